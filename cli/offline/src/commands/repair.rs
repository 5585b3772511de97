//! `repair`: takes what is whole of a damaged recording.

use clap::Args;
use isotherm_files::{print, print_data};
use isotherm_pipeline::repair_into;
use isotherm_support::failure::{Failure, shown};
use std::path::PathBuf;
use tracing::info;

/// Recover the intact rows of a damaged recording
///
/// Copies the rows before and after the damaged places of a recording into a new file.
///
/// Reads CSV, Parquet and MCAP; the new file has the same format. Data that were recorded with checksums are copied
/// where they match: rows of CSV, row groups of Parquet, chunks of MCAP. Data without checksums are copied where they
/// can be read. Each damaged place is printed with the rows and times that are lost. Rows keep session and sequence, so
/// a hole within a session is a gap of known length. After a hole of unknown length a new session begins. The recording
/// itself is not changed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm check flight.parquet\n  isotherm repair flight.parquet -o flight-repaired.parquet\n  isotherm repair flight.increments.csv -o whole.increments.csv"
)]
pub struct Repair {
    /// Read this damaged recording
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// Write the rows to this new file
    ///
    /// An existing file is never replaced.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print recovered and lost rows as JSON
    #[arg(long)]
    json: bool,
}

impl Repair {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let repaired = repair_into(&self.recording, &self.output)?;
        if self.json {
            return print_data(&format!("{}\n", serde_json::json!(repaired)));
        }
        for hole in &repaired.holes {
            print(&format!("{}: {hole}\n", shown(&self.recording)))?;
        }
        repaired.notes.iter().for_each(|note| info!("{note}"));
        if !repaired.has_checks {
            info!("note: the recording has no checks: what could be read was taken");
        }
        print(&format!("{}: {repaired}\n", shown(&self.output)))
    }
}
