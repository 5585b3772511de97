//! The worst file for each thing that a format counts: channels, fields, messages, groups, columns, names. What it
//! takes to read or to refuse one grows with its length, and stays within a budget of steps.

use crate::logs::Ulog;
use isotherm_files::{Disk, source, sources};
use isotherm_recording::Progress;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording::steps;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::read::{ImuChoice, RecordingContents, Samples};
use isotherm_recording_formats::write::{Files, Format, Rotation};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::{RawSample, StreamSample};
use isotherm_support::finding::name;
use mcap::records::{MessageHeader, op};
use rustix::time::{ClockId, clock_gettime};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::slice;
use std::time::Duration;

/// Makes a file of about this length.
type Worst = fn(usize) -> Vec<u8>;

const WORST: &[(&str, Worst)] = &[
    ("ULog: types within types", ulog_types_within_types),
    ("ULog: fields, and subscriptions to them", ulog_fields),
    ("ULog: names", ulog_names),
    ("ULog: types that are defined after their use", ulog_late_types),
    ("ULog: dropouts", |size| ulog(size, |log, _| log.message(b'O', &[1, 0]))),
    ("ULog: what looks like definitions", |size| {
        repeated(Ulog::new().bytes, size, |_| [[b'F'; 18_000], [b'x'; 18_000]].concat())
    }),
    ("ULog: times that fall", |size| ulog(size, |log, index| log.imu(u64::MAX / 2000 - index * 20_000_000))),
    ("DataFlash: definitions", |size| dataflash(size, |index| definition((index % 256) as u8, "A", "TimeUS"))),
    ("DataFlash: short messages", |size| dataflash(size, |_| vec![0xa3, 0x95, 1])),
    ("DataFlash: headers alone", |size| dataflash(size, |_| vec![0xa3, 0x95])),
    ("DataFlash text: definitions", |size| {
        dataflash_text(size, |index| format!("FMT, {}, 20, N{index}, QBf, TimeUS,I,GyrX\n", index % 250))
    }),
    ("DataFlash text: columns", |size| {
        let columns = dataflash_wide();
        dataflash_text(size, |index| if index == 0 { columns.clone() } else { "IMU, 1\n".to_owned() })
    }),
    ("DataFlash JSON: columns", |size| {
        let data: Vec<_> = (0..1500).map(|index| format!("\"c{index}\":1")).collect();
        let first = format!("{{\"meta\":{{\"type\":\"IMU\",\"timestamp\":1}},\"data\":{{{}}}}}\n", data.join(","));
        text(size, &first, |_| "{\"meta\":{\"type\":\"IMU\",\"timestamp\":1},\"data\":{}}\n".to_owned())
    }),
    ("MCAP: channels with messages", mcap_channels),
    ("MCAP: channels of ROS", |size| mcap_of_ros(size, "sensor_msgs/msg/Imu")),
    ("MCAP: channels of other messages", |size| mcap_of_ros(size, "x/msg/X")),
    ("MCAP: schemas", |size| {
        let descriptor = descriptor();
        mcap(size, |index| schema(index as u16, "isotherm.RawSample", &descriptor))
    }),
    ("MCAP: empty schemas", |size| mcap(size, |index| schema(index as u16, "x", b""))),
    ("MCAP: messages of no channel", |size| mcap(size, |_| record(op::MESSAGE, &[0; 22]))),
    ("MCAP: chunks of nothing", |size| mcap(size, |_| chunk(&zeros(1 << 26), 1 << 26))),
    ("MCAP: chunks of gigabytes", |size| mcap(size, |_| chunk(&zeros(1 << 22), 1 << 33))),
    ("MCAP: chunks of short messages", |size| {
        let chunk = chunk_of_messages();
        mcap(size, |_| chunk.clone())
    }),
    ("MCAP: records of no kind", |size| mcap(size, |_| record(0x80, &[]))),
    ("MCAP: zeros", |size| mcap(size, |_| vec![0; 9])),
    ("CSV: columns", |size| text(size, "sequence,timestamp_ns,a1_positive", |index| format!(",c{index}"))),
    ("CSV: columns and rows", |size| {
        let header: String = (0..size / 16).map(|index| format!("c{index},")).collect();
        text(size, &format!("sequence,timestamp_ns,a1_positive,{header}\n"), |index| format!("{index},\n"))
    }),
    ("CSV: columns of another program, and rows", |size| {
        let header: String = (0..size / 16).map(|index| format!(",ax{index}")).collect();
        text(size, &format!("time,ax,ay,az,gx,gy,gz{header}\n"), |index| format!("{index},0,0,9.8,0,0,0\n"))
    }),
    ("CSV: empty cells", |size| text(size, "time,ax,ay,az\n", |_| ",".to_owned())),
];

/// The pieces behind a beginning, up to about this length.
fn repeated(mut bytes: Vec<u8>, size: usize, piece: impl Fn(u64) -> Vec<u8>) -> Vec<u8> {
    let mut index = 0;
    while bytes.len() < size {
        bytes.extend(piece(index));
        index += 1;
    }
    bytes
}

fn text(size: usize, begin: &str, piece: impl Fn(u64) -> String) -> Vec<u8> {
    repeated(begin.as_bytes().to_vec(), size, |index| piece(index).into_bytes())
}

/// A log of messages, behind the definitions of both sensors and a row of each.
fn ulog(size: usize, message: impl Fn(&mut Ulog, u64) -> &mut Ulog) -> Vec<u8> {
    let mut log = Ulog::new();
    log.imu(1000);
    let mut index = 0;
    while log.bytes.len() < size {
        message(&mut log, index);
        index += 1;
    }
    log.bytes
}

fn ulog_types_within_types(size: usize) -> Vec<u8> {
    let mut log = Ulog::new();
    for level in 0..12 {
        let fields = format!("t{} x;", level + 1).repeat((size / 100).min(4000));
        log.message(b'F', format!("t{level}:{fields}").as_bytes());
    }
    log.message(b'F', b"t12:uint8_t[0] x;");
    while log.bytes.len() < size {
        log.subscribe(0, 100, "t0");
    }
    log.bytes
}

fn ulog_fields(size: usize) -> Vec<u8> {
    let mut log = Ulog::empty();
    log.message(b'F', format!("sensor_accel:{}", "uint8_t x;".repeat((size / 40).min(4000))).as_bytes());
    while log.bytes.len() < size {
        log.subscribe(0, 0, "sensor_accel");
    }
    log.bytes
}

fn ulog_names(size: usize) -> Vec<u8> {
    ulog(size, |log, index| {
        log.message(b'F', format!("n{index}:uint8_t x;").as_bytes());
        log.subscribe(0, 100 + index as u16, &format!("n{index}"))
    })
}

fn ulog_late_types(size: usize) -> Vec<u8> {
    let mut log = Ulog::new();
    let fields: String = (0..(size / 40).min(4000)).map(|index| format!("t{index} x;")).collect();
    log.message(b'F', format!("late:{fields}").as_bytes());
    for index in 0.. {
        if log.bytes.len() >= size {
            break;
        }
        log.message(b'F', format!("t{index}:char x;").as_bytes()).subscribe(0, 100, "late");
    }
    log.bytes
}

/// The message that defines another one.
fn definition(number: u8, name: &str, columns: &str) -> Vec<u8> {
    let padded = |text: &str, length: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(length, 0);
        bytes
    };
    let head = [0xa3, 0x95, 0x80, number, 3];
    [head.to_vec(), padded(name, 4), padded("Q", 16), padded(columns, 64)].concat()
}

fn dataflash(size: usize, message: impl Fn(u64) -> Vec<u8>) -> Vec<u8> {
    let begin = [definition(0x80, "FMT", "Type,Length,Name,Format,Columns"), definition(1, "IMU", "TimeUS")].concat();
    repeated(begin, size, message)
}

fn dataflash_text(size: usize, line: impl Fn(u64) -> String) -> Vec<u8> {
    text(size, "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n", line)
}

fn dataflash_wide() -> String {
    let names: Vec<_> = (0..3000).map(|index| index.to_string()).collect();
    format!("FMT, 130, 20, IMU, {}, {}\n", "B".repeat(3000), names.join(","))
}

fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&[opcode], &(content.len() as u64).to_le_bytes()[..], content].concat()
}

fn texts(texts: &[&[u8]]) -> Vec<u8> {
    texts.iter().flat_map(|text| [&(text.len() as u32).to_le_bytes()[..], text].concat()).collect()
}

fn schema(id: u16, name: &str, data: &[u8]) -> Vec<u8> {
    record(op::SCHEMA, &[&id.to_le_bytes()[..], &texts(&[name.as_bytes(), b"protobuf", data])].concat())
}

fn channel(id: u16, schema: u16, topic: &str, encoding: &str) -> Vec<u8> {
    let numbers = [id.to_le_bytes(), schema.to_le_bytes()].concat();
    record(op::CHANNEL, &[numbers, texts(&[topic.as_bytes(), encoding.as_bytes(), b""])].concat())
}

fn message(channel: u16) -> Vec<u8> {
    record(op::MESSAGE, &[&channel.to_le_bytes()[..], &[0; 20]].concat())
}

/// Records of a program that is not the recorder.
fn mcap(size: usize, piece: impl Fn(u64) -> Vec<u8>) -> Vec<u8> {
    let begin = [mcap::MAGIC.to_vec(), record(op::HEADER, &texts(&[b"", b"x"]))].concat();
    repeated(begin, size, piece)
}

/// The schema of raw samples, of a recording.
fn descriptor() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mcap");
    let streams = [(0, StreamKind::Raw)];
    let mut files =
        Files::create(&Disk, &path, Format::Mcap, Rotation::default(), &["imu-a".parse().unwrap()], &streams)
            .unwrap_or_else(|error| panic!("{}", error.1));
    files.write(&RecordedRow::new(0, 1, StreamSample::Raw(RawSample::default()))).unwrap_or_else(|_| panic!());
    files.finish().unwrap_or_else(|_| panic!());
    let bytes = fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    summary.schemas.values().next().unwrap().data.to_vec()
}

/// Each with a message behind it, so that the choice of a stream is looked at again.
fn mcap_channels(size: usize) -> Vec<u8> {
    let begin = schema(1, "isotherm.RawSample", &descriptor());
    mcap(size, |index| match index {
        0 => begin.clone(),
        _ => [channel(index as u16, 1, &format!("isotherm/i{}/raw", index % 40_000), "protobuf"), message(0)].concat(),
    })
}

fn mcap_of_ros(size: usize, schema_name: &str) -> Vec<u8> {
    mcap(size, |index| match index {
        0 => schema(1, schema_name, b""),
        _ => [channel(index as u16, 1, &format!("/i{index}"), "cdr"), message(index as u16)].concat(),
    })
}

/// A chunk without a check that says that it unpacks to this size.
fn chunk(packed: &[u8], unpacked: u64) -> Vec<u8> {
    let head = [&[0; 16][..], &unpacked.to_le_bytes(), &[0; 4], &texts(&[b"zstd"])].concat();
    record(op::CHUNK, &[&head[..], &(packed.len() as u64).to_le_bytes(), packed].concat())
}

/// Zeros as a frame of Zstandard, four bytes for 128 KiB (RFC 8878, blocks of the type RLE).
fn zeros(count: u32) -> Vec<u8> {
    const BLOCK: u32 = 1 << 17;
    let mut bytes = [&[0x28, 0xb5, 0x2f, 0xfd, 0x80][..], &[0x68], &count.to_le_bytes()].concat();
    for block in 0..count / BLOCK {
        let is_last = u32::from((block + 1) * BLOCK == count);
        bytes.extend(&(is_last | 1 << 1 | BLOCK << 3).to_le_bytes()[..3]);
        bytes.push(0);
    }
    bytes
}

/// A chunk of many short messages.
fn chunk_of_messages() -> Vec<u8> {
    let records = [channel(1, 0, "x", "x"), message(1).repeat(1 << 19)].concat();
    let packed = compress_to_vec(&records[..], CompressionLevel::Fastest);
    chunk(&packed, records.len() as u64)
}

/// Reads a file in every way. None of them matters but the work that it takes.
fn read(path: &Path) {
    for choice in [ImuChoice::Any, ImuChoice::Only("i1".parse().unwrap()), ImuChoice::Prefer("i1".parse().unwrap())] {
        let samples = Samples::open(&sources(&[path.to_owned()]).unwrap(), choice, &Progress::default());
        drop(samples.map(|samples| samples.take_while(Result::is_ok).count()));
    }
    let converted = Conversion::open(&source(path), None, &Settings::default());
    drop(converted.map(|rows| rows.take_while(Result::is_ok).count()));
    drop(RecordingContents::of(&source(path)));
}

/// Steps and processor time that a file of this length takes.
fn work(worst: Worst, size: usize) -> (u64, Duration, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("worst");
    let bytes = worst(size);
    fs::write(&path, &bytes).unwrap();
    let time = || Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).unwrap();
    let (steps, begun) = (steps::taken(), time());
    read(&path);
    (steps::taken() - steps, time() - begun, bytes.len() as u64)
}

fn check(size: usize) {
    for (name, worst) in WORST {
        let (steps, time, length) = work(*worst, size);
        println!("{steps:>12} steps, {time:>9.1?}: {name}, {length} bytes");
        assert!(steps <= steps::budget(length), "{name}: {steps} steps for {length} bytes");
    }
}

#[test]
fn the_worst_files_are_read_within_a_budget_of_steps() {
    check(1 << 18);
}

#[test]
#[ignore = "for figures, with --release: a megabyte of each, and a quarter of it"]
fn a_megabyte_of_the_worst_files() {
    check(1 << 18);
    check(1 << 20);
}

/// A bag of which every other chunk has only messages of a camera.
fn with_camera() -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(100)).library("x").profile("ros2");
    let options = options.calculate_data_section_crc(false);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schemas = ["sensor_msgs/msg/Imu", "sensor_msgs/msg/Image"].map(|name| writer.add_schema(name, "ros2msg", b""));
    let [of_imu, of_camera] = schemas.map(Result::unwrap);
    let metadata = BTreeMap::new();
    let imu = writer.add_channel(of_imu, "/imu", "cdr", &metadata).unwrap();
    let camera = writer.add_channel(of_camera, "/camera", "cdr", &metadata).unwrap();
    for number in 0..40 {
        let mut data = Vec::new();
        crate::convert_ros::imu(number).encode(&mut data).unwrap();
        for (channel_id, data) in [(imu, &data[..]), (camera, &b"picture ".repeat(20))] {
            let header = MessageHeader { channel_id, sequence: 0, log_time: number, publish_time: number };
            writer.write_to_known_channel(&header, data).unwrap();
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// A chunk of a camera that does not match its check is no matter, as long as the summary says what it has.
#[test]
fn chunks_of_other_channels_are_not_unpacked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.mcap");
    let rows = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let mut rows = Conversion::open(&source(&path), None, &Settings::default()).unwrap();
        let count = rows.by_ref().map(Result::unwrap).count();
        let damage = rows.findings().into_iter().find(|finding| finding.name == name::BAD_ROWS);
        (count, damage.map(|finding| finding.message))
    };
    let whole = with_camera();
    assert_eq!(rows(&whole), (40, None));
    let mut damaged = whole.clone();
    for place in memchr::memmem::find_iter(&whole, b"picture picture").step_by(10) {
        damaged[place] ^= 1;
    }
    assert_ne!(whole, damaged);
    assert_eq!(rows(&damaged), (40, None));
    // Without the summary nobody knows which channels a chunk defines.
    let cut = damaged.len() - 37;
    let (count, damage) = rows(&damaged[..cut]);
    assert!(count == 40 && damage.unwrap().contains("the chunk does not match its check"));
    // One of the IMU is unpacked, and checked.
    let mut damaged = whole.clone();
    damaged[memchr::memmem::find(&whole, b"imu_link").unwrap()] ^= 1;
    let (count, damage) = rows(&damaged);
    assert!(count == 39 && damage.unwrap().contains("the chunk does not match its check"), "{count}");
}

/// Kinds of damage, and what is said of them.
#[test]
fn chunks_are_refused_with_their_cause() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mcap");
    let said = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let samples = Samples::open(&sources(slice::from_ref(&path)).unwrap(), ImuChoice::Any, &Progress::default());
        let failure = samples.and_then(|samples| samples.collect::<Result<Vec<_>, _>>()).unwrap_err();
        failure.message
    };
    let large = said(&mcap(1000, |_| chunk(&zeros(1 << 17), (64 << 20) + 1)));
    assert!(large.contains("a chunk that unpacks to 67108865 bytes; at most 64 MiB are read"), "{large}");
    let nothing = said(&mcap(30, |_| chunk(&zeros(1 << 22), 1 << 22)));
    assert!(nothing.contains("a record that no chunk has"), "{nothing}");
    let messages = chunk_of_messages();
    let times = said(&mcap(3 * messages.len(), |_| messages.clone()));
    assert!(times.contains("its chunks unpack to over 64 times their size"), "{times}");
}
