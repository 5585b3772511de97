//! What the reference sets do not show: weights, points left out, data that allow no regression.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_calibration::double_double::DoubleDouble;
use isotherm_calibration::regression::{Point, Regression, RegressionError, f_limit, f_tail};
use proptest::prelude::*;

fn points(count: u32) -> Vec<Point> {
    (0..count).map(|i| f64::from(i) / 5.0 + 1.1).map(|x| Point::new(x, 3.0 + (3.0 * x).sin() + 0.2 * x * x)).collect()
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs().max(1e-300)
}

#[test]
fn leaving_a_point_out_is_what_it_says() {
    let all = points(12);
    let regression = Regression::new(all.clone(), 4).unwrap();
    for order in 0..=4 {
        let errors: Vec<f64> = (0..all.len())
            .map(|left_out| {
                let mut rest = all.clone();
                let point = rest.remove(left_out);
                Regression::new(rest, order).unwrap().at(order, point.x.value()).0 - point.y.value()
            })
            .collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let worst = errors.iter().fold(0.0, |most: f64, e| most.max(e.abs()));
        let fit = &regression.fits()[order];
        assert!(close(fit.leave_one_out_rms.unwrap(), rms, 1e-12), "{order}");
        assert!(close(fit.leave_one_out_max.unwrap(), worst, 1e-12), "{order}");
    }
}

#[test]
fn a_weight_of_two_is_as_good_as_two_points() {
    let mut twice = points(9);
    twice.push(twice[3]);
    let mut weighted = points(9);
    weighted[3].weight = DoubleDouble::from(2.0);
    let (twice, weighted) = (Regression::new(twice, 3).unwrap(), Regression::new(weighted, 3).unwrap());
    for (a, b) in twice.fits().iter().zip(weighted.fits()) {
        assert!(a.coefficients.iter().zip(&b.coefficients).all(|(a, b)| close(*a, *b, 1e-14)));
        assert!(close(a.sse, b.sse, 1e-14) && close(a.ss_total, b.ss_total, 1e-14));
        assert!(a.r_squared.is_none_or(|r| close(r, b.r_squared.unwrap(), 1e-13)) || a.order == 0);
    }
}

#[test]
fn the_partial_sum_of_squares_needs_a_refit() {
    // Eq. (15): without the last term, the fit is the one of the order below.
    let regression = Regression::new(points(12), 4).unwrap();
    for pair in regression.fits().windows(2) {
        let partial = pair[1].partial.last().unwrap();
        let centred = pair[1].partial_centred.last().unwrap();
        assert!(close(partial.sum_of_squares, pair[0].sse - pair[1].sse, 1e-11));
        assert!(close(centred.sum_of_squares, partial.sum_of_squares, 1e-13));
        assert!(close(pair[1].sequential_ss, partial.sum_of_squares, 1e-11));
    }
    // Lower terms depend on the centring.
    let fit = &regression.fits()[3];
    assert!(!close(fit.partial[0].sum_of_squares, fit.partial_centred[0].sum_of_squares, 0.1));
}

#[test]
fn what_allows_no_regression_is_refused() {
    let three = || points(3);
    assert_eq!(Regression::new(three(), 3).unwrap_err(), RegressionError::TooFewPoints { order: 3, distinct: 3 });
    let same = vec![three()[0]; 5];
    assert_eq!(Regression::new(same, 1).unwrap_err(), RegressionError::TooFewPoints { order: 1, distinct: 1 });
    assert_eq!(Regression::new(points(30), 16).unwrap_err(), RegressionError::OrderTooHigh(16));
    assert_eq!(Regression::new(Vec::new(), 0).unwrap_err(), RegressionError::TooFewPoints { order: 0, distinct: 0 });
    let huge = [1.0, 2.0, 3.0, 4.0].map(|x| Point::new(x * 1e130, x * 1e139)).to_vec();
    assert_eq!(Regression::new(huge, 2).unwrap_err(), RegressionError::OutOfRange);
    // As many coefficients as points: a curve, but nothing to judge it by.
    let exact = Regression::new(three(), 2).unwrap();
    assert!(exact.fits()[2].standard_errors.is_none() && exact.fits()[2].f.is_none());
    assert_eq!(exact.fits()[2].leave_one_out_rms, None);
    // A constant has no R.
    let constant = Regression::new([1.0, 2.0, 3.0].map(|x| Point::new(x, 5.0)).to_vec(), 1).unwrap();
    assert_eq!((constant.fits()[1].r_squared, constant.fits()[1].coefficients[0]), (None, 5.0));
}

#[test]
fn the_f_distribution_is_that_of_the_tables() {
    for (p, d1, d2, right) in
        [(0.05, 1.0, 10.0, 4.964_603), (0.01, 3.0, 11.0, 6.216_730), (0.05, 5.0, 1000.0, 2.223_052)]
    {
        assert!((f_limit(p, d1, d2) - right).abs() < 2e-5, "{}", f_limit(p, d1, d2));
        assert!(close(f_tail(f_limit(p, d1, d2), d1, d2), p, 1e-9));
    }
    assert_eq!((f_tail(0.0, 1.0, 5.0), f_tail(-1.0, 1.0, 5.0)), (1.0, 1.0));
}

proptest! {
    /// A polynomial is found again, wherever its x are.
    #[test]
    fn polynomials_are_found_again(
        coefficients in prop::collection::vec(-5.0..5.0f64, 1..=6),
        offset in -1e3..1e3f64,
        width in 1e-2..1e3f64,
    ) {
        let exact = |x: DoubleDouble| coefficients.iter().rev().fold(DoubleDouble::ZERO, |r, &c| r * x + c.into());
        let x = (0..20).map(|i| DoubleDouble::from(offset + width * f64::from(i)));
        let points = x.map(|x| Point { x, y: exact(x), weight: DoubleDouble::ONE }).collect();
        let regression = Regression::new(points, 7).unwrap();
        let fit = &regression.fits()[coefficients.len() - 1];
        // What y is good for, 1e-31 of its size, reaches a coefficient through the powers of the offset over the width.
        let farthest = offset.abs() + 20.0 * width;
        let size: f64 = coefficients.iter().zip(0..).map(|(c, k)| c.abs() * farthest.powi(k)).sum();
        let cost = 1e-28 * (2.0 + offset.abs() / width).powi(7);
        for (k, (got, right)) in (0..).zip(fit.coefficients.iter().zip(&coefficients)) {
            let tolerance = 1e-15 * right.abs() + cost * size / farthest.powi(k);
            prop_assert!((got - right).abs() <= tolerance, "{got} {right} {tolerance}");
        }
    }
}
