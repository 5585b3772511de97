//! `isotherm`: the compensation service and the tools around it.
//!
//! A library so that a bench can be the service in one of its processes, and so that what reads untrusted input can be fuzzed; the program
//! is [`main`].

#[cfg(feature = "campaign")]
mod campaign;
#[cfg(feature = "tools")]
mod clean;
mod cli;
pub mod config;
mod control;
mod create;
mod failure;
mod files;
#[cfg(feature = "campaign")]
pub mod instruments;
mod leftovers;
mod logging;
#[cfg(feature = "metrics")]
mod metrics;
#[cfg(feature = "record")]
mod record;
mod reload;
#[cfg(feature = "tools")]
mod samples;
mod served;
mod sigbus;
#[cfg(feature = "campaign")]
mod station;
mod status;
mod systemd;
mod threads;
#[cfg(feature = "top")]
mod top;
mod windows;
pub mod worker;

use clap::Parser as _;
use failure::Exit;
use std::io::Write as _;
use std::process::ExitCode;

/// The program: does what the process's command line asks for.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match cli::Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version go to stdout and are no failure; a closed pipe is nobody's either.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { Exit::Usage as u8 } else { 0 });
        }
    };
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let _ = writeln!(std::io::stderr(), "isotherm: {failure}");
            ExitCode::from(failure.exit as u8)
        }
    }
}
