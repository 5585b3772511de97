//! Calibration without a turntable: the IMU is put down in many attitudes, by hand, and gravity's length alone is the
//! reference.
//!
//! Each standstill gives one equation: the length of the compensated specific force is g_local/g0. The direction is not
//! known, so a rotation of the whole output is not observable: body axis 3 is along A3, body axis 2 in the plane of A2
//! and A3. Every table gets the alignment matrix, the inverse of M. What the attitudes do not determine is refused by
//! name.
//!
//! One temperature gives constants; several, at most as many coefficients as temperatures.

mod attitudes;
mod checks;
mod choice;
mod covariance;
mod diagnosis;
pub(crate) mod dilution;
pub(crate) mod error;
mod evidence;
mod groups;
mod inverse;
mod likelihood;
mod model;
mod noise;
mod options;
pub(crate) mod reading;
mod recording;
mod reduced;
mod result;
mod stated;
mod telemetry;
mod weighted;

pub use error::TumbleError;
pub use evidence::Evidence;
pub use groups::Groups;
pub(crate) use model::Unknowns;
pub use noise::{error_of_length, errors_of_means};
pub use options::{ScaleFactorChoice, TumbleOptions};
pub use recording::TumbleRecording;
pub use result::TumbleCalibration;
pub use telemetry::telemetry_steps;

use crate::checks::scale::unlike_scale_factors;
use crate::error::CalibrationError;
use crate::table::table_of;
use checks::{kelvin, of_readings, of_recordings, outliers};
use choice::{Chosen, Data, Fitted};
use isotherm_campaign::{Campaign, Standstills, begins_ns, faults, find_standstills, joint_range};
use isotherm_recording::{Continuity, Losses};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_support::finding::{Finding, Location, name};
use nalgebra::Vector3;
use reading::Reading;
use stated::{Ranges, Stated};

/// Share of a standstill's rows beyond which glitches of the telemetry break it.
const MOST_GLITCHES: f64 = 0.2;
/// An error code is one if the telemetry of both neighbours is as many steps, of at least so much, off it.
const ELSEWHERE: f64 = 10.0;
const ELSEWHERE_LEAST: f64 = 0.1;

/// Makes a table of the recordings of an IMU that was put down in many attitudes. Of the campaign, the IMU, the
/// gravities and what goes into the table unchanged are used. Every recording is searched for standstills by itself;
/// their numbers go on from recording to recording.
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
/// assert_eq!((found.readings.len(), found.groups.levels), (78, 3)); // standstills, temperatures
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
    let mut accepted = Vec::new();
    let mut admit = |findings: Vec<Finding>| {
        let admitted = options.admission().admit(findings, &mut accepted);
        admitted.map_err(|findings| CalibrationError::Faults { diagnosis: None, findings })
    };
    let continuity: Vec<Continuity> = recordings.iter().map(|recording| recording.rows.iter().collect()).collect();
    let mut findings = admit(of_recordings(campaign, recordings, &continuity))?;
    let Found { mut readings, too_short, turned, noise, counts } = readings(recordings, options.window_s)?;
    findings.extend(admit(counts)?);
    exclude(&mut readings, &options.exclude)?;
    let (readings, mut warnings) = without_glitches(readings);
    let gravity = campaign.gravity_local / campaign.gravity_reference;
    let groups = Groups::of(&readings);
    let names = |group: usize| group_name(recordings, &readings, &groups.members(group));
    let counts = diagnosis::of_counts(&readings, &errors_of_means(&readings), &groups, &names);
    let counts = counts.or_else(|| of_readings(&readings, gravity));
    findings.extend(admit(counts.into_iter().collect())?);
    let data = Data { readings: &readings, groups: &groups, gravity, misalignment: options.misalignment };
    let cause = || if groups.count > 1 { diagnosis::of_groups(data, &names) } else { None };
    let chosen = match choice::choose(data, options) {
        Err(refused @ TumbleError::Refused(_)) => {
            admit(cause().into_iter().collect())?;
            return Err(refused.into());
        }
        chosen => chosen?,
    };
    let Chosen { fitted, reasons, warnings: of_choice } = chosen;
    let evidence = fitted.weighted.as_ref().map(|weighted| Evidence::of(weighted, &groups));
    if evidence.as_ref().is_some_and(Evidence::is_against) {
        findings.extend(admit(cause().into_iter().collect())?);
    }
    let unknowns = fitted.model.unknowns;
    let (ranges, measured) = table_ranges(campaign, &readings, &unknowns, options)?;
    let Stated { curves, misalignment: errors } =
        stated::stated(&fitted, &groups, &ranges, &measured, campaign.gravity_source.half_width());
    let unknown = fitted.weighted.as_ref().map_or(&fitted.fit.unknown, |weighted| &weighted.unknown);
    let misalignment = fitted.model.misalignment(unknown);
    let alignment = if unknowns.misalignment { misalignment.try_inverse() } else { None };
    let table = table_of(campaign, curves.each_ref(), alignment).map_err(TumbleError::Table)?;
    let table = table.measured_at(Some(campaign.gravity_local)).measured_by_hand();
    let forces: Vec<Vector3<f64>> = readings.iter().map(|reading| fitted.model.force_of(unknown, reading)).collect();
    let residuals: Vec<f64> = forces.iter().map(|force| force.norm() - gravity).collect();
    let left = (residuals.iter().map(|residual| residual * residual).sum::<f64>() / residuals.len() as f64).sqrt();
    match &evidence {
        Some(evidence) => warnings.extend(evidence.findings(&fitted, &groups, left)),
        None => warnings.push(no_freedom(readings.len())),
    }
    warnings.extend(of_choice);
    warnings.extend(not_stated(&fitted, &groups));
    warnings.extend(campaign.gravity_warning());
    warnings.extend(kelvin(campaign, &readings));
    warnings.extend(unlike_scale_factors(&table));
    warnings.extend(checks::unmeasured(&ranges, &measured));
    warnings.extend(of_time(recordings, &continuity, readings.len()));
    warnings.extend(checks::turned(turned, readings.len()));
    warnings.extend(fitted.weighted.as_ref().map_or_else(Vec::new, |weighted| outliers(&readings, weighted)));
    findings.extend(admit(warnings)?);
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
        findings,
        accepted,
        groups,
        readings,
    })
}

/// What a message calls a group: its file and standstills.
fn group_name(recordings: &[TumbleRecording], readings: &[Reading], members: &[usize]) -> String {
    let [first, last] = [members[0], members[members.len() - 1]].map(|index| &readings[index]);
    format!("{}, standstills {} to {}", recordings[first.recording].name, first.number, last.number)
}

/// The readings without those whose telemetry is broken, with a line for each that has glitches.
fn without_glitches(readings: Vec<Reading>) -> (Vec<Reading>, Vec<Finding>) {
    let is_code = |index: usize| {
        let at = |index: usize| readings.get(index).map(|reading: &Reading| reading.telemetry_medians);
        let off = |other: Option<[[f64; AXES]; 2]>, sensor: usize, axis: usize, code: f64| {
            let step = readings[index].telemetry_step;
            other.is_none_or(|other| (other[sensor][axis] - code).abs() > ELSEWHERE * step.max(ELSEWHERE_LEAST))
        };
        let neighbours = [index.checked_sub(1).and_then(at), at(index + 1)];
        let medians = readings[index].telemetry_medians;
        (0..2).flat_map(|sensor| (0..AXES).map(move |axis| (sensor, axis))).any(|(sensor, axis)| {
            let code = medians[sensor][axis];
            telemetry::ERROR_CODES.contains(&code)
                && neighbours.iter().any(Option::is_some)
                && neighbours.iter().all(|other| off(*other, sensor, axis, code))
        })
    };
    let broken: Vec<bool> = (0..readings.len())
        .map(|index| {
            let reading = &readings[index];
            reading.telemetry_glitches as f64 > MOST_GLITCHES * reading.rows.len() as f64 || is_code(index)
        })
        .collect();
    let finding = |(reading, broken): (&Reading, &bool)| {
        let message = match (*broken, reading.telemetry_glitches) {
            (false, 0) => return None,
            (false, rows) => {
                let rows = if rows == 1 { "one row".to_owned() } else { format!("{rows} rows") };
                format!("{rows} of the telemetry are glitches of the thermometer: left out of mean and range")
            }
            (true, _) => "the telemetry is broken: the standstill is left out".to_owned(),
        };
        Some(Finding::warning(name::TELEMETRY_GLITCH, message).at(Location::Standstill(reading.number)))
    };
    let findings = readings.iter().zip(&broken).filter_map(finding).collect();
    let mut broken = broken.into_iter();
    let kept = readings.iter().filter(|_| !broken.next().unwrap_or_default()).cloned().collect();
    (kept, findings)
}

fn no_freedom(standstills: usize) -> Finding {
    let message = format!(
        "{standstills} standstills for {standstills} unknowns: nothing is left to judge the table by, so there are no standard errors; put the \
         IMU down in more attitudes"
    );
    Finding::warning(name::NO_FREEDOM, message)
}

/// Curves that take all that differs between groups.
fn not_stated(fitted: &Fitted<'_>, groups: &Groups) -> Option<Finding> {
    let order = fitted.model.unknowns.order;
    (groups.count > 1 && groups.count <= order + 1).then(|| {
        let message = format!(
            "{} groups of standstills, by file, power-up and temperature, for order {order}: nothing is left to tell what a group shares from \
             temperature, so no errors of biases and scale factors are stated; take one more group, or a lower order",
            groups.count
        );
        Finding::warning(name::NO_FREEDOM, message)
    })
}

/// Leaves out the standstills of these numbers.
fn exclude(readings: &mut Vec<Reading>, numbers: &[usize]) -> Result<(), TumbleError> {
    let count = readings.len();
    if let Some(missing) = numbers.iter().find(|number| !(1..=count).contains(number)) {
        return Err(TumbleError::NothingToExclude(*missing, count));
    }
    readings.retain(|reading| !numbers.contains(&reading.number));
    Ok(())
}

/// Gaps and faults of time in the recordings.
fn of_time(recordings: &[TumbleRecording], continuity: &[Continuity], standstills: usize) -> Vec<Finding> {
    let mut found = Vec::new();
    // Stamps that jitter or come in bursts are no gaps.
    let gaps = continuity.iter().map(|found| found.losses().gaps).sum::<u64>();
    if gaps > standstills as u64 {
        let message = format!("the recordings have {gaps} gaps; look for samples that were lost");
        found.push(Finding::warning(name::MISSING_ROWS, message));
    }
    let fault =
        |(recording, found): (&TumbleRecording, &Continuity)| Some(found.fault()?.finding().at(recording.place()));
    found.extend(recordings.iter().zip(continuity).filter_map(fault));
    found
}

/// The standstills of all recordings.
struct Found {
    readings: Vec<Reading>,
    too_short: usize,
    turned: usize,
    noise: Vec<[f64; AXES]>,
    /// What is wrong with the counts.
    counts: Vec<Finding>,
}

fn readings(recordings: &[TumbleRecording], window_s: Option<f64>) -> Result<Found, TumbleError> {
    let mut found = Found { readings: Vec::new(), too_short: 0, turned: 0, noise: Vec::new(), counts: Vec::new() };
    let has_gyroscopes = |row: &RawSample| {
        let triad = &row.gyroscopes;
        triad.positive_pulses.iter().chain(&triad.negative_pulses).any(|pulses| *pulses > 0)
    };
    let with_gyroscopes = recordings.iter().flat_map(|recording| &recording.rows).any(has_gyroscopes);
    for (index, recording) in recordings.iter().enumerate() {
        let TumbleRecording { name, rows, .. } = recording;
        let begins_ns = begins_ns(rows);
        let steps = telemetry_steps(rows);
        let standstills = find_standstills(rows, window_s)
            .and_then(Standstills::without_turned)
            .map_err(|error| TumbleError::Standstill { name: name.clone(), error })?;
        for standstill in &standstills.found {
            let number = found.readings.len() + 1;
            let range = standstill.rows.clone();
            let start_s = begins_ns[range.start] as f64 / 1e9;
            found.readings.push(Reading::of(
                [number, index],
                rows,
                range,
                start_s,
                &standstills,
                &steps,
                with_gyroscopes,
            ));
        }
        let at_rest: Vec<_> = standstills.found.iter().map(|standstill| standstill.rows.clone()).collect();
        found.counts.extend(faults(rows, &at_rest).into_iter().map(|finding| finding.at(recording.place())));
        found.too_short += standstills.too_short;
        found.turned += standstills.turned;
        found.noise.push(standstills.noise);
    }
    Ok(found)
}

/// The telemetry's range of head and board of each axis for the table, and as measured.
fn table_ranges(
    campaign: &Campaign,
    readings: &[Reading],
    unknowns: &Unknowns,
    options: &TumbleOptions,
) -> Result<(Ranges, Ranges), TumbleError> {
    let of = |ranges: fn(&Reading) -> [[f64; 2]; AXES]| {
        [0, 1, 2].map(|axis| joint_range(readings.iter().map(|reading| ranges(reading)[axis])))
    };
    let measured = [of(|reading| reading.head_range), of(|reading| reading.board_range)];
    let constant = measured.iter().flatten().any(|[low, high]| low == high);
    match options.temperature_range.or(campaign.temperature_range) {
        None if constant => Err(TumbleError::Refused(
            "the telemetry is constant, so the recordings do not say where the table is valid; state it: --temperature-range LOW,HIGH, or \
             temperature_range = [LOW, HIGH] in the campaign file".to_owned(),
        )),
        Some(_) if unknowns.order > 0 => Err(TumbleError::Options(
            "--temperature-range: the recordings show a range of their own, and a curve beyond it is a guess; leave it out, or give --order 0".to_owned(),
        )),
        Some([low, high]) => {
            if let Some([from, to]) = measured.iter().flatten().find(|[from, to]| *from < low || *to > high) {
                return Err(TumbleError::Options(format!(
                    "--temperature-range {low},{high}: the telemetry of the standstills is {from} to {to}; give a range that holds it"
                )));
            }
            Ok(([[[low, high]; AXES]; 2], measured))
        }
        None => Ok((measured, measured)),
    }
}
