//! The page of the calibrations of all IMUs of a vehicle, a section each.

use crate::page::{Cell, Column, NoteKind, Page};
use crate::warm_up;
use isotherm_campaign::Campaign;
use isotherm_fit::{BiasCurve, CalibrationOutcome, CampaignSource, WarmUpCalibration};

/// What became of an IMU of a vehicle: its calibration at one attitude, with where it comes from, or why there is no
/// table.
pub type Outcome<'a> = Result<(&'a Campaign, &'a CalibrationOutcome, &'a CampaignSource), &'a str>;

/// An IMU with the bias that gains least, and its factor.
type Gain<'a> = (&'a str, &'a WarmUpCalibration, (&'a BiasCurve, f64));

/// The page as HTML, with the IMUs by their names. `source` is where the calibrations come from, in words.
#[must_use]
pub fn html(source: &str, imus: &[(&str, Outcome<'_>)]) -> String {
    let names: Vec<_> = imus.iter().map(|(name, _)| *name).collect();
    let mut page = Page::new(&format!("Calibration of {} at one attitude", names.join(", ")), source);
    page.heading(2, "result", "Result");
    for (name, reason) in imus.iter().filter_map(|(name, outcome)| Some((name, outcome.as_ref().err()?))) {
        page.note(NoteKind::Bad, &format!("{name} is dropped"), reason);
    }
    let gains = imus.iter().filter_map(|(name, outcome)| match outcome {
        Ok((_, CalibrationOutcome::WarmUp(found), _)) => Some((*name, found.as_ref())),
        _ => None,
    });
    let gains = gains.filter_map(|(name, found)| Some((name, found, warm_up::least_gain(found)?)));
    let gains: Vec<_> = gains.collect();
    let columns: [Column<'_, Gain<'_>>; 4] = [
        ("IMU", &|(name, ..)| Cell::text(*name)),
        ("Smallest factor", &|(.., (_, factor))| Cell::number(*factor, 1)),
        ("of", &|(.., (axis, _))| Cell::text(axis.name())),
        ("Warnings", &|(_, found, _)| Cell::number(found.ramps.findings.len() as f64, 0)),
    ];
    if !gains.is_empty() {
        page.columns("How much less the biases vary over temperature: before by after", gains, &columns);
    }
    for (name, outcome) in imus {
        if let Ok((campaign, CalibrationOutcome::WarmUp(found), source)) = outcome {
            page.begin_part(name, name);
            warm_up::fill(&mut page, campaign, found, source);
        }
    }
    page.finish()
}
