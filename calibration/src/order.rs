//! Which order? All orders are fitted side by side; from the highest down, the first is taken whose highest term is both
//! significant and large enough to matter.
//!
//! From the highest down, because a forward rule that stops at the first term without effect stops at order 0 on a cubic
//! whose linear and quadratic parts cancel. Large enough, because on many samples any trifle is significant.

use crate::regression::{Fit, Regression};
use core::fmt::Write as _;

/// When a term counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// Probability that a term without effect is taken, over all orders together.
    pub significance: f64,
    /// Smallest change of the fitted curve that matters, in the quantity's unit; a quarter of the residual standard
    /// deviation if none is given.
    pub effect: Option<f64>,
    /// The unit, for the reason.
    pub unit: &'static str,
}

impl Default for Rule {
    fn default() -> Self {
        Self { significance: 0.01, effect: None, unit: "" }
    }
}

/// The chosen order.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Choice {
    /// From 0.
    pub order: usize,
    /// Why, in a sentence or two.
    pub reason: String,
}

/// Chooses among the fits of `regression`.
#[must_use]
pub fn choose(regression: &Regression, rule: &Rule) -> Choice {
    let fits = regression.fits();
    if let Some(exact) = fits.iter().find(|fit| fit.sse == 0.0 && fit.df_residual > 0) {
        let reason = format!("order {} is the lowest that meets every point to within rounding", exact.order);
        return Choice { order: exact.order, reason };
    }
    let tested = fits.iter().filter(|fit| fit.df_residual > 0 && fit.order > 0).count().max(1);
    // Shared among the orders that are tested.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::regression::Point;

    fn regression(y: impl Fn(f64) -> f64) -> Regression {
        let points = (0..15).map(|i| f64::from(i) / 7.0 - 1.0).map(|x| Point::new(x, y(x))).collect();
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
