//! The reader gets back what the recorder wrote, in every format, and reports damaged files as errors.
#![allow(clippy::unwrap_used, reason = "helpers of tests, in which the panic is the report")]

use super::{ImuChoice, Samples};
use crate::write::{Files, Format, Rotation};
use indicatif::ProgressBar;
use isotherm_failure::{Exit, Failure};
use isotherm_recording::rows::RecordedRow;
use isotherm_shared::stream::{ImuId, StreamKind};
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const FORMATS: [(Format, &str); 3] = [(Format::Csv, "r.csv"), (Format::Parquet, "r.parquet"), (Format::Mcap, "r.mcap")];

fn imu(name: &str) -> ImuId {
    name.parse().unwrap()
}

/// Pseudorandom numbers with a fixed seed.
struct TestRandom(u64);

impl TestRandom {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 ^ (self.0 >> 29)
    }
    fn below(&mut self, limit: usize) -> usize {
        (self.next() >> 11) as usize % limit
    }
}

/// Samples that cover the whole range of every field.
fn samples(count: u64) -> Vec<RawSample> {
    let mut random = TestRandom(count);
    let mut edge = move || [0, u64::MAX, 1 << 63, random.next()][random.below(4)];
    let made = (0..count).map(|number| RawSample {
        session: if number < count / 2 { u64::MAX } else { 3 },
        sequence: number * 7,
        timestamp_ns: edge(),
        interval_ns: edge(),
        sent_ns: 0,
        telemetry_ns: edge(),
        positive_pulses: [(); 3].map(|()| edge() as u32),
        negative_pulses: [(); 3].map(|()| edge() as u32),
        head_temperature: [0.1 + 0.2, f64::NAN, -0.0],
        board_temperature: [f64::INFINITY, f64::MIN_POSITIVE / 8.0, f64::from_bits(edge() >> 2)],
    });
    made.collect()
}

/// Writes the samples and as many increments, with several flushes.
fn write(folder: &Path, format: Format, name: &str, imus: &[ImuId], samples: &[RawSample]) -> PathBuf {
    let flush = samples.len() / 6 + 1;
    let path = folder.join(name);
    let streams: Vec<_> = (0..imus.len()).flat_map(|imu| StreamKind::BOTH.map(|stream| (imu, stream))).collect();
    let mut files = Files::create(&path, format, Rotation::default(), imus, &streams).ok().unwrap();
    for (count, raw) in samples.iter().enumerate() {
        for imu in 0..imus.len() {
            let raw = RawSample { timestamp_ns: raw.timestamp_ns ^ imu as u64, ..*raw };
            let increment = CompensatedIncrement { session: raw.session, sequence: raw.sequence, ..Default::default() };
            for sample in [StreamSample::Raw(raw), StreamSample::Increment(increment)] {
                files.write(&RecordedRow { imu, recorded_ns: 5, sample }).ok().unwrap();
            }
        }
        if count % flush == 0 {
            files.flush().ok().unwrap();
        }
    }
    files.finish().ok().unwrap();
    path
}

fn read(path: &Path, choice: ImuChoice) -> Result<Vec<RawSample>, Failure> {
    Samples::open(&[path.to_owned()], choice, &ProgressBar::hidden())?.collect()
}

fn bits(samples: &[RawSample]) -> Vec<String> {
    let bits = |values: [f64; 3]| values.map(f64::to_bits);
    let text = |s: &RawSample| {
        let RawSample { session, sequence, timestamp_ns, interval_ns, telemetry_ns, .. } = s;
        let pulses = (s.positive_pulses, s.negative_pulses);
        let temperatures = (bits(s.head_temperature), bits(s.board_temperature));
        format!("{session} {sequence} {timestamp_ns} {interval_ns} {telemetry_ns} {pulses:?} {temperatures:?}")
    };
    samples.iter().map(text).collect()
}

#[test]
fn every_format_gives_back_every_bit() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    for (format, name) in FORMATS {
        // More than a Parquet row group and than a batch of its reader.
        let samples = samples(if format == Format::Parquet { 66_000 } else { 3000 });
        let path = write(folder.path(), format, name, std::slice::from_ref(&a), &samples);
        let read = read(&path, ImuChoice::Only(a.clone())).unwrap();
        assert!(bits(&read) == bits(&samples), "{format:?}");
    }
    // No temporary files are left.
    let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["r.csv", "r.increments.csv", "r.increments.parquet", "r.mcap", "r.parquet"]);
}

#[test]
fn one_of_several_imus_is_selected() {
    let folder = TempDir::new().unwrap();
    let imus = [imu("imu-a"), imu("imu-b"), imu("imu-c")];
    let samples = samples(10);
    let path = write(folder.path(), Format::Mcap, "all.mcap", &imus, &samples);
    for (number, id) in imus.iter().enumerate() {
        for choice in [ImuChoice::Only(id.clone()), ImuChoice::Prefer(id.clone())] {
            let read = read(&path, choice).unwrap();
            assert_eq!(read[3].timestamp_ns, samples[3].timestamp_ns ^ number as u64);
            assert_eq!(read.len(), samples.len());
        }
    }
    let other = imu("imu-x");
    let preferred = read(&path, ImuChoice::Prefer(other.clone())).unwrap_err();
    assert!(preferred.message.contains("several IMUs: imu-a, imu-b, imu-c; choose one with --imu"), "{preferred}");
    let only = read(&path, ImuChoice::Only(other.clone())).unwrap_err();
    assert!(only.message.contains("no raw samples of imu-x, but of imu-a, imu-b, imu-c"), "{only}");
    assert_eq!((preferred.exit, only.exit), (Exit::Data, Exit::Data));
    let one = write(folder.path(), Format::Parquet, "one.parquet", &imus[..1], &samples);
    assert_eq!(read(&one, ImuChoice::Prefer(other.clone())).unwrap().len(), 10, "the only one there is");
    let wrong = read(&one, ImuChoice::Only(other.clone())).unwrap_err();
    assert!(wrong.message.contains("samples of imu-a, not of imu-x"), "{wrong}");
}

/// All flushed rows can be read, wherever the file ends.
#[test]
fn a_truncated_file_is_read_up_to_its_end() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    let samples = samples(500);
    for (format, name) in [FORMATS[0], FORMATS[2]] {
        let path = write(folder.path(), format, name, std::slice::from_ref(&a), &samples);
        let whole = fs::read(&path).unwrap();
        let (mut counts, step) = (Vec::new(), whole.len() / 300);
        for length in (2000..whole.len()).step_by(step) {
            fs::write(&path, &whole[..length]).unwrap();
            let read = read(&path, ImuChoice::Only(a.clone())).unwrap();
            assert!(bits(&read) == bits(&samples[..read.len()]), "{format:?} {length}");
            counts.push(read.len());
        }
        assert!(counts.is_sorted() && counts.last() >= Some(&400), "{format:?} {counts:?}");
    }
}

/// Any damaged file gives samples or an error, and no panic.
#[test]
fn damaged_files_are_errors() {
    let folder = TempDir::new().unwrap();
    let a = imu("imu-a");
    let mut random = TestRandom(1);
    for (format, name) in FORMATS {
        let path = write(folder.path(), format, name, std::slice::from_ref(&a), &samples(40));
        let whole = fs::read(&path).unwrap();
        let mut refused = 0;
        for round in 0..400 {
            let mut bytes = whole.clone();
            match round % 4 {
                0 => bytes.truncate(random.below(whole.len())),
                1 => {
                    let (from, to) = (random.below(whole.len()), random.below(whole.len()));
                    let length = random.below(64).min(whole.len() - from.max(to));
                    bytes.copy_within(from..from + length, to);
                }
                _ => {
                    for _ in 0..=round % 3 {
                        // Half of these rounds damage the last third of the file: a footer with sizes is there.
                        let place = random.below(whole.len());
                        let place = if round % 8 < 4 { whole.len() - 1 - place.min(whole.len() / 3) } else { place };
                        bytes[place] = [0, 1, 0x7f, 0x80, 0xff, random.next() as u8][random.below(6)];
                    }
                }
            }
            fs::write(&path, &bytes).unwrap();
            match read(&path, ImuChoice::Only(a.clone())) {
                Ok(read) => assert!(read.len() <= 40, "{format:?} {round}"),
                Err(failure) => {
                    assert!(matches!(failure.exit, Exit::Data | Exit::Io), "{format:?} {round}: {failure}");
                    refused += 1;
                }
            }
        }
        assert!(refused > 80, "{format:?}: {refused} of 400 were refused");
    }
}
