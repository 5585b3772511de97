//! The nine polynomials of a triad in parallel lanes, evaluated in one pass.
//!
//! A compensation needs bias, K+ and K- of three sensors, or of six. Evaluated one after the other they take most of a sample's time;
//! in parallel lanes the compiler uses vector instructions for them. Every lane does the same operations as
//! [`Polynomial::at`], so the values are the same to the last bit: a polynomial of lower order has zeros as its highest
//! coefficients, and `0 * x + c` is `c` for the finite `x` inside a range. (The sign of a bias that is 0 may differ; this
//! does not change any increment.)
//!
//! The lanes of both triads are two passes and not one of eighteen: the values of one triad fit into the registers, and a table without
//! gyroscopes has only one.

use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::table::Axis;
use crate::wire::{AXES, Triad};

/// Nine polynomials and one unused lane, so that the number is even.
const LANES: usize = 10;

/// Values of the nine polynomials, by quantity and sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneValues {
    /// Bias without transient term, in the unit of its coefficients.
    pub bias: [f64; AXES],
    /// K+ of the three sensors, then K-, in the unit of the triad.
    pub scale_factors: [f64; 2 * AXES],
}

impl LaneValues {
    /// Whether all scale factors are finite. Finite ones near the largest double may count as not finite.
    #[must_use]
    #[inline(always)]
    pub fn are_finite(&self) -> bool {
        let [p1, p2, p3, n1, n2, n3] = self.scale_factors;
        (((p1 + p2) + p3) - ((n1 + n2) + n3)).is_finite()
    }
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
}

impl Lanes {
    /// The lanes of a triad.
    #[must_use]
    pub fn new(axes: &[Axis; AXES]) -> Self {
        let mut lanes = Self {
            coefficients: [[0.0; LANES]; MAX_ORDER + 1],
            order: 0,
            plain: true,
            center: [0.0; LANES],
            scale: [1.0; LANES],
            low: [f64::NEG_INFINITY; LANES],
            high: [f64::INFINITY; LANES],
        };
        for (index, axis) in axes.iter().enumerate() {
            lanes.put(index, &axis.bias);
            lanes.put(AXES + index, &axis.positive_scale_factor);
            lanes.put(2 * AXES + index, &axis.negative_scale_factor);
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
    pub fn evaluate_inside(&self, triad: &Triad) -> Option<LaneValues> {
        let ([h1, h2, h3], [b1, b2, b3]) = (triad.head_temperature, triad.board_temperature);
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
        Some(LaneValues { bias: [r[0], r[1], r[2]], scale_factors: [r[3], r[4], r[5], r[6], r[7], r[8]] })
    }
}
