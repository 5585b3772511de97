//! From the dwells of a campaign to a coefficient table: checks, set points, orders, fit, outliers.
//!
//! Over 400 lines: the steps in their order, with the errors that each can end in.

use crate::alignment::{AlignmentChoice, is_needed, misalignment};
use crate::checks::{Finding, RunNumber, SetPoint, Severity, check, name, set_points};
use crate::diagnosis::{Diagnosis, diagnose, positions_off};
use crate::gyroscopes::result::GyroscopeCalibration;
use crate::one_stage::{Curves, OneStageError, SetPointValues, Solution, set_point_values, solve};
use crate::quality::{lack_of_fit, level_error, order_findings, outliers, position_that_explains};
use crate::reduce::{Reduced, reduce};
use crate::transients::{LagChoice, Transients, TransientsError};
use isotherm_campaign::Campaign;
use isotherm_campaign::Observability;
use isotherm_campaign::Position;
use isotherm_campaign::specific_force;
use isotherm_campaign::{Dwell, joint_range};
use isotherm_failure::{Exit, Failure};
use isotherm_shared::polynomial::MAX_ORDER;
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, Content, OutOfRange, Refusal};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::AXES;
use isotherm_statistics::Curve;
use isotherm_statistics::RegressionError;
use isotherm_statistics::{BIAS_EFFECT, OrderTable, QUANTITIES, Rule, SCALE_FACTOR_EFFECT};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Most findings that are listed without being asked for.
const SHOWN: usize = 10;
/// Highest order that is considered if none is requested.
pub const MAX_AUTO_ORDER: usize = 6;

/// How the coefficients are estimated.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Method {
    /// All dwells at once, each with its own telemetry.
    #[default]
    OneStage,
    /// Each set point first, then polynomials through their values: the paper's method.
    TwoStage,
}

/// Options of a calibration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationOptions {
    /// How the coefficients are estimated.
    pub method: Method,
    /// The order of every polynomial; chosen from the data if `None`.
    pub order: Option<usize>,
    /// Whether an alignment matrix is written into the table.
    pub alignment: AlignmentChoice,
    /// Dwells to leave out: set point \[degC\] and number of the position.
    pub exclude: Vec<(f64, u32)>,
    /// Names of faults that are only warnings; see [`name`].
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
    /// How the time constant of the lag is found, from ramps.
    pub lag: LagChoice,
    /// Time constant of the table in force \[s\]: it is kept where it lies within the interval that the ramps show.
    pub predecessor_lag_s: Option<f64>,
}

/// Why no table can be made of a campaign.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The list of positions does not determine all parameters.
    #[error("{}", .0.join("\n"))]
    Positions(Vec<String>),
    /// There are no dwells.
    #[error("no rows; a campaign needs dwells")]
    Empty,
    /// Findings of the checks, at least one of them a fault.
    #[error("{}", lines(findings, diagnosis.as_deref(), false, |finding| finding.to_string()).join("\n"))]
    Faults {
        /// The single mistake that explains them, if there is one.
        diagnosis: Option<Box<Diagnosis>>,
        /// All other findings.
        findings: Vec<Finding>,
    },
    /// A dwell or turn to leave out does not exist.
    #[error("there is no dwell or turn at set point {0} degC with the number {1} to leave out")]
    NothingToExclude(f64, u32),
    /// The remaining dwells of a set point do not determine its parameters.
    #[error("set point {set_point_c} degC: {deficiency}")]
    SetPoint {
        /// The set point \[degC\].
        set_point_c: f64,
        /// The parameters that are not determined, and positions that would help.
        deficiency: String,
    },
    /// Too few set points for an order.
    #[error("{axis} {quantity}: {error}; take a lower order, or more set points")]
    Order {
        /// A1, A2 or A3.
        axis: &'static str,
        /// Name of the quantity, as in the table.
        quantity: &'static str,
        /// Why the order cannot be fitted.
        error: RegressionError,
    },
    /// An option is not for this campaign.
    #[error("{0}")]
    Options(String),
    /// The table `curves` is not for these ramps.
    #[error("{}", .0.join("\n"))]
    Curves(Vec<String>),
    /// Nothing can be estimated from the ramps.
    #[error(transparent)]
    Transients(#[from] TransientsError),
    /// The joint fit failed.
    #[error(transparent)]
    Fit(#[from] OneStageError),
    /// The result is not a valid table.
    #[error("the result is no valid table: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Table(Vec<Refusal>),
}

/// The results of a calibration.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The coefficient table.
    pub table: CoefficientTable,
    /// The options it was made with.
    pub options: CalibrationOptions,
    /// The dwells that were used.
    pub dwells: Vec<Dwell>,
    /// The set points.
    pub set_points: Vec<SetPoint>,
    /// Warnings of the checks and of the later steps.
    pub findings: Vec<Finding>,
    /// Names of the faults that were accepted, and are warnings now.
    pub accepted: Vec<&'static str>,
    /// What the positions determine, by axis.
    pub observability: [Observability; AXES],
    /// Each set point reduced by itself, by axis: the paper's values.
    pub reduced: Vec<[Reduced; AXES]>,
    /// The order tables, by axis and quantity.
    pub orders: [[OrderTable; 3]; AXES],
    /// The estimate that the table is made of.
    pub solution: Solution,
    /// Outlying dwells, which were kept in the fit: index and axis.
    pub outliers: Vec<(usize, usize)>,
    /// Number of the position without which the residuals would fall to a third, if there is one.
    pub suspect_position: Option<u32>,
    /// The gyroscopes, of a campaign with turns; see [`gyroscopes::calibrate`](crate::gyroscopes::calibrate).
    pub gyroscopes: Option<GyroscopeCalibration>,
    /// What the ramps show, of a campaign with ramps; see [`gyroscopes::calibrate`](crate::gyroscopes::calibrate).
    pub transients: Option<Transients>,
}

impl Method {
    /// Every method with its name.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::OneStage, "one-stage"), (Self::TwoStage, "two-stage")];

    /// Its name in options and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::OneStage => "one-stage",
            Self::TwoStage => "two-stage",
        }
    }
}

impl Calibration {
    /// What a table without an alignment matrix leaves, if the IMU needs one: the largest error at any attitude \[g0\].
    #[must_use]
    pub fn left_without_alignment(&self) -> Option<f64> {
        let aligned = self.table.content().alignment.is_some();
        let across = |axis: usize| {
            let [next, after] = self.solution.axes[axis].misalignment;
            next.hypot(after)
        };
        (!aligned && is_needed(&self.solution)).then(|| (0..AXES).map(across).fold(0.0, f64::max))
    }

    /// Residual standard deviation of accelerometer `axis` over all dwells \[g0\].
    #[must_use]
    pub fn residual_sd(&self, axis: usize) -> f64 {
        let sum: f64 = self.solution.residuals.iter().map(|residual| residual[axis].powi(2)).sum();
        (sum / self.dwells.len() as f64).sqrt()
    }

    /// The misalignment matrix M. Row i: sensitivity of accelerometer i to the specific force along each axis; 1 on the
    /// diagonal.
    #[must_use]
    pub fn misalignment(&self) -> Matrix3<f64> {
        misalignment(&self.solution)
    }
}

/// Checks that the list of positions determines all parameters.
///
/// # Errors
/// Each deficiency, with a position that would help.
pub fn observable(campaign: &Campaign) -> Result<[Observability; AXES], CalibrationError> {
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
    let hint = "with 90 or -90 added to every outer_deg, and specific_force as it then is, the positions tell all apart: at outer_deg = 0 the inner \
                axis points up"
        .to_owned();
    let hint = turned.filter(observes).map(|_| hint);
    Err(CalibrationError::Positions(hint.into_iter().chain(deficiencies).collect()))
}

impl CalibrationError {
    /// Names of the faults that are left, each of which must be accepted too; empty if one of them cannot be.
    #[must_use]
    pub fn acceptable(&self) -> Vec<&'static str> {
        let Self::Faults { diagnosis, findings } = self else { return Vec::new() };
        let faults = findings.iter().filter(|finding| finding.severity == Severity::Fault);
        let mut names: Vec<&'static str> = Vec::new();
        for finding in diagnosis.iter().map(|diagnosis| &diagnosis.finding).chain(faults) {
            if !names.contains(&finding.name) {
                names.push(finding.name);
            }
        }
        if names.iter().all(|name| name::acceptable(name).is_ok()) { names } else { Vec::new() }
    }

    /// The findings as lines, if they are the error. The diagnosis comes first; without `symptoms`, those that it explains are only
    /// counted, and of the others the first ten are listed.
    pub fn lines(&self, symptoms: bool, line: impl Fn(&Finding) -> String) -> Vec<String> {
        match self {
            Self::Faults { diagnosis, findings } => lines(findings, diagnosis.as_deref(), symptoms, line),
            _ => Vec::new(),
        }
    }

    /// The error as the failure of a program, with the file concerned. `campaign` is the campaign file and `samples` the
    /// recording; `locate` gives file and line of a row.
    #[must_use]
    pub fn failure(&self, campaign: &Path, samples: &Path, locate: impl Fn(u64) -> String) -> Failure {
        self.failure_with(campaign, samples, locate, false)
    }

    /// As [`failure`](Self::failure). With `symptoms`, the findings that a diagnosis explains are listed too.
    #[must_use]
    pub fn failure_with(
        &self,
        campaign: &Path,
        samples: &Path,
        locate: impl Fn(u64) -> String,
        symptoms: bool,
    ) -> Failure {
        let exit = match self {
            Self::Positions(_) | Self::Curves(_) => Exit::Config,
            Self::NothingToExclude(..) | Self::Options(_) => Exit::Usage,
            Self::Fit(_) | Self::Table(_) => Exit::Failed,
            Self::Empty | Self::Faults { .. } | Self::SetPoint { .. } | Self::Order { .. } | Self::Transients(_) => {
                Exit::Data
            }
        };
        let message = match self {
            Self::Faults { .. } => self.lines(symptoms, |finding| finding.tagged(&locate)).join("\n"),
            Self::NothingToExclude(..) => format!("--exclude: {self}"),
            Self::Options(_) => self.to_string(),
            // The name of the recording is in the message.
            Self::Transients(_) => format!("{}: the ramps: {self}", campaign.display()),
            Self::Positions(deficiencies) | Self::Curves(deficiencies) => {
                let line = |deficiency: &String| format!("{}: {deficiency}", campaign.display());
                deficiencies.iter().map(line).collect::<Vec<_>>().join("\n")
            }
            _ => format!("{}: {self}", samples.display()),
        };
        let failure = Failure::new(exit, message);
        match self {
            Self::Positions(_) | Self::Curves(_) | Self::Transients(_) => failure.at(campaign, None),
            Self::NothingToExclude(..) | Self::Options(_) => failure,
            // Each finding has its own line.
            _ => failure.at(samples, None),
        }
    }
}

/// The findings as lines. The diagnosis comes first; without `symptoms`, those that it explains are only counted, and of the others the first
/// [`SHOWN`] are listed: faults come before warnings.
fn lines(
    findings: &[Finding],
    diagnosis: Option<&Diagnosis>,
    symptoms: bool,
    line: impl Fn(&Finding) -> String,
) -> Vec<String> {
    let is_symptom = |finding: &&Finding| diagnosis.is_some_and(|diagnosis| diagnosis.explains(finding));
    let (explained, mut others): (Vec<&Finding>, Vec<&Finding>) = findings.iter().partition(is_symptom);
    others.sort_by_key(|finding| finding.severity == Severity::Warning);
    let mut lines: Vec<String> = diagnosis.iter().map(|diagnosis| line(&diagnosis.finding)).collect();
    if symptoms {
        lines.extend(others.into_iter().chain(explained).map(&line));
        return lines;
    }
    let more = others.len().saturating_sub(SHOWN);
    lines.extend(others.into_iter().take(SHOWN).map(&line));
    let symptoms = explained.len();
    let noun = if symptoms == 1 { "symptom" } else { "symptoms" };
    let rest = match (more, symptoms) {
        (0, 0) => return lines,
        (0, _) => format!("{symptoms} {noun}"),
        (_, 0) => format!("{more} more"),
        _ => format!("{more} more, and {symptoms} {noun}"),
    };
    let them = if more + symptoms == 1 { "it" } else { "them" };
    lines.push(format!("... and {rest}; isotherm calibrate -v lists {them}"));
    lines
}

/// Turns accepted faults into warnings, and adds their names to `accepted`. With `strict` every warning was a fault before.
pub fn accept(findings: &mut [Finding], options: &CalibrationOptions, accepted: &mut Vec<&'static str>) {
    for finding in findings.iter_mut() {
        if (finding.severity == Severity::Fault || options.strict) && options.accept.contains(&finding.name) {
            finding.severity = Severity::Warning;
            finding.message += "; accepted";
            if !accepted.contains(&finding.name) {
                accepted.push(finding.name);
            }
        }
    }
}

/// The findings as the options judge them: accepted faults are warnings, and with `strict` every other warning is a fault. Adds the names of
/// those that are accepted to `accepted`; an error if a fault is left.
pub fn admit(
    mut findings: Vec<Finding>,
    options: &CalibrationOptions,
    accepted: &mut Vec<&'static str>,
) -> Result<Vec<Finding>, CalibrationError> {
    findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
    accept(&mut findings, options, accepted);
    if options.strict {
        for finding in findings.iter_mut().filter(|finding| !options.accept.contains(&finding.name)) {
            finding.severity = Severity::Fault;
        }
    }
    if any_fault(&findings) {
        return Err(CalibrationError::Faults { diagnosis: None, findings });
    }
    Ok(findings)
}

/// Whether one of the findings is a fault.
pub fn any_fault(findings: &[Finding]) -> bool {
    findings.iter().any(|finding| finding.severity == Severity::Fault)
}

/// Makes a coefficient table of the dwells of a campaign.
///
/// # Errors
/// If the data or the positions do not allow a valid table.
pub fn calibrate(
    campaign: &Campaign,
    dwells: Vec<Dwell>,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let observability = observable(campaign)?;
    if dwells.is_empty() {
        return Err(CalibrationError::Empty);
    }
    let dwells = exclude_dwells(campaign, dwells, &options.exclude)?;
    let set_points = set_points(&dwells, campaign.positions.len());
    let mut findings = check(campaign, &dwells, &set_points, &options.exclude);
    if !any_fault(&findings) {
        // Faults come first.
        findings.splice(..0, positions_off(campaign, &dwells, &set_points));
    }
    let mut diagnosis = diagnose(campaign, &dwells, &set_points, &mut findings);
    let mut accepted = Vec::new();
    accept(&mut findings, &options, &mut accepted);
    // A diagnosis is a fault too, even where its symptoms are only warnings.
    if let Some(Diagnosis { finding, .. }) = diagnosis.take_if(|it| options.accept.contains(&it.finding.name))
        && !findings.iter().any(|known| known.name == finding.name)
    {
        let mut finding = [finding];
        accept(&mut finding, &options, &mut accepted);
        findings.extend(finding);
    }
    if any_fault(&findings) || diagnosis.is_some() {
        return Err(CalibrationError::Faults { diagnosis: diagnosis.map(Box::new), findings });
    }
    let before_fit = findings.len();
    let reduced_level = reduced(campaign, &dwells, &set_points, None)?;
    let ranges = ranges(&dwells);
    let highest = options.order.unwrap_or_else(|| MAX_AUTO_ORDER.min(set_points.len().saturating_sub(2)));
    let order_tables = |values: &[SetPointValues]| order_tables(values, options.order, highest);
    let curves = |orders: &[[OrderTable; 3]; AXES]| -> Curves {
        let curve = |axis: usize, q: usize| {
            Curve::of(&orders[axis][q].regression, orders[axis][q].choice.order, ranges[axis][q.min(1)])
        };
        [0, 1, 2].map(|axis| [curve(axis, 0), curve(axis, 1), curve(axis, 2)])
    };
    // The first joint fit uses the orders of the uncorrected values. It gives the tilt and the drift within set points.
    let first_orders = order_tables(&reduced_level.iter().map(values).collect::<Vec<_>>())?;
    let first_fit = solve(campaign, &dwells, &set_points, &curves(&first_orders), &[])?;
    let reduced = reduced(campaign, &dwells, &set_points, first_fit.tilt)?;
    let two_stage_values: Vec<_> = reduced.iter().map(values).collect();
    let (orders, solution) = match options.method {
        Method::TwoStage => {
            let orders = order_tables(&two_stage_values)?;
            let solution = two_stage(campaign, &dwells, &set_points, &reduced, curves(&orders), first_fit.tilt);
            (orders, solution)
        }
        Method::OneStage => {
            let corrected = set_point_values(campaign, &dwells, &set_points, &first_fit);
            let corrected: Vec<_> = corrected
                .into_iter()
                .zip(&two_stage_values)
                .map(|(corrected, reduced)| corrected.unwrap_or(*reduced))
                .collect();
            let orders = order_tables(&corrected)?;
            let solution = solve(campaign, &dwells, &set_points, &curves(&orders), &[])?;
            (orders, solution)
        }
    };
    findings.extend(level_error(campaign, &dwells, &set_points, &solution));
    let (unfit, fit_findings) = lack_of_fit(&orders, &reduced);
    findings.extend(fit_findings);
    // Residuals about a curve that does not fit do not show outlying dwells.
    let mut outliers = outliers(campaign, &dwells, &set_points, &solution);
    outliers.retain(|(_, axis)| !unfit[*axis]);
    for &(dwell, axis) in &outliers {
        let (place, residual) = (&dwells[dwell], solution.residuals[dwell][axis]);
        findings.push(Finding {
            severity: Severity::Warning,
            name: name::OUTLIER,
            line: Some(place.lines[0]),
            place: Some((place.set_point_c, Some(RunNumber::Position(campaign.positions[place.position].number)))),
            message: format!(
                "{} is {:.2}e-6 g0 off the fit, far more than the other dwells; kept, leave it out with \
                 --exclude {}/{} if it is known to be bad",
                AXIS_NAMES[axis],
                residual * 1e6,
                place.set_point_c,
                campaign.positions[place.position].number
            ),
        });
    }
    findings.extend(order_findings(&orders));
    accept(&mut findings[before_fit..], &options, &mut accepted);
    if options.strict {
        for finding in findings.iter_mut().filter(|finding| !options.accept.contains(&finding.name)) {
            finding.severity = Severity::Fault;
        }
        if any_fault(&findings) {
            return Err(CalibrationError::Faults { diagnosis: None, findings });
        }
    }
    let curves = [0, 1, 2].map(|axis| &solution.axes[axis].curves);
    let alignment = options.alignment.matrix(&solution);
    let table = table_of(campaign, curves, alignment).map_err(CalibrationError::Table)?;
    let table = table.measured_at(Some(campaign.gravity_local));
    let suspect_position =
        position_that_explains(campaign, &dwells, &solution).map(|position| campaign.positions[position].number);
    Ok(Calibration {
        table,
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
        suspect_position,
        gyroscopes: None,
        transients: None,
    })
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
) -> Result<Vec<[Reduced; AXES]>, CalibrationError> {
    let of = |set_point: &SetPoint, axis: usize| {
        let parts: Vec<_> = set_point.dwells.iter().map(|&dwell| &dwells[dwell]).collect();
        let positions: Vec<_> = parts.iter().map(|dwell| campaign.positions[dwell.position].clone()).collect();
        let deficient = |deficiency| CalibrationError::SetPoint { set_point_c: set_point.set_point_c, deficiency };
        match Observability::of(&positions, axis).deficiencies.into_iter().next() {
            Some(deficiency) => Err(deficient(deficiency)),
            None => reduce(campaign, &parts, axis, tilt).ok_or_else(|| {
                deficient(format!("the pulses of {} do not tell its parameters apart", AXIS_NAMES[axis]))
            }),
        }
    };
    set_points.iter().map(|set_point| Ok([of(set_point, 0)?, of(set_point, 1)?, of(set_point, 2)?])).collect()
}

fn values(reduced: &[Reduced; AXES]) -> SetPointValues {
    let of = |axis: usize, q: usize| (reduced[axis].telemetry[q], reduced[axis].values[q]);
    [0, 1, 2].map(|axis| [of(axis, 0), of(axis, 1), of(axis, 2)])
}

/// Lowest and highest telemetry of all samples: head and board, by axis.
fn ranges(dwells: &[Dwell]) -> [[[f64; 2]; 2]; AXES] {
    [0, 1, 2].map(|axis| {
        [
            joint_range(dwells.iter().map(|d| d.head_range(axis))),
            joint_range(dwells.iter().map(|d| d.board_range(axis))),
        ]
    })
}

fn order_tables(
    values: &[SetPointValues],
    fixed: Option<usize>,
    highest: usize,
) -> Result<[[OrderTable; 3]; AXES], CalibrationError> {
    let of = |axis: usize, q: usize| -> Result<OrderTable, CalibrationError> {
        let values = || values.iter().map(|value| value[axis][q]);
        let size = values().map(|(_, y)| y.abs()).fold(0.0, f64::max);
        let (effect, unit) = if q == 0 { (BIAS_EFFECT, "g0") } else { (SCALE_FACTOR_EFFECT * size, "pulse/(s*g0)") };
        let rule = Rule { effect: Some(effect), unit, ..Rule::default() };
        let failed = |error| CalibrationError::Order { axis: AXIS_NAMES[axis], quantity: QUANTITIES[q], error };
        OrderTable::of_set_points(values(), fixed, highest, &rule).map_err(failed)
    };
    let axis = |axis: usize| Ok::<_, CalibrationError>([of(axis, 0)?, of(axis, 1)?, of(axis, 2)?]);
    Ok([axis(0)?, axis(1)?, axis(2)?])
}

/// The paper's method: curves through the values of the set points, and the means of the misalignments.
fn two_stage(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    reduced: &[[Reduced; AXES]],
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

/// The table of the curves A, K+ and K- of each axis, with what the campaign gives it unchanged.
pub fn table_of(
    campaign: &Campaign,
    curves: [&[Curve; 3]; AXES],
    alignment: Option<Matrix3<f64>>,
) -> Result<CoefficientTable, Vec<Refusal>> {
    let refuse = |axis: usize, quantity: usize| {
        let key = format!("axis.{}.{}", AXIS_NAMES[axis], QUANTITIES[quantity]);
        vec![Refusal { key, message: format!("tables hold orders up to {MAX_ORDER}") }]
    };
    let axis = |axis: usize| -> Result<Axis, Vec<Refusal>> {
        let polynomial = |q: usize, factor: f64| curves[axis][q].polynomial(factor).ok_or_else(|| refuse(axis, q));
        Ok(Axis {
            bias_unit: BiasUnit::MicroG0,
            bias: polynomial(0, 1e6)?,
            transient: 0.0,
            positive_scale_factor: polynomial(1, 1.0)?,
            negative_scale_factor: polynomial(2, 1.0)?,
            max_rate: campaign.max_rate,
        })
    };
    CoefficientTable::new(Content {
        format: 1,
        imu: campaign.imu.clone(),
        serial: campaign.serial.clone(),
        gravity: campaign.gravity_reference,
        temperature_unit: campaign.temperature_unit.clone(),
        out_of_range: campaign.out_of_range.unwrap_or(OutOfRange::Clamp),
        max_age_s: campaign.max_age_s,
        lag_s: None,
        axes: [axis(0)?, axis(1)?, axis(2)?],
        alignment,
        gyroscopes: None,
    })
}
