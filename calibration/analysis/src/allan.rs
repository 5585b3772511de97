//! The noise of a sensor at rest: its overlapping Allan deviation with intervals, and a model of five slopes fitted to
//! it.
//!
//! # Definition
//! A rate r is recorded n times at an interval Ts. Its phase is the running sum x of (r less its mean) times Ts, n + 1
//! values. For the averaging time tau = m Ts,
//!
//! ```text
//! AVAR(tau) = sum over k of (x(k+2m) - 2 x(k+m) + x(k))^2 / (2 (n + 1 - 2m) tau^2)        ADEV = sqrt(AVAR)
//! ```
//! This is the overlapping estimate of NIST SP 1065, section 5.2.4. The factors m lie a third of an octave apart, from
//! 1 to n/3: 1 to 6, 8 and 10 in the first decade, and in growing steps beyond. The model is fitted to the octaves.
//!
//! # Model
//! Named as in IEEE Std 952, with two-sided spectral densities:
//!
//! ```text
//! AVAR(tau) = 3 Q^2/tau^2 + N^2/tau + B^2 2 ln 2/pi + K^2 tau/3
//! ```
//! Q is quantisation, N white noise of the rate (random walk of velocity or angle), B flicker noise of the rate (bias
//! instability), and K random walk of the rate. [`model`] fits them, and [`moments`] gives the exact covariance of the
//! estimates.
//!
//! # Intervals
//! A point has f = 2 AVAR^2/variance degrees of freedom, with the variance under the fitted model. Its 95 % interval is
//! that of chi-square: from AVAR f/chi2(0.975) to AVAR f/chi2(0.025).

mod bridge;
mod collector;
pub(crate) mod counts;
pub(crate) mod curve;
mod deviations;
pub(crate) mod filter;
pub(crate) mod kalibr;
pub(crate) mod model;
pub(crate) mod moments;
mod outputs;
pub(crate) mod rate;
pub(crate) mod recording;
mod rest;
mod rows;
pub(crate) mod sensor;
pub(crate) mod step;
mod stretch;

pub use collector::NoiseRows;
pub use counts::CountChanges;
pub use curve::{Allan, AllanPoint, MIN_ROWS, TemperatureLine};
pub use model::{COEFFICIENTS, Coefficient, FLICKER_FLOOR, ModelFit};
pub use rate::{NoiseUnits, RateKind};
pub use recording::{NoiseAnalysis, NoiseError};
pub use sensor::SensorNoise;
pub use step::Step;
pub use stretch::BridgedRows;

#[cfg(test)]
mod tests;
