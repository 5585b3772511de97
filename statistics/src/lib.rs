//! Least squares and polynomial regression with their diagnostics: what every fit of Isotherm is made of. Regression is in double-double
//! from the decimals on, so that order 7 over a wide range loses no digit of a double.

pub mod curve;
pub mod diagnostics;
pub mod double_double;
pub mod hysteresis;
pub mod least_squares;
pub mod order;
pub mod regression;
