//! The comparison of two tables on the same run.

use crate::verdict::{group_interval, groups, noise};
use crate::window::{MIN_WINDOWS, Window};
use isotherm_statistics::mean;

/// The windows that both tables can judge, of the new one and of that in force.
pub(super) fn common_windows<'a>(new: &'a [Window], old: &'a [Window]) -> Vec<(&'a Window, &'a Window)> {
    let judged = |window: &Window| window.counts && !window.flagged;
    new.iter().zip(old).filter(|(window, other)| judged(window) && judged(other)).collect()
}

/// The errors along an axis in these windows, under both tables; the outputs should be `right`.
pub(super) fn errors_along(pairs: &[(&Window, &Window)], axis: usize, right: [f64; 2]) -> Vec<[f64; 2]> {
    pairs.iter().map(|(window, other)| [window.after[axis] - right[0], other.after[axis] - right[1]]).collect()
}

/// A worst error that is larger under the new table than under that in force, by more than is allowed.
pub(super) struct Worse {
    pub name: &'static str,
    pub new: f64,
    pub old: f64,
    pub allowed: f64,
}

/// The one of these, each with its errors under both tables, for which the worst error has grown most beyond what is
/// granted.
pub(super) fn worst_of(found: impl Iterator<Item = (&'static str, Vec<[f64; 2]>)>, granted: f64) -> Option<Worse> {
    let found = found.filter(|(_, errors)| errors.len() >= MIN_WINDOWS).map(|(name, errors)| {
        let of = |table: usize| errors.iter().map(|pair| pair[table]).collect::<Vec<_>>();
        let worst =
            |table: usize| groups(&of(table), mean).into_iter().fold(0.0, |most: f64, mean| most.max(mean.abs()));
        let differences: Vec<_> = errors.iter().map(|[new, old]| new - old).collect();
        let allowed = libm::hypot(granted, group_interval(noise(&differences), differences.len()));
        Worse { name, new: worst(0), old: worst(1), allowed }
    });
    let beyond = |it: &Worse| it.new - it.old - it.allowed;
    found.max_by(|a, b| beyond(a).total_cmp(&beyond(b))).filter(|it| beyond(it) > 0.0)
}
