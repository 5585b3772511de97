//! Normal gravity at a place, to notice a local gravity that cannot be right.

/// Largest plausible difference between local and normal gravity \[m/s2\]: anomalies of the field are below 0.002 m/s2
/// almost everywhere.
pub(crate) const ANOMALY: f64 = 0.003;

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
    let sin2 = latitude_deg.to_radians().sin().powi(2);
    let surface = EQUATOR * (1.0 + K * sin2) / (1.0 - E2 * sin2).sqrt();
    surface * (1.0 - 2.0 / A * (1.0 + F + M - 2.0 * F * sin2) * height_m + 3.0 / (A * A) * height_m * height_m)
}

/// What is wrong with a local gravity \[m/s2\] at this place; `None` if it is plausible.
#[must_use]
pub(crate) fn gravity_fault(gravity_local: f64, latitude_deg: f64, height_m: f64) -> Option<String> {
    let normal = normal_gravity(latitude_deg, height_m);
    ((gravity_local - normal).abs() > ANOMALY).then(|| {
        format!(
            "is {gravity_local}, but normal gravity at latitude {latitude_deg} and height {height_m} m is {normal:.4} m/s2; exchanged with \
             gravity_reference, or of another place?"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_gravity_is_that_of_the_ellipsoid() {
        // At the equator and the poles by definition; at 45 degrees that of GRS 80, 9.8061992, whose equator is 1.4e-6
        // higher.
        for (latitude, right) in
            [(0.0, 9.780_325_336), (90.0, 9.832_184_938), (-90.0, 9.832_184_938), (45.0, 9.806_197_77)]
        {
            assert!((normal_gravity(latitude, 0.0) - right).abs() < 1e-6, "{latitude}");
        }
        // 3.086e-6 m/s2 for each metre.
        assert!((normal_gravity(45.0, 0.0) - normal_gravity(45.0, 1000.0) - 3.086e-3).abs() < 2e-6);
    }

    #[test]
    fn a_gravity_of_another_place_is_noticed() {
        assert_eq!(gravity_fault(9.8015, 39.9, 50.0), None);
        assert!(gravity_fault(9.80665, 39.9, 50.0).unwrap().contains("9.80"));
        assert!(gravity_fault(9.8015, 39.9, 1500.0).is_some());
    }
}
