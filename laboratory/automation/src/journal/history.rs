//! The state of a campaign, from the lines of its journal.

use super::entry::{Entry, JournalLine, KeptStep};
use crate::stamp::Stamp;
use isotherm_shared::names::ImuId;

/// The state of a campaign that the lines of its journal give.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Complete units, in order.
    pub kept: Vec<KeptStep>,
    /// The set point that is reached \[degC\], and since when; `None` if none is.
    pub reached: Option<(f64, Stamp)>,
    /// When the last unit was kept; `None` if none was.
    pub kept_at: Option<Stamp>,
    /// The IMUs of a batch that are dropped, with the reason of each.
    pub dropped: Vec<(String, String)>,
    /// Whether a runner has started.
    pub begun: bool,
    /// Whether the instruments are in a confirmed safe state since the last runner.
    pub safe: bool,
}

impl History {
    /// Why this IMU of a batch is dropped; `None` if it is not.
    #[must_use]
    pub fn reason_dropped(&self, imu: &ImuId) -> Option<&str> {
        self.dropped.iter().find(|(dropped, _)| dropped == imu.as_str()).map(|(_, reason)| reason.as_str())
    }
}

/// The state that the lines of a journal give.
pub fn history(lines: &[JournalLine]) -> History {
    let mut history = History::default();
    for line in lines {
        match &line.entry {
            Entry::Started { .. } => {
                (history.begun, history.safe) = (true, false);
                if history.kept.is_empty() {
                    // Nothing is missing of them yet.
                    history.dropped.clear();
                }
            }
            Entry::Kept(kept) => {
                history.kept.push(kept.clone());
                history.kept_at = Some(line.at.clone());
            }
            Entry::Reached { set_point_c } => history.reached = Some((*set_point_c, line.at.clone())),
            Entry::Dropped { reason } => history.dropped.extend(line.imu.clone().map(|imu| (imu, reason.clone()))),
            Entry::Begin { .. } | Entry::Left => history.reached = None,
            Entry::Safe { certain, .. } => (history.reached, history.safe) = (None, *certain),
            _ => {}
        }
    }
    history
}
