//! From the dwells of a campaign to a coefficient table: checks, set points, orders, fit, outliers.

use crate::campaign::{Campaign, Dwell, range};
use crate::checks::{Finding, SetPoint, Severity, check, set_points};
use crate::curve::Curve;
use crate::one_stage::{Curves, OneStageError, SetPointValues, Solution, set_point_values, solve};
use crate::order::{BIAS_EFFECT, Choice, OrderTable, QUANTITIES, Rule, SCALE_FACTOR_EFFECT, choose};
use crate::positions::Observability;
use crate::quality::{lack_of_fit, level_error, order_findings, outliers};
use crate::reduce::{Reduced, reduce};
use crate::regression::{DataPoint, Regression, RegressionError};
use isotherm_failure::{Exit, Failure};
use isotherm_shared::polynomial::MAX_ORDER;
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, Content, Refusal};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::AXES;
use nalgebra::Matrix3;
use std::path::Path;

/// Highest order that is considered if none is requested.
const MAX_AUTO_ORDER: usize = 6;

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
    pub alignment: bool,
    /// Dwells to leave out: set point \[degC\] and number of the position.
    pub exclude: Vec<(f64, u32)>,
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
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Faults(Vec<Finding>),
    /// A dwell to leave out does not exist.
    #[error("there is no dwell at set point {0} degC in position {1} to leave out")]
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

fn misalignment(solution: &Solution) -> Matrix3<f64> {
    let mut matrix = Matrix3::identity();
    for (axis, part) in solution.axes.iter().enumerate() {
        for (k, m) in part.misalignment.into_iter().enumerate() {
            matrix[(axis, (axis + 1 + k) % AXES)] = m;
        }
    }
    matrix
}

/// Checks that the list of positions determines all parameters.
///
/// # Errors
/// Each deficiency, with a position that would help.
pub fn observable(campaign: &Campaign) -> Result<[Observability; AXES], CalibrationError> {
    let found = [0, 1, 2].map(|axis| Observability::of(&campaign.positions, axis));
    let deficiencies: Vec<_> = found.iter().flat_map(|o| o.deficiencies.iter().cloned()).collect();
    if deficiencies.is_empty() { Ok(found) } else { Err(CalibrationError::Positions(deficiencies)) }
}

impl CalibrationError {
    /// The error as the failure of a program, with the file concerned. `campaign` is the campaign file and `samples` the
    /// recording; `locate` gives file and line of a row.
    #[must_use]
    pub fn failure(&self, campaign: &Path, samples: &Path, locate: impl Fn(u64) -> String) -> Failure {
        let exit = match self {
            Self::Positions(_) => Exit::Config,
            Self::NothingToExclude(..) => Exit::Usage,
            Self::Fit(_) | Self::Table(_) => Exit::Failed,
            Self::Empty | Self::Faults(_) | Self::SetPoint { .. } | Self::Order { .. } => Exit::Data,
        };
        let message = match self {
            Self::Faults(findings) => {
                let line = |finding: &Finding| {
                    let warning = if finding.severity == Severity::Warning { "warning: " } else { "" };
                    format!("{warning}{}", finding.located(&locate))
                };
                findings.iter().map(line).collect::<Vec<_>>().join("\n")
            }
            Self::NothingToExclude(..) => format!("--exclude: {self}"),
            Self::Positions(deficiencies) => {
                let line = |deficiency: &String| format!("{}: {deficiency}", campaign.display());
                deficiencies.iter().map(line).collect::<Vec<_>>().join("\n")
            }
            _ => format!("{}: {self}", samples.display()),
        };
        Failure::new(exit, message)
    }
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
    if findings.iter().any(|finding| finding.severity == Severity::Fault) {
        return Err(CalibrationError::Faults(findings));
    }
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
            line: Some(place.lines[0]),
            place: Some((place.set_point_c, Some(campaign.positions[place.position].number))),
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
    let table = table(campaign, &options, &solution)?;
    Ok(Calibration { table, options, dwells, set_points, findings, observability, reduced, orders, solution, outliers })
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
        [range(dwells.iter().map(|d| d.head_range(axis))), range(dwells.iter().map(|d| d.board_range(axis)))]
    })
}

fn order_tables(
    values: &[SetPointValues],
    fixed: Option<usize>,
    highest: usize,
) -> Result<[[OrderTable; 3]; AXES], CalibrationError> {
    let of = |axis: usize, q: usize| -> Result<OrderTable, CalibrationError> {
        let failed = |error| CalibrationError::Order { axis: AXIS_NAMES[axis], quantity: QUANTITIES[q], error };
        let points: Vec<_> = values.iter().map(|value| value[axis][q]).map(|(x, y)| DataPoint::new(x, y)).collect();
        let size = points.iter().map(|point| point.y.value().abs()).fold(0.0, f64::max);
        // If the user requests an order, the table also shows up to two higher orders, as the number of points allows.
        let shown = (highest + 2).min(values.len().saturating_sub(2)).min(MAX_ORDER).max(highest);
        let regression = Regression::new(points, if fixed.is_some() { shown } else { highest }).map_err(failed)?;
        let (effect, unit) = if q == 0 { (BIAS_EFFECT, "g0") } else { (SCALE_FACTOR_EFFECT * size, "pulse/(s*g0)") };
        let choice = match fixed {
            Some(order) => Choice { order, reason: "asked for".to_owned() },
            None => choose(&regression, &Rule { effect: Some(effect), unit, ..Rule::default() }),
        };
        Ok(OrderTable::new(regression, choice))
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

fn table(
    campaign: &Campaign,
    options: &CalibrationOptions,
    solution: &Solution,
) -> Result<CoefficientTable, CalibrationError> {
    let refuse = |axis: usize, quantity: usize| {
        let key = format!("axis.{}.{}", AXIS_NAMES[axis], QUANTITIES[quantity]);
        CalibrationError::Table(vec![Refusal { key, message: format!("tables hold orders up to {MAX_ORDER}") }])
    };
    let axis = |axis: usize| -> Result<Axis, CalibrationError> {
        let curves = &solution.axes[axis].curves;
        let polynomial = |q: usize, factor: f64| curves[q].polynomial(factor).ok_or_else(|| refuse(axis, q));
        Ok(Axis {
            bias_unit: BiasUnit::MicroG0,
            bias: polynomial(0, 1e6)?,
            positive_scale_factor: polynomial(1, 1.0)?,
            negative_scale_factor: polynomial(2, 1.0)?,
            max_rate: campaign.max_rate,
        })
    };
    let content = Content {
        imu: campaign.imu.clone(),
        serial: campaign.serial.clone(),
        gravity: campaign.gravity_reference,
        temperature_unit: campaign.temperature_unit.clone(),
        out_of_range: campaign.out_of_range,
        max_age_s: campaign.max_age_s,
        axes: [axis(0)?, axis(1)?, axis(2)?],
        // Indicated = M * specific force, so the alignment is the inverse of M.
        alignment: if options.alignment { misalignment(solution).try_inverse() } else { None },
    };
    CoefficientTable::new(content).map_err(CalibrationError::Table)
}
