//! What the residuals of the static poses share: the shapes of their covariance, each by the columns that make it.
//!
//! ```text
//! V = s2 I + sum th_k B_k B_k' + z z' + v v'
//! B of bias and gain:     d_i and h_i of each group, several groups alone
//! B of the walk:          d_i of what is after each of at most 25 steps, of one group in all about its mean
//! B of the slopes:        d_i and h_i times (T_i - mean of the group), at order 0 alone, where temperature moves
//! d_i = df_i/dx,   h_i = d_i times (x + A), element by element
//! z_i = 60 s/sqrt(3) dT/dt df_i/dT,   v_i = (T_i - mean of the group)/sqrt(3) df_i/dT
//! ```
//! th: scatter of the groups' biases \[g0\] and gains, random walk of the bias over a group \[g0\], slopes of biases
//! and gains over temperature; z: an element that is up to 60 s behind its temperature; v: one that does not follow the
//! temperature within a group.
//!
//! A slope is a random quantity of unknown scatter, not an unknown: what the attitudes do not determine of it stays 0.

use super::groups::Groups;
use super::model::{GravityFit, GravityModel};
use super::reading::Reading;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{least_squares, mean};
use nalgebra::{DMatrix, DVector};

/// The element may be behind the temperature by as much, either way \[s\].
pub(super) const LAG_S: f64 = 60.0;
/// Standard deviation of a value that is anywhere within 1 of its middle.
const UNIFORM: f64 = 0.577_350_269_189_625_8;
/// A shape with a trace under this share of its own is not seen next to the unknowns.
const UNSEEN: f64 = 1e-9;
/// Least static poses of a group that a change of the temperature in time is taken from.
const LEAST_IN_TIME: usize = 4;
/// Row noises that temperature must move by in a group to be a nuisance.
pub(super) const MOVED: f64 = 6.0;
/// Row noises that the means must move by for a slope: those of static poses that do not move differ by a third of one.
const SLOPE_MOVED: f64 = 1.0;
/// Most steps of a walk: more static poses share a step.
const WALK_STEPS: usize = 25;

/// Kinds of variances.
pub(super) const KINDS: usize = 6;
/// Noise of each static pose.
pub(super) const NOISE: usize = 0;
/// Bias of each group.
pub(super) const BIAS: usize = 1;
/// Gain of each group.
pub(super) const GAIN: usize = 2;
/// Random walk of the bias in each group.
pub(super) const WALK: usize = 3;
/// Slope of each bias over temperature.
pub(super) const BIAS_SLOPE: usize = 4;
/// Slope of each gain over temperature.
pub(super) const GAIN_SLOPE: usize = 5;

/// The shapes at one fit.
pub(super) struct Shapes {
    /// B of each kind; without columns where it is not there. That of the noise is the unit matrix, and has none.
    pub columns: [DMatrix<f64>; KINDS],
    /// z and v.
    pub known: DMatrix<f64>,
}

/// h: the derivatives of each residual by the gains.
pub(super) fn by_gain(fit: &GravityFit) -> DMatrix<f64> {
    fit.by_force.component_mul(&fit.load)
}

impl Shapes {
    pub(super) fn of(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> Self {
        let none = || DMatrix::zeros(fit.residual.len(), 0);
        let (force, gain) = (&fit.by_force, by_gain(fit));
        let each = |by: &DMatrix<f64>| if groups.count > 1 { within_groups(by, groups) } else { none() };
        let slope = slopes(model, groups);
        let along = |by: &DMatrix<f64>| slope.as_ref().map_or_else(none, |off| along(by, off));
        Self {
            columns: [
                none(),
                each(force),
                each(&gain),
                walk(model.readings(), groups, force),
                along(force),
                along(&gain),
            ],
            known: known(model, fit, groups),
        }
    }

    /// The same in the space of `projected`; without those that are not seen there.
    pub(super) fn seen(&self, projected: Self) -> Self {
        let mut projected = projected;
        for (columns, all) in projected.columns.iter_mut().zip(&self.columns) {
            if columns.norm_squared() <= UNSEEN * all.norm_squared() {
                *columns = DMatrix::zeros(columns.nrows(), 0);
            }
        }
        projected
    }

    /// Whether a kind is there: the noise always is.
    pub(super) fn has(&self, kind: usize) -> bool {
        kind == NOISE || self.columns[kind].ncols() > 0
    }

    /// U: `V = s2 I + U U'` for these variances.
    pub(super) fn scaled(&self, variances: &[f64; KINDS]) -> DMatrix<f64> {
        let scaled = self.columns.iter().zip(variances).map(|(columns, variance)| columns * variance.sqrt());
        beside(self.known.nrows(), &scaled.chain([self.known.clone()]).collect::<Vec<_>>())
    }
}

/// Matrices of `rows` rows, side by side.
pub(super) fn beside(rows: usize, parts: &[DMatrix<f64>]) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(rows, parts.iter().map(DMatrix::ncols).sum());
    let mut at = 0;
    for part in parts {
        all.columns_mut(at, part.ncols()).copy_from(part);
        at += part.ncols();
    }
    all
}

/// The columns of `by` for each group: 0 outside of it.
pub(super) fn within_groups(by: &DMatrix<f64>, groups: &Groups) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(by.nrows(), AXES * groups.count);
    for (i, group) in groups.of.iter().enumerate() {
        all.view_mut((i, AXES * group), (1, AXES)).copy_from(&by.row(i));
    }
    all
}

/// What a slope over temperature makes of each reading.
fn along(by: &DMatrix<f64>, off: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(by.nrows(), AXES, |i, axis| -by[(i, axis)] * off[i])
}

/// Time of each reading after the first of its group \[s\].
fn times(readings: &[Reading], groups: &Groups) -> Vec<f64> {
    let starts: Vec<f64> = groups.all().iter().map(|members| readings[members[0]].start_s).collect();
    readings.iter().zip(&groups.of).map(|(reading, group)| reading.start_s - starts[*group]).collect()
}

/// A step of the bias of each axis after some of the readings of a group, scaled so that all steps make a walk of 1
/// over the group.
fn walk(readings: &[Reading], groups: &Groups, by_force: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, times) = (readings.len(), times(readings, groups));
    let share = (WALK_STEPS / groups.count.max(1)).max(1);
    let mut steps = Vec::new();
    for members in groups.all() {
        let parts = share.min(members.len().saturating_sub(1));
        let length = members.iter().map(|i| times[*i]).fold(0.0, f64::max);
        let first = |part: usize| part * (members.len() - 1) / parts;
        for part in 0..parts {
            let [before, from] = [first(part), first(part + 1)].map(|at| times[members[at]]);
            let size = if length > 0.0 { ((from - before).max(0.0) / length).sqrt() } else { 0.0 };
            let mut step = DVector::zeros(n);
            members[first(part) + 1..].iter().for_each(|i| step[*i] = size);
            steps.push(step);
        }
    }
    if groups.count == 1 {
        steps.iter_mut().for_each(|step| *step = step.add_scalar(-step.mean()));
    }
    DMatrix::from_fn(n, AXES * steps.len(), |i, column| by_force[(i, column % AXES)] * steps[column / AXES][i])
}

/// z and v.
fn known(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> DMatrix<f64> {
    let readings = model.readings();
    let by_temperature = model.by_temperature(fit);
    let temperature: Vec<f64> = readings.iter().map(Reading::temperature).collect();
    let (off, rates) = (groups.centred(&temperature), temperature_rates(&temperature, readings, groups));
    DMatrix::from_fn(readings.len(), 2, |i, column| {
        let size = if column == 0 { LAG_S * rates[i] } else { off[i] };
        UNIFORM * size * by_temperature[i]
    })
}

/// Change of the temperature in time at each reading \[1/s\]: of a parabola through its group; 0 in small groups.
fn temperature_rates(temperature: &[f64], readings: &[Reading], groups: &Groups) -> Vec<f64> {
    let times = groups.centred(&times(readings, groups));
    let mut rates = vec![0.0; readings.len()];
    for members in groups.all() {
        let length = members.iter().map(|i| times[*i].abs()).fold(0.0, f64::max);
        if members.len() < LEAST_IN_TIME || length == 0.0 {
            continue;
        }
        let middle = mean(&members.iter().map(|i| temperature[*i]).collect::<Vec<_>>());
        let design = DMatrix::from_fn(members.len(), 3, |row, power| (times[members[row]] / length).powi(power as i32));
        let right = DVector::from_fn(members.len(), |row, _| middle - temperature[members[row]]);
        let Some(parabola) = least_squares(&design, &right) else { continue };
        for i in members {
            rates[i] = (parabola.change[1] + 2.0 * parabola.change[2] * times[i] / length) / length;
        }
    }
    rates
}

/// How far each reading's temperature is off the mean of its group; `None` where it does not move, and above order 0,
/// whose curves have slopes.
pub(super) fn slopes(model: &GravityModel<'_>, groups: &Groups) -> Option<Vec<f64>> {
    let temperature: Vec<f64> = model.readings().iter().map(Reading::temperature).collect();
    let moves = model.unknowns.order == 0 && groups.moved(&temperature) > SLOPE_MOVED * groups.row_noise;
    moves.then(|| groups.centred(&temperature))
}

/// The columns of [`slopes`], of the biases, then of the gains.
pub(super) fn slope_columns(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> DMatrix<f64> {
    let n = fit.residual.len();
    let Some(off) = slopes(model, groups) else { return DMatrix::zeros(n, 0) };
    beside(n, &[along(&fit.by_force, &off), along(&by_gain(fit), &off)])
}
