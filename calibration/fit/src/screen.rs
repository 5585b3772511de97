//! Bad rows of a recording of an IMU at rest: rows that hold a value that no sensor measured. They are found while the
//! recording is read, and they go into no mean.
//!
//! # Method
//! 1. Rows are judged in chunks, each with rows of its neighbours on both sides, so that memory does not grow with the
//!    recording. Every sensor and every thermometer is a channel; rows that have a gap between them are apart.
//! 2. `level`: a parabola goes through 128 rows around 32 rows that are judged. It begins with the line that has the
//!    least median distance, which nearly half of the rows cannot move. A row is off by over 6.5 standard deviations of
//!    what is near, and by more than the channel's steps can be.
//! 3. `jumps`: rows that are off are bad if they begin and end with a jump. A warm-up that changes fast at its begin is
//!    off too, but it has no jumps.
//! 4. `stuck`: equal values in turn are bad if the channel hardly ever repeats a value nearby.
//!
//! The cost of a row is constant.

mod account;
mod channel;
mod jumps;
mod level;
mod piece;
mod stuck;

pub use account::{BadKind, BadRow, BadRows};

use channel::Channel;
use isotherm_shared::wire::{AXES, RawSample, Triad};
use piece::Piece;

/// Rows that are judged at a time.
const CHUNK: usize = 8192;
/// Rows of the neighbours on each side of them.
const MARGIN: usize = 320;
/// Rows are apart if the time between them is over this many of the usual steps.
const GAP: f64 = 10.0;
/// Temperature of an IMU that works \[degC\].
const CELSIUS: [f64; 2] = [-80.0, 150.0];
/// Sensors and thermometers.
const CHANNELS: usize = 6 * AXES;

/// Judges the rows of one recording.
#[derive(Clone, Debug)]
pub(crate) struct Screen {
    /// Rows that wait, after those that are context.
    rows: Vec<RawSample>,
    /// Rows at the begin that are judged: the verdicts on them are in `verdicts`.
    judged: usize,
    verdicts: Vec<Option<BadKind>>,
    channels: [Channel; CHANNELS],
    bad: BadRows,
}

impl Default for Screen {
    fn default() -> Self {
        Self {
            rows: Vec::new(),
            judged: 0,
            verdicts: Vec::new(),
            channels: core::array::from_fn(|_| Channel::default()),
            bad: BadRows::default(),
        }
    }
}

impl Screen {
    /// Takes a row. `take` gets the rows that are judged now, and whether each is good.
    pub(crate) fn add(&mut self, raw: &RawSample, take: impl FnMut(&RawSample, bool)) {
        self.rows.push(*raw);
        if self.rows.len() >= self.judged + CHUNK + MARGIN {
            self.judge(self.rows.len() - MARGIN, take);
        }
    }

    /// Judges the rows that still wait; returns the bad rows of the recording.
    pub(crate) fn finish(mut self, take: impl FnMut(&RawSample, bool)) -> BadRows {
        self.judge(self.rows.len(), take);
        self.bad
    }

    /// Judges all rows up to `end`, and keeps the last of them as context.
    fn judge(&mut self, end: usize, mut take: impl FnMut(&RawSample, bool)) {
        let mut verdicts = core::mem::take(&mut self.verdicts);
        verdicts.resize(self.rows.len(), None);
        let columns = Columns::of(&self.rows);
        for rows in columns.pieces() {
            self.not_measured(&columns, rows.clone(), &mut verdicts);
        }
        for (number, values) in columns.values.iter().enumerate() {
            let Some(values) = values else { continue };
            for rows in columns.pieces() {
                let is_known: Vec<bool> = verdicts[rows.clone()].iter().map(Option::is_some).collect();
                let piece = Piece {
                    times: &columns.times[rows.clone()],
                    values: &values[rows.clone()],
                    tolerance: columns.tolerance[number],
                    is_known: &is_known,
                    is_thermometer: number >= 2 * AXES,
                };
                for (row, kind) in self.channels[number].bad(&piece) {
                    let verdict = &mut verdicts[rows.start + row];
                    *verdict = verdict.or(Some(kind));
                }
            }
        }
        for (raw, verdict) in self.rows[..end].iter().zip(&verdicts).skip(self.judged) {
            if let Some(kind) = verdict {
                self.bad.add(raw.timestamp_ns, *kind);
            }
            take(raw, verdict.is_none());
        }
        let kept = end.saturating_sub(MARGIN);
        self.rows.drain(..kept);
        self.verdicts = verdicts[kept..end].to_vec();
        self.judged = end - kept;
    }

    /// Marks rows with what is no value, and with temperatures that no IMU has.
    fn not_measured(&self, columns: &Columns, rows: core::ops::Range<usize>, verdicts: &mut [Option<BadKind>]) {
        for (number, values) in columns.values.iter().enumerate() {
            let Some(values) = values else { continue };
            let values = &values[rows.clone()];
            let is_celsius = number >= 2 * AXES && {
                let usual = isotherm_statistics::median(values.iter().copied().filter(|value| value.is_finite()));
                (CELSIUS[0]..=CELSIUS[1]).contains(&usual)
            };
            for (row, value) in values.iter().enumerate() {
                let kind = match () {
                    () if !value.is_finite() => BadKind::NoNumber,
                    () if is_celsius && !(CELSIUS[0]..=CELSIUS[1]).contains(value) => BadKind::Temperature,
                    () => continue,
                };
                let verdict = &mut verdicts[rows.start + row];
                *verdict = verdict.or(Some(kind));
            }
        }
    }
}

/// The rows by channel.
struct Columns {
    /// \[s\]
    times: Vec<f64>,
    sessions: Vec<u64>,
    /// Rates \[pulse/s\] of the sensors, and temperature; NaN of a full counter. `None` of a channel that never
    /// changes, or that is as another one.
    values: Vec<Option<Vec<f64>>>,
    tolerance: Vec<f64>,
}

impl Columns {
    fn of(rows: &[RawSample]) -> Self {
        let first_ns = rows.first().map_or(0, |raw| raw.timestamp_ns);
        let has_gyroscopes = rows.iter().any(|raw| !raw.gyroscopes.is_absent());
        let triads = |raw: &RawSample| [raw.accelerometers, raw.gyroscopes];
        let mut values: Vec<Option<Vec<f64>>> = Vec::with_capacity(CHANNELS);
        for channel in 0..CHANNELS {
            let (part, triad, axis) = (channel / (2 * AXES), channel / AXES % 2, channel % AXES);
            let value = |raw: &RawSample| match part {
                0 => rate(&triads(raw)[triad], axis, raw.interval_ns),
                1 => triads(raw)[triad].head_temperature[axis],
                _ => triads(raw)[triad].board_temperature[axis],
            };
            let column: Vec<f64> = rows.iter().map(value).collect();
            let first = column.first().map(|value| value.to_bits());
            let is_constant = column.iter().all(|value| Some(value.to_bits()) == first && value.is_finite());
            let is_there = triad == 0 || has_gyroscopes;
            let is_new = || !values.iter().flatten().any(|other| same(other, &column));
            values.push((is_there && !is_constant && is_new()).then_some(column));
        }
        let usual_s = isotherm_statistics::median(rows.iter().map(|raw| raw.interval_ns as f64 / 1e9));
        // Readings that were made pulses carry a rounding of up to a pulse.
        let tolerance = |channel: usize| if channel < 2 * AXES { 1.01 / usual_s } else { 0.0 };
        Self {
            times: rows.iter().map(|raw| (raw.timestamp_ns.saturating_sub(first_ns)) as f64 / 1e9).collect(),
            sessions: rows.iter().map(|raw| raw.session).collect(),
            values,
            tolerance: (0..CHANNELS).map(tolerance).collect(),
        }
    }

    /// The rows without a gap between them.
    fn pieces(&self) -> Vec<core::ops::Range<usize>> {
        let steps = || self.times.windows(2).map(|pair| pair[1] - pair[0]);
        let usual = isotherm_statistics::median(steps());
        let is_gap = |row: usize| {
            self.sessions[row] != self.sessions[row - 1] || self.times[row] - self.times[row - 1] > GAP * usual
        };
        let starts = (1..self.times.len()).filter(|row| is_gap(*row));
        let ends: Vec<usize> = core::iter::once(0).chain(starts).chain([self.times.len()]).collect();
        ends.windows(2).map(|pair| pair[0]..pair[1]).filter(|rows| !rows.is_empty()).collect()
    }
}

/// Net pulses per second; NaN of a full counter.
fn rate(triad: &Triad, axis: usize, interval_ns: u64) -> f64 {
    let [positive, negative] = [triad.positive_pulses[axis], triad.negative_pulses[axis]];
    if positive == u32::MAX || negative == u32::MAX {
        return f64::NAN;
    }
    (f64::from(positive) - f64::from(negative)) / (interval_ns.max(1) as f64 / 1e9)
}

/// Whether two columns are the same, bit by bit.
fn same(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).all(|(a, b)| a.to_bits() == b.to_bits())
}
