//! Reproducible random numbers of a quality that suffices for simulated noise.

/// SplitMix64 with the Box-Muller transform. The same seed and stream give the same numbers.
///
/// ```
/// use isotherm_simulation::RandomGenerator;
///
/// let [mut a, mut again, mut other] = [0, 0, 1].map(|stream| RandomGenerator::new(7, stream));
/// let first = a.uniform();
/// assert_eq!(first, again.uniform());
/// assert_ne!(first, other.uniform());
/// assert!((2.0..3.0).contains(&a.between(2.0, 3.0)));
/// ```
#[derive(Clone, Debug)]
pub struct RandomGenerator {
    state: u64,
    /// Second number of the last Gaussian pair, if it is not used yet.
    spare: Option<f64>,
}

impl RandomGenerator {
    /// The numbers of `seed`; different `stream`s of one seed are independent.
    #[must_use]
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut seeds = Self { state: seed, spare: None };
        let state = seeds.next() ^ Self { state: stream, spare: None }.next().rotate_left(32);
        Self { state, spare: None }
    }

    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform from 0 (included) to 1 (excluded).
    pub fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Gaussian with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let (sin, cos) = libm::sincos(core::f64::consts::TAU * self.uniform());
        self.spare = Some(radius * sin);
        radius * cos
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_the_moments_of_a_gaussian() {
        let mut random = RandomGenerator::new(7, 0);
        let values: Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let moment = |n| values.iter().map(|v: &f64| v.powi(n)).sum::<f64>() / values.len() as f64;
        assert!(moment(1).abs() < 0.015 && (moment(2) - 1.0).abs() < 0.02, "{} {}", moment(1), moment(2));
        assert!(moment(3).abs() < 0.05 && (moment(4) - 3.0).abs() < 0.15, "{} {}", moment(3), moment(4));
        // The two numbers of one transform are independent of each other.
        let pairs = values.chunks(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / 50_000.0;
        assert!(pairs.abs() < 0.02, "{pairs}");
    }

    #[test]
    fn streams_and_seeds_differ_and_repeat() {
        let first = |seed, stream| RandomGenerator::new(seed, stream).uniform();
        assert_eq!(first(3, 1), first(3, 1));
        assert_ne!(first(3, 1), first(3, 2));
        assert_ne!(first(3, 1), first(1, 3));
        assert_ne!(first(3, 1), first(4, 1));
    }
}
