//! A calibration of any kind, from its measurements to the text of its table.

use crate::accuracy::Accuracy;
use crate::calibrate::calibrate;
use crate::error::CalibrationError;
use crate::gyroscopes::Measurements;
use crate::options::CalibrationOptions;
use crate::ramps::{RampCalibration, calibrate_ramps};
use crate::result::Calibration;
use crate::transients::RampRecording;
use crate::tumble::{TumbleCalibration, TumbleOptions, TumbleRecording, calibrate_tumble};
use crate::warm_up::{WarmUpCalibration, WarmUpOptions, calibrate_warm_up};
use isotherm_campaign::Campaign;
use isotherm_shared::table::CoefficientTable;
use isotherm_support::finding::Finding;

/// What was measured, and the options of its fit.
#[derive(Clone, Debug)]
pub enum CalibrationData {
    /// A campaign on a turntable, with the ramps next to its positions.
    Campaign(Measurements, CalibrationOptions),
    /// Only ramps, and the table that gives everything else.
    Ramps(Vec<RampRecording>, Box<CoefficientTable>, CalibrationOptions),
    /// Recordings at one attitude, and the nominal table.
    WarmUp(Vec<RampRecording>, Box<CoefficientTable>, WarmUpOptions),
    /// A tumble.
    Tumble(Vec<TumbleRecording>, TumbleOptions),
}

/// A calibration of any kind. The command, an automatic campaign and Python make it alike.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{CalibrationOptions, CampaignSource, CalibrationOutcome, CalibrationData, TableFile};
/// use isotherm_fit::{read_measurements, sha256};
///
/// let text = include_str!("../../../examples/campaign/campaign.toml");
/// let samples: &[u8] = include_bytes!("../../../examples/campaign/samples.csv");
/// let campaign = isotherm_campaign::Campaign::from_toml(text)?;
/// let rows = isotherm_recording::CampaignCsvReader::new(samples)?;
/// let measured = CalibrationData::Campaign(read_measurements(&campaign, rows)?, CalibrationOptions::default());
/// let fitted = CalibrationOutcome::fit(&campaign, measured)?;
/// assert!(fitted.findings().is_empty());
/// let source = CampaignSource {
///     campaign: "campaign.toml".to_owned(),
///     campaign_sha256: sha256(text.as_bytes()),
///     samples_sha256: sha256(samples),
///     ..CampaignSource::at("2026-01-01T00:00:00Z")
/// };
/// let file = TableFile::from_toml("imu-paper.toml", &fitted.sealed(&campaign, &source)?)?;
/// assert_eq!(file.table, *fitted.table());
/// assert!(file.origin.curves[0][0].is_some()); // the provenance has the errors of the bias of A1
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub enum CalibrationOutcome {
    /// A campaign on a turntable.
    Campaign(Box<Calibration>),
    /// Only ramps.
    Ramps(Box<RampCalibration>),
    /// Recordings at one attitude.
    WarmUp(Box<WarmUpCalibration>),
    /// A tumble.
    Tumble(Box<TumbleCalibration>),
}

impl CalibrationOutcome {
    /// Makes the table of what was measured.
    ///
    /// # Errors
    /// If the data do not allow a valid table.
    pub fn fit(campaign: &Campaign, data: CalibrationData) -> Result<Self, CalibrationError> {
        Ok(match data {
            CalibrationData::Campaign(measurements, options) => {
                Self::Campaign(Box::new(calibrate(campaign, measurements, options)?))
            }
            CalibrationData::Ramps(ramps, curves, options) => {
                Self::Ramps(Box::new(calibrate_ramps(campaign, &ramps, &curves, options)?))
            }
            CalibrationData::WarmUp(recordings, nominal, options) => {
                Self::WarmUp(Box::new(calibrate_warm_up(campaign, &recordings, &nominal, &options)?))
            }
            CalibrationData::Tumble(recordings, options) => {
                Self::Tumble(Box::new(calibrate_tumble(campaign, &recordings, &options)?))
            }
        })
    }

    /// The coefficient table.
    #[must_use]
    pub fn table(&self) -> &CoefficientTable {
        match self {
            Self::Campaign(found) => &found.table,
            Self::Ramps(found) => &found.table,
            Self::WarmUp(found) => found.table(),
            Self::Tumble(found) => &found.table,
        }
    }

    /// Warnings, and faults that were accepted.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        match self {
            Self::Campaign(found) => &found.findings,
            Self::Ramps(found) => &found.findings,
            Self::WarmUp(found) => &found.ramps.findings,
            Self::Tumble(found) => &found.findings,
        }
    }

    /// The calibration of a campaign on a turntable.
    #[must_use]
    pub fn campaign(&self) -> Option<&Calibration> {
        if let Self::Campaign(found) = self { Some(found) } else { None }
    }

    /// The bottom line, in words.
    #[must_use]
    pub fn accuracy(&self) -> String {
        match self {
            Self::Campaign(found) => Accuracy::of(found).to_string(),
            Self::Ramps(found) => found.accuracy(),
            Self::WarmUp(found) => found.accuracy(),
            Self::Tumble(found) => found.accuracy(),
        }
    }
}
