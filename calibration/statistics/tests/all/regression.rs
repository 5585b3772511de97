//! Properties that the reference sets do not test: weights, leave-one-out errors, data that allow no regression.

use isotherm_statistics::{DataPoint, DoubleDouble, Regression, RegressionError, Rule, choose, f_limit, f_tail};
use proptest::prelude::*;

fn points(count: u32) -> Vec<DataPoint> {
    (0..count)
        .map(|i| f64::from(i) / 5.0 + 1.1)
        .map(|x| DataPoint::new(x, 3.0 + libm::sin(3.0 * x) + 0.2 * x * x))
        .collect()
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs().max(1e-300)
}

#[test]
fn leave_one_out_errors_equal_those_of_refits() {
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
fn a_weight_of_two_equals_two_points() {
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
    // Eq. (15): the fit without the last term is the fit of the next lower order.
    let regression = Regression::new(points(12), 4).unwrap();
    for pair in regression.fits().windows(2) {
        let partial = pair[1].partial.last().unwrap();
        let centred = pair[1].partial_centred.last().unwrap();
        assert!(close(partial.sum_of_squares, pair[0].sse - pair[1].sse, 1e-11));
        assert!(close(centred.sum_of_squares, partial.sum_of_squares, 1e-13));
        assert!(close(pair[1].sequential_ss, partial.sum_of_squares, 1e-11));
    }
    // The sums of squares of lower terms depend on the centring.
    let fit = &regression.fits()[3];
    assert!(!close(fit.partial[0].sum_of_squares, fit.partial_centred[0].sum_of_squares, 0.1));
}

#[test]
fn data_that_allow_no_regression_are_refused() {
    let three = || points(3);
    assert_eq!(Regression::new(three(), 3).unwrap_err(), RegressionError::TooFewPoints { order: 3, distinct: 3 });
    let same = vec![three()[0]; 5];
    assert_eq!(Regression::new(same, 1).unwrap_err(), RegressionError::TooFewPoints { order: 1, distinct: 1 });
    assert_eq!(Regression::new(points(30), 16).unwrap_err(), RegressionError::OrderTooHigh(16));
    assert_eq!(Regression::new(Vec::new(), 0).unwrap_err(), RegressionError::TooFewPoints { order: 0, distinct: 0 });
    let huge = points(30).iter().map(|p| DataPoint::new(p.x.value() * 1e135, p.y.value())).collect();
    assert_eq!(Regression::new(huge, 15).unwrap_err(), RegressionError::OutOfRange);
    // With as many coefficients as points there is a curve, but no residual to judge it by.
    let exact = Regression::new(three(), 2).unwrap();
    assert!(exact.fits()[2].standard_errors.is_none() && exact.fits()[2].f.is_none());
    assert_eq!(exact.fits()[2].leave_one_out_rms, None);
    // Constant data have no R.
    let constant = Regression::new([1.0, 2.0, 3.0].map(|x| DataPoint::new(x, 5.0)).to_vec(), 1).unwrap();
    assert_eq!((constant.fits()[1].r_squared, constant.fits()[1].coefficients[0]), (None, 5.0));
}

#[test]
fn the_f_distribution_agrees_with_published_tables() {
    for (p, d1, d2, right) in
        [(0.05, 1.0, 10.0, 4.964_603), (0.01, 3.0, 11.0, 6.216_730), (0.05, 5.0, 1000.0, 2.223_052)]
    {
        assert!((f_limit(p, d1, d2) - right).abs() < 2e-5, "{}", f_limit(p, d1, d2));
        assert!(close(f_tail(f_limit(p, d1, d2), d1, d2), p, 1e-9));
    }
    assert_eq!((f_tail(0.0, 1.0, 5.0), f_tail(-1.0, 1.0, 5.0)), (1.0, 1.0));
}

proptest! {
    /// The fit recovers a polynomial in any range of x.
    #[test]
    fn polynomials_are_recovered(
        coefficients in prop::collection::vec(-5.0..5.0f64, 1..=6),
        offset in -1e3..1e3f64,
        width in 1e-2..1e3f64,
    ) {
        let exact = |x: DoubleDouble| coefficients.iter().rev().fold(DoubleDouble::ZERO, |r, &c| r * x + c.into());
        let x = (0..20).map(|i| DoubleDouble::from(offset + width * f64::from(i)));
        let points = x.map(|x| DataPoint { x, y: exact(x), weight: DoubleDouble::ONE }).collect();
        let regression = Regression::new(points, 7).unwrap();
        let fit = &regression.fits()[coefficients.len() - 1];
        // The rounding of y, 1e-31 of its size, is amplified in a coefficient by powers of offset / width.
        let farthest = offset.abs() + 20.0 * width;
        let size: f64 = coefficients.iter().zip(0..).map(|(c, k)| c.abs() * farthest.powi(k)).sum();
        let cost = 1e-28 * (2.0 + offset.abs() / width).powi(7);
        for (k, (got, right)) in (0..).zip(fit.coefficients.iter().zip(&coefficients)) {
            let tolerance = 1e-15 * right.abs() + cost * size / farthest.powi(k);
            prop_assert!((got - right).abs() <= tolerance, "{got} {right} {tolerance}");
        }
    }
}

#[test]
fn any_scale_of_x_and_y_is_answered_or_refused() {
    for exponent in [-135, -100, -60, -30, -12, 0, 12, 18, 30, 60, 100, 135] {
        for order in [1, 6, 12, 15] {
            let scale = 10_f64.powi(exponent);
            for (x_scale, y_scale) in [(scale, 1.0), (1.0, scale), (scale, scale), (scale, 1.0 / scale)] {
                let points: Vec<_> =
                    points(30).iter().map(|p| DataPoint::new(p.x.value() * x_scale, p.y.value() * y_scale)).collect();
                // No data may cause a panic, and every returned figure must be finite.
                if let Ok(regression) = Regression::new(points, order) {
                    let fit = &regression.fits()[order];
                    assert!(
                        fit.partial.iter().all(|p| p.sum_of_squares.is_finite() && p.p.is_some()),
                        "{exponent} {order}"
                    );
                }
            }
        }
    }
    // Times as users have them: nanoseconds since 1970, one every 10 s.
    let times: Vec<_> = points(60)
        .iter()
        .zip(0_i64..)
        .map(|(p, i)| DataPoint {
            x: DoubleDouble::parse(&format!("{}", 1_700_000_000_000_000_000 + i * 10_000_000_000)).unwrap(),
            ..*p
        })
        .collect();
    let fit = &Regression::new(times, 12).unwrap().fits()[12].clone();
    assert!(fit.partial.iter().all(|partial| partial.p.is_some()));
}

#[test]
fn a_fit_is_perfect_only_to_the_rounding_of_its_data() {
    let line = |y: &dyn Fn(i64) -> String| {
        let point = |i: i64| DataPoint {
            x: DoubleDouble::from(i as f64),
            y: DoubleDouble::parse(&y(i)).unwrap(),
            weight: DoubleDouble::ONE,
        };
        Regression::new((0..9).map(point).collect(), 1).unwrap().fits()[1].clone()
    };
    // Doubles in their shortest form: 0.1 * 3 is 0.30000000000000004.
    assert_eq!(line(&|i| format!("{:?}", 0.1 * i as f64)).f, None);
    assert_eq!(line(&|i| format!("{}.{}", i / 10, i % 10)).sse, 0.0);
    // Nanoseconds since 1970 with up to 100 ns of jitter must not be rounded to doubles, whose spacing there is 256 ns.
    let jitter = |i: i64| 1_700_000_000_000_000_000 + i * 10_000_000_000 + (i * 7919) % 100;
    assert!(line(&|i| jitter(i).to_string()).residual_sd.unwrap() > 10.0);
}

#[test]
fn as_many_coefficients_as_points_are_never_chosen() {
    let noisy = |x: f64| 2.0 * x + 0.01 * libm::sin(97.0 * x);
    let points = (0..7).map(f64::from).map(|x| DataPoint::new(x, noisy(x))).collect();
    let choice = choose(&Regression::new(points, 6).unwrap(), &Rule::default());
    assert_eq!(choice.order, 1, "{}", choice.reason);
}
