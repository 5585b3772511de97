//! Options of a calibration by gravity's length.

use isotherm_support::finding::Admission;

/// One scale factor for both channels of an axis, or two.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum ScaleFactorChoice {
    /// One, unless two are significantly better and the attitudes allow them.
    #[default]
    Auto,
    /// K- = -K+.
    Single,
    /// K+ and K-, each a curve of its own.
    Split,
}

impl ScaleFactorChoice {
    /// Every choice with its name.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Auto, "auto"), (Self::Single, "single"), (Self::Split, "split")];
}

/// Options of a calibration without a turntable.
#[derive(Clone, Debug, PartialEq)]
pub struct TumbleOptions {
    /// Length of a window of the search for static poses \[s\]; `None` for that of
    /// [`find_static_poses`](isotherm_campaign::find_static_poses).
    pub window_s: Option<f64>,
    /// The order of every polynomial; chosen from the data if `None`.
    pub order: Option<usize>,
    /// One scale factor or two.
    pub scale_factor: ScaleFactorChoice,
    /// Whether misalignments are estimated.
    pub misalignment: bool,
    /// Numbers of static poses to leave out, from 1.
    pub exclude: Vec<usize>,
    /// Where a table of order 0 is valid, in the temperature's unit; the measured range if `None`.
    pub temperature_range: Option<[f64; 2]>,
    /// Names of faults that are only warnings; see [`name`](isotherm_support::finding::name).
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
}

impl Default for TumbleOptions {
    fn default() -> Self {
        Self {
            window_s: None,
            order: None,
            scale_factor: ScaleFactorChoice::Auto,
            misalignment: true,
            exclude: Vec::new(),
            temperature_range: None,
            accept: Vec::new(),
            strict: false,
        }
    }
}

impl TumbleOptions {
    /// Which findings they accept.
    pub(super) fn admission(&self) -> Admission<'_> {
        Admission { accept: &self.accept, strict: self.strict }
    }
}
