//! Static poses with glitches of the thermometer.

use super::reading::Reading;
use super::temperature;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Location, name};

/// Share of a static pose's rows beyond which glitches of the temperature break it.
const MOST_GLITCHES: f64 = 0.2;
/// An error code is one if the temperature of both neighbours is as many steps, of at least so much, off it.
const ELSEWHERE: f64 = 10.0;
const ELSEWHERE_LEAST: f64 = 0.1;

/// The readings without those whose temperature is broken, with a line for each that has glitches.
pub(super) fn without_glitches(readings: Vec<Reading>) -> (Vec<Reading>, Vec<Finding>) {
    let is_code = |index: usize| {
        let at = |index: usize| readings.get(index).map(|reading: &Reading| reading.temperature_medians);
        let off = |other: Option<[[f64; AXES]; 2]>, sensor: usize, axis: usize, code: f64| {
            let step = readings[index].temperature_step;
            other.is_none_or(|other| (other[sensor][axis] - code).abs() > ELSEWHERE * step.max(ELSEWHERE_LEAST))
        };
        let neighbours = [index.checked_sub(1).and_then(at), at(index + 1)];
        let medians = readings[index].temperature_medians;
        (0..2).flat_map(|sensor| (0..AXES).map(move |axis| (sensor, axis))).any(|(sensor, axis)| {
            let code = medians[sensor][axis];
            temperature::ERROR_CODES.contains(&code)
                && neighbours.iter().any(Option::is_some)
                && neighbours.iter().all(|other| off(*other, sensor, axis, code))
        })
    };
    let broken: Vec<bool> = (0..readings.len())
        .map(|index| {
            let reading = &readings[index];
            reading.temperature_glitches as f64 > MOST_GLITCHES * reading.rows.len() as f64 || is_code(index)
        })
        .collect();
    let finding = |(reading, broken): (&Reading, &bool)| {
        let message = match (*broken, reading.temperature_glitches) {
            (false, 0) => return None,
            (false, rows) => {
                let rows = if rows == 1 { "one row".to_owned() } else { format!("{rows} rows") };
                format!("{rows} of the temperature are glitches of the thermometer: left out of mean and range")
            }
            (true, _) => "the temperature is broken: the static pose is left out".to_owned(),
        };
        Some(Finding::warning(name::TEMPERATURE_GLITCH, message).at(Location::StaticPose(reading.number)))
    };
    let findings = readings.iter().zip(&broken).filter_map(finding).collect();
    let mut broken = broken.into_iter();
    let kept = readings.iter().filter(|_| !broken.next().unwrap_or_default()).cloned().collect();
    (kept, findings)
}
