//! What a run shows of the output of a table.

use super::figures::MAX_UNJUDGED;
use crate::evidence::own_recording;
use crate::stability::error::{OTHER_ATTITUDE, count_of, wrong_times};
use crate::stability::stillness::unjudged;
use crate::verdict::{MIN_GROUP, Verdict};
use crate::{AxisStability, Coverage, Force, GyroscopeStability, LeftOut, LocalGravity, Loops, Window};
use isotherm_recording::{Losses, TimeFault};
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};
use serde::{Deserialize, Serialize};

/// An axis that is on average over this off the stated specific force gives a warning \[g0\].
pub(super) const ATTITUDE_WARNING: f64 = 5e-3;

/// Largest difference between the length of the output and gravity, in windows that do not count \[g0\].
pub(super) const GRAVITY_TOLERANCE: f64 = 0.02;

/// Fewest windows that a requirement is judged by: two groups.
pub(super) const MIN_JUDGED: usize = 2 * MIN_GROUP;

/// `interval_ns` that differs from the timestamps' steps by more than this part gives a warning.
pub(super) const CLOCK_WARNING: f64 = 200e-6;

/// The stability of a recording.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Stability {
    /// All windows, in order.
    pub windows: Vec<Window>,
    /// Specific force \[g0\] that was subtracted from the outputs.
    pub specific_force: [f64; AXES],
    /// Whether the attitude was stated; otherwise the specific force is the median of the outputs.
    pub stated: bool,
    /// The figures, by axis.
    pub axes: [AxisStability; AXES],
    /// Local gravity \[g0\]; if it is unknown, the median length of the output.
    pub gravity: f64,
    /// Where local gravity comes from.
    pub gravity_source: LocalGravity,
    /// What the run allows to be claimed.
    pub verdict: Verdict,
    /// Smallest step of the temperature of head and board, by axis; none if it never changes.
    pub resolution: [[Option<f64>; 2]; AXES],
    /// Number of samples without a valid interval; they have no velocity.
    pub left_out: u64,
    /// The windows that do not count.
    pub windows_left_out: LeftOut,
    /// The loops between heating and cooling.
    pub loops: Loops,
    /// What is left out of the loops at the beginning of a session, where the lagged temperature begins soaked \[s\];
    /// `None` if nothing is.
    pub unsettled_s: Option<f64>,
    /// Temperature at which the coefficients are frozen: head and board, by axis.
    pub middle: [[f64; 2]; AXES],
    /// What of the table the run exercises.
    pub covered: Coverage,
    /// Whether a bound can be met although the run leaves a hole of more than a tenth of a curve's range; the caller
    /// says so, where the user accepts it, or where several runs are judged together.
    pub accepts_holes: bool,
    /// `interval_ns` over the timestamp's step between consecutive sequences, median of the windows; `None` without
    /// consecutive sequences.
    pub interval_ratio: Option<f64>,
    /// The gyroscopes, or why they are not judged; `None` if neither the table nor the recording has any.
    pub gyroscopes: Option<Result<GyroscopeStability, String>>,
    /// That samples are of another device than the table's, if some are.
    pub other_device: Option<Finding>,
    /// Rows that are missing by their sequences, and steps of time.
    #[serde(with = "whole")]
    pub losses: Losses,
    /// The first fault of time.
    pub time_fault: Option<TimeFault>,
    /// Whether the table was made from this recording, as its provenance says; the caller looks.
    pub made_the_table: bool,
    /// What is to be said of times and missing rows.
    pub of_time: Vec<Finding>,
}

impl Stability {
    /// The gyroscopes, if they are judged.
    #[must_use]
    pub fn judged_gyroscopes(&self) -> Option<&GyroscopeStability> {
        self.gyroscopes.as_ref()?.as_ref().ok()
    }

    /// Why nothing can be claimed of the table, if so: the figures are meaningless, or they are those of a part of the
    /// run.
    #[must_use]
    pub fn nothing_claimed(&self) -> Option<String> {
        self.gravity_mismatch().or_else(|| self.unjudged())
    }

    /// Why the table is not judged over the whole run, if too many windows are left out.
    #[must_use]
    pub fn unjudged(&self) -> Option<String> {
        unjudged(&self.windows_left_out, "at the attitude")
    }

    /// How many windows of each triad are judged, and why the others are not; of gyroscopes only if it is not the same.
    #[must_use]
    pub fn judged_windows(&self) -> String {
        let of_gyroscopes = self.judged_gyroscopes().map(|found| &found.windows_left_out);
        let more = of_gyroscopes.filter(|left_out| left_out.count() > left_out.by_accelerometers);
        let more = more.map(|left_out| format!("; of the gyroscopes {left_out}")).unwrap_or_default();
        format!("{}{more}", self.windows_left_out)
    }

    /// What is wrong with the recording, or with the run: the cause first. Without a requirement, which says it too,
    /// also why nothing is claimed.
    #[must_use]
    pub fn findings(&self, required: bool) -> Vec<Finding> {
        let own = own_recording(self.made_the_table);
        let mut found: Vec<Finding> =
            own.into_iter().chain(self.of_time.iter().cloned()).chain(self.other_device.clone()).collect();
        let mut add = |name, message: Option<String>| found.extend(message.map(|text| Finding::warning(name, text)));
        add(name::INTERVAL, self.interval_warning());
        if !required {
            let mismatch = self.gravity_mismatch();
            add(name::UNJUDGED, self.unjudged().filter(|_| mismatch.is_none()));
            add(name::NOT_GRAVITY, mismatch);
        }
        add(name::ATTITUDE_OFF, self.attitude_warning());
        found
    }

    /// A warning if the output is far off the stated attitude.
    #[must_use]
    pub fn attitude_warning(&self) -> Option<String> {
        let counted: Vec<_> = self.windows.iter().filter(|window| window.counts).collect();
        let off = [0, 1, 2].map(|axis| {
            counted.iter().map(|window| window.after[axis] - self.specific_force[axis]).sum::<f64>()
                / counted.len() as f64
        });
        (self.stated && off.iter().any(|off| off.abs() > ATTITUDE_WARNING)).then(|| {
            format!(
                "the output is on average off the stated specific force by {}: the attitude was another one, or the table is off by as much",
                Force(off)
            )
        })
    }

    /// Why every figure is meaningless, if the length of the output is far from gravity in more windows than may be
    /// left out.
    #[must_use]
    pub fn gravity_mismatch(&self) -> Option<String> {
        // The tolerance is wide enough for every place on Earth.
        let gravity = if self.gravity_source.value().is_some() { self.gravity } else { 1.0 };
        // In a window that counts it is the error that is to be judged.
        let tolerance = |window: &Window| if window.counts { OTHER_ATTITUDE } else { GRAVITY_TOLERANCE };
        let off = self.windows.iter().filter(|window| (window.length() - gravity).abs() > tolerance(window));
        let off: Vec<f64> = off.map(Window::length).collect();
        let windows = self.windows.len();
        (off.len() as f64 > MAX_UNJUDGED * windows as f64).then(|| {
            let (count, length) = (off.len(), isotherm_statistics::median(off));
            let of = if count == windows { String::new() } else { format!(" in {count} of {windows} windows") };
            format!(
                "the output is {length:.4} g0 long{of}, gravity is {gravity:.4}: {}",
                wrong_times(length / gravity).unwrap_or_else(|| {
                    "not at rest, a dead converter, wrong intervals, or the table of another IMU".to_owned()
                })
            )
        })
    }

    /// Why no requirement is judged, if there are too few windows.
    #[must_use]
    pub fn too_short(&self) -> Option<String> {
        let counted = self.windows.iter().filter(|window| window.counts).count();
        (counted < MIN_JUDGED).then(|| {
            format!(
                "No requirement is judged by a run of {}, at least {MIN_JUDGED} are needed.",
                count_of(counted, "window")
            )
        })
    }

    /// A warning if `interval_ns` is not the time from sample to sample.
    #[must_use]
    pub fn interval_warning(&self) -> Option<String> {
        let ratio = self.interval_ratio.filter(|ratio| (ratio - 1.0).abs() > CLOCK_WARNING)?;
        Some(format!(
            "interval_ns is {:.0} ppm {} than the time from sample to sample: one of them is wrong; if it is interval_ns, the output is off by as \
             much along the specific force",
            (ratio - 1.0).abs() * 1e6,
            if ratio > 1.0 { "longer" } else { "shorter" }
        ))
    }
}

/// All counts of losses. As a document they have those of sessions only where there are several; a format without names
/// must have the same fields every time.
mod whole {
    use isotherm_recording::Losses;
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    pub(super) fn serialize<S: Serializer>(losses: &Losses, serializer: S) -> Result<S::Ok, S::Error> {
        let Losses { missing, gaps, time_steps, session_changes, session_missing, session_unknown } = *losses;
        [missing, gaps, time_steps, session_changes, session_missing, session_unknown].serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Losses, D::Error> {
        let [missing, gaps, time_steps, session_changes, session_missing, session_unknown] =
            <[u64; 6]>::deserialize(deserializer)?;
        Ok(Losses { missing, gaps, time_steps, session_changes, session_missing, session_unknown })
    }
}
