//! The gate: what a fitted table must show before it replaces the table in force.
//!
//! 1. **Bounds.** Every verification run must show every bound of the requirement. Bounds that the user does not give
//!    come from the errors of the fit, see [`Requirement::of_fit`].
//! 2. **Alignment.** Without an alignment matrix, what the misalignments leave must be within the bound of an axis at
//!    any attitude, not only at that of the run; and within [`GATE_LEFT`], if the user has not stated the bound.
//! 3. **The whole run.** Few windows of a run may be left out, see [`Stability::unjudged`].
//! 4. **The table in force.** On the same runs the new table must not be worse, and it must cover its range. Only
//!    windows that both tables can judge are compared.
//! 5. **All runs together.** They leave no hole of over a tenth of a range, unless the user accepts `not-covered`. A
//!    channel that none of them drives agrees with the table in force, see [`exercised`].
//! 6. **The gyroscopes**, see [`gyroscopes`]: all of this holds for them too, and a table that has lost them does not
//!    replace one that has them.

mod allowed;
mod comparison;
pub(crate) mod exercised;
pub(crate) mod gyroscopes;

pub use allowed::GATE_FLOOR;
pub use allowed::GateRefusal;
pub(crate) use allowed::{GATE_ACCEPTED, GATE_LEFT, GATE_MOST};

use crate::requirement::Requirement;
use crate::stability::Stability;
use crate::window::Window;
use allowed::{GROUP_S, is_unexplained};
use comparison::{Worse, common_windows, errors_along, worst_of};
use gyroscopes::GyroscopeBounds;
use isotherm_fit::{Accuracy, Calibration, noise_of_dwells};
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, largest};
use isotherm_support::finding::name;

/// A range may end earlier than that of the table in force by this part of it: no two campaigns have the same ends.
const RANGE_TOLERANCE: f64 = 0.05;

/// What is required of one fitted table.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{CalibrationOptions, calibrate, read_measurements};
/// use isotherm_verification::{Gate, Requirement};
/// # use isotherm_campaign::Campaign;
/// # let campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
/// # let samples: &[u8] = include_bytes!("../../../examples/campaign/samples.csv");
/// # let rows = isotherm_recording::CampaignCsvReader::new(samples)?;
///
/// let measurements = read_measurements(&campaign, rows)?;
/// let calibration = calibrate(&campaign, measurements, CalibrationOptions::default())?;
/// // Nobody states a bound: the fit gives one for a run at this direction.
/// let gate = Gate::new(Requirement::default(), &calibration, [0.6, -0.48, 0.64])?;
/// assert!(gate.require.bias.is_some_and(|bias| bias < 50e-6)); // g0
/// assert!(gate.refuses_table(&calibration, None).is_empty());
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Gate {
    /// The bounds.
    pub require: Requirement,
    /// What is granted to the new table in the comparison \[g0\].
    granted: f64,
    /// What a table without alignment matrix may leave \[g0\].
    pub left: f64,
    /// What is granted to the gyroscopes, if the new table has any.
    gyroscopes: Option<GyroscopeBounds>,
    /// Whether the user accepts that the runs together leave a hole in a range.
    accepts_holes: bool,
}

impl Requirement {
    /// Absolute bounds from the budget of a fit, for a run at the specific force `force` \[local gravity\]: for each
    /// axis three times the sum of the 95 % half widths of bias, of scale factor times |force| and of the misalignments
    /// across it, plus three residual standard deviations, plus [`GATE_FLOOR`]. The largest axis counts. What a fit
    /// cannot know is unbounded.
    ///
    /// The bounds are at most `GATE_MOST`. A mistake that enlarges the residuals must not widen them: with a warning
    /// that the model does not explain the data they are at most `GATE_ACCEPTED`. Both grow by three times the noise
    /// that a group of the run has, as far as the rows of the campaign show it. With accepted faults the bounds are at
    /// most `GATE_ACCEPTED` in any case; if a single position explains the residuals
    /// ([`Calibration::suspect_position`]) at most [`GATE_FLOOR`], because that position pulls the fit more at other
    /// attitudes than at that of the run. A user who knows better states bounds.
    ///
    /// The bound of the gyroscopes: `gyroscopes::rate`.
    #[must_use]
    pub fn of_fit(calibration: &Calibration, force: [f64; AXES]) -> Self {
        let accuracy = Accuracy::of(calibration);
        let axis = |axis: usize| {
            let part = &calibration.solution.axes[axis];
            let across = part
                .misalignment_interval(CONFIDENCE)
                .map(|[next, after]| next * force[(axis + 1) % AXES].abs() + after * force[(axis + 2) % AXES].abs());
            let half_widths = accuracy.bias[axis]? + accuracy.scale_factor[axis]? * force[axis].abs() + across?;
            Some(3.0 * (half_widths + calibration.residual_sd(axis)) + GATE_FLOOR)
        };
        let most = [axis(0), axis(1), axis(2)].into_iter().collect::<Option<Vec<_>>>();
        let unexplained = is_unexplained(calibration);
        let noise = 3.0 * group_noise(calibration);
        let highest = match calibration.suspect_position {
            Some(_) => GATE_FLOOR,
            None if !calibration.accepted.is_empty() => GATE_ACCEPTED,
            None if unexplained => GATE_ACCEPTED + noise,
            None => GATE_MOST + noise,
        };
        let most = most.map(largest).filter(|most| most.is_finite()).map(|most| most.min(highest));
        Self {
            factor: None,
            bias: most,
            scale: most,
            level: most.map(|most| most * 2.0_f64.sqrt()),
            rate: gyroscopes::rate(calibration, force),
        }
    }
}

/// What the noise of the rows leaves in the mean of a group of a run \[g0\], of the noisiest axis.
fn group_noise(calibration: &Calibration) -> f64 {
    let found = noise_of_dwells(calibration.dwells.iter(), &calibration.table.content().axes);
    largest(found) / GROUP_S.sqrt()
}

impl Gate {
    /// The gate for a fit, with the bounds that the user gives in `require`, for runs at the direction `force`.
    ///
    /// # Errors
    /// If neither the user nor the fit gives a bound for the axes, or for the gyroscopes.
    pub fn new(require: Requirement, calibration: &Calibration, force: [f64; AXES]) -> Result<Self, String> {
        let of_fit = Requirement::of_fit(calibration, force);
        let bounds = require.or(of_fit);
        let Some(bias) = bounds.bias else {
            let why = calibration.unknown_errors().unwrap_or(
                "a curve has no degrees of freedom, so that its error is not known; measure more set points",
            );
            return Err(format!(
                "the fit gives no bound for the gate: {why}; or state a bound as in --require bias=20ug0"
            ));
        };
        // See `of_fit`: three times the errors, and the floor. A poor fit must not excuse itself with more than the
        // floor.
        let granted = of_fit.bias.map_or(0.0, |bias| (bias - GATE_FLOOR) / 3.0).clamp(0.0, GATE_FLOOR);
        let left = require.bias.unwrap_or_else(|| bias.min(GATE_LEFT));
        let gyroscopes = GyroscopeBounds::of(require, calibration, force);
        if gyroscopes.is_some() && bounds.rate.is_none() {
            return Err("the fit gives no bound for the gyroscopes: a curve has no degrees of freedom, so that its error is not known; measure \
                        more set points, or state a bound as in --require rate=0.1deg/h"
                .to_owned());
        }
        let accepts_holes = calibration.options.accept.contains(&name::NOT_COVERED);
        Ok(Self { require: bounds, granted, left, gyroscopes, accepts_holes })
    }

    /// Why the table must not be installed, as far as no run is needed to see it.
    #[must_use]
    pub fn refuses_table(&self, calibration: &Calibration, in_force: Option<&CoefficientTable>) -> Vec<GateRefusal> {
        let left = calibration.left_without_alignment().filter(|left| *left > self.left).map(|left| GateRefusal {
            by: "no alignment",
            cause: format!(
                "without an alignment matrix, which this IMU needs: misalignments leave up to {:.2}e-6 g0, at most {:.2}e-6 g0 is required; \
                 give --alignment, or a wider bias in --require",
                left * 1e6,
                self.left * 1e6
            ),
        });
        let hemisphere = gyroscopes::other_hemisphere(calibration);
        let narrower = in_force.and_then(|old| narrower(&calibration.table, old));
        let lost = in_force.and_then(|old| gyroscopes::lost(&calibration.table, old));
        left.into_iter()
            .chain(narrower.map(|cause| GateRefusal { by: "range", cause }))
            .chain(lost)
            .chain(hemisphere)
            .collect()
    }

    /// Why the table must not be installed, as a run shows it. `present` is the same run under the table in force, if
    /// that can judge it.
    #[must_use]
    pub fn refuses_run(&self, stability: &Stability, present: Option<&Stability>) -> Vec<GateRefusal> {
        // Without a remedy: not judged, and another judgement says why.
        let missed = self.require.judge(stability).into_iter().filter(|judgement| judgement.remedy.is_some());
        let missed = missed.map(|judgement| GateRefusal { by: judgement.bound, cause: judgement.message });
        let of_gyroscopes = |present| gyroscopes::worse(stability, present, self.gyroscopes?.granted);
        let worse = present.and_then(|present| worse(stability, present, self.granted)).into_iter();
        let worse = worse.chain(present.and_then(of_gyroscopes));
        let worse = worse.map(|cause| format!("worse than the table in force: {cause}"));
        missed.chain(worse.map(|cause| GateRefusal { by: "table in force", cause })).collect()
    }
}

/// Whether the worst error of `new` is larger than that of `old` on the same run, by more than the errors of its fit,
/// `granted` \[g0\]. The message names the accelerometer, or the length, for which this is most so.
///
/// Both tables see the same pulses, so the noise of a window is the same in both, and the difference of a group's means
/// has next to none. The worst errors differ by no more than the largest of these differences: tables that agree within
/// `granted` are never refused. The noise counts only between tables that differ by more: of two that are off by as
/// much on opposite sides, it makes one look worse. If the noise of a group's mean is as large as `granted`, the new
/// one is then refused in 6 % of the runs, below a third of it in none.
fn worse(new: &Stability, old: &Stability, granted: f64) -> Option<String> {
    let pairs = common_windows(&new.windows, &old.windows);
    let axis = |axis: usize| errors_along(&pairs, axis, [new.specific_force[axis], old.specific_force[axis]]);
    let length = || -> Vec<[f64; 2]> {
        let error = |window: &Window, run: &Stability| window.length() - run.gravity;
        let still = pairs.iter().filter(|(window, other)| window.still && other.still);
        still.map(|(window, other)| [error(window, new), error(other, old)]).collect()
    };
    let known = new.verdict.gravity_known && old.verdict.gravity_known;
    let found = (0..AXES).map(|index| (AXIS_NAMES[index], axis(index))).chain(known.then(|| ("the length", length())));
    let Worse { name, new, old, allowed } = worst_of(found, granted)?;
    Some(format!(
        "{name} is off by {:.3}e-6 g0, with the table in force by {:.3}e-6 g0 in the same windows; {:.3}e-6 g0 more is granted",
        new * 1e6,
        old * 1e6,
        allowed * 1e6
    ))
}

/// The first curve whose range is smaller than in the table in force.
fn narrower(new: &CoefficientTable, old: &CoefficientTable) -> Option<String> {
    let curves = |table: &CoefficientTable| {
        let gyroscopes = table.content().gyroscopes.iter().flat_map(|it| GYROSCOPE_NAMES.iter().zip(&it.axes));
        let axes = AXIS_NAMES.iter().zip(&table.content().axes).chain(gyroscopes);
        axes.flat_map(|(name, axis): (&&str, &Axis)| {
            let curves =
                [("bias", &axis.bias), ("K+", &axis.positive_scale_factor), ("K-", &axis.negative_scale_factor)];
            curves.map(|(curve, polynomial)| (format!("{curve} of {name}"), polynomial.range()))
        })
        .collect::<Vec<_>>()
    };
    let unit = &new.content().temperature_unit;
    curves(new).into_iter().zip(curves(old)).find_map(|((name, [low, high]), (_, [old_low, old_high]))| {
        let tolerance = RANGE_TOLERANCE * (old_high - old_low);
        (low > old_low + tolerance || high < old_high - tolerance).then(|| {
            format!(
                "{name} covers {low:.4} to {high:.4} {unit}, in the table in force {old_low:.4} to {old_high:.4}; take a campaign over the whole \
                 range, or move that table away"
            )
        })
    })
}

#[cfg(test)]
mod tests;
