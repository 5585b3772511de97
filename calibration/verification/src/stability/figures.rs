//! The figures of a sensor over the windows of a run, whatever the sensor is.

use crate::window::Window;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{mean, rms};
use serde::{Deserialize, Serialize};

/// Largest part of the windows that need not be at the attitude: a reading of the temperature that is not plausible
/// spoils a window.
pub(super) const MAX_UNJUDGED: f64 = 0.01;

/// One sensor's stability, in g0 or deg/h.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct AxisStability {
    /// Standard deviation with frozen coefficients.
    pub sd_before: f64,
    /// Rms about zero with frozen coefficients.
    pub rms_before: f64,
    /// Standard deviation with the full model.
    pub sd_after: f64,
    /// Rms about zero with the full model.
    pub rms_after: f64,
}

impl AxisStability {
    /// Standard deviation before over after.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.sd_before / self.sd_after
    }
}

/// Median of the full model's output along an axis.
pub(super) fn median(windows: &[Window], axis: usize) -> f64 {
    isotherm_statistics::median(windows.iter().map(|window| window.after[axis]))
}

/// The figures of a triad over windows whose outputs should be `right`.
pub(super) fn figures(counted: &[&Window], right: [f64; AXES]) -> [AxisStability; AXES] {
    [0, 1, 2].map(|axis| {
        let errors = |of: fn(&Window) -> &[f64; AXES]| -> Vec<f64> {
            counted.iter().map(|window| of(window)[axis] - right[axis]).collect()
        };
        let (before, after) = (errors(|window| &window.before), errors(|window| &window.after));
        AxisStability { sd_before: sd(&before), rms_before: rms(&before), sd_after: sd(&after), rms_after: rms(&after) }
    })
}

fn sd(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}
