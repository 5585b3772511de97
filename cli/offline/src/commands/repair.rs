//! `repair`: takes what is whole of a damaged recording.

use clap::Args;
use isotherm_files::{print, print_data};
use isotherm_pipeline::repair_into;
use isotherm_support::failure::{Failure, shown};
use std::path::PathBuf;
use tracing::info;

/// Take what is whole of a damaged recording
///
/// Take the rows before and behind damaged places of a recording into a new file.
///
/// CSV, Parquet and MCAP; the new file has the same format. What was recorded with checks is taken where it matches
/// them: rows of CSV, row groups of Parquet, chunks of MCAP. Without checks it is taken where it can be read. Each
/// damaged place is printed with the rows and times that are lost. Rows keep session and sequence, so a hole within a
/// session is a gap of known length; behind one of unknown length a new session begins. The recording itself is not
/// changed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm check flight.parquet\n  isotherm repair flight.parquet -o flight-repaired.parquet\n  isotherm repair flight.increments.csv -o whole.increments.csv"
)]
pub struct Repair {
    /// The damaged recording
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// Write the rows to this new file
    ///
    /// Where the rows go; a file that exists is never replaced.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print what was taken and lost as JSON
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
