//! `isotherm install` is killed at each of its system calls that change something.

use super::tracer::{End, Fate, TRACED_TIMEOUT, Traced};
use super::{digest, lost_digit};
use isotherm_tests::{TABLE, TestDomain, text, variant, wait_until};
use std::fs;

/// Kills the installation of a table at the call with this number, and returns the call; `None` if there are fewer.
fn kill_at(domain: &TestDomain, number: usize, ends: i32) -> Option<String> {
    let folder = domain.path("").display().to_string();
    let (sender, killed) = std::sync::mpsc::channel();
    let mut seen = 0;
    let command = domain.isotherm(&["install", "new.toml", "tables/imu-a.toml"]);
    let mut traced = Traced::start(command, move |call| {
        if !call.changes || !call.path.starts_with(&folder) {
            return Fate::Happens;
        }
        seen += 1;
        if seen <= number {
            return Fate::Happens;
        }
        let _ = sender.send(format!("{} {}", call.name, call.path));
        Fate::Kills
    });
    match traced.end(TRACED_TIMEOUT).unwrap() {
        End::Exited(code) if code == ends => None,
        End::Exited(code) => panic!("{code}: {}", traced.log()),
        End::Killed(_) => Some(killed.recv().unwrap()),
    }
}

/// Kills the installation of `new` at each call, and repeats it each time, which must end with `code` and leave these
/// two tables. Returns the calls.
fn kill_at_each(new: &str, code: i32, wanted: [&str; 2]) -> Vec<String> {
    let domain = TestDomain::new();
    fs::create_dir(domain.path("tables")).unwrap();
    let path = |name: &str| domain.path("tables").join(name);
    let read = |name: &str| fs::read_to_string(path(name)).unwrap();
    domain.write("tables/imu-a.toml", TABLE);
    let _service = domain.serve(&["--imu", "imu-a=tables/imu-a.toml"]);
    domain.write("new.toml", new);
    let mut calls = Vec::new();
    loop {
        // As before the first one, by a user.
        fs::write(path("imu-a.toml"), TABLE).unwrap();
        wait_until("the first table", || {
            let imu = domain.imu_status();
            imu["table"] == digest(TABLE) && imu["last_reload_error"].is_null()
        });
        fs::write(path("imu-a.toml.previous"), variant(2)).unwrap();
        let Some(call) = kill_at(&domain, calls.len(), code) else { return calls };
        let now = read("imu-a.toml");
        assert!([TABLE, new].contains(&now.as_str()), "{call}: {now}");
        let output = domain.run(&["install", "new.toml", "tables/imu-a.toml"]);
        assert_eq!(output.status.code(), Some(code), "{call}: {}", text(&output.stderr));
        let both = [read("imu-a.toml"), read("imu-a.toml.previous")];
        assert_eq!(both, wanted, "{call}");
        assert_eq!(fs::read_dir(domain.path("tables")).unwrap().count(), 2, "{call}");
        calls.push(call);
    }
}

#[test]
fn after_each_kill_one_table_is_there_and_the_next_call_settles_it() {
    let calls = kill_at_each(&variant(1), 0, [&variant(1), TABLE]);
    assert!(calls.iter().filter(|call| call.starts_with("rename")).count() >= 4, "{calls:?}");
}

#[test]
fn a_kill_brings_no_refused_table_into_use() {
    let calls = kill_at_each(&lost_digit(), 78, [TABLE, &variant(2)]);
    assert!(calls.iter().filter(|call| call.starts_with("rename")).count() >= 4, "{calls:?}");
}
