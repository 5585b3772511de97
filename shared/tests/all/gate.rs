//! What a gate of seconds costs while the temperature moves, as docs/maths.md says.

use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::CoefficientTable;

const TABLE: &str = include_str!("../../../tests/data/imu-a.toml");
/// Parts of a gate, of which the mean is taken by Simpson's rule.
const PARTS: u32 = 2000;

/// The mean over a gate during which the temperature moves evenly by `span` about `middle`.
fn mean(middle: f64, span: f64, of: impl Fn(f64) -> f64) -> f64 {
    let at = |part: u32| of(middle + span * (f64::from(part) / f64::from(PARTS) - 0.5));
    let weight = |part: u32| match part {
        0 | PARTS => 1.0,
        _ if part % 2 == 1 => 4.0,
        _ => 2.0,
    };
    (0..=PARTS).map(|part| weight(part) * at(part)).sum::<f64>() / (3.0 * f64::from(PARTS))
}

/// Coefficients of a polynomial about another place: c0, c1, ...
fn about(coefficients: &[f64], middle: f64) -> Vec<f64> {
    let mut shifted = coefficients.to_vec();
    for lowest in 0..shifted.len() {
        for power in (lowest..shifted.len() - 1).rev() {
            shifted[power] += middle * shifted[power + 1];
        }
    }
    shifted
}

/// The terms of even order over what they are multiplied by: 1/12, 1/80, 1/448.
fn of_gate(coefficients: &[f64], middle: f64, span: f64) -> f64 {
    let term = |(power, c): (usize, &f64)| c * (span / 2.0).powi(power as i32) / (power + 1) as f64;
    about(coefficients, middle).iter().enumerate().skip(2).step_by(2).map(term).sum()
}

/// Numbers that are the same in every run, from -1 to 1.
fn numbers() -> impl Iterator<Item = f64> {
    let next = |x: &u64| Some(16807 * x % 2_147_483_647);
    core::iter::successors(Some(1_234_567), next).map(|x| 2.0 * x as f64 / 2_147_483_647.0 - 1.0)
}

#[test]
fn a_gate_costs_the_terms_of_even_order() {
    let mut numbers = numbers();
    let mut next = || numbers.next().unwrap();
    for order in 0..=7 {
        for _ in 0..100 {
            let coefficients: Vec<f64> = (0..=order).map(|_| next()).collect();
            let polynomial = Polynomial::new(&coefficients, 0.0, 1.0, [-2.0, 2.0]).unwrap();
            let (middle, span) = (next(), next());
            let found = mean(middle, span, |u| polynomial.at(u)) - polynomial.at(middle);
            let expected = of_gate(&coefficients, middle, span);
            assert!((found - expected).abs() < 1e-12, "{coefficients:?}, {middle}, {span}: {found} {expected}");
        }
    }
}

/// The pulses of a gate, taken at its mean temperature: the error of the specific force is that of the second
/// derivative of what is counted, K (f + A), and with temperature of the gate's end that of its first.
#[test]
fn a_specific_force_is_off_by_little_at_the_mean_and_by_much_at_the_end() {
    let table = CoefficientTable::from_toml(TABLE, None).unwrap();
    let (mut numbers, force) = (numbers(), 1.0);
    let mut next = || numbers.next().unwrap();
    let mut worst = [0.0_f64; 2];
    for axis in &table.content().axes {
        let bias = |u: f64| axis.bias.at(u) * 1e-6;
        let counted = |u: f64| axis.positive_scale_factor.at(u) * (force + bias(u));
        for _ in 0..100 {
            // The range in 40 minutes, and gates of 10 s.
            let (middle, span) = (2.55 + 1.6 * next(), 3.3 / 2400.0 * 10.0);
            let pulses = mean(middle, span, counted);
            let reduced = |u: f64| pulses / axis.positive_scale_factor.at(u) - bias(u) - force;
            let h = 1e-3;
            let [first, second] = [
                (counted(middle + h) - counted(middle - h)) / (2.0 * h),
                (counted(middle + h) - 2.0 * counted(middle) + counted(middle - h)) / (h * h),
            ];
            let scale = axis.positive_scale_factor.at(middle);
            let at_mean = second * span * span / 24.0 / scale;
            assert!((reduced(middle) - at_mean).abs() < 1e-3 * at_mean.abs() + 1e-12, "{middle}: {at_mean}");
            let at_end = -first * span / 2.0 / scale;
            let rest = (reduced(middle + span / 2.0) - at_end).abs();
            assert!(rest < 0.05 * at_end.abs() + 1e-6, "{middle}: {at_end}, {rest}");
            worst = [worst[0].max(reduced(middle).abs()), worst[1].max(reduced(middle + span / 2.0).abs())];
        }
    }
    println!("{:.2e} g0 at the mean, {:.1e} at the end", worst[0], worst[1]);
    assert!(worst[0] < 0.15e-6 && (20e-6..120e-6).contains(&worst[1]), "{worst:?}");
}
