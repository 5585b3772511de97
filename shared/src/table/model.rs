//! The table, its content and its digest.

use super::checks::{
    alignment_fault, bias_fault, gravity_fault, max_age_fault, max_rate_fault, negative_scale_factor_fault,
    positive_scale_factor_fault,
};
use crate::lanes::Lanes;
use crate::polynomial::Polynomial;
use crate::stream::ImuId;
use crate::units::{Bias, BiasUnit, NegativeScaleFactor, PositiveScaleFactor, SCALE_FACTOR_UNIT};
use crate::wire::AXES;
use core::fmt;
use nalgebra::Matrix3;
use sha2::{Digest as _, Sha256};

/// Names of the accelerometers, in order.
pub const AXIS_NAMES: [&str; AXES] = ["A1", "A2", "A3"];

/// Policy for telemetry outside a polynomial's range. Every policy flags the sample.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum OutOfRange {
    /// The polynomial is evaluated at the nearest end of the range.
    Clamp,
    /// The polynomial is evaluated at the telemetry.
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

/// The coefficients of one accelerometer.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Unit of the bias polynomial's value.
    pub bias_unit: BiasUnit,
    /// Bias against head telemetry, in `bias_unit`; within +-1 g0 over its range.
    pub bias: Polynomial,
    /// K+ against board telemetry \[pulse/(s*g0)\]; at least 1 over its range.
    pub positive_scale_factor: Polynomial,
    /// K- against board telemetry \[pulse/(s*g0)\]; at most -1 over its range.
    pub negative_scale_factor: Polynomial,
    /// Plausibility limit of the pulse rate of both channels together \[pulse/s\]; a higher rate is flagged.
    pub max_rate: Option<f64>,
}

impl Axis {
    /// Bias at `head` telemetry.
    #[must_use]
    #[inline]
    pub fn bias_at(&self, head: f64) -> Bias {
        Bias(self.bias.at(head) * self.bias_unit.in_g0())
    }

    /// K+ at `board` telemetry.
    #[must_use]
    #[inline]
    pub fn positive_scale_factor_at(&self, board: f64) -> PositiveScaleFactor {
        PositiveScaleFactor(self.positive_scale_factor.at(board))
    }

    /// K- at `board` telemetry.
    #[must_use]
    #[inline]
    pub fn negative_scale_factor_at(&self, board: f64) -> NegativeScaleFactor {
        NegativeScaleFactor(self.negative_scale_factor.at(board))
    }
}

/// The content of a table, not checked yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Content {
    /// The IMU that the coefficients belong to.
    pub imu: ImuId,
    /// Serial number, free text.
    pub serial: Option<String>,
    /// The value of 1 g0 \[m/s2\].
    pub gravity: f64,
    /// Unit of the telemetry, a label.
    pub temperature_unit: String,
    /// Policy for telemetry outside a range.
    pub out_of_range: OutOfRange,
    /// Telemetry older than this is flagged \[s\].
    pub max_age_s: Option<f64>,
    /// A1, A2, A3.
    pub axes: [Axis; AXES],
    /// Body-frame increment = matrix * sensor increment.
    pub alignment: Option<Matrix3<f64>>,
}

/// A valid coefficient table with its digest. Two tables are equal if their contents are.
#[derive(Clone, Debug)]
pub struct CoefficientTable {
    content: Content,
    lanes: Lanes,
    digest: Digest,
    id: u64,
    gravity_local: Option<f64>,
}

impl PartialEq for CoefficientTable {
    fn eq(&self, other: &Self) -> bool {
        self.content == other.content
    }
}

/// An invalid part of a [`Content`].
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Refusal {
    /// The key as in a table file; for an axis it begins with `axis.A1.`, `axis.A2.` or `axis.A3.`.
    pub key: String,
    /// What is wrong, and what to write instead.
    pub message: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.key, self.message)
    }
}

impl CoefficientTable {
    /// Checks `content` and computes its digest.
    ///
    /// # Errors
    /// All invalid parts of `content`.
    pub fn new(content: Content) -> Result<Self, Vec<Refusal>> {
        let refusals = content.refusals();
        if refusals.is_empty() {
            let (lanes, digest) = (content.lanes(), content.digest());
            Ok(Self { content, lanes, id: digest.id(), digest, gravity_local: None })
        } else {
            Err(refusals)
        }
    }

    /// The content of the table.
    #[must_use]
    #[inline]
    pub const fn content(&self) -> &Content {
        &self.content
    }

    /// Local gravity where the table was measured \[m/s2\], as its provenance says. It is not part of the digest.
    #[must_use]
    pub const fn gravity_local(&self) -> Option<f64> {
        self.gravity_local
    }

    /// The table with the local gravity where it was measured \[m/s2\].
    #[must_use]
    pub const fn measured_at(mut self, gravity_local: Option<f64>) -> Self {
        self.gravity_local = gravity_local;
        self
    }

    /// All polynomials, for evaluating them in one pass.
    #[must_use]
    #[inline]
    pub const fn lanes(&self) -> &Lanes {
        &self.lanes
    }

    /// SHA-256 over everything that affects the numbers or names their IMU; see [`Content::canonical`].
    #[must_use]
    pub const fn digest(&self) -> &Digest {
        &self.digest
    }

    /// The first 8 bytes of the digest, big-endian; every increment carries this number.
    #[must_use]
    #[inline]
    pub const fn id(&self) -> u64 {
        self.id
    }
}

impl Content {
    /// All polynomials, for evaluating them in one pass.
    fn lanes(&self) -> Lanes {
        let polynomials =
            self.axes.each_ref().map(|axis| [&axis.bias, &axis.positive_scale_factor, &axis.negative_scale_factor]);
        Lanes::new(polynomials, self.axes.each_ref().map(|axis| axis.bias_unit.in_g0()))
    }

    fn refusals(&self) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        let mut check = |key: String, fault: Option<String>| {
            refusals.extend(fault.map(|message| Refusal { key, message }));
        };
        check("imu.gravity".to_owned(), gravity_fault(self.gravity));
        check("temperature.max_age_s".to_owned(), self.max_age_s.and_then(max_age_fault));
        for (name, axis) in AXIS_NAMES.iter().zip(&self.axes) {
            check(format!("axis.{name}.bias"), bias_fault(&axis.bias, axis.bias_unit));
            check(
                format!("axis.{name}.positive_scale_factor"),
                positive_scale_factor_fault(&axis.positive_scale_factor),
            );
            check(
                format!("axis.{name}.negative_scale_factor"),
                negative_scale_factor_fault(&axis.negative_scale_factor),
            );
            check(format!("axis.{name}.max_rate"), axis.max_rate.and_then(max_rate_fault));
        }
        check("alignment.matrix".to_owned(), self.alignment.as_ref().and_then(alignment_fault));
        refusals
    }

    /// The text whose bytes the digest is computed over.
    ///
    /// It is UTF-8; each line is `KEY VALUE` and ends with one LF. A NUMBER is the 16 lower-case hexadecimal digits of its
    /// IEEE 754 double, most significant first, with -0 as 0. A TEXT is its UTF-8 bytes in lower-case hexadecimal. The
    /// lines, in this order:
    ///
    /// ```text
    /// isotherm-table 1
    /// imu.id TEXT
    /// imu.serial TEXT                          only if present
    /// imu.gravity NUMBER
    /// temperature.unit TEXT
    /// temperature.out_of_range TEXT
    /// temperature.max_age_s NUMBER             only if present
    /// axis.A1.max_rate NUMBER                  only if present
    /// axis.A1.bias.unit TEXT
    /// axis.A1.bias.range NUMBER NUMBER
    /// axis.A1.bias.center NUMBER               0 if absent
    /// axis.A1.bias.scale NUMBER                1 if absent
    /// axis.A1.bias.coefficients NUMBER ...     c0 first
    /// axis.A1.positive_scale_factor.unit ...   as for the bias, then negative_scale_factor; then A2, A3
    /// alignment.matrix NUMBER ...              nine, row by row, only if present
    /// ```
    #[must_use]
    pub fn canonical(&self) -> String {
        let mut lines = String::from("isotherm-table 1\n");
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
        line("temperature.unit", text(&self.temperature_unit));
        line("temperature.out_of_range", text(self.out_of_range.name()));
        if let Some(age) = self.max_age_s {
            line("temperature.max_age_s", numbers(&[age]));
        }
        for (name, axis) in AXIS_NAMES.iter().zip(&self.axes) {
            if let Some(rate) = axis.max_rate {
                line(&format!("axis.{name}.max_rate"), numbers(&[rate]));
            }
            for (quantity, polynomial, unit) in axis.polynomials() {
                let mut part = |key: &str, value| line(&format!("axis.{name}.{quantity}.{key}"), value);
                part("unit", text(unit));
                part("range", numbers(&polynomial.range()));
                part("center", numbers(&[polynomial.center()]));
                part("scale", numbers(&[polynomial.scale()]));
                part("coefficients", numbers(polynomial.coefficients()));
            }
        }
        if let Some(matrix) = &self.alignment {
            line("alignment.matrix", numbers(matrix.transpose().as_slice()));
        }
        lines
    }

    fn digest(&self) -> Digest {
        Digest(Sha256::digest(self.canonical()).into())
    }
}

impl Axis {
    /// The three polynomials with their names and units in table files.
    pub(super) fn polynomials(&self) -> [(&'static str, &Polynomial, &'static str); 3] {
        [
            ("bias", &self.bias, self.bias_unit.name()),
            ("positive_scale_factor", &self.positive_scale_factor, SCALE_FACTOR_UNIT),
            ("negative_scale_factor", &self.negative_scale_factor, SCALE_FACTOR_UNIT),
        ]
    }
}

fn text(value: &str) -> String {
    value.bytes().fold(String::from(" "), |line, byte| format!("{line}{byte:02x}"))
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| format!(" {:016x}", (value + 0.0).to_bits())).collect()
}

/// SHA-256 of a table's canonical form.
#[derive(Clone, Copy, Eq, PartialEq)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The first 8 bytes, big-endian.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.0.iter().take(8).fold(0, |id, &byte| id << 8 | u64::from(byte))
    }
}

/// `sha256:` and 64 hexadecimal digits.
impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("sha256:")?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
