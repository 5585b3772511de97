//! The command line: one file a command.

mod check;
mod serve;
mod status;
#[cfg(feature = "tools")]
mod tools;
#[cfg(feature = "top")]
mod top;

#[cfg(feature = "campaign")]
pub use tools::{calibrate, verify};

use crate::failure::{Exit, Failure};
use crate::files::remove_unfinished_on_signals;
use clap::{Parser, Subcommand};
use isotherm_client::{Domain, Options};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Of what this program was built, for a report of a fault.
const LONG_VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    "\ncommit: ",
    env!("ISOTHERM_COMMIT"),
    "\nfeatures: ",
    env!("ISOTHERM_FEATURES"),
    "\nbuilt: ",
    env!("ISOTHERM_BUILT")
);

#[cfg(feature = "tools")]
const EXAMPLES: &str = "Examples:
  isotherm demo                                           the whole chain, on embedded data
  isotherm serve --imu imu-a=imu-a.toml                   serve an IMU until SIGTERM
  isotherm feed --imu imu-a run.csv -o increments.csv     send it a recording, from another terminal
  isotherm status
  isotherm calibrate campaign.toml -o imu-a.toml --report imu-a.html
Exit codes: 0 done, 1 failed, 64 usage, 65 bad data, 69 no service, 74 input or output, 78 bad configuration or table";
#[cfg(not(feature = "tools"))]
const EXAMPLES: &str = "Examples:
  isotherm serve --imu imu-a=imu-a.toml
  isotherm status
This is a build without the tools (feature \"tools\"): calibrate, feed, replay and the others are not in it.
Exit codes: 0 done, 1 failed, 64 usage, 69 no service, 74 input or output, 78 bad configuration or table";

/// Compensates accelerometer pulses for temperature, live over shared memory and offline.
#[derive(Debug, Parser)]
#[command(
    name = "isotherm",
    version,
    long_version = LONG_VERSION,
    propagate_version = true,
    arg_required_else_help = true,
    after_help = EXAMPLES
)]
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
    Serve(serve::Serve),
    Check(check::Check),
    Status(status::Status),
    #[cfg(feature = "top")]
    Top(top::Top),
    #[cfg(feature = "tools")]
    #[command(flatten)]
    Tool(Box<tools::Tool>),
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
            Command::Serve(serve) => serve.run(&domain),
            Command::Check(check) => {
                clear_up_on_signals()?;
                check.run()
            }
            Command::Status(status) => status.run(domain),
            #[cfg(feature = "top")]
            Command::Top(top) => top.run(domain),
            #[cfg(feature = "tools")]
            Command::Tool(tool) => tool.run(domain),
        }
    }
}

/// For commands that write files and do not handle signals themselves.
fn clear_up_on_signals() -> Result<(), Failure> {
    remove_unfinished_on_signals().map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))
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
