//! A campaign's dwells become a coefficient table: checks, set points, orders, fit, outliers.

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

/// Highest order that `auto` looks at.
const AUTO_ORDER: usize = 6;
/// How the coefficients are estimated.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Method {
    /// All dwells at once, each with its own telemetry.
    #[default]
    OneStage,
    /// Each set point first, then polynomials through their values; the paper's way.
    TwoStage,
}

/// What the user asks for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationOptions {
    /// How the coefficients are estimated.
    pub method: Method,
    /// The order of every polynomial; chosen from the data if `None`.
    pub order: Option<usize>,
    /// Whether the table gets an alignment matrix.
    pub alignment: bool,
    /// Dwells that are left out: set point \[degC\] and number of the position.
    pub exclude: Vec<(f64, u32)>,
}

/// Why a campaign does not become a table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The list of positions cannot tell all parameters apart.
    #[error("{}", .0.join("\n"))]
    Positions(Vec<String>),
    /// There is nothing to fit.
    #[error("no rows; a campaign needs dwells")]
    Empty,
    /// What the checks found.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Faults(Vec<Finding>),
    /// A dwell to leave out that is not there.
    #[error("there is no dwell at set point {0} degC in position {1} to leave out")]
    NothingToExclude(f64, u32),
    /// A set point whose dwells, less those left out, cannot tell its parameters apart.
    #[error("set point {set_point_c} degC: {deficiency}")]
    SetPoint {
        /// \[degC\]
        set_point_c: f64,
        /// What cannot be told apart, and what would help.
        deficiency: String,
    },
    /// Too few set points for an order.
    #[error("{axis} {quantity}: {error}; take a lower order, or more set points")]
    Order {
        /// A1, A2 or A3.
        axis: &'static str,
        /// As in the table.
        quantity: &'static str,
        /// What is missing.
        error: RegressionError,
    },
    /// The joint fit failed.
    #[error(transparent)]
    Fit(#[from] OneStageError),
    /// The result cannot be a table.
    #[error("the result is no valid table: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Table(Vec<Refusal>),
}

/// Everything that came out of a campaign.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The result.
    pub table: CoefficientTable,
    /// What was asked for.
    pub options: CalibrationOptions,
    /// The dwells that counted.
    pub dwells: Vec<Dwell>,
    /// The stays at set points.
    pub set_points: Vec<SetPoint>,
    /// Warnings of the checks, and what came up later.
    pub findings: Vec<Finding>,
    /// What the positions can tell, by axis.
    pub observability: [Observability; AXES],
    /// Each set point reduced by itself, by axis: the paper's values.
    pub reduced: Vec<[Reduced; AXES]>,
    /// By axis and quantity.
    pub orders: [[OrderTable; 3]; AXES],
    /// The estimate in force.
    pub solution: Solution,
    /// Dwells out of proportion that were kept: index and axis.
    pub outliers: Vec<(usize, usize)>,
}

impl Method {
    /// Every method with its name.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::OneStage, "one-stage"), (Self::TwoStage, "two-stage")];

    /// Its name.
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

    /// Row i: what accelerometer i indicates of the specific force along each axis; 1 on the diagonal.
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

/// Whether the list of positions can tell all parameters apart.
///
/// # Errors
/// Naming each deficiency and a position that would help.
pub fn observable(campaign: &Campaign) -> Result<[Observability; AXES], CalibrationError> {
    let found = [0, 1, 2].map(|axis| Observability::of(&campaign.positions, axis));
    let deficiencies: Vec<_> = found.iter().flat_map(|o| o.deficiencies.iter().cloned()).collect();
    if deficiencies.is_empty() { Ok(found) } else { Err(CalibrationError::Positions(deficiencies)) }
}

impl CalibrationError {
    /// The failure of a program: what is wrong with which file, and where. `campaign` is the campaign file, `samples` the recording, and
    /// `locate` gives file and line of a row of it.
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

/// Makes a table of a campaign's dwells.
///
/// # Errors
/// Everything that keeps it from being one.
pub fn calibrate(
    campaign: &Campaign,
    dwells: Vec<Dwell>,
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let observability = observable(campaign)?;
    if dwells.is_empty() {
        return Err(CalibrationError::Empty);
    }
    let dwells = without(campaign, dwells, &options.exclude)?;
    let stays = set_points(&dwells, campaign.positions.len());
    let mut findings = check(campaign, &dwells, &stays, &options.exclude);
    if findings.iter().any(|finding| finding.severity == Severity::Fault) {
        return Err(CalibrationError::Faults(findings));
    }
    let level = reduced(campaign, &dwells, &stays, None)?;
    let ranges = ranges(&dwells);
    let highest = options.order.unwrap_or_else(|| AUTO_ORDER.min(stays.len().saturating_sub(2)));
    let order_tables = |values: &[SetPointValues]| order_tables(values, options.order, highest);
    let curves = |orders: &[[OrderTable; 3]; AXES]| -> Curves {
        let curve = |axis: usize, q: usize| {
            Curve::of(&orders[axis][q].regression, orders[axis][q].choice.order, ranges[axis][q.min(1)])
        };
        [0, 1, 2].map(|axis| [curve(axis, 0), curve(axis, 1), curve(axis, 2)])
    };
    // A joint fit first, with the orders that the drifting values suggest: it knows the tilt and the drift within set points.
    let plain = order_tables(&level.iter().map(values).collect::<Vec<_>>())?;
    let first = solve(campaign, &dwells, &stays, &curves(&plain), &[])?;
    let reduced = reduced(campaign, &dwells, &stays, first.tilt)?;
    let two_stage_values: Vec<_> = reduced.iter().map(values).collect();
    let (orders, solution) = match options.method {
        Method::TwoStage => {
            let orders = order_tables(&two_stage_values)?;
            let solution = two_stage(campaign, &dwells, &stays, &reduced, curves(&orders), first.tilt);
            (orders, solution)
        }
        Method::OneStage => {
            let corrected = set_point_values(campaign, &dwells, &stays, &first);
            let corrected: Vec<_> =
                corrected.into_iter().zip(&two_stage_values).map(|(value, plain)| value.unwrap_or(*plain)).collect();
            let orders = order_tables(&corrected)?;
            let solution = solve(campaign, &dwells, &stays, &curves(&orders), &[])?;
            (orders, solution)
        }
    };
    findings.extend(level_error(campaign, &dwells, &stays, &solution));
    let (unfit, lacking) = lack_of_fit(&orders, &reduced);
    findings.extend(lacking);
    // Where the curve is wrong, its residuals say nothing about a dwell.
    let mut outliers = outliers(campaign, &dwells, &stays, &solution);
    outliers.retain(|(_, axis)| !unfit[*axis]);
    for &(dwell, axis) in &outliers {
        let (place, residual) = (&dwells[dwell], solution.residuals[dwell][axis]);
        findings.push(Finding {
            severity: Severity::Warning,
            line: Some(place.lines[0]),
            place: Some((place.set_point_c, Some(campaign.positions[place.position].number))),
            message: format!(
                "{} is {:.2}e-6 g0 off the fit, out of all proportion to the other dwells; kept, leave it out with \
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
    Ok(Calibration {
        table,
        options,
        dwells,
        set_points: stays,
        findings,
        observability,
        reduced,
        orders,
        solution,
        outliers,
    })
}

fn without(
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
    stays: &[SetPoint],
    tilt: Option<[f64; 2]>,
) -> Result<Vec<[Reduced; AXES]>, CalibrationError> {
    let of = |stay: &SetPoint, axis: usize| {
        let parts: Vec<_> = stay.dwells.iter().map(|&dwell| &dwells[dwell]).collect();
        let positions: Vec<_> = parts.iter().map(|dwell| campaign.positions[dwell.position].clone()).collect();
        let deficient = |deficiency| CalibrationError::SetPoint { set_point_c: stay.set_point_c, deficiency };
        match Observability::of(&positions, axis).deficiencies.into_iter().next() {
            Some(deficiency) => Err(deficient(deficiency)),
            None => reduce(campaign, &parts, axis, tilt).ok_or_else(|| {
                deficient(format!("the pulses of {} do not tell its parameters apart", AXIS_NAMES[axis]))
            }),
        }
    };
    stays.iter().map(|stay| Ok([of(stay, 0)?, of(stay, 1)?, of(stay, 2)?])).collect()
}

fn values(reduced: &[Reduced; AXES]) -> SetPointValues {
    let of = |axis: usize, q: usize| (reduced[axis].telemetry[q], reduced[axis].values[q]);
    [0, 1, 2].map(|axis| [of(axis, 0), of(axis, 1), of(axis, 2)])
}

/// Lowest and highest telemetry of the samples: head and board, by axis.
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
        // A user who asks for order N sees the neighbours too, where there are points for them.
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

/// The paper's way: the curves through the set points' values, the misalignments as their means.
fn two_stage(
    campaign: &Campaign,
    dwells: &[Dwell],
    stays: &[SetPoint],
    reduced: &[[Reduced; AXES]],
    curves: Curves,
    tilt: Option<[f64; 2]>,
) -> Solution {
    crate::one_stage::hold(campaign, dwells, stays, curves, tilt, |axis, k| {
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
        // What is indicated is M times the specific force.
        alignment: if options.alignment { misalignment(solution).try_inverse() } else { None },
    };
    CoefficientTable::new(content).map_err(CalibrationError::Table)
}
