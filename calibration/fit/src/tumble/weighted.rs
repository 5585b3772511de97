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

use super::covariance::{BIAS, BIAS_SLOPE, GAIN, GAIN_SLOPE, KINDS, NOISE, Shapes, by_gain};
use super::groups::Groups;
use super::inverse::Inverse;
use super::likelihood::{Likelihood, StatedError, Variances};
use super::model::{GravityFit, GravityModel, Offsets};
use super::remainder::Remainder;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{f_tail, median};
use nalgebra::{DMatrix, DVector, Vector3};

/// Rounds of the groups' offsets.
const ROUNDS: usize = 3;
/// Twice the logarithm of the likelihood over that of only the noise from which on the weights are taken: chance has
/// less in 99 of 100 tumbles.
const SHOWN: f64 = 8.0;
/// A weighted fit that leaves so many times the squares of the one with equal weights, beyond the noise, is not taken.
const LEAVES_MORE: f64 = 1.5;

/// A fit with its covariance.
pub(super) struct WeightedFit<'a> {
    pub model: GravityModel<'a>,
    pub unknown: DVector<f64>,
    /// Variances by kind, 0 where the static poses show none, with what is known of them.
    pub variances: Variances,
    /// Variance of a length by only the noise of the means \[g0^2\].
    pub floor: f64,
    /// Derivatives at the last round, with the residual that the unknowns are a step from.
    pub fit: GravityFit,
    /// f with the groups' offsets taken back, linear.
    pub residual: DVector<f64>,
    /// C.
    pub covariance: DMatrix<f64>,
    /// V^-1.
    pub inverse: Inverse,
    pub shapes: Shapes,
    /// V^-1 J C.
    weights: DMatrix<f64>,
}

impl<'a> WeightedFit<'a> {
    /// Fits from `start`, the unweighted fit. No variance of the noise is below `floor` \[g0^2\]. `given` variances are
    /// taken instead of estimated ones. `None` without degrees of freedom, or if the static poses do not determine the
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
            variances = Some(round.variances.values);
            found = Some(round);
        }
        found.map(|found| found.guarded(start, groups.count == 1))
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
        let shapes = Shapes::of(&model, &fit, groups);
        let likelihood = Likelihood::of(Remainder::of(&fit.jacobian, &shapes, &residual), floor);
        let variances = match (given, start) {
            (true, Some(variances)) => likelihood.given(variances)?,
            (_, start) => likelihood.estimated(start)?,
        };
        let inverse = Inverse::of(&shapes, &variances.values)?;
        let weighted = inverse.solve(&fit.jacobian);
        let covariance = (fit.jacobian.transpose() * &weighted).cholesky()?.inverse();
        let weights = weighted * &covariance;
        let unknown = &fit.unknown - weights.transpose() * &residual;
        Some(Self { unknown, model, variances, floor, fit, residual, covariance, inverse, shapes, weights })
    }

    /// The same with the unknowns of the fit with equal weights if the static poses do not show that they share
    /// anything, or if the weighted unknowns leave far more. The errors stay those of the whole covariance. Whether
    /// several groups share something is not judged: a power-up is there in any case.
    fn guarded(mut self, start: &GravityFit, is_one_group: bool) -> Self {
        let noise = self.floor * start.residual.len() as f64;
        let plain = self.model.clone().without_offsets();
        let left = plain.at(self.unknown.clone()).squares();
        let explained = self.left().norm_squared();
        let shown = !is_one_group || self.variances.evidence > SHOWN;
        if !shown || left > LEAVES_MORE * start.squares().max(explained) + noise || !left.is_finite() {
            self.take_equal_weights(start);
        }
        self
    }

    /// Takes the fit with equal weights, with its errors under the same covariance: C is (J'J)^-1 J'V J (J'J)^-1.
    fn take_equal_weights(&mut self, start: &GravityFit) {
        let Some(inverse) = &start.inverse else { return };
        self.weights = &start.jacobian * inverse;
        let shared = self.shapes.scaled(&self.variances.values).tr_mul(&self.weights);
        self.covariance = self.weights.tr_mul(&self.weights) * self.variances.values[NOISE] + shared.tr_mul(&shared);
        self.unknown.clone_from(&start.unknown);
    }

    /// The offsets of the groups' biases and gains.
    fn offsets(&self, groups: &Groups) -> Vec<[Vector3<f64>; 2]> {
        let left = self.inverse.solve_vector(&self.left());
        let gain = by_gain(&self.fit);
        let mut offsets = vec![[Vector3::zeros(); 2]; groups.count];
        for (i, group) in groups.of.iter().enumerate() {
            for (offset, (kind, by)) in offsets[*group].iter_mut().zip([(BIAS, &self.fit.by_force), (GAIN, &gain)]) {
                *offset += by.fixed_view::<1, AXES>(i, 0).transpose() * (left[i] * self.variances.values[kind]);
            }
        }
        offsets
    }

    /// The error of c'p, with the unknowns in p.
    pub(super) fn error(&self, c: &DVector<f64>) -> StatedError {
        let weights = &self.weights * c;
        self.variances.error(self.parts(&weights), self.known(&weights))
    }

    /// The covariance of the unknowns under the careful variances, for what is stated.
    pub(super) fn careful_covariance(&self) -> DMatrix<f64> {
        let shared = self.shapes.scaled(&self.variances.careful).tr_mul(&self.weights);
        self.weights.tr_mul(&self.weights) * self.variances.careful[NOISE] + shared.tr_mul(&shared)
    }

    /// What a variance of 1 of each kind makes in a sum of the residuals.
    fn parts(&self, weights: &DVector<f64>) -> [f64; KINDS] {
        let mut parts = self.shapes.columns.each_ref().map(|columns| columns.tr_mul(weights).norm_squared());
        parts[NOISE] = weights.norm_squared();
        parts
    }

    /// What lags make in it.
    fn known(&self, weights: &DVector<f64>) -> f64 {
        self.shapes.known.tr_mul(weights).norm_squared()
    }

    /// The slope over temperature of an axis' bias \[g0 per unit\] or, of quantity 1 and 2, of its gain, as a random
    /// quantity of its variance; `None` where the covariance has none.
    pub(super) fn slope(&self, axis: usize, quantity: usize) -> Option<(f64, StatedError)> {
        let kind = if quantity == 0 { BIAS_SLOPE } else { GAIN_SLOPE };
        if !self.shapes.has(kind) {
            return None;
        }
        let column = self.shapes.columns[kind].column(axis).into_owned();
        // V^-1 - V^-1 J C J'V^-1 is what the step leaves of V^-1.
        let solved = self.inverse.solve_vector(&column);
        let left = &solved - &self.weights * self.fit.jacobian.tr_mul(&solved);
        let weights = left * self.variances.values[kind];
        let mut parts = self.parts(&weights);
        parts[kind] += 1.0 - 2.0 * weights.dot(&column);
        Some((weights.dot(&self.residual), self.variances.error(parts, self.known(&weights))))
    }

    /// F of combinations of the unknowns, a row each, against 0.
    fn f(&self, combinations: &DMatrix<f64>) -> Option<f64> {
        let values = combinations * &self.unknown;
        let covariance = combinations * &self.covariance * combinations.transpose();
        let f = values.dot(&covariance.cholesky()?.solve(&values)) / combinations.nrows() as f64;
        Some(if f < 0.0 { 0.0 } else { f })
    }

    /// The probability by chance of combinations of the unknowns at least as far from 0 as they are; a row each.
    pub(super) fn p(&self, combinations: &DMatrix<f64>) -> Option<f64> {
        let count = combinations.nrows();
        let freedom = median((0..count).map(|row| self.error(&combinations.row(row).transpose()).freedom));
        Some(f_tail(self.f(combinations)?, count as f64, freedom))
    }

    /// The same with only the ratios of the variances: their size is that of the residuals, at least `least` times what
    /// it is.
    pub(super) fn p_at_own_size(&self, combinations: &DMatrix<f64>, least: f64) -> Option<f64> {
        let freedom = self.residual.len().checked_sub(self.unknown.len()).filter(|freedom| *freedom > 0)? as f64;
        let left = self.left();
        let size = left.dot(&self.inverse.solve_vector(&left)) / freedom;
        Some(f_tail(self.f(combinations)? / size.max(least), combinations.nrows() as f64, freedom))
    }

    /// f after the step \[g0\].
    pub(super) fn left(&self) -> DVector<f64> {
        &self.residual + &self.fit.jacobian * (&self.unknown - &self.fit.unknown)
    }
}
