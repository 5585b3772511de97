//! Points of a regression, and why there is none.

use crate::double_double::DoubleDouble;

/// Highest order of a regression.
pub const MAX_ORDER: usize = 15;

/// One point of the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DataPoint {
    /// The independent variable.
    pub x: DoubleDouble,
    /// The dependent variable.
    pub y: DoubleDouble,
    /// Inverse variance, up to a common factor; over 0.
    pub weight: DoubleDouble,
}

impl DataPoint {
    /// A point of weight 1.
    #[must_use]
    pub fn new(x: f64, y: f64) -> Self {
        Self { x: x.into(), y: y.into(), weight: DoubleDouble::ONE }
    }
}

/// Why there is no regression.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegressionError {
    /// More coefficients than distinct x.
    #[error("order {order} needs {} different values of x, there are {distinct}", order + 1)]
    TooFewPoints {
        /// The requested order.
        order: usize,
        /// Number of distinct x.
        distinct: usize,
    },
    /// More coefficients than points.
    #[error("order {order} with {linear} linear columns needs {} points, there are {points}", order + linear + 1)]
    TooFewRows {
        /// The requested order.
        order: usize,
        /// Number of linear columns.
        linear: usize,
        /// Number of points.
        points: usize,
    },
    /// A linear column that has not one value for each point.
    #[error("the column {column} has {values} values for {points} points")]
    Length {
        /// Its name.
        column: String,
        /// Number of its values.
        values: usize,
        /// Number of points.
        points: usize,
    },
    /// A linear column without variation.
    #[error("the column {0} has the same value in every row: it cannot be separated from the constant; leave it out")]
    Constant(String),
    /// Columns of which each follows from the others to within its last digit.
    #[error("{}", dependent(columns, *power))]
    Dependent {
        /// The columns and powers of x.
        columns: Vec<String>,
        /// The highest power of x among them.
        power: usize,
    },
    /// An order over [`MAX_ORDER`].
    #[error("order {0} is over {MAX_ORDER}")]
    OrderTooHigh(usize),
    /// A sum or power is out of the range of doubles.
    #[error("the numbers are too large or too small: a sum or power of them is out of range")]
    OutOfRange,
}

/// Middle and half width of the range. Both are rounded to doubles, so that a user can repeat the centring.
pub(super) fn center_and_scale(values: impl Iterator<Item = DoubleDouble> + Clone) -> (DoubleDouble, DoubleDouble) {
    let values = || values.clone().map(DoubleDouble::value);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    let half = (high - low) / 2.0;
    (DoubleDouble::from(low + half), DoubleDouble::from(if half > 0.0 { half } else { 1.0 }))
}

/// The message about dependent columns.
fn dependent(columns: &[String], power: usize) -> String {
    let listed = match columns {
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
        [] => String::new(),
    };
    let or = if power > 1 { format!(", or fit up to order {} only", power - 1) } else { String::new() };
    format!(
        "the columns {listed} are linearly dependent: each follows from the others to within its last digit, so their \
         coefficients are not unique; leave one of them out{or}"
    )
}
