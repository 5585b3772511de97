//! From the dwells of one set point to its bias, scale factors and misalignments.
//!
//! The pulse rates of a dwell give the indicated acceleration, and its position gives the specific force (s in g0, own
//! axis first; m: misalignments onto the two other axes \[rad\]):
//!
//! ```text
//! rate+/K+ + rate-/K- = s + m_p s_p + m_o s_o + A
//! ```
//! This is linear in 1/K+, 1/K-, A, m_p and m_o, so one least-squares solution in g0 serves any list of positions. For
//! six faces at two headings it equals the closed form: A from the horizontal readings, then K+ and K- from the up and
//! down readings. The mean of an up and a down reading is *not* the bias if K+ differs from -K-.
//!
//! The temperature changes a little between the positions. Each result therefore has its own **effective temperature**:
//! the mean over the dwells with the weights that they have in this result, not the plain mean.

use crate::sensor::ReducedSensor;
use isotherm_campaign::{Campaign, Dwell, PARAMETERS};
use isotherm_shared::wire::AXES;
use nalgebra::{DMatrix, DVector};

/// The parameters of one accelerometer at one set point: A \[g0\], K+ and K- \[pulse/(s*g0)\], m onto the next axis and
/// m onto the one after \[rad\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorReduction {
    /// A, K+, K-, m, m.
    pub values: [f64; PARAMETERS],
    /// Standard errors of the values, from the scatter within the set point; NaN if there are only as many dwells as
    /// parameters.
    pub standard_errors: [f64; PARAMETERS],
    /// Effective temperature: of the head for A, of the board for K+ and K-.
    pub temperature: [f64; 3],
    /// Residual standard deviation \[g0\]; includes the effect of the base's tilt, if the tilt is not given.
    pub residual_sd: f64,
}

/// What both triads have, of a set point with `dwells` dwells.
pub(crate) fn sensors(reduced: &[SensorReduction; AXES], dwells: usize) -> [ReducedSensor<'_>; AXES] {
    reduced.each_ref().map(|SensorReduction { temperature, values, standard_errors, .. }| ReducedSensor {
        temperature: *temperature,
        values,
        standard_errors,
        freedom: dwells.saturating_sub(PARAMETERS),
    })
}

/// Reduces `dwells` of one set point for accelerometer `axis`, with the base tilted by `tilt`. `None` if the dwells do
/// not determine the parameters. The caller must check first that the positions do: otherwise the few pulses of a
/// horizontal reading could be taken for a scale factor.
#[must_use]
pub fn reduce(campaign: &Campaign, dwells: &[&Dwell], axis: usize, tilt: Option<[f64; 2]>) -> Option<SensorReduction> {
    let force =
        |dwell: &Dwell, k: usize| campaign.force(&campaign.positions[dwell.position], tilt).0[(axis + k) % AXES];
    // Rates are divided by the largest rate, so that all columns are of order 1.
    let largest = |channel: usize| dwells.iter().map(|dwell| dwell.sums.rates(axis)[channel]).fold(0.0, f64::max);
    let nominal = [largest(0), largest(1)];
    let row = |dwell: &Dwell| {
        let [positive, negative] = dwell.sums.rates(axis);
        [-1.0, positive / nominal[0], negative / nominal[1], -force(dwell, 1), -force(dwell, 2)]
    };
    let n = dwells.len();
    if n < PARAMETERS || nominal[0] * nominal[1] == 0.0 {
        return None;
    }
    let rows: Vec<_> = dwells.iter().map(|dwell| row(dwell)).collect();
    let matrix = DMatrix::from_fn(n, PARAMETERS, |i, j| rows[i][j]);
    let right = DVector::from_iterator(n, dwells.iter().map(|dwell| force(dwell, 0)));
    let qr = matrix.clone().qr();
    let (q, r) = (qr.q(), qr.r());
    let diagonal = r.diagonal().abs();
    if diagonal.min() < 1e-6 * diagonal.max() {
        return None;
    }
    let inverse = r.try_inverse()?;
    // Solution = pseudo * right.
    let pseudo = &inverse * q.transpose();
    let solution = &pseudo * &right;
    let residual = right - &matrix * &solution;
    let freedom = (n - PARAMETERS) as f64;
    let residual_sd = (residual.norm_squared() / freedom).sqrt();
    let error = |j: usize| residual_sd * inverse.row(j).norm();
    let [k_plus, k_minus] = [nominal[0] / solution[1], nominal[1] / solution[2]];
    // The weights of the dwells in each result sum to 1.
    let effective = |j: usize, temperature: &dyn Fn(&Dwell) -> f64| -> f64 {
        dwells.iter().enumerate().map(|(i, dwell)| pseudo[(j, i)] * matrix[(i, j)] * temperature(dwell)).sum()
    };
    let board = |dwell: &Dwell| dwell.board(axis);
    Some(SensorReduction {
        values: [solution[0], k_plus, k_minus, solution[3], solution[4]],
        standard_errors: [
            error(0),
            error(1) * k_plus * k_plus / nominal[0],
            error(2) * k_minus * k_minus / nominal[1],
            error(3),
            error(4),
        ],
        temperature: [effective(0, &|dwell| dwell.head(axis)), effective(1, &board), effective(2, &board)],
        residual_sd,
    })
}
