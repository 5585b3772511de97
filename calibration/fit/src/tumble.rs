//! Calibration without a turntable: the IMU is put down in many attitudes, by hand, and only the magnitude of gravity
//! is the reference.
//!
//! Each static pose gives one equation: the length of the compensated specific force is g_local/g0. The direction is
//! not known, so a rotation of the whole output is not observable: body axis 3 is along A3, body axis 2 in the plane of
//! A2 and A3. Every table gets the alignment matrix, the inverse of M. What the attitudes do not determine is refused
//! by name.
//!
//! One temperature gives constants; several, at most as many coefficients as temperatures.

mod attitudes;
mod checks;
mod choice;
mod covariance;
mod diagnosis;
pub(crate) mod dilution;
pub(crate) mod error;
mod estimates;
mod evidence;
mod glitches;
mod groups;
mod inverse;
mod likelihood;
mod model;
mod noise;
mod options;
mod poses;
pub(crate) mod reading;
mod recording;
mod remainder;
mod result;
mod temperature;
mod weighted;

pub use error::TumbleError;
pub use evidence::Evidence;
pub use groups::Groups;
pub use noise::{error_of_magnitude, errors_of_means};
pub use options::{ScaleFactorChoice, TumbleOptions};
pub use recording::TumbleRecording;
pub use result::TumbleCalibration;
pub use temperature::temperature_steps;

use crate::admit::AdmittedFindings;
use crate::checks::scale::unlike_scale_factors;
use crate::error::CalibrationError;
use crate::table::table_of;
use choice::{Choice, Data};
use estimates::Estimates;
use glitches::without_glitches;
use isotherm_campaign::Campaign;
use isotherm_recording::{Continuity, Losses};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, rms};
use nalgebra::Matrix3;
use poses::{PoseSearch, excluding};
use reading::Reading;

/// Makes a table of the recordings of an IMU that was put down in many attitudes. Only the IMU, the gravities and what
/// goes into the table unchanged are used. Every recording is searched for static poses by itself; their numbers go on
/// from recording to recording.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{TumbleOptions, TumbleRecording, calibrate_tumble};
/// use isotherm_campaign::Campaign;
/// use isotherm_recording::RawCsvReader;
///
/// let campaign = Campaign::tumble("imu-t".parse()?, [9.81, 9.81], "degC");
/// let rows: &[u8] = include_bytes!("../tests/data/any_lab/tumble3/recording.csv");
/// let mut recording = TumbleRecording::new("recording.csv");
/// for raw in RawCsvReader::new(rows)? {
///     recording.add(&raw?)?;
/// }
/// let found = calibrate_tumble(&campaign, &[recording], &TumbleOptions::default())?;
/// assert_eq!((found.readings.len(), found.groups.levels), (78, 3)); // static poses, temperatures
/// assert!(found.residual_rms() < 1e-3); // g0
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Faults that are not accepted, and see [`TumbleError`]; what the attitudes do not determine is named.
pub fn calibrate_tumble(
    campaign: &Campaign,
    recordings: &[TumbleRecording],
    options: &TumbleOptions,
) -> Result<TumbleCalibration, CalibrationError> {
    let mut admitted = AdmittedFindings::new(options.admission());
    let continuity: Vec<Continuity> = recordings.iter().map(|recording| recording.rows.iter().collect()).collect();
    admitted.add(checks::of_recordings(campaign, recordings, &continuity))?;
    let PoseSearch { readings, too_short, turned, noise, counts } = PoseSearch::of(recordings, options.window_s)?;
    admitted.add(counts)?;
    let (readings, glitches) = without_glitches(excluding(readings, &options.exclude)?);
    let gravity = campaign.gravity_local / campaign.gravity_reference;
    let groups = Groups::of(&readings);
    let names = |group: usize| group_name(recordings, &readings, &groups.members(group));
    let counts = diagnosis::of_counts(&readings, &errors_of_means(&readings), &groups, &names);
    admitted.add(counts.or_else(|| checks::of_readings(&readings, gravity)))?;
    let data = Data { readings: &readings, groups: &groups, gravity, misalignment: options.misalignment };
    let cause = || if groups.count > 1 { diagnosis::of_groups(data, &names) } else { None };
    let choice = choice::choose(data, options);
    if let Err(TumbleError::Refused(_)) = choice {
        admitted.add(cause())?;
    }
    let Choice { fitted, reasons, warnings } = choice?;
    let evidence = fitted.weighted.as_ref().map(|weighted| Evidence::of(weighted, &groups));
    if evidence.as_ref().is_some_and(Evidence::is_against) {
        admitted.add(cause())?;
    }
    let unknowns = fitted.model.unknowns;
    let (ranges, measured) = estimates::table_ranges(campaign, &readings, &unknowns, options)?;
    let half_width = campaign.gravity_source.half_width();
    let Estimates { curves, misalignment: errors } =
        estimates::estimates(&fitted, &groups, &ranges, &measured, half_width);
    let misalignment = fitted.model.misalignment(fitted.unknown());
    let table = table(campaign, &curves, misalignment.try_inverse().filter(|_| unknowns.misalignment))?;
    let forces: Vec<_> = readings.iter().map(|reading| fitted.model.force_of(fitted.unknown(), reading)).collect();
    let residuals: Vec<f64> = forces.iter().map(|force| force.norm() - gravity).collect();
    let of_residuals = match &evidence {
        Some(evidence) => evidence.findings(&fitted, &groups, rms(&residuals)),
        None => vec![checks::no_freedom(readings.len())],
    };
    let of_fit = warnings.into_iter().chain(checks::not_stated(&fitted, &groups)).chain(campaign.gravity_warning());
    let of_table = checks::kelvin(campaign, &readings).into_iter().chain(unlike_scale_factors(&table));
    let of_rows = checks::of_time(recordings, &continuity, readings.len());
    let warnings = glitches.into_iter().chain(of_residuals).chain(of_fit).chain(of_table);
    let warnings = warnings.chain(checks::unmeasured(&ranges, &measured)).chain(of_rows);
    let warnings = warnings.chain(checks::turned(turned, readings.len()));
    let outliers = fitted.weighted.iter().flat_map(|weighted| checks::outliers(&readings, weighted));
    admitted.add(warnings.chain(outliers))?;
    let dilution = fitted.dilution.clone();
    Ok(TumbleCalibration {
        table,
        gravity_source: campaign.gravity_source,
        options: options.clone(),
        too_short,
        rows: recordings.iter().map(|recording| recording.rows.len()).sum(),
        noise,
        evidence,
        unknowns,
        reasons,
        residuals,
        freedom: readings.len() - unknowns.count(),
        dilution,
        curves,
        misalignment,
        misalignment_error: errors.map(|(errors, _)| errors),
        misalignment_freedom: errors.map_or(0.0, |(_, freedom)| freedom),
        forces: forces.into_iter().map(Into::into).collect(),
        losses: continuity.iter().map(Continuity::losses).fold(Losses::default(), Losses::and),
        findings: admitted.findings,
        accepted: admitted.accepted,
        groups,
        readings,
    })
}

/// The table of a tumble.
fn table(
    campaign: &Campaign,
    curves: &[[Curve; 3]; AXES],
    alignment: Option<Matrix3<f64>>,
) -> Result<CoefficientTable, TumbleError> {
    let table = table_of(campaign, curves.each_ref(), alignment).map_err(TumbleError::Table)?;
    Ok(table.measured_at(Some(campaign.gravity_local)).measured_by_hand())
}

/// What a message calls a group: its file and static poses.
fn group_name(recordings: &[TumbleRecording], readings: &[Reading], members: &[usize]) -> String {
    let [first, last] = [members[0], members[members.len() - 1]].map(|index| &readings[index]);
    format!("{}, static poses {} to {}", recordings[first.recording].name, first.number, last.number)
}
