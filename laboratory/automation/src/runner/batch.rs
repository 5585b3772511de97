//! Which IMUs of a batch go on, and which are dropped.

use super::Runner;
use crate::journal::Entry;
use crate::progress::DroppedImu;
use crate::streams::FailedImu;
use isotherm_support::failure::Failure;

impl Runner<'_> {
    /// Drops the IMUs of a batch that have spoiled the unit in progress too often.
    pub(super) fn drop_spoilers(&mut self) -> Result<(), Failure> {
        while let Some(spoiler) = self.streams.spoiler(self.machine.is_last_attempt()) {
            if !self.drop_all(vec![spoiler])? {
                break;
            }
        }
        Ok(())
    }

    /// Drops these IMUs of a batch, unless none would be left. Returns whether one is dropped.
    pub(super) fn drop_all(&mut self, failed: Vec<FailedImu>) -> Result<bool, Failure> {
        let mut is_dropped = false;
        for FailedImu { imu, reason } in failed {
            if !self.may_drop || !self.streams.has_others() {
                break;
            }
            let reason = format!("at {}: {reason}", self.unit_name());
            let plan = self.streams.drop_imu(imu);
            self.trends.leave_out(imu);
            self.machine.renew_attempts();
            self.progress.event(&format!("{} is dropped {reason}", plan.imu));
            self.journal.about(Some(&plan.imu));
            let noted = self.journal.write_synced(Entry::Dropped { reason: reason.clone() });
            self.journal.about(None);
            noted?;
            self.dropped.push(DroppedImu { imu: plan.imu.to_string(), reason });
            is_dropped = true;
        }
        Ok(is_dropped)
    }
}
