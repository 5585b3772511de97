//! Limits of commands and readings: the plan's own limits, within absolute limits that no plan can widen.

use isotherm_shared::document::Section;

/// Absolute limits of the chamber's temperature, commanded and measured \[degC\].
pub(crate) const CHAMBER_C: [f64; 2] = [-65.0, 100.0];
/// Absolute limit of the ramp of the chamber's set point \[degC/min\].
pub(crate) const RAMP_C_PER_MIN: f64 = 10.0;
/// Absolute limits of each angle of the turntable \[deg\].
pub(crate) const ANGLE_DEG: [f64; 2] = [-720.0, 720.0];
/// Absolute limit of each axis's rate \[deg/s\].
pub(crate) const RATE_DEG_S: f64 = 200.0;
/// Absolute limit of each axis's acceleration \[deg/s2\].
pub(crate) const ACCELERATION_DEG_S2: f64 = 500.0;
/// A reading may exceed the limit of an angle \[deg\] or a rate \[deg/s\] by this much: noise and overshoot of the
/// servo.
const SERVO_MARGIN: f64 = 1.0;

/// A plan's limits. None is wider than the absolute limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    chamber_c: [f64; 2],
    angles_deg: [[f64; 2]; 2],
    ramp_c_per_min: f64,
    rate_deg_s: f64,
    acceleration_deg_s2: f64,
}

/// Reads `[limits]`. The absolute limit replaces a missing or wrong one, which is reported as a fault.
pub(crate) fn read(section: Section<'_, '_>) -> Limits {
    let range = |key, absolute, right| range(&section, key, absolute, right);
    let chamber_c =
        range("chamber_c", CHAMBER_C, "lowest and highest temperature of the chamber in degC, as [-30, 50]");
    let outer = range("outer_deg", ANGLE_DEG, "lowest and highest outer angle in degrees, as [-5, 365]");
    let inner = range("inner_deg", ANGLE_DEG, "lowest and highest inner angle in degrees, as [-5, 365]");
    let limit = |key, default: f64, absolute: f64| {
        let value = section.optional_number(key);
        let wrong = value.filter(|value| !(*value > 0.0 && *value <= absolute));
        section.refuse(key, wrong.map(|value| format!("is {value:?}, give a number over 0 and up to {absolute:?}")));
        value.unwrap_or(default)
    };
    let ramp_c_per_min = limit("ramp_c_per_min", 3.0, RAMP_C_PER_MIN);
    let rate_deg_s = limit("rate_deg_s", 60.0, RATE_DEG_S);
    let acceleration_deg_s2 = limit("acceleration_deg_s2", 100.0, ACCELERATION_DEG_S2);
    section.finish();
    Limits { chamber_c, angles_deg: [outer, inner], ramp_c_per_min, rate_deg_s, acceleration_deg_s2 }
}

fn range(section: &Section<'_, '_>, key: &'static str, absolute: [f64; 2], right: &str) -> [f64; 2] {
    let [low, high] = absolute;
    let Some(given) = section.numbers(key, right) else { return absolute };
    let given = <[f64; 2]>::try_from(given).ok();
    let inside = given.filter(|given| low <= given[0] && given[0] < given[1] && given[1] <= high);
    if inside.is_none() {
        section.fault(key, format!("give {right}, within {low:?} and {high:?}"));
    }
    inside.unwrap_or(absolute)
}

impl Limits {
    /// The absolute limits.
    pub const ABSOLUTE: Self = Self {
        chamber_c: CHAMBER_C,
        angles_deg: [ANGLE_DEG; 2],
        ramp_c_per_min: RAMP_C_PER_MIN,
        rate_deg_s: RATE_DEG_S,
        acceleration_deg_s2: ACCELERATION_DEG_S2,
    };

    /// The fault of a chamber temperature \[degC\], commanded or measured; `None` if it is within the limits.
    pub fn chamber(&self, celsius: f64) -> Option<String> {
        let [low, high] = self.chamber_c;
        (!(low..=high).contains(&celsius))
            .then(|| format!("{celsius:?} degC is outside limits.chamber_c, {low:?} to {high:?} degC"))
    }

    /// The chamber temperature within the limits that is nearest to `celsius` \[degC\].
    pub const fn clamp_chamber(&self, celsius: f64) -> f64 {
        celsius.clamp(self.chamber_c[0], self.chamber_c[1])
    }

    /// The fault of a ramp \[degC/min\]; `None` if it is within the limit.
    pub fn ramp(&self, per_min: f64) -> Option<String> {
        let limit = self.ramp_c_per_min;
        (per_min > limit).then(|| format!("{per_min:.3} degC/min is over limits.ramp_c_per_min, {limit:?}"))
    }

    /// The fault of angles to command \[deg\]; `None` if they are within the limits.
    pub fn angles(&self, angles: [f64; 2]) -> Option<String> {
        self.angle(angles, 0.0, false)
    }

    /// The fault of a rate to command \[deg/s\]; `None` if it is within the limit.
    pub fn rate(&self, rate: f64) -> Option<String> {
        let limit = self.rate_deg_s;
        (rate > limit).then(|| format!("{rate:?} deg/s is over limits.rate_deg_s, {limit:?}"))
    }

    /// The fault of an acceleration to command \[deg/s2\]; `None` if it is within the limit.
    pub fn acceleration(&self, acceleration: f64) -> Option<String> {
        let limit = self.acceleration_deg_s2;
        (acceleration > limit).then(|| format!("{acceleration:?} deg/s2 is over limits.acceleration_deg_s2, {limit:?}"))
    }

    /// The fault of measured angles \[deg\] and rates \[deg/s\]; `None` if they are within the limits and the servo's
    /// margin. For a turntable that counts modulo 360 degrees, whole turns do not count.
    pub fn reading(&self, angles: [f64; 2], rates: [f64; 2], wraps: bool) -> Option<String> {
        self.measured_rates(rates).or_else(|| self.measured_angles(angles, wraps))
    }

    /// The fault of measured rates \[deg/s\], as [`reading`](Self::reading).
    pub fn measured_rates(&self, rates: [f64; 2]) -> Option<String> {
        let fast = rates.iter().find(|rate| rate.is_nan() || rate.abs() > self.rate_deg_s + SERVO_MARGIN);
        fast.map(|rate| format!("the turntable turns at {rate:.3} deg/s, over limits.rate_deg_s"))
    }

    /// The fault of measured angles \[deg\], as [`reading`](Self::reading).
    pub fn measured_angles(&self, angles: [f64; 2], wraps: bool) -> Option<String> {
        self.angle(angles, SERVO_MARGIN, wraps)
    }

    fn angle(&self, angles: [f64; 2], margin: f64, wraps: bool) -> Option<String> {
        let axes = ["outer", "inner"].into_iter().zip(angles).zip(self.angles_deg);
        axes.into_iter().find_map(|((name, angle), [low, high])| {
            let turns: &[f64] = if wraps { &[0.0, -360.0, 360.0] } else { &[0.0] };
            let inside = turns.iter().any(|turn| (low - margin..=high + margin).contains(&(angle + turn)));
            (!inside)
                .then(|| format!("{name} angle {angle:?} deg is outside limits.{name}_deg, {low:?} to {high:?} deg"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::document::Document;

    fn limits(text: &str) -> Result<Limits, String> {
        let document = Document::parse(text).unwrap();
        let limits = document.root().section("limits", "").map(read);
        document.finish(limits).map_err(|faults| faults.to_string())
    }

    const TEXT: &str = "[limits]\nchamber_c = [-30, 50]\nouter_deg = [-5, 365]\ninner_deg = [-5, 365]\n";

    #[test]
    fn a_plan_cannot_widen_the_absolute_limits() {
        assert!(limits(TEXT).is_ok());
        for (from, to) in [
            ("[-30, 50]", "[-66, 50]"),
            ("[-30, 50]", "[-30, 101]"),
            ("[-30, 50]", "[50, -30]"),
            ("[-5, 365]", "[-721, 365]"),
            ("[limits]", "[limits]\nrate_deg_s = 201"),
            ("[limits]", "[limits]\nramp_c_per_min = 10.1"),
            ("[limits]", "[limits]\nacceleration_deg_s2 = 0"),
        ] {
            assert!(limits(&TEXT.replacen(from, to, 1)).is_err(), "{to}");
        }
    }

    #[test]
    fn commands_and_readings_are_held_to_them() {
        let limits = limits(TEXT).unwrap();
        assert_eq!((limits.chamber(-30.0), limits.angles([365.0, -5.0]), limits.ramp(3.0)), (None, None, None));
        for celsius in [-30.1, 50.1, f64::NAN] {
            assert!(limits.chamber(celsius).is_some());
        }
        assert!(limits.angles([0.0, 365.1]).unwrap().contains("inner angle 365.1"));
        assert!(limits.rate(60.1).is_some() && limits.rate(60.0).is_none() && limits.acceleration(100.1).is_some());
        assert_eq!(limits.reading([365.5, 0.0], [60.5, 0.0], false), None);
        for angle in [-6.5, 366.5, 719.0] {
            assert!(limits.reading([angle, 0.0], [0.0; 2], false).is_some(), "{angle}");
        }
        let narrow = self::limits(&TEXT.replace("outer_deg = [-5, 365]", "outer_deg = [-90, 90]")).unwrap();
        assert!(narrow.reading([270.0, 0.0], [0.0; 2], true).is_none(), "-90 of a turntable that wraps");
        assert!(narrow.reading([180.0, 0.0], [0.0; 2], true).is_some());
        assert!(
            limits.reading([f64::INFINITY, 0.0], [0.0; 2], true).is_some()
                && limits.reading([0.0; 2], [0.0, -62.0], true).is_some()
        );
        assert!(
            limits.reading([f64::NAN, 0.0], [0.0; 2], true).is_some()
                && limits.reading([0.0; 2], [f64::NAN; 2], true).is_some()
        );
    }
}
