//! `install`: makes a table the one that the service serves.

use super::digest;
use clap::{ArgGroup, Args};
use isotherm_client::{Domain, ImuId};
use isotherm_documents::load_table_text;
use isotherm_files::{Trust, print};
use isotherm_install::{NewTable, TableInstaller, table_file};
use isotherm_shared::table::difference::TableDifference;
use isotherm_support::failure::{Exit, Failure, shown, tell};
use rustix::process::geteuid;
use std::path::PathBuf;

/// Install a table for the running service
///
/// Checks the new table, shows what changes, replaces the table in one step, and waits until the running service serves
/// it. The old table is kept as TABLE.previous, and `rollback` brings it back. If the service refuses the new table,
/// because it changes too much, the old one is put back, and the exit code is 78. Without a running service the table
/// is installed for the next start.
///
/// If the service has not judged the table within 10 s, or another installation goes on for 30 s, the exit code is 75:
/// run the same command again. The command belongs to the user of the domain, or to root.
#[derive(Debug, Args)]
#[group(skip)]
#[command(
    group = ArgGroup::new("target").required(true),
    after_help = "Examples:\n  isotherm install new.toml /etc/isotherm/tables/imu-a.toml\n  isotherm install new.toml --imu imu-a\n  isotherm install --accept sha256:DIGEST new.toml /etc/isotherm/tables/imu-a.toml"
)]
pub struct Install {
    /// Take the path that the running service reads
    ///
    /// The service must serve this IMU.
    #[arg(long, value_name = "ID", group = "target")]
    imu: Option<ImuId>,
    /// Accept this table although it changes too much
    ///
    /// The digest is sha256: and 64 hexadecimal digits, and must be that of the new table.
    #[arg(long, value_name = "DIGEST", value_parser = digest)]
    accept: Option<String>,
    /// The new table
    #[arg(value_name = "NEW")]
    new: PathBuf,
    /// Install it as this file
    #[arg(value_name = "TABLE", group = "target")]
    table: Option<PathBuf>,
}

impl Install {
    /// Installs the table.
    ///
    /// # Errors
    /// If the new table is not valid, and those of [`TableInstaller`].
    pub fn run(self, domain: &Domain) -> Result<(), Failure> {
        let Self { imu, accept, new, table } = self;
        let (table, target) = match (table, &imu) {
            (Some(table), _) => (table, None),
            (None, Some(imu)) => (table_file(domain, imu)?, Some(imu)),
            (None, None) => return Err(Failure::new(Exit::Usage, "name the file of the table, or --imu")),
        };
        let (loaded, text, _) = load_table_text(&new, target, Trust::Protected)?;
        if let Some(accept) = accept.as_ref().filter(|accept| **accept != loaded.digest().to_string()) {
            let message = format!("--accept {accept}: {} has {}", shown(&new), loaded.digest());
            return Err(Failure::new(Exit::Usage, message));
        }
        loaded.content().unlike_scale_factors().iter().for_each(|warning| {
            tell("isotherm", format_args!("{}: warning: {warning}", shown(&new)));
        });
        if geteuid().is_root() {
            tell("isotherm", format_args!("domain {:?} in {}", domain.name(), domain.root_path()));
        }
        let installer = TableInstaller::lock(domain, &loaded.content().imu, &table)?;
        installer.settle()?;
        let place = shown(&table);
        let changes = match installer.present() {
            Ok(None) => format!("{place}: there is no table yet"),
            Ok(Some(present)) if present.content().imu != loaded.content().imu => {
                let (one, other) = (&present.content().imu, &loaded.content().imu);
                let message = format!(
                    "{place} is the table of {one}, and {} is of {other}; name the file of {other}, or move {place} away; nothing is changed",
                    shown(&new)
                );
                return Err(Failure::new(Exit::Config, message));
            }
            Ok(Some(present)) if present == loaded => format!("{place} has the same table"),
            Ok(Some(present)) => TableDifference::of(&present, &loaded).summary().join("\n"),
            Err(error) => format!("what is there is no table, and is not kept: {error}"),
        };
        print(&(changes + "\n"))?;
        let new = NewTable { table: &loaded, text: &text, source: &new, is_accepted: accept.is_some() };
        print(&(installer.install(&new)?.join("\n") + "\n"))
    }
}
