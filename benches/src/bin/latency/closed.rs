//! Round trips, each sent when the last has been answered, through every path in turn.
//!
//! Paths are measured in blocks of some milliseconds, one after the other, in an order that rotates; the children that are not
//! being measured are stopped. Which cache slices the memory of a pair of processes falls into changes its round trip by
//! a tenth, so after some blocks all processes are started anew: that is a round. Ratios are taken within a round.

use crate::Effort;
use crate::floor::Floor;
use crate::paths::{Bare, InProcess, Isotherm, Path, Socket};
use isotherm_benches::statistics::{figures, ratios};
use isotherm_benches::{IMU, Outcome, Partner, World, cores, pin, preemptions, sample, stolen};
use isotherm_client::{Acquisition, RawSample};
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Uncounted round trips at the start of each block, while caches and the child's core wake up.
const WARM_UP: usize = 300;
/// Blocks of each path in a round.
const BLOCKS: usize = 5;
/// Queues of the bare pair, and of the service where it is to be compared with it.
const SHORT: usize = 2;

/// Every path, with the round trips of a block.
const PATHS: [(&str, usize); 7] = [
    ("floor", 5_000),
    ("iceoryx2", 5_000),
    ("iceoryx2_again", 5_000),
    ("isotherm", 5_000),
    ("isotherm_default_depth", 5_000),
    ("unix_socket", 300),
    ("in_process", 5_000),
];

/// The ratios that are given, of the first to the second. The same twice is another pair of processes: what chance does.
const RATIOS: [(&str, &str); 5] = [
    ("isotherm", "iceoryx2"),
    ("isotherm_default_depth", "iceoryx2"),
    ("iceoryx2_again", "iceoryx2"),
    ("isotherm", "floor"),
    ("unix_socket", "isotherm"),
];

/// What has been measured of a path.
#[derive(Default)]
struct Series {
    /// Sorted round trips \[ns\] of each round.
    rounds: Vec<Vec<u32>>,
    disturbed: usize,
}

pub fn measure(effort: Effort) -> Outcome<Value> {
    let (rounds, blocks) = match effort {
        Effort::Smoke => (2, 2),
        Effort::Usual => (20, BLOCKS),
        Effort::Long => (200, BLOCKS),
    };
    let cores = cores();
    let (mine, theirs) = (cores.first().copied(), cores.get(1).copied());
    pin(mine.filter(|_| theirs.is_some()));

    let mut series: [Series; PATHS.len()] = Default::default();
    for round in 0..rounds {
        let mut processes = Processes::start(theirs)?;
        series.iter_mut().for_each(|series| series.rounds.push(Vec::new()));
        for block in 0..blocks {
            for turn in 0..PATHS.len() {
                let path = (round + block + turn) % PATHS.len();
                processes.block(path, &mut series[path])?;
            }
        }
    }
    let of = |name: &str| PATHS.iter().zip(&series).find(|((path, _), _)| *path == name).map(|(_, series)| series);
    let paths: Map<_, _> = PATHS
        .iter()
        .zip(&series)
        .map(|((name, _), series)| ((*name).to_owned(), figures(series.rounds.concat()).into()))
        .collect();
    let ratios: Map<_, _> = RATIOS
        .iter()
        .filter_map(|(upper, lower)| Some((format!("{upper}/{lower}"), ratios(&of(upper)?.rounds, &of(lower)?.rounds))))
        .collect();
    Ok(json!({
        "paths": paths,
        "ratios": ratios,
        "rounds": rounds,
        "blocks": rounds * blocks * PATHS.len(),
        "disturbed_blocks": series.iter().map(|series| series.disturbed).sum::<usize>(),
        "pinned": theirs.is_some(),
        "clock_ns": clock_cost(),
    }))
}

/// All ends of all paths, and the processes behind them, stopped unless they are being measured.
struct Processes {
    floor: (Floor, Partner),
    bare: [(Bare, Partner); 2],
    isotherm: [(Isotherm, Partner); 2],
    socket: (Socket, Partner),
    in_process: InProcess,
    // The worlds last: the ends are gone when their memory is removed.
    _worlds: [World; 5],
}

impl Processes {
    fn start(core: Option<usize>) -> Outcome<Self> {
        let worlds = [World::new()?, World::new()?, World::new()?, World::new()?, World::new()?];
        let [one, other, short, deep, rest] = &worlds;
        let pinned = core.map(|core| core.to_string()).unwrap_or_default();
        let bare = |world: &World| -> Outcome<_> {
            let (name, root) = (world.domain().name(), world.domain().root_path());
            let echo = world.spawn(&["child", &pinned, "echo", name, root, &SHORT.to_string()])?;
            let bare = Bare::connect(world.domain(), SHORT)?;
            echo.pause();
            Ok((bare, echo))
        };
        let isotherm = |world: &World, depth: &str| -> Outcome<_> {
            let core = core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
            let service = world.serve(&format!("{depth}[wait]\nstrategy = \"spin\"\n{core}"))?;
            let acquisition = Acquisition::connect(&IMU.parse()?, &world.options())?;
            service.pause();
            Ok((Isotherm(acquisition), service))
        };
        let bare = [bare(one)?, bare(other)?];
        let isotherm = [isotherm(short, &format!("depth = {SHORT}\n"))?, isotherm(deep, "")?];
        let lines = rest.shared_memory("floor");
        let floor = Floor::create(&lines)?;
        let floor = (floor, rest.spawn(&["child", &pinned, "floor", &lines.to_string_lossy()])?);
        floor.1.pause();
        let path = rest.path("socket");
        let server = rest.spawn(&["child", &pinned, "socket", &path.to_string_lossy()])?;
        let socket = (Socket::connect(&path)?, server);
        socket.1.pause();
        Ok(Self { floor, bare, isotherm, socket, in_process: InProcess::new()?, _worlds: worlds })
    }

    fn block(&mut self, path: usize, series: &mut Series) -> Outcome<()> {
        let (name, count) = PATHS[path];
        match name {
            "floor" => block(&mut self.floor.0, Some(&self.floor.1), count, series),
            "iceoryx2" => block(&mut self.bare[0].0, Some(&self.bare[0].1), count, series),
            "iceoryx2_again" => block(&mut self.bare[1].0, Some(&self.bare[1].1), count, series),
            "isotherm" => block(&mut self.isotherm[0].0, Some(&self.isotherm[0].1), count, series),
            "isotherm_default_depth" => block(&mut self.isotherm[1].0, Some(&self.isotherm[1].1), count, series),
            "unix_socket" => block(&mut self.socket.0, Some(&self.socket.1), count, series),
            _ => block(&mut self.in_process, None, count, series),
        }
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
