//! The ramps of a campaign: their [transients](crate::transients) go into the table of its positions or, without
//! positions, into another table.
//!
//! # Only ramps
//! They show how each bias changes with temperature, at one attitude. The table that the campaign file calls `curves`
//! gives everything else. Its bias curves are replaced by those of the ramps, each shifted to keep its value at mid
//! range: the constant of a ramp contains the attitude (1 mrad is 1000 ug0) and Earth's rate. What such a table does
//! not know stands in [`RampCalibration::not_known`].

use crate::admit::admit;
use crate::checks::scale::unlike_scale_factors;
use crate::error::CalibrationError;
use crate::options::{CalibrationOptions, refuse_options};
use crate::result::Calibration;
use crate::transients::{CurveSource, RampRecording, TransientOptions, Transients, fit};
use isotherm_campaign::Campaign;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable, Content};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::device;
use isotherm_support::finding::{Finding, Severity, name};

/// What a ramp indicates may differ by this from its stated specific force \[g0\]: biases are part of it.
const FORCE: f64 = 0.1;
/// An axis that carries more specific force has a curve that contains the change of its scale factor \[g0\].
const CARRIED_G0: f64 = 0.01;

/// What gives errors of curves.
pub(crate) const ONE_DIRECTION_REMEDY: &str = "heat and cool, in one recording or in several";

/// The result of a campaign with only ramps.
#[derive(Clone, Debug)]
pub struct RampCalibration {
    /// The table: that of `curves`, with the bias curves and the transients of the ramps.
    pub table: CoefficientTable,
    /// The table that gave everything else.
    pub curves: CoefficientTable,
    /// The options it was made with.
    pub options: CalibrationOptions,
    /// Warnings.
    pub findings: Vec<Finding>,
    /// Names of the faults that were accepted, and are warnings now.
    pub accepted: Vec<&'static str>,
    /// Number of recordings.
    pub recordings: usize,
    /// What the ramps show.
    pub transients: Transients,
}

impl RampCalibration {
    /// What the table knows, in one line.
    #[must_use]
    pub fn accuracy(&self) -> String {
        let names: Vec<_> = self.transients.biases.iter().map(crate::transients::BiasTransient::name).collect();
        let count = self.recordings;
        let noun = if count == 1 { "recording" } else { "recordings" };
        format!(
            "the change of the biases of {} with temperature, at one attitude, from {count} {noun} of ramps; {}; nothing else was measured",
            names.join(", "),
            self.transients.curve_errors()
        )
    }

    /// What the table does not know, in sentences.
    #[must_use]
    pub fn not_known(&self) -> Vec<String> {
        let content = self.table.content();
        let g_sensitivity =
            content.gyroscopes.as_ref().is_some_and(|found| found.g_sensitivity.iter().any(Option::is_some));
        let of_gyroscopes = if g_sensitivity { ", g-sensitivities" } else { "" };
        let measured = |kind| self.transients.biases.iter().any(|bias| bias.kind == kind);
        let earth = if measured(SensorKind::Gyroscope) {
            "attitude (1 mrad is 1000 ug0) and Earth's rate (up to 15 deg/h)"
        } else {
            "attitude (1 mrad is 1000 ug0)"
        };
        let mut sentences = vec![
            format!("scale factors, misalignments{of_gyroscopes}: not measured; they are those of curves"),
            format!(
                "the constant of each bias: not measured; at mid range it is that of curves, since that of the ramps contains {earth}"
            ),
        ];
        sentences.push(format!(
            "a tilt of the fixture with temperature{}: it looks like a bias",
            if measured(SensorKind::Accelerometer) { " (1 urad is 1 ug0 on a horizontal axis)" } else { "" }
        ));
        let ranges = self.shorter_ranges();
        if !ranges.is_empty() {
            sentences.push(format!(
                "the biases beyond the temperature of the ramps, where curves had a bias: the new ranges are {}",
                ranges.join(", ")
            ));
        }
        let carrying = self.transients.biases.iter().filter(|bias| bias.carried_g0 > CARRIED_G0);
        let carrying: Vec<_> = carrying.map(|bias| format!("{} ({:.2} g0)", bias.name(), bias.carried_g0)).collect();
        if !carrying.is_empty() {
            sentences.push(format!(
                "only the bias of {}: the axis carries a specific force f, so that its curve is the bias and f dK/K, the change of its scale factor that curves \
                 does not know",
                carrying.join(", ")
            ));
        }
        if content.gyroscopes.is_some() && !measured(SensorKind::Gyroscope) {
            sentences.push(
                "the gyroscopes: the ramps have none; their curves are those of curves, without transients".to_owned(),
            );
        }
        sentences
    }

    /// The ranges of the biases that reach less far than those of `curves`.
    fn shorter_ranges(&self) -> Vec<String> {
        let (before, unit) = (self.curves.content(), &self.table.content().temperature_unit);
        let shorter = self.transients.biases.iter().filter_map(|bias| {
            let [low, high] = bias.curve.range();
            let axes = match (bias.kind, &before.gyroscopes) {
                (SensorKind::Gyroscope, Some(gyroscopes)) => &gyroscopes.axes,
                _ => &before.axes,
            };
            let [was_low, was_high] = axes[bias.axis].bias.range();
            let is_shorter = low > was_low || high < was_high;
            is_shorter.then(|| format!("{} {low:.3} .. {high:.3} {unit}", bias.name()))
        });
        shorter.collect()
    }
}

/// Makes a table of only ramps. `curves` is the table that the campaign file names.
///
/// Two recordings of a simulated IMU, whose elements follow their heads with 240 s, at 20 and 70 degC/h:
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{CalibrationOptions, RampRecording, calibrate_ramps};
/// use isotherm_campaign::Campaign;
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{RampSchedule, Truth, ramp, ramp_seed, ramps_toml};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../examples/tables/imu-whole.toml"), None)?;
/// let truth = Truth::of(table);
/// let mut schedules = [RampSchedule::default(), RampSchedule::default()];
/// schedules[1].run.ramp_c_per_s = 70.0 / 3600.0;
/// let mut recordings = ["1.csv", "2.csv"].map(RampRecording::new);
/// for ((recording, schedule), number) in recordings.iter_mut().zip(&schedules).zip(1..) {
///     ramp(&truth, schedule, ramp_seed(5, number)).try_for_each(|raw| recording.add(&raw))?;
/// }
/// let ramps = [schedules[0].ramp("1.csv"), schedules[1].ramp("2.csv")];
/// let campaign = Campaign::from_toml(&ramps_toml(&truth, "imu.toml", &ramps))?;
/// let found = calibrate_ramps(&campaign, &recordings, &truth.static_table(), CalibrationOptions::default())?;
/// assert!(found.table.content().lag_s.is_some_and(|lag_s| (lag_s / 240.0 - 1.0).abs() < 0.2));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// If an option is for positions, if `curves` is no table for these ramps, if a recording is of another device, or if
/// nothing can be estimated.
pub fn calibrate_ramps(
    campaign: &Campaign,
    ramps: &[RampRecording],
    curves: &CoefficientTable,
    options: CalibrationOptions,
) -> Result<RampCalibration, CalibrationError> {
    let has_errors = options.curves_have_errors;
    ramp_calibration(campaign, ramps, curves, options, Vec::new(), |found| {
        one_direction(curves, found, has_errors).into_iter().collect()
    })
}

/// As [`calibrate_ramps`], with further findings: `before` anything is fitted, and those `after` of what was found.
pub(crate) fn ramp_calibration(
    campaign: &Campaign,
    ramps: &[RampRecording],
    curves: &CoefficientTable,
    options: CalibrationOptions,
    before: Vec<Finding>,
    after: impl Fn(&Transients) -> Vec<Finding>,
) -> Result<RampCalibration, CalibrationError> {
    refuse_options(campaign, &options)?;
    let wrong = mismatches(campaign, curves.content());
    if !wrong.is_empty() {
        return Err(CalibrationError::Curves(wrong));
    }
    refuse_twice(ramps)?;
    let mut accepted = Vec::new();
    let before = faults(campaign, ramps, curves).into_iter().chain(before).collect();
    let mut findings = admit(before, &options, &mut accepted)?;
    let mut content = curves.content().clone();
    content.serial = campaign.serial.clone().or(content.serial);
    content.out_of_range = campaign.out_of_range.unwrap_or(content.out_of_range);
    content.max_age_s = campaign.max_age_s.or(content.max_age_s);
    if campaign.max_rate.is_some() {
        content.axes.iter_mut().for_each(|axis| axis.max_rate = campaign.max_rate);
    }
    let transients = fit(
        ramps,
        curves,
        &TransientOptions {
            curves: CurveSource::Ramps,
            lag: options.lag,
            predecessor_s: options.predecessor_lag_s.or(content.lag_s),
        },
    )?;
    let of_gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
    content.axes.iter_mut().chain(of_gyroscopes).for_each(|axis| axis.transient = 0.0);
    transients.apply(&mut content);
    let found = after(&transients).into_iter().chain(warnings(ramps, curves, &transients));
    findings.extend(admit(found.collect(), &options, &mut accepted)?);
    let of_facts = unlike_scale_factors(curves).into_iter().chain(campaign.gravity_warning()).collect();
    findings.extend(admit(of_facts, &options, &mut accepted)?);
    let table = CoefficientTable::new(content).map_err(CalibrationError::Table)?;
    Ok(RampCalibration {
        table: table.measured_at(Some(campaign.gravity_local)),
        curves: curves.clone(),
        options,
        findings,
        accepted,
        recordings: ramps.len(),
        transients,
    })
}

/// Writes what the ramps next to the positions show into the table of a calibration.
pub(crate) fn add_transients(
    campaign: &Campaign,
    calibration: &mut Calibration,
    ramps: &[RampRecording],
) -> Result<(), CalibrationError> {
    refuse_twice(ramps)?;
    let Calibration { table, options, accepted, findings, .. } = calibration;
    findings.extend(admit(faults(campaign, ramps, table), options, accepted)?);
    let found = fit(
        ramps,
        table,
        &TransientOptions { curves: CurveSource::Campaign, lag: options.lag, predecessor_s: options.predecessor_lag_s },
    )?;
    let mut content = table.content().clone();
    found.apply(&mut content);
    findings.extend(admit(warnings(ramps, table, &found), options, accepted)?);
    let new = CoefficientTable::new(content).map_err(CalibrationError::Table)?;
    *table = new.measured_at(table.gravity_local()).measured_on(table.turntable().cloned());
    calibration.transients = Some(found);
    Ok(())
}

/// # Errors
/// If two recordings have rows in common: the second shows nothing there, and would halve the errors.
fn refuse_twice(ramps: &[RampRecording]) -> Result<(), CalibrationError> {
    for (number, ramp) in ramps.iter().enumerate() {
        if let Some(same) = ramps[..number].iter().find(|other| ramp.has_rows_of(other)) {
            let message = format!("{} has rows of {}, which would count twice; take one out", ramp.name(), same.name());
            let findings = vec![Finding::fault(name::SAME_RECORDING, message)];
            return Err(CalibrationError::Faults { diagnosis: None, findings });
        }
    }
    Ok(())
}

/// What is wrong with the recordings, before anything is estimated.
fn faults(campaign: &Campaign, ramps: &[RampRecording], table: &CoefficientTable) -> Vec<Finding> {
    let mut all = devices(campaign, ramps, table);
    let of_interval = |ramp: &RampRecording| {
        ramp.continuity().not_nominal(table).map(|found| {
            let message = format!("{}: {}", ramp.name(), found.message);
            Finding { message, ..found }
        })
    };
    all.extend(ramps.iter().filter(|ramp| !ramp.fits_table()).filter_map(of_interval));
    let gravity = campaign.gravity_local / campaign.gravity_reference;
    for (ramp, recording) in campaign.ramps.iter().zip(ramps) {
        let Some(stated) = ramp.specific_force.map(|force| force.map(|f| f * gravity)) else { continue };
        let indicated = [0, 1, 2].map(|axis| recording.mean_indicated(axis, &table.content().axes[axis]));
        let off = (0..stated.len()).find(|axis| (indicated[*axis] - stated[*axis]).abs() > FORCE);
        all.extend(off.map(|axis| {
            let message = format!(
                "{}: {} indicates {:.3} g0 on average, and specific_force says {:.3} g0; correct specific_force, or leave it out",
                recording.name(),
                AXIS_NAMES[axis],
                indicated[axis],
                stated[axis]
            );
            Finding::whole(Severity::Fault, name::WRONG_POSITION, message)
        }));
    }
    all
}

/// Why a table cannot give the curves of ramps.
fn mismatches(campaign: &Campaign, curves: &Content) -> Vec<String> {
    let mut wrong = Vec::new();
    if curves.imu != campaign.imu {
        wrong.push(format!(
            "curves is the table of {}, and the campaign is of {}; give that of the same IMU",
            curves.imu, campaign.imu
        ));
    }
    if curves.temperature_unit != campaign.temperature_unit {
        wrong.push(format!(
            "the temperature of curves is in {:?}, and temperature_unit is {:?}; give a table in the unit of the ramps",
            curves.temperature_unit, campaign.temperature_unit
        ));
    }
    if curves.gravity != campaign.gravity_reference {
        wrong.push(format!(
            "1 g0 of curves is {} m/s2, and gravity_reference is {} m/s2; state that of curves, since its scale factors are per g0",
            curves.gravity, campaign.gravity_reference
        ));
    }
    wrong
}

/// The fault that ramps are of another device than the campaign file or the table says, or of two devices.
fn devices(campaign: &Campaign, ramps: &[RampRecording], table: &CoefficientTable) -> Vec<Finding> {
    let of_file = campaign.serial.as_deref().map_or(0, device);
    let found = || ramps.iter().flat_map(|ramp| ramp.devices().map(|device| (ramp.name(), device)));
    let first = found().map(|(_, device)| device).find(|device| *device != 0);
    let (expected, whose) = match (of_file, table.device()) {
        (0, 0) => (first.unwrap_or(0), "the first ramp's"),
        (0, of_table) => (of_table, "that of the serial number of curves"),
        (of_file, _) => (of_file, "that of the serial number of the campaign file"),
    };
    let fault = |message| vec![Finding::whole(Severity::Fault, name::OTHER_DEVICE, message)];
    if of_file != 0 && table.device() != 0 && of_file != table.device() {
        return fault(
            "the serial numbers of the campaign file and of curves differ; give the table of the same device \
             (--other-device makes the table anyway)"
                .to_owned(),
        );
    }
    let other = found().find(|(_, device)| *device != 0 && *device != expected);
    other.map_or_else(Vec::new, |(name, device)| {
        fault(format!(
            "{name}: rows of this ramp are from device {device:016x}, and {expected:016x} is {whose}; give ramps of \
             that device, or correct serial or the acquisition's serial number (--other-device makes the table \
             anyway)"
        ))
    })
}

/// The fault that curves whose errors are not known would replace curves that depend on temperature, or have errors.
fn one_direction(curves: &CoefficientTable, found: &Transients, has_errors: bool) -> Option<Finding> {
    let unknown = found.biases.iter().find(|bias| bias.curve_error.is_none())?;
    let content = curves.content();
    let gyroscopes = content.gyroscopes.iter().flat_map(|gyroscopes| &gyroscopes.axes);
    let order = content.axes.iter().chain(gyroscopes).map(|axis| axis.bias.coefficients().len() - 1).max()?;
    let worth = match (order, has_errors) {
        (0, false) => return None,
        (0, true) => "state their errors".to_owned(),
        (order, _) => format!("are of order {order}"),
    };
    let message = format!(
        "no ramp heats and cools over half of the range of {}: the errors of the new curves are not known, and the \
         bias curves of curves {worth}; {ONE_DIRECTION_REMEDY}, or replace them anyway with --replace-curves",
        unknown.name()
    );
    Some(Finding::fault(name::ONE_DIRECTION, message))
}

/// What is to be said of the ramps: the sweeps, the warnings of the estimate, and triads that do not match.
fn warnings(ramps: &[RampRecording], table: &CoefficientTable, found: &Transients) -> Vec<Finding> {
    let warning = |name, message| Finding::whole(Severity::Warning, name, message);
    let mut all = found.findings.clone();
    all.extend(found.warnings.iter().map(|message| warning(name::TRANSIENT, message.clone())));
    all.extend(ramps.iter().filter_map(|ramp| {
        let (losses, fault) = (ramp.continuity().losses(), ramp.continuity().fault()?);
        Some(warning(name::TIME_STEP, format!("{}: {fault}; in all {losses}", ramp.name())))
    }));
    let without = ramps.iter().find(|ramp| !ramp.has_gyroscopes());
    let message = match (&table.content().gyroscopes, without) {
        (Some(_), Some(ramp)) => {
            format!("{} has no gyroscopes, and the table has: the ramps say nothing of G1, G2 and G3", ramp.name())
        }
        (None, _) if ramps.iter().any(RampRecording::has_gyroscopes) => {
            "the ramps have gyroscopes, and the table has none: the ramps are fitted for A1, A2 and A3 only".to_owned()
        }
        _ => return all,
    };
    all.push(warning(name::RAMP_GYROSCOPES, message));
    all
}
