//! The nine polynomials of a table side by side, evaluated in one pass.
//!
//! A compensation needs the bias, K+ and K- of three axes. One after the other they cost most of a sample's time; side by side
//! the compiler makes vector instructions of them. Every lane does what [`Polynomial::at`] does, operation by operation, so the
//! values are the same to the last bit: orders that differ are filled up with zeros in front, and `0 * x + c` is `c` for
//! the finite `x` inside a range. (The sign of a bias that is 0 may differ; no increment can tell.)

use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::wire::AXES;

/// Nine, and one that makes their number even.
const LANES: usize = 10;

/// Values of the nine polynomials, one array for the three axes each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneValues {
    /// Bias \[g0\].
    pub bias: [f64; AXES],
    /// K+ \[pulse/(s*g0)\].
    pub positive_scale_factor: [f64; AXES],
    /// K- \[pulse/(s*g0)\].
    pub negative_scale_factor: [f64; AXES],
}

/// What it takes to evaluate them. Biases come first, then K+, then K-.
#[derive(Clone, Debug, PartialEq)]
pub struct Lanes {
    /// c0 of every lane, then c1 ..
    coefficients: [[f64; LANES]; MAX_ORDER + 1],
    /// The highest order of any lane.
    order: usize,
    /// Whether no lane has a centre or a scale.
    plain: bool,
    center: [f64; LANES],
    scale: [f64; LANES],
    low: [f64; LANES],
    high: [f64; LANES],
    /// From the biases' units to g0.
    bias_unit: [f64; AXES],
}

impl Lanes {
    /// Puts the polynomials side by side: bias, K+ and K- of each axis, and the factor from each bias's unit to g0.
    #[must_use]
    pub fn new(polynomials: [[&Polynomial; 3]; AXES], bias_unit: [f64; AXES]) -> Self {
        let mut lanes = Self {
            coefficients: [[0.0; LANES]; MAX_ORDER + 1],
            order: 0,
            plain: true,
            center: [0.0; LANES],
            scale: [1.0; LANES],
            low: [f64::NEG_INFINITY; LANES],
            high: [f64::INFINITY; LANES],
            bias_unit,
        };
        for (axis, [bias, positive, negative]) in polynomials.into_iter().enumerate() {
            lanes.put(axis, bias);
            lanes.put(AXES + axis, positive);
            lanes.put(2 * AXES + axis, negative);
        }
        lanes
    }

    fn put(&mut self, lane: usize, polynomial: &Polynomial) {
        let coefficients = polynomial.coefficients();
        for (row, coefficient) in self.coefficients.iter_mut().zip(coefficients) {
            row[lane] = *coefficient;
        }
        self.order = self.order.max(coefficients.len() - 1);
        // A constant has no use for centre and scale, which might make its x infinite.
        if coefficients.len() > 1 {
            self.center[lane] = polynomial.center();
            self.scale[lane] = polynomial.scale();
            self.plain &= polynomial.center() == 0.0 && polynomial.scale() == 1.0;
        }
        [self.low[lane], self.high[lane]] = polynomial.range();
    }

    /// The values, if every telemetry lies inside the range of every polynomial that it drives (and so is finite).
    #[must_use]
    #[inline(always)]
    pub fn inside(&self, head: &[f64; AXES], board: &[f64; AXES]) -> Option<LaneValues> {
        let ([h1, h2, h3], [b1, b2, b3]) = (*head, *board);
        let mut x = [h1, h2, h3, b1, b2, b3, b1, b2, b3, 0.0];
        let mut inside = true;
        for ((x, low), high) in x.iter().zip(&self.low).zip(&self.high) {
            inside &= (low <= x) & (x <= high);
        }
        if !inside {
            return None;
        }
        if !self.plain {
            for ((x, center), scale) in x.iter_mut().zip(&self.center).zip(&self.scale) {
                *x = (*x - center) / scale;
            }
        }
        let (lower, _) = self.coefficients.split_at(self.order.min(MAX_ORDER));
        let mut r = self.coefficients[lower.len()];
        for row in lower.iter().rev() {
            for ((r, x), c) in r.iter_mut().zip(&x).zip(row) {
                *r = *r * x + c;
            }
        }
        let [u1, u2, u3] = self.bias_unit;
        Some(LaneValues {
            bias: [r[0] * u1, r[1] * u2, r[2] * u3],
            positive_scale_factor: [r[3], r[4], r[5]],
            negative_scale_factor: [r[6], r[7], r[8]],
        })
    }
}
