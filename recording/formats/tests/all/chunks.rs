//! Chunks of MCAP that other programs have packed, and what is wrong with them.

use isotherm_files::{Disk, source};
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::write::{Files, Format, Rotation};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::{RawSample, StreamSample, Triad};
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::name;
use mcap::records::op;
use std::fs;
use std::path::Path;
use std::slice;
use tempfile::TempDir;

/// Messages of each bag.
const MESSAGES: usize = 60;
const NAMES: [&str; 3] = ["none", "zstd", "lz4"];

fn bag(name: &str) -> Vec<u8> {
    fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/bags/{name}.mcap"))).unwrap()
}

fn rows(bytes: &[u8]) -> Result<Vec<RawSample>, Exit> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("bag.mcap");
    fs::write(&path, bytes).unwrap();
    let opened = Conversion::open(&source(&path), None, &Settings::default());
    let rows = opened.and_then(|mut rows| {
        let read = rows.by_ref().collect::<Result<_, _>>()?;
        // What is left out is named.
        let is_whole = rows.findings().iter().all(|finding| finding.name != name::BAD_ROWS);
        if is_whole { Ok(read) } else { Err(Failure::new(Exit::Data, "damaged")) }
    });
    rows.map_err(|failure| failure.exit)
}

/// The place of the first chunk, and of its parts: size, check, packed records.
fn first_chunk(bytes: &[u8]) -> [usize; 3] {
    let header = 17 + bytes[9] as usize;
    assert_eq!(bytes[header], op::CHUNK);
    let content = header + 9;
    let name = u32::from_le_bytes(*bytes[content + 28..].first_chunk().unwrap()) as usize;
    [content + 16, content + 24, content + 32 + name + 8]
}

#[test]
fn a_bag_has_the_same_rows_whatever_its_compression() {
    let [none, zstd, lz4] = NAMES.map(|name| rows(&bag(name)).unwrap());
    assert_eq!(none.len(), MESSAGES);
    assert_eq!((&none, &none), (&zstd, &lz4));
}

/// Each byte of a chunk is covered by its check, or by that of the file.
#[test]
fn a_flipped_bit_in_a_chunk_is_seen_whatever_its_compression() {
    for name in NAMES {
        let (bytes, whole) = (bag(name), rows(&bag(name)).unwrap());
        let [_, check, packed] = first_chunk(&bytes);
        for place in (packed..packed + 600).step_by(13).chain(check..check + 4) {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1 << (place % 8);
            // Other packed bytes may unpack to the same records.
            let (read, is_same) = (rows(&damaged), name != "none" && place >= packed);
            assert!(read == Err(Exit::Data) || is_same && read.as_ref() == Ok(&whole), "{name}: byte {place}");
        }
    }
}

/// A chunk without a check, as some writers make it, must still have the length that it says.
#[test]
fn a_chunk_unpacks_to_the_length_that_it_says_or_is_left_out() {
    for name in NAMES {
        let mut bytes = bag(name);
        let [size, check, _] = first_chunk(&bytes);
        bytes[check..check + 4].fill(0);
        // The check of the data is one, too.
        let end = bytes.windows(9).rposition(|head| head == [op::DATA_END, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        bytes[end + 9..end + 13].fill(0);
        assert_eq!(rows(&bytes).unwrap().len(), MESSAGES, "{name}");
        for change in [-1_i64, 1] {
            let mut other = bytes.clone();
            let said = i64::from_le_bytes(*bytes[size..].first_chunk().unwrap());
            other[size..size + 8].copy_from_slice(&(said + change).to_le_bytes());
            assert_eq!(rows(&other), Err(Exit::Data), "{name}: {change}");
        }
    }
}

/// Rows of 1 ms of six sensors at rest, with their temperatures once a second.
#[test]
fn an_mcap_recording_has_at_most_60_bytes_a_row() {
    const ROWS: u64 = 20_000;
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("r.mcap");
    let imu = "imu-a".parse().unwrap();
    let streams = [(0, StreamKind::Raw)];
    let files = Files::create(&Disk, &path, Format::Mcap, Rotation::default(), slice::from_ref(&imu), &streams);
    let mut files = files.unwrap_or_else(|error| panic!("{}", error.1));
    let mut state = 5_u64;
    for row in 0..ROWS {
        // About normal, with a deviation of some nine pulses.
        let mut pulses = |mean: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            mean + state.to_be_bytes()[..4].iter().map(|byte| u32::from(*byte)).sum::<u32>() / 16
        };
        let celsius = 25.0 + (row / 1000) as f64 / 128.0;
        let mut triad = |means: [u32; 3]| Triad {
            positive_pulses: means.map(&mut pulses),
            head_temperature: [celsius; 3],
            board_temperature: [celsius + 1.0; 3],
            ..Triad::ABSENT
        };
        let (accelerometers, gyroscopes) = (triad([500, 700, 2000]), triad([300, 400, 600]));
        let timestamp_ns = (row + 1) * 1_000_000;
        let raw = RawSample {
            session: 1,
            sequence: row,
            timestamp_ns,
            interval_ns: 1_000_000,
            accelerometers,
            gyroscopes,
            ..RawSample::default()
        };
        files.write(&RecordedRow::new(0, timestamp_ns, StreamSample::Raw(raw))).unwrap_or_else(|_| panic!());
    }
    files.finish().unwrap_or_else(|_| panic!());
    let length = fs::metadata(&path).unwrap().len();
    println!("{:.1} bytes a row", length as f64 / ROWS as f64);
    assert!(length <= 60 * ROWS, "{length}");
}
