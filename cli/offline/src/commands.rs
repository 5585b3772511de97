//! The commands, one file each. A command parses its arguments, calls a library, prints messages and returns the exit
//! code.

mod arguments;
mod calibrate;
mod check;
pub mod common;
mod compare;
mod convert;
mod describe;
mod explain;
mod export;
mod import;
mod noise;
mod part;
mod regress;
mod replay;
mod verify;

pub use check::CHECKED_FILES;

use clap::Subcommand;
use isotherm_command::check::{Check, CheckedFiles};
use isotherm_command::explain::Topic;
use isotherm_command::no_domain;
use isotherm_files::remove_unfinished_on_signals;
use isotherm_support::failure::Failure;

/// The commands that work on files.
#[derive(Debug, Subcommand)]
pub enum OfflineCommand {
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "the documentation of a variant would be its help, which its arguments have")]
    Check(Check),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Replay(replay::Replay),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Convert(convert::Convert),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Calibrate(Box<calibrate::Calibrate>),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Regress(regress::Regress),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Verify(verify::Verify),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Compare(compare::Compare),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Noise(noise::NoiseCommand),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Describe(describe::Describe),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Export(export::Export),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Import(import::Import),
    #[command(arg = no_domain())]
    #[allow(missing_docs, reason = "as above")]
    Explain(explain::ExplainName),
    #[command(arg = no_domain(), hide = true)]
    #[allow(missing_docs, reason = "as above")]
    Arguments(arguments::Arguments),
}

impl OfflineCommand {
    /// Runs the command. `checked` is what `check` validates, and `topics` what `explain` has in addition.
    ///
    /// # Errors
    /// The failure names phase, cause and remedy, and has the exit code.
    pub fn run(self, verbose: bool, checked: CheckedFiles, topics: fn() -> Vec<Topic>) -> Result<(), Failure> {
        if !matches!(
            self,
            Self::Check(_) | Self::Regress(_) | Self::Explain(_) | Self::Describe(_) | Self::Arguments(_)
        ) {
            remove_unfinished_on_signals()?;
        }
        match self {
            Self::Check(check) => check.run(checked),
            Self::Replay(replay) => replay.run(),
            Self::Convert(convert) => convert.run(),
            Self::Calibrate(calibrate) => calibrate.run(verbose),
            Self::Regress(regress) => regress.run(),
            Self::Verify(verify) => verify.run(),
            Self::Compare(compare) => compare.run(),
            Self::Noise(noise) => noise.run(),
            Self::Export(export) => export.run(),
            Self::Import(import) => import.run(),
            Self::Describe(describe) => describe.run(),
            Self::Explain(explain) => explain.run(topics()),
            Self::Arguments(arguments) => arguments.run(crate::command()),
        }
    }
}
