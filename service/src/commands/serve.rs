//! `serve`: runs the service.

use crate::config_source::ConfigSource;
use crate::control::{self, ServiceEnd};
use crate::lock::DomainLock;
use crate::logging::{self, LogFormat};
use clap::Args;
use isotherm_client::{Domain, ImuId};
use isotherm_files::Trust;
use isotherm_support::failure::{Exit, Failure};
use std::env;
use std::os::unix::process::CommandExt as _;
use std::path::PathBuf;
use std::process::Command;

/// Run the compensation service until SIGTERM or SIGINT
///
/// A table file that changes is loaded automatically. SIGHUP loads all tables again.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm serve --imu imu-a=tables/imu-a.toml\n  isotherm serve --config /etc/isotherm/service.toml --log-format json"
)]
pub struct Serve {
    /// Read this configuration file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Serve an IMU with its coefficient table
    ///
    /// Can be repeated. The IMUs are served in addition to those of the configuration.
    #[arg(long, value_name = "ID=TABLE", value_parser = imu)]
    imu: Vec<(ImuId, PathBuf)>,
    /// Serve IMUs whose table does not exist yet
    ///
    /// Its increments are NaN until the table file appears.
    #[arg(long)]
    allow_uncalibrated: bool,
    /// Accept files that other users can write
    ///
    /// Without this option, the service refuses a configuration or a table that everybody can write, or that belongs to
    /// a user other than this one and root.
    #[arg(long)]
    allow_world_writable: bool,
    /// Choose the format of log lines
    #[arg(long, value_enum, default_value_t, value_name = "FORMAT")]
    log_format: LogFormat,
}

impl Serve {
    /// Runs the service until SIGTERM or SIGINT.
    ///
    /// # Errors
    /// Why it could not start or continue.
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        logging::start(self.log_format);
        let Self { config, imu, allow_uncalibrated, allow_world_writable, .. } = self;
        let trust = Trust::owned_unless(allow_world_writable);
        let source = ConfigSource { file: config, imus: imu, trust };
        match control::run(domain, source, allow_uncalibrated)? {
            ServiceEnd::Stopped => Ok(()),
            ServiceEnd::BeginsAnew(lock) => Err(begin_anew(&lock)),
        }
    }
}

/// Executes this program again with the same arguments, as the same process. Returns only if that fails.
fn begin_anew(lock: &DomainLock) -> Failure {
    logging::flush();
    let mut arguments = env::args_os();
    // The program may have been replaced meanwhile; this is the one that runs.
    let mut program = Command::new("/proc/self/exe");
    if let Some(name) = arguments.next() {
        program.arg0(name);
    }
    let error = match lock.keep_over_exec() {
        Ok(()) => program.args(arguments).exec(),
        Err(error) => error,
    };
    Failure::new(Exit::Failed, format!("restarting: executing this program again: {error}; start the service"))
}

fn imu(text: &str) -> Result<(ImuId, PathBuf), String> {
    let (id, table) = text.split_once('=').ok_or("give ID=TABLE, for example imu-a=tables/imu-a.toml")?;
    let id: ImuId = id.parse().map_err(|error| format!("{error}"))?;
    if table.is_empty() {
        return Err("the path of the table is missing".to_owned());
    }
    Ok((id, table.into()))
}
