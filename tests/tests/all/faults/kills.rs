//! `kill -9` at the system calls of each phase, then a start.

use super::supervisor::Supervisor;
use super::tracer::{Call, Fate, TRACED_TIMEOUT, Traced};
use super::{Ground, digest, lost_digit, may_trace, try_all};
use isotherm_tests::{TABLE, TIMEOUT, variant, wait_until};
use nix::sys::signal::Signal;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// What the service does when it is killed.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Phase {
    /// Nothing has been kept before. Only what concerns the keeping.
    FirstStart,
    Start,
    /// It takes a table and keeps it.
    Reload,
    RefusedReload,
    /// It takes a table that was refused and is accepted, keeps it, and uses the acceptance up.
    Acceptance,
    Stop,
}

const PHASES: [Phase; 6] =
    [Phase::FirstStart, Phase::Start, Phase::Reload, Phase::RefusedReload, Phase::Acceptance, Phase::Stop];

impl Phase {
    /// The digest of the table that is in force afterwards, and after a start that follows a kill.
    fn digest(self) -> String {
        match self {
            Self::FirstStart | Self::Start | Self::RefusedReload | Self::Stop => digest(TABLE),
            Self::Reload => digest(&variant(1)),
            Self::Acceptance => digest(&lost_digit()),
        }
    }

    fn is_start(self) -> bool {
        matches!(self, Self::FirstStart | Self::Start)
    }

    /// Whether the call is one of this phase.
    fn contains(self, call: &Call) -> bool {
        self != Self::FirstStart || call.path.contains("/.state/") || call.path.contains("kept-imu-a")
    }
}

/// A system call of a phase: what it does to what, and how many such calls come before it.
#[derive(Clone, Debug, Eq, PartialEq)]
struct Place {
    phase: Phase,
    name: &'static str,
    /// Without the parts that differ from run to run.
    path: String,
    number: usize,
    changes: bool,
}

/// Notes the calls while a phase lasts, and kills at one of them.
struct Watch {
    phase: Phase,
    lasts: bool,
    seen: HashMap<(&'static str, String), usize>,
    calls: Vec<Place>,
    kills_at: Option<Place>,
    /// What is different in each run, and its name in a place.
    ground: Vec<(String, &'static str)>,
}

impl Watch {
    fn decide(&mut self, call: &Call) -> Fate {
        if !self.lasts || !self.phase.contains(call) {
            return Fate::Happens;
        }
        let path = without_numbers(&call.path, &self.ground);
        let number = self.seen.entry((call.name, path.clone())).or_default();
        *number += 1;
        self.calls.push(Place { phase: self.phase, name: call.name, path, number: *number, changes: call.changes });
        if self.was_killed() { Fate::Kills } else { Fate::Happens }
    }

    fn was_killed(&self) -> bool {
        self.kills_at.is_some() && self.kills_at.as_ref() == self.calls.last()
    }
}

/// The path with `#` in the place of what differs from run to run: long words with a digit, and random names.
fn without_numbers(path: &str, ground: &[(String, &str)]) -> String {
    let known = ground.iter().fold(path.to_owned(), |path, (text, name)| path.replace(text.as_str(), name));
    let (mut text, mut word) = (String::new(), String::new());
    for character in known.chars().chain(['/']) {
        if character.is_ascii_alphanumeric() {
            word.push(character);
            continue;
        }
        let is_random =
            text.ends_with(".isotherm-") || word.len() > 4 && word.bytes().any(|byte| byte.is_ascii_digit());
        text.push_str(if is_random { "#" } else { &word });
        text.push(character);
        word.clear();
    }
    text.pop();
    text
}

/// A service in a phase.
struct Run {
    ground: Ground,
    supervisor: Supervisor,
    traced: Traced,
    watch: Arc<Mutex<Watch>>,
}

impl Run {
    fn start(phase: Phase, kills_at: Option<Place>) -> Self {
        let ground = if phase == Phase::FirstStart { Ground::empty() } else { Ground::new() };
        let supervisor = Supervisor::listen(&ground.domain.path("notify"));
        let domain = ground.domain.client_domain();
        let names = vec![
            (domain.prefix(), "PREFIX_"),
            (domain.name().to_owned(), "DOMAIN"),
            (ground.domain.path("").display().to_string().trim_end_matches('/').to_owned(), "FOLDER"),
        ];
        let lasts = phase.is_start();
        let watch = Watch { phase, lasts, seen: HashMap::new(), calls: Vec::new(), kills_at, ground: names };
        let watch = Arc::new(Mutex::new(watch));
        let decides = Arc::clone(&watch);
        let traced = Traced::start(ground.serve(&supervisor), move |call| decides.lock().unwrap().decide(call));
        ground.domain.register_process(traced.pid);
        Self { ground, supervisor, traced, watch }
    }

    /// Waits until something has happened, or the process has been killed. Returns whether it lives.
    fn wait(&mut self, mut done: impl FnMut(&Self) -> bool) -> bool {
        let begun = Instant::now();
        while !done(self) {
            if self.traced.end(Duration::from_millis(5)).is_some() {
                return false;
            }
            assert!(
                begun.elapsed() < TRACED_TIMEOUT,
                "{:?} does not end, after {} calls:\n{}",
                self.watch.lock().unwrap().phase,
                self.watch.lock().unwrap().calls.len(),
                self.traced.log()
            );
        }
        true
    }

    fn is_ready(&self) -> bool {
        self.supervisor.wait_for("READY=1", Duration::ZERO).is_some()
    }

    /// Brings the service to the end of its phase, or to the kill.
    fn go(&mut self, phase: Phase) {
        if !self.wait(Self::is_ready) {
            assert!(phase.is_start(), "it ended before the phase:\n{}", self.traced.log());
            return;
        }
        if !phase.is_start() {
            assert!(self.wait(|run| !run.ground.is_in_its_first_second()));
        }
        let refused = |run: &Self| run.traced.has_logged("table refused", Duration::ZERO);
        if phase == Phase::Acceptance {
            self.ground.domain.replace("imu-a.toml", &lost_digit());
            assert!(self.wait(refused));
        }
        self.watch.lock().unwrap().lasts = true;
        let wanted = phase.digest();
        let lives = match phase {
            Phase::FirstStart | Phase::Start => self.wait(|run| run.ground.kept() == wanted),
            Phase::Reload => {
                self.ground.domain.replace("imu-a.toml", &variant(1));
                self.wait(|run| run.ground.kept() == wanted)
            }
            Phase::RefusedReload => {
                self.ground.domain.replace("imu-a.toml", &lost_digit());
                self.wait(refused)
            }
            Phase::Acceptance => {
                self.ground.domain.accept("imu-a", &lost_digit());
                self.wait(|run| run.ground.kept() == wanted && !run.is_accepted())
            }
            Phase::Stop => {
                self.traced.signal(Signal::SIGTERM);
                self.wait(|_| false)
            }
        };
        // What follows belongs to the phase.
        let begin = Instant::now();
        let _ = lives && self.wait(|run| run.supervisor.is_fed(begin, 1, Duration::ZERO));
        self.watch.lock().unwrap().lasts = false;
    }

    fn is_accepted(&self) -> bool {
        self.ground.domain.is_accepted("imu-a")
    }
}

/// The calls of a phase, each place once.
fn places(phase: Phase) -> Vec<Place> {
    let mut run = Run::start(phase, None);
    run.go(phase);
    std::mem::take(&mut run.watch.lock().unwrap().calls)
}

/// What came of a kill.
struct Outcome {
    /// Whether the place was reached.
    was_killed: bool,
    /// From the next start to READY=1.
    ready_after: Duration,
}

/// Kills at a place, and starts the service again.
fn kill_at(place: &Place) -> Outcome {
    let mut run = Run::start(place.phase, Some(place.clone()));
    run.go(place.phase);
    run.traced.signal(Signal::SIGKILL);
    let Run { ground, supervisor, traced, watch } = run;
    let was_killed = watch.lock().unwrap().was_killed();
    drop((traced, supervisor));
    let supervisor = Supervisor::listen(&ground.domain.path("notify"));
    let begun = Instant::now();
    let service = ground.domain.start(ground.serve(&supervisor));
    let ready = supervisor.wait_for("READY=1", TIMEOUT);
    let ready = ready.unwrap_or_else(|| panic!("after {place:?} it is not ready again:\n{}", service.log()));
    let in_force = ground.domain.imu_status()["table"].clone();
    assert_eq!(in_force, place.phase.digest(), "after {place:?}:\n{}", service.log());
    // What has begun is completed: the table in force is kept.
    wait_until("the table to be kept", || ground.domain.imu_status()["table_kept"] == true);
    service.kill();
    Outcome { was_killed, ready_after: ready - begun }
}

/// Kills at the place with this index. Another run may not come so far, as it looks less often at the same files. Then
/// it kills at the first such call, otherwise at one of the next places.
fn kill_near(places: &[Place], index: usize) -> Outcome {
    let first = Place { number: 1, ..places[index].clone() };
    let next = (1..=2).map(|step| places[(index + step) % places.len()].clone());
    let others = [first].into_iter().chain(next).filter(|other| *other != places[index]);
    let mut outcome = kill_at(&places[index]);
    for other in others {
        if outcome.was_killed {
            break;
        }
        outcome = kill_at(&other);
    }
    outcome
}

/// Kills at a share of the places: of those that change something one in `changing`, of the others one in `others`.
fn try_places(changing: usize, others: usize) {
    println!("{:<16}{:>8}{:>8}{:>8}{:>12}", "phase", "calls", "tried", "killed", "ready [s]");
    let (mut all_tried, mut all_killed) = (0, 0);
    for phase in PHASES {
        let places = places(phase);
        let all = places.len();
        let (change, look): (Vec<_>, Vec<_>) = places.into_iter().partition(|place| place.changes);
        // The share begins at another place in each phase.
        let share = |places: &[Place], step: usize| {
            let first = all % step.min(places.len().max(1));
            (first..places.len()).step_by(step)
        };
        let changes = share(&change, changing).map(|index| (&change, index));
        let chosen: Vec<_> = changes.chain(share(&look, others).map(|index| (&look, index))).collect();
        let outcomes = try_all(&chosen, |(places, index)| kill_near(places, *index));
        let killed = outcomes.iter().filter(|outcome| outcome.was_killed).count();
        let latest = outcomes.iter().map(|outcome| outcome.ready_after).max().unwrap_or_default();
        println!("{:<16}{all:>8}{:>8}{killed:>8}{:>12.2}", format!("{phase:?}"), outcomes.len(), latest.as_secs_f64());
        assert!(killed > 0, "{phase:?}");
        (all_tried, all_killed) = (all_tried + outcomes.len(), all_killed + killed);
    }
    // Some calls are not made in each run.
    assert!(all_killed * 2 > all_tried, "{all_killed} of {all_tried}");
}

#[test]
fn killed_at_a_share_of_its_system_calls_it_serves_again() {
    if may_trace() {
        try_places(40, 400);
    }
}

#[test]
#[ignore = "minutes: cargo test -p isotherm-tests --test all faults -- --ignored --nocapture"]
fn killed_at_every_system_call_that_changes_something_it_serves_again() {
    if may_trace() {
        try_places(1, 20);
    }
}

#[test]
fn numbers_and_random_names_do_not_make_another_place() {
    let ground = [("isotherm_5a7be278_".to_owned(), "PREFIX_"), ("/tmp/iso-aBcD".to_owned(), "FOLDER")];
    for (path, plain) in [
        ("/dev/shm/isotherm_5a7be278_0354a209029e_15845651540028.data", "/dev/shm/PREFIX_#_#.data"),
        ("/tmp/iso-aBcD/.state/d/.isotherm-aBxYzW", "FOLDER/.state/d/.isotherm-#"),
        ("/tmp/iso-aBcD/imu-a.toml", "FOLDER/imu-a.toml"),
    ] {
        assert_eq!(without_numbers(path, &ground), plain);
    }
}
