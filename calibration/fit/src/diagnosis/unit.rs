//! Another device from a set point on, or an IMU that was turned on its fixture there.
//!
//! Misalignments do not depend on temperature. Where each set point agrees with itself, but the misalignments of those
//! before a time and after it are two groups, the IMU before it is not the IMU after it. A turn on the fixture leaves
//! opposite misalignments, m onto an axis and back.

use super::cause::{Diagnosis, MAX_GOOD, OF_FORCES, diagnosis};
use crate::checks::SetPoint;
use crate::reduce::reduce;
use isotherm_campaign::{Campaign, Dwell};
use isotherm_shared::wire::AXES;
use isotherm_statistics::rms;
use isotherm_support::finding::name;

/// Misalignments of the three accelerometers, onto the next axis and the one after \[rad\].
type Misalignments = [f64; 2 * AXES];

/// The groups differ by over this many times the scatter within them …
const SCATTERS: f64 = 10.0;
/// … and by over this many times the residuals of the set points \[rad, g0\] …
const RESIDUALS: f64 = 2.0;
/// … and by over this \[rad\], rms.
const DIFFERENT: f64 = 5e-5;
/// What is not a turn is below this part of the difference, rms.
const TURNED: f64 = 0.2;

/// The diagnosis, if the set points are two groups.
pub(super) fn other_device(campaign: &Campaign, dwells: &[Dwell], set_points: &[SetPoint]) -> Option<Diagnosis> {
    let reduced: Option<Vec<(Misalignments, f64)>> =
        set_points.iter().map(|set_point| misalignments(campaign, dwells, set_point)).collect();
    let (values, residuals): (Vec<Misalignments>, Vec<f64>) = reduced?.into_iter().unzip();
    let residual = residuals.into_iter().fold(0.0, f64::max);
    if values.len() < 3 || residual >= MAX_GOOD {
        return None;
    }
    let split = |at: usize| {
        let [before, after] = [mean(&values[..at]), mean(&values[at..])];
        let squares = |group: &[Misalignments], mean: &Misalignments| -> f64 {
            group.iter().map(|value| rms(&difference(value, mean)).powi(2)).sum()
        };
        let within = squares(&values[..at], &before) + squares(&values[at..], &after);
        (at, difference(&after, &before), (within / (values.len() - 2) as f64).sqrt())
    };
    let (at, differs, scatter) = (1..values.len()).map(split).min_by(|a, b| a.2.total_cmp(&b.2))?;
    let size = rms(&differs);
    if size < (SCATTERS * scatter).max(RESIDUALS * residual).max(DIFFERENT) {
        return None;
    }
    let from = set_points[at].set_point_c;
    let what = if rms(&symmetric(&differs)) < TURNED * size {
        "the IMU was turned on its fixture, or taken off and put on again"
    } else {
        "the rows are of another device"
    };
    let message = format!(
        "from set point {from} degC on {what}: misalignments differ by {:.2} mrad there, and by {:.3} mrad within the set points before and after; \
         take out the rows of one, or measure again",
        size * 1e3,
        scatter * 1e3
    );
    Some(diagnosis(name::DEVICE_CHANGED, message, OF_FORCES))
}

/// The misalignments of a set point, with the largest residual \[g0\].
fn misalignments(campaign: &Campaign, dwells: &[Dwell], set_point: &SetPoint) -> Option<(Misalignments, f64)> {
    let own: Vec<&Dwell> = set_point.dwells.iter().map(|&dwell| &dwells[dwell]).collect();
    let [a1, a2, a3] = [0, 1, 2].map(|axis| reduce(campaign, &own, axis, None));
    let axes = [a1?, a2?, a3?];
    let residual = axes.iter().map(|axis| axis.residual_sd).fold(0.0, f64::max);
    Some((core::array::from_fn(|k| axes[k / 2].values[3 + k % 2]), residual))
}

fn mean(values: &[Misalignments]) -> Misalignments {
    core::array::from_fn(|k| values.iter().map(|value| value[k]).sum::<f64>() / values.len() as f64)
}

fn difference(a: &Misalignments, b: &Misalignments) -> Misalignments {
    core::array::from_fn(|k| a[k] - b[k])
}

/// What is the same onto an axis and back: m onto the next axis of one, and onto the one after of that.
fn symmetric(m: &Misalignments) -> Misalignments {
    core::array::from_fn(|k| {
        let (axis, onto) = (k / 2, k % 2);
        let other = (axis + 1 + onto) % AXES;
        0.5 * (m[k] + m[2 * other + 1 - onto])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_has_no_symmetric_part() {
        // A1 onto A2 and back, A2 onto A3 and back, A3 onto A1 and back.
        let turned = [3.0, 2.0, 1.0, -3.0, -2.0, -1.0];
        assert_eq!(symmetric(&turned), [0.0; 6]);
        assert_eq!(symmetric(&[3.0, 0.0, 0.0, 3.0, 0.0, 0.0]), [3.0, 0.0, 0.0, 3.0, 0.0, 0.0]);
    }
}
