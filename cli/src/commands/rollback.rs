//! `rollback`: brings the predecessor of an installed table back.

use clap::Args;
use isotherm_automation::in_force::changes;
use isotherm_documents::load_table;
use isotherm_files::{Installation, Trust, print};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::PathBuf;
use tracing::info;

/// Restore the predecessor of an installed table
///
/// `campaign run --calibrate` keeps the table that it replaces as TABLE.previous. This command exchanges the two in one
/// step, and a running service loads the table immediately. Running the command again undoes the exchange. A
/// predecessor that is broken or of another IMU is refused.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm rollback /etc/isotherm/tables/imu-a.toml\n  isotherm rollback --imu imu-a /etc/isotherm/tables/imu-a.toml"
)]
pub(crate) struct Rollback {
    /// Name the IMU of the table
    ///
    /// Required if the installed table is broken or of another IMU.
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Exchange this installed table with its predecessor
    #[arg(value_name = "TABLE")]
    table: PathBuf,
}

impl Rollback {
    pub(crate) fn run(self) -> Result<(), Failure> {
        let failed = |exit: Exit, cause: String| Failure::new(exit, format!("{cause}; nothing is changed"));
        // What a killed installation has left is settled now; until the end no other one changes the files.
        let installation = Installation::lock(&self.table)?;
        let kept = installation.previous();
        let (place, previous) = (shown(&self.table), shown(kept));
        if !kept.exists() {
            return Err(failed(Exit::Io, format!("{place} has no predecessor: there is no {previous}")));
        }
        if !self.table.exists() {
            let cause = format!("there is no {place} to exchange; rename {previous} to it");
            return Err(failed(Exit::Io, cause));
        }
        // The installed table may be the broken one; its predecessor must be whole, and of the same IMU.
        let present = load_table(&self.table, self.imu.as_ref(), Trust::Any).map(|(table, _)| table);
        let present = present.inspect_err(|error| info!("{error}")).ok();
        let Some(imu) = self.imu.or_else(|| present.as_ref().map(|present| present.content().imu.clone())) else {
            let cause = format!("{place} is broken and cannot say whose predecessor comes back; give --imu ID");
            return Err(failed(Exit::Config, cause));
        };
        let (back, _) = load_table(kept, Some(&imu), Trust::Any).map_err(|error| {
            let failure = Failure::from(error);
            failed(failure.exit, failure.to_string())
        })?;
        if present.as_ref().is_some_and(|present| *present == back) {
            return Err(failed(Exit::Failed, format!("{previous} has the same table as {place}")));
        }
        match present {
            Some(present) => {
                changes(&present, &back).iter().for_each(|change| info!("note: {change}"));
            }
            None => info!("note: the broken table does not show whether the axes turn"),
        }
        installation.roll_back()?;
        print(&format!("{place} is {} again; its successor is kept as {previous}\n", back.digest()))
    }
}
