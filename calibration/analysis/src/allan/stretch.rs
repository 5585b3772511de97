//! The rows that are analysed: a stretch at rest whose times are regular, in which short gaps are bridged.
//!
//! A row follows the one before after 0.5 to 1.5 intervals. Otherwise, the next row is sought up to which sequences and
//! times agree on how many rows are missing between: none where a row only came late, up to [`MOST_MISSING`] in a gap.
//! Times decide where the sequences were made from them, and a late row looked like a gap first.

use core::ops::Range;
use isotherm_shared::sequence::Period;

/// The time from row to row, and the interval of the row over that of the row before, lie within these parts of the
/// interval.
const REGULAR: [f64; 2] = [0.5, 1.5];
/// Most rows of a gap that is bridged.
pub(super) const MOST_MISSING: usize = 16;
/// Rows that may come at a wrong time in turn.
const LATE_ROWS: usize = 10;
/// Rows behind a gap that must not come early: then the row at its end came late, and there is no gap.
const CONFIRMED_ROWS: usize = 4;
/// Most part of the rows that may be bridged.
pub(super) const MOST_BRIDGED: f64 = 0.02;

/// The rows of a stretch that are missing, and are bridged.
///
/// Each missing row is given a value with the covariance of the rows around it: what is expected from them, and a
/// random number with the scatter that is left. The same rows give the same values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgedRows {
    /// Rows that are missing, or have no output that is a number.
    pub rows: usize,
    /// Gaps that they make.
    pub gaps: usize,
    /// How many of them are there, with an output that is not a number.
    pub not_a_number: usize,
    /// Rows that the stretch would have.
    pub of: usize,
}

impl BridgedRows {
    /// The part of the rows that are bridged.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.rows as f64 / self.of.max(1) as f64
    }

    /// `3 rows are missing in 2 gaps, 0.30 % of the 1000 that are analysed`.
    pub(super) fn words(&self) -> String {
        let Self { rows, gaps, not_a_number, of } = *self;
        let [rows, gaps] = [(rows, "row"), (gaps, "gap")].map(|(count, noun)| counted(count, noun));
        let are = if self.rows == 1 { "is" } else { "are" };
        let no_number = if not_a_number > 0 {
            format!(" ({} with an output that is not a number)", counted(not_a_number, "row"))
        } else {
            String::new()
        };
        format!(
            "{rows} {are} missing{no_number} in {gaps}, {:.2} % of the {of} that are analysed",
            self.share() * 100.0
        )
    }

    /// Whether they are over 2 %, so that no figure may be certified.
    #[must_use]
    pub fn is_too_much(&self) -> bool {
        self.share() > MOST_BRIDGED
    }
}

/// A stretch of rows.
#[derive(Clone, Debug, Default)]
pub(super) struct Stretch {
    runs: Vec<Run>,
    /// Number of its rows.
    pub kept: usize,
}

/// Rows of a stretch that follow each other, and how many are missing behind them.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub rows: Range<usize>,
    pub missing: usize,
}

impl Stretch {
    fn push(&mut self, row: usize) {
        self.kept += 1;
        match self.runs.last_mut().filter(|last| last.rows.end == row && last.missing == 0) {
            Some(last) => last.rows.end += 1,
            None => self.runs.push(Run { rows: row..row + 1, missing: 0 }),
        }
    }

    /// First and last row, and those between.
    pub(super) fn rows(&self) -> Range<usize> {
        self.runs.first().map_or(0..0, |first| first.rows.start..self.runs[self.runs.len() - 1].rows.end)
    }

    pub(super) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// What `of` makes of its rows, at regular times; NaN where one is missing.
    pub(super) fn values(&self, mut of: impl FnMut(usize) -> f64) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.bridged().of);
        for run in &self.runs {
            values.extend(run.rows.clone().map(&mut of));
            values.extend(core::iter::repeat_n(f64::NAN, run.missing));
        }
        values
    }

    /// What is bridged in it.
    pub(super) fn bridged(&self) -> BridgedRows {
        let rows = self.runs.iter().map(|run| run.missing).sum();
        let gaps = self.runs.iter().filter(|run| run.missing > 0).count();
        BridgedRows { rows, gaps, not_a_number: self.rows().len() - self.kept, of: self.kept + rows }
    }
}

/// The stretches of rows that are at rest and whose outputs are numbers.
pub(super) fn stretches(mut rows: impl Iterator<Item = (usize, Period)>) -> Vec<Stretch> {
    /// Rows that are looked at together.
    const AHEAD: usize = LATE_ROWS + 1 + CONFIRMED_ROWS;
    const MORE: usize = 1 << 12;
    let (mut kept, mut next): (Vec<(usize, Period)>, usize) = (rows.by_ref().take(MORE).collect(), 0);
    let mut found: Vec<Stretch> = Vec::new();
    while let Some((first, _)) = kept.get(next) {
        let mut stretch = Stretch::default();
        stretch.push(*first);
        loop {
            if next + AHEAD > kept.len() {
                kept.drain(..next);
                kept.extend(rows.by_ref().take(MORE));
                next = 0;
            }
            let Some((count, gaps)) = goes_on(&kept[next..kept.len().min(next + AHEAD)]) else { break };
            for row in 0..count {
                let missing = gaps.iter().filter(|(behind, _)| *behind == row).map(|(_, missing)| missing).sum();
                if let Some(last) = stretch.runs.last_mut() {
                    last.missing = missing;
                }
                stretch.push(kept[next + row + 1].0);
            }
            next += count;
        }
        found.push(stretch);
        next += 1;
    }
    found
}

/// How many rows follow the first of `kept` up to the next one at the right time, and behind which of them, counted
/// from the first, how many are missing. `None` if it ends the stretch.
fn goes_on(kept: &[(usize, Period)]) -> Option<(usize, Vec<(usize, usize)>)> {
    let row = |index: usize| &kept[index].1;
    let is_within = |ratio: f64| (REGULAR[0]..=REGULAR[1]).contains(&ratio);
    let first = row(0);
    let interval_ns = first.interval_ns as f64;
    let passed =
        |from: usize, to: usize| (i128::from(row(to).timestamp_ns) - i128::from(row(from).timestamp_ns)) as f64;
    let is_early = |index: usize| passed(index - 1, index) < REGULAR[0] * interval_ns;
    // Sequences are those of one session, and rise.
    let follows = |index: usize| {
        let (before, now) = (row(index - 1), row(index));
        before.session == now.session
            && now.sequence > before.sequence
            && is_within(now.interval_ns as f64 / before.interval_ns as f64)
    };
    let missing_behind = |index: usize| row(index + 1).sequence - row(index).sequence - 1;
    if kept.len() > 1 && follows(1) && missing_behind(0) == 0 && is_within(passed(0, 1) / row(1).interval_ns as f64) {
        return Some((1, Vec::new()));
    }
    let (mut by_sequence, mut early) = (0_u64, false);
    for count in 1..kept.len().min(LATE_ROWS + 1) {
        if !follows(count) {
            return None;
        }
        by_sequence = by_sequence.saturating_add(missing_behind(count - 1));
        early |= is_early(count);
        let missing = (passed(0, count) / interval_ns).round() - count as f64;
        let agrees = missing == by_sequence as f64 || (early && missing < by_sequence as f64);
        let behind = count + 1..kept.len().min(count + 1 + CONFIRMED_ROWS);
        let is_late = behind.take_while(|index| follows(*index)).any(is_early);
        if !(0.0..=MOST_MISSING as f64).contains(&missing) || !agrees || is_late {
            continue;
        }
        let missing = missing as usize;
        let gaps: Vec<_> = if missing as u64 == by_sequence {
            (0..count).map(|index| (index, missing_behind(index) as usize)).collect()
        } else {
            // The sequences count late rows as gaps, too.
            let longest = (0..count).max_by(|a, b| passed(*a, a + 1).total_cmp(&passed(*b, b + 1)))?;
            vec![(longest, missing)]
        };
        return Some((count, gaps.into_iter().filter(|(_, missing)| *missing > 0).collect()));
    }
    None
}

/// `1 row`, `3 rows`.
fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
