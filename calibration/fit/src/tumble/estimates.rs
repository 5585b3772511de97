//! The curves of the fit with what is known of their errors.

use super::choice::TumbleFit;
use super::error::TumbleError;
use super::groups::Groups;
use super::model::Unknowns;
use super::options::TumbleOptions;
use super::reading::Reading;
use super::weighted::WeightedFit;
use isotherm_campaign::{Campaign, joint_range};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, SlopeError, mean, root, student_quantile_of};
use nalgebra::{DMatrix, DVector};

/// The degrees of freedom of a curve are the least at the ends of this many equal steps over its range.
const STEPS: u32 = 8;

/// Curves and misalignments with their errors.
pub(super) struct Estimates {
    /// Of each axis: A \[g0\], K+ and K- \[pulse/(s*g0)\].
    pub curves: [[Curve; 3]; AXES],
    /// Standard errors of m12, m13, m23 \[rad\], and the degrees of freedom of the worst known.
    pub misalignment: Option<([f64; AXES], f64)>,
}

/// The ranges of head and board temperature, for each axis.
pub(super) type Ranges = [[[f64; 2]; AXES]; 2];

/// The curves over `ranges`, with errors where temperature was `measured`. `gravity` is the relative half width of the
/// local gravity's 95 % interval: every scale factor is off by as much.
pub(super) fn estimates(
    fitted: &TumbleFit<'_>,
    groups: &Groups,
    ranges: &Ranges,
    measured: &Ranges,
    gravity: f64,
) -> Estimates {
    let TumbleFit { model, weighted, .. } = fitted;
    let unknown = fitted.unknown();
    // Between groups nothing is left to judge A and K by if the order takes it all.
    let known = weighted.as_ref().filter(|_| groups.count == 1 || groups.count > model.unknowns.order + 1);
    let step = model.readings().iter().map(|reading| reading.temperature_step).fold(0.0, f64::max);
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
    Estimates { curves: [0, 1, 2].map(|axis| [0, 1, 2].map(|quantity| curve(axis, quantity))), misalignment }
}

fn least_freedom(weighted: &WeightedFit<'_>, [axis, quantity]: [usize; 2], [low, high]: [f64; 2]) -> f64 {
    let points = (0..=STEPS).map(|step| low + (high - low) * f64::from(step) / f64::from(STEPS));
    points
        .map(|temperature| weighted.error(&weighted.model.gradient(axis, quantity, temperature)).freedom)
        .fold(f64::INFINITY, f64::min)
}

/// The slope that a constant lacks, of one group whose temperature moved: its size and its own interval.
fn slope_error(
    weighted: &WeightedFit<'_>,
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

/// The temperature's range of head and board of each axis for the table, and as measured.
pub(super) fn table_ranges(
    campaign: &Campaign,
    readings: &[Reading],
    unknowns: &Unknowns,
    options: &TumbleOptions,
) -> Result<(Ranges, Ranges), TumbleError> {
    let of = |ranges: fn(&Reading) -> [[f64; 2]; AXES]| {
        [0, 1, 2].map(|axis| joint_range(readings.iter().map(|reading| ranges(reading)[axis])))
    };
    let measured = [of(|reading| reading.head_range), of(|reading| reading.board_range)];
    let constant = measured.iter().flatten().any(|[low, high]| low == high);
    match options.temperature_range.or(campaign.temperature_range) {
        None if constant => Err(TumbleError::Refused(
            "the temperature is constant, so the recordings do not say where the table is valid; state it: --temperature-range LOW,HIGH, or \
             temperature_range = [LOW, HIGH] in the campaign file".to_owned(),
        )),
        Some(_) if unknowns.order > 0 => Err(TumbleError::Options(
            "--temperature-range: the recordings show a range of their own, and a curve beyond it is a guess; leave it out, or give --order 0".to_owned(),
        )),
        Some([low, high]) => {
            if let Some([from, to]) = measured.iter().flatten().find(|[from, to]| *from < low || *to > high) {
                return Err(TumbleError::Options(format!(
                    "--temperature-range {low},{high}: the temperature of the static poses is {from} to {to}; give a range that holds it"
                )));
            }
            Ok(([[[low, high]; AXES]; 2], measured))
        }
        None => Ok((measured, measured)),
    }
}
