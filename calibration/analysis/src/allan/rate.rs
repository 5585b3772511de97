//! What a rate is, and its units.

/// What a rate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateKind {
    /// Net counts \[pulse/s\].
    Counts,
    /// Compensated specific force \[g0\].
    SpecificForce,
    /// Compensated angular rate \[deg/h\].
    AngularRate,
}

/// Units and names by which the noise of a rate is shown, each unit with the factor from the unit of the rate and
/// seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseUnits {
    /// Unit of the rate, which is that of Allan deviations.
    pub rate: &'static str,
    /// Units of Q, N, B, K.
    pub coefficients: [(&'static str, f64); 4],
    /// Unit of the spectral density N, with factor 1.
    pub density: &'static str,
    /// Names of Q, N, B, K.
    pub names: [&'static str; 4],
}

const QUANTISATION: &str = "quantisation noise";
const FLICKER: &str = "bias instability";

impl RateKind {
    /// The units and names that are usual for this rate.
    #[must_use]
    pub const fn units(self) -> NoiseUnits {
        match self {
            Self::Counts => NoiseUnits {
                rate: "pulse/s",
                coefficients: [("pulse", 1.0), ("pulse/sqrt(s)", 1.0), ("pulse/s", 1.0), ("pulse/(s sqrt(s))", 1.0)],
                density: "pulse/(s sqrt(Hz))",
                names: [QUANTISATION, "white noise", FLICKER, "random walk of the rate"],
            },
            Self::SpecificForce => NoiseUnits {
                rate: "g0",
                coefficients: [("g0 s", 1.0), ("g0/sqrt(Hz)", 1.0), ("g0", 1.0), ("g0/(s sqrt(Hz))", 1.0)],
                density: "g0/sqrt(Hz)",
                names: [QUANTISATION, "velocity random walk", FLICKER, "acceleration random walk"],
            },
            // A rate of 1 deg/h is 1/3600 deg a second; the root of an hour is 60 roots of a second.
            Self::AngularRate => NoiseUnits {
                rate: "deg/h",
                coefficients: [
                    ("deg", 1.0 / 3600.0),
                    ("deg/sqrt(h)", 1.0 / 60.0),
                    ("deg/h", 1.0),
                    ("deg/(h sqrt(h))", 60.0),
                ],
                density: "deg/(h sqrt(Hz))",
                names: [QUANTISATION, "angle random walk", FLICKER, "rate random walk"],
            },
        }
    }
}
