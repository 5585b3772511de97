//! Tails and limits against values of arbitrary precision: tests/data/tails/exact.py.

use isotherm_statistics::{
    CONFIDENCE, NORMAL_QUANTILE, beta_tail, chi_square_limit, f_limit, f_tail, student_quantile_of,
};

#[test]
fn tails_and_limits_are_right_to_thirteen_digits() {
    let mut counted = 0;
    for line in include_str!("../data/tails/tails.csv").lines() {
        let (name, numbers) = line.split_once(',').unwrap();
        let numbers: Vec<f64> = numbers.split(',').map(|text| text.parse().unwrap()).collect();
        let found = match (name, numbers.as_slice()) {
            ("f_tail", [f, d1, d2, _]) => f_tail(*f, *d1, *d2),
            ("beta_tail", [x, a, b, _]) => beta_tail(*x, *a, *b),
            ("f_limit", [p, d1, d2, _]) => f_limit(*p, *d1, *d2),
            ("chi_square_limit", [p, freedom, _]) => chi_square_limit(*p, *freedom),
            other => panic!("{other:?}"),
        };
        let right = numbers[numbers.len() - 1];
        // A small probability has the rounding of its logarithm.
        let bound = 1e-13_f64.max(1e-15 * libm::log(right).abs());
        assert!((found / right - 1.0).abs() < bound, "{line}: {found:e}");
        counted += 1;
    }
    assert!(counted > 400, "{counted}");
}

#[test]
fn what_has_no_answer_is_not_a_number_and_the_ends_are_exact() {
    assert!(
        f_tail(1.0, 0.0, 5.0).is_nan() && f_tail(f64::NAN, 1.0, 5.0).is_nan() && f_tail(1.0, 1.0, f64::NAN).is_nan()
    );
    assert!(beta_tail(f64::NAN, 1.0, 1.0).is_nan() && beta_tail(0.5, -1.0, 1.0).is_nan());
    assert!(chi_square_limit(0.5, 0.0).is_nan() && student_quantile_of(0.95, 0.0).is_nan());
    assert_eq!([0.0, 1e300, f64::INFINITY].map(|f| f_tail(f, 2.0, 900.0)), [1.0, 0.0, 0.0]);
    assert_eq!([-1.0, 0.0, 1.0, 2.0].map(|x| beta_tail(x, 0.5, 3.0)), [1.0, 1.0, 0.0, 0.0]);
    assert_eq!([0.0, 1.0].map(|p| f_limit(p, 1.0, 9.0)), [f64::INFINITY, 0.0]);
    assert_eq!([1.0, 0.0].map(|confidence| student_quantile_of(confidence, 9.0)), [f64::INFINITY, 0.0]);
}

#[test]
fn the_quantile_of_the_normal_distribution_is_that_of_the_confidence() {
    let within = libm::erf(NORMAL_QUANTILE / core::f64::consts::SQRT_2);
    assert!((within - CONFIDENCE).abs() < 2e-16, "{within}");
    assert!((student_quantile_of(CONFIDENCE, 1e9) / NORMAL_QUANTILE - 1.0).abs() < 1e-8);
}
