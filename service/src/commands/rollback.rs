//! `rollback`: brings the predecessor of an installed table back.

use clap::Args;
use isotherm_client::Domain;
use isotherm_documents::load_table;
use isotherm_files::{Trust, print};
use isotherm_install::{NewTable, TableInstaller};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::difference::TableDifference;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::PathBuf;
use tracing::info;

/// Restore the predecessor of an installed table
///
/// `install` and `campaign run --calibrate` keep the table that they replace as TABLE.previous. This command installs
/// that one as `install` does, with the same exit codes, and keeps the present table as TABLE.previous, so that a
/// second call brings it back. If the predecessor is broken, of another IMU, or refused by the service, nothing is
/// changed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm rollback /etc/isotherm/tables/imu-a.toml\n  isotherm rollback --imu imu-a /etc/isotherm/tables/imu-a.toml"
)]
pub struct Rollback {
    /// Name the IMU of the table
    ///
    /// Required if the installed table is absent, broken or of another IMU.
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Exchange this installed table with its predecessor
    #[arg(value_name = "TABLE")]
    table: PathBuf,
}

impl Rollback {
    /// Exchanges the table and its predecessor.
    ///
    /// # Errors
    /// If there is no predecessor, or the service refuses it, or the two cannot be exchanged; nothing is changed then.
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        let Self { imu, table } = self;
        let place = shown(&table);
        let failed = |exit: Exit, cause: String| Failure::new(exit, format!("{cause}; nothing is changed"));
        // The installed table may be the broken one.
        let present = load_table(&table, imu.as_ref(), Trust::Any).map(|(table, _)| table);
        let present = present.inspect_err(|error| info!("{error}")).ok();
        let Some(imu) = imu.or_else(|| present.as_ref().map(|present| present.content().imu.clone())) else {
            let cause = format!("{place} does not say whose predecessor comes back; give --imu ID");
            return Err(failed(Exit::Config, cause));
        };
        let installer = TableInstaller::lock(domain, &imu, &table)?;
        let (back, text, kept) =
            installer.predecessor().map_err(|failure| failed(failure.exit, failure.to_string()))?;
        let changes = match installer.present() {
            Ok(Some(present)) if present == back && !installer.is_pending() => {
                return Err(failed(Exit::Failed, format!("{} has the same table as {place}", shown(kept))));
            }
            Ok(Some(present)) => TableDifference::of(&present, &back).summary(),
            _ => vec!["what is there does not show what changes".to_owned()],
        };
        print(&(changes.join("\n") + "\n"))?;
        let source = kept.to_owned();
        let new = NewTable { table: &back, text: &text, source: &source, is_accepted: false };
        print(&(installer.install(&new)?.join("\n") + "\n"))
    }
}
