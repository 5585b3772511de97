//! Readings that another part of the program receives as messages, as those of a robot's network.
//!
//! They become samples by the rules of every other source: their stamps say which control periods are missing and which
//! message is the one before once more, or straighten the times where a driver stamps what it has just received.

use crate::description::{Description, Kind, Timing};
use crate::frames::FrameArrival;
use crate::intake::{Intake, RowArrival};
use crate::message_queue::{MessageQueue, MessageStamps};
use crate::number::Value;
use crate::sample::{Axes, Columns, TemperatureColumns};
use isotherm_client::{ImuId, RawSample, Realtime, Resolution, device};
use isotherm_recording_formats::convert::{ColumnRef, Kind as Count, Linear, SensorColumns, Sensors, Temperature};
use isotherm_shared::wire::AXES;

/// The places of a row: accelerometers, gyroscopes, temperature.
const COLUMNS: [&str; 2 * AXES + 1] = ["ax", "ay", "az", "gx", "gy", "gz", "temperature"];
const TEMPERATURE: usize = 2 * AXES;

/// How messages become samples.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageSettings {
    /// The IMU.
    pub imu: ImuId,
    /// Serial number of the device.
    pub serial: Option<String>,
    /// The nominal interval \[ns\].
    pub interval_ns: u64,
    /// What a pulse stands for over that interval; that of the table.
    pub resolution: Resolution,
    /// What the stamps are.
    pub stamps: MessageStamps,
    /// Whether the device has gyroscopes.
    pub has_gyroscopes: bool,
    /// Whether its accelerometers feel gravity, so that the length of the first accelerations shows a wrong unit.
    pub has_gravity: bool,
    /// The temperature of all samples; `None`: messages have it.
    pub temperature: Option<f64>,
    /// What the temperature of messages is called in reports, such as its topic.
    pub temperature_name: String,
    /// The age at which the temperature of messages is stale \[s\], which may be infinite; `None`: by its pace.
    pub temperature_max_age_s: Option<f64>,
}

/// The messages as a source of rows.
pub(crate) struct Messages {
    queue: MessageQueue,
    stamps: MessageStamps,
}

impl Messages {
    pub(crate) fn new(queue: &MessageQueue, stamps: MessageStamps) -> Self {
        Self { queue: queue.clone(), stamps }
    }

    pub(crate) const fn queue(&self) -> &MessageQueue {
        &self.queue
    }

    pub(crate) fn is_stamped(&self) -> bool {
        self.stamps == MessageStamps::Sample
    }

    /// Gives what waits to the intake.
    pub(crate) fn read(&self, intake: &mut Intake, sink: &mut dyn FnMut(RawSample, u64)) {
        while let Some(message) = self.queue.pop() {
            let mut row = [Value::ABSENT; COLUMNS.len()];
            let values = message.specific_force.into_iter().chain(message.angular_rate).chain(message.temperature);
            for (place, value) in row.iter_mut().zip(values) {
                *place = Value::real(value);
            }
            let (came_ns, stamp) = match self.stamps {
                MessageStamps::Sample => (message.arrived_ns, Some(message.stamp_ns)),
                MessageStamps::Arrival => (message.stamp_ns, None),
            };
            let arrival = Some(FrameArrival { after_ns: came_ns, by_ns: came_ns });
            intake.take(&row, RowArrival { arrival, stamp, ..RowArrival::default() }, sink);
        }
    }
}

impl Description {
    /// The description of a device whose messages come through `queue`.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_acquire::{Description, MessageQueue, MessageSettings, MessageStamps};
    /// use isotherm_client::Resolution;
    ///
    /// let settings = MessageSettings {
    ///     imu: "imu-a".parse()?,
    ///     serial: None,
    ///     interval_ns: 2_500_000,
    ///     resolution: Resolution::default(),
    ///     stamps: MessageStamps::Sample,
    ///     has_gyroscopes: true,
    ///     has_gravity: true,
    ///     temperature: None,
    ///     temperature_name: "temperature".to_owned(),
    ///     temperature_max_age_s: None,
    /// };
    /// let description = Description::of_messages(settings, &MessageQueue::default());
    /// assert_eq!(description.summary(), "source of imu-a: messages, accelerometers and gyroscopes at 400 Hz");
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn of_messages(settings: MessageSettings, queue: &MessageQueue) -> Self {
        let MessageSettings { imu, serial, interval_ns, resolution, stamps, has_gyroscopes, temperature, .. } =
            settings;
        let mut names = COLUMNS.map(str::to_owned).to_vec();
        names[TEMPERATURE] = settings.temperature_name;
        let axes = |first: usize| Axes {
            columns: std::array::from_fn(|axis| first + axis),
            offset: 0.0,
            sign: [1.0; AXES],
            is_reading: true,
        };
        let sensors = |first: usize, resolution: f64| Sensors {
            columns: std::array::from_fn(|axis| ColumnRef::Name(COLUMNS[first + axis].to_owned())),
            negative: None,
            gate_s: None,
            kind: Count::Reading,
            offset: 0.0,
            resolution: Some(resolution),
            sign: [1.0; AXES],
            unit: Some(1.0),
            range: None,
            duration: None,
        };
        let place = || vec![ColumnRef::Name(names[TEMPERATURE].clone())];
        let linear = Linear { scale: 1.0, offset: 0.0 };
        let all = [TEMPERATURE; 2 * AXES];
        Self {
            kind: Kind::Messages(queue.clone(), stamps),
            timing: Timing { interval_ns, counter: None, latency: None, clock: None, pulses: None },
            columns: Columns {
                accelerometer: axes(0),
                gyroscope: has_gyroscopes.then(|| axes(AXES)),
                temperature: temperature.map_or(
                    TemperatureColumns::Columns { head: all, board: all, linear },
                    TemperatureColumns::Constant,
                ),
                status: None,
                resolution,
                interval_ns,
                device: serial.as_deref().map_or(0, device),
            },
            has_gravity: settings.has_gravity,
            identity: None,
            setup: Vec::new(),
            sensors: SensorColumns {
                accelerometer: sensors(0, resolution.accelerometer),
                gyroscope: has_gyroscopes.then(|| sensors(AXES, resolution.gyroscope)),
                temperature: temperature.map_or_else(
                    || Temperature::Columns { head: place(), board: place(), linear: Some(linear) },
                    Temperature::Constant,
                ),
                temperature_max_age_s: settings.temperature_max_age_s,
            },
            names,
            realtime: Realtime::default(),
            spin: false,
            reopen_after: None,
            imu,
            serial,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message_queue::DeviceMessage;
    use isotherm_support::failure::Exit;

    const INTERVAL: u64 = 2_500_000;
    const BEGIN: u64 = 1_000_000_000_000;

    fn settings() -> MessageSettings {
        MessageSettings {
            imu: "imu-a".parse().unwrap(),
            serial: None,
            interval_ns: INTERVAL,
            resolution: Resolution::default(),
            stamps: MessageStamps::Sample,
            has_gyroscopes: true,
            has_gravity: true,
            temperature: Some(25.0),
            temperature_name: "temperature".to_owned(),
            temperature_max_age_s: None,
        }
    }

    /// The samples of messages that come at these times with these stamps, and how many sessions they have.
    fn samples(messages: impl Iterator<Item = [u64; 2]>) -> (Vec<RawSample>, u64) {
        let queue = MessageQueue::default();
        let description = Description::of_messages(settings(), &queue);
        let source = Messages::new(&queue, MessageStamps::Sample);
        let mut intake = Intake::new(&description, 0.0, true);
        let mut samples = Vec::new();
        for [arrived_ns, stamp_ns] in messages {
            let message = DeviceMessage {
                arrived_ns,
                stamp_ns,
                specific_force: [0.0, 0.0, 9.8],
                angular_rate: [0.0; AXES],
                temperature: None,
            };
            assert!(queue.push(message));
            source.read(&mut intake, &mut |raw, _| samples.push(raw));
        }
        intake.settle(&mut |raw, _| samples.push(raw));
        (samples, intake.tally.sessions)
    }

    /// Anybody in the network may have sent them.
    #[test]
    fn messages_at_another_rate_end_it_for_now() {
        let queue = MessageQueue::default();
        let description = Description::of_messages(settings(), &queue);
        let source = Messages::new(&queue, MessageStamps::Sample);
        let mut intake = Intake::new(&description, 0.0, true);
        let refused = (0..200).find_map(|number: u64| {
            let stamp_ns = BEGIN + number * 2 * INTERVAL;
            let [specific_force, angular_rate] = [[0.0, 0.0, 9.8], [0.0; AXES]];
            let arrived_ns = stamp_ns;
            let message = DeviceMessage { arrived_ns, stamp_ns, specific_force, angular_rate, temperature: None };
            assert!(queue.push(message));
            source.read(&mut intake, &mut |_, _| {});
            intake.judge().err()
        });
        assert_eq!(refused.unwrap().exit, Exit::Temporary);
    }

    #[test]
    fn messages_that_have_waited_and_come_together_are_samples_of_one_session() {
        // All at once after a time, a group at a time, or only the first ones.
        for (first, group) in [(3, 400), (88, 400), (200, 400), (400, 400), (400, 88), (0, 40)] {
            let messages = (0..400).map(|number| {
                let arrived = match number < first {
                    true => BEGIN + first * INTERVAL + number * 2_000 + number / group * 500_000,
                    false => BEGIN + (number / group + 1) * group * INTERVAL + number,
                };
                [arrived, BEGIN + number * INTERVAL]
            });
            let (samples, sessions) = samples(messages);
            assert_eq!((samples.len(), sessions), (400, 1), "{first}, {group}");
            for (number, sample) in (0..).zip(&samples) {
                assert_eq!([sample.sequence, sample.timestamp_ns], [number, BEGIN + number * INTERVAL]);
            }
        }
    }
}
