//! A user installs tables with `isotherm install`: served, refused, accepted, without a service, on disks and through
//! links that do not allow it, and twice at once.

use isotherm_tests::{Needs, TABLE, TestDomain, binary, may_mount, skip, table, text, variant, wait_until};
use serde_json::Value;
use std::env;
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt as _, chown, symlink};
use std::process::{Command, Output};

const INSTALLED: &str = "imu-a.toml";
const PREVIOUS: &str = "imu-a.toml.previous";
const NOBODY: u32 = 65534;

fn digest(text: &str) -> String {
    table(text).digest().to_string()
}

/// A valid table that lacks a digit.
fn far() -> String {
    TABLE.replace("91733.0", "9173.0")
}

/// Runs `isotherm install` with this code, and returns what it printed.
fn install(domain: &TestDomain, code: i32, arguments: &[&str]) -> String {
    ended(&domain.run(&[&["install"], arguments].concat()), code)
}

fn ended(output: &Output, code: i32) -> String {
    let printed = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{printed}");
    printed
}

/// Runs a command that a program has printed, as a user does who pastes it.
fn paste(domain: &TestDomain, command: &str, code: i32) -> String {
    let (plain, path) = (domain.isotherm(&[]), env::var_os("PATH").unwrap());
    let folders = [binary("isotherm").parent().unwrap().to_owned()]
        .into_iter()
        .chain(env::split_paths(&path).collect::<Vec<_>>());
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
    shell.env_remove("ISOTHERM_DOMAIN").env("PATH", env::join_paths(folders).unwrap()).current_dir(domain.path(""));
    ended(&domain.finish(shell), code)
}

/// The installed table, its predecessor, and how many files there are of both.
fn state(domain: &TestDomain) -> (String, Option<String>, usize) {
    let names = fs::read_dir(domain.path("")).unwrap().map(|entry| entry.unwrap().file_name());
    let count = names.filter(|name| name.to_string_lossy().contains(INSTALLED)).count();
    let previous = fs::read_to_string(domain.path(PREVIOUS)).ok();
    (fs::read_to_string(domain.path(INSTALLED)).unwrap(), previous, count)
}

#[test]
fn a_table_is_served_and_its_predecessor_comes_back() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("new.toml", &variant(1));
    let printed = install(&domain, 0, &["new.toml", INSTALLED]);
    assert!(printed.contains(&format!("{} is served, as imu-a.toml", digest(&variant(1)))), "{printed}");
    assert_eq!(domain.imu_status()["table"], digest(&variant(1)));
    assert_eq!(state(&domain), (variant(1), Some(TABLE.to_owned()), 2));
    // Again, by the path that the service uses.
    let printed = install(&domain, 0, &["new.toml", "--imu", "imu-a"]);
    assert!(printed.contains("is served already, as /"), "{printed}");
    assert_eq!(state(&domain), (variant(1), Some(TABLE.to_owned()), 2));
    let printed = domain.run_ok(&["rollback", INSTALLED]);
    assert!(printed.contains(&format!("{} is served, as imu-a.toml", digest(TABLE))), "{printed}");
    assert_eq!(state(&domain), (TABLE.to_owned(), Some(variant(1)), 2));
}

#[test]
fn without_a_service_a_table_is_installed_for_the_next_start() {
    let domain = TestDomain::new();
    domain.write("new.toml", &variant(1));
    // Everybody can read it, whatever the umask is.
    let output = domain.finish(domain.isotherm_after(&[], "umask 077", &["install", "new.toml", INSTALLED]));
    assert!(ended(&output, 0).contains("no service runs"));
    assert_eq!(fs::metadata(domain.path(INSTALLED)).unwrap().permissions().mode() & 0o777, 0o644);
    assert_eq!(state(&domain), (variant(1), None, 1));
    domain.write("next.toml", TABLE);
    fs::set_permissions(domain.path(INSTALLED), Permissions::from_mode(0o640)).unwrap();
    install(&domain, 0, &["next.toml", INSTALLED]);
    assert_eq!(fs::metadata(domain.path(INSTALLED)).unwrap().permissions().mode() & 0o777, 0o640);
    assert_eq!(state(&domain), (TABLE.to_owned(), Some(variant(1)), 2));
    install(&domain, 69, &["next.toml", "--imu", "imu-a"]);
    // The note of a service that was killed counts for nothing.
    domain.serve_recording().kill();
    install(&domain, 0, &["new.toml", INSTALLED]);
    assert_eq!(state(&domain), (variant(1), Some(TABLE.to_owned()), 2));
}

#[test]
fn what_check_refuses_changes_nothing() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("broken.toml", &TABLE.replace("gravity", "gravitiy"));
    assert!(install(&domain, 78, &["broken.toml", INSTALLED]).contains("broken.toml:"));
    domain.write("other.toml", &variant(1).replace("imu-a", "imu-b"));
    assert!(install(&domain, 78, &["other.toml", INSTALLED]).contains("imu-a.toml is the table of imu-a"));
    install(&domain, 78, &["other.toml", "--imu", "imu-a"]);
    install(&domain, 64, &["--accept", &digest(TABLE), "other.toml", INSTALLED]);
    install(&domain, 74, &["none.toml", INSTALLED]);
    assert_eq!(state(&domain), (TABLE.to_owned(), None, 1));
}

#[test]
fn a_refused_table_goes_and_the_printed_command_accepts_it() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("new.toml", &variant(1));
    install(&domain, 0, &["new.toml", INSTALLED]);
    domain.write("far.toml", &far());
    let before = state(&domain);
    let printed = install(&domain, 78, &["far.toml", INSTALLED]);
    assert_eq!(state(&domain), before, "the predecessor, too");
    assert_eq!(domain.imu_status()["table"], digest(&variant(1)));
    // The domain stands in the command, since it is not the default one.
    let accept = printed.lines().find_map(|line| line.strip_prefix("accept:  ")).unwrap();
    paste(&domain, accept, 0);
    assert_eq!(state(&domain), (far(), Some(variant(1)), 2));
    assert_eq!(domain.imu_status()["table"], digest(&far()));
    // The way back is as far.
    let printed = ended(&domain.run(&["rollback", INSTALLED]), 78);
    assert!(printed.contains("the table before is back\ncompare: "), "{printed}");
    assert_eq!(state(&domain), (far(), Some(variant(1)), 2));
    assert_eq!(domain.imu_status()["refused_table"], Value::Null);
    let back = digest(&variant(1));
    install(&domain, 0, &["--accept", &back, PREVIOUS, INSTALLED]);
    assert_eq!(state(&domain), (variant(1), Some(far()), 2));
    // One that a user has put there by hand.
    domain.replace(INSTALLED, &far());
    wait_until("the refusal", || domain.imu_status()["refused_table"] == digest(&far()));
    install(&domain, 0, &["--accept", &digest(&far()), "far.toml", INSTALLED]);
    assert_eq!(domain.imu_status()["table"], digest(&far()));
}

/// A service that hangs cannot judge. When it goes on, the same command finds out what became of the table.
#[test]
fn what_is_not_judged_stays_and_the_same_command_settles_it() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for (name, new) in [("new.toml", variant(1)), ("far.toml", far())] {
        domain.write(INSTALLED, TABLE);
        wait_until("the first table", || domain.imu_status()["table"] == digest(TABLE));
        let _ = fs::remove_file(domain.path(PREVIOUS));
        domain.write(name, &new);
        service.stop();
        assert!(install(&domain, 75, &[name, INSTALLED]).contains("run the same command again"));
        assert_eq!(state(&domain), (new.clone(), None, 2), "the old one waits");
        service.resume();
        let is_good = name == "new.toml";
        install(&domain, if is_good { 0 } else { 78 }, &[name, INSTALLED]);
        let wanted = if is_good { (new, Some(TABLE.to_owned()), 2) } else { (TABLE.to_owned(), None, 1) };
        assert_eq!(state(&domain), wanted);
    }
}

/// A rollback that was interrupted has lost neither of the two tables, whatever comes next.
#[test]
fn a_rollback_that_is_not_judged_is_repeated_or_taken_back() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    for (previous, wanted) in
        [(variant(1), (variant(1), Some(TABLE.to_owned()), 2)), (far(), (TABLE.to_owned(), Some(far()), 2))]
    {
        domain.replace(INSTALLED, TABLE);
        wait_until("the first table", || domain.imu_status()["table"] == digest(TABLE));
        domain.write(PREVIOUS, &previous);
        service.stop();
        let rollback = domain.spawn(&["rollback", INSTALLED]);
        wait_until("the predecessor", || fs::read_to_string(domain.path(INSTALLED)).unwrap() == previous);
        rollback.kill();
        service.resume();
        ended(&domain.run(&["rollback", INSTALLED]), if previous == far() { 78 } else { 0 });
        assert_eq!(state(&domain), wanted);
    }
    service.stop();
    ended(&domain.run(&["rollback", INSTALLED]), 75);
    assert_eq!(state(&domain), (far(), Some(far()), 3));
    service.resume();
    domain.write("new.toml", &variant(2));
    install(&domain, 0, &["new.toml", INSTALLED]);
    assert_eq!(state(&domain), (variant(2), Some(TABLE.to_owned()), 2));
}

#[test]
fn a_service_that_is_restarted_meanwhile_judges_the_table() {
    let domain = TestDomain::new();
    for (new, code) in [(variant(1), 0), (far(), 78)] {
        let service = domain.serve_recording();
        domain.write("new.toml", &new);
        service.stop();
        let install = domain.spawn(&["install", "new.toml", INSTALLED]);
        wait_until("the new file", || fs::read_to_string(domain.path(INSTALLED)).unwrap() == new);
        service.kill();
        let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
        let (status, log) = install.wait();
        assert_eq!(status.code(), Some(code), "{log}");
        assert_eq!(state(&domain).0, if code == 0 { new } else { TABLE.to_owned() });
        service.terminate();
        domain.run_ok(&["clean"]);
        let _ = fs::remove_file(domain.path(PREVIOUS));
    }
}

/// What was never served is no predecessor.
#[test]
fn a_refused_or_broken_file_does_not_push_the_predecessor_out() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("one.toml", &variant(1));
    install(&domain, 0, &["one.toml", INSTALLED]);
    domain.write("two.toml", &variant(2));
    for wrong in [far(), "broken".to_owned()] {
        domain.replace(INSTALLED, &wrong);
        wait_until("the refusal", || domain.imu_status()["last_reload_error"].is_string());
        let printed = install(&domain, 0, &["two.toml", INSTALLED]);
        assert!(!printed.contains("rollback"), "{printed}");
        assert_eq!(state(&domain), (variant(2), Some(TABLE.to_owned()), 2));
    }
}

#[test]
fn an_acceptance_waits_for_the_service_that_reads_the_file() {
    let domain = TestDomain::new();
    domain.write(INSTALLED, TABLE);
    domain.write("far.toml", &far());
    let accept = |table: &str| install(&domain, 0, &["--accept", &digest(&far()), "far.toml", table]);
    // The domain has no folder yet.
    accept("elsewhere.toml");
    assert!(domain.is_accepted("imu-a"));
    let service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    accept("elsewhere.toml");
    assert!(!domain.is_accepted("imu-a"));
    install(&domain, 78, &["far.toml", INSTALLED]);
    service.terminate();
}

#[test]
fn printed_commands_work_whatever_the_file_is_called() {
    let domain = TestDomain::new();
    let (folder, name) = ("it's a folder; $(touch made)", "it's a folder; $(touch made)/imu-a.toml");
    fs::create_dir(domain.path(folder)).unwrap();
    domain.write(name, TABLE);
    let _service = domain.serve(&["--imu", &format!("imu-a={name}")]);
    domain.write("new.toml", &variant(1));
    let printed = install(&domain, 0, &["new.toml", name]);
    let way_back = printed.split('`').nth(1).unwrap();
    assert!(paste(&domain, way_back, 0).contains(&format!("{} is served", digest(TABLE))));
    domain.write("-far.toml", &far());
    let printed = install(&domain, 78, &["--", "-far.toml", name]);
    let command = |name: &str| printed.lines().find_map(|line| line.strip_prefix(name)).unwrap().trim();
    assert!(paste(&domain, command("compare:"), 78).contains("A1 positive_scale_factor"));
    paste(&domain, command("accept:"), 0);
    assert_eq!(fs::read_to_string(domain.path(name)).unwrap(), far());
    assert!(!domain.path("made").exists());
}

/// The note of the service was changed by hand, so that it names another file.
#[test]
fn a_file_that_is_no_table_is_not_replaced_by_the_name_of_an_imu() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("new.toml", &variant(1));
    let other = domain.write("other", "precious");
    let mut notes = fs::read_dir(domain.client_domain().root_path()).unwrap().map(|entry| entry.unwrap().path());
    let note = notes.find(|path| path.to_string_lossy().ends_with("table-imu-a.json")).unwrap();
    let text = fs::read_to_string(&note).unwrap();
    fs::write(&note, text.replace(&domain.path(INSTALLED).display().to_string(), &other.display().to_string()))
        .unwrap();
    let printed = install(&domain, 69, &["new.toml", "--imu", "imu-a"]);
    assert!(printed.contains("/other for imu-a, which is no table of it; name the file"), "{printed}");
    assert_eq!(fs::read_to_string(other).unwrap(), "precious");
}

#[test]
fn a_service_that_reads_another_file_is_named() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    domain.write("new.toml", &variant(1));
    domain.write("elsewhere.toml", TABLE);
    let printed = install(&domain, 0, &["new.toml", "elsewhere.toml"]);
    assert!(
        printed.contains("not served: the service of domain") && printed.contains("/imu-a.toml for imu-a"),
        "{printed}"
    );
    domain.write("other.toml", &variant(1).replace("imu-a", "imu-b"));
    assert!(install(&domain, 0, &["other.toml", "imu-b.toml"]).contains("has no note of imu-b: it does not serve it"));
}

#[test]
fn a_table_behind_a_link_lies_in_a_folder_that_is_not_watched() {
    let domain = TestDomain::new();
    fs::create_dir(domain.path("tables")).unwrap();
    domain.write("tables/one.toml", TABLE);
    symlink("tables/one.toml", domain.path(INSTALLED)).unwrap();
    let _service = domain.serve(&["--imu", "imu-a=imu-a.toml"]);
    domain.write("new.toml", &variant(1));
    assert!(install(&domain, 0, &["new.toml", INSTALLED]).contains("is served, as imu-a.toml"));
    assert!(domain.path(INSTALLED).is_symlink());
    let kept = fs::read_to_string(domain.path("tables/one.toml.previous")).unwrap();
    assert_eq!((state(&domain).0, kept), (variant(1), TABLE.to_owned()));
    // It leads to nothing, or to what somebody else has made.
    symlink("tables/none.toml", domain.path("nothing.toml")).unwrap();
    assert!(install(&domain, 74, &["new.toml", "nothing.toml"]).contains("nothing is changed"));
    assert!(!domain.path("tables/none.toml").exists());
    if !rustix::process::geteuid().is_root() {
        return skip("only root can give a file away", Needs::Machine);
    }
    chown(domain.path("tables/one.toml"), Some(NOBODY), None).unwrap();
    let printed = install(&domain, 74, &["new.toml", INSTALLED]);
    assert!(printed.contains("belongs to user 65534"), "{printed}");
}

#[test]
fn where_nothing_can_be_written_nothing_is_changed() {
    let domain = TestDomain::new();
    if !may_mount() {
        return skip("no file system can be mounted", Needs::Machine);
    }
    domain.write("new.toml", &variant(1));
    domain.write("old.toml", TABLE);
    fs::create_dir(domain.path("full")).unwrap();
    for after in ["mount -o remount,ro full", "head -c 1m /dev/zero > full/fill"] {
        let mount = format!(
            "mount -t tmpfs -o size=64k tmpfs full && cp old.toml full/{INSTALLED} && {{ {after} 2> /dev/null; true; }}"
        );
        let script = format!(
            "{mount}; \"$0\" \"$@\"; code=$?; cmp old.toml full/{INSTALLED} && echo left: $(ls -A full | grep -v fill) >&2; exit $code"
        );
        let plain = domain.isotherm(&["install", "new.toml", "full/imu-a.toml"]);
        let mut command = Command::new("unshare");
        command.args(["-m", "sh", "-c", &script]).arg(plain.get_program()).args(plain.get_args());
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command.current_dir(domain.path(""));
        let printed = ended(&domain.finish(command), 74);
        assert!(
            printed.contains("nothing is changed") && printed.ends_with("left: imu-a.toml\n"),
            "{after}: {printed}"
        );
    }
}

#[test]
fn of_two_at_once_the_second_follows_the_first() {
    let domain = TestDomain::new();
    let _service = domain.serve_recording();
    let new = [variant(1), variant(2)];
    let names = ["one.toml", "two.toml"];
    for (name, text) in names.iter().zip(&new) {
        domain.write(name, text);
    }
    let both = names.map(|name| domain.spawn(&["install", name, INSTALLED]));
    for process in both {
        let (status, log) = process.wait();
        assert!(status.success(), "{log}");
    }
    let (now, previous, count) = state(&domain);
    let last = new.iter().position(|text| *text == now).unwrap();
    assert_eq!((previous.as_ref(), count), (Some(&new[1 - last]), 2));
    assert_eq!(domain.imu_status()["table"], digest(&now));
}
