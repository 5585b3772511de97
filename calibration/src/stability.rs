//! How stable the output is over temperature, without and with compensation: the paper's table 4 and figure 6.
//!
//! # Definition
//! The paper prints no definition; this one is ours. The IMU is held still at a stated attitude while the temperature runs
//! or steps through its range. The output is averaged over windows (10 s), and the specific force of the attitude is
//! subtracted, in g0. Of these values each accelerometer has a standard deviation (about the mean) and an rms (about zero),
//! which also shows a constant error.
//!
//! - **before**: with the coefficients frozen at the run's mid temperature,
//! - **after**: with the full model,
//! - **factor**: standard deviation before over after.
//!
//! If no attitude is stated, the median of the compensated output is used as the specific force. A constant error then does
//! not show.
//!
//! # The modulus
//! This check needs no turntable: at rest, at any attitude, the vector of the three outputs must have the length of local
//! gravity. Without an alignment matrix, misalignments appear in it fully (3e-4 rad: up to 3e-4 g0). With one, only errors
//! of bias and scale factor remain.
//!
//! Over 400 lines: the figures, the collector that computes them and their messages are one definition.

use core::fmt;
use isotherm_shared::compensate::compensate;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable};
use isotherm_shared::wire::{AXES, Flags, RawSample};

/// A window counts for the stability if every axis is within this of the specific force of the attitude \[g0\].
const ATTITUDE_TOLERANCE: f64 = 5e-3;
/// A window was still if it differs from its neighbours by less than this \[g0\].
const STILL_TOLERANCE: f64 = 1e-3;
/// Largest difference between the length of the output at rest and gravity \[g0\].
const GRAVITY_TOLERANCE: f64 = 0.02;
/// Fewest windows for a standard deviation.
const MIN_WINDOWS: usize = 3;

/// Conditions of the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    /// Direction of the specific force along A1, A2, A3, a unit vector; unknown if `None`.
    pub attitude: Option<[f64; AXES]>,
    /// Local gravity \[m/s2\].
    pub gravity_local: f64,
}

impl Setup {
    /// `attitude` is a direction of any length. Without `gravity_local` \[m/s2\], local gravity is the table's gravity.
    #[must_use]
    pub fn new(attitude: Option<[f64; AXES]>, gravity_local: Option<f64>, table: &CoefficientTable) -> Self {
        let attitude = attitude.map(|direction| {
            let length = direction.iter().map(|f| f * f).sum::<f64>().sqrt();
            direction.map(|f| f / length)
        });
        Self { attitude, gravity_local: gravity_local.unwrap_or(table.content().gravity) }
    }
}

/// Means over one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Middle of the window, since the begin of the recording \[s\].
    pub time_s: f64,
    /// Sum of its intervals \[s\].
    pub seconds: f64,
    /// Output with the coefficients frozen at mid temperature \[g0\].
    pub before: [f64; AXES],
    /// Output of the full model \[g0\]; NaN where the table rejects.
    pub after: [f64; AXES],
    /// Mean telemetry of the heads.
    pub head: [f64; AXES],
    /// Mean telemetry of the boards.
    pub board: [f64; AXES],
    /// Whether a sample had any flag other than stale telemetry.
    pub flagged: bool,
    /// Whether the window counts for the stability: it is at the attitude.
    pub counts: bool,
    /// Whether the IMU was still, at any attitude.
    pub still: bool,
}

/// One accelerometer's stability \[g0\].
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// |output| minus local gravity \[g0\], over the windows in which the IMU was still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modulus {
    /// Number of windows.
    pub windows: usize,
    /// Mean.
    pub mean: f64,
    /// Rms about zero.
    pub rms: f64,
    /// Largest absolute value.
    pub worst: f64,
}

/// The stability of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// All windows, in order.
    pub windows: Vec<Window>,
    /// Specific force \[g0\] that was subtracted from the outputs.
    pub specific_force: [f64; AXES],
    /// Whether the attitude was stated; otherwise the specific force is the median of the outputs.
    pub stated: bool,
    /// The figures, by axis.
    pub axes: [AxisStability; AXES],
    /// The modulus; none if the IMU was never still.
    pub modulus: Option<Modulus>,
    /// Local gravity \[g0\].
    pub gravity: f64,
    /// Smallest step of the telemetry of head and board, by axis; none if it never changes.
    pub resolution: [[Option<f64>; 2]; AXES],
    /// Number of samples without a valid interval; they have no velocity.
    pub left_out: u64,
    /// Telemetry at which the coefficients are frozen: head and board, by axis.
    pub middle: [[f64; 2]; AXES],
}

impl Stability {
    /// A warning if the length of the specific force is far from gravity.
    #[must_use]
    pub fn gravity_mismatch(&self) -> Option<String> {
        let length = self.specific_force.iter().map(|f| f * f).sum::<f64>().sqrt();
        ((length - self.gravity).abs() > GRAVITY_TOLERANCE).then(|| {
            format!(
                "the output is {length:.4} g0 long, gravity is {:.4}: not at rest, a dead converter, or the table of another IMU",
                self.gravity
            )
        })
    }

    /// Checks that the factor of every axis is at least `factor`.
    ///
    /// # Errors
    /// The axes with a smaller factor.
    pub fn require(&self, factor: f64) -> Result<(), String> {
        let axes = AXIS_NAMES.iter().zip(&self.axes);
        let short = axes.filter(|(_, axis)| axis.factor().is_nan() || axis.factor() < factor);
        let short: Vec<_> = short.map(|(name, axis)| format!("{name} {:.2}", axis.factor())).collect();
        if short.is_empty() {
            return Ok(());
        }
        let axes = short.join(", ");
        Err(format!("stability: {axes} times better, {factor} are required; calibrate anew, or look at the report"))
    }
}

/// Why the stability cannot be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StabilityError {
    /// Too few windows.
    #[error(
        "{windows} windows of {window_s} s; at least {MIN_WINDOWS} are needed: record longer, or take a shorter --window"
    )]
    TooShort {
        /// Complete windows.
        windows: usize,
        /// Length of a window \[s\].
        window_s: f64,
    },
    /// The output of an axis is not a number in any window.
    #[error(
        "the output of {axis} is not a number: its telemetry is, or the table rejects it; look at a{index}_head and a{index}_board"
    )]
    NotANumber {
        /// A1, A2 or A3.
        axis: &'static str,
        /// 1, 2 or 3.
        index: usize,
    },
    /// Too few windows are at the attitude.
    #[error(
        "only {counted} of {windows} windows are within {ATTITUDE_TOLERANCE} g0 of the specific force {force}; hold the IMU still, and state its \
         attitude with --attitude"
    )]
    OffAttitude {
        /// Windows at the attitude.
        counted: usize,
        /// All windows.
        windows: usize,
        /// The specific force of the attitude.
        force: Force,
    },
}

/// A specific force \[g0\], displayed with its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force(pub [f64; AXES]);

impl fmt::Display for Force {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a1, a2, a3] = self.0;
        write!(f, "({a1:.4}, {a2:.4}, {a3:.4}) g0")
    }
}

/// Sums over the samples of one window.
#[derive(Clone, Copy, Debug, Default)]
struct WindowSums {
    begin_s: f64,
    end_s: f64,
    seconds: f64,
    positive: [f64; AXES],
    negative: [f64; AXES],
    head: [f64; AXES],
    board: [f64; AXES],
    velocity: [f64; AXES],
    flagged: bool,
}

/// Sums samples into windows; memory does not grow with the sampling rate.
#[derive(Clone, Debug)]
pub struct Collector<'a> {
    table: &'a CoefficientTable,
    window_s: f64,
    begin_ns: Option<u64>,
    open: WindowSums,
    windows: Vec<WindowSums>,
    telemetry: [[TelemetryStep; 2]; AXES],
    left_out: u64,
}

/// Finds the smallest step of one telemetry signal.
#[derive(Clone, Copy, Debug)]
struct TelemetryStep {
    last: f64,
    step: f64,
}

impl TelemetryStep {
    fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        let step = (value - self.last).abs();
        // A smaller step is the rounding of decimals.
        if step > 1e-9 * value.abs() {
            self.step = self.step.min(step);
        }
        self.last = value;
    }
}

/// Middle of the range of the windows' mean telemetry: head and board, by axis. Flagged windows are used only if all are
/// flagged, because one invalid reading would shift the middle.
fn middle(windows: &[WindowSums]) -> [[f64; 2]; AXES] {
    let good = windows.iter().any(|window| !window.flagged);
    let used = || windows.iter().filter(move |window| !(good && window.flagged));
    let of = |telemetry: &dyn Fn(&WindowSums) -> f64| {
        let (low, high) = used()
            .map(|window| telemetry(window) / window.seconds)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), u| (low.min(u), high.max(u)));
        0.5 * (low + high)
    };
    [0, 1, 2].map(|axis| [of(&|window| window.head[axis]), of(&|window| window.board[axis])])
}

impl<'a> Collector<'a> {
    /// A collector for windows of `window_s` seconds.
    #[must_use]
    pub fn new(table: &'a CoefficientTable, window_s: f64) -> Self {
        let telemetry = TelemetryStep { last: f64::NAN, step: f64::INFINITY };
        let telemetry = [[telemetry; 2]; 3];
        Self {
            table,
            window_s,
            begin_ns: None,
            open: WindowSums::default(),
            windows: Vec::new(),
            telemetry,
            left_out: 0,
        }
    }

    /// Adds the next sample. A sample with an invalid interval has no velocity and is left out.
    pub fn add(&mut self, raw: &RawSample) {
        let compensation = compensate(self.table, raw);
        if compensation.flags.intersects(Flags::INTERVAL) {
            self.left_out += 1;
            return;
        }
        let seconds = raw.interval_ns as f64 / 1e9;
        let begin_ns = *self.begin_ns.get_or_insert(raw.timestamp_ns.saturating_sub(raw.interval_ns));
        let end_s = raw.timestamp_ns.saturating_sub(begin_ns) as f64 / 1e9;
        let open = &mut self.open;
        if open.seconds == 0.0 {
            open.begin_s = end_s - seconds;
        }
        open.end_s = end_s;
        open.seconds += seconds;
        open.flagged |= compensation.flags.0 & !Flags::TELEMETRY_STALE.0 != 0;
        for axis in 0..AXES {
            open.positive[axis] += f64::from(raw.positive_pulses[axis]);
            open.negative[axis] += f64::from(raw.negative_pulses[axis]);
            open.head[axis] += raw.head_temperature[axis] * seconds;
            open.board[axis] += raw.board_temperature[axis] * seconds;
            open.velocity[axis] += compensation.velocity_increment[axis];
            self.telemetry[axis][0].add(raw.head_temperature[axis]);
            self.telemetry[axis][1].add(raw.board_temperature[axis]);
        }
        // The window ends with the sample that brings it nearest to its nominal length.
        if open.seconds + 0.5 * seconds >= self.window_s {
            self.windows.push(core::mem::take(open));
        }
    }

    /// The stability over all complete windows.
    ///
    /// # Errors
    /// If there are too few windows, too few at the attitude, or an axis whose output is not a number.
    pub fn finish(self, setup: &Setup) -> Result<Stability, StabilityError> {
        if self.windows.len() < MIN_WINDOWS {
            return Err(StabilityError::TooShort { windows: self.windows.len(), window_s: self.window_s });
        }
        let middle = middle(&self.windows);
        let frozen = FrozenCoefficients::new(self.table, middle);
        let mut windows: Vec<_> = self.windows.iter().map(|sums| window(sums, &frozen, self.table)).collect();
        let gravity = setup.gravity_local / self.table.content().gravity;
        let median = |axis: usize| crate::diagnostics::median(windows.iter().map(|window| window.after[axis]));
        let specific_force = match setup.attitude {
            Some(direction) => direction.map(|f| f * gravity),
            None => [median(0), median(1), median(2)],
        };
        if let Some(axis) =
            (0..AXES).find(|&axis| median(axis).is_nan() || windows.iter().all(|w| w.after[axis].is_nan()))
        {
            return Err(StabilityError::NotANumber { axis: AXIS_NAMES[axis], index: axis + 1 });
        }
        mark(&mut windows, specific_force);
        let counted: Vec<_> = windows.iter().filter(|window| window.counts).collect();
        if counted.len() < MIN_WINDOWS {
            let (counted, windows) = (counted.len(), windows.len());
            return Err(StabilityError::OffAttitude { counted, windows, force: Force(specific_force) });
        }
        let axes = [0, 1, 2].map(|axis| {
            let errors = |of: fn(&Window) -> &[f64; AXES]| -> Vec<f64> {
                counted.iter().map(|window| of(window)[axis] - specific_force[axis]).collect()
            };
            let (before, after) = (errors(|window| &window.before), errors(|window| &window.after));
            AxisStability {
                sd_before: sd(&before),
                rms_before: rms(&before),
                sd_after: sd(&after),
                rms_after: rms(&after),
            }
        });
        let resolution = self.telemetry.map(|parts| parts.map(|t| Some(t.step).filter(|step| step.is_finite())));
        let modulus = modulus(&windows, gravity);
        Ok(Stability {
            windows,
            specific_force,
            stated: setup.attitude.is_some(),
            axes,
            modulus,
            gravity,
            resolution,
            left_out: self.left_out,
            middle,
        })
    }
}

/// Bias \[g0\], K+ and K- of each axis at mid temperature.
struct FrozenCoefficients([[f64; 3]; AXES]);

impl FrozenCoefficients {
    fn new(table: &CoefficientTable, middle: [[f64; 2]; AXES]) -> Self {
        let clamped = |polynomial: &Polynomial, telemetry: f64| polynomial.at(polynomial.clamp(telemetry));
        Self([0, 1, 2].map(|index| {
            let (axis, [head, board]) = (&table.content().axes[index], middle[index]);
            [
                clamped(&axis.bias, head) * axis.bias_unit.in_g0(),
                clamped(&axis.positive_scale_factor, board),
                clamped(&axis.negative_scale_factor, board),
            ]
        }))
    }
}

fn window(sums: &WindowSums, frozen: &FrozenCoefficients, table: &CoefficientTable) -> Window {
    let content = table.content();
    let mean = |values: [f64; AXES]| values.map(|value| value / sums.seconds);
    let mut before = [0, 1, 2].map(|axis| {
        let [bias, k_plus, k_minus] = frozen.0[axis];
        (sums.positive[axis] / k_plus + sums.negative[axis] / k_minus) / sums.seconds - bias
    });
    if let Some(matrix) = &content.alignment {
        before = (matrix * nalgebra::Vector3::from(before)).into();
    }
    Window {
        time_s: 0.5 * (sums.begin_s + sums.end_s),
        seconds: sums.seconds,
        before,
        after: mean(sums.velocity).map(|rate| rate / content.gravity),
        head: mean(sums.head),
        board: mean(sums.board),
        flagged: sums.flagged,
        counts: false,
        still: false,
    }
}

/// Sets `counts` and `still` of every window.
fn mark(windows: &mut [Window], force: [f64; AXES]) {
    let distance = |a: &[f64; AXES], b: &[f64; AXES]| {
        // `f64::max` ignores NaN. The distance must be NaN if one axis is: NaN is below no tolerance.
        let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, |most: f64, d| if most.is_nan() || d.is_nan() { f64::NAN } else { most.max(d) })
    };
    let after: Vec<_> = windows.iter().map(|window| window.after).collect();
    for (index, window) in windows.iter_mut().enumerate() {
        window.counts = distance(&window.after, &force) < ATTITUDE_TOLERANCE;
        let neighbours = [index.checked_sub(1), Some(index + 1)];
        let mut near = neighbours.iter().flatten().filter_map(|&other| after.get(other));
        window.still = near.all(|other| distance(&window.after, other) < STILL_TOLERANCE);
    }
}

fn modulus(windows: &[Window], gravity: f64) -> Option<Modulus> {
    let length = |window: &Window| window.after.iter().map(|a| a * a).sum::<f64>().sqrt();
    let off: Vec<f64> = windows.iter().filter(|window| window.still).map(|window| length(window) - gravity).collect();
    if off.is_empty() {
        return None;
    }
    Some(Modulus {
        windows: off.len(),
        mean: off.iter().sum::<f64>() / off.len() as f64,
        rms: rms(&off),
        worst: off.iter().fold(0.0, |most: f64, value| most.max(value.abs())),
    })
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn sd(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}

#[cfg(test)]
mod tests;
