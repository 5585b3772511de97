//! The columns of recordings: one list for every format, reader and writer.

use isotherm_shared::wire::{AXES, RawSample};

/// A column's type.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ColumnKind {
    /// Whole number of 64 bits without a sign.
    U64,
    /// Whole number of 32 bits without a sign.
    U32,
    /// Double.
    F64,
    /// Text of a few characters.
    Text,
}

/// A column: name, type and unit.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name in every format.
    pub name: &'static str,
    /// Its type where the format has types.
    pub kind: ColumnKind,
    /// Unit, or what the values are.
    pub unit: &'static str,
}

const fn column(name: &'static str, kind: ColumnKind, unit: &'static str) -> Column {
    Column { name, kind, unit }
}

/// Column with the Unix time at which the recorder received the sample. Only `isotherm record` writes it, so it marks a file as the
/// recorder's.
pub const RECORDED_NS: &str = "recorded_ns";

/// Places in [`RAW`] of the columns that readers and writers name.
pub const SESSION: usize = 1;
/// Place of `sequence`.
pub const SEQUENCE: usize = 2;
/// Place of `timestamp_ns`.
pub const TIMESTAMP_NS: usize = 3;
/// Place of `interval_ns`.
pub const INTERVAL_NS: usize = 4;
/// Place of `telemetry_ns`.
pub const TELEMETRY_NS: usize = 6;
/// Place of the first axis' columns: positive and negative pulses, head and board telemetry. The other axes' follow.
pub const FIRST_AXIS: usize = 7;
/// Columns of an axis.
pub const PER_AXIS: usize = 4;

/// Columns of raw samples that a recording may do without.
pub const OPTIONAL: [&str; 4] = [RECORDED_NS, "session", "sent_ns", "telemetry_ns"];

/// Columns of a campaign's rows, before those of the raw sample: the chamber's set point and the number of the position, which is empty
/// in rows that were taken while the table moved.
pub const CAMPAIGN: [Column; 2] = [
    column("set_point_c", ColumnKind::F64, "degC, set point of the chamber"),
    column("position", ColumnKind::U32, "number of the position; empty while the table moves"),
];

/// The first bytes of a Parquet file.
pub const PARQUET_MAGIC: &[u8] = b"PAR1";
/// The first bytes of an MCAP file.
pub const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Formats of recordings that are no text, by their first bytes.
pub const BINARY_FORMATS: [(&[u8], &str); 2] = [(PARQUET_MAGIC, "Parquet"), (MCAP_MAGIC, "MCAP")];

const HEAD: [Column; 5] = [
    column(RECORDED_NS, ColumnKind::U64, "ns, UTC since 1970, when the recorder took it"),
    column("session", ColumnKind::U64, "chosen at random by the acquisition each time it starts"),
    column("sequence", ColumnKind::U64, "rises by 1 with each sample of a session"),
    column("timestamp_ns", ColumnKind::U64, "ns, acquisition clock, end of the period"),
    column("interval_ns", ColumnKind::U64, "ns, control period"),
];

/// Columns of raw samples. What exists is never renumbered: a column's place is its field's number in MCAP.
pub const RAW: [Column; 19] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    column("sent_ns", ColumnKind::U64, "ns, CLOCK_MONOTONIC when it was sent; 0 = unknown"),
    column("telemetry_ns", ColumnKind::U64, "ns, acquisition clock when the temperatures were read; 0 = unknown"),
    column("a1_positive", ColumnKind::U32, "pulses"),
    column("a1_negative", ColumnKind::U32, "pulses"),
    column("a1_head", ColumnKind::F64, "unit of the table's telemetry"),
    column("a1_board", ColumnKind::F64, "unit of the table's telemetry"),
    column("a2_positive", ColumnKind::U32, "pulses"),
    column("a2_negative", ColumnKind::U32, "pulses"),
    column("a2_head", ColumnKind::F64, "unit of the table's telemetry"),
    column("a2_board", ColumnKind::F64, "unit of the table's telemetry"),
    column("a3_positive", ColumnKind::U32, "pulses"),
    column("a3_negative", ColumnKind::U32, "pulses"),
    column("a3_head", ColumnKind::F64, "unit of the table's telemetry"),
    column("a3_board", ColumnKind::F64, "unit of the table's telemetry"),
];

/// Columns of increments. What exists is never renumbered.
pub const INCREMENT: [Column; 13] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    column("a1_dv", ColumnKind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("a2_dv", ColumnKind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("a3_dv", ColumnKind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("table", ColumnKind::Text, "first 16 hexadecimal digits of the table's digest"),
    column("flags", ColumnKind::Text, "names of the sample flags joined by |; - for none"),
    column("delivery", ColumnKind::Text, "names of the delivery flags joined by |; - for none"),
    column("flag_bits", ColumnKind::U32, "all flags as one number"),
    column("latency_ns", ColumnKind::U32, "ns, from sending the raw sample to publishing the increment"),
];

/// Stores the value of the column at `place` of [`RAW`] in a sample: a whole number, or the bits of a double. What only the recorder
/// knows (`recorded_ns`, `sent_ns`) is left out: it is no part of a sample that is read.
pub fn store(raw: &mut RawSample, place: usize, value: u64) {
    match place {
        SESSION => raw.session = value,
        SEQUENCE => raw.sequence = value,
        TIMESTAMP_NS => raw.timestamp_ns = value,
        INTERVAL_NS => raw.interval_ns = value,
        TELEMETRY_NS => raw.telemetry_ns = value,
        FIRST_AXIS.. => {
            let axis = (place - FIRST_AXIS) / PER_AXIS % AXES;
            match (place - FIRST_AXIS) % PER_AXIS {
                0 => raw.positive_pulses[axis] = value as u32,
                1 => raw.negative_pulses[axis] = value as u32,
                2 => raw.head_temperature[axis] = f64::from_bits(value),
                _ => raw.board_temperature[axis] = f64::from_bits(value),
            }
        }
        _ => {}
    }
}
