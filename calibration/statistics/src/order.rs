//! Order tables: the fits of all orders of one curve, with the order that is chosen.

mod choice;

use crate::diagnostics::Diagnostics;
use crate::regression::{DataPoint, Fit, LinearTerm, Regression, RegressionError, TermTest};
use crate::tails::f_limit;
use choice::Choice;
pub use choice::{PureError, Rule, choose};
use core::fmt::Write as _;
use isotherm_shared::polynomial::MAX_ORDER;
use serde::Serialize;
use serde_json::Value;

/// Names of the three curves of an accelerometer, as in a table.
pub use isotherm_shared::table::difference::QUANTITIES;
/// Highest order of an order table if none is requested, as far as the data allow it.
const DEFAULT_ORDER: usize = 6;

/// The highest order that is fitted if none is requested: 6, or less if there are few distinct x, or few points for
/// `linear` linear columns.
///
/// ```
/// use isotherm_statistics::default_order;
///
/// let temperature = [1.1, 1.5, 1.9, 2.3, 2.7];
/// assert_eq!(default_order(&temperature, 0), 3); // two degrees of freedom are left
/// ```
#[must_use]
pub fn default_order(x: &[f64], linear: usize) -> usize {
    let points = x.len().saturating_sub(linear + 2);
    DEFAULT_ORDER.min(distinct(x.iter().copied()).saturating_sub(2)).min(points).max(1)
}

/// Number of different values.
fn distinct(values: impl IntoIterator<Item = f64>) -> usize {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values.len()
}

/// The fits of all orders of one curve, with the choice.
#[derive(Clone, Debug)]
pub struct OrderTable {
    /// All fits.
    pub regression: Regression,
    /// The chosen order and the reason.
    pub choice: Choice,
    /// Diagnostics of the fit of the chosen order.
    pub diagnostics: Diagnostics,
}

impl OrderTable {
    /// A table with a given choice.
    #[must_use]
    pub fn new(regression: Regression, choice: Choice) -> Self {
        let diagnostics = Diagnostics::of(&regression, choice.order);
        Self { regression, choice, diagnostics }
    }

    /// The table of a curve through the values of set points, given as temperature and value: of the order `fixed`, or
    /// of the one that `rule` chooses up to `highest`.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_statistics::{OrderTable, Rule};
    ///
    /// // K+ [pulse/(s*g0)] at five set points, by temperature [V]; order 1 is asked for.
    /// let values = [(1.1, 97_001.0), (1.8, 97_008.2), (2.5, 97_015.1), (3.2, 97_021.8), (3.9, 97_029.0)];
    /// let table = OrderTable::of_set_points(values.into_iter(), Some(1), 1, &Rule::default())?;
    /// assert_eq!(table.choice.order, 1);
    /// assert_eq!(table.regression.fits().len(), 4); // up to two higher orders are shown beside it
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If the points do not allow the order.
    pub fn of_set_points(
        values: impl Iterator<Item = (f64, f64)>,
        fixed: Option<usize>,
        highest: usize,
        rule: &Rule,
    ) -> Result<Self, RegressionError> {
        let points: Vec<_> = values.map(|(x, y)| DataPoint::new(x, y)).collect();
        let possible = match fixed {
            // The table also shows up to two higher orders, as the number of points allows.
            Some(order) => (order + 2).min(points.len().saturating_sub(2)).min(MAX_ORDER).max(order),
            // Temperature with few digits may be the same at several set points.
            None => highest.min(distinct(points.iter().map(|point| point.x.value())).saturating_sub(2)),
        };
        let regression = Regression::new(points, possible)?;
        let choice = match fixed {
            Some(order) => Choice { order, reason: "asked for".to_owned() },
            None => choose(&regression, rule),
        };
        Ok(Self::new(regression, choice))
    }

    /// A table with the order that `rule` chooses.
    #[must_use]
    pub fn choose(regression: Regression, rule: &Rule) -> Self {
        let choice = choose(&regression, rule);
        Self::new(regression, choice)
    }

    /// The fit of the chosen order.
    #[must_use]
    pub fn chosen(&self) -> &Fit {
        &self.regression.fits()[self.choice.order]
    }

    /// The table as a JSON document: the output of `isotherm regress --json` without the facts about the file.
    #[must_use]
    pub fn json(&self) -> Value {
        let Self { regression, choice, diagnostics } = self;
        let document = Document {
            n: regression.n(),
            center: regression.center(),
            scale: regression.scale(),
            orders: self.shown().iter().map(LimitedFit::of).collect(),
            selected: choice.order,
            reason: &choice.reason,
            residuals: regression.residuals(choice.order),
            diagnostics,
            warnings: &diagnostics.warnings,
            linear: regression.linear().collect(),
        };
        // It fails only for maps whose keys are no texts.
        serde_json::to_value(document).unwrap_or_default()
    }

    /// The fits that the table shows. Order 0 is of interest only with linear columns.
    fn shown(&self) -> &[Fit] {
        &self.regression.fits()[usize::from(self.regression.linear().next().is_none())..]
    }

    /// The table as text; `x` and `y` are the names of the columns.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_statistics::{DataPoint, OrderTable, Regression, Rule};
    ///
    /// let data = include_str!("../../../examples/cubic.csv").lines().skip(1).filter_map(|line| line.split_once(','));
    /// let points = data.map(|(x, y)| Ok(DataPoint::new(x.parse()?, y.parse()?)));
    /// let points: Result<Vec<_>, std::num::ParseFloatError> = points.collect();
    /// let text = OrderTable::choose(Regression::new(points?, 5)?, &Rule::default()).text("x", "y");
    /// assert!(text.starts_with("y as a polynomial of x") && text.contains("Chosen: order 3"));
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn text(&self, x: &str, y: &str) -> String {
        let Self { regression, choice, .. } = self;
        let columns: Vec<_> = regression.linear().collect();
        let linear = if columns.is_empty() { String::new() } else { format!(", and linear in {}", columns.join(", ")) };
        let mut text = format!(
            "{y} as a polynomial of {x}{linear}: {} points\n\n order  residual sd          R2           R            F        p   \
             leave-one-out rms         max      effect\n",
            regression.n()
        );
        let fits = self.shown();
        // Writing to a String cannot fail.
        for fit in fits {
            let _ = writeln!(
                text,
                "{:6} {} {:11.9} {:11.9} {} {} {:>19} {} {}",
                fit.order,
                number(fit.residual_sd, 12),
                fit.r_squared.unwrap_or(f64::NAN),
                fit.r.unwrap_or(f64::NAN),
                number(fit.f, 12),
                number(fit.f_p, 8),
                number(fit.leave_one_out_rms, 11),
                number(fit.leave_one_out_max, 11),
                number(Some(fit.effect), 11),
            );
        }
        for fit in fits {
            let _ = writeln!(
                text,
                "\norder {}: coefficients of {x}^k; partial sums of squares in the basis centred at {:.6}, scaled by {:.6}\n  \
                 k            coefficient  standard error     partial sum            F        p",
                fit.order,
                regression.center(),
                regression.scale()
            );
            for (k, coefficient) in fit.coefficients.iter().enumerate() {
                let error = fit.standard_errors.as_ref().map(|errors| errors[k]);
                let none = TermTest { term: 0, sum_of_squares: f64::NAN, f: None, p: None };
                let partial = if k == 0 { &none } else { fit.partial_centred.get(k - 1).unwrap_or(&none) };
                let sum = (k > 0).then_some(partial.sum_of_squares);
                let _ = writeln!(
                    text,
                    "  {k:1} {coefficient:>22.14e} {} {} {} {}",
                    number(error, 15),
                    number(sum, 15),
                    number(partial.f, 12),
                    number(partial.p, 8)
                );
            }
            text.push_str(&linear_text(&fit.linear));
        }
        let _ = writeln!(text, "\nChosen: order {}; {}.", choice.order, choice.reason);
        text
    }
}

/// The terms of the linear columns of a fit, each in a row.
fn linear_text(terms: &[LinearTerm]) -> String {
    let width = terms.iter().map(|term| term.column.chars().count()).max().unwrap_or(0).max("column".len());
    let mut text = String::new();
    if !terms.is_empty() {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  {:width$}            coefficient  standard error     partial sum            F        p   variance inflation",
            "column"
        );
    }
    for term in terms {
        let _ = writeln!(
            text,
            "  {:width$} {:>22.14e} {} {} {} {} {}",
            term.column,
            term.coefficient,
            number(term.standard_error, 15),
            number(Some(term.sum_of_squares), 15),
            number(term.f, 12),
            number(term.p, 8),
            number(Some(term.variance_inflation), 20)
        );
    }
    text
}

/// An order table as JSON.
#[derive(Serialize)]
struct Document<'a> {
    n: usize,
    center: f64,
    scale: f64,
    orders: Vec<LimitedFit<'a>>,
    selected: usize,
    reason: &'a str,
    residuals: Vec<f64>,
    diagnostics: &'a Diagnostics,
    warnings: &'a [String],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    linear: Vec<&'a str>,
}

/// A fit with what its F and its partial F must exceed.
#[derive(Serialize)]
struct LimitedFit<'a> {
    #[serde(flatten)]
    fit: &'a Fit,
    f_limit: Limits,
    partial_f_limit: Limits,
}

/// By the probability of a larger F by chance.
#[derive(Serialize)]
struct Limits {
    #[serde(rename = "0.05")]
    five_percent: Option<f64>,
    #[serde(rename = "0.01")]
    one_percent: Option<f64>,
}

impl<'a> LimitedFit<'a> {
    fn of(fit: &'a Fit) -> Self {
        let limits = |terms: usize| {
            let limit = |p: f64| (fit.df_residual > 0).then(|| f_limit(p, terms as f64, fit.df_residual as f64));
            Limits { five_percent: limit(0.05), one_percent: limit(0.01) }
        };
        Self { fit, f_limit: limits(fit.order + fit.linear.len()), partial_f_limit: limits(1) }
    }
}

fn number(value: Option<f64>, width: usize) -> String {
    match value {
        Some(value) if value == 0.0 || (1e-3..1e6).contains(&value.abs()) => {
            let digits = 5_usize.saturating_sub(libm::log10(value.abs().max(1.0)) as usize);
            format!("{value:>width$.digits$}")
        }
        Some(value) => format!("{:>width$}", format!("{value:.*e}", width.min(12).saturating_sub(8).max(1))),
        None => format!("{:>width$}", "-"),
    }
}
