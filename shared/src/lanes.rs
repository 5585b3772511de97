//! The nine polynomials of a table in parallel lanes, evaluated in one pass.
//!
//! A compensation needs the bias, K+ and K- of three axes. Evaluated one after the other they take most of a sample's time;
//! in parallel lanes the compiler uses vector instructions for them. Every lane does the same operations as
//! [`Polynomial::at`], so the values are the same to the last bit: a polynomial of lower order has zeros as its highest
//! coefficients, and `0 * x + c` is `c` for the finite `x` inside a range. (The sign of a bias that is 0 may differ; this
//! does not change any increment.)

use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::wire::AXES;

/// Nine polynomials and one unused lane, so that the number is even.
const LANES: usize = 10;

/// Values of the nine polynomials, by quantity and axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneValues {
    /// Bias \[g0\].
    pub bias: [f64; AXES],
    /// K+ \[pulse/(s*g0)\].
    pub positive_scale_factor: [f64; AXES],
    /// K- \[pulse/(s*g0)\].
    pub negative_scale_factor: [f64; AXES],
}

/// The nine polynomials by lane: three biases, then three K+, then three K-.
#[derive(Clone, Debug, PartialEq)]
pub struct Lanes {
    /// c0 of every lane, then c1 of every lane, and so on.
    coefficients: [[f64; LANES]; MAX_ORDER + 1],
    /// The highest order of any lane.
    order: usize,
    /// Whether every lane has centre 0 and scale 1.
    plain: bool,
    center: [f64; LANES],
    scale: [f64; LANES],
    low: [f64; LANES],
    high: [f64; LANES],
    /// Factors from the units of the biases to g0.
    bias_unit: [f64; AXES],
}

impl Lanes {
    /// `polynomials` are bias, K+ and K- of each axis; `bias_unit` is the factor from each bias's unit to g0.
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
        // A constant does not depend on x. Its centre and scale could make x infinite, and 0 * x would be NaN then.
        if coefficients.len() > 1 {
            self.center[lane] = polynomial.center();
            self.scale[lane] = polynomial.scale();
            self.plain &= polynomial.center() == 0.0 && polynomial.scale() == 1.0;
        }
        [self.low[lane], self.high[lane]] = polynomial.range();
    }

    /// The values of all polynomials; `None` unless every telemetry is inside the range of every polynomial that it drives
    /// (and therefore finite).
    #[must_use]
    #[inline(always)]
    pub fn evaluate_inside(&self, head: &[f64; AXES], board: &[f64; AXES]) -> Option<LaneValues> {
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
