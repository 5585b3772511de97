//! Options of what the past of the temperature adds to the biases: elements that lag, and plays.

use clap::Args;
use isotherm_offline::parse::{numbers, positive, time_constant};
use isotherm_shared::table::Content;
use isotherm_shared::wire::AXES;
use isotherm_simulation::Play;
use isotherm_support::failure::{Exit, Failure};

/// Where only gyroscopes have a thing.
const ONLY_GYROSCOPES: &str = "the IMU has no gyroscopes; give --gyroscopes too";

/// Options of the memory of the biases.
#[derive(Debug, Args)]
pub(super) struct MemoryOptions {
    /// Set the lag behind the head temperature [s]
    ///
    /// The time constant with which the sensing elements follow the head temperature. Default: as in TABLE, or no lag.
    #[arg(long, value_name = "S", value_parser = time_constant)]
    lag: Option<f64>,
    /// Set the transients of the accelerometers' biases
    ///
    /// For A1, A2, A3, per unit of temperature by which the element leads its head [1e-6 g0 per V or degC]
    #[arg(long, value_name = "T1,T2,T3", allow_hyphen_values = true, value_parser = numbers::<AXES>)]
    transient: Option<[f64; AXES]>,
    /// Set the transients of the gyroscopes' biases
    ///
    /// For G1, G2, G3 [deg/h per V or degC]
    #[arg(long, value_name = "T1,T2,T3", allow_hyphen_values = true, value_parser = numbers::<AXES>)]
    gyroscope_transient: Option<[f64; AXES]>,
    /// Add a play that causes hysteresis
    ///
    /// W is the half-width of the play [V or degC]: its position follows the head temperature within W. Can be
    /// repeated.
    #[arg(long, value_name = "W", value_parser = positive)]
    play: Vec<f64>,
    /// Set the play's effect on accelerometers
    ///
    /// The preceding --play adds this to the biases of A1, A2, A3, per unit of temperature by which it leads its head
    /// [1e-6 g0 per V or degC]
    #[arg(long, value_name = "H1,H2,H3", allow_hyphen_values = true, value_parser = numbers::<AXES>)]
    hysteresis: Vec<[f64; AXES]>,
    /// Set the play's effect on gyroscopes
    ///
    /// The preceding --play adds this to the biases of G1, G2, G3 [deg/h per V or degC]
    #[arg(long, value_name = "H1,H2,H3", allow_hyphen_values = true, value_parser = numbers::<AXES>)]
    gyroscope_hysteresis: Vec<[f64; AXES]>,
}

impl MemoryOptions {
    /// Sets time constant and transients of `content`, if they are given.
    pub(super) fn apply(&self, content: &mut Content) -> Result<(), Failure> {
        if let Some(transients) = self.transient {
            for (axis, transient) in content.axes.iter_mut().zip(transients) {
                axis.transient = transient * (1e-6 / axis.bias_unit.factor());
            }
        }
        if let Some(transients) = self.gyroscope_transient {
            let Some(gyroscopes) = &mut content.gyroscopes else {
                return Err(Failure::new(Exit::Usage, format!("--gyroscope-transient: {ONLY_GYROSCOPES}")));
            };
            for (axis, transient) in gyroscopes.axes.iter_mut().zip(transients) {
                axis.transient = transient / axis.bias_unit.factor();
            }
        }
        content.lag_s = self.lag.or(content.lag_s);
        let given = self.transient.is_some() || self.gyroscope_transient.is_some();
        if given && content.lag_s.is_none() {
            return Err(Failure::new(
                Exit::Usage,
                "a transient needs a lag; give --lag too, the time constant of the sensing elements",
            ));
        }
        let gyroscopes = content.gyroscopes.iter().flat_map(|gyroscopes| &gyroscopes.axes);
        let has_transient = content.axes.iter().chain(gyroscopes).any(|axis| axis.transient != 0.0);
        if self.lag.is_some() && !given && !has_transient {
            return Err(Failure::new(
                Exit::Usage,
                "--lag: no bias has a transient that would show it; give --transient too",
            ));
        }
        content.format = content.format.max(content.least_format());
        Ok(())
    }

    /// The plays.
    pub(super) fn plays(&self, gyroscopes: bool) -> Result<Vec<Play>, Failure> {
        if !gyroscopes && !self.gyroscope_hysteresis.is_empty() {
            return Err(Failure::new(Exit::Usage, format!("--gyroscope-hysteresis: {ONLY_GYROSCOPES}")));
        }
        let count = self.play.len();
        let fits = |given: &[[f64; AXES]]| given.is_empty() || given.len() == count;
        let any = !self.hysteresis.is_empty() || !self.gyroscope_hysteresis.is_empty();
        if !fits(&self.hysteresis) || !fits(&self.gyroscope_hysteresis) || (count > 0 && !any) {
            return Err(Failure::new(
                Exit::Usage,
                "give each --play its --hysteresis, or --gyroscope-hysteresis, or both: as many of one as of the other, in the same order",
            ));
        }
        let nth = |given: &[[f64; AXES]], index: usize| given.get(index).copied().unwrap_or_default();
        let play = |(index, half_width): (usize, &f64)| Play {
            half_width: *half_width,
            accelerometers: nth(&self.hysteresis, index).map(|h| h / 1e6),
            gyroscopes: nth(&self.gyroscope_hysteresis, index),
        };
        Ok(self.play.iter().enumerate().map(play).collect())
    }
}
