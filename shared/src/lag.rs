//! The lagged temperature: the head temperature of each sensor behind a first-order lag. The transient term of a bias
//! needs it.
//!
//! The service has no state, so the producer of the samples keeps this one: the acquisition for live samples, the
//! offline tools for recordings that have no lagged temperature.
//!
//! # Formula
//! L follows the temperature U by `dL/dt = (U - L) / tau`. With the first reading L = U: the sensor is taken to be
//! soaked. For a later one, dt after the last,
//!
//! ```text
//! a = exp(-dt / tau)
//! k = (1 - a) * tau / dt
//! L = U + (L_last - U_last) * a - (U - U_last) * k
//! ```
//! which is exact for temperature that is linear between two readings. So L does not depend on how often the
//! temperature is read.
//!
//! A reading is a new measurement. A value that is only repeated from sample to sample is none: the temperature would
//! be taken to rise in one sample what it rose since the last measurement.
//!
//! A value that no thermometer gives ([`ReadingLimits`]) is no reading either: L goes on as if the temperature had
//! stayed, and the time of it counts as unknown, so that L is unknown until a reading comes again and the share of that
//! time has decayed.

use crate::status::{ImuStatus, Ranges};
use crate::table::CoefficientTable;
use crate::units::CELSIUS;
use crate::wire::{AXES, RawSample, SENSORS};
use serde::{Deserialize, Serialize};

/// L is known where an unknown start has at most this share in it. That is so after three time constants.
pub const KNOWN_SHARE: f64 = 0.05;

/// Where so much of L is unknown a value outside the step's limit begins a new history, since it costs nothing: a
/// thermometer that was wrong at first, or was replaced, is believed in the end.
const LOST_SHARE: f64 = 0.5;

/// What the head temperature of an IMU can be, and how fast it can change, in the table's unit.
///
/// Both follow from the span, which is the width of the head's ranges in the table, and at least [`LEAST_SPAN_C`] where
/// the unit is degrees Celsius. A value farther outside the ranges than a quarter of the span is no reading. Neither is
/// one whose step since the last reading is over a sixteenth of the span and as much again for each second between
/// them: for a span of 80 °C that is 5 °C, and 5 °C/s. Recordings have up to 0.5 °C in a step and 5 °C/s, and noise is
/// a step of some tenths in a millisecond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReadingLimits {
    low: f64,
    high: f64,
    /// The largest step, and what it may be larger for each second.
    step: f64,
}

/// The least span of temperature in degrees Celsius.
const LEAST_SPAN_C: f64 = 80.0;

impl ReadingLimits {
    /// The limits of a table's readings.
    #[must_use]
    pub fn of(table: &CoefficientTable) -> Self {
        Self::new(&Ranges::of_accelerometers(table), Ranges::of_gyroscopes(table).as_ref())
    }

    /// The limits of the readings of the table in force; `None` without one.
    #[must_use]
    pub fn of_status(imu: &ImuStatus) -> Option<Self> {
        let gyroscopes = imu.gyroscopes.as_ref().map(|gyroscopes| &gyroscopes.ranges);
        imu.ranges.as_ref().map(|ranges| Self::new(ranges, gyroscopes))
    }

    fn new(accelerometers: &Ranges, gyroscopes: Option<&Ranges>) -> Self {
        let ranges = || accelerometers.head.iter().chain(gyroscopes.iter().flat_map(|ranges| &ranges.head));
        let low = ranges().map(|[low, _]| *low).fold(f64::INFINITY, f64::min);
        let high = ranges().map(|[_, high]| *high).fold(f64::NEG_INFINITY, f64::max);
        let least = if CELSIUS.contains(&accelerometers.unit.as_str()) { LEAST_SPAN_C } else { 0.0 };
        let span = (high - low).max(least);
        Self { low: low - span / 4.0, high: high + span / 4.0, step: span / 16.0 }
    }

    /// Whether a thermometer gives this value at all.
    fn contain(&self, temperature: f64) -> bool {
        (self.low..=self.high).contains(&temperature)
    }

    /// Whether a thermometer gives this value so long after the last reading \[ns\].
    fn allow(&self, step: f64, dt: u64) -> bool {
        step.abs() <= self.step * (1.0 + dt as f64 / 1e9)
    }
}

/// The state of one sensor: its last reading, and L at that time.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct LaggedReading {
    /// When the temperature was measured, on the acquisition's clock \[ns\].
    pub time_ns: u64,
    /// Head temperature U, in the table's unit.
    pub temperature: f64,
    /// Lagged temperature L, in the table's unit.
    pub lagged: f64,
}

/// The lag of an IMU: its time constant, and the state of each sensor.
///
/// Every field may have any value. An application that restarts saves a copy (it is `Copy`, and has serde's traits) and
/// goes on with it.
///
/// ```
/// use isotherm_shared::lag::Lag;
/// use isotherm_shared::wire::RawSample;
///
/// let mut lag = Lag::new(240_000_000_000); // 240 s
/// lag.read(0, 2.0, 1_000_000_000); // A1 is soaked at 2 V …
/// lag.read(0, 2.4, 241_000_000_000); // .. and at 2.4 V one time constant later
/// let mut raw = RawSample { telemetry_ns: 241_000_000_000, ..RawSample::default() };
/// raw.accelerometers.head_temperature[0] = 2.4;
/// lag.fill(&mut raw);
/// let lagged = raw.accelerometers.head_lagged[0];
/// assert_eq!(raw.lag_ns, 240_000_000_000);
/// assert!(2.0 < lagged && lagged < 2.4, "{lagged}");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Lag {
    /// Time constant tau \[ns\]; 0 = there is no lag. It may be changed at any time: L is kept.
    pub lag_ns: u64,
    /// The state of each sensor; `None` before its first reading.
    pub sensors: [Option<LaggedReading>; SENSORS],
    /// The share of each sensor's L that is unknown. It rests on a start of which it is not known that the sensor was
    /// soaked: 0 where it was, otherwise 1 at the first reading, and `exp(-dt / tau)` of that dt later. Time in which
    /// the values were no readings adds to it. [`KNOWN_SHARE`] is small enough.
    pub unknown: [f64; SENSORS],
    /// Which start of the machine the times are of; 0 = unknown, or of a clock that goes on over a start.
    #[serde(default)]
    pub boot: u64,
    /// Which values are readings; `None` = all that are finite. It is no part of a state that is saved.
    #[serde(skip)]
    pub limits: Option<ReadingLimits>,
    /// Whether the last value of each sensor was outside these limits. It is no part of a state that is saved.
    #[serde(skip)]
    pub faulty: [bool; SENSORS],
}

impl Lag {
    /// A lag without readings.
    #[must_use]
    pub const fn new(lag_ns: u64) -> Self {
        Self {
            lag_ns,
            sensors: [None; SENSORS],
            unknown: [0.0; SENSORS],
            boot: 0,
            limits: None,
            faulty: [false; SENSORS],
        }
    }

    /// Forgets all readings: each sensor is soaked at its next one.
    pub const fn reset(&mut self) {
        *self = Self { boot: self.boot, limits: self.limits, ..Self::new(self.lag_ns) };
    }

    /// Forgets the readings of a sensor, and that it was soaked: its L is unknown until its readings span three time
    /// constants.
    pub fn forget(&mut self, sensor: usize) {
        if let (Some(state), Some(unknown)) = (self.sensors.get_mut(sensor), self.unknown.get_mut(sensor)) {
            (*state, *unknown, self.faulty[sensor]) = (None, 1.0, false);
        }
    }

    /// Whether the L of a sensor may be used: what is unknown has no more than [`KNOWN_SHARE`] in it, and the last
    /// value was a reading.
    #[must_use]
    pub fn is_known(&self, sensor: usize) -> bool {
        self.unknown.get(sensor).is_some_and(|share| *share <= KNOWN_SHARE && !self.faulty[sensor])
    }

    /// Takes a new reading of one of the [`SENSORS`]: the head temperature, and when it was measured on the
    /// acquisition's clock \[ns\].
    ///
    /// A reading that is not finite is none. Neither is one of the same time as the last, nor one of a sensor that does
    /// not exist. One of an earlier time is of a clock that was set back: L is kept, and the temperature goes on from
    /// there. One outside the [limits](Self::limits) shows only that time has passed, in which the temperature is
    /// unknown.
    pub fn read(&mut self, sensor: usize, temperature: f64, time_ns: u64) {
        let Some(state) = self.sensors.get_mut(sensor) else { return };
        if !temperature.is_finite() || state.is_some_and(|last| last.time_ns == time_ns) {
            return;
        }
        let unknown = &mut self.unknown[sensor];
        let passed = state.and_then(|last| time_ns.checked_sub(last.time_ns)).filter(|_| self.lag_ns > 0);
        let mut decay = passed.map_or(1.0, |dt| libm::exp(-(dt as f64 / self.lag_ns as f64)));
        if let Some(limits) = self.limits.filter(|_| self.lag_ns > 0) {
            let is_step = state.zip(passed).is_some_and(|(last, dt)| !limits.allow(temperature - last.temperature, dt));
            let is_lost = *unknown >= LOST_SHARE;
            if !limits.contain(temperature) || (is_step && !is_lost) {
                *unknown = 1.0 - (1.0 - *unknown) * decay;
                self.faulty[sensor] = true;
                *state = state.map(|last| last.next(last.temperature, time_ns, self.lag_ns));
                return;
            }
            if is_step {
                (*state, *unknown, decay) = (None, 1.0, 1.0);
            }
        }
        *unknown *= decay;
        self.faulty[sensor] = false;
        let soaked = LaggedReading { time_ns, temperature, lagged: temperature };
        *state = Some(state.map_or(soaked, |last| last.next(temperature, time_ns, self.lag_ns)));
    }

    /// Takes the readings of a sample of which it is not known whether its temperature is new, as in a recording. Its
    /// time is `telemetry_ns`. Where that is unknown, a value is a new measurement if it is not the last one of its
    /// sensor, at the sample's `timestamp_ns`.
    pub fn follow(&mut self, raw: &RawSample) {
        for (sensor, temperature) in heads(raw).into_iter().enumerate() {
            if raw.temperature_time_ns() != 0 {
                self.read(sensor, temperature, raw.temperature_time_ns());
            } else if self.sensors[sensor].is_none_or(|last| last.temperature != temperature) {
                self.read(sensor, temperature, raw.timestamp_ns);
            }
        }
    }

    /// Fills time constant and lagged temperature of a sample in. A sensor without a reading is soaked at the sample's
    /// temperature. L that is [not known](Self::is_known) becomes NaN, which is not equal to the temperature: the
    /// increments of the sensor will be flagged. Gyroscopes that the IMU does not have get their own temperature, NaN.
    pub fn fill(&self, raw: &mut RawSample) {
        let has_gyroscopes = !raw.gyroscopes.is_absent();
        let mut lagged = heads(raw);
        for (sensor, lagged) in lagged.iter_mut().enumerate() {
            if self.lag_ns == 0 {
                *lagged = 0.0;
            } else if sensor < AXES || has_gyroscopes {
                if !self.is_known(sensor) {
                    *lagged = f64::NAN;
                } else if let Some(state) = &self.sensors[sensor] {
                    *lagged = state.lagged;
                }
            }
        }
        raw.lag_ns = self.lag_ns;
        let [a1, a2, a3, g1, g2, g3] = lagged;
        raw.accelerometers.head_lagged = [a1, a2, a3];
        raw.gyroscopes.head_lagged = [g1, g2, g3];
    }
}

/// Completes the lagged temperature of a recording's rows, in their order. Each session begins soaked.
///
/// ```
/// use isotherm_shared::lag::LagCompletion;
/// use isotherm_shared::wire::RawSample;
///
/// let mut completion = LagCompletion::new(240_000_000_000);
/// let mut row = RawSample { timestamp_ns: 1_000_000_000, ..RawSample::default() };
/// row.accelerometers.head_temperature = [21.5; 3];
/// completion.complete(&mut row, false);
/// assert_eq!((row.lag_ns, row.accelerometers.head_lagged), (240_000_000_000, [21.5; 3]));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct LagCompletion {
    lag: Lag,
    session: Option<u64>,
}

impl LagCompletion {
    /// With the time constant \[ns\], 0 for none.
    #[must_use]
    pub const fn new(lag_ns: u64) -> Self {
        Self { lag: Lag::new(lag_ns), session: None }
    }

    /// Sets the time constant \[ns\] of all further rows.
    pub const fn set_lag(&mut self, lag_ns: u64) {
        self.lag.lag_ns = lag_ns;
    }

    /// Sets which values of all further rows are readings.
    pub const fn set_limits(&mut self, limits: Option<ReadingLimits>) {
        self.lag.limits = limits;
    }

    /// Completes the next row. The rows of a recording that `has_lag`, that is its columns, stay as the acquisition
    /// sent them, those without a time constant too: the service computed with them. Their readings count in any case.
    pub fn complete(&mut self, raw: &mut RawSample, has_lag: bool) {
        if self.session.replace(raw.session).is_some_and(|session| session != raw.session) {
            self.lag.reset();
        }
        self.lag.follow(raw);
        if !has_lag {
            self.lag.fill(raw);
        }
    }
}

impl LaggedReading {
    /// The state at the next reading, with the time constant `lag_ns` \[ns\]. A reading of the same or of an earlier
    /// time keeps L.
    #[must_use]
    pub fn next(&self, temperature: f64, time_ns: u64, lag_ns: u64) -> Self {
        let passed = time_ns.checked_sub(self.time_ns).filter(|dt| *dt > 0);
        let lagged = passed.map_or(self.lagged, |dt| {
            let ratio = dt as f64 / lag_ns as f64;
            // 1 - a without cancellation.
            let k = -libm::expm1(-ratio) / ratio;
            temperature + (self.lagged - self.temperature) * libm::exp(-ratio) - (temperature - self.temperature) * k
        });
        // Only with numbers near the largest double, or in a state that was handed over.
        Self { time_ns, temperature, lagged: if lagged.is_finite() { lagged } else { temperature } }
    }
}

/// Head temperature of all sensors.
const fn heads(raw: &RawSample) -> [f64; SENSORS] {
    let ([a1, a2, a3], [g1, g2, g3]) = (raw.accelerometers.head_temperature, raw.gyroscopes.head_temperature);
    [a1, a2, a3, g1, g2, g3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Triad;

    #[test]
    fn a_session_of_a_recording_begins_soaked_and_rows_that_have_lag_stay() {
        let row = |session, second: u64, temperature| RawSample {
            session,
            timestamp_ns: second * 1_000_000_000,
            accelerometers: Triad { head_temperature: [temperature; 3], ..Triad::default() },
            ..RawSample::default()
        };
        let mut completion = LagCompletion::new(100_000_000_000);
        let mut complete = |mut raw: RawSample, has_lag| {
            completion.complete(&mut raw, has_lag);
            (raw.lag_ns, raw.accelerometers.head_lagged[0])
        };
        assert_eq!(complete(row(1, 1, 20.0), false), (100_000_000_000, 20.0));
        let (_, behind) = complete(row(1, 51, 30.0), false);
        assert!(behind > 20.0 && behind < 25.0, "{behind}");
        // As it was sent; what it reads counts for the next one.
        assert_eq!(complete(row(1, 101, 30.1), true), (0, 0.0));
        let (_, nearer) = complete(row(1, 151, 30.2), false);
        assert!(nearer > 26.0 && nearer < 29.0, "{nearer}");
        assert_eq!(complete(row(2, 201, 30.0), false), (100_000_000_000, 30.0));
    }
    use proptest::prelude::*;

    const TAU_NS: u64 = 240_000_000_000;

    /// L of one sensor after readings of a line: temperature at time 0 and its slope \[1/s\].
    fn of_line(start: f64, slope: f64, times_ns: &[u64]) -> f64 {
        let mut lag = Lag::new(TAU_NS);
        for time_ns in times_ns {
            lag.read(0, start + slope * (*time_ns as f64 / 1e9), *time_ns);
        }
        lag.sensors[0].unwrap().lagged
    }

    proptest! {
        /// However often linear temperature is read, L is the solution of the differential equation.
        #[test]
        fn linear_temperature_is_exact_at_any_rate(
            start in -5.0..5.0f64,
            slope in -0.01..0.01f64,
            steps_ns in prop::collection::vec(1_000_000..300_000_000_000u64, 1..60),
        ) {
            let times: Vec<_> = [0].into_iter().chain(steps_ns.iter().scan(0, |time, step| {
                *time += step;
                Some(*time)
            })).collect();
            let end = *times.last().unwrap();
            let (tau, t) = (TAU_NS as f64 / 1e9, end as f64 / 1e9);
            // L = U - slope tau (1 - exp(-t / tau)), with L = U at time 0.
            let exact = start + slope * t + slope * tau * libm::expm1(-t / tau);
            let size = start.abs() + slope.abs() * (t + tau);
            for read in [&times[..], &[0, end]] {
                let lagged = of_line(start, slope, read);
                prop_assert!((lagged - exact).abs() <= 1e-13 * size, "{} for {}, {} readings", lagged, exact, read.len());
            }
        }

        /// No reading, and no state that was handed over, makes L useless for good.
        #[test]
        fn any_numbers_give_finite_lagged_temperature(
            lag_ns in any::<u64>(),
            state in any::<Option<(u64, f64, f64)>>(),
            readings in prop::collection::vec((any::<u64>(), any::<u64>()), 1..20),
        ) {
            let mut lag = Lag::new(lag_ns);
            lag.sensors[3] = state.map(|(time_ns, temperature, lagged)| LaggedReading { time_ns, temperature, lagged });
            for (bits, time_ns) in readings {
                let (temperature, before) = (f64::from_bits(bits), lag);
                lag.read(3, temperature, time_ns);
                let same_time = before.sensors[3].is_some_and(|last| last.time_ns == time_ns);
                if temperature.is_finite() && !same_time {
                    let now = lag.sensors[3].unwrap();
                    prop_assert_eq!((now.time_ns, now.temperature), (time_ns, temperature));
                    prop_assert!(now.lagged.is_finite());
                } else {
                    prop_assert_eq!(format!("{lag:?}"), format!("{before:?}"));
                }
            }
        }

        /// L stays between the lowest and the highest reading, whatever the temperature does.
        #[test]
        fn lagged_temperature_stays_within_the_readings(
            readings in prop::collection::vec((1_000_000..1_000_000_000_000u64, 0.9..4.2f64), 1..60),
        ) {
            let (mut lag, mut time_ns) = (Lag::new(TAU_NS), 0);
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for (step_ns, temperature) in readings {
                time_ns += step_ns;
                (low, high) = (low.min(temperature), high.max(temperature));
                lag.read(5, temperature, time_ns);
                let lagged = lag.sensors[5].unwrap().lagged;
                prop_assert!((low - 1e-12..=high + 1e-12).contains(&lagged), "{} of {}..{}", lagged, low, high);
            }
        }
    }

    fn sample(telemetry_ns: u64, timestamp_ns: u64, temperature: f64) -> RawSample {
        let triad = Triad { head_temperature: [temperature; AXES], ..Triad::default() };
        RawSample { telemetry_ns, timestamp_ns, accelerometers: triad, gyroscopes: triad, ..RawSample::default() }
    }

    /// A step of the temperature by 1 in one second, two seconds after the first reading.
    const STEP: [(u64, f64); 3] = [(1_000_000_000, 1.0), (2_000_000_000, 1.0), (3_000_000_000, 2.0)];

    #[test]
    fn a_value_that_is_only_repeated_is_no_reading() {
        let exact = of_readings(&STEP);
        let mut lag = Lag::new(TAU_NS);
        for (time_ns, temperature) in STEP {
            // The samples between two readings repeat the last one.
            for timestamp_ns in (time_ns..time_ns + 1_000_000_000).step_by(50_000_000) {
                lag.follow(&sample(time_ns, timestamp_ns, temperature));
            }
        }
        assert_eq!(lag.sensors, [exact.sensors[0]; SENSORS]);
        // Where the time of the temperature is unknown, only a change shows that it was read.
        let mut lag = Lag::new(TAU_NS);
        for (time_ns, temperature) in STEP {
            for timestamp_ns in (time_ns..time_ns + 1_000_000_000).step_by(50_000_000) {
                lag.follow(&sample(0, timestamp_ns, temperature));
            }
        }
        assert_eq!(lag.sensors, [of_readings(&[STEP[0], STEP[2]]).sensors[0]; SENSORS]);
    }

    fn of_readings(readings: &[(u64, f64)]) -> Lag {
        let mut lag = Lag::new(TAU_NS);
        readings.iter().for_each(|(time_ns, temperature)| lag.read(0, *temperature, *time_ns));
        lag
    }

    #[test]
    fn readings_that_are_not_finite_are_left_out() {
        let mut lag = Lag::new(TAU_NS);
        lag.read(0, f64::NAN, 0);
        assert_eq!(lag, Lag::new(TAU_NS));
        for (time_ns, temperature) in STEP {
            lag.read(0, temperature, time_ns);
            lag.read(0, f64::NAN, time_ns + 1);
            lag.read(0, f64::INFINITY, time_ns + 2);
        }
        lag.read(SENSORS, 1.0, 5);
        assert_eq!(lag, of_readings(&STEP));
    }

    #[test]
    fn a_clock_that_is_set_back_keeps_the_lag() {
        let mut lag = of_readings(&STEP);
        let before = lag.sensors[0].unwrap();
        lag.read(0, 2.5, 7);
        assert_eq!(lag.sensors[0], Some(LaggedReading { time_ns: 7, temperature: 2.5, lagged: before.lagged }));
        lag.read(0, 2.5, 7 + 100 * TAU_NS);
        assert!((lag.sensors[0].unwrap().lagged - 2.5).abs() < 1e-12, "soaked at last");
    }

    #[test]
    fn an_unknown_start_is_known_after_three_time_constants() {
        const SECOND: u64 = 1_000_000_000;
        // One of two sensors with the same readings was not soaked at the first, but 0.7 colder.
        let temperature = |seconds: u64| 1.2 + 1e-4 * seconds as f64;
        let mut lag = Lag::new(TAU_NS);
        lag.forget(0);
        lag.forget(SENSORS);
        assert_eq!(lag.unknown, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let mut right = LaggedReading { time_ns: 0, temperature: temperature(0), lagged: temperature(0) - 0.7 };
        for seconds in (0..1200).step_by(10) {
            if seconds > 0 {
                right = right.next(temperature(seconds), seconds * SECOND, TAU_NS);
            }
            (0..2).for_each(|sensor| lag.read(sensor, temperature(seconds), seconds * SECOND));
            assert_eq!(lag.is_known(0), seconds >= 720, "after {seconds} s");
            assert!(lag.is_known(1) && !lag.is_known(SENSORS));
            // The share is that of the difference at the start which is left.
            let left = lag.sensors[0].unwrap().lagged - right.lagged;
            assert!((left - 0.7 * lag.unknown[0]).abs() < 1e-12, "{left} after {seconds} s");
        }
        assert_eq!(lag.sensors[0], lag.sensors[1]);
        // A time constant that is not known yet, and a clock that was set back, show nothing.
        for (lag_ns, time_ns) in [(0, 10 * TAU_NS), (TAU_NS, 5)] {
            let mut lag = Lag::new(lag_ns);
            lag.forget(3);
            [10, time_ns].into_iter().for_each(|time_ns| lag.read(3, 1.0, time_ns));
            assert_eq!(lag.unknown[3].to_bits(), 1.0_f64.to_bits());
        }
        lag.forget(2);
        lag.reset();
        assert_eq!(lag, Lag::new(TAU_NS));
    }

    #[test]
    fn a_value_that_no_thermometer_gives_is_no_reading() {
        const SECOND: u64 = 1_000_000_000;
        let text = include_str!("../../examples/tables/imu-b.toml");
        let table = CoefficientTable::from_toml(text, None).unwrap();
        let limits = ReadingLimits::of(&table);
        let ranges = Ranges::of_accelerometers(&table);
        assert_eq!(limits, ReadingLimits::new(&ranges, None));
        let celsius = Ranges { unit: "degC".to_owned(), head: [[-40.0, 85.0]; AXES], ..ranges.clone() };
        let narrow = Ranges { head: [[20.0, 30.0]; AXES], ..celsius.clone() };
        let volts = Ranges { unit: "V".to_owned(), head: [[0.9, 4.1], [0.9, 4.0], [1.0, 4.1]], ..ranges };
        for (ranges, [low, high, step]) in
            [(&celsius, [-71.25, 116.25, 7.8125]), (&narrow, [0.0, 50.0, 5.0]), (&volts, [0.1, 4.9, 0.2])]
        {
            let limits = ReadingLimits::new(ranges, None);
            let found = [limits.low - low, limits.high - high, limits.step - step];
            assert!(found.iter().all(|error| error.abs() < 1e-12), "{limits:?}");
        }
        let hot = Ranges { head: [[-40.0, 125.0]; AXES], ..celsius.clone() };
        assert!(ReadingLimits::new(&celsius, Some(&hot)).contain(150.0));

        // A thermometer shows -55 degC for 10 s, which is inside the limits of the range, or 200 degC, which is not.
        for fault in [-55.0, 200.0] {
            let begin = || {
                let mut lag = Lag { limits: Some(ReadingLimits::new(&celsius, None)), ..Lag::new(TAU_NS) };
                (1..=100).for_each(|second| lag.read(0, 25.0, second * SECOND));
                lag
            };
            let mut lag = begin();
            for second in 101..=110 {
                lag.read(0, fault, second * SECOND);
                let mut raw = sample(0, 0, fault);
                lag.fill(&mut raw);
                assert!(!lag.is_known(0) && raw.accelerometers.head_lagged[0].is_nan(), "{fault} at {second} s");
                assert!(lag.is_known(1) && raw.accelerometers.head_lagged[1] == fault, "no reading: soaked");
            }
            assert_eq!(lag.sensors[0], Some(LaggedReading { time_ns: 110 * SECOND, temperature: 25.0, lagged: 25.0 }));
            lag.read(0, 25.1, 111 * SECOND);
            let lagged = lag.sensors[0].unwrap().lagged;
            assert!(lag.is_known(0) && (lagged - 25.0).abs() < 1e-3, "{lagged} after {fault}");
            // After a minute a fifth of L is unknown, until that has decayed to a twentieth.
            let mut lag = begin();
            (101..=160).for_each(|second| lag.read(0, fault, second * SECOND));
            let share = -libm::expm1(-0.25);
            assert!((lag.unknown[0] - share).abs() < 1e-12, "{} for {share}", lag.unknown[0]);
            let known = (161..1000).find(|second| {
                lag.read(0, 25.0, second * SECOND);
                lag.is_known(0)
            });
            assert!(known.is_some_and(|second| (515..525).contains(&second)), "{known:?}");
        }
    }

    #[test]
    fn a_thermometer_that_was_wrong_at_first_is_believed_in_the_end() {
        const SECOND: u64 = 1_000_000_000;
        let limits = Some(ReadingLimits { low: -71.0, high: 116.0, step: 7.8 });
        // Its first value is that of its reset. From a start that is not known the right one counts at once.
        for (unknown, believed) in [(0.0, 165..175), (1.0, 2..3)] {
            let mut lag = Lag { limits, ..Lag::new(TAU_NS) };
            lag.unknown = [unknown; SENSORS];
            lag.read(0, 85.0, SECOND);
            let last = (2..1000).find(|second| {
                lag.read(0, 25.0, second * SECOND);
                lag.sensors[0].unwrap().lagged == 25.0
            });
            assert!(last.is_some_and(|second| believed.contains(&second)), "{last:?}");
            assert_eq!(lag.unknown[0].to_bits(), 1.0_f64.to_bits());
        }
        // A value outside the range is not the first reading either.
        let mut lag = Lag { limits, ..Lag::new(TAU_NS) };
        lag.read(0, -273.15, SECOND);
        assert!(lag.sensors[0].is_none() && !lag.is_known(0));
        lag.read(0, 25.0, 2 * SECOND);
        lag.read(0, 25.0, 3 * SECOND);
        assert!(lag.is_known(0));
        lag.reset();
        assert_eq!(lag.limits, limits);
        // Rapid readings with noise, and a long pause, are readings.
        for (index, temperature) in [25.0, 25.6, 24.7, 26.0].into_iter().enumerate() {
            lag.read(1, temperature, SECOND + index as u64 * 1_000_000);
        }
        lag.read(1, 70.0, 61 * SECOND);
        assert!(lag.is_known(1) && lag.sensors[1].unwrap().temperature == 70.0);
    }

    #[test]
    fn gyroscopes_that_the_imu_does_not_have_stay_absent() {
        let mut lag = Lag::new(TAU_NS);
        (0..SENSORS).for_each(|sensor| lag.read(sensor, 25.0, 1));
        lag.forget(4);
        for gyroscopes in [Triad::ABSENT, Triad::default()] {
            let mut raw = RawSample { gyroscopes, ..sample(0, 0, 25.0) };
            lag.fill(&mut raw);
            assert!(raw.gyroscopes.is_absent() && raw.accelerometers.head_lagged == [25.0; 3], "{raw:?}");
        }
    }

    #[test]
    fn a_sample_gets_the_lag_of_its_sensors() {
        let mut lag = Lag::new(TAU_NS);
        let mut raw = sample(0, 0, 3.0);
        lag.fill(&mut raw);
        assert_eq!(
            (raw.lag_ns, raw.accelerometers.head_lagged, raw.gyroscopes.head_lagged),
            (TAU_NS, [3.0; 3], [3.0; 3])
        );
        for sensor in 0..SENSORS {
            lag.read(sensor, sensor as f64, 1);
        }
        lag.fill(&mut raw);
        assert_eq!((raw.accelerometers.head_lagged, raw.gyroscopes.head_lagged), ([0.0, 1.0, 2.0], [3.0, 4.0, 5.0]));
        // Another time constant keeps L; none clears what the sample had.
        lag.lag_ns = 7;
        lag.fill(&mut raw);
        assert_eq!((raw.lag_ns, raw.gyroscopes.head_lagged), (7, [3.0, 4.0, 5.0]));
        lag.lag_ns = 0;
        lag.fill(&mut raw);
        assert_eq!(raw, sample(0, 0, 3.0));
        lag.reset();
        assert_eq!(lag, Lag::new(0));
    }
}
