//! The command line: one file a command.

pub mod calibrate;
#[cfg(feature = "campaign")]
mod campaign;
mod check;
mod clean;
mod demo;
mod feed;
mod parse;
mod regress;
mod replay;
mod serve;
mod simulate;
#[cfg(feature = "campaign")]
mod station;
mod status;
pub mod verify;

use crate::failure::{Exit, Failure};
use crate::files::{Output, remove_unfinished_on_signals};
use clap::{Parser, Subcommand};
use isotherm_client::{Domain, Options};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

#[cfg(feature = "campaign")]
pub use calibrate::{now, tool};

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
    #[cfg(feature = "campaign")]
    Campaign(campaign::Campaign),
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
        if match &self.command {
            Command::Replay(_) | Command::Calibrate(_) | Command::Verify(_) | Command::Check(_) => true,
            Command::Simulate(simulate) => simulate.is_brief(),
            _ => false,
        } {
            let handled = remove_unfinished_on_signals();
            handled.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        match self.command {
            Command::Demo(demo) => demo.run(domain),
            Command::Serve(serve) => serve.run(&domain),
            Command::Feed(feed) => feed.run(domain),
            Command::Replay(replay) => replay.run(),
            Command::Calibrate(calibrate) => calibrate.run(),
            Command::Verify(verify) => verify.run(),
            Command::Regress(regress) => regress.run(),
            Command::Check(check) => check.run(),
            Command::Simulate(simulate) => simulate.run(&domain),
            #[cfg(feature = "campaign")]
            Command::Campaign(campaign) => campaign.run(domain),
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

/// Refuses to write over what a command reads, and two outputs into one file.
fn apart(inputs: &[(&Path, &str)], outputs: &[Option<&Path>]) -> Result<(), Failure> {
    let regular = |path: &Path| std::fs::canonicalize(path).ok().filter(|path| path.is_file());
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    for (index, output) in outputs.iter().enumerate() {
        let Some(output) = output else { continue };
        let same = |other: &Path| *output == other || regular(output).is_some_and(|path| regular(other) == Some(path));
        if let Some((_, what)) = inputs.iter().find(|(input, _)| *input != Path::new("-") && same(input)) {
            return usage(format!("{} is {what}; write to another file", output.display()));
        }
        if outputs[..index].iter().flatten().any(|other| same(other)) {
            return usage(format!("{} is named for two outputs; give each a file of its own", output.display()));
        }
    }
    Ok(())
}

/// A whole file that is made aside and becomes visible when everything has succeeded.
struct Aside {
    path: Option<PathBuf>,
    output: Output,
}

impl Aside {
    /// Prepares it; `None` or `-` is stdout.
    fn create(path: Option<&Path>) -> Result<Self, Failure> {
        let output = Output::create(path);
        let output = output.map_err(|error| Failure::io("writing", path.unwrap_or(Path::new("stdout")), &error))?;
        Ok(Self { path: path.map(Path::to_owned), output })
    }

    /// Writes its whole text.
    fn write(mut self, text: &str) -> Result<Self, Failure> {
        let result = self.output.write_all(text.as_bytes()).and_then(|()| self.output.flush());
        written(self.path.as_deref(), result)?;
        Ok(self)
    }

    /// Makes it visible.
    fn finish(self) -> Result<(), Failure> {
        written(self.path.as_deref(), self.output.finish())
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
