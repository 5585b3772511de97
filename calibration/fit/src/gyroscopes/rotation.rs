//! The angle over a turn, from the pulses of the gyroscopes themselves.

use super::runs::{AT_REST, TurnBlock};
use isotherm_shared::units::ARCSEC;

/// Rest before and after the motion in which phi follows the pulses \[s\].
const LONGEST_REST: f64 = 30.0;

/// Sets the rotations of blocks to 0 that lie further than [`LONGEST_REST`] from the motion. Bias and Earth's rate
/// count as rotation, and in a long rest they would add up.
pub(super) fn hold_at_rest(blocks: &[TurnBlock], rotations: &mut [f64]) {
    let rate = |(block, rotation): (&TurnBlock, &f64)| rotation.abs() / block.seconds;
    let rates: Vec<f64> = blocks.iter().zip(rotations.iter()).map(rate).collect();
    let fastest = rates.iter().copied().fold(0.0, f64::max);
    let moves = |rate: &f64| *rate > AT_REST * fastest;
    let (Some(first), Some(last)) = (rates.iter().position(moves), rates.iter().rposition(moves)) else { return };
    let (before, after): (Vec<usize>, Vec<usize>) = ((0..first).rev().collect(), (last + 1..blocks.len()).collect());
    for side in [before, after] {
        let mut seconds = 0.0;
        for index in side {
            seconds += blocks[index].seconds;
            if seconds > LONGEST_REST {
                rotations[index] = 0.0;
            }
        }
    }
}

/// phi over a turn: the cumulated rotations of its blocks, scaled to the angle in total, linear within a block.
pub(super) struct TurnIntegrals {
    /// Integral of cos(phi) \[s\].
    pub cosine: f64,
    /// Integral of sin(phi) \[s\].
    pub sine: f64,
}

impl TurnIntegrals {
    /// `rotations` of the blocks, in any unit; `angle` in arcsec.
    pub(super) fn of(blocks: &[TurnBlock], rotations: &[f64], angle: f64) -> Self {
        let factor = angle / rotations.iter().sum::<f64>() * ARCSEC;
        let (mut phi, mut cosine, mut sine) = (0.0, 0.0, 0.0);
        for (block, rotation) in blocks.iter().zip(rotations) {
            let half = 0.5 * rotation * factor;
            // The mean over an angle from a to b is that at the middle times sin(h)/h, with h = (b - a)/2.
            let mean = if half.abs() < 1e-4 { 1.0 - half * half / 6.0 } else { libm::sin(half) / half };
            cosine += block.seconds * mean * libm::cos(phi + half);
            sine += block.seconds * mean * libm::sin(phi + half);
            phi += 2.0 * half;
        }
        Self { cosine, sine }
    }
}
