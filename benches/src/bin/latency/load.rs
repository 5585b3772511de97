//! Beside two neighbours that use all the processor time they get: with and without real-time settings, with and without reloads.

use crate::Effort;
use crate::open::{self, Latencies, Schedule};
use isotherm_benches::statistics::pooled_ratio;
use isotherm_benches::{IMU, Outcome, Partner, TABLE, World, cores, pin, stolen};
use isotherm_client::{Acquisition, Realtime};
use serde_json::{Map, Value, json};
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

/// \[Hz\].
const RATE: u32 = 2_000;
/// With and without reloads take turns of a second this often.
const TURNS: usize = 20;
const RELOADS_PER_SECOND: u32 = 10;
/// `SCHED_FIFO` priorities: the service before its client.
const PRIORITIES: (i32, i32) = (50, 49);

/// A neighbour.
pub fn hungry() -> Outcome<()> {
    loop {
        core::hint::black_box(0);
    }
}

pub fn measure(effort: Effort) -> Outcome<Value> {
    let cores = cores();
    let mut document = Map::new();
    for (neighbours, realtime) in [(false, false), (false, true), (true, false), (true, true)] {
        let name = match (neighbours, realtime) {
            (false, false) => "quiet",
            (false, true) => "quiet, real-time",
            (true, false) => "neighbours",
            (true, true) => "neighbours, real-time",
        };
        // In a thread of its own, since real-time settings are a thread's and stay.
        let cores = cores.clone();
        let result = thread::spawn(move || scenario(effort, &cores, neighbours, realtime).map_err(|e| e.to_string()));
        let figures = match result.join().map_err(|_| "a scenario panicked")? {
            Ok(figures) => figures,
            Err(cause) => json!({"not_measured": cause}),
        };
        document.insert(name.to_owned(), figures);
    }
    Ok(json!({"load": document, "rate_hz": RATE, "reloads_per_s": RELOADS_PER_SECOND}))
}

fn scenario(effort: Effort, cores: &[usize], neighbours: bool, realtime: bool) -> Outcome<Value> {
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    let world = World::new()?;
    let _hungry: Vec<Partner> = if neighbours {
        let start = |core: &usize| world.spawn(&["child", &core.to_string(), "hungry"]);
        cores.iter().map(start).collect::<Outcome<_>>()?
    } else {
        Vec::new()
    };
    let core = theirs.map(|core| format!("core = {core}\n")).unwrap_or_default();
    let more = if realtime { format!("priority = {}\nlock_memory = true\n", PRIORITIES.0) } else { String::new() };
    let _service = world.serve(&format!("[realtime]\n{core}{more}"))?;
    let reloads = Reloads::start(world.path("table.toml"));
    // Only now: what this thread starts has its settings.
    pin(mine.filter(|_| theirs.is_some()));
    if realtime {
        Realtime { priority: Some(PRIORITIES.1), lock_memory: true, ..Realtime::default() }.apply()?;
    }
    let mut acquisition = [Acquisition::connect(&IMU.parse()?, &world.options())?];
    let schedule = Schedule {
        period: Duration::from_secs(1) / RATE,
        warm_up: RATE as usize / 20,
        count: effort.of(200, RATE as usize),
        // A sender that spins at a real-time priority would be stopped by the kernel itself.
        spin: false,
    };
    let (mut without, mut with, mut disturbed) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..effort.of(6, TURNS) {
        let before = stolen();
        for (on, turns) in [(false, &mut without), (true, &mut with)] {
            reloads.on(on);
            turns.push(open::run(&mut acquisition, schedule, || ())?);
        }
        disturbed.push(stolen() != before);
    }
    drop(reloads);
    // What the host takes away shows in the tails of both; it would only blur the ratio.
    let sent = |turns: &[Latencies]| {
        let undisturbed = turns.iter().zip(&disturbed).filter(|(_, disturbed)| !**disturbed);
        undisturbed.map(|(turn, _)| turn.sent.clone()).collect::<Vec<_>>()
    };
    let (with_sent, without_sent) = (sent(&with), sent(&without));
    let ratio = |part: f64| pooled_ratio(&with_sent, &without_sent, part);
    let ratios = json!({"p99": ratio(0.99), "p999": ratio(0.999)});
    let figures = |turns: Vec<Latencies>| {
        let mut all = Latencies::default();
        turns.into_iter().for_each(|turn| all.append(turn));
        all.figures()
    };
    Ok(json!({
        "no_reloads": figures(without),
        "reloads": figures(with),
        "ratios from_send, reloads/no_reloads": ratios,
        "turns": disturbed.len(),
        "disturbed_turns": disturbed.iter().filter(|disturbed| **disturbed).count(),
    }))
}

/// A thread that replaces the table ten times a second while it is told to.
struct Reloads {
    on: Arc<AtomicBool>,
    end: Option<mpsc::Sender<()>>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Reloads {
    fn start(table: PathBuf) -> Self {
        let on = Arc::new(AtomicBool::new(false));
        let (end, ended) = mpsc::channel::<()>();
        let asked = Arc::clone(&on);
        let thread = thread::spawn(move || {
            let next = table.with_extension("new");
            let mut number = 0;
            while ended.recv_timeout(Duration::from_secs(1) / RELOADS_PER_SECOND) == Err(RecvTimeoutError::Timeout) {
                if asked.load(Relaxed) {
                    number = (number + 1) % 9;
                    let text = TABLE.replace("9.8015", &format!("9.80{number}"));
                    // What fails here shows as a reload that does not come, not as latency.
                    let _ = fs::write(&next, text).and_then(|()| fs::rename(&next, &table));
                }
            }
        });
        Self { on, end: Some(end), thread: Some(thread) }
    }

    fn on(&self, on: bool) {
        self.on.store(on, Relaxed);
    }
}

impl Drop for Reloads {
    fn drop(&mut self) {
        self.end.take();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
