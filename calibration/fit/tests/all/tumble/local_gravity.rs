//! Local gravity of latitude and height: what checks it, and what it adds to the intervals.

use super::common::{STANDARD, campaign, recording, samples};
use isotherm_campaign::{Campaign, GravitySource, Place};
use isotherm_fit::{TumbleCalibration, TumbleOptions, calibrate_tumble, largest_interval};
use isotherm_support::finding::{Finding, name};

/// 102 ppm: twice the 50 mGal that normal gravity is off.
const HALF_WIDTH: f64 = 102e-6;

fn calibrated(campaign: &Campaign) -> TumbleCalibration {
    let recordings = [recording(&samples("tumble3/recording.csv"))];
    calibrate_tumble(campaign, &recordings, &TumbleOptions::default()).unwrap()
}

fn warnings(found: &TumbleCalibration) -> Vec<&Finding> {
    found.findings.iter().filter(|finding| finding.name == name::LOCAL_GRAVITY).collect()
}

#[test]
fn normal_gravity_widens_the_scale_factors_and_nothing_else() {
    let place = Place::new(29.0, 200.0).unwrap();
    let stated = calibrated(&campaign([place.normal_gravity(), STANDARD]));
    let normal = calibrated(&campaign([9.7, STANDARD]).with_normal_gravity(place));
    assert_eq!((stated.gravity_source, normal.gravity_source), (GravitySource::Stated, GravitySource::Normal(place)));
    assert_eq!(normal.table.gravity_local(), Some(place.normal_gravity()));
    assert_eq!(
        (stated.table.digest(), &stated.misalignment_error),
        (normal.table.digest(), &normal.misalignment_error)
    );
    assert!(warnings(&normal).is_empty() && stated.findings.len() == normal.findings.len());
    for (axis, quantity) in (0..9).map(|index| (index / 3, index % 3)) {
        let [narrow, wide] = [&stated, &normal].map(|found| &found.curves[axis][quantity]);
        let added = |at: f64| if quantity == 0 { 0.0 } else { HALF_WIDTH * narrow.at(at) };
        let [low, high] = narrow.measured();
        for at in [low, 0.7 * low + 0.3 * high, 0.5 * (low + high), high] {
            let [narrow, wide] = [narrow, wide].map(|curve| curve.interval(at, 0.95).unwrap());
            let right = libm::hypot(narrow, added(at));
            assert!((wide / right - 1.0).abs() < 1e-9, "{axis} {quantity} at {at}: {wide}, not {right}");
        }
        let [narrow, wide] = [narrow, wide].map(|curve| largest_interval(curve, true).unwrap());
        match quantity {
            0 => assert!((wide / narrow - 1.0).abs() < 1e-9),
            _ => {
                assert!(wide > HALF_WIDTH && wide <= libm::hypot(narrow, HALF_WIDTH) * (1.0 + 1e-9), "{wide} {narrow}");
            }
        }
        // `compare` takes the covariance of the provenance.
        let [low, high] = [&stated, &normal].map(|found| found.curves[axis][quantity].table_covariance().unwrap());
        assert!(if quantity == 0 { low == high } else { high[(0, 0)] > low[(0, 0)] }, "{low} {high}");
    }
}

#[test]
fn a_stated_gravity_is_checked_by_the_place_and_never_widened() {
    let stated = campaign([9.79179, STANDARD]);
    let plain = calibrated(&stated);
    // Normal gravity is 9.79179 m/s2 at 200 m; 450 and 850 m higher it is 1.39e-3 and 2.62e-3 less.
    let place = |height| Place::new(28.9, height).unwrap();
    assert!((place(200.0).normal_gravity() - 9.79179).abs() < 2e-4, "{}", place(200.0).normal_gravity());
    for (height, warned) in [(200.0, false), (650.0, false), (1050.0, true), (3000.0, true)] {
        let found = calibrated(&stated.clone().at_place(place(height)));
        let [warnings, all] = [warnings(&found).len(), found.findings.len()];
        assert_eq!((warnings, all), (usize::from(warned), plain.findings.len() + warnings), "{height}");
        assert_eq!(found.gravity_source, GravitySource::Stated);
        let intervals = |found: &TumbleCalibration| found.curves[1][1].interval(25.0, 0.95);
        assert_eq!(intervals(&found), intervals(&plain));
    }
}

#[test]
fn a_campaign_file_takes_normal_gravity_only_without_a_turntable() {
    let text = "format = 1\nmethod = \"gravity-only\"\nimu = \"imu-t\"\nsamples = \"desk.csv\"\ngravity_reference = 9.80665\n\
                temperature_unit = \"degC\"\n";
    let place = "latitude_deg = 47.4\nheight_m = 408\n";
    let found = Campaign::from_toml(&format!("{text}{place}")).unwrap();
    let right = Place::new(47.4, 408.0).unwrap();
    assert_eq!((found.gravity_local, found.gravity_source), (right.normal_gravity(), GravitySource::Normal(right)));
    assert_eq!((found.latitude_deg, found.height_m), (Some(47.4), Some(408.0)));
    let stated = Campaign::from_toml(&format!("{text}{place}gravity_local = 9.8074\n")).unwrap();
    assert_eq!((stated.gravity_local, stated.gravity_source), (9.8074, GravitySource::Stated));
    let message = |text: &str| Campaign::from_toml(text).unwrap_err().to_string();
    for (more, words) in [
        ("", "gravity_local: missing"),
        ("latitude_deg = 47.4\n", "give both latitude_deg and height_m"),
        ("height_m = 408\n", "give both latitude_deg and height_m"),
        ("latitude_deg = 90.5\nheight_m = 408\n", "latitude_deg: is 90.5, give -90 to 90"),
        ("latitude_deg = nan\nheight_m = 408\n", "latitude_deg"),
        ("latitude_deg = 47.4\nheight_m = 9001\n", "height_m: is 9001.0, give -1000 to 9000"),
        (
            "latitude_deg = 47.4\nheight_m = 408\ngravity_local = 9.8004\n",
            "gravity_local: is 9.8004, but normal gravity",
        ),
    ] {
        let said = message(&format!("{text}{more}"));
        assert!(said.contains(words), "{more}: {said}");
    }
    let turntable = include_str!("../../../../../examples/campaign/campaign.toml");
    let without: String =
        turntable.lines().filter(|line| !line.starts_with("gravity_local")).map(|line| format!("{line}\n")).collect();
    let said = message(&format!("latitude_deg = 47.4\nheight_m = 408\n{without}"));
    assert!(said.contains("gravity_local: missing"), "{said}");
}
