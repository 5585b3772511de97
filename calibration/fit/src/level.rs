//! Level errors of the base, and positions that differ from the campaign file, in the residuals of the accelerometers.

use crate::checks::SetPoint;
use crate::one_stage::Solution;
use crate::quality::deviations;
use isotherm_campaign::{Campaign, Dwell, SAME_DIRECTION, other_zero};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use nalgebra::{DMatrix, DVector};

/// A position whose median residual exceeds this, plus the scatter in the position, shows a level error \[g0\].
const LEVEL_ERROR: f64 = 2e-6;
/// If the tilt is estimated, a larger median residual means that the position is wrong \[g0\].
const UNEXPLAINED: f64 = 20e-6;
/// A position explains the residuals if they fall by this factor without it.
const EXPLAINS: f64 = 3.0;
/// A position is essential if the others determine less than this part of what it measures.
const ESSENTIAL: f64 = 1e-3;

/// A warning if a position has a residual at all temperatures, or if the tilt is not estimated and may not cancel. The
/// cause is a level error of the base, or a position that differs from the campaign file.
pub(crate) fn level_error(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    solution: &Solution,
) -> Option<Finding> {
    let (size, position, axis) = largest_level_error(campaign, dwells, solution);
    let shown = format!(
        "position {} is {:.1}e-6 g0 off on {} at all temperatures",
        campaign.positions[position].number,
        size * 1e6,
        AXIS_NAMES[axis]
    );
    let missing = format!("{}, so that the base's tilt is not estimated", why_no_tilt(campaign));
    let paired = is_all_paired(campaign, dwells, set_points);
    let message = match (solution.tilt, paired) {
        (Some(_), _) if size < UNEXPLAINED => return None,
        (Some(_), _) => format!(
            "{shown}, which no tilt of the base explains: correct its angles, or its number if it was exchanged with another position, or measure \
             it again"
        ),
        (None, true) if size == 0.0 => return None,
        (None, true) => format!(
            "{missing}; {shown}, which cancels only if each direction was measured at two opposite headings; state the angles"
        ),
        (None, false) => without_pairs(campaign, &missing, (size > 0.0).then_some(shown.as_str())),
    };
    Some(Finding::warning(name::LEVEL, message))
}

/// What is said where the tilt is not estimated and does not cancel. `shown` is the largest level error, if there is
/// one.
fn without_pairs(campaign: &Campaign, missing: &str, shown: Option<&str>) -> String {
    let shown = shown.map(|shown| format!("; {shown}")).unwrap_or_default();
    let why = match campaign.mount {
        Some(_) => "these positions do not separate the base's tilt from the other parameters",
        None => missing,
    };
    format!(
        "{why}, and not every direction was measured at two opposite headings, where it cancels: 1e-6 rad of tilt may put some 1e-6 g0 \
         into bias, scale factors and misalignments{shown}; state the angles, or measure pairs"
    )
}

/// The largest median residual of a position that shows a level error, the position's index, and the axis.
fn largest_level_error(campaign: &Campaign, dwells: &[Dwell], solution: &Solution) -> (f64, usize, usize) {
    let places: Vec<usize> = dwells.iter().map(|dwell| dwell.position).collect();
    let mut largest = (0.0, 0, 0);
    for axis in 0..AXES {
        let deviations = deviations(&places, &solution.residuals, axis, &[]);
        for position in 0..campaign.positions.len() {
            let Some(any) = deviations.iter().find(|it| places[it.run] == position) else { continue };
            if any.usual.abs() > largest.0 && any.usual.abs() > LEVEL_ERROR + any.scale {
                largest = (any.usual.abs(), position, axis);
            }
        }
    }
    largest
}

/// Why the base's tilt is not estimated.
fn why_no_tilt(campaign: &Campaign) -> String {
    if campaign.positions.iter().any(|position| position.angles.is_none()) {
        return "not every position has outer_deg and inner_deg".to_owned();
    }
    let remedy = other_zero(&campaign.positions);
    let remedy = remedy.map_or_else(String::new, |off| format!(" (it would with {off} added to every outer_deg)"));
    format!("no mounting of the IMU explains outer_deg and inner_deg of most positions{remedy}")
}

/// Whether the base's tilt is neither estimated nor cancels, so that its effect on the curves is not known.
pub(crate) fn is_tilt_open(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    solution: &Solution,
) -> bool {
    solution.tilt.is_none() && !is_all_paired(campaign, dwells, set_points)
}

fn is_all_paired(campaign: &Campaign, dwells: &[Dwell], set_points: &[SetPoint]) -> bool {
    set_points.iter().all(|set_point| is_paired(campaign, dwells, set_point))
}

/// Whether every direction of a set point was measured an even number of times.
fn is_paired(campaign: &Campaign, dwells: &[Dwell], set_point: &SetPoint) -> bool {
    let forces: Vec<_> =
        set_point.dwells.iter().map(|&d| campaign.positions[dwells[d].position].specific_force).collect();
    let same = |a: &[f64; AXES], b: &[f64; AXES]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_DIRECTION);
    forces.iter().all(|force| forces.iter().filter(|other| same(force, other)).count() % 2 == 0)
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
    let means = DVector::from_fn(used.len() * AXES, |index, _| mean(used[index / AXES], index % AXES));
    let basis = basis(design(campaign, &used, solution.tilt))?;
    let all = [0, 1, 2].map(|axis| {
        solution.residuals.iter().map(|residual| residual[axis].powi(2)).sum::<f64>() / dwells.len() as f64
    });
    let of_means = mean_squares(&means, None);
    let without = |position: usize| {
        let others = mean_squares(&means_without(position, &means, &basis)?, Some(position));
        Some((0..AXES).map(|axis| (all[axis] - of_means[axis]).max(0.0) + others[axis]).sum::<f64>())
    };
    let rest = (0..used.len()).filter_map(|position| Some((used[position], without(position)?)));
    let (position, rest) = rest.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (rest < all.iter().sum::<f64>() / EXPLAINS.powi(2)).then_some(position)
}

/// The columns of the linear fit, with a row for each axis in each of the positions `used`.
fn design(campaign: &Campaign, used: &[usize], tilt: Option<[f64; 2]>) -> DMatrix<f64> {
    let forces: Vec<_> = campaign.positions.iter().map(|position| campaign.force(position, tilt)).collect();
    DMatrix::from_fn(used.len() * AXES, AXES * 5 + 2, |index, column| {
        let (position, axis) = (used[index / AXES], index % AXES);
        let (force, by_tilt) = &forces[position];
        match (column / 5, column % 5) {
            (AXES, k) => tilt.map_or(0.0, |_| by_tilt[axis][k]),
            (other, _) if other != axis => 0.0,
            (_, 0) => 1.0,
            (_, 1) => force[axis].max(0.0),
            (_, 2) => force[axis].min(0.0),
            (_, k) => force[(axis + k - 2) % AXES],
        }
    })
}

/// An orthonormal basis of the columns.
fn basis(design: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let svd = design.svd(true, false);
    let smallest = 1e-9 * svd.singular_values.max();
    let columns: Vec<usize> = (0..svd.singular_values.len()).filter(|&k| svd.singular_values[k] > smallest).collect();
    Some(svd.u?.select_columns(&columns))
}

/// The mean residuals of a fit without a position; `None` if the others do not determine that fit.
fn means_without(position: usize, means: &DVector<f64>, basis: &DMatrix<f64>) -> Option<DVector<f64>> {
    let part = basis.rows(position * AXES, AXES);
    let free = DMatrix::identity(AXES, AXES) - part * part.transpose();
    if free.symmetric_eigenvalues().min() < ESSENTIAL {
        return None;
    }
    let off = free.try_inverse()? * means.rows(position * AXES, AXES);
    Some(means + basis * (part.transpose() * off))
}

/// Mean square of the positions' means along each axis.
fn mean_squares(means: &DVector<f64>, left_out: Option<usize>) -> [f64; AXES] {
    let positions = means.len() / AXES;
    [0, 1, 2].map(|axis| {
        let kept = (0..positions).filter(|&p| Some(p) != left_out);
        kept.map(|p| means[p * AXES + axis].powi(2)).sum::<f64>() / (positions - usize::from(left_out.is_some())) as f64
    })
}
