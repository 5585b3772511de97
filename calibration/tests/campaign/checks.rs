//! What a campaign is told before it becomes a table: faults and warnings with line, set point and position.

use crate::common::{calibrated, csv, dwells, noiseless, paper_truth as truth, quiet, stated};
use isotherm_calibration::calibrate::{CalibrationError, CalibrationOptions, calibrate};
use isotherm_calibration::campaign::Campaign;
use isotherm_calibration::checks::Severity;
use isotherm_calibration::positions::Scheme;
use isotherm_calibration::simulate::{CampaignSchedule, SimulatedRow, TILT_RAD, campaign};
use std::fs;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// As [`told`], with what concerns the whole campaign.
fn told_all(change: impl Fn(&mut Vec<SimulatedRow>)) -> (bool, String) {
    findings(change, |_| {}, &[], true)
}

/// What a changed campaign is told: its faults, or the warnings about its dwells and set points.
fn told(
    change: impl Fn(&mut Vec<SimulatedRow>),
    file: impl Fn(&mut Campaign),
    exclude: &[(f64, u32)],
) -> (bool, String) {
    findings(change, file, exclude, false)
}

fn findings(
    change: impl Fn(&mut Vec<SimulatedRow>),
    file: impl Fn(&mut Campaign),
    exclude: &[(f64, u32)],
    all: bool,
) -> (bool, String) {
    let truth = truth(TILT_RAD, 9.8015);
    let set_points_c = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    let plan = CampaignSchedule { set_points_c, noise: quiet(), ..CampaignSchedule::default() };
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &plan, 1).collect();
    change(&mut rows);
    let mut stated = stated(&truth, &plan);
    file(&mut stated);
    let options = CalibrationOptions { order: Some(3), exclude: exclude.to_vec(), ..CalibrationOptions::default() };
    let dwells = match dwells(&stated, &csv(rows)) {
        Ok(dwells) => dwells,
        Err(error) => return (false, error),
    };
    match calibrate(&stated, dwells, options) {
        Ok(calibration) => {
            let findings = calibration.findings.iter().filter(|f| all || f.place.is_some());
            (true, findings.map(|f| format!("{:?} {f}\n", f.line)).collect())
        }
        Err(CalibrationError::Faults(findings)) => {
            let faults = findings.iter().filter(|f| f.severity == Severity::Fault);
            (false, faults.map(|f| format!("{:?} {f}\n", f.line)).collect())
        }
        Err(error) => (false, error.to_string()),
    }
}

fn at(row: &SimulatedRow, set_point: f64, position: u32) -> bool {
    (row.set_point_c, row.position) == (set_point, position)
}

#[test]
fn a_good_campaign_is_told_nothing() {
    assert_eq!(told(|_| {}, |_| {}, &[]), (true, String::new()));
}

#[test]
fn a_missing_position_is_named_and_can_be_left_out() {
    let without = |rows: &mut Vec<SimulatedRow>| rows.retain(|row| !at(row, 20.0, 5));
    let (made, text) = told(without, |_| {}, &[]);
    assert!(!made && text.contains("set point 20 degC: position 5 of the campaign file is missing"), "{text}");
    assert!(told(without, |_| {}, &[(20.0, 5)]).0);
    // Both positions in which A1 points up: nothing else tells its K+.
    let (made, text) =
        told(|rows| rows.retain(|row| !at(row, 20.0, 5) && !at(row, 20.0, 6)), |_| {}, &[(20.0, 5), (20.0, 6)]);
    assert!(
        !made && text.starts_with("set point 20 degC: A1: K+ ") && text.contains("one with A1 pointing up"),
        "{text}"
    );
    let (made, text) = told(|_| {}, |_| {}, &[(20.0, 99)]);
    assert!(!made && text.contains("no dwell at set point 20 degC in position 99"), "{text}");
}

#[test]
fn positions_that_observe_too_little_are_refused() {
    let (made, text) = told(|_| {}, |file| file.positions.retain(|position| position.label != "-z"), &[]);
    // The samples have positions that the file does not list.
    assert!(!made && text.contains("position 3: no such position"), "{text}");
    let (made, text) = told(
        |rows| rows.retain(|row| ![3, 4].contains(&row.position)),
        |file| file.positions.retain(|position| position.label != "-z"),
        &[],
    );
    assert!(!made && text.starts_with("A3: K- ") && text.contains("one with A3 pointing down"), "{text}");
}

#[test]
fn an_outlying_dwell_is_named_and_kept() {
    let bump = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().filter(|row| at(row, 0.0, 9)).for_each(|row| row.raw.positive_pulses[1] += 40);
    };
    let (made, text) = told(bump, |_| {}, &[]);
    assert!(made && text.lines().count() == 1, "{text}");
    assert!(text.contains("set point 0 degC, position 9: A2 is") && text.contains("kept"), "{text}");
    assert_eq!(told(bump, |_| {}, &[(0.0, 9)]), (true, String::new()));
}

#[test]
fn motion_wrong_positions_and_saturation_are_faults() {
    let first_row = |rows: &mut Vec<SimulatedRow>| rows.iter_mut().position(|row| at(row, 40.0, 7)).unwrap();
    let (made, text) = told(
        |rows| {
            let index = first_row(rows);
            rows[index].raw.negative_pulses[0] -= 400_000;
        },
        |_| {},
        &[],
    );
    assert!(
        !made && text.contains("set point 40 degC, position 7: A1 was not still") && text.starts_with("Some("),
        "{text}"
    );
    let (made, text) = told(
        |rows| {
            let index = first_row(rows);
            rows[index + 3].raw.positive_pulses[2] += 60;
        },
        |_| {},
        &[],
    );
    assert!(made && text.contains("set point 40 degC, position 7: A3 was not still"), "{text}");
    let swap = |rows: &mut Vec<SimulatedRow>| {
        for row in rows.iter_mut().filter(|row| row.set_point_c == -20.0) {
            row.position = [0, 1, 2, 3, 4, 7, 8, 5, 6, 9, 10, 11, 12][row.position as usize];
        }
    };
    let (made, text) = told(swap, |_| {}, &[]);
    assert!(!made && text.contains("set point -20 degC, position 7: A1 indicates 1.0"), "{text}");
    let clip = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().for_each(|row| row.raw.positive_pulses[2] = row.raw.positive_pulses[2].min(920_000));
    };
    let (made, text) = told(clip, |_| {}, &[]);
    assert!(made && text.contains("the + channel of A3 gives the same 92000 pulse/s in every row"), "{text}");
    let (made, text) = told(|_| {}, |file| file.max_rate = Some(90_000.0), &[]);
    assert!(!made && text.contains("A1 counts 9") && text.contains("saturated"), "{text}");
}

#[test]
fn time_soak_and_telemetry_are_checked() {
    let (made, text) = told(|rows| rows[700].raw.timestamp_ns = rows[699].raw.timestamp_ns, |_| {}, &[]);
    assert!(!made && text.contains("line 702: ") && text.contains("time must rise"), "{text}");
    let (made, text) = told(|rows| rows[1].raw.interval_ns *= 10, |_| {}, &[]);
    assert!(!made && text.contains("line 3: ") && text.contains("pulses would be counted twice"), "{text}");
    let (made, text) = told(|rows| rows[5].raw.board_temperature[1] = f64::NAN, |_| {}, &[]);
    assert!(!made && text.contains("line 7: set point -20 degC, position 1: a2_board is NaN"), "{text}");
    let (made, text) = told(|rows| rows[5].raw.head_temperature[2] = 0.0, |_| {}, &[]);
    assert!(!made && text.contains("Some(7) set point -20 degC, position 1: a3_head runs from 0 to"), "{text}");
    let (made, text) = told(|rows| rows.iter_mut().for_each(|row| row.raw.head_temperature[2] = 2.5), |_| {}, &[]);
    assert!(!made && text.contains("a3_head is the same at every set point"), "{text}");
    let (made, text) = told(|_| {}, |file| file.soak_s = Some(5000.0), &[]);
    assert!(!made && text.contains("set point -10 degC: its first dwell begins 4260 s after"), "{text}");
    // 9 s counted in every 10 s, or 11: every scale factor would be wrong by as much.
    let (made, text) = told_all(|rows| rows.iter_mut().for_each(|row| row.raw.interval_ns = 9_000_000_000));
    assert!(
        made && text.contains("the intervals add up to 0.9") && text.contains("every scale factor is wrong"),
        "{text}"
    );
    let (made, text) = told_all(|rows| rows.iter_mut().for_each(|row| row.raw.interval_ns = 11_000_000_000));
    assert!(!made && text.contains("pulses are counted twice"), "{text}");
    let dead = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().filter(|row| row.set_point_c >= 20.0).for_each(|row| row.raw.head_temperature[0] = 2.9);
    };
    let (made, text) = told(dead, |_| {}, &[]);
    assert!(
        !made && text.contains("set point 30 degC, position 1: a1_head does not move from the set point before"),
        "{text}"
    );
    let (made, text) = told(|rows| rows.truncate(rows.len() - 20), |_| {}, &[]);
    assert!(made && text.contains("set point 40 degC, position 12: 100.0 s only"), "{text}");
    let sooner = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().filter(|row| row.set_point_c > -20.0).for_each(|row| row.raw.timestamp_ns -= 2_000_000_000_000);
    };
    let (made, text) = told(sooner, |_| {}, &[]);
    assert!(made && text.contains("set point -10 degC: its first dwell begins 2260 s after"), "{text}");
}

#[test]
fn too_few_set_points_for_an_order_are_refused() {
    let truth = truth(TILT_RAD, 9.8015);
    let plan = CampaignSchedule { set_points_c: vec![0.0, 20.0], ..noiseless(Scheme::SixFacesTwoHeadings.positions()) };
    let refused = calibrated(&truth, &plan, 1, CalibrationOptions { order: Some(3), ..CalibrationOptions::default() })
        .unwrap_err();
    assert!(refused.to_string().contains("order 3 needs 4 different values of x, there are 2"), "{refused}");
    let (_, line) =
        calibrated(&truth, &plan, 1, CalibrationOptions { order: Some(1), ..CalibrationOptions::default() }).unwrap();
    // Two set points make a line, but tell nothing of its error.
    assert_eq!(line.solution.axes[0].curves[0].standard_error(2.0), None);
}

#[test]
fn campaign_files_are_refused_with_line_and_key() {
    let good = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    assert!(Campaign::from_toml(&good).is_ok());
    for (from, to, told) in [
        ("format = 1", "format = 2", "line 1: format: unknown"),
        ("gravity_local = 9.8015", "gravity_local = 98.0", "gravity_local: is 98.0, give 9.7 to 9.9"),
        ("number = 2", "number = 1", "position.2.number: 1 is there twice"),
        ("[0, 0, -1]", "[0, 0, -9.8]", "position.3.specific_force: give the direction"),
        ("[0, 0, -1]", "[0, -1]", "position.3.specific_force: give the direction"),
        ("outer_deg = 0\n", "", "position.1: give both outer_deg and inner_deg, or neither"),
        ("imu = \"imu-paper\"", "imu = \"IMU\"", "line 2: imu: is \"IMU\", give 1 to 32"),
        ("temperature_unit", "temprature_unit", "temprature_unit: unknown key"),
        ("samples = \"samples.csv\"", "", "samples: missing"),
    ] {
        let faults = Campaign::from_toml(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(faults.contains(told), "{from} -> {to}: {faults}");
    }
    // The angles alone are enough, and a few digits say which way.
    let angles = good.replace("specific_force", "# specific_force");
    assert_eq!(Campaign::from_toml(&angles).unwrap().positions, Campaign::from_toml(&good).unwrap().positions);
    let edge = good.replacen("[0, 0, 1] ", "[0, 0.7071, 0.7071] ", 1).replacen("up = \"+z\"", "up = \"y and z\"", 1);
    let edge = Campaign::from_toml(&edge).unwrap().positions[0].specific_force;
    assert!((edge[1] - 0.5_f64.sqrt()).abs() < 1e-15);
}
