//! What is seen in a recording or between tables: the Allan deviation of an IMU at rest, the comparison of two tables, and the statistics of
//! a batch of units.
//!
//! This crate opens no file: a caller gives rows and tables.

mod allan;
mod batch;
mod compare;

pub use allan::kalibr::imu_yaml;
pub use allan::{
    Allan, COEFFICIENTS, Coefficient, FLICKER_FLOOR, MIN_ROWS, ModelFit, NoiseAnalysis, NoiseError, NoiseUnits,
    RateKind, SensorNoise, TemperatureLine,
};
pub use batch::{Batch, BatchCurve, Family, Quantity, StandOut, batch, least_found, leave_one_out, limit, stand_outs};
pub use compare::{
    AlignmentComparison, Comparison, ComparisonRequirement, Convention, CurveComparison, Judgement, NOT_IN_THE_ERRORS,
    Trend, Verdict, YEAR_S, compare,
};
