//! The fit with the weights of its own covariance, whose variances are estimated by restricted maximum likelihood.
//!
//! ```text
//! y = N'f, S_k = N'V_k N,   N: basis of the null space of J'
//! Q = (sum th_k S_k + N'(zz' + vv')N)^-1,   th_k *= (y'Q S_k Q y / tr(Q S_k))^(1/2), after 10 steps ^1
//! C = (J'V^-1 J)^-1,   step = -C J'V^-1 f
//! ```
//! The offsets of groups may be too large for a linear equation, so that they are estimated in three rounds, each about
//! those of the round before:
//! ```text
//! b_g = tb2 sum d_i e_i,   k_g = tk2 sum h_i e_i,   e = V^-1 (f + J step)
//! ```
//! Source: H. D. Patterson, R. Thompson, Recovery of inter-block information when block sizes are unequal, 1971; the
//! degrees of freedom of an interval after F. E. Satterthwaite, 1946.

use super::covariance::{BIAS, GAIN, KINDS, NOISE, Shapes, by_gain, slopes};
use super::groups::Groups;
use super::model::{GravityFit, GravityModel, Offsets};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{f_tail, median};
use nalgebra::{DMatrix, DVector};

/// Rounds of the groups' offsets.
const ROUNDS: usize = 3;
/// Steps of the variances that are halved, and all.
const CAREFUL_STEPS: usize = 10;
const MOST_STEPS: usize = 80;
/// Relative change of the variances that ends the steps.
const SMALL_CHANGE: f64 = 1e-3;
/// Share of the scale that a variance is no smaller than.
const LEAST_VARIANCE: f64 = 1e-12;
/// Singular values of the information below this share are not inverted.
const SINGULAR: f64 = 1e-12;

/// A fit with its covariance.
pub(super) struct Weighted<'a> {
    pub model: GravityModel<'a>,
    pub unknown: DVector<f64>,
    /// Variances by kind; 0 where the standstills show none.
    pub variances: [f64; KINDS],
    /// Variance of a length by the noise of the means alone \[g0^2\].
    pub floor: f64,
    /// Derivatives at the last round, with the residual that the unknowns are a step from.
    pub fit: GravityFit,
    /// f with the groups' offsets taken back, linear.
    pub residual: DVector<f64>,
    /// J with the columns of [`slopes`].
    pub jacobian: DMatrix<f64>,
    /// The slopes that are dropped.
    pub slopes: DVector<f64>,
    /// C.
    pub covariance: DMatrix<f64>,
    /// Covariance of the residuals, and its inverse.
    pub inverse: DMatrix<f64>,
    pub shapes: Shapes,
    /// V^-1 J C.
    weights: DMatrix<f64>,
    /// Inverse of the information about the variances that are estimated.
    information: DMatrix<f64>,
    seen: Vec<usize>,
}

/// Error of a linear combination of the unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct StatedError {
    pub variance: f64,
    /// Degrees of freedom of the variance, at least 1.
    pub freedom: f64,
    /// Share of what an element behind its telemetry makes.
    pub lag_share: f64,
}

impl<'a> Weighted<'a> {
    /// Fits from `start`, the unweighted fit. No variance of the noise is below `floor` \[g0^2\]. `given` variances are
    /// taken instead of estimated ones. `None` without degrees of freedom, or if the standstills do not determine the
    /// unknowns.
    pub(super) fn of(
        model: &GravityModel<'a>,
        start: &GravityFit,
        groups: &Groups,
        floor: f64,
        given: Option<&[f64; KINDS]>,
    ) -> Option<Self> {
        let (mut offsets, mut unknown) = (vec![[Offsets::default().bias; 2]; groups.count], start.unknown.clone());
        let mut variances = given.copied();
        let mut found = None;
        for _ in 0..if groups.count > 1 { ROUNDS } else { 1 } {
            let of = |group: &usize| Offsets { bias: offsets[*group][0], gain: offsets[*group][1] };
            let model = model.clone().with_offsets(groups.of.iter().map(of).collect());
            let round = Self::round(model, unknown.clone(), groups, floor, variances.as_ref(), given.is_some())?;
            unknown.clone_from(&round.unknown);
            offsets = round.offsets(groups);
            variances = Some(round.variances);
            found = Some(round);
        }
        found
    }

    fn round(
        model: GravityModel<'a>,
        unknown: DVector<f64>,
        groups: &Groups,
        floor: f64,
        start: Option<&[f64; KINDS]>,
        given: bool,
    ) -> Option<Self> {
        let fit = model.at(unknown);
        let residual = DVector::from_fn(fit.residual.len(), |i, _| fit.residual[i] + model.shared(&fit, i));
        let beside = slopes(&model, &fit, groups);
        let mut jacobian = fit.jacobian.clone().resize_horizontally(fit.jacobian.ncols() + beside.ncols(), 0.0);
        jacobian.columns_mut(fit.jacobian.ncols(), beside.ncols()).copy_from(&beside);
        let shapes = Shapes::of(&model, &fit, groups);
        let basis = null_space(&jacobian);
        let inside = shapes.within(&basis);
        let seen: Vec<usize> = (0..KINDS).filter(|kind| inside.estimated[*kind].is_some()).collect();
        let likelihood = Likelihood { shapes: inside, right: basis.transpose() * &residual, floor };
        let variances = match (given, start) {
            (true, Some(variances)) => [0, 1, 2, 3].map(|k| if seen.contains(&k) { variances[k] } else { 0.0 }),
            (_, start) => likelihood.variances(start)?,
        };
        let information = likelihood.information(&variances, &seen)?;
        let inverse = shapes.covariance(&variances).cholesky()?.inverse();
        let weighted = &inverse * &jacobian;
        let covariance = (jacobian.transpose() * &weighted).cholesky()?.inverse();
        let weights = weighted * &covariance;
        let step = -(weights.transpose() * &residual);
        let count = fit.unknown.len();
        Some(Self {
            unknown: &fit.unknown + step.rows(0, count),
            slopes: step.rows(count, beside.ncols()).into_owned(),
            model,
            variances,
            floor,
            residual,
            jacobian,
            covariance,
            inverse,
            weights,
            information: information.pseudo_inverse(SINGULAR).ok()?,
            seen,
            shapes,
            fit,
        })
    }

    /// The offsets of the groups' biases and gains.
    fn offsets(&self, groups: &Groups) -> Vec<[nalgebra::Vector3<f64>; 2]> {
        let left = &self.inverse * self.left();
        let gain = by_gain(&self.fit);
        let of = |group: usize| {
            [(BIAS, &self.fit.by_force), (GAIN, &gain)].map(|(kind, by)| {
                let sum = groups.members(group).into_iter().fold(nalgebra::Vector3::zeros(), |sum, i| {
                    sum + by.row(i).transpose().fixed_rows::<AXES>(0) * left[i]
                });
                sum * self.variances[kind]
            })
        };
        (0..groups.count).map(of).collect()
    }

    /// The error of c'p, with the unknowns and then the slopes that are dropped in p.
    pub(super) fn error(&self, c: &DVector<f64>) -> StatedError {
        let c = c.clone().resize_vertically(self.jacobian.ncols(), 0.0);
        let weights = &self.weights * &c;
        let variance = c.dot(&(&self.covariance * &c));
        let part =
            |kind: &usize| self.shapes.estimated[*kind].as_ref().map_or(0.0, |shape| weights.dot(&(shape * &weights)));
        let parts = DVector::from_iterator(self.seen.len(), self.seen.iter().map(part));
        let spread = parts.dot(&(&self.information * &parts)).max(1e-300);
        let lag = (self.shapes.known.transpose() * &weights).norm_squared();
        StatedError { variance, freedom: (2.0 * variance * variance / spread).max(1.0), lag_share: lag / variance }
    }

    /// F of combinations of the unknowns, a row each, against 0.
    fn f(&self, combinations: &DMatrix<f64>) -> Option<f64> {
        let values = combinations * &self.unknown;
        let combinations = combinations.clone().resize_horizontally(self.jacobian.ncols(), 0.0);
        let covariance = &combinations * &self.covariance * combinations.transpose();
        let f = values.dot(&covariance.cholesky()?.solve(&values)) / combinations.nrows() as f64;
        Some(f.max(0.0))
    }

    /// The probability by chance of combinations of the unknowns at least as far from 0 as they are; a row each.
    pub(super) fn p(&self, combinations: &DMatrix<f64>) -> Option<f64> {
        let count = combinations.nrows();
        let freedom = median((0..count).map(|row| self.error(&combinations.row(row).transpose()).freedom));
        Some(f_tail(self.f(combinations)?, count as f64, freedom))
    }

    /// The same with the ratios of the variances alone: their size is that of the residuals, at least `least` times
    /// what it is.
    pub(super) fn p_at_own_size(&self, combinations: &DMatrix<f64>, least: f64) -> Option<f64> {
        let freedom = self.residual.len().checked_sub(self.jacobian.ncols()).filter(|freedom| *freedom > 0)? as f64;
        let left = self.left();
        let size = left.dot(&(&self.inverse * &left)) / freedom;
        Some(f_tail(self.f(combinations)? / size.max(least), combinations.nrows() as f64, freedom))
    }

    /// f after the step \[g0\].
    fn left(&self) -> DVector<f64> {
        let mut step = &self.unknown - &self.fit.unknown;
        step = step.resize_vertically(self.jacobian.ncols(), 0.0);
        step.rows_mut(self.unknown.len(), self.slopes.len()).copy_from(&self.slopes);
        &self.residual + &self.jacobian * step
    }
}

/// The likelihood of the variances, in the space that the unknowns leave.
struct Likelihood {
    shapes: Shapes,
    right: DVector<f64>,
    floor: f64,
}

impl Likelihood {
    fn shape(&self, kind: usize) -> Option<&DMatrix<f64>> {
        self.shapes.estimated[kind].as_ref()
    }

    /// Q.
    fn inverse(&self, variances: &[f64; KINDS]) -> Option<DMatrix<f64>> {
        Some(self.shapes.covariance(variances).cholesky()?.inverse())
    }

    fn variances(&self, start: Option<&[f64; KINDS]>) -> Option<[f64; KINDS]> {
        let m = self.right.len() as f64;
        if self.right.is_empty() {
            return None;
        }
        let scale = (self.right.norm_squared() / m).max(self.floor);
        let even = |kind| self.shape(kind).map_or(0.0, |shape| scale / 3.0 * m / shape.trace());
        let mut now = start.copied().unwrap_or_else(|| [0, 1, 2, 3].map(even));
        for step in 0..MOST_STEPS {
            let inverse = self.inverse(&now)?;
            let solved = &inverse * &self.right;
            let before = now;
            for (kind, variance) in now.iter_mut().enumerate() {
                let Some(shape) = self.shape(kind) else { continue };
                let ratio = solved.dot(&(shape * &solved)) / inverse.dot(shape);
                let factor = if step < CAREFUL_STEPS { ratio.sqrt() } else { ratio };
                *variance = (*variance * factor).max(LEAST_VARIANCE * scale);
            }
            now[NOISE] = now[NOISE].max(self.floor);
            let small = |(now, before): (&f64, &f64)| {
                (now - before).abs() <= SMALL_CHANGE * before + SMALL_CHANGE * SMALL_CHANGE * scale
            };
            if now.iter().zip(&before).all(small) {
                break;
            }
        }
        Some(now)
    }

    /// tr(Q S_a Q S_b)/2 of the kinds that are seen.
    fn information(&self, variances: &[f64; KINDS], seen: &[usize]) -> Option<DMatrix<f64>> {
        let inverse = self.inverse(variances)?;
        let products: Vec<_> = seen.iter().filter_map(|kind| Some(&inverse * self.shape(*kind)?)).collect();
        Some(DMatrix::from_fn(seen.len(), seen.len(), |a, b| products[a].dot(&products[b].transpose()) / 2.0))
    }
}

/// An orthonormal basis of what the columns of `matrix` leave; columns that depend on others leave as much.
pub(super) fn null_space(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    const DEPENDENT: f64 = 1e-9;
    let n = matrix.nrows();
    let mut scaled = matrix.clone();
    for mut column in scaled.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    if scaled.ncols() == 0 {
        return DMatrix::identity(n, n);
    }
    let qr = scaled.col_piv_qr();
    let triangle = qr.r();
    let sizes: Vec<f64> = (0..triangle.nrows()).map(|k| triangle[(k, k)].abs()).collect();
    let largest = sizes.iter().copied().fold(0.0, f64::max);
    let rank = sizes.iter().filter(|size| **size > DEPENDENT * largest).count();
    let mut transposed = DMatrix::identity(n, n);
    qr.q_tr_mul(&mut transposed);
    transposed.rows(rank, n - rank).transpose()
}
