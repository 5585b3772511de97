//! The quality of a calibration beyond its standard errors: level errors, lack of fit, outlying dwells.

use crate::campaign::{Campaign, Dwell};
use crate::checks::{Finding, SetPoint, Severity};
use crate::diagnostics::{median, robust_sd};
use crate::one_stage::{Solution, solve};
use crate::order::{BIAS_EFFECT, OrderTable, QUANTITIES, SCALE_FACTOR_EFFECT};
use crate::positions::SAME_DIRECTION;
use crate::reduce::Reduced;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;

/// Limit of a dwell's residual, in robust standard deviations of the residuals; a dwell over it is an outlier.
const OUTLIER: f64 = 6.0;
/// Constant part of that limit \[g0\].
const OUTLIER_FLOOR: f64 = 1e-6;
/// Limit of the set points' scatter about their curve, in their own standard errors; beyond it the curve does not fit.
const LACK_OF_FIT: f64 = 8.0;
/// Lower bound of that limit, in multiples of the smallest effect that matters.
const LACK_OF_FIT_FLOOR: f64 = 10.0;
/// A position whose median residual exceeds this, plus the scatter in the position, shows a level error \[g0\].
const LEVEL_ERROR: f64 = 2e-6;
/// If the tilt is estimated, a larger median residual means that the position is wrong \[g0\].
const UNEXPLAINED: f64 = 20e-6;
/// Largest part of the dwells that can be outliers.
const MAX_OUTLIER_PART: f64 = 0.1;
/// Largest number of outliers.
const MAX_OUTLIERS: usize = 20;

/// A warning if a position has a residual at all temperatures, or if the tilt is not estimated and may not cancel. The
/// cause is a level error of the base, or a position that differs from the campaign file.
pub fn level_error(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    solution: &Solution,
) -> Option<Finding> {
    let mut largest = (0.0, 0, 0);
    for axis in 0..AXES {
        let (_, scale, usual) = position_statistics(campaign.positions.len(), dwells, &solution.residuals, axis, &[]);
        for (position, usual) in usual.iter().enumerate() {
            if usual.abs() > largest.0 && usual.abs() > LEVEL_ERROR + scale[position] {
                largest = (usual.abs(), position, axis);
            }
        }
    }
    let (size, position, axis) = largest;
    let shown = format!(
        "position {} is {:.1}e-6 g0 off on {} at all temperatures",
        campaign.positions[position].number,
        size * 1e6,
        AXIS_NAMES[axis]
    );
    let missing = "outer_deg and inner_deg are missing or do not fit the stated specific forces, so that the base's tilt is not estimated";
    let paired = set_points.iter().all(|set_point| is_paired(campaign, dwells, set_point));
    let message = match (solution.tilt, paired) {
        (Some(_), _) if size < UNEXPLAINED => return None,
        (Some(_), _) => format!("{shown}, which no tilt of the base explains: exchanged positions, or wrong angles?"),
        (None, true) if size == 0.0 => return None,
        (None, true) => {
            format!(
                "{missing}; {shown}, which cancels only if each direction was measured at two opposite headings; state the angles"
            )
        }
        (None, false) => {
            let why = match campaign.mount {
                Some(_) => "these positions do not tell the base's tilt from the other parameters",
                None => missing,
            };
            let shown = if size > 0.0 { format!("; {shown}") } else { String::new() };
            format!(
                "{why}, and not every direction was measured at two opposite headings, where it cancels: 1e-6 rad of tilt may put some 1e-6 g0 \
                 into bias, scale factors and misalignments{shown}; state the angles, or measure pairs"
            )
        }
    };
    Some(Finding { severity: Severity::Warning, line: None, place: None, message })
}

/// Whether every direction of a set point was measured an even number of times.
fn is_paired(campaign: &Campaign, dwells: &[Dwell], set_point: &SetPoint) -> bool {
    let forces: Vec<_> =
        set_point.dwells.iter().map(|&d| campaign.positions[dwells[d].position].specific_force).collect();
    let same = |a: &[f64; AXES], b: &[f64; AXES]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_DIRECTION);
    forces.iter().all(|force| forces.iter().filter(|other| same(force, other)).count() % 2 == 0)
}

/// Warnings about curves that miss their set points by much more than the set points' own uncertainty, and about curves
/// without degrees of freedom. The array marks the axes that have a curve of the first kind.
pub fn lack_of_fit(orders: &[[OrderTable; 3]; AXES], reduced: &[[Reduced; AXES]]) -> ([bool; AXES], Vec<Finding>) {
    let (mut unfit, mut findings) = ([false; AXES], Vec::new());
    for (axis, tables) in orders.iter().enumerate() {
        for (quantity, table) in tables.iter().enumerate() {
            let fit = &table.regression.fits()[table.choice.order];
            let own = median(reduced.iter().map(|parts| parts[axis].standard_errors[quantity]));
            let size = reduced.iter().map(|parts| parts[axis].values[quantity].abs()).fold(0.0, f64::max);
            let effect = if quantity == 0 { BIAS_EFFECT } else { SCALE_FACTOR_EFFECT * size };
            let name = format!("{} {}", AXIS_NAMES[axis], QUANTITIES[quantity]);
            // The robust scatter ignores a few outliers, which are found elsewhere.
            let n = table.regression.n() as f64;
            let scatter = |_| robust_sd(&table.regression.residuals(fit.order)) * (n / fit.df_residual as f64).sqrt();
            let message = match fit.residual_sd.map(scatter) {
                Some(sd) if sd > (LACK_OF_FIT * own).max(LACK_OF_FIT_FLOOR * effect) => {
                    unfit[axis] = true;
                    let (factor, unit) = if quantity == 0 { (1e6, "e-6 g0") } else { (1e6 / size, " ppm") };
                    format!(
                        "{name}: the set points scatter by {:.2}{unit} about the curve of order {}, {:.0} times what each is uncertain by: the \
                         order is too low, there are too few set points for a higher one, or the IMU does not repeat",
                        sd * factor,
                        fit.order,
                        sd / own
                    )
                }
                None => format!(
                    "{name}: order {} takes all {} set points, so that nothing tells how good the curve is; measure more set points, or take \
                     a lower order",
                    fit.order,
                    reduced.len()
                ),
                _ => continue,
            };
            findings.push(Finding { severity: Severity::Warning, line: None, place: None, message });
        }
    }
    (unfit, findings)
}

/// Outlying dwells, as index and axis. The worst is left out and the fit repeated, until no outlier is left.
pub fn outliers(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    solution: &Solution,
) -> Vec<(usize, usize)> {
    let curves = [0, 1, 2].map(|axis| solution.axes[axis].curves.clone());
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut left_out: Vec<usize> = Vec::new();
    let mut residuals = solution.residuals.clone();
    let most = MAX_OUTLIERS.min((MAX_OUTLIER_PART * dwells.len() as f64) as usize);
    while left_out.len() < most {
        let mut worst: Option<(f64, usize, usize)> = None;
        for axis in 0..AXES {
            let (off, scale, _) = position_statistics(campaign.positions.len(), dwells, &residuals, axis, &left_out);
            for d in (0..off.len()).filter(|d| !left_out.contains(d)) {
                let ratio = off[d].abs() / (OUTLIER * scale[dwells[d].position] + OUTLIER_FLOOR);
                if ratio > 1.0 && worst.is_none_or(|(most, ..)| ratio > most) {
                    worst = Some((ratio, d, axis));
                }
            }
        }
        let Some((_, dwell, axis)) = worst else { break };
        found.push((dwell, axis));
        left_out.push(dwell);
        match solve(campaign, dwells, set_points, &curves, &left_out) {
            Ok(solution) => residuals = solution.residuals,
            Err(_) => break,
        }
    }
    found
}

/// The difference of each dwell's residual from the median of its position; the robust standard deviation of these
/// differences in each position; the median of each position. Each position has its own level error, if no tilt was
/// estimated, and its own scatter, because the turntable's repeatability acts differently on the axes.
fn position_statistics(
    positions: usize,
    dwells: &[Dwell],
    residuals: &[[f64; AXES]],
    axis: usize,
    left_out: &[usize],
) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let kept =
        |position: usize| (0..dwells.len()).filter(move |d| dwells[*d].position == position && !left_out.contains(d));
    let usual: Vec<f64> = (0..positions).map(|p| median(kept(p).map(|d| residuals[d][axis]))).collect();
    let off: Vec<f64> = (0..dwells.len()).map(|d| residuals[d][axis] - usual[dwells[d].position]).collect();
    let all: Vec<f64> = (0..positions).flat_map(kept).map(|d| off[d]).collect();
    // A few dwells in a position can agree by chance, so the scatter over all positions is the lower limit.
    let least = robust_sd(&all);
    let scale = |position: usize| least.max(robust_sd(&kept(position).map(|d| off[d]).collect::<Vec<_>>()));
    let scales = (0..positions).map(scale).collect();
    (off, scales, usual)
}

/// The warnings of the order tables' diagnostics, with the name of the curve.
pub fn order_findings(orders: &[[OrderTable; 3]; AXES]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (name, tables) in AXIS_NAMES.iter().zip(orders) {
        for (quantity, table) in QUANTITIES.iter().zip(tables) {
            for warning in &table.diagnostics.warnings {
                let message = format!("{name} {quantity}: {warning}");
                findings.push(Finding { severity: Severity::Warning, line: None, place: None, message });
            }
        }
    }
    findings
}
