//! What a simpler method gets wrong, each with its own data: integrated, without noise, with pulses of 0.02 arcsec. A
//! method that falls into the trap is wrong by what is written next to it.

use super::station::{Gyroscope, Station, TestTurn, head_and_board, six_turns};
use isotherm_campaign::Scheme;
use isotherm_fit::{CalibrationError, CalibrationOptions, Method, TriadObservability};
use nalgebra::{Matrix3, Vector3};

/// What the method itself leaves: D \[deg/h\], K \[ppm\], s \[deg/h/g0\], M \[rad\].
const EXACT: [f64; 4] = [0.0002, 0.05, 0.0004, 5e-8];

fn check(name: &str, station: &Station, limits: [f64; 4]) {
    let calibration =
        station.calibrate(CalibrationOptions::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
    let errors = station.errors(&calibration);
    println!("{name}: {errors:?}");
    assert!(errors.iter().zip(limits).all(|(error, limit)| *error < limit), "{name}: {errors:?}");
    let earth = calibration.gyroscopes.as_ref().unwrap().solution.earth.unwrap();
    assert!(
        (earth[0] - station.earth().x).abs() < 2e-4 && (earth[1] - station.earth().y).abs() < 2e-4,
        "{name}: {earth:?}"
    );
}

#[test]
fn earths_rate_in_any_heading_and_latitude() {
    // Left out: K 398 ppm, s 9.7 deg/h/g0.
    for (seed, latitude) in [(1, 0.0), (2, 39.9), (3, -33.0), (4, 89.0), (5, 75.0)] {
        check(&format!("latitude {latitude}"), &Station { latitude, ..Station::new(seed).fine() }, EXACT);
    }
}

#[test]
fn a_large_g_sensitivity() {
    // Left out: as wrong as it is itself.
    let mut station = Station { turn_row: 0.2, ..Station::new(6).fine() };
    for (axis, gyroscope) in station.gyroscopes.iter_mut().enumerate() {
        gyroscope.s = [8.0, -12.0, 10.0].map(|s| s * (1.0 - 0.7 * axis as f64));
    }
    // phi is that of the pulses, and what gravity adds to them is taken for motion.
    check("g-sensitivity", &station, [EXACT[0], 0.2, EXACT[2], 1e-7]);
}

#[test]
fn across_the_axis_a_whole_turn_does_not_average_out() {
    // As averaged out: D 0.11, K 5, s 0.19, M 2.4e-6; a profile that is not symmetric in time adds a sine.
    for profile in [[10.0, 10.0, 7.0], [10.0, 2.0, 20.0], [25.0, 5.0, 5.0]] {
        check(&format!("{profile:?}"), &Station { profile, turn_row: 0.2, ..Station::new(7).fine() }, EXACT);
    }
}

#[test]
fn a_long_rest_is_no_rotation() {
    // As rotation: bias and Earth's rate turn phi by a degree in five minutes.
    check("rest of 600 s", &Station { rest: 600.3, ..Station::new(7).fine() }, [2e-3, 0.3, 1e-3, 2e-7]);
}

#[test]
fn any_angle_is_exact() {
    for angle in [360.0, 720.0, 90.0, 270.0, 1000.0] {
        let mut station = Station { turns: six_turns(angle), turn_row: 0.2, ..Station::new(8).fine() };
        station.turns.swap(1, 4);
        // K is as good as a pulse by the angle.
        let limits = if angle < 360.0 { [EXACT[0], 0.3, EXACT[2], 3e-7] } else { EXACT };
        check(&format!("{angle} deg"), &station, limits);
    }
    // A table whose driver takes angles modulo 360 does a turn in three moves.
    check("three moves", &Station { moves: 3, turn_row: 0.2, ..Station::new(9).fine() }, EXACT);
}

#[test]
fn the_channel_of_the_other_sign_counts() {
    // Left out: K 130 ppm. At rest some of the gyroscopes run against the turn, some with it.
    for bias in [-40.0, 40.0] {
        let mut station = Station::new(10).fine();
        for gyroscope in &mut station.gyroscopes {
            gyroscope.bias[0] = bias;
        }
        // phi is that of the pulses, and what the bias adds to them is taken for motion: 5e-9 rad of M for each deg/h.
        check(&format!("bias {bias}"), &station, [EXACT[0], EXACT[1], EXACT[2], 3e-7]);
    }
    // Channels that differ by a percent.
    let mut station = Station::new(11).fine();
    for gyroscope in &mut station.gyroscopes {
        gyroscope.kn = gyroscope.kn.map(|c| 1.01 * c);
    }
    check("K- 1 % larger", &station, EXACT);
}

#[test]
fn the_base_is_not_level() {
    // Taken as level with a tilt of 7e-5 rad: s 0.0009.
    check("tilt", &Station { tilt: [5e-4, -4e-4], ..Station::new(12).fine() }, EXACT);
}

#[test]
fn any_mounting_of_the_imu() {
    let turn = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let left = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let oblique = *nalgebra::Rotation3::from_euler_angles(0.2, -0.3, 0.4).matrix();
    for (name, mount) in [("turned", turn), ("left-handed", left), ("oblique", oblique)] {
        let mut station = Station { mount, tilt: [2e-4, 1e-4], ..Station::new(13).fine() };
        for turn in &mut station.turns {
            turn.axis = (mount * Vector3::from(turn.axis)).into();
        }
        // The text of the axis has few digits; the product takes it from the angles.
        check(name, &station, EXACT);
    }
}

#[test]
fn other_lists_of_positions() {
    for scheme in [Scheme::SixFacesSixEdges, Scheme::FourPointTumble] {
        let station = Station { positions: scheme.angles().to_vec(), tilt: [3e-4, -2e-4], ..Station::new(17).fine() };
        let found = TriadObservability::of(&station.campaign());
        assert!((found.rank, found.unknowns) == (26, 26) && found.condition < 10.0, "{found:?}");
        check(&format!("{scheme:?}"), &station, EXACT);
    }
}

#[test]
fn drift_within_a_set_point() {
    // Two-stage: D 0.013, K 3.0 with 1 degC a set point.
    let station = Station { drift: 1.0, ..Station::new(14).fine() };
    check("drift", &station, [0.0005, 0.2, 0.0005, 1.5e-7]);
    let options = CalibrationOptions { method: Method::TwoStage, ..CalibrationOptions::default() };
    let errors = station.errors(&station.calibrate(options).unwrap());
    println!("two-stage: {errors:?}");
    assert!(errors[0] < 0.05 && errors[1] < 10.0 && errors[2] < 0.02 && errors[3] < 1e-6, "{errors:?}");
    let steady = Station { drift: 0.0, ..station };
    let options = CalibrationOptions { method: Method::TwoStage, ..CalibrationOptions::default() };
    let errors = steady.errors(&steady.calibrate(options).unwrap());
    assert!(errors.iter().zip(EXACT).all(|(error, limit)| *error < limit), "{errors:?}");
}

#[test]
fn a_latitude_that_is_wrong() {
    // 0.1 deg off: s 0.02 deg/h/g0, and nothing else.
    let slightly =
        |latitude: f64| Station { latitude, stated_latitude: Some(latitude + 0.1), ..Station::new(15).fine() };
    let station = slightly(39.9);
    let errors = station.errors(&station.calibrate(CalibrationOptions::default()).unwrap());
    println!("0.1 deg: {errors:?}");
    assert!(
        errors[0] < EXACT[0] && errors[1] < EXACT[1] && (0.015..0.025).contains(&errors[2]) && errors[3] < EXACT[3],
        "{errors:?}"
    );
    // 1 deg off: refused with the latitude.
    let station = Station { latitude: 39.9, stated_latitude: Some(40.9), ..Station::new(15).fine() };
    let refused = station.calibrate(CalibrationOptions::default()).unwrap_err().to_string();
    println!("{refused}");
    assert!(
        refused.contains("latitude_deg = 40.9: Earth's horizontal rate is 11.53")
            && refused.contains("looks like 39.90 or -39.90"),
        "{refused}"
    );
    // The other hemisphere: the horizontal rate is right, s is 19 off, and a warning says so.
    let mut station = Station { latitude: 39.9, stated_latitude: Some(-39.9), ..Station::new(15).fine() };
    for gyroscope in &mut station.gyroscopes {
        gyroscope.s = [0.1, -0.2, 0.3];
    }
    let calibration = station.calibrate(CalibrationOptions::default()).unwrap();
    let errors = station.errors(&calibration);
    assert!((errors[2] - 19.3).abs() < 0.1 && errors[0] < EXACT[0], "{errors:?}");
    let findings: Vec<_> = calibration.findings.iter().map(ToString::to_string).collect();
    assert!(
        findings
            .iter()
            .any(|finding| finding.contains("the other hemisphere") && finding.ends_with("-39.9 meant, or 39.9?")),
        "{findings:?}"
    );
    // With the right sign there is no warning.
    let right = Station { stated_latitude: None, ..station };
    assert_eq!(right.calibrate(CalibrationOptions::default()).unwrap().findings, []);
}

#[test]
fn only_positive_turns_are_refused_by_name() {
    // K 263 ppm wrong at full rank.
    let station = Station::new(16);
    let of_sign =
        |sign: f64| -> Vec<TestTurn> { station.turns.iter().copied().filter(|turn| turn.angle * sign > 0.0).collect() };
    let refused =
        Station { turns: of_sign(1.0), ..station.clone() }.calibrate(CalibrationOptions::default()).unwrap_err();
    let CalibrationError::Positions(lines) = &refused else { panic!("{refused}") };
    // About [0, -1, 0] a positive turn drives G2 negative.
    assert_eq!(
        lines,
        &[
            "K- of G1: no turn drives it negative; add angle_deg < 0 about [1, 0, 0], of 90 degrees at least",
            "K+ of G2: no turn drives it positive; add angle_deg > 0 about [0, 1, 0], of 90 degrees at least",
            "K- of G3: no turn drives it negative; add angle_deg < 0 about [0, 0, 1], of 90 degrees at least",
        ]
    );
    let refused =
        Station { turns: of_sign(-1.0), ..station }.calibrate(CalibrationOptions::default()).unwrap_err().to_string();
    assert!(refused.contains("K- of G2: no turn drives it negative; add angle_deg < 0 about [0, 1, 0]"), "{refused}");
}

#[test]
fn the_temperature_of_the_generator_is_that_of_the_campaign() {
    // Guards the generator: heads and boards are apart, and cover 1.1 to 3.9 V.
    let [head, board] = head_and_board(3, -25.0);
    assert!((head - 1.136).abs() < 1e-12 && (board - 1.224).abs() < 1e-12);
    let Gyroscope { kp, kn, .. } = Station::new(1).gyroscopes[0];
    assert!(kp[0] > 0.8 && kn[0] < -0.8);
}
