//! Options of a calibration.

use crate::alignment::AlignmentChoice;
use crate::error::CalibrationError;
use crate::transients::LagChoice;
use isotherm_campaign::Campaign;
use isotherm_support::finding::Admission;

/// Highest order that is considered if none is requested.
pub(crate) const MAX_AUTO_ORDER: usize = 6;

/// How the coefficients are estimated.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Method {
    /// All dwells at once, each with its own temperature.
    #[default]
    OneStage,
    /// Each set point first, then polynomials through their values: the paper's method.
    TwoStage,
}

/// Options of a calibration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationOptions {
    /// How the coefficients are estimated.
    pub method: Method,
    /// The order of every polynomial; chosen from the data if `None`.
    pub order: Option<usize>,
    /// Whether an alignment matrix is written into the table.
    pub alignment: AlignmentChoice,
    /// Dwells to leave out: set point \[degC\] and number of the position.
    pub exclude: Vec<(f64, u32)>,
    /// Names of faults that are only warnings; see [`name`](isotherm_support::finding::name).
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
    /// How the time constant of the lag is found, from ramps.
    pub lag: LagChoice,
    /// Time constant of the table in force \[s\]: it is kept where it lies within the interval that the ramps show.
    pub predecessor_lag_s: Option<f64>,
    /// Whether the table that only ramps begin with has errors of its bias curves in its provenance.
    pub curves_have_errors: bool,
}

impl CalibrationOptions {
    /// Which findings they accept.
    pub(crate) fn admission(&self) -> Admission<'_> {
        Admission { accept: &self.accept, strict: self.strict }
    }
}

impl Method {
    /// Every method with its name.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::OneStage, "one-stage"), (Self::TwoStage, "two-stage")];

    /// Its name in options and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::OneStage => "one-stage",
            Self::TwoStage => "two-stage",
        }
    }
}

/// # Errors
/// If an option is for ramps and there are none, or for positions and there are only ramps.
pub(crate) fn refuse_options(campaign: &Campaign, options: &CalibrationOptions) -> Result<(), CalibrationError> {
    let message = if campaign.ramps.is_empty() && options.lag != LagChoice::Search {
        "a time constant of the lag is for ramps, and the campaign file has none; give [[ramp]], or leave the time constant out"
    } else if campaign.has_ramps_alone()
        && (options.order.is_some()
            || options.method != Method::default()
            || options.alignment != AlignmentChoice::IfNeeded
            || !options.exclude.is_empty())
    {
        "order, method, alignment and exclude are for positions, and the campaign file has only ramps; leave them out"
    } else {
        return Ok(());
    };
    Err(CalibrationError::Options(message.to_owned()))
}
