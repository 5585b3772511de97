//! Other users of the machine: what they put into folders that everybody may write must not stop, mislead or slow down
//! a domain.
//!
//! The other user is `nobody`, so only root can run these tests.

use iceoryx2::prelude::{NodeBuilder, ipc};
use isotherm_client::transport::stream::configuration;
use isotherm_client::{Domain, join};
use isotherm_tests::{Needs, Process, RUN, TestDomain, skip, text, wait_until};
use rustix::process::Signal;
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

const NOBODY: u32 = 65_534;

/// A shell of the user nobody that runs `script`, with `$1` as its argument; `None` if this process may not change its
/// user.
fn neighbour(script: &str, argument: &Path) -> Option<Command> {
    if !rustix::process::geteuid().is_root() {
        skip("only root can be another user", Needs::Machine);
        return None;
    }
    let mut command = Command::new("sh");
    command.args(["-c", script, "sh"]).arg(argument).uid(NOBODY).gid(NOBODY).current_dir("/").stdin(Stdio::null());
    Some(command)
}

/// Runs a script of the user nobody to its end; false if that is not possible here.
fn plant(script: &str, argument: &Path) -> bool {
    let Some(mut command) = neighbour(script, argument) else { return false };
    assert!(command.status().unwrap().success(), "{script}");
    true
}

/// Objects that anybody can make, each by a shell command.
const OBJECTS: [(&str, &str); 9] = [
    ("pipe", "mkfifo -m 666 $1"),
    ("empty file", "touch $1 && chmod 666 $1"),
    ("half-created object", "touch $1 && chmod 200 $1"),
    ("sparse file of 1 TB", "truncate -s 1T $1 && chmod 666 $1"),
    ("sparse file of 1 GB", "truncate -s 1G $1 && chmod 666 $1"),
    ("link to nothing", "ln -s /nowhere/x $1"),
    ("link to a terminal", "ln -s /dev/tty $1"),
    ("link to itself", "ln -s $1 $1"),
    ("folder", "mkdir -m 777 $1"),
];

fn in_shared_memory(domain: &Domain, name: &str) -> PathBuf {
    PathBuf::from(format!("/dev/shm/{}{name}", domain.prefix()))
}

/// Removes what a test has planted, also if the test fails.
struct Planted(Vec<PathBuf>);

impl Drop for Planted {
    fn drop(&mut self) {
        for path in &self.0 {
            let _ = fs::remove_file(path).or_else(|_| fs::remove_dir(path));
        }
    }
}

/// Uses the service as its clients do, and ends it.
fn assert_usable(domain: &TestDomain, service: Process) {
    domain.run_ok(&["feed", "--imu", "imu-a", "--timeout", "10", RUN, "-o", "fed.csv"]);
    domain.run_ok(&["status"]);
    service.terminate();
    domain.run_ok(&["clean"]);
}

#[test]
fn objects_of_other_users_in_shared_memory_are_ignored() {
    let domain = TestDomain::new();
    let prefix = domain.client_domain();
    let counter = counter_of_nodes(prefix);
    // All at once under names of no meaning, then each in the place of the transport's default counter of nodes.
    let names = (0..OBJECTS.len()).map(|index| in_shared_memory(prefix, &format!("x{index}")));
    let rounds = [names.zip(OBJECTS).collect::<Vec<_>>()]
        .into_iter()
        .chain(OBJECTS.map(|object| vec![(counter.clone(), object)]));
    for round in rounds {
        let mut planted = Planted(Vec::new());
        let free = free_shared_memory();
        for (path, (object, script)) in round {
            planted.0.push(path.clone());
            if !plant(script, &path) {
                return;
            }
            eprintln!("{object}: {}", path.display());
        }
        assert_usable(&domain, domain.serve_recording());
        for path in &planted.0 {
            assert_eq!(fs::symlink_metadata(path).unwrap().uid(), NOBODY, "{} was replaced", path.display());
        }
        // The pages of the sparse files stay unallocated: 1 GB would show.
        assert!(free.saturating_sub(free_shared_memory()) < 500_000_000);
    }
}

/// The path of the object that programs without Isotherm's client make when they join.
fn counter_of_nodes(domain: &Domain) -> PathBuf {
    let node = NodeBuilder::new().config(&configuration(domain).unwrap()).create::<ipc::Service>().unwrap();
    let mut objects = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let prefix = in_shared_memory(domain, "").into_os_string().into_string().unwrap();
    let counter = objects
        .find(|path| path.to_str().is_some_and(|path| path.starts_with(&prefix) && path.ends_with(".global_mgmt")));
    drop(node);
    let counter = counter.unwrap();
    fs::remove_file(&counter).unwrap();
    fs::remove_dir_all(domain.root_path()).unwrap();
    counter
}

fn free_shared_memory() -> u64 {
    let found = rustix::fs::statvfs("/dev/shm").unwrap();
    found.f_bavail * found.f_frsize
}

#[test]
fn an_object_in_the_place_of_a_stream_is_named_and_a_new_service_makes_another() {
    let domain = TestDomain::new();
    domain.serve_recording().kill();
    // As after a restart of the machine: the memory is gone, the small files of the streams remain.
    let own = fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let prefix = in_shared_memory(domain.client_domain(), "").into_os_string().into_string().unwrap();
    let own: Vec<_> = own.filter(|path| path.to_str().is_some_and(|path| path.starts_with(&prefix))).collect();
    let mut planted = Planted(Vec::new());
    for path in own {
        fs::remove_file(&path).unwrap();
        if path.extension().is_some_and(|ending| ending == "dynamic") {
            if !plant("touch $1 && chmod 666 $1", &path) {
                return;
            }
            planted.0.push(path);
        }
    }
    assert!(planted.0.len() > 2, "{:?}", planted.0);
    let output = domain.run(&["feed", "--imu", "imu-a", "--timeout", "1", RUN, "-o", "fed.csv"]);
    let message = text(&output.stderr);
    assert!(message.contains("is not this user's; its owner or root can remove it"), "{message}");
    assert_eq!(output.status.code(), Some(77));
    assert_usable(&domain, domain.serve_recording());
}

#[test]
fn half_created_objects_of_others_do_not_delay_and_joining_has_a_deadline() {
    let domain = TestDomain::new();
    // Always a new one: none ever becomes old enough to be removed.
    let storm = "i=0; while :; do i=$((i+1)); (umask 577; : > \"$1.$i\"); rm -f \"$1.$((i-20))\"; done";
    let path = in_shared_memory(domain.client_domain(), "storm");
    let Some(mut command) = neighbour(storm, &path) else { return };
    command.stderr(Stdio::null());
    let neighbour = domain.start(command);
    wait_until("the storm", || path.with_extension("3").exists() || path.with_extension("300").exists());
    assert_usable(&domain, domain.serve_recording());
    neighbour.kill();

    // The same by this user: its own half-created objects count, but not without limit.
    let mut command = Command::new("sh");
    command.args(["-c", storm, "sh"]).arg(in_shared_memory(domain.client_domain(), "own"));
    let own = domain.start(command);
    let output = domain.run(&["serve", "--imu", "imu-a=imu-a.toml"]);
    let message = text(&output.stderr);
    assert!(message.contains("processes of this user keep creating objects"), "{message}");
    own.kill();
    domain.run_ok(&["clean"]);
}

#[test]
fn nothing_in_shared_memory_is_open_to_other_users() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    domain.run_ok(&["feed", "--imu", "imu-a", RUN, "-o", "fed.csv"]);
    let open_to_others = || {
        let prefix = domain.client_domain().prefix();
        let objects = fs::read_dir("/dev/shm").unwrap().flatten();
        let objects = objects.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        let modes = objects.filter_map(|entry| Some((entry.path(), entry.metadata().ok()?.mode())));
        modes.filter(|(_, mode)| mode & 0o077 != 0).collect::<Vec<_>>()
    };
    assert_eq!(open_to_others(), []);
    let folder = fs::read_dir(domain.client_domain().root_path()).unwrap().flatten();
    let files: Vec<_> = folder.filter(|entry| entry.file_type().unwrap().is_file()).collect();
    assert!(!files.is_empty());
    for file in files {
        assert_eq!(file.metadata().unwrap().mode() & 0o077, 0, "{}", file.path().display());
    }
    // A program that uses the transport without Isotherm's client leaves an object that everybody may write.
    let config = configuration(domain.client_domain()).unwrap();
    let node = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
    wait_until("the service to close it", || open_to_others().is_empty());
    drop(node);
    service.terminate();
}

/// A folder that everybody may write, with the sticky bit, as `/tmp`; and a domain in it.
fn shared_parent(domain: &TestDomain) -> (PathBuf, Domain) {
    fs::set_permissions(domain.path(""), Permissions::from_mode(0o755)).unwrap();
    let parent = domain.path("shared");
    fs::create_dir(&parent).unwrap();
    fs::set_permissions(&parent, Permissions::from_mode(0o1777)).unwrap();
    let name = domain.client_domain().name();
    (parent.clone(), Domain::new(name, &format!("{}/{name}", parent.display())).unwrap())
}

fn assert_refused(domain: &TestDomain, parent: &Path, expected: &str) {
    for arguments in [&["status"][..], &["serve", "--imu", "imu-a=imu-a.toml"], &["clean"]] {
        let mut command = domain.isotherm(arguments);
        command.env("ISOTHERM_ROOT", parent);
        let output = domain.finish(command);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(77), "{message}");
        for part in [expected, "ISOTHERM_ROOT", "--domain"] {
            assert!(message.contains(part), "{arguments:?}: {message}");
        }
    }
}

#[test]
fn a_folder_or_link_that_another_user_made_first_is_refused_with_the_remedy() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", isotherm_tests::TABLE);
    let (parent, shared) = shared_parent(&domain);
    let root = Path::new(shared.root_path());
    if !plant("mkdir $1", root) {
        return;
    }
    assert_refused(&domain, &parent, "user 65534 made ");
    fs::remove_dir(root).unwrap();
    // A link to a folder of root: the owner behind the link would be right.
    let own = domain.path("own");
    fs::create_dir(&own).unwrap();
    assert!(plant(&format!("ln -s {} $1", own.display()), root));
    // An old file that looks like a stream that was left half-created.
    let precious = own.join("services").join(format!("{}precious", shared.prefix()));
    fs::create_dir(own.join("services")).unwrap();
    let file = fs::File::create(&precious).unwrap();
    file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
    fs::set_permissions(&precious, Permissions::from_mode(0o600)).unwrap();
    assert_refused(&domain, &parent, "is a link of user 65534");
    assert!(precious.exists() && fs::read_dir(&own).unwrap().count() == 1);
    fs::remove_dir_all(own.join("services")).unwrap();
    fs::remove_file(root).unwrap();
    assert!(plant("mkfifo $1", root));
    assert_refused(&domain, &parent, "is not a folder");
    fs::remove_file(root).unwrap();

    // Where nobody else may make one, a link is followed.
    fs::set_permissions(&parent, Permissions::from_mode(0o755)).unwrap();
    symlink(&own, root).unwrap();
    join(&shared).unwrap();
    fs::remove_file(root).unwrap();

    // Without the sticky bit everybody could replace the folder later.
    fs::set_permissions(&parent, Permissions::from_mode(0o777)).unwrap();
    let message = join(&shared).unwrap_err().to_string();
    assert!(message.contains("everybody may replace "), "{message}");
    for path in fs::read_dir("/dev/shm").unwrap().flatten() {
        if path.file_name().to_string_lossy().starts_with(&shared.prefix()) {
            fs::remove_file(path.path()).unwrap();
        }
    }
}

/// A file, or a link to one of root's, that another user has put where the path was away: refused by the service, at
/// the start and while it runs. One-shot commands read what their user names.
#[test]
fn a_table_or_configuration_of_another_user_is_refused() {
    let domain = TestDomain::new();
    let (parent, _) = shared_parent(&domain);
    let elsewhere = domain.write("elsewhere.toml", isotherm_tests::TABLE);
    let [table, configuration] = ["imu-a.toml", "service.toml"].map(|name| parent.join(name));
    let own = || {
        fs::write(&table, isotherm_tests::TABLE).unwrap();
        fs::write(&configuration, "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n").unwrap();
    };
    let arguments = ["serve", "--config", configuration.to_str().unwrap()];
    let as_link = format!("ln -s {} $1", elsewhere.display());
    let as_file = |text: &str| format!("cat > $1 <<'end'\n{text}end");
    let next = as_file(&isotherm_tests::variant(1));
    for script in [&as_link, &next] {
        own();
        let service = domain.serve(&arguments[1..]);
        fs::remove_file(&table).unwrap();
        if !plant(script, &table) {
            return;
        }
        let assert_refused = |service: Process| {
            service.wait_for_log(&format!("{}:1: it belongs to user 65534, ", table.display()));
            let status = domain.run_ok(&["status"]);
            assert!(status.contains("REFUSED") && status.contains("chown -h 0 "), "{status}");
            service.terminate();
        };
        assert_refused(service);
        // A start has the kept table.
        assert_refused(domain.serve(&arguments[1..]));
        fs::remove_file(&table).unwrap();
    }
    let forget = || {
        fs::remove_dir_all(domain.path(".state")).unwrap();
        domain.run_ok(&["clean"]);
    };
    forget();
    for (path, scripts) in [
        (&table, [as_link.clone(), next.clone()]),
        (&configuration, [as_link, as_file("[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n")]),
    ] {
        for script in scripts {
            own();
            fs::remove_file(path).unwrap();
            assert!(plant(&script, path));
            let output = domain.run(&arguments);
            let message = text(&output.stderr);
            assert_eq!(output.status.code(), Some(78), "{message}");
            for part in [":1: it belongs to user 65534, ", "chown -h 0 ", "--allow-world-writable"] {
                assert!(message.contains(part), "{message}");
            }
            // Its user has named it.
            if !path.is_symlink() {
                domain.run_ok(&["check", path.to_str().unwrap()]);
                domain.serve(&[&arguments[1..], &["--allow-world-writable"]].concat()).terminate();
                forget();
            }
            fs::remove_file(path).unwrap();
        }
    }
    own();
    fs::remove_file(&table).unwrap();
    assert!(plant(&next, &table));
    domain.run_ok(&["replay", "--table", table.to_str().unwrap(), RUN, "-o", "replayed.csv"]);
}

#[test]
fn results_do_not_follow_what_another_user_has_put_into_a_shared_folder() {
    let domain = TestDomain::new();
    let table = domain.write("imu-a.toml", isotherm_tests::TABLE);
    let victim = domain.write("victim.txt", "precious");
    let (parent, _) = shared_parent(&domain);
    let output = parent.join("o.csv");
    for script in [format!("ln -s {} $1", victim.display()), "mkfifo -m 666 $1".to_owned(), "echo x > $1".to_owned()] {
        if !plant(&script, &output) {
            return;
        }
        let arguments = ["replay", "--table", table.to_str().unwrap(), RUN, "-o", output.to_str().unwrap()];
        let refused = domain.run(&arguments);
        let message = text(&refused.stderr);
        assert_eq!(refused.status.code(), Some(74), "{script}: {message}");
        assert!(message.contains("o.csv: it belongs to user 65534"), "{message}");
        assert_eq!(fs::read_to_string(&victim).unwrap(), "precious");
        fs::remove_file(&output).unwrap();
    }
    // One's own entries are used as anywhere.
    symlink(domain.path("mine.csv"), &output).unwrap();
    domain.run_ok(&["replay", "--table", table.to_str().unwrap(), RUN, "-o", output.to_str().unwrap()]);
    assert!(domain.path("mine.csv").exists());
}

#[test]
fn links_that_another_user_flips_never_lead_into_another_folder() {
    let domain = TestDomain::new();
    let (parent, shared) = shared_parent(&domain);
    let target = parent.join("target");
    fs::create_dir(&target).unwrap();
    fs::set_permissions(&target, Permissions::from_mode(0o777)).unwrap();
    let flips = format!("while :; do ln -s {} $1; rm $1; mkdir $1; rmdir $1; done", target.display());
    let Some(mut command) = neighbour(&flips, Path::new(shared.root_path())) else { return };
    command.stderr(Stdio::null());
    let mut neighbour = domain.start(command);
    let (mut joined, mut refused) = (0, 0);
    for _ in 0..1000 {
        match join(&shared) {
            Ok(_) => {
                // From here on the folder is this user's, and the sticky bit keeps it there. Remove it for the next
                // try.
                let found = fs::symlink_metadata(shared.root_path()).unwrap();
                assert!(found.is_dir() && found.uid() == 0);
                joined += 1;
                neighbour.signal(Signal::STOP);
                fs::remove_dir_all(shared.root_path()).unwrap();
                neighbour.signal(Signal::CONT);
            }
            Err(_) => refused += 1,
        }
        assert_eq!(fs::read_dir(&target).unwrap().count(), 0, "something was made behind the link");
        if neighbour.has_ended() {
            let command = self::neighbour(&flips, Path::new(shared.root_path())).unwrap();
            neighbour = domain.start(command);
        }
    }
    eprintln!("{joined} joined, {refused} refused");
    assert!(refused > 0, "the links were never in the way");
    neighbour.kill();
}
