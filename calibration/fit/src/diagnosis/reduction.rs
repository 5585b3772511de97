//! One set point, reduced under a hypothesis.

use crate::checks::SetPoint;
use isotherm_campaign::{Campaign, Dwell, PARAMETERS};
use isotherm_shared::wire::AXES;
use nalgebra::{DMatrix, DVector};

/// With more dwells, nothing is tried: the rows are no campaign then.
pub(super) const MAX_DWELLS: usize = 20_000;
/// Residuals below this need no diagnosis \[g0\].
pub(super) const GOOD: f64 = 20e-6;
/// Residual of scale factors with a wrong sign \[g0\].
pub(super) const WRONG_SIGN: f64 = 1.0;
/// Least degrees of freedom of a set point without one of its positions.
const MIN_FREEDOM: usize = 3;
/// Added to the normal equations' scaled diagonal, so that what a set point does not determine stays 0.
const RIDGE: f64 = 1e-11;
/// Weight of the observation that the base is level: a tilt of 1e-3 rad costs as much as a residual of 10e-6 g0. Where
/// positions do not separate the tilt from the other unknowns it stays small.
const LEVEL_WEIGHT: f64 = 1e-2;
/// Unknowns of a set point: those of three accelerometers, and the tilt.
pub(super) const UNKNOWNS: usize = AXES * PARAMETERS + 2;

/// Specific force of a position \[g0\], and its derivatives by the tilt.
pub(super) type Direction = ([f64; AXES], [[f64; 2]; AXES]);

/// Where the pulses of both channels of each accelerometer are: accelerometer and channel of the columns.
pub(super) type Columns = [[[usize; 2]; 2]; AXES];

/// Both channels of accelerometer a in the columns of accelerometer `order[a]`.
pub(super) fn in_order(order: [usize; AXES]) -> Columns {
    order.map(|axis| [[axis, 0], [axis, 1]])
}

/// Two columns exchanged.
pub(super) fn with_exchanged(a: [usize; 2], b: [usize; 2]) -> Columns {
    in_order([0, 1, 2]).map(|axis| {
        axis.map(|column| match column {
            _ if column == a => b,
            _ if column == b => a,
            _ => column,
        })
    })
}

/// Trials of hypotheses on the dwells of a campaign.
pub(super) struct Trials<'a> {
    pub campaign: &'a Campaign,
    pub dwells: &'a [Dwell],
    pub set_points: &'a [SetPoint],
    pub directions: Vec<Direction>,
    /// Residuals of each set point as the campaign file states it \[g0\], [`WRONG_SIGN`] if a scale factor has a wrong
    /// sign; NaN if it cannot be reduced.
    pub stated: Vec<f64>,
}

/// One set point, reduced under a hypothesis.
pub(super) struct Reduction {
    /// Residual standard deviation \[g0\].
    pub sd: f64,
    /// Signs of the scale factors by accelerometer: 1 right, -1 both wrong, 0 neither.
    pub sign: [i8; AXES],
    pub unknowns: DVector<f64>,
    /// The rates that a unit of the unknowns stands for.
    pub nominal: [[f64; 2]; AXES],
}

impl<'a> Trials<'a> {
    pub(super) fn new(campaign: &'a Campaign, dwells: &'a [Dwell], set_points: &'a [SetPoint]) -> Self {
        let directions = campaign.positions.iter().map(|position| campaign.force(position, Some([0.0; 2]))).collect();
        let mut trials = Self { campaign, dwells, set_points, directions, stated: Vec::new() };
        let stated = |set_point: &SetPoint| {
            let reduction = trials.try_positions(set_point, &[], |position| position);
            reduction.map_or(f64::NAN, |r| if r.sign == [1; AXES] { r.sd } else { WRONG_SIGN })
        };
        trials.stated = set_points.iter().map(stated).collect();
        trials
    }

    pub(super) fn try_positions(
        &self,
        set_point: &SetPoint,
        off: &[usize],
        position: impl Fn(usize) -> usize,
    ) -> Option<Reduction> {
        self.reduce(set_point, off, &|dwell| self.directions[position(dwell.position)], in_order([0, 1, 2]), &|_| 1.0)
    }

    /// Reduces a set point without the positions in `off`. `direction` gives the specific force of a dwell, `columns`
    /// those of each channel, `time` the factor of a dwell's counted time.
    pub(super) fn reduce(
        &self,
        set_point: &SetPoint,
        off: &[usize],
        direction: &dyn Fn(&Dwell) -> Direction,
        columns: Columns,
        time: &dyn Fn(&Dwell) -> f64,
    ) -> Option<Reduction> {
        let dwells: Vec<&Dwell> = set_point
            .dwells
            .iter()
            .map(|&dwell| &self.dwells[dwell])
            .filter(|dwell| !off.contains(&dwell.position))
            .collect();
        let rates = |dwell: &Dwell, axis: usize| {
            columns[axis].map(|[axis, channel]| dwell.sums.rates(axis)[channel] / time(dwell))
        };
        let largest = |axis: usize, channel: usize| dwells.iter().map(|d| rates(d, axis)[channel]).fold(0.0, f64::max);
        let nominal = [0, 1, 2].map(|axis| [largest(axis, 0), largest(axis, 1)]);
        if nominal.iter().flatten().any(|rate| !(*rate > 0.0 && rate.is_finite())) {
            return None;
        }
        let unknowns = if self.campaign.mount.is_some() { UNKNOWNS } else { UNKNOWNS - 2 };
        let freedom = (AXES * dwells.len()).checked_sub(unknowns)?;
        if freedom == 0 || (!off.is_empty() && freedom < MIN_FREEDOM) {
            return None;
        }
        let shares = |dwell: &Dwell, axis: usize| {
            let [positive, negative] = rates(dwell, axis);
            [positive / nominal[axis][0], negative / nominal[axis][1]]
        };
        let directions: Vec<_> = dwells.iter().map(|dwell| direction(dwell)).collect();
        let (matrix, right) = equations(&directions, unknowns, |d, axis| shares(dwells[d], axis));
        let solution = solve(&matrix, &right)?;
        let residual = right - &matrix * &solution;
        let sd = (residual.norm_squared() / freedom as f64).sqrt();
        Some(Reduction { sd, sign: signs(&solution), unknowns: solution, nominal })
    }
}

/// 1 for each axis whose scale factors have the right signs, -1 where both are opposite, otherwise 0.
fn signs(solution: &DVector<f64>) -> [i8; AXES] {
    [0, 1, 2].map(|axis| match (solution[PARAMETERS * axis + 1], solution[PARAMETERS * axis + 2]) {
        (plus, minus) if plus > 0.0 && minus < 0.0 => 1,
        (plus, minus) if plus < 0.0 && minus > 0.0 => -1,
        _ => 0,
    })
}

/// The equations of dwells with these `directions`: the unknowns of each axis, then the base's tilt. `shares` gives the
/// rates of a dwell's channels, by axis, over the largest ones.
fn equations(
    directions: &[Direction],
    unknowns: usize,
    shares: impl Fn(usize, usize) -> [f64; 2],
) -> (DMatrix<f64>, DVector<f64>) {
    let mut matrix = DMatrix::zeros(AXES * directions.len(), unknowns);
    let mut right = DVector::zeros(AXES * directions.len());
    for (d, (force, by_tilt)) in directions.iter().enumerate() {
        for axis in 0..AXES {
            let (row, first) = (AXES * d + axis, PARAMETERS * axis);
            let [positive, negative] = shares(d, axis);
            let (next, after) = (force[(axis + 1) % AXES], force[(axis + 2) % AXES]);
            for (k, value) in [-1.0, positive, negative, -next, -after].into_iter().enumerate() {
                matrix[(row, first + k)] = value;
            }
            for k in AXES * PARAMETERS..unknowns {
                matrix[(row, k)] = -by_tilt[axis][k - AXES * PARAMETERS];
            }
            right[row] = force[axis];
        }
    }
    (matrix, right)
}

/// The solution by scaled normal equations, in which the base is nearly level.
fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let unknowns = matrix.ncols();
    let mut normal = matrix.tr_mul(matrix);
    let mut projection = matrix.tr_mul(right);
    for k in AXES * PARAMETERS..unknowns {
        normal[(k, k)] += LEVEL_WEIGHT * LEVEL_WEIGHT;
    }
    let scale = DVector::from_fn(unknowns, |k, _| match normal[(k, k)].sqrt() {
        size if size > 0.0 => size,
        _ => 1.0,
    });
    for i in 0..unknowns {
        for k in 0..unknowns {
            normal[(i, k)] /= scale[i] * scale[k];
        }
        normal[(i, i)] = normal[(i, i)].max(RIDGE) + RIDGE;
        projection[i] /= scale[i];
    }
    Some(normal.cholesky()?.solve(&projection).component_div(&scale))
}
