//! The gyroscopes of a campaign: from dwells and turns to their part of the table.
//!
//! The accelerometers are calibrated first, only from the dwells
//! ([`calibrate`](crate::accelerometers::calibrate_accelerometers)). Their fit gives the base's tilt. The gyroscopes
//! are then fitted to dwells and turns together:
//!
//! 1. [`runs`]: the rows of the turns that the campaign file lists.
//! 2. [`observability`]: what positions and turns determine, before there are data.
//! 3. `checks`: turns that were not as the campaign file says.
//! 4. [`fit`]: each set point by itself, then all together.
//! 5. [`earth`]: Earth's rate in IMU coordinates; the check of the latitude; stations without angles.
//! 6. [`result`]: what was found.

mod checks;
mod data;
pub(crate) mod earth;
mod elimination;
mod fit;
mod input;
mod model;
pub(crate) mod observability;
pub(crate) mod result;
mod rotation;
pub(crate) mod runs;
mod set_points;
pub(crate) mod solution;

pub use result::{GyroscopeCalibration, is_alignment_needed};
pub use runs::{FittedRun, Measurements, RunPlace, read_measurements};

use crate::admit::add_findings;
use crate::alignment::{AlignmentChoice, is_needed as accelerometers_need_alignment};
use crate::error::CalibrationError;
use crate::joint::OneStageError;
use crate::noise::noise_of_dwells;
use crate::one_stage::SetPointValues;
use crate::options::{CalibrationOptions, MAX_AUTO_ORDER, Method};
use crate::orders::OrderRules;
use crate::quality::{FittedTriad, Outlier};
use crate::result::Calibration;
use crate::sensor::TriadUnits;
use crate::table::gyroscope_axes;
use data::Data;
use earth::{EarthCheck, LeftOver};
use fit::solve;
use input::GyroscopeRun;
use isotherm_campaign::Campaign;
use isotherm_shared::table::{Axis, CoefficientTable, Gyroscopes};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, OrderTable};
use isotherm_support::finding::Finding;
use model::{GyroscopeCurves, GyroscopeModel};
use nalgebra::{DVector, Matrix3};
use observability::TriadObservability;
use runs::GyroscopeRuns;
use set_points::{SetPointReduction, corrected_values, reduce};
use solution::TriadSolution;

/// Fits the gyroscopes of a campaign, whose accelerometers are fitted, and writes them into the table.
pub(crate) fn add_gyroscopes(
    campaign: &Campaign,
    calibration: &mut Calibration,
    gyroscopes: &GyroscopeRuns,
    observability: TriadObservability,
    excluded_turns: &[(f64, u32)],
) -> Result<(), CalibrationError> {
    let first_finding = calibration.findings.len();
    let data = Data::new(campaign, calibration, gyroscopes, excluded_turns)?;
    let findings = checks::check(&data, excluded_turns, gyroscopes.present);
    add_findings(calibration, findings)?;
    let (found, findings) = estimate(&data, calibration, observability, first_finding)?;
    let table = table(calibration, &found.solution)?;
    calibration.table = table.measured_on(found.turntable(calibration.solution.tilt, campaign.mount));
    calibration.gyroscopes = Some(found);
    add_findings(calibration, findings)
}

/// The estimate, with what is to be said about it.
fn estimate(
    data: &Data<'_>,
    calibration: &Calibration,
    observability: TriadObservability,
    first_finding: usize,
) -> Result<(GyroscopeCalibration, Vec<Finding>), CalibrationError> {
    let (mut runs, mut places) = data.runs();
    if data.campaign.mount.is_none() {
        earth::eliminate_horizontal(&mut runs, &places);
    }
    let (ranges, first) = (data.ranges(), checks::first_scale_factors(data));
    let constant = |axis: usize, q: usize| {
        let value = if q == 0 { 0.0 } else { first[axis][q - 1] };
        Curve::new([0.0, 1.0], DVector::from_element(1, value), None, 0.0, ranges[axis][q.min(1)])
    };
    let start = [0, 1, 2].map(|axis| [0, 1, 2].map(|q| constant(axis, q)));
    let reduced = (0..data.set_points_c.len()).map(|index| reduce_set_point(data, &runs, index, &start));
    let reduced = reduced.collect::<Result<Vec<_>, _>>()?;
    let (orders, solution) = fit_runs(&ranges, &calibration.options, &runs, &reduced)?;
    for ((place, run), residual) in places.iter_mut().zip(&runs).zip(&solution.residuals) {
        place.residual = residual.map(|residual| residual * run.seconds.sqrt());
    }
    let mut findings = Vec::new();
    let earth = EarthCheck::of(data.campaign, data.tilt, &solution);
    findings.extend(earth.as_ref().and_then(|earth| earth.finding(data.campaign)));
    findings.extend(earth::hemisphere(data.campaign, &solution));
    let left_over = match data.campaign.mount {
        Some(_) => None,
        None => LeftOver::of(data.campaign, &runs, &places, reduced.len(), &solution),
    };
    findings.extend(left_over.as_ref().map(LeftOver::finding));
    let (outliers, of_fit) = quality(data, &runs, &places, &reduced, &orders, &solution);
    findings.extend(of_fit);
    let noise = noise_of_dwells(data.dwells.iter().map(|(_, dwell)| *dwell), &axes(&solution)?);
    let found = GyroscopeCalibration {
        runs: places,
        observability,
        reduced,
        orders,
        solution,
        earth,
        left_over,
        outliers,
        first_finding,
        noise,
    };
    Ok((found, findings))
}

/// The outlying runs, by index and gyroscope, and what is to be said of the fit.
fn quality(
    data: &Data<'_>,
    runs: &[GyroscopeRun<'_>],
    places: &[FittedRun],
    reduced: &[SetPointReduction],
    orders: &[[OrderTable; 3]; AXES],
    solution: &TriadSolution,
) -> (Vec<(usize, usize)>, Vec<Finding>) {
    let triad = FittedTriad {
        units: TriadUnits::of(SensorKind::Gyroscope),
        orders,
        set_points: reduced.iter().map(SetPointReduction::sensors).collect(),
        places: places.iter().map(|run| run.place).collect(),
        residuals: &solution.residuals,
    };
    let curves: GyroscopeCurves = [0, 1, 2].map(|axis| solution.gyroscopes[axis].curves.clone());
    let refit =
        |left_out: &[usize]| solve(runs, reduced.len(), &curves, left_out).ok().map(|solution| solution.residuals);
    triad.findings(refit, |run, axis| {
        let FittedRun { set_point, place, lines, residual, .. } = &places[run];
        Outlier {
            line: lines[0],
            set_point_c: data.set_points_c[*set_point],
            number: place.number(data.campaign),
            off: format!("{:.2} arcsec", residual[axis]),
        }
    })
}

/// A set point by itself, from the curves `start`.
fn reduce_set_point(
    data: &Data<'_>,
    runs: &[GyroscopeRun<'_>],
    index: usize,
    start: &GyroscopeCurves,
) -> Result<SetPointReduction, CalibrationError> {
    let deficient = |deficiency| CalibrationError::SetPoint { set_point_c: data.set_points_c[index], deficiency };
    let turns: Vec<_> = data.turns.iter().filter(|(place, _)| *place == index).collect();
    // Turns may have been left out.
    let missing = observability::scale_factors(turns.iter().map(|(_, turn)| &data.campaign.turns[turn.run.position]));
    if let Some(deficiency) = missing.into_iter().next() {
        return Err(deficient(deficiency));
    }
    let of_set_point: Vec<_> = runs.iter().filter(|run| run.set_point == index).cloned().collect();
    reduce(&of_set_point, start).map_err(|_| {
        let told =
            "its dwells and turns do not distinguish the gyroscopes' parameters; measure again what was left out";
        deficient(told.to_owned())
    })
}

/// The orders, and all runs together.
fn fit_runs(
    ranges: &[[[f64; 2]; 2]; AXES],
    options: &CalibrationOptions,
    runs: &[GyroscopeRun<'_>],
    reduced: &[SetPointReduction],
) -> Result<([[OrderTable; 3]; AXES], TriadSolution), CalibrationError> {
    let highest = options.order.unwrap_or_else(|| MAX_AUTO_ORDER.min(reduced.len().saturating_sub(2)));
    let rules = OrderRules::gyroscopes();
    let order_tables = |values: &[SetPointValues]| rules.tables(values, options.order, highest, |_, _| None);
    let curves = |orders: &[[OrderTable; 3]; AXES]| crate::orders::curves(orders, ranges);
    let values = |reduced: &SetPointReduction| {
        [0, 1, 2].map(|axis| [0, 1, 2].map(|q| (reduced.temperature[axis][q], reduced.values[axis][q])))
    };
    let two_stage_values: Vec<_> = reduced.iter().map(values).collect();
    let first_orders = order_tables(&two_stage_values)?;
    match options.method {
        Method::TwoStage => {
            let solution = two_stage(runs, reduced, &curves(&first_orders));
            Ok((first_orders, solution.ok_or(CalibrationError::Fit(OneStageError::Divergence))?))
        }
        Method::OneStage => {
            let orders = order_tables(&corrected_values(runs, reduced, &curves(&first_orders))?)?;
            let solution = solve(runs, reduced.len(), &curves(&orders), &[])?;
            Ok((orders, solution))
        }
    }
}

/// Curves through the values of the set points, and the means of everything else.
fn two_stage(
    runs: &[GyroscopeRun<'_>],
    reduced: &[SetPointReduction],
    curves: &GyroscopeCurves,
) -> Option<TriadSolution> {
    let n = reduced.len() as f64;
    let mean = |value: &dyn Fn(&SetPointReduction) -> f64| {
        let mean = reduced.iter().map(value).sum::<f64>() / n;
        let variance = reduced.iter().map(|part| (value(part) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    };
    let constants = [0, 1, 2].map(|axis| [3, 4, 5, 6, 7].map(|k| mean(&|part| part.values[axis][k])));
    let earth = [0, 1].map(|k| mean(&|part| part.earth.unwrap_or_default()[k]));
    GyroscopeModel::new(runs, reduced.len(), curves).fixed(constants, earth)
}

/// The table of both triads. Both get an alignment matrix, or neither.
fn table(calibration: &Calibration, solution: &TriadSolution) -> Result<CoefficientTable, CalibrationError> {
    let aligned = match calibration.options.alignment {
        AlignmentChoice::IfNeeded => {
            accelerometers_need_alignment(&calibration.solution) || is_alignment_needed(solution)
        }
        AlignmentChoice::With => true,
        AlignmentChoice::Without => false,
    };
    let alignment = |misalignment: Matrix3<f64>| aligned.then(|| misalignment.try_inverse()).flatten();
    let mut content = calibration.table.content().clone();
    content.alignment = alignment(calibration.misalignment());
    content.gyroscopes = Some(Gyroscopes {
        axes: axes(solution)?,
        g_sensitivity: [0, 1, 2].map(|axis| Some(solution.gyroscopes[axis].g_sensitivity)),
        alignment: alignment(result::misalignment(solution)),
    });
    content.format = content.least_format();
    let gravity_local = calibration.table.gravity_local();
    CoefficientTable::new(content).map(|table| table.measured_at(gravity_local)).map_err(CalibrationError::Table)
}

/// Bias, K+ and K- of the gyroscopes as a table has them.
fn axes(solution: &TriadSolution) -> Result<[Axis; AXES], CalibrationError> {
    let curves = [0, 1, 2].map(|axis| &solution.gyroscopes[axis].curves);
    gyroscope_axes(curves).map_err(CalibrationError::Table)
}
