//! Round trips through every path in turn. Each sample is sent when the one before it has been answered.
//!
//! Paths are measured in blocks of some milliseconds, one after the other, in an order that rotates. The children that are not
//! being measured are stopped. The round trip of a pair of processes depends on the cache slices that its memory falls into: it
//! changes by a tenth. So after some blocks all processes are started again; this is a round. Ratios are taken within a round.

use crate::Effort;
use crate::floor::Floor;
use crate::paths::{Bare, InProcess, Isotherm, Path, Socket};
use isotherm_benches::statistics::{figures, ratios};
use isotherm_benches::{
    BenchDomain, BenchProcess, BenchResult, IMU, OtherBuild, cores, pin, preemptions, sample, stolen_ticks,
};
use isotherm_client::{Acquisition, RawSample};
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Uncounted round trips at the start of each block, while caches and the child's core warm up.
const WARM_UP: usize = 300;
/// Blocks of each path in a round.
const BLOCKS: usize = 5;
/// Queue depth of the bare pair, and of the service where the two are compared.
const SHORT: usize = 2;

/// Round trips of a block.
const COUNT: usize = 5_000;
/// Round trips of a block, for a path that takes a hundred times longer.
const SLOW_COUNT: usize = 300;
/// Suffix of the name of a path with the default queue depth.
const DEFAULT_DEPTH: &str = "_default_depth";

/// The ratios that are given for this build, of the first path to the second. `iceoryx2_again` is the same path with another pair
/// of processes: its ratio shows the random differences between pairs.
const RATIOS: [(&str, &str); 5] = [
    ("isotherm", "iceoryx2"),
    ("isotherm_default_depth", "iceoryx2"),
    ("iceoryx2_again", "iceoryx2"),
    ("isotherm", "floor"),
    ("unix_socket", "isotherm"),
];

/// All ratios. Every other build is compared with the bare transport, and this build with it, at both queue depths.
fn all_ratios(others: &[OtherBuild]) -> Vec<(String, String)> {
    let own = RATIOS.iter().map(|(upper, lower)| ((*upper).to_owned(), (*lower).to_owned()));
    let of_others = others.iter().flat_map(|OtherBuild { name, .. }| {
        let deep = format!("{name}{DEFAULT_DEPTH}");
        let own_deep = format!("isotherm{DEFAULT_DEPTH}");
        let (bare, own) = ("iceoryx2".to_owned(), "isotherm".to_owned());
        [(name.clone(), bare.clone()), (deep.clone(), bare), (own, name.clone()), (own_deep, deep)]
    });
    own.chain(of_others).collect()
}

/// What has been measured of a path.
#[derive(Default)]
struct PathTimes {
    /// Sorted round trips \[ns\] of each round.
    rounds: Vec<Vec<u32>>,
    disturbed: usize,
}

/// Measures every path, and the services of other builds beside them.
pub fn measure(effort: Effort, others: &[OtherBuild]) -> BenchResult<Value> {
    let (rounds, blocks) = match effort {
        Effort::Smoke => (2, 2),
        Effort::Usual => (20, BLOCKS),
        Effort::Long => (200, BLOCKS),
    };
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));

    let (mut names, mut series) = (Vec::new(), Vec::<PathTimes>::new());
    for round in 0..rounds {
        let mut pairs = Pairs::start(theirs, others)?;
        names = pairs.paths.iter().map(|pair| pair.name.clone()).collect();
        series.resize_with(names.len(), PathTimes::default);
        series.iter_mut().for_each(|series| series.rounds.push(Vec::new()));
        for block in 0..blocks {
            for turn in 0..names.len() {
                let path = (round + block + turn) % names.len();
                pairs.paths[path].block(&mut series[path])?;
            }
        }
    }
    let of = |name: &str| names.iter().zip(&series).find(|(path, _)| *path == name).map(|(_, series)| series);
    let paths: Map<_, _> = names
        .iter()
        .zip(&series)
        .map(|(name, series)| (name.clone(), figures(series.rounds.concat()).into()))
        .collect();
    let ratios: Map<_, _> = all_ratios(others)
        .iter()
        .filter_map(|(upper, lower)| Some((format!("{upper}/{lower}"), ratios(&of(upper)?.rounds, &of(lower)?.rounds))))
        .collect();
    Ok(json!({
        "paths": paths,
        "ratios": ratios,
        "rounds": rounds,
        "blocks": rounds * blocks * names.len(),
        "disturbed_blocks": series.iter().map(|series| series.disturbed).sum::<usize>(),
        "pinned": theirs.is_some(),
        "clock_ns": clock_cost(),
    }))
}

/// A path, and the process behind it, which is stopped unless it is being measured.
struct Pair {
    name: String,
    path: Box<dyn MeasureBlock>,
    peer: Option<BenchProcess>,
    count: usize,
}

/// All paths of a round.
struct Pairs {
    paths: Vec<Pair>,
    // The last field: the paths must be dropped before the shared memory of their domains is removed.
    domains: Vec<BenchDomain>,
}

impl Pairs {
    fn start(core: Option<usize>, others: &[OtherBuild]) -> BenchResult<Self> {
        let mut pairs = Self { paths: Vec::new(), domains: Vec::new() };
        let pinned = core.map(|core| core.to_string()).unwrap_or_default();
        pairs.add("floor", COUNT, |domain| {
            let lines = domain.shared_memory("floor");
            let floor = Floor::create(&lines)?;
            Ok((floor, Some(domain.spawn(&["child", &pinned, "floor", &lines.to_string_lossy()])?)))
        })?;
        for name in ["iceoryx2", "iceoryx2_again"] {
            pairs.add(name, COUNT, |domain| {
                let (name, root) = (domain.as_domain().name(), domain.as_domain().root_path());
                let echo = domain.spawn(&["child", &pinned, "echo", name, root, &SHORT.to_string()])?;
                Ok((Bare::connect(domain.as_domain(), SHORT)?, Some(echo)))
            })?;
        }
        let realtime = core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
        let builds = [("isotherm", None)].into_iter();
        for (name, program) in builds.chain(others.iter().map(|build| (build.name.as_str(), Some(&build.program)))) {
            for (name, depth) in
                [(name.to_owned(), format!("depth = {SHORT}\n")), (format!("{name}{DEFAULT_DEPTH}"), String::new())]
            {
                pairs.add(&name, COUNT, |domain| {
                    let settings = format!("{depth}[wait]\nstrategy = \"spin\"\n{realtime}");
                    let service = domain.serve_by(program.map(PathBuf::as_path), &settings)?;
                    Ok((Isotherm(Acquisition::connect(&IMU.parse()?, &domain.options())?), Some(service)))
                })?;
            }
        }
        pairs.add("unix_socket", SLOW_COUNT, |domain| {
            let path = domain.path("socket");
            let server = domain.spawn(&["child", &pinned, "socket", &path.to_string_lossy()])?;
            Ok((Socket::connect(&path)?, Some(server)))
        })?;
        pairs.add("in_process", COUNT, |_| Ok((InProcess::new()?, None)))?;
        Ok(pairs)
    }

    /// Starts a path in a domain of its own.
    fn add<P: Path + 'static>(
        &mut self,
        name: &str,
        count: usize,
        start: impl FnOnce(&BenchDomain) -> BenchResult<(P, Option<BenchProcess>)>,
    ) -> BenchResult<()> {
        let domain = BenchDomain::new()?;
        let (path, peer) = start(&domain)?;
        peer.iter().for_each(BenchProcess::pause);
        self.paths.push(Pair { name: name.to_owned(), path: Box::new(path), peer, count });
        self.domains.push(domain);
        Ok(())
    }
}

impl Pair {
    fn block(&mut self, series: &mut PathTimes) -> BenchResult<()> {
        self.path.block(self.peer.as_ref(), self.count, series)
    }
}

/// Measures a block of a path. Only this call is dispatched dynamically; the round trips in the block are not.
trait MeasureBlock {
    fn block(&mut self, peer: Option<&BenchProcess>, count: usize, series: &mut PathTimes) -> BenchResult<()>;
}

impl<P: Path> MeasureBlock for P {
    fn block(&mut self, peer: Option<&BenchProcess>, count: usize, series: &mut PathTimes) -> BenchResult<()> {
        block(self, peer, count, series)
    }
}

/// Times a block of round trips. It counts as disturbed if one of the two processes was preempted meanwhile, or if there was
/// steal time.
fn block(path: &mut impl Path, peer: Option<&BenchProcess>, count: usize, series: &mut PathTimes) -> BenchResult<()> {
    let sample = sample();
    if let Some(peer) = peer {
        peer.resume();
    }
    for _ in 0..WARM_UP.min(count) {
        path.round_trip(&sample)?;
    }
    let disturbance =
        || preemptions(std::process::id()) + peer.map_or(0, |peer| preemptions(peer.pid())) + stolen_ticks();
    let before = disturbance();
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        times.push(timed(path, &sample)?);
    }
    series.disturbed += usize::from(disturbance() != before);
    if let Some(peer) = peer {
        peer.pause();
    }
    if let Some(round) = series.rounds.last_mut() {
        round.append(&mut times);
        round.sort_unstable();
    }
    Ok(())
}

#[inline]
fn timed(path: &mut impl Path, sample: &RawSample) -> BenchResult<u32> {
    let sent = Instant::now();
    black_box(path.round_trip(black_box(sample))?);
    Ok(u32::try_from(sent.elapsed().as_nanos()).unwrap_or(u32::MAX))
}

/// The cost of reading the clock \[ns\], which is a part of every round trip.
fn clock_cost() -> f64 {
    const READINGS: u32 = 100_000;
    let started = Instant::now();
    for _ in 0..READINGS {
        black_box(Instant::now());
    }
    let cost: Duration = started.elapsed() / READINGS;
    cost.as_secs_f64() * 1e9
}
