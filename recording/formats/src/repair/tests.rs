//! Files as `record` writes them, damaged in every way: no row is ever read with another number, and what is taken is
//! what was recorded, without the damaged row, row group or chunk.
#![allow(clippy::unwrap_used, reason = "helpers of tests, in which the panic is the report")]

use super::{Hole, RepairReport, inspect, repair};
use crate::read::tests::{TestRandom, bits, read};
use crate::read::{ImuChoice, Part, read_numbers};
use crate::write::parquet::write_groups;
use crate::write::{Files, Format, Rotation};
use isotherm_files::{Disk, source, sources};
use isotherm_recording::Layout;
use isotherm_recording::Progress;
use isotherm_recording::rows::{RecordedOffset, RecordedRow};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample, Triad};
use isotherm_support::failure::Exit;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Rows of a recording, and of a row group and of a chunk.
const ROWS: usize = 240;
const UNIT: usize = 30;
/// Damaged files of each kind.
const SEEDS: u64 = 120;
const LAYOUT: Layout = Layout { device: true, gyroscopes: true, lag: true, unix_offset: true };

fn imu() -> ImuId {
    "imu-a".parse().unwrap()
}

/// Two sessions, with a gap.
fn samples() -> Vec<RawSample> {
    let mut random = TestRandom(7);
    let mut triad = |lagged: f64| Triad {
        positive_pulses: [(); 3].map(|()| random.next() as u32 >> 8),
        negative_pulses: [(); 3].map(|()| random.next() as u32 % 3),
        head_temperature: [(); 3].map(|()| 20.0 + random.below(1000) as f64 / 977.0),
        board_temperature: [25.25, -0.5, 1e-7],
        head_lagged: [lagged; 3],
    };
    let made = (0..ROWS as u64).map(|number| {
        let second = number >= 100;
        let sequence = if second {
            number - 100
        } else if number > 50 {
            number + 5
        } else {
            number
        };
        RawSample {
            session: if second { 6_550_915_373_864_606_449 } else { 17_000_000_000_000_000_007 },
            sequence,
            timestamp_ns: 1_050_000_000 + number * 2_500_000,
            interval_ns: 2_500_000,
            telemetry_ns: 1_050_000_000 + number / 8 * 20_000_000,
            lag_ns: 240_000_000_000,
            device: 0x46a7_426e_f29c_c83b,
            accelerometers: triad(20.5),
            gyroscopes: triad(21.5),
            ..RawSample::default()
        }
    });
    made.collect()
}

fn increment(raw: &RawSample) -> CompensatedIncrement {
    CompensatedIncrement {
        session: raw.session,
        sequence: raw.sequence,
        timestamp_ns: raw.timestamp_ns,
        interval_ns: raw.interval_ns,
        velocity_increment: raw.accelerometers.head_temperature.map(|value| value / 977.0),
        angle_increment: raw.gyroscopes.head_temperature.map(|value| value / 9770.0),
        table: 0x344b_2bd4_35b5_041a,
        flags: raw.sequence % 4,
        latency_ns: 1234,
    }
}

fn rows(stream: StreamKind) -> Vec<RecordedRow> {
    let row = |raw: &RawSample| RecordedRow {
        imu: 0,
        recorded_ns: 1_795_741_168_131_947_502 + raw.timestamp_ns,
        unix_offset: RecordedOffset::new(1_795_741_168_131_000_000, 30 + raw.sequence / 9),
        sample: match stream {
            StreamKind::Raw => StreamSample::Raw(*raw),
            StreamKind::Increment => StreamSample::Increment(increment(raw)),
        },
    };
    samples().iter().map(row).collect()
}

/// What is read of a file, row by row.
type ReadRows = Result<Vec<String>, Exit>;

/// A file of the recorder.
struct RecordedFile {
    name: String,
    path: PathBuf,
    stream: StreamKind,
    whole: Vec<u8>,
    /// Its rows.
    rows: Vec<String>,
    /// Most rows that damage at one place may take.
    unit: usize,
}

impl RecordedFile {
    fn read(&self, path: &Path) -> ReadRows {
        read_rows(path, self.stream)
    }

    /// Writes damaged bytes. Returns what is read of them, and what is taken of them by `repair`.
    fn damaged(&self, bytes: &[u8]) -> (ReadRows, Option<(RepairReport, Vec<String>)>) {
        let target = self.path.with_file_name("repaired").with_extension(self.path.extension().unwrap());
        let damaged = self.path.with_file_name("damaged").with_extension(self.path.extension().unwrap());
        fs::write(&damaged, bytes).unwrap();
        let mut taken = Vec::new();
        let repaired = repair(&source(&damaged), &mut taken).ok().map(|repaired| {
            fs::write(&target, &taken).unwrap();
            let rows = self.read(&target).unwrap_or_else(|exit| panic!("{}: {exit:?} {repaired:?}", self.name));
            if !repaired.holes.is_empty() {
                assert!(inspect(&source(&target)).unwrap().holes.is_empty(), "{}: {repaired:?}", self.name);
            }
            (repaired, rows)
        });
        (self.read(&damaged), repaired)
    }

    /// Asserts what must hold of a file with one damaged place. Returns whether it is refused.
    fn assert_damage(&self, bytes: &[u8], what: &str) -> bool {
        let (read, repaired) = self.damaged(bytes);
        let name = format!("{} {what}", self.name);
        if let Ok(rows) = &read {
            assert!(self.rows.starts_with(rows), "{name}: another number, with exit code 0");
        }
        let Some((repaired, rows)) = repaired else { panic!("{name}: nothing was taken") };
        self.assert_part(&name, &rows);
        let lost = self.rows.len() - rows.len();
        assert!(lost <= self.unit, "{name}: {lost} rows lost: {repaired:?}");
        assert_lost(&name, &repaired, self.stream, lost);
        // What is not whole is found, and what is found is not whole.
        assert!(read.as_ref() == Ok(&self.rows) || !repaired.holes.is_empty(), "{name}: {repaired:?}");
        read.is_err()
    }

    /// Asserts that all rows were recorded, in this order.
    fn assert_part(&self, name: &str, rows: &[String]) {
        let mut left = self.rows.iter();
        assert!(rows.iter().all(|row| left.any(|own| own == row)), "{name}: a row that was not recorded");
    }
}

/// Asserts that the report has the rows that were lost of a stream, or says that their number is not known.
fn assert_lost(name: &str, repaired: &RepairReport, stream: StreamKind, lost: usize) {
    let own = |hole: &Hole| {
        let own = hole.losses.iter().filter(|loss| loss.stream.ends_with(stream.name()));
        own.map(|loss| loss.rows).sum::<Option<u64>>()
    };
    let known: Option<u64> = repaired.holes.iter().map(own).sum();
    // Between 50 and 56 the recording has a gap.
    assert!(
        known.is_none_or(|known| [lost, lost + 5].contains(&(known as usize))),
        "{name}: {lost} lost: {repaired:?}"
    );
    assert!(lost == 0 || !repaired.holes.is_empty(), "{name}: {repaired:?}");
}

fn read_rows(path: &Path, stream: StreamKind) -> ReadRows {
    if stream == StreamKind::Raw {
        return read(path, ImuChoice::Only(imu())).map(|rows| bits(&rows)).map_err(|failure| failure.exit);
    }
    let names = ["sequence", "timestamp_ns", "interval_ns", "a1_dv", "a2_dv", "a3_dv", "g1_da", "g3_da", "flag_bits"];
    let number = |_, text: &str| text.parse::<f64>().map_err(|_| "a number");
    let read = read_numbers(
        &sources(&[path.to_owned()]).unwrap(),
        &names,
        &ImuChoice::Only(imu()),
        Part::default(),
        &Progress::default(),
        number,
    );
    let read = read.map_err(|failure| failure.exit)?;
    Ok(read
        .rows
        .iter()
        .map(|row| format!("{:?}", row.values.iter().map(|value| value.to_bits()).collect::<Vec<_>>()))
        .collect())
}

/// A recording in each format, and of each stream.
fn recorded(folder: &TempDir) -> Vec<RecordedFile> {
    let mut all = Vec::new();
    let mut add = |file: &str, stream: StreamKind, unit: usize| {
        let path = folder.path().join(file);
        let (whole, rows) = (fs::read(&path).unwrap(), read_rows(&path, stream).unwrap());
        assert_eq!(rows.len(), ROWS);
        all.push(RecordedFile { name: format!("{file} {}", stream.name()), path, stream, whole, rows, unit });
    };
    for (format, file) in [(Format::Csv, "r.csv"), (Format::Mcap, "r.mcap")] {
        let (imus, streams) = ([imu()], StreamKind::BOTH.map(|stream| (0, stream)));
        let path = folder.path().join(file);
        let mut files = Files::create(&Disk, &path, format, Rotation::default(), &imus, &streams).ok().unwrap();
        for (number, (raw, increment)) in rows(StreamKind::Raw).iter().zip(rows(StreamKind::Increment)).enumerate() {
            files.write(raw).ok().unwrap();
            files.write(&increment).ok().unwrap();
            if number % UNIT == UNIT - 1 {
                files.flush().ok().unwrap();
            }
        }
        if format == Format::Mcap {
            // As it is before its end.
            fs::copy(&path, folder.path().join("begun.mcap")).unwrap();
        }
        files.finish().ok().unwrap();
    }
    for (stream, file) in [(StreamKind::Raw, "r.parquet"), (StreamKind::Increment, "r.increments.parquet")] {
        let layout = LAYOUT.of_stream(stream);
        write_groups(&folder.path().join(file), &imu(), stream, layout, UNIT, &rows(stream)).unwrap();
    }
    // A line end that is lost joins two rows.
    for (file, stream, unit) in [
        ("r.csv", StreamKind::Raw, 2),
        ("r.increments.csv", StreamKind::Increment, 2),
        ("r.parquet", StreamKind::Raw, UNIT),
        ("r.increments.parquet", StreamKind::Increment, UNIT),
        ("r.mcap", StreamKind::Raw, UNIT),
        ("r.mcap", StreamKind::Increment, UNIT),
        ("begun.mcap", StreamKind::Raw, UNIT),
    ] {
        add(file, stream, unit);
    }
    all
}

#[test]
fn a_whole_recording_is_taken_as_it_is() {
    let folder = TempDir::new().unwrap();
    for file in recorded(&folder) {
        let (_, repaired) = file.damaged(&file.whole);
        let (repaired, rows) = repaired.unwrap();
        assert!(repaired.holes.is_empty() && repaired.has_checks && rows == file.rows, "{}: {repaired:?}", file.name);
        assert_eq!(repaired.lost(), Some(0));
        assert!(repaired.streams.iter().all(|stream| (stream.rows, stream.sessions) == (ROWS as u64, 2)));
        if file.name.contains(".csv") {
            let mut taken = Vec::new();
            repair(&source(&file.path), &mut taken).unwrap();
            assert!(taken == file.whole, "{}", file.name);
        }
    }
}

/// One flipped bit, at places by chance.
fn assert_flipped(kind: &str) {
    let folder = TempDir::new().unwrap();
    let seeds = std::env::var("ISOTHERM_MUTATIONS").ok().and_then(|text| text.parse().ok()).unwrap_or(SEEDS);
    for file in recorded(&folder).iter().filter(|file| file.name.contains(kind)) {
        let (mut refused, mut flipped) = (0, 0);
        let by_chance = (0..seeds).map(|seed| {
            let mut random = TestRandom(seed);
            (random.below(file.whole.len()), random.below(8))
        });
        // The first bytes say what follows.
        for (place, bit) in by_chance.chain((0..12).map(|place| (place, place % 8))) {
            if is_only_description(file, place) {
                continue;
            }
            let mut bytes = file.whole.clone();
            bytes[place] ^= 1 << bit;
            refused += u64::from(file.assert_damage(&bytes, &format!("byte {place} bit {bit}")));
            flipped += 1;
        }
        println!("{}: {refused} of {flipped} flipped bits refused", file.name);
        assert!(refused > flipped / 2, "{}: {refused} of {flipped}", file.name);
    }
}

#[test]
fn a_flipped_bit_in_csv_never_becomes_another_number() {
    assert_flipped("csv");
}

#[test]
fn a_flipped_bit_in_parquet_never_becomes_another_number() {
    assert_flipped("parquet");
}

#[test]
fn a_flipped_bit_in_mcap_never_becomes_another_number() {
    assert_flipped("mcap");
}

/// Every bit of a header in CSV and of the footer of a Parquet file that is not its metadata's.
#[test]
fn no_bit_of_a_header_can_be_flipped_unnoticed() {
    let folder = TempDir::new().unwrap();
    for file in recorded(&folder).iter().filter(|file| file.name.contains(".csv")) {
        let header = file.whole.iter().position(|byte| *byte == b'\n').unwrap();
        for bit in 0..(header + 1) * 8 {
            let mut bytes = file.whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            fs::write(file.path.with_file_name("damaged.csv"), &bytes).unwrap();
            let read = file.read(&file.path.with_file_name("damaged.csv"));
            assert_eq!(read, Err(Exit::Data), "{}: bit {bit}", file.name);
            if bit % 11 == 0 {
                file.assert_damage(&bytes, &format!("bit {bit}"));
            }
        }
    }
}

/// Blocks of zeros, as a file system leaves after a crash, garbage, and parts that are missing or twice.
#[test]
fn what_is_before_and_behind_a_damaged_block_is_taken() {
    let folder = TempDir::new().unwrap();
    for file in recorded(&folder) {
        for seed in 0..SEEDS / 3 {
            let mut random = TestRandom(seed);
            let mut bytes = file.whole.clone();
            let place = random.below(bytes.len());
            let length = [1, 7, 64, 512, 4096][random.below(5)].min(bytes.len() - place);
            let what = match random.below(4) {
                0 => {
                    bytes[place..place + length].fill(0);
                    "zeros"
                }
                1 => {
                    let garbage: Vec<_> = (0..length).map(|_| random.next() as u8).collect();
                    bytes.splice(place..place, garbage);
                    "garbage"
                }
                2 => {
                    bytes.drain(place..place + length);
                    "missing"
                }
                _ => {
                    let part = bytes[place..place + length].to_vec();
                    let to = random.below(bytes.len());
                    bytes.splice(to..to, part);
                    "twice"
                }
            };
            let name = format!("{} {what} {length} bytes at {place}, seed {seed}", file.name);
            let (read, repaired) = file.damaged(&bytes);
            if let Ok(rows) = &read {
                file.assert_part(&name, rows);
            }
            let Some((repaired, rows)) = repaired else {
                // Nothing else has what its channels are.
                assert!(file.name.starts_with("begun"), "{name}: nothing was taken");
                continue;
            };
            if what == "twice" {
                // Rows that come before their place make those behind them a new session.
                let without_session = |row: &String| row.split_once(' ').map(|(_, rest)| rest.to_owned());
                let mut own: Vec<_> = file.rows.iter().map(without_session).collect();
                let is_there =
                    |row| own.iter().position(|own| *own == row).map(|place| own.swap_remove(place)).is_some();
                assert!(
                    rows.iter().map(without_session).all(is_there),
                    "{name}: a row that was not recorded, or twice"
                );
                continue;
            }
            file.assert_part(&name, &rows);
            let lost = file.rows.len() - rows.len();
            // What a block covers, and the rows, groups or chunks at its borders.
            let row = file.whole.len() / file.rows.len();
            let most = 2 * file.unit + 2 * length / row + 2 * length / (row * file.unit) * file.unit;
            assert!(lost <= most, "{name}: {lost} rows lost, {most} may be: {repaired:?}");
            assert_lost(&name, &repaired, file.stream, lost);
        }
    }
}

/// Wherever a file ends, what is before the end is taken.
#[test]
fn of_a_truncated_file_all_that_is_there_is_taken() {
    let folder = TempDir::new().unwrap();
    for file in recorded(&folder) {
        let (mut counts, step) = (Vec::new(), file.whole.len() / 40);
        for length in (1..file.whole.len()).step_by(step) {
            let name = format!("{} {length} bytes", file.name);
            let (read, repaired) = file.damaged(&file.whole[..length]);
            let rows = repaired.map(|(_, rows)| rows).unwrap_or_default();
            assert!(file.rows.starts_with(&rows), "{name}");
            assert!(read.is_err() || read == Ok(rows.clone()), "{name}");
            counts.push(rows.len());
        }
        assert!(counts.is_sorted(), "{}: {counts:?}", file.name);
        let most = file.rows.len() - file.unit.max(file.rows.len() / 40 + 1);
        assert!(*counts.last().unwrap() >= most, "{}: {counts:?}", file.name);
    }
}

/// Whether the place is in the first chunk of an MCAP file that was not ended, without which no message can be read.
fn is_only_description(file: &RecordedFile, place: usize) -> bool {
    let first = 8 + 9 + file.whole[9..].first_chunk().map_or(0, |length| u64::from_le_bytes(*length) as usize);
    let end = file.whole.get(first + 1..).and_then(<[u8]>::first_chunk).map_or(0, |length| u64::from_le_bytes(*length));
    file.name.starts_with("begun") && (first..first + 9 + end as usize).contains(&place)
}
