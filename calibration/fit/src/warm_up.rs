//! Bias curves from recordings at one attitude, while the IMU warms up or cools: what PX4 and ArduPilot call
//! temperature calibration.
//!
//! # Method
//! 1. `rest`: the stretches at rest are recordings of their own from here on; bad rows were left out while they were
//!    read.
//! 2. The recordings are [ramps](crate::ramps): lag and transient of each bias, the band between sweeps, steps, another
//!    unit, missing rows are found as there. `nominal` gives everything but the bias curves.
//! 3. `curves`: each curve goes through means of 1/200 of the temperature's range, which weigh by how they scatter;
//!    each recording has a constant of its own.
//! 4. `order`: all curves are cubics, unless a higher order predicts sweeps that are left out clearly better.
//! 5. The constant of an accelerometer's curve contains the attitude: the curve keeps the bias of `nominal` at the
//!    reference temperature. That of a gyroscope stays in, with Earth's rate.
//!
//! The error of a curve is the band: how far heating and cooling are apart at the same temperature. No curve over
//! temperature can be better. One sweep does not show it: the 95 % interval from noise is compared with what a lag of a
//! minute would make.

mod beside;
mod checks;
mod curves;
mod jumps;
mod options;
mod order;
mod result;

pub use checks::LEAST_WARM_UP_SPAN;
pub use options::{OnBoard, WarmUpOptions};
pub use order::{OrderChoice, TriedOrder};
pub use result::{BEHIND_S, BiasCurve, OnBoardCurve, Spread, SweepPoint, SweepSpan, WarmUpCalibration};

use crate::admit::admit;
use crate::checks::scale::zero_of;
use crate::error::CalibrationError;
use crate::options::CalibrationOptions;
use crate::ramps::{RampCalibration, ramp_calibration};
use crate::rest::at_rest;
use crate::table::{axis_mut, axis_of, set_bias};
use crate::transients::{BiasTransient, BinValue, RampRecording, bin_values};
use curves::{Part, Scatter, Series, Shape, Weight, spread};
use isotherm_autopilot::Autopilot;
use isotherm_campaign::Campaign;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::{CELSIUS, SensorKind};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{largest, sweeps};
use isotherm_support::finding::{Finding, any_fault};
use std::collections::BTreeMap;

/// Standard errors of a 95 % interval.
const NORMAL_95: f64 = 1.96;

/// Bins of the range where the temperature's unit is no degree.
const WIDE: f64 = 60.0;

/// Makes a table of recordings at one attitude. `nominal` gives everything but the bias curves.
///
/// # Errors
/// If `nominal` is no table for these recordings, if a recording is of another device or moved, if its unit or interval
/// is wrong, or if nothing can be estimated.
pub fn calibrate_warm_up(
    campaign: &Campaign,
    recordings: &[RampRecording],
    nominal: &CoefficientTable,
    options: &WarmUpOptions,
) -> Result<WarmUpCalibration, CalibrationError> {
    if !options.on_board.is_empty() && !CELSIUS.contains(&nominal.content().temperature_unit.as_str()) {
        let unit = &nominal.content().temperature_unit;
        let message =
            format!("the temperature is in {unit:?}, and parameters of autopilots are over degC; leave them out");
        return Err(CalibrationError::Options(message));
    }
    let fit_options = CalibrationOptions {
        accept: options.accept.clone(),
        strict: options.strict,
        lag: options.lag,
        ..CalibrationOptions::default()
    };
    let rest = at_rest(recordings);
    let recordings = rest.recordings.as_slice();
    if any_fault(&rest.findings) && recordings.is_empty() {
        return Err(CalibrationError::Faults { diagnosis: None, findings: rest.findings });
    }
    let before = rest.findings.into_iter().chain(checks::before(recordings, nominal)).collect();
    let mut ramps = ramp_calibration(campaign, recordings, nominal, fit_options, before, checks::after)?;
    let series = all_series(recordings, &ramps);
    let found = jumps::jumps(&series, recordings, nominal.content().gravity);
    add(&mut ramps, found, checks::last(recordings, nominal))?;
    let parts = sweeps_of(&series);
    let scatters: Option<Vec<Scatter>> = series.iter().map(Series::scatter).collect();
    let scatters = scatters.ok_or_else(|| few(0))?;
    let choice = order::choose(&series, &scatters, &parts, options.order, options.highest_order);
    let [low, high] = series.first().map_or([0.0; 2], |bias| bias.range);
    let at = options.at.unwrap_or_else(|| low.midpoint(high));
    if !(low..=high).contains(&at) {
        let message = format!(
            "the reference temperature is {at}, and the temperature reaches from {low} to {high}; give one of it"
        );
        return Err(CalibrationError::Options(message));
    }
    let bin = if zero_of(&nominal.content().temperature_unit).is_some() { 1.0 } else { (high - low) / WIDE };
    let order = choice.order;
    let made = CurveContext { ramps: &ramps, sweeps: &parts, at, bin, options };
    let curve = |(bias, scatter): (&Series, &Scatter)| made.curve(bias, *scatter, order);
    let biases: Option<Vec<BiasCurve>> = series.iter().zip(&scatters).map(curve).collect();
    let biases = biases.ok_or_else(|| few(order))?;
    add(&mut ramps, Vec::new(), checks::beside(&biases, nominal.content().gravity))?;
    ramps.table = with_curves(&ramps, &biases, recordings)?;
    let sweeps = parts.iter().filter_map(|part| span(&series, part)).collect();
    let recordings = recordings.iter().map(|recording| recording.name().to_owned()).collect();
    let rows = rest.accounts;
    let options = options.clone();
    Ok(WarmUpCalibration { ramps, options, recordings, rows, order: choice, at, bin, sweeps, biases })
}

/// Why there is no curve.
fn few(order: usize) -> CalibrationError {
    let remedy = if order > 0 { "give a lower one" } else { "record the IMU while its temperature changes" };
    CalibrationError::Options(format!("the temperature has too few temperatures for order {order}; {remedy}"))
}

/// Adds what was found first, and last, to the findings of the ramps.
fn add(ramps: &mut RampCalibration, first: Vec<Finding>, last: Vec<Finding>) -> Result<(), CalibrationError> {
    let mut all = admit(first, &ramps.options, &mut ramps.accepted)?;
    all.append(&mut ramps.findings);
    all.extend(admit(last, &ramps.options, &mut ramps.accepted)?);
    ramps.findings = all;
    Ok(())
}

/// The biases of all sensors that the ramps have.
fn all_series(recordings: &[RampRecording], ramps: &RampCalibration) -> Vec<Series> {
    let content = ramps.table.content();
    let of = |transient: &BiasTransient| {
        let axis = axis_of(content, transient.kind, transient.axis)?;
        let lag_s = content.lag_s.filter(|_| transient.transient != 0.0);
        let of_recording = |recording: &RampRecording| {
            let mut bins = bin_values(recording, transient.kind, transient.axis, axis, lag_s);
            bins.iter_mut().for_each(|bin| bin.value -= transient.transient * bin.difference);
            bins
        };
        Some(Series {
            kind: transient.kind,
            axis: transient.axis,
            range: extremes(recordings, transient.kind, transient.axis, HEAD)?,
            recordings: recordings.iter().map(of_recording).collect(),
        })
    };
    ramps.transients.biases.iter().filter_map(of).collect()
}

/// Temperatures of a sensor.
const HEAD: usize = 0;
const BOARD: usize = 1;

/// Least and largest temperature of a sensor in all rows.
fn extremes(recordings: &[RampRecording], kind: SensorKind, axis: usize, which: usize) -> Option<[f64; 2]> {
    let sensor = axis + if kind == SensorKind::Gyroscope { AXES } else { 0 };
    let all = recordings.iter().filter_map(|recording| recording.extremes(sensor)[which]);
    all.reduce(|[a, b], [low, high]| [a.min(low), b.max(high)])
}

/// The sweeps of the mean temperature of the accelerometers.
fn sweeps_of(series: &[Series]) -> Vec<Part> {
    let count = series.first().map_or(0, |bias| bias.recordings.len());
    let of_recording = |recording: usize| {
        let heads = series.get(..AXES).unwrap_or(series);
        let bins = heads.first().map_or(0, |bias| bias.recordings[recording].len());
        let mean = |bin: usize| heads.iter().map(|bias| bias.recordings[recording][bin].temperature).sum::<f64>();
        let temperature: Vec<f64> = (0..bins).map(mean).collect();
        sweeps(&temperature).into_iter().map(move |sweep| Part { recording, bins: sweep.values })
    };
    (0..count).flat_map(of_recording).collect()
}

fn span(series: &[Series], part: &Part) -> Option<SweepSpan> {
    let bins = series.first()?.bins(part);
    let (first, last) = (bins.first()?, bins.last()?);
    Some(SweepSpan {
        recording: part.recording,
        heating: last.temperature > first.temperature,
        temperature: [first.temperature, last.temperature],
        age_s: [first.age_s, last.age_s],
    })
}

/// What the curves are made with.
struct CurveContext<'a> {
    ramps: &'a RampCalibration,
    sweeps: &'a [Part],
    at: f64,
    bin: f64,
    options: &'a WarmUpOptions,
}

impl CurveContext<'_> {
    /// The curve of a bias; `None` if its temperature does not determine it.
    fn curve(&self, bias: &Series, scatter: Scatter, order: usize) -> Option<BiasCurve> {
        let shape = bias.fit(&bias.whole(), order, Weight::Scatter(scatter))?;
        let transients = &self.ramps.transients.biases;
        let transient = transients.iter().find(|it| it.kind == bias.kind && it.axis == bias.axis)?;
        let nominal = axis_of(self.ramps.curves.content(), bias.kind, bias.axis)?;
        let constant = match bias.kind {
            SensorKind::Accelerometer => nominal.bias_at(nominal.bias.clamp(self.at)).0,
            SensorKind::Gyroscope => shape.constant()? + shape.at(self.at),
        };
        // Without the constant of its recording, which has the attitude in it.
        let own = |recording: usize| shape.constants[recording].unwrap_or_default();
        let raw = |bin: &BinValue| bin.value + transient.transient * bin.difference;
        let left = |of: &dyn Fn(&BinValue) -> f64| {
            let recordings = bias.recordings.iter().enumerate();
            let value = |recording: usize| move |bin: &BinValue| (bin.temperature, of(bin) - own(recording));
            let values = recordings.flat_map(|(recording, bins)| bins.iter().map(value(recording)));
            spread_of(values, self.bin)
        };
        let beside = |autopilot: &Autopilot| {
            let cubic = beside::cubic(*autopilot, bias, &raw)?;
            let polynomial = cubic.polynomial(self.at, constant)?;
            Some((*autopilot, polynomial, left(&|bin| raw(bin) - cubic.at(bin.temperature))))
        };
        let gravity = self.ramps.curves.content().gravity;
        let on_board = |parameters: &OnBoard| {
            let subtracted = beside::of_parameters(parameters, bias, gravity)?;
            let shift = constant - subtracted(self.at);
            Some(OnBoardCurve {
                name: parameters.name.clone(),
                points: places(bias.range).map(|temperature| (temperature, subtracted(temperature) + shift)).collect(),
                after: left(&|bin| raw(bin) - subtracted(bin.temperature)),
            })
        };
        Some(BiasCurve {
            kind: bias.kind,
            axis: bias.axis,
            curve: shape.polynomial(self.at, constant)?,
            before: left(&|bin| raw(bin) - nominal.bias_at(nominal.bias.clamp(bin.temperature)).0),
            after: left(&|bin| bin.value - shape.at(bin.temperature)),
            interval: self.interval(bias, &shape, scatter),
            behind: largest(self.sweeps.iter().map(|sweep| behind(bias, &shape, sweep))),
            band: transient.curve_error.clone(),
            points: self.points(bias, &shape, constant),
            beside: self.options.beside.iter().filter_map(beside).collect(),
            on_board: self.options.on_board.iter().filter_map(on_board).collect(),
        })
    }

    /// Largest half width of the 95 % interval of a curve over its range.
    fn interval(&self, bias: &Series, shape: &Shape, scatter: Scatter) -> f64 {
        let together = shape.together(bias, scatter);
        let at = (bias.kind == SensorKind::Accelerometer).then_some(self.at);
        let error = |temperature: f64| shape.standard_error(temperature, at, together);
        NORMAL_95 * largest(places(bias.range).map(error))
    }

    /// The means of each sweep in wide bins, on the curve's constant.
    fn points(&self, bias: &Series, shape: &Shape, constant: f64) -> Vec<SweepPoint> {
        let shift = constant - shape.at(self.at);
        let of_sweep = |(sweep, part): (usize, &Part)| {
            let means = bias.means(core::slice::from_ref(part), self.bin);
            let own = shape.constants[part.recording].unwrap_or_default();
            let point = move |(_, mean): (i64, curves::Mean)| SweepPoint {
                sweep,
                temperature: mean.temperature,
                age_s: mean.age_s,
                value: mean.value - own + shift,
                residual: mean.value - own - shape.at(mean.temperature),
            };
            means.into_iter().map(point).collect::<Vec<_>>()
        };
        self.sweeps.iter().enumerate().flat_map(of_sweep).collect()
    }
}

/// How far a curve is off at most in a sweep if the element is [`BEHIND_S`] behind its temperature.
fn behind(bias: &Series, shape: &Shape, sweep: &Part) -> f64 {
    let [low, high] = bias.range;
    let means = bias.means(core::slice::from_ref(sweep), bias.narrow());
    let off = means.windows(2).map(|pair| {
        let [(_, from), (_, to)] = pair else { return 0.0 };
        let change = (to.temperature - from.temperature).abs();
        let slope = (shape.at(to.temperature) - shape.at(from.temperature)) / change;
        // What is further behind than the range is at the other end of it.
        slope.abs() * (change / (to.age_s - from.age_s).abs() * BEHIND_S).min(high - low)
    });
    off.filter(|off| off.is_finite()).fold(0.0, f64::max)
}

/// Places of a range, its ends among them.
fn places([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    const INTERVALS: usize = 120;
    (0..=INTERVALS).map(move |k| low + (high - low) * k as f64 / INTERVALS as f64)
}

/// Standard deviation and largest distance of the means of bins of the temperature, of temperature and value.
fn spread_of(values: impl Iterator<Item = (f64, f64)>, bin: f64) -> Spread {
    let mut all: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for (temperature, value) in values {
        let (sum, count) = all.entry((temperature / bin).floor() as i64).or_default();
        *sum += value;
        *count += 1.0;
    }
    let means: Vec<f64> = all.values().map(|(sum, count)| sum / count).collect();
    let [sd, largest] = spread(&means);
    Spread { sd, largest }
}

/// The table with the curves, over the range of the rows. Scale factors that do not depend on temperature reach as far.
fn with_curves(
    ramps: &RampCalibration,
    biases: &[BiasCurve],
    recordings: &[RampRecording],
) -> Result<CoefficientTable, CalibrationError> {
    let mut content = ramps.table.content().clone();
    for bias in biases {
        let board = extremes(recordings, bias.kind, bias.axis, BOARD);
        let axis = axis_mut(&mut content, bias.kind, bias.axis);
        set_bias(axis, &bias.curve);
        for scale_factor in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
            let ([low, high], Some([least, most])) = (scale_factor.range(), board) else { continue };
            if scale_factor.coefficients().len() == 1 {
                let range = [low.min(least), high.max(most)];
                let (center, scale) = (scale_factor.center(), scale_factor.scale());
                let wider = Polynomial::new(scale_factor.coefficients(), center, scale, range);
                *scale_factor = wider.unwrap_or(*scale_factor);
            }
        }
    }
    content.format = content.least_format();
    let table = CoefficientTable::new(content).map_err(CalibrationError::Table)?;
    Ok(table.measured_at(ramps.curves.gravity_local()))
}
