//! Increments as ROS messages in MCAP: `sensor_msgs/msg/Imu`, and `sensor_msgs/msg/Temperature` where the temperature
//! is in degC.
//!
//! An increment over its interval is a mean: `linear_acceleration = velocity_increment / interval` \[m/s2\], the
//! specific force, and `angular_velocity = angle_increment / interval` \[rad/s\]. The stamp is the end of the interval
//! on the acquisition's clock. A metadata record `isotherm.table` names each table that computed increments.

use super::container::McapContainer;
use super::growing::Appender;
use super::publication::PublicationClock;
use crate::ros::{IMU, IMU_DEFINITION, ImuMessage, TEMPERATURE, TEMPERATURE_DEFINITION, TemperatureMessage};
use isotherm_recording::columns::Layout;
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::CELSIUS;
use isotherm_shared::wire::{AXES, CompensatedIncrement, RawSample, StreamSample};
use isotherm_support::storage::Storage;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// Name of the metadata record of a table.
const TABLE: &str = "isotherm.table";

/// A table that may have computed the increments.
#[derive(Clone, Debug)]
pub struct RosTable {
    imu: ImuId,
    id: u64,
    digest: String,
    file: String,
    is_celsius: bool,
}

impl RosTable {
    /// A table and the path of its file, whose name is written; empty if it is not known.
    #[must_use]
    pub fn new(table: &CoefficientTable, file: &Path) -> Self {
        let content = table.content();
        Self {
            imu: content.imu.clone(),
            id: table.id(),
            digest: table.digest().to_string(),
            file: file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            is_celsius: CELSIUS.contains(&content.temperature_unit.as_str()),
        }
    }

    /// The IMU that it is of.
    #[must_use]
    pub const fn imu(&self) -> &ImuId {
        &self.imu
    }

    /// Whether its temperature is in degC, and becomes messages.
    #[must_use]
    pub const fn is_celsius(&self) -> bool {
        self.is_celsius
    }
}

/// Writes increments of IMUs as ROS messages into any sink.
pub struct RosWriter<W: Write> {
    container: McapContainer,
    sink: W,
    tables: Vec<RosTable>,
    imus: Vec<RosImu>,
    message: Vec<u8>,
}

/// The channels of an IMU.
struct RosImu {
    /// Index in the caller's list.
    index: usize,
    id: ImuId,
    imu: u16,
    temperature: Option<u16>,
    sequence: [u32; 2],
    /// The table of the last increment.
    table: Option<u64>,
    clock: PublicationClock,
}

/// The namespace of an IMU's topics: names of ROS have no `-` and do not begin with a digit.
fn namespace(imu: &ImuId) -> String {
    let name = imu.as_str().replace('-', "_");
    if name.starts_with(|letter: char| letter.is_ascii_digit()) { format!("imu_{name}") } else { name }
}

/// Refuses IMUs that would have the same topics in one file, such as `imu-a` and `imu_a`.
///
/// # Errors
/// With the two IMUs and the remedy.
pub fn refuse_same_topics<'a>(imus: impl IntoIterator<Item = &'a ImuId>) -> Result<(), String> {
    let mut known: BTreeMap<String, &ImuId> = BTreeMap::new();
    for imu in imus {
        let space = namespace(imu);
        if let Some(other) = known.get(&space) {
            return Err(format!(
                "{other} and {imu} would both have the topics /{space}/..; record them into separate files"
            ));
        }
        known.insert(space, imu);
    }
    Ok(())
}

impl<W: Write> RosWriter<W> {
    /// Adds the channels of these IMUs, each with its index in the rows. `tables` are those that may have computed the
    /// increments. An IMU that has one in degC has a channel of temperatures.
    ///
    /// # Errors
    /// Those of the sink; [`InvalidInput`](io::ErrorKind::InvalidInput) as [`refuse_same_topics`].
    pub fn new(sink: W, imus: &[(usize, &ImuId)], tables: &[RosTable]) -> io::Result<Self> {
        refuse_same_topics(imus.iter().map(|(_, id)| *id))
            .map_err(|message| io::Error::new(io::ErrorKind::InvalidInput, message))?;
        let mut container = McapContainer::new("ros2");
        // As rosbag2 writes it: no quality of service is known.
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let mut channel = |name: &str, definition: &str, topic: &str| {
            let schema = container.add_schema(name, "ros2msg", definition.as_bytes())?;
            container.add_channel(schema, topic, "cdr", &metadata)
        };
        let imus = imus.iter().map(|&(index, id)| {
            let space = namespace(id);
            let imu = channel(IMU, IMU_DEFINITION, &format!("/{space}/data_raw"))?;
            let temperature = match tables.iter().any(|table| table.imu == *id && table.is_celsius) {
                true => Some(channel(TEMPERATURE, TEMPERATURE_DEFINITION, &format!("/{space}/temperature"))?),
                false => None,
            };
            Ok(RosImu {
                index,
                id: id.clone(),
                imu,
                temperature,
                sequence: [0; 2],
                table: None,
                clock: PublicationClock::default(),
            })
        });
        let imus = imus.collect::<io::Result<_>>()?;
        Ok(Self { container, sink, tables: tables.to_vec(), imus, message: Vec::new() })
    }

    /// Writes a row: an increment as an Imu, the head temperature of a raw sample as a Temperature.
    ///
    /// # Errors
    /// Those of the sink; if the time is after 2038, which ROS cannot say.
    pub fn write(&mut self, row: &RecordedRow) -> io::Result<()> {
        match &row.sample {
            StreamSample::Increment(increment) => self.increment(row, increment),
            StreamSample::Raw(raw) => self.temperature(row, raw),
        }
    }

    fn increment(&mut self, row: &RecordedRow, increment: &CompensatedIncrement) -> io::Result<()> {
        let Some(imu) = self.imus.iter_mut().find(|imu| imu.index == row.imu) else { return Ok(()) };
        if imu.table.replace(increment.table) != Some(increment.table) {
            let known = self.tables.iter().find(|table| table.imu == imu.id && table.id == increment.table);
            self.container.write_metadata(TABLE, &metadata(&imu.id, increment.table, known));
        }
        let seconds = increment.interval_ns as f64 / 1e9;
        let mean = |over: [f64; AXES]| over.map(|value| value / seconds);
        let has_gyroscopes = Layout::of(&StreamSample::Increment(*increment)).gyroscopes;
        let message = ImuMessage {
            stamp_ns: increment.timestamp_ns,
            frame_id: imu.id.to_string(),
            angular_velocity: has_gyroscopes.then(|| mean(increment.angle_increment)),
            linear_acceleration: Some(mean(increment.velocity_increment)),
        };
        self.message.clear();
        message.encode(&mut self.message).map_err(|message| io::Error::new(io::ErrorKind::InvalidData, message))?;
        imu.sequence[0] = imu.sequence[0].wrapping_add(1);
        let header = MessageHeader {
            channel_id: imu.imu,
            sequence: imu.sequence[0],
            log_time: row.recorded_ns,
            publish_time: imu.clock.time_ns(row, increment.timestamp_ns),
        };
        self.container.write(&header, &self.message);
        self.pass_on()
    }

    /// Writes the mean of the three heads. The stamp is when they were read, where the sample says that.
    fn temperature(&mut self, row: &RecordedRow, raw: &RawSample) -> io::Result<()> {
        let Some(imu) = self.imus.iter_mut().find(|imu| imu.index == row.imu) else { return Ok(()) };
        let Some(channel_id) = imu.temperature else { return Ok(()) };
        let stamp_ns = match raw.temperature_time_ns() {
            0 => raw.timestamp_ns,
            temperature_ns => temperature_ns,
        };
        let heads = raw.accelerometers.head_temperature;
        let celsius = heads[0] + ((heads[1] - heads[0]) + (heads[2] - heads[0])) / AXES as f64;
        self.message.clear();
        TemperatureMessage { stamp_ns, frame_id: imu.id.to_string(), celsius }
            .encode(&mut self.message)
            .map_err(|message| io::Error::new(io::ErrorKind::InvalidData, message))?;
        imu.sequence[1] = imu.sequence[1].wrapping_add(1);
        let publish_time = imu.clock.time_ns(row, stamp_ns);
        let header = MessageHeader { channel_id, sequence: imu.sequence[1], log_time: row.recorded_ns, publish_time };
        self.container.write(&header, &self.message);
        self.pass_on()
    }

    /// Ends the chunk.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn flush(&mut self) -> io::Result<()> {
        self.container.end_chunk();
        self.pass_on()?;
        self.sink.flush()
    }

    /// Writes summary and footer.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn end(&mut self) -> io::Result<()> {
        self.container.finish();
        self.pass_on()?;
        self.sink.flush()
    }

    /// Writes summary and footer, and returns the sink.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn finish(mut self) -> io::Result<W> {
        self.end()?;
        Ok(self.sink)
    }

    fn pass_on(&mut self) -> io::Result<()> {
        self.sink.write_all(&self.container.take())
    }
}

/// What is known of a table.
fn metadata(imu: &ImuId, table: u64, known: Option<&RosTable>) -> BTreeMap<String, String> {
    let mut texts =
        BTreeMap::from([("imu".to_owned(), imu.to_string()), ("table".to_owned(), format!("{table:016x}"))]);
    if let Some(known) = known {
        texts.insert("digest".to_owned(), known.digest.clone());
        if !known.file.is_empty() {
            texts.insert("file".to_owned(), known.file.clone());
        }
    }
    texts
}

/// A file of ROS messages that grows only by complete flushes.
pub(super) type RosFile = RosWriter<Appender>;

impl RosFile {
    /// Creates a file with the channels of these IMUs.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(super) fn create(
        storage: &dyn Storage,
        path: &Path,
        imus: &[(usize, &ImuId)],
        tables: &[RosTable],
    ) -> io::Result<Self> {
        let mut begun = RosWriter::new(Vec::new(), imus, tables)?;
        begun.flush()?;
        let sink = Appender::create(storage, path, &begun.sink)?;
        Ok(Self { container: begun.container, sink, tables: begun.tables, imus: begun.imus, message: Vec::new() })
    }

    /// Size without the open chunk \[bytes\].
    pub(super) fn size(&self) -> u64 {
        self.sink.size()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imus_with_the_same_topics_are_refused() {
        let refused = |names: [&str; 2]| {
            let imus = names.map(|name| name.parse::<ImuId>().unwrap());
            RosWriter::new(Vec::new(), &[(0, &imus[0]), (1, &imus[1])], &[]).err().map(|error| error.to_string())
        };
        assert_eq!(
            refused(["imu-a", "imu_a"]).unwrap(),
            "imu-a and imu_a would both have the topics /imu_a/..; record them into separate files"
        );
        assert!(refused(["1", "imu_1"]).unwrap().starts_with("1 and imu_1 would"));
        assert_eq!(refused(["imu-a", "imu-b"]), None);
    }
}
