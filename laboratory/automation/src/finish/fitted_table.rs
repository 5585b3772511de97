//! A fitted table, and its installation.

use crate::in_force::InForce;
use isotherm_files::Installation;
use isotherm_fit::Calibration;
use isotherm_support::failure::{Failure, shown, tell};
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

    /// Installs the table as `target`, unless it is in force already.
    pub(super) fn install(&self, target: &Path) -> Result<(), Failure> {
        let installation = Installation::lock(target)?;
        installation.check_unchanged(self.in_force.as_ref().map(|in_force| in_force.state))?;
        let (digest, place) = (self.digest(), shown(target));
        if self.in_force.as_ref().is_some_and(|in_force| in_force.table.digest().to_string() == digest) {
            print_message(&format!("{digest} is installed as {place} already"));
            return Ok(());
        }
        let has_predecessor = installation.install(&self.text)?;
        print_message(&format!("{digest} is installed as {place}"));
        if has_predecessor {
            let kept = shown(installation.previous());
            print_message(&format!("its predecessor is kept as {kept}; `isotherm rollback {place}` brings it back"));
        }
        Ok(())
    }
}

pub(super) fn print_message(message: &str) {
    tell("isotherm", message);
}
