//! Bias curves as powers of temperature about one temperature.

use isotherm_shared::polynomial::Polynomial;

/// Highest order of the autopilots' polynomials.
pub const HIGHEST_ORDER: usize = 3;
/// Coefficients of these polynomials.
pub(crate) const TERMS: usize = HIGHEST_ORDER + 1;

/// Points at which a range is looked at, ends included.
const POINTS: u32 = 400;

/// `a_k` of `p(T) = a_0 + a_1 (T - about) + .. + a_3 (T - about)^3`, for a polynomial of order 3 at most. If it has
/// higher orders, these are the first four terms.
///
/// With `s = (about - center) / scale`, the coefficients about s come from repeated synthetic division; each is then
/// divided by `scale^k`.
pub(crate) fn powers(p: &Polynomial, about: f64) -> [f64; TERMS] {
    let s = (about - p.center()) / p.scale();
    let mut shifted = p.coefficients().to_vec();
    for low in 0..shifted.len() {
        // From the highest down, each takes what the one above it has become.
        let mut above = 0.0;
        for coefficient in shifted.iter_mut().skip(low).rev() {
            *coefficient += above * s;
            above = *coefficient;
        }
    }
    let mut all = [0.0; TERMS];
    let mut divisor = 1.0;
    for (power, coefficient) in all.iter_mut().zip(shifted) {
        *power = coefficient / divisor;
        divisor *= p.scale();
    }
    all
}

/// Whether the polynomial has terms above order 3.
pub(crate) fn is_higher(p: &Polynomial) -> bool {
    p.coefficients().iter().skip(TERMS).any(|coefficient| *coefficient != 0.0)
}

/// The polynomial of order 3 that has the first four terms of the polynomial's Chebyshev series over its range: nearly
/// the one with the least largest difference. `None` if a coefficient overflows.
pub(crate) fn third_order(p: &Polynomial) -> Option<Polynomial> {
    const NODES: u32 = 16;
    let [low, high] = p.range();
    let (middle, half) = (f64::midpoint(low, high), (high - low) / 2.0);
    // The series of a polynomial of order n is exact with more than n nodes.
    let term = |k: u32| {
        let sum: f64 = (0..NODES)
            .map(|node| std::f64::consts::PI * (f64::from(node) + 0.5) / f64::from(NODES))
            .map(|angle| p.at(middle + half * libm::cos(angle)) * libm::cos(f64::from(k) * angle))
            .sum();
        sum * 2.0 / f64::from(NODES)
    };
    let [t0, t1, t2, t3] = [term(0) / 2.0, term(1), term(2), term(3)];
    // T2 = 2 x^2 - 1, T3 = 4 x^3 - 3 x
    Polynomial::new(&[t0 - t2, t1 - 3.0 * t3, 2.0 * t2, 4.0 * t3], middle, half, p.range())
}

/// Temperatures over a range, its ends included.
pub(crate) fn points([low, high]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..=POINTS).map(move |point| {
        let share = f64::from(point) / f64::from(POINTS);
        (low * (1.0 - share) + high * share).clamp(low, high)
    })
}

/// The largest absolute value over a range.
pub(crate) fn largest(range: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    points(range).map(|at| value(at).abs()).fold(0.0, f64::max)
}

/// The range that all have; `None` if there is none.
pub(crate) fn common(ranges: impl Iterator<Item = [f64; 2]>) -> Option<[f64; 2]> {
    let all = ranges.fold([f64::NEG_INFINITY, f64::INFINITY], |[a, b], [low, high]| [a.max(low), b.min(high)]);
    (all[0] < all[1]).then_some(all)
}

/// The range from the lowest to the highest end.
pub(crate) fn hull(ranges: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    ranges.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [low, high]| [a.min(low), b.max(high)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_the_polynomial() {
        let p = Polynomial::new(&[0.3, -1.5, 0.7, 2.5], 25.0, -40.0, [-20.0, 70.0]).unwrap();
        for about in [-17.3, 0.0, 25.0, 35.0] {
            let [a0, a1, a2, a3] = powers(&p, about);
            for at in points(p.range()) {
                let t = at - about;
                assert!((a0 + a1 * t + a2 * t * t + a3 * t * t * t - p.at(at)).abs() < 1e-12, "{about} {at}");
            }
        }
        assert_eq!(powers(&Polynomial::new(&[0.25], 1.0, 3.0, [0.0, 1.0]).unwrap(), 35.0), [0.25, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_third_order_of_a_third_order_is_the_same() {
        let p = Polynomial::new(&[0.3, -1.5, 0.7, 2.5], 25.0, 40.0, [-20.0, 70.0]).unwrap();
        let third = third_order(&p).unwrap();
        assert!(largest(p.range(), |at| third.at(at) - p.at(at)) < 1e-13);
    }

    #[test]
    fn what_a_third_order_lacks_is_spread_over_the_range() {
        // x^4 over -1 to 1 has T4 / 8 above order 3.
        let p = Polynomial::new(&[0.0, 0.0, 0.0, 0.0, 1.0], 0.0, 1.0, [-1.0, 1.0]).unwrap();
        let third = third_order(&p).unwrap();
        assert!(is_higher(&p) && !is_higher(&third));
        let lost = largest(p.range(), |at| third.at(at) - p.at(at));
        assert!((lost - 0.125).abs() < 1e-12, "{lost}");
    }

    #[test]
    fn ranges_are_joined() {
        let ranges = [[-10.0, 50.0], [-20.0, 40.0]];
        assert_eq!(common(ranges.into_iter()), Some([-10.0, 40.0]));
        assert_eq!(hull(ranges.into_iter()), [-20.0, 50.0]);
        assert_eq!(common([[0.0, 1.0], [1.0, 2.0]].into_iter()), None);
    }
}
