//! Recordings: rows, the one list of columns, and CSV. Other formats are in `isotherm-recording-formats`.
//!
//! This crate reads from any source and writes to any sink; its callers open the files. Readers find columns by name,
//! in any order, and ignore other columns. A row that cannot be read is left out and counted ([`DamagedPlaces`]):
//!
//! ```text
//! raw:        sequence,timestamp_ns,interval_ns,a1_positive,a1_negative,a1_head,a1_board,a2_..,a3_..
//!             [session] [telemetry_ns] [device] [g1_positive,..,g3_board] [lag_ns,a1_head_lagged,..,g3_head_lagged]
//! campaign:   set_point_c,position, then the raw columns
//! increments: sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,[g1_da,g2_da,g3_da,]table,flags     [delivery]
//! of record:  all columns
//! ```
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_recording::RawCsvReader;
//!
//! let recording: &[u8] = include_bytes!("../../tests/data/run.csv");
//! let samples = RawCsvReader::new(recording)?.collect::<Result<Vec<_>, _>>()?;
//! assert_eq!((samples[0].sequence, samples[0].interval_ns), (0, 2_500_000));
//! assert_eq!(samples[0].accelerometers.positive_pulses, [4, 0, 234]);
//! # Ok(())
//! # }
//! ```

mod campaign;
pub mod columns;
mod continuity;
pub mod csv;
mod damage;
mod device;
mod error;
pub mod foreign;
mod increments;
mod interval;
mod log;
mod marks;
mod nominal;
mod overlap;
mod pieces;
mod progress;
mod raw;
pub mod rows;
pub mod steps;

pub use campaign::{CampaignCsvReader, CampaignRow, POSITION, SET_POINT};
pub use columns::Layout;
pub use columns::layouts;
pub use continuity::{Continuity, Losses, MISSING, TimeFault};
pub use damage::{DamagedPlaces, RowsBefore};
pub use device::other_device;
pub use error::RecordingError;
pub use increments::{ANGLE_CSV_COLUMNS, CSV_COLUMNS as INCREMENT_CSV_COLUMNS, IncrementCsvWriter, IncrementLayout};
pub use interval::{CLOCK_TOLERANCE, IntervalFault, cause, part, unit_factor};
pub use log::LogImu;
pub use marks::{Marks, share_rows};
pub use overlap::Overlap;
pub use pieces::{MOST_PERIODS, SequenceRule, goes_on};
pub use progress::{Observer, Progress, WatchedReader};
pub use raw::{RawCsvReader, RawCsvWriter};
