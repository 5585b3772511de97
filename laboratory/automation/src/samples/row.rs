//! The sum of the samples of a row.

use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, Triad};

/// The sum of the samples of a row: pulses and intervals are added, temperature is averaged over time.
pub(super) struct RowSum {
    pub(super) sum: RawSample,
    pub(super) count: u32,
    first: RawSample,
    pub(super) seconds: f64,
    accelerometers: TemperatureSum,
    gyroscopes: TemperatureSum,
    /// Sum of each sample's temperature time times its interval \[ns2\]; 0 if a sample has no temperature time.
    read_ns2: u128,
}

/// Sums of a triad's temperature times the interval, by sensor.
#[derive(Clone, Copy, Default)]
struct TemperatureSum {
    head: [f64; AXES],
    board: [f64; AXES],
}

impl TemperatureSum {
    /// Adds `triad`'s temperature over `seconds`, and its pulses to `sum`.
    fn add(&mut self, sum: &mut Triad, triad: &Triad, seconds: f64) {
        for axis in 0..AXES {
            sum.positive_pulses[axis] = sum.positive_pulses[axis].saturating_add(triad.positive_pulses[axis]);
            sum.negative_pulses[axis] = sum.negative_pulses[axis].saturating_add(triad.negative_pulses[axis]);
            self.head[axis] += triad.head_temperature[axis] * seconds;
            self.board[axis] += triad.board_temperature[axis] * seconds;
        }
    }

    /// `sum` with the mean temperature of `seconds`.
    fn mean(&self, sum: Triad, seconds: f64) -> Triad {
        let mean = |sums: [f64; AXES]| sums.map(|sum| sum / seconds);
        Triad { head_temperature: mean(self.head), board_temperature: mean(self.board), ..sum }
    }
}

impl RowSum {
    pub(super) fn new(first: &RawSample) -> Self {
        let empty = |triad: Triad| Triad { positive_pulses: [0; AXES], negative_pulses: [0; AXES], ..triad };
        let (accelerometers, gyroscopes) = (empty(first.accelerometers), empty(first.gyroscopes));
        // A mean of lagged temperature is of no use: readers compute it from the rows.
        let sum = RawSample { interval_ns: 0, lag_ns: 0, accelerometers, gyroscopes, ..*first };
        let (accelerometers, gyroscopes) = (TemperatureSum::default(), TemperatureSum::default());
        Self { sum, count: 0, first: *first, seconds: 0.0, accelerometers, gyroscopes, read_ns2: 0 }.with(first)
    }

    pub(super) fn with(mut self, sample: &RawSample) -> Self {
        let seconds = sample.interval_ns as f64 / 1e9;
        self.count += 1;
        self.seconds += seconds;
        self.sum.timestamp_ns = sample.timestamp_ns;
        let known = sample.temperature_time_ns() > 0 && (self.count == 1 || self.read_ns2 > 0);
        self.read_ns2 += u128::from(sample.temperature_time_ns()) * u128::from(sample.interval_ns);
        self.read_ns2 *= u128::from(known);
        self.sum.interval_ns += sample.interval_ns;
        self.accelerometers.add(&mut self.sum.accelerometers, &sample.accelerometers, seconds);
        self.gyroscopes.add(&mut self.sum.gyroscopes, &sample.gyroscopes, seconds);
        self
    }

    /// Whether the counters have room for as much again.
    pub(super) fn has_room(&self) -> bool {
        let triads = [&self.sum.accelerometers, &self.sum.gyroscopes];
        let largest = triads.iter().flat_map(|triad| triad.positive_pulses.iter().chain(&triad.negative_pulses)).max();
        largest.is_none_or(|largest| *largest < u32::MAX / 2) && self.sum.interval_ns < MAX_INTERVAL_NS / 2
    }

    /// The row. A row of one sample is that sample.
    pub(super) fn mean(&self) -> RawSample {
        if self.count == 1 {
            return RawSample { lag_ns: 0, ..self.first };
        }
        // The mean fits into u64: it is at most the largest temperature time.
        let telemetry_ns = (self.read_ns2 / u128::from(self.sum.interval_ns)) as u64;
        let accelerometers = self.accelerometers.mean(self.sum.accelerometers, self.seconds);
        let gyroscopes = self.gyroscopes.mean(self.sum.gyroscopes, self.seconds);
        RawSample { telemetry_ns, accelerometers, gyroscopes, ..self.sum }
    }
}
