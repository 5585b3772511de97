//! What would be certified as noise and is none: steps, filters, repeated values. None is seen in honest records.

use super::recording::{ALL, rows};
use super::simulated::{Truth, rates};
use isotherm_analysis::NoiseAnalysis;
use isotherm_finding::name;
use isotherm_shared::wire::RawSample;

/// Rows of 0.1 s, of white noise, flicker noise and random walk \[pulse\].
const HONEST: [Truth; 6] = [
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.0, walk: 0.0 },
    Truth { quantisation: 0.0, white: 3.0, flicker: 1.0, walk: 0.06 },
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.3, walk: 0.005 },
    Truth { quantisation: 0.0, white: 2.0, flicker: 2.0, walk: 0.0 },
    Truth { quantisation: 0.0, white: 20.0, flicker: 0.0, walk: 2.0 },
    Truth { quantisation: 0.0, white: 1.0, flicker: 0.0, walk: 3.0 },
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

/// Rows of which each value stands for `times` rows; axis k is new `stagger` k rows later.
fn repeated(rows: &[RawSample], times: usize, stagger: usize, axes: &[usize]) -> Vec<RawSample> {
    let mut all = rows.to_vec();
    for (index, row) in all.iter_mut().enumerate() {
        for axis in axes {
            let from = (index - (index + stagger * axis) % times.min(index + 1)).min(index);
            let taken = if from + times > index { from } else { index };
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
    for weight in [0.7, 0.3, 0.1] {
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

/// A hundred records of each kind; see the figures of the page on noise.
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
