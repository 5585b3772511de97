//! Normal gravity at a place: to notice a local gravity that cannot be right, and instead of one that nobody knows.

use core::fmt;
use core::ops::RangeInclusive;
use isotherm_support::finding::{Finding, name};

/// Half width of the 95 % interval of normal gravity as local gravity, relative: anomalies are 50 mGal rms, 51 ppm.
pub const NORMAL_GRAVITY_HALF_WIDTH: f64 = 2.0 * 51e-6;

/// Difference between local and normal gravity that is warned of \[m/s2\]: 650 m of height.
const SUSPECT: f64 = 0.002;

/// Largest plausible difference between local and normal gravity \[m/s2\]: anomalies of the field are below 0.002 m/s2
/// almost everywhere.
pub(crate) const ANOMALY: f64 = 0.003;

/// A place on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    latitude_deg: f64,
    height_m: f64,
}

impl Place {
    /// Geodetic latitudes, north positive \[deg\].
    pub const LATITUDES: RangeInclusive<f64> = -90.0..=90.0;
    /// Heights above the ellipsoid \[m\]; those above the sea are at most 110 m off.
    pub const HEIGHTS: RangeInclusive<f64> = -1000.0..=9000.0;

    /// The place at the geodetic latitude \[deg\], north positive, and the height above the ellipsoid \[m\].
    ///
    /// # Errors
    /// A value that is not in its range.
    pub fn new(latitude_deg: f64, height_m: f64) -> Result<Self, String> {
        let values = [("latitude", latitude_deg, Self::LATITUDES, "deg"), ("height", height_m, Self::HEIGHTS, "m")];
        match values.into_iter().find(|(_, value, range, _)| !range.contains(value)) {
            Some((what, value, range, unit)) => {
                Err(format!("{what} is {value}, give {} to {} {unit}", range.start(), range.end()))
            }
            None => Ok(Self { latitude_deg, height_m }),
        }
    }

    /// Geodetic latitude \[deg\], north positive.
    #[must_use]
    pub const fn latitude_deg(self) -> f64 {
        self.latitude_deg
    }

    /// Height above the ellipsoid \[m\].
    #[must_use]
    pub const fn height_m(self) -> f64 {
        self.height_m
    }

    /// Normal gravity there \[m/s2\].
    #[must_use]
    pub fn normal_gravity(self) -> f64 {
        normal_gravity(self.latitude_deg, self.height_m)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "latitude {} and height {} m", self.latitude_deg, self.height_m)
    }
}

/// Where local gravity comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum GravitySource {
    /// It is stated.
    #[default]
    Stated,
    /// It is normal gravity, because it is not known.
    Normal(Place),
}

impl GravitySource {
    /// Its name in a provenance.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stated => "stated",
            Self::Normal(_) => "normal",
        }
    }

    /// Half width of its 95 % interval, relative; 0 if it is stated, since its error is then not known.
    #[must_use]
    pub const fn half_width(self) -> f64 {
        match self {
            Self::Stated => 0.0,
            Self::Normal(_) => NORMAL_GRAVITY_HALF_WIDTH,
        }
    }
}

/// Normal gravity \[m/s2\] at the geodetic latitude \[deg\] and the height above the ellipsoid \[m\], -1000 to 9000:
/// Somigliana's formula on the ellipsoid of WGS 84, and its upward continuation to second order (NIMA TR8350.2,
/// equations 4-1 and 4-3).
///
/// ```
/// use isotherm_campaign::normal_gravity;
///
/// assert!((normal_gravity(45.0, 0.0) - 9.80620).abs() < 1e-5);
/// assert!((normal_gravity(45.0, 1000.0) - 9.80311).abs() < 1e-5); // 3.1e-6 m/s2 less for each metre
/// ```
#[must_use]
pub fn normal_gravity(latitude_deg: f64, height_m: f64) -> f64 {
    const EQUATOR: f64 = 9.780_325_335_9;
    const K: f64 = 0.001_931_852_652_41;
    const E2: f64 = 0.006_694_379_990_14;
    const A: f64 = 6_378_137.0;
    const F: f64 = 1.0 / 298.257_223_563;
    const M: f64 = 0.003_449_786_506_84;
    let sin2 = libm::sin(latitude_deg.to_radians()).powi(2);
    let surface = EQUATOR * (1.0 + K * sin2) / (1.0 - E2 * sin2).sqrt();
    surface * (1.0 - 2.0 / A * (1.0 + F + M - 2.0 * F * sin2) * height_m + 3.0 / (A * A) * height_m * height_m)
}

/// What is wrong with a local gravity \[m/s2\] at this place; `None` if it is plausible.
#[must_use]
pub(crate) fn gravity_fault(gravity_local: f64, place: Place) -> Option<String> {
    is_off(gravity_local, place, ANOMALY).then(|| format!("is {}", contradiction(gravity_local, place)))
}

/// A warning about a local gravity \[m/s2\] that is over 0.002 m/s2 off normal gravity at this place.
#[must_use]
pub(crate) fn gravity_warning(gravity_local: f64, place: Place) -> Option<Finding> {
    let warning =
        || Finding::warning(name::LOCAL_GRAVITY, format!("local gravity is {}", contradiction(gravity_local, place)));
    is_off(gravity_local, place, SUSPECT).then(warning)
}

fn is_off(gravity_local: f64, place: Place, limit: f64) -> bool {
    (gravity_local - place.normal_gravity()).abs() > limit
}

fn contradiction(gravity_local: f64, place: Place) -> String {
    let normal = place.normal_gravity();
    format!(
        "{gravity_local}, but normal gravity at {place} is {normal:.4} m/s2; exchanged with gravity_reference, or of another place?"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_gravity_is_that_of_the_ellipsoid() {
        // NIMA TR8350.2, table 3.4, at equator and poles. At 45 degrees GRS 80 has 9.8061992 (Moritz 2000), and its
        // equator is 1.4e-6 higher.
        for (latitude, right) in [
            (0.0, 9.780_325_335_9),
            (90.0, 9.832_184_937_9),
            (-90.0, 9.832_184_937_9),
            (45.0, 9.806_197_770),
            (-45.0, 9.806_197_770),
        ] {
            assert!((normal_gravity(latitude, 0.0) - right).abs() < 2e-9, "{latitude}");
        }
        // The free air gradient at 45 degrees is -3.0855e-6 at the ellipsoid; the second order is 7.2e-13 each m2.
        let fall = |metres: f64| normal_gravity(45.0, metres) - normal_gravity(45.0, 0.0);
        assert!((fall(1.0) + 3.0855e-6).abs() < 1e-9, "{}", fall(1.0));
        assert!((fall(5000.0) + 5000.0 * 3.0855e-6 - 25e6 * 7.23e-13).abs() < 1e-6, "{}", fall(5000.0));
        assert!((fall(-400.0) - 400.0 * 3.0855e-6).abs() < 1e-6, "{}", fall(-400.0));
    }

    #[test]
    fn a_gravity_of_another_place_is_noticed() {
        let [low, high] = [50.0, 1500.0].map(|height| Place::new(39.9, height).unwrap());
        assert_eq!(gravity_fault(9.8015, low), None);
        assert!(gravity_fault(9.80665, low).unwrap().contains("9.80"));
        assert!(gravity_fault(9.8015, high).is_some());
        let normal = low.normal_gravity();
        for off in [-1.99e-3, 0.0, 1.99e-3] {
            assert_eq!(gravity_warning(normal + off, low), None, "{off}");
        }
        for off in [-2.01e-3, 2.01e-3] {
            let warning = gravity_warning(normal + off, low).unwrap();
            assert!(
                warning.message.contains("but normal gravity at latitude 39.9 and height 50 m is 9.80"),
                "{warning}"
            );
            assert_eq!(gravity_fault(normal + off, low), None, "{off}");
        }
    }

    #[test]
    fn a_place_that_is_none_is_refused() {
        for (latitude, height, message) in [
            (90.1, 0.0, "latitude is 90.1, give -90 to 90 deg"),
            (f64::NAN, 0.0, "latitude is NaN"),
            (0.0, -1000.5, "height is -1000.5, give -1000 to 9000 m"),
            (0.0, f64::NAN, "height is NaN"),
            (0.0, f64::INFINITY, "height is inf"),
        ] {
            assert!(Place::new(latitude, height).unwrap_err().starts_with(message), "{message}");
        }
        assert!(Place::new(-90.0, 9000.0).is_ok() && Place::new(90.0, -1000.0).is_ok());
    }
}
