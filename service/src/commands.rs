//! The commands of the daemon, one file each, and what the programs that join a domain share.

pub mod check;
pub mod install;
pub mod reload;
pub mod rollback;
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

/// The digest of a table as an option gives it.
fn digest(text: &str) -> Result<String, String> {
    let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    let valid = text.strip_prefix("sha256:").is_some_and(|digits| digits.len() == 64 && digits.bytes().all(is_digit));
    if valid {
        Ok(text.to_owned())
    } else {
        Err("give all of it, sha256: and 64 hexadecimal digits in lower case".to_owned())
    }
}

/// Runs a program that may write a log: as [`isotherm_command::exit_code`], and what waits to be written is written.
pub fn exit_code(program: &str, run: impl FnOnce() -> Result<Result<(), Failure>, clap::Error>) -> ExitCode {
    let code = isotherm_command::exit_code(program, logging::tell_last, run);
    logging::flush();
    code
}
