//! The readings of one temperature, reduced while they are read.

use core::ops::Range;
use isotherm_shared::lag::LaggedReading;
use isotherm_shared::wire::RawSample;

/// Rows and readings are added up over at least this time, so that memory does not grow with the sampling rate \[ns\].
pub(super) const BIN_NS: u64 = 1_000_000_000;
/// Changes from row to row that are kept of a sensor.
const MOST_CHANGES: usize = 1024;
/// The step is the least change but for this part of them.
const LEAST_PART: f64 = 0.02;

/// Some of the changes from row to row, or from reading to reading, evenly chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Changes {
    some: Vec<f32>,
    stride: u32,
    skipped: u32,
}

/// The readings of one temperature.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Readings {
    /// Least and largest reading.
    pub extremes: Option<[f64; 2]>,
    means: Vec<Reading>,
    /// The last value, which is no new reading if it comes again.
    latest: Option<Reading>,
    sum: ReadingSum,
    pub steps: Changes,
}

/// A measured value, or the mean of some.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    pub time_ns: u64,
    pub temperature: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ReadingSum {
    first_ns: u64,
    /// Sum of the times after the first.
    time_ns: u64,
    temperature: f64,
    count: u32,
}

impl Changes {
    pub(super) fn add(&mut self, change: f64) {
        self.skipped += 1;
        if self.skipped < self.stride {
            return;
        }
        self.skipped = 0;
        if self.some.len() == MOST_CHANGES {
            let mut number = 0;
            self.some.retain(|_| {
                number += 1;
                number % 2 == 0
            });
            self.stride = 2 * self.stride.max(1);
        }
        self.some.push(change.abs() as f32);
    }

    pub(super) fn least(&self) -> f64 {
        let mut all = self.some.clone();
        all.sort_by(f32::total_cmp);
        all.get((all.len() as f64 * LEAST_PART) as usize).map_or(0.0, |least| f64::from(*least))
    }
}

impl Readings {
    /// The readings within these times, which are in order.
    pub(super) fn within(&self, times: &[Range<u64>]) -> Self {
        let is_within = |reading: &Reading| {
            let after = times.partition_point(|time| time.end < reading.time_ns);
            times.get(after).is_some_and(|time| time.start <= reading.time_ns)
        };
        let means: Vec<Reading> = self.readings().into_iter().filter(is_within).collect();
        let widen = |extremes: Option<[f64; 2]>, reading: &Reading| {
            let [low, high] = extremes.unwrap_or([reading.temperature; 2]);
            Some([low.min(reading.temperature), high.max(reading.temperature)])
        };
        Self { extremes: means.iter().fold(None, widen), means, steps: self.steps.clone(), ..Self::default() }
    }

    /// `unknown_ns` is the time of temperature whose time is not known.
    pub(super) fn add(&mut self, raw: &RawSample, temperature: f64, unknown_ns: u64) {
        let (time_ns, is_new) = match raw.temperature_time_ns() {
            // Without the time of the temperature only a change shows that it was read.
            0 => (unknown_ns, self.latest.is_none_or(|latest| latest.temperature != temperature)),
            time_ns => (time_ns, true),
        };
        if !is_new || self.latest.is_some_and(|latest| latest.time_ns >= time_ns) {
            return;
        }
        let change = self.latest.map(|latest| temperature - latest.temperature);
        change.filter(|change| *change != 0.0).into_iter().for_each(|change| self.steps.add(change));
        self.latest = Some(Reading { time_ns, temperature });
        let [low, high] = self.extremes.unwrap_or([temperature; 2]);
        self.extremes = Some([low.min(temperature), high.max(temperature)]);
        if time_ns - self.sum.first_ns >= BIN_NS {
            self.means.extend(self.sum.mean());
            self.sum = ReadingSum { first_ns: time_ns, ..ReadingSum::default() };
        }
        self.sum.time_ns += time_ns - self.sum.first_ns;
        self.sum.temperature += temperature;
        self.sum.count += 1;
    }

    pub(super) fn readings(&self) -> Vec<Reading> {
        self.means.iter().copied().chain(self.sum.mean()).collect()
    }
}

impl ReadingSum {
    fn mean(&self) -> Option<Reading> {
        (self.count > 0).then(|| Reading {
            time_ns: self.first_ns + self.time_ns / u64::from(self.count),
            temperature: self.temperature / f64::from(self.count),
        })
    }
}

/// Temperature at each of the rising `times_ns`, linear between readings, constant before the first and after the last.
/// `readings` has at least one.
pub(super) fn interpolated(readings: &[Reading], times_ns: &[u64]) -> Vec<f64> {
    let mut before = 0;
    let value = |&time_ns: &u64| {
        while readings.get(before + 1).is_some_and(|next| next.time_ns <= time_ns) {
            before += 1;
        }
        let from = readings[before];
        match readings.get(before + 1) {
            Some(to) if from.time_ns < time_ns => {
                let part = (time_ns - from.time_ns) as f64 / (to.time_ns - from.time_ns) as f64;
                from.temperature + (to.temperature - from.temperature) * part
            }
            _ => from.temperature,
        }
    };
    times_ns.iter().map(value).collect()
}

/// d = L - U at each of the rising `times_ns`, with L behind the readings by `lag_ns` as in flight. `temperature` is U
/// at these times.
pub(super) fn behind(readings: &[Reading], times_ns: &[u64], temperature: &[f64], lag_ns: u64) -> Vec<f64> {
    let first = readings[0];
    let mut state = LaggedReading { time_ns: first.time_ns, temperature: first.temperature, lagged: first.temperature };
    let mut rest = &readings[1..];
    let difference = |(&time_ns, &temperature): (&u64, &f64)| {
        while let Some((next, others)) = rest.split_first().filter(|(next, _)| next.time_ns <= time_ns) {
            state = state.next(next.temperature, next.time_ns, lag_ns);
            rest = others;
        }
        if time_ns <= state.time_ns {
            state.lagged - state.temperature
        } else {
            state.next(temperature, time_ns, lag_ns).lagged - temperature
        }
    };
    times_ns.iter().zip(temperature).map(difference).collect()
}
