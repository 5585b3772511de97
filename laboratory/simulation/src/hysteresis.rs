//! Hysteresis of the biases: plays, which remember temperature and not time.
//!
//! # Equations
//! The position z of a play of half-width w follows the head telemetry U, and stands while U turns back within its
//! width:
//!
//! ```text
//! z = min(max(z, U - w), U + w)
//! error = h (z - U)                                                                    [g0 or deg/h]
//! ```
//! So the error is h w while the telemetry falls and -h w while it rises, whatever the rate; it stays during a hold,
//! and goes over within 2 w after a turn. Several plays add up.

use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};

/// A play, and how much of it each bias has.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Play {
    /// Half-width w, over 0, in the unit of the telemetry.
    pub half_width: f64,
    /// h of A1, A2, A3: error for each unit of telemetry that the play is ahead of the head \[g0\].
    pub accelerometers: [f64; AXES],
    /// h of G1, G2, G3, as above \[deg/h\].
    #[serde(default)]
    pub gyroscopes: [f64; AXES],
}

/// A play at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct SimulatedPlay {
    pub play: Play,
    /// The last telemetry.
    telemetry: f64,
    /// Position z.
    position: f64,
}

impl SimulatedPlay {
    /// A play in its middle at `telemetry`.
    pub(crate) const fn new(play: Play, telemetry: f64) -> Self {
        Self { play, telemetry, position: telemetry }
    }

    /// How far the play is ahead of the telemetry, z - U.
    pub(crate) fn ahead(&self) -> f64 {
        self.position - self.telemetry
    }

    /// Follows the telemetry, which goes monotonically from the last one to `telemetry`.
    pub(crate) fn follow(&mut self, telemetry: f64) {
        self.telemetry = telemetry;
        self.position = self.position.max(telemetry - self.play.half_width).min(telemetry + self.play.half_width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_play_stands_within_its_width_and_is_dragged_beyond() {
        let play = Play { half_width: 0.5, accelerometers: [1.0; AXES], gyroscopes: [0.0; AXES] };
        let mut simulated = SimulatedPlay::new(play, 2.0);
        for (telemetry, ahead) in
            [(2.0, 0.0), (2.3, -0.3), (3.0, -0.5), (4.0, -0.5), (3.5, 0.0), (3.25, 0.25), (1.0, 0.5)]
        {
            simulated.follow(telemetry);
            assert!((simulated.ahead() - ahead).abs() < 1e-12, "{telemetry}: {}", simulated.ahead());
        }
    }
}
