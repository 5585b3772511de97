//! Two users of one machine. A domain belongs to one of them; the other one gets increments and metrics in the ways
//! that docs/security.md names. The users have numbers that no name belongs to, so only root can run most of these
//! tests. `examples/network/two-users.sh` tries the tunnel.

use isotherm_tests::{Needs, Process, RUN, TABLE, TestDomain, binary, skip, text, variant, wait_until};
use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown};
use std::path::PathBuf;
use std::process::{Command, Stdio};

const OWNER: u32 = 61_001;
const OTHER: u32 = 61_002;
/// The exit code if the domain is another user's.
const OTHER_USER: i32 = 77;

/// The domain of one user, in a folder that both can enter.
struct UsersDomain(TestDomain);

impl UsersDomain {
    /// `None` if this process may not change its user.
    fn new() -> Option<Self> {
        if !rustix::process::geteuid().is_root() {
            skip("only root can be another user", Needs::Machine);
            return None;
        }
        let domain = TestDomain::new();
        fs::set_permissions(domain.path(""), Permissions::from_mode(0o755)).unwrap();
        chown(domain.path(""), Some(OWNER), Some(OWNER)).unwrap();
        let run = fs::read_to_string(RUN).unwrap();
        for (name, text) in [("imu-a.toml", TABLE), ("run.csv", run.as_str())] {
            chown(domain.write(name, text), Some(OWNER), None).unwrap();
        }
        for (name, user) in [("own", OWNER), ("other", OTHER)] {
            fs::create_dir(domain.path(name)).unwrap();
            chown(domain.path(name), Some(user), Some(user)).unwrap();
        }
        Some(Self(domain))
    }

    /// A program of this build that a user starts. The clone may lie in a folder of root's.
    fn program(&self, user: u32, name: &str, arguments: &[&str]) -> Command {
        let plain = self.0.program(name, arguments);
        let program = self.0.path(name);
        if !program.exists() {
            fs::hard_link(binary(name), &program).or_else(|_| fs::copy(binary(name), &program).map(drop)).unwrap();
        }
        let mut command = self.by(user);
        command.arg(program).args(arguments);
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?)))).env_remove("ISOTHERM_LOG");
        command.env("ISOTHERM_STATE", self.0.path("own/state"));
        command
    }

    /// A command of a user, whose program and arguments follow.
    fn by(&self, user: u32) -> Command {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", &user.to_string(), "--regid", &user.to_string(), "--clear-groups"]);
        command.current_dir(self.0.path(""));
        command
    }

    fn serve(&self) -> Process {
        let service = self.0.start(self.program(OWNER, "isotherm", &["serve", "--imu", "imu-a=imu-a.toml"]));
        service.wait_for_log(" ready ");
        service
    }

    /// Runs `isotherm` as a user, asserts its exit code, and returns what it printed.
    fn run(&self, user: u32, arguments: &[&str], code: i32) -> String {
        let output = self.0.finish(self.program(user, "isotherm", arguments));
        let words = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{user} {arguments:?}: {words}");
        text(&output.stdout) + &words
    }

    fn feed(&self) {
        self.run(OWNER, &["feed", "--imu", "imu-a", "--rate", "1000", "run.csv", "-o", "own/fed.csv"], 0);
    }
}

#[test]
fn another_user_is_refused_by_every_command() {
    let Some(users) = UsersDomain::new() else { return };
    let _service = users.serve();
    for command in [
        &["status"][..],
        &["feed", "--imu", "imu-a", "run.csv"],
        &["record", "--imu", "imu-a", "-o", "other/flight.csv"],
        &["serve", "--imu", "imu-a=imu-a.toml", "--allow-world-writable"],
        &["clean"],
    ] {
        assert!(users.run(OTHER, command, OTHER_USER).contains("belongs to another user"), "{command:?}");
    }
    users.run(OWNER, &["status"], 0);
}

#[test]
fn a_pipe_gives_increments_to_another_user() {
    let Some(users) = UsersDomain::new() else { return };
    let _service = users.serve();
    let record = &["record", "--imu", "imu-a", "--stream", "increment", "-o", "-"];
    let mut record = users.program(OWNER, "isotherm", record).stdout(Stdio::piped()).spawn().unwrap();
    users.0.register_process(record.id());
    // The program of the other user, which can open nothing of the domain.
    let mut save = users.by(OTHER);
    save.args(["sh", "-c", "exec cat > other/increments.csv"]).stdin(record.stdout.take().unwrap());
    let save = users.0.start(save);
    wait_until("the recorder", || users.run(OWNER, &["status", "--json"], 0).contains("\"readers\": 1"));
    users.feed();
    let rows = |name: &str| {
        let text = fs::read_to_string(users.0.path(name)).unwrap_or_default();
        text.lines().filter(|line| line.starts_with(|first: char| first.is_ascii_digit())).count()
    };
    let sent = rows("own/fed.csv");
    assert!(sent > 100);
    wait_until("all increments", || rows("other/increments.csv") == sent);
    rustix::process::kill_process(
        rustix::process::Pid::from_raw(record.id().cast_signed()).unwrap(),
        rustix::process::Signal::TERM,
    )
    .unwrap();
    assert!(record.wait().unwrap().success());
    assert!(save.wait().0.success());
}

#[test]
fn the_exporter_gives_metrics_to_another_user() {
    let Some(users) = UsersDomain::new() else { return };
    let _service = users.serve();
    users.feed();
    let exporter = users.0.start(users.program(OWNER, "isotherm-exporter", &["--listen", "127.0.0.1:0"]));
    exporter.wait_for_log("metrics at http://");
    let log = exporter.log();
    let (_, address) = log.split_once("metrics at http://").unwrap();
    let (host, port) = address.split('/').next().unwrap().split_once(':').unwrap();
    let request = format!(
        "exec 3<>/dev/tcp/{host}/{port} && printf 'GET /metrics HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n' >&3 && timeout 20 cat <&3"
    );
    wait_until("a page with the samples", || {
        let mut scrape = users.by(OTHER);
        scrape.args(["bash", "-c", &request]);
        let page = text(&users.0.finish(scrape).stdout);
        page.lines().any(|line| line.starts_with("isotherm_increments_total{imu=\"imu-a\"}") && !line.ends_with(" 0"))
    });
}

#[test]
fn a_group_of_users_is_refused_with_the_remedy() {
    let domain = TestDomain::new();
    domain.write("imu-a.toml", TABLE);
    let served: PathBuf =
        domain.write("service.toml", "[domain]\ngroup = \"imu\"\n[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
    for command in [&["serve", "--config", served.to_str().unwrap()][..], &["check", served.to_str().unwrap()]] {
        let output = domain.run(command);
        let message = text(&output.stderr) + &text(&output.stdout);
        assert_eq!(output.status.code(), Some(78), "{command:?}: {message}");
        assert!(message.contains("domain.group") && message.contains("docs/security.md"), "{command:?}: {message}");
    }
}

/// On an installed system the table belongs to root, and the domain to the service's user.
#[test]
fn root_installs_for_the_service_of_another_user_and_no_third_one_does() {
    let Some(users) = UsersDomain::new() else { return };
    let tables = users.0.path("tables");
    fs::create_dir(&tables).unwrap();
    fs::set_permissions(&tables, Permissions::from_mode(0o755)).unwrap();
    let read = |name: &str| fs::read_to_string(tables.join(name)).unwrap();
    fs::write(tables.join("imu-a.toml"), TABLE).unwrap();
    let far = TABLE.replace("91733.0", "9173.0");
    for (name, text) in [("new.toml", variant(1)), ("far.toml", far.clone())] {
        users.0.write(name, &text);
    }
    let serve = &["serve", "--imu", "imu-a=tables/imu-a.toml"];
    let service = users.0.start(users.program(OWNER, "isotherm", serve));
    service.wait_for_log(" ready ");
    let printed = users.run(OTHER, &["install", "new.toml", "tables/imu-a.toml"], OTHER_USER);
    assert!(printed.contains("belongs to another user"), "{printed}");
    assert_eq!(read("imu-a.toml"), TABLE);
    // The service's own user may not write the table.
    users.run(OWNER, &["install", "new.toml", "tables/imu-a.toml"], 74);
    let printed = users.run(0, &["install", "new.toml", "--imu", "imu-a"], 0);
    assert!(printed.contains(users.0.client_domain().root_path()) && printed.contains("is served"), "{printed}");
    assert_eq!([read("imu-a.toml"), read("imu-a.toml.previous")], [variant(1), TABLE.to_owned()]);
    users.run(0, &["install", "far.toml", "tables/imu-a.toml"], 78);
    let digest = isotherm_tests::table(&far).digest().to_string();
    users.run(0, &["install", "--accept", &digest, "far.toml", "tables/imu-a.toml"], 0);
    assert_eq!([read("imu-a.toml"), read("imu-a.toml.previous")], [far, variant(1)]);
    assert!(users.run(OWNER, &["status"], 0).contains(&digest));
    // The acceptance is used up, and root has left nothing of its own in the domain.
    let entries = || fs::read_dir(users.0.client_domain().root_path()).unwrap().map(Result::unwrap);
    wait_until("the acceptance is used up", || {
        !entries().any(|entry| entry.file_name().to_string_lossy().contains("accepted-"))
    });
    assert!(entries().all(|entry| entry.metadata().unwrap().uid() == OWNER));
}
