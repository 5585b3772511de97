//! What a coefficient table says, what is wrong with it, and the canonical form that its digest is of.

use super::checks::{
    NO_LAG, alignment_fault, bias_fault, g_sensitivity_fault, gravity_fault, lag_fault, max_age_fault, max_rate_fault,
    negative_scale_factor_fault, nominal_interval_fault, positive_scale_factor_fault, transient_fault,
};
use super::digest::Digest;
use crate::names::ImuId;
use crate::polynomial::Polynomial;
use crate::units::{Bias, BiasUnit, NegativeScaleFactor, PositiveScaleFactor, SensorKind};
use crate::wire::AXES;
use core::fmt;
use nalgebra::Matrix3;
use sha2::{Digest as _, Sha256};

/// Names of the accelerometers, in order.
pub const AXIS_NAMES: [&str; AXES] = SensorKind::Accelerometer.names();

/// Names of the gyroscopes, in order.
pub const GYROSCOPE_NAMES: [&str; AXES] = SensorKind::Gyroscope.names();

/// Policy for temperature outside a polynomial's range. Every policy flags the sample.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum OutOfRange {
    /// The polynomial is evaluated at the nearest end of the range.
    Clamp,
    /// The polynomial is evaluated at the temperature.
    Extrapolate,
    /// The increment of the axis is NaN.
    Reject,
}

impl OutOfRange {
    /// Every policy with its name in table files.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Clamp, "clamp"), (Self::Extrapolate, "extrapolate"), (Self::Reject, "reject")];

    /// The name in table files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Clamp => "clamp",
            Self::Extrapolate => "extrapolate",
            Self::Reject => "reject",
        }
    }
}

/// The coefficients of one sensor: an accelerometer or a gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Unit of the bias polynomial's value.
    pub bias_unit: BiasUnit,
    /// Bias against head temperature, in `bias_unit`; over its range within +-1 g0, or +-36000 deg/h.
    pub bias: Polynomial,
    /// What the bias has in addition for each unit of (lagged - present) head temperature, in `bias_unit`; 0 for none.
    pub transient: f64,
    /// K+ against board temperature \[pulse/(s*g0) or pulse/arcsec\]; over its range at least 1, or 1e-6.
    pub positive_scale_factor: Polynomial,
    /// K- against board temperature \[pulse/(s*g0) or pulse/arcsec\]; over its range at most -1, or -1e-6.
    pub negative_scale_factor: Polynomial,
    /// Plausibility limit of the pulse rate of both channels together \[pulse/s\]; a higher rate is flagged.
    pub max_rate: Option<f64>,
}

impl Axis {
    /// Bias at `head` temperature, without the transient term.
    #[must_use]
    #[inline]
    pub fn bias_at(&self, head: f64) -> Bias {
        Bias(self.bias.at(head) * self.bias_unit.factor())
    }

    /// K+ at `board` temperature.
    #[must_use]
    #[inline]
    pub fn positive_scale_factor_at(&self, board: f64) -> PositiveScaleFactor {
        PositiveScaleFactor(self.positive_scale_factor.at(board))
    }

    /// K- at `board` temperature.
    #[must_use]
    #[inline]
    pub fn negative_scale_factor_at(&self, board: f64) -> NegativeScaleFactor {
        NegativeScaleFactor(self.negative_scale_factor.at(board))
    }
}

/// The coefficients of the gyroscopes.
#[derive(Clone, Debug, PartialEq)]
pub struct Gyroscopes {
    /// G1, G2, G3.
    pub axes: [Axis; AXES],
    /// Of each gyroscope: what it indicates for specific force along each of the IMU's axes \[deg/h/g0\].
    pub g_sensitivity: [Option<[f64; AXES]>; AXES],
    /// Body-frame increment = matrix * sensor increment.
    pub alignment: Option<Matrix3<f64>>,
}

/// The `method` in the provenance of a table that was measured without a turntable, and in its campaign file.
pub const GRAVITY_ONLY: &str = "gravity-only";

/// Highest version of the file format.
pub const FORMAT: u8 = 3;

/// The content of a table, not checked yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Content {
    /// Version of the file format, at least [`Content::least_format`]; it is part of the digest.
    pub format: u8,
    /// The IMU that the coefficients belong to.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// The value of 1 g0 \[m/s2\].
    pub gravity: f64,
    /// The control period that the scale factors are of, which readings have \[s\]; none for pulse counters, whose
    /// scale factors are of no period. See [`interval_fits`](crate::nominal::interval_fits).
    pub nominal_interval_s: Option<f64>,
    /// Unit of the temperature, a label.
    pub temperature_unit: String,
    /// Policy for temperature outside a range.
    pub out_of_range: OutOfRange,
    /// Temperature older than this is flagged \[s\].
    pub max_age_s: Option<f64>,
    /// Time constant of the lagged temperature \[s\]; required if any bias has a transient term.
    pub lag_s: Option<f64>,
    /// A1, A2, A3.
    pub axes: [Axis; AXES],
    /// Body-frame increment = matrix * sensor increment.
    pub alignment: Option<Matrix3<f64>>,
    /// G1, G2, G3.
    pub gyroscopes: Option<Gyroscopes>,
}

/// An invalid part of a [`Content`].
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct ContentFault {
    /// The key as in a table file; for a sensor it begins with its section and name, as in `axis.A1.` or
    /// `gyroscope.G3.`.
    pub key: String,
    /// What is wrong, and what to write instead.
    pub message: String,
}

impl fmt::Display for ContentFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.key, self.message)
    }
}

impl Content {
    /// The lowest version of the file format that has all of this content.
    #[must_use]
    pub fn least_format(&self) -> u8 {
        let transient = self.axes.iter().any(|axis| axis.transient != 0.0);
        match (self.nominal_interval_s, transient || self.lag_s.is_some() || self.gyroscopes.is_some()) {
            (Some(_), _) => 3,
            (None, true) => 2,
            (None, false) => 1,
        }
    }

    pub(super) fn refusals(&self) -> Vec<ContentFault> {
        let mut refusals = Vec::new();
        let mut check = |key: String, fault: Option<String>| {
            refusals.extend(fault.map(|message| ContentFault { key, message }));
        };
        let least = self.least_format();
        let fault = (!(least..=FORMAT).contains(&self.format)).then(|| format!("is {}, give {least}", self.format));
        check("format".to_owned(), fault);
        check("imu.gravity".to_owned(), gravity_fault(self.gravity));
        let nominal = self.nominal_interval_s.and_then(nominal_interval_fault);
        check("imu.nominal_interval_s".to_owned(), nominal);
        check("temperature.max_age_s".to_owned(), self.max_age_s.and_then(max_age_fault));
        check("lag.time_constant_s".to_owned(), self.lag_s.and_then(lag_fault));
        let gyroscopes =
            self.gyroscopes.iter().map(|gyroscopes| (SensorKind::Gyroscope, "gyroscope", &gyroscopes.axes));
        let accelerometers = (SensorKind::Accelerometer, "axis", &self.axes);
        for (kind, section, axes) in [accelerometers].into_iter().chain(gyroscopes) {
            for (name, axis) in kind.names().iter().zip(axes) {
                for (key, fault) in axis.faults(kind, self.lag_s.is_some()) {
                    check(format!("{section}.{name}.{key}"), fault);
                }
            }
        }
        check("alignment.matrix".to_owned(), self.alignment.as_ref().and_then(alignment_fault));
        if let Some(gyroscopes) = &self.gyroscopes {
            for (name, coefficients) in GYROSCOPE_NAMES.iter().zip(&gyroscopes.g_sensitivity) {
                for (key, coefficient) in G_SENSITIVITY_KEYS.iter().zip(coefficients.iter().flatten()) {
                    check(format!("gyroscope.{name}.g_sensitivity.{key}"), g_sensitivity_fault(*coefficient));
                }
            }
            check("gyroscope_alignment.matrix".to_owned(), gyroscopes.alignment.as_ref().and_then(alignment_fault));
        }
        refusals
    }

    /// The text whose bytes the digest is computed over.
    ///
    /// It is UTF-8; each line is `KEY VALUE` and ends with one LF. A NUMBER is the 16 lower-case hexadecimal digits of
    /// its IEEE 754 double, most significant first, with -0 as 0. A TEXT is its UTF-8 bytes in lower-case hexadecimal.
    /// The lines, in this order:
    ///
    /// ```text
    /// isotherm-table 1                         the format, 1, 2 or 3
    /// imu.id TEXT
    /// imu.serial TEXT                          only if present
    /// imu.gravity NUMBER
    /// imu.nominal_interval_s NUMBER            only if present
    /// temperature.unit TEXT
    /// temperature.out_of_range TEXT
    /// temperature.max_age_s NUMBER             only if present
    /// lag.time_constant_s NUMBER               only if present
    /// axis.A1.max_rate NUMBER                  only if present
    /// axis.A1.bias.unit TEXT
    /// axis.A1.bias.range NUMBER NUMBER
    /// axis.A1.bias.center NUMBER               0 if absent
    /// axis.A1.bias.scale NUMBER                1 if absent
    /// axis.A1.bias.coefficients NUMBER ...     c0 first
    /// axis.A1.bias.transient NUMBER            only if it is not 0
    /// axis.A1.positive_scale_factor.unit ...   as for the bias, then negative_scale_factor; then A2, A3
    /// alignment.matrix NUMBER ...              nine, row by row, only if present
    /// gyroscope.G1.max_rate ...                as for the axes, then
    /// gyroscope.G1.g_sensitivity NUMBER ...    a1, a2, a3, only if present; then G2, G3
    /// gyroscope_alignment.matrix NUMBER ...    nine, row by row, only if present
    /// ```
    #[must_use]
    pub fn canonical(&self) -> String {
        let mut lines = format!("isotherm-table {}\n", self.format);
        let mut line = |key: &str, value: String| {
            lines.push_str(key);
            lines.push_str(&value);
            lines.push('\n');
        };
        line("imu.id", text(self.imu.as_str()));
        if let Some(serial) = &self.serial {
            line("imu.serial", text(serial));
        }
        line("imu.gravity", numbers(&[self.gravity]));
        if let Some(interval) = self.nominal_interval_s {
            line("imu.nominal_interval_s", numbers(&[interval]));
        }
        line("temperature.unit", text(&self.temperature_unit));
        line("temperature.out_of_range", text(self.out_of_range.name()));
        if let Some(age) = self.max_age_s {
            line("temperature.max_age_s", numbers(&[age]));
        }
        if let Some(time_constant) = self.lag_s {
            line("lag.time_constant_s", numbers(&[time_constant]));
        }
        for (name, axis) in AXIS_NAMES.iter().zip(&self.axes) {
            axis.canonical(SensorKind::Accelerometer, &mut |key, value| line(&format!("axis.{name}.{key}"), value));
        }
        if let Some(matrix) = &self.alignment {
            line("alignment.matrix", numbers(matrix.transpose().as_slice()));
        }
        let Some(gyroscopes) = &self.gyroscopes else { return lines };
        for ((name, axis), g_sensitivity) in GYROSCOPE_NAMES.iter().zip(&gyroscopes.axes).zip(&gyroscopes.g_sensitivity)
        {
            let mut part = |key: &str, value| line(&format!("gyroscope.{name}.{key}"), value);
            axis.canonical(SensorKind::Gyroscope, &mut part);
            if let Some(coefficients) = g_sensitivity {
                part("g_sensitivity", numbers(coefficients));
            }
        }
        if let Some(matrix) = &gyroscopes.alignment {
            line("gyroscope_alignment.matrix", numbers(matrix.transpose().as_slice()));
        }
        lines
    }

    pub(super) fn digest(&self) -> Digest {
        Digest(Sha256::digest(self.canonical()).into())
    }
}

/// Keys of the three coefficients of a g-sensitivity.
pub(super) const G_SENSITIVITY_KEYS: [&str; AXES] = ["a1", "a2", "a3"];

impl Axis {
    /// The three polynomials with their names and units in table files.
    pub(super) fn polynomials(&self, kind: SensorKind) -> [(&'static str, &Polynomial, &'static str); 3] {
        [
            ("bias", &self.bias, self.bias_unit.name()),
            ("positive_scale_factor", &self.positive_scale_factor, kind.scale_factor_unit()),
            ("negative_scale_factor", &self.negative_scale_factor, kind.scale_factor_unit()),
        ]
    }

    /// What is wrong, by key.
    fn faults(&self, kind: SensorKind, has_lag: bool) -> [(&'static str, Option<String>); 6] {
        let of_kind = kind.bias_units().iter().any(|(unit, _)| *unit == self.bias_unit);
        let unit =
            (!of_kind).then(|| format!("is {}, which is not a unit of {}", self.bias_unit.name(), kind.base_unit()));
        let no_lag = || (self.transient != 0.0 && !has_lag).then(|| NO_LAG.to_owned());
        [
            ("bias.unit", unit),
            ("bias", bias_fault(kind, &self.bias, self.bias_unit)),
            ("bias.transient", transient_fault(kind, self.transient, &self.bias, self.bias_unit).or_else(no_lag)),
            ("positive_scale_factor", positive_scale_factor_fault(kind, &self.positive_scale_factor)),
            ("negative_scale_factor", negative_scale_factor_fault(kind, &self.negative_scale_factor)),
            ("max_rate", self.max_rate.and_then(max_rate_fault)),
        ]
    }

    /// The lines of the canonical form, by key.
    fn canonical(&self, kind: SensorKind, line: &mut dyn FnMut(&str, String)) {
        if let Some(rate) = self.max_rate {
            line("max_rate", numbers(&[rate]));
        }
        for (quantity, polynomial, unit) in self.polynomials(kind) {
            let mut part = |key: &str, value| line(&format!("{quantity}.{key}"), value);
            part("unit", text(unit));
            part("range", numbers(&polynomial.range()));
            part("center", numbers(&[polynomial.center()]));
            part("scale", numbers(&[polynomial.scale()]));
            part("coefficients", numbers(polynomial.coefficients()));
            if quantity == "bias" && self.transient != 0.0 {
                part("transient", numbers(&[self.transient]));
            }
        }
    }
}

fn text(value: &str) -> String {
    value.bytes().fold(String::from(" "), |line, byte| format!("{line}{byte:02x}"))
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| format!(" {:016x}", (value + 0.0).to_bits())).collect()
}
