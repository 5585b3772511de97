//! What a gate allows, whatever the sensor is, and how it refuses.

use crate::verdict::MIN_GROUP;
use isotherm_fit::Calibration;
use isotherm_support::finding::{Finding, name};

/// What a gate allows in any case \[g0\]: dynamic effects of a temperature that moves, which a campaign of settled set
/// points does not show.
pub const GATE_FLOOR: f64 = 10e-6;
/// Largest bound of a gate that nobody has stated \[g0\]: 20 arcsec of level, five times what one expects of such an
/// IMU. A user with a worse turntable or IMU knows it, and states a bound.
pub(crate) const GATE_MOST: f64 = 100e-6;
/// The same for a fit that does not explain its data: with accepted faults, or with a warning that says so \[g0\].
pub(crate) const GATE_ACCEPTED: f64 = 20e-6;
/// Warnings that the model does not explain the data, or not all of it. What they report is in the residuals, and so in
/// the bound.
const UNEXPLAINED: [&str; 4] = [name::LEVEL, name::LACK_OF_FIT, name::RESIDUALS, name::OUTLIER];
/// What a table without alignment matrix may leave, if nobody has stated a bound \[g0\]: a fit of few set points has a
/// wide bound, but this is an error that it has seen.
pub(crate) const GATE_LEFT: f64 = 20e-6;
/// Shortest group of a run \[s\]: windows of 10 s.
pub(super) const GROUP_S: f64 = 10.0 * MIN_GROUP as f64;
/// Why a table must not be installed.
#[derive(Clone, Debug, PartialEq)]
pub struct GateRefusal {
    /// `no alignment`, `range`, `channel`, `runs`, `table in force`, `gyroscopes`, `latitude`, or the name of the
    /// judgement that is not met.
    pub by: &'static str,
    /// In words.
    pub cause: String,
}

impl GateRefusal {
    /// What runs that cover more of the range would show.
    pub const RUNS: &str = "runs";
    /// What more runs, at other attitudes, would show.
    pub const CHANNEL: &str = "channel";
}

/// Whether a warning says that the model does not explain the data.
pub(super) fn is_unexplained(calibration: &Calibration) -> bool {
    // Without the angles a level error is the base's tilt, which nobody has estimated, as well as a mistake.
    let tilt = calibration.solution.tilt.is_some();
    let unexplained = |finding: &Finding| UNEXPLAINED.contains(&finding.name) && (tilt || finding.name != name::LEVEL);
    calibration.findings.iter().any(unexplained)
}
