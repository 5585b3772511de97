//! The terms of a fit: their coefficients, errors and tests.

use super::linear::LinearTerm;
use crate::double_double::DoubleDouble;
use crate::tails::f_tail;
use serde::Serialize;

/// The partial sum of squares of one term, and its test.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TermTest {
    /// The term's power.
    pub term: usize,
    /// Q(without the term) - Q, eq. (16).
    pub sum_of_squares: f64,
    /// F with 1 and n-m-1 degrees of freedom; none for a perfect fit.
    pub f: Option<f64>,
    /// Probability of a larger F if the term had no effect.
    pub p: Option<f64>,
}

/// The terms of one order, in one basis. Row i of its matrix gives coefficient i from Q'y.
pub(super) struct Terms<'a> {
    pub matrix: &'a [Vec<DoubleDouble>],
    /// Q'y.
    pub rotated: &'a [DoubleDouble],
    /// Only the leading block is used: so many rows and columns.
    pub count: usize,
    /// None if there is no residual to test by.
    pub mean_square: Option<DoubleDouble>,
    pub df_residual: usize,
}

impl Terms<'_> {
    fn row(&self, term: usize) -> &[DoubleDouble] {
        &self.matrix[term][..self.count]
    }

    /// The largest entry of a row, about a power of the scale. A row is divided by it, so that the squares stay in the
    /// range of doubles.
    pub(super) fn size(&self, term: usize) -> DoubleDouble {
        DoubleDouble::from(self.row(term).iter().map(|entry| entry.value().abs()).fold(0.0, f64::max))
    }

    /// Of the coefficient over its size, for residuals of variance 1.
    pub(super) fn variance(&self, term: usize) -> DoubleDouble {
        let size = self.size(term);
        self.row(term).iter().map(|&entry| entry / size).map(|part| part * part).sum()
    }

    pub(super) fn coefficient(&self, term: usize) -> DoubleDouble {
        self.row(term).iter().zip(self.rotated).map(|(&entry, &z)| entry * z).sum()
    }

    /// With the mean square of the residuals, which may be 0.
    pub(super) fn standard_error(&self, term: usize, mean_square: Option<DoubleDouble>) -> Option<f64> {
        mean_square.map(|ms| (self.size(term) * (self.variance(term) * ms).sqrt()).value())
    }

    /// Sum of squares, F and probability of a coefficient.
    fn test(&self, term: usize) -> (f64, Option<f64>, Option<f64>) {
        let c = self.coefficient(term) / self.size(term);
        let sum_of_squares = c * c / self.variance(term);
        let f = self.mean_square.map(|ms| (sum_of_squares / ms).value());
        (sum_of_squares.value(), f, f.map(|f| f_tail(f, 1.0, self.df_residual as f64)))
    }

    /// The test of the power `power`, whose coefficient is that of `term`.
    pub(super) fn partial(&self, power: usize, term: usize) -> TermTest {
        let (sum_of_squares, f, p) = self.test(term);
        TermTest { term: power, sum_of_squares, f, p }
    }

    /// The term of a linear column.
    pub(super) fn linear(
        &self,
        term: usize,
        column: &str,
        mean_square: Option<DoubleDouble>,
        variance_inflation: f64,
    ) -> LinearTerm {
        let (sum_of_squares, f, p) = self.test(term);
        LinearTerm {
            column: column.to_owned(),
            coefficient: self.coefficient(term).value(),
            standard_error: self.standard_error(term, mean_square),
            sum_of_squares,
            f,
            p,
            variance_inflation,
        }
    }

    /// Variance inflation of a column with this sum of squares.
    pub(super) fn inflation(&self, term: usize, sum_of_squares: DoubleDouble) -> f64 {
        let inflation = self.variance(term) * sum_of_squares;
        (inflation * self.size(term) * self.size(term)).value()
    }
}
