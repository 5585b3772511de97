//! ArduPilot's parameters by name, in the order of the files of its own tool.
//!
//! Instances 1 to 3 have the number within the name; 4 and 5 have a group of their own.

use crate::autopilot::Autopilot;
use crate::firmware::{ArduPilotTriad, Constants};
use crate::lines::Lines;
use crate::number::decimal;
use isotherm_shared::units::SensorKind;
use std::fmt::Write as _;

const AXES: [char; 3] = ['X', 'Y', 'Z'];

/// Decimals of coefficients and temperatures.
const COEFFICIENT: usize = 9;
const TEMPERATURE: usize = 1;

/// The first instance with names of its own group.
const GROUPED: u8 = 4;

fn prefix(instance: u8) -> String {
    if instance < GROUPED { format!("INS_TCAL{instance}_") } else { format!("INS{instance}_TCAL_") }
}

const fn letters(kind: SensorKind) -> &'static str {
    match kind {
        SensorKind::Accelerometer => "ACC",
        SensorKind::Gyroscope => "GYR",
    }
}

/// The coefficients of order k, 1 to 3.
fn coefficients(kind: SensorKind, instance: u8, k: usize) -> [String; 3] {
    AXES.map(|axis| format!("{}{}{k}_{axis}", prefix(instance), letters(kind)))
}

fn caltemp(kind: SensorKind, instance: u8) -> String {
    let sensor = letters(kind);
    if instance < GROUPED {
        format!("INS_{sensor}{instance}_CALTEMP")
    } else {
        format!("INS{instance}_{sensor}_CALTEMP")
    }
}

fn offsets(kind: SensorKind, instance: u8) -> [String; 3] {
    let first = match kind {
        SensorKind::Accelerometer => "ACCOFFS",
        SensorKind::Gyroscope => "GYROFFS",
    };
    let stem = match instance {
        1 => format!("INS_{first}"),
        2.. if instance < GROUPED => format!("INS_{}{instance}OFFS", letters(kind)),
        _ => format!("INS{instance}_{first}"),
    };
    AXES.map(|axis| format!("{stem}_{axis}"))
}

/// The first parameter of an axis that its bias comes from.
pub(crate) fn bias_name(kind: SensorKind, instance: u8, axis: usize) -> String {
    let [x, y, z] = coefficients(kind, instance, 1);
    match axis {
        0 => x,
        1 => y,
        _ => z,
    }
}

/// The text of a file with these triads of one instance, which have one range.
pub(crate) fn write(range: [f32; 2], triads: &[(SensorKind, ArduPilotTriad)], instance: u8) -> String {
    let prefix = prefix(instance);
    let mut text = format!("{prefix}ENABLE 1\n");
    // Writing to a String cannot fail.
    let mut line = |name: &str, value: f32, decimals: usize| {
        let _ = writeln!(text, "{name} {}", decimal(value, decimals));
    };
    let [low, high] = range;
    line(&format!("{prefix}TMIN"), low, TEMPERATURE);
    line(&format!("{prefix}TMAX"), high, TEMPERATURE);
    for (kind, triad) in triads {
        for k in 1..=3 {
            for (name, axis) in coefficients(*kind, instance, k).iter().zip(&triad.coefficients) {
                line(name, axis[k - 1], COEFFICIENT);
            }
        }
    }
    for (kind, triad) in triads {
        let Some(Constants { temperature, offsets: values }) = triad.constants else { continue };
        line(&caltemp(*kind, instance), temperature, TEMPERATURE);
        for (name, value) in offsets(*kind, instance).iter().zip(values) {
            line(name, value, COEFFICIENT);
        }
    }
    text
}

/// Reads a triad of an instance. Accelerometers must be there; gyroscopes need not: `Some(None)`.
pub(crate) fn read(lines: &mut Lines<'_>, kind: SensorKind, instance: u8) -> Option<Option<ArduPilotTriad>> {
    let prefix = prefix(instance);
    if !lines.any(&format!("{prefix}{}", letters(kind))) {
        if kind == SensorKind::Gyroscope {
            return Some(None);
        }
        let [first, ..] = coefficients(kind, instance, 1);
        let title = Autopilot::ArduPilot;
        let cause = "missing: the file has not this instance; give another instance or file";
        let elsewhere = lines.elsewhere();
        lines.wrong(&first, format!("{cause} ({title} was to be read){elsewhere}"));
        return None;
    }
    let (low, high) = (format!("{prefix}TMIN"), format!("{prefix}TMAX"));
    let enable = format!("{prefix}ENABLE");
    // The accelerometers have reported what both share.
    let range = if kind == SensorKind::Accelerometer {
        if lines.whole(&enable).is_some_and(|enabled| enabled != 1.0) {
            let cause = "is not 1: ArduPilot does not use these parameters, or still learns them";
            lines.wrong(&enable, format!("{cause}; give 1 if it shall use them"));
        }
        lines.range(&low, &high, &enable)
    } else {
        lines.known_range(&low, &high)
    };
    let powers = [1, 2, 3].map(|k| lines.three(coefficients(kind, instance, k), &low));
    let constants = constants(lines, kind, instance);
    let [c1, c2, c3] = powers;
    let (c1, c2, c3) = (c1?, c2?, c3?);
    let coefficients = [0, 1, 2].map(|axis| [c1[axis], c2[axis], c3[axis]]);
    Some(Some(ArduPilotTriad { range: range?, coefficients, constants: constants? }))
}

/// Calibration temperature and offsets, which are there together or not at all: `Some(None)`.
fn constants(lines: &mut Lines<'_>, kind: SensorKind, instance: u8) -> Option<Option<Constants>> {
    let (caltemp, offsets) = (caltemp(kind, instance), offsets(kind, instance));
    let names = [&caltemp].into_iter().chain(&offsets);
    let Some(beside) = names.into_iter().find(|name| lines.line(name).is_some()).cloned() else { return Some(None) };
    let temperature = lines.number(&caltemp, &beside);
    let offsets = lines.three(offsets, &beside);
    Some(Some(Constants { temperature: temperature?, offsets: offsets? }))
}
