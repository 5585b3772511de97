//! Round trips, each sent when the last has been answered, through every path in turn.
//!
//! Paths are measured in blocks of some milliseconds, one after the other, in an order that rotates; the children that are not
//! being measured are stopped. Which cache slices the memory of a pair of processes falls into changes its round trip by
//! a tenth, so after some blocks all processes are started anew: that is a round. Ratios are taken within a round.

use crate::Effort;
use crate::floor::Floor;
use crate::paths::{Bare, InProcess, Isotherm, Path, Socket};
use isotherm_benches::statistics::{figures, ratios};
use isotherm_benches::{IMU, OtherBuild, Outcome, Partner, World, cores, pin, preemptions, sample, stolen};
use isotherm_client::{Acquisition, RawSample};
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Uncounted round trips at the start of each block, while caches and the child's core wake up.
const WARM_UP: usize = 300;
/// Blocks of each path in a round.
const BLOCKS: usize = 5;
/// Queues of the bare pair, and of the service where it is to be compared with it.
const SHORT: usize = 2;

/// Round trips of a block.
const COUNT: usize = 5_000;
/// Of a path that takes a hundred times longer.
const SLOW_COUNT: usize = 300;
/// What the name of a path with the default depth of the queues ends with.
const DEFAULT_DEPTH: &str = "_default_depth";

/// The ratios that are given, of the first to the second, without those of other builds. The same twice is another pair of processes: what
/// chance does.
const RATIOS: [(&str, &str); 5] = [
    ("isotherm", "iceoryx2"),
    ("isotherm_default_depth", "iceoryx2"),
    ("iceoryx2_again", "iceoryx2"),
    ("isotherm", "floor"),
    ("unix_socket", "isotherm"),
];

/// All ratios: every other build has those of Isotherm to the bare transport, and Isotherm's to it.
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
struct Series {
    /// Sorted round trips \[ns\] of each round.
    rounds: Vec<Vec<u32>>,
    disturbed: usize,
}

/// Measures every path, and the services of other builds beside them.
pub fn measure(effort: Effort, others: &[OtherBuild]) -> Outcome<Value> {
    let (rounds, blocks) = match effort {
        Effort::Smoke => (2, 2),
        Effort::Usual => (20, BLOCKS),
        Effort::Long => (200, BLOCKS),
    };
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));

    let (mut names, mut series) = (Vec::new(), Vec::<Series>::new());
    for round in 0..rounds {
        let mut pairs = Pairs::start(theirs, others)?;
        names = pairs.paths.iter().map(|pair| pair.name.clone()).collect();
        series.resize_with(names.len(), Series::default);
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
    path: Box<dyn Block>,
    partner: Option<Partner>,
    count: usize,
}

/// All paths of a round.
struct Pairs {
    paths: Vec<Pair>,
    // The worlds last: the ends are gone when their memory is removed.
    worlds: Vec<World>,
}

impl Pairs {
    fn start(core: Option<usize>, others: &[OtherBuild]) -> Outcome<Self> {
        let mut pairs = Self { paths: Vec::new(), worlds: Vec::new() };
        let pinned = core.map(|core| core.to_string()).unwrap_or_default();
        pairs.add("floor", COUNT, |world| {
            let lines = world.shared_memory("floor");
            let floor = Floor::create(&lines)?;
            Ok((floor, Some(world.spawn(&["child", &pinned, "floor", &lines.to_string_lossy()])?)))
        })?;
        for name in ["iceoryx2", "iceoryx2_again"] {
            pairs.add(name, COUNT, |world| {
                let (domain, root) = (world.domain().name(), world.domain().root_path());
                let echo = world.spawn(&["child", &pinned, "echo", domain, root, &SHORT.to_string()])?;
                Ok((Bare::connect(world.domain(), SHORT)?, Some(echo)))
            })?;
        }
        let realtime = core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
        let builds = [("isotherm", None)].into_iter();
        for (name, program) in builds.chain(others.iter().map(|build| (build.name.as_str(), Some(&build.program)))) {
            for (name, depth) in
                [(name.to_owned(), format!("depth = {SHORT}\n")), (format!("{name}{DEFAULT_DEPTH}"), String::new())]
            {
                pairs.add(&name, COUNT, |world| {
                    let settings = format!("{depth}[wait]\nstrategy = \"spin\"\n{realtime}");
                    let service = world.serve_by(program.map(PathBuf::as_path), &settings)?;
                    Ok((Isotherm(Acquisition::connect(&IMU.parse()?, &world.options())?), Some(service)))
                })?;
            }
        }
        pairs.add("unix_socket", SLOW_COUNT, |world| {
            let path = world.path("socket");
            let server = world.spawn(&["child", &pinned, "socket", &path.to_string_lossy()])?;
            Ok((Socket::connect(&path)?, Some(server)))
        })?;
        pairs.add("in_process", COUNT, |_| Ok((InProcess::new()?, None)))?;
        Ok(pairs)
    }

    /// Starts a path in a world of its own.
    fn add<P: Path + 'static>(
        &mut self,
        name: &str,
        count: usize,
        start: impl FnOnce(&World) -> Outcome<(P, Option<Partner>)>,
    ) -> Outcome<()> {
        let world = World::new()?;
        let (path, partner) = start(&world)?;
        partner.iter().for_each(Partner::pause);
        self.paths.push(Pair { name: name.to_owned(), path: Box::new(path), partner, count });
        self.worlds.push(world);
        Ok(())
    }
}

impl Pair {
    fn block(&mut self, series: &mut Series) -> Outcome<()> {
        self.path.block(self.partner.as_ref(), self.count, series)
    }
}

/// A block of a path. One call a block goes through a pointer; the round trips in it do not.
trait Block {
    fn block(&mut self, partner: Option<&Partner>, count: usize, series: &mut Series) -> Outcome<()>;
}

impl<P: Path> Block for P {
    fn block(&mut self, partner: Option<&Partner>, count: usize, series: &mut Series) -> Outcome<()> {
        block(self, partner, count, series)
    }
}

/// Times a block of round trips. It counts as disturbed if one of the two was taken off its core meanwhile, or the host
/// gave the machine's time to others.
fn block(path: &mut impl Path, partner: Option<&Partner>, count: usize, series: &mut Series) -> Outcome<()> {
    let sample = sample();
    if let Some(partner) = partner {
        partner.resume();
    }
    for _ in 0..WARM_UP.min(count) {
        path.round_trip(&sample)?;
    }
    let disturbance =
        || preemptions(std::process::id()) + partner.map_or(0, |partner| preemptions(partner.pid())) + stolen();
    let before = disturbance();
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        times.push(timed(path, &sample)?);
    }
    series.disturbed += usize::from(disturbance() != before);
    if let Some(partner) = partner {
        partner.pause();
    }
    if let Some(round) = series.rounds.last_mut() {
        round.append(&mut times);
        round.sort_unstable();
    }
    Ok(())
}

#[inline]
fn timed(path: &mut impl Path, sample: &RawSample) -> Outcome<u32> {
    let sent = Instant::now();
    black_box(path.round_trip(black_box(sample))?);
    Ok(u32::try_from(sent.elapsed().as_nanos()).unwrap_or(u32::MAX))
}

/// What is in every figure of a path: the clock \[ns\].
fn clock_cost() -> f64 {
    const READINGS: u32 = 100_000;
    let started = Instant::now();
    for _ in 0..READINGS {
        black_box(Instant::now());
    }
    let cost: Duration = started.elapsed() / READINGS;
    cost.as_secs_f64() * 1e9
}
