//! `sensor_msgs/msg/Imu` in MCAP: bags as other programs write them, and the way back from increments.

use isotherm_files::{Disk, source};
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::ros::{ImuMessage, TemperatureMessage};
use isotherm_recording_formats::write::{Files, Format, RosTable, RosWriter, Rotation};
use isotherm_shared::compensate::answer;
use isotherm_shared::names::StreamKind;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample, Triad};
use isotherm_support::failure::{Exit, Failure};
use mcap::read::LinearReader;
use mcap::records::{MessageHeader, Record};
use ruzstd::decoding::FrameDecoder;
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const TABLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data");
/// A stamp \[ns\].
pub(crate) const BEGIN: u64 = 1_700_000_000_000_000_000;
/// Interval \[ns\].
pub(crate) const STEP: u64 = 5_000_000;

/// A bag that is being made.
pub(crate) struct Bag {
    writer: mcap::Writer<Cursor<Vec<u8>>>,
    channels: BTreeMap<String, u16>,
}

impl Bag {
    pub(crate) fn new() -> Self {
        Self { writer: mcap::Writer::new(Cursor::default()).unwrap(), channels: BTreeMap::new() }
    }

    fn message(&mut self, schema: &str, encoding: &str, topic: &str, data: &[u8]) -> &mut Self {
        self.message_at(5, schema, encoding, topic, data)
    }

    /// A message that was recorded at this time \[ns\].
    fn message_at(&mut self, log_time: u64, schema: &str, encoding: &str, topic: &str, data: &[u8]) -> &mut Self {
        let writer = &mut self.writer;
        let id = *self.channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap()
        });
        let header = MessageHeader { channel_id: id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, data).unwrap();
        self
    }

    pub(crate) fn imu(&mut self, topic: &str, imu: &ImuMessage) -> &mut Self {
        let mut data = Vec::new();
        imu.encode(&mut data).unwrap();
        self.message("sensor_msgs/msg/Imu", "cdr", topic, &data)
    }

    /// An IMU's message that was recorded at this time \[ns\].
    pub(crate) fn imu_at(&mut self, log_time: u64, topic: &str, imu: &ImuMessage) -> &mut Self {
        let mut data = Vec::new();
        imu.encode(&mut data).unwrap();
        self.message_at(log_time, "sensor_msgs/msg/Imu", "cdr", topic, &data)
    }

    pub(crate) fn temperature(&mut self, topic: &str, stamp_ns: u64, celsius: f64) -> &mut Self {
        self.temperature_at(5, topic, stamp_ns, celsius)
    }

    /// A temperature that was recorded at this time \[ns\].
    pub(crate) fn temperature_at(&mut self, log_time: u64, topic: &str, stamp_ns: u64, celsius: f64) -> &mut Self {
        let mut data = Vec::new();
        TemperatureMessage { stamp_ns, frame_id: "t".to_owned(), celsius }.encode(&mut data).unwrap();
        self.message_at(log_time, "sensor_msgs/msg/Temperature", "cdr", topic, &data)
    }

    pub(crate) fn bytes(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }

    pub(crate) fn convert(self, settings: &Settings) -> Result<(Vec<RawSample>, Vec<String>), Failure> {
        convert(&self.bytes(), settings)
    }
}

fn convert(bytes: &[u8], settings: &Settings) -> Result<(Vec<RawSample>, Vec<String>), Failure> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bag.mcap");
    fs::write(&path, bytes).unwrap();
    let mut conversion = Conversion::open(&source(&path), None, settings)?;
    let samples = (&mut conversion).collect::<Result<_, _>>()?;
    Ok((samples, told(&conversion)))
}

pub(crate) fn imu(number: u64) -> ImuMessage {
    ImuMessage {
        stamp_ns: BEGIN + number * STEP,
        frame_id: "imu_link".to_owned(),
        angular_velocity: Some([0.5, -0.25, 1e-6 * number as f64]),
        linear_acceleration: Some([-9.80665, 0.0, 0.123_456_7]),
    }
}

#[test]
fn stamps_readings_and_temperatures_are_those_of_the_messages() {
    let mut bag = Bag::new();
    bag.imu("/imu", &imu(0));
    bag.temperature("/t", BEGIN + 2 * STEP, 31.0).temperature("/t", BEGIN + STEP, 30.0);
    bag.imu("/imu", &imu(1)).imu("/imu", &imu(2)).imu("/imu", &imu(3));
    bag.message("std_msgs/msg/String", "cdr", "/log", b"whatever");
    let (samples, notes) = bag.convert(&Settings::default()).unwrap();
    assert_eq!(samples.len(), 4);
    for (number, sample) in (0..).zip(&samples) {
        assert_eq!((sample.sequence, sample.timestamp_ns), (number, BEGIN + number * STEP));
        assert_eq!(sample.interval_ns, STEP);
        let (a, g) = (&sample.accelerometers, &sample.gyroscopes);
        assert_eq!((a.positive_pulses, a.negative_pulses), ([0, 0, 123_457], [9_806_650, 0, 0]));
        assert_eq!((g.positive_pulses, g.negative_pulses), ([500_000, 0, number as u32], [0, 250_000, 0]));
        // The last temperature up to the stamp; the first, before there is one.
        let expected = [[30.0, 30.0, 31.0, 31.0][number as usize]; 3];
        assert_eq!([a.head_temperature, a.board_temperature, g.head_temperature], [expected; 3]);
    }
    let notes = notes.join("\n");
    assert!(notes.contains("temperature of /t, in degC"), "{notes}");
    assert!(notes.contains("warning [no-temperature]: 1 rows before the first temperature have that one"), "{notes}");
    assert!(notes.contains("the nominal interval is 0.005 s, found from"), "{notes}");
}

#[test]
fn both_byte_orders_and_the_layout_of_ros_1_are_read() {
    let mut little = Vec::new();
    imu(3).encode(&mut little).unwrap();
    let (name, doubles) = ("imu_link", 4 + (12_usize + 9).next_multiple_of(8));
    let mut big = little.clone();
    big[1] = 0;
    let words = (4..16).step_by(4).map(|at| (at, 4));
    for (at, size) in words.chain((doubles..little.len()).step_by(8).map(|at| (at, 8))) {
        big[at..at + size].reverse();
    }
    let stamp =
        [7, (imu(3).stamp_ns / 1_000_000_000) as u32, (imu(3).stamp_ns % 1_000_000_000) as u32, name.len() as u32];
    let mut ros1: Vec<u8> = stamp.iter().flat_map(|word| word.to_le_bytes()).collect();
    ros1.extend(name.bytes().chain(little[doubles..].iter().copied()));
    let settings = Settings { interval_ns: Some(STEP), temperature: Some(20.0), ..Settings::default() };
    let of = |schema: &str, encoding: &str, data: &[u8]| {
        let mut bag = Bag::new();
        bag.message(schema, encoding, "/imu", data);
        bag.convert(&settings).unwrap().0
    };
    let right = of("sensor_msgs/msg/Imu", "cdr", &little);
    assert_eq!(right[0].accelerometers.negative_pulses[0], 9_806_650);
    assert_eq!(of("sensor_msgs/msg/Imu", "cdr", &big), right);
    assert_eq!(of("sensor_msgs/Imu", "ros1", &ros1), right);
}

#[test]
fn of_several_topics_one_is_chosen() {
    let bag = || {
        let mut bag = Bag::new();
        bag.imu("/left", &imu(0)).imu("/right", &ImuMessage { linear_acceleration: Some([1.0; 3]), ..imu(0) });
        bag.temperature("/t1", BEGIN, 10.0).temperature("/t2", BEGIN, 20.0);
        bag
    };
    let settings = |topic: Option<&str>, temperature_topic: Option<&str>| Settings {
        session: 0,
        interval_ns: Some(STEP),
        topic: topic.map(str::to_owned),
        temperature_topic: temperature_topic.map(str::to_owned),
        ..Settings::default()
    };
    let refused = |settings: &Settings| {
        let failure = bag().convert(settings).unwrap_err();
        assert_eq!(failure.exit, Exit::Data);
        failure.message
    };
    let message = refused(&settings(None, None));
    assert!(
        message.contains("several topics, /left, /right; choose one with --topic, or those of accelerometers and"),
        "{message}"
    );
    assert!(refused(&settings(Some("/middle"), None)).contains("no topic /middle"));
    assert!(refused(&settings(Some("/left"), None)).contains("choose one with --temperature-topic"));
    let (samples, _) = bag().convert(&settings(Some("right"), Some("/t2"))).unwrap();
    assert_eq!(
        (samples[0].accelerometers.positive_pulses, samples[0].accelerometers.head_temperature),
        ([1_000_000; 3], [20.0; 3])
    );
    let given = Settings { temperature: Some(7.0), ..settings(Some("/left"), None) };
    assert_eq!(bag().convert(&given).unwrap().0[0].accelerometers.head_temperature, [7.0; 3]);
}

#[test]
fn what_cannot_be_converted_is_refused_with_the_topics_found() {
    let refused = |bag: Bag| {
        let failure = bag.convert(&Settings::default()).unwrap_err();
        assert_eq!(failure.exit, Exit::Data);
        failure.message
    };
    let mut bag = Bag::new();
    bag.message("std_msgs/msg/String", "cdr", "/log", b"");
    assert!(refused(bag).contains("no messages; topics found: /log (std_msgs/msg/String)"));
    assert!(refused(Bag::new()).contains("topics found: none"));
    let mut bag = Bag::new();
    bag.message("isotherm.RawSample", "protobuf", "isotherm/imu-a/raw", b"");
    assert!(refused(bag).contains("a recording of Isotherm needs no conversion"));
    let mut bag = Bag::new();
    bag.imu("/imu", &ImuMessage { linear_acceleration: None, ..imu(0) });
    assert!(refused(bag).contains("message 1: no linear_acceleration"));
    let mut bag = Bag::new();
    bag.imu("/imu", &imu(0)).imu("/imu", &ImuMessage { angular_velocity: None, ..imu(1) });
    assert!(refused(bag).contains("message 2: no angular_velocity, unlike the first"));
    let mut bag = Bag::new();
    bag.imu("/imu", &ImuMessage { linear_acceleration: Some([0.0, 5000.0, 0.0]), ..imu(0) });
    assert!(refused(bag).contains("message 1: linear_acceleration.y: 5000 is 5000000000 pulses"));
    let mut bag = Bag::new();
    bag.message("sensor_msgs/msg/Imu", "cdr", "/imu", &[0, 1, 0, 0, 5]);
    assert!(refused(bag).contains("message 1: a message that is shorter than its type"));
    let mut nan = Vec::new();
    imu(0).encode(&mut nan).unwrap();
    // The last double but the covariance: linear_acceleration.z.
    let at = nan.len() - 10 * 8;
    nan[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    let mut bag = Bag::new();
    bag.message("sensor_msgs/msg/Imu", "cdr", "/imu", &nan);
    assert!(refused(bag).contains("message 1: linear_acceleration.z is NaN"));
}

/// A placeholder is reported loudly.
#[test]
fn without_a_temperature_there_is_a_placeholder_and_a_warning() {
    let mut bag = Bag::new();
    bag.imu("/imu", &imu(0)).imu("/imu", &imu(1));
    let (samples, notes) = bag.convert(&Settings::default()).unwrap();
    assert_eq!(samples[0].accelerometers.head_temperature, [25.0; 3]);
    assert!(
        notes
            .iter()
            .any(|note| note.starts_with("warning [no-temperature]: the data have no temperature; 25 is in all rows")),
        "{notes:?}"
    );
}

/// Every prefix of a bag, and a bag with wrong bytes, are converted or refused as bad data.
#[test]
fn no_file_makes_it_panic() {
    let mut bag = Bag::new();
    for number in 0..3 {
        bag.temperature("/t", BEGIN + number * STEP, 20.0).imu("/imu", &imu(number));
    }
    let bytes = bag.bytes();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bag.mcap");
    let check = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let conversion = Conversion::open(&source(&path), None, &Settings::default());
        if let Err(failure) = conversion.and_then(|conversion| conversion.collect::<Result<Vec<_>, _>>()) {
            assert!([Exit::Data, Exit::Usage].contains(&failure.exit), "{failure}");
        }
    };
    for length in 0..bytes.len() {
        check(&bytes[..length]);
    }
    for place in 8..bytes.len() {
        let mut wrong = bytes.clone();
        wrong[place] ^= 0xff;
        check(&wrong);
    }
}

fn table(celsius: bool) -> CoefficientTable {
    let text = fs::read_to_string(Path::new(TABLES).join("imu-g.toml")).unwrap();
    let text = text.lines().filter(|line| !line.starts_with("digest")).collect::<Vec<_>>().join("\n");
    let text = if celsius { text.replace("unit = \"V\"", "unit = \"degC\"") } else { text };
    CoefficientTable::from_toml(&text, None).unwrap()
}

/// Raw samples at rest, and their increments.
fn samples(table: &CoefficientTable) -> Vec<(RawSample, CompensatedIncrement)> {
    let row = |number: u64| {
        let triad = |pulses: u32| Triad {
            positive_pulses: [pulses + number as u32, 0, 3],
            negative_pulses: [0, pulses, 0],
            head_temperature: [2.25, 2.5, 2.75],
            board_temperature: [2.5; 3],
            head_lagged: [2.5; 3],
        };
        let raw = RawSample {
            session: 1,
            sequence: number,
            timestamp_ns: BEGIN + number * STEP,
            interval_ns: STEP,
            telemetry_ns: if number == 0 { 0 } else { BEGIN + number * STEP - 1 },
            lag_ns: table.lag_ns(),
            accelerometers: triad(400),
            gyroscopes: triad(900),
            ..RawSample::default()
        };
        (raw, answer(Some(table), &raw))
    };
    (0..10).map(row).collect()
}

/// The messages of a file by topic.
type Messages = BTreeMap<String, Vec<Vec<u8>>>;

/// The messages of a file, and the metadata about tables.
fn content(bytes: &[u8]) -> (Messages, Vec<BTreeMap<String, String>>) {
    let (mut messages, mut metadata, mut topics) = (Messages::new(), Vec::new(), BTreeMap::new());
    for record in records(bytes) {
        match record {
            Record::Channel(channel) => drop(topics.insert(channel.id, channel.topic)),
            Record::Message { header, data } => {
                messages.entry(topics[&header.channel_id].clone()).or_default().push(data.into_owned());
            }
            Record::Metadata(record) => {
                assert_eq!(record.name, "isotherm.table");
                metadata.push(record.metadata);
            }
            _ => {}
        }
    }
    (messages, metadata)
}

/// The records of the data of a file that was written here, those in chunks with the others.
fn records(bytes: &[u8]) -> Vec<Record<'static>> {
    let of_record = |record: Record<'_>| match record {
        Record::Chunk { header, data } => {
            assert_eq!(header.compression, "zstd");
            let mut records = vec![0; header.uncompressed_size as usize];
            assert_eq!(FrameDecoder::new().decode_all(&data, &mut records).unwrap(), records.len());
            let records = LinearReader::sans_magic(&records).map(|record| record.unwrap().into_owned());
            records.collect::<Vec<_>>()
        }
        record => vec![record.into_owned()],
    };
    let in_data = |record: &Record<'_>| !matches!(record, Record::DataEnd(_));
    LinearReader::new(bytes).unwrap().map(Result::unwrap).take_while(in_data).flat_map(of_record).collect()
}

#[test]
fn increments_become_messages_and_are_converted_back() {
    let table = table(true);
    let known = RosTable::new(&table, Path::new("/etc/isotherm/imu-g.toml"));
    assert!(known.is_celsius());
    let mut writer =
        RosWriter::new(Cursor::new(Vec::new()), &[(0, known.imu())], std::slice::from_ref(&known)).unwrap();
    let samples = samples(&table);
    for (raw, increment) in &samples {
        let row = |sample| RecordedRow::new(0, 1, sample);
        writer.write(&row(StreamSample::Raw(*raw))).unwrap();
        writer.write(&row(StreamSample::Increment(*increment))).unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let (messages, metadata) = content(&bytes);
    let expected = [("imu", "imu-g"), ("file", "imu-g.toml"), ("digest", &table.digest().to_string())];
    let mut expected: BTreeMap<_, _> = expected.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
    expected.insert("table".to_owned(), format!("{:016x}", table.id()));
    assert_eq!(metadata, [expected]);
    assert_eq!(messages.keys().collect::<Vec<_>>(), ["/imu_g/data_raw", "/imu_g/temperature"]);
    let (back, notes) = convert(&bytes, &Settings::default()).unwrap();
    assert!(!notes.iter().any(|note| note.starts_with("warning")), "{notes:?}");
    assert_eq!(back.len(), samples.len());
    for (back, (raw, increment)) in back.iter().zip(&samples) {
        assert_eq!((back.timestamp_ns, back.interval_ns), (raw.timestamp_ns, STEP));
        for axis in 0..3 {
            let check = |triad: &Triad, over: f64| {
                let pulses = f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis]);
                let rate = over / (STEP as f64 / 1e9);
                assert!((pulses * 1e-6 - rate).abs() <= 0.5e-6 * (1.0 + 1e-6), "{pulses} {rate}");
                assert_eq!(triad.head_temperature[axis], 2.5);
            };
            check(&back.accelerometers, increment.velocity_increment[axis]);
            check(&back.gyroscopes, increment.angle_increment[axis]);
        }
    }
    // In V there are no temperatures.
    let volts = RosTable::new(&self::table(false), Path::new("t"));
    let writer = RosWriter::new(Cursor::new(Vec::new()), &[(0, volts.imu())], std::slice::from_ref(&volts)).unwrap();
    assert!(!volts.is_celsius() && content(&writer.finish().unwrap().into_inner()).0.is_empty());
}

/// What the recorder writes names each table, goes on in the next file, and can be read without its end.
#[test]
fn the_recorder_writes_messages_of_several_imus() {
    let table = table(true);
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("drive.mcap");
    let imus: Vec<_> = ["imu-g", "2nd"].map(|name| name.parse().unwrap()).into();
    let streams: Vec<_> = (0..2).flat_map(|imu| StreamKind::BOTH.map(|stream| (imu, stream))).collect();
    let rotation = Rotation { size: Some(1), ..Rotation::default() };
    let tables = [RosTable::new(&table, Path::new("imu-g.toml"))];
    let files = Files::create_with_tables(&Disk, &path, Format::Ros, rotation, &imus, &streams, &tables);
    let mut files = files.ok().unwrap();
    let mut names: Vec<PathBuf> = files.current_paths();
    for (number, (raw, increment)) in samples(&table).into_iter().enumerate() {
        let increment = CompensatedIncrement { table: increment.table + u64::from(number >= 3), ..increment };
        for imu in 0..2 {
            for sample in [StreamSample::Raw(raw), StreamSample::Increment(increment)] {
                assert!(files.write(&RecordedRow::new(imu, BEGIN, sample)).ok().unwrap().is_none());
            }
        }
        if number == 5 {
            names.extend(files.flush().ok().unwrap().unwrap());
        }
    }
    names.extend(files.flush().ok().unwrap().unwrap());
    let file_names: Vec<_> = names.iter().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(file_names, ["drive-0001.mcap", "drive-0002.mcap", "drive-0003.mcap"]);
    let (messages, metadata) = content(&fs::read(&names[0]).unwrap());
    let topics = ["/imu_2nd/data_raw", "/imu_g/data_raw", "/imu_g/temperature"];
    assert_eq!(
        messages.iter().map(|(topic, all)| (topic.as_str(), all.len())).collect::<Vec<_>>(),
        topics.map(|topic| (topic, 6))
    );
    let known: Vec<_> = metadata.iter().map(|texts| (texts["imu"].as_str(), texts.contains_key("digest"))).collect();
    assert_eq!(known, [("imu-g", true), ("2nd", false), ("imu-g", false), ("2nd", false)]);
    let settings = Settings { topic: Some("/imu_g/data_raw".to_owned()), ..Settings::default() };
    let (back, notes) = convert(&fs::read(&names[0]).unwrap(), &settings).unwrap();
    assert_eq!(back.len(), 6);
    assert!(!notes.iter().any(|note| note.contains("not ended properly")), "{notes:?}");
    let second = fs::read(&names[1]).unwrap();
    assert_eq!(convert(&second, &settings).unwrap().0.len(), 4);
    // Without its end, as if the recorder had been killed after the flush.
    let end = second.windows(9).position(|bytes| bytes[0] == 0x0f && bytes[1..] == 4_u64.to_le_bytes()).unwrap();
    let (rows, notes) = convert(&second[..end], &settings).unwrap();
    assert_eq!(rows.len(), 4);
    assert!(notes.iter().any(|note| note.contains("not ended properly")), "{notes:?}");
}

/// Findings and notes of a conversion, a line each.
fn told(conversion: &Conversion) -> Vec<String> {
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    findings.chain(conversion.notes()).collect()
}
