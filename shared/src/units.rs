//! Types for quantities that are all `f64`, so that the compiler finds a swap.

/// Bias of an accelerometer \[g0\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias(pub f64);

/// Scale factor of the positive channel, K+ > 0 \[pulse/(s*g0)\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositiveScaleFactor(pub f64);

/// Scale factor of the negative channel, K- < 0 \[pulse/(s*g0)\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NegativeScaleFactor(pub f64);

/// The unit in which a table gives the bias coefficients.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum BiasUnit {
    /// The table's value of 1 g0.
    G0,
    /// 1e-3 g0.
    MilliG0,
    /// 1e-6 g0.
    MicroG0,
}

impl BiasUnit {
    /// Every unit with its name in table files.
    pub const NAMES: [(Self, &'static str); 3] = [(Self::G0, "g0"), (Self::MilliG0, "mg0"), (Self::MicroG0, "ug0")];

    /// The factor from this unit to g0.
    #[must_use]
    pub const fn in_g0(self) -> f64 {
        match self {
            Self::G0 => 1.0,
            Self::MilliG0 => 1e-3,
            Self::MicroG0 => 1e-6,
        }
    }

    /// The name in table files: `g0`, `mg0` or `ug0`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::G0 => "g0",
            Self::MilliG0 => "mg0",
            Self::MicroG0 => "ug0",
        }
    }
}

/// The unit of every scale factor.
pub const SCALE_FACTOR_UNIT: &str = "pulse/(s*g0)";
