//! The Isotherm daemon: receives raw samples over shared memory, compensates them, publishes increments.
//!
//! The program `isothermd` calls [`main`]. `isotherm serve`, `check`, `status`, `install`,
//! `rollback` and `reload` are the same [`commands`].
//! Other programs use this library to [`create`] streams in a domain and to [`clean`] it.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_service::config::Config;
//! use std::path::Path;
//!
//! let text = include_str!("../../examples/service.toml");
//! let config = Config::from_toml(text, Path::new("/etc/isotherm"))?;
//! assert_eq!((config.imus.len(), config.workers()), (2, 1));
//! assert_eq!(config.imus[0].table, Path::new("/etc/isotherm/tables/imu-paper.toml"));
//! # Ok(())
//! # }
//! ```

pub mod clean;
pub mod commands;
pub mod config;
mod config_source;
mod control;
mod crash;
pub mod create;
mod early_death;
mod events;
mod guard;
mod imu;
mod keeper;
mod leftovers;
mod lock;
pub mod logging;
mod memory;
mod reload;
mod session;
mod source;
mod start;
mod startup;
mod status;
mod systemd;
mod threads;
mod windows;
pub mod worker;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use commands::install::Install;
use commands::no_domain;
use commands::reload::Reload;
use commands::rollback::Rollback;
use commands::serve::Serve;
use commands::status::Status;
use isotherm_command::check::{Check, CheckedFiles};
use isotherm_command::explain::{Explain, topics};
use isotherm_shared::kind::FileKind;
use isotherm_support::failure::{Exit, Failure, shown};
pub use source::{StatusSource, StatusWait};
use std::path::Path;
use std::process::ExitCode;

/// Serve compensated increments, as a daemon
///
/// Compensates the samples of accelerometers and gyroscopes for temperature, live over shared memory. This program has
/// only the daemon and its tools.
#[derive(Debug, Parser)]
#[command(
    name = "isothermd",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    after_help = "Examples:
  isothermd serve --imu imu-a=imu-a.toml
  isothermd status
`isotherm` has these commands too, and the tools: calibrate, feed, replay, record and the others."
)]
struct Daemon {
    /// Join the domain of this name
    ///
    /// A service and clients of different domains never connect to each other.
    ///
    /// Default: the domain that ISOTHERM_DOMAIN names, or "default"
    #[arg(long, global = true, value_name = "NAME")]
    domain: Option<String>,
    #[command(subcommand)]
    command: DaemonCommand,
}

#[derive(Debug, Subcommand)]
enum DaemonCommand {
    Serve(Serve),
    #[command(arg = no_domain())]
    Check(Check),
    Status(Status),
    Install(Install),
    #[command(arg = no_domain())]
    Rollback(Rollback),
    Reload(Reload),
    #[command(arg = no_domain())]
    Explain(Explain),
}

impl Daemon {
    fn run(self) -> Result<(), Failure> {
        let domain = commands::domain(self.domain.as_deref())?;
        match self.command {
            DaemonCommand::Serve(serve) => serve.run(&domain),
            DaemonCommand::Check(check) => {
                check.run(CheckedFiles { laboratory, recording: None, configuration: commands::check::configuration })
            }
            DaemonCommand::Status(status) => status.run(domain),
            DaemonCommand::Install(install) => install.run(&domain),
            DaemonCommand::Rollback(rollback) => rollback.run(&domain),
            DaemonCommand::Reload(reload) => reload.run(domain),
            DaemonCommand::Explain(explain) => explain.run(&topics()),
        }
    }
}

/// Files of the laboratory: this program recognises them but does not read them.
fn laboratory(kind: FileKind, _: &str, path: &Path) -> Result<String, Failure> {
    let message = format!("{}: {}; `isotherm check` reads it", shown(path), kind.name());
    Err(Failure::new(Exit::Usage, message))
}

/// The command line of the program `isothermd`, also for its manual pages. `--version` prints `long_version` after the
/// name.
#[must_use]
pub fn command(long_version: &'static str) -> clap::Command {
    commands::finish(Daemon::command().long_version(long_version), "isothermd")
}

/// The program `isothermd`: runs the command of the process's command line.
#[must_use]
pub fn main(long_version: &'static str) -> ExitCode {
    commands::exit_code("isothermd", || {
        let matches = command(long_version).try_get_matches()?;
        Ok(Daemon::from_arg_matches(&matches)?.run())
    })
}
