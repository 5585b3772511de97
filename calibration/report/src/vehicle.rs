//! The page of the calibrations of all IMUs of a vehicle, a section each.

use crate::page::{NoteKind, Page};
use crate::warm_up;
use isotherm_campaign::Campaign;
use isotherm_fit::{CalibrationOutcome, CampaignSource};

/// What became of an IMU of a vehicle: its calibration at one attitude, with where it comes from, or why there is no
/// table.
pub type Outcome<'a> = Result<(&'a Campaign, &'a CalibrationOutcome, &'a CampaignSource), &'a str>;

/// The page as HTML, with the IMUs by their names. `source` is where the calibrations come from, in words.
#[must_use]
pub fn html(source: &str, imus: &[(&str, Outcome<'_>)]) -> String {
    let names: Vec<_> = imus.iter().map(|(name, _)| *name).collect();
    let mut page = Page::new(&format!("Calibration of {} at one attitude", names.join(", ")), source);
    for (name, outcome) in imus {
        page.begin_part(name, name);
        match outcome {
            Ok((campaign, CalibrationOutcome::WarmUp(found), source)) => {
                warm_up::fill(&mut page, campaign, found, source);
            }
            Ok(_) => {}
            Err(reason) => page.note(NoteKind::Bad, &format!("{name} is dropped"), reason),
        }
    }
    page.finish()
}
