//! The `[provenance]` section that `calibrate` writes below a table: the origin of the table and its uncertainty. It is
//! not part of the digest, so an edited value passes unnoticed. It is for people and scripts. Programs read from it
//! `gravity_local` and Earth's rate, which `verify` takes if the user states none, and the time and the errors of the
//! table, see [`Origin`] and [`StatedErrors`](isotherm_shared::table::StatedErrors).

mod device;
mod document;
mod gyroscopes;
mod hash;
mod origin;
mod source;
mod transients;
mod tumble;
mod turntable;
mod warm_up;

pub use hash::{HashingStream, sha256};
pub use origin::{CurveErrors, Origin, TableFile};
pub use source::{CampaignSource, tool};

use crate::outcome::CalibrationOutcome;
use document::sealed;
use isotherm_campaign::Campaign;

impl CalibrationOutcome {
    /// The text of the table file: the sealed table and its provenance. The text is read back and compared.
    ///
    /// # Errors
    /// If the text does not give the same table, or if the provenance cannot be written.
    pub fn sealed(&self, campaign: &Campaign, source: &CampaignSource) -> Result<String, String> {
        let table = self.table();
        match self {
            Self::Campaign(found) => sealed(campaign, table, turntable::provenance(campaign, found, source)),
            Self::Ramps(found) => sealed(campaign, table, transients::RampsProvenance::of(campaign, found, source)),
            Self::WarmUp(found) => sealed(campaign, table, warm_up::WarmUpProvenance::of(campaign, found, source)),
            Self::Tumble(found) => sealed(campaign, table, tumble::TumbleProvenance::of(campaign, found, source)),
        }
    }
}
