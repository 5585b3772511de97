//! The likelihood of the variances, in the space that the unknowns leave.

use super::covariance::{BIAS, KINDS, NOISE};
use super::remainder::Remainder;
use isotherm_statistics::{pseudo_inverse, root};
use nalgebra::{DMatrix, DVector};

/// Steps of the variances that are halved, and all.
const CAREFUL_STEPS: usize = 10;
const MOST_STEPS: usize = 80;
/// Relative change of the variances that ends the steps.
const SMALL_CHANGE: f64 = 1e-3;
/// Share of the scale that a variance is no smaller than.
const LEAST_VARIANCE: f64 = 1e-12;
/// Singular values of the information below this share are not inverted.
const SINGULAR: f64 = 1e-12;
/// Degrees of freedom from which on a variance is known.
const MOST_FREEDOM: f64 = 1e6;

/// Error of a linear combination of the unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct StatedError {
    pub variance: f64,
    /// Degrees of freedom of the variance, at least 1.
    pub freedom: f64,
    /// Share of what an element behind its temperature makes.
    pub lag_share: f64,
}

/// Variances by kind with what is known of them.
#[derive(Clone, Debug)]
pub(super) struct Variances {
    pub values: [f64; KINDS],
    /// One standard error more of all but the noise, of one group: few static poses show a variance of 0 by chance.
    pub careful: [f64; KINDS],
    /// Twice the logarithm of their likelihood over that of only the noise; infinite of given ones.
    pub evidence: f64,
    /// Inverse of the information about those that are seen.
    information: DMatrix<f64>,
    seen: Vec<usize>,
}

impl Variances {
    /// The error of what a variance of 1 of each kind makes `parts` of, and lags `known`.
    pub(super) fn error(&self, parts: [f64; KINDS], known: f64) -> StatedError {
        let variance = parts.iter().zip(self.careful).map(|(part, variance)| part * variance).sum::<f64>() + known;
        let seen = DVector::from_iterator(self.seen.len(), self.seen.iter().map(|kind| parts[*kind]));
        let spread = seen.dot(&(&self.information * &seen));
        // Satterthwaite: a variance that scatters by less than this is known, whatever its unit.
        let least = 2.0 * variance * variance / MOST_FREEDOM;
        let freedom = if spread <= least { MOST_FREEDOM } else { 2.0 * variance * variance / spread };
        let lag_share = if known == 0.0 { 0.0 } else { known / variance };
        StatedError { variance, freedom: freedom.clamp(1.0, MOST_FREEDOM), lag_share }
    }
}

/// The likelihood of the variances of some residuals.
pub(super) struct Likelihood {
    reduced: Remainder,
    floor: f64,
}

impl Likelihood {
    /// No variance of the noise is below `floor` \[g0^2\].
    pub(super) const fn of(reduced: Remainder, floor: f64) -> Self {
        Self { reduced, floor }
    }

    /// Q in the coordinates of the shapes; next to them it is 1/s2.
    fn inverse(&self, variances: &[f64; KINDS]) -> Option<DMatrix<f64>> {
        let shared = self.reduced.shapes.scaled(variances);
        let size = self.reduced.right.len();
        let all = &shared * shared.transpose() + DMatrix::identity(size, size) * variances[NOISE];
        Some(all.cholesky()?.inverse())
    }

    /// These variances where the static poses show them.
    pub(super) fn given(&self, variances: &[f64; KINDS]) -> Option<Variances> {
        self.known([0, 1, 2, 3, 4, 5].map(|kind| if self.has(kind) { variances[kind] } else { 0.0 }))
    }

    /// The variances of the greatest likelihood; `None` without degrees of freedom.
    pub(super) fn estimated(&self, start: Option<&[f64; KINDS]>) -> Option<Variances> {
        let m = self.reduced.dimension() as f64;
        if m == 0.0 {
            return None;
        }
        let scale = (self.reduced.squares() / m).max(self.floor);
        let even = |kind| match kind {
            NOISE => scale / 3.0,
            _ if !self.has(kind) => 0.0,
            _ => scale / 3.0 * m / self.reduced.shapes.columns[kind].norm_squared(),
        };
        let mut now = start.copied().unwrap_or_else(|| [0, 1, 2, 3, 4, 5].map(even));
        for step in 0..MOST_STEPS {
            let inverse = self.inverse(&now)?;
            let solved = &inverse * &self.reduced.right;
            let before = now;
            for (kind, variance) in now.iter_mut().enumerate().filter(|(kind, _)| self.has(*kind)) {
                let ratio = self.ratio(kind, before[NOISE], &inverse, &solved);
                let factor = if step < CAREFUL_STEPS { ratio.sqrt() } else { ratio };
                let least = LEAST_VARIANCE * even(kind);
                *variance = (*variance * factor).max(least);
            }
            now[NOISE] = now[NOISE].max(self.floor);
            let small = |kind: usize| {
                (now[kind] - before[kind]).abs()
                    <= SMALL_CHANGE * before[kind] + SMALL_CHANGE * SMALL_CHANGE * even(kind)
            };
            if (0..KINDS).all(small) {
                break;
            }
        }
        let mut known = self.known(now)?;
        known.evidence = self.ratio_to_noise(&now)?;
        Some(known)
    }

    /// Twice the logarithm of the likelihood of these variances over that of only the noise and the lags.
    fn ratio_to_noise(&self, variances: &[f64; KINDS]) -> Option<f64> {
        let mut noise = [0.0; KINDS];
        let m = self.reduced.dimension() as f64;
        noise[NOISE] = (self.reduced.squares() / m).max(self.floor);
        Some(self.logarithm(variances)? - self.logarithm(&noise)?)
    }

    /// Twice the logarithm of the likelihood of these variances.
    fn logarithm(&self, variances: &[f64; KINDS]) -> Option<f64> {
        let shared = self.reduced.shapes.scaled(variances);
        let size = self.reduced.right.len();
        let all = &shared * shared.transpose() + DMatrix::identity(size, size) * variances[NOISE];
        let cholesky = all.cholesky()?;
        let determinant = 2.0 * cholesky.l_dirty().diagonal().iter().map(|value| libm::log(*value)).sum::<f64>();
        let squares = self.reduced.right.dot(&cholesky.solve(&self.reduced.right));
        let (others, noise) = (self.reduced.others as f64, variances[NOISE]);
        Some(-determinant - squares - others * libm::log(noise) - self.reduced.other_squares / noise)
    }

    fn has(&self, kind: usize) -> bool {
        self.reduced.shapes.has(kind)
    }

    /// y'Q S_k Q y / tr(Q S_k).
    fn ratio(&self, kind: usize, noise: f64, inverse: &DMatrix<f64>, solved: &DVector<f64>) -> f64 {
        if kind == NOISE {
            let squares = solved.norm_squared() + self.reduced.other_squares / (noise * noise);
            return squares / (inverse.trace() + self.reduced.others as f64 / noise);
        }
        let columns = &self.reduced.shapes.columns[kind];
        columns.tr_mul(solved).norm_squared() / (inverse * columns).dot(columns)
    }

    /// The variances with the information about those that are seen, tr(Q S_a Q S_b)/2.
    fn known(&self, values: [f64; KINDS]) -> Option<Variances> {
        let inverse = self.inverse(&values)?;
        let seen: Vec<usize> = (0..KINDS).filter(|kind| self.has(*kind)).collect();
        let columns = &self.reduced.shapes.columns;
        let solved: Vec<DMatrix<f64>> =
            seen.iter().map(|k| if *k == NOISE { inverse.clone() } else { &inverse * &columns[*k] }).collect();
        let of = |a: usize, b: usize| match (seen[a], seen[b]) {
            (NOISE, NOISE) => inverse.norm_squared() + self.reduced.others as f64 / values[NOISE].powi(2),
            (NOISE, _) => solved[b].norm_squared(),
            (_, NOISE) => solved[a].norm_squared(),
            (a, _) => columns[a].tr_mul(&solved[b]).norm_squared(),
        };
        let information = inverse_of_scaled(&DMatrix::from_fn(seen.len(), seen.len(), |a, b| of(a, b) / 2.0))?;
        let mut careful = values;
        // Several groups judge each other.
        let one_group = !self.has(BIAS);
        for (index, kind) in seen.iter().enumerate().filter(|(_, kind)| one_group && **kind != NOISE) {
            careful[*kind] += root(information[(index, index)]);
        }
        Some(Variances { values, careful, information, seen, evidence: f64::INFINITY })
    }
}

/// The inverse of the information, scaled so that its diagonal is 1: the kinds' units differ by many powers of ten.
fn inverse_of_scaled(information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = information.diagonal().map(|value| if value > 0.0 { value.sqrt() } else { 1.0 });
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |a, b| matrix[(a, b)] / (size[a] * size[b]))
    };
    Some(scaled(&pseudo_inverse(scaled(information), SINGULAR)?))
}
