//! The rows whose noise is wanted, as they are read.

use super::curve::MIN_ROWS;
use super::outputs::{AnalysisSpan, Outputs};
use super::rate::RateKind;
use super::recording::{MOST_LEFT_OUT, NoiseAnalysis, NoiseError, repeated};
use super::rest::{PIECE_ROWS, Rest};
use super::rows::Rows;
use super::stretch::{Stretch, stretches};
use core::ops::Range;
use isotherm_campaign::{Begins, MAGNITUDE_ROWS, magnitude_at_rest, rate_at_rest};
use isotherm_recording::foreign::LeftOutRows;
use isotherm_recording::{Continuity, MISSING};
use isotherm_shared::sequence::Period;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_support::finding::{Finding, name};

/// Rounding of times that are typed \[s\].
const TOLERANCE_S: f64 = 1e-9;

/// Collects rows, each of which takes 8 bytes for each axis that is analysed and 8 for its times. Temperature takes 16
/// bytes where it changes. What is not analysed is not kept.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::{NoiseAnalysis, NoiseRows};
/// use isotherm_shared::wire::RawSample;
///
/// let row = |i: u64| {
///     let mut raw = RawSample { sequence: i, timestamp_ns: (i + 1) * 10_000_000, ..RawSample::default() };
///     raw.interval_ns = 10_000_000;
///     let noise = |axis: u64| 20 + ((i * (7 + axis) * 2_654_435_761) >> 16) as u32 % 7;
///     raw.accelerometers.positive_pulses = [noise(0), noise(1), 2000 + noise(2)];
///     raw
/// };
/// let mut rows = NoiseRows::new(None, [10.0, 40.0]);
/// (0..5000).for_each(|i| rows.push(&row(i)));
/// let all: Vec<_> = (0..5000).map(row).collect();
/// assert_eq!(rows.analyse()?, NoiseAnalysis::of(&all, None, [10.0, 40.0])?);
/// # Ok(())
/// # }
/// ```
pub struct NoiseRows<'a> {
    table: Option<&'a CoefficientTable>,
    /// \[s since the begin of the first row\]
    part: [f64; 2],
    rows: Rows,
    /// Most rows in which a rest is sought at once.
    piece_rows: usize,
    /// Rows of the whole recording, and those before the part.
    all: usize,
    before: usize,
    /// Whether the part has ended.
    has_ended: bool,
    begins: Begins,
    /// Where the last row ends \[s\].
    end_s: f64,
    continuity: Continuity,
    /// Whether any row has gyroscopes.
    gyroscopes: bool,
    left_out: LeftOutRows,
}

/// The longest stretch of rows at rest, and how many rows those like it have.
type Longest = (Stretch, usize);

impl NoiseAnalysis {
    /// The noise of `rows`, compensated by `table` if there is one. Only rows that begin and end within `part` count
    /// \[s since the begin of the first row\].
    ///
    /// # Errors
    /// If there are fewer than [`MIN_ROWS`] rows at rest without a gap.
    pub fn of(rows: &[RawSample], table: Option<&CoefficientTable>, part: [f64; 2]) -> Result<Self, NoiseError> {
        let mut kept = NoiseRows::new(table, part);
        rows.iter().for_each(|row| kept.push(row));
        kept.analyse()
    }
}

impl<'a> NoiseRows<'a> {
    /// Rows that begin and end within `part` are collected \[s since the begin of the first row\]; `table` compensates
    /// them.
    #[must_use]
    pub fn new(table: Option<&'a CoefficientTable>, part: [f64; 2]) -> Self {
        Self {
            table,
            part,
            rows: Rows::default(),
            piece_rows: PIECE_ROWS,
            all: 0,
            before: 0,
            has_ended: false,
            begins: Begins::default(),
            end_s: 0.0,
            continuity: Continuity::default(),
            gyroscopes: false,
            left_out: LeftOutRows::default(),
        }
    }

    /// Seeks rests in pieces of so many rows.
    #[cfg(test)]
    pub(super) const fn in_pieces_of(mut self, rows: usize) -> Self {
        self.piece_rows = rows;
        self
    }

    /// Adds the next row of the recording.
    pub fn push(&mut self, row: &RawSample) {
        self.all += 1;
        let begins_ns = self.begins.next_ns(row);
        let [begin_s, end_s] = [begins_ns, begins_ns.saturating_add(row.interval_ns)].map(|ns| ns as f64 / 1e9);
        self.end_s = end_s;
        let is_inside = begin_s >= self.part[0] - TOLERANCE_S && end_s <= self.part[1] + TOLERANCE_S;
        match (is_inside, self.rows.len()) {
            (false, 0) => self.before += 1,
            (false, _) => self.has_ended = true,
            _ => {}
        }
        if !is_inside || self.has_ended {
            return;
        }
        let has_gyroscopes = !row.gyroscopes.is_absent();
        self.gyroscopes |= has_gyroscopes;
        let in_table = self.table.is_none_or(|table| table.content().gyroscopes.is_some());
        self.rows.push(row, has_gyroscopes && in_table, begins_ns);
        self.continuity.add(row);
    }

    /// Notes the rows of the recording that were left out, since their stamps cannot be right.
    pub const fn leave_out(&mut self, rows: LeftOutRows) {
        self.left_out = rows;
    }

    /// What is missing among the rows.
    #[must_use]
    pub const fn continuity(&self) -> &Continuity {
        &self.continuity
    }

    /// The noise.
    ///
    /// # Errors
    /// If there are fewer than [`MIN_ROWS`] rows at rest without a gap, or if more than 5 % of the rows were left out
    /// by their stamps.
    pub fn analyse(self) -> Result<NoiseAnalysis, NoiseError> {
        if self.left_out.share() > MOST_LEFT_OUT {
            return Err(NoiseError::LeftOut(self.left_out));
        }
        let (rows, count) = (&self.rows, self.rows.len());
        if count == 0 {
            let seconds = self.end_s;
            return Err(NoiseError::Nothing { part: self.part.map(|end| end.min(seconds)), seconds });
        }
        let (outputs, finding) = Outputs::new(self.table, self.gyroscopes);
        let (mut not_finite, mut of_others) = (Vec::new(), 0_u64);
        let rest = Rest::of(rows, self.piece_rows, |row, sample| {
            let (rates, is_other) = outputs.rates(sample);
            of_others += u64::from(is_other);
            if !outputs.are_finite(&rates) {
                not_finite.push(row);
            }
        })?;
        let (stretch, at_rest) = longest(&rest.at_rest, rows, &not_finite);
        let used = self.before + stretch.rows().start..self.before + stretch.rows().end;
        if stretch.kept < MIN_ROWS {
            return Err(NoiseError::TooShort { rows: used, not_a_number: not_finite.len() });
        }
        let bridged = stretch.bridged();
        let ends = [stretch.rows().start, stretch.rows().end - 1];
        let [first, last] = ends.map(|row| rows.period(row));
        let interval_s = (last.timestamp_ns - first.timestamp_ns) as f64 / 1e9 / (bridged.of - 1) as f64;
        let of_others =
            self.table.filter(|_| of_others > 0).map(|table| isotherm_recording::other_device(table, of_others));
        let mut found: Vec<Finding> = finding.into_iter().chain(of_others).collect();
        let of_time = self.continuity.findings(MISSING).into_iter().map(Finding::warned);
        // What is bridged says it better.
        let is_bridged = self.continuity.losses().missing == (bridged.rows - bridged.not_a_number) as u64;
        found.extend(of_time.filter(|it| it.name != name::MISSING_ROWS || !is_bridged));
        found.extend(self.table.and_then(|table| self.continuity.not_nominal(table)));
        let begin: Vec<_> = rows.iter().take(MAGNITUDE_ROWS).collect();
        found.extend(self.table.and_then(|table| magnitude_at_rest(table, &begin)));
        // Every sensor says itself that its counts never change.
        found.extend(rest.faults.into_iter().filter(|it| it.name != name::NO_PULSES).map(Finding::warned));
        let used_s = [rows.span_s(ends[0])[0], rows.span_s(ends[1])[1]];
        let analysed = AnalysisSpan { stretch, interval_s, begin_s: used_s[0] };
        let sensors = outputs.noise(self.rows, &analysed);
        found.extend(sensors.chunks(AXES).filter_map(|triad| repeated(triad, interval_s)));
        if let [.., a, b, c] = &sensors[..]
            && c.kind == RateKind::AngularRate
        {
            found.extend(rate_at_rest([a.mean, b.mean, c.mean]));
        }
        let unit = self.table.map_or("unit", |table| &table.content().temperature_unit);
        let mut analysis = NoiseAnalysis {
            rows: self.all,
            used_s,
            used,
            bridged,
            at_rest,
            interval_s,
            sensors,
            losses: self.continuity.losses(),
            of_recording: found,
            temperature_unit: unit.to_owned(),
        };
        analysis.of_recording.extend(analysis.of_gaps());
        Ok(analysis)
    }
}

/// The longest stretch, the first of two, and how many rows those of its static pose have that are of its session and
/// interval. The outputs of some rows are no numbers.
fn longest(at_rest: &[Range<usize>], rows: &Rows, not_finite: &[usize]) -> Longest {
    let mut best = (Stretch::default(), 0);
    for rest in at_rest {
        let mut without = not_finite[not_finite.partition_point(|row| *row < rest.start)..].iter().peekable();
        let kept = rest.clone().filter(|row| without.next_if(|without| **without == *row).is_none());
        let all = stretches(kept.map(|row| (row, rows.period(row))));
        let period = |stretch: &Stretch| -> Period { rows.period(stretch.rows().start) };
        let alike = |a: &Stretch, b: &Stretch| {
            let [a, b] = [period(a), period(b)];
            a.session == b.session && a.interval_ns.abs_diff(b.interval_ns) <= a.interval_ns / 2
        };
        let Some(longest) = all.iter().reduce(|a, b| if b.kept > a.kept { b } else { a }) else { continue };
        if longest.kept > best.0.kept {
            let alike = all.iter().filter(|other| alike(longest, other)).map(|other| other.kept);
            best = (longest.clone(), alike.sum());
        }
    }
    best
}
