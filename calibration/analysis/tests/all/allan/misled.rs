//! What would be certified as noise and is none: steps, filters, repeated values. None is seen in honest records.

use super::recording::{ALL, rows};
use super::simulated::{Truth, rates};
use isotherm_analysis::NoiseAnalysis;
use isotherm_shared::wire::RawSample;
use isotherm_support::finding::name;

/// Rows of 0.1 s, of white noise, flicker noise and random walk \[pulse\].
const HONEST: [Truth; 6] = [
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.0, walk: 0.0 },
    Truth { quantisation: 0.0, white: 3.0, flicker: 1.0, walk: 0.06 },
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.1, walk: 0.005 },
    Truth { quantisation: 0.0, white: 2.0, flicker: 2.0, walk: 0.0 },
    Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 2.0 },
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.0, walk: 0.3 },
];
const ROWS: usize = 4096;
/// Names of what is looked for.
const MISLED: [&str; 3] = [name::NOISE_STEP, name::NOISE_FILTERED, name::REPEATED];

fn counts(truth: &Truth, seed: u64) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|axis| rates(truth, ROWS, 3 * seed + axis))
}

/// Which of the three are found, and how many sensors have a limit cycle.
fn found(rows: &[RawSample]) -> ([usize; 3], usize) {
    let analysis = NoiseAnalysis::of(rows, None, ALL).unwrap();
    let findings = analysis.findings();
    let cycles = findings.iter().filter(|it| it.name == name::LIMIT_CYCLE).count();
    (MISLED.map(|name| findings.iter().filter(|it| it.name == name).count()), cycles)
}

/// A knock of 220 ug0 at a scale factor of 60 000 pulse/(s g0): 1.32 pulses a row of 0.1 s.
fn knocked(counts: &mut [Vec<f64>; 3], row: usize) {
    counts[1][row..].iter_mut().for_each(|count| *count += 1.32);
}

/// A low-pass of the first order, with this weight of the new value.
fn low_pass(counts: &mut [f64], weight: f64) {
    let mut last = counts[0];
    for count in counts {
        last += weight * (*count - last);
        *count = last;
    }
}

/// Rows of 10 ms of which each value stands for `times` rows; axis k is new `stagger` k rows later.
fn repeated(rows: &[RawSample], times: usize, stagger: usize, axes: &[usize]) -> Vec<RawSample> {
    let mut all = rows.to_vec();
    for (index, row) in all.iter_mut().enumerate() {
        (row.timestamp_ns, row.interval_ns) = (row.timestamp_ns / 10, row.interval_ns / 10);
        for axis in axes {
            let taken = index.saturating_sub((index + stagger * axis) % times);
            row.accelerometers.positive_pulses[*axis] = rows[taken].accelerometers.positive_pulses[*axis];
        }
    }
    all
}

/// Counts of rows that are read anew in each, as of a digital sensor: nothing is carried into the next row.
fn coarse(truth: &Truth, seed: u64, offset: f64) -> Vec<RawSample> {
    let mut all = rows(&[vec![0.0; ROWS], vec![0.0; ROWS], vec![0.0; ROWS]], 4000.0);
    let counts = counts(truth, seed);
    for (index, row) in all.iter_mut().enumerate() {
        row.accelerometers.positive_pulses =
            [0, 1, 2].map(|axis| (4000.0 + offset + counts[axis][index]).round() as u32);
    }
    all
}

/// How many of `number` records of each kind show each of the three, and their names.
fn tally(number: u64) -> Vec<(String, [usize; 3], usize)> {
    let mut tallies = Vec::new();
    let mut add = |what: &str, record: &dyn Fn(u64) -> Vec<RawSample>| {
        let mut sums = ([0; 3], 0);
        for seed in 0..number {
            let (found, cycles) = found(&record(seed));
            (0..3).for_each(|k| sums.0[k] += usize::from(found[k] > 0));
            sums.1 += usize::from(cycles > 0);
        }
        tallies.push((what.to_owned(), sums.0, sums.1));
    };
    for (index, truth) in HONEST.iter().enumerate() {
        add(&format!("honest {index}"), &|seed| rows(&counts(truth, seed), 4000.3));
    }
    for white in [0.05, 0.15, 0.25, 0.3, 0.5] {
        let truth = Truth { white, ..HONEST[0] };
        let offset = |seed: u64| 4000.0 + (0.137 * seed as f64).fract();
        add(&format!("limit cycle {white}"), &|seed| rows(&counts(&truth, seed), offset(seed)));
        add(&format!("coarse {white}"), &|seed| coarse(&truth, seed, offset(seed).fract()));
    }
    for truth in [0, 2] {
        add(&format!("knock of {truth}"), &|seed| {
            let mut counts = counts(&HONEST[truth], seed);
            knocked(&mut counts, 600 + 29 * seed as usize);
            rows(&counts, 4000.3)
        });
    }
    for weight in [0.8, 0.7] {
        add(&format!("low-pass {weight}"), &|seed| {
            let mut counts = counts(&HONEST[1], seed);
            counts.iter_mut().for_each(|counts| {
                counts.iter_mut().for_each(|count| *count *= 4.0);
                low_pass(counts, weight);
            });
            rows(&counts, 4000.3)
        });
    }
    for (times, stagger, axes) in
        [(2, 0, &[0, 1, 2][..]), (4, 0, &[0, 1, 2]), (3, 1, &[0, 1, 2]), (2, 0, &[1]), (4, 0, &[2])]
    {
        add(&format!("repeated {times} {stagger} {axes:?}"), &|seed| {
            repeated(&rows(&counts(&HONEST[seed as usize % 3], seed), 4000.3), times, stagger, axes)
        });
    }
    tallies
}

/// In all records of each fault but one at most, and in none of the others.
#[test]
fn steps_filters_and_repeated_values_are_found_where_they_are() {
    const NUMBER: u64 = 4;
    for (what, found, cycles) in tally(NUMBER) {
        let first = what.split(' ').next().unwrap();
        let right = ["knock", "low-pass", "repeated"].iter().position(|fault| *fault == first);
        for (index, count) in found.into_iter().enumerate() {
            let is_right = if right == Some(index) { count + 1 >= NUMBER as usize } else { count == 0 };
            assert!(is_right, "{what}: {} in {count} of {NUMBER}", MISLED[index]);
        }
        assert!(first == "limit" || first == "coarse" || cycles == 0, "{what}: {cycles} limit cycles");
    }
}

/// A knock is named with its time and size; K is not given, in no form.
#[test]
fn a_knock_is_named_and_taken_out() {
    let mut counts = counts(&HONEST[0], 1);
    knocked(&mut counts, 2000);
    let analysis = NoiseAnalysis::of(&rows(&counts, 4000.3), None, ALL).unwrap();
    let allan = analysis.sensors[1].allan.as_ref().unwrap();
    let [step] = allan.steps[..] else { panic!("{:?}", allan.steps) };
    assert!((step.at_s - 200.0).abs() < 5.0 && (step.size / 13.2 - 1.0).abs() < 0.1, "{step:?}");
    assert!(!allan.gives(3) && allan.gives(1) && analysis.sensors[0].allan.as_ref().unwrap().gives(3));
    let text = isotherm_report::noise::text::text(&analysis);
    assert_eq!(text.matches("not given").count(), 1, "{text}");
    let json = isotherm_report::noise::json::document(&analysis);
    assert!(json["sensors"][1]["model"]["coefficients"][3]["value_in_unit"].is_null(), "{json}");
    assert!(json["sensors"][0]["model"]["coefficients"][3]["unit"].is_string(), "{json}");
}

/// A hundred records of each kind.
#[test]
#[ignore = "takes minutes"]
fn rates_of_hundred_records() {
    for (what, found, cycles) in tally(100) {
        println!(
            "{what:24} step {:3} filtered {:3} repeated {:3} limit cycle {cycles:3} of 100",
            found[0], found[1], found[2]
        );
    }
}
