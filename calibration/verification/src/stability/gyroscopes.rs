//! The gyroscopes of a recording at rest: the same figures as for the accelerometers, in deg/h.
//!
//! What a gyroscope at rest indicates is Earth's rate along it, see [`super::earth_rate`]. Where that is known it is
//! subtracted, and the constant error is judged; the standard errors of Earth's rate are part of its interval and of
//! that of the worst error. Where it is not known, the median of the output is subtracted instead, and only the
//! variation is judged.
//!
//! The table's g-sensitivity is part of the full model. It is also part of the frozen coefficients, with the frozen
//! output of the accelerometers.
//!
//! **Random walk** is the noise of a window times the root of the window's length: of white noise of the rate it does
//! not depend on that length. The pulses' rounding is part of it, and is most of it in short windows.
//!
//! Scale factors and misalignments are not judged: Earth's rate and the bias are 1e-3 of what shows them.

use super::coverage::Coverage;
use super::earth_rate::EarthRate;
use super::figures::{AxisStability, figures, median};
use super::loops::Loops;
use super::stillness::{GYROSCOPES, LeftOut, mark, unjudged};
use crate::verdict::{Errors, Estimate, errors, group_size, noise_freedom};
use crate::window::{MIN_WINDOWS, Window};
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, GYROSCOPE_NAMES};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, student_quantile_of};
use serde::{Deserialize, Serialize};

/// Why the constant error is not judged, and how to state Earth's rate, for a table that has it.
const NO_ANGLES: [&str; 2] = [
    "without the angles of the turntable only the variation of the gyroscopes can be judged: Earth's rate along them is not known",
    "give --angles OUTER,INNER, the angles in the run",
];
/// The same for a table that has not.
const NO_EARTH_RATE: [&str; 2] = [
    "without Earth's rate only the variation of the gyroscopes can be judged",
    "take a table whose provenance has earth_rate_deg_h, from a campaign with turns and angles, and give --angles OUTER,INNER",
];

/// The stability of the gyroscopes.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct GyroscopeStability {
    /// All windows, in order, as those of the accelerometers; the outputs in deg/h. A window counts if that of the
    /// accelerometers does, and if the IMU did not turn.
    pub windows: Vec<Window>,
    /// The figures, by gyroscope \[deg/h\].
    pub axes: [AxisStability; AXES],
    /// The errors, by gyroscope \[deg/h\].
    pub errors: [Errors; AXES],
    /// Angle random walk, by gyroscope \[deg/sqrt(h)\].
    pub random_walk: [Estimate; AXES],
    /// Number of groups of windows.
    pub groups: usize,
    /// Number of windows in a group.
    pub windows_in_group: usize,
    /// What was subtracted from the outputs \[deg/h\]: Earth's rate, or the median of the outputs.
    pub subtracted: [f64; AXES],
    /// Earth's rate, if it is known.
    pub earth_rate: Option<EarthRate>,
    /// Whether the table's provenance has Earth's rate.
    pub has_turntable: bool,
    /// Whether the table has an alignment matrix of the gyroscopes.
    pub aligned: bool,
    /// Temperature at which the coefficients are frozen: head and board, by gyroscope.
    pub middle: [[f64; 2]; AXES],
    /// What of the bias curves the run exercises.
    pub covered: Coverage,
    /// The windows that do not count.
    pub windows_left_out: LeftOut,
    /// The loops between heating and cooling.
    pub loops: Loops,
}

/// What is known of the place and of the table.
pub(super) struct Conditions<'a> {
    pub earth_rate: Option<EarthRate>,
    pub has_turntable: bool,
    pub axes: &'a [Axis; AXES],
    pub unit: &'a str,
    pub aligned: bool,
    pub middle: [[f64; 2]; AXES],
    /// Of each window: largest difference of the means of its parts; output of the static model, if the table has a
    /// lag; whether the lagged temperature has not forgotten yet how it began.
    pub spreads: Vec<[f64; AXES]>,
    pub static_output: Option<Vec<[f64; AXES]>>,
    pub unsettled: Vec<bool>,
}

impl GyroscopeStability {
    /// The stability over `windows`, of which those count that do for the accelerometers.
    ///
    /// # Errors
    /// Why the gyroscopes cannot be judged, in words.
    pub(super) fn of(mut windows: Vec<Window>, conditions: &Conditions<'_>) -> Result<Self, String> {
        let middle = [0, 1, 2].map(|axis| median(&windows, axis));
        if middle.iter().any(|output| output.is_nan()) {
            // With an alignment matrix one output that is not a number makes three.
            let inside = |curve: &Polynomial, u: f64| curve.range()[0] <= u && u <= curve.range()[1];
            let rejected = |axis: &usize| {
                let Axis { bias, positive_scale_factor, negative_scale_factor, .. } = &conditions.axes[*axis];
                !windows.iter().all(|window| {
                    let (head, board) = (window.head[*axis], window.board[*axis]);
                    inside(bias, head) && inside(positive_scale_factor, board) && inside(negative_scale_factor, board)
                })
            };
            let axis = (0..AXES).find(rejected).unwrap_or_default();
            let (name, index) = (GYROSCOPE_NAMES[axis], axis + 1);
            return Err(format!(
                "the output of {name} is not a number: its temperature is, or the table rejects it; look at g{index}_head and g{index}_board"
            ));
        }
        let windows_left_out = mark(&mut windows, &conditions.spreads, &GYROSCOPES, |_| true);
        let counted: Vec<&Window> = windows.iter().filter(|window| window.counts).collect();
        if counted.len() < MIN_WINDOWS {
            return Err(format!(
                "in only {} of {} windows the IMU was at the attitude and did not turn; hold it still",
                counted.len(),
                windows.len()
            ));
        }
        let middle = [0, 1, 2].map(|axis| isotherm_statistics::median(counted.iter().map(|window| window.after[axis])));
        let subtracted = conditions.earth_rate.map_or(middle, |earth| earth.rate);
        let seconds = counted.iter().map(|window| window.seconds).sum::<f64>() / counted.len() as f64;
        let values =
            |axis: usize| counted.iter().map(|window| window.after[axis] - subtracted[axis]).collect::<Vec<_>>();
        let errors = [0, 1, 2].map(|axis| {
            let found = errors(&values(axis), conditions.earth_rate.is_some());
            let of_earth =
                conditions.earth_rate.and_then(|earth| earth.interval).map_or(0.0, |interval| interval[axis]);
            let widened = |it: Estimate| Estimate { interval: libm::hypot(it.interval, of_earth), ..it };
            Errors { constant: found.constant.map(widened), worst: widened(found.worst), ..found }
        });
        let freedom = noise_freedom(counted.len());
        // The relative error of a standard deviation with so many degrees of freedom.
        let relative = student_quantile_of(CONFIDENCE, freedom) / (2.0 * freedom).sqrt();
        let random_walk = errors.map(|errors| {
            let value = errors.noise * (seconds / 3600.0).sqrt();
            Estimate { value, interval: value * relative }
        });
        let windows_in_group = group_size(counted.len());
        Ok(Self {
            axes: figures(&counted, subtracted),
            errors,
            random_walk,
            groups: counted.len() / windows_in_group,
            windows_in_group,
            subtracted,
            earth_rate: conditions.earth_rate,
            has_turntable: conditions.has_turntable,
            aligned: conditions.aligned,
            middle: conditions.middle,
            covered: Coverage::of(&windows, SensorKind::Gyroscope, conditions.axes, conditions.unit),
            loops: Loops::of(
                &windows,
                conditions.static_output.as_deref(),
                &conditions.unsettled,
                subtracted,
                conditions.axes,
            ),
            windows_left_out,
            windows,
        })
    }

    /// Why nothing can be claimed of the gyroscopes, if too many windows are left out.
    #[must_use]
    pub fn unjudged(&self) -> Option<String> {
        unjudged(&self.windows_left_out, "at rest")
    }

    /// What cannot be judged because Earth's rate is not known, and how to state it; `None` if all is judged.
    #[must_use]
    pub const fn missing(&self) -> Option<[&'static str; 2]> {
        match (self.earth_rate, self.has_turntable) {
            (Some(_), _) => None,
            (None, true) => Some(NO_ANGLES),
            (None, false) => Some(NO_EARTH_RATE),
        }
    }

    /// The gyroscope with the largest error that is judged, and that error \[deg/h\].
    #[must_use]
    pub fn largest(&self) -> (&'static str, Estimate) {
        let worst = |axis: usize| (GYROSCOPE_NAMES[axis], self.errors[axis].worst);
        [worst(1), worst(2)].into_iter().fold(worst(0), |a, b| if b.1.most() > a.1.most() { b } else { a })
    }

    /// The largest error as a sentence.
    #[must_use]
    pub fn conclusion(&self) -> String {
        if let Some(reason) = self.unjudged() {
            return format!("Nothing can be claimed of the gyroscopes: {reason}.");
        }
        let (name, worst) = self.largest();
        format!(
            "The largest error of the gyroscopes{} is that of {name}, {:.4} +- {:.4} deg/h.",
            if self.missing().is_none() { "" } else { " that could be judged" },
            worst.value,
            worst.interval
        )
    }
}
