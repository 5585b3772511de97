//! The program `isotherm`: one file for each command (`commands`), the recorder, and the live screen.
//!
//! It is a library so that a bench can run the program in one of its own processes.

mod commands;
mod recorder;
mod top;

use clap::{CommandFactory as _, FromArgMatches as _, Parser};
use isotherm_offline::messages;
use isotherm_service::commands as common;
use isotherm_support::failure::Failure;
use std::env;
use std::process::ExitCode;

/// Compensate accelerometers and gyroscopes for temperature
///
/// Calibrates IMUs over temperature, and compensates their samples live, over shared memory, or offline.
#[derive(Debug, Parser)]
#[command(
    name = "isotherm",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    after_help = "Examples:
  isotherm demo                                           the whole chain, on embedded data
  isotherm serve --imu imu-a=imu-a.toml                   serve an IMU until SIGTERM
  isotherm feed --imu imu-a run.csv -o increments.csv     send it a recording, from another terminal
  isotherm status
  isotherm calibrate turntable campaign.toml -o imu-a.toml --report imu-a.html"
)]
struct Cli {
    /// Join the domain of this name
    ///
    /// A service and clients of different domains never connect to each other.
    ///
    /// Default: the domain that ISOTHERM_DOMAIN names, or "default"
    #[arg(long, global = true, value_name = "NAME")]
    domain: Option<String>,
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
    command: commands::Command,
}

impl Cli {
    /// The whole command line, for parsing, manual pages and completions.
    fn full_command() -> clap::Command {
        let command = Self::command().long_version(isotherm_version::LONG_VERSION);
        common::finish(command, "isotherm")
    }

    fn run(self) -> Result<(), Failure> {
        if !self.command.logs(self.quiet) {
            messages::start(self.quiet, self.verbose);
        }
        let domain = common::domain(self.domain.as_deref())?;
        self.command.run(domain, self.verbose)
    }
}

/// The whole command line of the program.
#[must_use]
pub fn command() -> clap::Command {
    Cli::full_command()
}

/// Runs the program with the command line of this process.
#[must_use]
pub fn main() -> ExitCode {
    let arguments: Vec<_> = env::args_os().collect();
    common::exit_code("isotherm", || match Cli::full_command().try_get_matches_from(&arguments) {
        Ok(matches) => Ok(Cli::from_arg_matches(&matches)?.run()),
        Err(error) => Err(error),
    })
}
