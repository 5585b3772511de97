//! The commands beside the service: the feature `tools`.

pub mod calibrate;
#[cfg(feature = "campaign")]
mod campaign;
mod clean;
mod demo;
mod feed;
mod generate;
mod parse;
#[cfg(feature = "record")]
mod record;
mod regress;
mod relay;
mod replay;
mod simulate;
#[cfg(feature = "campaign")]
mod station;
pub mod verify;

use super::{Cli, clear_up_on_signals, options, written};
use crate::failure::{Exit, Failure};
use crate::files::Output;
use clap::Subcommand;
use isotherm_client::Domain;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The published tables of the source paper.
const PAPER: &str = include_str!("../../../../examples/tables/imu-paper.toml");

#[derive(Debug, Subcommand)]
pub enum Tool {
    Demo(demo::Demo),
    Feed(feed::Feed),
    Replay(replay::Replay),
    #[cfg(feature = "record")]
    Record(record::Record),
    Calibrate(calibrate::Calibrate),
    Regress(regress::Regress),
    Verify(verify::Verify),
    Simulate(simulate::Simulate),
    #[cfg(feature = "campaign")]
    Campaign(campaign::Campaign),
    Relay(relay::Relay),
    Clean(clean::Clean),
    Completions(generate::Completions),
    Man(generate::Man),
}

impl Tool {
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        let brief = match &self {
            Self::Replay(_) | Self::Calibrate(_) | Self::Verify(_) | Self::Man(_) => true,
            Self::Simulate(simulate) => simulate.is_brief(),
            _ => false,
        };
        if brief {
            clear_up_on_signals()?;
        }
        match self {
            Self::Demo(demo) => demo.run(domain),
            Self::Feed(feed) => feed.run(domain),
            Self::Replay(replay) => replay.run(),
            #[cfg(feature = "record")]
            Self::Record(record) => record.run(domain),
            Self::Calibrate(calibrate) => calibrate.run(),
            Self::Regress(regress) => regress.run(),
            Self::Verify(verify) => verify.run(),
            Self::Simulate(simulate) => simulate.run(&domain),
            #[cfg(feature = "campaign")]
            Self::Campaign(campaign) => campaign.run(domain),
            Self::Relay(relay) => relay.run(&domain),
            Self::Clean(clean) => clean.run(&domain),
            Self::Completions(completions) => completions.run(),
            Self::Man(man) => man.run(),
        }
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
