//! The noise of an IMU as JSON, with keys as in the parent's [`json`](crate::json): `in_unit` is the `unit` of the same
//! object.

use crate::json::losses;
use core::f64::consts::SQRT_2;
use isotherm_analysis::{
    Allan, COEFFICIENTS, Coefficient, FLICKER_FLOOR, ModelFit, NoiseAnalysis, NoiseUnits, SensorNoise, TemperatureLine,
};
use serde_json::{Value, json};

/// The document of `isotherm noise --json`. Rows are counted from 1.
#[must_use]
pub fn document(analysis: &NoiseAnalysis) -> Value {
    json!({
        "rows": analysis.used.len(),
        "first_row": analysis.used.start + 1,
        "last_row": analysis.used.end,
        "recorded_rows": analysis.rows,
        "from_s": analysis.used_s[0],
        "to_s": analysis.used_s[1],
        "interval_s": analysis.interval_s,
        "losses": losses(analysis.losses),
        "sensors": analysis.sensors.iter().map(|each| sensor(each, &analysis.temperature_unit)).collect::<Vec<_>>(),
        "findings": crate::json::findings(&analysis.findings(), |line| line.to_string()),
    })
}

/// The noise of rates whose unit is not known, which is called "unit", beside their line in telemetry.
#[must_use]
pub fn rates(allan: &Allan, line: Option<&TemperatureLine>) -> Value {
    let units = NoiseUnits {
        rate: "unit",
        coefficients: [("unit s", 1.0), ("unit/sqrt(Hz)", 1.0), ("unit", 1.0), ("unit/(s sqrt(Hz))", 1.0)],
        density: "unit/sqrt(Hz)",
        names: ["quantisation noise", "white noise", "bias instability", "random walk of the rate"],
    };
    let mut document = curve(allan, &units);
    document["temperature"] = json!(line.map(|line| temperature(line, &units, "unit of the telemetry")));
    document
}

/// One sensor: its curve, the noise of a row, and its rate against telemetry.
fn sensor(sensor: &SensorNoise, temperature_unit: &str) -> Value {
    let units = sensor.kind.units();
    let mut document =
        sensor.allan.as_ref().map_or_else(|| json!({ "unit": units.rate }), |allan| curve(allan, &units));
    document["axis"] = json!(sensor.name);
    document["white_noise_counts"] = json!(sensor.white_counts);
    document["limit_cycle"] = json!(sensor.has_limit_cycle());
    document["temperature"] = json!(sensor.line.as_ref().map(|line| temperature(line, &units, temperature_unit)));
    document
}

fn temperature(line: &TemperatureLine, units: &NoiseUnits, temperature_unit: &str) -> Value {
    json!({
        "unit": format!("{} per {temperature_unit}", units.rate),
        "slope_in_unit": line.slope,
        "standard_error_in_unit": line.slope_error,
        "contaminated_from_s": line.contaminated_from_s,
        "without": curve(&line.without, units),
    })
}

/// The points as columns, the minimum and the model.
fn curve(allan: &Allan, units: &NoiseUnits) -> Value {
    json!({
        "unit": units.rate,
        "tau_s": allan.points.iter().map(|point| point.tau_s).collect::<Vec<_>>(),
        "adev_in_unit": allan.points.iter().map(|point| point.adev).collect::<Vec<_>>(),
        "interval_in_unit": allan.points.iter().map(|point| point.interval).collect::<Vec<_>>(),
        "degrees_of_freedom": allan.points.iter().map(|point| point.freedom).collect::<Vec<_>>(),
        "minimum": allan.minimum().map(|point| json!({
            "unit": units.rate,
            "tau_s": point.tau_s,
            "adev_in_unit": point.adev,
            "interval_in_unit": point.interval,
            "at_end": allan.falls_to_the_end(),
        })),
        "model": allan.model.as_ref().map(|fit| model(fit, units)),
    })
}

fn model(model: &ModelFit, units: &NoiseUnits) -> Value {
    let coefficients = model.coefficients.iter().enumerate().map(|(k, coefficient)| {
        let (unit, factor) = units.coefficients[k];
        let mut document = scaled(coefficient, unit, factor);
        document["letter"] = json!(COEFFICIENTS[k]);
        document["name"] = json!(units.names[k]);
        document
    });
    let [_, white, flicker, _] = &model.coefficients;
    json!({
        "holds": model.holds(),
        "chi_square": model.chi_square,
        "degrees_of_freedom": model.freedom,
        "fitted_s": model.fitted_s,
        "coefficients": coefficients.collect::<Vec<_>>(),
        "two_sided_density": scaled(white, units.density, 1.0),
        "one_sided_density": scaled(white, units.density, SQRT_2),
        "flicker_floor": scaled(flicker, units.rate, FLICKER_FLOOR),
    })
}

/// A coefficient times a factor: value and range, or what it is below.
fn scaled(coefficient: &Coefficient, unit: &str, factor: f64) -> Value {
    json!({
        "unit": unit,
        "value_in_unit": coefficient.value * factor,
        "range_in_unit": coefficient.range.map(|range| range.map(|end| end * factor)),
        "below_in_unit": coefficient.below().map(|below| below * factor),
    })
}
