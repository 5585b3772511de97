//! What goes wrong with recordings of people's desks.

use super::common::{
    INTERVAL_S, STANDARD, SimulatedImu, Truth, calibrated, campaign, cube, messages, put_down, recording, samples,
};
use isotherm_campaign::{Campaign, find_static_poses};
use isotherm_fit::{
    CalibrationError, ScaleFactorChoice, TumbleError, TumbleOptions, TumbleRecording, calibrate_tumble,
};
use isotherm_shared::compensate::answer;
use isotherm_shared::wire::RawSample;
use isotherm_verification::{LocalGravity, Magnitudes, MagnitudesError};
use nalgebra::{Rotation3, Vector3};

#[test]
fn slow_motion_is_never_at_rest() {
    let mut imu = SimulatedImu::new(Truth::random(1), 1, 1.0);
    for k in 0..4000 {
        // A turn every 80 s, at a rate that comes and goes.
        let angle = core::f64::consts::TAU * (f64::from(k) * INTERVAL_S / 80.0 + 0.02 * libm::sin(f64::from(k) / 37.0));
        imu.row(&(Rotation3::from_euler_angles(angle, 0.7 * angle, 0.0) * Vector3::z()), 25.0, 0.0);
    }
    let error = find_static_poses(&imu.rows, None).unwrap_err();
    assert!(error.to_string().contains("the means wander by"), "{error}");
    // In real recordings averaging helps: the means wander by far less than the limit of 0.4.
    for name in ["xsens/recording.csv", "ferraris/recording.csv", "five_mpu9150/imu4.csv", "tumble3/recording.csv"] {
        let found = find_static_poses(&samples(name), None).unwrap();
        assert!((0.01..0.12).contains(&found.wander), "{name}: {}", found.wander);
    }
}

#[test]
fn noise_does_not_lengthen_gravity() {
    let truth = Truth::random(2);
    let mut imu = SimulatedImu::new(truth.clone(), 2, 1.0);
    imu.noise = 50e-3;
    for direction in cube() {
        imu.rest(&direction, 25.0, 60.0);
        imu.gap(10.0);
    }
    let found = calibrated(&imu.rows, |options| {
        options.temperature_range = Some([0.0, 50.0]);
        options.scale_factor = ScaleFactorChoice::Single;
    });
    let found = found.unwrap();
    let bound = 1.2e-3;
    for axis in 0..3 {
        let both = [1, 2].map(|quantity| truth.value(axis, quantity, 27.5 + 0.4 * axis as f64));
        let off = found.curves[axis][1].at(found.mid(axis, 1)) / ((both[0] + both[1]) / 2.0) - 1.0;
        assert!(off.abs() < bound, "A{}: {off}", axis + 1);
    }
    // The mean of the lengths would be too long by the square of the noise, and every scale factor with it.
    let length = |row: &RawSample| Vector3::from(answer(Some(&found.table), row).velocity_increment).norm();
    let seconds = imu.rows.len() as f64 * INTERVAL_S;
    let lengthened = imu.rows.iter().map(length).sum::<f64>() / seconds / 9.81 - 1.0;
    assert!(lengthened > 1.5 * bound, "{lengthened}");
}

#[test]
fn an_offset_that_is_left_in_is_refused() {
    let rows: Vec<RawSample> = samples("xsens/recording.csv")
        .into_iter()
        .map(|mut row| {
            let triad = &mut row.accelerometers;
            for axis in 0..3 {
                let net = 4 * 32_768 + i64::from(triad.positive_pulses[axis]) - i64::from(triad.negative_pulses[axis]);
                (triad.positive_pulses[axis], triad.negative_pulses[axis]) = (u32::try_from(net).unwrap(), 0);
            }
            row
        })
        .collect();
    let error = calibrated(&rows, |options| options.temperature_range = Some([0.0, 50.0])).unwrap_err().to_string();
    assert!(error.contains("offset of an unsigned count") && error.contains("isotherm convert"), "{error}");
}

#[test]
fn a_pose_in_which_the_imu_turns_is_left_out() {
    let mut imu = SimulatedImu::new(Truth::random(4), 4, 1.0);
    // Rows are so noisy that their variance does not show a turn of 3 degrees in a minute; it makes the mean 114e-6 g0
    // too short.
    imu.noise = 2e-3;
    for (index, direction) in cube().iter().enumerate() {
        for k in 0..1200 {
            // Direction 7 is in the plane of A1 and A2.
            let angle = if index == 7 { f64::from(k) / 1200.0 * 3_f64.to_radians() } else { 0.0 };
            let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * direction;
            imu.row(&turned, 25.0, 0.0);
        }
        imu.gap(10.0);
    }
    let found = calibrated(&imu.rows, |options| options.temperature_range = Some([0.0, 50.0])).unwrap();
    let turned = messages(&found).into_iter().filter(|it| it.starts_with("1 of 26 static poses are left out")).count();
    assert!(turned == 1 && found.readings.len() == 25, "{:?}", messages(&found));
    assert!(found.readings.iter().all(|reading| !reading.rows.contains(&(7 * 1200 + 600))));
}

#[test]
fn rows_of_ten_seconds_and_gaps_are_used() {
    let truth = Truth::random(6);
    let mut imu = SimulatedImu::new(truth, 6, 1.0);
    for direction in cube() {
        imu.rest(&direction, 25.0, 120.0);
        imu.gap(10.0);
    }
    // 200 rows of 0.05 s each become one of 10 s; the gaps stay.
    let rows: Vec<RawSample> = imu
        .rows
        .chunks(200)
        .map(|chunk| {
            let mut sum = chunk[chunk.len() - 1];
            sum.interval_ns = chunk.iter().map(|row| row.interval_ns).sum();
            for axis in 0..3 {
                sum.accelerometers.positive_pulses[axis] =
                    chunk.iter().map(|row| row.accelerometers.positive_pulses[axis]).sum();
                sum.accelerometers.negative_pulses[axis] =
                    chunk.iter().map(|row| row.accelerometers.negative_pulses[axis]).sum();
            }
            sum
        })
        .collect();
    let found = calibrated(&rows, |options| options.temperature_range = Some([0.0, 50.0])).unwrap();
    // A pause of one row is as one that is lost, so two rows are cut off before and after it.
    assert_eq!(found.readings.len(), 26);
    assert!(
        found.readings.iter().all(|reading| (8..=10).contains(&reading.rows.len())),
        "{:?}",
        found.readings[0].rows
    );
    assert!(found.residual_rms() < 20e-6, "{}", found.residual_rms());
}

#[test]
fn two_attitudes_at_two_temperatures_are_refused() {
    let directions = [Vector3::new(0.1, 0.2, 1.0).normalize(), Vector3::new(1.0, 0.1, -0.2).normalize()];
    let error = calibrated(&put_down(&directions, &[-10.0, 60.0]), |_| {}).unwrap_err();
    assert!(matches!(error, CalibrationError::Tumble(TumbleError::Attitudes { .. })), "{error}");
    let many: Vec<_> = directions.iter().cycle().take(30).copied().collect();
    let error = calibrated(&put_down(&many, &[-10.0, 60.0]), |_| {}).unwrap_err();
    assert!(matches!(error, CalibrationError::Tumble(TumbleError::Attitudes { .. })), "{error}");
}

#[test]
fn two_temperatures_give_a_constant_or_a_line_that_is_asked_for() {
    let rows = put_down(&cube(), &[-10.0, 60.0]);
    let found = calibrated(&rows, |_| {}).unwrap();
    assert_eq!((found.groups.levels, found.unknowns.order), (2, 0));
    assert!(messages(&found).iter().any(|warning| warning.contains("--order 1")), "{:?}", messages(&found));
    let line = calibrated(&rows, |options| options.order = Some(1)).unwrap();
    assert!(line.unknowns.order == 1 && line.residual_rms() < 0.1 * found.residual_rms());
    let error = calibrated(&rows, |options| options.order = Some(2)).unwrap_err();
    assert!(
        matches!(error, CalibrationError::Tumble(TumbleError::Options(_)))
            && error.to_string().contains("order 1 at most"),
        "{error}"
    );
}

#[test]
fn constant_temperature_needs_a_range() {
    let rows = samples("xsens/recording.csv");
    let error = calibrated(&rows, |_| {}).unwrap_err().to_string();
    assert!(error.contains("--temperature-range"), "{error}");
    let error = calibrated(&rows, |options| options.temperature_range = Some([30.0, 40.0])).unwrap_err().to_string();
    assert!(error.contains("a range that holds it"), "{error}");
}

#[test]
fn a_pose_can_be_left_out_by_its_number() {
    let rows = put_down(&cube(), &[25.0]);
    let range = Some([0.0, 50.0]);
    let found =
        calibrated(&rows, |options| (options.temperature_range, options.exclude) = (range, vec![3, 26])).unwrap();
    assert!(found.readings.len() == 24 && found.readings.iter().all(|reading| ![3, 26].contains(&reading.number)));
    let error = calibrated(&rows, |options| options.exclude = vec![27]).unwrap_err();
    assert_eq!(error, CalibrationError::Tumble(TumbleError::NothingToExclude(27, 26)));
}

#[test]
fn each_file_is_a_recording_of_its_own() {
    let [cold, hot] = [-10.0, 60.0].map(|temperature| put_down(&cube(), &[temperature]));
    let both = [recording(&cold), recording(&hot)];
    let options = TumbleOptions { order: Some(1), ..TumbleOptions::default() };
    let found = calibrate_tumble(&campaign([STANDARD, STANDARD]), &both, &options).unwrap();
    assert!(found.readings.len() == 52 && found.readings[26].recording == 1 && found.readings[26].number == 27);
}

#[test]
fn a_campaign_file_of_the_method_has_no_positions() {
    let text = "format = 1\nmethod = \"gravity-only\"\nimu = \"imu-t\"\nsamples = [\"cold.csv\", \"hot.csv\"]\ngravity_reference = 9.80665\n\
                gravity_local = 9.81\ntemperature_unit = \"degC\"\n";
    let campaign = Campaign::from_toml(text).unwrap();
    assert!(campaign.is_tumble && campaign.samples.len() == 2 && !campaign.has_ramps_alone());
    let faults =
        Campaign::from_toml(&format!("{text}[[position]]\nnumber = 1\nspecific_force = [0, 0, 1]\n")).unwrap_err();
    assert!(faults.to_string().contains("knows no directions"), "{faults}");
    let ranged = Campaign::from_toml(&format!("{text}temperature_range = [15, 35]\n")).unwrap();
    assert_eq!(ranged.temperature_range, Some([15.0, 35.0]));
    let faults = Campaign::from_toml(&format!("{text}temperature_range = [35, 15]\n")).unwrap_err().to_string();
    assert!(faults.contains("the lower one first"), "{faults}");
    let imus = "imus = [{ id = \"a\", mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] }, { id = \"b\" }]";
    let batch = text.replace("imu = \"imu-t\"", imus).replace("[\"cold.csv\", \"hot.csv\"]", "\"{imu}.csv\"");
    let faults = Campaign::batch_from_toml(&batch).unwrap_err().to_string();
    assert!(faults.contains("the mounting of a has no effect"), "{faults}");
    let faults = Campaign::from_toml(&text.replace("gravity-only", "tumble")).unwrap_err().to_string();
    assert!(faults.contains("method") && faults.contains("gravity-only"), "{faults}");
}

#[test]
fn a_split_is_found_while_the_imu_warms_itself() {
    for seed in 0..6 {
        let mut truth = Truth::random(seed);
        // No effect of temperature, and 2e-3 between the channels.
        for axis in &mut truth.axes {
            axis[0][1] = 0.0;
            (axis[1][1], axis[2]) = (0.0, [axis[1][0] * 1.002, 0.0]);
        }
        let mut imu = SimulatedImu::new(truth.clone(), seed, 1.0);
        imu.noise = 5e-4;
        let directions = cube();
        imu.tumble(&directions, 25.0);
        let found = calibrated(&imu.rows, |_| {}).unwrap();
        assert!(
            found.unknowns.split && found.unknowns.order == 0,
            "seed {seed}: {:?} {:?}",
            found.unknowns,
            found.reasons
        );
        for axis in 0..3 {
            let off = found.curves[axis][0].at(25.2) - truth.axes[axis][0][0];
            let error = found.curves[axis][0].standard_error(25.2).unwrap();
            assert!(off.abs() < 4.0 * error, "seed {seed}: {off} +- {error}");
        }
    }
}

#[test]
fn wrong_intervals_and_a_recording_named_twice_are_refused() {
    let rows = put_down(&cube(), &[25.0]);
    let range = Some([0.0, 50.0]);
    let wrong: Vec<RawSample> =
        rows.iter().map(|row| RawSample { interval_ns: row.interval_ns * 6 / 5, ..*row }).collect();
    let error = calibrated(&wrong, |options| options.temperature_range = range).unwrap_err().to_string();
    assert!(error.contains("interval_ns is 1.2000 of the time from row to row"), "{error}");
    let twice = [recording(&rows), recording(&rows)];
    let options = TumbleOptions { temperature_range: range, ..TumbleOptions::default() };
    let error = calibrate_tumble(&campaign([9.81, 9.81]), &twice, &options).unwrap_err().to_string();
    assert!(error.contains("are the same recording"), "{error}");
    let error = calibrate_tumble(&campaign([9.81, 9.81]), &[TumbleRecording::new("empty.csv")], &options).unwrap_err();
    assert!(error.to_string().contains("empty.csv: there are no rows"), "{error}");
}

#[test]
fn what_looks_wrong_is_named() {
    let rows = put_down(&cube(), &[25.0]);
    let other = SimulatedImu::new(Truth::random(77), 77, 1.0);
    let mut other = other;
    cube().iter().for_each(|direction| {
        other.rest(direction, 25.0, 1.0);
        other.gap(10.0);
    });
    let options = TumbleOptions { temperature_range: Some([0.0, 50.0]), ..TumbleOptions::default() };
    let both = [recording(&rows), recording(&other.rows)];
    let error = calibrate_tumble(&campaign([9.81, 9.81]), &both, &options).unwrap_err().to_string();
    assert!(error.starts_with("the two groups of static poses") && error.contains("another device in one"), "{error}");
    let kelvin: Vec<RawSample> = put_down(&cube(), &[298.15]);
    let found = calibrated(&kelvin, |options| options.temperature_range = Some([250.0, 350.0])).unwrap();
    assert!(messages(&found).iter().any(|warning| warning.contains("kelvin")), "{:?}", messages(&found));
    let dead: Vec<RawSample> = rows
        .iter()
        .map(|row| {
            let mut row = *row;
            (row.accelerometers.positive_pulses[2], row.accelerometers.negative_pulses[2]) = (0, 0);
            row
        })
        .collect();
    let error = calibrated(&dead, |_| {}).unwrap_err().to_string();
    assert!(error.contains("A3 gives no pulses"), "{error}");
}

#[test]
fn lengths_of_another_device_are_refused() {
    let rows = put_down(&cube(), &[25.0]);
    let mut campaign = campaign([9.81, 9.81]);
    campaign.serial = Some("17".to_owned());
    let options = TumbleOptions { temperature_range: Some([0.0, 50.0]), ..TumbleOptions::default() };
    let found = calibrate_tumble(&campaign, &[recording(&rows)], &options).unwrap();
    let others: Vec<RawSample> = rows.iter().map(|row| RawSample { device: 5, ..*row }).collect();
    let lengths = |accepted| Magnitudes::of(&found.table, &others, None, LocalGravity::Stated(9.81), accepted);
    assert_eq!(lengths(false), Err(MagnitudesError::OtherDevice(others.len())));
    assert_eq!(lengths(true).unwrap().other_device, others.len());
    let error = calibrate_tumble(&campaign, &[recording(&others)], &options).unwrap_err().to_string();
    assert!(error.contains("another device than serial number 17"), "{error}");
}

#[test]
fn poses_that_never_drive_an_axis_do_not_meet_a_bound() {
    let options = TumbleOptions { temperature_range: Some([0.0, 50.0]), ..TumbleOptions::default() };
    let all = put_down(&cube(), &[25.0]);
    let found = calibrate_tumble(&campaign([9.81, 9.81]), &[recording(&all)], &options).unwrap();
    let judged = |directions: &[[f64; 3]]| {
        let directions: Vec<_> = directions.iter().map(|direction| Vector3::from(*direction)).collect();
        let rows = put_down(&directions, &[25.0]);
        let lengths = Magnitudes::of(&found.table, &rows, None, LocalGravity::Stated(9.81), false).unwrap();
        let met = lengths.judge(&"scale=20000ppm".parse().unwrap()).remove(0);
        (lengths.shown, met)
    };
    let in_plane =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.7, 0.0, 0.7], [-0.7, 0.0, 0.7]];
    let (shown, judgement) = judged(&in_plane);
    assert_eq!(shown.undriven, ["K+ of A2", "K- of A2"]);
    assert!(shown.driven[1] == [0.0, 0.0] && (shown.driven[0][0] - 2.0 / 6.0).abs() < 0.02, "{shown}");
    assert!(shown.temperature < 0.1, "{shown}");
    let words = ": not shown, no static pose drives K+ of A2, K- of A2";
    assert!(!judgement.met && judgement.message.ends_with(words), "{judgement:?}");
    let (shown, judgement) = judged(&[&in_plane[..], &[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]].concat());
    assert!(judgement.met && shown.undriven.is_empty(), "{judgement:?}");
}
