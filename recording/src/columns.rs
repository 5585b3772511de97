//! The columns of recordings: one list for every format, reader and writer.

pub use isotherm_shared::content::MCAP_MAGIC;
use isotherm_shared::content::PARQUET_MAGIC;
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, RawSample, StreamSample, Triad};

/// A column's type.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ColumnKind {
    /// Unsigned integer of 64 bits.
    U64,
    /// Unsigned integer of 32 bits.
    U32,
    /// IEEE 754 double.
    F64,
    /// Text: 16 hexadecimal digits.
    Hex,
    /// Text: names of flags joined by `|`, `-` for none.
    Flags,
}

/// Which files have a column.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum ColumnSet {
    /// Every file.
    Always,
    /// Every file of the recorder; other files may lack it.
    Recorder,
    /// Files of samples whose unit is known.
    Device,
    /// Files of an IMU that has gyroscopes: all columns of the set.
    Gyroscopes,
    /// Files of samples with lagged temperature: all columns of the set.
    Lag,
    /// Files of an IMU with gyroscopes, of samples with lagged temperature: all columns of the set.
    LaggedGyroscopes,
    /// Files of a recorder that measures the offset of Unix time.
    UnixOffset,
}

/// A column: name, type and unit.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Its name in every format.
    pub name: &'static str,
    /// The field number in MCAP files. It never changes.
    pub number: u64,
    /// Which files have it.
    pub set: ColumnSet,
    /// Its type, in formats that have types.
    pub kind: ColumnKind,
    /// Unit, or meaning of the values.
    pub unit: &'static str,
}

/// Which of the columns that depend on the samples a file has.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Layout {
    /// `device`.
    pub device: bool,
    /// The columns of the gyroscopes.
    pub gyroscopes: bool,
    /// Time constant and lagged temperature.
    pub lag: bool,
    /// The offset of Unix time, and its uncertainty.
    pub unix_offset: bool,
}

impl Layout {
    /// The columns that a sample needs.
    #[must_use]
    pub fn of(sample: &StreamSample) -> Self {
        match sample {
            StreamSample::Raw(raw) => {
                let gyroscopes = !raw.gyroscopes.is_absent();
                Self { device: raw.device != 0, gyroscopes, lag: raw.lag_ns != 0, unix_offset: false }
            }
            StreamSample::Increment(increment) => {
                let flags = Flags(increment.flags).intersects(GYROSCOPE_FLAGS);
                let gyroscopes = flags || !increment.angle_increment.iter().all(|angle| angle.is_nan());
                Self { gyroscopes, ..Self::default() }
            }
        }
    }

    /// The columns of both.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self {
            device: self.device || other.device,
            gyroscopes: self.gyroscopes || other.gyroscopes,
            lag: self.lag || other.lag,
            unix_offset: self.unix_offset || other.unix_offset,
        }
    }

    /// The part of it that matters to a stream.
    #[must_use]
    pub const fn of_stream(self, stream: StreamKind) -> Self {
        match stream {
            StreamKind::Raw => self,
            StreamKind::Increment => Self { device: false, lag: false, ..self },
        }
    }

    /// Whether a file of the recorder with this layout has the column.
    #[must_use]
    pub const fn has(self, column: &Column) -> bool {
        match column.set {
            ColumnSet::Always | ColumnSet::Recorder => true,
            ColumnSet::Device => self.device,
            ColumnSet::Gyroscopes => self.gyroscopes,
            ColumnSet::Lag => self.lag,
            ColumnSet::LaggedGyroscopes => self.gyroscopes && self.lag,
            ColumnSet::UnixOffset => self.unix_offset,
        }
    }
}

/// The layouts of a recorder's files: every choice of columns.
pub fn layouts() -> impl Iterator<Item = (StreamKind, Layout)> {
    let of = |bits: u8| {
        let [device, gyroscopes, lag, unix_offset] = [1, 2, 4, 8].map(|bit| bits & bit != 0);
        Layout { device, gyroscopes, lag, unix_offset }
    };
    let raw = (0..16).map(move |bits| (StreamKind::Raw, of(bits)));
    raw.chain([0, 2, 8, 10].map(move |bits| (StreamKind::Increment, of(bits))))
}

/// The flags that only an increment under a table with gyroscopes has.
const GYROSCOPE_FLAGS: Flags = Flags(Flags((1 << 18) - 1).of_gyroscopes().0 | Flags::G_UNKNOWN.0);

const fn column(number: u64, set: ColumnSet, name: &'static str, kind: ColumnKind, unit: &'static str) -> Column {
    Column { name, number, set, kind, unit }
}

/// Index of `recorded_ns` in [`RAW`]: the Unix time at which the recorder received the sample. Only `isotherm record`
/// writes it, so it identifies the files of the recorder.
pub const RECORDED_NS: usize = 0;
/// Index of `session` in [`RAW`].
pub const SESSION: usize = 1;
/// Index of `sequence` in [`RAW`].
pub const SEQUENCE: usize = 2;
/// Index of `timestamp_ns` in [`RAW`].
pub const TIMESTAMP_NS: usize = 3;
/// Index of `interval_ns` in [`RAW`].
pub const INTERVAL_NS: usize = 4;
/// Index of `sent_ns` in [`RAW`].
pub const SENT_NS: usize = 5;
/// Index of `telemetry_ns` in [`RAW`].
pub const TELEMETRY_NS: usize = 6;
/// Index in [`RAW`] of the columns of A1: positive and negative pulses, head and board temperature. Those of A2 and A3
/// follow.
pub const ACCELEROMETERS: usize = 7;
/// Index of `device` in [`RAW`].
pub const DEVICE: usize = 19;
/// Index in [`RAW`] of the columns of G1, as for [`ACCELEROMETERS`].
pub const GYROSCOPES: usize = 20;
/// Index of `lag_ns` in [`RAW`]. The lagged head temperature of A1 to A3 and G1 to G3 follows.
pub const LAG_NS: usize = 32;

/// Index in [`RAW`] of the columns of the recorder's offset of Unix time.
pub const UNIX_OFFSET: usize = GYROSCOPES_LAGGED + AXES;
/// The name of the offset of Unix time; the other column of its set has the uncertainty.
pub(crate) const UNIX_OFFSET_NS: &str = "unix_offset_ns";

/// Number of columns of a sensor, without the lagged temperature.
const PER_SENSOR: usize = 4;
/// Index of `a1_head_lagged` in [`RAW`].
const ACCELEROMETERS_LAGGED: usize = LAG_NS + 1;
/// Index of `g1_head_lagged` in [`RAW`].
const GYROSCOPES_LAGGED: usize = ACCELEROMETERS_LAGGED + AXES;

/// Columns of a campaign's rows that come before those of the raw sample: the chamber's set point and the number of the
/// position. The position is empty in rows that were taken while the turntable moved.
pub const CAMPAIGN: [Column; 2] = [
    column(0, ColumnSet::Always, "set_point_c", ColumnKind::F64, "degC, set point of the chamber"),
    column(0, ColumnSet::Always, "position", ColumnKind::U32, "number of the position; empty while the table moves"),
];

/// First bytes and names of binary files that are no text.
pub const BINARY_FORMATS: [(&[u8], &str); 2] = [(PARQUET_MAGIC, "Parquet"), (MCAP_MAGIC, "MCAP")];

const HEAD: [Column; 5] = [
    column(1, ColumnSet::Recorder, "recorded_ns", ColumnKind::U64, "ns, UTC since 1970, when the recorder took it"),
    column(
        2,
        ColumnSet::Recorder,
        "session",
        ColumnKind::U64,
        "chosen at random by the acquisition each time it starts",
    ),
    column(3, ColumnSet::Always, "sequence", ColumnKind::U64, "rises by 1 with each sample of a session"),
    column(4, ColumnSet::Always, "timestamp_ns", ColumnKind::U64, "ns, acquisition clock, end of the period"),
    column(5, ColumnSet::Always, "interval_ns", ColumnKind::U64, "ns, control period"),
];

/// A column of pulses.
const fn pulses(number: u64, set: ColumnSet, name: &'static str) -> Column {
    column(number, set, name, ColumnKind::U32, "pulses")
}

/// A column of temperature.
const fn temperature(number: u64, set: ColumnSet, name: &'static str) -> Column {
    column(number, set, name, ColumnKind::F64, "unit of the table's temperature")
}

/// A column of lagged temperature.
const fn lagged(number: u64, set: ColumnSet, name: &'static str) -> Column {
    column(number, set, name, ColumnKind::F64, "unit of the table's temperature; the head's behind the lag")
}

/// The offset of Unix time, with the numbers of its columns.
const fn unix_offset([offset, uncertainty]: [u64; 2]) -> [Column; 2] {
    let of_offset = "ns, Unix time less CLOCK_MONOTONIC of the machine that recorded; 0 = unknown";
    let of_uncertainty = "ns, bound of the error of unix_offset_ns; 0 = unknown";
    [
        column(offset, ColumnSet::UnixOffset, UNIX_OFFSET_NS, ColumnKind::U64, of_offset),
        column(uncertainty, ColumnSet::UnixOffset, "unix_offset_uncertainty_ns", ColumnKind::U64, of_uncertainty),
    ]
}

/// Columns of raw samples. New ones are added at the end.
pub const RAW: [Column; 41] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    column(6, ColumnSet::Recorder, "sent_ns", ColumnKind::U64, "ns, CLOCK_MONOTONIC when it was sent; 0 = unknown"),
    column(
        7,
        ColumnSet::Recorder,
        "telemetry_ns",
        ColumnKind::U64,
        "ns, acquisition clock when the temperatures were read; 0 = unknown",
    ),
    pulses(8, ColumnSet::Always, "a1_positive"),
    pulses(9, ColumnSet::Always, "a1_negative"),
    temperature(10, ColumnSet::Always, "a1_head"),
    temperature(11, ColumnSet::Always, "a1_board"),
    pulses(12, ColumnSet::Always, "a2_positive"),
    pulses(13, ColumnSet::Always, "a2_negative"),
    temperature(14, ColumnSet::Always, "a2_head"),
    temperature(15, ColumnSet::Always, "a2_board"),
    pulses(16, ColumnSet::Always, "a3_positive"),
    pulses(17, ColumnSet::Always, "a3_negative"),
    temperature(18, ColumnSet::Always, "a3_head"),
    temperature(19, ColumnSet::Always, "a3_board"),
    column(20, ColumnSet::Device, "device", ColumnKind::Hex, "number of the device; 0 = unknown"),
    pulses(21, ColumnSet::Gyroscopes, "g1_positive"),
    pulses(22, ColumnSet::Gyroscopes, "g1_negative"),
    temperature(23, ColumnSet::Gyroscopes, "g1_head"),
    temperature(24, ColumnSet::Gyroscopes, "g1_board"),
    pulses(25, ColumnSet::Gyroscopes, "g2_positive"),
    pulses(26, ColumnSet::Gyroscopes, "g2_negative"),
    temperature(27, ColumnSet::Gyroscopes, "g2_head"),
    temperature(28, ColumnSet::Gyroscopes, "g2_board"),
    pulses(29, ColumnSet::Gyroscopes, "g3_positive"),
    pulses(30, ColumnSet::Gyroscopes, "g3_negative"),
    temperature(31, ColumnSet::Gyroscopes, "g3_head"),
    temperature(32, ColumnSet::Gyroscopes, "g3_board"),
    column(
        33,
        ColumnSet::Lag,
        "lag_ns",
        ColumnKind::U64,
        "ns, time constant of the lagged temperature; 0 = there is none",
    ),
    lagged(34, ColumnSet::Lag, "a1_head_lagged"),
    lagged(35, ColumnSet::Lag, "a2_head_lagged"),
    lagged(36, ColumnSet::Lag, "a3_head_lagged"),
    lagged(37, ColumnSet::LaggedGyroscopes, "g1_head_lagged"),
    lagged(38, ColumnSet::LaggedGyroscopes, "g2_head_lagged"),
    lagged(39, ColumnSet::LaggedGyroscopes, "g3_head_lagged"),
    unix_offset([40, 41])[0],
    unix_offset([40, 41])[1],
];

/// A column of velocity increments.
const fn velocity(number: u64, name: &'static str) -> Column {
    let unit = "m/s over the interval; NaN where it could not be computed";
    column(number, ColumnSet::Always, name, ColumnKind::F64, unit)
}

/// A column of angle increments.
const fn angle(number: u64, name: &'static str) -> Column {
    let unit = "rad over the interval; NaN where it could not be computed";
    column(number, ColumnSet::Gyroscopes, name, ColumnKind::F64, unit)
}

/// Columns of increments.
pub const INCREMENT: [Column; 18] = [
    HEAD[0],
    HEAD[1],
    HEAD[2],
    HEAD[3],
    HEAD[4],
    velocity(6, "a1_dv"),
    velocity(7, "a2_dv"),
    velocity(8, "a3_dv"),
    angle(14, "g1_da"),
    angle(15, "g2_da"),
    angle(16, "g3_da"),
    column(9, ColumnSet::Always, "table", ColumnKind::Hex, "first 16 hexadecimal digits of the table's digest"),
    column(10, ColumnSet::Always, "flags", ColumnKind::Flags, "names of the sample flags joined by |; - for none"),
    column(11, ColumnSet::Always, "delivery", ColumnKind::Flags, "names of the delivery flags joined by |; - for none"),
    column(12, ColumnSet::Always, "flag_bits", ColumnKind::U64, "all flags as one number"),
    column(
        13,
        ColumnSet::Always,
        "latency_ns",
        ColumnKind::U64,
        "ns, from sending the raw sample to publishing the increment",
    ),
    unix_offset([17, 18])[0],
    unix_offset([17, 18])[1],
];

/// The value of the column with this index in [`RAW`]: an integer, or the bits of a double. A sample has no
/// `recorded_ns`, and no offset of Unix time.
#[must_use]
pub fn load(raw: &RawSample, index: usize) -> u64 {
    let part = |triad: &Triad, index: usize| {
        let sensor = index / PER_SENSOR % AXES;
        match index % PER_SENSOR {
            0 => u64::from(triad.positive_pulses[sensor]),
            1 => u64::from(triad.negative_pulses[sensor]),
            2 => triad.head_temperature[sensor].to_bits(),
            _ => triad.board_temperature[sensor].to_bits(),
        }
    };
    match index {
        SESSION => raw.session,
        SEQUENCE => raw.sequence,
        TIMESTAMP_NS => raw.timestamp_ns,
        INTERVAL_NS => raw.interval_ns,
        SENT_NS => raw.sent_ns,
        TELEMETRY_NS => raw.telemetry_ns,
        ACCELEROMETERS..DEVICE => part(&raw.accelerometers, index - ACCELEROMETERS),
        DEVICE => raw.device,
        GYROSCOPES..LAG_NS => part(&raw.gyroscopes, index - GYROSCOPES),
        LAG_NS => raw.lag_ns,
        ACCELEROMETERS_LAGGED..GYROSCOPES_LAGGED => {
            raw.accelerometers.head_lagged[index - ACCELEROMETERS_LAGGED].to_bits()
        }
        GYROSCOPES_LAGGED..UNIX_OFFSET => raw.gyroscopes.head_lagged[index - GYROSCOPES_LAGGED].to_bits(),
        _ => 0,
    }
}

/// Stores a value of the column with this index in [`RAW`] in a sample: an integer, or the bits of a double.
/// `recorded_ns`, `sent_ns` and the offset of Unix time are ignored: samples that are read from a recording do not have
/// them.
pub fn store(raw: &mut RawSample, index: usize, value: u64) {
    let part = |triad: &mut Triad, index: usize| {
        let sensor = index / PER_SENSOR % AXES;
        match index % PER_SENSOR {
            0 => triad.positive_pulses[sensor] = value as u32,
            1 => triad.negative_pulses[sensor] = value as u32,
            2 => triad.head_temperature[sensor] = f64::from_bits(value),
            _ => triad.board_temperature[sensor] = f64::from_bits(value),
        }
    };
    match index {
        SESSION => raw.session = value,
        SEQUENCE => raw.sequence = value,
        TIMESTAMP_NS => raw.timestamp_ns = value,
        INTERVAL_NS => raw.interval_ns = value,
        TELEMETRY_NS => raw.telemetry_ns = value,
        ACCELEROMETERS..DEVICE => part(&mut raw.accelerometers, index - ACCELEROMETERS),
        DEVICE => raw.device = value,
        GYROSCOPES..LAG_NS => part(&mut raw.gyroscopes, index - GYROSCOPES),
        LAG_NS => raw.lag_ns = value,
        ACCELEROMETERS_LAGGED..GYROSCOPES_LAGGED => {
            raw.accelerometers.head_lagged[index - ACCELEROMETERS_LAGGED] = f64::from_bits(value);
        }
        GYROSCOPES_LAGGED..UNIX_OFFSET => {
            raw.gyroscopes.head_lagged[index - GYROSCOPES_LAGGED] = f64::from_bits(value);
        }
        _ => {}
    }
}

/// The value of the column with this index in [`INCREMENT`], as for [`load`]; of a column with flags, their bits.
#[must_use]
pub fn load_increment(increment: &CompensatedIncrement, index: usize) -> u64 {
    let flags = Flags(increment.flags);
    match index {
        SESSION => increment.session,
        SEQUENCE => increment.sequence,
        TIMESTAMP_NS => increment.timestamp_ns,
        INTERVAL_NS => increment.interval_ns,
        5..8 => increment.velocity_increment[index - 5].to_bits(),
        8..11 => increment.angle_increment[index - 8].to_bits(),
        11 => increment.table,
        12 => flags.only(Flags::SAMPLE).0,
        13 => flags.only(Flags::DELIVERY).0,
        14 => flags.0,
        15 => increment.latency_ns,
        _ => 0,
    }
}

/// Stores a value of the column with this index in [`INCREMENT`] in an increment: an integer, or the bits of a double.
/// `recorded_ns`, and the parts of the flags that have columns of their own, are ignored.
pub const fn store_increment(increment: &mut CompensatedIncrement, index: usize, value: u64) {
    match index {
        SESSION => increment.session = value,
        SEQUENCE => increment.sequence = value,
        TIMESTAMP_NS => increment.timestamp_ns = value,
        INTERVAL_NS => increment.interval_ns = value,
        5..8 => increment.velocity_increment[index - 5] = f64::from_bits(value),
        8..11 => increment.angle_increment[index - 8] = f64::from_bits(value),
        11 => increment.table = value,
        14 => increment.flags = value,
        15 => increment.latency_ns = value,
        _ => {}
    }
}

/// The columns that a file of raw samples lacks to have its sets whole: for each column its name and set, and whether
/// the file has it.
pub fn incomplete<'a>(
    columns: impl Iterator<Item = (&'a str, ColumnSet)> + Clone,
    found: impl Fn(&str) -> bool,
) -> Vec<&'a str> {
    let any = |wanted: ColumnSet| columns.clone().any(|(name, set)| set == wanted && found(name));
    // The lagged temperature of gyroscopes does not ask for gyroscopes: of an IMU that has none, the readers leave it
    // out.
    let gyroscopes = any(ColumnSet::Gyroscopes);
    let lag = any(ColumnSet::Lag) || any(ColumnSet::LaggedGyroscopes);
    let needed = |set: ColumnSet| match set {
        ColumnSet::Gyroscopes => gyroscopes,
        ColumnSet::Lag => lag,
        ColumnSet::LaggedGyroscopes => gyroscopes && lag,
        ColumnSet::Always | ColumnSet::Recorder | ColumnSet::Device | ColumnSet::UnixOffset => false,
    };
    columns.clone().filter(|(name, set)| needed(*set) && !found(name)).map(|(name, _)| name).collect()
}

/// What to do about [`incomplete`] sets.
pub const INCOMPLETE_HINT: &str = "a recording has all columns of the gyroscopes (g1_positive, g1_negative, g1_head, g1_board, g2_.., g3_..) or \
     none, and all of the lagged temperature (lag_ns, a1_head_lagged, a2_.., a3_.., with gyroscopes also g1_head_lagged, ..) or none";

/// The number in a field of kind [`ColumnKind::Hex`]: 16 hexadecimal digits; also nothing, or `0`, for 0. `None` for
/// any other text.
#[must_use]
pub fn hex(text: &[u8]) -> Option<u64> {
    if text.is_empty() || text == b"0" {
        return Some(0);
    }
    if text.len() != 16 || !text.iter().all(u8::is_ascii_hexdigit) {
        return None;
    }
    u64::from_str_radix(core::str::from_utf8(text).ok()?, 16).ok()
}

/// Columns of a stream's recording.
#[must_use]
pub fn columns(stream: StreamKind, layout: Layout) -> Vec<Column> {
    all(stream).iter().filter(|column| layout.has(column)).copied().collect()
}

pub(crate) const fn all(stream: StreamKind) -> &'static [Column] {
    match stream {
        StreamKind::Raw => &RAW,
        StreamKind::Increment => &INCREMENT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files of MCAP that exist have these numbers.
    #[test]
    fn no_field_is_renumbered() {
        let numbered = |columns: &[Column]| {
            let mut names: Vec<_> = columns.iter().map(|column| (column.number, column.name)).collect();
            names.sort_unstable();
            assert!(names.iter().map(|(number, _)| *number).eq(1..=names.len() as u64), "{names:?}");
            names.into_iter().map(|(_, name)| name).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(
            numbered(&RAW),
            "recorded_ns session sequence timestamp_ns interval_ns sent_ns telemetry_ns \
             a1_positive a1_negative a1_head a1_board a2_positive a2_negative a2_head a2_board \
             a3_positive a3_negative a3_head a3_board device \
             g1_positive g1_negative g1_head g1_board g2_positive g2_negative g2_head g2_board \
             g3_positive g3_negative g3_head g3_board lag_ns a1_head_lagged a2_head_lagged a3_head_lagged \
             g1_head_lagged g2_head_lagged g3_head_lagged unix_offset_ns unix_offset_uncertainty_ns"
        );
        assert_eq!(
            numbered(&INCREMENT),
            "recorded_ns session sequence timestamp_ns interval_ns a1_dv a2_dv a3_dv table flags delivery flag_bits \
             latency_ns g1_da g2_da g3_da unix_offset_ns unix_offset_uncertainty_ns"
        );
    }

    /// Every column of a raw sample has a place of its own, which reads back what was stored.
    #[test]
    fn what_is_stored_is_loaded() {
        let mut raw = RawSample::default();
        let bits = |index: usize| match RAW[index].kind {
            ColumnKind::U32 => 100 + index as u64,
            _ => (100.0 + index as f64).to_bits(),
        };
        (0..RAW.len()).for_each(|index| store(&mut raw, index, bits(index)));
        for (index, column) in RAW.iter().enumerate() {
            let is_ignored = [RECORDED_NS, SENT_NS].contains(&index) || column.set == ColumnSet::UnixOffset;
            let kept = if is_ignored { 0 } else { bits(index) };
            assert_eq!(load(&raw, index), kept, "{}", column.name);
        }
        assert_eq!(raw.gyroscopes.board_temperature[2], 100.0 + 31.0);
        assert_eq!(raw.gyroscopes.head_lagged[2], 100.0 + 38.0);
        assert_eq!(load(&RawSample { sent_ns: 7, ..raw }, SENT_NS), 7);
    }

    #[test]
    fn an_imu_without_gyroscopes_needs_none_of_the_new_columns() {
        let raw = |raw: RawSample| Layout::of(&StreamSample::Raw(raw));
        let accelerometers = Triad { head_temperature: [1.0; AXES], ..Triad::default() };
        let plain = RawSample { session: 1, accelerometers, ..RawSample::default() };
        assert_eq!(raw(plain), Layout::default());
        let minus_zero = Triad { board_temperature: [0.0, 0.0, -0.0], ..Triad::default() };
        let pulses = Triad { negative_pulses: [0, 1, 0], ..Triad::default() };
        for gyroscopes in [minus_zero, pulses] {
            assert_eq!(raw(RawSample { gyroscopes, ..plain }), Layout { gyroscopes: true, ..Layout::default() });
        }
        assert_eq!(raw(RawSample { device: 1, ..plain }), Layout { device: true, ..Layout::default() });
        assert_eq!(raw(RawSample { lag_ns: 1, ..plain }), Layout { lag: true, ..Layout::default() });

        let nan = [f64::NAN; AXES];
        let increment = |angle_increment, flags: Flags| {
            let plain = CompensatedIncrement { angle_increment, flags: flags.0, ..CompensatedIncrement::default() };
            Layout::of(&StreamSample::Increment(plain)).gyroscopes
        };
        let of_accelerometers = Flags(((1 << 26) - 1) & !Flags::G_UNKNOWN.0);
        assert!(!increment(nan, Flags::default()) && !increment(nan, of_accelerometers));
        assert!(increment([f64::NAN, 0.0, f64::NAN], Flags::default()));
        assert!(increment(nan, Flags::G_UNKNOWN) && increment(nan, Flags::rate(2).of_gyroscopes()));
    }
}
