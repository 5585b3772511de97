//! From the dwells of a campaign to a coefficient table: checks, set points, orders, fit, outliers.

use crate::checks::temperature::last_digits;
use crate::checks::{SetPoint, check, set_points};
use crate::diagnosis::{Diagnosis, diagnose, positions_off};
use crate::error::CalibrationError;
use crate::level::{is_tilt_open, level_error, position_that_explains};
use crate::one_stage::{Curves, SetPointValues, Solution, set_point_values, solve};
use crate::options::{CalibrationOptions, MAX_AUTO_ORDER, Method};
use crate::orders::OrderRules;
use crate::quality::{FittedTriad, Outlier};
use crate::reduce::{SensorReduction, reduce, sensors};
use crate::result::Calibration;
use crate::sensor::TriadUnits;
use crate::table::table_of;
use isotherm_campaign::{Campaign, Dwell, Observability, PARAMETERS, Position, joint_range, specific_force};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{OrderTable, PureError};
use isotherm_support::finding::{Finding, RunNumber, Severity, any_fault};
use nalgebra::{Matrix3, Vector3};

/// Checks that the list of positions determines all parameters.
///
/// # Errors
/// Each deficiency, with a position that would help.
pub fn accelerometers_observable(campaign: &Campaign) -> Result<[Observability; AXES], CalibrationError> {
    let found = [0, 1, 2].map(|axis| Observability::of(&campaign.positions, axis));
    let deficiencies: Vec<_> = found.iter().flat_map(|o| o.deficiencies.iter().cloned()).collect();
    if deficiencies.is_empty() {
        return Ok(found);
    }
    // An outer axis whose zero is horizontal: then a face up and a face down are missing.
    // Faces in one plane do not show the mounting, but without stated directions it is the usual one.
    let usual = |position: &Position| {
        position.angles.is_some_and(|[outer, inner]| specific_force(outer, inner) == position.specific_force)
    };
    let mount = campaign.mount.or_else(|| campaign.positions.iter().all(usual).then(Matrix3::identity));
    let turned = |position: &Position| {
        let [outer, inner] = position.angles?;
        let force = mount? * Vector3::from(specific_force(outer + 90.0, inner));
        Some(Position { specific_force: force.into(), ..position.clone() })
    };
    let turned: Option<Vec<_>> = campaign.positions.iter().map(turned).collect();
    let observes =
        |positions: &Vec<_>| (0..AXES).all(|axis| Observability::of(positions, axis).deficiencies.is_empty());
    let hint = "with 90 or -90 added to every outer_deg, and specific_force as it then is, the positions distinguish all of them: at outer_deg = 0 the inner \
                axis points up"
        .to_owned();
    let hint = turned.filter(observes).map(|_| hint);
    Err(CalibrationError::Positions(hint.into_iter().chain(deficiencies).collect()))
}

/// Makes a coefficient table of the dwells of a campaign.
///
/// # Errors
/// If the data or the positions do not allow a valid table.
pub fn calibrate_accelerometers(
    campaign: &Campaign,
    dwells: Vec<Dwell>,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let observability = accelerometers_observable(campaign)?;
    if dwells.is_empty() {
        return Err(CalibrationError::Empty);
    }
    let dwells = exclude_dwells(campaign, dwells, &options.exclude)?;
    let set_points = set_points(&dwells, campaign.positions.len());
    let data = Data { campaign, dwells: &dwells, set_points: &set_points };
    let mut accepted = Vec::new();
    let mut findings = data.checked(&options, &mut accepted)?;
    let before_fit = findings.len();
    let Fit { reduced, orders, mut solution } = data.fit(&options)?;
    solution.read_in_steps(&last_digits(&dwells));
    let (outliers, of_fit) = data.findings_of_fit(&reduced, &orders, &solution);
    findings.extend(of_fit);
    options.admission().accept(&mut findings[before_fit..], &mut accepted);
    if options.strict {
        for finding in findings.iter_mut().filter(|finding| !options.accept.contains(&finding.name)) {
            finding.severity = Severity::Fault;
        }
        if any_fault(&findings) {
            return Err(CalibrationError::Faults { diagnosis: None, findings });
        }
    }
    let curves = [0, 1, 2].map(|axis| &solution.axes[axis].curves);
    let table = table_of(campaign, curves, options.alignment.matrix(&solution)).map_err(CalibrationError::Table)?;
    if is_tilt_open(campaign, &dwells, &set_points, &solution) {
        solution.leave_tilt_open();
    }
    let suspect = position_that_explains(campaign, &dwells, &solution);
    Ok(Calibration {
        table: table.measured_at(Some(campaign.gravity_local)),
        suspect_position: suspect.map(|position| campaign.positions[position].number),
        options,
        dwells,
        set_points,
        findings,
        accepted,
        observability,
        reduced,
        orders,
        solution,
        outliers,
        gyroscopes: None,
        transients: None,
    })
}

/// The dwells of a campaign with their set points.
struct Data<'a> {
    campaign: &'a Campaign,
    dwells: &'a [Dwell],
    set_points: &'a [SetPoint],
}

/// Each set point by itself, and all together.
struct Fit {
    reduced: Vec<[SensorReduction; AXES]>,
    orders: [[OrderTable; 3]; AXES],
    solution: Solution,
}

impl Data<'_> {
    /// What is found before anything is fitted; an error if a fault is left.
    fn checked(
        &self,
        options: &CalibrationOptions,
        accepted: &mut Vec<&'static str>,
    ) -> Result<Vec<Finding>, CalibrationError> {
        let Self { campaign, dwells, set_points } = self;
        let mut findings = check(campaign, dwells, set_points, &options.exclude);
        if !any_fault(&findings) {
            // Faults come first.
            findings.splice(..0, positions_off(campaign, dwells, set_points));
        }
        let mut diagnosis = diagnose(campaign, dwells, set_points, &mut findings);
        findings.extend(campaign.gravity_warning());
        options.admission().accept(&mut findings, accepted);
        // A diagnosis is a fault too, even where its symptoms are only warnings.
        if let Some(Diagnosis { finding, .. }) = diagnosis.take_if(|it| options.accept.contains(&it.finding.name))
            && !findings.iter().any(|known| known.name == finding.name)
        {
            let mut finding = [finding];
            options.admission().accept(&mut finding, accepted);
            findings.extend(finding);
        }
        if any_fault(&findings) || diagnosis.is_some() {
            return Err(CalibrationError::Faults { diagnosis: diagnosis.map(Box::new), findings });
        }
        Ok(findings)
    }

    fn fit(&self, options: &CalibrationOptions) -> Result<Fit, CalibrationError> {
        let Self { campaign, dwells, set_points } = *self;
        let reduced_level = reduced(campaign, dwells, set_points, None)?;
        let ranges = ranges(dwells);
        let highest = options.order.unwrap_or_else(|| MAX_AUTO_ORDER.min(set_points.len().saturating_sub(2)));
        let rules = OrderRules::accelerometers();
        let order_tables = |values: &[SetPointValues], own: Option<&[[SensorReduction; AXES]]>| {
            rules.tables(values, options.order, highest, |axis, q| own_error(own?, set_points, axis, q))
        };
        let curves = |orders: &[[OrderTable; 3]; AXES]| crate::orders::curves(orders, &ranges);
        // The first joint fit uses the orders of the uncorrected values. It gives the tilt and the drift within set
        // points.
        let first_orders = order_tables(&reduced_level.iter().map(values).collect::<Vec<_>>(), None)?;
        let first_fit = solve(campaign, dwells, set_points, &curves(&first_orders), &[])?;
        let reduced = reduced(campaign, dwells, set_points, first_fit.tilt)?;
        let two_stage_values: Vec<_> = reduced.iter().map(values).collect();
        // Without the tilt, level errors that cancel in the values are in the scatter within a set point.
        let own = first_fit.tilt.map(|_| reduced.as_slice());
        let (orders, solution) = match options.method {
            Method::TwoStage => {
                let orders = order_tables(&two_stage_values, own)?;
                let solution = two_stage(campaign, dwells, set_points, &reduced, curves(&orders), first_fit.tilt);
                (orders, solution)
            }
            Method::OneStage => {
                let corrected = set_point_values(campaign, dwells, set_points, &first_fit).into_iter();
                let corrected =
                    corrected.zip(&two_stage_values).map(|(corrected, reduced)| corrected.unwrap_or(*reduced));
                let orders = order_tables(&corrected.collect::<Vec<_>>(), own)?;
                let solution = solve(campaign, dwells, set_points, &curves(&orders), &[])?;
                (orders, solution)
            }
        };
        Ok(Fit { reduced, orders, solution })
    }

    /// The outlying dwells, by index and axis, and what is to be said of the fit.
    fn findings_of_fit(
        &self,
        reduced: &[[SensorReduction; AXES]],
        orders: &[[OrderTable; 3]; AXES],
        solution: &Solution,
    ) -> (Vec<(usize, usize)>, Vec<Finding>) {
        let Self { campaign, dwells, set_points } = *self;
        let triad = FittedTriad {
            units: TriadUnits::of(SensorKind::Accelerometer),
            orders,
            set_points: set_points.iter().zip(reduced).map(|(it, reduced)| sensors(reduced, it.dwells.len())).collect(),
            places: dwells.iter().map(|dwell| dwell.position).collect(),
            residuals: &solution.residuals,
        };
        let curves = [0, 1, 2].map(|axis| solution.axes[axis].curves.clone());
        let refit = |left_out: &[usize]| {
            solve(campaign, dwells, set_points, &curves, left_out).ok().map(|solution| solution.residuals)
        };
        let (outliers, of_fit) = triad.findings(refit, |run, axis| Outlier {
            line: dwells[run].lines[0],
            set_point_c: dwells[run].set_point_c,
            number: RunNumber::Position(campaign.positions[dwells[run].position].number),
            off: format!("{:.2}e-6 g0", solution.residuals[run][axis] * 1e6),
        });
        let level = level_error(campaign, dwells, set_points, solution);
        (outliers, level.into_iter().chain(of_fit).collect())
    }
}

fn exclude_dwells(
    campaign: &Campaign,
    mut dwells: Vec<Dwell>,
    exclude: &[(f64, u32)],
) -> Result<Vec<Dwell>, CalibrationError> {
    let place = |dwell: &Dwell| (dwell.set_point_c, campaign.positions[dwell.position].number);
    let listed = |(set_point, number): &(f64, u32)| {
        dwells.iter().any(|dwell| dwell.set_point_c == *set_point)
            && campaign.positions.iter().any(|position| position.number == *number)
    };
    if let Some(&(set_point, number)) = exclude.iter().find(|place| !listed(place)) {
        return Err(CalibrationError::NothingToExclude(set_point, number));
    }
    dwells.retain(|dwell| !exclude.contains(&place(dwell)));
    Ok(dwells)
}

fn reduced(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    tilt: Option<[f64; 2]>,
) -> Result<Vec<[SensorReduction; AXES]>, CalibrationError> {
    let of = |set_point: &SetPoint, axis: usize| {
        let parts: Vec<_> = set_point.dwells.iter().map(|&dwell| &dwells[dwell]).collect();
        let positions: Vec<_> = parts.iter().map(|dwell| campaign.positions[dwell.position].clone()).collect();
        let deficient = |deficiency| CalibrationError::SetPoint { set_point_c: set_point.set_point_c, deficiency };
        match Observability::of(&positions, axis).deficiencies.into_iter().next() {
            Some(deficiency) => Err(deficient(deficiency)),
            None => reduce(campaign, &parts, axis, tilt).ok_or_else(|| {
                deficient(format!("the pulses of {} do not distinguish its parameters", AXIS_NAMES[axis]))
            }),
        }
    };
    set_points.iter().map(|set_point| Ok([of(set_point, 0)?, of(set_point, 1)?, of(set_point, 2)?])).collect()
}

fn values(reduced: &[SensorReduction; AXES]) -> SetPointValues {
    let of = |axis: usize, q: usize| (reduced[axis].temperature[q], reduced[axis].values[q]);
    [0, 1, 2].map(|axis| [of(axis, 0), of(axis, 1), of(axis, 2)])
}

/// The own error of a set point, from the scatter within the set points; `None` where they have no dwells to spare.
fn own_error(
    reduced: &[[SensorReduction; AXES]],
    set_points: &[SetPoint],
    axis: usize,
    quantity: usize,
) -> Option<PureError> {
    let spare = set_points.iter().map(|set_point| set_point.dwells.len().saturating_sub(PARAMETERS));
    let squares = reduced.iter().map(|of| of[axis].standard_errors[quantity].powi(2)).zip(spare.clone());
    let known: Vec<_> = squares.filter(|(square, spare)| *spare > 0 && square.is_finite()).collect();
    let freedom = spare.sum::<usize>() as f64;
    let variance = known.iter().map(|(square, _)| square).sum::<f64>() / known.len() as f64;
    (!known.is_empty()).then_some(PureError { variance, freedom })
}

/// Lowest and highest temperature of all samples: head and board, by axis.
fn ranges(dwells: &[Dwell]) -> [[[f64; 2]; 2]; AXES] {
    [0, 1, 2].map(|axis| {
        [
            joint_range(dwells.iter().map(|d| d.head_range(axis))),
            joint_range(dwells.iter().map(|d| d.board_range(axis))),
        ]
    })
}

/// The paper's method: curves through the values of the set points, and the means of the misalignments.
fn two_stage(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    reduced: &[[SensorReduction; AXES]],
    curves: Curves,
    tilt: Option<[f64; 2]>,
) -> Solution {
    crate::one_stage::fixed_solution(campaign, dwells, set_points, curves, tilt, |axis, k| {
        let m: Vec<f64> = reduced.iter().map(|parts| parts[axis].values[3 + k]).collect();
        let n = m.len() as f64;
        let mean = m.iter().sum::<f64>() / n;
        let variance = m.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    })
}
