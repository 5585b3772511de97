//! Findings about a campaign: faults and warnings with line, set point and position.
//!
//! Over 400 lines: each finding has its test next to those that it is distinguished from.

use super::common::{calibrated, campaign_file, csv, dwells, noiseless, paper_truth as truth, quiet};
use isotherm_campaign::{Campaign, Scheme, read_dwells};
use isotherm_fit::{Calibration, CalibrationError, CalibrationOptions, calibrate_accelerometers};
use isotherm_recording::CampaignRow;
use isotherm_simulation::{CampaignSchedule, SimulatedRow, TILT_RAD, campaign};
use isotherm_support::finding::{Finding, Severity, name};
use std::fs;
use std::path::PathBuf;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");

/// As [`findings`], with those about the whole campaign.
fn all_findings(change_rows: impl Fn(&mut Vec<SimulatedRow>)) -> (bool, String) {
    collect_findings(change_rows, |_| {}, &[], true)
}

/// Calibrates a changed campaign. Returns whether there is a table, with the warnings about dwells and set points if
/// so, with the faults if not.
fn findings(
    change_rows: impl Fn(&mut Vec<SimulatedRow>),
    change_file: impl Fn(&mut Campaign),
    exclude: &[(f64, u32)],
) -> (bool, String) {
    collect_findings(change_rows, change_file, exclude, false)
}

fn collect_findings(
    change_rows: impl Fn(&mut Vec<SimulatedRow>),
    change_file: impl Fn(&mut Campaign),
    exclude: &[(f64, u32)],
    all: bool,
) -> (bool, String) {
    let truth = truth(TILT_RAD, 9.8015);
    let set_points_c = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    let schedule = CampaignSchedule { set_points_c, noise: quiet(), ..CampaignSchedule::default() };
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
    change_rows(&mut rows);
    let mut file = campaign_file(&truth, &schedule);
    change_file(&mut file);
    let options = CalibrationOptions { order: Some(3), exclude: exclude.to_vec(), ..CalibrationOptions::default() };
    let dwells = match dwells(&file, &csv(rows)) {
        Ok(dwells) => dwells,
        Err(error) => return (false, error),
    };
    match calibrate_accelerometers(&file, dwells, options) {
        Ok(calibration) => {
            let findings = calibration.findings.iter().filter(|f| all || f.place.is_some());
            (true, findings.map(|f| format!("{:?} {f}\n", f.line)).collect())
        }
        Err(CalibrationError::Faults { diagnosis, findings }) => {
            let faults = findings.iter().filter(|f| f.severity == Severity::Fault);
            let all: Vec<_> = diagnosis.iter().map(|diagnosis| &diagnosis.finding).chain(faults).collect();
            (false, all.iter().map(|f| format!("{:?} {f}\n", f.line)).collect())
        }
        Err(error) => (false, error.to_string()),
    }
}

fn is_at(row: &SimulatedRow, set_point: f64, position: u32) -> bool {
    (row.set_point_c, row.position) == (set_point, position)
}

#[test]
fn a_good_campaign_has_no_findings() {
    assert_eq!(findings(|_| {}, |_| {}, &[]), (true, String::new()));
}

#[test]
fn a_missing_position_is_named_and_can_be_left_out() {
    let without = |rows: &mut Vec<SimulatedRow>| rows.retain(|row| !is_at(row, 20.0, 5));
    let (has_table, text) = findings(without, |_| {}, &[]);
    assert!(!has_table && text.contains("set point 20 degC: position 5 of the campaign file is missing"), "{text}");
    assert!(findings(without, |_| {}, &[(20.0, 5)]).0);
    // Without both positions in which A1 points up, K+ of A1 cannot be determined.
    let (has_table, text) = findings(
        |rows| rows.retain(|row| !is_at(row, 20.0, 5) && !is_at(row, 20.0, 6)),
        |_| {},
        &[(20.0, 5), (20.0, 6)],
    );
    assert!(
        !has_table && text.starts_with("set point 20 degC: A1: K+ ") && text.contains("one with A1 pointing up"),
        "{text}"
    );
    let (has_table, text) = findings(|_| {}, |_| {}, &[(20.0, 99)]);
    assert!(!has_table && text.contains("no dwell or turn at set point 20 degC with the number 99"), "{text}");
}

#[test]
fn positions_that_observe_too_little_are_refused() {
    let (has_table, text) = findings(|_| {}, |file| file.positions.retain(|position| position.label != "-z"), &[]);
    // The samples have positions that the file does not list.
    assert!(!has_table && text.contains("position 3: no such position"), "{text}");
    let (has_table, text) = findings(
        |rows| rows.retain(|row| ![3, 4].contains(&row.position)),
        |file| file.positions.retain(|position| position.label != "-z"),
        &[],
    );
    assert!(!has_table && text.starts_with("A3: K- ") && text.contains("one with A3 pointing down"), "{text}");
}

#[test]
fn an_outlying_dwell_is_named_and_kept() {
    let bump = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut()
            .filter(|row| is_at(row, 0.0, 9))
            .for_each(|row| row.raw.accelerometers.positive_pulses[1] += 40);
    };
    let (has_table, text) = findings(bump, |_| {}, &[]);
    assert!(has_table && text.lines().count() == 1, "{text}");
    assert!(text.contains("set point 0 degC, position 9: A2 is") && text.contains("kept"), "{text}");
    assert_eq!(findings(bump, |_| {}, &[(0.0, 9)]), (true, String::new()));
}

#[test]
fn motion_wrong_positions_and_saturation_are_faults() {
    let first_row = |rows: &mut Vec<SimulatedRow>| rows.iter_mut().position(|row| is_at(row, 40.0, 7)).unwrap();
    let (has_table, text) = findings(
        |rows| {
            let index = first_row(rows);
            rows[index].raw.accelerometers.negative_pulses[0] -= 400_000;
        },
        |_| {},
        &[],
    );
    assert!(
        !has_table && text.contains("set point 40 degC, position 7: A1 was not still") && text.starts_with("Some("),
        "{text}"
    );
    let (has_table, text) = findings(
        |rows| {
            let index = first_row(rows);
            rows[index + 3].raw.accelerometers.positive_pulses[2] += 60;
        },
        |_| {},
        &[],
    );
    assert!(has_table && text.contains("set point 40 degC, position 7: A3 was not still"), "{text}");
    let swap = |rows: &mut Vec<SimulatedRow>| {
        for row in rows.iter_mut().filter(|row| row.set_point_c == -20.0) {
            row.position = [0, 1, 2, 3, 4, 7, 8, 5, 6, 9, 10, 11, 12][row.position as usize];
        }
    };
    let (has_table, text) = findings(swap, |_| {}, &[]);
    assert!(!has_table && text.contains("set point -20 degC, position 7: A1 indicates 1.0"), "{text}");
    let clip = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().for_each(|row| {
            row.raw.accelerometers.positive_pulses[2] = row.raw.accelerometers.positive_pulses[2].min(920_000);
        });
    };
    let (has_table, text) = findings(clip, |_| {}, &[]);
    assert!(!has_table && text.contains("the + channel of A3 gives the same 92000 pulse/s in every row"), "{text}");
    let (has_table, text) = findings(|_| {}, |file| file.max_rate = Some(90_000.0), &[]);
    assert!(!has_table && text.contains("A1 counts 9") && text.contains("saturated"), "{text}");
}

#[test]
fn time_soak_and_temperature_are_checked() {
    let (has_table, text) = findings(|rows| rows[700].raw.timestamp_ns = rows[699].raw.timestamp_ns, |_| {}, &[]);
    assert!(!has_table && text.contains("line 702: ") && text.contains("time must rise"), "{text}");
    let (has_table, text) = findings(|rows| rows[1].raw.interval_ns *= 10, |_| {}, &[]);
    assert!(!has_table && text.contains("Some(3) set point -20 degC, position 1: A3 was not still"), "{text}");
    let (has_table, text) = findings(|rows| rows.iter_mut().for_each(|row| row.raw.interval_ns *= 100), |_| {}, &[]);
    assert!(!has_table && text.contains("line 1002: ") && text.contains("pulses would be counted twice"), "{text}");
    let (has_table, text) = findings(|rows| rows[5].raw.accelerometers.board_temperature[1] = f64::NAN, |_| {}, &[]);
    assert!(!has_table && text.contains("line 7: set point -20 degC, position 1: a2_board is NaN"), "{text}");
    let (has_table, text) = findings(|rows| rows[5].raw.accelerometers.head_temperature[2] = 0.0, |_| {}, &[]);
    assert!(!has_table && text.contains("Some(7) set point -20 degC, position 1: a3_head runs from 0 to"), "{text}");
    let (has_table, text) =
        findings(|rows| rows.iter_mut().for_each(|row| row.raw.accelerometers.head_temperature[2] = 2.5), |_| {}, &[]);
    assert!(!has_table && text.contains("a3_head is the same at every set point"), "{text}");
    let (has_table, text) = findings(|_| {}, |file| file.soak_s = Some(5000.0), &[]);
    assert!(!has_table && text.contains("set point -10 degC: its first dwell begins 4260 s after"), "{text}");
    // Rows every 10 s with intervals of 9 s or 11 s: every scale factor would be wrong by 10 %.
    for (interval_ns, ratio) in [(9_000_000_000, "0.9000"), (11_000_000_000, "1.1000")] {
        let (has_table, text) = all_findings(|rows| rows.iter_mut().for_each(|row| row.raw.interval_ns = interval_ns));
        let right = format!("interval_ns is {ratio} of the time from row to row in all dwells");
        assert!(!has_table && text.contains(&right) && text.contains("every scale factor would be wrong"), "{text}");
    }
    let dead = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut()
            .filter(|row| row.set_point_c >= 20.0)
            .for_each(|row| row.raw.accelerometers.head_temperature[0] = 2.9);
    };
    let (has_table, text) = findings(dead, |_| {}, &[]);
    assert!(
        !has_table && text.contains("set point 30 degC, position 1: a1_head does not move from the set point before"),
        "{text}"
    );
    let (has_table, text) = findings(|rows| rows.truncate(rows.len() - 20), |_| {}, &[]);
    assert!(has_table && text.contains("set point 40 degC, position 12: 100.0 s only"), "{text}");
    let sooner = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut().filter(|row| row.set_point_c > -20.0).for_each(|row| row.raw.timestamp_ns -= 2_000_000_000_000);
    };
    let (has_table, text) = findings(sooner, |_| {}, &[]);
    assert!(has_table && text.contains("set point -10 degC: its first dwell begins 2260 s after"), "{text}");
}

/// Calibrates a changed campaign with `options`.
pub(crate) fn with_rows(
    change_rows: impl Fn(&mut Vec<SimulatedRow>),
    options: CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let truth = truth(TILT_RAD, 9.8015);
    let set_points_c = (-2..=4).map(|k| 10.0 * f64::from(k)).collect();
    let schedule = CampaignSchedule { set_points_c, noise: quiet(), ..CampaignSchedule::default() };
    let mut rows: Vec<SimulatedRow> = campaign(&truth, &schedule, 1).collect();
    change_rows(&mut rows);
    let file = campaign_file(&truth, &schedule);
    let row = |(line, row): (u64, SimulatedRow)| {
        Ok(CampaignRow { line, set_point_c: row.set_point_c, position: Some(row.position), sample: row.raw })
    };
    let dwells = read_dwells(&file, (2..).zip(rows).map(row)).unwrap();
    calibrate_accelerometers(&file, dwells, CalibrationOptions { order: Some(3), ..options })
}

/// The findings about the whole campaign, by name, with `options`.
fn names(change_rows: impl Fn(&mut Vec<SimulatedRow>), options: CalibrationOptions) -> (bool, Vec<&'static str>) {
    let whole = |findings: &[Finding]| findings.iter().filter(|f| f.place.is_none()).map(|f| f.name).collect();
    match with_rows(change_rows, options) {
        Ok(calibration) => (true, whole(&calibration.findings)),
        Err(CalibrationError::Faults { diagnosis, findings }) => {
            let diagnosis = diagnosis.map(|diagnosis| diagnosis.finding.name);
            (false, diagnosis.into_iter().chain(whole(&findings)).collect())
        }
        Err(error) => panic!("{error}"),
    }
}

/// The names that a table's provenance has, and the gate sees.
fn accepted(change_rows: &dyn Fn(&mut Vec<SimulatedRow>), options: CalibrationOptions) -> Vec<&'static str> {
    let calibration = with_rows(change_rows, options).unwrap();
    let texts: Vec<_> = calibration.findings.iter().filter(|finding| finding.message.contains("; accepted")).collect();
    assert!(texts.iter().all(|finding| finding.message.matches("; accepted").count() == 1), "{texts:?}");
    calibration.accepted
}

#[test]
fn only_consecutive_rows_tell_the_interval() {
    let check = |change: &dyn Fn(&mut Vec<SimulatedRow>)| names(change, CalibrationOptions::default());
    let each = |rows: &mut Vec<SimulatedRow>, change: &dyn Fn(&mut SimulatedRow)| rows.iter_mut().for_each(change);
    // A row in four is lost: what is left is right.
    let lost = |rows: &mut Vec<SimulatedRow>| rows.retain(|row| row.raw.sequence % 4 != 2);
    assert_eq!(check(&lost), (true, vec![name::MISSING_ROWS]));
    // Every third sample was kept; every row is the sum of a hundred samples.
    let thin = |rows: &mut Vec<SimulatedRow>| rows.retain(|row| row.raw.sequence % 3 == 0);
    assert_eq!(check(&thin), (true, vec![name::MISSING_ROWS]));
    let sums = |rows: &mut Vec<SimulatedRow>| each(rows, &|row| row.raw.sequence *= 100);
    assert_eq!(check(&sums), (true, vec![]));
    // In sums too, a device's factor is no gap.
    let sums_in_us = |rows: &mut Vec<SimulatedRow>| {
        each(rows, &|row| {
            (row.raw.sequence, row.raw.interval_ns) = (row.raw.sequence * 100, row.raw.interval_ns / 1000);
        });
    };
    assert_eq!(check(&sums_in_us), (false, vec![name::INTERVAL]));
    // The acquisition was started again in the middle of each dwell.
    let restarted = |rows: &mut Vec<SimulatedRow>| {
        each(rows, &|row| (row.raw.session, row.raw.sequence) = (row.raw.sequence / 15, row.raw.sequence % 15));
    };
    assert_eq!(check(&restarted), (true, vec![]));
    // Timestamps that jitter by 3 % of the interval.
    let jitter = |rows: &mut Vec<SimulatedRow>| {
        each(rows, &|row| row.raw.timestamp_ns += row.raw.sequence.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 35);
    };
    assert_eq!(check(&jitter), (true, vec![]));
}

#[test]
fn faults_are_accepted_by_name_and_warnings_are_faults_on_request() {
    let short = |rows: &mut Vec<SimulatedRow>| rows.iter_mut().for_each(|row| row.raw.interval_ns = 9_000_000_000);
    let lost = |rows: &mut Vec<SimulatedRow>| rows.retain(|row| row.raw.sequence % 4 != 2);
    let accept =
        |accept: &[&'static str]| CalibrationOptions { accept: accept.to_vec(), ..CalibrationOptions::default() };
    let strict = |accept: &[&'static str]| CalibrationOptions {
        accept: accept.to_vec(),
        strict: true,
        ..CalibrationOptions::default()
    };
    assert!(!names(short, accept(&[])).0 && !names(short, accept(&[name::SOAK])).0);
    assert_eq!(names(short, accept(&[name::INTERVAL])), (true, vec![name::INTERVAL]));
    assert!(names(lost, accept(&[])).0 && !names(lost, strict(&[])).0);
    assert!(names(lost, strict(&[name::MISSING_ROWS])).0 && names(|_| {}, strict(&[])).0);
    // What strict made a fault is accepted by name, whether it was found before the fit or after it. Without strict
    // there was no fault.
    let bump = |rows: &mut Vec<SimulatedRow>| {
        rows.iter_mut()
            .filter(|row| is_at(row, 0.0, 9))
            .for_each(|row| row.raw.accelerometers.positive_pulses[1] += 40);
    };
    for (change, name) in [(&lost as &dyn Fn(&mut Vec<SimulatedRow>), name::MISSING_ROWS), (&bump, name::OUTLIER)] {
        assert_eq!(accepted(change, strict(&[name])), [name]);
        assert_eq!(accepted(change, accept(&[name])), [""; 0]);
    }
    assert!(!names(bump, strict(&[])).0);
    // An accepted diagnosis that is one of the findings is one warning, with its name.
    assert_eq!(accepted(&short, strict(&[name::INTERVAL])), [name::INTERVAL]);
    // A diagnosis is a fault like others: its symptoms cannot be accepted without it.
    let exchange = |rows: &mut Vec<SimulatedRow>| {
        for row in rows.iter_mut().filter(|row| [3, 9].contains(&row.position)) {
            row.position = 12 - row.position;
        }
    };
    assert!(!names(exchange, accept(&[name::WRONG_POSITION])).0);
}

#[test]
fn dead_channels_are_one_line_with_the_remedy() {
    let dead = |channels: &'static [(usize, bool)]| {
        let error = with_rows(
            |rows| {
                for SimulatedRow { raw, .. } in rows {
                    for &(axis, positive) in channels {
                        let pulses = if positive {
                            &mut raw.accelerometers.positive_pulses
                        } else {
                            &mut raw.accelerometers.negative_pulses
                        };
                        pulses[axis] = 0;
                    }
                }
            },
            CalibrationOptions::default(),
        );
        let lines = error.unwrap_err().lines(false, |finding| finding.tagged(|line| line.to_string()));
        assert!(lines.len() == 2 && lines[1].starts_with("... and "), "{lines:?}");
        lines[0].clone()
    };
    for (channels, expected) in [
        (
            &[(0, true), (0, false), (2, true), (2, false)][..],
            "A1 and A3 give no pulse in the whole campaign: fix what",
        ),
        (&[(0, true), (0, false), (1, true), (1, false), (2, true), (2, false)], "A1, A2 and A3 give no pulse"),
        (&[(0, true), (1, false)], "the + channel of A1 and the - channel of A2 give no pulse"),
        (&[(0, true), (1, true), (2, false)], "the + channel of A1, the + channel of A2 and the - channel of A3 give"),
        (&[(1, false), (2, true), (2, false)], "the - channel of A2 and A3 give no pulse"),
        (&[(1, true), (1, false)], "A2 gives no pulse"),
        (&[(0, false), (1, false), (2, false)], "no accelerometer gives a pulse on its - channel"),
    ] {
        let line = dead(channels);
        assert!(line.starts_with("fault [no-pulses]: ") && line.contains(expected), "{line}");
    }
}

#[test]
fn names_of_findings_are_unique_and_explained() {
    let mut names: Vec<_> = name::explanations().map(|known| known.name).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
    // A constant cannot be declared without an explanation. A name that is no constant could be given to a finding.
    let mut folders = vec![PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/src"))];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = fs::read_to_string(&path).unwrap();
            let literal =
                ["Severity::Fault, \"", "Severity::Warning, \"", "warning(\""].iter().any(|it| text.contains(it));
            assert!(!literal, "{}: a finding whose name is no constant", path.display());
        }
    }
    for known in name::explanations() {
        let [meaning, remedy] = [known.meaning, known.remedy];
        assert!(meaning.ends_with('.') && remedy.ends_with('.'), "{known:?}");
        assert_eq!(name::acceptable(known.name).is_err(), known.rank == name::Rank::Final, "{known:?}");
    }
    assert_eq!(name::acceptable("position-off"), Ok(name::POSITION_OFF));
    assert!(name::acceptable("missing-position").unwrap_err().contains("with `--exclude"));
    assert!(name::acceptable("").unwrap_err().contains("position-off"));
}

#[test]
fn too_few_set_points_for_an_order_are_refused() {
    let truth = truth(TILT_RAD, 9.8015);
    let schedule =
        CampaignSchedule { set_points_c: vec![0.0, 20.0], ..noiseless(Scheme::SixFacesTwoHeadings.positions()) };
    let refused =
        calibrated(&truth, &schedule, 1, CalibrationOptions { order: Some(3), ..CalibrationOptions::default() })
            .unwrap_err();
    assert!(refused.to_string().contains("order 3 needs 4 different values of x, there are 2"), "{refused}");
    let (_, line) =
        calibrated(&truth, &schedule, 1, CalibrationOptions { order: Some(1), ..CalibrationOptions::default() })
            .unwrap();
    // Two set points determine a line, but not its error.
    assert_eq!(line.solution.axes[0].curves[0].standard_error(2.0), None);
}

#[test]
fn campaign_files_are_refused_with_line_and_key() {
    let good = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    assert!(Campaign::from_toml(&good).is_ok());
    for (from, to, expected) in [
        ("format = 1", "format = 2", "line 1: format: unknown"),
        ("gravity_local = 9.8015", "gravity_local = 98.0", "gravity_local: is 98.0, give 9.7 to 9.9"),
        ("number = 2", "number = 1", "position.2.number: 1 is there twice"),
        ("[0, 0, -1]", "[0, 0, -9.8]", "position.3.specific_force: give the direction"),
        ("[0, 0, -1]", "[0, -1]", "position.3.specific_force: give the direction"),
        ("outer_deg = 0\n", "", "position.1: give both outer_deg and inner_deg, or neither"),
        (
            "outer_deg = 0\n",
            "outer_deg = 1\n",
            "position: the angles of position 1 do not fit its specific_force, which differs by 1.00 degrees from [0.00000, 0.01745, 0.99985]",
        ),
        ("imu = \"imu-paper\"", "imu = \"IMU\"", "line 2: imu: is \"IMU\", give 1 to 32"),
        ("temperature_unit", "temprature_unit", "temprature_unit: unknown key"),
        ("samples = \"samples.csv\"", "", "samples: missing"),
    ] {
        let faults = Campaign::from_toml(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(faults.contains(expected), "{from} -> {to}: {faults}");
    }
    let angle = |line: &&str| !line.starts_with("outer_deg") && !line.starts_with("inner_deg");
    let without_angles: String = good.lines().filter(angle).map(|line| format!("{line}\n")).collect();
    // The angles are sufficient. A direction may be given with few digits; it is normalised.
    let angles = good.replace("specific_force", "# specific_force");
    assert_eq!(Campaign::from_toml(&angles).unwrap().positions, Campaign::from_toml(&good).unwrap().positions);
    let edge =
        without_angles.replacen("[0, 0, 1] ", "[0, 0.7071, 0.7071] ", 1).replacen("up = \"+z\"", "up = \"y and z\"", 1);
    let edge = Campaign::from_toml(&edge).unwrap().positions[0].specific_force;
    assert!((edge[1] - 0.5_f64.sqrt()).abs() < 1e-15);
}
