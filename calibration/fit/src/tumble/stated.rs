//! The curves of the fit with what is known of their errors.

use super::choice::Fitted;
use super::groups::{Groups, mean};
use super::reading::Reading;
use super::weighted::Weighted;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, SlopeError, root, student_quantile_of};
use nalgebra::{DMatrix, DVector};

/// The degrees of freedom of a curve are the least at the ends of this many equal steps over its range.
const STEPS: u32 = 8;

/// Curves and misalignments with their errors.
pub(super) struct Stated {
    /// Of each axis: A \[g0\], K+ and K- \[pulse/(s*g0)\].
    pub curves: [[Curve; 3]; AXES],
    /// Standard errors of m12, m13, m23 \[rad\], and the degrees of freedom of the worst known.
    pub misalignment: Option<([f64; AXES], f64)>,
}

/// The ranges of head and board telemetry, for each axis.
pub(super) type Ranges = [[[f64; 2]; AXES]; 2];

/// The curves over `ranges`, with errors where telemetry was `measured`. `gravity` is the relative half width of the
/// local gravity's 95 % interval: every scale factor is off by as much.
pub(super) fn stated(fitted: &Fitted<'_>, groups: &Groups, ranges: &Ranges, measured: &Ranges, gravity: f64) -> Stated {
    let Fitted { model, fit, weighted, .. } = fitted;
    let unknown = weighted.as_ref().map_or(&fit.unknown, |weighted| &weighted.unknown);
    // Between groups nothing is left to judge A and K by if the order takes it all.
    let known = weighted.as_ref().filter(|_| groups.count == 1 || groups.count > model.unknowns.order + 1);
    let step = model.readings().iter().map(|reading| reading.telemetry_step).fold(0.0, f64::max);
    let curve = |axis: usize, quantity: usize| {
        let sensor = usize::from(quantity > 0);
        let [range, measured] = [ranges[sensor][axis], measured[sensor][axis]];
        let Some(weighted) = known else {
            return model.curve(unknown, None, [axis, quantity], 0.0, range).known(measured, None);
        };
        let freedom = least_freedom(weighted, [axis, quantity], measured);
        let gravity = if quantity > 0 { gravity / student_quantile_of(CONFIDENCE, freedom) } else { 0.0 };
        let covariance: DMatrix<f64> =
            weighted.careful_covariance() + unknown * unknown.transpose() * (gravity * gravity);
        let plain = model.curve(unknown, Some(&covariance), [axis, quantity], freedom, range);
        let slope = slope_error(weighted, groups, [axis, quantity], &plain);
        plain.known(measured, slope).read_in_steps(step)
    };
    let misalignment = weighted.as_ref().filter(|_| model.unknowns.misalignment).map(|weighted| {
        let errors = [0, 1, 2].map(|k| {
            let mut c = DVector::zeros(weighted.unknown.len());
            c[weighted.unknown.len() - AXES + k] = 1.0;
            weighted.error(&c)
        });
        let freedom = errors.iter().map(|error| error.freedom).fold(f64::INFINITY, f64::min);
        (errors.map(|error| root(error.variance)), freedom)
    });
    Stated { curves: [0, 1, 2].map(|axis| [0, 1, 2].map(|quantity| curve(axis, quantity))), misalignment }
}

fn least_freedom(weighted: &Weighted<'_>, [axis, quantity]: [usize; 2], [low, high]: [f64; 2]) -> f64 {
    let points = (0..=STEPS).map(|step| low + (high - low) * f64::from(step) / f64::from(STEPS));
    points
        .map(|telemetry| weighted.error(&weighted.model.gradient(axis, quantity, telemetry)).freedom)
        .fold(f64::INFINITY, f64::min)
}

/// The slope that a constant lacks, of one group whose telemetry moved: its size and its own interval.
fn slope_error(
    weighted: &Weighted<'_>,
    groups: &Groups,
    [axis, quantity]: [usize; 2],
    curve: &Curve,
) -> Option<SlopeError> {
    let (slope, error) = weighted.slope(axis, quantity).filter(|_| groups.count == 1)?;
    let half = slope.abs() + student_quantile_of(CONFIDENCE, error.freedom) * root(error.variance);
    let of = |reading: &Reading| if quantity == 0 { reading.head[axis] } else { reading.board[axis] };
    let about = mean(&weighted.model.readings().iter().map(of).collect::<Vec<_>>());
    let unit = if quantity == 0 { 1.0 } else { curve.at(about).abs() };
    Some(SlopeError { per_unit: half * unit, about })
}
