//! Takes what is whole of a damaged recording into another one: the rows before and behind each damaged place.
//!
//! What was recorded with checks is taken where it matches them: rows of CSV, row groups of Parquet, chunks of MCAP.
//! Without checks it is taken where it can be read. Rows keep their session and sequence, by which the length of a hole
//! is known. Where it is not, because the same session goes on with a sequence that does not rise, a new session
//! begins.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_recording_formats::repair::repair;
//! use isotherm_support::source::DataSource;
//!
//! let text = include_str!("../../../tests/data/run.csv").replacen("\n7,", "\n7\u{0},", 1);
//! let repaired = repair(&DataSource::of_bytes("damaged.csv", text.into_bytes()), std::io::sink())?;
//! assert_eq!((repaired.holes.len(), repaired.lost()), (1, Some(1)));
//! # Ok(())
//! # }
//! ```

mod account;
mod chunks;
mod csv;
mod mcap;
mod parquet;
mod report;

pub use report::{Hole, Loss, RecordingFormat, RepairReport, RowTime, StreamRows};

use crate::read::random::RandomAccess;
use crate::seal::MAGIC;
use isotherm_recording::columns::MCAP_MAGIC;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use report::RepairError;
use std::io::{self, Read as _, Write};
use std::path::Path;

/// Takes what is whole of a recording into any sink, in the same format. Returns what was taken and lost.
///
/// # Errors
/// If nothing can be taken, or if the source cannot be read or the sink written.
pub fn repair(of: &DataSource, mut sink: impl Write) -> Result<RepairReport, Failure> {
    let source = of.name();
    let io = |error: &io::Error| Failure::io("opening", source, error);
    let is_file = of.check_file().map_err(|error| io(&error))?;
    if !is_file {
        let message = format!("{}: only a file can be repaired", shown(source));
        return Err(Failure::new(Exit::Usage, message).at(source, None));
    }
    let mut begin = Vec::new();
    let mut file = of.open().map_err(|error| io(&error))?;
    (&mut file).take(MCAP_MAGIC.len() as u64).read_to_end(&mut begin).map_err(|error| io(&error))?;
    let sink: &mut dyn Write = &mut sink;
    let repaired = match format_of(source, &begin) {
        None => Err(RepairError::Nothing("the file is empty".to_owned())),
        Some(RecordingFormat::Csv) => csv::repair(of, sink),
        Some(RecordingFormat::Parquet) => {
            RandomAccess::new(file).map_err(RepairError::Read).and_then(|file| parquet::repair(file, sink))
        }
        Some(RecordingFormat::Mcap) => {
            RandomAccess::new(file).map_err(RepairError::Read).and_then(|file| mcap::repair(&file, sink))
        }
    };
    let repaired = repaired.and_then(|repaired| match repaired.holes.is_empty() || repaired.rows() > 0 {
        true => Ok(repaired),
        false => {
            let hole = repaired.holes.first().map(Hole::to_string).unwrap_or_default();
            Err(RepairError::Nothing(format!("no row is whole: {hole}")))
        }
    });
    repaired.map_err(|error| match error {
        RepairError::Nothing(message) => {
            Failure::new(Exit::Data, format!("{}: {message}", shown(source))).at(source, None)
        }
        RepairError::Read(error) => Failure::io("reading", source, &error),
        RepairError::Write(error) => Failure::new(Exit::Io, format!("writing: {error}")),
    })
}

/// As [`repair`], without a result: finds all damaged places.
///
/// # Errors
/// If no row is whole, or the file cannot be read.
pub fn inspect(source: &DataSource) -> Result<RepairReport, Failure> {
    repair(source, io::sink())
}

/// The format of a file: by its first bytes, or where these are damaged, by its name. `None` if it is empty.
fn format_of(path: &Path, begin: &[u8]) -> Option<RecordingFormat> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    match (begin, ending.as_str()) {
        ([], _) => None,
        (begin, _) if begin.starts_with(MAGIC) => Some(RecordingFormat::Parquet),
        (begin, _) if begin == MCAP_MAGIC => Some(RecordingFormat::Mcap),
        (_, "parquet") => Some(RecordingFormat::Parquet),
        (_, "mcap") => Some(RecordingFormat::Mcap),
        _ => Some(RecordingFormat::Csv),
    }
}

#[cfg(test)]
mod tests;
