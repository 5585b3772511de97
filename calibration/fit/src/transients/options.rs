//! Options of the estimate, and why there is none.

/// Residuals are shown, and sweeps judged, after this many time constants since a recording began: the start may not
/// have been soaked.
pub(super) const SOAK: f64 = 3.0;

/// How the time constant is found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LagChoice {
    /// From the ramps.
    #[default]
    Search,
    /// The user's, for example that of a sister unit \[s\].
    Given(f64),
    /// No transient is written.
    None,
}

/// What gives the curves of the biases.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum CurveSource {
    /// The table's bias curves are of a campaign: the ramps only give the transients.
    Campaign,
    /// The ramps: each curve of the table is replaced, and keeps its value at mid range.
    Ramps,
}

/// Options of [`fit`](crate::fit).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransientOptions {
    /// What gives the curves of the biases.
    pub curves: CurveSource,
    /// How the time constant is found.
    pub lag: LagChoice,
    /// Time constant of the table in force \[s\]: it is kept where it lies within the new one's interval.
    pub predecessor_s: Option<f64>,
}

/// Why nothing can be estimated from ramps.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransientsError {
    /// There is no recording.
    #[error("no ramps")]
    Empty,
    /// Three times the time constant that was given \[s\] are as long as the recordings.
    #[error(
        "the time constant of {0} s is too long for them: they last hardly more than three of it; give a shorter one, or record longer ramps"
    )]
    TooLong(f64),
    /// A recording is too short or has no change of temperature; a message with its name.
    #[error("{0}")]
    Recording(String),
}
