//! Exhausted resources (shared memory, descriptors, disk, file watches), unsafe permissions, and a suspended service.

use isotherm_tests::{
    Needs, RUN, TABLE, TestDomain, kill, may_mount, recording, round_trip, skip, table, text, variant, wait_until,
};
use rustix::process::Signal;
use std::fs;
use std::io::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};

/// A shell command that mounts a separate `/dev/shm`.
fn mount_private_shm(options: &str) -> String {
    format!("mount -t tmpfs -o {options} tmpfs /dev/shm")
}

#[test]
fn a_service_without_room_in_shared_memory_says_so() {
    if !may_mount() {
        return;
    }
    for (options, cause) in [
        ("size=16k", "shared memory /dev/shm is full: "),
        ("size=512k", "shared memory /dev/shm is full: "),
        ("size=1500k", "shared memory /dev/shm is full: "),
        ("ro", "shared memory /dev/shm cannot be written"),
    ] {
        let domain = TestDomain::new();
        domain.write("imu-a.toml", TABLE);
        let mut command =
            domain.isotherm_after(&["-m"], &mount_private_shm(options), &["serve", "--imu", "imu-a=imu-a.toml"]);
        let output = command.output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{options}: {message}");
        assert!(message.contains(cause), "{options}: {message}");
    }
}

/// The relay looks for the room of a client, and this many streams need more: it is missing in the middle.
#[test]
fn shared_memory_that_is_missing_while_streams_are_created_is_an_error() {
    if !may_mount() {
        return;
    }
    let domain = TestDomain::new();
    let imus: Vec<_> = (0..40).map(|number| format!("imu-{number}")).collect();
    let arguments = ["relay", "--domain", "from", "--to", "to"].into_iter();
    let arguments: Vec<_> = arguments.chain(imus.iter().flat_map(|imu| ["--imu", imu])).collect();
    for size in ["size=1536k", "size=1600k", "size=1664k"] {
        let output = domain.isotherm_after(&["-m"], &mount_private_shm(size), &arguments).output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{size}: {message}");
        assert!(message.contains("shared memory /dev/shm is full: "), "{size}: {message}");
    }
}

#[test]
fn shared_memory_that_fills_up_later_does_not_disturb_connected_clients() {
    if !may_mount() {
        return;
    }
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let mount = mount_private_shm("size=8m");
    let service = domain.start(domain.isotherm_after(&["-m"], &mount, &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    let beside = |pid: u32, arguments: &[&str]| {
        let command = domain.isotherm_after(&[], &format!("cd {}", domain.path("").display()), arguments);
        let shell: Vec<_> = command.get_args().map(ToOwned::to_owned).collect();
        let mut entered = Command::new("nsenter");
        entered.args(["-t", &pid.to_string(), "-m", "sh"]).args(shell);
        entered.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
        entered
    };
    let inside = |arguments: &[&str]| beside(service.pid(), arguments);
    let feed = domain.start(inside(&["feed", "--imu", "imu-a", "--rate", "2000", RUN, "-o", "fed.csv"]));
    wait_until("samples", || {
        let output = inside(&["status", "--json"]).output().unwrap();
        let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        status["imus"][0]["received"].as_u64().is_some_and(|received| received > 100)
    });
    let filler = format!("/proc/{}/root/dev/shm/filler", service.pid());
    let mut filler = fs::File::create(filler).unwrap();
    while filler.write_all(&[1; 4096]).is_ok() {}
    let refused = inside(&["feed", "--imu", "imu-a", RUN]).output().unwrap();
    assert_eq!(refused.status.code(), Some(74), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("shared memory /dev/shm is full: "), "{}", text(&refused.stderr));
    // The status is there all the same, each time a new one, and says why nobody else can connect.
    let mut received = Vec::new();
    for _ in 0..2 {
        let output = inside(&["status", "--json"]).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("shared memory /dev/shm is full: "), "{}", text(&output.stderr));
        let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(status["pid"], service.pid());
        received.push((status["taken_ns"].as_u64().unwrap(), status["imus"][0]["received"].as_u64().unwrap()));
    }
    assert!(received[1].0 > received[0].0 && received[1].1 >= received[0].1, "{received:?}");
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(domain.path("fed.csv")).unwrap() == replayed);
    // Nothing is left of it when there is room, and a service that is gone has none.
    let note = std::path::Path::new(domain.client_domain().root_path())
        .join(format!("{}status.json", domain.client_domain().prefix()));
    assert!(note.exists());
    let mut stays = Command::new("nsenter");
    stays.args(["-t", &service.pid().to_string(), "-m", "sleep", "1000"]);
    let stays = domain.start(stays);
    drop(filler);
    let filler = format!("/proc/{}/root/dev/shm/filler", service.pid());
    fs::remove_file(&filler).unwrap();
    wait_until("room", || !note.exists());
    assert!(inside(&["status"]).output().unwrap().stderr.is_empty());
    let mut filler = fs::File::create(filler).unwrap();
    while filler.write_all(&[1; 4096]).is_ok() {}
    wait_until("no room", || note.exists());
    service.kill();
    let output = beside(stays.pid(), &["status"]).output().unwrap();
    assert_eq!(output.status.code(), Some(74), "{}", text(&output.stdout));
}

/// Each allocation of shared memory that a signal has interrupted is done again, so that no page is missing later.
#[test]
fn shared_memory_is_allocated_although_signals_interrupt() {
    match Command::new("strace").args(["-e", "trace=none", "true"]).output() {
        Err(_) => return skip("there is no strace", Needs::Program),
        Ok(output) if !output.status.success() => return skip("this user may not trace", Needs::Machine),
        Ok(_) => {}
    }
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let calls = domain.path("calls");
    let plain = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let mut traced = Command::new("strace");
    traced.args(["-f", "-e", "trace=fallocate", "-e", "inject=fallocate:error=EINTR:when=1+2", "-o"]).arg(&calls);
    traced.arg(plain.get_program()).args(plain.get_args()).current_dir(domain.path("")).stdin(Stdio::null());
    traced.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let traced = domain.start(traced);
    traced.wait_for_log("ready");
    round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
    kill(domain.status()["pid"].as_u64().unwrap() as u32, Signal::TERM);
    let (status, log) = traced.wait();
    assert!(status.success(), "{log}");
    let calls = fs::read_to_string(&calls).unwrap();
    let (interrupted, done) = (calls.matches("EINTR").count(), calls.matches(" = 0\n").count());
    assert!(interrupted > 5 && done == interrupted, "{calls}");
}

#[test]
fn leftovers_of_killed_services_do_not_prevent_the_next_start() {
    if !may_mount() {
        return;
    }
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    // Room for one service, not for two.
    let preparation = mount_private_shm("size=2900k")
        + " && for n in 1 2 3; do \"$0\" serve --imu imu-a=imu-a.toml 2> log & \
             until grep ready log || ! kill -0 $!; do sleep 0.01; done; kill -KILL $!; wait $!; done; true";
    let mut command = domain.isotherm_after(&["-m"], &preparation, &["clean"]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).matches("ready").count(), 3, "{}", fs::read_to_string(domain.path("log")).unwrap());
}

#[test]
fn a_domains_folder_that_cannot_be_used_is_named() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let serve = |root: &str| {
        let mut command = domain.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
        let output = command.env("ISOTHERM_ROOT", root).output().unwrap();
        assert_eq!(output.status.code(), Some(74), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("the domain's folder "), "{}", text(&output.stderr));
    };
    serve("/dev/null");
    serve("/proc");
    if may_mount() {
        fs::create_dir(domain.path("small")).unwrap();
        for options in ["size=16k", "ro", "size=1m,nr_inodes=8"] {
            let mount = format!("mount -t tmpfs -o {options} tmpfs small && export ISOTHERM_ROOT=$PWD/small");
            let mut command = domain.isotherm_after(&["-m"], &mount, &["serve", "--imu", "imu-a=imu-a.toml"]);
            let output = command.output().unwrap();
            assert_eq!(output.status.code(), Some(74), "{options}: {}", text(&output.stderr));
            assert!(text(&output.stderr).contains("the domain's folder "), "{options}: {}", text(&output.stderr));
        }
    }
    let mut command = domain.isotherm(&["status"]);
    let output = command.env("ISOTHERM_DOMAIN", std::ffi::OsStr::from_bytes(b"\xff")).output().unwrap();
    assert_eq!(output.status.code(), Some(64), "{}", text(&output.stderr));
}

/// Closes what a child inherits from this process, the transport's sockets of tests that run meanwhile, and limits the
/// number of its descriptors. Only bash closes descriptors of two digits.
fn limited(limit: u32) -> String {
    let close =
        "for file in /proc/self/fd/*; do number=${file##*/}; [ $number -le 2 ] || eval \"exec $number>&-\"; done";
    format!("exec bash -c '{close}; ulimit -n {limit}; exec \"$0\" \"$@\"' \"$0\" \"$@\"")
}

#[test]
fn too_few_descriptors_are_named_as_the_cause() {
    let mut refused = 0;
    for limit in (10..=94).step_by(4) {
        let domain = TestDomain::new();
        domain.write("imu-a.toml", TABLE);
        let service =
            domain.start(domain.isotherm_after(&[], &limited(limit), &["serve", "--imu", "imu-a=imu-a.toml"]));
        wait_until("readiness or an end", || service.count_in_log("ready") > 0 || service.has_ended());
        if service.count_in_log("ready") > 0 {
            round_trip(&mut domain.acquisition("imu-a"), &recording()[0]);
            service.terminate();
            continue;
        }
        let (status, log) = service.wait();
        assert_eq!(status.code(), Some(74), "{limit}: {log}");
        assert!(log.contains(&format!("may open {limit} files and needs ")), "{limit}: {log}");
        refused += 1;
    }
    assert!((3..19).contains(&refused), "{refused} limits were too low");
}

#[test]
fn a_full_disk_leaves_the_old_file_whole() {
    if !may_mount() {
        return;
    }
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    fs::create_dir(domain.path("small")).unwrap();
    let campaign = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/campaign.toml");
    // The padded table has no room for a second copy. The other results need more room than there is.
    let padded = format!("{TABLE}\n#{}", "x".repeat(30_000));
    domain.write("padded.toml", &padded);
    for (arguments, file) in [
        (&["replay", "--table", "imu-a.toml", RUN, "-o", "small/old"][..], "run"),
        (&["calibrate", "turntable", campaign, "-o", "small/old"], "table"),
        (&["calibrate", "turntable", campaign, "-o", "table.toml", "--report", "small/old"], "report"),
        (&["check", "--seal", "small/old"], "seal"),
    ] {
        let (source, fill) = if file == "seal" {
            ("padded.toml", "true")
        } else {
            ("imu-a.toml", "head -c 40000 /dev/zero > small/fill")
        };
        let size = if file == "seal" { "size=48k" } else { "size=60k" };
        let preparation = format!("mount -t tmpfs -o {size} tmpfs small && cp {source} small/old && {fill}");
        // The mount disappears with the command, so the same shell compares the files.
        let compare = format!("\"$0\" \"$@\"; code=$?; cmp {source} small/old && ls -A small >&2; exit $code");
        let mut command = domain.isotherm_after(&["-m"], &format!("{preparation}; {compare}; true"), arguments);
        let output = command.output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{file}: {message}");
        assert!(message.contains("No space left on device") && message.contains("small/old"), "{file}: {message}");
        let mut left: Vec<_> = message.lines().filter(|line| ["old", "fill"].contains(line)).collect();
        left.sort_unstable();
        assert_eq!(left.last(), Some(&"old"), "{file}: {message}{}", text(&output.stdout));
        assert!(!message.contains("\n.iso"), "{file}: something is left behind: {message}");
    }
}

#[test]
fn without_file_watches_tables_are_polled() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    // The limit of inotify instances is separate in each user namespace.
    let limit = "echo 0 > /proc/sys/user/max_inotify_instances";
    if !domain.isotherm_after(&["-Ur"], limit, &["--version"]).output().is_ok_and(|output| output.status.success()) {
        skip("this user may not have a user namespace", Needs::Machine);
        return;
    }
    let service = domain.start(domain.isotherm_after(&["-Ur"], limit, &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    assert_eq!(service.count_in_log("watching a table's folder"), 1, "{}", service.log());
    assert_eq!(service.count_in_log("checked every 50 ms instead"), 1, "{}", service.log());
    domain.replace("imu-a.toml", &variant(1));
    let mut acquisition = domain.acquisition("imu-a");
    let next = table(&variant(1)).id();
    wait_until("the new table", || round_trip(&mut acquisition, &recording()[0]).table == next);
    service.terminate();
}

#[test]
fn trust_files_are_refused_unless_allowed() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    domain.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
    let set_mode = |name: &str, mode| fs::set_permissions(domain.path(name), fs::Permissions::from_mode(mode)).unwrap();
    for name in ["imu-a.toml", "service.toml"] {
        set_mode(name, 0o666);
        for command in [&["serve", "--config", "service.toml"][..], &["check", name]] {
            let output = domain.run(command);
            assert_eq!(output.status.code(), Some(78), "{command:?}");
            let message = text(&output.stderr);
            assert!(message.contains(&format!("{name}:1: everybody may write it; chmod o-w ")), "{message}");
        }
        domain.run_ok(&["check", "--allow-world-writable", name]);
        set_mode(name, 0o644);
    }
    let service = domain.serve(&["--config", "service.toml"]);
    domain.write("next.toml", &variant(1));
    set_mode("next.toml", 0o646);
    fs::rename(domain.path("next.toml"), domain.path("imu-a.toml")).unwrap();
    service.wait_for_log("table refused, the one in force stays: ");
    assert!(service.log().contains("everybody may write it"), "{}", service.log());
    set_mode("imu-a.toml", 0o640);
    service.wait_for_log("table taken");
    service.terminate();
    set_mode("imu-a.toml", 0o646);
    domain.serve(&["--config", "service.toml", "--allow-world-writable"]).terminate();
}

/// For the processes this is as when the machine is suspended.
#[test]
fn a_service_that_was_stopped_continues_without_loss() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "1000", "--window", "8", RUN, "-o", "fed.csv"]);
    for received in [200, 600] {
        wait_until("samples", || domain.imu_status()["received"].as_u64().unwrap() > received);
        service.stop();
        // Longer than all intervals of one or two seconds: resends, housekeeping, statistics.
        std::thread::sleep(std::time::Duration::from_millis(2_500));
        service.resume();
    }
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let replayed = domain.run_ok(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(domain.path("fed.csv")).unwrap() == replayed, "each once, in order");
    assert_eq!(domain.imu_status()["gaps"], 0);
    assert_eq!(service.count_in_log("stands still"), 0, "{}", service.log());
    service.terminate();
}

/// A program that a client executes must not hold what shows that the client lives.
#[test]
fn no_file_of_a_domain_is_left_open_over_exec() {
    const CLOSES: u32 = 0o2_000_000;
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let recorder = domain.spawn(&["record", "--imu", "imu-a", "-o", "flight.csv"]);
    let feed = domain.spawn(&["feed", "--imu", "imu-a", "--rate", "1000", RUN, "-o", "fed.csv"]);
    wait_until("samples", || domain.imu_status()["compensated"].as_u64().unwrap() > 100);
    let prefix = domain.client_domain().prefix();
    for process in [&service, &recorder, &feed] {
        let (mut closed, mut left) = (0, Vec::new());
        for file in fs::read_dir(format!("/proc/{}/fd", process.pid())).unwrap().flatten() {
            let Ok(target) = fs::read_link(file.path()) else { continue };
            let name = target.file_name().unwrap().to_string_lossy().into_owned();
            let number = file.file_name().to_string_lossy().into_owned();
            let Ok(info) = fs::read_to_string(format!("/proc/{}/fdinfo/{number}", process.pid())) else { continue };
            let flags = info.lines().find_map(|line| line.strip_prefix("flags:")).unwrap().trim();
            match u32::from_str_radix(flags, 8).unwrap() & CLOSES {
                _ if !name.starts_with(&prefix) => {}
                0 => left.push(name),
                _ => closed += 1,
            }
        }
        assert!(closed > 10 && left.is_empty(), "{closed} {left:?}");
    }
    feed.kill();
    recorder.kill();
    service.terminate();
}
