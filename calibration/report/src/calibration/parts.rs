//! What the sections of a calibration's page share.

use crate::page::{Cell, NoteKind};
use isotherm_campaign::{Campaign, Position};
use isotherm_fit::{CalibratedTriad, Calibration, CampaignSource};

/// The three quantities of a sensor.
pub(super) const QUANTITY_NAMES: [&str; 3] = ["Bias", "K+", "K-"];

pub(super) struct CalibrationPage<'a> {
    pub(super) campaign: &'a Campaign,
    pub(super) calibration: &'a Calibration,
    pub(super) source: &'a CampaignSource,
    /// File and line of a row.
    pub(super) locate: &'a dyn Fn(u64) -> String,
    /// The accelerometers, and the gyroscopes if there are any.
    pub(super) triads: Vec<CalibratedTriad<'a>>,
}

/// The cell of a dwell or turn with a finding.
pub(super) fn remark() -> Cell {
    Cell::Verdict(NoteKind::Warning, "see result".to_owned())
}

/// An angle of the turntable in a position, outer or inner; a dash without angles.
pub(super) fn angle(position: &Position, axis: usize) -> Cell {
    Cell::Number(position.angles.map_or_else(|| "-".to_owned(), |angles| angles[axis].to_string()))
}
