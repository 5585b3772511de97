//! `describe`: what files are, and what they are good for.

use super::common::ForeignArgs;
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_files::{print, print_data};
use isotherm_pipeline::FileDescription;
use isotherm_support::failure::Failure;
use serde_json::json;
use std::path::PathBuf;

/// Describe files and what they are good for
///
/// Format, IMUs, rows, rate and temperature of every file that any command reads, with the command line of each job
/// that it is good for, and the reason of each that it is not.
///
/// Logs of autopilots, data of other programs, recordings, tables, campaign files, mappings and parameters. Nothing has
/// to be known of a file: where an option is missing, the message has it. The whole file is read, row by row. The exit
/// code is that of the worst file that cannot be read.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm describe flight.ulg\n  isotherm describe *.BIN imu-a.toml vehicle.params\n  isotherm describe --mapping mapping.toml run.csv --json"
)]
pub struct Describe {
    /// Describe these files
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print one JSON document instead of text
    ///
    /// It has a list, files, with an entry for each file: docs/describe.md. What cannot be read is in its entry.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl Describe {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let foreign = self.foreign.read()?;
        let mut all = Vec::new();
        for file in &self.files {
            let description = FileDescription::of(file, &foreign, &bytes_bar);
            if !self.json {
                print(&description.text())?;
            }
            all.push(description);
        }
        if self.json {
            print_data(&format!("{:#}\n", json!({ "files": all })))?;
        }
        let failures = all.iter().filter_map(FileDescription::failure).collect();
        Failure::all(failures).map_or(Ok(()), Err)
    }
}
