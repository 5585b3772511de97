//! Which rows of a window have stamps that follow each other: the chain of rows of least cost.
//!
//! A row that the chain leaves out costs 1. Steps of the time that rows at their usual pace do not have cost, too: a
//! gap less than a row, a row too much more than it, and a clock that starts again as much as a dozen rows.

use super::rollover::Rollover;
use isotherm_recording::foreign::LEAP_NS;

/// Most rows between two rows of the chain.
pub(super) const MOST_SKIPPED: usize = 40;

/// A step that is longer than that of the rows.
const GAP: f64 = 0.75;
/// A row more than the time has room for.
const CROWDED: f64 = 3.0;
/// A gap behind a stamp of 0, of over so many periods.
const AFTER_ZERO: f64 = 3.0;
const FAR_FROM_ZERO: f64 = 16.0;
/// Up to so many rows before the first leap, or behind the last one, cost less than a gap.
const FEW: usize = 3;
const FEW_ROWS: f64 = 0.5;
/// A leap is longer than so many periods.
const LEAP_PERIODS: f64 = 1000.0;
const ROLLOVER: f64 = 0.5;
/// What a row costs more that is left out although no stamp around it is odd.
const CALM: f64 = 0.1;
/// A clock that starts again.
const SESSION: f64 = 12.0;
/// A row that is off its place by as much as it may.
const OFF: f64 = 0.25;

/// How the stamps of good rows lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rhythm {
    /// The time from row to row \[ns\].
    pub period_ns: f64,
    /// Periods by which a row may be off its place.
    pub tolerance: f64,
    /// Time by which a stamp may be before the one of the row before \[ns\]; `None`: it must rise.
    pub back_ns: Option<u64>,
}

/// How a row follows the one before it in the chain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ChainLink {
    /// By its stamp.
    Step,
    /// A counter of this width \[ns\] rolled over.
    Rollover(u64),
    /// The clock started again.
    Session,
}

/// A row of the chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChainStep {
    /// Its place in the window.
    pub at: usize,
    /// How it follows the row before, or the last row before the window. [`ChainLink::Step`] of the first row of all.
    pub link: ChainLink,
    /// Whether the step is that of as many rows.
    pub is_in_step: bool,
}

impl Rhythm {
    /// Of rows that are stamped at their usual pace.
    pub(super) const fn even(period_ns: f64) -> Self {
        Self { period_ns, tolerance: 0.5, back_ns: None }
    }

    /// Whether the stamps are those of the rows, and not of their arrival.
    pub(super) const fn is_even(&self) -> bool {
        self.back_ns.is_none()
    }

    /// Whether a stamp cannot simply follow the one before.
    pub(super) fn is_odd(&self, earlier_ns: u64, later_ns: u64) -> bool {
        let falls = match self.back_ns {
            None => later_ns <= earlier_ns,
            Some(back_ns) => later_ns.saturating_add(back_ns) < earlier_ns,
        };
        falls || later_ns == 0 || self.is_leap(later_ns.saturating_sub(earlier_ns) as f64)
    }

    fn is_leap(&self, step_ns: f64) -> bool {
        step_ns > LEAP_NS as f64 && step_ns > LEAP_PERIODS * self.period_ns
    }

    /// Whether a step \[ns\] is that of so many rows.
    pub(super) fn is_in_step(&self, step_ns: f64, rows: usize) -> bool {
        (step_ns / self.period_ns - rows as f64).abs() <= self.tolerance
    }

    /// How a stamp follows another one, and the step \[ns\].
    fn link(&self, earlier_ns: u64, later_ns: u64, rollover: &Rollover) -> (ChainLink, f64) {
        let falls = match self.back_ns {
            None => later_ns <= earlier_ns,
            Some(back_ns) => later_ns.saturating_add(back_ns) < earlier_ns,
        };
        if !falls {
            // The difference is exact before it is rounded.
            let back_ns = earlier_ns.saturating_sub(later_ns) as f64;
            return (ChainLink::Step, later_ns.saturating_sub(earlier_ns) as f64 - back_ns);
        }
        match rollover.width_between(earlier_ns, later_ns, self.period_ns) {
            Some(width_ns) => (ChainLink::Rollover(width_ns), (width_ns - earlier_ns + later_ns) as f64),
            None => (ChainLink::Session, 0.0),
        }
    }

    /// What it costs that the second row is the next of the chain, apart from the rows that are left out; `rows` is how
    /// many places it is behind.
    fn cost(&self, link: ChainLink, step_ns: f64, rows: usize, is_from_zero: bool) -> f64 {
        let of_link = match link {
            ChainLink::Session => return SESSION,
            ChainLink::Rollover(_) => ROLLOVER,
            ChainLink::Step => 0.0,
        };
        let off = step_ns / self.period_ns - rows as f64;
        let of_step = if off.abs() <= self.tolerance {
            OFF * off.abs() / self.tolerance
        } else if off < 0.0 {
            CROWDED * (0.5 - off - self.tolerance)
        } else if is_from_zero && off > FAR_FROM_ZERO {
            AFTER_ZERO
        } else {
            GAP
        };
        of_link + of_step
    }
}

/// The chain of rows with these stamps \[ns\]. `last_ns` is the stamp of the last row before them; `is_end`: there are
/// none behind them.
pub(super) fn chain(
    stamps: &[u64],
    last_ns: Option<u64>,
    is_end: bool,
    rhythm: &Rhythm,
    rollover: &Rollover,
) -> Vec<ChainStep> {
    let is_odd = |at: usize| {
        let before = at.checked_sub(1).map_or(last_ns, |before| stamps.get(before).copied());
        before.zip(stamps.get(at)).is_some_and(|(before_ns, ns)| rhythm.is_odd(before_ns, *ns))
    };
    // What it costs to leave out all rows up to each.
    let mut left_out = vec![0.0];
    for at in 0..stamps.len() {
        let more = if is_odd(at) || is_odd(at + 1) { 0.0 } else { CALM };
        left_out.push(left_out[at] + 1.0 + more);
    }
    let count = stamps.len();
    let leaps = |at: usize| rhythm.is_leap(stamps[at].saturating_sub(stamps[at - 1]) as f64);
    let begin = |at: usize| if (1..=FEW).contains(&at) && leaps(at) { FEW_ROWS } else { left_out[at] };
    let rest = |at: usize| {
        let is_few = is_end && at < count && count - at <= FEW && at > 0 && leaps(at);
        if is_few { FEW_ROWS } else { left_out[count] - left_out[at] }
    };
    // Of each row the least cost, and the row before it, as its place and 1.
    let mut best: Vec<(f64, usize, ChainStep)> = Vec::with_capacity(stamps.len());
    for (at, later_ns) in stamps.iter().copied().enumerate() {
        let first = ChainStep { at, link: ChainLink::Step, is_in_step: false };
        let mut least = (if last_ns.is_none() { begin(at) } else { f64::INFINITY }, 0, first);
        for before in (at.saturating_sub(MOST_SKIPPED + 1)..at + 1).rev() {
            // The place and 1 of an earlier row; 0 is the last one before the window.
            let earlier =
                if before == 0 { last_ns.map(|ns| (0.0, ns)) } else { Some((best[before - 1].0, stamps[before - 1])) };
            let Some((so_far, earlier_ns)) = earlier.filter(|(so_far, _)| *so_far < least.0) else { continue };
            let rows = at + 1 - before;
            let (link, step_ns) = rhythm.link(earlier_ns, later_ns, rollover);
            let skipped = left_out[at] - left_out[before];
            let cost = so_far + skipped + rhythm.cost(link, step_ns, rows, earlier_ns == 0);
            if cost < least.0 {
                let is_in_step = link != ChainLink::Session && rhythm.is_in_step(step_ns, rows);
                least = (cost, before, ChainStep { is_in_step, ..first });
                least.2.link = link;
            }
        }
        best.push(least);
    }
    let total = |at: usize| best[at].0 + rest(at + 1);
    let end = (0..best.len()).rev().min_by(|a, b| total(*a).total_cmp(&total(*b)));
    let none = last_ns.is_some().then_some(left_out[count]);
    let mut chain = Vec::new();
    let mut at = end.filter(|end| none.is_none_or(|none| total(*end) < none)).map_or(0, |end| end + 1);
    while at > 0 {
        let (_, before, linked) = best[at - 1];
        chain.push(linked);
        at = before;
    }
    chain.reverse();
    chain
}
