//! Selection of the polynomial order. All orders are fitted. The highest order is chosen whose highest term is both
//! significant and large enough to matter.
//!
//! The search goes from the highest order down: a forward search that stops at the first term without effect would stop
//! at order 0 on a cubic whose linear and quadratic parts cancel. The effect must be large enough, because with many
//! samples any small effect is significant.
//!
//! # The order of a model
//! Few points make a test weak: with six, a cubic term must be twenty times its error to be significant. A model that
//! is known has an order, and a lower one is never chosen: terms that are not there cost little, while one that is
//! there and not seen costs as much as it is large. Any rule that drops terms within their errors makes the error of
//! some curves two to three times as large.
//!
//! A higher order must be significant, and the points' own errors, where repeated measurements show them, must say that
//! the model's order does not fit (lack of fit against pure error):
//!
//! ```text
//! F = Q_m / (n - m - 1) / own variance,   with n - m - 1 degrees of freedom and those of the own variance
//! ```

use crate::regression::{Fit, Regression};
use crate::tails::f_tail;
use core::fmt::Write as _;

/// The rule for the choice of an order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// Probability of choosing a term without effect, over all orders together.
    pub significance: f64,
    /// Smallest change of the fitted curve that matters, in the unit of the quantity. If it is `None`, a quarter of the
    /// residual standard deviation of a point of the mean weight.
    pub effect: Option<f64>,
    /// The unit of the quantity, for the text of the reason.
    pub unit: &'static str,
    /// The lowest order that is chosen, as far as the fits reach: that of a model which is known. Usually 0.
    pub least: usize,
    /// The points' own error, if it is known: a higher order than `least` is chosen only where they do not explain the
    /// scatter about that.
    pub own_error: Option<PureError>,
}

/// What repeated measurements at the points show of the error of one point, whatever the curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PureError {
    /// Variance of a point.
    pub variance: f64,
    /// Its degrees of freedom.
    pub freedom: f64,
}

impl Default for Rule {
    fn default() -> Self {
        Self { significance: 0.01, effect: None, unit: "", least: 0, own_error: None }
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
    let fits = regression.fits();
    let model = &fits[rule.least.min(fits.len().saturating_sub(1))];
    let Choice { order, reason } = by_the_data(regression, rule);
    let own = rule.own_error.filter(|own| own.freedom > 0.0 && own.variance.is_finite());
    let least = model.order;
    if order < least {
        let reason =
            format!("{least} at least, the order of the model; without it the data would give {order}: {reason}");
        return Choice { order: least, reason };
    }
    match own.map(|own| lack_of_fit(model, &own)) {
        Some(p) if order > least && p >= rule.significance => Choice {
            order: least,
            reason: format!(
                "{least}, the order of the model, which the points meet to within their own errors ({}); without it the data would give \
                 {order}: {reason}",
                against("p", p, rule.significance)
            ),
        },
        _ => Choice { order, reason },
    }
}

/// The probability of so large a scatter about the model if the own errors were all.
fn lack_of_fit(model: &Fit, own: &PureError) -> f64 {
    let scatter = model.ms_residual.unwrap_or(0.0);
    if scatter == 0.0 { 1.0 } else { f_tail(scatter / own.variance, model.df_residual as f64, own.freedom) }
}

/// A probability next to its limit, with as many digits as distinguish the two.
fn against(name: &str, p: f64, limit: f64) -> String {
    let text = |value: f64, digits: usize| format!("{value:.digits$e}");
    let digits = (1..17).find(|&digits| p == limit || text(p, digits) != text(limit, digits)).unwrap_or(17);
    format!("{name} {}, limit {}", text(p, digits), text(limit, digits))
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
    // The standard deviation of a point of the mean weight: a common factor of the weights says nothing.
    let weight = regression.points().iter().map(|point| point.weight.value()).sum::<f64>() / regression.n() as f64;
    let threshold = |fit: &Fit| rule.effect.or(fit.residual_sd.map(|sd| 0.25 * (sd / weight.sqrt()))).unwrap_or(0.0);
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
            "the term of order {order} is significant (F {}, {}) and moves the curve by up to {:.3e}{unit} (threshold {:.3e})",
            if f < 1e4 { format!("{f:.2}") } else { format!("{f:.2e}") },
            against("p", p, limit),
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
            format!("is not significant ({})", against("p", p, limit))
        };
        let _ = write!(reason, "; that of order {} {why}", fit.order);
    }
    Choice { order, reason }
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
        let scatter = |x: f64| 1e-3 * libm::sin(1e4 * x);
        let choice = choose(&regression(|x| (5.0 * x * x * x - 3.0 * x) / 2.0 + scatter(x)), &Rule::default());
        assert_eq!(choice.order, 3, "{}", choice.reason);
    }

    #[test]
    fn an_effect_too_small_to_matter_is_refused_and_said_so() {
        let data = regression(|x| 5.0 * x + 0.1 * x * x + 1e-4 * libm::sin(1e4 * x));
        assert_eq!(choose(&data, &Rule::default()).order, 2);
        let choice = choose(&data, &Rule { effect: Some(0.5), ..Rule::default() });
        assert_eq!(choice.order, 1);
        assert!(choice.reason.contains("that of order 2 moves it by only"), "{}", choice.reason);
    }

    #[test]
    fn a_common_factor_of_the_weights_changes_nothing_but_the_size_of_sums() {
        let weighted = |factor: f64| {
            let points = (0..15).map(|i| {
                let x = f64::from(i) / 7.0 - 1.0;
                let weight = (factor * if i % 2 == 0 { 1.0 } else { 2.0 }).into();
                DataPoint { weight, ..DataPoint::new(x, 5.0 * x + 0.02 * x * x + 0.01 * libm::sin(1e4 * x)) }
            });
            Regression::new(points.collect(), 4).unwrap()
        };
        let (plain, other) = (weighted(1.0), weighted(1e6));
        for (a, b) in plain.fits().iter().zip(other.fits()) {
            assert_eq!(a.df_residual, 15 - a.order - 1, "a point of weight 2 is one point");
            let errors = |fit: &Fit| fit.standard_errors.clone().unwrap();
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-12 * a.abs().max(1e-12);
            assert!(a.coefficients.iter().zip(&b.coefficients).all(|(a, b)| near(*a, *b)));
            assert!(errors(a).iter().zip(errors(b)).all(|(a, b)| near(*a, b)), "order {}", a.order);
            assert!(a.f.zip(b.f).is_none_or(|(a, b)| near(a, b)));
            assert!((b.residual_sd.unwrap() / a.residual_sd.unwrap() - 1e3).abs() < 1e-9);
        }
        assert_eq!(choose(&plain, &Rule::default()).order, choose(&other, &Rule::default()).order);
    }

    #[test]
    fn no_rounded_probability_contradicts_its_sentence() {
        assert_eq!(against("p", 0.003, 0.0025), "p 3.0e-3, limit 2.5e-3");
        assert_eq!(against("p", 0.002_504, 0.0025), "p 2.504e-3, limit 2.500e-3");
        let data = regression(|x| 5.0 * x + 0.1 * x * x + 0.3 * libm::sin(1e4 * x));
        let reason = choose(&data, &Rule::default()).reason;
        assert!(!reason.contains("p 0.00"), "{reason}");
    }

    #[test]
    fn a_model_keeps_its_order_unless_own_errors_say_that_it_does_not_fit() {
        let rule = |own: Option<f64>| Rule {
            least: 3,
            own_error: own.map(|sd| PureError { variance: sd * sd, freedom: 100.0 }),
            ..Rule::default()
        };
        let line = |x: f64| 1.0 + x + 1e-3 * libm::sin(1e4 * x);
        assert_eq!(choose(&regression(line), &Rule::default()).order, 1);
        for own in [None, Some(1e-3), Some(1e-2)] {
            let found = choose(&regression(line), &rule(own));
            assert_eq!(found.order, 3, "{}", found.reason);
        }
        // A term above the cubic is significant, and smaller than the points' own errors.
        let fourth = |x: f64| 1.0 + x.powi(3) + 1e-2 * (8.0 * x.powi(4) - 8.0 * x * x) + 1e-3 * libm::sin(1e4 * x);
        for (own, order) in [(None, 4), (Some(1e-3), 4), (Some(1e-2), 3)] {
            let found = choose(&regression(fourth), &rule(own));
            assert_eq!(found.order, order, "{own:?}: {}", found.reason);
        }
    }

    #[test]
    fn scatter_is_a_constant_and_an_exact_fit_needs_no_test() {
        assert_eq!(choose(&regression(|x| libm::sin(1e4 * x)), &Rule::default()).order, 0);
        let choice = choose(&regression(|x| 1.0 + x * x), &Rule::default());
        assert_eq!(choice.order, 2, "{}", choice.reason);
    }
}
