//! Positions that are not where the campaign file states them.

use super::reduction::{GOOD, MAX_DWELLS, Trials, UNKNOWNS};
use crate::checks::SetPoint;
use isotherm_campaign::{Campaign, Dwell, Observability, PARAMETERS, Position};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Severity, name};
use nalgebra::{Matrix3, Vector3};

/// With more positions, pairs and single positions are not tried.
pub(super) const MAX_POSITIONS: usize = 64;
/// A position is off if it is by more than this \[g0\] …
pub(super) const POSITION_OFF: f64 = 1e-3;
/// … and by more than this many of its own standard errors …
const POSITION_OFF_ERRORS: f64 = 20.0;
/// … and by more than this many times the others' residuals.
pub(super) const POSITION_OFF_OTHERS: f64 = 5.0;
/// Largest number of positions that can be off: of more, nothing shows which are right.
const MAX_OFF: usize = 3;

impl Trials<'_> {
    /// The specific force that was measured in a position, less the stated one, in units of the local gravity: a mean
    /// over the set points `scope` with its standard error. The positions in `off` do not count in the reduction.
    pub(super) fn measured(&self, position: usize, scope: &[usize], off: &[usize]) -> Option<(Vector3<f64>, f64)> {
        let gravity = self.campaign.gravity_local / self.campaign.gravity_reference;
        let mut all: Vec<Vector3<f64>> = Vec::new();
        for &i in scope {
            let set_point = &self.set_points[i];
            let Some(reduction) = self.try_positions(set_point, off, |position| position) else { continue };
            let u = &reduction.unknowns;
            let m = |axis: usize, k: usize| u[PARAMETERS * axis + 3 + k];
            let matrix = Matrix3::new(1.0, m(0, 0), m(0, 1), m(1, 1), 1.0, m(1, 0), m(2, 0), m(2, 1), 1.0);
            for &dwell in set_point.dwells.iter().filter(|&&dwell| self.dwells[dwell].position == position) {
                let indicated = |axis: usize| {
                    let [positive, negative] = self.dwells[dwell].sums.rates(axis);
                    let [by_positive, by_negative] = reduction.nominal[axis];
                    let first = PARAMETERS * axis;
                    u[first + 1] * positive / by_positive + u[first + 2] * negative / by_negative - u[first]
                };
                let indicated = Vector3::new(indicated(0), indicated(1), indicated(2));
                let (stated, by_tilt) = self.directions[position];
                let tilt = if u.len() == UNKNOWNS { [u[UNKNOWNS - 2], u[UNKNOWNS - 1]] } else { [0.0; 2] };
                let by_tilt = Vector3::from(by_tilt.map(|by| by[0] * tilt[0] + by[1] * tilt[1]));
                all.push((matrix.try_inverse()? * indicated - Vector3::from(stated) - by_tilt) / gravity);
            }
        }
        let n = all.len() as f64;
        let mean = all.iter().sum::<Vector3<f64>>() / n;
        let squares: f64 = all.iter().map(|value| (value - mean).norm_squared()).sum();
        // A single dwell has the errors of the others, which the caller compares it with.
        let error = if all.len() > 1 { (squares / (n - 1.0) / n).sqrt() } else { 0.0 };
        (!all.is_empty()).then_some((mean, error))
    }

    /// Error of the specific force that is measured in a position, if the positions in `off` do not count and each
    /// other dwell has an error of 1. `None` if the other positions do not determine all parameters.
    pub(super) fn spread(&self, off: &[usize], position: usize) -> Option<f64> {
        let positions = &self.campaign.positions;
        let kept: Vec<Position> =
            (0..positions.len()).filter(|p| !off.contains(p)).map(|p| positions[p].clone()).collect();
        let force = positions[position].specific_force;
        let of = |axis: usize| {
            let found = Observability::of(&kept, axis);
            let sigma = found.sigma.filter(|_| found.deficiencies.is_empty())?;
            let own = if force[axis] > 0.0 { sigma[1] } else { sigma[2] } * force[axis];
            let parts = [1.0, sigma[0], own, sigma[3] * force[(axis + 1) % AXES], sigma[4] * force[(axis + 2) % AXES]];
            Some(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
        };
        Some(of(0)?.max(of(1)?).max(of(2)?))
    }

    /// Residual of all set points without the positions in `off` \[g0\].
    fn without(&self, off: &[usize]) -> Option<f64> {
        let of = |set_point: &SetPoint| Some(self.try_positions(set_point, off, |position| position)?.sd.powi(2));
        let squares: Option<Vec<f64>> = self.set_points.iter().map(of).collect();
        let squares = squares.filter(|squares| !squares.is_empty())?;
        Some((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }
}

/// Faults of positions that are not where the campaign file states them, by more than their errors and the others'
/// residuals.
#[must_use]
pub(crate) fn positions_off(campaign: &Campaign, dwells: &[Dwell], set_points: &[SetPoint]) -> Vec<Finding> {
    if dwells.len() > MAX_DWELLS {
        return Vec::new();
    }
    let trials = Trials::new(campaign, dwells, set_points);
    let all: Vec<usize> = (0..set_points.len()).collect();
    let mut off: Vec<usize> = Vec::new();
    if campaign.positions.len() > MAX_POSITIONS || !trials.stated.iter().any(|sd| *sd > GOOD) {
        return Vec::new();
    }
    for _ in 0..MAX_OFF {
        let next = (0..campaign.positions.len())
            .filter(|position| !off.contains(position))
            .filter_map(|position| {
                let without = [off.as_slice(), &[position]].concat();
                trials.spread(&without, position)?;
                Some((trials.without(&without)?, position))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((others, position)) = next else { break };
        off.push(position);
        let is_off = |position: &usize| {
            let spread = trials.spread(&off, *position).unwrap_or(f64::INFINITY);
            trials.measured(*position, &all, &off).is_some_and(|(offset, error)| {
                offset.norm() > POSITION_OFF
                    && offset.norm() > POSITION_OFF_ERRORS * error
                    && offset.norm() > POSITION_OFF_OTHERS * spread * others
            })
        };
        if off.iter().all(is_off) {
            let finding = |position: &usize| {
                Finding::whole(Severity::Fault, name::POSITION_OFF, trials.describe_off(*position, &all, &off, ""))
            };
            return off.iter().map(finding).collect();
        }
    }
    Vec::new()
}
