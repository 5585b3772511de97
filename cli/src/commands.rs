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

pub(crate) use calibrate::{renamed_options, replacement};

use clap::Subcommand;
use isotherm_client::Domain;
use isotherm_demo::Demo;
use isotherm_files::remove_unfinished_on_signals;
use isotherm_service::commands::check::Check;
use isotherm_service::commands::no_domain;
use isotherm_service::commands::reload::Reload;
use isotherm_service::commands::serve::Serve;
use isotherm_service::commands::status::Status;
use isotherm_support::failure::Failure;

/// The switch of the messages in a command that writes a log in their place.
fn hidden(name: &'static str, short: char) -> clap::Arg {
    clap::Arg::new(name).short(short).long(name).global(true).hide(true).action(clap::ArgAction::SetTrue)
}

/// The commands of the program.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    // It is that of `isothermd`, and writes a log.
    #[command(arg = hidden("quiet", 'q'), arg = hidden("verbose", 'v'))]
    Serve(Serve),
    #[command(arg = no_domain())]
    Check(Check),
    Status(Status),
    Reload(Reload),
    Top(top::Top),
    #[command(arg = no_domain())]
    Demo(Demo),
    Acquire(acquire::Acquire),
    Feed(feed::Feed),
    #[command(arg = no_domain())]
    Replay(replay::Replay),
    Record(record::Record),
    #[command(arg = no_domain())]
    Repair(repair::Repair),
    #[command(arg = no_domain())]
    Convert(convert::Convert),
    #[command(arg = no_domain())]
    Calibrate(Box<calibrate::Calibrate>),
    #[command(arg = no_domain())]
    Regress(regress::Regress),
    #[command(arg = no_domain())]
    Verify(verify::Verify),
    #[command(arg = no_domain())]
    Compare(compare::Compare),
    #[command(arg = no_domain())]
    Noise(noise::Noise),
    #[command(arg = no_domain())]
    Export(export::Export),
    #[command(arg = no_domain())]
    Import(import::Import),
    Simulate(Box<simulate::Simulate>),
    Campaign(campaign::CampaignCommand),
    #[command(arg = no_domain())]
    Rollback(rollback::Rollback),
    Relay(relay::Relay),
    Clean(clean::Clean),
    #[command(arg = no_domain())]
    Explain(explain::ExplainName),
    #[command(arg = no_domain())]
    Completions(generate::Completions),
    #[command(arg = no_domain())]
    Man(generate::Man),
}

impl Command {
    /// Runs the command.
    ///
    /// # Errors
    /// The failure names phase, cause and remedy, and has the exit code.
    pub(crate) fn run(self, domain: Domain, verbose: bool) -> Result<(), Failure> {
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
            Self::Calibrate(calibrate) => calibrate.run(verbose),
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
            Self::Completions(completions) => completions.run(),
            Self::Man(man) => man.run(),
        }
    }

    /// Whether the command writes a log of its own, with times, in place of messages.
    pub(crate) const fn logs(&self) -> bool {
        match self {
            Self::Serve(_) | Self::Relay(_) => true,
            Self::Campaign(campaign) => campaign.logs(),
            _ => false,
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
