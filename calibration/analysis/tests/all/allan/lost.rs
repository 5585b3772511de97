//! Rows that are missing: truths lie in their ranges as often as without losses, and N stays what it is.

use super::recording::{ALL, INTERVAL_NS, rows};
use super::simulated::{Truth, rates};
use isotherm_analysis::{BridgedRows, COEFFICIENTS, NoiseAnalysis};
use isotherm_report::noise;
use isotherm_report::noise::NoiseSource;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::RandomGenerator;
use isotherm_statistics::median;
use isotherm_support::finding::name;

/// Kinds of noise in counts a row: name, truth, and the weight of a new value in a low-pass of the first order.
const KINDS: [(&str, Truth, Option<f64>); 6] = [
    ("white", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.0 }, None),
    ("white, walk", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.3 }, None),
    ("white, flicker", Truth { quantisation: 0.0, white: 20.0, flicker: 4.0, walk: 0.0 }, None),
    ("quantised", Truth { quantisation: 0.0, white: 0.7, flicker: 0.0, walk: 0.0 }, None),
    ("filtered", Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 0.0 }, Some(0.6)),
    ("mixture", Truth { quantisation: 0.0, white: 3.0, flicker: 1.0, walk: 0.06 }, None),
];
/// Losses: name, part of the rows, and most rows of a gap.
const LOSSES: [(&str, f64, u64); 5] = [
    ("none", 0.0, 1),
    ("1 in 300", 1.0 / 300.0, 1),
    ("1 %", 0.01, 1),
    ("1.9 %", 0.019, 1),
    ("1.9 % in bursts", 0.019, 16),
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
    /// N over that without losses.
    ratios: Vec<f64>,
}

impl Tally {
    /// The median: of filtered rows the tau from which a model holds differs, and N with it.
    fn ratio(&self) -> f64 {
        median(self.ratios.iter().copied())
    }
}

/// A tally for each of the losses, of so many recordings of a kind.
fn tallies(kind: &(&str, Truth, Option<f64>), count: usize, recordings: u64, seed: u64) -> Vec<Tally> {
    let interval_s = INTERVAL_NS as f64 / 1e9;
    // From an interval of 1 to that of the rows.
    let units = [1.0, interval_s.sqrt().recip(), interval_s.recip(), libm::pow(interval_s, -1.5)];
    let truth = Truth { quantisation: QUANTISATION, ..kind.1 }.coefficients();
    let mut all = vec![Tally::default(); LOSSES.len()];
    for seed in seed * 1000..seed * 1000 + recordings {
        let whole = recorded(kind, count, seed);
        let mut first = [0.0; 3];
        for (tally, (_, part, longest)) in all.iter_mut().zip(LOSSES) {
            let left = with_losses(&whole, part, longest, seed);
            let analysis = NoiseAnalysis::of(&left, None, ALL).unwrap();
            // Chance ends a static pose now and then, also without losses.
            assert!(analysis.used.len() > left.len() / 4, "{:?} of {}", analysis.used, left.len());
            assert_eq!(analysis.bridged.of - analysis.bridged.rows, analysis.used.len());
            for (axis, sensor) in analysis.sensors.iter().enumerate() {
                let allan = sensor.allan.as_ref().unwrap();
                let Some(model) = allan.model.as_ref() else { continue };
                let white = model.coefficients[1].value;
                if part == 0.0 {
                    first[axis] = white;
                }
                if first[axis] > 0.0 && white > 0.0 {
                    tally.ratios.push(white / first[axis]);
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
        let Tally { ranges, held, .. } = tally;
        let more = 100.0 * (tally.ratio() - 1.0);
        println!("{:15} {loss:16} model holds {ranges:3}, {COEFFICIENTS:?} {held:3?}, N {more:+.3} %", kind.0);
    }
    all
}

/// Whether each loss leaves as many ranges that hold the truth as there are without it, less `fewer`, and N within
/// `most`, of filtered rows within ten times as much.
fn assert_alike(kind: &str, tallies: &[Tally], fewer: usize, most: f64) {
    let without = &tallies[0];
    let most = if kind == "filtered" { 10.0 * most } else { most };
    for tally in &tallies[1..] {
        assert!(tally.ranges + fewer >= without.ranges, "{kind}: {tally:?} {without:?}");
        assert!((0..4).all(|k| tally.held[k] + fewer >= without.held[k]), "{kind}: {tally:?} {without:?}");
        assert!((tally.ratio() - 1.0).abs() < most, "{kind}: {tally:?}");
    }
}

fn white(count: usize) -> Vec<RawSample> {
    recorded(&KINDS[0], count, 9)
}

fn of(rows: &[RawSample]) -> NoiseAnalysis {
    NoiseAnalysis::of(rows, None, ALL).unwrap()
}

#[test]
fn bridged_rows_are_told_and_the_same_each_time() {
    let mut rows = white(5000);
    rows.drain(4000..4016);
    rows.remove(2500);
    rows.drain(1200..1203);
    let found = of(&rows);
    let bridged = BridgedRows { rows: 20, gaps: 3, not_a_number: 0, of: 5000 };
    assert_eq!((found.bridged, found.used.clone(), found.used_s), (bridged, 0..4980, [0.0, 500.0]));
    assert!((found.interval_s - 0.1).abs() < 1e-12);
    assert_eq!(found, of(&rows));
    let message = "20 rows are missing in 3 gaps, 0.40 % of the 5000 that are analysed; they are bridged, ";
    let told: Vec<_> = found.findings().into_iter().filter(|it| it.name == name::MISSING_ROWS).collect();
    assert!(told.len() == 1 && told[0].message.starts_with(message), "{told:?}");
    assert!(noise::text::text(&found).contains("the longest stretch at rest without a long gap\n"));
    let document = &noise::json::document(&found)["bridged"];
    assert_eq!((&document["rows"], &document["gaps"], &document["too_many"]), (&20.into(), &3.into(), &false.into()));
    assert_eq!(document["part"], 0.004);
    let source = NoiseSource {
        tool: "t".to_owned(),
        time: "now".to_owned(),
        recording: "night".to_owned(),
        table: None,
        imu: "imu-n".to_owned(),
    };
    assert!(noise::html(&found, &source).contains(message));
    // A whole recording says nothing of them.
    let whole = of(&white(5000));
    assert_eq!(whole.bridged, BridgedRows { of: 5000, ..BridgedRows::default() });
    assert!(whole.findings().is_empty() && whole.lost().is_none());
}

/// Rows that come late are no gap: neither with sequences of the IMU, nor with those that are made from the times, by
/// which the row is behind a gap.
#[test]
fn late_rows_are_no_gap() {
    for made_from_times in [false, true] {
        let mut rows = white(5000);
        for index in (100..4900).step_by(97) {
            rows[index].timestamp_ns += INTERVAL_NS * 7 / 10;
            if index % 2 == 0 {
                rows[index + 1].timestamp_ns += INTERVAL_NS * 6 / 10;
            }
        }
        if made_from_times {
            for index in 1..rows.len() {
                let step_ns = rows[index].timestamp_ns - rows[index - 1].timestamp_ns;
                let steps = if 2 * step_ns > 3 * INTERVAL_NS { (step_ns + INTERVAL_NS / 2) / INTERVAL_NS } else { 1 };
                rows[index].sequence = rows[index - 1].sequence + steps;
            }
        }
        // One that is missing between them all the same.
        rows.remove(2030);
        let found = of(&rows);
        assert_eq!((found.used, found.bridged.rows, found.bridged.of), (0..4999, 1, 5000), "{made_from_times}");
    }
}

/// Time that is lost without a hole in the sequences, and holes without lost time, are not bridged.
#[test]
fn holes_that_sequences_and_times_do_not_agree_on_end_the_stretch() {
    let all = white(5000);
    let mut time = all.clone();
    time[2000..].iter_mut().for_each(|row| row.timestamp_ns += 3 * INTERVAL_NS);
    let mut sequence = all.clone();
    sequence[2000..].iter_mut().for_each(|row| row.sequence += 3);
    let mut more = all.clone();
    more.drain(2000..2002);
    more[2000..].iter_mut().for_each(|row| row.timestamp_ns += INTERVAL_NS);
    for (what, rows) in [("time", time), ("sequence", sequence), ("more time", more)] {
        let found = of(&rows);
        assert_eq!((found.used.start, found.used.end, found.bridged.rows), (2000, rows.len(), 0), "{what}");
    }
}

/// Over 2 %, and where long gaps leave little, the analysis says that nothing is certified.
#[test]
fn too_many_lost_rows_are_said() {
    let all = white(20_000);
    let many = of(&with_losses(&all, 0.04, 1, 5));
    assert!(many.bridged.is_too_much());
    let lost = many.lost().unwrap();
    assert!(lost.contains(" % of the 20000 that are analysed, over 2 %: look for what loses them, "), "{lost}");
    let message = many.findings()[0].message.clone();
    assert!(message.starts_with(&lost) && message.ends_with("no file for Kalibr is written"), "{message}");
    // A gap of 30 rows in each 3000.
    let mut rows = all;
    rows.retain(|row| row.sequence % 3000 >= 30 || row.sequence < 30);
    let split = of(&rows);
    let lost = split.lost().unwrap();
    let [from_s, to_s] = split.used_s;
    let remedy = format!("take only this stretch, with --from {from_s:.3} --to {to_s:.3}");
    assert!(lost.starts_with("gaps of over 16 rows leave a stretch of ") && lost.ends_with(&remedy), "{lost}");
    let alone = NoiseAnalysis::of(&rows, None, [from_s, to_s]).unwrap();
    assert_eq!((alone.lost(), alone.used), (None, split.used));
}

/// White noise does not grow over times that are longer than the rows around a gap, as it would if its level were that
/// of few rows: its variance by twice the part that is missing.
#[test]
fn white_noise_is_white_over_all_times() {
    let whole = white(100_000);
    let left = of(&with_losses(&whole, 0.05, 1, 8));
    assert!(left.bridged.share() > 0.04 && left.bridged.of == 100_000, "{:?}", left.bridged);
    let points = |analysis: &NoiseAnalysis| -> Vec<f64> {
        let all = analysis.sensors.iter().flat_map(|sensor| &sensor.allan.as_ref().unwrap().points);
        all.filter(|point| (200..1100).contains(&point.factor)).map(|point| point.adev).collect()
    };
    let (of_left, of_whole) = (points(&left), points(&of(&whole)));
    let ratios = of_left.iter().zip(&of_whole).map(|(a, b)| a / b);
    let mean = ratios.sum::<f64>() / of_left.len() as f64;
    assert!(of_left.len() > 15 && (mean - 1.0).abs() < 0.02, "{mean}");
}

/// A knock, temperature and repeated values are seen next to gaps.
#[test]
fn what_is_looked_for_is_found_beside_gaps() {
    let mut rows = white(5000);
    rows[3000..].iter_mut().for_each(|row| row.accelerometers.positive_pulses[1] += 30);
    for (index, row) in rows.iter_mut().enumerate() {
        row.accelerometers.head_temperature = [20.0 + 1e-3 * index as f64; 3];
    }
    for index in 0..rows.len() {
        rows[index].accelerometers.positive_pulses[2] = rows[index - index % 4].accelerometers.positive_pulses[2];
    }
    let whole = of(&rows);
    let left = of(&with_losses(&rows, 0.019, 3, 6));
    for (a, b) in whole.sensors.iter().zip(&left.sensors) {
        let [a, b] = [a, b].map(|sensor| (sensor, sensor.allan.as_ref().unwrap()));
        assert_eq!(a.1.steps.len(), b.1.steps.len(), "{}", a.0.name);
        let pairs = a.1.steps.iter().zip(&b.1.steps);
        assert!(pairs.into_iter().all(|(a, b)| (a.at_s - b.at_s).abs() < 3.0 && (a.size / b.size - 1.0).abs() < 0.02));
        let new = a.0.new_every_s.zip(b.0.new_every_s).map(|(a, b)| a / b);
        assert!(new.is_none_or(|ratio| (ratio - 1.0).abs() < 0.01), "{new:?}");
        assert_eq!(a.0.new_every_s.is_some(), b.0.new_every_s.is_some());
        let [a, b] = [a, b].map(|(sensor, _)| sensor.line.as_ref().unwrap());
        assert!((a.slope - b.slope).abs() < 0.3 * a.slope_error.unwrap_or(1.0).max(1.0), "{} {}", a.slope, b.slope);
    }
    assert_eq!(whole.sensors[1].allan.as_ref().unwrap().steps.len(), 1);
    assert!(whole.sensors[2].new_every_s.is_some());
}

/// A straight line between the neighbours would make N 1 to 1.5 % smaller or larger at 2 % lost.
#[test]
fn truths_are_in_their_ranges_as_without_losses() {
    for kind in &KINDS {
        assert_alike(kind.0, &tallies(kind, 4000, 6, 3), 3, 0.005);
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
