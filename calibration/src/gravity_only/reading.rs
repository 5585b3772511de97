//! What the IMU indicated over one standstill.

use isotherm_campaign::Standstills;
use isotherm_shared::wire::{AXES, RawSample};
use std::ops::Range;

/// The means over the rows of one standstill.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Number of the standstill, from 1, over all recordings in their order.
    pub number: usize,
    /// Index of the recording.
    pub recording: usize,
    /// Its rows in the recording.
    pub rows: Range<usize>,
    /// Its start after the start of the recording's first interval \[s\].
    pub start_s: f64,
    /// Sum of the intervals of its rows without glitches \[s\].
    pub seconds: f64,
    /// Rate of the positive and of the negative channel of each accelerometer \[pulse/s\].
    pub rates: [[f64; 2]; AXES],
    /// Mean head telemetry of each accelerometer.
    pub head: [f64; AXES],
    /// Mean board telemetry of each accelerometer.
    pub board: [f64; AXES],
    /// Lowest and highest head telemetry of each accelerometer.
    pub head_range: [[f64; 2]; AXES],
    /// Lowest and highest board telemetry of each accelerometer.
    pub board_range: [[f64; 2]; AXES],
    /// Standard error of the net rates from the noise of the rows \[pulse/s\].
    pub noise: [f64; AXES],
    /// Net rates over the first and over the second half of the rows \[pulse/s\].
    pub halves: [[f64; AXES]; 2],
    /// Mean net rate of each gyroscope \[pulse/s\]; Earth's rate is in it. `None` where the rows have no gyroscopes.
    pub gyroscopes: Option<[f64; AXES]>,
}

impl Reading {
    /// The means of the rows `range` of a recording without its glitches; the standstill begins at `start_s`.
    #[must_use]
    pub fn of(
        number: usize,
        recording: usize,
        all: &[RawSample],
        range: Range<usize>,
        start_s: f64,
        standstills: &Standstills,
        with_gyroscopes: bool,
    ) -> Self {
        let rows: Vec<RawSample> = standstills.rows(all, range.clone()).copied().collect();
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
        let mean = |telemetry: fn(&RawSample) -> [f64; AXES]| {
            [0, 1, 2].map(|axis| rows.iter().map(|row| telemetry(row)[axis]).sum::<f64>() / count)
        };
        let range_of = |telemetry: fn(&RawSample) -> [f64; AXES]| {
            [0, 1, 2].map(|axis| isotherm_campaign::joint_range(rows.iter().map(|row| [telemetry(row)[axis]; 2])))
        };
        let [head, board]: [fn(&RawSample) -> [f64; AXES]; 2] =
            [|row| row.accelerometers.head_temperature, |row| row.accelerometers.board_temperature];
        let gyroscope = |axis: usize| {
            let of = |row: &RawSample| {
                f64::from(row.gyroscopes.positive_pulses[axis]) - f64::from(row.gyroscopes.negative_pulses[axis])
            };
            rows.iter().map(of).sum::<f64>() / seconds
        };
        Self {
            number,
            recording,
            rows: range,
            start_s,
            seconds,
            rates: [0, 1, 2].map(|axis| [plus, minus].map(|pulses| channel(rows, pulses, axis) / seconds)),
            head: mean(head),
            board: mean(board),
            head_range: range_of(head),
            board_range: range_of(board),
            // The noise of a rate over n rows is that of a row over n^(1/2).
            noise: standstills.noise.map(|counts| counts * count.sqrt() / seconds),
            halves: [net(&rows[..rows.len() / 2]), net(&rows[rows.len() / 2..])],
            gyroscopes: with_gyroscopes.then(|| [0, 1, 2].map(gyroscope)),
        }
    }

    /// Net rate of an accelerometer \[pulse/s\].
    #[must_use]
    pub fn net(&self, axis: usize) -> f64 {
        self.rates[axis][0] - self.rates[axis][1]
    }
}

fn seconds(rows: &[RawSample]) -> f64 {
    rows.iter().map(|row| row.interval_ns as f64).sum::<f64>() * 1e-9
}
