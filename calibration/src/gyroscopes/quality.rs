//! The quality of the gyroscopes' calibration beyond its standard errors: lack of fit, outlying runs.

use super::fit::{GyroscopeCurves, ReducedSetPoint, Run, TriadSolution, solve};
use super::runs::FittedRun;
use crate::effects::{GYROSCOPE_BIAS_EFFECT, GYROSCOPE_SCALE_FACTOR_EFFECT};
use isotherm_campaign::Campaign;
use isotherm_finding::{Finding, Location, Severity, name};
use isotherm_shared::table::GYROSCOPE_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{OrderTable, QUANTITIES, median, robust_sd};

/// Limit of a run's residual, in robust standard deviations; a run over it is an outlier.
const OUTLIER: f64 = 6.0;
/// Constant part of that limit \[arcsec/sqrt(s)\].
const OUTLIER_FLOOR: f64 = 0.05;
/// Largest part of the runs that can be outliers.
const MAX_OUTLIER_PART: f64 = 0.1;
/// Largest number of outliers.
const MAX_OUTLIERS: usize = 20;
/// Limit of the set points' scatter about their curve, in their own standard errors; beyond it the curve does not fit.
const LACK_OF_FIT: f64 = 8.0;
/// Lower bound of that limit, in multiples of the smallest effect that matters.
const LACK_OF_FIT_FLOOR: f64 = 10.0;

/// Warnings about curves that miss their set points by much more than the set points' own uncertainty, and about curves
/// without degrees of freedom. The array marks the gyroscopes that have a curve of the first kind.
pub(super) fn lack_of_fit(
    orders: &[[OrderTable; 3]; AXES],
    reduced: &[ReducedSetPoint],
) -> ([bool; AXES], Vec<Finding>) {
    let (mut unfit, mut findings) = ([false; AXES], Vec::new());
    for (axis, tables) in orders.iter().enumerate() {
        for (quantity, table) in tables.iter().enumerate() {
            let fit = &table.regression.fits()[table.choice.order];
            let own = median(reduced.iter().map(|parts| parts.standard_errors[axis][quantity]));
            let size = reduced.iter().map(|parts| parts.values[axis][quantity].abs()).fold(0.0, f64::max);
            let effect = if quantity == 0 { GYROSCOPE_BIAS_EFFECT } else { GYROSCOPE_SCALE_FACTOR_EFFECT * size };
            let curve = format!("{} {}", GYROSCOPE_NAMES[axis], QUANTITIES[quantity]);
            let n = table.regression.n() as f64;
            let scatter = |_| robust_sd(&table.regression.residuals(fit.order)) * (n / fit.df_residual as f64).sqrt();
            let (name, message) = match fit.residual_sd.map(scatter) {
                Some(sd) if sd > (LACK_OF_FIT * own).max(LACK_OF_FIT_FLOOR * effect) => {
                    unfit[axis] = true;
                    let (factor, unit) = if quantity == 0 { (1.0, "deg/h") } else { (1e6 / size, "ppm") };
                    let message = format!(
                        "{curve}: the set points scatter by {:.3} {unit} about the curve of order {}, {:.0} times what each is uncertain by: the order \
                         is too low, there are too few set points for a higher one, or the gyroscope does not repeat",
                        sd * factor,
                        fit.order,
                        sd / own
                    );
                    (name::LACK_OF_FIT, message)
                }
                None => {
                    let message = format!(
                        "{curve}: order {} takes all {} set points, so that nothing tells how good the curve is; measure more set points, or take a \
                         lower order",
                        fit.order,
                        reduced.len()
                    );
                    (name::NO_FREEDOM, message)
                }
                _ => continue,
            };
            findings.push(Finding::whole(Severity::Warning, name, message));
        }
    }
    (unfit, findings)
}

/// Outlying runs, as index and gyroscope. The worst is left out and the fit repeated, until no outlier is left.
pub(super) fn outliers(
    runs: &[Run<'_>],
    places: &[FittedRun],
    set_points: usize,
    solution: &TriadSolution,
) -> Vec<(usize, usize)> {
    let curves: GyroscopeCurves = [0, 1, 2].map(|axis| solution.gyroscopes[axis].curves.clone());
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut left_out: Vec<usize> = Vec::new();
    let mut residuals = solution.residuals.clone();
    let most = MAX_OUTLIERS.min((MAX_OUTLIER_PART * runs.len() as f64) as usize);
    while left_out.len() < most {
        let mut worst: Option<(f64, usize, usize)> = None;
        for axis in 0..AXES {
            for (run, ratio) in excess(places, &residuals, axis, &left_out) {
                if ratio > 1.0 && worst.is_none_or(|(most, ..)| ratio > most) {
                    worst = Some((ratio, run, axis));
                }
            }
        }
        let Some((_, run, axis)) = worst else { break };
        found.push((run, axis));
        left_out.push(run);
        match solve(runs, set_points, &curves, &left_out) {
            Ok(solution) => residuals = solution.residuals,
            Err(_) => break,
        }
    }
    found
}

/// The residual of each run less the median of its position or turn, over the limit.
fn excess(places: &[FittedRun], residuals: &[[f64; AXES]], axis: usize, left_out: &[usize]) -> Vec<(usize, f64)> {
    let kept: Vec<usize> = (0..places.len()).filter(|run| !left_out.contains(run)).collect();
    let same = |run: usize| kept.iter().copied().filter(move |other| places[*other].place == places[run].place);
    let off: Vec<(usize, f64)> = kept
        .iter()
        .map(|&run| (run, residuals[run][axis] - median(same(run).map(|other| residuals[other][axis]))))
        .collect();
    // A few runs in a position can agree by chance, so the scatter over all of them is the lower limit.
    let least = robust_sd(&off.iter().map(|(_, off)| *off).collect::<Vec<_>>());
    let scale = |run: usize| {
        let own: Vec<f64> =
            off.iter().filter(|(other, _)| places[*other].place == places[run].place).map(|(_, off)| *off).collect();
        least.max(robust_sd(&own))
    };
    off.iter().map(|&(run, value)| (run, value.abs() / (OUTLIER * scale(run) + OUTLIER_FLOOR))).collect()
}

/// The warning about an outlier.
pub(super) fn outlier(
    campaign: &Campaign,
    set_points_c: &[f64],
    places: &[FittedRun],
    &(run, axis): &(usize, usize),
) -> Finding {
    let FittedRun { set_point, place, lines, residual, .. } = &places[run];
    let set_point_c = set_points_c[*set_point];
    let number = place.number(campaign);
    Finding {
        severity: Severity::Warning,
        name: name::OUTLIER,
        line: Some(lines[0]),
        place: Some(Location::SetPoint(set_point_c, Some(number))),
        message: format!(
            "{} is {:.2} arcsec off the fit, far more than elsewhere; kept, leave it out with --exclude {set_point_c}/{} if it is known to be bad",
            GYROSCOPE_NAMES[axis],
            residual[axis],
            number.value()
        ),
    }
}

/// The warnings of the order tables' diagnostics, with the name of the curve.
pub(super) fn order_findings(orders: &[[OrderTable; 3]; AXES]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (gyroscope, tables) in GYROSCOPE_NAMES.iter().zip(orders) {
        for (quantity, table) in QUANTITIES.iter().zip(tables) {
            for warning in &table.diagnostics.warnings {
                let message = format!("{gyroscope} {quantity}: {warning}");
                findings.push(Finding::whole(Severity::Warning, name::RESIDUALS, message));
            }
        }
    }
    findings
}
