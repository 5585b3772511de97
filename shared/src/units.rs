//! Types for quantities that are all `f64`, so that the compiler finds a swap, and what differs between the two kinds
//! of sensor.

use crate::wire::AXES;
use serde::{Deserialize, Serialize};

/// Bias of a sensor, in the base unit of its kind: g0 or deg/h.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias(pub f64);

/// Scale factor of the positive channel, K+ > 0, in the unit of its kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositiveScaleFactor(pub f64);

/// Scale factor of the negative channel, K- < 0, in the unit of its kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NegativeScaleFactor(pub f64);

/// The labels of temperature that is a temperature in degrees Celsius.
pub const CELSIUS: [&str; 3] = ["degC", "\u{b0}C", "C"];

/// One arc second \[rad\]: pi / 648000 as the nearest double.
pub const ARCSEC: f64 = core::f64::consts::PI / 648_000.0;

/// The kind of a sensor, and so of a triad.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub enum SensorKind {
    /// A1, A2, A3: specific force. The base unit of the bias is the table's 1 g0.
    Accelerometer,
    /// G1, G2, G3: inertial rate. The base unit of the bias is deg/h, which is arcsec/s.
    Gyroscope,
}

impl SensorKind {
    /// Names of the triad's sensors, in order.
    #[must_use]
    pub const fn names(self) -> [&'static str; AXES] {
        match self {
            Self::Accelerometer => ["A1", "A2", "A3"],
            Self::Gyroscope => ["G1", "G2", "G3"],
        }
    }

    /// Every unit of a bias with its name in table files.
    #[must_use]
    pub const fn bias_units(self) -> &'static [(BiasUnit, &'static str)] {
        match self {
            Self::Accelerometer => &[(BiasUnit::G0, "g0"), (BiasUnit::MilliG0, "mg0"), (BiasUnit::MicroG0, "ug0")],
            Self::Gyroscope => &[(BiasUnit::DegreePerHour, "deg/h")],
        }
    }

    /// The base unit of a bias.
    #[must_use]
    pub const fn base_unit(self) -> &'static str {
        match self {
            Self::Accelerometer => "g0",
            Self::Gyroscope => "deg/h",
        }
    }

    /// The unit of both scale factors.
    #[must_use]
    pub const fn scale_factor_unit(self) -> &'static str {
        match self {
            Self::Accelerometer => "pulse/(s*g0)",
            Self::Gyroscope => "pulse/arcsec",
        }
    }

    /// Largest absolute value of a bias within its range, in the base unit.
    #[must_use]
    pub const fn max_bias(self) -> f64 {
        match self {
            Self::Accelerometer => 1.0,
            Self::Gyroscope => 36_000.0,
        }
    }

    /// Smallest absolute value of a scale factor within its range.
    #[must_use]
    pub const fn min_scale_factor(self) -> f64 {
        match self {
            Self::Accelerometer => 1.0,
            Self::Gyroscope => 1e-6,
        }
    }
}

/// The unit in which a table gives the bias coefficients.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum BiasUnit {
    /// The table's value of 1 g0.
    G0,
    /// 1e-3 g0.
    MilliG0,
    /// 1e-6 g0.
    MicroG0,
    /// 1 deg/h, of a gyroscope.
    DegreePerHour,
}

impl BiasUnit {
    /// The factor from this unit to the base unit: g0 or deg/h.
    ///
    /// ```
    /// use isotherm_shared::units::{BiasUnit, SensorKind};
    ///
    /// assert_eq!(793.55 * BiasUnit::MicroG0.factor(), 793.55e-6); // g0
    /// assert_eq!(SensorKind::Gyroscope.base_unit(), "deg/h");
    /// ```
    #[must_use]
    pub const fn factor(self) -> f64 {
        match self {
            Self::G0 | Self::DegreePerHour => 1.0,
            Self::MilliG0 => 1e-3,
            Self::MicroG0 => 1e-6,
        }
    }

    /// The name in table files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::G0 => "g0",
            Self::MilliG0 => "mg0",
            Self::MicroG0 => "ug0",
            Self::DegreePerHour => "deg/h",
        }
    }
}
