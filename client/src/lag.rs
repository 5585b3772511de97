//! The lagged temperature of live samples: an acquisition feeds its readings, and every sample that it sends carries
//! the state.

use crate::clock::boot;
use crate::lag_option::LagOption;
use core::str::FromStr;
use isotherm_shared::lag::{Lag, ReadingLimits};
use isotherm_shared::status::ImuStatus;
use isotherm_shared::time_constant::TimeConstant;
use isotherm_shared::wire::{AXES, RawSample, SENSORS};

/// The bits of all sensors.
const ALL: u8 = (1 << SENSORS) - 1;

/// A sensor of an IMU.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_client::Sensor;
///
/// let sensor: Sensor = "G2".parse()?;
/// assert!("X1".parse::<Sensor>().is_err());
/// assert_eq!(Sensor::NAMES[sensor as usize].1, "G2");
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
#[expect(missing_docs, reason = "the names of the sensors")]
pub enum Sensor {
    A1,
    A2,
    A3,
    G1,
    G2,
    G3,
}

impl Sensor {
    /// All sensors with their names, in the order of their numbers from 0.
    pub const NAMES: [(Self, &'static str); SENSORS] =
        [(Self::A1, "A1"), (Self::A2, "A2"), (Self::A3, "A3"), (Self::G1, "G1"), (Self::G2, "G2"), (Self::G3, "G3")];
}

/// A text that is not the name of a sensor.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{0:?} is not a sensor; give A1, A2, A3, G1, G2 or G3")]
pub struct UnknownSensor(String);

impl FromStr for Sensor {
    type Err = UnknownSensor;
    fn from_str(name: &str) -> Result<Self, UnknownSensor> {
        let found = Self::NAMES.iter().find(|(_, known)| *known == name);
        found.map(|(sensor, _)| *sensor).ok_or_else(|| UnknownSensor(name.to_owned()))
    }
}

/// The lag of an acquisition.
#[derive(Debug)]
pub(crate) struct AcquisitionLag {
    option: LagOption,
    lag: Lag,
    /// The sensors that the application has fed, one bit each.
    fed: u8,
    /// The sensors whose last reading was handed over, and none has come since.
    restored: u8,
}

impl AcquisitionLag {
    pub(crate) fn new(option: LagOption) -> Self {
        let lag_ns = match option {
            LagOption::Fixed(time_constant) => time_constant.ns(),
            LagOption::Service | LagOption::None => 0,
        };
        let mut lag = Lag { boot: boot(), ..Lag::new(lag_ns) };
        (0..SENSORS).for_each(|sensor| lag.forget(sensor));
        Self { option, lag, fed: 0, restored: 0 }
    }

    /// Takes the time constant and the ranges of the table in force, if the service is to give them.
    pub(crate) fn learn(&mut self, in_force: &ImuStatus) {
        if self.option != LagOption::Service {
            return;
        }
        self.lag.limits = ReadingLimits::of_status(in_force);
        // A table without a time constant needs none. The old one stays, so that L goes on for a later table.
        if let Some(Ok(time_constant)) = in_force.lag_s.map(TimeConstant::from_seconds) {
            self.lag.lag_ns = time_constant.ns();
        }
    }

    pub(crate) fn read(&mut self, sensor: usize, temperature: f64, time_ns: u64) {
        if self.option != LagOption::None {
            self.fed |= 1 << sensor;
            self.check_clock(sensor, time_ns);
            self.lag.read(sensor, temperature, time_ns);
        }
    }

    pub(crate) fn follow(&mut self, raw: &RawSample) {
        if self.option != LagOption::None {
            self.fed = ALL;
            let time_ns = match raw.temperature_time_ns() {
                0 => raw.timestamp_ns,
                temperature_ns => temperature_ns,
            };
            (0..SENSORS).for_each(|sensor| self.check_clock(sensor, time_ns));
            self.lag.follow(raw);
        }
    }

    /// Forgets a reading that was handed over if the first one after it is earlier: it is of another clock, for example
    /// of the time before the machine was started anew, and shows nothing of the present one.
    fn check_clock(&mut self, sensor: usize, time_ns: u64) {
        if self.restored & 1 << sensor != 0 {
            self.restored &= !(1 << sensor);
            if self.lag.sensors[sensor].is_some_and(|kept| kept.time_ns > time_ns) {
                self.lag.forget(sensor);
            }
        }
    }

    /// What the temperatures of a new session have been is not known.
    pub(crate) fn reset(&mut self) {
        self.restore(&Lag::default());
    }

    /// Each sensor is soaked at its next temperature.
    pub(crate) const fn soak(&mut self) {
        self.lag.reset();
        self.restored = 0;
    }

    pub(crate) const fn state(&self) -> &Lag {
        &self.lag
    }

    /// Goes on with kept readings. A sensor without one is unknown, not soaked. Readings of another start of the
    /// machine are none: the time that has passed since then is not known.
    pub(crate) fn restore(&mut self, kept: &Lag) {
        let is_of_another_boot = ![0, self.lag.boot].contains(&kept.boot) && self.lag.boot != 0;
        (self.fed, self.restored) = (0, 0);
        for (sensor, (reading, share)) in kept.sensors.iter().zip(kept.unknown).enumerate() {
            self.lag.forget(sensor);
            if !is_of_another_boot
                && reading.is_some_and(|reading| reading.temperature.is_finite() && reading.lagged.is_finite())
            {
                self.lag.sensors[sensor] = *reading;
                self.lag.unknown[sensor] = if (0.0..=1.0).contains(&share) { share } else { 1.0 };
                self.fed |= 1 << sensor;
            }
        }
        self.restored = self.fed;
    }

    /// Fills time constant and lagged temperature into a sample, unless the application has done so or feeds no
    /// readings.
    #[inline]
    pub(crate) fn fill(&self, raw: &mut RawSample) {
        if raw.lag_ns == 0 && self.lag.lag_ns != 0 && self.fed != 0 {
            self.lag.fill(raw);
            if self.fed != ALL {
                self.mark_unfed(raw);
            }
        }
    }

    /// The lagged temperature of a sensor that was never fed is not known, except for gyroscopes that the IMU does not
    /// have.
    fn mark_unfed(&self, raw: &mut RawSample) {
        for (triad, first) in [(&mut raw.accelerometers, 0), (&mut raw.gyroscopes, AXES)] {
            if first == 0 || !triad.is_absent() {
                for (axis, lagged) in triad.head_lagged.iter_mut().enumerate() {
                    if self.fed & 1 << (first + axis) == 0 {
                        *lagged = f64::NAN;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::lag::LaggedReading;
    use isotherm_shared::wire::Triad;

    const TEMPERATURE: f64 = 2.5;

    fn sample(gyroscopes: f64) -> RawSample {
        let triad = |head| Triad { head_temperature: [head; AXES], ..Triad::default() };
        RawSample { accelerometers: triad(TEMPERATURE), gyroscopes: triad(gyroscopes), ..RawSample::default() }
    }

    fn fixed() -> AcquisitionLag {
        AcquisitionLag::new(LagOption::Fixed(TimeConstant::from_seconds(10.0).unwrap()))
    }

    fn soaked() -> AcquisitionLag {
        let mut lag = fixed();
        lag.soak();
        lag
    }

    fn filled(lag: &AcquisitionLag, sample: RawSample) -> RawSample {
        let mut filled = sample;
        lag.fill(&mut filled);
        filled
    }

    #[test]
    fn sensors_are_numbered_in_the_order_of_the_wire() {
        for (number, (sensor, name)) in Sensor::NAMES.into_iter().enumerate() {
            assert_eq!((sensor as usize, name.parse()), (number, Ok(sensor)));
        }
        assert!("A4".parse::<Sensor>().is_err() && "a1".parse::<Sensor>().is_err());
    }

    #[test]
    fn samples_carry_the_lag_of_the_readings() {
        let mut lag = soaked();
        for (sensor, _) in Sensor::NAMES {
            lag.read(sensor as usize, 2.0, 1_000_000_000);
            lag.read(sensor as usize, TEMPERATURE, 2_000_000_000);
        }
        let sent = filled(&lag, sample(TEMPERATURE));
        assert_eq!(sent.lag_ns, 10_000_000_000);
        // The temperature rose by 0.5 in a tenth of the time constant: L = U - 0.5 * (1 - exp(-0.1)) / 0.1.
        let expected = 2.5 - 0.5 * (1.0 - libm::exp(-0.1_f64)) / 0.1;
        for lagged in [sent.accelerometers.head_lagged, sent.gyroscopes.head_lagged].as_flattened() {
            assert!((lagged - expected).abs() < 1e-14, "{lagged} {expected}");
        }
    }

    #[test]
    fn what_the_application_fills_in_stays() {
        let mut lag = soaked();
        lag.read(Sensor::A1 as usize, TEMPERATURE, 1);
        let own = RawSample { lag_ns: 7, ..sample(0.0) };
        assert_eq!(filled(&lag, own), own);
        let mut none = AcquisitionLag::new(LagOption::None);
        none.read(Sensor::A1 as usize, TEMPERATURE, 1);
        assert_eq!(filled(&none, sample(0.0)), sample(0.0));
    }

    #[test]
    fn a_sensor_that_is_not_fed_is_unknown() {
        let mut lag = soaked();
        assert_eq!(filled(&lag, sample(TEMPERATURE)), sample(TEMPERATURE), "no reading: no lag");
        for sensor in [Sensor::A1, Sensor::A2, Sensor::A3] {
            lag.read(sensor as usize, TEMPERATURE, 1);
        }
        let known = |triad: Triad| triad.head_lagged.map(f64::is_finite);
        let sent = filled(&lag, sample(TEMPERATURE));
        assert_eq!((known(sent.accelerometers), known(sent.gyroscopes)), ([true; 3], [false; 3]));
        assert!(filled(&lag, sample(0.0)).gyroscopes.is_absent(), "an IMU without gyroscopes sends none");
        lag.read(Sensor::G2 as usize, TEMPERATURE, 1);
        assert_eq!(known(filled(&lag, sample(TEMPERATURE)).gyroscopes), [false, true, false]);
    }

    #[test]
    fn a_new_session_is_unknown_unless_it_is_soaked_and_a_kept_state_goes_on() {
        let mut lag = soaked();
        lag.follow(&RawSample { timestamp_ns: 1, ..sample(1.0) });
        lag.follow(&RawSample { timestamp_ns: 1_000_000_001, ..sample(1.5) });
        let (kept, now) = (*lag.state(), sample(1.5));
        let sent = filled(&lag, now);
        assert!(sent.gyroscopes.head_lagged[2] < 1.1);
        for is_soaked in [false, true] {
            lag.reset();
            if is_soaked {
                lag.soak();
            }
            lag.follow(&RawSample { timestamp_ns: 2_000_000_001, ..now });
            assert_eq!(known(&lag, now), [is_soaked; SENSORS]);
        }
        assert_eq!(filled(&lag, now).gyroscopes.head_lagged, [1.5; 3]);
        let mut next = fixed();
        next.restore(&kept);
        assert_eq!(filled(&next, now), sent);
    }

    /// Known lagged temperature of the six sensors of a sample.
    fn known(lag: &AcquisitionLag, sample: RawSample) -> [bool; SENSORS] {
        let sent = filled(lag, sample);
        let [[a1, a2, a3], [g1, g2, g3]] =
            [sent.accelerometers, sent.gyroscopes].map(|triad| triad.head_lagged.map(f64::is_finite));
        [a1, a2, a3, g1, g2, g3].map(|finite| finite && sent.lag_ns != 0)
    }

    #[test]
    fn without_a_state_nothing_is_known_until_three_time_constants_have_passed() {
        let mut lag = fixed();
        assert_eq!(filled(&lag, sample(TEMPERATURE)), sample(TEMPERATURE), "no reading: no lag");
        for second in 0..40 {
            lag.follow(&RawSample { telemetry_ns: 1 + second * 1_000_000_000, ..sample(TEMPERATURE) });
            assert_eq!(known(&lag, sample(TEMPERATURE)), [second >= 30; SENSORS], "after {second} s");
            // What is not known is handed over as that.
            let mut next = fixed();
            next.restore(lag.state());
            assert_eq!(known(&next, sample(TEMPERATURE)), [second >= 30; SENSORS], "after {second} s");
        }
        // An IMU without gyroscopes sends none.
        lag.restore(&Lag::default());
        lag.follow(&RawSample { telemetry_ns: 1, ..sample(0.0) });
        assert_eq!(filled(&lag, sample(0.0)).gyroscopes, Triad::default());
        lag.soak();
        lag.follow(&RawSample { telemetry_ns: 1, ..sample(TEMPERATURE) });
        assert_eq!(known(&lag, sample(TEMPERATURE)), [true; SENSORS], "the application says that it is soaked");
    }

    #[test]
    fn readings_of_another_start_of_the_machine_are_unknown() {
        let mut lag = soaked();
        let (kept, own) = (sample(TEMPERATURE), *lag.state());
        assert_eq!(own.boot, boot());
        lag.follow(&RawSample { telemetry_ns: 1, ..kept });
        let mut saved = *lag.state();
        for (number, known_then) in [(own.boot, true), (0, true), (own.boot ^ 1, false), (u64::MAX, false)] {
            saved.boot = number;
            let mut next = fixed();
            next.restore(&saved);
            next.follow(&RawSample { telemetry_ns: 1_000_000_000, ..kept });
            assert_eq!(known(&next, kept), [known_then; SENSORS], "{number}");
            assert_eq!(next.state().boot, own.boot);
        }
        lag.reset();
        assert_eq!(lag.state().boot, own.boot);
    }

    #[test]
    fn a_kept_reading_of_another_clock_or_of_no_value_is_unknown() {
        let reading = |time_ns, lagged| Some(LaggedReading { time_ns, temperature: 2.0, lagged });
        let (mut kept, late) = (Lag::new(0), 1_000_000_000);
        kept.sensors =
            [reading(5, 2.0), reading(late, 2.0), None, reading(5, f64::NAN), reading(5, 2.0), reading(5, 2.0)];
        kept.unknown = [0.0, 0.0, 0.0, 0.0, f64::NAN, -1.0];
        let right = [true, false, false, false, false, false];
        let mut lag = fixed();
        lag.restore(&kept);
        Sensor::NAMES.iter().for_each(|(sensor, _)| lag.read(*sensor as usize, TEMPERATURE, 10));
        assert_eq!(known(&lag, sample(TEMPERATURE)), right);
        lag.restore(&kept);
        lag.follow(&RawSample { timestamp_ns: 10, ..sample(TEMPERATURE) });
        assert_eq!(known(&lag, sample(TEMPERATURE)), right);
        // Later the clock is the acquisition's own: a reading of an earlier time keeps L.
        lag.read(Sensor::A1 as usize, TEMPERATURE, 7);
        assert_eq!(known(&lag, sample(TEMPERATURE)), right);
    }
}
