//! Files that `record` and `acquire --record` wrote before there were checks, in `tests/data/unchecked`: they are read
//! as they were, and known to have no checks.

use isotherm_files::{source, sources};
use isotherm_recording::Progress;
use isotherm_recording::columns::{ColumnKind, RAW, RECORDED_NS, SENT_NS, hex, load};
use isotherm_recording_formats::read::{ImuChoice, Part, Samples, read_numbers};
use isotherm_recording_formats::repair::{RepairReport, inspect, repair};
use isotherm_shared::wire::RawSample;
use std::fs;
use std::path::{Path, PathBuf};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/unchecked").join(name)
}

/// The values of a text, row by row, with their names.
fn rows(name: &str) -> Vec<Vec<(String, String)>> {
    let text = fs::read_to_string(file(name)).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let named = |row: &str| header.split(',').map(str::to_owned).zip(row.split(',').map(str::to_owned)).collect();
    rows.lines().map(named).collect()
}

/// Asserts that a sample has the values of a row, and 0 in the columns that the text does not have.
fn assert_is(raw: &RawSample, row: &[(String, String)]) {
    for (index, column) in RAW.iter().enumerate().filter(|(index, _)| ![RECORDED_NS, SENT_NS].contains(index)) {
        let Some((_, text)) = row.iter().find(|(name, _)| name == column.name) else { continue };
        let expected = match column.kind {
            ColumnKind::F64 => text.parse::<f64>().unwrap().to_bits(),
            ColumnKind::Hex => hex(text.as_bytes()).unwrap(),
            _ => text.parse().unwrap(),
        };
        assert_eq!(load(raw, index), expected, "{}", column.name);
    }
}

/// A recording, and the text of its rows.
const RAW_FILES: [(&str, &str, usize); 6] = [
    ("recorded.csv", "recorded.csv", 40),
    ("recorded.parquet", "recorded.csv", 40),
    ("recorded.mcap", "recorded.csv", 40),
    ("acquired.csv", "acquired.csv", 19),
    ("acquired.parquet", "acquired.parquet.csv", 19),
    ("acquired.mcap", "acquired.mcap.csv", 19),
];

#[test]
fn files_from_before_there_were_checks_are_read_as_they_were() {
    for (name, text, count) in RAW_FILES {
        let samples = Samples::open(&sources(&[file(name)]).unwrap(), ImuChoice::Any, &Progress::default()).unwrap();
        let samples: Vec<_> = samples.map(Result::unwrap).collect();
        let rows = rows(text);
        assert_eq!((samples.len(), rows.len()), (count, count), "{name}");
        samples.iter().zip(&rows).for_each(|(raw, row)| assert_is(raw, row));
    }
    let names = ["sequence", "a1_dv", "a2_dv", "a3_dv", "g1_da", "g2_da", "g3_da", "flag_bits"];
    let number = |_, text: &str| text.parse::<f64>().map_err(|_| "a number");
    let values = |name: &str| {
        let read = read_numbers(
            &sources(&[file(name)]).unwrap(),
            &names,
            &ImuChoice::Any,
            Part::default(),
            &Progress::default(),
            number,
        )
        .unwrap();
        read.rows.into_iter().map(|row| row.values).collect::<Vec<_>>()
    };
    let text = rows("recorded.increments.csv");
    let value = |row: &[(String, String)], name: &str| {
        row.iter().find(|(own, _)| own == name).unwrap().1.parse::<f64>().unwrap()
    };
    let expected: Vec<Vec<_>> = text.iter().map(|row| names.iter().map(|name| value(row, name)).collect()).collect();
    assert_eq!(expected.len(), 40);
    for name in ["recorded.increments.csv", "recorded.increments.parquet", "recorded.mcap"] {
        assert!(values(name) == expected, "{name}");
    }
}

#[test]
fn files_from_before_there_were_checks_are_known_and_can_be_repaired() {
    for name in
        RAW_FILES.map(|(name, ..)| name).into_iter().chain(["recorded.increments.csv", "recorded.increments.parquet"])
    {
        let RepairReport { has_checks, holes, streams, .. } = inspect(&source(file(name))).unwrap();
        // Chunks of MCAP have always had one.
        assert_eq!((has_checks, holes.len()), (name.ends_with("mcap"), 0), "{name}");
        let count = if name.starts_with("recorded") { (40, 2) } else { (19, 1) };
        assert!(streams.iter().all(|stream| (stream.rows, stream.sessions) == count), "{name}: {streams:?}");
        // What is taken of them has none either: nothing vouches for it.
        let mut taken = Vec::new();
        repair(&source(file(name)), &mut taken).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, &taken).unwrap();
        assert_eq!(inspect(&source(&path)).unwrap().has_checks, has_checks, "{name}");
        if name.ends_with("csv") {
            assert!(taken == fs::read(file(name)).unwrap(), "{name}");
        }
    }
}

/// Without checks a row is damaged if it cannot be read, and a sequence is wrong if those around it say so.
#[test]
fn of_a_text_without_checks_what_can_be_read_is_taken() {
    let text = fs::read_to_string(file("recorded.csv")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    let lines: Vec<_> = text.lines().collect();
    let repaired = |changed: &[(usize, String)]| {
        let mut lines: Vec<_> = lines.iter().map(|line| (*line).to_owned()).collect();
        changed.iter().for_each(|(line, new)| lines[*line].clone_from(new));
        fs::write(&path, lines.join("\n") + "\n").unwrap();
        let mut taken = Vec::new();
        let repaired = repair(&source(&path), &mut taken).unwrap();
        (repaired, String::from_utf8(taken).unwrap())
    };
    let without = |gone: &[usize]| {
        let kept = lines.iter().enumerate().filter(|(line, _)| !gone.contains(line));
        kept.map(|(_, line)| format!("{line}\n")).collect::<String>()
    };
    // A letter, a field too few, a whole line of zeros.
    let (report, taken) = repaired(&[
        (5, lines[5].replacen("50000000", "5000z000", 1)),
        (6, lines[6].rsplit_once(',').unwrap().0.to_owned()),
        (12, "\0".repeat(300)),
    ]);
    assert_eq!((taken, report.lost(), report.holes.len()), (without(&[5, 6, 12]), Some(3), 2), "{report:?}");
    assert_eq!(report.holes[0].place, "lines 6 to 7");
    // Row 9 has sequence 8: a step forth, and back.
    let sequence =
        |line: usize, from: &str, to: &str| (line, lines[line].replacen(&format!(",{from},"), &format!(",{to},"), 1));
    for to in ["9008", "3"] {
        let (report, taken) = repaired(&[sequence(9, "8", to)]);
        assert_eq!((taken, report.lost()), (without(&[9]), Some(1)), "{report:?}");
        assert!(report.holes[0].cause.starts_with(&format!("sequence {to} between 7 and 9")), "{report:?}");
    }
}
