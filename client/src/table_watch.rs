//! Which table is in force, as an acquisition knows it: from the status when it connects, and again when an answer
//! names another table.

use crate::clock::monotonic_ns;
use isotherm_shared::names::ImuId;
use isotherm_shared::status::{ImuStatus, ServiceStatus};
use isotherm_shared::table::PulseScale;
use isotherm_shared::wire::CompensatedIncrement;

/// Pause between two questions \[ns\].
const RETRY_NS: u64 = 1_000_000_000;

/// What is known of the table in force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum KnownTable {
    /// Nothing: the status could not be read yet.
    #[default]
    Unknown,
    /// The service has no table for this IMU.
    None,
    /// The nominal interval of the table, and what one pulse stands for.
    Of(PulseScale),
}

/// The table in force.
#[derive(Debug, Default)]
pub(crate) struct TableWatch {
    pub known: KnownTable,
    /// The id of that table; 0 without one.
    settled: u64,
    /// The id in the last answer that had another one, or that of the table that is known.
    seen: u64,
    /// A question that failed is not repeated before this \[ns\].
    retry_ns: u64,
}

impl TableWatch {
    /// Takes the table in force. It may be another one than an answer has named: then that question is void, and the
    /// next such answer asks again. Returns the status of the IMU.
    pub(crate) fn learn<'a>(&mut self, status: &'a ServiceStatus, imu: &ImuId) -> Option<&'a ImuStatus> {
        let in_force = status.imus.iter().find(|known| known.id == imu.as_str());
        self.settled = in_force.map_or(0, ImuStatus::table_id);
        self.seen = self.settled;
        self.known = in_force.and_then(ImuStatus::pulse_scale).map_or(KnownTable::None, KnownTable::Of);
        in_force
    }

    /// Looks at the table of an answer.
    #[inline]
    pub(crate) const fn note(&mut self, answer: &CompensatedIncrement) {
        if answer.table != self.settled {
            self.seen = answer.table;
        }
    }

    /// Whether the service has to be asked for the table in force. Not again within a second.
    pub(crate) fn asks(&mut self) -> bool {
        if self.seen == self.settled && self.known != KnownTable::Unknown {
            return false;
        }
        let now = monotonic_ns();
        let is_due = now >= self.retry_ns;
        if is_due {
            self.retry_ns = now + RETRY_NS;
        }
        is_due
    }
}
