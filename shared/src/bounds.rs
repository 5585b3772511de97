//! Bounds as a user writes them: a number with a unit, which must be there.

/// Units of a bound, with their size in the bound's own unit.
pub type Units = &'static [(&'static str, f64)];

/// A kind of bound. Without units it is a bare number.
#[derive(Clone, Copy, Debug)]
pub struct Bound {
    /// Its name, for messages.
    pub name: &'static str,
    /// The units that it may be written in.
    pub units: Units,
    /// Smallest and largest value that makes sense, in its own unit and in words. No smaller one has digits where it is
    /// printed.
    pub range: ([f64; 2], &'static str),
}

/// In g0.
pub const BIAS: Bound = Bound {
    name: "bias",
    units: &[("ug0", 1e-6), ("mg0", 1e-3), ("g0", 1.0)],
    range: ([1e-9, 1.0], "0.001 ug0 to 1 g0"),
};
/// Relative.
pub const SCALE: Bound =
    Bound { name: "scale", units: &[("ppm", 1e-6), ("%", 1e-2)], range: ([1e-9, 1.0], "0.001 ppm to 100 %") };
const ANGLE_UNITS: Units = &[
    ("arcsec", std::f64::consts::PI / 648_000.0),
    ("arcmin", std::f64::consts::PI / 10_800.0),
    ("deg", std::f64::consts::PI / 180.0),
    ("urad", 1e-6),
    ("mrad", 1e-3),
    ("rad", 1.0),
];
const ANGLES: ([f64; 2], &str) = ([0.001 * ANGLE_UNITS[0].1, 90.0 * ANGLE_UNITS[2].1], "0.001 arcsec to 90 deg");
/// In rad.
pub const LEVEL: Bound = Bound { name: "level", units: ANGLE_UNITS, range: ANGLES };
/// In rad.
pub const ALIGNMENT: Bound = Bound { name: "alignment", units: ANGLE_UNITS, range: ANGLES };
/// In deg/h.
pub const RATE: Bound = Bound {
    name: "rate",
    units: &[("deg/h", 1.0), ("deg/s", 3600.0), ("arcsec/s", 1.0)],
    range: ([1e-6, 36_000.0], "1e-6 deg/h to 10 deg/s"),
};
/// A ratio.
pub const FACTOR: Bound = Bound { name: "factor", units: &[], range: ([1e-9, 1e9], "1e-9 to 1e9") };

impl Bound {
    /// The value in the bound's own unit; `rule` says in messages how bounds are written.
    ///
    /// # Errors
    /// What is wrong with the text, and what to write.
    pub fn parse(&self, value: &str, rule: &str) -> Result<f64, String> {
        let Self { name, units, range: ([least, most], range) } = *self;
        // Both characters for micro: the sign, and the Greek letter.
        let ascii = value.replace(['\u{b5}', '\u{3bc}'], "u");
        // The unit "ug0" ends with a digit, and "g0" ends it too.
        let with_unit = units.iter().find_map(|(unit, size)| {
            let number = ascii.strip_suffix(unit)?.trim().parse::<f64>().ok()?;
            Some(number * size)
        });
        let number = if units.is_empty() { ascii.parse::<f64>().ok() } else { with_unit };
        let Some(number) = number else {
            if units.is_empty() {
                return Err(format!("{value:?} is not a number; {rule}"));
            }
            let names: Vec<_> = units.iter().map(|(unit, _)| *unit).collect();
            return Err(format!("{name} is {value:?}; give a number with a unit: {}", names.join(", ")));
        };
        // 1e-9: 90 deg is 90 deg, whatever rounding makes of it. NaN is in no range.
        if number <= 0.0 {
            return Err(format!("{name} must be over 0"));
        }
        if !(least * (1.0 - 1e-9)..=most * (1.0 + 1e-9)).contains(&number) {
            return Err(format!("{name} must be from {range}"));
        }
        Ok(number)
    }
}
