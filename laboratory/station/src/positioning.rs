//! Where the turntable's axes come to rest: each misses its commanded angle by an error that no read-back shows.
//!
//! A new position has new errors, independent of all others. An angle that an axis comes back to while the other axis
//! stands, modulo 360 degrees, has the error that it had, within the repeatability of a turn: the axis meets the same
//! marks of its scale and the same wobble of its bearing. So a turn of whole revolutions leans on the repeatability
//! only, in one move or in several, and any other turn on the scale, too.

use isotherm_simulation::{Noise, RandomGenerator};

/// Angles that differ by less than this modulo 360 are the same \[deg\].
const SAME_DEG: f64 = 1e-6;
/// Number of the random stream of the errors, the same as in a simulated campaign.
const POSITIONING_STREAM: u64 = 3;

/// The errors of both axes. Both begin at the angle 0, without an error.
pub(crate) struct PositioningErrors {
    random: RandomGenerator,
    /// Standard deviation of the error of a new position \[deg\].
    positioning_deg: f64,
    /// Standard deviation of the error of each move back to an angle \[deg\].
    repeatability_deg: f64,
    axes: [AxisErrors; 2],
}

/// The errors of an axis.
#[derive(Default)]
struct AxisErrors {
    commanded_deg: f64,
    rest_deg: f64,
    /// Angles where it has been since the other axis moved \[deg\], and their errors \[deg\]; the present one is the
    /// last.
    visited: Vec<(f64, f64)>,
}

impl PositioningErrors {
    /// The errors of `seed`.
    pub(crate) fn new(noise: &Noise, seed: u64) -> Self {
        let axes = [(); 2].map(|()| AxisErrors { visited: vec![(0.0, 0.0)], ..AxisErrors::default() });
        Self {
            random: RandomGenerator::new(seed, POSITIONING_STREAM),
            positioning_deg: noise.positioning_rad.to_degrees(),
            repeatability_deg: noise.turn_rad.to_degrees(),
            axes,
        }
    }

    /// The angle where a move of `axis` to `commanded_deg` ends \[deg\]. An axis that is there already does not move.
    pub(crate) fn rest_deg(&mut self, axis: usize, commanded_deg: f64) -> f64 {
        let [moving, standing] = if axis == 0 { [0, 1] } else { [1, 0] };
        if commanded_deg == self.axes[moving].commanded_deg {
            return self.axes[moving].rest_deg;
        }
        let visited = &mut self.axes[standing].visited;
        visited.drain(..visited.len() - 1);

        let AxisErrors { commanded_deg: commanded, rest_deg, visited } = &mut self.axes[moving];
        let same = |(angle_deg, _): &(f64, f64)| {
            let difference_deg = (commanded_deg - angle_deg).rem_euclid(360.0);
            difference_deg.min(360.0 - difference_deg) < SAME_DEG
        };
        let (error_deg, off_deg) = match visited.iter().position(same) {
            Some(index) => (visited.remove(index).1, self.repeatability_deg * self.random.normal()),
            None => (self.positioning_deg * self.random.normal(), 0.0),
        };
        visited.push((commanded_deg, error_deg));
        (*commanded, *rest_deg) = (commanded_deg, commanded_deg + error_deg + off_deg);
        *rest_deg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors() -> PositioningErrors {
        let [positioning_rad, turn_rad] = [1.0, 0.2].map(|arcsec: f64| (arcsec / 3600.0).to_radians());
        PositioningErrors::new(&Noise { positioning_rad, turn_rad, ..Noise::NONE }, 5)
    }

    fn rms(values: &[f64]) -> f64 {
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn a_new_position_has_new_errors() {
        let mut errors = errors();
        let mut found = Vec::new();
        for _ in 0..500 {
            for (outer, inner) in [(90.0, 180.0), (0.0, 90.0), (270.0, 270.0)] {
                for (axis, angle) in [(0, outer), (1, inner)] {
                    found.push((errors.rest_deg(axis, angle) - angle) * 3600.0);
                }
            }
        }
        assert!((rms(&found) - 1.0).abs() < 0.05, "{}", rms(&found));
        let products: Vec<_> = found.windows(3).map(|pair| pair[0] * pair[2]).collect();
        assert!((products.iter().sum::<f64>() / products.len() as f64).abs() < 0.1);
    }

    /// In one move and in three, back and forth; the axis that stands is commanded, too.
    #[test]
    fn whole_turns_repeat() {
        for moves in [1, 3] {
            let mut errors = errors();
            let mut found = Vec::new();
            for visit in 0..300 {
                let start = f64::from(visit % 4) * 90.0;
                errors.rest_deg(1, start);
                let standing = errors.rest_deg(1, start);
                let mut before = errors.rest_deg(0, 360.0 - start);
                for direction in [1.0, -1.0] {
                    let mut after = before;
                    for part in 1..=moves {
                        let angle = 360.0 * f64::from(part) / f64::from(moves);
                        let begin = if direction > 0.0 { 360.0 - start } else { 720.0 - start };
                        after = errors.rest_deg(0, begin + direction * angle);
                        assert_eq!(errors.rest_deg(1, start), standing);
                    }
                    found.push((after - before - direction * 360.0) * 3600.0);
                    before = after;
                }
            }
            assert!((0.2..0.3).contains(&rms(&found)), "{moves}: {}", rms(&found));
        }
    }

    #[test]
    fn an_exact_turntable_is_exact() {
        let mut errors = PositioningErrors::new(&Noise::NONE, 5);
        assert_eq!(
            [(0, 90.0), (1, -5.0), (0, 450.0)].map(|(axis, angle)| errors.rest_deg(axis, angle)),
            [90.0, -5.0, 450.0]
        );
    }
}
