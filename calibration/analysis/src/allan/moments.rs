//! The exact covariance of estimates of the Allan variance under the model, after C. A. Greenhall.
//!
//! # Derivation
//! The estimate for the factor m is S/(2 L m^2), where S is the sum of the squares of L = n + 1 - 2m second differences
//! of the phase (Ts = 1 here). For Gaussian noise the covariance of two such sums is twice the sum of the squares of
//! the covariances R of their terms:
//!
//! ```text
//! cov(S1/L1, S2/L2) = 2/(L1 L2) sum over k, l of R(k + m1 - l - m2)^2
//! R(t) = 4 G(t) - 2 (G(t+m1) + G(t-m1) + G(t+m2) + G(t-m2)) + G(t+m1+m2) + G(t+m1-m2) + G(t-m1+m2) + G(t-m1-m2)
//! ```
//! t is the distance of the middles of the two differences, and G the generalised autocovariance of the phase. With
//! squares of the coefficients as factors, G is for Q: 1 at t = 0, otherwise 0; N: -|t|/2; B: t^2 ln|t|/(2 pi); K:
//! |t|^3/12. Check: R(0) for m1 = m2 = m is 2 m^2 AVAR of the model.
//!
//! R is a sum of four parts, one for each coefficient, so the sum of its squares is a quadratic form in their squares.
//! Its matrix depends only on the factors and n: it is computed once, and used for every axis and iteration.
//!
//! # Shortcuts
//! - Terms with the same distance t are added at once.
//! - Beyond |t| = m1 + m2, R is 0 but for B, whose R falls as 1/t^2; it is left out beyond 8 (m1 + m2), which changes
//!   the sum by less than 1e-3.
//! - Where both factors are over 64, R changes little from t to t + 1, and every (min(m1, m2)/64)th t is taken. Q,
//!   which is not 0 at single t, is summed apart.

use core::f64::consts::PI;
use isotherm_support::checkpoint::checkpoint;
use nalgebra::{Matrix4, Vector4};
use std::cell::RefCell;
use std::collections::HashMap;

/// R of B is left out beyond this many times the sum of the factors.
const REACH: f64 = 8.0;
/// Steps of t over the shorter of the two averaging times.
const STEPS: f64 = 64.0;

/// The matrix of the quadratic form that gives the covariance of two estimates of the Allan variance, from the squares
/// of Q, N, B, K for Ts = 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moments(Matrix4<f64>);

/// The matrices of the last number of rates, by the factors.
type Known = (usize, HashMap<[usize; 2], Moments>);

thread_local! {
    static KNOWN: RefCell<Known> = RefCell::default();
}

impl Moments {
    /// As [`Moments::new`], computed once for all sensors of a recording: of a night at 1 kHz it takes a minute.
    #[must_use]
    pub(crate) fn of(factors: [usize; 2], n: usize) -> Self {
        KNOWN.with_borrow_mut(|(of, known)| {
            if *of != n {
                (*of, *known) = (n, HashMap::new());
            }
            known.entry(factors).or_insert_with(|| Self::new(factors, n)).clone()
        })
    }

    /// For the two averaging factors, of n rates. Both must be at most n/2.
    #[must_use]
    pub(crate) fn new([m1, m2]: [usize; 2], n: usize) -> Self {
        let counts = [m1, m2].map(|m| (n + 1).saturating_sub(2 * m) as f64);
        let (m1, m2) = (m1 as f64, m2 as f64);
        let step = (m1.min(m2) / STEPS).max(1.0);
        let mut sum = Matrix4::zeros();
        // Every distance but 0 occurs in both directions.
        let pairs = |t: f64| pairs(t + m2 - m1, counts) + if t == 0.0 { 0.0 } else { pairs(m2 - m1 - t, counts) };
        let reach = (REACH * (m1 + m2)).min(n as f64);
        for index in 0..=(reach / step) as usize {
            if index % 1024 == 0 {
                checkpoint();
            }
            let t = index as f64 * step;
            let weight = pairs(t);
            if weight > 0.0 {
                let [white, flicker, walk] = differences(t, [m1, m2]);
                let parts = Vector4::new(0.0, white, flicker, walk);
                sum += parts * parts.transpose() * (weight * step);
            }
        }
        for (t, quantisation) in quantised([m1, m2]) {
            let [white, flicker, walk] = differences(t, [m1, m2]);
            let weight = pairs(t) * quantisation;
            sum[(0, 0)] += weight * quantisation;
            for (index, part) in [(1, white), (2, flicker), (3, walk)] {
                sum[(0, index)] += weight * part;
                sum[(index, 0)] += weight * part;
            }
        }
        Self(sum / (2.0 * counts[0] * counts[1] * m1 * m1 * m2 * m2))
    }

    /// The covariance of the two estimates for these squares of Q, N, B, K, in units with Ts = 1.
    #[must_use]
    pub(crate) fn covariance(&self, squares: &Vector4<f64>) -> f64 {
        squares.dot(&(self.0 * squares))
    }
}

/// The generalised autocovariance G of the phase at t, over the squares of Q, N, B, K for Ts = 1.
pub(super) fn autocovariance(t: f64) -> Vector4<f64> {
    let size = t.abs();
    let [quantisation, flicker] =
        if size == 0.0 { [1.0, 0.0] } else { [0.0, size * size * libm::log(size) / (2.0 * PI)] };
    Vector4::new(quantisation, -0.5 * size, flicker, size.powi(3) / 12.0)
}

/// Number of pairs k in 0..counts\[0\], l in 0..counts\[1\] with k - l = lag.
fn pairs(lag: f64, [first, second]: [f64; 2]) -> f64 {
    (first.min(second + lag) - lag.max(0.0)).max(0.0)
}

/// R at t for N, B and K.
fn differences(t: f64, factors: [f64; 2]) -> [f64; 3] {
    let [_, white, flicker, walk] = double_difference(t, factors).into();
    // Straight lines and parabolas on one side cancel; computed, they would leave rounding errors.
    if t >= factors[0] + factors[1] { [0.0, flicker, 0.0] } else { [white, flicker, walk] }
}

fn double_difference(t: f64, [m1, m2]: [f64; 2]) -> Vector4<f64> {
    let sum = |times: [f64; 4]| times.into_iter().map(autocovariance).sum::<Vector4<f64>>();
    let single = sum([t + m1, t - m1, t + m2, t - m2]);
    let double = sum([t + m1 + m2, t + m1 - m2, t - m1 + m2, t - m1 - m2]);
    4.0 * autocovariance(t) - 2.0 * single + double
}

/// Every t from 0 on at which R of Q is not 0, and its value there.
fn quantised([m1, m2]: [f64; 2]) -> Vec<(f64, f64)> {
    let mut places = vec![0.0, m1, m2, m1 + m2, (m1 - m2).abs()];
    places.sort_by(f64::total_cmp);
    places.dedup();
    places.into_iter().map(|t| (t, double_difference(t, [m1, m2])[0])).collect()
}
