use super::deviations::{phase, variance};
use super::moments::Moments;
use super::*;
use crate::allan::deviations::factors;

/// Frequencies of NIST SP 1065, section 5.10: a set of 9 and a random set of 1000.
fn random_set() -> Vec<f64> {
    let next = |x: &u64| Some(16807 * x % 2_147_483_647);
    core::iter::successors(Some(1_234_567_890), next).take(1000).map(|x| x as f64 / 2_147_483_647.0).collect()
}

#[test]
fn sets_of_nist_sp_1065() {
    let adev = |rates: &[f64], m| variance(&phase(rates, 1.0), m, 1.0).sqrt();
    let rates = random_set();
    let printed = [1, 10, 100].map(|m| format!("{:.6e}", adev(&rates, m)));
    assert_eq!(printed, ["2.922319e-1", "9.159953e-2", "3.241343e-2"]);
    let rates = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0];
    let printed = [1, 2].map(|m| format!("{:.5}", adev(&rates, m)));
    assert_eq!(printed, ["91.22945", "85.95287"]);
}

/// The moments by their definition: every lag, every term.
fn by_definition(factors: [usize; 2], n: usize, squares: [f64; 4]) -> f64 {
    let [m1, m2] = factors.map(|m| m as f64);
    let [l1, l2] = factors.map(|m| (n + 1 - 2 * m) as i64);
    let g = |t: f64| {
        let size = t.abs();
        let [quantisation, flicker] = if size == 0.0 { [1.0, 0.0] } else { [0.0, size * size * size.ln()] };
        let parts = [quantisation, -size / 2.0, flicker / core::f64::consts::TAU, size.powi(3) / 12.0];
        parts.iter().zip(squares).map(|(part, square)| part * square).sum::<f64>()
    };
    let second = [(0.0, 1.0), (1.0, -2.0), (2.0, 1.0)];
    let term = |lag: i64| {
        let count = (l1.min(l2 + lag) - lag.max(0)).max(0) as f64;
        let covariance = second.iter().flat_map(|a| second.iter().map(move |b| (a, b)));
        let covariance: f64 = covariance.map(|(a, b)| a.1 * b.1 * g(lag as f64 + a.0 * m1 - b.0 * m2)).sum();
        count * covariance * covariance
    };
    (1 - l2..l1).map(term).sum::<f64>() / (2.0 * l1 as f64 * l2 as f64 * m1 * m1 * m2 * m2)
}

#[test]
fn moments_are_those_of_the_definition() {
    let each = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    for squares in each.into_iter().chain([[1.0, 0.1, 0.01, 1e-5], [0.0, 0.0, 1.0, 1e-3]]) {
        for factors in
            [[1, 1], [1, 64], [3, 7], [2, 1024], [64, 256], [256, 256], [512, 1024], [813, 813], [1024, 1024]]
        {
            let [right, swapped] = [factors, [factors[1], factors[0]]].map(|it| by_definition(it, 4096, squares));
            let found = Moments::new(factors, 4096).covariance(&squares.into());
            assert!((found / right - 1.0).abs() < 1e-3, "{squares:?} {factors:?}: {found} {right}");
            assert!((swapped / right - 1.0).abs() < 1e-6, "{squares:?} {factors:?}: {swapped} {right}");
        }
    }
}

/// The covariance R(0) of a term with itself is that of the model, so the moments of one term are 2 AVAR^2.
#[test]
fn a_single_term_has_the_variance_of_the_model() {
    for squares in [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]] {
        let m = 16_usize;
        let length = m as f64;
        let terms = [3.0 / (length * length), 1.0 / length, FLICKER_FLOOR * FLICKER_FLOOR, length / 3.0];
        let variance: f64 = terms.iter().zip(squares).map(|(term, square)| term * square).sum();
        let found = Moments::new([m; 2], 2 * m).covariance(&squares.into());
        assert!((found / (2.0 * variance * variance) - 1.0).abs() < 1e-9, "{squares:?}: {found} {variance}");
    }
}

#[test]
fn factors_are_thirds_of_octaves_to_a_third_of_the_rows() {
    assert_eq!(factors(100), [1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32]);
    assert_eq!(factors(32768).len(), 38);
    assert_eq!(factors(32768).last(), Some(&10321));
}

#[test]
fn rates_that_never_change_have_no_deviation() {
    assert_eq!(Allan::of(&[7.5; 2000], 0.1), None);
    assert_eq!(Allan::of(&[1.0, 2.0], 0.1), None);
}

#[test]
fn counts_that_alternate_have_points_but_no_model() {
    let rates: Vec<f64> = (0..2000).map(|row| f64::from(row % 2)).collect();
    let found = Allan::of(&rates, 1.0).unwrap();
    assert!(found.model.is_none() && found.points.iter().all(|point| point.interval.is_none()));
    assert_eq!(found.points[1].adev, 0.0);
}
