//! What a recording holds of each stream: the same columns in every format.

use core::fmt::Display;
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, RawSample};

/// A column's type.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Kind {
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
    pub kind: Kind,
    /// Unit, or what the values are.
    pub unit: &'static str,
}

const fn column(name: &'static str, kind: Kind, unit: &'static str) -> Column {
    Column { name, kind, unit }
}

/// UNIX time when the recorder took the sample. No other recording has this column: by it the reader knows one of ours.
pub const RECORDED_NS: &str = "recorded_ns";

const HEAD: [Column; 5] = [
    column(RECORDED_NS, Kind::U64, "ns, UTC since 1970, when the recorder took it"),
    column("session", Kind::U64, "chosen at random by the acquisition each time it starts"),
    column("sequence", Kind::U64, "rises by 1 with each sample of a session"),
    column("timestamp_ns", Kind::U64, "ns, acquisition clock, end of the period"),
    column("interval_ns", Kind::U64, "ns, control period"),
];

/// Columns of raw samples. What exists is never renumbered: a column's place is its field's number in MCAP.
pub const RAW: [Column; 19] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    column("sent_ns", Kind::U64, "ns, CLOCK_MONOTONIC when it was sent; 0 = unknown"),
    column("telemetry_ns", Kind::U64, "ns, acquisition clock when the temperatures were read; 0 = unknown"),
    column("a1_positive", Kind::U32, "pulses"),
    column("a1_negative", Kind::U32, "pulses"),
    column("a1_head", Kind::F64, "unit of the table's telemetry"),
    column("a1_board", Kind::F64, "unit of the table's telemetry"),
    column("a2_positive", Kind::U32, "pulses"),
    column("a2_negative", Kind::U32, "pulses"),
    column("a2_head", Kind::F64, "unit of the table's telemetry"),
    column("a2_board", Kind::F64, "unit of the table's telemetry"),
    column("a3_positive", Kind::U32, "pulses"),
    column("a3_negative", Kind::U32, "pulses"),
    column("a3_head", Kind::F64, "unit of the table's telemetry"),
    column("a3_board", Kind::F64, "unit of the table's telemetry"),
];

/// Columns of increments. What exists is never renumbered.
pub const INCREMENT: [Column; 13] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    column("a1_dv", Kind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("a2_dv", Kind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("a3_dv", Kind::F64, "m/s over the interval; NaN where it could not be computed"),
    column("table", Kind::Text, "first 16 hexadecimal digits of the table's digest"),
    column("flags", Kind::Text, "names of the sample flags joined by |; - for none"),
    column("delivery", Kind::Text, "names of the delivery flags joined by |; - for none"),
    column("flag_bits", Kind::U32, "all flags as one number"),
    column("latency_ns", Kind::U32, "ns, from sending the raw sample to publishing the increment"),
];

/// Takes a row's values, column by column.
pub trait Values {
    /// A [`Kind::U64`].
    fn u64(&mut self, value: u64);
    /// A [`Kind::U32`].
    fn u32(&mut self, value: u32);
    /// A [`Kind::F64`].
    fn f64(&mut self, value: f64);
    /// A [`Kind::Text`].
    fn text(&mut self, value: impl Display);
}

/// Sets what the column of [`RAW`] at `place` holds: a whole number, or the bits of a double. What only the recorder knows, when it was
/// sent and taken, is no part of a sample that is read.
pub fn set(raw: &mut RawSample, place: usize, value: u64) {
    const AXIS: usize = 7;
    match place {
        1 => raw.session = value,
        2 => raw.sequence = value,
        3 => raw.timestamp_ns = value,
        4 => raw.interval_ns = value,
        6 => raw.telemetry_ns = value,
        AXIS.. => {
            let axis = (place - AXIS) / 4 % AXES;
            match (place - AXIS) % 4 {
                0 => raw.positive_pulses[axis] = value as u32,
                1 => raw.negative_pulses[axis] = value as u32,
                2 => raw.head_temperature[axis] = f64::from_bits(value),
                _ => raw.board_temperature[axis] = f64::from_bits(value),
            }
        }
        _ => {}
    }
}

/// What has been received, of which IMU of the recorder's list, and when.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Place in the recorder's list of IMUs.
    pub imu: usize,
    /// UNIX time \[ns\].
    pub recorded_ns: u64,
    /// What it is.
    pub sample: Sample,
}

/// One of the two that travel.
#[derive(Clone, Copy, Debug)]
pub enum Sample {
    /// From the raw stream.
    Raw(RawSample),
    /// From the increment stream.
    Increment(CompensatedIncrement),
}

/// Which of an IMU's two streams.
#[derive(Clone, Copy, Debug, Eq, PartialEq, clap::ValueEnum)]
pub enum Stream {
    /// Raw samples
    Raw,
    /// Compensated increments
    Increment,
}

impl Stream {
    /// Both, in the order of their numbers.
    pub const BOTH: [Self; 2] = [Self::Raw, Self::Increment];

    /// Its columns.
    pub const fn columns(self) -> &'static [Column] {
        match self {
            Self::Raw => &RAW,
            Self::Increment => &INCREMENT,
        }
    }

    /// As in its stream's name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Increment => "increment",
        }
    }
}

impl Row {
    /// The stream that it came from.
    pub const fn stream(&self) -> Stream {
        match self.sample {
            Sample::Raw(_) => Stream::Raw,
            Sample::Increment(_) => Stream::Increment,
        }
    }

    /// Session and sequence.
    pub const fn key(&self) -> (u64, u64) {
        match &self.sample {
            Sample::Raw(raw) => (raw.session, raw.sequence),
            Sample::Increment(increment) => (increment.session, increment.sequence),
        }
    }

    /// The acquisition's time \[ns\].
    pub const fn timestamp_ns(&self) -> u64 {
        match &self.sample {
            Sample::Raw(raw) => raw.timestamp_ns,
            Sample::Increment(increment) => increment.timestamp_ns,
        }
    }

    /// Hands over the values in the order of the columns.
    pub fn visit(&self, values: &mut impl Values) {
        let (session, sequence) = self.key();
        values.u64(self.recorded_ns);
        values.u64(session);
        values.u64(sequence);
        values.u64(self.timestamp_ns());
        match &self.sample {
            Sample::Raw(raw) => {
                values.u64(raw.interval_ns);
                values.u64(raw.sent_ns);
                values.u64(raw.telemetry_ns);
                for axis in 0..AXES {
                    values.u32(raw.positive_pulses[axis]);
                    values.u32(raw.negative_pulses[axis]);
                    values.f64(raw.head_temperature[axis]);
                    values.f64(raw.board_temperature[axis]);
                }
            }
            Sample::Increment(increment) => {
                let flags = Flags(increment.flags);
                values.u64(increment.interval_ns);
                increment.velocity_increment.iter().for_each(|dv| values.f64(*dv));
                values.text(format_args!("{:016x}", increment.table));
                values.text(flags.only(Flags::SAMPLE));
                values.text(flags.only(Flags::DELIVERY));
                values.u32(flags.0);
                values.u32(increment.latency_ns);
            }
        }
    }
}
