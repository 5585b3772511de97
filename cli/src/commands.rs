//! The commands, one file each. A command parses its arguments, calls a library, prints messages and returns the exit
//! code.

mod acquire;
mod campaign;
mod check;
mod clean;
mod common;
mod explain;
mod feed;
mod generate;
mod record;
mod relay;
mod simulate;
mod top;

use clap::Subcommand;
use isotherm_client::Domain;
use isotherm_demo::Demo;
use isotherm_files::remove_unfinished_on_signals;
use isotherm_offline::commands::OfflineCommand;
use isotherm_service::commands::install::Install;
use isotherm_service::commands::no_domain;
use isotherm_service::commands::reload::Reload;
use isotherm_service::commands::rollback::Rollback;
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
    Status(Status),
    Install(Install),
    Reload(Reload),
    Top(top::Top),
    #[command(arg = no_domain())]
    Demo(Demo),
    Acquire(acquire::Acquire),
    Feed(feed::Feed),
    Record(record::Record),
    #[command(flatten)]
    Offline(OfflineCommand),
    Simulate(Box<simulate::Simulate>),
    Campaign(campaign::CampaignCommand),
    Rollback(Rollback),
    Relay(relay::Relay),
    Clean(clean::Clean),
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
            Self::Status(status) => status.run(domain),
            Self::Install(install) => install.run(&domain),
            Self::Reload(reload) => reload.run(domain),
            Self::Top(top) => top.run(domain),
            Self::Demo(demo) => demo.run(domain),
            Self::Acquire(acquire) => acquire.run(domain),
            Self::Feed(feed) => feed.run(domain),
            Self::Record(record) => record.run(domain),
            Self::Offline(offline) => offline.run(verbose, check::ALL_FILES, explain::live_topics),
            Self::Simulate(simulate) => simulate.run(&domain),
            Self::Campaign(campaign) => campaign.run(domain),
            Self::Rollback(rollback) => rollback.run(&domain),
            Self::Relay(relay) => relay.run(&domain),
            Self::Clean(clean) => clean.run(&domain),
            Self::Completions(completions) => completions.run(),
            Self::Man(man) => man.run(),
        }
    }

    /// Whether the command writes a log of its own, with times, in place of messages.
    pub(crate) const fn logs(&self, quiet: bool) -> bool {
        match self {
            Self::Serve(_) | Self::Relay(_) => true,
            Self::Acquire(acquire) => acquire.logs() && !quiet,
            Self::Campaign(campaign) => campaign.logs(),
            _ => false,
        }
    }

    /// Whether a live command writes files, ends by itself and registers no signals of its own.
    fn writes_and_ends(&self) -> bool {
        match self {
            Self::Feed(_) | Self::Man(_) => true,
            Self::Simulate(simulate) => simulate.writes_and_ends(),
            _ => false,
        }
    }
}
