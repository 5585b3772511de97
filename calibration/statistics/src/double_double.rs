//! Numbers of about 32 decimal digits: an unevaluated sum of two doubles, `hi + lo` with `|lo| <= ulp(hi)/2`.
//!
//! The data of a regression are decimals that a double cannot represent exactly, such as 0.1. On ill-conditioned data
//! sets only this rounding costs half the digits of the result. Text is therefore read into a [`DoubleDouble`], and the
//! whole factorisation uses it. Algorithms: Dekker (1971), Knuth (TAOCP 2, 4.2.2), Hida, Li and Bailey (2001).
//! Magnitudes must be between about 1e-140 and 1e140; outside, results degrade to doubles or become infinite or NaN.

use core::cmp::Ordering;
use core::iter::Sum;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// An unevaluated sum of two doubles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleDouble {
    hi: f64,
    lo: f64,
}

/// `a + b` and its rounding error, exact.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

/// As [`two_sum`], for `|a| >= |b|`.
fn quick_two_sum(a: f64, b: f64) -> DoubleDouble {
    let hi = a + b;
    DoubleDouble { hi, lo: b - (hi - a) }
}

/// The upper and the lower half of a double's digits.
fn split(a: f64) -> (f64, f64) {
    let t = 134_217_729.0 * a; // 2^27 + 1
    let high = t - (t - a);
    (high, a - high)
}

/// `a * b` and its rounding error, exact.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (product, ((ah * bh - product) + ah * bl + al * bh) + al * bl)
}

impl DoubleDouble {
    /// Zero.
    pub const ZERO: Self = Self { hi: 0.0, lo: 0.0 };
    /// One.
    pub const ONE: Self = Self { hi: 1.0, lo: 0.0 };

    /// The nearest double.
    #[must_use]
    pub const fn value(self) -> f64 {
        self.hi
    }

    /// Whether it is neither infinite nor NaN.
    #[must_use]
    pub const fn is_finite(self) -> bool {
        self.hi.is_finite() && self.lo.is_finite()
    }

    /// The absolute value.
    #[must_use]
    pub fn abs(self) -> Self {
        if self.hi < 0.0 { -self } else { self }
    }

    /// Square root; NaN of a negative number.
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.hi == 0.0 {
            return Self::ZERO;
        }
        // One Newton step doubles the number of correct digits.
        let root = self.hi.sqrt();
        let error = self - Self::from(root) * Self::from(root);
        Self::from(root) + Self::from(error.hi / (2.0 * root))
    }

    /// To the power of `exponent`.
    #[must_use]
    pub fn powi(self, exponent: u32) -> Self {
        (0..32).rev().fold(Self::ONE, |power, bit| {
            let square = power * power;
            if exponent >> bit & 1 == 1 { square * self } else { square }
        })
    }

    /// Reads a decimal number, for example `-1.25`, `.5` or `6.02E+23`, to about 31 digits. `None` if the text is not a
    /// number, or if its magnitude is neither 0 nor between 1e-140 and 1e140.
    ///
    /// ```
    /// use isotherm_statistics::DoubleDouble;
    ///
    /// let tenth = DoubleDouble::parse("0.1").unwrap_or(DoubleDouble::ZERO);
    /// assert_ne!(tenth, DoubleDouble::from(0.1)); // the double next to 0.1 is 5.6e-18 above it
    /// assert_eq!((tenth * DoubleDouble::from(10.0)).value(), 1.0);
    /// assert_eq!(DoubleDouble::parse("1e999"), None);
    /// ```
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        // The parser of f64 decides what is a number.
        let nearest: f64 = text.parse().ok()?;
        if nearest == 0.0 {
            return Some(Self::ZERO);
        }
        if !(1e-140..1e140).contains(&nearest.abs()) {
            return None;
        }
        let (mantissa, exponent) = match text.split_once(['e', 'E']) {
            Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
            None => (text, 0),
        };
        let (mut digits, mut kept, mut after_point) = (0_u128, 0, None);
        let mut power = exponent;
        for byte in mantissa.bytes() {
            match byte {
                b'.' => after_point = Some(()),
                // 33 digits are more than two doubles hold.
                b'0'..=b'9' if kept < 33 => {
                    digits = digits * 10 + u128::from(byte - b'0');
                    kept += i32::from(digits > 0);
                    power -= i32::from(after_point.is_some());
                }
                b'0'..=b'9' => power += i32::from(after_point.is_none()),
                _ => {}
            }
        }
        let ten = Self::from(10.0).powi(power.unsigned_abs());
        let size = if power < 0 { Self::from_integer(digits) / ten } else { Self::from_integer(digits) * ten };
        Some(if nearest < 0.0 { -size } else { size })
    }

    fn from_integer(integer: u128) -> Self {
        // A piece of 40 bits is exact as a double.
        let piece = |shift: u32| Self::from(((integer >> shift) & ((1 << 40) - 1)) as f64);
        let shift = Self::from((1_u64 << 40) as f64);
        (piece(80) * shift + piece(40)) * shift + piece(0)
    }
}

impl From<f64> for DoubleDouble {
    fn from(hi: f64) -> Self {
        Self { hi, lo: 0.0 }
    }
}

impl Add for DoubleDouble {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (sum, error) = two_sum(self.hi, other.hi);
        let (low, low_error) = two_sum(self.lo, other.lo);
        let first = quick_two_sum(sum, error + low);
        quick_two_sum(first.hi, first.lo + low_error)
    }
}

impl Neg for DoubleDouble {
    type Output = Self;

    fn neg(self) -> Self {
        Self { hi: -self.hi, lo: -self.lo }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let (product, error) = two_product(self.hi, other.hi);
        quick_two_sum(product, error + (self.hi * other.lo + self.lo * other.hi))
    }
}

impl Div for DoubleDouble {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        // Long division: each quotient adds the digits of one double.
        let first = self.hi / other.hi;
        let rest = self - other * Self::from(first);
        let second = rest.hi / other.hi;
        let rest = rest - other * Self::from(second);
        quick_two_sum(first, second) + Self::from(rest.hi / other.hi)
    }
}

impl AddAssign for DoubleDouble {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for DoubleDouble {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Sum for DoubleDouble {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Add::add)
    }
}

impl PartialOrd for DoubleDouble {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        match self.hi.partial_cmp(&other.hi) {
            Some(Ordering::Equal) => self.lo.partial_cmp(&other.lo),
            order => order,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `a - b` relative to `b`.
    fn error(a: DoubleDouble, b: DoubleDouble) -> f64 {
        ((a - b) / b).value().abs()
    }

    #[test]
    fn decimals_are_read_to_31_digits() {
        let third = DoubleDouble::ONE / DoubleDouble::from(3.0);
        assert!(error(DoubleDouble::parse("0.33333333333333333333333333333333333").unwrap(), third) < 1e-31);
        assert!(error(DoubleDouble::parse("-3333333333333333333333333333333333.33E-034").unwrap(), -third) < 1e-31);
        // The nearest double is right to 17 digits; `lo` holds its error.
        let tenth = DoubleDouble::parse(".1").unwrap();
        assert_eq!(tenth.hi, 0.1);
        assert!((tenth.lo + 5.551_115_123_125_783e-18).abs() < 1e-33, "{}", tenth.lo);
        assert!((tenth * DoubleDouble::from(10.0) - DoubleDouble::ONE).value().abs() < 1e-31);
        for (text, value) in [("0", 0.0), ("-0.000", 0.0), ("+7", 7.0), ("1e2", 100.0), ("2.50", 2.5), ("0.1", 0.1)] {
            assert_eq!(DoubleDouble::parse(text).map(DoubleDouble::value), Some(value), "{text}");
        }
        for text in ["", "x", "1,5", "NaN", "inf", "1e300", "1e-300", "--1", "1e"] {
            assert_eq!(DoubleDouble::parse(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn every_double_is_read_back(value in prop::num::f64::NORMAL.prop_filter("range", |v| (1e-130..1e130).contains(&v.abs()))) {
            prop_assert_eq!(DoubleDouble::parse(&format!("{value:e}")).unwrap().value(), value);
        }

        #[test]
        fn inverse_operations_agree_to_31_digits(a in 1e-3..1e3f64, b in 1e-3..1e3f64, c in -1e-17..1e-17f64) {
            let (x, y) = (DoubleDouble::from(a) + DoubleDouble::from(a * c), DoubleDouble::from(b) - DoubleDouble::from(b * c));
            prop_assert!(error(x * y / y, x) < 1e-31);
            prop_assert!(error(x + y - y, x) < 1e-31 * (1.0 + b / a));
            prop_assert!(error(x.sqrt() * x.sqrt(), x) < 1e-31);
            prop_assert!(error(x.powi(7) / x.powi(6), x) < 1e-30);
        }
    }
}
