//! Functions that the tests share: simulated campaigns with known truth, as files like those of a laboratory.

use isotherm_campaign::{Campaign, Dwell, Position, read_dwells};
use isotherm_fit::{Calibration, CalibrationError, CalibrationOptions, calibrate_accelerometers};
use isotherm_recording::{CampaignCsvReader, RawCsvWriter};
use isotherm_shared::table::CoefficientTable;
pub(crate) use isotherm_simulation::worst_errors as worst;
use isotherm_simulation::{CampaignSchedule, MISALIGNMENT, Noise, SimulatedRow, Truth, campaign, campaign_toml};

/// The published tables of the source paper.
pub(crate) fn paper() -> CoefficientTable {
    CoefficientTable::from_toml(include_str!("../../../../../examples/tables/imu-paper.toml"), None).unwrap()
}

/// Noise of the temperature and the sensors only: turntable angles are exact, and visits of a set point repeat exactly.
pub(crate) fn quiet() -> Noise {
    Noise { bias_g0: 0.0, scale_factor: 0.0, positioning_rad: 0.0, ..Noise::default() }
}

/// The campaign file of a simulated campaign.
pub(crate) fn campaign_file(truth: &Truth, schedule: &CampaignSchedule) -> Campaign {
    let content = truth.table.content();
    let (imu, unit) = (content.imu.as_str(), &content.temperature_unit);
    let text = campaign_toml(imu, "samples.csv", content.gravity, truth.gravity_local, unit, &schedule.positions);
    Campaign::from_toml(&text).unwrap()
}

/// The rows as the text of a samples file.
pub(crate) fn csv(rows: impl IntoIterator<Item = SimulatedRow>) -> Vec<u8> {
    let mut writer = RawCsvWriter::new(Vec::new(), "set_point_c,position,", false).unwrap();
    for row in rows {
        writer.write(format_args!("{},{},", row.set_point_c, row.position), &row.raw).unwrap();
    }
    writer.finish().unwrap()
}

/// The dwells in the text of a samples file.
pub(crate) fn dwells(campaign: &Campaign, text: &[u8]) -> Result<Vec<Dwell>, String> {
    let reader = CampaignCsvReader::new(text).map_err(|error| error.to_string())?;
    read_dwells(campaign, reader).map_err(|error| error.to_string())
}

/// The calibration from a whole simulated campaign, with its campaign file.
pub(crate) fn calibrated(
    truth: &Truth,
    schedule: &CampaignSchedule,
    seed: u64,
    options: CalibrationOptions,
) -> Result<(Campaign, Calibration), CalibrationError> {
    let file = campaign_file(truth, schedule);
    let dwells = dwells(&file, &csv(campaign(truth, schedule, seed))).unwrap();
    let calibration = calibrate_accelerometers(&file, dwells, options)?;
    Ok((file, calibration))
}

/// The paper's IMU with the misalignment [`MISALIGNMENT`].
pub(crate) fn paper_truth(tilt: [f64; 2], gravity: f64) -> Truth {
    Truth::new(paper().content().clone(), MISALIGNMENT, tilt, gravity).unwrap()
}

/// A campaign without noise; only temperature and pulses are quantised.
pub(crate) fn noiseless(positions: Vec<Position>) -> CampaignSchedule {
    CampaignSchedule { positions, noise: Noise::NONE, ..CampaignSchedule::default() }
}
