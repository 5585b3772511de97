//! Round trips through every path in turn. Each sample is sent when the one before it has been answered.

use crate::pairs::{DEFAULT_DEPTH, Pair, SHORT, alternate, builds, pinned};
use crate::paths::Path;
use isotherm_benches::{
    BenchProcess, BenchResult, Common, OtherBuild, PathTimes, nanoseconds, preemptions, sample, stolen_ticks,
};
use isotherm_client::RawSample;
use serde_json::{Map, Value, json};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Uncounted round trips at the start of each block, while caches and the child's core warm up.
const WARM_UP: usize = 300;
/// Blocks of each path in a round.
const BLOCKS: usize = 5;

/// Round trips of a block.
const COUNT: usize = 5_000;
/// A path that takes a hundred times longer, and its round trips of a block.
const SLOW: (&str, usize) = ("unix_socket", 300);

/// The ratios that are given for this build, of the first path to the second. `iceoryx2_again` is the same path with
/// another pair of processes: its ratio shows the random differences between pairs.
const RATIOS: [&str; 5] = [
    "isotherm/iceoryx2",
    "isotherm_default_depth/iceoryx2",
    "iceoryx2_again/iceoryx2",
    "isotherm/floor",
    "unix_socket/isotherm",
];

/// All ratios. Every other build is compared with the bare transport, and this build with it, at both queue depths.
fn all_ratios(others: &[OtherBuild]) -> Vec<String> {
    let of_others = others.iter().flat_map(|OtherBuild { name, .. }| {
        let deep = format!("{name}{DEFAULT_DEPTH}");
        [
            format!("{name}/iceoryx2"),
            format!("{deep}/iceoryx2"),
            format!("isotherm/{name}"),
            format!("isotherm{DEFAULT_DEPTH}/{deep}"),
        ]
    });
    RATIOS.map(str::to_owned).into_iter().chain(of_others).collect()
}

/// Measures every path, and the services of other builds for comparison.
pub(crate) fn measure(common: Common, others: &[OtherBuild]) -> BenchResult<Value> {
    let (rounds, blocks) = (common.rounds(2, 14), if common.smoke { 2 } else { BLOCKS });
    let [series] = alternate(
        rounds,
        blocks,
        |pairs| {
            pairs.add_floor()?;
            pairs.add_bare("iceoryx2")?;
            pairs.add_bare("iceoryx2_again")?;
            for (name, program) in builds(others) {
                pairs.add_service(name, program, Some(SHORT), "spin")?;
                pairs.add_service(&format!("{name}{DEFAULT_DEPTH}"), program, None, "spin")?;
            }
            pairs.add_socket()?;
            pairs.add_in_process()
        },
        |Pair { name, path, peer }, _, times| {
            let count = if name == SLOW.0 { SLOW.1 } else { COUNT };
            path.closed(peer.as_ref(), common.block(count), times)
        },
    )?;
    let paths: Map<_, _> = series.paths().map(|(name, times)| (name.clone(), times.figures().into())).collect();
    Ok(json!({
        "paths": paths,
        "ratios": series.ratios(&all_ratios(others)),
        "rounds": rounds,
        "blocks": series.total(|times| times.turns),
        "disturbed_blocks": series.total(|times| times.disturbed),
        "pinned": pinned(),
        "clock_ns": clock_cost(),
    }))
}

/// Times a block of round trips. It counts as disturbed if one of the two processes was preempted meanwhile, or if
/// there was steal time.
pub(crate) fn block(
    path: &mut impl Path,
    peer: Option<&BenchProcess>,
    count: usize,
    times: &mut PathTimes,
) -> BenchResult<()> {
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
    let mut block = Vec::with_capacity(count);
    for _ in 0..count {
        block.push(timed(path, &sample)?);
    }
    times.add(&block, disturbance() != before);
    if let Some(peer) = peer {
        peer.pause();
    }
    Ok(())
}

#[inline]
fn timed(path: &mut impl Path, sample: &RawSample) -> BenchResult<u32> {
    let sent = Instant::now();
    black_box(path.round_trip(black_box(sample))?);
    Ok(nanoseconds(sent.elapsed()))
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
