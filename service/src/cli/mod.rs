//! The command line: one file a command.

mod calibrate;
mod check;
mod clean;
mod demo;
mod feed;
mod parse;
mod regress;
mod replay;
mod serve;
mod simulate;
mod status;
mod verify;

use crate::failure::{Exit, Failure};
use clap::{Parser, Subcommand};
use isotherm_client::{Domain, Options};
use std::io;
use std::path::Path;
use std::time::Duration;

/// The published tables of the source paper.
const PAPER: &str = include_str!("../../../examples/tables/imu-paper.toml");

/// Compensates accelerometer pulses for temperature, live over shared memory and offline.
#[derive(Debug, Parser)]
#[command(name = "isotherm", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// The world of service and clients; two domains never meet
    ///
    /// The one that ISOTHERM_DOMAIN names, or "default", unless given
    #[arg(long, global = true, value_name = "NAME")]
    domain: Option<String>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Demo),
    Serve(serve::Serve),
    Feed(feed::Feed),
    Replay(replay::Replay),
    Calibrate(calibrate::Calibrate),
    Regress(regress::Regress),
    Verify(verify::Verify),
    Check(check::Check),
    Simulate(simulate::Simulate),
    Status(status::Status),
    Clean(clean::Clean),
}

impl Cli {
    /// Does what the command line asks for.
    ///
    /// # Errors
    /// Phase, cause and remedy, with the exit code.
    pub fn run(self) -> Result<(), Failure> {
        let domain = isotherm_client::domain(self.domain.as_deref());
        let domain = domain.map_err(|error| Failure::new(Exit::Usage, error.to_string()))?;
        match self.command {
            Command::Demo(demo) => demo.run(domain),
            Command::Serve(serve) => serve.run(&domain),
            Command::Feed(feed) => feed.run(domain),
            Command::Replay(replay) => replay.run(),
            Command::Calibrate(calibrate) => calibrate.run(),
            Command::Verify(verify) => verify.run(),
            Command::Regress(regress) => regress.run(),
            Command::Check(check) => check.run(),
            Command::Simulate(simulate) => simulate.run(),
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

/// Refuses to write increments over the recording that they come from.
fn not_the_same(input: &Path, output: Option<&Path>) -> Result<(), Failure> {
    let regular = |path: &Path| std::fs::canonicalize(path).ok().filter(|path| path.is_file());
    match (regular(input), output.and_then(regular)) {
        (Some(input), Some(output)) if input == output => {
            let message = format!("{} is the recording itself; write the increments to another file", output.display());
            Err(Failure::new(Exit::Usage, message))
        }
        _ => Ok(()),
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
