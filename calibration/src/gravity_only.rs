//! Calibration without a turntable: the IMU is put down in many attitudes, by hand, and gravity's length alone is the
//! reference.
//!
//! Each standstill gives one equation: the length of the compensated specific force is g_local/g0. The direction is not
//! known, so a rotation of the whole output is not observable: body axis 3 is along A3, body axis 2 in the plane of A2
//! and A3. Every table gets the alignment matrix, the inverse of M. What the attitudes do not determine is refused by
//! name.
//!
//! One temperature gives constants; several, at most as many coefficients as temperatures.

mod checks;
mod choice;
pub(crate) mod dilution;
pub(crate) mod error;
mod model;
mod options;
pub(crate) mod provenance;
pub(crate) mod reading;
mod recording;
mod result;

pub use error::GravityOnlyError;
pub(crate) use model::Unknowns;
pub use options::{GravityOnlyOptions, ScaleFactorChoice};
pub use recording::TumbleRecording;
pub use result::GravityOnlyCalibration;

use crate::checks::scale::unlike_scale_factors;
use crate::error::CalibrationError;
use crate::table::table_of;
use checks::{kelvin, of_readings, of_recordings, outliers, turned};
use choice::Chosen;
use isotherm_campaign::{Campaign, TUMBLED, begins_ns, find_standstills, joint_range, stretches};
use isotherm_finding::{Finding, name};
use isotherm_recording::{Continuity, Losses};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::median;
use model::{GravityFit, GravityModel};
use nalgebra::{DMatrix, Vector3};
use reading::Reading;

/// Residuals over the noise of the standstills that give a warning. Real IMUs reach 3.
const LACK_OF_FIT: f64 = 20.0;
/// Noise of a standstill that is taken at least for that \[g0\].
const LEAST_NOISE: f64 = 1e-6;
/// Share of the telemetry's range that a temperature is no wider than.
const LEVEL: f64 = 0.1;
/// Median of chi-square with one degree of freedom.
const CHI_SQUARE_MEDIAN: f64 = 0.454_936;

/// Makes a table of the recordings of an IMU that was put down in many attitudes. Of the campaign, the IMU, the
/// gravities and what goes into the table unchanged are used. Every recording is searched for standstills by itself;
/// their numbers go on from recording to recording.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_calibration::{GravityOnlyOptions, TumbleRecording, calibrate_gravity_only};
/// use isotherm_campaign::Campaign;
/// use isotherm_recording::RawCsvReader;
///
/// let campaign = Campaign::gravity_only("imu-t".parse()?, [9.81, 9.81], "degC");
/// let rows: &[u8] = include_bytes!("../tests/data/any_lab/tumble3/recording.csv");
/// let mut recording = TumbleRecording::new("recording.csv");
/// for raw in RawCsvReader::new(rows)? {
///     recording.add(&raw?)?;
/// }
/// let found = calibrate_gravity_only(&campaign, &[recording], &GravityOnlyOptions::default())?;
/// assert_eq!((found.readings.len(), found.levels), (78, 3)); // standstills, temperatures
/// assert!(found.residual_rms() < 1e-3); // g0
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Faults that are not accepted, and see [`GravityOnlyError`]; what the attitudes do not determine is named.
pub fn calibrate_gravity_only(
    campaign: &Campaign,
    recordings: &[TumbleRecording],
    options: &GravityOnlyOptions,
) -> Result<GravityOnlyCalibration, CalibrationError> {
    let mut accepted = Vec::new();
    let mut admit = |findings: Vec<Finding>| {
        let admitted = options.admission().admit(findings, &mut accepted);
        admitted.map_err(|findings| CalibrationError::Faults { diagnosis: None, findings })
    };
    let continuity: Vec<Continuity> = recordings.iter().map(|recording| recording.rows.iter().collect()).collect();
    let mut findings = admit(of_recordings(campaign, recordings, &continuity))?;
    let Found { mut readings, too_short, noise } = readings(recordings, options.window_s)?;
    exclude(&mut readings, &options.exclude)?;
    let gravity = campaign.gravity_local / campaign.gravity_reference;
    findings.extend(admit(of_readings(&readings, gravity).into_iter().collect())?);
    let levels = levels(&readings);
    let Chosen { model, fit, dilution, reasons, warnings } = choice::choose(&readings, levels, gravity, options)?;
    let unknowns = model.unknowns;
    let errors = Errors::of(&model, &fit, &readings);
    let ranges = table_ranges(campaign, &readings, &unknowns, options)?;
    let curve = |axis: usize, quantity: usize| {
        let range = ranges[usize::from(quantity > 0)][axis];
        model.curve(&fit.unknown, errors.covariance.as_ref(), [axis, quantity], errors.freedom, range)
    };
    let curves = [0, 1, 2].map(|axis| [0, 1, 2].map(|quantity| curve(axis, quantity)));
    let misalignment = model.misalignment(&fit.unknown);
    let alignment = if unknowns.misalignment { misalignment.try_inverse() } else { None };
    let table = table_of(campaign, curves.each_ref(), alignment).map_err(GravityOnlyError::Table)?;
    let table = table.measured_at(Some(campaign.gravity_local)).measured_by_hand();
    let mut warnings = warnings;
    warnings.extend(errors.warnings(readings.len()));
    warnings.extend(kelvin(campaign, &readings));
    warnings.extend(unlike_scale_factors(&table));
    warnings.extend(of_time(recordings, &continuity, readings.len()));
    warnings
        .extend(turned(&readings, &errors.of_lengths, |reading, net| model.force_of_net(&fit.unknown, net, reading)));
    warnings.extend(outliers(&readings, &fit, errors.freedom));
    findings.extend(admit(warnings)?);
    Ok(GravityOnlyCalibration {
        table,
        options: options.clone(),
        too_short,
        rows: recordings.iter().map(|recording| recording.rows.len()).sum(),
        noise,
        levels,
        unknowns,
        reasons,
        residuals: fit.residual.iter().copied().collect(),
        freedom: errors.freedom,
        dilution,
        curves,
        misalignment,
        misalignment_error: errors.covariance.as_ref().and_then(|covariance| model.misalignment_errors(covariance)),
        forces: errors.forces.into_iter().map(Into::into).collect(),
        losses: continuity.iter().map(Continuity::losses).fold(Losses::default(), Losses::and),
        findings,
        accepted,
        readings,
    })
}

/// Leaves out the standstills of these numbers.
fn exclude(readings: &mut Vec<Reading>, numbers: &[usize]) -> Result<(), GravityOnlyError> {
    let count = readings.len();
    if let Some(missing) = numbers.iter().find(|number| !(1..=count).contains(number)) {
        return Err(GravityOnlyError::NothingToExclude(*missing, count));
    }
    readings.retain(|reading| !numbers.contains(&reading.number));
    Ok(())
}

/// What the residuals and the noise of the standstills say of a fit.
struct Errors {
    freedom: usize,
    /// Specific force of each standstill \[g0\].
    forces: Vec<Vector3<f64>>,
    /// Standard error of each length by the noise of its rows \[g0\].
    of_lengths: Vec<f64>,
    /// Residuals over what the noise of the standstills explains.
    ratio: f64,
    /// Of the unknowns; `None` without degrees of freedom.
    covariance: Option<DMatrix<f64>>,
}

impl Errors {
    fn of(model: &GravityModel<'_>, fit: &GravityFit, readings: &[Reading]) -> Self {
        let freedom = readings.len() - model.unknowns.count();
        let forces: Vec<_> = readings.iter().map(|reading| model.force_of(&fit.unknown, reading)).collect();
        let of_length = |force: &Vector3<f64>, errors: [f64; AXES]| {
            error_of_length(force, errors, |axis| model.scale_factor(&fit.unknown, axis))
        };
        let of_lengths = readings.iter().zip(&forces).map(|(reading, force)| of_length(force, reading.noise)).collect();
        let of_means = errors_of_means(readings);
        let least = forces.iter().zip(of_means).map(|(force, errors)| of_length(force, errors).powi(2));
        let least = least.sum::<f64>() / readings.len() as f64;
        let variance = (fit.squares() / freedom.max(1) as f64).max(least);
        Self {
            freedom,
            forces,
            of_lengths,
            ratio: variance.sqrt() / least.sqrt().max(LEAST_NOISE),
            covariance: fit.inverse.as_ref().filter(|_| freedom > 0).map(|inverse| inverse * variance),
        }
    }

    fn warnings(&self, standstills: usize) -> Vec<Finding> {
        let mut warnings = Vec::new();
        if self.freedom == 0 {
            let message = format!(
                "{standstills} standstills for {standstills} unknowns: nothing is left to judge the table by, so there are no standard errors; \
                 put the IMU down in more attitudes"
            );
            warnings.push(Finding::warning(name::NO_FREEDOM, message));
        }
        if self.ratio > LACK_OF_FIT {
            let message = format!(
                "the residuals are {:.0} times what the noise of the standstills explains: recordings of different IMUs, an order that is too \
                 low, or ground that is not firm; look at the residuals",
                self.ratio
            );
            warnings.push(Finding::warning(name::LACK_OF_FIT, message));
        }
        warnings
    }
}

/// Gaps and faults of time in the recordings.
fn of_time(recordings: &[TumbleRecording], continuity: &[Continuity], standstills: usize) -> Vec<Finding> {
    let mut found = Vec::new();
    let gaps = recordings.iter().map(|recording| stretches(&recording.rows).len().saturating_sub(1)).sum::<usize>();
    if gaps > standstills {
        let message =
            format!("the recordings have {gaps} gaps, and each ends a standstill; look for samples that were lost");
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
    noise: Vec<[f64; AXES]>,
}

fn readings(recordings: &[TumbleRecording], window_s: f64) -> Result<Found, GravityOnlyError> {
    let mut found = Found { readings: Vec::new(), too_short: 0, noise: Vec::new() };
    let has_gyroscopes = |row: &RawSample| {
        let triad = &row.gyroscopes;
        triad.positive_pulses.iter().chain(&triad.negative_pulses).any(|pulses| *pulses > 0)
    };
    let with_gyroscopes = recordings.iter().flat_map(|recording| &recording.rows).any(has_gyroscopes);
    for (index, TumbleRecording { name, rows }) in recordings.iter().enumerate() {
        let begins_ns = begins_ns(rows);
        let standstills = find_standstills(rows, window_s, TUMBLED)
            .map_err(|error| GravityOnlyError::Standstill { name: name.clone(), error })?;
        for range in standstills.found {
            let number = found.readings.len() + 1;
            let start_s = begins_ns[range.start] as f64 / 1e9;
            found.readings.push(Reading::of(number, index, rows, range, start_s, standstills.noise, with_gyroscopes));
        }
        found.too_short += standstills.too_short;
        found.noise.push(standstills.noise);
    }
    Ok(found)
}

/// Number of temperatures: groups of standstills whose head telemetry is no further apart than a tenth of the whole
/// range.
fn levels(readings: &[Reading]) -> usize {
    let mut all: Vec<f64> = readings.iter().map(|reading| reading.head.iter().sum::<f64>() / AXES as f64).collect();
    all.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (all.first(), all.last()) else { return 0 };
    let width = (last - first) * LEVEL;
    let mut levels = 1;
    let mut start = *first;
    for telemetry in &all {
        if telemetry - start > width {
            levels += 1;
            start = *telemetry;
        }
    }
    levels
}

/// The telemetry's range of head and board of each axis for the table.
fn table_ranges(
    campaign: &Campaign,
    readings: &[Reading],
    unknowns: &Unknowns,
    options: &GravityOnlyOptions,
) -> Result<[[[f64; 2]; AXES]; 2], GravityOnlyError> {
    let of = |ranges: fn(&Reading) -> [[f64; 2]; AXES]| {
        [0, 1, 2].map(|axis| joint_range(readings.iter().map(|reading| ranges(reading)[axis])))
    };
    let mut measured = [of(|reading| reading.head_range), of(|reading| reading.board_range)];
    let constant = measured.iter().flatten().any(|[low, high]| low == high);
    match options.temperature_range.or(campaign.temperature_range) {
        None if constant => Err(GravityOnlyError::Refused(
            "the telemetry is constant, so the recordings do not say where the table is valid; state it: --temperature-range LOW,HIGH, or \
             temperature_range = [LOW, HIGH] in the campaign file".to_owned(),
        )),
        Some(_) if unknowns.order > 0 => Err(GravityOnlyError::Options(
            "--temperature-range: the recordings show a range of their own, and a curve beyond it is a guess; leave it out, or give --order 0".to_owned(),
        )),
        Some([low, high]) => {
            for [from, to] in measured.iter_mut().flatten() {
                if *from < low || *to > high {
                    return Err(GravityOnlyError::Options(format!(
                        "--temperature-range {low},{high}: the telemetry of the standstills is {from} to {to}; give a range that holds it"
                    )));
                }
                (*from, *to) = (low, high);
            }
            Ok(measured)
        }
        None => Ok(measured),
    }
}

/// The standard error of a specific force's length \[g0\], from those of its net rates \[pulse/s\].
pub fn error_of_length(force: &Vector3<f64>, errors: [f64; AXES], scale_factor: impl Fn(usize) -> f64) -> f64 {
    let part = |axis: usize| force[axis] / force.norm() * errors[axis] / scale_factor(axis);
    (0..AXES).map(|axis| part(axis).powi(2)).sum::<f64>().sqrt()
}

/// The standard errors of the net rates of each standstill \[pulse/s\]. The rows of a counter that keeps what is left
/// over vary, but their sum does not: over n rows, noise w of each row and what is left over q give the mean a variance
/// of (w + q/n)/n. Half the difference between the halves has (w + 3 q/n)/n, and a row w + q. The median over the
/// standstills, because the IMU may have turned in some.
pub fn errors_of_means(readings: &[Reading]) -> Vec<[f64; AXES]> {
    let parts = [0, 1, 2].map(|axis| {
        let of_halves = |reading: &Reading| {
            let [first, last] = reading.halves;
            let n = reading.rows.len() as f64;
            let row = reading.noise[axis].powi(2) * n;
            let square = ((last[axis] - first[axis]) / 2.0).powi(2) / CHI_SQUARE_MEDIAN * n;
            [square, row, n]
        };
        let [square, row, n] = [0, 1, 2].map(|k| median(readings.iter().map(|reading| of_halves(reading)[k])));
        let w = ((square - 3.0 * row / n) / (1.0 - 3.0 / n)).clamp(0.0, row);
        [w, row - w]
    });
    let errors = |reading: &Reading| {
        let n = reading.rows.len() as f64;
        parts.map(|[w, q]| ((w + q / n) / n).sqrt())
    };
    readings.iter().map(errors).collect()
}
