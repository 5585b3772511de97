//! A domain that belongs to a group: several users of the group use one service, and nobody else does. The users have
//! numbers that no name belongs to, so only root can run these tests.

use isotherm_tests::{Needs, Process, RUN, TABLE, TIMEOUT, TestDomain, binary, skip, table, text, wait_until};
use rustix::process::Signal;
use std::fs::{self, Permissions};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _, chown};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

const GROUP: u32 = 61_000;
const SERVICE: u32 = 61_001;
const ACQUISITION: u32 = 61_002;
const READER: u32 = 61_003;
const OUTSIDER: u32 = 61_004;

/// A domain whose folders the users can enter.
struct GroupDomain {
    domain: TestDomain,
    program: PathBuf,
}

impl GroupDomain {
    /// `None` if this process may not change its user.
    fn new() -> Option<Self> {
        if !rustix::process::geteuid().is_root() {
            skip("only root can be another user", Needs::Machine);
            return None;
        }
        let domain = TestDomain::new();
        fs::set_permissions(domain.path(""), Permissions::from_mode(0o755)).unwrap();
        chown(domain.path(""), Some(SERVICE), Some(SERVICE)).unwrap();
        // The clone may lie in a folder of root's.
        let program = domain.path("isotherm");
        fs::hard_link(binary("isotherm"), &program)
            .or_else(|_| fs::copy(binary("isotherm"), &program).map(drop))
            .unwrap();
        for (name, text) in
            [("imu-a.toml", TABLE), ("service.toml", &config(GROUP)), ("run.csv", &fs::read_to_string(RUN).unwrap())]
        {
            let path = domain.write(name, text);
            chown(&path, Some(SERVICE), None).unwrap();
            fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
        }
        let out = domain.path("out");
        fs::create_dir(&out).unwrap();
        fs::set_permissions(out, Permissions::from_mode(0o1777)).unwrap();
        Some(Self { domain, program })
    }

    /// A command of a user, who belongs to the group unless he is the outsider.
    fn isotherm(&self, user: u32, arguments: &[&str]) -> Command {
        let plain = self.domain.isotherm(arguments);
        let group = if user == OUTSIDER { OUTSIDER } else { GROUP };
        let mut command = Command::new("setpriv");
        command.args(["--reuid", &user.to_string(), "--regid", &user.to_string(), "--groups", &group.to_string()]);
        command.arg(&self.program).args(arguments);
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?)))).env_remove("ISOTHERM_LOG");
        command.env("ISOTHERM_STATE", self.domain.path("state")).current_dir(self.domain.path(""));
        command
    }

    fn serve(&self) -> Process {
        let service = self.domain.start(self.isotherm(SERVICE, &["serve", "--config", "service.toml"]));
        service.wait_for_log(" ready ");
        service
    }

    fn run(&self, user: u32, arguments: &[&str], code: i32) -> String {
        let output = self.domain.finish(self.isotherm(user, arguments));
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{user} {arguments:?}: {words}");
        text(&output.stdout) + &words
    }

    /// All that the domain has in shared memory and in its folder.
    fn objects(&self) -> Vec<PathBuf> {
        let (root, prefix) = (self.domain.client_domain().root_path(), self.domain.client_domain().prefix());
        let inside = |folder: PathBuf| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let memory =
            inside("/dev/shm".into()).filter(|path| path.file_name().unwrap().to_string_lossy().starts_with(&prefix));
        let first: Vec<_> = inside(root.into()).collect();
        let second: Vec<_> = first.iter().flat_map(|path| inside(path.clone())).collect();
        let third: Vec<_> = second.iter().flat_map(|path| inside(path.clone())).collect();
        memory.chain(first).chain(second).chain(third).collect()
    }
}

fn config(group: u32) -> String {
    format!("[domain]\ngroup = \"{group}\"\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n")
}

const FEED: [&str; 8] = ["feed", "--imu", "imu-a", "--rate", "1000", "run.csv", "-o", "out/fed.csv"];

#[test]
fn users_of_the_group_share_a_domain_and_nobody_else_enters_it() {
    let Some(group) = GroupDomain::new() else { return };
    let service = group.serve();
    let recorder = group.domain.start(group.isotherm(READER, &["record", "--imu", "imu-a", "-o", "out/flight.csv"]));
    recorder.wait_for_log("recording imu-a");
    let feed = group.domain.start(group.isotherm(ACQUISITION, &FEED));
    wait_until("samples", || group.run(READER, &["status", "--json"], 0).contains("\"acquisition_connected\": true"));
    // While all are connected: the group may what the owner may, and others nothing.
    let private = ["group", "kept-imu-a", "service.lock", "session-imu-a", "starting"];
    // What was just created is opened to the group a moment later.
    let is_open = |path: &PathBuf| {
        let Ok(found) = fs::symlink_metadata(path) else { return true };
        let mode = found.mode() & 0o777;
        assert_eq!(mode & 0o007, 0, "{}: {mode:o}", path.display());
        assert!([SERVICE, ACQUISITION, READER].contains(&found.uid()), "{}: {}", path.display(), found.uid());
        if private.iter().any(|name| path.to_string_lossy().ends_with(name)) {
            (found.uid(), mode) == (SERVICE, 0o600)
        } else {
            (found.gid(), mode >> 3 & 7) == (GROUP, mode >> 6)
        }
    };
    let begun = Instant::now();
    let sockets = loop {
        let objects = group.objects();
        let is_socket = |path: &&PathBuf| fs::symlink_metadata(path).is_ok_and(|it| it.file_type().is_socket());
        let sockets = objects.iter().filter(is_socket).count();
        let closed: Vec<_> = objects.iter().filter(|path| !is_open(path)).collect();
        if closed.is_empty() {
            break sockets;
        }
        assert!(begun.elapsed() < TIMEOUT, "not the group's: {closed:?}");
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(sockets > 0);
    let (status, log) = feed.wait();
    assert!(status.success(), "{log}");
    recorder.terminate();
    group.run(ACQUISITION, &["replay", "--table", "imu-a.toml", "run.csv", "-o", "out/replayed.csv"], 0);
    let read = |name: &str| fs::read_to_string(group.domain.path(name)).unwrap();
    let replayed = read("out/replayed.csv");
    assert!(read("out/fed.csv") == replayed);
    assert_eq!(read("out/flight.csv").lines().count(), replayed.lines().count());
    // Others get the reason.
    for command in [&["status"][..], &["feed", "--imu", "imu-a", "--timeout", "1", "run.csv", "-o", "/dev/null"]] {
        assert!(group.run(OUTSIDER, command, OTHER_USER).contains("belongs to another user"));
    }
    // Only the service's user accepts a table.
    let far = TABLE.replace("91733.0", "9173.0");
    group.domain.replace("imu-a.toml", &far);
    chown(group.domain.path("imu-a.toml"), Some(SERVICE), None).unwrap();
    service.wait_for_log("table refused");
    let accept = ["reload", "--imu", "imu-a", "--accept", &table(&far).digest().to_string()];
    assert!(group.run(READER, &accept, OTHER_USER).contains("only the service's user"));
    group.run(SERVICE, &accept, 0);
    assert!(!service.log().contains("iceoryx2"), "{}", service.log());
    service.terminate();
}

/// Exit code of a command that meets another user's domain.
const OTHER_USER: i32 = 77;

#[test]
fn members_that_are_killed_are_replaced_and_what_they_leave_is_removed() {
    let Some(group) = GroupDomain::new() else { return };
    let mut service = group.serve();
    for (round, user) in [ACQUISITION, READER, ACQUISITION, SERVICE, READER].into_iter().enumerate() {
        let feed = group.domain.start(group.isotherm(user, &FEED));
        wait_until("samples of this member", || {
            let status: serde_json::Value =
                serde_json::from_str(&group.run(SERVICE, &["status", "--json"], 0)).unwrap();
            let imu = &status["imus"][0];
            imu["acquisition_connected"] == true && imu["received"].as_u64().unwrap() > 0
        });
        if round == 2 {
            // The service dies under it, and the member goes on with the next one.
            service.kill();
            service = group.serve();
            let (status, log) = feed.wait();
            assert!(status.success(), "{log}");
        } else {
            feed.signal(Signal::KILL);
            feed.wait();
        }
        let _ = fs::remove_file(group.domain.path("out/fed.csv.partial"));
        let _ = fs::remove_file(group.domain.path("out/fed.csv"));
    }
    // The next process of each user removes what those before it have left.
    let dead = |user: u32| {
        let memory = group.objects().into_iter().filter(|path| path.starts_with("/dev/shm"));
        memory.filter(|path| fs::symlink_metadata(path).is_ok_and(|found| found.uid() == user)).count()
    };
    for user in [ACQUISITION, READER] {
        let before = dead(user);
        group.run(user, &["status"], 0);
        // What `status` itself leaves: its connection.
        wait_until("what was left to be removed", || {
            group.run(user, &["status"], 0);
            dead(user) <= 2
        });
        println!("{user}: {before} objects were left");
    }
    service.terminate();
}

#[test]
fn a_group_that_cannot_be_is_refused_at_the_start() {
    let Some(group) = GroupDomain::new() else { return };
    let refused = |text: &str| {
        group.domain.write("service.toml", text);
        group.run(SERVICE, &["serve", "--config", "service.toml"], 78)
    };
    assert!(refused(&config(GROUP).replace("61000", "no-such-group")).contains("there is no such group"));
    assert!(refused(&config(61_999)).contains("the service's user is not a member"));
    // Where everybody may make folders, anybody could make one for his group.
    fs::set_permissions(group.domain.path(""), Permissions::from_mode(0o1777)).unwrap();
    assert!(refused(&config(GROUP)).contains("everybody may make a folder in"));
    fs::set_permissions(group.domain.path(""), Permissions::from_mode(0o755)).unwrap();
    // A folder of another user.
    let root = PathBuf::from(group.domain.client_domain().root_path());
    fs::create_dir(&root).unwrap();
    chown(&root, Some(READER), Some(GROUP)).unwrap();
    fs::set_permissions(&root, Permissions::from_mode(0o750)).unwrap();
    assert!(refused(&config(GROUP)).contains("it must be 2770 and the group's"));
    // Without the setting it is only the service's again.
    fs::remove_dir(&root).unwrap();
    group.domain.write("service.toml", &config(GROUP));
    group.serve().terminate();
    group.domain.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
    let service = group.serve();
    group.run(READER, &["status"], OTHER_USER);
    group.run(SERVICE, &["status"], 0);
    service.terminate();
}
