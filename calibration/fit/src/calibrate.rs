//! From the measurements of a campaign to a coefficient table of both triads.

use crate::accelerometers::{accelerometers_observable, calibrate_accelerometers};
use crate::admit::{add_findings, admit};
use crate::checks::scale::unlike_scale_factors;
use crate::checks::wraps::wraps;
use crate::error::CalibrationError;
use crate::gyroscopes::observability::TriadObservability;
use crate::gyroscopes::{Measurements, add_gyroscopes};
use crate::options::{CalibrationOptions, refuse_options};
use crate::ramps::add_transients;
use crate::result::Calibration;
use isotherm_campaign::Campaign;
use isotherm_support::finding::{Finding, Severity, name};

/// Checks that positions and turns determine all parameters of both triads; of the accelerometers only, if the campaign
/// file has no turns.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::observable;
/// use isotherm_campaign::Campaign;
///
/// let mut campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
/// assert!(observable(&campaign).is_ok());
/// campaign.positions.truncate(4); // A3 up and down alone
/// let error = observable(&campaign).err().ok_or("A1 and A2 are not determined")?;
/// assert!(error.to_string().contains("A1"), "{error}");
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Each deficiency, with a position or turn that would help.
pub fn observable(campaign: &Campaign) -> Result<TriadObservability, CalibrationError> {
    let found = TriadObservability::of(campaign);
    let mut deficiencies = match accelerometers_observable(campaign) {
        Err(CalibrationError::Positions(deficiencies)) => deficiencies,
        _ => Vec::new(),
    };
    if !campaign.turns.is_empty() {
        deficiencies.extend(found.deficiencies.iter().cloned());
    }
    if deficiencies.is_empty() { Ok(found) } else { Err(CalibrationError::Positions(deficiencies)) }
}

/// Makes a coefficient table of both triads from a campaign; of the accelerometers only, if the campaign file has no
/// turns. Ramps next to the positions give lag and transients. Campaigns with only ramps are for
/// [`ramps::calibrate_ramps`](crate::ramps::calibrate_ramps).
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{CalibrationOptions, calibrate, read_measurements};
/// # use isotherm_campaign::Campaign;
/// # use isotherm_recording::CampaignCsvReader;
/// # let campaign = Campaign::from_toml(include_str!("../../../examples/campaign/campaign.toml"))?;
/// # let samples: &[u8] = include_bytes!("../../../examples/campaign/samples.csv");
///
/// // Cubic curves, without the dwell at -25 degC in position 1.
/// let options = CalibrationOptions { order: Some(3), exclude: vec![(-25.0, 1)], ..CalibrationOptions::default() };
/// let measurements = read_measurements(&campaign, CampaignCsvReader::new(samples)?)?;
/// let calibration = calibrate(&campaign, measurements, options)?;
/// assert_eq!(calibration.dwells.len(), 15 * 12 - 1);
/// assert_eq!(calibration.table.content().axes[0].bias.coefficients().len(), 4);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If the data, the positions, the turns or the ramps do not allow a valid table.
pub fn calibrate(
    campaign: &Campaign,
    mut measurements: Measurements,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    refuse_options(campaign, &options)?;
    let ramps = core::mem::take(&mut measurements.ramps);
    let mut calibration = calibrate_static(campaign, measurements, options)?;
    if !ramps.is_empty() {
        add_transients(campaign, &mut calibration, &ramps)?;
    }
    let Calibration { options, accepted, findings, table, .. } = &mut calibration;
    // It causes others, and they do not cause it.
    findings.splice(0..0, admit(unlike_scale_factors(table), options, accepted)?);
    Ok(calibration)
}

/// The table of dwells and turns.
fn calibrate_static(
    campaign: &Campaign,
    measurements: Measurements,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let wrapped = wraps(&measurements);
    let Measurements { dwells, gyroscopes, other_device, findings: of_files, .. } = measurements;
    let devices: Vec<_> = other_device.map(|other| other.finding(campaign)).into_iter().collect();
    // Before anything is said about samples of another device.
    if !devices.is_empty() && !options.accept.contains(&name::OTHER_DEVICE) {
        return Err(CalibrationError::Faults { diagnosis: None, findings: devices });
    }
    // Wrong counts look like wrong positions.
    let mut accepted = Vec::new();
    let wrapped = admit(wrapped.into_iter().collect(), &options, &mut accepted)?;
    if campaign.turns.is_empty() {
        let mut calibration = calibrate_accelerometers(campaign, dwells, options)?;
        calibration.accepted.extend(accepted);
        add_findings(&mut calibration, wrapped)?;
        add_findings(&mut calibration, devices)?;
        add_findings(&mut calibration, of_files)?;
        if gyroscopes.present {
            let message = "the samples have gyroscopes, but the campaign file has no [[turn]]: only the accelerometers are calibrated";
            let finding = Finding::whole(Severity::Warning, name::NO_TURNS, message.to_owned());
            add_findings(&mut calibration, vec![finding])?;
        }
        return Ok(calibration);
    }
    let observability = observable(campaign)?;
    let (excluded_turns, excluded_dwells) = options
        .exclude
        .iter()
        .copied()
        .partition::<Vec<_>, _>(|(_, number)| campaign.turns.iter().any(|turn| turn.start.number == *number));
    let for_accelerometers = CalibrationOptions { exclude: excluded_dwells, ..options.clone() };
    let mut calibration = calibrate_accelerometers(campaign, dwells, for_accelerometers)?;
    calibration.options = options;
    calibration.accepted.extend(accepted);
    add_findings(&mut calibration, wrapped)?;
    add_findings(&mut calibration, devices)?;
    add_findings(&mut calibration, of_files)?;
    add_gyroscopes(campaign, &mut calibration, &gyroscopes, observability, &excluded_turns)?;
    Ok(calibration)
}
