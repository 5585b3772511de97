//! The rhythm of rows, found from the first ones: of stamps at the usual pace, and of stamps of arrivals.

use super::interval;
use isotherm_recording::foreign::ForeignRow;
use std::collections::VecDeque;

/// Fewer rows are a handful, which has no usual step.
pub(super) const HANDFUL: usize = 10;
/// Most rows over which the mean step of arrivals is taken.
const SPAN: usize = 1000;
/// Stamps of arrivals step back in at least one of so many rows, if that is their jitter.
const BACK: usize = 50;
/// And by no more than so many periods.
const FARTHEST_BACK: f64 = 3.0;
/// Rows with one stamp have the same values, but for one of so many.
const OTHER_VALUES: usize = 20;
/// Rows with other stamps have other values, but for one of so many.
const SAME_VALUES: usize = 10;
/// So few of the rows may repeat the one before, whatever values say: one of so many.
const FEW: usize = 50;

/// How the stamps of good rows lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rhythm {
    /// The time from row to row \[ns\].
    pub period_ns: f64,
    /// Time by which a row may be off its place \[ns\].
    pub tolerance_ns: f64,
    /// Time by which a stamp may be before the one of the row before \[ns\]; `None`: it must rise.
    pub back_ns: Option<u64>,
}

impl Rhythm {
    /// Of rows that are stamped at their usual pace.
    const fn even(period_ns: f64) -> Self {
        Self { period_ns, tolerance_ns: 0.5 * period_ns, back_ns: None }
    }

    /// Whether the stamps are those of the rows, and not of their arrival.
    pub(super) const fn is_even(&self) -> bool {
        self.back_ns.is_none()
    }

    /// Whether a row can follow another one by the time between them \[ns\].
    pub(super) fn rises(&self, step_ns: f64) -> bool {
        match self.back_ns {
            None => step_ns > 0.0,
            Some(back_ns) => step_ns >= -(back_ns as f64),
        }
    }

    /// Whether the time between two rows \[ns\] is less than none.
    pub(super) fn steps_back(&self, step_ns: f64) -> bool {
        step_ns < -(self.back_ns.unwrap_or(0) as f64)
    }

    /// Whether the time between two rows \[ns\] is about that of one.
    pub(super) fn is_usual(&self, step_ns: f64) -> bool {
        step_ns > 0.0 && (step_ns - self.period_ns).abs() <= self.tolerance_ns / 2.0
    }
}

/// The rhythm of rows that are stamped at their usual pace; of a handful of rows that of the shortest step.
pub(super) fn rhythm(stamps: &[u64]) -> Rhythm {
    if stamps.len() < HANDFUL {
        let steps = stamps.windows(2).filter_map(|pair| pair[1].checked_sub(pair[0])).filter(|step| *step > 0);
        return Rhythm::even(steps.min().unwrap_or(1) as f64);
    }
    Rhythm::even(interval::usual_step(stamps).unwrap_or(1.0).max(1.0))
}

/// The rhythm of rows that are stamped when they arrive, with jitter or in bursts.
pub(super) fn arrivals(stamps: &[u64]) -> Rhythm {
    let span = (stamps.len() / 4).clamp(1, SPAN);
    let step = |from: usize| stamps.get(from + span).map(|to| to.saturating_sub(stamps[from]));
    let period_ns = quantile((0..stamps.len()).filter_map(step), 0.5) as f64 / span as f64;
    let period_ns = period_ns.max(1.0);
    let gap_ns = interval::found(stamps).map_or(0.0, |shape| shape.gap_ns as f64);
    let back: Vec<_> = stamps.windows(2).filter_map(|pair| pair[0].checked_sub(pair[1])).filter(|ns| *ns > 0).collect();
    let is_often = back.len() * BACK > stamps.len();
    let usual_back_ns = quantile(back.into_iter(), 0.9);
    let is_jitter = is_often && usual_back_ns as f64 <= FARTHEST_BACK * period_ns;
    let back_ns = if is_jitter { 2 * usual_back_ns } else { 0 };
    let tolerance_ns = gap_ns.max(back_ns as f64).max(2.0 * period_ns);
    Rhythm { period_ns, tolerance_ns, back_ns: Some(back_ns) }
}

fn quantile(values: impl Iterator<Item = u64>, part: f64) -> u64 {
    let mut all: Vec<_> = values.collect();
    all.sort_unstable();
    all.get((all.len() as f64 * part) as usize).copied().unwrap_or(0)
}

/// Which rows are there twice.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Twice {
    /// Those with the stamp and the values of the row just before.
    pub standing: bool,
    /// Those with the stamp and the values of an earlier row, behind which the time went on.
    pub earlier: bool,
}

/// Which rows are there twice, of rows that are stamped at their usual pace, and of rows that are stamped when they
/// arrive: a burst has one stamp, and its rows may have the same values where these do not distinguish rows.
pub(super) fn twice(rows: &VecDeque<ForeignRow>) -> [Twice; 2] {
    // Pairs of rows with other stamps and with one stamp; of each all, and those with the same values.
    let mut pairs = [[0_usize; 2]; 2];
    for (earlier, later) in rows.iter().zip(rows.iter().skip(1)) {
        let [all, same] = &mut pairs[usize::from(earlier.timestamp_ns == later.timestamp_ns)];
        *all += 1;
        *same += usize::from(earlier.pulses == later.pulses);
    }
    let [[others, same], [standing, repeated]] = pairs;
    let values_tell = same * SAME_VALUES <= others;
    let are_few = repeated * FEW <= rows.len();
    let are_repeated = values_tell && (standing - repeated) * OTHER_VALUES <= standing;
    [are_few || are_repeated, !are_few && are_repeated].map(|standing| Twice { standing, earlier: values_tell })
}
