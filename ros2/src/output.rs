//! From increments to messages.

use crate::covariance::{NoiseDensities, TableErrors, covariance};
use crate::description::{InvalidPolicy, OutputSettings};
use crate::message::{HeaderMessage, SensorImu, SensorTemperature, TimeMessage};
use isotherm_client::{CompensatedIncrement, Flags};
use isotherm_shared::status::ImuStatus;
use isotherm_shared::units::CELSIUS;
use isotherm_shared::wire::AXES;

/// As the first element of a covariance: there is no such value.
const ABSENT: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// What became of the increments of an IMU.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct OutputCounts {
    /// Published.
    pub published: u64,
    /// Not whole, and so not published as numbers.
    pub invalid: u64,
    /// Control periods that were missing before one that came.
    pub missing: u64,
    /// Not published, since the time cannot be put on Unix time.
    pub untimed: u64,
    /// Not taken by the network, since a reliable subscriber did not keep up.
    pub untaken: u64,
}

/// Makes messages of the increments of one IMU.
#[derive(Clone, Debug)]
pub struct ImuComposer {
    frame: String,
    rotation: [[f64; 3]; 3],
    invalid: InvalidPolicy,
    noise: NoiseDensities,
    /// Errors of the table in force.
    pub errors: TableErrors,
}

impl ImuComposer {
    /// As described, with this noise.
    #[must_use]
    pub fn new(settings: &OutputSettings, noise: NoiseDensities) -> Self {
        let OutputSettings { frame, rotation, invalid, .. } = settings.clone();
        Self { frame, rotation, invalid, noise, errors: TableErrors::default() }
    }

    /// The message of an increment, and whether it is whole; no message for one that is left out. Where the table has
    /// no gyroscopes, the message says that it has no angular velocity.
    #[must_use]
    pub fn message(&self, increment: &CompensatedIncrement, stamp: TimeMessage) -> (Option<SensorImu>, bool) {
        let (force, rate) = (increment.specific_force(), increment.angular_rate());
        let has_gyroscopes = has_gyroscopes(increment);
        let is_finite = |values: &[f64; AXES]| values.iter().all(|value| value.is_finite());
        let is_whole = is_finite(&force) && (!has_gyroscopes || is_finite(&rate));
        if !is_whole && self.invalid == InvalidPolicy::Omit {
            return (None, false);
        }
        let covariance = |density, errors| covariance(density, errors, increment.interval_ns, &self.rotation);
        let message = SensorImu {
            header: HeaderMessage { stamp, frame_id: self.frame.clone() },
            orientation_covariance: ABSENT,
            angular_velocity: if has_gyroscopes { self.turned(rate) } else { [0.0; AXES] }.into(),
            angular_velocity_covariance: match has_gyroscopes {
                true => covariance(self.noise.gyroscope, self.errors.gyroscope),
                false => ABSENT,
            },
            linear_acceleration: self.turned(force).into(),
            linear_acceleration_covariance: covariance(self.noise.accelerometer, self.errors.accelerometer),
            ..SensorImu::default()
        };
        (Some(message), is_whole)
    }

    /// A vector in the frame of the messages.
    fn turned(&self, vector: [f64; AXES]) -> [f64; AXES] {
        self.rotation.map(|row| {
            // What is not known of one axis is not known where a part of that axis is; 0 times NaN is NaN.
            let parts = row.iter().zip(vector).filter(|(part, _)| **part != 0.0);
            parts.map(|(part, value)| part * value).fold(0.0, |sum, part| sum + part)
        })
    }

    /// A message of the temperature.
    #[must_use]
    pub fn temperature(&self, temperature: f64, stamp: TimeMessage) -> SensorTemperature {
        let header = HeaderMessage { stamp, frame_id: self.frame.clone() };
        SensorTemperature { header, temperature, variance: 0.0 }
    }
}

/// Whether the table of an increment has gyroscopes: a value is there, or a flag says why none is.
fn has_gyroscopes(increment: &CompensatedIncrement) -> bool {
    let is_absent = increment.angle_increment.iter().all(|angle| angle.is_nan());
    // All flags of sensors, moved to the gyroscopes.
    let causes = Flags((1 << 18) - 1).of_gyroscopes() | Flags::INTERVAL | Flags::NO_TABLE;
    !is_absent || Flags(increment.flags).intersects(causes)
}

/// The temperatures of one IMU that are published: each with the time at which it was read.
#[derive(Clone, Copy, Debug, Default)]
pub struct TemperatureOutput {
    received: u64,
    read_ns: u64,
}

impl TemperatureOutput {
    /// The temperature of a status that was taken at `taken_ns`, and when it was read, on the same clock \[ns\]. That
    /// is the time of the status where the acquisition does not give it, and never earlier than that of the status
    /// before. `None` if no sample has come since then, or if the temperature is stale: an old one has no new stamp.
    pub fn next(&mut self, imu: &ImuStatus, taken_ns: u64) -> Option<(f64, u64)> {
        let has_sample = imu.received != std::mem::replace(&mut self.received, imu.received) && imu.rate_hz > 0;
        let temperature = temperature_of(imu).filter(|_| has_sample && !imu.temperature_stale)?;
        let age_ns = imu.temperature_age_s.map_or(0, |age_s| (age_s * 1e9) as u64);
        self.read_ns = self.read_ns.max(taken_ns.saturating_sub(age_ns));
        Some((temperature, self.read_ns))
    }
}

/// The mean temperature of the accelerometers' heads, if it is in degrees Celsius.
fn temperature_of(imu: &ImuStatus) -> Option<f64> {
    let is_celsius = imu.ranges.as_ref().is_some_and(|ranges| CELSIUS.contains(&ranges.unit.as_str()));
    let known: Vec<f64> = imu.head_temperature.iter().flatten().copied().collect();
    (is_celsius && !known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::OutputSettings;

    fn increment() -> CompensatedIncrement {
        CompensatedIncrement {
            interval_ns: 2_500_000,
            velocity_increment: [0.0025, -0.005, 0.025],
            angle_increment: [1e-3, 2e-3, 3e-3],
            ..CompensatedIncrement::default()
        }
    }

    fn composer(invalid: InvalidPolicy) -> ImuComposer {
        let rotation = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]];
        let own = OutputSettings::new("imu-a".parse().unwrap());
        ImuComposer::new(&OutputSettings { rotation, invalid, ..own }, NoiseDensities::default())
    }

    #[test]
    fn values_are_increments_over_their_interval_in_the_frame_of_the_messages() {
        let (message, is_whole) =
            composer(InvalidPolicy::Omit).message(&increment(), TimeMessage { sec: 5, nanosec: 7 });
        let message = message.unwrap();
        let near = |found: [f64; 3], expected: [f64; 3]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(is_whole && near(message.linear_acceleration.into(), [-2.0, 1.0, -10.0]));
        assert!(near(message.angular_velocity.into(), [0.8, 0.4, -1.2]));
        assert_eq!((message.header.frame_id.as_str(), message.header.stamp.sec), ("imu_a", 5));
        assert_eq!((message.orientation_covariance, message.angular_velocity_covariance), (ABSENT, [0.0; 9]));
    }

    /// The status of an IMU in degrees Celsius.
    pub(crate) fn status(received: u64, temperature_age_s: Option<f64>, temperature_stale: bool) -> ImuStatus {
        let ranges = [[-40.0, 85.0]; 3];
        let document = serde_json::json!({
            "id": "imu-a", "table_file": "", "ranges": { "unit": "degC", "head": ranges, "board": ranges },
            "head_temperature": [25.0, 26.0, 27.0], "board_temperature": [null, null, null], "received": received,
            "rate_hz": 100, "compensated": received, "gaps": 0, "missing": 0, "repeats": 0, "sessions": 1,
            "transport_errors": 0, "flagged": {}, "reloads": 0, "refusals": 0,
            "latency_distribution": { "counts": [], "sum_s": 0.0 }, "acquisition_connected": true, "readers": 1,
            "temperature_age_s": temperature_age_s, "temperature_stale": temperature_stale,
        });
        serde_json::from_value(document).unwrap()
    }

    #[test]
    fn a_temperature_has_the_time_at_which_it_was_read_and_none_if_it_is_stale() {
        const SECOND: u64 = 1_000_000_000;
        let mut output = TemperatureOutput::default();
        let mut next =
            |received, age_s, is_stale, second: u64| output.next(&status(received, age_s, is_stale), second * SECOND);
        assert_eq!(next(1, Some(2.0), false, 100), Some((26.0, 98 * SECOND)));
        assert_eq!(next(1, Some(2.0), false, 101), None, "no sample has come");
        assert_eq!(next(2, Some(3.5), false, 101), Some((26.0, 98 * SECOND)), "a stamp does not go back");
        assert_eq!(next(3, Some(1.0), false, 102), Some((26.0, 101 * SECOND)));
        assert_eq!(next(4, Some(6.0), true, 107), None);
        assert_eq!(next(5, None, false, 108), Some((26.0, 108 * SECOND)), "the acquisition does not say when");
    }

    #[test]
    fn what_is_not_known_is_left_out_or_nan_and_never_a_number() {
        let bad = CompensatedIncrement { velocity_increment: [0.0025, f64::NAN, 0.025], ..increment() };
        assert_eq!(composer(InvalidPolicy::Omit).message(&bad, TimeMessage::default()), (None, false));
        let (message, is_whole) = composer(InvalidPolicy::Nan).message(&bad, TimeMessage::default());
        let force: [f64; 3] = message.unwrap().linear_acceleration.into();
        assert!(!is_whole && force[0].is_nan() && force[1] == 1.0 && force[2] == -10.0, "{force:?}");
        let no_interval = CompensatedIncrement { interval_ns: 0, ..increment() };
        assert_eq!(composer(InvalidPolicy::Omit).message(&no_interval, TimeMessage::default()), (None, false));
    }

    #[test]
    fn a_table_without_gyroscopes_has_no_angular_velocity_and_one_whose_gyroscopes_fail_is_not_whole() {
        let absent = CompensatedIncrement { angle_increment: [f64::NAN; 3], ..increment() };
        let (message, is_whole) = composer(InvalidPolicy::Omit).message(&absent, TimeMessage::default());
        let message = message.unwrap();
        assert!(is_whole && message.angular_velocity == [0.0; 3].into());
        assert_eq!(message.angular_velocity_covariance, ABSENT);
        let failed = CompensatedIncrement { flags: 0b111 << (32 + 12), ..absent };
        assert_eq!(composer(InvalidPolicy::Omit).message(&failed, TimeMessage::default()), (None, false));
    }
}
