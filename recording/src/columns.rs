//! The columns of recordings: one list for every format, reader and writer.

use isotherm_shared::wire::{AXES, RawSample};

/// A column's type.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ColumnKind {
    /// Unsigned integer of 64 bits.
    U64,
    /// Unsigned integer of 32 bits.
    U32,
    /// IEEE 754 double.
    F64,
    /// Text of a few characters.
    Text,
}

/// A column: name, type and unit.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name in every format.
    pub name: &'static str,
    /// Its type, in formats that have types.
    pub kind: ColumnKind,
    /// Unit, or meaning of the values.
    pub unit: &'static str,
}

const fn column(name: &'static str, kind: ColumnKind, unit: &'static str) -> Column {
    Column { name, kind, unit }
}

/// Column with the Unix time at which the recorder received the sample. Only `isotherm record` writes it, so it identifies the
/// files of the recorder.
pub const RECORDED_NS: &str = "recorded_ns";

/// Index of `session` in [`RAW`].
pub const SESSION: usize = 1;
/// Index of `sequence` in [`RAW`].
pub const SEQUENCE: usize = 2;
/// Index of `timestamp_ns` in [`RAW`].
pub const TIMESTAMP_NS: usize = 3;
/// Index of `interval_ns` in [`RAW`].
pub const INTERVAL_NS: usize = 4;
/// Index of `telemetry_ns` in [`RAW`].
pub const TELEMETRY_NS: usize = 6;
/// Index in [`RAW`] of the first axis' columns: positive and negative pulses, head and board telemetry. Those of the other axes
/// follow.
pub const FIRST_AXIS: usize = 7;
/// Number of columns of an axis.
pub const PER_AXIS: usize = 4;

/// Columns of raw samples that may be missing in a recording.
pub const OPTIONAL: [&str; 4] = [RECORDED_NS, "session", "sent_ns", "telemetry_ns"];

/// Columns of a campaign's rows that come before those of the raw sample: the chamber's set point and the number of the position.
/// The position is empty in rows that were taken while the turntable moved.
pub const CAMPAIGN: [Column; 2] = [
    column("set_point_c", ColumnKind::F64, "degC, set point of the chamber"),
    column("position", ColumnKind::U32, "number of the position; empty while the table moves"),
];

/// The first bytes of a Parquet file.
pub const PARQUET_MAGIC: &[u8] = b"PAR1";
/// The first bytes of an MCAP file.
pub const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// First bytes and names of the binary formats of recordings.
pub const BINARY_FORMATS: [(&[u8], &str); 2] = [(PARQUET_MAGIC, "Parquet"), (MCAP_MAGIC, "MCAP")];

const HEAD: [Column; 5] = [
    column(RECORDED_NS, ColumnKind::U64, "ns, UTC since 1970, when the recorder took it"),
    column("session", ColumnKind::U64, "chosen at random by the acquisition each time it starts"),
    column("sequence", ColumnKind::U64, "rises by 1 with each sample of a session"),
    column("timestamp_ns", ColumnKind::U64, "ns, acquisition clock, end of the period"),
    column("interval_ns", ColumnKind::U64, "ns, control period"),
];

/// Columns of raw samples. Existing columns are never renumbered: the index plus 1 is the field number in MCAP files.
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

/// Columns of increments. Existing columns are never renumbered, as in [`RAW`].
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

/// Stores a value of the column with this index in [`RAW`] in a sample: an integer, or the bits of a double. `recorded_ns` and
/// `sent_ns` are ignored: samples that are read from a recording do not have them.
pub fn store(raw: &mut RawSample, index: usize, value: u64) {
    match index {
        SESSION => raw.session = value,
        SEQUENCE => raw.sequence = value,
        TIMESTAMP_NS => raw.timestamp_ns = value,
        INTERVAL_NS => raw.interval_ns = value,
        TELEMETRY_NS => raw.telemetry_ns = value,
        FIRST_AXIS.. => {
            let axis = (index - FIRST_AXIS) / PER_AXIS % AXES;
            match (index - FIRST_AXIS) % PER_AXIS {
                0 => raw.positive_pulses[axis] = value as u32,
                1 => raw.negative_pulses[axis] = value as u32,
                2 => raw.head_temperature[axis] = f64::from_bits(value),
                _ => raw.board_temperature[axis] = f64::from_bits(value),
            }
        }
        _ => {}
    }
}
