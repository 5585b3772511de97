//! Parts of recordings of several pieces.

use crate::foreign::{Files, foreign};
use isotherm_files::sources;
use isotherm_recording::Progress;
use isotherm_recording::RecordingError;
use isotherm_recording_formats::read::{ImuChoice, Input, Part, Recording, RecordingTime, RowKind};
use sha2::{Digest as _, Sha256};
use std::path::PathBuf;

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.1\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-5\n[temperature]\ncolumns = \"T\"\n";

/// Rows of 0.1 s whose stamps are these tenths of a second, with a tenth of it as temperature.
fn text(tenths: core::ops::Range<u32>) -> String {
    let row = |tenth: u32| format!("{}.{},0.5,-0.25,9.8,{}\n", tenth / 10, tenth % 10, f64::from(tenth) / 10.0);
    "t,x,y,z,T\n".to_owned() + &tenths.map(row).collect::<String>()
}

fn open(files: &[PathBuf], from: f64, to: f64) -> Recording {
    let part = Part::new(Some(RecordingTime::Seconds(from)), Some(RecordingTime::Seconds(to))).unwrap();
    let input = Input::from((ImuChoice::Any, foreign(Some(MAPPING)))).within(part);
    Recording::open_hashed(&sources(files).unwrap(), RowKind::Sample, input, &Progress::default()).unwrap()
}

/// Stamps in tenths of a second.
fn stamps(recording: &mut Recording) -> Vec<u64> {
    recording.map(|row| row.unwrap().sample.timestamp_ns / 100_000_000).collect()
}

#[test]
fn the_pieces_of_a_recording_have_one_begin_and_the_hash_is_of_all() {
    let files = Files::new();
    let texts = [text(51..61), text(61..71), text(71..81)];
    let pieces: Vec<_> = [2, 0, 1].map(|piece| files.write(&format!("{piece}.txt"), &texts[piece])).to_vec();
    let hash =
        |texts: &[String]| Sha256::digest(texts.concat()).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    // Within a piece, over pieces, and behind the first.
    for (from, to, wanted) in [(0.2, 0.5, 53..56), (0.8, 1.3, 59..64), (1.5, 9.0, 66..81), (0.0, 0.1, 51..52)] {
        let mut recording = open(&pieces, from, to);
        assert_eq!(stamps(&mut recording), wanted.clone().collect::<Vec<_>>());
        let (before, seconds) = recording.left_out();
        assert_eq!(before, wanted.start - 51);
        assert!((seconds - (wanted.start - 51) as f64 / 10.0).abs() < 1e-9);
        let note = recording.notes().pop().unwrap();
        assert!(
            note.starts_with(&format!("{} rows are read, from {from} s to {to} s", wanted.clone().count())),
            "{note}"
        );
        // What a table of the readings covers is what was read.
        let nominal = recording.nominal(&"imu-a".parse().unwrap()).unwrap();
        if wanted.clone().count() > 1 {
            assert_eq!(nominal.range, [wanted.start as f64 / 10.0, (wanted.end - 1) as f64 / 10.0]);
        }
        assert_eq!(recording.sha256().unwrap(), hash(&texts));
    }
}

#[test]
fn a_fault_behind_the_part_is_not_met_and_one_before_it_is() {
    let files = Files::new();
    // One row would be left out.
    let broken = text(51..71).replace("6.4,", "broken,").replace("6.5,", "broken,");
    let path = files.write("broken.txt", broken);
    assert_eq!(stamps(&mut open(core::slice::from_ref(&path), 0.0, 1.0)).len(), 10);
    let error = open(core::slice::from_ref(&path), 1.6, 9.0).find_map(Result::err);
    assert!(matches!(error, Some(RecordingError::Data { .. })), "{error:?}");
    let mut recording = open(&[path], 0.0, 0.05);
    let error = recording.next().unwrap().unwrap_err();
    assert!(recording.failure(&error).message.contains("broken.txt: no row from 0 s to 0.05 s"), "{error}");
    assert!(recording.next().is_none());
}
