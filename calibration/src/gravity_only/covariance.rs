//! What the residuals of the standstills share: the shapes of their covariance.
//!
//! ```text
//! V = s2 I + tb2 [same group](d_i.d_j) + tk2 [same group](h_i.h_j) + w2 W_ij (d_i.d_j) + z z' + v v'
//! d_i = df_i/dx,   h_i = d_i times (x + A), element by element
//! W_ij = min(t_i, t_j)/length of the group, 0 between groups; of one group in all, about its mean
//! z_i = 60 s/sqrt(3) dT/dt df_i/dT,   v_i = (T_i - mean of the group)/sqrt(3) df_i/dT
//! ```
//! tb, tk: scatter of the groups' biases \[g0\] and gains; w: random walk of the bias over a group \[g0\]; z: an
//! element that is up to 60 s behind its telemetry; v: one that does not follow the telemetry within a group.

use super::groups::{Groups, mean};
use super::model::{GravityFit, GravityModel};
use super::reading::Reading;
use isotherm_shared::wire::AXES;
use isotherm_statistics::least_squares;
use nalgebra::{DMatrix, DVector};

/// The element may be behind the telemetry by as much, either way \[s\].
pub(super) const LAG_S: f64 = 60.0;
/// Standard deviation of a value that is anywhere within 1 of its middle.
const UNIFORM: f64 = 0.577_350_269_189_625_8;
/// A shape with a trace under this share of its own is not seen beside the unknowns.
const UNSEEN: f64 = 1e-9;
/// Least standstills of a group that a change of the temperature in time is taken from.
const LEAST_IN_TIME: usize = 4;
/// Row noises that telemetry must move by in a group to be a nuisance.
pub(super) const MOVED: f64 = 6.0;
/// Degrees of freedom from which on the slopes of the scale factors are nuisances, too.
const GAIN_SLOPES: usize = 10;
/// Degrees of freedom over which the slopes of the biases are.
const BIAS_SLOPES: usize = 4;

/// Kinds of variances.
pub(super) const KINDS: usize = 4;
/// Noise of each standstill.
pub(super) const NOISE: usize = 0;
/// Bias of each group.
pub(super) const BIAS: usize = 1;
/// Gain of each group.
pub(super) const GAIN: usize = 2;
/// Random walk of the bias in each group.
pub(super) const WALK: usize = 3;

/// The shapes at one fit.
pub(super) struct Shapes {
    /// Of each kind; `None` with one group, which has no others to differ from.
    pub estimated: [Option<DMatrix<f64>>; KINDS],
    /// z and v.
    pub known: DMatrix<f64>,
}

/// h: the derivatives of each residual by the gains.
pub(super) fn by_gain(fit: &GravityFit) -> DMatrix<f64> {
    fit.by_force.component_mul(&fit.load)
}

impl Shapes {
    pub(super) fn of(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> Self {
        let n = fit.residual.len();
        let same = |i: usize, j: usize| groups.of[i] == groups.of[j];
        let products = &fit.by_force * fit.by_force.transpose();
        let gain = by_gain(fit);
        let gains = &gain * gain.transpose();
        let within = |all: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| if same(i, j) { all[(i, j)] } else { 0.0 });
        let several = groups.count > 1;
        Self {
            estimated: [
                Some(DMatrix::identity(n, n)),
                several.then(|| within(&products)),
                several.then(|| within(&gains)),
                Some(walk(model.readings(), groups).component_mul(&products)),
            ],
            known: known(model, fit, groups),
        }
    }

    /// The covariance of the residuals for these variances.
    pub(super) fn covariance(&self, variances: &[f64; KINDS]) -> DMatrix<f64> {
        sum(&self.estimated, variances) + &self.known * self.known.transpose()
    }

    /// The shapes in the space of the columns of `basis`; without those that are not seen there.
    pub(super) fn within(&self, basis: &DMatrix<f64>) -> Self {
        let seen = |shape: &Option<DMatrix<f64>>| {
            let shape = shape.as_ref()?;
            let inside = basis.transpose() * shape * basis;
            (inside.trace() > UNSEEN * shape.trace()).then_some(inside)
        };
        let estimated = [0, 1, 2, 3].map(|kind| seen(&self.estimated[kind]));
        Self { estimated, known: basis.transpose() * &self.known }
    }
}

fn sum(shapes: &[Option<DMatrix<f64>>; KINDS], variances: &[f64; KINDS]) -> DMatrix<f64> {
    let n = shapes[NOISE].as_ref().map_or(0, DMatrix::nrows);
    let mut all = DMatrix::zeros(n, n);
    for (shape, variance) in shapes.iter().zip(variances) {
        if let Some(shape) = shape {
            all.zip_apply(shape, |sum, part| *sum += variance * part);
        }
    }
    all
}

/// Time of each reading after the first of its group \[s\].
fn times(readings: &[Reading], groups: &Groups) -> Vec<f64> {
    let starts: Vec<f64> = (0..groups.count).map(|group| readings[groups.members(group)[0]].start_s).collect();
    readings.iter().zip(&groups.of).map(|(reading, group)| reading.start_s - starts[*group]).collect()
}

/// W.
fn walk(readings: &[Reading], groups: &Groups) -> DMatrix<f64> {
    let (n, times) = (readings.len(), times(readings, groups));
    let mut walk = DMatrix::zeros(n, n);
    for group in 0..groups.count {
        let members = groups.members(group);
        let length = members.iter().map(|i| times[*i]).fold(1e-9, f64::max);
        for i in &members {
            for j in &members {
                walk[(*i, *j)] = times[*i].min(times[*j]) / length;
            }
        }
    }
    if groups.count == 1 {
        let of_row = DVector::from_fn(n, |i, _| walk.row(i).mean());
        let all = of_row.mean();
        walk = DMatrix::from_fn(n, n, |i, j| walk[(i, j)] - of_row[i] - of_row[j] + all);
    }
    walk
}

/// z and v.
fn known(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> DMatrix<f64> {
    let readings = model.readings();
    let by_telemetry = model.by_telemetry(fit);
    let telemetry: Vec<f64> = readings.iter().map(Reading::telemetry).collect();
    let (off, rates) = (groups.centred(&telemetry), telemetry_rates(&telemetry, readings, groups));
    DMatrix::from_fn(readings.len(), 2, |i, column| {
        let size = if column == 0 { LAG_S * rates[i] } else { off[i] };
        UNIFORM * size * by_telemetry[i]
    })
}

/// Change of the telemetry in time at each reading \[1/s\]: of a parabola through its group; 0 in small groups.
fn telemetry_rates(telemetry: &[f64], readings: &[Reading], groups: &Groups) -> Vec<f64> {
    let times = groups.centred(&times(readings, groups));
    let mut rates = vec![0.0; readings.len()];
    for group in 0..groups.count {
        let members = groups.members(group);
        let length = members.iter().map(|i| times[*i].abs()).fold(0.0, f64::max);
        if members.len() < LEAST_IN_TIME || length == 0.0 {
            continue;
        }
        let middle = mean(&members.iter().map(|i| telemetry[*i]).collect::<Vec<_>>());
        let design = DMatrix::from_fn(members.len(), 3, |row, power| (times[members[row]] / length).powi(power as i32));
        let right = DVector::from_fn(members.len(), |row, _| middle - telemetry[members[row]]);
        let Some(parabola) = least_squares(&design, &right) else { continue };
        for i in members {
            rates[i] = (parabola.change[1] + 2.0 * parabola.change[2] * times[i] / length) / length;
        }
    }
    rates
}

/// Columns that are estimated beside the unknowns and dropped: without them the order of the attitudes in telemetry
/// that moves is taken for an effect. At order 0 alone; of the biases, then of the gains, three each.
pub(super) fn slopes(model: &GravityModel<'_>, fit: &GravityFit, groups: &Groups) -> DMatrix<f64> {
    let n = fit.residual.len();
    let telemetry: Vec<f64> = model.readings().iter().map(Reading::telemetry).collect();
    let freedom = n.saturating_sub(model.unknowns.count());
    let still = groups.moved(&telemetry) <= MOVED * groups.row_noise;
    if model.unknowns.order > 0 || still || freedom <= BIAS_SLOPES {
        return DMatrix::zeros(n, 0);
    }
    let off = groups.centred(&telemetry);
    let gain = by_gain(fit);
    let columns = if freedom >= GAIN_SLOPES { 2 * AXES } else { AXES };
    DMatrix::from_fn(n, columns, |i, k| {
        let by = if k < AXES { fit.by_force[(i, k)] } else { gain[(i, k - AXES)] };
        -by * off[i]
    })
}
