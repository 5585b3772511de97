//! `sensor_msgs/msg/Imu` in MCAP, as rosbag2 writes it, and converted bags of ROS 1.
//!
//! The time is that of `header.stamp`, unless the time of the log is wanted. The temperature of a row is that of the
//! last `sensor_msgs/msg/Temperature` up to its time; so the file is read twice, first for the topics and the
//! temperatures. Where the stamps of the temperatures are of no use for the rows, it is the last one that was recorded.

use super::joined::JoinedSource;
use super::recorded::{EvenSample, JoinedTemperatures, MessageTimes, TimedTemperature};
use super::settings::{Settings, TimeSource};
use super::stream::RowStream;
use super::unit::Quantity;
use crate::read::records::Records;
use crate::read::skip::ChannelFilter;
use crate::ros::{Encoding, IMU, ImuMessage, TEMPERATURE, TemperatureMessage};
use isotherm_recording::RecordingError;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, OpenData, PLACEHOLDER, placeholder, pulses};
use isotherm_shared::readings::Resolution;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, name};
use isotherm_support::source::DataSource;
use mcap::records::Record;
use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::Path;
use std::rc::Rc;

/// One pulse \[m/s2 or rad/s\].
const RESOLUTION: f64 = 1e-6;
/// With what the schemas of Isotherm begin.
const OWN: &str = "isotherm.";
/// Most topics that a message lists.
const LISTED: usize = 40;

/// Rows of the messages of a topic.
pub(super) struct RosSource {
    messages: BagMessages,
    topic: String,
    time: TimeSource,
    /// Which of the readings are wanted.
    wanted: SensorChoice,
    gyroscopes: bool,
    /// The first row, which has been read already.
    first: Option<ForeignRow>,
    temperature: Option<f64>,
    temperatures: Temperatures,
    /// One of the messages' unit of accelerations \[m/s2\] and of rates \[rad/s\].
    units: [f64; 2],
}

/// Which readings of the messages are wanted. A topic of only accelerometers or gyroscopes has zeros for the others.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum SensorChoice {
    All,
    Accelerometers,
    Gyroscopes,
}

/// The topics that the rows are made of.
#[derive(Debug, PartialEq)]
enum TopicChoice {
    One(String),
    /// Of accelerometers and of gyroscopes.
    Two([String; 2]),
}

/// What the first messages of a topic have other than zeros, and the times of some of all.
#[derive(Clone, Debug, Default)]
struct TopicContent {
    messages: u64,
    accelerations: bool,
    rates: bool,
    times: EvenSample<MessageTimes>,
}

/// Messages of a topic that are looked at.
const LOOKED_AT: u64 = 100;

/// The temperatures of a topic.
#[derive(Default)]
struct Temperatures {
    topic: Option<String>,
    joined: JoinedTemperatures,
    /// Rows before the first temperature.
    before: u64,
}

/// A kind of messages that concern a conversion.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum MessageKind {
    Imu,
    Temperature,
    /// Of any other schema, or in an unknown encoding.
    Other,
}

/// The messages of an MCAP file, with their topics.
struct BagMessages {
    records: Records,
    /// Names of the schemas.
    schemas: HashMap<u16, String>,
    channels: HashMap<u16, Rc<BagChannel>>,
    /// Number of the last message, from 1, without those of chunks that are passed over.
    read: u64,
}

struct BagChannel {
    topic: String,
    schema: String,
    kind: MessageKind,
    encoding: Encoding,
}

impl BagChannel {
    fn new(topic: String, schema: String, encoding: &str) -> Self {
        let encoding = match encoding {
            "cdr" => Some(Encoding::Cdr),
            "ros1" => Some(Encoding::Ros1),
            _ => None,
        };
        let kind = match (schema.replace("/msg/", "/").as_str(), encoding) {
            ("sensor_msgs/Imu", Some(_)) => MessageKind::Imu,
            ("sensor_msgs/Temperature", Some(_)) => MessageKind::Temperature,
            _ => MessageKind::Other,
        };
        Self { topic, schema, kind, encoding: encoding.unwrap_or(Encoding::Cdr) }
    }
}

/// A message, its channel, and when it was recorded \[ns\].
type OfChannel = (Rc<BagChannel>, Vec<u8>, u64);

/// Whether an MCAP file has messages of `sensor_msgs/msg/Imu`, and before them none of Isotherm. False of a pipe, and
/// of a file that cannot be read up to there.
pub(crate) fn is_bag(source: &DataSource) -> bool {
    let Some(mut messages) = source.is_file().then(|| BagMessages::open(source, &Settings::default()).ok()).flatten()
    else {
        return false;
    };
    loop {
        match messages.records.next() {
            Ok(Some(Record::Message { .. })) => {}
            Ok(Some(Record::Schema { header, .. })) if header.name.starts_with(OWN) => return false,
            Ok(Some(Record::Channel(channel))) => {
                let id = channel.id;
                messages.take(Record::Channel(channel));
                if messages.channels.get(&id).is_some_and(|channel| channel.kind == MessageKind::Imu) {
                    return true;
                }
            }
            Ok(Some(record)) => drop(messages.take(record)),
            Ok(None) | Err(_) => return false,
        }
    }
}

/// What is in a file.
#[derive(Default)]
struct BagContents {
    /// The topics of `sensor_msgs/msg/Imu`.
    imus: BTreeMap<String, TopicContent>,
    temperatures: BTreeMap<String, Vec<TimedTemperature>>,
    /// All topics, with their schemas.
    topics: BTreeMap<String, String>,
}

impl RosSource {
    /// Chooses the topics. They and the temperatures are read first, then the rows.
    ///
    /// # Errors
    /// If there is no topic of the messages, or several and none is chosen; if the data cannot be read twice.
    pub(super) fn open(
        mut data: OpenData<'_>,
        settings: &Settings,
        temperature: Option<f64>,
        units: [f64; 2],
    ) -> Result<Box<dyn ForeignRows>, Failure> {
        let path = data.source.name();
        if path == Path::new("-") {
            return Err(Failure::new(
                Exit::Usage,
                "MCAP cannot be converted from a pipe, since it is read twice; name the file",
            ));
        }
        let failed = |error: RecordingError| error.failure(path);
        let refused = |message: String| Failure::new(Exit::Data, format!("{}: {message}", shown(path)));
        let mut contents = BagContents::read(&mut BagMessages::new(data.source, data.take())).map_err(failed)?;
        let chosen = contents.choose(settings).map_err(|problem| refused(contents.problem(&problem, IMU)))?;
        let names: Vec<_> = contents.temperatures.keys().cloned().collect();
        let temperature_topic = match temperature {
            Some(_) => None,
            None => choose(&names, settings.temperature_topic.as_deref(), "--temperature-topic")
                .map_err(|problem| refused(contents.problem(&problem, TEMPERATURE)))?,
        };
        let temperatures = match temperature_topic {
            Some(topic) => contents.temperatures_of(topic, &chosen, settings.time).map_err(refused)?,
            None => Temperatures::default(),
        };
        let of_topic = |messages: BagMessages, topic: String, wanted: SensorChoice| Self {
            messages,
            topic,
            time: settings.time,
            wanted,
            gyroscopes: true,
            first: None,
            temperature,
            temperatures: Temperatures::default(),
            units,
        };
        let messages = BagMessages::new(data.source, data.again(&settings.progress)?);
        match chosen {
            TopicChoice::One(topic) => {
                let source = Self { temperatures, ..of_topic(messages, topic, SensorChoice::All) };
                source.begin().map_err(failed)
            }
            TopicChoice::Two([topic, of_gyroscopes]) => {
                // They are read together, however far apart they lie in the file.
                let others = BagMessages::open(data.source, &Settings::default())?;
                let accelerometers =
                    Self { temperatures, ..of_topic(messages, topic.clone(), SensorChoice::Accelerometers) };
                // The rows have the temperature of the accelerometers.
                let gyroscopes = Self {
                    temperature: Some(PLACEHOLDER),
                    ..of_topic(others, of_gyroscopes.clone(), SensorChoice::Gyroscopes)
                };
                let stream = |source: Self, are_gyroscopes: bool, name: String| {
                    source.begin().and_then(|source| RowStream::new(source, settings.time, are_gyroscopes, name, None))
                };
                let rows = stream(accelerometers, false, topic).map_err(failed)?;
                let others = stream(gyroscopes, true, of_gyroscopes).map_err(failed)?;
                Ok(Box::new(JoinedSource::new(rows, others)))
            }
        }
    }

    /// Reads the first row.
    fn begin(mut self) -> Result<Box<dyn ForeignRows>, RecordingError> {
        self.first = self.next_reading(true)?;
        Ok(Box::new(self))
    }

    /// The next row. The first decides whether there are gyroscopes.
    fn next_reading(&mut self, is_first: bool) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            let Some((channel, data, log_ns)) = self.messages.next()? else { return Ok(None) };
            if channel.kind != MessageKind::Imu || channel.topic != self.topic {
                continue;
            }
            let reading =
                ImuMessage::decode(channel.encoding, &data).and_then(|imu| self.reading(&imu, log_ns, is_first));
            return reading.map(Some).map_err(|message| self.messages.error(self.messages.count(), message));
        }
    }

    fn reading(&mut self, imu: &ImuMessage, log_ns: u64, is_first: bool) -> Result<ForeignRow, String> {
        let no_acceleration = "no linear_acceleration: the first element of its covariance is -1";
        let acceleration = match self.wanted {
            SensorChoice::Gyroscopes => [0.0; AXES],
            _ => imu.linear_acceleration.ok_or(no_acceleration)?,
        };
        if is_first {
            self.gyroscopes = self.wanted != SensorChoice::Accelerometers && imu.angular_velocity.is_some();
        }
        let rates = match (imu.angular_velocity, self.gyroscopes) {
            (Some(rates), true) => rates,
            (_, false) => [0.0; AXES],
            (None, true) => {
                return Err("no angular_velocity, unlike the first message: its covariance begins with -1".to_owned());
            }
        };
        let stamp_ns = if self.time == TimeSource::Header { imu.stamp_ns } else { log_ns };
        let mut reading =
            ForeignRow { place: self.messages.count(), timestamp_ns: Some(stamp_ns), ..ForeignRow::default() };
        let names = ["linear_acceleration", "angular_velocity"];
        for (index, value) in acceleration.into_iter().chain(rates).enumerate() {
            let name = || format!("{}.{}", names[index / AXES], ["x", "y", "z"][index % AXES]);
            if !value.is_finite() {
                return Err(format!("{} is {value}, not a number", name()));
            }
            let pulses = pulses(value * self.units[index / AXES], 0.0, RESOLUTION, 1.0);
            (reading.pulses[index], reading.rest[index]) =
                pulses.map_err(|message| format!("{}: {message}", name()))?;
        }
        let time_ns = if self.temperatures.joined.are_by_recording { log_ns } else { stamp_ns };
        self.temperatures.before += u64::from(self.temperatures.joined.are_after(time_ns));
        self.take_temperature(time_ns, &mut reading);
        Ok(reading)
    }

    fn take_temperature(&self, time_ns: u64, reading: &mut ForeignRow) {
        let temperature = self.temperature.or_else(|| self.temperatures.joined.at(time_ns)).unwrap_or(PLACEHOLDER);
        (reading.head, reading.board) = ([temperature; _], [temperature; _]);
    }
}

impl ForeignRows for RosSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        match self.first.take() {
            Some(first) => Ok(Some(first)),
            None => self.next_reading(false),
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        self.messages.error(place, message)
    }

    fn unit(&self) -> Option<&'static str> {
        Some("message")
    }

    fn units(&self) -> Result<Units, String> {
        let resolution = Resolution { accelerometer: RESOLUTION, gyroscope: RESOLUTION };
        Ok(Units { resolution, ..Units::default() })
    }

    fn are_readings(&self) -> [bool; 2] {
        [true; 2]
    }

    fn has_gyroscopes(&self) -> bool {
        self.gyroscopes
    }

    fn has_temperature(&self) -> bool {
        self.temperature.is_none() && !self.temperatures.joined.values.is_empty()
    }

    fn notes(&self) -> Vec<String> {
        let of = match self.wanted {
            SensorChoice::Gyroscopes => "G1, G2, G3 are x, y, z; one pulse is",
            _ => "A1, A2, A3 are x, y, z; one pulse is",
        };
        let unit = match self.wanted {
            SensorChoice::All => "m/s2 or rad/s",
            SensorChoice::Accelerometers => "m/s2",
            SensorChoice::Gyroscopes => "rad/s",
        };
        let scale = format!("{}: {of} {RESOLUTION} {unit}", self.topic);
        let named = |quantity: Quantity, unit: f64| quantity.named(unit).map_or("", |unit| unit.name);
        let [a, g] = [named(Quantity::Acceleration, self.units[0]), named(Quantity::Rate, self.units[1])];
        let units = (self.units != [1.0; 2]).then(|| format!("the messages are in {a} and {g}, as the mapping says"));
        let temperature = self.temperatures.topic.iter().map(|topic| format!("temperature of {topic}, in degC"));
        core::iter::once(scale).chain(units).chain(temperature).collect()
    }

    fn has_log_time(&self) -> bool {
        true
    }

    fn findings(&self) -> Vec<Finding> {
        let truncation = self.messages.records.truncation().map(|text| Finding::warning(name::TRUNCATED, text));
        let Temperatures { topic, before, joined } = &self.temperatures;
        let none = if topic.is_none() { placeholder(self.temperature) } else { None };
        let late = || format!("{before} rows before the first temperature have that one");
        let late = (*before > 0).then(|| Finding::warning(name::NO_TEMPERATURE, late()));
        let damage = self.messages.records.damage();
        damage.into_iter().chain(truncation).chain(none).chain(joined.finding.clone()).chain(late).collect()
    }
}

impl BagContents {
    fn read(messages: &mut BagMessages) -> Result<Self, RecordingError> {
        let mut contents = Self::default();
        while let Some((channel, data, log_ns)) = messages.next()? {
            if channel.kind == MessageKind::Temperature {
                let temperature = TemperatureMessage::decode(channel.encoding, &data);
                let temperature = temperature.map_err(|message| messages.error(messages.count(), message))?;
                let values = contents.temperatures.entry(channel.topic.clone()).or_default();
                let times = MessageTimes { stamp_ns: temperature.stamp_ns, log_ns };
                values.push(TimedTemperature { times, celsius: temperature.celsius });
                continue;
            }
            if !contents.imus.contains_key(&channel.topic) {
                contents.imus.insert(channel.topic.clone(), TopicContent::default());
            }
            let Some(seen) = contents.imus.get_mut(&channel.topic) else { continue };
            // What cannot be read is an error where the rows are.
            let decoded = || ImuMessage::decode(channel.encoding, &data).ok();
            seen.times.add(|| Some(MessageTimes { stamp_ns: decoded()?.stamp_ns, log_ns }));
            if seen.messages < LOOKED_AT {
                seen.messages += 1;
                if let Some(imu) = decoded() {
                    let has = |vector: Option<[f64; 3]>| vector.is_some_and(|of| of.iter().any(|value| *value != 0.0));
                    seen.accelerations |= has(imu.linear_acceleration);
                    seen.rates |= has(imu.angular_velocity);
                }
            }
        }
        for channel in messages.channels.values() {
            contents.topics.insert(channel.topic.clone(), channel.schema.clone());
            if channel.kind == MessageKind::Imu {
                contents.imus.entry(channel.topic.clone()).or_default();
            }
        }
        Ok(contents)
    }

    /// The topics of the rows: those that are named, or the only one; or the two of an IMU whose accelerometers and
    /// gyroscopes have a topic each, as the messages show.
    fn choose(&self, settings: &Settings) -> Result<TopicChoice, String> {
        let names: Vec<_> = self.imus.keys().cloned().collect();
        let (topic, of_gyroscopes) = (settings.topic.as_deref(), settings.gyroscope_topic.as_deref());
        if let Some(of_gyroscopes) = of_gyroscopes {
            let of_gyroscopes = choose(&names, Some(of_gyroscopes), "")?.ok_or_else(|| self.no_imu())?;
            let others: Vec<_> = names.into_iter().filter(|name| *name != of_gyroscopes).collect();
            let topic = choose(&others, topic, "--topic")?;
            let topic = topic.ok_or("no topic of accelerometers next to that of the gyroscopes; give only --topic")?;
            return Ok(TopicChoice::Two([topic, of_gyroscopes]));
        }
        let seen: Vec<_> = self.imus.iter().collect();
        if let (None, [(one, a), (other, b)]) = (topic, &seen[..]) {
            let has = |seen: &TopicContent| (seen.accelerations, seen.rates);
            match (has(a), has(b)) {
                ((true, false), (false, true)) => {
                    return Ok(TopicChoice::Two([one, other].map(|name| (*name).clone())));
                }
                ((false, true), (true, false)) => {
                    return Ok(TopicChoice::Two([other, one].map(|name| (*name).clone())));
                }
                _ => {}
            }
        }
        let option = "--topic, or those of accelerometers and gyroscopes with --topic and --gyroscope-topic";
        choose(&names, topic, option)?.map(TopicChoice::One).ok_or_else(|| self.no_imu())
    }

    /// The temperatures of a topic for the rows that are chosen.
    ///
    /// # Errors
    /// If neither stamps nor times of recording show which temperature a row has.
    fn temperatures_of(
        &mut self,
        topic: String,
        chosen: &TopicChoice,
        time: TimeSource,
    ) -> Result<Temperatures, String> {
        let (TopicChoice::One(of_rows) | TopicChoice::Two([of_rows, _])) = chosen;
        let mut values = self.temperatures.remove(&topic).unwrap_or_default();
        let joined = match (time, self.imus.get(of_rows)) {
            (TimeSource::Header, Some(rows)) => rows.times.joined(of_rows, (&topic, values))?,
            _ => {
                values.sort_by_key(|value| value.times.log_ns);
                JoinedTemperatures { values, are_by_recording: true, finding: None }
            }
        };
        Ok(Temperatures { topic: Some(topic), joined, before: 0 })
    }

    fn no_imu(&self) -> String {
        let own = self.topics.values().any(|schema| schema.starts_with(OWN));
        let own =
            if own { "; a recording of Isotherm needs no conversion, every command reads it as it is" } else { "" };
        format!("no messages{own}")
    }

    /// A message about the topics of a schema.
    fn problem(&self, problem: &str, schema: &str) -> String {
        let listed = self.topics.iter().take(LISTED).map(|(topic, schema)| format!("{topic} ({schema})"));
        let listed = listed.collect::<Vec<_>>().join(", ");
        let more = if self.topics.len() > LISTED { ", .." } else { "" };
        format!(
            "{schema} (cdr or ros1): {problem}; topics found: {}{more}",
            if listed.is_empty() { "none" } else { &listed }
        )
    }
}

/// The topic that is wanted, otherwise the only one; `None` if there is none.
fn choose(topics: &[String], wanted: Option<&str>, option: &str) -> Result<Option<String>, String> {
    match (wanted, topics) {
        (Some(wanted), _) => {
            match topics.iter().find(|topic| topic.trim_start_matches('/') == wanted.trim_start_matches('/')) {
                Some(topic) => Ok(Some(topic.clone())),
                None => Err(format!("no topic {wanted}")),
            }
        }
        (None, []) => Ok(None),
        (None, [only]) => Ok(Some(only.clone())),
        (None, [..]) => Err(format!("several topics, {}; choose one with {option}", topics.join(", "))),
    }
}

impl BagMessages {
    fn open(of: &DataSource, settings: &Settings) -> Result<Self, Failure> {
        let source = of.open().map_err(|error| Failure::io("opening", of.name(), &error))?;
        Ok(Self::new(of, settings.progress.restarted(source)))
    }

    /// The messages of a file, from its beginning.
    fn new(of: &DataSource, source: Box<dyn Read>) -> Self {
        let kind = |channel: &mcap::records::Channel, schema: &str| {
            BagChannel::new(channel.topic.clone(), schema.to_owned(), &channel.message_encoding).kind
        };
        let unwanted = ChannelFilter::of(of, |channel, schema| kind(channel, schema) != MessageKind::Other);
        Self { records: Records::without(source, unwanted), schemas: HashMap::new(), channels: HashMap::new(), read: 0 }
    }

    /// Number of the last message, from 1.
    fn count(&self) -> u64 {
        self.read + self.records.skipped()
    }

    /// The next message and its channel.
    fn next(&mut self) -> Result<Option<OfChannel>, RecordingError> {
        loop {
            let record = self.records.next();
            let record = record.map_err(|error| error.located(|message| self.error(self.count(), message)))?;
            let Some(record) = record else { return Ok(None) };
            if let Some(message) = self.take(record) {
                return Ok(Some(message));
            }
        }
    }

    /// Takes a record; returns a message that concerns a conversion.
    fn take(&mut self, record: Record<'static>) -> Option<OfChannel> {
        match record {
            Record::Schema { header, .. } => drop(self.schemas.insert(header.id, header.name)),
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let encoding = &channel.message_encoding;
                self.channels.insert(channel.id, Rc::new(BagChannel::new(channel.topic, schema, encoding)));
            }
            Record::Message { header, data } => {
                self.read += 1;
                let channel = self.channels.get(&header.channel_id);
                let channel = channel.filter(|channel| channel.kind != MessageKind::Other)?;
                return Some((Rc::clone(channel), data.into_owned(), header.log_time));
            }
            _ => {}
        }
        None
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        RecordingError::Place { place: format!("message {}", if place == 0 { self.count() } else { place }), message }
    }
}
