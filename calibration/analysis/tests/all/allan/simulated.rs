//! Rates with quantisation, white noise, flicker noise and random walk of known sizes.

use isotherm_simulation::RandomGenerator;

/// The truth for an interval of 1 s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Truth {
    /// Quantisation Q: the phase is read in steps of Q times the root of 12.
    pub quantisation: f64,
    /// White noise N.
    pub white: f64,
    /// Flicker noise B.
    pub flicker: f64,
    /// Random walk K.
    pub walk: f64,
}

impl Truth {
    pub(crate) fn coefficients(&self) -> [f64; 4] {
        [self.quantisation, self.white, self.flicker, self.walk]
    }
}

/// Rates 1 s apart. Flicker noise is white noise of standard deviation B through the filter (1 - z^-1)^(-1/2), which
/// has run for as many rows before: the spectral density of the result is B^2/(2 pi f) (N. J. Kasdin, Proc. IEEE
/// 83, 1995).
pub(crate) fn rates(truth: &Truth, rows: usize, seed: u64) -> Vec<f64> {
    let mut random = RandomGenerator::new(seed, 0);
    let mut rates = vec![0.0; rows];
    if truth.flicker > 0.0 {
        let weights: Vec<f64> = (1..2 * rows)
            .scan(1.0, |weight, k| {
                let this = *weight;
                *weight *= (k as f64 - 0.5) / k as f64;
                Some(this)
            })
            .collect();
        for driven in 0..2 * rows {
            let white = truth.flicker * random.normal();
            // The row that this number drives first, counted from the first row that is kept.
            let (first, skipped) = (driven.saturating_sub(rows), rows.saturating_sub(driven));
            for (rate, weight) in rates[first..].iter_mut().zip(&weights[skipped..]) {
                *rate += weight * white;
            }
        }
    }
    let mut bias = 0.0;
    for rate in &mut rates {
        bias += truth.walk * random.normal();
        *rate += bias + truth.white * random.normal();
    }
    if truth.quantisation > 0.0 {
        let step = truth.quantisation * 12_f64.sqrt();
        let (mut phase, mut read) = (step * random.uniform(), 0.0);
        for rate in &mut rates {
            phase += *rate;
            let now = (phase / step).floor() * step;
            (*rate, read) = (now - read, now);
        }
    }
    rates
}
