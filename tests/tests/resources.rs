//! What the machine can run out of: shared memory, descriptors, disk, file watches; and time that passes without us.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{
    Needs, RUN, TABLE, World, may_mount, recording, round_trip, skip, table, text, variant, wait_until,
};
use std::fs;
use std::io::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::PermissionsExt as _;

/// A shell's words that give the commands behind them a shared memory of their own.
fn own_memory(options: &str) -> String {
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
        let world = World::new();
        world.write("imu-a.toml", TABLE);
        let mut command = world.isotherm_after(&["-m"], &own_memory(options), &["serve", "--imu", "imu-a=imu-a.toml"]);
        let output = command.output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(74), "{options}: {message}");
        assert!(message.contains(cause), "{options}: {message}");
    }
}

#[test]
fn shared_memory_that_fills_up_later_hurts_nobody_who_is_there() {
    if !may_mount() {
        return;
    }
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let mount = own_memory("size=8m");
    let service = world.start(world.isotherm_after(&["-m"], &mount, &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    let inside = |arguments: &[&str]| {
        let pid = service.pid().to_string();
        let command = world.isotherm_after(&[], &format!("cd {}", world.path("").display()), arguments);
        let shell: Vec<_> = command.get_args().map(ToOwned::to_owned).collect();
        let mut entered = std::process::Command::new("nsenter");
        entered.args(["-t", &pid, "-m", "sh"]).args(shell);
        entered.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
        entered
    };
    let feed = world.start(inside(&["feed", "--imu", "imu-a", "--rate", "2000", RUN, "-o", "fed.csv"]));
    wait_until("samples", || {
        let output = inside(&["status", "--json"]).output().unwrap();
        let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        status["imus"][0]["received"].as_u64().is_some_and(|received| received > 100)
    });
    let filler = format!("/proc/{}/root/dev/shm/filler", service.pid());
    let mut filler = fs::File::create(filler).unwrap();
    while filler.write_all(&[1; 4096]).is_ok() {}
    let refused = inside(&["status"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(74), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("shared memory /dev/shm is full: "), "{}", text(&refused.stderr));
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let replayed = world.run_well(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(world.path("fed.csv")).unwrap() == replayed);
    service.terminate();
}

#[test]
fn what_a_killed_service_has_left_does_not_keep_the_next_one_out() {
    if !may_mount() {
        return;
    }
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    // Room for one service, not for two.
    let preparation = own_memory("size=2600k")
        + " && for n in 1 2 3; do \"$0\" serve --imu imu-a=imu-a.toml 2> log & \
             until grep ready log || ! kill -0 $!; do sleep 0.01; done; kill -KILL $!; wait $!; done; true";
    let mut command = world.isotherm_after(&["-m"], &preparation, &["clean"]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).matches("ready").count(), 3, "{}", fs::read_to_string(world.path("log")).unwrap());
}

#[test]
fn a_domains_folder_that_cannot_be_used_is_named() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    let serve = |root: &str| {
        let mut command = world.isotherm(&["serve", "--imu", "imu-a=imu-a.toml"]);
        let output = command.env("ISOTHERM_ROOT", root).output().unwrap();
        assert_eq!(output.status.code(), Some(74), "{}", text(&output.stderr));
        assert!(text(&output.stderr).contains("the domain's folder "), "{}", text(&output.stderr));
    };
    serve("/dev/null");
    serve("/proc");
    if may_mount() {
        fs::create_dir(world.path("small")).unwrap();
        for options in ["size=16k", "ro", "size=1m,nr_inodes=8"] {
            let mount = format!("mount -t tmpfs -o {options} tmpfs small && export ISOTHERM_ROOT=$PWD/small");
            let mut command = world.isotherm_after(&["-m"], &mount, &["serve", "--imu", "imu-a=imu-a.toml"]);
            let output = command.output().unwrap();
            assert_eq!(output.status.code(), Some(74), "{options}: {}", text(&output.stderr));
            assert!(text(&output.stderr).contains("the domain's folder "), "{options}: {}", text(&output.stderr));
        }
    }
    let mut command = world.isotherm(&["status"]);
    let output = command.env("ISOTHERM_DOMAIN", std::ffi::OsStr::from_bytes(b"\xff")).output().unwrap();
    assert_eq!(output.status.code(), Some(64), "{}", text(&output.stderr));
}

#[test]
fn too_few_descriptors_are_named_as_the_cause() {
    let mut refused = 0;
    for limit in (10..=66).step_by(4) {
        let world = World::new();
        world.write("imu-a.toml", TABLE);
        let limited = format!("ulimit -n {limit}");
        let service = world.start(world.isotherm_after(&[], &limited, &["serve", "--imu", "imu-a=imu-a.toml"]));
        wait_until("readiness or an end", || service.count_in_log("ready") > 0 || service.has_ended());
        if service.count_in_log("ready") > 0 {
            round_trip(&mut world.acquisition("imu-a"), &recording()[0]);
            service.terminate();
            continue;
        }
        let (status, log) = service.wait();
        assert_eq!(status.code(), Some(74), "{limit}: {log}");
        assert!(log.contains(&format!("may open {limit} files and needs ")), "{limit}: {log}");
        refused += 1;
    }
    assert!((3..14).contains(&refused), "{refused} limits were too low");
}

#[test]
fn a_full_disk_leaves_the_old_file_whole() {
    if !may_mount() {
        return;
    }
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    fs::create_dir(world.path("small")).unwrap();
    let campaign = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/campaign.toml");
    // The commented table has no room beside itself; the others have less than they need.
    let padded = format!("{TABLE}\n#{}", "x".repeat(30_000));
    world.write("padded.toml", &padded);
    for (arguments, file) in [
        (&["replay", "--table", "imu-a.toml", RUN, "-o", "small/old"][..], "run"),
        (&["calibrate", campaign, "-o", "small/old"], "table"),
        (&["calibrate", campaign, "-o", "table.toml", "--report", "small/old"], "report"),
        (&["check", "--seal", "small/old"], "seal"),
    ] {
        let (source, fill) = if file == "seal" {
            ("padded.toml", "true")
        } else {
            ("imu-a.toml", "head -c 40000 /dev/zero > small/fill")
        };
        let size = if file == "seal" { "size=48k" } else { "size=60k" };
        let preparation = format!("mount -t tmpfs -o {size} tmpfs small && cp {source} small/old && {fill}");
        // What the mount holds is gone with the command: it is compared inside.
        let compare = format!("\"$0\" \"$@\"; code=$?; cmp {source} small/old && ls -A small >&2; exit $code");
        let mut command = world.isotherm_after(&["-m"], &format!("{preparation}; {compare}; true"), arguments);
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
fn without_file_watches_tables_are_looked_at() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    // A user namespace has a limit of its own.
    let limit = "echo 0 > /proc/sys/user/max_inotify_instances";
    if !world.isotherm_after(&["-Ur"], limit, &["--version"]).output().is_ok_and(|output| output.status.success()) {
        skip("this user may not have a user namespace", Needs::Machine);
        return;
    }
    let service = world.start(world.isotherm_after(&["-Ur"], limit, &["serve", "--imu", "imu-a=imu-a.toml"]));
    service.wait_for_log("ready");
    assert_eq!(service.count_in_log("watching a table's folder"), 1, "{}", service.log());
    assert_eq!(service.count_in_log("looked at every 50 ms instead"), 1, "{}", service.log());
    world.replace("imu-a.toml", &variant(1));
    let mut acquisition = world.acquisition("imu-a");
    let next = table(&variant(1)).id();
    wait_until("the new table", || round_trip(&mut acquisition, &recording()[0]).table == next);
    service.terminate();
}

#[test]
fn what_everybody_may_write_is_refused_unless_allowed() {
    let world = World::new();
    world.write("imu-a.toml", TABLE);
    world.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
    let permit = |name: &str, mode| fs::set_permissions(world.path(name), fs::Permissions::from_mode(mode)).unwrap();
    for name in ["imu-a.toml", "service.toml"] {
        permit(name, 0o666);
        for command in [&["serve", "--config", "service.toml"][..], &["check", name]] {
            let output = world.run(command);
            assert_eq!(output.status.code(), Some(78), "{command:?}");
            let message = text(&output.stderr);
            assert!(message.contains(&format!("{name}:1: everybody may write it; chmod o-w ")), "{message}");
        }
        world.run_well(&["check", "--allow-world-writable", name]);
        permit(name, 0o644);
    }
    let service = world.serve(&["--config", "service.toml"]);
    world.write("next.toml", &variant(1));
    permit("next.toml", 0o646);
    fs::rename(world.path("next.toml"), world.path("imu-a.toml")).unwrap();
    service.wait_for_log("table refused, the one in force stays: ");
    assert!(service.log().contains("everybody may write it"), "{}", service.log());
    permit("imu-a.toml", 0o640);
    service.wait_for_log("table taken");
    service.terminate();
    permit("imu-a.toml", 0o646);
    world.serve(&["--config", "service.toml", "--allow-world-writable"]).terminate();
}

/// A machine that is suspended, as far as its processes see it.
#[test]
fn a_service_that_was_stopped_goes_on_where_it_was() {
    let world = World::new();
    let service = world.serve_recording();
    let feed = world.spawn(&["feed", "--imu", "imu-a", "--rate", "1000", "--window", "8", RUN, "-o", "fed.csv"]);
    for received in [200, 600] {
        wait_until("samples", || world.imu_status()["received"].as_u64().unwrap() > received);
        service.stop();
        // Longer than everything that is timed in seconds: resends, housekeeping, windows.
        std::thread::sleep(std::time::Duration::from_millis(2_500));
        service.go_on();
    }
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    let replayed = world.run_well(&["replay", "--table", "imu-a.toml", RUN]);
    assert!(fs::read_to_string(world.path("fed.csv")).unwrap() == replayed, "each once, in order");
    assert_eq!(world.imu_status()["gaps"], 0);
    assert_eq!(service.count_in_log("stands still"), 0, "{}", service.log());
    service.terminate();
}
