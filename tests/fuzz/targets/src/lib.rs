//! The fuzz targets as functions of bytes, and what they share: samples with any bits, and the checks of every answer
//! and every refusal.
//!
//! A violated guarantee is a panic. `fuzz/` runs them under libFuzzer; the test of this crate runs them on the corpora.
#![allow(clippy::expect_used, clippy::panic, clippy::missing_panics_doc, reason = "a panic is the report")]

pub mod acquire;
pub mod campaign;
pub mod config;
pub mod convert;
pub mod formats;
pub mod recording;
pub mod sample;
pub mod table;

use isotherm_recording::steps;
use isotherm_shared::compensate::answer;
use isotherm_shared::document::Faults;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable, Gyroscopes, OutOfRange};
use isotherm_shared::wire::{AXES, CompensatedIncrement, Flags, MAX_INTERVAL_NS, RawSample, Triad};
use rustix::fs::{MemfdFlags, memfd_create};
use std::fs::File;
use std::os::fd::AsRawFd as _;
use std::path::PathBuf;

/// Size of a sample in shared memory \[bytes\].
pub const SAMPLE: usize = size_of::<RawSample>();

/// Checks that each fault has a line number within the text and a message.
pub fn check_faults(text: &str, faults: &Faults) {
    let lines = 1 + text.bytes().filter(|byte| *byte == b'\n').count();
    assert!((1..=101).contains(&faults.0.len()), "{} faults", faults.0.len());
    for fault in &faults.0 {
        assert!((1..=lines).contains(&fault.line), "line {} of {lines}: {fault}", fault.line);
        assert!(!fault.message.is_empty(), "{fault:?}");
    }
}

/// The sample with these bytes in shared memory.
#[must_use]
pub fn sample(bytes: &[u8; SAMPLE]) -> RawSample {
    let long = |at: usize| u64::from_ne_bytes(bytes[at..].first_chunk().copied().unwrap_or_default());
    let word = |at: usize| u32::from_ne_bytes(bytes[at..].first_chunk().copied().unwrap_or_default());
    let words = |at: usize| [at, at + 4, at + 8].map(word);
    let doubles = |at: usize| [at, at + 8, at + 16].map(|at| f64::from_bits(long(at)));
    let triad = |at: usize| Triad {
        positive_pulses: words(at),
        negative_pulses: words(at + 12),
        head_temperature: doubles(at + 24),
        board_temperature: doubles(at + 48),
        head_lagged: doubles(at + 72),
    };
    RawSample {
        session: long(0),
        sequence: long(8),
        timestamp_ns: long(16),
        interval_ns: long(24),
        sent_ns: long(32),
        telemetry_ns: long(40),
        lag_ns: long(48),
        device: long(56),
        accelerometers: triad(64),
        gyroscopes: triad(160),
    }
}

/// Whether two numbers are equal to the last bit; all NaNs count as equal.
#[must_use]
pub fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Compensates a sample with any bits, and checks every guarantee about the answer.
pub fn checked(table: Option<&CoefficientTable>, raw: &RawSample) -> CompensatedIncrement {
    let found = answer(table, raw);
    let again = answer(table, raw);
    let bits = |increment: &CompensatedIncrement| {
        [increment.velocity_increment, increment.angle_increment].map(|triad| triad.map(f64::to_bits))
    };
    assert_eq!((bits(&found), found.flags), (bits(&again), again.flags));
    assert_eq!((found.session, found.sequence), (raw.session, raw.sequence));
    assert_eq!((found.timestamp_ns, found.interval_ns), (raw.timestamp_ns, raw.interval_ns));
    assert_eq!((found.table, found.latency_ns), (table.map_or(0, CoefficientTable::id), 0));

    let accelerometers = Expected::of(table, table.map(|table| &table.content().axes), raw, &raw.accelerometers);
    let accelerometers =
        accelerometers.aligned(table.and_then(|table| table.content().alignment.as_ref()).map(|matrix| matrix.amax()));
    accelerometers.check(&found.velocity_increment, raw);
    let of_gyroscopes = match table.and_then(|table| Some((table, table.content().gyroscopes.as_ref()?))) {
        Some((table, gyroscopes)) => checked_gyroscopes(table, gyroscopes, raw, &accelerometers, &found),
        None => {
            assert!(found.angle_increment.iter().all(|angle| angle.is_nan()), "{found:?}");
            Flags::default()
        }
    };
    let flags = of_sample(table, raw) | accelerometers.flags | of_gyroscopes;
    assert_eq!(found.flags, flags.0, "{} instead of {flags}", Flags(found.flags));
    assert_eq!(flags.only(Flags::SAMPLE), flags);
    found
}

/// The flags that no sensor gives.
fn of_sample(table: Option<&CoefficientTable>, raw: &RawSample) -> Flags {
    // The highest bit is the mark of the acquisition, and no part of the time.
    let (is_marked, read_ns) = (raw.telemetry_ns >> 63 == 1, raw.telemetry_ns % (1 << 63));
    let age = raw.timestamp_ns.abs_diff(read_ns) as f64 / 1e9;
    let known = read_ns != 0 && raw.timestamp_ns != 0;
    let limit = table.and_then(|table| table.content().max_age_s);
    let own = table.map_or(0, CoefficientTable::device);
    let nominal = table.map_or(0, CoefficientTable::nominal_ns);
    union([
        (!has_valid_interval(raw), Flags::INTERVAL),
        (
            nominal != 0 && has_valid_interval(raw) && !is_near_multiple(nominal, raw.interval_ns),
            Flags::INTERVAL_NOT_NOMINAL,
        ),
        (table.is_none(), Flags::NO_TABLE),
        (table.is_some() && is_marked || known && limit.is_some_and(|limit| age > limit), Flags::TELEMETRY_STALE),
        (![0, raw.device].contains(&own) && raw.device != 0, Flags::OTHER_DEVICE),
    ])
}

/// Whether any multiple, 1 to 64, is within 1 % of the interval: the rule of the kernel, without a nearest one.
fn is_near_multiple(nominal_ns: u64, interval_ns: u64) -> bool {
    (1..=64).any(|m| u128::from(interval_ns.abs_diff(m * nominal_ns)) * 100 <= u128::from(m * nominal_ns))
}

/// The flags whose conditions hold.
fn union(flags: impl IntoIterator<Item = (bool, Flags)>) -> Flags {
    let holding = flags.into_iter().filter(|(holds, _)| *holds);
    holding.fold(Flags::default(), |all, (_, flag)| all | flag)
}

/// Checks the angle increments. Returns the flags of the gyroscopes.
fn checked_gyroscopes(
    table: &CoefficientTable,
    gyroscopes: &Gyroscopes,
    raw: &RawSample,
    accelerometers: &Expected,
    found: &CompensatedIncrement,
) -> Flags {
    let mut expected = Expected::of(Some(table), Some(&gyroscopes.axes), raw, &raw.gyroscopes);
    let absent = raw.gyroscopes.is_absent() && raw.gyroscopes.head_temperature[0].is_nan();
    let lag_unknown = if absent { Flags::default() } else { expected.flags.only(Flags::LAG_UNKNOWN) };
    let flags = lag_unknown | Flags(expected.flags.0 & !Flags::LAG_UNKNOWN.0).of_gyroscopes();
    // A velocity increment that is NaN costs an angle nothing but its g-sensitivity. One that has nearly overflowed may
    // cost it all.
    let known = found.velocity_increment.iter().all(|dv| dv.is_finite());
    for (may_overflow, g_sensitivity) in expected.may_overflow.iter_mut().zip(&gyroscopes.g_sensitivity) {
        *may_overflow |= g_sensitivity.is_some() && accelerometers.may_overflow.contains(&true);
    }
    let unknown = gyroscopes.g_sensitivity.iter().any(Option::is_some) && !known;
    expected.aligned(gyroscopes.alignment.as_ref().map(|matrix| matrix.amax())).check(&found.angle_increment, raw);
    flags | union([(unknown, Flags::G_UNKNOWN)])
}

const fn has_valid_interval(raw: &RawSample) -> bool {
    raw.interval_ns != 0 && raw.interval_ns <= MAX_INTERVAL_NS
}

/// Reads an input of this length, and checks that it takes no more steps than a file of this length may: no input makes
/// a reader slow out of proportion.
fn within_budget<T>(length: usize, read: impl FnOnce() -> T) -> T {
    let before = steps::taken();
    let read = read();
    let (taken, most) = (steps::taken() - before, steps::budget(length as u64));
    assert!(taken <= most, "{taken} steps for {length} bytes; {most} at most");
    read
}

/// A file in memory, and a path that opens it: for what reads only files.
fn memory_file() -> (File, PathBuf) {
    let file = File::from(memfd_create("input", MemfdFlags::empty()).expect("a file in memory"));
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    (file, PathBuf::from(path))
}

/// What must be true of a triad's increments.
struct Expected {
    /// As those of accelerometers, with [`Flags::LAG_UNKNOWN`].
    flags: Flags,
    /// Which sensors must have no increment.
    without: [bool; AXES],
    /// Whose increment may be NaN because it overflows, by extrapolation or by an alignment that is no rotation, or
    /// because an extrapolated scale factor has the wrong sign.
    may_overflow: [bool; AXES],
}

impl Expected {
    fn of(table: Option<&CoefficientTable>, axes: Option<&[Axis; AXES]>, raw: &RawSample, triad: &Triad) -> Self {
        let invalid = !has_valid_interval(raw);
        let mut expected =
            Self { flags: Flags::default(), without: [invalid || table.is_none(); AXES], may_overflow: [false; AXES] };
        for index in 0..AXES {
            let finite = triad.head_temperature[index].is_finite() && triad.board_temperature[index].is_finite();
            expected.flags |= union([(!finite, Flags::not_finite(index))]);
            expected.without[index] |= !finite;
            if let (Some(table), Some(axes)) = (table, axes) {
                expected.add(index, table, &axes[index], raw, triad);
            }
        }
        expected
    }

    /// Adds what the table says of a sensor.
    fn add(&mut self, index: usize, table: &CoefficientTable, axis: &Axis, raw: &RawSample, triad: &Triad) {
        let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
        let below = |p: &Polynomial, temperature: f64| temperature.is_finite() && temperature < p.range()[0];
        let above = |p: &Polynomial, temperature: f64| temperature.is_finite() && temperature > p.range()[1];
        let scale_factors = [&axis.positive_scale_factor, &axis.negative_scale_factor];
        let sides = [
            (below(&axis.bias, head), Flags::head_below(index)),
            (above(&axis.bias, head), Flags::head_above(index)),
            (scale_factors.iter().any(|p| below(p, board)), Flags::board_below(index)),
            (scale_factors.iter().any(|p| above(p, board)), Flags::board_above(index)),
        ];
        let outside = sides.iter().any(|side| side.0);
        let policy = table.content().out_of_range;
        self.without[index] |= outside && policy == OutOfRange::Reject;
        self.may_overflow[index] = outside && policy == OutOfRange::Extrapolate;
        let pulses = u64::from(triad.positive_pulses[index]) + u64::from(triad.negative_pulses[index]);
        let rate = pulses as f64 / (raw.interval_ns as f64 / 1e9);
        let fast = has_valid_interval(raw) && axis.max_rate.is_some_and(|limit| rate > limit);
        let difference = triad.head_lagged[index] - head;
        let [low, high] = axis.bias.range();
        let usable = difference.is_finite() && difference.abs() <= high - low;
        let lag_known = table.lag_ns() != 0 && raw.lag_ns == table.lag_ns() && usable;
        let others = [(fast, Flags::rate(index)), (axis.transient != 0.0 && !lag_known, Flags::LAG_UNKNOWN)];
        self.flags |= union(sides.into_iter().chain(others));
    }

    /// An alignment, given by its largest entry, combines the sensors: what holds for one then holds for all.
    fn aligned(self, largest_entry: Option<f64>) -> Self {
        /// Far above every rotation, and far below what overflows with the largest counts.
        const LARGE: f64 = 1e100;
        let Some(largest_entry) = largest_entry else { return self };
        Self {
            flags: self.flags,
            without: [self.without.contains(&true); AXES],
            may_overflow: [self.may_overflow.contains(&true) || largest_entry > LARGE; AXES],
        }
    }

    fn check(&self, increments: &[f64; AXES], raw: &RawSample) {
        for (index, increment) in increments.iter().enumerate() {
            assert!(!increment.is_infinite());
            assert!(increment.is_nan() || !self.without[index], "{increment} with {}", self.flags);
            assert!(
                increment.is_finite() || self.without[index] || self.may_overflow[index],
                "no increment of sensor {}, {}: {raw:?}",
                index + 1,
                self.flags
            );
        }
    }
}
