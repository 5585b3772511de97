//! The commands, one file each. A command parses its arguments, calls a library, prints messages and returns the exit
//! code.

mod acquire;
mod calibrate;
mod campaign;
mod check;
mod clean;
mod common;
mod compare;
mod convert;
mod explain;
mod export;
mod feed;
mod generate;
mod import;
mod noise;
mod part;
mod record;
mod regress;
mod relay;
mod repair;
mod replay;
mod rollback;
mod simulate;
mod top;
mod verify;

use clap::Subcommand;
use isotherm_client::Domain;
use isotherm_demo::Demo;
use isotherm_files::remove_unfinished_on_signals;
use isotherm_service::commands::check::Check;
use isotherm_service::commands::reload::Reload;
use isotherm_service::commands::serve::Serve;
use isotherm_service::commands::status::Status;
use isotherm_support::failure::Failure;

/// Commands that join no domain.
pub(crate) const WITHOUT_DOMAIN: [&str; 22] = [
    "calibrate",
    "campaign check",
    "campaign status",
    "campaign stop",
    "check",
    "compare",
    "completions",
    "convert",
    "demo",
    "explain",
    "export",
    "import",
    "man",
    "noise",
    "regress",
    "repair",
    "replay",
    "rollback",
    "simulate campaign",
    "simulate ramp",
    "simulate run",
    "verify",
];

/// The commands of the program.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Serve(Serve),
    Check(Check),
    Status(Status),
    Reload(Reload),
    Top(top::Top),
    Demo(Demo),
    Acquire(acquire::Acquire),
    Feed(feed::Feed),
    Replay(replay::Replay),
    Record(record::Record),
    Repair(repair::Repair),
    Convert(convert::Convert),
    Calibrate(Box<calibrate::Calibrate>),
    Regress(regress::Regress),
    Verify(verify::Verify),
    Compare(compare::Compare),
    Noise(noise::Noise),
    Export(export::Export),
    Import(import::Import),
    Simulate(Box<simulate::Simulate>),
    Campaign(campaign::CampaignCommand),
    Rollback(rollback::Rollback),
    Relay(relay::Relay),
    Clean(clean::Clean),
    Explain(explain::Explain),
    Completions(generate::Completions),
    Man(generate::Man),
}

impl Command {
    /// Runs the command. `program` is the definition of the whole command line, for completions and manual pages.
    ///
    /// # Errors
    /// The failure names phase, cause and remedy, and has the exit code.
    pub(crate) fn run(self, domain: Domain, program: clap::Command) -> Result<(), Failure> {
        if self.writes_and_ends() {
            remove_unfinished_on_signals()?;
        }
        match self {
            Self::Serve(serve) => serve.run(&domain),
            Self::Check(check) => check.run(check::laboratory_file, Some(check::recording)),
            Self::Status(status) => status.run(domain),
            Self::Reload(reload) => reload.run(domain),
            Self::Top(top) => top.run(domain),
            Self::Demo(demo) => demo.run(domain),
            Self::Acquire(acquire) => acquire.run(domain),
            Self::Feed(feed) => feed.run(domain),
            Self::Replay(replay) => replay.run(),
            Self::Record(record) => record.run(domain),
            Self::Repair(repair) => repair.run(),
            Self::Convert(convert) => convert.run(),
            Self::Calibrate(calibrate) => calibrate.run(),
            Self::Regress(regress) => regress.run(),
            Self::Verify(verify) => verify.run(),
            Self::Compare(compare) => compare.run(),
            Self::Noise(noise) => noise.run(),
            Self::Export(export) => export.run(),
            Self::Import(import) => import.run(),
            Self::Simulate(simulate) => simulate.run(&domain),
            Self::Campaign(campaign) => campaign.run(domain),
            Self::Rollback(rollback) => rollback.run(),
            Self::Relay(relay) => relay.run(&domain),
            Self::Clean(clean) => clean.run(&domain),
            Self::Explain(explain) => explain.run(),
            Self::Completions(completions) => completions.run(program),
            Self::Man(man) => man.run(program),
        }
    }

    /// Whether the command writes files, ends by itself and registers no signals of its own.
    fn writes_and_ends(&self) -> bool {
        match self {
            Self::Feed(_)
            | Self::Replay(_)
            | Self::Calibrate(_)
            | Self::Verify(_)
            | Self::Compare(_)
            | Self::Convert(_)
            | Self::Repair(_)
            | Self::Noise(_)
            | Self::Export(_)
            | Self::Import(_)
            | Self::Man(_) => true,
            Self::Simulate(simulate) => simulate.writes_and_ends(),
            _ => false,
        }
    }
}
