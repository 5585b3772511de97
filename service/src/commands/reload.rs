//! `reload`: takes a table that the service refuses because it changes too much.

use super::digest;
use crate::config::Config;
use clap::Args;
use isotherm_client::{ConnectError, Domain, ImuId, Options, StatusError, fetch_status, prepare};
use isotherm_files::Trust;
use isotherm_install::Acceptance;
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use isotherm_support::failure::{Exit, Failure, one_line, tell};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// How long the service may take until it has read the file and has its table in force; it looks 20 times a second.
const TAKEN_LIMIT: Duration = Duration::from_secs(3);
/// What the service has read before the acceptance was removed is in force after this time.
const WITHDRAWAL: Duration = Duration::from_millis(300);
/// How long keeping the table may take.
const KEPT_LIMIT: Duration = Duration::from_secs(10);

/// Accept a table that changes too much
///
/// A service refuses a new table that differs from the one in force by more than max_change, or by more than that table
/// lets expect, and an unsealed one after a sealed one. This command accepts it.
///
/// The service accepts only the table with this digest. Its log message and `status` show the digest. The table becomes
/// the new anchor: later tables may differ from it by at most three times their limits. If the digest is that of the
/// table in force, that table becomes the anchor. The command waits until the table is kept. If no service is running,
/// the next one accepts the table when it starts.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm reload --imu imu-a --accept sha256:DIGEST")]
pub struct Reload {
    /// The IMU
    #[arg(long, value_name = "ID")]
    imu: ImuId,
    /// Accept the table with this digest
    ///
    /// The digest is sha256: and 64 hexadecimal digits.
    #[arg(long, value_name = "DIGEST", value_parser = digest)]
    accept: String,
}

impl Reload {
    /// Accepts the table, and waits until a running service has it in force and has kept it.
    ///
    /// # Errors
    /// If the service does not serve the IMU, its file has another table, the acceptance cannot be written, or the
    /// table cannot be kept.
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        let Self { imu, accept } = self;
        prepare(&domain)?;
        let written = Acceptance::write(&domain, &imu, &accept);
        let acceptance = written.map_err(|error| Failure::io("writing in", Path::new(domain.root_path()), &error))?;
        let options = Options::new(domain, Duration::ZERO);
        let (begun, mut withdrawn) = (Instant::now(), None::<Instant>);
        loop {
            let status = match fetch_status(&options) {
                Err(StatusError::Connect(ConnectError::NoService(_))) if withdrawn.is_none() => {
                    tell(
                        "isotherm",
                        format_args!("no service runs; the next one takes this table of {imu} at its start"),
                    );
                    return Ok(());
                }
                status => status.inspect_err(|_| acceptance.remove())?,
            };
            let found = status.imus.iter().find(|found| found.id == imu.as_str());
            // The service makes an accepted table the anchor, too.
            let taken = found.filter(|found| found.table.as_ref() == Some(&accept) && found.anchor == found.table);
            match taken {
                Some(ImuStatus { table_kept: true, .. }) => {
                    tell("isotherm", format_args!("{imu}: {accept} is in force, and kept"));
                    judge_configuration(&status);
                    return Ok(());
                }
                Some(ImuStatus { keep_error: Some(error), .. }) => return Err(not_kept(&imu, error)),
                Some(_) if begun.elapsed() > KEPT_LIMIT => {
                    let limit = KEPT_LIMIT.as_secs();
                    return Err(not_kept(
                        &imu,
                        &format!("the disk of the state folder has not answered for {limit} s"),
                    ));
                }
                None if withdrawn.is_some_and(|withdrawn| withdrawn.elapsed() > WITHDRAWAL) => {
                    return Err(not_taken(&imu, found));
                }
                None if withdrawn.is_none() && (found.is_none() || begun.elapsed() > TAKEN_LIMIT) => {
                    acceptance.remove();
                    withdrawn = Some(Instant::now());
                }
                _ => thread::sleep(Duration::from_millis(20)),
            }
        }
    }
}

/// Judges the file of the configuration as it is now, if the service runs with the one that was kept of it.
fn judge_configuration(status: &ServiceStatus) {
    let (Some(file), Some(_)) = (&status.configuration_file, &status.configuration_error) else { return };
    match Config::load(Path::new(file), Trust::Protected) {
        Ok(_) => tell("isotherm", format_args!("{} is valid now; restart the service to use it", one_line(file))),
        Err(error) => tell(
            "isotherm",
            format_args!(
                "warning: the service runs with the last configuration that worked, since this one is refused: {error}"
            ),
        ),
    }
}

/// Why the table, which is in force, may not be known to the next start. The acceptance stays for it.
fn not_kept(imu: &ImuId, cause: &str) -> Failure {
    let message = format!(
        "{imu}: the table is in force, but it is not kept: {cause}; make room, or name another state folder and restart the service; until it \
         is kept the acceptance stays, and the next start takes the table by it"
    );
    Failure::new(Exit::Io, message)
}

/// Why the table is not taken.
fn not_taken(imu: &ImuId, found: Option<&ImuStatus>) -> Failure {
    let Some(ImuStatus { table_file, refused_table, last_reload_error, .. }) = found else {
        return Failure::new(Exit::Unavailable, format!("the service does not serve {imu}"));
    };
    let file = match (refused_table, last_reload_error) {
        (Some(refused), _) => format!("has {refused}"),
        (None, Some(error)) => format!("is refused for another reason: {error}"),
        (None, None) => "has the table that is in force".to_owned(),
    };
    Failure::new(
        Exit::Config,
        format!("{imu}: this is not the table of {}, which {file}; nothing is changed", one_line(table_file)),
    )
}
