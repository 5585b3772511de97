//! Input: a campaign file and its samples, with a zero byte between them. If the campaign file is empty, the example's
//! is used.
//!
//! Every refusal must name a line and a reason. Accepted input must pass through the checks and through calibration by
//! both methods without a panic and within the limits of time and memory. A resulting table that is written and read
//! again must be the same table. If the campaign has only ramps, the samples are those of one ramp.

use crate::check_faults;
use isotherm_campaign::{Campaign, Dwell, read_dwells};
use isotherm_fit::{
    AlignmentChoice, CalibrationOptions, Method, RampRecording, accelerometers_observable as observable,
    calibrate_accelerometers, calibrate_ramps, check, set_points,
};
use isotherm_recording::CampaignCsvReader;
use isotherm_shared::table::{CoefficientTable, Content};

const EXAMPLE: &str = include_str!("../../../../examples/campaign/campaign.toml");
const TABLE: &str = include_str!("../../../../examples/tables/imu-whole.toml");

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let Ok(text) = str::from_utf8(&bytes[..end]) else { return };
    let text = if text.is_empty() { EXAMPLE } else { text };
    let campaign = match Campaign::batch_from_toml(text) {
        // The last IMU of a batch is as good as any.
        Ok(mut campaigns) => campaigns.pop().expect("an IMU"),
        Err(faults) => return check_faults(text, &faults),
    };
    let samples = bytes.get(end + 1..);
    if campaign.has_ramps_alone() {
        assert!(!campaign.ramps.is_empty() && campaign.curves.is_some());
        return samples.map_or((), |samples| ramps_alone(&campaign, samples));
    }
    for (index, position) in campaign.positions.iter().enumerate() {
        let length = position.specific_force.iter().map(|f| f * f).sum::<f64>().sqrt();
        assert!((length - 1.0).abs() < 1e-9, "{position:?}");
        let (force, by_tilt) = campaign.force(&campaign.positions[index], Some([1e-3, -1e-3]));
        assert!(force.iter().chain(by_tilt.iter().flatten()).all(|f| f.is_finite()));
    }
    let observable = observable(&campaign);
    let Some(samples) = samples else { return };
    let Ok(dwells) = CampaignCsvReader::new(samples).and_then(|rows| read_dwells(&campaign, rows)) else { return };
    check_dwells(&campaign, &dwells);
    if observable.is_ok() {
        both_methods(&campaign, &dwells);
    }
}

/// Checks the dwells, and what is found in them.
fn check_dwells(campaign: &Campaign, dwells: &[Dwell]) {
    for dwell in dwells {
        assert!(dwell.rows >= 1 && dwell.lines[0] <= dwell.lines[1] && dwell.position < campaign.positions.len());
        assert!((1..=512).contains(&dwell.blocks.len()));
    }
    let stays = set_points(dwells, campaign.positions.len());
    assert_eq!(stays.iter().map(|stay| stay.dwells.len()).sum::<usize>(), dwells.len());
    for finding in check(campaign, dwells, &stays, &[]) {
        assert!(!finding.message.is_empty());
    }
}

fn both_methods(campaign: &Campaign, dwells: &[Dwell]) {
    for method in [Method::OneStage, Method::TwoStage] {
        let options = CalibrationOptions {
            method,
            alignment: AlignmentChoice::of(method == Method::TwoStage, false),
            ..CalibrationOptions::default()
        };
        if let Ok(calibration) = calibrate_accelerometers(campaign, dwells.to_vec(), options) {
            same_when_read_again(campaign, &calibration.table);
        }
    }
}

/// Campaigns with only ramps need the table of this very IMU: the example's, as if it were the campaign's.
fn ramps_alone(campaign: &Campaign, samples: &[u8]) {
    let Ok(recording) = RampRecording::from_csv("ramp.csv", samples) else { return };
    let example = CoefficientTable::from_toml(TABLE, None).expect("a valid table").content().clone();
    let content = Content {
        imu: campaign.imu.clone(),
        serial: campaign.serial.clone(),
        gravity: campaign.gravity_reference,
        temperature_unit: campaign.temperature_unit.clone(),
        ..example
    };
    let Ok(curves) = CoefficientTable::new(content) else { return };
    if let Ok(calibration) = calibrate_ramps(campaign, &[recording], &curves, CalibrationOptions::default()) {
        same_when_read_again(campaign, &calibration.table);
    }
}

fn same_when_read_again(campaign: &Campaign, table: &CoefficientTable) {
    let again = CoefficientTable::from_toml(&table.to_toml(), Some(&campaign.imu));
    assert_eq!(again.expect("a valid table").digest(), table.digest());
}
