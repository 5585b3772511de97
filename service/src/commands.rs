//! The commands of the daemon, one file each, and what the programs that join a domain share.

pub mod check;
pub mod reload;
pub mod serve;
pub mod status;

use crate::logging;
use isotherm_client::Domain;
pub use isotherm_command::{finish, no_domain};
use isotherm_support::failure::{Exit, Failure};
use std::process::ExitCode;

/// The domain that the command line names, otherwise the one that the environment names, otherwise the default.
///
/// # Errors
/// If it is not a valid domain.
pub fn domain(name: Option<&str>) -> Result<Domain, Failure> {
    isotherm_client::domain(name).map_err(|error| Failure::new(Exit::Usage, error.to_string()))
}

/// Runs a program that may write a log: as [`isotherm_command::exit_code`], and what waits to be written is written.
pub fn exit_code(program: &str, run: impl FnOnce() -> Result<Result<(), Failure>, clap::Error>) -> ExitCode {
    let code = isotherm_command::exit_code(program, logging::tell_last, run);
    logging::flush();
    code
}
