//! Disks and a log that are slow, or fail: the watchdog is fed, and signals are obeyed.

use super::supervisor::{Supervisor, WATCHDOG};
use super::tracer::{Call, End, Fate, TRACED_TIMEOUT, Traced};
use super::{Ground, digest, lost_digit, may_trace, try_all};
use isotherm_tests::{TABLE, TIMEOUT, variant, wait_until};
use nix::errno::Errno;
use nix::sys::signal::Signal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// What is slow or fails.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Target {
    /// Calls of this name on the files of tables, configuration and state folder.
    Disk(&'static str),
    /// Writing the log.
    Log,
}

/// When it begins.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum From {
    /// With the process; the service is asked to end before it is ready.
    Start,
    /// With the process, but the configuration is whole.
    Tables,
    /// When the service is ready. Then it gets a table, one that it refuses, and the acceptance of that.
    Ready,
}

#[derive(Clone, Copy, Debug)]
struct Case {
    target: Target,
    fate: Fate,
    from: From,
}

const LATE: Fate = Fate::Waits(Duration::from_secs(6));
/// Longer than the test waits for anything: what happens in it happens while the call hangs.
const HANGS: Fate = Fate::Waits(Duration::from_secs(3 * TIMEOUT.as_secs()));

/// All cases; `delay` is what happens to a call that is slow.
fn cases(delay: Fate) -> Vec<Case> {
    let disks = ["fsync", "rename", "open", "stat", "unlink"].map(Target::Disk);
    let targets = disks.into_iter().chain([Target::Log]);
    let fates = [delay].into_iter().chain([Errno::EIO, Errno::ENOSPC, Errno::EROFS, Errno::EINTR].map(Fate::Fails));
    let fates: Vec<_> = fates.collect();
    let both = targets.flat_map(|target| fates.iter().map(move |fate| (target, *fate)));
    let both: Vec<_> = both.collect();
    [From::Start, From::Tables, From::Ready]
        .into_iter()
        .flat_map(|from| both.iter().map(move |&(target, fate)| Case { target, fate, from }))
        .collect()
}

/// What came of a case.
struct Outcome {
    /// The longest time without a feed of the watchdog, from READY=1 to the signal; `None` if it was not ready.
    gap: Option<Duration>,
    /// From SIGTERM to the end.
    stops_after: Duration,
    /// How often the fault happened.
    faults: u32,
    end: End,
    log: String,
}

/// Runs the service with a fault, and asks it to end.
fn attempt(case: &Case) -> Outcome {
    let ground = Ground::new();
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let (lasts, faults) = (Arc::new(AtomicBool::new(case.from != From::Ready)), Arc::<AtomicU32>::default());
    let folder = ground.domain.path("").display().to_string();
    let streams = ground.domain.client_domain().root_path().to_owned();
    let (target, fate) = (case.target, case.fate);
    let spared = if case.from == From::Tables { "/service.toml" } else { "/notify" };
    let decide = {
        let (lasts, faults) = (Arc::clone(&lasts), Arc::clone(&faults));
        move |call: &Call| {
            // The files of the transport lie in memory.
            let on_disk =
                call.path.starts_with(&folder) && !call.path.starts_with(&streams) && !call.path.ends_with(spared);
            let hit = match target {
                Target::Disk(name) => call.name == name && on_disk,
                Target::Log => call.name == "write" && call.path.starts_with("pipe:"),
            };
            if !hit || !lasts.load(Ordering::Relaxed) {
                return Fate::Happens;
            }
            let number = faults.fetch_add(1, Ordering::Relaxed);
            // An interrupted call is made again: every other one.
            if fate == Fate::Fails(Errno::EINTR) && number % 2 == 1 { Fate::Happens } else { fate }
        }
    };
    let mut traced = Traced::start(ground.serve(&supervisor), decide);
    ground.domain.register_process(traced.pid);
    let mut ready = None;
    if case.from == From::Ready {
        ready = Some(
            supervisor.wait_for("READY=1", TRACED_TIMEOUT).unwrap_or_else(|| panic!("{case:?}:\n{}", traced.log())),
        );
        lasts.store(true, Ordering::Relaxed);
        // What comes of them is slow or fails. What matters is that the watchdog is fed meanwhile.
        let goes_on =
            |feeds| assert!(supervisor.is_fed(Instant::now(), feeds, TIMEOUT), "{case:?}: not fed:\n{}", traced.log());
        for text in [variant(1), lost_digit()] {
            ground.domain.replace("imu-a.toml", &text);
            goes_on(1);
        }
        ground.domain.accept("imu-a", &lost_digit());
        goes_on(5);
    } else {
        // Until the first fault has happened, or the service is ready without one.
        let begun = Instant::now();
        while faults.load(Ordering::Relaxed) == 0 && begun.elapsed() < TIMEOUT {
            if supervisor.wait_for("READY=1", Duration::from_millis(2)).is_some() {
                break;
            }
        }
    }
    let asked = Instant::now();
    traced.signal(Signal::SIGTERM);
    let end = traced.end(TIMEOUT).unwrap_or_else(|| panic!("{case:?}: SIGTERM is not obeyed:\n{}", traced.log()));
    let gap = ready.map(|ready| supervisor.largest_gap(ready, asked));
    Outcome { gap, stops_after: asked.elapsed(), faults: faults.load(Ordering::Relaxed), end, log: traced.log() }
}

/// Tries these cases, and prints the figures of each. Returns the longest time without a feed of the watchdog.
fn try_cases(cases: &[Case]) -> Duration {
    let outcomes = try_all(cases, attempt);
    println!("{:<16}{:<18}{:<8}{:>8}{:>10}{:>12}  end", "target", "fault", "from", "faults", "gap [s]", "SIGTERM [s]");
    for (case, outcome) in cases.iter().zip(&outcomes) {
        let Case { target, fate, from } = case;
        let name = match target {
            Target::Disk(name) => format!("disk {name}"),
            Target::Log => "log write".to_owned(),
        };
        let fate = match fate {
            Fate::Waits(time) => format!("{} s late", time.as_secs()),
            Fate::Fails(errno) => format!("{errno:?}"),
            fate => format!("{fate:?}"),
        };
        let gap = outcome.gap.map_or("-".to_owned(), |gap| format!("{:.2}", gap.as_secs_f64()));
        println!(
            "{name:<16}{fate:<18}{:<8}{:>8}{gap:>10}{:>12.2}  {:?}",
            format!("{from:?}"),
            outcome.faults,
            outcome.stops_after.as_secs_f64(),
            outcome.end
        );
    }
    for (case, outcome) in cases.iter().zip(&outcomes) {
        let ends_well = match case.from {
            From::Ready => outcome.end == End::Exited(0),
            // What cannot be read ends the start, and the supervisor tries again.
            From::Start | From::Tables => {
                [End::Exited(0), End::Exited(74), End::Killed(Signal::SIGTERM)].contains(&outcome.end)
            }
        };
        assert!(ends_well, "{case:?}: {:?}\n{}", outcome.end, outcome.log);
    }
    outcomes.iter().filter_map(|outcome| outcome.gap).max().unwrap_or_default()
}

/// An IMU that is new, and whose disk does not answer, keeps no other from being served.
#[test]
fn a_disk_that_does_not_answer_keeps_no_other_imu_from_being_served() {
    if !may_trace() {
        return;
    }
    let ground = Ground::new();
    ground.domain.write("imu-b.toml", TABLE);
    let both = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n[[imu]]\nid = \"imu-b\"\ntable = \"imu-b.toml\"\n";
    ground.domain.write("service.toml", both);
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let decide = |call: &Call| {
        let is_new = call.name == "open" && call.path.ends_with("imu-b.toml") && !call.path.contains("/.state/");
        if is_new { Fate::Waits(Duration::from_secs(60)) } else { Fate::Happens }
    };
    let mut traced = Traced::start(ground.serve(&supervisor), decide);
    ground.domain.register_process(traced.pid);
    assert!(supervisor.wait_for("READY=1", TRACED_TIMEOUT).is_some(), "{}", traced.log());
    let status = ground.domain.status();
    assert_eq!(status["imus"][0]["table"], digest(TABLE));
    assert!(status["imus"][1]["table"].is_null(), "{status}");
    traced.signal(Signal::SIGTERM);
    assert_eq!(traced.end(TIMEOUT), Some(End::Exited(0)), "{}", traced.log());
}

/// The disk of the state folder hangs: the start takes the table whose digest is noted in the domain's folder, and
/// nothing that is kept is lost when the disk answers.
#[test]
fn a_state_disk_that_hangs_delays_a_start_and_does_not_end_it() {
    if !may_trace() {
        return;
    }
    let ground = Ground::new();
    // Two steps, so that the anchor is another table than the one in force.
    let first = ground.domain.serve(&["--config", "service.toml"]);
    ground.domain.replace("imu-a.toml", &variant(1));
    wait_until("the table to be kept", || {
        let imu = ground.domain.imu_status();
        imu["table"] == digest(&variant(1)) && imu["table_kept"] == true
    });
    first.kill();
    ground.domain.write("imu-b.toml", &TABLE.replace("\"imu-a\"", "\"imu-b\""));
    let both = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n[[imu]]\nid = \"imu-b\"\ntable = \"imu-b.toml\"\n";
    ground.domain.write("service.toml", both);
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    // The first call hangs longer than the start waits.
    let mut has_hung = false;
    let decide = move |call: &Call| {
        let hangs = !has_hung && ["open", "stat"].contains(&call.name) && call.path.contains("/.state/");
        has_hung |= hangs;
        if hangs { Fate::Waits(Duration::from_secs(12)) } else { Fate::Happens }
    };
    let mut traced = Traced::start(ground.serve(&supervisor), decide);
    ground.domain.register_process(traced.pid);
    assert!(supervisor.wait_for("READY=1", TRACED_TIMEOUT).is_some(), "{}", traced.log());
    let of = |status: &serde_json::Value, imu: usize, field: &str| status["imus"][imu][field].clone();
    let log = traced.log();
    assert!(log.contains("the disk of the state folder does not answer: "), "{log}");
    assert!(
        log.contains("the same as before, by its digest") && log.contains("there is no table for this IMU"),
        "{log}"
    );
    // `status` gives up after two seconds, which a traced service may need for its next one on a busy machine.
    let status = || serde_json::from_slice(&ground.domain.run(&["status", "--json"]).stdout).unwrap_or_default();
    wait_until("the table of before", || of(&status(), 0, "table") == digest(&variant(1)));
    // Then the disk answers: the anchor is known again, and the file of the other IMU is judged once more.
    wait_until("what was kept", || {
        let status = status();
        of(&status, 0, "anchor") == digest(TABLE)
            && of(&status, 0, "table_kept") == true
            && of(&status, 1, "table").is_string()
    });
    traced.signal(Signal::SIGTERM);
    assert_eq!(traced.end(TIMEOUT), Some(End::Exited(0)), "{}", traced.log());
    // What was kept is as it was.
    let service = ground.domain.serve(&["--config", "service.toml"]);
    let imu = ground.domain.imu_status();
    assert_eq!((&imu["table"], &imu["anchor"]), (&digest(&variant(1)).into(), &digest(TABLE).into()));
    service.terminate();
}

#[test]
fn slow_and_failing_disks_and_logs_stop_neither_watchdog_nor_signals() {
    if may_trace() {
        // Those that hang longest, and of the rest each kind once.
        let share = cases(HANGS).into_iter().enumerate().filter(|(index, case)| {
            let slow =
                case.fate == HANGS && matches!(case.target, Target::Disk("fsync" | "open" | "stat") | Target::Log);
            slow || index % 11 == 3
        });
        try_cases(&share.map(|(_, case)| case).collect::<Vec<_>>());
    }
}

#[test]
#[ignore = "minutes: cargo test -p isotherm-tests --test all faults -- --ignored --nocapture"]
fn every_fault_of_disks_and_logs_stops_neither_watchdog_nor_signals() {
    if may_trace() {
        let gap = try_cases(&cases(LATE));
        // Half of what the unit file allows. This is for a machine that does nothing else.
        assert!(gap < WATCHDOG / 2, "{gap:?} without a feed");
    }
}
