//! Recordings in every format: CSV, Parquet and MCAP.
//!
//! [`mod@read`] detects the format of a file by its first bytes and reads several pieces of a recording as one.
//! [`mod@write`] writes recordings that are complete up to the last flush at every moment. [`mod@convert`] makes raw
//! samples of foreign data.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use indicatif::ProgressBar;
//! use isotherm_recording_formats::read::{ImuChoice, Samples};
//!
//! let paths = ["../../tests/data/run.csv".into()];
//! let samples = Samples::open(&paths, ImuChoice::Any, &ProgressBar::hidden())?;
//! let first = samples.into_iter().next().ok_or("no row")??;
//! assert_eq!(first.accelerometers.positive_pulses, [4, 0, 234]);
//! # Ok(())
//! # }
//! ```

pub mod convert;
mod protobuf;
pub mod read;
pub mod repair;
pub mod ros;
mod seal;
pub mod steps;
mod varint;
pub mod write;
