//! What the IMU indicated over one static pose.

use super::temperature::{CleanTemperature, Temperature, noise as temperature_noise, of_row};
use isotherm_campaign::StaticPoses;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;
use std::ops::Range;

/// Part of the rows of one value from which on noise averages no rounding.
const ONE_VALUE: f64 = 0.9;

/// The means over the rows of one static pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Number of the static pose, from 1, over all recordings in their order.
    pub number: usize,
    /// Index of the recording.
    pub recording: usize,
    /// Its session in the recording.
    pub session: u64,
    /// Its rows in the recording.
    pub rows: Range<usize>,
    /// Its start after the start of the recording's first interval \[s\].
    pub start_s: f64,
    /// Sum of the intervals of its rows without glitches \[s\].
    pub seconds: f64,
    /// Rate of the positive and of the negative channel of each accelerometer \[pulse/s\].
    pub rates: [[f64; 2]; AXES],
    /// Mean head temperature of each accelerometer.
    pub head: [f64; AXES],
    /// Mean board temperature of each accelerometer.
    pub board: [f64; AXES],
    /// Lowest and highest head temperature of each accelerometer.
    pub head_range: [[f64; 2]; AXES],
    /// Lowest and highest board temperature of each accelerometer.
    pub board_range: [[f64; 2]; AXES],
    /// Most rows of a sensor's temperature that are glitches.
    pub temperature_glitches: usize,
    /// Medians of head and board temperature of each accelerometer.
    pub temperature_medians: [[f64; AXES]; 2],
    /// Noise of a row of the head temperature, mean over the accelerometers.
    pub temperature_noise: f64,
    /// Largest step of the head temperature.
    pub temperature_step: f64,
    /// Standard error of the net rates from the noise of the rows \[pulse/s\].
    pub noise: [f64; AXES],
    /// Rounding error of the net rates \[pulse/s\]: that of a step of the counts if at least 90 % of the rows have one
    /// value, otherwise 0.
    pub rounding: [f64; AXES],
    /// Net rates over the first and over the second half of the rows \[pulse/s\].
    pub halves: [[f64; AXES]; 2],
    /// Mean net rate of each gyroscope \[pulse/s\]; Earth's rate is in it. `None` where the rows have no gyroscopes.
    pub gyroscopes: Option<[f64; AXES]>,
}

impl Reading {
    /// The means of the rows `range` of a recording without its glitches: its number, the recording's, and where the
    /// static pose begins, `start_s`.
    #[must_use]
    pub fn of(
        [number, recording]: [usize; 2],
        all: &[RawSample],
        range: Range<usize>,
        start_s: f64,
        poses: &StaticPoses,
        steps: &Temperature,
        with_gyroscopes: bool,
    ) -> Self {
        let rows: Vec<RawSample> = poses.rows(all, range.clone()).copied().collect();
        let rows = rows.as_slice();
        let count = rows.len() as f64;
        let seconds = seconds(rows);
        let channel = |rows: &[RawSample], pulses: fn(&RawSample) -> [u32; AXES], axis: usize| {
            rows.iter().map(|row| f64::from(pulses(row)[axis])).sum::<f64>()
        };
        let [plus, minus]: [fn(&RawSample) -> [u32; AXES]; 2] =
            [|row| row.accelerometers.positive_pulses, |row| row.accelerometers.negative_pulses];
        let net = |rows: &[RawSample]| {
            [0, 1, 2].map(|axis| (channel(rows, plus, axis) - channel(rows, minus, axis)) / self::seconds(rows))
        };
        let temperature =
            |sensor: usize, axis: usize| rows.iter().map(|row| of_row(row)[sensor][axis]).collect::<Vec<_>>();
        let cleaned = [0, 1]
            .map(|sensor| [0, 1, 2].map(|axis| CleanTemperature::of(&temperature(sensor, axis), steps[sensor][axis])));
        let [head, board] = &cleaned;
        let gyroscope = |axis: usize| {
            let of = |row: &RawSample| {
                f64::from(row.gyroscopes.positive_pulses[axis]) - f64::from(row.gyroscopes.negative_pulses[axis])
            };
            rows.iter().map(of).sum::<f64>() / seconds
        };
        Self {
            number,
            recording,
            session: rows.first().map_or(0, |row| row.session),
            rows: range,
            start_s,
            seconds,
            rates: [0, 1, 2].map(|axis| [plus, minus].map(|pulses| channel(rows, pulses, axis) / seconds)),
            head: head.each_ref().map(|cleaned| cleaned.mean),
            board: board.each_ref().map(|cleaned| cleaned.mean),
            head_range: head.each_ref().map(|cleaned| cleaned.range),
            board_range: board.each_ref().map(|cleaned| cleaned.range),
            temperature_glitches: cleaned.iter().flatten().map(|cleaned| cleaned.glitches).max().unwrap_or_default(),
            temperature_medians: cleaned.each_ref().map(|sensor| sensor.each_ref().map(|cleaned| cleaned.median)),
            temperature_noise: (0..AXES)
                .map(|axis| temperature_noise(&temperature(0, axis), steps[0][axis]))
                .sum::<f64>()
                / AXES as f64,
            temperature_step: steps[0].iter().copied().fold(0.0, f64::max),
            // The noise of a rate over n rows is that of a row over n^(1/2).
            noise: poses.noise.map(|counts| counts * count.sqrt() / seconds),
            rounding: [0, 1, 2].map(|axis| rounding(rows, axis) * poses.steps[axis] * count / seconds),
            halves: [net(&rows[..rows.len() / 2]), net(&rows[rows.len() / 2..])],
            gyroscopes: with_gyroscopes.then(|| [0, 1, 2].map(gyroscope)),
        }
    }

    /// Mean head temperature of the three accelerometers.
    #[must_use]
    pub fn temperature(&self) -> f64 {
        self.head.iter().sum::<f64>() / AXES as f64
    }

    /// Net rate of an accelerometer \[pulse/s\].
    #[must_use]
    pub fn net(&self, axis: usize) -> f64 {
        self.rates[axis][0] - self.rates[axis][1]
    }
}

/// 1 over sqrt(12) if nearly all rows have one net count: noise far below a step averages no rounding. Otherwise, 0.
fn rounding(rows: &[RawSample], axis: usize) -> f64 {
    let triad = |row: &RawSample| row.accelerometers;
    let net =
        |row: &RawSample| f64::from(triad(row).positive_pulses[axis]) - f64::from(triad(row).negative_pulses[axis]);
    let usual = median(rows.iter().map(net));
    let same = rows.iter().filter(|row| net(row) == usual).count();
    if same as f64 >= ONE_VALUE * rows.len() as f64 { 12.0_f64.sqrt().recip() } else { 0.0 }
}

fn seconds(rows: &[RawSample]) -> f64 {
    rows.iter().map(|row| row.interval_ns as f64).sum::<f64>() * 1e-9
}
