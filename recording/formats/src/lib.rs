//! Recordings in every format: CSV and MCAP.
//!
//! [`mod@read`] detects the format of a file by its first bytes and reads several pieces of a recording as one.
//! [`mod@write`] writes recordings that are complete up to the last flush at every moment. [`mod@convert`] makes raw
//! samples of foreign data. No file is opened here: who calls gives what reads and seeks, under its name, and a place
//! to write.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_recording::Progress;
//! use isotherm_recording_formats::read::{ImuChoice, Samples};
//! use isotherm_support::source::DataSource;
//!
//! let source = DataSource::of_bytes("run.csv", include_bytes!("../../../tests/data/run.csv").to_vec());
//! let samples = Samples::open(&[source], ImuChoice::Any, &Progress::default())?;
//! let first = samples.into_iter().next().ok_or("no row")??;
//! assert_eq!(first.accelerometers.positive_pulses, [4, 0, 234]);
//! # Ok(())
//! # }
//! ```

pub mod convert;
mod protobuf;
pub mod read;
pub mod ros;
mod varint;
pub mod write;
