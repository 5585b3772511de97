//! Round trips through every path in turn, at the rate of an IMU: a sample is sent when it is due. Between two samples
//! the acquisition's thread uses its caches for other work, as an acquisition does.
//!
//! A turn is a part of a block of some tens of milliseconds. It counts as disturbed if the host took the machine
//! meanwhile.

use crate::pairs::{ANTICIPATE, DEFAULT_DEPTH, Pair, SHORT, alternate, builds, pinned};
use crate::paths::Path;
use isotherm_benches::{
    BenchProcess, BenchResult, Common, OtherBuild, PathTimes, Series, nanoseconds, sample, stolen_ticks, worker_time,
};
use serde_json::{Map, Value, json};
use std::hint::{black_box, spin_loop};
use std::time::{Duration, Instant};

/// Rates \[Hz\], round trips of a block, and of a block of a path whose ratio at p99 is judged. A round has one block
/// of each path at each rate; its p90 needs 200 round trips.
const RATES: [(u32, usize, usize); 2] = [(400, 210, 300), (2_000, 300, 400)];
/// Uncounted round trips at the start of each block, while the child's core warms up and the service learns the rate.
const WARM_UP: usize = 50;
/// Duration of a turn.
const TURN: Duration = Duration::from_millis(50);
/// Size of the memory that the acquisition's thread works on between two samples: more than a first-level cache holds,
/// and about what a second-level cache does. That takes a small part of the shortest period, and is given as
/// `own_work_us`.
const OWN_BYTES: usize = 1 << 20;
/// Size of a cache line.
const LINE_BYTES: usize = 64;

/// Suffix of the name of a path whose service blocks.
const BLOCK: &str = "_block";

/// The ratios that are given for this build, of the first path to the second. `iceoryx2_rehearsed` does what a client
/// with bare streams can do to be as ready as Isotherm.
const RATIOS: [&str; 8] = [
    "isotherm_anticipate/iceoryx2_rehearsed",
    "isotherm/iceoryx2",
    "isotherm_default_depth/iceoryx2",
    "isotherm/iceoryx2_rehearsed",
    "isotherm_default_depth/iceoryx2_rehearsed",
    "iceoryx2_rehearsed/iceoryx2",
    "iceoryx2_again/iceoryx2",
    "isotherm_default_depth/floor",
];

/// The ratios of the waiting strategies. They are given of undisturbed turns too: a worker that sleeps is hit harder
/// when the host takes the machine.
const STRATEGY_RATIOS: [&str; 3] = [
    "isotherm_anticipate/isotherm_block",
    "isotherm_anticipate/isotherm_default_depth",
    "isotherm_block/isotherm_default_depth",
];

/// All ratios. Every other build is compared with the bare transport, and this build with it.
fn all_ratios(others: &[OtherBuild]) -> Vec<String> {
    let of_others = others.iter().flat_map(|OtherBuild { name, .. }| {
        [
            format!("{name}{DEFAULT_DEPTH}/iceoryx2"),
            format!("isotherm{DEFAULT_DEPTH}/{name}{DEFAULT_DEPTH}"),
            format!("isotherm{ANTICIPATE}/{name}{ANTICIPATE}"),
        ]
    });
    RATIOS.iter().chain(&STRATEGY_RATIOS).map(ToString::to_string).chain(of_others).collect()
}

/// Measures every path at every rate, and the services of other builds for comparison.
pub(crate) fn measure(common: Common, others: &[OtherBuild]) -> BenchResult<Value> {
    let rounds = common.rounds(1, 8);
    let mut own = OwnWork::new();
    let walk = own.cost();
    let series: [Series; RATES.len()] = alternate(
        rounds,
        1,
        |pairs| {
            pairs.add_floor()?;
            pairs.add_bare("iceoryx2")?;
            pairs.add_bare("iceoryx2_again")?;
            pairs.add_rehearsed("iceoryx2_rehearsed")?;
            pairs.add_service("isotherm", None, Some(SHORT), "spin")?;
            for (name, program) in builds(others) {
                pairs.add_service(&format!("{name}{DEFAULT_DEPTH}"), program, None, "spin")?;
                pairs.add_service(&format!("{name}{ANTICIPATE}"), program, None, "anticipate")?;
            }
            pairs.add_service(&format!("isotherm{BLOCK}"), None, None, "block")?;
            pairs.add_in_process()
        },
        |Pair { name, path, peer }, kind, times| {
            let (rate, count, long) = RATES[kind];
            let judged = [DEFAULT_DEPTH, ANTICIPATE, BLOCK].iter().any(|suffix| name.ends_with(suffix));
            let period = Duration::from_secs(1) / rate;
            let count = common.block(if judged { long } else { count });
            path.paced(peer.as_ref(), &mut Pace { period, count, own: &mut own }, times)
        },
    )?;
    let ratios = all_ratios(others);
    let mut document = Map::new();
    for ((rate, ..), series) in RATES.iter().zip(&series) {
        let mut at_rate = series_figures(series, &ratios);
        at_rate["undisturbed_ratios"] = series.undisturbed_ratios(&STRATEGY_RATIOS).into();
        document.insert(rate.to_string(), at_rate);
    }
    document.insert("rounds".to_owned(), rounds.into());
    document.insert("pinned".to_owned(), pinned().into());
    document.insert("own_work_us".to_owned(), json!((walk.as_secs_f64() * 1e7).round() / 10.0));
    Ok(document.into())
}

/// The figures of all paths, and their ratios.
pub(crate) fn series_figures(series: &Series, ratios: &[impl AsRef<str>]) -> Value {
    let paths: Map<_, _> = series.paths().map(|(name, times)| (name.clone(), figures(times))).collect();
    json!({
        "paths": paths,
        "ratios": series.ratios(ratios),
        "turns": series.total(|times| times.turns),
        "disturbed_turns": series.total(|times| times.disturbed),
    })
}

/// The figures of a path, with those from the moments at which samples were due, and the worker's share of a core.
fn figures(times: &PathTimes) -> Value {
    let mut figures = times.figures();
    let from_due = isotherm_benches::figures(times.from_due.clone());
    figures.insert("from_due".to_owned(), from_due.into());
    if !times.worker.is_zero() {
        let share = times.worker.as_secs_f64() / times.counted.as_secs_f64();
        figures.insert("cpu_percent".to_owned(), json!((share * 1e4).round() / 1e2));
    }
    figures.insert("turns".to_owned(), times.turns.into());
    figures.insert("disturbed_turns".to_owned(), times.disturbed.into());
    figures.into()
}

/// How a block is paced.
pub(crate) struct Pace<'a> {
    pub period: Duration,
    /// Round trips that are counted.
    pub count: usize,
    pub own: &'a mut OwnWork,
}

/// Times a block of round trips, after some uncounted ones.
pub(crate) fn block(
    path: &mut impl Path,
    peer: Option<&BenchProcess>,
    pace: &mut Pace<'_>,
    times: &mut PathTimes,
) -> BenchResult<()> {
    let sample = sample();
    let turn = (TURN.as_nanos() / pace.period.as_nanos()) as usize;
    if let Some(peer) = peer {
        peer.resume();
    }
    let worker = || peer.map(worker_time).unwrap_or_default();
    let (mut block, mut from_due) = (Vec::with_capacity(turn), Vec::with_capacity(turn));
    let mut due = Instant::now() + pace.period;
    let (mut begun, mut worker_before, mut stolen) = (due, Duration::ZERO, 0);
    for number in 0..WARM_UP + pace.count {
        if number == WARM_UP {
            (begun, worker_before, stolen) = (Instant::now(), worker(), stolen_ticks());
        }
        pace.own.walk();
        wait_until(due - path.lead());
        path.prepare()?;
        wait_until(due);
        let sent = Instant::now();
        black_box(path.round_trip(black_box(&sample))?);
        let answered = Instant::now();
        if number >= WARM_UP {
            block.push(nanoseconds(answered - sent));
            from_due.push(nanoseconds(answered - due));
        }
        if block.len() == turn || number + 1 == WARM_UP + pace.count {
            let stolen_before = core::mem::replace(&mut stolen, stolen_ticks());
            times.add(&block, stolen != stolen_before);
            times.from_due.append(&mut from_due);
            block.clear();
        }
        due += pace.period;
    }
    times.worker += worker().saturating_sub(worker_before);
    times.counted += begun.elapsed();
    if let Some(peer) = peer {
        peer.pause();
    }
    Ok(())
}

/// Spins until a moment.
fn wait_until(moment: Instant) {
    while Instant::now() < moment {
        spin_loop();
    }
}

/// What the acquisition's thread does between two samples: it reads and writes one word in each cache line of its
/// memory.
pub(crate) struct OwnWork(Vec<u64>);

impl OwnWork {
    /// Takes the memory.
    pub(crate) fn new() -> Self {
        Self(vec![1; OWN_BYTES / size_of::<u64>()])
    }

    /// Uses all of the memory once.
    fn walk(&mut self) {
        let mut state = 0_u64;
        for word in self.0.iter_mut().step_by(LINE_BYTES / size_of::<u64>()) {
            state = state.rotate_left(5) ^ *word;
            *word = if state & 3 == 0 { state.wrapping_add(1) } else { word.wrapping_add(state) };
        }
        black_box(state);
    }

    /// How long that takes.
    fn cost(&mut self) -> Duration {
        const WALKS: u32 = 100;
        self.walk();
        let started = Instant::now();
        (0..WALKS).for_each(|_| self.walk());
        started.elapsed() / WALKS
    }
}
