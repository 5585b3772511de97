//! Input: any bytes as a recording. Rows and error must not depend on where the source splits its bytes. Accepted samples that
//! are written and read again must be equal to the last bit, and so must their increments.
#![no_main]

use isotherm_fuzz::{checked, same};
use isotherm_recording::{IncrementCsvWriter, RawCsvReader, RawCsvWriter};
use isotherm_recording::{RecordingError, csv::Rows};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{Flags, RawSample};
use libfuzzer_sys::fuzz_target;
use std::io::Read;
use std::sync::LazyLock;

static TABLE: LazyLock<CoefficientTable> = LazyLock::new(|| {
    CoefficientTable::from_toml(include_str!("../../tests/data/imu-a.toml"), None).expect("a valid table")
});

/// The samples up to the first error, and its text.
fn read(source: impl Read) -> (Vec<RawSample>, Option<String>) {
    let mut samples = Vec::new();
    let result = RawCsvReader::new(source).and_then(|reader| {
        for sample in reader {
            samples.push(sample?);
        }
        Ok(())
    });
    if let Err(RecordingError::Data { line, message }) = &result {
        assert!(*line >= 1 && !message.is_empty());
    }
    (samples, result.err().map(|error| error.to_string()))
}

/// All fields of a sample as bits; all NaNs are written alike, so they get the same bits.
fn bits(raw: &RawSample) -> ([u64; 5], [[u32; 3]; 2], [[u64; 3]; 2]) {
    let bits = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
    (
        [raw.session, raw.sequence, raw.timestamp_ns, raw.interval_ns, raw.telemetry_ns],
        [raw.positive_pulses, raw.negative_pulses],
        [raw.head_temperature.map(bits), raw.board_temperature.map(bits)],
    )
}

fuzz_target!(|bytes: &[u8]| {
    let (samples, error) = read(bytes);
    let all = |samples: &[RawSample]| samples.iter().map(bits).collect::<Vec<_>>();
    let (begin, end) = bytes.split_at(bytes.len() / 2);
    let (from_parts, same_error) = read(begin.chain(end));
    assert_eq!((all(&from_parts), same_error), (all(&samples), error));

    let mut raw = RawCsvWriter::new(Vec::new(), "session", true).expect("memory takes all");
    let mut increments = IncrementCsvWriter::new(Vec::new(), true).expect("memory takes all");
    let mut answers = Vec::new();
    for sample in &samples {
        raw.write(sample.session, sample).expect("memory takes all");
        let answer = checked(Some(&TABLE), sample);
        increments.write(&answer).expect("memory takes all");
        answers.push(answer);
    }
    let (again, error) = read(&*raw.finish().expect("memory takes all"));
    assert_eq!((all(&again), error), (all(&samples), None));

    let written = increments.finish().expect("memory takes all");
    let mut rows = Rows::new(&*written);
    assert!(rows.next_row().expect("a header"));
    let names = ["sequence", "timestamp_ns", "interval_ns", "a1_dv", "a2_dv", "a3_dv", "table", "flags", "delivery"];
    let columns = rows.columns(&names, "").expect("every column");
    for answer in &answers {
        assert!(rows.next_row().expect("a row"));
        let integers = [0, 1, 2].map(|column| rows.integer::<u64>(&columns[column]).expect("an integer"));
        assert_eq!(integers, [answer.sequence, answer.timestamp_ns, answer.interval_ns]);
        for (axis, dv) in answer.velocity_increment.iter().enumerate() {
            assert!(same(rows.float(&columns[3 + axis]).expect("a number"), *dv));
        }
        let table = rows.parse(&columns[6], "", |text| u64::from_str_radix(text, 16).ok()).expect("a table");
        let flags = rows.parse(&columns[7], "", |text| Some(text.to_owned())).expect("flags");
        assert_eq!((table, flags), (TABLE.id(), Flags(answer.flags).to_string()));
    }
    assert!(!rows.next_row().expect("the end"));
});
