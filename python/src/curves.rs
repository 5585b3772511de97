//! The curves of a calibration or table: their values with the intervals of the report.

use crate::records::Values;
use crate::value::{Reduced, reduced};
use isotherm_campaign::Campaign;
use isotherm_client::Sensor;
use isotherm_fit::{BiasCurve, CalibratedTriad, CalibrationOutcome, TableFile, TriadUnits, WarmUpCalibration};
use isotherm_report::calibration::set_points;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{CONFIDENCE, Curve as Fitted, QUANTITIES};
use numpy::PyArray1;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// The temperature of each set point, its value, and the half length of its error bar.
type Point = [f64; 3];

/// One curve over temperature.
#[pyclass(frozen, eq, hash, module = "isotherm._isotherm")]
#[derive(Clone, Deserialize, Serialize)]
pub struct Curve {
    sensor: Cow<'static, str>,
    quantity: Cow<'static, str>,
    unit: Cow<'static, str>,
    temperature_unit: String,
    /// From the unit of the fit to `unit`.
    factor: f64,
    curve: Fitted,
    /// Half width over the whole range, of a curve that is not fitted by least squares.
    half_width: Option<f64>,
    points: Vec<Point>,
}

/// The curves of a calibration, in the units of its table.
pub(crate) fn of_calibration(fitted: &CalibrationOutcome, campaign: &Campaign, table: &TableFile) -> Vec<Curve> {
    let unit = &campaign.temperature_unit;
    match fitted {
        CalibrationOutcome::Campaign(found) => {
            let triads = CalibratedTriad::all(found).enumerate();
            triads.flat_map(|(number, triad)| of_triad(&triad, number, unit)).collect()
        }
        CalibrationOutcome::Tumble(found) => {
            let units = TriadUnits::of(SensorKind::Accelerometer);
            let curve = |(sensor, quantity): (usize, usize)| {
                named((sensor, quantity), units, unit, found.curves[sensor][quantity].clone(), Vec::new())
            };
            (0..found.curves.len()).flat_map(|sensor| [0, 1, 2].map(|quantity| curve((sensor, quantity)))).collect()
        }
        CalibrationOutcome::WarmUp(found) => {
            of_table(table).into_iter().map(|curve| of_warm_up(found, curve)).collect()
        }
        CalibrationOutcome::Ramps(_) => of_table(table),
    }
}

/// The curves of a table, with the errors that its provenance has.
pub(crate) fn of_table(table: &TableFile) -> Vec<Curve> {
    let places = (0..Sensor::NAMES.len()).flat_map(|sensor| [0, 1, 2].map(|quantity| (sensor, quantity)));
    let curve = |(sensor, quantity): (usize, usize)| {
        let (curve, unit) = table.curve(sensor, quantity)?;
        Some(Curve {
            sensor: Sensor::NAMES[sensor].1.into(),
            quantity: QUANTITIES[quantity].into(),
            unit: unit.into(),
            temperature_unit: table.table.content().temperature_unit.clone(),
            factor: 1.0,
            curve,
            half_width: None,
            points: Vec::new(),
        })
    };
    places.filter_map(curve).collect()
}

fn of_triad(triad: &CalibratedTriad<'_>, number: usize, temperature_unit: &str) -> Vec<Curve> {
    let curve = |(axis, quantity): (usize, usize)| {
        let points = set_points(triad, axis, quantity);
        let place = (number * triad.curves.len() + axis, quantity);
        named(place, triad.units, temperature_unit, triad.curves[axis][quantity].clone(), points)
    };
    (0..triad.curves.len()).flat_map(|axis| [0, 1, 2].map(|quantity| curve((axis, quantity)))).collect()
}

fn named(
    (sensor, quantity): (usize, usize),
    units: &TriadUnits,
    temperature_unit: &str,
    curve: Fitted,
    points: Vec<Point>,
) -> Curve {
    let (factor, unit) = if quantity == 0 { (units.bias_factor, units.bias) } else { (1.0, units.scale_factor) };
    let scaled = |[at, value, half]: Point| [at, value * factor, half * factor];
    Curve {
        sensor: Sensor::NAMES[sensor].1.into(),
        quantity: QUANTITIES[quantity].into(),
        unit: unit.into(),
        temperature_unit: temperature_unit.to_owned(),
        factor,
        curve,
        half_width: None,
        points: points.into_iter().map(scaled).collect(),
    }
}

/// A bias curve of a warm-up with the band between sweeps and the means, in the unit of the table.
fn of_warm_up(found: &WarmUpCalibration, curve: Curve) -> Curve {
    let own = |bias: &&BiasCurve| curve.quantity == QUANTITIES[0] && bias.name() == curve.sensor;
    let Some(bias) = found.biases.iter().find(own) else { return curve };
    let units = TriadUnits::of(bias.kind);
    // Biases of the fit are in g0, those of tables may be in ug0.
    let factor = if curve.unit == units.bias { units.bias_factor } else { 1.0 };
    let points = bias.points.iter().map(|it| [it.temperature, it.value * factor, f64::NAN]).collect();
    let half_width = bias.band.as_ref().map(|band| band.half_width * factor);
    Curve { half_width, points, ..curve }
}

#[pymethods]
impl Curve {
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }

    #[getter]
    fn sensor(&self) -> &str {
        &self.sensor
    }

    #[getter]
    fn quantity(&self) -> &str {
        &self.quantity
    }

    #[getter]
    fn unit(&self) -> &str {
        &self.unit
    }

    #[getter]
    fn temperature_unit(&self) -> &str {
        &self.temperature_unit
    }

    #[getter]
    fn range(&self) -> (f64, f64) {
        self.curve.range().into()
    }

    #[getter]
    fn order(&self) -> usize {
        self.curve.order()
    }

    #[getter]
    fn points(&self) -> Vec<Point> {
        self.points.clone()
    }

    /// The values at these temperatures, and the half widths of their 95 % intervals, NaN where they are not known: at
    /// each by itself, or of the band that holds for the whole curve.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        temperature: Values<f64>,
        whole: bool,
    ) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let quantile = match whole {
            true => self.curve.band_quantile(CONFIDENCE),
            false => self.curve.point_quantile(CONFIDENCE),
        };
        let half = |at: f64| match quantile {
            Some(quantile) => self.curve.half_width(at, quantile).map(|half| half * self.factor),
            None => {
                let [low, high] = self.curve.range();
                self.half_width.filter(|_| (low..=high).contains(&at))
            }
        };
        let values: Vec<f64> = temperature.iter().map(|at| self.curve.at(*at) * self.factor).collect();
        let halves: Vec<f64> = temperature.iter().map(|at| half(*at).unwrap_or(f64::NAN)).collect();
        (PyArray1::from_vec(py, values), PyArray1::from_vec(py, halves))
    }
}
