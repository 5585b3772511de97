//! A fitted table, and its installation.

use crate::in_force::InForce;
use isotherm_client::Domain;
use isotherm_fit::Calibration;
use isotherm_install::{NewTable, TableInstaller};
use isotherm_support::failure::{Failure, tell};
use std::path::Path;

/// A fitted table, and the one that it may replace.
pub(super) struct FittedTable {
    pub(super) calibration: Calibration,
    /// The text of its file.
    pub(super) text: String,
    pub(super) in_force: Option<InForce>,
}

impl FittedTable {
    pub(super) fn digest(&self) -> String {
        self.calibration.table.digest().to_string()
    }

    /// Installs the table, which is in the file `source`, as `target`, unless it is there already.
    pub(super) fn install(&self, source: &Path, target: &Path, domain: &Domain) -> Result<(), Failure> {
        let table = &self.calibration.table;
        let installer = TableInstaller::lock(domain, &table.content().imu, target)?;
        installer.settle()?;
        installer.check_unchanged(self.in_force.as_ref().map(|in_force| in_force.state))?;
        let installed = installer.install(&NewTable { table, text: &self.text, source, is_accepted: false })?;
        installed.iter().for_each(|line| print_message(line));
        Ok(())
    }
}

pub(super) fn print_message(message: &str) {
    tell("isotherm", message);
}
