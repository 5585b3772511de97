//! The next table is accepted while the service uses up the acceptance of the one before: none is lost.

use super::supervisor::Supervisor;
use super::tracer::{Call, Fate, TRACED_TIMEOUT, Traced};
use super::{Ground, digest, lost_digit, may_trace, try_all};
use isotherm_tests::TABLE;
use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Whether the call belongs to the keeping of a table, at the end of which its acceptance is used up.
fn belongs_to_keeping(call: &Call) -> bool {
    let uses_up = call.name == "unlink" && call.path.contains("accepted-imu-a");
    let is_table = call.path.contains("/.state/") && !call.path.contains("configuration.");
    uses_up || is_table || call.path.contains("kept-imu-a")
}

/// Configurations that services have kept in the state folder. The start keeps its own there, too.
fn configurations(ground: &Ground) -> usize {
    let files = fs::read_dir(ground.state()).into_iter().flatten().flatten();
    let names = files.filter_map(|file| file.file_name().into_string().ok());
    names.filter(|name| name.starts_with("configuration.") && name.ends_with(".toml")).count()
}

/// Waits until something has happened, as long as a traced service may take.
fn wait_for(what: &str, traced: &Traced, happened: impl Fn() -> bool) {
    let begun = Instant::now();
    while !happened() {
        assert!(begun.elapsed() < TRACED_TIMEOUT, "{what} did not happen:\n{}", traced.log());
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Has the service take an accepted table. Before the call with this number, while that is kept, the way back is
/// accepted and put in place. Returns how many such calls there were, after both tables were taken and kept.
fn accept_again_at(number: usize) -> usize {
    let ground = Arc::new(Ground::new());
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let (calls, begins) = (Arc::new(AtomicUsize::new(0)), Arc::new(Mutex::new(false)));
    let decide = {
        let (ground, calls, begins) = (Arc::clone(&ground), Arc::clone(&calls), Arc::clone(&begins));
        move |call: &Call| {
            if *begins.lock().unwrap()
                && belongs_to_keeping(call)
                && calls.fetch_add(1, Ordering::Relaxed) + 1 == number
            {
                ground.domain.accept("imu-a", TABLE);
                ground.domain.replace("imu-a.toml", TABLE);
            }
            Fate::Happens
        }
    };
    let configurations_before = configurations(&ground);
    let traced = Traced::start(ground.serve(&supervisor), decide);
    ground.domain.register_process(traced.pid);
    assert!(supervisor.wait_for("READY=1", TRACED_TIMEOUT).is_some(), "{}", traced.log());
    wait_for("that the first table is kept", &traced, || ground.kept() == digest(TABLE));
    wait_for("that the configuration is kept", &traced, || configurations(&ground) > configurations_before);
    ground.domain.replace("imu-a.toml", &lost_digit());
    assert!(traced.has_logged("table refused", TRACED_TIMEOUT), "{}", traced.log());
    *begins.lock().unwrap() = true;
    ground.domain.accept("imu-a", &lost_digit());
    let is_kept = |text: &str| ground.kept() == digest(text) && !ground.domain.is_accepted("imu-a");
    if number == usize::MAX {
        wait_for("that the accepted table is kept", &traced, || is_kept(&lost_digit()));
        return calls.load(Ordering::Relaxed);
    }
    let taken = || traced.log().matches("accepted by its digest").count();
    let what = format!("that the table that was accepted at call {number} is taken");
    wait_for(&what, &traced, || taken() == 2 && is_kept(TABLE));
    calls.load(Ordering::Relaxed)
}

#[test]
fn a_table_that_is_accepted_at_any_call_of_keeping_the_one_before_is_taken() {
    if !may_trace() {
        return;
    }
    let calls = accept_again_at(usize::MAX);
    assert!(calls > 5, "{calls}");
    let numbers: Vec<_> = (1..=calls).collect();
    try_all(&numbers, |number| accept_again_at(*number));
}
