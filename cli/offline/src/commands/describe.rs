//! `describe`: what files are, and what they are good for.

use super::common::ForeignArgs;
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_files::{print, print_data};
use isotherm_pipeline::FileDescription;
use isotherm_support::failure::Failure;
use serde_json::json;
use std::path::PathBuf;

/// Describe files and their possible uses
///
/// Prints format, IMUs, rows, rate and temperature of every file that any command reads. Each job that the file can be
/// used for is printed with its command line, and each other job with the reason.
///
/// Reads logs of autopilots, third-party data, recordings, tables, campaign files, mappings and parameters. You need
/// not know anything about a file: if an option is missing, the message names it. The whole file is read, row by row.
/// The exit code is that of the worst file that cannot be read.
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
    /// It contains a list, files, with an entry for each file: docs/describe.md. The entry of a file that cannot be
    /// read has the reason.
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
