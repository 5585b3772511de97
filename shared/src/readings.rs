//! Readings in, increments out: from m/s2 and rad/s to the pulses of a sample, and from an increment back to them.
//!
//! # Formula
//! A reading is the mean specific force or rate over the sample's own control period Ts. A pulse is `resolution` over
//! the nominal interval T. With the remainder r that the last sample left, which is 0 at first, a sample has
//!
//! ```text
//! x = reading * Ts / (resolution * T) + r
//! N = round(x)                              positive channel if N > 0, negative channel if N < 0
//! r = x - N                                 at most half a pulse; for the next sample
//! ```
//! So the sum of all pulses differs from the integral of all readings by at most half a pulse, however long it runs.
//! The arithmetic has twice the digits of a double: its rounding adds up to far less than a pulse in years.
//!
//! A sample usually has Ts = T. One with another Ts, such as the measured interval or that of k samples in one, gives
//! the integral over that Ts, so that its increment is right too, and samples can be summed
//! ([`RawSample::merge`]). The table that belongs to it is [`nominal_table`](crate::table::nominal_table).

use crate::units::SensorKind;
use crate::wire::{AXES, CompensatedIncrement, MAX_INTERVAL_NS, RawSample, SENSORS, Triad};

/// Accepted range of a resolution \[m/s2 or rad/s\].
pub const RESOLUTION_RANGE: [f64; 2] = [1e-15, 1e6];

/// What one pulse over the nominal interval stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// Of the accelerometers \[m/s2\].
    pub accelerometer: f64,
    /// Of the gyroscopes \[rad/s\].
    pub gyroscope: f64,
}

/// 1e-6 m/s2 and 1e-7 rad/s: far below the noise of a MEMS sensor, and up to 4294 m/s2 and 429 rad/s in one sample.
impl Default for Resolution {
    fn default() -> Self {
        Self { accelerometer: 1e-6, gyroscope: 1e-7 }
    }
}

/// Why readings cannot become pulses. The sample and the remainders have not been changed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ReadingError {
    /// A reading is NaN or infinite.
    #[error("{sensor}: the reading is {reading}; leave the sample out, which readers see as a gap")]
    NotFinite {
        /// A1 to G3.
        sensor: &'static str,
        /// The reading.
        reading: f64,
    },
    /// A reading is more pulses than a channel of a sample can have.
    #[error("{sensor}: the reading {reading} is over {} pulses in this sample; give a larger resolution", u32::MAX)]
    OutOfRange {
        /// A1 to G3.
        sensor: &'static str,
        /// The reading \[m/s2 or rad/s\].
        reading: f64,
    },
    /// A nominal or own interval is 0 or over an hour.
    #[error("the interval is {0} ns; give 1 to {MAX_INTERVAL_NS}")]
    Interval(u64),
    /// The acquisition has connected without a resolution.
    #[error("the acquisition sends no readings: connect with the resolution in its options")]
    NoResolution,
    /// A resolution is outside of its range.
    #[error("the resolution is {0:?}; give 1e-15 to 1e6 m/s2 or rad/s")]
    Resolution(f64),
}

/// Turns the readings of one IMU into pulses, sample after sample.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::compensate::answer;
/// use isotherm_shared::readings::{Readings, Resolution};
/// use isotherm_shared::table::{Nominal, nominal_table};
/// use isotherm_shared::wire::RawSample;
///
/// let interval_ns = 2_500_000;
/// let mut readings = Readings::new(Resolution::default(), interval_ns);
/// let mut raw = RawSample::default();
/// raw.accelerometers.head_temperature = [31.2; 3]; // degC
/// raw.accelerometers.board_temperature = [31.2; 3];
/// readings.fill(&mut raw, [0.12, -0.3, 9.81], None)?; // m/s2
/// assert_eq!(raw.accelerometers.positive_pulses, [120_000, 0, 9_810_000]);
/// assert_eq!(raw.accelerometers.negative_pulses, [0, 300_000, 0]);
///
/// let table = nominal_table(&Nominal::new("imu-a".parse()?, interval_ns, [-40.0, 85.0]))?;
/// let specific_force = answer(Some(&table), &raw).specific_force(); // m/s2
/// assert!((specific_force[2] - 9.81).abs() < 1e-9);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readings {
    /// What one pulse over the nominal interval stands for; each within [`RESOLUTION_RANGE`].
    pub resolution: Resolution,
    /// The nominal interval between two samples \[ns\], that of the table; 1..=[`MAX_INTERVAL_NS`].
    pub interval_ns: u64,
    /// What rounding has left of A1 to G3 \[pulse\], at most half a pulse; anything else counts as 0.
    pub remainders: [f64; SENSORS],
}

impl Readings {
    /// Without remainders. `interval_ns` is the nominal interval \[ns\].
    #[must_use]
    pub const fn new(resolution: Resolution, interval_ns: u64) -> Self {
        Self { resolution, interval_ns, remainders: [0.0; SENSORS] }
    }

    /// Writes the pulses of a sample: `specific_force` \[m/s2\] along A1, A2, A3, and `angular_rate` \[rad/s\] about
    /// G1, G2, G3, each the mean over the sample's interval. Without `angular_rate` the gyroscopes become
    /// [`Triad::ABSENT`].
    ///
    /// An `interval_ns` of 0 becomes the nominal interval. Another one is kept, and the pulses are those of that
    /// interval. All other fields stay.
    ///
    /// # Errors
    /// A reading that is not finite, or over `u32::MAX` pulses; a resolution or an interval outside of its range.
    /// Nothing is written or carried then.
    pub fn fill(
        &mut self,
        raw: &mut RawSample,
        specific_force: [f64; AXES],
        angular_rate: Option<[f64; AXES]>,
    ) -> Result<(), ReadingError> {
        let interval_ns = if raw.interval_ns == 0 { self.interval_ns } else { raw.interval_ns };
        let (nominal, ts) = (checked_interval(self.interval_ns)?, checked_interval(interval_ns)?);
        let pulse = |resolution| Ok(Product::of(checked_resolution(resolution)?, nominal));
        let (accelerometer, gyroscope) = (pulse(self.resolution.accelerometer)?, pulse(self.resolution.gyroscope)?);
        let [a1, a2, a3, g1, g2, g3] = self.remainders;
        let accelerometers = counted(SensorKind::Accelerometer, specific_force, ts, accelerometer, [a1, a2, a3])?;
        let counted = |rate| counted(SensorKind::Gyroscope, rate, ts, gyroscope, [g1, g2, g3]);
        let gyroscopes = angular_rate.map(counted).transpose()?;
        raw.interval_ns = interval_ns;
        let [a1, a2, a3] = write(&mut raw.accelerometers, accelerometers);
        let [g1, g2, g3] = if let Some(gyroscopes) = gyroscopes {
            write(&mut raw.gyroscopes, gyroscopes)
        } else {
            raw.gyroscopes = Triad::ABSENT;
            [0.0; AXES]
        };
        self.remainders = [a1, a2, a3, g1, g2, g3];
        Ok(())
    }

    /// Forgets the remainders: for a new session, and after a gap.
    pub const fn reset(&mut self) {
        self.remainders = [0.0; SENSORS];
    }
}

impl Triad {
    /// Multiplies the pulses, each to the nearest whole number: for a table of another nominal interval. What becomes
    /// too large becomes the largest.
    pub fn rescale(&mut self, ratio: f64) {
        for pulses in self.positive_pulses.iter_mut().chain(&mut self.negative_pulses) {
            // A double above the range becomes its end.
            *pulses = (f64::from(*pulses) * ratio).round() as u32;
        }
    }
}

impl RawSample {
    /// Makes the sample invalid, where its pulses are not those of the table: every temperature becomes NaN, so that no
    /// increment is computed of it, and it is flagged. Gyroscopes that are absent stay so.
    pub fn invalidate(&mut self) {
        for triad in [&mut self.accelerometers, &mut self.gyroscopes] {
            (triad.head_temperature, triad.board_temperature) = ([f64::NAN; AXES], [f64::NAN; AXES]);
        }
    }
}

impl CompensatedIncrement {
    /// The mean specific force over the interval \[m/s2\], along the axes of the increment; NaN where the increment is
    /// NaN, and for an interval of 0.
    #[must_use]
    pub fn specific_force(&self) -> [f64; AXES] {
        mean(self.velocity_increment, self.interval_ns)
    }

    /// The mean angular rate over the interval \[rad/s\], about the axes of the increment; NaN where the increment is
    /// NaN, and for an interval of 0. Earth's rate is in it.
    #[must_use]
    pub fn angular_rate(&self) -> [f64; AXES] {
        mean(self.angle_increment, self.interval_ns)
    }
}

fn mean(increments: [f64; AXES], interval_ns: u64) -> [f64; AXES] {
    // Some number divided by 0 would be infinite.
    let ts = if interval_ns == 0 { f64::NAN } else { interval_ns as f64 / 1e9 };
    increments.map(|increment| increment / ts)
}

pub(crate) fn checked_resolution(resolution: f64) -> Result<f64, ReadingError> {
    let [least, most] = RESOLUTION_RANGE;
    let within = (least..=most).contains(&resolution);
    if within { Ok(resolution) } else { Err(ReadingError::Resolution(resolution)) }
}

/// The interval as a double, which has all its digits.
pub(crate) fn checked_interval(interval_ns: u64) -> Result<f64, ReadingError> {
    let within = (1..=MAX_INTERVAL_NS).contains(&interval_ns);
    if within { Ok(interval_ns as f64) } else { Err(ReadingError::Interval(interval_ns)) }
}

/// Whole pulses of the sensors of a triad, with their signs, and what remains.
fn counted(
    kind: SensorKind,
    readings: [f64; AXES],
    ts: f64,
    pulse: Product,
    remainders: [f64; AXES],
) -> Result<[(f64, f64); AXES], ReadingError> {
    let mut all = [(0.0, 0.0); AXES];
    for (((counted, sensor), reading), remainder) in all.iter_mut().zip(kind.names()).zip(readings).zip(remainders) {
        if !reading.is_finite() {
            return Err(ReadingError::NotFinite { sensor, reading });
        }
        let remainder = if remainder.abs() <= 0.5 { remainder } else { 0.0 };
        *counted = whole(reading, ts, pulse, remainder).ok_or(ReadingError::OutOfRange { sensor, reading })?;
    }
    Ok(all)
}

/// `reading * ts / pulse + remainder` as a whole number, and what remains; `None` if a channel cannot hold it.
fn whole(reading: f64, ts: f64, pulse: Product, remainder: f64) -> Option<(f64, f64)> {
    let most = f64::from(u32::MAX);
    let integral = Product::of(reading, ts);
    let quotient = integral.high / pulse.high;
    // NaN, which an overflow may give, is not within. One more, since the remainder counts too.
    if !(-most - 1.0..=most + 1.0).contains(&quotient) {
        return None;
    }
    // What the quotient lacks. The fused operation rounds once, so its result is exact.
    let lacking = (-quotient).mul_add(pulse.high, integral.high) + (integral.low - quotient * pulse.low);
    let nearest = quotient.round();
    let rest = (quotient - nearest) + lacking / pulse.high + remainder;
    let pulses = nearest + rest.round();
    (pulses.abs() <= most).then_some((pulses, rest - rest.round()))
}

/// Writes pulses, and returns what remains.
fn write(triad: &mut Triad, counted: [(f64, f64); AXES]) -> [f64; AXES] {
    // A negative number becomes 0 in the positive channel, and a positive one in the negative channel.
    triad.positive_pulses = counted.map(|(pulses, _)| pulses as u32);
    triad.negative_pulses = counted.map(|(pulses, _)| -pulses as u32);
    counted.map(|(_, remainder)| remainder)
}

/// A product of two doubles without rounding: its double, and what that lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Product {
    high: f64,
    low: f64,
}

impl Product {
    fn of(a: f64, b: f64) -> Self {
        let high = a * b;
        Self { high, low: a.mul_add(b, -high) }
    }
}
