//! Rows that are missing: truths lie in their ranges as often as without losses, and N stays what it is.

use super::recording::{ALL, INTERVAL_NS, rows};
use super::simulated::{Truth, rates};
use isotherm_analysis::{COEFFICIENTS, NoiseAnalysis};
use isotherm_shared::wire::RawSample;
use isotherm_simulation::RandomGenerator;

/// Kinds of noise in counts a row: name, truth, and the weight of a new value in a low-pass of the first order.
const KINDS: [(&str, Truth, Option<f64>); 6] = [
    ("white", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.0 }, None),
    ("white, walk", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.3 }, None),
    ("white, flicker", Truth { quantisation: 0.0, white: 20.0, flicker: 4.0, walk: 0.0 }, None),
    ("quantised", Truth { quantisation: 0.0, white: 0.5, flicker: 0.0, walk: 0.0 }, None),
    ("filtered", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.0 }, Some(0.6)),
    ("mixture", Truth { quantisation: 0.0, white: 3.0, flicker: 1.0, walk: 0.06 }, None),
];
/// Losses: name, part of the rows, and most rows of a gap.
const LOSSES: [(&str, f64, u64); 5] = [
    ("none", 0.0, 1),
    ("1 in 300", 1.0 / 300.0, 1),
    ("1 %", 0.01, 1),
    ("1.9 %", 0.019, 1),
    ("1.9 % in bursts", 0.019, 8),
];

/// Counts are what is left of a phase that is read in whole steps.
const QUANTISATION: f64 = 0.288_675;

fn recorded((_, truth, weight): &(&str, Truth, Option<f64>), count: usize, seed: u64) -> Vec<RawSample> {
    let counts = [0, 1, 2].map(|axis| {
        let mut counts = rates(truth, count, 3 * seed + axis);
        let mut last = counts[0];
        for count in &mut counts {
            last += weight.unwrap_or(1.0) * (*count - last);
            *count = last;
        }
        counts
    });
    rows(&counts, 4000.3)
}

/// The rows without this part of them, in gaps of up to `longest` rows.
pub(super) fn with_losses(rows: &[RawSample], part: f64, longest: u64, seed: u64) -> Vec<RawSample> {
    let mut random = RandomGenerator::new(seed, 77);
    let mean = (1 + longest) as f64 / 2.0;
    let (mut left, mut lost) = (Vec::new(), 0);
    for (index, row) in rows.iter().enumerate() {
        let is_inside = index > 0 && index + 1 < rows.len();
        if lost == 0 && is_inside && random.uniform() < part / mean {
            lost = 1 + (random.uniform() * longest as f64) as u64;
        }
        if lost > 0 && is_inside {
            lost -= 1;
        } else {
            left.push(*row);
        }
    }
    left
}

#[derive(Clone, Debug, Default)]
struct Tally {
    /// Sensors for which the model holds.
    ranges: usize,
    /// In how many the range of each coefficient holds the truth.
    held: [usize; 4],
    /// N over that without losses: sum and number.
    ratio: (f64, usize),
}

/// A tally for each of the losses, of so many recordings of a kind.
fn tallies(kind: &(&str, Truth, Option<f64>), count: usize, recordings: u64, seed: u64) -> Vec<Tally> {
    let interval_s = INTERVAL_NS as f64 / 1e9;
    // From an interval of 1 to that of the rows.
    let units = [1.0, interval_s.sqrt().recip(), interval_s.recip(), interval_s.powf(-1.5)];
    let truth = Truth { quantisation: QUANTISATION, ..kind.1 }.coefficients();
    let mut all = vec![Tally::default(); LOSSES.len()];
    for seed in seed * 1000..seed * 1000 + recordings {
        let whole = recorded(kind, count, seed);
        let mut first = [0.0; 3];
        for (tally, (_, part, longest)) in all.iter_mut().zip(LOSSES) {
            let left = with_losses(&whole, part, longest, seed);
            let analysis = NoiseAnalysis::of(&left, None, ALL).unwrap();
            // A few rows at an end, behind a burst, are too few for a window at rest.
            assert!(analysis.used.len() + 40 > left.len(), "{:?} of {}", analysis.used, left.len());
            assert_eq!(analysis.bridged.of - analysis.bridged.rows, analysis.used.len());
            for (axis, sensor) in analysis.sensors.iter().enumerate() {
                let allan = sensor.allan.as_ref().unwrap();
                let Some(model) = allan.model.as_ref() else { continue };
                let white = model.coefficients[1].value;
                if part == 0.0 {
                    first[axis] = white;
                } else if first[axis] > 0.0 && white > 0.0 {
                    tally.ratio = (tally.ratio.0 + white / first[axis], tally.ratio.1 + 1);
                }
                tally.ranges += usize::from(model.holds());
                for k in 0..4 {
                    let [low, high] = model.coefficients[k].range.unwrap_or([f64::INFINITY; 2]);
                    let holds = (low..=high).contains(&(truth[k] * units[k]));
                    tally.held[k] += usize::from(holds && allan.gives(k));
                }
            }
        }
    }
    for (tally, (loss, ..)) in all.iter().zip(LOSSES) {
        let mean = 100.0 * (tally.ratio.0 / tally.ratio.1.max(1) as f64 - 1.0);
        let Tally { ranges, held, .. } = tally;
        println!("{:15} {loss:16} model holds {ranges:3}, {COEFFICIENTS:?} {held:3?}, N {mean:+.3} %", kind.0);
    }
    all
}

/// Whether each loss leaves as many ranges that hold the truth as there are without it, less `fewer`, and N within
/// `most`.
fn assert_alike(kind: &str, tallies: &[Tally], fewer: usize, most: f64) {
    let without = &tallies[0];
    for tally in &tallies[1..] {
        assert!(tally.ranges + fewer >= without.ranges, "{kind}: {tally:?} {without:?}");
        assert!((0..4).all(|k| tally.held[k] + fewer >= without.held[k]), "{kind}: {tally:?} {without:?}");
        let ratio = tally.ratio.0 / tally.ratio.1 as f64;
        assert!((ratio - 1.0).abs() < most, "{kind}: {ratio}");
    }
}

/// A straight line between the neighbours would make N 1 to 1.5 % smaller or larger at 2 % lost.
#[test]
fn truths_are_in_their_ranges_as_without_losses() {
    for kind in &KINDS {
        assert_alike(kind.0, &tallies(kind, 4000, 6, 3), 3, 0.006);
    }
}

/// `cargo test --release -p isotherm-analysis --test all -- --ignored --nocapture lost`
#[test]
#[ignore = "102 sensors of each of 6 kinds and 5 losses: minutes"]
fn truths_are_in_their_ranges_as_without_losses_in_102_of_each() {
    let seed = std::env::var("ISOTHERM_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    println!("ISOTHERM_SEED={seed}");
    std::thread::scope(|scope| {
        let study = |kind: &'static (&str, Truth, Option<f64>)| (kind.0, tallies(kind, 20_000, 34, seed));
        let running: Vec<_> = KINDS.iter().map(|kind| scope.spawn(move || study(kind))).collect();
        for thread in running {
            let (kind, tallies) = thread.join().unwrap();
            assert_alike(kind, &tallies, 5, 0.0015);
        }
    });
}

#[test]
#[ignore]
fn debug_split() {
    for kind in &KINDS {
        for seed in 1000..1034 {
            let whole = recorded(kind, 20_000, seed);
            let left = with_losses(&whole, 0.019, 8, seed);
            let Ok(found) = isotherm_campaign::find_standstills(&left, Some(1.0)) else { println!("{} {seed}: none", kind.0); continue };
            if found.found.len() > 1 {
                for pair in found.found.windows(2) {
                    let (a, b) = (pair[0].rows.end, pair[1].rows.start);
                    println!("{} {seed}: {:?} {:?} {:?}", kind.0, pair[0].rows, pair[1].rows,
                        left[a.saturating_sub(14)..b + 14].iter().map(|r| r.sequence).collect::<Vec<_>>());
                }
            }
        }
    }
}
