//! What the ramps of a campaign show about lag and transients.

use super::options::{CurveSource, TransientOptions};
use crate::sensor::TriadUnits;
use crate::table::{axis_mut, set_bias};
use isotherm_recording::Losses;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::Content;
use isotherm_shared::units::SensorKind;
use isotherm_statistics::{LoopPoint, SweepBand};
use isotherm_support::finding::Finding;

/// What the ramps show.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum TransientVerdict {
    /// A lag: at least one bias gets a transient.
    Lag,
    /// The recordings do not show whether heating and cooling differ by a lag.
    Undetermined,
    /// Hysteresis that is not a lag.
    Hysteresis,
    /// Neither a lag nor hysteresis predicts better than the static curve.
    None,
    /// At least one bias gets a transient, at a time constant that the user gave: the ramps need not show it.
    Given,
}

impl TransientVerdict {
    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lag => "lag",
            Self::Undetermined => "undetermined",
            Self::Hysteresis => "hysteresis",
            Self::None => "none",
            Self::Given => "given",
        }
    }
}

/// The time constant of the IMU.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeConstantEstimate {
    /// Value \[s\].
    pub value_s: f64,
    /// 95 % interval \[s\]; both ends are the value if it was given.
    pub interval_s: [f64; 2],
    /// Whether the user gave it.
    pub given: bool,
    /// Whether it is that of the table in force, which lies within the interval.
    pub kept: bool,
    /// Whether the search ended at an end of its grid.
    pub at_end: bool,
    /// The search: time constant \[s\] and objective, the sum over the biases of n log(SSE/n), which is least at the
    /// best fit.
    pub search: Vec<(f64, f64)>,
}

/// Rms about zero of sweeps that were left out, in the bias's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Of the static curve.
    pub static_curve: f64,
    /// Of static curve and hysteresis.
    pub hysteresis: f64,
    /// Of static curve, lag and hysteresis.
    pub lag_and_hysteresis: f64,
    /// Of the same, with the hysteresis then left out: what a table can have.
    pub written: f64,
}

/// A condition for a transient to be written, with its figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Short name: `predicts`, `lag-not-hysteresis`, `significant`, `matters`; of the time constant `both-directions`,
    /// `inside-search`, `interval`.
    pub name: &'static str,
    /// The figure.
    pub figure: f64,
    /// What it must be below or above.
    pub limit: f64,
    /// Whether the figure must be above the limit, not below it.
    pub above: bool,
    /// Whether it is met.
    pub met: bool,
    /// Whether it decides; with a time constant that was given some only warn.
    pub decides: bool,
}

/// The transient of one bias.
#[derive(Clone, Debug)]
pub struct BiasTransient {
    /// Accelerometer or gyroscope.
    pub kind: SensorKind,
    /// 0 to 2.
    pub axis: usize,
    /// What is written: the transient per unit of temperature \[g0 or deg/h\]; 0 if it is not written.
    pub transient: f64,
    /// The estimate, written or not \[g0 or deg/h per unit of temperature\].
    pub estimate: f64,
    /// Its standard error, with that of the time constant in it.
    pub standard_error: f64,
    /// Its standard error at the time constant: of whether there is a transient.
    pub error_at_time_constant: f64,
    /// Prediction error on the sweeps left out \[g0 or deg/h\]; `None` if no sweep can be left out.
    pub prediction: Option<Prediction>,
    /// The conditions.
    pub conditions: Vec<Condition>,
    /// Residual of the static curve, block by block \[g0 or deg/h\].
    pub before: Vec<LoopPoint>,
    /// Residual of static curve and transient as estimated, block by block \[g0 or deg/h\].
    pub after: Vec<LoopPoint>,
    /// Bias curve of the ramps \[g0 or deg/h\], shifted to equal the table's at mid range.
    pub curve: Polynomial,
    /// The band between the sweeps with the transient that is written: half of it is the error of the curve \[g0 or
    /// deg/h\]. `None`, not known, if no recording heats and cools over half of the range.
    pub curve_error: Option<SweepBand>,
    /// Largest specific force that the axis carries in a recording \[g0\]; the converter could make its transient
    /// above 0.1. 0 for gyroscopes.
    pub carried_g0: f64,
}

/// The result of [`fit`](super::fit).
#[derive(Clone, Debug)]
pub struct Transients {
    /// The options.
    pub options: TransientOptions,
    /// What the ramps show.
    pub verdict: TransientVerdict,
    /// The verdict and its reasons in sentences.
    pub words: Vec<String>,
    /// The time constant, of the table if a bias has a transient.
    pub time_constant: TimeConstantEstimate,
    /// Conditions of the time constant, for all biases.
    pub conditions: Vec<Condition>,
    /// A1, A2, A3, and G1, G2, G3 where table and recordings have gyroscopes.
    pub biases: Vec<BiasTransient>,
    /// Warnings: a carried specific force, conditions that a given time constant did not meet.
    pub warnings: Vec<String>,
    /// What is wrong with sweeps: rows that are missing, a step, another unit, sweeps that differ by more than a lag
    /// explains.
    pub findings: Vec<Finding>,
    /// Rows that are missing within the ramps by their sequences, and steps of time.
    pub losses: Losses,
}

impl BiasTransient {
    /// Name of the sensor.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.kind.names()[self.axis]
    }
}

impl Transients {
    /// The errors of the curves in words, half of the bands between sweeps, by bias.
    #[must_use]
    pub fn curve_errors(&self) -> String {
        let error = |bias: &BiasTransient| match &bias.curve_error {
            Some(band) => format!("{} {}", bias.name(), TriadUnits::of(bias.kind).bias_text(band.half_width)),
            None => format!("{} not known", bias.name()),
        };
        let errors: Vec<_> = self.biases.iter().map(error).collect();
        if self.biases.iter().all(|bias| bias.curve_error.is_none()) {
            return "the errors of the curves are not known: no ramp heats and cools over half of the range".to_owned();
        }
        format!("errors of the curves, half of the band between sweeps: {}", errors.join(", "))
    }

    /// Writes what was found into the content of a table: time constant and transients, and the curves of
    /// [`CurveSource::Ramps`].
    pub fn apply(&self, content: &mut Content) {
        let lag = self.biases.iter().any(|bias| bias.transient != 0.0);
        content.lag_s = lag.then_some(self.time_constant.value_s);
        for bias in &self.biases {
            let axis = axis_mut(content, bias.kind, bias.axis);
            axis.transient = bias.transient / axis.bias_unit.factor();
            if self.options.curves == CurveSource::Ramps {
                set_bias(axis, &bias.curve);
            }
        }
        content.format = content.least_format();
    }
}
