//! What is wrong with recordings at one attitude.

use super::result::BiasCurve;
use crate::checks::scale::zero_of;
use crate::ramps::ONE_DIRECTION_REMEDY;
use crate::sensor::TriadUnits;
use crate::transients::{RampRecording, Transients, bin_values};
use isotherm_campaign::rate_at_rest;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Severity, name};

/// What was found in files and concerns every curve: it is said before anything is fitted.
const IN_FILES: [&str; 2] = [name::INTERVAL, name::CLOCKS_APART];
/// Rows cover at least this part of the time.
const COVERED: f64 = 0.5;
/// The length of the specific force at rest may be off by this part of 1 g0: biases of cheap sensors are in it.
const LENGTH: f64 = 0.2;
/// The temperature of a warm-up moves by this at least \[degC\].
pub const LEAST_WARM_UP_SPAN: f64 = 2.0;
/// Temperature of an IMU that works \[degC\].
const CELSIUS: [f64; 2] = [-80.0, 150.0];
/// Temperature over this looks like kelvin up to `MILLI`, then like thousandths of a degree.
const MILLI: f64 = 1000.0;
/// What is said of temperature that is far below and above all temperatures.
const COUNTS: &str = "it looks like counts of the thermometer: give temperature.scale and temperature.offset in a \
                      mapping (--mapping), with which degC = scale * number + offset; an MPU-6050 has 0.00294117647 and \
                      36.53, thousandths of a degree 0.001 and 0";
/// Counts of thermometers have 16 bits.
const MOST_COUNTS: f64 = 32_768.0;
/// The temperature has settled where it moves by under this part of its largest rate …
const SETTLED: f64 = 0.1;
/// … for this part of a recording.
const SETTLED_PART: f64 = 0.02;
/// The cubic of an autopilot leaves clearly less if it leaves less than this part.
const BESIDE: f64 = 0.9;
/// Rates are means over this part of a recording.
const RATE_PART: f64 = 0.01;

/// What is found before anything is fitted.
pub(super) fn before(recordings: &[RampRecording], nominal: &CoefficientTable) -> Vec<Finding> {
    let of_recording = |recording: &RampRecording| {
        let of_file = recording.findings().iter().filter(|finding| IN_FILES.contains(&finding.name)).cloned();
        let interval = recording.continuity().interval().map(|fault| {
            let finding = fault.finding();
            Finding { message: format!("{}: {}", recording.name(), finding.message), ..finding }
        });
        let found = [
            covered(recording),
            celsius(recording, nominal),
            still(recording, nominal),
            dead(recording, nominal),
            length(recording, nominal),
            rate(recording, nominal),
        ];
        of_file.chain(interval).chain(found.into_iter().flatten()).collect::<Vec<_>>()
    };
    recordings.iter().flat_map(of_recording).collect()
}

/// What is found in the sweeps.
pub(super) fn after(found: &Transients) -> Vec<Finding> {
    let unknown = found.biases.iter().find(|bias| bias.curve_error.is_none()).map(|bias| {
        let message = format!(
            "no recordings heat and cool over half of the range of {}: the errors of the curves are not known; {ONE_DIRECTION_REMEDY}",
            bias.name()
        );
        Finding::warning(name::ONE_DIRECTION, message)
    });
    unknown.into_iter().collect()
}

/// What is said last: temperature that never settles, and what was found in the files.
pub(super) fn last(recordings: &[RampRecording], nominal: &CoefficientTable) -> Vec<Finding> {
    let of_files = recordings.iter().flat_map(|recording| recording.findings().iter().cloned());
    let of_files = of_files.filter(|finding| !IN_FILES.contains(&finding.name));
    let unit = &nominal.content().temperature_unit;
    recordings.iter().filter_map(|recording| settled(recording, unit)).chain(of_files).collect()
}

/// Biases of which the cubic of an autopilot, or parameters that are on board, leave clearly less on the same rows.
pub(super) fn beside(biases: &[BiasCurve], gravity: f64) -> Vec<Finding> {
    let better = |bias: &BiasCurve| {
        let cubics = bias.beside.iter().map(|(of, _, spread)| (of.title(), spread.sd));
        let others = cubics.chain(bias.on_board.iter().map(|it| (it.name.as_str(), it.after.sd)));
        let (of, least) = others.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let [theirs, ours] = [least, bias.after.sd].map(|sd| TriadUnits::of(bias.kind).si_text(sd, gravity));
        (least < BESIDE * bias.after.sd).then(|| format!("{} {theirs} ({of}) instead of {ours}", bias.name()))
    };
    let all: Vec<_> = biases.iter().filter_map(better).collect();
    let message = format!(
        "what --beside names leaves less of the same rows: {}; look at the residuals in the report, or give --order 3",
        all.join(", ")
    );
    if all.is_empty() { Vec::new() } else { vec![Finding::warning(name::BESIDE_LEAVES_LESS, message)] }
}

/// Rows that usually cover little of the time to the next one: their interval is far too short. A hole is none.
fn covered(recording: &RampRecording) -> Option<Finding> {
    let interval_s = recording.usual_interval_s();
    let covered = interval_s / (interval_s + recording.usual_gap_s());
    (covered < COVERED).then(|| {
        let message = format!(
            "{}: rows of {interval_s} s cover {:.1} % of the time; give the true interval, about {:.4} s if no rows are lost",
            recording.name(),
            covered * 100.0,
            interval_s / covered
        );
        Finding::fault(name::INTERVAL, message)
    })
}

/// Temperature that does not move far enough for a curve.
fn still(recording: &RampRecording, nominal: &CoefficientTable) -> Option<Finding> {
    let unit = &nominal.content().temperature_unit;
    let [low, high] = recording.extremes(0)[0]?;
    (zero_of(unit).is_some() && high - low < LEAST_WARM_UP_SPAN).then(|| {
        let message = format!(
            "{}: the temperature moves by {:.2} {unit}; a curve over temperature needs {LEAST_WARM_UP_SPAN} at least: warm up, or cool",
            recording.name(),
            high - low
        );
        Finding::whole(Severity::Fault, name::TEMPERATURE_CONSTANT, message)
    })
}

/// Sensors whose counts never change.
fn dead(recording: &RampRecording, nominal: &CoefficientTable) -> Option<Finding> {
    let content = nominal.content();
    let gyroscopes = content.gyroscopes.as_ref().filter(|_| recording.has_gyroscopes());
    let triads = [(SensorKind::Accelerometer, &content.axes)].into_iter();
    let triads = triads.chain(gyroscopes.map(|gyroscopes| (SensorKind::Gyroscope, &gyroscopes.axes)));
    let sensors = triads.flat_map(|(kind, axes)| axes.iter().enumerate().map(move |(axis, of)| (kind, axis, of)));
    let is_dead = |(kind, axis, of): &(SensorKind, usize, &Axis)| {
        bin_values(recording, *kind, *axis, of, None).windows(2).all(|pair| pair[0].value == pair[1].value)
    };
    let names: Vec<_> = sensors.filter(is_dead).map(|(kind, axis, _)| kind.names()[axis]).collect();
    (!names.is_empty()).then(|| {
        let message =
            format!("{}: {} never changes; look at its column and its converter", recording.name(), names.join(", "));
        Finding::whole(Severity::Fault, name::DEAD_AXIS, message)
    })
}

/// Temperature that is no degree Celsius.
fn celsius(recording: &RampRecording, nominal: &CoefficientTable) -> Option<Finding> {
    if zero_of(&nominal.content().temperature_unit) != Some(0.0) {
        return None;
    }
    let [low, high] = recording.extremes(0)[0]?;
    let cause = match () {
        () if low.abs().max(high) <= MOST_COUNTS && (low < CELSIUS[0] && high > CELSIUS[1] || low < -MILLI) => COUNTS,
        () if low < -MILLI || high > MILLI => {
            "it looks like thousandths of a degree: divide it by 1000, with temperature.scale = 0.001 in a mapping \
             (--mapping); of counts give temperature.scale and temperature.offset of the sensor"
        }
        () if low > CELSIUS[1] => {
            "it looks like kelvin: subtract 273.15, with temperature.offset = -273.15 in a mapping (--mapping)"
        }
        () if low < CELSIUS[0] || high > CELSIUS[1] => {
            "it is not a temperature of an IMU: look at its column and its unit"
        }
        () => return None,
    };
    let message = format!("{}: the temperature is {low:.1} to {high:.1} degC; {cause}", recording.name());
    Some(Finding::fault(name::TEMPERATURE_OFFSET, message))
}

/// A length of the specific force that is not gravity.
fn length(recording: &RampRecording, nominal: &CoefficientTable) -> Option<Finding> {
    let content = nominal.content();
    let force = [0, 1, 2].map(|axis| recording.mean_indicated(axis, &content.axes[axis]));
    let length = force.iter().map(|f| f * f).sum::<f64>().sqrt();
    let cause = match length * content.gravity {
        _ if (length - 1.0).abs() <= LENGTH => return None,
        si if (si - 1.0).abs() <= LENGTH => {
            "the readings look like g, not m/s2: give accelerometer.unit = \"g\" in a mapping (--mapping)"
        }
        _ if (length / content.gravity - 1.0).abs() <= LENGTH => {
            "the readings look like m/s2, not g: give accelerometer.unit = \"m/s2\" in a mapping (--mapping)"
        }
        _ => {
            "keep the IMU at rest; give accelerometer.unit (or scale) and time.interval_s of the readings in a mapping \
             (--mapping), or the \
              table of this IMU"
        }
    };
    let message = format!(
        "{}: {length:.4} g0 on average at rest, {:.4} m/s2; {cause}",
        recording.name(),
        length * content.gravity
    );
    Some(Finding::fault(name::NOT_GRAVITY, message))
}

/// A rate that no gyroscope has at rest.
fn rate(recording: &RampRecording, nominal: &CoefficientTable) -> Option<Finding> {
    let gyroscopes = nominal.content().gyroscopes.as_ref().filter(|_| recording.has_gyroscopes())?;
    let rates = [0, 1, 2].map(|axis| recording.mean_indicated(AXES + axis, &gyroscopes.axes[axis]));
    let finding = rate_at_rest(rates)?;
    Some(Finding { message: format!("{}: {}", recording.name(), finding.message), ..finding })
}

/// Temperature that never settles: the sensing elements are behind it by their lag all the time.
fn settled(recording: &RampRecording, unit: &str) -> Option<Finding> {
    let rates = recording.rates_of_temperature(RATE_PART);
    let largest = rates.iter().copied().fold(0.0, f64::max);
    let settled = rates.iter().filter(|rate| **rate < SETTLED * largest).count();
    let part = settled as f64 / rates.len().max(1) as f64;
    let rate = largest * 60.0;
    (part < SETTLED_PART && !rates.is_empty()).then(|| {
        let message = format!(
            "{}: the temperature moves by up to {rate:.1} {unit} a minute and never settles: a sensing element that is 60 s behind \
             it is up to {rate:.1} {unit} off everywhere; warm up more slowly, or wait at the end",
            recording.name()
        );
        Finding::warning(name::NOT_SETTLED, message)
    })
}
