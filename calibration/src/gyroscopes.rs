//! The gyroscopes of a campaign: from dwells and turns to their part of the table.
//!
//! The accelerometers are calibrated first, from the dwells alone ([`calibrate`](crate::calibrate::calibrate)). Their fit gives the base's
//! tilt. The gyroscopes are then fitted to dwells and turns together:
//!
//! 1. [`turn`]: the turns of the campaign file; [`runs`]: their rows.
//! 2. [`observability`]: what positions and turns determine, before there are data.
//! 3. `checks`: turns that were not as the campaign file says.
//! 4. [`fit`]: each set point by itself, then all together.
//! 5. [`earth`]: Earth's rate in IMU coordinates; the check of the latitude; stations without angles.
//! 6. [`result`]: what was found.
//!
//! Over 400 lines: the steps in their order, with what they hand on.

mod checks;
pub mod earth;
pub mod fit;
pub mod observability;
mod quality;
pub mod result;
pub mod runs;

pub use result::{GyroscopeCalibration, is_alignment_needed};
pub use runs::{FittedRun, Measurements, OtherDevice, Place, read};

use crate::alignment::{AlignmentChoice, is_needed as accelerometers_need_alignment};
use crate::calibrate::{
    Calibration, CalibrationError, CalibrationOptions, MAX_AUTO_ORDER, Method, admit,
    calibrate as calibrate_accelerometers, observable as accelerometers_observable,
};
use crate::checks::scale::unlike_scale_factors;
use crate::checks::{Finding, Severity, name};
use crate::noise;
use crate::one_stage::{OneStageError, SetPointValues};
use crate::ramps::{add_transients, refuse_options};
use earth::{EarthCheck, LeftOver};
use fit::{GyroscopeCurves, ReducedSetPoint, Run, RunTurn, TriadSolution, corrected_values, reduce, solve};
use isotherm_campaign::Campaign;
use isotherm_campaign::{Dwell, joint_range};
use isotherm_shared::polynomial::MAX_ORDER;
use isotherm_shared::table::{Axis, CoefficientTable, FORMAT, GYROSCOPE_NAMES, Gyroscopes, Refusal};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::AXES;
use isotherm_statistics::Curve;
use isotherm_statistics::{OrderTable, QUANTITIES, Rule};
use nalgebra::{DVector, Matrix3, Vector3};
use observability::TriadObservability;
use runs::{GyroscopeRuns, TurnRun};

/// Smallest change of D that justifies a higher order \[deg/h\].
pub const BIAS_EFFECT: f64 = 1e-3;
/// Smallest relative change of a scale factor that justifies a higher order.
pub const SCALE_FACTOR_EFFECT: f64 = 0.5e-6;
/// The lowest order that is chosen, as far as the set points allow it: the model is cubic. A term that the noise of a set point hides still moves
/// the curve by some ppm.
const LEAST_ORDER: usize = 3;
/// Probability of choosing a term without effect, over the orders of a curve: 1 % over the nine curves of the triad.
const SIGNIFICANCE: f64 = 0.01 / 9.0;

/// Checks that positions and turns determine all parameters of both triads; of the accelerometers only, if the campaign file has no turns.
///
/// # Errors
/// Each deficiency, with a position or turn that would help.
pub fn observable(campaign: &Campaign) -> Result<TriadObservability, CalibrationError> {
    let found = TriadObservability::of(campaign);
    let mut deficiencies = match accelerometers_observable(campaign) {
        Err(CalibrationError::Positions(deficiencies)) => deficiencies,
        _ => Vec::new(),
    };
    if !campaign.turns.is_empty() {
        deficiencies.extend(found.deficiencies.iter().cloned());
    }
    if deficiencies.is_empty() { Ok(found) } else { Err(CalibrationError::Positions(deficiencies)) }
}

/// Makes a coefficient table of both triads from a campaign; of the accelerometers only, if the campaign file has no turns. Ramps beside the
/// positions give lag and transients. Ramps alone are for [`ramps::calibrate`](crate::ramps::calibrate).
///
/// # Errors
/// If the data, the positions, the turns or the ramps do not allow a valid table.
pub fn calibrate(
    campaign: &Campaign,
    mut measurements: Measurements,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    refuse_options(campaign, &options)?;
    let ramps = core::mem::take(&mut measurements.ramps);
    let mut calibration = calibrate_static(campaign, measurements, options)?;
    if !ramps.is_empty() {
        add_transients(campaign, &mut calibration, &ramps)?;
    }
    let Calibration { options, accepted, findings, table, .. } = &mut calibration;
    // It causes others, and they do not cause it.
    findings.splice(0..0, admit(unlike_scale_factors(table), options, accepted)?);
    Ok(calibration)
}

/// The table of dwells and turns.
fn calibrate_static(
    campaign: &Campaign,
    measurements: Measurements,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let Measurements { dwells, gyroscopes, other_device, .. } = measurements;
    let devices: Vec<_> = other_device.map(|other| other.finding(campaign)).into_iter().collect();
    // Before anything is said about samples of another unit.
    if !devices.is_empty() && !options.accept.contains(&name::OTHER_DEVICE) {
        return Err(CalibrationError::Faults { diagnosis: None, findings: devices });
    }
    if campaign.turns.is_empty() {
        let mut calibration = calibrate_accelerometers(campaign, dwells, options)?;
        add_findings(&mut calibration, devices)?;
        if gyroscopes.present {
            let message = "the samples have gyroscopes, but the campaign file has no [[turn]]: only the accelerometers are calibrated";
            let finding = Finding::whole(Severity::Warning, name::NO_TURNS, message.to_owned());
            add_findings(&mut calibration, vec![finding])?;
        }
        return Ok(calibration);
    }
    let observability = observable(campaign)?;
    let (excluded_turns, excluded_dwells) = options
        .exclude
        .iter()
        .copied()
        .partition::<Vec<_>, _>(|(_, number)| campaign.turns.iter().any(|turn| turn.start.number == *number));
    let for_accelerometers = CalibrationOptions { exclude: excluded_dwells, ..options.clone() };
    let mut calibration = calibrate_accelerometers(campaign, dwells, for_accelerometers)?;
    calibration.options = options;
    add_findings(&mut calibration, devices)?;
    let first_finding = calibration.findings.len();
    let data = Data::new(campaign, &calibration, &gyroscopes, &excluded_turns)?;
    let findings = checks::check(&data, &excluded_turns, gyroscopes.present);
    add_findings(&mut calibration, findings)?;
    let (found, findings) = estimate(&data, &calibration, observability, first_finding)?;
    let table = table(&calibration, &found.solution)?;
    calibration.table = table.measured_on(found.turntable(calibration.solution.tilt, campaign.mount));
    calibration.gyroscopes = Some(found);
    add_findings(&mut calibration, findings)?;
    Ok(calibration)
}

/// Adds findings of the gyroscopes to those of the accelerometers; an error if one of them is a fault that is not accepted.
fn add_findings(calibration: &mut Calibration, findings: Vec<Finding>) -> Result<(), CalibrationError> {
    let Calibration { options, accepted, findings: known, .. } = calibration;
    known.extend(admit(findings, options, accepted)?);
    Ok(())
}

/// The runs of the gyroscopes with their set points.
struct Data<'a> {
    campaign: &'a Campaign,
    /// Temperatures of the set points \[degC\].
    set_points_c: Vec<f64>,
    tilt: Option<[f64; 2]>,
    /// Set point and dwell.
    dwells: Vec<(usize, &'a Dwell)>,
    /// Set point and turn.
    turns: Vec<(usize, &'a TurnRun)>,
    /// Turns at set points without dwells.
    strays: Vec<&'a TurnRun>,
}

impl<'a> Data<'a> {
    fn new(
        campaign: &'a Campaign,
        calibration: &Calibration,
        gyroscopes: &'a GyroscopeRuns,
        excluded_turns: &[(f64, u32)],
    ) -> Result<Self, CalibrationError> {
        let number = |turn: &TurnRun| campaign.turns[turn.run.position].start.number;
        let is = |turn: &TurnRun, place: &(f64, u32)| (turn.run.set_point_c, number(turn)) == *place;
        // A turn that is missing may be left out as well as one that is there.
        let mut runs = gyroscopes.dwells.iter().chain(gyroscopes.turns.iter().map(|turn| &turn.run));
        let unknown = excluded_turns.iter().find(|(set_point_c, _)| !runs.any(|run| run.set_point_c == *set_point_c));
        if let Some(&(set_point_c, number)) = unknown {
            return Err(CalibrationError::NothingToExclude(set_point_c, number));
        }
        let mut dwells = Vec::new();
        for (index, set_point) in calibration.set_points.iter().enumerate() {
            for &dwell in &set_point.dwells {
                // Both triads' dwells are of the same rows.
                let line = calibration.dwells[dwell].lines[0];
                dwells
                    .extend(gyroscopes.dwells.iter().find(|dwell| dwell.lines[0] == line).map(|dwell| (index, dwell)));
            }
        }
        // A turn belongs to the visit of its temperature that is nearest in the file.
        let set_point = |turn: &TurnRun| {
            let distance = |dwell: &Dwell| dwell.lines[0].abs_diff(turn.run.lines[0]);
            let of_its_temperature = dwells.iter().filter(|(_, dwell)| dwell.set_point_c == turn.run.set_point_c);
            of_its_temperature.min_by_key(|(_, dwell)| distance(dwell)).map(|(set_point, _)| *set_point)
        };
        let (mut turns, mut strays) = (Vec::new(), Vec::new());
        for turn in gyroscopes.turns.iter().filter(|turn| !excluded_turns.iter().any(|place| is(turn, place))) {
            match set_point(turn) {
                Some(set_point) => turns.push((set_point, turn)),
                None => strays.push(turn),
            }
        }
        let set_points_c = calibration.set_points.iter().map(|set_point| set_point.set_point_c).collect();
        Ok(Self { campaign, set_points_c, tilt: calibration.solution.tilt, dwells, turns, strays })
    }

    /// The runs for the fit: the dwells, then the turns; with the place of each.
    fn runs(&self) -> (Vec<Run<'a>>, Vec<FittedRun>) {
        let mut runs = Vec::new();
        let mut places = Vec::new();
        let hand = self.campaign.mount.map_or(1.0, |mount| mount.determinant().signum());
        let dwells = self.dwells.iter().map(|(set_point, dwell)| (*set_point, *dwell, None));
        let turns = self.turns.iter().map(|(set_point, turn)| (*set_point, &turn.run, Some(*turn)));
        for (set_point, run, turn) in dwells.chain(turns) {
            let (place, start) = match turn {
                Some(_) => (Place::Turn(run.position), &self.campaign.turns[run.position].start),
                None => (Place::Position(run.position), &self.campaign.positions[run.position]),
            };
            let earth::Start { force, earth, by_horizontal } = earth::Start::of(self.campaign, start, self.tilt);
            places.push(FittedRun {
                set_point,
                place,
                lines: run.lines,
                start_ns: run.time_ns[0],
                seconds: run.sums.seconds,
                residual: [0.0; AXES],
            });
            runs.push(Run {
                set_point,
                seconds: run.sums.seconds,
                pulses: [0, 1, 2].map(|axis| [run.sums.positive[axis], run.sums.negative[axis]]),
                head: [0, 1, 2].map(|axis| run.head(axis)),
                board: [0, 1, 2].map(|axis| run.board(axis)),
                force,
                earth,
                by_horizontal,
                horizontal: Vec::new(),
                group: None,
                turn: turn.map(|turn| RunTurn {
                    axis: Vector3::from(self.campaign.turns[run.position].axis),
                    angle: self.campaign.turns[run.position].angle_deg * 3600.0,
                    hand,
                    blocks: &turn.blocks,
                }),
            });
        }
        (runs, places)
    }

    /// Lowest and highest telemetry of all runs: head and board, by gyroscope.
    fn ranges(&self) -> [[[f64; 2]; 2]; AXES] {
        let runs = || self.dwells.iter().map(|(_, dwell)| *dwell).chain(self.turns.iter().map(|(_, turn)| &turn.run));
        [0, 1, 2].map(|axis| {
            [joint_range(runs().map(|run| run.head_range(axis))), joint_range(runs().map(|run| run.board_range(axis)))]
        })
    }
}

/// The estimate, with what is to be said about it.
fn estimate(
    data: &Data<'_>,
    calibration: &Calibration,
    observability: TriadObservability,
    first_finding: usize,
) -> Result<(GyroscopeCalibration, Vec<Finding>), CalibrationError> {
    let options = &calibration.options;
    let (mut runs, mut places) = data.runs();
    if data.campaign.mount.is_none() {
        earth::eliminate_horizontal(&mut runs, &places);
    }
    let ranges = data.ranges();
    let first = checks::first_scale_factors(data);
    let reduced = (0..data.set_points_c.len()).map(|index| {
        let turns: Vec<_> = data.turns.iter().filter(|(place, _)| *place == index).collect();
        // Turns may have been left out.
        let missing =
            observability::scale_factors(turns.iter().map(|(_, turn)| &data.campaign.turns[turn.run.position]));
        if let Some(deficiency) = missing.into_iter().next() {
            return Err(CalibrationError::SetPoint { set_point_c: data.set_points_c[index], deficiency });
        }
        let of_set_point: Vec<_> = runs.iter().filter(|run| run.set_point == index).cloned().collect();
        let constant = |axis: usize, q: usize| {
            let value = if q == 0 { 0.0 } else { first[axis][q - 1] };
            Curve::new([0.0, 1.0], DVector::from_element(1, value), None, 0, ranges[axis][q.min(1)])
        };
        let start = [0, 1, 2].map(|axis| [0, 1, 2].map(|q| constant(axis, q)));
        reduce(&of_set_point, &start).map_err(|_| CalibrationError::SetPoint {
            set_point_c: data.set_points_c[index],
            deficiency:
                "its dwells and turns do not tell the gyroscopes' parameters apart; measure again what was left out"
                    .to_owned(),
        })
    });
    let reduced = reduced.collect::<Result<Vec<_>, _>>()?;
    let highest = options.order.unwrap_or_else(|| MAX_AUTO_ORDER.min(reduced.len().saturating_sub(2)));
    let order_tables = |values: &[SetPointValues]| order_tables(values, options.order, highest);
    let curves = |orders: &[[OrderTable; 3]; AXES]| -> GyroscopeCurves {
        let curve = |axis: usize, q: usize| {
            Curve::of(&orders[axis][q].regression, orders[axis][q].choice.order, ranges[axis][q.min(1)])
        };
        [0, 1, 2].map(|axis| [curve(axis, 0), curve(axis, 1), curve(axis, 2)])
    };
    let values = |reduced: &ReducedSetPoint| {
        [0, 1, 2].map(|axis| [0, 1, 2].map(|q| (reduced.telemetry[axis][q], reduced.values[axis][q])))
    };
    let two_stage_values: Vec<_> = reduced.iter().map(values).collect();
    let first_orders = order_tables(&two_stage_values)?;
    let (orders, solution) = match options.method {
        Method::TwoStage => {
            let solution = two_stage(&runs, &reduced, &curves(&first_orders))
                .ok_or(CalibrationError::Fit(OneStageError::Divergence))?;
            (first_orders, solution)
        }
        Method::OneStage => {
            let orders = order_tables(&corrected_values(&runs, &reduced, &curves(&first_orders))?)?;
            let solution = solve(&runs, reduced.len(), &curves(&orders), &[])?;
            (orders, solution)
        }
    };
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
    let (unfit, fit_findings) = quality::lack_of_fit(&orders, &reduced);
    findings.extend(fit_findings);
    let mut outliers = quality::outliers(&runs, &places, reduced.len(), &solution);
    // Residuals about a curve that does not fit do not show outlying runs.
    outliers.retain(|(_, axis)| !unfit[*axis]);
    findings
        .extend(outliers.iter().map(|outlier| quality::outlier(data.campaign, &data.set_points_c, &places, outlier)));
    findings.extend(quality::order_findings(&orders));
    let noise = noise::of_dwells(data.dwells.iter().map(|(_, dwell)| *dwell), &axes(&solution)?);
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

fn order_tables(
    values: &[SetPointValues],
    fixed: Option<usize>,
    highest: usize,
) -> Result<[[OrderTable; 3]; AXES], CalibrationError> {
    let of = |axis: usize, q: usize| -> Result<OrderTable, CalibrationError> {
        let values = || values.iter().map(|value| value[axis][q]);
        let size = values().map(|(_, y)| y.abs()).fold(0.0, f64::max);
        let (effect, unit) = if q == 0 { (BIAS_EFFECT, "deg/h") } else { (SCALE_FACTOR_EFFECT * size, "pulse/arcsec") };
        let rule = Rule { significance: SIGNIFICANCE, effect: Some(effect), unit, least: LEAST_ORDER };
        let failed = |error| CalibrationError::Order { axis: GYROSCOPE_NAMES[axis], quantity: QUANTITIES[q], error };
        OrderTable::of_set_points(values(), fixed, highest, &rule).map_err(failed)
    };
    let axis = |axis: usize| Ok::<_, CalibrationError>([of(axis, 0)?, of(axis, 1)?, of(axis, 2)?]);
    Ok([axis(0)?, axis(1)?, axis(2)?])
}

/// Curves through the values of the set points, and the means of everything else.
fn two_stage(runs: &[Run<'_>], reduced: &[ReducedSetPoint], curves: &GyroscopeCurves) -> Option<TriadSolution> {
    let n = reduced.len() as f64;
    let mean = |value: &dyn Fn(&ReducedSetPoint) -> f64| {
        let mean = reduced.iter().map(value).sum::<f64>() / n;
        let variance = reduced.iter().map(|part| (value(part) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    };
    let constants = [0, 1, 2].map(|axis| [3, 4, 5, 6, 7].map(|k| mean(&|part| part.values[axis][k])));
    let earth = [0, 1].map(|k| mean(&|part| part.earth.unwrap_or_default()[k]));
    fit::JointModel::new(runs, reduced.len(), curves).fixed(constants, earth)
}

/// Bias, K+ and K- of the gyroscopes as a table has them.
fn axes(solution: &TriadSolution) -> Result<[Axis; AXES], CalibrationError> {
    let refuse = |axis: usize, quantity: usize| {
        let key = format!("gyroscope.{}.{}", GYROSCOPE_NAMES[axis], QUANTITIES[quantity]);
        CalibrationError::Table(vec![Refusal { key, message: format!("tables hold orders up to {MAX_ORDER}") }])
    };
    let axis = |axis: usize| -> Result<Axis, CalibrationError> {
        let curves = &solution.gyroscopes[axis].curves;
        let polynomial = |q: usize| curves[q].polynomial(1.0).ok_or_else(|| refuse(axis, q));
        Ok(Axis {
            bias_unit: BiasUnit::DegreePerHour,
            bias: polynomial(0)?,
            transient: 0.0,
            positive_scale_factor: polynomial(1)?,
            negative_scale_factor: polynomial(2)?,
            max_rate: None,
        })
    };
    Ok([axis(0)?, axis(1)?, axis(2)?])
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
    content.format = FORMAT;
    content.alignment = alignment(calibration.misalignment());
    content.gyroscopes = Some(Gyroscopes {
        axes: axes(solution)?,
        g_sensitivity: [0, 1, 2].map(|axis| Some(solution.gyroscopes[axis].g_sensitivity)),
        alignment: alignment(result::misalignment(solution)),
    });
    let gravity_local = calibration.table.gravity_local();
    CoefficientTable::new(content).map(|table| table.measured_at(gravity_local)).map_err(CalibrationError::Table)
}
