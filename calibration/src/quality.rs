//! The quality of a calibration beyond its standard errors: level errors, lack of fit, outlying dwells.

use crate::checks::SetPoint;
use crate::effects::{BIAS_EFFECT, SCALE_FACTOR_EFFECT};
use crate::one_stage::{Solution, solve};
use crate::reduce::Reduced;
use isotherm_campaign::{Campaign, Dwell, SAME_DIRECTION, other_zero};
use isotherm_finding::{Finding, Severity, name};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{OrderTable, QUANTITIES, median, robust_sd};
use nalgebra::{DMatrix, DVector};

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
/// A position explains the residuals if they fall by this factor without it.
const EXPLAINS: f64 = 3.0;
/// A position is essential if the others determine less than this part of what it measures.
const ESSENTIAL: f64 = 1e-3;
/// Largest part of the dwells that can be outliers.
const MAX_OUTLIER_PART: f64 = 0.1;
/// Largest number of outliers.
const MAX_OUTLIERS: usize = 20;

/// A warning if a position has a residual at all temperatures, or if the tilt is not estimated and may not cancel. The
/// cause is a level error of the base, or a position that differs from the campaign file.
pub(crate) fn level_error(
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
    let why = if campaign.positions.iter().any(|position| position.angles.is_none()) {
        "not every position has outer_deg and inner_deg".to_owned()
    } else {
        let remedy = other_zero(&campaign.positions);
        let remedy = remedy.map_or_else(String::new, |off| format!(" (it would with {off} added to every outer_deg)"));
        format!("no mounting of the IMU explains outer_deg and inner_deg of most positions{remedy}")
    };
    let missing = format!("{why}, so that the base's tilt is not estimated");
    let paired = set_points.iter().all(|set_point| is_paired(campaign, dwells, set_point));
    let message = match (solution.tilt, paired) {
        (Some(_), _) if size < UNEXPLAINED => return None,
        (Some(_), _) => format!(
            "{shown}, which no tilt of the base explains: correct its angles, or its number if it was exchanged with another position, or measure \
             it again"
        ),
        (None, true) if size == 0.0 => return None,
        (None, true) => {
            format!(
                "{missing}; {shown}, which cancels only if each direction was measured at two opposite headings; state the angles"
            )
        }
        (None, false) => {
            let why = match campaign.mount {
                Some(_) => "these positions do not tell the base's tilt from the other parameters",
                None => &missing,
            };
            let shown = if size > 0.0 { format!("; {shown}") } else { String::new() };
            format!(
                "{why}, and not every direction was measured at two opposite headings, where it cancels: 1e-6 rad of tilt may put some 1e-6 g0 \
                 into bias, scale factors and misalignments{shown}; state the angles, or measure pairs"
            )
        }
    };
    Some(Finding::whole(Severity::Warning, name::LEVEL, message))
}

/// Whether every direction of a set point was measured an even number of times.
fn is_paired(campaign: &Campaign, dwells: &[Dwell], set_point: &SetPoint) -> bool {
    let forces: Vec<_> =
        set_point.dwells.iter().map(|&d| campaign.positions[dwells[d].position].specific_force).collect();
    let same = |a: &[f64; AXES], b: &[f64; AXES]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_DIRECTION);
    forces.iter().all(|force| forces.iter().filter(|other| same(force, other)).count() % 2 == 0)
}

/// A warning about the curves that miss their set points by much more than the set points' own uncertainty, and one
/// about curves without degrees of freedom. The array marks the axes that have a curve of the first kind.
pub(crate) fn lack_of_fit(
    orders: &[[OrderTable; 3]; AXES],
    reduced: &[[Reduced; AXES]],
) -> ([bool; AXES], Vec<Finding>) {
    let mut unfit = [false; AXES];
    // What is said about the worst curve, how bad that is, and the names of the curves.
    let [mut missing, mut taking]: [(f64, String, Vec<String>); 2] =
        [(0.0, String::new(), Vec::new()), (0.0, String::new(), Vec::new())];
    for (axis, tables) in orders.iter().enumerate() {
        for (quantity, table) in tables.iter().enumerate() {
            let fit = &table.regression.fits()[table.choice.order];
            let own = median(reduced.iter().map(|parts| parts[axis].standard_errors[quantity]));
            let size = reduced.iter().map(|parts| parts[axis].values[quantity].abs()).fold(0.0, f64::max);
            let effect = if quantity == 0 { BIAS_EFFECT } else { SCALE_FACTOR_EFFECT * size };
            let curve = format!("{} {}", AXIS_NAMES[axis], QUANTITIES[quantity]);
            // The robust scatter ignores a few outliers, which are found elsewhere.
            let n = table.regression.n() as f64;
            let scatter = |_| robust_sd(&table.regression.residuals(fit.order)) * (n / fit.df_residual as f64).sqrt();
            match fit.residual_sd.map(scatter) {
                Some(sd) if sd > (LACK_OF_FIT * own).max(LACK_OF_FIT_FLOOR * effect) => {
                    unfit[axis] = true;
                    let (factor, unit) = if quantity == 0 { (1e6, "e-6 g0") } else { (1e6 / size, " ppm") };
                    if sd / own > missing.0 {
                        let text = format!(
                            "{curve}: the set points scatter by {:.2}{unit} about the curve of order {}, {:.0} times what each is uncertain by",
                            sd * factor,
                            fit.order,
                            sd / own
                        );
                        (missing.0, missing.1) = (sd / own, text);
                    }
                    missing.2.push(curve);
                }
                None => {
                    if taking.2.is_empty() {
                        taking.1 = format!(
                            "{curve}: order {} takes all {} set points, so that nothing tells how good the curve is",
                            fit.order,
                            reduced.len()
                        );
                    }
                    taking.2.push(curve);
                }
                _ => {}
            }
        }
    }
    let remedies = [
        (
            name::LACK_OF_FIT,
            missing,
            "the order is too low, there are too few set points for a higher one, or the IMU does not repeat; take a higher --order, measure more \
             set points, or look in the report for a set point that is off",
        ),
        (name::NO_FREEDOM, taking, "measure more set points, or take a lower order"),
    ];
    let finding = |(name, (_, text, curves), remedy): (&'static str, (f64, String, Vec<String>), &str)| {
        let others = match curves.len() {
            0 => return None,
            1 => String::new(),
            2 => ", and so it is with one more curve".to_owned(),
            n => format!(", and so it is with {} more curves", n - 1),
        };
        Some(Finding::whole(Severity::Warning, name, format!("{text}{others}: {remedy}")))
    };
    (unfit, remedies.into_iter().filter_map(finding).collect())
}

/// Outlying dwells, as index and axis. The worst is left out and the fit repeated, until no outlier is left.
pub(crate) fn outliers(
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

/// The position that explains the residuals, by its index: they fall to a third in a fit without it. A single wrong
/// position says nothing about the laboratory, but it pulls the whole fit.
///
/// The fit without a position is the linear one of the positions' mean residuals: bias, K+, K- and two misalignments of
/// each accelerometer, and the tilt if it was estimated. With the hat matrix H the residuals r of the position become
/// d = (1 - H_pp)^-1 r, those of the others grow by H_op d.
pub(crate) fn position_that_explains(campaign: &Campaign, dwells: &[Dwell], solution: &Solution) -> Option<usize> {
    let of = |position: usize| (0..dwells.len()).filter(move |&d| dwells[d].position == position);
    let used: Vec<usize> = (0..campaign.positions.len()).filter(|&p| of(p).next().is_some()).collect();
    let mean = |position: usize, axis: usize| {
        of(position).map(|d| solution.residuals[d][axis]).sum::<f64>() / of(position).count() as f64
    };
    let row = |index: usize| (used[index / AXES], index % AXES);
    let forces: Vec<_> = campaign.positions.iter().map(|position| campaign.force(position, solution.tilt)).collect();
    let rows = used.len() * AXES;
    let design = DMatrix::from_fn(rows, AXES * 5 + 2, |index, column| {
        let (position, axis) = row(index);
        let (force, by_tilt) = &forces[position];
        match (column / 5, column % 5) {
            (AXES, k) => solution.tilt.map_or(0.0, |_| by_tilt[axis][k]),
            (other, _) if other != axis => 0.0,
            (_, 0) => 1.0,
            (_, 1) => force[axis].max(0.0),
            (_, 2) => force[axis].min(0.0),
            (_, k) => force[(axis + k - 2) % AXES],
        }
    });
    let svd = design.svd(true, false);
    let all = [0, 1, 2].map(|axis| {
        solution.residuals.iter().map(|residual| residual[axis].powi(2)).sum::<f64>() / dwells.len() as f64
    });
    let basis = svd.u?;
    let smallest = 1e-9 * svd.singular_values.max();
    let columns: Vec<usize> = (0..svd.singular_values.len()).filter(|&k| svd.singular_values[k] > smallest).collect();
    let basis = basis.select_columns(&columns);
    let means = DVector::from_fn(rows, |index, _| mean(row(index).0, row(index).1));
    let by_axis = |values: &DVector<f64>, left_out: Option<usize>| {
        [0, 1, 2].map(|axis| {
            let kept = (0..used.len()).filter(|&p| Some(p) != left_out);
            kept.map(|p| values[p * AXES + axis].powi(2)).sum::<f64>()
                / (used.len() - usize::from(left_out.is_some())) as f64
        })
    };
    let of_means = by_axis(&means, None);
    let without = |position: usize| {
        let part = basis.rows(position * AXES, AXES);
        let free = DMatrix::identity(AXES, AXES) - part * part.transpose();
        // Without this position the others would not determine the fit.
        if free.symmetric_eigenvalues().min() < ESSENTIAL {
            return None;
        }
        let off = free.try_inverse()? * means.rows(position * AXES, AXES);
        let others = by_axis(&(&means + &basis * (part.transpose() * off)), Some(position));
        Some((0..AXES).map(|axis| (all[axis] - of_means[axis]).max(0.0) + others[axis]).sum::<f64>())
    };
    let rest = (0..used.len()).filter_map(|position| Some((used[position], without(position)?)));
    let (position, rest) = rest.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (rest < all.iter().sum::<f64>() / EXPLAINS.powi(2)).then_some(position)
}

/// The warnings of the order tables' diagnostics, with the name of the curve.
pub(crate) fn order_findings(orders: &[[OrderTable; 3]; AXES]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (axis, tables) in AXIS_NAMES.iter().zip(orders) {
        for (quantity, table) in QUANTITIES.iter().zip(tables) {
            for warning in &table.diagnostics.warnings {
                let message = format!("{axis} {quantity}: {warning}");
                findings.push(Finding::whole(Severity::Warning, name::RESIDUALS, message));
            }
        }
    }
    findings
}
