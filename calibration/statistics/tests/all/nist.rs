//! The regression compared with NIST's reference sets and with a cubic; all their figures are known to 30 digits.

use isotherm_statistics::{DataPoint, DoubleDouble, Fit, Regression, Rule, TermTest, choose, f_limit};
use serde_json::Value;

fn load(name: &str) -> Value {
    let path = format!("{}/tests/data/nist/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn regression(set: &Value, order: usize) -> Regression {
    let column = |name: &str| set["text"][name].as_array().unwrap().iter().map(|v| v.as_str().unwrap());
    let number = |text: &str| DoubleDouble::parse(text).unwrap();
    let points = column("x").zip(column("y"));
    let points = points.map(|(x, y)| DataPoint { x: number(x), y: number(y), weight: DoubleDouble::ONE });
    Regression::new(points.collect(), order).unwrap()
}

/// Number of correct digits: -log10 of the relative error, at most 16. If `right` is exactly zero, only zero is
/// correct.
fn digits(got: f64, right: &Value) -> f64 {
    let text = right.as_str().unwrap();
    let right: f64 = text.parse().unwrap();
    if got == right {
        return 16.0;
    }
    -libm::log10(((got - right) / right).abs())
}

fn worst(got: &[f64], right: &Value) -> f64 {
    let right = right.as_array().unwrap();
    assert_eq!(got.len(), right.len());
    got.iter().zip(right).map(|(got, right)| digits(*got, right)).fold(16.0, f64::min)
}

#[test]
fn every_figure_of_a_set_has_at_least_14_correct_digits() {
    println!(
        "{:10} {:>12} {:>15} {:>5} {:>10} {:>5}",
        "set", "coefficients", "standard errors", "R2", "resid. sd", "F"
    );
    for name in ["Norris", "Pontius", "Wampler1", "Wampler2", "Wampler3", "Wampler4", "Wampler5", "Filip"] {
        let set = load(name);
        let order = set["degree"].as_u64().unwrap() as usize;
        let regression = regression(&set, order);
        let fit = &regression.fits()[order];
        let right = &set["exact_recomputed"];
        let perfect = right["residual_sd"] == "0";
        let figures = [
            worst(&fit.coefficients, &right["coefficients"]),
            worst(fit.standard_errors.as_ref().unwrap(), &right["sd"]),
            digits(fit.r_squared.unwrap(), &right["r_squared"]),
            digits(fit.residual_sd.unwrap(), &right["residual_sd"]),
            // A perfect fit has no F.
            if perfect { f64::from(u8::from(fit.f.is_none())) * 16.0 } else { digits(fit.f.unwrap(), &right["f"]) },
        ];
        println!(
            "{name:10} {:12.1} {:15.1} {:5.1} {:10.1} {:5.1}",
            figures[0], figures[1], figures[2], figures[3], figures[4]
        );
        assert!(figures.iter().all(|digits| *digits > 14.5), "{name}: {figures:?}");
    }
}

#[test]
fn a_higher_maximum_order_changes_no_lower_fit_and_no_choice() {
    let set = load("Filip");
    let ten = regression(&set, 10);
    let twelve = regression(&set, 12);
    for (a, b) in ten.fits()[10].coefficients.iter().zip(&twelve.fits()[10].coefficients) {
        assert!(((a - b) / b).abs() < 1e-15, "{a} {b}");
    }
    assert_eq!(choose(&ten, &Rule::default()).order, 10);
    assert_eq!(choose(&regression(&load("Wampler1"), 8), &Rule::default()).order, 5);
}

#[test]
fn every_figure_of_the_cubic_is_reproduced() {
    let set = load("synthetic_cubic");
    let orders = set["orders"].as_array().unwrap();
    let regression = regression(&set, orders.len());
    assert_eq!(choose(&regression, &Rule::default()).order, 3);
    for right in orders {
        let order = right["order"].as_u64().unwrap() as usize;
        let fit: &Fit = &regression.fits()[order];
        let mut least = worst(&fit.coefficients, &right["coefficients"])
            .min(worst(fit.standard_errors.as_ref().unwrap(), &right["sd"]))
            .min(worst(&regression.residuals(order), &right["residuals"]));
        let figures = [
            (fit.ss_total, "ss_total"),
            (fit.ss_regression, "ss_regression"),
            (fit.sse, "ss_residual"),
            (fit.ms_residual.unwrap(), "ms_residual"),
            (fit.residual_sd.unwrap(), "residual_sd"),
            (fit.r_squared.unwrap(), "r_squared"),
            (fit.r.unwrap(), "r"),
            (fit.adj_r_squared.unwrap(), "adj_r_squared"),
            (fit.one_minus_r_squared.unwrap(), "one_minus_r_squared"),
            (fit.f.unwrap(), "F"),
            (fit.f_p.unwrap(), "F_p"),
            (fit.sequential_ss, "sequential_ss"),
            (f_limit(0.05, order as f64, fit.df_residual as f64), "F_crit_0.05"),
            (f_limit(0.01, 1.0, fit.df_residual as f64), "partial_F_crit_0.01"),
        ];
        for (got, name) in figures {
            let right = digits(got, &right[name]);
            assert!(right > 12.0, "order {order}: {name} is {got}, {right} digits");
            least = least.min(right);
        }
        for (TermTest { term, sum_of_squares, f, p }, right) in
            fit.partial.iter().zip(right["partial"].as_array().unwrap())
        {
            for (got, name) in [(*sum_of_squares, "partial_ss"), (f.unwrap(), "F"), (p.unwrap(), "p")] {
                let right = digits(got, &right[name]);
                assert!(right > 11.0, "order {order}, term {term}: {name} is {got}, {right} digits");
                least = least.min(right);
            }
        }
        println!("order {order}: at least {least:.1} digits");
        assert!(least > 11.0);
    }
}
