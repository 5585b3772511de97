//! What attitudes allow: D sqrt(n) of the sets that people use, and what is refused.

use super::common::{calibrated, cube, off, put_down};
use isotherm_fit::{CalibrationError, ScaleFactorChoice, TumbleError};
use isotherm_simulation::RandomGenerator;
use nalgebra::Vector3;

/// D sqrt(n) with one K or with two; infinite or over 100 as the refusal says it.
fn cost(directions: &[Vector3<f64>], choice: ScaleFactorChoice) -> f64 {
    let found = calibrated(&put_down(directions, &[25.0]), |options| {
        options.scale_factor = choice;
        options.temperature_range = Some([0.0, 50.0]);
    });
    match found {
        Ok(found) => found.dilution.times_root_n,
        Err(CalibrationError::Tumble(TumbleError::Attitudes { message, .. })) => {
            let shown = message.split("D sqrt(n) is ").nth(1).unwrap_or_else(|| panic!("{message}"));
            let shown = shown.split(',').next().unwrap();
            if shown == "infinite" { f64::INFINITY } else { shown.parse().unwrap() }
        }
        // Both signs and a reading near zero.
        Err(CalibrationError::Tumble(TumbleError::Refused(message))) if message.contains("--scale-factor split") => {
            f64::INFINITY
        }
        Err(error) => panic!("{error}"),
    }
}

fn near(value: f64, right: f64, part: f64) {
    let fits = if right.is_infinite() { value.is_infinite() } else { (value / right - 1.0).abs() < part };
    assert!(fits, "{value}, not {right}");
}

fn with_parts(counts: &[usize]) -> Vec<Vector3<f64>> {
    let parts = |direction: &Vector3<f64>| direction.iter().filter(|part| **part != 0.0).count();
    cube().into_iter().filter(|direction| counts.contains(&parts(direction))).collect()
}

const ONE: ScaleFactorChoice = ScaleFactorChoice::Single;
const TWO: ScaleFactorChoice = ScaleFactorChoice::Split;

#[test]
fn a_cube() {
    near(cost(&cube(), ONE), 3.1, 0.02);
    near(cost(&with_parts(&[1, 3]), ONE), 3.2, 0.02);
    near(cost(&with_parts(&[2]), ONE), 3.2, 0.02);
    near(cost(&cube(), TWO), 5.2, 0.02);
    near(cost(&with_parts(&[1, 3]), TWO), 4.5, 0.02);
    assert!(cost(&with_parts(&[2]), TWO) > 1000.0);
}

/// The mean over `sets` random sets of attitudes about `directions`.
fn scattered(directions: &[Vector3<f64>], degrees: f64, choice: ScaleFactorChoice) -> f64 {
    let sets = 8;
    let logarithms = (0..sets).map(|seed| {
        let mut random = RandomGenerator::new(seed, 9);
        let all: Vec<_> = directions.iter().map(|direction| off(&mut random, direction, degrees)).collect();
        libm::log(cost(&all, choice))
    });
    libm::exp(logarithms.sum::<f64>() / sets as f64)
}

#[test]
fn six_faces_by_eye() {
    let faces: Vec<_> = (0..4).flat_map(|_| with_parts(&[1])).collect();
    let [five, ten, twenty] = [5.0, 10.0, 20.0].map(|degrees| scattered(&faces, degrees, ONE));
    near(five, 20.0, 0.35);
    near(ten, 10.0, 0.35);
    near(twenty, 5.5, 0.35);
}

#[test]
fn ten_degrees_about_upright_are_not_enough() {
    let upright: Vec<_> = (0..24).map(|_| Vector3::z()).collect();
    let both: Vec<_> = (0..24).map(|k| if k % 2 == 0 { Vector3::z() } else { -Vector3::z() }).collect();
    assert!(scattered(&upright, 10.0, ONE) > 2e4);
    assert!(scattered(&upright, 30.0, ONE) > 300.0);
    assert!(scattered(&both, 10.0, ONE) > 50.0);
    assert!((4.0..15.0).contains(&scattered(&both, 45.0, ONE)));
}

#[test]
fn one_plane_and_two_planes_are_refused() {
    let circle = |a: usize, b: usize| {
        (0..12).map(move |k| {
            let mut direction = Vector3::zeros();
            let (sin, cos) = libm::sincos(f64::from(k) * core::f64::consts::TAU / 12.0);
            (direction[a], direction[b]) = (cos, sin);
            direction
        })
    };
    let one: Vec<_> = circle(0, 2).collect();
    let two: Vec<_> = circle(0, 2).chain(circle(1, 2)).collect();
    for (directions, missing) in [(one, "A2"), (two, "m12")] {
        let refused =
            calibrated(&put_down(&directions, &[25.0]), |options| options.temperature_range = Some([0.0, 50.0]));
        let Err(CalibrationError::Tumble(TumbleError::Attitudes { parameters, attitude, message, .. })) = refused
        else {
            panic!("{refused:?}")
        };
        let list = parameters.join(", ");
        assert!(list.contains(missing), "{message}: {list}; {attitude}");
        assert!(attitude.contains("A1") && attitude.contains("A2") || attitude.contains("A2"), "{attitude}");
    }
}

#[test]
fn a_split_needs_both_signs_and_a_reading_near_zero() {
    let up: Vec<_> = cube().into_iter().filter(|direction| direction.z >= 0.0).collect();
    let refused = calibrated(&put_down(&up, &[25.0]), |options| options.scale_factor = TWO).unwrap_err().to_string();
    assert!(
        refused.contains("A3 has no static pose with a negative reading") && refused.contains("-A3 up"),
        "{refused}"
    );
    let refused = calibrated(&put_down(&with_parts(&[3]), &[25.0]), |options| options.scale_factor = TWO);
    assert!(refused.unwrap_err().to_string().contains("a reading near zero"));
}

#[test]
fn one_attitude_many_times_is_refused() {
    let mut random = RandomGenerator::new(5, 5);
    let same: Vec<_> = (0..30).map(|_| off(&mut random, &Vector3::new(0.1, 0.2, 1.0).normalize(), 0.5)).collect();
    let refused = calibrated(&put_down(&same, &[25.0]), |options| options.temperature_range = Some([0.0, 50.0]));
    let error = refused.unwrap_err().to_string();
    assert!(error.contains("all 30 static poses are one attitude") && error.contains("never turned"), "{error}");
}

#[test]
fn tumbled_at_one_temperature_alone_is_refused_by_name() {
    let mut rows = put_down(&cube(), &[-10.0]);
    let last_ns = rows.last().unwrap().timestamp_ns;
    let up = vec![Vector3::z(); 26];
    for (index, mut row) in put_down(&up, &[25.0, 60.0]).into_iter().enumerate() {
        row.timestamp_ns += last_ns + 60_000_000_000;
        row.sequence = (rows.len() + index) as u64;
        rows.push(row);
    }
    let refused = calibrated(&rows, |options| options.order = Some(1)).unwrap_err();
    let CalibrationError::Tumble(TumbleError::Attitudes { parameters, attitude, .. }) = &refused else {
        panic!("{refused}")
    };
    assert!(parameters.iter().any(|name| name.ends_with("c1")), "{refused}");
    assert!(attitude.contains("temperature") || attitude.contains("temperature"), "{refused}");
}
