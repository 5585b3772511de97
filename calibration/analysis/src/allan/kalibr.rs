//! The noise of an IMU as the file `imu.yaml` of Kalibr, the calibration of cameras and IMUs.
//!
//! Kalibr's densities are those of continuous time and two-sided: white noise n with E\[n(t1) n(t2)\] = sigma^2
//! delta(t1 - t2), and a bias that is the integral of such noise (ethz-asl/kalibr, wiki page "IMU Noise Model"). These
//! are N and K. Kalibr has one value for a triad; it is that of the worst axis.

use crate::allan::curve::Allan;
use crate::allan::model::Coefficient;
use crate::allan::rate::RateKind;
use crate::allan::recording::NoiseAnalysis;
use crate::allan::sensor::SensorNoise;
use isotherm_shared::units::{ARCSEC, SensorKind};
use std::fmt::Write as _;

/// The file. `gravity` is the value of 1 g0 \[m/s2\]. A figure that the analysis does not give is a comment that says
/// why. `None` if the analysis is without a table, as counts have no physical unit, or if too many rows are
/// [lost](NoiseAnalysis::lost).
#[must_use]
pub fn imu_yaml(analysis: &NoiseAnalysis, gravity: f64, source: &str) -> Option<String> {
    if analysis.sensors.iter().any(|sensor| sensor.kind == RateKind::Counts) || analysis.lost().is_some() {
        return None;
    }
    // A file name must not end the comment.
    let source: String = source.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut text = format!(
        "# Noise of {source}: worst axis of each triad, two-sided densities of continuous time.\n\
         rostopic: /imu0  # change it to the topic of the IMU\nupdate_rate: {:.6}  # Hz\n",
        1.0 / analysis.interval_s
    );
    let of_accelerometers = [("noise_density", "m/s^2/sqrt(Hz)", 1), ("random_walk", "m/s^3/sqrt(Hz)", 3)];
    let of_gyroscopes = [("noise_density", "rad/s/sqrt(Hz)", 1), ("random_walk", "rad/s^2/sqrt(Hz)", 3)];
    let triads = [
        (SensorKind::Accelerometer, "accelerometer", of_accelerometers, gravity),
        (SensorKind::Gyroscope, "gyroscope", of_gyroscopes, ARCSEC),
    ];
    for (kind, triad, keys, factor) in triads {
        let sensors: Vec<_> = analysis.sensors.iter().filter(|sensor| sensor.sensor == kind).collect();
        for (name, unit, coefficient) in keys {
            // Writing to a String cannot fail.
            let _ = match worst(&sensors, coefficient, factor) {
                Ok((value, why)) => writeln!(text, "{triad}_{name}: {value:.6e}  # {unit}; {why}"),
                Err(why) => writeln!(text, "# {triad}_{name}: not written, {why}; fill it in [{unit}]"),
            };
        }
    }
    Some(text)
}

/// The largest coefficient with this index of a triad, and what it is, or why there is none.
fn worst(sensors: &[&SensorNoise], index: usize, factor: f64) -> Result<(f64, String), String> {
    if sensors.is_empty() {
        return Err("the recording or the table has no gyroscopes".to_owned());
    }
    let mut found: Vec<(&str, Coefficient, &str)> = Vec::new();
    for sensor in sensors {
        let contamination = sensor.contamination().map(|(line, _)| &line.without);
        let without = if contamination.is_some() { ", without the straight line in head temperature" } else { "" };
        let allan: Option<&Allan> = contamination.or(sensor.allan.as_ref());
        let model = allan.and_then(|allan| allan.model.as_ref()).filter(|model| model.holds());
        let model = model.ok_or_else(|| format!("the model does not hold for {}", sensor.name))?;
        if !allan.is_some_and(|allan| allan.gives(index)) {
            return Err(format!("a step was taken out of {}", sensor.name));
        }
        found.push((sensor.name, model.coefficients[index], without));
    }
    let largest = |of: fn(&Coefficient) -> Option<f64>| {
        let values = found.iter().filter_map(|(name, coefficient, without)| Some((*name, of(coefficient)?, *without)));
        values.max_by(|a, b| a.1.total_cmp(&b.1))
    };
    if let Some((name, value, without)) = largest(|it| it.is_significant().then_some(it.value)) {
        return Ok((value * factor, format!("{name}{without}")));
    }
    let (name, below, without) = largest(Coefficient::below).ok_or("the model gives no range")?;
    let why = format!("an upper limit (95 %) of {name}{without}: no axis shows any, and Kalibr needs a value over 0");
    Ok((below * factor, why))
}
