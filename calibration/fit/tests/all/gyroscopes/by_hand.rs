//! Stations without angles: by hand, or on a rate table.

use super::station::{Station, TestTurn};
use isotherm_fit::CalibrationOptions;

/// A stop with the axis vertical: outer and inner angle that bring it there, and the axis in IMU coordinates.
const VERTICAL: [([f64; 2], [f64; 3]); 3] =
    [([90.0, 90.0], [1.0, 0.0, 0.0]), ([90.0, 0.0], [0.0, 1.0, 0.0]), ([0.0, 0.0], [0.0, 0.0, 1.0])];

fn turns(stops: [([f64; 2], [f64; 3]); 3]) -> Vec<TestTurn> {
    let turns = stops.into_iter().flat_map(|stop| [360.0, -360.0].map(|angle| (stop, angle)));
    (101..)
        .zip(turns)
        .map(|(number, (([outer, inner], axis), angle))| TestTurn { number, axis, angle, outer, inner })
        .collect()
}

fn station(seed: u64) -> Station {
    Station { angles: false, tilt: [0.0; 2], turns: turns(VERTICAL), ..Station::new(seed).fine() }
}

#[test]
fn positions_in_pairs_and_turns_about_the_vertical_need_no_angles() {
    for seed in 20..24 {
        let station = station(seed);
        let calibration = station.calibrate(CalibrationOptions::default()).unwrap();
        let errors = station.errors(&calibration);
        println!("{seed}: {errors:?}");
        // The horizontal rate, up to 15 deg/h, cancels.
        assert!(errors[0] < 0.0005 && errors[1] < 0.1 && errors[2] < 0.0005 && errors[3] < 1e-7, "{errors:?}");
        let found = calibration.gyroscopes.as_ref().unwrap();
        assert_eq!((found.solution.earth, found.earth, found.left_over.clone()), (None, None, None));
        assert_eq!(
            calibration.findings.iter().filter(|finding| finding.name != "level").count(),
            0,
            "{:?}",
            calibration.findings
        );
    }
}

#[test]
fn what_does_not_cancel_is_a_warning_with_its_size() {
    // Turns about horizontal axes: Earth's rate along them is not known.
    let horizontal = [([0.0, 0.0], [1.0, 0.0, 0.0]), ([0.0, 90.0], [0.0, -1.0, 0.0]), ([0.0, 0.0], [0.0, 0.0, 1.0])];
    let across = Station { turns: turns(horizontal), ..station(30) };
    // One position without a partner.
    let mut single = station(31);
    single.positions.remove(1);
    for (name, station, from) in
        [("turns", across, "turn 101, turn 102, turn 103, turn 104"), ("position", single, "position 1:")]
    {
        let calibration = station.calibrate(CalibrationOptions::default()).unwrap();
        let errors = station.errors(&calibration);
        let left = calibration.gyroscopes.as_ref().unwrap().left_over.clone().unwrap();
        println!("{name}: {errors:?} {left:?}");
        let bounds = [left.bias, left.scale_factor * 1e6, left.g_sensitivity, left.misalignment];
        for (k, (error, bound)) in errors.into_iter().zip(bounds).enumerate() {
            // What the warning says is the worst heading: never less than the error, apart from the pulses.
            assert!(error < 1.05 * bound + [0.0005, 0.1, 0.0005, 1e-7][k], "{name} {k}: {error} {bound}");
        }
        let text = calibration.findings.iter().map(|finding| format!("{finding}\n")).collect::<String>();
        assert!(text.contains("it does not cancel in ") && text.contains(from), "{text}");
    }
}
