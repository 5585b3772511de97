//! Simulated recordings of a tumble, and of one that never rests: which static poses are found.
//! They vary rate, noise, counts, rests, moves, tremor, bumps, low-pass filters, lost rows, glitches and fans.

use isotherm_campaign::{StaticPoses, find_static_poses};
use isotherm_shared::wire::RawSample;
use isotherm_simulation::RandomGenerator;
use nalgebra::{Rotation3, Unit, Vector3};
use std::ops::Range;

const RATES: [f64; 7] = [5.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0];

/// A recording, and the rows of its rests.
struct Recording {
    rows: Vec<RawSample>,
    rests: Vec<Range<usize>>,
}

/// What is between a force and its counts.
struct Sensor {
    rate: f64,
    noise: f64,
    /// Size of a count \[g0\].
    count: f64,
    /// Weight of a new value in a first-order low-pass; 1 without one.
    weight: f64,
    lost: f64,
    glitches: f64,
    /// Amplitude \[g0\] and frequency \[Hz\] of a vibration.
    fan: [f64; 2],
    filtered: Vector3<f64>,
    index: u64,
}

impl Sensor {
    fn new(random: &mut RandomGenerator) -> Self {
        let mut log = |low: f64, high: f64| libm::exp(random.between(libm::log(low), libm::log(high)));
        let noise = log(1e-4, 3e-3);
        let count = noise * log(0.01, 4.0);
        let mut some = |part: f64, low: f64, high: f64| {
            let value = random.between(low, high);
            if random.uniform() < part { value } else { 0.0 }
        };
        let fan = some(0.2, 0.5, 3.0) * noise;
        let filter = some(0.5, 0.0, 0.7);
        let (lost, glitches) = (some(0.5, 0.0, 0.05), some(0.3, 0.0, 0.002));
        let rate = RATES[(random.uniform() * RATES.len() as f64) as usize % RATES.len()];
        // No filter is below 2 Hz. A slow recording has no fan: it would be a slow movement there.
        let weight = (1.0 - filter).max(1.0 - libm::exp(-2.0 * core::f64::consts::TAU / rate));
        let fan = [if rate < 50.0 { 0.0 } else { fan }, random.between(5.0, 45.0)];
        Self { rate, noise, count, weight, lost, glitches, fan, filtered: Vector3::zeros(), index: 0 }
    }

    /// Takes a force \[g0\]: a row, unless it is lost.
    fn row(&mut self, random: &mut RandomGenerator, force: &Vector3<f64>, rows: &mut Vec<RawSample>) {
        let interval_ns = (1e9 / self.rate) as u64;
        let phase = core::f64::consts::TAU * self.fan[1] * self.index as f64 / self.rate;
        let vibration = Vector3::new(1.0, 0.6, -0.4) * self.fan[0] * libm::sin(phase);
        let noise = Vector3::from_fn(|_, _| random.normal()) * self.noise / self.weight.sqrt();
        self.filtered += (force + vibration + noise - self.filtered) * self.weight;
        let mut sample = RawSample {
            sequence: self.index,
            timestamp_ns: (self.index + 1) * interval_ns,
            interval_ns,
            ..RawSample::default()
        };
        for axis in 0..3 {
            let glitch = if random.uniform() < self.glitches { 60.0 * self.noise } else { 0.0 };
            let counts = ((self.filtered[axis] + glitch) / self.count).round();
            let triad = &mut sample.accelerometers;
            let channel = if counts >= 0.0 { &mut triad.positive_pulses } else { &mut triad.negative_pulses };
            channel[axis] = counts.abs() as u32;
        }
        self.index += 1;
        if random.uniform() >= self.lost {
            rows.push(sample);
        }
    }
}

fn direction(random: &mut RandomGenerator) -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::from_fn(|_, _| random.normal()))
}

/// An IMU that is put down in 14 attitudes.
fn honest(seed: u64) -> (Sensor, Recording) {
    let mut random = RandomGenerator::new(seed, 31);
    let random = &mut random;
    let mut sensor = Sensor::new(random);
    let mut found = Recording { rows: Vec::new(), rests: Vec::new() };
    let [rest_s, move_s] = [random.between(2.2, 8.0), random.between(0.8, 6.0)];
    let tremor = random.between(5e-3, 40e-3);
    let mut here = direction(random);
    sensor.filtered = *here;
    for _ in 0..14 {
        let first = found.rows.len();
        let rest_s = rest_s * random.between(0.9, 1.3);
        for _ in 0..(rest_s * sensor.rate) as usize {
            sensor.row(random, &here, &mut found.rows);
        }
        found.rests.push(first..found.rows.len());
        let next = direction(random);
        let turn = Rotation3::rotation_between(&here, &next).unwrap_or_else(Rotation3::identity);
        let count = (move_s * random.between(0.7, 1.3) * sensor.rate).max(2.0) as usize;
        let mut shaking = Vector3::zeros();
        for k in 0..count {
            let part = 0.5 - 0.5 * libm::cos(core::f64::consts::PI * (k + 1) as f64 / count as f64);
            shaking = shaking * libm::exp(-6.0 / sensor.rate) + Vector3::from_fn(|_, _| random.normal()) * tremor;
            // It is put down with a bump.
            let bump = if k + 1 == count { random.between(0.05, 0.5) } else { 0.0 };
            let force = turn.powf(part) * *here + shaking + *next * bump;
            sensor.row(random, &force, &mut found.rows);
        }
        here = next;
    }
    (sensor, found)
}

const RESTLESS: [&str; 3] = ["creep", "hand", "slow motion"];

/// An IMU that never rests, for two minutes.
fn restless(kind: &str, seed: u64) -> Vec<RawSample> {
    let mut random = RandomGenerator::new(seed, 32);
    let random = &mut random;
    let mut sensor = Sensor { fan: [0.0, 1.0], lost: 0.0, ..Sensor::new(random) };
    sensor.rate = sensor.rate.max(25.0);
    let (axis, start, mut rows) = (direction(random), direction(random), Vec::new());
    // It turns so fast [rad/s] that gravity along it moves by the noise in a tenth of a second.
    let rate = match kind {
        "creep" => random.between(10e-3, 40e-3).max(3.0 * sensor.noise),
        _ => random.between(80e-3, 200e-3),
    };
    let (mut angle, mut sway) = (0.0, Vector3::zeros());
    for k in 0..(120.0 * sensor.rate) as usize {
        let time_s = k as f64 / sensor.rate;
        let speed = if kind == "slow motion" { 1.0 + 0.5 * libm::sin(0.4 * time_s) } else { 1.0 };
        angle += if kind == "hand" { 0.0 } else { rate * speed / sensor.rate };
        if kind == "hand" {
            let step = (2.0 / sensor.rate).sqrt();
            sway = sway * (1.0 - 1.0 / sensor.rate) + Vector3::from_fn(|_, _| random.normal()) * 15e-3 * step;
        }
        let force = Rotation3::from_axis_angle(&axis, angle) * *start + sway;
        sensor.row(random, &force, &mut rows);
    }
    rows
}

fn overlap(a: &Range<usize>, b: &Range<usize>) -> usize {
    a.end.min(b.end).saturating_sub(a.start.max(b.start))
}

/// Recordings refused, rests missed of all of two seconds or more, static poses found of which over a fifth is a move,
/// of all found.
fn tally(count: u64) -> [usize; 5] {
    let [mut refused, mut missed, mut rests, mut wrong, mut all] = [0; 5];
    for seed in 0..count {
        let (sensor, recording) = honest(seed);
        rests += recording.rests.len();
        let found = match find_static_poses(&recording.rows, None).and_then(StaticPoses::without_turned) {
            Ok(found) => found,
            Err(error) => {
                println!("{seed}: {error}, at {} Hz, low-pass {:.2}", sensor.rate, sensor.weight);
                (refused, missed) = (refused + 1, missed + recording.rests.len());
                continue;
            }
        };
        let found: Vec<_> = found.found.iter().map(|pose| pose.rows.clone()).collect();
        let is_found = |rest: &&Range<usize>| found.iter().any(|rows| 3 * overlap(rows, rest) > rest.len());
        let missing = recording.rests.iter().filter(|rest| !is_found(rest)).count();
        let inside = |rows: &Range<usize>| recording.rests.iter().map(|rest| overlap(rows, rest)).max().unwrap_or(0);
        let false_ones = found.iter().filter(|rows| 5 * inside(rows) < 4 * rows.len()).count();
        if missing + false_ones > 0 {
            println!(
                "{seed}: {missing} missed, {false_ones} false at {} Hz, low-pass {:.2}",
                sensor.rate, sensor.weight
            );
        }
        (missed, wrong, all) = (missed + missing, wrong + false_ones, all + found.len());
    }
    println!("of {count} refused {refused}; missed {missed} of {rests}; false {wrong} of {all}");
    [refused, missed, rests, wrong, all]
}

fn at_rest(kind: &str, count: u64) -> u64 {
    let is_found = |rows: &[RawSample]| find_static_poses(rows, None).and_then(StaticPoses::without_turned).is_ok();
    let found = (0..count).filter(|seed| is_found(&restless(kind, *seed))).count() as u64;
    println!("{kind}: static poses in {found} of {count}");
    found
}

fn check(count: u64) {
    let [refused, missed, rests, wrong, all] = tally(count);
    assert!(refused == 0 && 200 * missed <= rests && 200 * wrong <= all);
    for kind in RESTLESS {
        assert!(at_rest(kind, count / 2) <= (count / 100).max(1), "{kind}");
    }
}

#[test]
fn poses_of_honest_recordings_are_found_and_no_others() {
    check(40);
}

#[test]
#[ignore = "minutes"]
fn poses_of_a_thousand_honest_recordings_are_found_and_no_others() {
    check(1000);
}
