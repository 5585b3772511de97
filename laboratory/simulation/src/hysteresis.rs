//! Hysteresis of the biases: plays, which remember temperature and not time.
//!
//! # Equations
//! The position z of a play of half-width w follows the head temperature U, and stands while U turns back within its
//! width:
//!
//! ```text
//! z = min(max(z, U - w), U + w)
//! error = h (z - U)                                                                    [g0 or deg/h]
//! ```
//! So the error is h w while the temperature falls and -h w while it rises, whatever the rate; it stays during a hold,
//! and goes over within 2 w after a turn. Several plays add up.

use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};

/// A play, and how much of it each bias has.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Play {
    /// Half-width w, over 0, in the unit of the temperature.
    pub half_width: f64,
    /// h of A1, A2, A3: error for each unit of temperature that the play is ahead of the head \[g0\].
    pub accelerometers: [f64; AXES],
    /// h of G1, G2, G3, as above \[deg/h\].
    #[serde(default)]
    pub gyroscopes: [f64; AXES],
}

/// A play at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimulatedPlay {
    pub play: Play,
    /// The last temperature.
    temperature: f64,
    /// Position z.
    position: f64,
}

impl SimulatedPlay {
    /// A play in its middle at `temperature`.
    pub(crate) const fn new(play: Play, temperature: f64) -> Self {
        Self { play, temperature, position: temperature }
    }

    /// How far the play is ahead of the temperature, z - U.
    pub(crate) fn ahead(&self) -> f64 {
        self.position - self.temperature
    }

    /// Follows the temperature, which goes monotonically from the last one to `temperature`.
    pub(crate) fn follow(&mut self, temperature: f64) {
        self.temperature = temperature;
        self.position = self.position.max(temperature - self.play.half_width).min(temperature + self.play.half_width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_play_stands_within_its_width_and_is_dragged_beyond() {
        let play = Play { half_width: 0.5, accelerometers: [1.0; AXES], gyroscopes: [0.0; AXES] };
        let mut simulated = SimulatedPlay::new(play, 2.0);
        for (temperature, ahead) in
            [(2.0, 0.0), (2.3, -0.3), (3.0, -0.5), (4.0, -0.5), (3.5, 0.0), (3.25, 0.25), (1.0, 0.5)]
        {
            simulated.follow(temperature);
            assert!((simulated.ahead() - ahead).abs() < 1e-12, "{temperature}: {}", simulated.ahead());
        }
    }
}
