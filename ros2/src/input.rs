//! From the messages of a driver to those that an acquisition takes.

use crate::description::InputSettings;
use crate::message::{SensorImu, SensorTemperature};
use crate::stamps::{SmallestDelay, delay_ns};
use isotherm_acquire::DeviceMessage;
use isotherm_client::UnixOffset;
use isotherm_shared::wire::AXES;

/// By how much a stamp of this machine's clock may differ from its arrival, and one of another clock from what the
/// stamps before it show \[ns\].
const NEAR_NS: i64 = 1_000_000_000;

/// What became of a driver's messages.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct InputCounts {
    /// Messages of readings that came.
    pub messages: u64,
    /// The frame is not the described one: not taken.
    pub other_frame: u64,
    /// With a stamp that cannot be: not taken.
    pub absurd_stamp: u64,
    /// For which the acquisition had no room: not taken.
    pub overflow: u64,
    /// Temperatures that came.
    pub temperatures: u64,
    /// Temperatures that are no number, or of another frame: not taken.
    pub bad_temperatures: u64,
    /// Messages that are of another type, or cut.
    pub unreadable: u64,
}

/// Lets the messages of one driver through that can be what they say.
#[derive(Clone, Debug)]
pub struct InputGate {
    frame: Option<String>,
    has_other_clock: bool,
    units: [f64; 2],
    temperature: Option<f64>,
    delay: Option<SmallestDelay>,
    /// What was counted.
    pub counts: InputCounts,
}

impl InputGate {
    /// As described.
    #[must_use]
    pub fn new(settings: &InputSettings) -> Self {
        Self {
            frame: settings.frame.clone(),
            has_other_clock: settings.has_other_clock,
            units: settings.units,
            temperature: None,
            delay: None,
            counts: InputCounts::default(),
        }
    }

    /// Takes a temperature: it counts from the next message on.
    pub fn take_temperature(&mut self, message: &SensorTemperature) {
        self.counts.temperatures += 1;
        // A thermometer often has no frame.
        let is_of_frame = message.header.frame_id.is_empty() || self.is_of_frame(&message.header.frame_id);
        if is_of_frame && message.temperature.is_finite() {
            self.temperature = Some(message.temperature);
        } else {
            self.counts.bad_temperatures += 1;
        }
    }

    /// Takes a message that arrived at this time of `CLOCK_MONOTONIC` \[ns\].
    ///
    /// # Errors
    /// Why it is not taken.
    pub fn take(&mut self, message: &SensorImu, arrived_ns: u64, offset: UnixOffset) -> Result<DeviceMessage, String> {
        self.counts.messages += 1;
        if !self.is_of_frame(&message.header.frame_id) {
            self.counts.other_frame += 1;
            let own = self.frame.as_deref().unwrap_or_default();
            return Err(format!("is of frame {:?}, and frame is {own:?}", message.header.frame_id));
        }
        let stamp_ns = self.stamp_ns(message, arrived_ns, offset).inspect_err(|_| self.counts.absurd_stamp += 1)?;
        // -1: there is no such value.
        let values = |values: [f64; AXES], covariance: &[f64; 9], unit: f64| {
            if covariance[0] == -1.0 { [f64::NAN; AXES] } else { values.map(|value| value * unit) }
        };
        let [acceleration, rate] = self.units;
        Ok(DeviceMessage {
            arrived_ns,
            stamp_ns,
            specific_force: values(
                message.linear_acceleration.into(),
                &message.linear_acceleration_covariance,
                acceleration,
            ),
            angular_rate: values(message.angular_velocity.into(), &message.angular_velocity_covariance, rate),
            temperature: self.temperature.take(),
        })
    }

    fn is_of_frame(&self, frame: &str) -> bool {
        self.frame.as_ref().is_none_or(|own| own == frame)
    }

    /// The stamp on `CLOCK_MONOTONIC`.
    fn stamp_ns(&mut self, message: &SensorImu, arrived_ns: u64, offset: UnixOffset) -> Result<u64, String> {
        let stamp = message.header.stamp;
        if stamp.nanosec >= 1_000_000_000 {
            return Err(format!("has a stamp of {} ns in a second", stamp.nanosec));
        }
        let unix_ns = stamp.unix_ns();
        if !self.has_other_clock {
            let on_monotonic = offset.monotonic_ns(unix_ns);
            let near = on_monotonic
                .filter(|stamp_ns| delay_ns(*stamp_ns, arrived_ns).unsigned_abs() <= NEAR_NS.unsigned_abs());
            let seconds = offset.unix_ns(arrived_ns).saturating_sub(unix_ns) as f64 / 1e9;
            return near.ok_or_else(|| {
                format!("has a stamp of {seconds:.1} s before it came: of another clock? then give clock = \"other\"")
            });
        }
        let stamp_ns = u64::try_from(unix_ns).map_err(|_| "has a stamp before 1970".to_owned())?;
        let smallest = self.delay.get_or_insert_with(|| SmallestDelay::new(stamp_ns, arrived_ns));
        if delay_ns(stamp_ns, arrived_ns).saturating_sub(smallest.least()) > NEAR_NS {
            // The clock was set back, or a recording has begun anew.
            *smallest = SmallestDelay::new(stamp_ns, arrived_ns);
        }
        u64::try_from(smallest.place(stamp_ns, arrived_ns)).map_err(|_| "has a stamp that cannot be placed".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NodeDescription, TimeMessage};
    use std::path::Path;

    const OFFSET: UnixOffset = UnixOffset { offset_ns: 1_700_000_000_000_000_000, uncertainty_ns: 50 };
    const NOW: u64 = 9_000_000_000_000;

    fn gate(keys: &str) -> InputGate {
        let text = format!(
            "format = 1\n[[subscribe]]\nimu = \"imu-a\"\ntopic = \"/driver/imu\"\ntemperature_topic = \"/driver/t\"\n\
             interval_s = 0.01\nframe = \"imu_link\"\n{keys}"
        );
        InputGate::new(&NodeDescription::from_toml(&text, Path::new("")).unwrap().inputs[0])
    }

    fn message(unix_ns: i64) -> SensorImu {
        let mut message = SensorImu::default();
        message.header.frame_id = "imu_link".to_owned();
        message.header.stamp = TimeMessage::of_unix_ns(unix_ns).unwrap();
        message.linear_acceleration = [1.0, 2.0, 3.0].into();
        message
    }

    #[test]
    fn stamps_of_this_machine_are_those_of_the_monotonic_clock() {
        let mut gate = gate("");
        let taken = gate.take(&message(OFFSET.unix_ns(NOW - 1_000)), NOW, OFFSET).unwrap();
        assert_eq!((taken.stamp_ns, taken.arrived_ns, taken.temperature), (NOW - 1_000, NOW, None));
        let mut warm = SensorTemperature { temperature: 31.5, ..SensorTemperature::default() };
        gate.take_temperature(&warm);
        warm.temperature = f64::NAN;
        gate.take_temperature(&warm);
        let next = gate.take(&message(OFFSET.unix_ns(NOW)), NOW + 10, OFFSET).unwrap();
        assert_eq!(next.temperature, Some(31.5));
        assert_eq!(gate.take(&message(OFFSET.unix_ns(NOW + 1)), NOW + 20, OFFSET).unwrap().temperature, None);
        assert_eq!((gate.counts.temperatures, gate.counts.bad_temperatures), (2, 1));
    }

    #[test]
    fn the_units_of_the_driver_become_those_of_the_samples() {
        let mut message = message(OFFSET.unix_ns(NOW));
        message.angular_velocity = [180.0, 0.0, -90.0].into();
        let taken = |keys: &str| {
            let taken = gate(keys).take(&message, NOW, OFFSET).unwrap();
            (taken.specific_force, taken.angular_rate)
        };
        assert_eq!(taken(""), ([1.0, 2.0, 3.0], [180.0, 0.0, -90.0]));
        let (force, rate) = taken("accelerometer_unit = \"g\"\ngyroscope_unit = \"deg/s\"\n");
        assert_eq!(force, [9.80665, 2.0 * 9.80665, 3.0 * 9.80665]);
        assert!((rate[0] - std::f64::consts::PI).abs() < 1e-12 && rate[2] < 0.0, "{rate:?}");
    }

    #[test]
    fn what_cannot_be_is_counted_and_not_taken() {
        let mut gate = gate("");
        let absurd = [
            0,
            i64::from(i32::MIN) * 1_000_000_000,
            OFFSET.unix_ns(NOW) + 1_100_000_000,
            OFFSET.unix_ns(NOW) - 1_100_000_000,
        ];
        for unix_ns in absurd {
            assert!(gate.take(&message(unix_ns), NOW, OFFSET).unwrap_err().contains("stamp"));
        }
        let mut over = message(OFFSET.unix_ns(NOW));
        over.header.stamp.nanosec = u32::MAX;
        assert!(gate.take(&over, NOW, OFFSET).is_err());
        let mut other = message(OFFSET.unix_ns(NOW));
        other.header.frame_id = "camera".to_owned();
        assert!(gate.take(&other, NOW, OFFSET).unwrap_err().contains("camera"));
        assert_eq!((gate.counts.messages, gate.counts.absurd_stamp, gate.counts.other_frame), (6, 5, 1));
        let mut absent = message(OFFSET.unix_ns(NOW));
        absent.angular_velocity_covariance[0] = -1.0;
        assert!(gate.take(&absent, NOW, OFFSET).unwrap().angular_rate[0].is_nan());
    }

    #[test]
    fn another_clock_keeps_its_distances_and_may_be_set_back() {
        let mut gate = gate("clock = \"other\"\n");
        let first = gate.take(&message(77_000_000_000), NOW + 5_000_000, OFFSET).unwrap();
        let second = gate.take(&message(77_010_000_000), NOW + 11_000_000, OFFSET).unwrap();
        let third = gate.take(&message(77_020_000_000), NOW + 29_000_000, OFFSET).unwrap();
        assert_eq!(first.stamp_ns, NOW + 5_000_000);
        // The second one came earlier by 4 ms: the stamps move there by a tenth of the time that passes.
        assert_eq!((second.stamp_ns, third.stamp_ns), (NOW + 14_000_000, NOW + 23_000_000));
        let again = gate.take(&message(70_000_000_000), NOW + 39_000_000, OFFSET).unwrap();
        assert_eq!(again.stamp_ns, NOW + 39_000_000);
        assert_eq!(gate.counts.absurd_stamp, 0);
    }
}
