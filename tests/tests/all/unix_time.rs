//! Recordings say which Unix time it was: every format has the offset of the clocks, and MCAP has it in its publish
//! times.

use isotherm_client::{RawSample, UnixOffset, monotonic_ns};
use isotherm_files::source;
use isotherm_recording::Progress;
use isotherm_recording_formats::read::{ImuChoice, Part, read_numbers};
use isotherm_tests::emulator::Emulator;
use isotherm_tests::{TestDomain, id, recording, round_trip};
use mcap::read::LinearReader;
use mcap::records::Record;
use rustix::process::Signal;
use ruzstd::decoding::FrameDecoder;
use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

const OFFSET: [&str; 2] = ["unix_offset_ns", "unix_offset_uncertainty_ns"];
/// By how much the sum of two times is off that were rounded to doubles \[ns\].
const ROUNDED: f64 = 1024.0;
/// Samples of a session whose timestamps are of `CLOCK_MONOTONIC`, and of one with others.
const MONOTONIC: usize = 100;
const OTHER: usize = 50;

fn unix_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64
}

/// Timestamp, offset and uncertainty of each row of the stream that has this column.
fn rows(domain: &TestDomain, file: &str, column: &str) -> Vec<[f64; 3]> {
    let names = ["timestamp_ns", OFFSET[0], OFFSET[1], column];
    let (choice, sources) = (ImuChoice::Only(id("imu-a")), [source(domain.path(file))]);
    let number = |_, text: &str| text.parse::<f64>().map_err(|_| "a number");
    let read = read_numbers(&sources, &names, &choice, Part::default(), &Progress::default(), number);
    let read = read.unwrap_or_else(|failure| panic!("{file}: {failure}"));
    read.rows.into_iter().map(|row| [row.values[0], row.values[1], row.values[2]]).collect()
}

/// The publish times of a topic.
fn publish_times(domain: &TestDomain, file: &str, topic: &str) -> Vec<u64> {
    let (bytes, mut channel, mut times) = (fs::read(domain.path(file)).unwrap(), None, Vec::new());
    for record in LinearReader::new(&bytes).unwrap() {
        let Record::Chunk { header, data } = record.unwrap() else { continue };
        let mut records = vec![0; header.uncompressed_size as usize];
        FrameDecoder::new().decode_all(&data, &mut records).unwrap();
        for record in LinearReader::sans_magic(&records) {
            match record.unwrap() {
                Record::Channel(record) if record.topic == topic => channel = Some(record.id),
                Record::Message { header, .. } if Some(header.channel_id) == channel => times.push(header.publish_time),
                _ => {}
            }
        }
    }
    times
}

#[test]
fn every_format_says_which_unix_time_it_was() {
    let domain = TestDomain::new();
    let service = domain.serve_recording();
    let files = ["r.csv", "r.mcap"].map(|file| vec!["-o", file]);
    let ros = vec!["-o", "ros.mcap", "--format", "ros"];
    let recorders: Vec<_> = files
        .into_iter()
        .chain([ros])
        .map(|more| domain.spawn(&[&["record", "--imu", "imu-a"], &more[..]].concat()))
        .collect();
    recorders.iter().for_each(|recorder| recorder.wait_for_log("recording imu-a"));
    let samples = recording();
    // For each sample its timestamp, and the Unix time before and after that.
    let mut acquisition = domain.acquisition("imu-a");
    let sent: Vec<_> = samples[..MONOTONIC]
        .iter()
        .map(|sample| {
            let (before, timestamp_ns, after) = (unix_ns(), monotonic_ns(), unix_ns());
            round_trip(&mut acquisition, &RawSample { timestamp_ns, ..*sample });
            (timestamp_ns, [before, after])
        })
        .collect();
    drop(acquisition);
    let mut acquisition = domain.acquisition("imu-a");
    for sample in &samples[..OTHER] {
        round_trip(&mut acquisition, sample);
    }
    let status = domain.status();
    for recorder in recorders {
        recorder.signal(Signal::TERM);
        let (ended, log) = recorder.wait();
        assert!(ended.success() && log.contains("imu-a increment: 150 rows of 2 sessions"), "{log}");
    }
    drop(acquisition);
    service.terminate();

    for (file, column) in
        [("r.csv", "a1_positive"), ("r.increments.csv", "a1_dv"), ("r.mcap", "a1_positive"), ("r.mcap", "a1_dv")]
    {
        let rows = rows(&domain, file, column);
        assert_eq!(rows.len(), MONOTONIC + OTHER, "{file}");
        for ([timestamp_ns, offset_ns, uncertainty_ns], (sent_ns, [before, after])) in rows.iter().zip(&sent) {
            assert_eq!((*timestamp_ns, *uncertainty_ns >= 1.0), (*sent_ns as f64, true), "{file}");
            let (unix_ns, bound) = (timestamp_ns + offset_ns, uncertainty_ns + ROUNDED);
            let range = *before as f64 - bound..=*after as f64 + bound;
            assert!(range.contains(&unix_ns), "{file} {column}: {unix_ns} is not in {range:?}");
        }
        // Both measure the same.
        let [known_ns, known_by_ns] =
            ["unix_offset_ns", "unix_offset_uncertainty_ns"].map(|key| status[key].as_f64().unwrap());
        let [_, offset_ns, uncertainty_ns] = rows[rows.len() - 1];
        assert!(
            (offset_ns - known_ns).abs() <= uncertainty_ns + known_by_ns + ROUNDED,
            "{file}: {offset_ns} {known_ns}"
        );
    }
    for (file, topic, column) in [
        ("r.mcap", "isotherm/imu-a/raw", "a1_positive"),
        ("r.mcap", "isotherm/imu-a/increment", "a1_dv"),
        ("ros.mcap", "/imu_a/data_raw", "a1_dv"),
    ] {
        let (published, rows) = (publish_times(&domain, file, topic), rows(&domain, "r.mcap", column));
        assert_eq!(published.len(), rows.len(), "{file} {topic}");
        for (number, (published, [timestamp_ns, offset_ns, _])) in published.iter().zip(&rows).enumerate() {
            // Another recorder has measured it for itself, with a bound that ROS messages do not have.
            let known_by_ns = if file == "r.mcap" { 0.0 } else { 1e9 };
            let expected = if number < MONOTONIC { timestamp_ns + offset_ns } else { *timestamp_ns };
            assert!(
                (*published as f64 - expected).abs() <= known_by_ns + ROUNDED,
                "{file} {topic}: {published} {expected}"
            );
        }
        // The times of another clock stay as they are.
        let other: Vec<_> = samples[..OTHER].iter().map(|sample| sample.timestamp_ns).collect();
        assert_eq!(published[MONOTONIC..], other, "{file} {topic}");
    }
    for file in ["r.csv", "r.increments.csv"] {
        let text = fs::read_to_string(domain.path(file)).unwrap();
        let header = text.lines().next().unwrap();
        assert!(header.ends_with(&format!(",{},{}", OFFSET[0], OFFSET[1])), "{header}");
    }
}

#[test]
fn what_acquire_records_says_it_too() {
    let domain = TestDomain::new();
    let bytes: Vec<_> = (0..300).flat_map(|number| Emulator::Stim300.frame(number)).collect();
    fs::write(domain.path("bytes"), bytes).unwrap();
    let description =
        format!("{}/../examples/acquire/{}.toml", env!("CARGO_MANIFEST_DIR"), Emulator::Stim300.profile());
    let acquired = domain.run(&["acquire", &description, "--device", "bytes", "--dry-run", "--record", "a.csv"]);
    let measured = UnixOffset::measure();
    let text = fs::read_to_string(domain.path("a.csv"));
    let text = text.unwrap_or_else(|error| panic!("{error}: {}", isotherm_tests::text(&acquired.stderr)));
    let header: Vec<_> = text.lines().next().unwrap().split(',').collect();
    let place = header.iter().position(|name| *name == OFFSET[0]).unwrap();
    let rows: Vec<_> = text.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>()).collect();
    assert!(rows.len() > 250, "{}", rows.len());
    for row in rows {
        let [offset_ns, uncertainty_ns] = [0, 1].map(|more| row[place + more].parse::<i64>().unwrap());
        let bound = uncertainty_ns.unsigned_abs() + measured.uncertainty_ns;
        assert!(offset_ns.abs_diff(measured.offset_ns) <= bound, "{offset_ns} +- {bound}: {measured:?}");
    }
}
