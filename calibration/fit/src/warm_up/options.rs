//! Options of a calibration at one attitude.

use crate::transients::LagChoice;
use isotherm_autopilot::{Autopilot, Parameters};

/// Parameters that an autopilot has on board, which are judged on the rows of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct OnBoard {
    /// How they are called in results: the name of their file.
    pub name: String,
    /// The parameters of the IMU.
    pub parameters: Parameters,
}

/// Options of [`calibrate_warm_up`](crate::calibrate_warm_up).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WarmUpOptions {
    /// The order of all curves, 0 to 7; chosen by sweeps left out if `None`.
    pub order: Option<usize>,
    /// The highest order to choose, for example 3 for an autopilot's parameters.
    pub highest_order: Option<usize>,
    /// How the time constant of the lag is found.
    pub lag: LagChoice,
    /// Reference temperature, in the temperature's unit: accelerometers keep the bias of the nominal table there. Mid
    /// range if `None`.
    pub at: Option<f64>,
    /// Curves of autopilots to compare with.
    pub beside: Vec<Autopilot>,
    /// Parameters to compare with. The temperature must be in degC then.
    pub on_board: Vec<OnBoard>,
    /// Names of faults that are only warnings; see [`name`](isotherm_support::finding::name).
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
}
