//! Selection of the polynomial order. All orders are fitted. The highest order is chosen whose highest term is both
//! significant and large enough to matter.
//!
//! The search goes from the highest order down: a forward search that stops at the first term without effect would stop
//! at order 0 on a cubic whose linear and quadratic parts cancel. The effect must be large enough, because with many
//! samples any small effect is significant.

use crate::diagnostics::Diagnostics;
use crate::regression::{DataPoint, Fit, LinearTerm, Partial, Regression, RegressionError, f_limit};
use core::fmt::Write as _;
use isotherm_shared::polynomial::MAX_ORDER;
use serde::Serialize;
use serde_json::Value;

/// Names of the three curves of an accelerometer, as in a table.
pub use isotherm_shared::table::difference::QUANTITIES;
/// Highest order of an order table if none is requested, as far as the data allow it.
const DEFAULT_ORDER: usize = 6;

/// The rule for the choice of an order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// Probability of choosing a term without effect, over all orders together.
    pub significance: f64,
    /// Smallest change of the fitted curve that matters, in the unit of the quantity. If it is `None`, a quarter of the
    /// residual standard deviation.
    pub effect: Option<f64>,
    /// The unit of the quantity, for the text of the reason.
    pub unit: &'static str,
    /// The lowest order that is chosen, as far as the fits reach: that of a model which is known. Usually 0.
    pub least: usize,
}

impl Default for Rule {
    fn default() -> Self {
        Self { significance: 0.01, effect: None, unit: "", least: 0 }
    }
}

/// The chosen order.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Choice {
    /// The order, from 0.
    pub order: usize,
    /// The reason, in a sentence or two.
    pub reason: String,
}

/// Chooses an order among the fits of `regression`.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_statistics::{DataPoint, Regression, Rule, choose};
///
/// // A slope of 0.1 ug0/V is significant here, but moves the curve by less than what matters.
/// let points = (0..10).map(|i| (f64::from(i), 1e-3 * f64::from(i % 2)));
/// let points = points.map(|(x, noise)| DataPoint::new(x, 50.0 + 0.1 * x + noise)).collect();
/// let rule = Rule { effect: Some(2.0), unit: "ug0", ..Rule::default() };
/// let choice = choose(&Regression::new(points, 2)?, &rule);
/// assert_eq!(choice.order, 0);
/// assert!(choice.reason.contains("that of order 1 moves it by only"), "{}", choice.reason);
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn choose(regression: &Regression, rule: &Rule) -> Choice {
    let least = rule.least.min(regression.fits().len().saturating_sub(1));
    match by_the_data(regression, rule) {
        Choice { order, reason } if order < least => Choice {
            order: least,
            reason: format!("{least} at least, the order of the model; the data alone would give {order}: {reason}"),
        },
        choice => choice,
    }
}

fn by_the_data(regression: &Regression, rule: &Rule) -> Choice {
    let fits = regression.fits();
    if let Some(exact) = fits.iter().find(|fit| fit.sse == 0.0 && fit.df_residual > 0) {
        let reason = format!("order {} is the lowest that meets every point to within rounding", exact.order);
        return Choice { order: exact.order, reason };
    }
    let tested = fits.iter().filter(|fit| fit.df_residual > 0 && fit.order > 0).count().max(1);
    // The significance is divided by the number of tests (Bonferroni).
    let limit = rule.significance / tested as f64;
    let threshold = |fit: &Fit| rule.effect.or(fit.residual_sd.map(|sd| 0.25 * sd)).unwrap_or(0.0);
    let last = |fit: &Fit| fit.partial.last().and_then(|partial| Some((partial.f?, partial.p?)));
    let counts = |fit: &&Fit| last(fit).is_some_and(|(_, p)| p < limit) && fit.effect >= threshold(fit);
    let order = fits.iter().rev().find(counts).map_or(0, |fit| fit.order);
    let unit = if rule.unit.is_empty() { String::new() } else { format!(" {}", rule.unit) };
    let mut reason = String::new();
    if let Some((f, p)) = last(&fits[order]) {
        let fit = &fits[order];
        // Writing to a String cannot fail.
        let _ = write!(
            reason,
            "the term of order {order} is significant (F {}, p {p:.1e}, limit {limit:.1e}) and moves the curve by up to \
             {:.3e}{unit} (threshold {:.3e})",
            if f < 1e4 { format!("{f:.2}") } else { format!("{f:.2e}") },
            fit.effect,
            threshold(fit)
        );
    } else {
        let _ = write!(reason, "no term is both significant (limit {limit:.1e}) and large enough: a constant");
        if regression.linear().next().is_some() {
            reason.push_str(" and the linear columns");
        }
    }
    let above: Vec<_> = fits[order + 1..].iter().filter_map(|fit| Some((fit, last(fit)?.1))).collect();
    for (fit, p) in above {
        let why = if p < limit {
            format!("moves it by only {:.3e}{unit} (threshold {:.3e})", fit.effect, threshold(fit))
        } else {
            format!("is not significant (p {p:.2})")
        };
        let _ = write!(reason, "; that of order {} {why}", fit.order);
    }
    Choice { order, reason }
}

/// The highest order that is fitted if none is requested: 6, or less if there are few distinct x, or few points for
/// `linear` linear columns.
///
/// ```
/// use isotherm_statistics::default_order;
///
/// let telemetry = [1.1, 1.5, 1.9, 2.3, 2.7];
/// assert_eq!(default_order(&telemetry, 0), 3); // two degrees of freedom are left
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

    /// The table of a curve through the values of set points, given as telemetry and value: of the order `fixed`, or of
    /// the one that `rule` chooses up to `highest`.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_statistics::{OrderTable, Rule};
    ///
    /// // K+ [pulse/(s*g0)] at five set points, by telemetry [V]; order 1 is asked for.
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
            // Telemetry with few digits may be the same at several set points.
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
        // It fails for maps alone whose keys are no texts.
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
    /// let data = include_str!("../../examples/cubic.csv").lines().skip(1).filter_map(|line| line.split_once(','));
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
                let none = Partial { term: 0, sum_of_squares: f64::NAN, f: None, p: None };
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
            let digits = 5_usize.saturating_sub(value.abs().max(1.0).log10() as usize);
            format!("{value:>width$.digits$}")
        }
        Some(value) => format!("{:>width$}", format!("{value:.*e}", width.min(12).saturating_sub(8).max(1))),
        None => format!("{:>width$}", "-"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::DataPoint;

    fn regression(y: impl Fn(f64) -> f64) -> Regression {
        let points = (0..15).map(|i| f64::from(i) / 7.0 - 1.0).map(|x| DataPoint::new(x, y(x))).collect();
        Regression::new(points, 5).unwrap()
    }

    #[test]
    fn a_cubic_whose_lower_terms_have_no_effect_is_found() {
        // The Legendre polynomial of order 3 has no linear or quadratic regression.
        let scatter = |x: f64| 1e-3 * (1e4 * x).sin();
        let choice = choose(&regression(|x| (5.0 * x * x * x - 3.0 * x) / 2.0 + scatter(x)), &Rule::default());
        assert_eq!(choice.order, 3, "{}", choice.reason);
    }

    #[test]
    fn an_effect_too_small_to_matter_is_refused_and_said_so() {
        let data = regression(|x| 5.0 * x + 0.1 * x * x + 1e-4 * (1e4 * x).sin());
        assert_eq!(choose(&data, &Rule::default()).order, 2);
        let choice = choose(&data, &Rule { effect: Some(0.5), ..Rule::default() });
        assert_eq!(choice.order, 1);
        assert!(choice.reason.contains("that of order 2 moves it by only"), "{}", choice.reason);
    }

    #[test]
    fn scatter_is_a_constant_and_an_exact_fit_needs_no_test() {
        assert_eq!(choose(&regression(|x| (1e4 * x).sin()), &Rule::default()).order, 0);
        let choice = choose(&regression(|x| 1.0 + x * x), &Rule::default());
        assert_eq!(choice.order, 2, "{}", choice.reason);
    }
}
