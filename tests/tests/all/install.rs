//! An installed table and its predecessor: what `isotherm rollback` brings back and refuses, and what survives kills
//! and other processes.
//!
//! Over 400 lines: a rollback is an installation of the predecessor.

use crate::feed::{Feed, ids};
use isotherm_files::{Identity, Installation};
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure};
use isotherm_tests::{Needs, TABLE, TestDomain, skip, table, text, variant, wait_until};
use std::fs::{self, Permissions};
use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use std::{env, thread};

const INSTALLED: &str = "imu-a.toml";
const PREVIOUS: &str = "imu-a.toml.previous";
const REPLACED: &str = "imu-a.toml.replaced";
const NEW: &str = ".isotherm-imu-a.toml.new";
const LOCK: &str = ".isotherm-imu-a.toml.lock";
const NOBODY: u32 = 65534;

/// Runs `isotherm rollback imu-a.toml`, which must end with this code, and returns its message. Nothing may be changed.
fn refused(domain: &TestDomain, code: i32) -> String {
    refused_with(domain, code, &[])
}

/// As [`refused`], with more options.
fn refused_with(domain: &TestDomain, code: i32, options: &[&str]) -> String {
    let state = || {
        let names = fs::read_dir(domain.path("")).unwrap().flatten().map(|entry| entry.path());
        let mut files: Vec<_> = names.map(|path| (fs::read(&path).ok(), path)).collect();
        files.sort();
        files
    };
    let before = state();
    let output = domain.run(&[&["rollback", INSTALLED], options].concat());
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert_eq!(state(), before, "{said}");
    assert_eq!(text(&output.stdout), "");
    said
}

fn has(said: &str, wanted: &[&str]) {
    assert!(wanted.iter().all(|wanted| said.contains(wanted)), "{wanted:?} is not in {said}");
}

#[test]
fn what_cannot_be_brought_back_is_refused_and_changes_nothing() {
    let domain = TestDomain::new();
    domain.write(INSTALLED, TABLE);
    has(&refused(&domain, 74), &["imu-a.toml has no predecessor: there is no imu-a.toml.previous; nothing is changed"]);
    domain.write(PREVIOUS, "format = 1\n");
    has(&refused(&domain, 78), &["imu-a.toml.previous:1: ", "nothing is changed"]);
    domain.write(PREVIOUS, &variant(1).replace("imu-a", "imu-b"));
    has(&refused(&domain, 78), &["imu-a.toml.previous:", "imu-b", "imu-a", "nothing is changed"]);
    domain.write(PREVIOUS, &format!("# the same\n{TABLE}"));
    has(&refused(&domain, 1), &["imu-a.toml.previous has the same table as imu-a.toml; nothing is changed"]);
    domain.write("elsewhere.toml", &variant(1));
    fs::remove_file(domain.path(PREVIOUS)).unwrap();
    symlink("elsewhere.toml", domain.path(PREVIOUS)).unwrap();
    has(&refused(&domain, 74), &["imu-a.toml.previous is not a regular file"]);
    fs::remove_file(domain.path(PREVIOUS)).unwrap();
    fs::rename(domain.path(INSTALLED), domain.path(PREVIOUS)).unwrap();
    has(&refused(&domain, 78), &["imu-a.toml does not say whose predecessor comes back; give --imu ID"]);
    domain.run_ok(&["rollback", "--imu", "imu-a", INSTALLED]);
    assert_eq!(fs::read_to_string(domain.path(INSTALLED)).unwrap(), TABLE);
}

/// What the installed table cannot say must be given: a predecessor of another IMU never comes back.
#[test]
fn a_broken_table_is_replaced_by_its_whole_predecessor_through_a_link_too() {
    let domain = TestDomain::new();
    fs::create_dir(domain.path("tables")).unwrap();
    domain.write("tables/imu-a.toml", "broken");
    domain.write("tables/imu-a.toml.previous", TABLE);
    symlink("tables/imu-a.toml", domain.path(INSTALLED)).unwrap();
    has(&refused(&domain, 78), &["imu-a.toml:1: ", "give --imu ID; nothing is changed"]);
    has(&refused_with(&domain, 78, &["--imu", "imu-b"]), &["imu-a.toml.previous:", "imu-b", "nothing is changed"]);
    let output = domain.run(&["rollback", "--imu", "imu-a", INSTALLED]);
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    has(&said, &["imu-a.toml:1: "]);
    assert!(text(&output.stdout).contains(&format!("{} is installed as imu-a.toml", table(TABLE).digest())));
    assert!(domain.path(INSTALLED).is_symlink());
    assert_eq!(fs::read_to_string(domain.path(INSTALLED)).unwrap(), TABLE);
    let again = domain.run(&["rollback", INSTALLED]);
    assert_eq!(again.status.code(), Some(1), "it does not go back to a broken one");
}

#[test]
fn what_a_rollback_changes_is_said() {
    let domain = TestDomain::new();
    let turned = |angle: f64| {
        format!("{}[alignment]\nmatrix = [[1.0, {angle}, 0.0], [{}, 1.0, 0.0], [0.0, 0.0, 1.0]]\n", variant(1), -angle)
    };
    let turns = "the axes turn: boresight the vehicle again";
    for (installed, previous, wanted) in [
        (TABLE.to_owned(), turned(1e-3), &["alignment changes by 1 mrad", turns][..]),
        (turned(1e-3), TABLE.to_owned(), &["alignment changes by 1 mrad", turns]),
        (turned(1e-3), turned(2e-3), &["alignment changes by 1 mrad", turns]),
        (
            TABLE.to_owned(),
            variant(1).replace("clamp", "reject"),
            &["out_of_range: it was \"clamp\", now it is \"reject\""],
        ),
    ] {
        domain.write(INSTALLED, &installed);
        domain.write(PREVIOUS, &previous);
        has(&domain.run_ok(&["rollback", INSTALLED]), wanted);
    }
    domain.write(INSTALLED, &turned(1e-3));
    domain.write(PREVIOUS, &turned(1e-3).replace("9.8001", "9.8002"));
    assert!(!domain.run_ok(&["rollback", INSTALLED]).contains("the axes turn"));
}

#[test]
fn two_rollbacks_bring_the_first_state_back() {
    let domain = TestDomain::new();
    domain.write(INSTALLED, TABLE);
    domain.write(PREVIOUS, &variant(1));
    fs::set_permissions(domain.path(INSTALLED), Permissions::from_mode(0o640)).unwrap();
    let state = || {
        assert_eq!(fs::metadata(domain.path(INSTALLED)).unwrap().mode() & 0o777, 0o640);
        [INSTALLED, PREVIOUS].map(|name| fs::read_to_string(domain.path(name)).unwrap())
    };
    let [one, two] = state();
    domain.run_ok(&["rollback", INSTALLED]);
    assert_eq!(state(), [two.clone(), one.clone()]);
    domain.run_ok(&["rollback", INSTALLED]);
    assert_eq!(state(), [one, two]);
}

/// Every exchange reaches the service, and no sample is lost between.
#[test]
fn exchanged_again_and_again_under_a_feed() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let [one, two] = [TABLE.to_owned(), variant(1)].map(|text| table(&text));
    domain.write(PREVIOUS, &variant(1));
    let mut reader = domain.reader("imu-a");
    let mut wait_for = |table: &CoefficientTable| {
        wait_until("an increment of the table", || {
            std::iter::from_fn(|| reader.receive().unwrap()).any(|increment| increment.table == table.id())
        });
    };
    let feed = Feed::start(&domain);
    wait_for(&one);
    for table in [&two, &one, &two, &one] {
        let said = domain.run_ok(&["rollback", INSTALLED]);
        assert!(
            said.contains(&format!("{} is served, as imu-a.toml\nthe table before is kept", table.digest())),
            "{said}"
        );
        wait_for(table);
    }
    assert_eq!(feed.end(), ids([&one, &two, &one, &two, &one]));
    let status = domain.imu_status();
    assert_eq!((&status["reloads"], &status["last_reload_error"]), (&4.into(), &serde_json::Value::Null));
    assert_eq!(service.count_in_log("table refused"), 0, "{}", service.log());
    service.terminate();
}

/// Set in a child process: the number of the table that it installs.
const NUMBER: &str = "ISOTHERM_TESTS_NUMBER";

/// This test as a child process, in a folder of its own.
fn child(test: &str, folder: &Path, number: u32) -> Command {
    child_of(&env::current_exe().unwrap(), test, folder, number)
}

/// As [`child`], by a copy of this program.
fn child_of(program: &Path, test: &str, folder: &Path, number: u32) -> Command {
    let mut command = Command::new(program);
    command
        .args(["--exact", &format!("install::{test}"), "--nocapture"])
        .env(NUMBER, number.to_string())
        .current_dir(folder);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The number that a child process has been given; `None` in the test itself.
fn number() -> Option<u32> {
    env::var(NUMBER).ok().map(|number| number.parse().unwrap())
}

/// Reports to the test what this child does, also if the child is killed at once. Without the test the child ends here.
fn report(what: &str) {
    io::stdout().write_all(format!("{what}\n").as_bytes()).unwrap();
}

/// Some text that is longer than a page, so that a part of it is noticed.
fn numbered(number: u32) -> String {
    format!("{number}\n").repeat(3000)
}

/// The number of a whole text of [`numbered`]; `None` if there is no file.
fn number_in(path: &Path) -> Option<u32> {
    let text = fs::read_to_string(path).ok()?;
    let number = text.lines().next().unwrap_or_default().parse().unwrap();
    assert!(text == numbered(number), "{} is whole", path.display());
    Some(number)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A child installs and rolls back until it is killed, at moments by chance and while a table is being replaced.
#[test]
fn whenever_it_is_killed_a_table_is_in_force_and_the_way_back_is_there() {
    if let Some(first) = number() {
        for number in first.. {
            report(&format!("install {number}"));
            let installation = Installation::lock(Path::new(INSTALLED)).unwrap();
            installation.complete().unwrap();
            installation.install(&numbered(number)).unwrap();
            installation.complete().unwrap();
            drop(installation);
            report("done");
            if number % 3 == 0 {
                report("roll back");
                let installation = Installation::lock(Path::new(INSTALLED)).unwrap();
                installation.install(&fs::read_to_string(installation.previous()).unwrap()).unwrap();
                installation.complete().unwrap();
                report("done");
            }
        }
    }
    let domain = TestDomain::new();
    let folder = domain.path("tables");
    fs::create_dir(&folder).unwrap();
    let path = |name: &str| folder.join(name);
    fs::write(path(INSTALLED), numbered(0)).unwrap();
    fs::set_permissions(path(INSTALLED), Permissions::from_mode(0o600)).unwrap();
    // The table in force and its predecessor.
    let mut state = (Some(0), None);
    let (mut next, mut interrupted) = (1, 0);
    for round in 0..60 {
        let mut child = child("whenever_it_is_killed_a_table_is_in_force_and_the_way_back_is_there", &folder, next)
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut told = vec![lines.by_ref().find(|line| line.starts_with("install ")).unwrap()];
        let begun = Instant::now();
        let pause = Duration::from_micros(RandomState::new().build_hasher().finish() % 30_000);
        // Every other kill is as soon as there is the copy of a table that is being replaced.
        while begun.elapsed() < pause && !(round % 2 == 0 && path(REPLACED).exists()) {
            thread::yield_now();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        told.extend(lines);

        // What must be there, with and without the last step.
        let mut before = state;
        for step in told {
            before = state;
            state = match step.strip_prefix("install ") {
                Some(number) => (number.parse().ok(), state.0),
                None if step == "roll back" => (state.1, state.0),
                None => state,
            };
            next = state.0.max(state.1).map_or(next, |number| next.max(number + 1));
        }
        let found = names(&folder);
        interrupted += u32::from(found.iter().any(|name| name == REPLACED));
        let documented = [LOCK, NEW, INSTALLED, PREVIOUS, REPLACED];
        assert!(found.iter().all(|name| documented.contains(&name.as_str())), "{found:?}");
        for name in &found {
            assert_eq!(fs::metadata(path(name)).unwrap().mode() & 0o777, 0o600, "{name}");
        }
        let in_force = number_in(&path(INSTALLED));
        assert!([before.0, state.0].contains(&in_force), "{in_force:?} of {before:?} {state:?}");
        number_in(&path(PREVIOUS));
        number_in(&path(REPLACED));

        // The next process completes the step or takes it back.
        Installation::lock(&path(INSTALLED)).unwrap().complete().unwrap();
        let now = (number_in(&path(INSTALLED)), number_in(&path(PREVIOUS)));
        assert_eq!(now.0, in_force);
        assert!([before, state].contains(&now), "{now:?} of {before:?} {state:?}, from {found:?}");
        assert_eq!(names(&folder).len(), 1 + usize::from(now.1.is_some()));
        state = now;
    }
    report(&format!("{interrupted} of 60 kills were while a table was being replaced"));
}

/// A child compares with the installed table, waits for a line, and installs.
fn compare_and_install(number: u32) {
    let target = Path::new(INSTALLED);
    let compared = Identity::of(target);
    report("compared");
    io::stdin().read_line(&mut String::new()).unwrap();
    let install = || {
        let installation = Installation::lock(target)?;
        if installation.state() != compared {
            return Err(Failure::new(Exit::Failed, "it has changed meanwhile"));
        }
        installation.install(&numbered(number))?;
        installation.complete()
    };
    let code = install().map_or_else(
        |failure| {
            report(&failure.message);
            failure.exit as i32
        },
        |()| 0,
    );
    #[expect(clippy::exit, reason = "the child's exit code is what it says")]
    std::process::exit(code);
}

/// Starts these children, and calls `between` when all have compared; then they install. Returns their exit codes and
/// what they said.
fn compete<const N: usize>(
    test: &str,
    domain: &TestDomain,
    numbers: [u32; N],
    between: impl FnOnce(),
) -> [(i32, String); N] {
    let children = numbers.map(|number| {
        let mut child = child(test, &domain.path(""), number).spawn().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while line != "compared\n" {
            line.clear();
            assert!(stdout.read_line(&mut line).unwrap() > 0, "it has ended");
        }
        (child, stdout)
    });
    between();
    let children = children.map(|(mut child, stdout)| {
        child.stdin.take().unwrap().write_all(b"\n").unwrap();
        (child, stdout)
    });
    children.map(|(mut child, mut stdout)| {
        let mut said = String::new();
        stdout.read_to_string(&mut said).unwrap();
        (child.wait().unwrap().code().unwrap(), said)
    })
}

#[test]
fn of_several_installers_one_installs_and_the_others_see_that_the_table_has_changed() {
    if let Some(number) = number() {
        compare_and_install(number);
    }
    let test = "of_several_installers_one_installs_and_the_others_see_that_the_table_has_changed";
    let domain = TestDomain::new();
    let both = || [INSTALLED, PREVIOUS].map(|name| number_in(&domain.path(name)));
    domain.write(INSTALLED, &numbered(0));
    let ends = compete(test, &domain, [1, 2, 3], || {});
    let winner = ends.iter().position(|(code, _)| *code == 0).unwrap();
    assert_eq!(both(), [Some(winner as u32 + 1), Some(0)], "{ends:?}");
    for (code, said) in ends.iter().enumerate().filter(|(index, _)| *index != winner).map(|(_, end)| end) {
        assert!(*code == 1 && said.contains("it has changed meanwhile"), "{ends:?}");
    }
    assert_eq!(names(&domain.path("")).len(), 2);

    // There was no table.
    fs::remove_file(domain.path(INSTALLED)).unwrap();
    let ends = compete(test, &domain, [4, 5], || {});
    assert_eq!(ends[0].0 + ends[1].0, 1, "{ends:?}");

    // A rollback after the comparison.
    domain.write(INSTALLED, TABLE);
    domain.write(PREVIOUS, &variant(1));
    let [(code, said)] = compete(test, &domain, [6], || drop(domain.run_ok(&["rollback", INSTALLED])));
    assert!(code == 1 && said.contains("has changed meanwhile"), "{said}");
    assert_eq!(fs::read_to_string(domain.path(INSTALLED)).unwrap(), variant(1), "what came back stays");
}

#[test]
fn in_a_shared_folder_what_another_user_has_put_there_is_not_used() {
    if let Some(number) = number() {
        compare_and_install(number);
    }
    if !rustix::process::geteuid().is_root() {
        return skip("only root can act as another user", Needs::Machine);
    }
    let test = "in_a_shared_folder_what_another_user_has_put_there_is_not_used";
    let domain = TestDomain::new();
    fs::set_permissions(domain.path(""), Permissions::from_mode(0o1777)).unwrap();
    domain.write(INSTALLED, TABLE);
    for name in [PREVIOUS, REPLACED, NEW, LOCK] {
        if name != PREVIOUS {
            domain.write(PREVIOUS, &variant(2));
        }
        chown(domain.write(name, &variant(1)), Some(NOBODY), Some(NOBODY)).unwrap();
        has(&refused(&domain, 74), &[name, "it belongs to user 65534", "have it removed"]);
        fs::remove_file(domain.path(name)).unwrap();
    }

    // The old table's owner and permissions stay with both. A predecessor that this user cannot replace stays, and so
    // does the table.
    let folder = domain.path("tables");
    fs::create_dir(&folder).unwrap();
    fs::set_permissions(&folder, Permissions::from_mode(0o1770)).unwrap();
    chown(&folder, None, Some(NOBODY)).unwrap();
    let path = |name: &str| folder.join(name);
    fs::write(path(INSTALLED), numbered(0)).unwrap();
    fs::set_permissions(path(INSTALLED), Permissions::from_mode(0o640)).unwrap();
    chown(path(INSTALLED), Some(NOBODY), Some(NOBODY)).unwrap();
    let installation = Installation::lock(&path(INSTALLED)).unwrap();
    installation.install(&numbered(1)).unwrap();
    installation.complete().unwrap();
    drop(installation);
    for name in [INSTALLED, PREVIOUS] {
        let metadata = fs::metadata(path(name)).unwrap();
        assert_eq!((metadata.uid(), metadata.gid(), metadata.mode() & 0o777), (NOBODY, NOBODY, 0o640), "{name}");
    }
    chown(path(PREVIOUS), Some(0), Some(0)).unwrap();
    let before = fs::metadata(path(INSTALLED)).unwrap().ino();
    // Another user may not reach where this was built.
    fs::copy(env::current_exe().unwrap(), domain.path("test")).unwrap();
    let mut command = child_of(&domain.path("test"), test, &folder, 2);
    command.uid(NOBODY).gid(NOBODY).stdin(Stdio::null());
    let output = domain.finish(command);
    assert_eq!(output.status.code(), Some(74), "{}", text(&output.stdout));
    has(
        &text(&output.stdout),
        &["keeping the predecessor as imu-a.toml.previous: ", "ermitted", "imu-a.toml is the new"],
    );
    assert_eq!([INSTALLED, PREVIOUS, REPLACED].map(|name| number_in(&path(name))), [Some(2), Some(0), Some(1)]);
    assert_eq!(fs::metadata(path(REPLACED)).unwrap().ino(), before);
}
