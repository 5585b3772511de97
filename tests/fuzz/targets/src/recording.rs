//! Input: any bytes as a recording. Rows and error must not depend on where the source splits its bytes. Accepted
//! samples that are written and read again must be equal to the last bit, and so must their increments.

use crate::{checked, same};
use isotherm_recording::csv::Rows;
use isotherm_recording::{IncrementCsvWriter, IncrementLayout, Layout, RawCsvReader, RawCsvWriter, RecordingError};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, Flags, RawSample, StreamSample};
use std::io::Read;
use std::sync::LazyLock;

static TABLE: LazyLock<CoefficientTable> = LazyLock::new(|| {
    CoefficientTable::from_toml(include_str!("../../../../examples/tables/imu-whole.toml"), None)
        .expect("a valid table")
});
/// Columns of the increments of both triads.
const INCREMENTS: [&str; 6] = ["a1_dv", "a2_dv", "a3_dv", "g1_da", "g2_da", "g3_da"];

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

/// The integers, the counters and the temperature of a sample.
type Bits = ([u64; 7], [[[u32; 3]; 2]; 2], [[[u64; 3]; 3]; 2]);

/// All fields of a sample as bits; all NaNs are written alike, so they get the same bits.
fn bits(raw: &RawSample) -> Bits {
    let bits = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
    let triads = [&raw.accelerometers, &raw.gyroscopes];
    (
        [raw.session, raw.sequence, raw.timestamp_ns, raw.interval_ns, raw.telemetry_ns, raw.lag_ns, raw.device],
        triads.map(|triad| [triad.positive_pulses, triad.negative_pulses]),
        triads.map(|triad| [triad.head_temperature, triad.board_temperature, triad.head_lagged].map(|of| of.map(bits))),
    )
}

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let (samples, error) = read(bytes);
    let all = |samples: &[RawSample]| samples.iter().map(bits).collect::<Vec<_>>();
    let (begin, end) = bytes.split_at(bytes.len() / 2);
    let (from_parts, same_error) = read(begin.chain(end));
    assert_eq!((all(&from_parts), same_error), (all(&samples), error));

    let needed = samples.iter().map(|sample| Layout::of(&StreamSample::Raw(*sample)));
    let layout = needed.fold(Layout::default(), Layout::with);
    let raw = RawCsvWriter::with_layout(Vec::new(), "session", true, layout);
    let mut raw = raw.expect("memory takes all");
    for sample in &samples {
        raw.write(sample.session, sample).expect("memory takes all");
    }
    let (again, error) = read(&*raw.finish().expect("memory takes all"));
    assert_eq!((all(&again), error), (all(&samples), None));
    increments(&samples.iter().map(|sample| checked(Some(&TABLE), sample)).collect::<Vec<_>>());
}

/// Writes answers, and compares what is written.
fn increments(answers: &[CompensatedIncrement]) {
    let layout = IncrementLayout { gyroscopes: true, delivery: true };
    let mut writer = IncrementCsvWriter::new(Vec::new(), layout).expect("memory takes all");
    answers.iter().for_each(|answer| writer.write(answer).expect("memory takes all"));
    let written = writer.finish().expect("memory takes all");
    let mut rows = Rows::new(&*written);
    assert!(rows.next_row().expect("a header"));
    let names =
        [&["sequence", "timestamp_ns", "interval_ns"][..], &INCREMENTS, &["table", "flags", "delivery"]].concat();
    let columns = rows.columns(&names, "").expect("every column");
    for answer in answers {
        assert!(rows.next_row().expect("a row"));
        let integers = [0, 1, 2].map(|column| rows.integer::<u64>(&columns[column]).expect("an integer"));
        assert_eq!(integers, [answer.sequence, answer.timestamp_ns, answer.interval_ns]);
        let values = [answer.velocity_increment, answer.angle_increment];
        for (column, value) in columns[3..].iter().zip(values.as_flattened()) {
            assert!(same(rows.float(column).expect("a number"), *value));
        }
        let [.., table, flags, _] = &columns[..] else { unreachable!("nine columns and more") };
        let table = rows.parse(table, "", |text| u64::from_str_radix(text, 16).ok()).expect("a table");
        let flags = rows.parse(flags, "", |text| Some(text.to_owned())).expect("flags");
        assert_eq!((table, flags), (TABLE.id(), Flags(answer.flags).to_string()));
    }
    assert!(!rows.next_row().expect("the end"));
}
