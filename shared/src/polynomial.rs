//! A polynomial of temperature, with the range in which it was calibrated.
//!
//! ```text
//! x = (U - center) / scale          p(x) = c0 + c1 x + ... + cn x^n,   n <= 7
//! ```
//! It is evaluated by Horner's rule in IEEE double without fused multiply-add, so that every implementation gives the
//! same bits. Whether a polynomial stays on one side of a limit over its whole range is decided by its Bernstein
//! coefficients, which enclose it, not by sampling.

/// Highest order of a table's polynomial.
pub const MAX_ORDER: usize = 7;

/// A polynomial of order 0 to [`MAX_ORDER`] over a range of temperature. Coefficients, centre, scale and range are
/// always finite, the scale is never 0, and the range is never empty.
///
/// ```
/// use isotherm_shared::polynomial::{Polynomial, Side};
///
/// // 10 - 2 x + 0.5 x^2 over 1 to 4 V.
/// let polynomial = Polynomial::new(&[10.0, -2.0, 0.5], 0.0, 1.0, [1.0, 4.0]).expect("a valid polynomial");
/// assert_eq!(polynomial.at(2.0), 8.0);
/// assert_eq!((polynomial.side(4.5), polynomial.clamp(4.5)), (Side::Above, 4.0));
/// assert_eq!(Polynomial::new(&[f64::NAN], 0.0, 1.0, [1.0, 4.0]), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polynomial {
    coefficients: [f64; MAX_ORDER + 1],
    len: usize,
    center: f64,
    scale: f64,
    range: [f64; 2],
}

/// Where a temperature value lies with respect to a range.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Side {
    /// Below the lower end.
    Below,
    /// Within, ends included.
    Inside,
    /// Above the upper end.
    Above,
}

/// A point where a polynomial is on the wrong side of a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// Temperature at that point.
    pub at: f64,
    /// The polynomial's value there.
    pub value: f64,
}

impl Polynomial {
    /// `coefficients` are in ascending order, c0 first.
    ///
    /// Returns `None` unless there are 1 to 8 of them, every number is finite, `scale` is not 0 and
    /// `range[0] < range[1]`.
    #[must_use]
    pub fn new(coefficients: &[f64], center: f64, scale: f64, range: [f64; 2]) -> Option<Self> {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let valid = (1..=MAX_ORDER + 1).contains(&coefficients.len())
            && finite(coefficients)
            && finite(&[center, scale, range[0], range[1]])
            && scale != 0.0
            && range[0] < range[1];
        valid.then(|| {
            let mut all = [0.0; MAX_ORDER + 1];
            all[..coefficients.len()].copy_from_slice(coefficients);
            Self { coefficients: all, len: coefficients.len(), center, scale, range }
        })
    }

    /// The coefficients, c0 first.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..self.len]
    }

    /// Centre, which is subtracted from the temperature; in the temperature's unit.
    #[must_use]
    pub const fn center(&self) -> f64 {
        self.center
    }

    /// Scale, which divides the centred temperature; in the temperature's unit, never 0.
    #[must_use]
    pub const fn scale(&self) -> f64 {
        self.scale
    }

    /// Lower and upper end of the calibrated range of temperature.
    #[must_use]
    pub const fn range(&self) -> [f64; 2] {
        self.range
    }

    /// On which side of the range `temperature` (not NaN) lies.
    #[must_use]
    #[inline]
    pub fn side(&self, temperature: f64) -> Side {
        if temperature < self.range[0] {
            Side::Below
        } else if temperature > self.range[1] {
            Side::Above
        } else {
            Side::Inside
        }
    }

    /// The nearest temperature within the range.
    #[must_use]
    #[inline]
    pub fn clamp(&self, temperature: f64) -> f64 {
        temperature.clamp(self.range[0], self.range[1])
    }

    /// The polynomial at `temperature`, inside the range or not.
    #[must_use]
    #[inline]
    pub fn at(&self, temperature: f64) -> f64 {
        // (U - 0) / 1 is U to the last bit; this test saves nine divisions a sample.
        let x = if self.center == 0.0 && self.scale == 1.0 {
            temperature
        } else {
            (temperature - self.center) / self.scale
        };
        let (last, lower) = self.coefficients().split_last().unwrap_or((&0.0, &[]));
        lower.iter().rev().fold(*last, |r, c| r * x + c)
    }

    /// Searches the range for temperature where the polynomial is below `limit`; `None` if there is none.
    ///
    /// The Bernstein coefficients over an interval enclose the polynomial there, and the first and the last one are its
    /// values at the ends. If all are at or above the limit, the interval has no violation. If the first or the last is
    /// below it, that end is a violation. Otherwise, the interval is halved. An interval that is still undecided below
    /// 2^-48 of the range counts as a violation.
    ///
    /// ```
    /// use isotherm_shared::polynomial::Polynomial;
    ///
    /// let polynomial = Polynomial::new(&[10.0, -2.0, 0.5], 0.0, 1.0, [1.0, 4.0]).expect("a valid polynomial");
    /// assert_eq!(polynomial.below(7.9), None); // its lowest value is 8, at 2 V
    /// assert!(polynomial.below(8.5).is_some_and(|violation| violation.value < 8.5));
    /// ```
    #[must_use]
    pub fn below(&self, limit: f64) -> Option<Violation> {
        self.violation(1.0, limit)
    }

    /// As [`below`](Self::below), for temperature where the polynomial is above `limit`.
    #[must_use]
    pub fn above(&self, limit: f64) -> Option<Violation> {
        self.violation(-1.0, -limit)
    }

    fn violation(&self, sign: f64, limit: f64) -> Option<Violation> {
        let mut bernstein = self.bernstein();
        for b in &mut bernstein[..self.len] {
            *b *= sign;
        }
        // Undecided intervals: (coefficients, start, width), the last two as fractions of the range. The lower half
        // comes first.
        let mut undecided = vec![(bernstein, 0.0, 1.0)];
        while let Some((b, start, width)) = undecided.pop() {
            let b = &b[..self.len];
            // A coefficient that has overflowed proves nothing.
            let clear = |v: f64| v >= limit && v.is_finite();
            if b.iter().copied().all(clear) {
                continue;
            }
            let (first, last) = (b[0], b[self.len - 1]);
            let found = if !clear(first) {
                Some(start)
            } else if !clear(last) {
                Some(start + width)
            } else if width < libm::exp2(-48.0) {
                Some(start + width / 2.0)
            } else {
                None
            };
            if let Some(t) = found {
                let at = self.range[0] + t * (self.range[1] - self.range[0]);
                return Some(Violation { at, value: self.at(at) });
            }
            let (left, right) = halve(b);
            undecided.push((right, start + width / 2.0, width / 2.0));
            undecided.push((left, start, width / 2.0));
        }
        None
    }

    /// Bernstein coefficients over the range.
    fn bernstein(&self) -> [f64; MAX_ORDER + 1] {
        let n = self.len - 1;
        let x0 = (self.range[0] - self.center) / self.scale;
        let width = (self.range[1] - self.center) / self.scale - x0;
        // Taylor coefficients at x0 by repeated synthetic division, then scaled to t = (x - x0)/width.
        let mut taylor = self.coefficients;
        for low in 0..n {
            for k in (low..n).rev() {
                taylor[k] += taylor[k + 1] * x0;
            }
        }
        let mut power = 1.0;
        for c in &mut taylor[..=n] {
            *c *= power;
            power *= width;
        }
        // b_i = sum over j <= i of C(i,j)/C(n,j) * a_j
        let mut bernstein = [0.0; MAX_ORDER + 1];
        for (i, b) in bernstein.iter_mut().enumerate().take(n + 1) {
            let mut ratio = 1.0;
            for (j, a) in taylor.iter().enumerate().take(i + 1) {
                *b += ratio * a;
                ratio *= (i - j) as f64 / (n - j).max(1) as f64;
            }
        }
        bernstein
    }
}

/// Bernstein coefficients over the two halves of the interval, by De Casteljau's algorithm.
fn halve(b: &[f64]) -> ([f64; MAX_ORDER + 1], [f64; MAX_ORDER + 1]) {
    let n = b.len() - 1;
    let mut left = [0.0; MAX_ORDER + 1];
    let mut right = [0.0; MAX_ORDER + 1];
    right[..=n].copy_from_slice(b);
    for (level, end) in left.iter_mut().enumerate().take(n + 1) {
        *end = right[0];
        for k in 0..n - level {
            right[k] = 0.5 * right[k] + 0.5 * right[k + 1];
        }
    }
    (left, right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn polynomial(coefficients: &[f64], range: [f64; 2]) -> Polynomial {
        Polynomial::new(coefficients, 0.0, 1.0, range).unwrap()
    }

    #[test]
    fn evaluates_with_centre_and_scale() {
        let p = Polynomial::new(&[1.0, -2.0, 0.5], 2.5, -1.5, [1.0, 4.0]).unwrap();
        let x = (3.7 - 2.5) / -1.5;
        assert_eq!(p.at(3.7).to_bits(), ((0.5 * x + -2.0) * x + 1.0_f64).to_bits());
        assert_eq!(polynomial(&[42.0], [0.0, 1.0]).at(1e300), 42.0);
    }

    #[test]
    fn only_valid_polynomials_can_be_built() {
        assert!(Polynomial::new(&[], 0.0, 1.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[0.0; 9], 0.0, 1.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[f64::NAN], 0.0, 1.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], f64::INFINITY, 1.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], 0.0, 0.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], 0.0, -0.0, [0.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], 0.0, 1.0, [1.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], 0.0, 1.0, [2.0, 1.0]).is_none());
        assert!(Polynomial::new(&[1.0], 0.0, 1.0, [f64::NAN, 1.0]).is_none());
    }

    #[test]
    fn finds_a_dip_that_no_coarse_sampling_sees() {
        // 1e6 (U-a)^2 is below 1 only for |U-a| < 1e-3: 1/2000 of the range.
        for a in [1.234_567, 0.0, 4.0, 3.999_5, 2.0] {
            let p = polynomial(&[1e6 * a * a, -2e6 * a, 1e6], [0.0, 4.0]);
            let violation = p.below(1.0).unwrap();
            assert!(violation.value < 1.0 && (violation.at - a).abs() < 1e-3, "{violation:?}");
            assert!(p.above(1.6e7 + 1.0).is_none());
        }
    }

    #[test]
    fn finds_a_zero_for_every_order() {
        // x^n for even n has its only zero in the middle of the range; adding 2 keeps it above 1.
        for order in [2, 4, 6] {
            let mut coefficients = vec![0.0; order + 1];
            coefficients[order] = 1000.0;
            let p = Polynomial::new(&coefficients, 2.5, 1.25, [1.0, 4.0]).unwrap();
            assert!((p.below(1.0).unwrap().at - 2.5).abs() < 1.0);
            coefficients[0] = 2.0;
            assert!(Polynomial::new(&coefficients, 2.5, 1.25, [1.0, 4.0]).unwrap().below(1.0).is_none());
        }
        for order in [1, 3, 5, 7] {
            let mut coefficients = vec![0.0; order + 1];
            coefficients[order] = -1000.0;
            let p = Polynomial::new(&coefficients, 2.5, 1.25, [1.0, 4.0]).unwrap();
            assert!(p.below(1.0).is_some() && p.above(-1.0).is_some());
        }
    }

    #[test]
    fn overflow_counts_as_a_violation() {
        let p = polynomial(&[1e308, 1e308, 1e308], [1.0, 1e10]);
        assert!(p.below(1.0).is_some() || p.above(1e308).is_some());
        let p = polynomial(&[1e308, -1e308, 1e308, -1e308], [-1e300, 1e300]);
        assert!(p.below(1.0).is_some());
        assert!(polynomial(&[100.0, 0.0, 1e308], [0.0, 1e5]).below(1.0).is_some());
    }

    proptest! {
        /// Without a reported violation every sampled point is at or above the limit, and a reported violation is a
        /// real one.
        #[test]
        fn the_verdict_agrees_with_dense_sampling(
            coefficients in prop::collection::vec(-5.0..5.0f64, 1..=8),
            center in -2.0..2.0f64,
            scale in prop_oneof![-3.0..-0.5f64, 0.5..3.0f64],
            low in -2.0..1.0f64,
            width in 0.1..3.0f64,
            limit in -30.0..30.0f64,
        ) {
            let p = Polynomial::new(&coefficients, center, scale, [low, low + width]).unwrap();
            let size: f64 = coefficients.iter().map(|c| c.abs()).sum::<f64>() * 4.0_f64.max(5.0 / scale.abs()).powi(7);
            let rounding = size * 1e-13;
            match p.below(limit) {
                Some(v) => {
                    prop_assert!(v.value < limit + rounding);
                    prop_assert!(v.at >= low && v.at <= low + width + 1e-12);
                }
                None => for k in 0..=1000 {
                    let u = low + width * f64::from(k) / 1000.0;
                    prop_assert!(p.at(u) >= limit - rounding);
                }
            }
        }
    }
}
