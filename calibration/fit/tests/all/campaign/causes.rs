//! One cause has one line with the right words, and the bottom line does not claim what a warning contradicts.

use super::checks::with_rows;
use super::common::{calibrated, campaign_file, csv, dwells, paper, paper_truth, quiet};
use isotherm_campaign::{Campaign, Position};
use isotherm_fit::{
    Accuracy, Calibration, CalibrationOptions, OneStageError, calibrate_accelerometers, set_points, solve,
};
use isotherm_shared::wire::RawSample;
use isotherm_simulation::{CampaignSchedule, Noise, SimulatedRow, TILT_RAD, Truth, campaign, campaign_toml};
use isotherm_statistics::Curve;
use isotherm_support::finding::name;
use nalgebra::{DVector, Matrix3};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// A fit takes a second; one that never ends differs from it.
const WATCHDOG: Duration = Duration::from_secs(300);

fn options(accept: &[&'static str]) -> CalibrationOptions {
    CalibrationOptions { accept: accept.to_vec(), ..CalibrationOptions::default() }
}

/// All lines about changed rows that are refused.
fn lines(change: impl Fn(&mut Vec<SimulatedRow>), symptoms: bool) -> Vec<String> {
    let error = with_rows(change, options(&[])).unwrap_err();
    error.lines(symptoms, |finding| finding.tagged(|line| line.to_string()))
}

/// The warnings, and the bottom line.
fn claims(calibration: &Calibration) -> (Vec<&'static str>, String) {
    (calibration.findings.iter().map(|finding| finding.name).collect(), Accuracy::of(calibration).to_string())
}

/// A campaign of seven set points whose file states only angles, and of which `stated` changes the text.
fn angles_only(stated: impl Fn(&mut [f64; 2], u32)) -> Result<(Vec<&'static str>, String), String> {
    let truth = paper_truth(TILT_RAD, 9.8015);
    let set_points_c = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    let schedule = CampaignSchedule { set_points_c, noise: quiet(), ..CampaignSchedule::default() };
    let mut positions = schedule.positions.clone();
    for position in &mut positions {
        let mut angles = position.angles.unwrap();
        stated(&mut angles, position.number);
        *position = Position::at(position.number, angles[0], angles[1]);
    }
    let text = campaign_toml("imu-paper", "samples.csv", 9.8015, 9.8015, "V", &positions);
    let text: String =
        text.lines().filter(|line| !line.starts_with("specific_force")).map(|l| format!("{l}\n")).collect();
    let file = Campaign::from_toml(&text).unwrap();
    let dwells = dwells(&file, &csv(campaign(&truth, &schedule, 1))).unwrap();
    let calibration = calibrate_accelerometers(&file, dwells, options(&[]));
    calibration.map(|calibration| claims(&calibration)).map_err(|error| error.to_string())
}

#[test]
fn the_bottom_line_names_what_it_does_not_contain() {
    let (warnings, line) = angles_only(|_, _| {}).unwrap();
    assert!(warnings.is_empty() && line.ends_with(" set points"), "{warnings:?} {line}");
    let (warnings, line) = angles_only(|angles, number| angles[0] += if number == 5 { 0.04 } else { 0.0 }).unwrap();
    assert_eq!(warnings, [name::LEVEL]);
    assert!(line.ends_with(" set points, without what position 5 adds and the errors of warning [level]"), "{line}");
    // Curves that do not fit have one warning.
    let truth = paper_truth(TILT_RAD, 9.8015);
    let schedule = CampaignSchedule { noise: quiet(), ..CampaignSchedule::default() };
    let order = CalibrationOptions { order: Some(1), ..options(&[]) };
    let (_, calibration) = calibrated(&truth, &schedule, 1, order).unwrap();
    let (warnings, line) = claims(&calibration);
    assert_eq!(warnings.iter().filter(|name| **name == name::LACK_OF_FIT).count(), 1, "{warnings:?}");
    let unfit = calibration.findings.iter().find(|finding| finding.name == name::LACK_OF_FIT).unwrap();
    assert!(unfit.message.contains(" more curves: ") && unfit.message.contains("take a higher --order"), "{unfit}");
    assert!(line.ends_with("without the errors of warning [lack-of-fit]"), "{line}");
}

#[test]
fn without_degrees_of_freedom_nothing_is_known() {
    let truth = paper_truth(TILT_RAD, 9.8015);
    let schedule = |count: i32| CampaignSchedule {
        set_points_c: (0..count).map(|k| 15.0 * f64::from(k) - 20.0).collect(),
        noise: quiet(),
        ..CampaignSchedule::default()
    };
    let order = |order| CalibrationOptions { order: Some(order), ..options(&[]) };
    let (_, calibration) = calibrated(&truth, &schedule(5), 1, order(4)).unwrap();
    let (warnings, line) = claims(&calibration);
    assert_eq!(warnings, [name::NO_FREEDOM]);
    let unknown = "bias not known (no degrees of freedom), scale factor not known (no degrees of freedom) over ";
    assert!(line.starts_with(unknown), "{line}");
    let text = isotherm_report::text::calibration(&calibration);
    assert!(!text.contains("NaN") && text.contains("not known"), "{text}");
    // With one degree of freedom the caution says why intervals are so wide.
    let (_, calibration) = calibrated(&truth, &schedule(3), 1, order(1)).unwrap();
    let caution = Accuracy::of(&calibration).caution().unwrap();
    assert!(caution.contains("with 1 degree of freedom intervals are +- 12.7 standard errors"), "{caution}");
}

#[test]
fn intervals_a_little_off_are_a_warning_with_its_size() {
    let scaled = |parts: u64| {
        move |rows: &mut Vec<SimulatedRow>| {
            rows.iter_mut().for_each(|row| row.raw.interval_ns = row.raw.interval_ns / 1_000_000 * parts);
        }
    };
    for (parts, size) in [(995_000, "5025 ppm"), (999_700, "300 ppm"), (1_000_300, "300 ppm"), (1_009_000, "8920 ppm")]
    {
        let calibration = with_rows(scaled(parts), options(&[])).unwrap();
        let (warnings, line) = claims(&calibration);
        assert_eq!(warnings, [name::INTERVAL], "{parts}");
        let message = &calibration.findings[0].message;
        assert!(message.contains(&format!("every scale factor is wrong by {size}")), "{message}");
        assert!(line.ends_with("without the errors of warning [interval]"), "{line}");
        let strict = CalibrationOptions { strict: true, ..options(&[]) };
        assert!(with_rows(scaled(parts), strict).is_err());
    }
    for parts in [999_900, 1_000_100] {
        assert!(with_rows(scaled(parts), options(&[])).unwrap().findings.is_empty());
    }
}

#[test]
fn a_few_rows_of_the_same_count_are_no_full_converter() {
    // Near the extremum of K the largest rate is the same at two set points, three rows a dwell.
    let truth = Truth::varied(paper().content(), 100).unwrap();
    let noise = Noise { sensor_g0: 1e-6, ..Noise::default() };
    let schedule = CampaignSchedule { dwell_s: 30.0, noise, ..CampaignSchedule::default() };
    let (_, calibration) = calibrated(&truth, &schedule, 100, options(&[])).unwrap();
    assert!(!claims(&calibration).0.contains(&name::SATURATED));
}

#[test]
fn one_cable_of_two_accelerometers_is_named() {
    fn channel(raw: &mut RawSample, [axis, channel]: [usize; 2]) -> &mut u32 {
        if channel == 0 {
            &mut raw.accelerometers.positive_pulses[axis]
        } else {
            &mut raw.accelerometers.negative_pulses[axis]
        }
    }
    let exchange = |raw: &mut RawSample, a: [usize; 2], b: [usize; 2]| {
        let pulses = *channel(raw, a);
        *channel(raw, a) = std::mem::replace(channel(raw, b), pulses);
    };
    let sign = |channel: usize| ["+", "-"][channel];
    let column = |axis: usize, channel: usize| format!("a{}_{}", axis + 1, ["positive", "negative"][channel]);
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        for (first, second) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let found =
                lines(|rows| rows.iter_mut().for_each(|row| exchange(&mut row.raw, [a, first], [b, second])), false);
            let words = format!(
                "fault [channels-exchanged]: the {} channel of A{} and the {} channel of A{} look exchanged: exchange their cables, or the \
                 columns {} and {}",
                sign(first),
                a + 1,
                sign(second),
                b + 1,
                column(a, first),
                column(b, second)
            );
            assert!(found[0].starts_with(&words) && found.len() <= 2, "{words}\n{found:?}");
        }
    }
    let late = |rows: &mut Vec<SimulatedRow>| {
        let late = rows.iter_mut().filter(|row| row.set_point_c >= 20.0);
        late.for_each(|row| exchange(&mut row.raw, [0, 0], [1, 0]));
    };
    assert!(lines(late, false)[0].contains("look exchanged at 3 of 7 set points (20, 30, 40 degC)"));
}

#[test]
fn several_causes_do_not_fill_the_screen() {
    let pairs = |rows: &mut Vec<SimulatedRow>| {
        for row in rows {
            row.position = [0, 5, 2, 9, 4, 1, 6, 7, 8, 3, 10, 11, 12][row.position as usize];
        }
    };
    let (all, few) = (lines(pairs, true), lines(pairs, false));
    assert!(all.len() > 20 && few.len() == 11, "{} {}", all.len(), few.len());
    assert_eq!(all[..10], few[..10]);
    assert!(few.iter().take(10).all(|line| line.starts_with("fault ")));
    assert_eq!(few[10], format!("... and {} more; with -v isotherm calibrate lists them", all.len() - 10));
}

#[test]
fn what_else_must_be_accepted_is_said() {
    let exchange = |rows: &mut Vec<SimulatedRow>| {
        for row in rows.iter_mut().filter(|row| [3, 9].contains(&row.position)) {
            row.position = 12 - row.position;
        }
    };
    assert_eq!(with_rows(exchange, options(&[])).unwrap_err().acceptable(), ["positions-exchanged", "wrong-position"]);
    let error = with_rows(exchange, options(&[name::POSITIONS_EXCHANGED])).unwrap_err();
    assert_eq!(error.acceptable(), [name::WRONG_POSITION]);
    assert!(with_rows(exchange, options(&[name::POSITIONS_EXCHANGED, name::WRONG_POSITION])).is_ok());
    let missing = with_rows(|rows| rows.retain(|row| row.position != 8), options(&[])).unwrap_err();
    assert!(missing.acceptable().is_empty());
}

#[test]
fn motion_in_a_dwell_is_not_a_wrong_angle() {
    let disturb = |rows: &mut Vec<SimulatedRow>| {
        let dwell = rows.iter_mut().filter(|row| (row.set_point_c, row.position) == (20.0, 5));
        for (index, row) in dwell.enumerate() {
            row.raw.accelerometers.positive_pulses[0] += if index % 3 == 0 { 4000 } else { 0 };
        }
    };
    let found = lines(disturb, false);
    assert!(
        found[0].starts_with("fault [not-still]: ") && found[0].contains("degC, position 5: A1 was not still"),
        "{found:?}"
    );
    assert!(!found.iter().any(|line| line.contains("correct its angles")), "{found:?}");
    assert!(with_rows(disturb, options(&[name::NOT_STILL])).is_ok());
}

/// The rows of one device below 20 degC, and of another from there on.
fn two_devices(set_points_c: &[f64], other: &Truth, order: Option<usize>) -> Result<Calibration, Vec<String>> {
    let truth = paper_truth(TILT_RAD, 9.8015);
    let schedule = CampaignSchedule { set_points_c: set_points_c.to_vec(), ..CampaignSchedule::default() };
    let own = campaign(&truth, &schedule, 1).filter(|row| row.set_point_c < 20.0);
    let others = campaign(other, &schedule, 1).filter(|row| row.set_point_c >= 20.0);
    let file = campaign_file(&truth, &schedule);
    let dwells = dwells(&file, &csv(own.chain(others))).unwrap();
    let fitted = calibrate_accelerometers(&file, dwells, CalibrationOptions { order, ..options(&[]) });
    fitted.map_err(|error| error.lines(false, |finding| finding.tagged(|line| line.to_string())))
}

#[test]
fn another_device_from_a_set_point_on_is_no_wrong_angle() {
    let seven: Vec<f64> = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    for seed in 1..=6 {
        let other = Truth::varied(paper().content(), seed).unwrap();
        for (set_points_c, order) in [(&seven[..], None), (&[-20.0, 0.0, 20.0][..], Some(0))] {
            let lines = two_devices(set_points_c, &other, order).unwrap_err();
            println!("{}", lines[0]);
            let first = "fault [device-changed]: from set point 20 degC on the rows are of another device: misalignments differ by ";
            assert!(lines[0].starts_with(first), "{seed}: {lines:#?}");
            assert!(!lines.iter().any(|line| line.contains("correct its angles")), "{lines:#?}");
        }
    }
    // The same unit, turned on its fixture by a milliradian.
    let m = isotherm_simulation::MISALIGNMENT;
    let turned = Matrix3::new(0.0, 1e-3, 4e-4, -1e-3, 0.0, -3e-4, -4e-4, 3e-4, 0.0);
    let moved = Truth::new(paper().content().clone(), m + turned, TILT_RAD, 9.8015).unwrap();
    let lines = two_devices(&seven, &moved, None).unwrap_err();
    assert!(lines[0].contains("from set point 20 degC on the IMU was turned on its fixture"), "{lines:#?}");
    // Itself.
    assert!(two_devices(&seven, &paper_truth(TILT_RAD, 9.8015), None).is_ok());
}

#[test]
fn exchanged_set_points_are_named_with_the_remedy() {
    let exchange = |rows: &mut Vec<SimulatedRow>| {
        for row in rows {
            row.set_point_c = match row.set_point_c {
                -20.0 => 40.0,
                40.0 => -20.0,
                other => other,
            };
        }
    };
    let calibration = with_rows(exchange, options(&[])).unwrap();
    let order = calibration.findings.iter().find(|finding| finding.name == name::TEMPERATURE_ORDER).unwrap();
    let words = "-20 and 40 degC look exchanged; exchange them in the samples' column set_point_c";
    assert!(order.message.ends_with(words), "{order}");
}

#[test]
fn a_file_of_angles_alone_is_told_which_angle_is_off() {
    let text = |stated: fn(&mut [f64; 2])| angles_only(|angles, _| stated(angles)).unwrap_err();
    for stated in [|angles: &mut [f64; 2]| angles[0] += 90.0, |angles: &mut [f64; 2]| angles[0] -= 90.0] {
        let refused = text(stated);
        assert!(refused.starts_with("with 90 or -90 added to every outer_deg"), "{refused}");
    }
    let upside_down = text(|angles| angles[0] += 180.0);
    assert!(upside_down.contains("or outer_deg of every position is off by 180 degrees"), "{upside_down}");
    assert!(upside_down.contains("; add 180 to every outer_deg"), "{upside_down}");
    let turned = text(|angles| angles[1] += 180.0);
    assert!(turned.contains("; add 180 to every inner_deg"), "{turned}");
    let mirrored = text(|angles| angles[1] = -angles[1]);
    assert!(mirrored.contains("or the sign of every inner_deg"), "{mirrored}");
}

#[test]
fn a_broken_reading_cannot_be_accepted() {
    for value in [1e6, -40.0, 1e18] {
        let broken = |rows: &mut Vec<SimulatedRow>| rows[5].raw.accelerometers.head_temperature[1] = value;
        let error = with_rows(broken, options(&[name::TEMPERATURE_DRIFT])).unwrap_err();
        let found = error.lines(false, |finding| finding.tagged(|line| line.to_string()));
        let words = format!(
            "fault [temperature-reading]: 7: set point -20 degC, position 1: a2_head reads {value:?}, and 1.32"
        );
        assert!(found[0].starts_with(&words) && error.acceptable().is_empty(), "{found:?}");
    }
}

#[test]
fn values_that_overflow_do_not_keep_the_fit_from_ending() {
    let (send, receive) = mpsc::channel();
    thread::spawn(move || {
        let (truth, schedule) = (paper_truth(TILT_RAD, 9.8015), CampaignSchedule::default());
        let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
        rows[5].raw.accelerometers.board_temperature[1] = 1e300;
        let file = campaign_file(&truth, &schedule);
        let dwells = dwells(&file, &csv(rows)).unwrap();
        let set_points = set_points(&dwells, file.positions.len());
        let curve = |constant: f64| {
            Curve::new([2.5, 1.0], DVector::from_vec(vec![constant, 1e-3, 1e-3]), None, 1.0, [1.0, 4.0])
        };
        let curves = [(); 3].map(|()| [curve(1e-3), curve(9e4), curve(-9e4)]);
        let _ = send.send(solve(&file, &dwells, &set_points, &curves, &[]).map(|_| ()));
    });
    let ended = receive.recv_timeout(WATCHDOG).expect("the fit does not end");
    assert!(matches!(ended, Err(OneStageError::Undetermined { .. })), "{ended:?}");
}

#[test]
fn the_file_says_whose_angles_do_not_fit() {
    let truth = paper_truth(TILT_RAD, 9.8015);
    let schedule = CampaignSchedule::default();
    let mut positions = campaign_file(&truth, &schedule).positions;
    positions[3].angles = positions[3].angles.map(|[outer, inner]| [outer + 1.0, inner]);
    let text = campaign_toml("imu-paper", "samples.csv", 9.8015, 9.8015, "V", &positions);
    let faults = Campaign::from_toml(&text).unwrap_err().to_string();
    let words = "the angles of position 4 do not fit its specific_force, which differs by 1.00 degrees from";
    assert!(faults.contains(words), "{faults}");
    positions.iter_mut().for_each(|p| p.angles = p.angles.map(|[outer, inner]| [outer + 90.0, inner]));
    positions[3].angles = positions[3].angles.map(|[outer, inner]| [outer - 1.0, inner]);
    let text = campaign_toml("imu-paper", "samples.csv", 9.8015, 9.8015, "V", &positions);
    // Another zero of the outer axis is no fault: the tilt is not estimated then, and a warning says why.
    assert_eq!(Campaign::from_toml(&text).unwrap().mount, None);
}
