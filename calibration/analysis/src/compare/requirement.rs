//! What is required of the difference of two tables.

use isotherm_shared::bounds::{self, Bound};
use std::fmt;
use std::str::FromStr;

/// The largest differences that are allowed.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_analysis::ComparisonRequirement;
///
/// let required: ComparisonRequirement = "bias=2e-5g0,scale=50ppm".parse()?;
/// assert_eq!((required.bias, required.rate), (Some(2e-5), None)); // g0
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ComparisonRequirement {
    /// Of the bias of every accelerometer \[g0\].
    pub bias: Option<f64>,
    /// Of K+ and K- of every sensor, relative.
    pub scale: Option<f64>,
    /// Of every entry of the alignment matrices \[rad\].
    pub alignment: Option<f64>,
    /// Of the bias of every gyroscope \[deg/h\].
    pub rate: Option<f64>,
}

/// The rule, for messages.
const RULE: &str = "give bounds such as bias=20ug0,scale=50ppm,alignment=20urad,rate=0.05deg/h";

impl FromStr for ComparisonRequirement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut found = Self::default();
        for part in text.split(',') {
            let Some((name, value)) = part.split_once('=') else {
                return Err(format!("{:?} is not a bound; {RULE}", part.trim()));
            };
            let (place, kind): (_, Bound) = match name.trim() {
                "bias" => (&mut found.bias, bounds::BIAS),
                "scale" => (&mut found.scale, bounds::SCALE),
                "alignment" => (&mut found.alignment, bounds::ALIGNMENT),
                "rate" => (&mut found.rate, bounds::RATE),
                name => return Err(format!("{name:?} is not a bound; {RULE}")),
            };
            if place.is_some() {
                return Err(format!("{} is given twice", kind.name));
            }
            *place = Some(kind.parse(value.trim(), RULE)?);
        }
        Ok(found)
    }
}

impl ComparisonRequirement {
    /// The bounds of both.
    ///
    /// # Errors
    /// If both have the same bound.
    pub fn and(self, other: Self) -> Result<Self, String> {
        let one = |name: &str, a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(_), Some(_)) => Err(format!("{name} is given twice")),
            _ => Ok(a.or(b)),
        };
        Ok(Self {
            bias: one("bias", self.bias, other.bias)?,
            scale: one("scale", self.scale, other.scale)?,
            alignment: one("alignment", self.alignment, other.alignment)?,
            rate: one("rate", self.rate, other.rate)?,
        })
    }

    /// The bound of a curve in the unit of its difference: ug0, ppm or deg/h.
    pub fn of_curve(&self, unit: &str) -> Option<f64> {
        match unit {
            "ug0" => self.bias.map(|bias| bias * 1e6),
            "deg/h" => self.rate,
            _ => self.scale.map(|scale| scale * 1e6),
        }
    }
}

/// Whether a difference is within a bound.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub enum Compliance {
    /// All of it, band included.
    Within,
    /// The band reaches over the bound, and the difference may be on either side.
    Undecided,
    /// Some of it, without its band.
    Beyond,
}

impl Compliance {
    /// Of a difference that is somewhere at least `lower`, and everywhere at most `upper`.
    pub(super) fn of(lower: f64, upper: f64, bound: f64) -> Self {
        if upper <= bound {
            Self::Within
        } else if lower > bound {
            Self::Beyond
        } else {
            Self::Undecided
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Within => "within",
            Self::Undecided => "undecided",
            Self::Beyond => "beyond",
        }
    }
}

impl fmt::Display for Compliance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_mandatory() {
        let parse = |text: &str| text.parse::<ComparisonRequirement>();
        let all = parse("bias=2ug0,scale=3 ppm, alignment=5arcsec,rate=0.01deg/h").unwrap();
        assert_eq!(
            (all.of_curve("ug0"), all.of_curve("ppm"), all.of_curve("deg/h")),
            (Some(2.0), Some(3.0), Some(0.01))
        );
        // 2ug0 is 2 of ug0, neither 20 of something nor 2u of g0.
        assert_eq!(parse("bias=2\u{b5}g0").unwrap().bias, Some(2e-6));
        for (text, expected) in [
            ("bias=2", "bias is \"2\"; give a number with a unit: ug0, mg0, g0"),
            ("bias=2ug", "bias is \"2ug\""),
            ("scale=2ug0", "scale is \"2ug0\"; give a number with a unit: ppm, %"),
            ("bias=-2ug0", "bias must be over 0"),
            ("level=2arcsec", "\"level\" is not a bound; give bounds such as"),
            ("10", "\"10\" is not a bound"),
            ("", "\"\" is not a bound"),
            ("bias=2ug0,bias=3ug0", "bias is given twice"),
            ("alignment=100deg", "alignment must be from 0.001 arcsec to 90 deg"),
        ] {
            let message = parse(text).unwrap_err();
            assert!(message.starts_with(expected), "{text}: {message}");
        }
        let more = parse("scale=3ppm").unwrap();
        assert_eq!(parse("bias=2ug0").unwrap().and(more).unwrap(), parse("bias=2ug0,scale=3ppm").unwrap());
        assert_eq!(more.and(more).unwrap_err(), "scale is given twice");
    }
}
