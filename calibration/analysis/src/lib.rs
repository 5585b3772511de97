//! What is seen in a recording or between tables: the Allan deviation of an IMU at rest, the comparison of two tables,
//! and the statistics of a batch of devices.
//!
//! This crate opens no file: a caller gives rows and tables.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_analysis::{ComparisonRequirement, compare};
//! use isotherm_fit::TableFile;
//!
//! let old = include_str!("../../../tests/data/imu-a.toml");
//! let new = old.replace("c0 = 793.55", "c0 = 803.55"); // the bias of A1 is 10 ug0 higher
//! let tables = vec![TableFile::from_toml("old.toml", old)?, TableFile::from_toml("new.toml", &new)?];
//! let comparison = compare(tables, false).map_err(|error| error.to_string())?;
//! assert!(comparison.check(&"bias=20ug0".parse()?).is_ok());
//! let required: ComparisonRequirement = "bias=5ug0".parse()?;
//! assert!(comparison.check(&required).is_err_and(|message| message.contains("A1 bias")));
//! # Ok(())
//! # }
//! ```

mod allan;
mod batch;
mod compare;

pub use allan::kalibr::imu_yaml;
pub use allan::{
    Allan, AllanPoint, BridgedRows, COEFFICIENTS, Coefficient, CountChanges, FLICKER_FLOOR, MIN_ROWS, ModelFit,
    NoiseAnalysis, NoiseError, NoiseRows, NoiseUnits, RateKind, SensorNoise, Step, TemperatureLine,
};
pub use batch::{
    Batch, BatchCurve, Family, Quantity, StandOut, batch, least_found, leave_one_out, limit, same_rows, stand_outs,
};
pub use compare::{
    AlignmentComparison, Comparison, ComparisonRequirement, Compliance, Convention, CurveComparison, CurveJudgement,
    NOT_IN_THE_ERRORS, Trend, YEAR_S, compare,
};
