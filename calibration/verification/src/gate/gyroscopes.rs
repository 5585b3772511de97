//! The gate for gyroscopes.
//!
//! A run at rest shows the whole error of a gyroscope at its attitude: of the bias, and of the g-sensitivity along the
//! specific force. It must be within the bound `rate`, and not worse than under the table in force. The rest is **not
//! judged by any run at rest**: scale factors, misalignments, and g-sensitivity across the specific forces of the runs.
//! Earth's rate shows 15 deg/h times their error, some 1e-4 deg/h. They must agree with the table in force, where that
//! has gyroscopes.
//!
//! The misalignments are compared against the axes of the accelerometers: how the IMU sits on the fixture turns both
//! triads alike.

use super::allowed::{GATE_FLOOR, GATE_MOST, GROUP_S, GateRefusal, is_unexplained};
use super::comparison::{Worse, common_windows, errors_along, worst_of};
use crate::requirement::Requirement;
use crate::stability::{EarthRate, Stability};
use isotherm_fit::{Calibration, GyroscopeCalibration, GyroscopeSolution, largest_interval};
use isotherm_shared::table::{CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, largest};
use isotherm_support::finding::{Finding, name};
use nalgebra::{Matrix3, Vector3};

/// What the gate allows a gyroscope in any case \[deg/h\]: dynamic effects of a temperature that moves.
pub(crate) const RATE_FLOOR: f64 = 0.02;
/// Largest part of the bound that is not noise, if nobody has stated the bound \[deg/h\].
pub(crate) const RATE_MOST: f64 = 0.2;
/// The same for a fit that does not explain its data, or with accepted faults \[deg/h\].
pub(crate) const RATE_ACCEPTED: f64 = 0.05;
/// What the noise of a group's mean may add to the upper end of the worst error, in standard deviations: of the means
/// of 60 groups the largest is 3 off, and its interval for all groups at once is 3.3.
const NOISE: f64 = 7.0;

/// Half width of the 95 % interval of what a run at the specific force `force` \[local gravity\] shows of a gyroscope
/// \[deg/h\]: bias, g-sensitivity and Earth's rate. `None` without degrees of freedom.
fn half_width(found: &GyroscopeCalibration, axis: usize, force: [f64; AXES]) -> Option<f64> {
    let part = &found.solution.gyroscopes[axis];
    let by_force = part.g_sensitivity_interval(CONFIDENCE)?.iter().zip(force).map(|(s, f)| s * f.abs()).sum::<f64>();
    Some(largest_interval(&part.curves[0], false)? + by_force)
}

/// The bound for the whole error of every gyroscope \[deg/h\] from the budget of a fit, for a run at the specific force
/// `force` \[local gravity\]: three times the sum of the 95 % half widths of bias, of g-sensitivities times |force| and
/// of Earth's rate, plus [`RATE_FLOOR`], of the worst gyroscope; at most [`RATE_MOST`], and at most [`RATE_ACCEPTED`]
/// if the model does not explain the data or if a fault was accepted. To this comes seven times the noise that a group
/// of the run has. `None` without gyroscopes, or if the fit does not know its errors.
#[must_use]
pub(crate) fn rate(calibration: &Calibration, force: [f64; AXES]) -> Option<f64> {
    let found = calibration.gyroscopes.as_ref()?;
    let of_earth = calibration.table.turntable().and_then(EarthRate::largest_interval);
    let axes =
        (0..AXES).map(|axis| Some(3.0 * (half_width(found, axis, force)? + of_earth.unwrap_or(0.0)) + RATE_FLOOR));
    let most = largest(axes.collect::<Option<Vec<_>>>()?);
    let poor = !calibration.accepted.is_empty() || is_unexplained(calibration);
    let noise = largest(found.noise) / GROUP_S.sqrt();
    most.is_finite().then(|| most.min(if poor { RATE_ACCEPTED } else { RATE_MOST }) + NOISE * noise)
}

/// What is granted to the gyroscopes of a new table.
#[derive(Clone, Copy, Debug)]
pub(super) struct GyroscopeBounds {
    /// In the comparison on the same runs \[deg/h\].
    pub granted: f64,
    /// Largest difference from the table in force of what no run drives: of a scale factor, relative, and of a
    /// misalignment \[rad\].
    pub relative: f64,
    /// The same of the g-sensitivity \[deg/h/g0\].
    g_sensitivity: f64,
}

impl GyroscopeBounds {
    /// Those of a fit; of a scale factor what the user has stated as `scale`, if so. Both tables have errors: twice the
    /// three half widths of the one that is known, plus the floor. `None` without gyroscopes.
    pub(super) fn of(require: Requirement, calibration: &Calibration, force: [f64; AXES]) -> Option<Self> {
        let found = calibration.gyroscopes.as_ref()?;
        // An error that is not known grants nothing.
        let most = |of: &dyn Fn(&GyroscopeSolution) -> Option<f64>| {
            largest(found.solution.gyroscopes.iter().map(|part| of(part).unwrap_or(0.0)))
        };
        let scale_factor =
            most(&|part| Some(largest_interval(&part.curves[1], true)?.max(largest_interval(&part.curves[2], true)?)));
        let misalignment = most(&|part| Some(largest(part.misalignment_interval(CONFIDENCE)?)));
        let g_sensitivity = most(&|part| Some(largest(part.g_sensitivity_interval(CONFIDENCE)?)));
        let both = |half_width: f64, floor: f64| 2.0 * 3.0 * half_width + floor;
        let granted = largest((0..AXES).map(|axis| half_width(found, axis, force).unwrap_or(0.0)));
        Some(Self {
            granted: granted.clamp(0.0, RATE_FLOOR),
            relative: require.scale.unwrap_or_else(|| both(scale_factor.max(misalignment), GATE_FLOOR).min(GATE_MOST)),
            g_sensitivity: both(g_sensitivity, RATE_FLOOR).min(RATE_MOST),
        })
    }

    /// Why the table must not be installed, as far as no run shows it: what differs from the table in force beyond
    /// these bounds. `forces` are the specific forces of the runs \[g0\].
    pub(super) fn refuses(
        &self,
        forces: &[[f64; AXES]],
        new: &CoefficientTable,
        old: &CoefficientTable,
    ) -> Vec<GateRefusal> {
        let because = |what: &str, off: String, most: String| GateRefusal {
            by: "gyroscopes",
            cause: format!(
                "{what}, which no run at rest shows, is {off} off the table in force, at most {most} is allowed; look at the turns of the campaign, \
                 or move that table away if the IMU has changed"
            ),
        };
        let mut found = Vec::new();
        if let Some((turned, name)) = misalignment(new, old).filter(|(turned, _)| *turned > self.relative) {
            let (off, most) = (format!("{:.1}e-6 rad", turned * 1e6), format!("{:.1}e-6 rad", self.relative * 1e6));
            found.push(because(&format!("the misalignment of {name} against the accelerometers"), off, most));
        }
        let (Some(new), Some(old)) = (&new.content().gyroscopes, &old.content().gyroscopes) else { return found };
        for (axis, name) in GYROSCOPE_NAMES.iter().enumerate() {
            let (part, before) = (new.g_sensitivity[axis], old.g_sensitivity[axis]);
            let change = Vector3::from(part.unwrap_or_default()) - Vector3::from(before.unwrap_or_default());
            let off = unseen(change, forces).norm();
            if off > self.g_sensitivity {
                let (off, most) = (format!("{off:.3} deg/h/g0"), format!("{:.3} deg/h/g0", self.g_sensitivity));
                found.push(because(
                    &format!("the g-sensitivity of {name} across the specific forces of the runs"),
                    off,
                    most,
                ));
            }
        }
        found
    }
}

/// The part of a g-sensitivity that no run at these specific forces shows: that across all of them.
fn unseen(change: Vector3<f64>, forces: &[[f64; AXES]]) -> Vector3<f64> {
    let mut seen: Vec<Vector3<f64>> = Vec::new();
    for force in forces {
        let force = Vector3::from(*force).normalize();
        let across = seen.iter().fold(force, |left, seen| left - seen * seen.dot(&left));
        // Two attitudes that are 6 degrees apart show little more than one.
        seen.extend((across.norm() > 0.1).then(|| across.normalize()));
    }
    seen.iter().fold(change, |left, seen| left - seen * seen.dot(&left))
}

/// Largest difference between two tables of a misalignment of a gyroscope against the axes of the accelerometers
/// \[rad\], and its gyroscope; `None` if a table has not both alignment matrices.
fn misalignment(new: &CoefficientTable, old: &CoefficientTable) -> Option<(f64, &'static str)> {
    // Increments of the accelerometers' sensors times this are those of gyroscopes along the same axes.
    let of = |table: &CoefficientTable| {
        let content = table.content();
        let matrix = content.gyroscopes.as_ref()?.alignment?.try_inverse()? * content.alignment?;
        Some(Matrix3::from_fn(|i, j| matrix[(i, j)] / matrix[(i, i)]))
    };
    let difference = of(new)? - of(old)?;
    let rows = (0..AXES).map(|axis| (difference.row(axis).amax(), GYROSCOPE_NAMES[axis]));
    rows.max_by(|(a, _), (b, _)| a.total_cmp(b))
}

/// The refusal of a table without gyroscopes that would replace one with them.
pub(super) fn lost(new: &CoefficientTable, old: &CoefficientTable) -> Option<GateRefusal> {
    (old.content().gyroscopes.is_some() && new.content().gyroscopes.is_none()).then(|| GateRefusal {
        by: "gyroscopes",
        cause: "the table in force has gyroscopes, the new one has none: their angle increments would stop; take a campaign with turns, or move that \
                table away"
            .to_owned(),
    })
}

/// The refusal of a fit whose g-sensitivities look as if the latitude had the wrong sign: no run at rest can see that,
/// since Earth's vertical rate and gravity lie along one line at every attitude.
pub(super) fn other_hemisphere(calibration: &Calibration) -> Option<GateRefusal> {
    let doubt =
        |finding: &&Finding| finding.name == name::LATITUDE && !calibration.options.accept.contains(&name::LATITUDE);
    let finding = calibration.findings.iter().find(doubt)?;
    Some(GateRefusal {
        by: "latitude",
        cause: format!("{}; correct latitude_deg, or calibrate by hand with --accept latitude", finding.message),
    })
}

/// The comparison of [`super::Gate::refuses_run`] for the gyroscopes, if both tables have them and Earth's rate is
/// known: why `new` is worse than `old` on the same run, by more than `granted` \[deg/h\].
pub(super) fn worse(new: &Stability, old: &Stability, granted: f64) -> Option<String> {
    let (new, old) = (new.judged_gyroscopes()?, old.judged_gyroscopes()?);
    if new.missing().or(old.missing()).is_some() {
        return None;
    }
    let pairs = common_windows(&new.windows, &old.windows);
    let errors = |axis: usize| errors_along(&pairs, axis, [new.subtracted[axis], old.subtracted[axis]]);
    let found = (0..AXES).map(|axis| (GYROSCOPE_NAMES[axis], errors(axis)));
    let Worse { name, new, old, allowed } = worst_of(found, granted)?;
    Some(format!(
        "{name} is off by {new:.4} deg/h, with the table in force by {old:.4} deg/h in the same windows; {allowed:.4} deg/h more is granted"
    ))
}
