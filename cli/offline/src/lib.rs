//! The commands of `isotherm` that work only on files: calibration, verification, conversion and all that belongs to
//! them. The program `isotherm` has them in addition to the live ones. The program of this crate has nothing else, and
//! links no transport, so that it runs as WebAssembly, too.

pub mod commands;
pub mod messages;
pub mod parse;
#[cfg_attr(target_os = "wasi", path = "progress_wasi.rs")]
pub mod progress;

use clap::{CommandFactory as _, FromArgMatches as _, Parser};
use commands::OfflineCommand;
use isotherm_command::{exit_code, finish};
use isotherm_support::failure::tell_plainly;
use std::env;
use std::process::ExitCode;

/// Calibrate accelerometers and gyroscopes over temperature
///
/// Contains the commands of `isotherm` that work on files.
#[derive(Debug, Parser)]
#[command(name = "isotherm", version, propagate_version = true, arg_required_else_help = true)]
struct OfflineProgram {
    /// Print only failures to stderr
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Print more messages
    ///
    /// If data are refused, calibrate then lists all faults and warnings instead of the first ten, and also those that
    /// a diagnosis explains
    #[arg(short, long, global = true)]
    verbose: bool,
    #[command(subcommand)]
    command: OfflineCommand,
}

/// The whole command line of the offline commands.
#[must_use]
pub fn command() -> clap::Command {
    finish(OfflineProgram::command().long_version(isotherm_version::LONG_VERSION), "isotherm")
}

/// Runs the program with the command line of this process.
#[must_use]
pub fn main() -> ExitCode {
    let arguments: Vec<_> = env::args_os().collect();
    exit_code("isotherm", tell_plainly, || match command().try_get_matches_from(&arguments) {
        Ok(matches) => {
            let OfflineProgram { quiet, verbose, command } = OfflineProgram::from_arg_matches(&matches)?;
            messages::start(quiet, verbose);
            Ok(command.run(verbose, commands::CHECKED_FILES, Vec::new))
        }
        Err(error) => Err(error),
    })
}
