//! The command line: one file a command.

mod check;
mod clean;
mod demo;
mod feed;
mod replay;
mod serve;
mod status;

use crate::failure::{Exit, Failure};
use clap::{Parser, Subcommand};
use isotherm_client::{Domain, Options};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Compensates accelerometer pulses for temperature, live over shared memory and offline.
#[derive(Debug, Parser)]
#[command(version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// The world of service and clients; two domains never meet
    #[arg(long, global = true, env = "ISOTHERM_DOMAIN", default_value = Domain::DEFAULT, value_name = "NAME")]
    domain: String,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Serve(serve::Serve),
    Feed(feed::Feed),
    Replay(replay::Replay),
    Check(check::Check),
    Status(status::Status),
    Clean(clean::Clean),
}

impl Cli {
    /// Does what the command line asks for.
    ///
    /// # Errors
    /// Phase, cause and remedy, with the exit code.
    pub fn run(self) -> Result<(), Failure> {
        let domain = isotherm_client::domain(Some(&self.domain));
        let domain = domain.map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
        match self.command {
            Command::Demo(demo) => demo.run(domain),
            Command::Serve(serve) => serve.run(&domain),
            Command::Feed(feed) => feed.run(domain),
            Command::Replay(replay) => replay.run(),
            Command::Check(check) => check.run(),
            Command::Status(status) => status.run(domain),
            Command::Clean(clean) => clean.run(&domain),
        }
    }
}

fn options(domain: Domain, timeout: Duration) -> Options {
    Options { domain, timeout }
}

/// Turns an error in writing results into a failure. A reader that has gone, as in `isotherm replay .. | head`, is none.
fn written(path: Option<&Path>, result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error)),
        Ok(()) => Ok(()),
    }
}

/// A number of seconds over 0.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    if !(seconds > 0.0 && seconds <= 1e6) {
        return Err("give a number of seconds over 0 and up to 1000000".to_owned());
    }
    Ok(Duration::from_secs_f64(seconds))
}
