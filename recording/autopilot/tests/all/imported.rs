//! Import: what a table has, and files that are broken.

use crate::common::{FULL_PARAMS, FULL_PARM, import_options, imported, subtracted};
use isotherm_autopilot::{Autopilot, ImportError, ImportOptions, import};
use isotherm_shared::compensate::answer;
use isotherm_shared::document::Fault;
use isotherm_shared::readings::{Readings, Resolution};
use isotherm_shared::table::{CoefficientTable, OutOfRange};
use isotherm_shared::units::BiasUnit;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::Failure;

#[test]
fn the_table_is_nominal_with_biases() {
    let table = imported(FULL_PARAMS, Autopilot::Px4);
    let content = table.content();
    assert_eq!((content.temperature_unit.as_str(), content.out_of_range), ("degC", OutOfRange::Clamp));
    assert_eq!((content.gravity, content.imu.as_str()), (9.80665, "imu-a"));
    let a1 = &content.axes[0];
    let range = [-17.603_062_f32, 73.966_79].map(f64::from);
    assert_eq!((a1.bias_unit, a1.bias.range()), (BiasUnit::MicroG0, range));
    assert_eq!(a1.positive_scale_factor.coefficients(), [9.80665 / (1e-6 * 0.0025)]);
    assert_eq!(content.gyroscopes.as_ref().unwrap().axes[2].bias_unit, BiasUnit::DegreePerHour);
    assert!(!table.is_nominal());
    // The file of the table reads back to it.
    assert_eq!(CoefficientTable::from_toml(&table.to_toml(), None).unwrap(), table);
}

#[test]
fn readings_come_out_as_the_firmware_corrects_them() {
    let table = imported(FULL_PARAMS, Autopilot::Px4);
    let mut readings = Readings::new(Resolution::default(), 2_500_000);
    let mut raw = RawSample::default();
    let [force, rate] = [[0.3, -0.2, 9.9], [0.01, 0.02, -0.03]];
    readings.fill(&mut raw, force, Some(rate)).unwrap();
    for triad in [&mut raw.accelerometers, &mut raw.gyroscopes] {
        triad.head_temperature = [12.5; 3];
        triad.board_temperature = [12.5; 3];
    }
    let increment = answer(Some(&table), &raw);
    assert_eq!(increment.flags, 0);
    let [biases, drifts] = subtracted(&table, 12.5);
    for axis in 0..3 {
        assert!((increment.specific_force()[axis] - (force[axis] - biases[axis])).abs() < 6e-7);
        assert!((increment.angular_rate()[axis] - (rate[axis] - drifts[axis])).abs() < 6e-8);
    }
}

#[test]
fn the_constants_of_ardupilot_are_in_the_biases() {
    let constants = "INS_ACC1_CALTEMP 25\nINS_ACCOFFS_X 0.5\nINS_ACCOFFS_Y -0.25\nINS_ACCOFFS_Z 0.125\n";
    let table = imported(&(FULL_PARM.to_owned() + constants), Autopilot::ArduPilot);
    let [accelerometers, gyroscopes] = subtracted(&table, 25.0);
    for (found, right) in accelerometers.into_iter().zip([0.5, -0.25, 0.125]) {
        assert!((found - right).abs() < 1e-12, "{found} {right}");
    }
    // Without constants: 0 at 35 degC.
    assert!(gyroscopes.iter().all(|rate| rate.abs() > 1e-6));
    assert!(subtracted(&table, 35.0)[1].iter().all(|rate| rate.abs() < 1e-12));
}

#[test]
fn files_of_ground_stations_are_read() {
    let right = imported(FULL_PARM, Autopilot::ArduPilot);
    let commas = FULL_PARM.replace(' ', ",").replace('\n', " # why\r\n");
    let commas = format!("\u{feff}# a comment\r\n\r\nFRAME_CLASS,1\r\n{commas}");
    assert_eq!(imported(&commas, Autopilot::ArduPilot), right);
    let line = |line: &str| {
        let kind = if line.contains("ENABLE") { 2 } else { 9 };
        format!("1\t1\t{}\t{kind}\n", line.replace(' ', "\t"))
    };
    assert_eq!(imported(&FULL_PARM.lines().map(line).collect::<String>(), Autopilot::ArduPilot), right);
}

#[test]
fn what_concerns_no_imu_is_passed_over_and_what_does_is_understood() {
    let right = imported(FULL_PARM, Autopilot::ArduPilot);
    let others = "// our vehicle\nRC6_OPTION 212 // roll\n@include ../base.parm\n@delete RC7_OPTION\nFRAME_CLASS 1.0 0.0\n\
                  one two three four\n\u{0}\u{1} 1 2 3\nSERIAL_PASS 0xFF\n";
    let of_lines = |line: &dyn Fn(&str) -> String| FULL_PARM.lines().map(line).collect::<String>();
    for text in [
        others.to_owned() + FULL_PARM,
        of_lines(&|line| format!("{line} @READONLY\n")),
        of_lines(&|line| format!("{line} 0.000000 // what it was\n")),
        of_lines(&|line| format!("{}\r\n", line.replace(' ', "="))),
        of_lines(&|line| format!("{}  # Reason: tempcal, 5 % = less\n", line.replace(' ', " = "))),
        of_lines(&|line| format!("  {}\n", line.replace(' ', "\t , "))),
        FULL_PARM.replace("ENABLE 1", "ENABLE 0x1"),
    ] {
        assert_eq!(imported(&text, Autopilot::ArduPilot), right, "{text}");
    }
    let right = imported(FULL_PARAMS, Autopilot::Px4);
    let fields = |line: &str| line.split('\t').map(str::to_owned).collect::<Vec<_>>();
    let rows = FULL_PARAMS.lines().map(fields).filter(|fields| fields.len() == 5);
    let shown = |(at, fields): (usize, Vec<String>)| format!("x + {} [{at},{}] : {}\n", fields[2], at + 300, fields[3]);
    let shown: String = rows.enumerate().map(shown).collect();
    assert_eq!(imported(&format!("Symbols: x = used, + = saved\n{shown}"), Autopilot::Px4), right);
    assert_eq!(imported(&FULL_PARAMS.replace("\t3014666\t", "\t0x2E000A\t"), Autopilot::Px4), right);
}

#[test]
fn scale_factors_of_an_older_px4_are_refused_by_name() {
    let with = |instance: u8, factor: &str| format!("{FULL_PARAMS}1\t1\tTC_G{instance}_SCL_1\t{factor}\t9\n");
    let line = FULL_PARAMS.lines().count() + 1;
    is_refused(&with(0, "0.97"), Autopilot::Px4, (line, "TC_G0_SCL_1", "is 0.97: an older PX4 multiplies"));
    let right = imported(FULL_PARAMS, Autopilot::Px4);
    for neutral in [with(0, "1.0"), with(1, "0.97")] {
        assert_eq!(imported(&neutral, Autopilot::Px4), right);
    }
}

/// The faults of a text.
fn faults(text: &str, options: &ImportOptions) -> Vec<Fault> {
    match import(text, options).unwrap_err() {
        ImportError::Text(faults) => faults.0,
        other => panic!("{other}"),
    }
}

/// Checks that a text has a fault in this line, of this key, that says this.
fn is_refused(text: &str, autopilot: Autopilot, (line, key, said): (usize, &str, &str)) {
    let found = faults(text, &import_options(autopilot));
    let right = |fault: &Fault| fault.line == line && fault.key == key && fault.message.contains(said);
    assert!(found.iter().any(right), "line {line}: {key}: {said}\n{found:?}");
}

#[test]
fn a_broken_file_of_px4_is_refused_with_line_and_key() {
    let line = "1\t1\tTC_A0_X1_2\t-0.0022110650945116393\t9\n";
    let value = |value: &str| FULL_PARAMS.replace("-0.0022110650945116393", value);
    let device = |value: &str| FULL_PARAMS.replace("3014666", value);
    let more = |line: &str| format!("{FULL_PARAMS}1\t1\t{line}\n");
    let count = FULL_PARAMS.lines().count();
    for (text, fault) in [
        (FULL_PARAMS.replace(line, ""), (4, "TC_A0_X1_2", "missing")),
        (value("nan"), (17, "TC_A0_X1_2", "\"nan\", give a finite number")),
        (value("1e39"), (17, "TC_A0_X1_2", "give a finite number")),
        (value("0,5"), (17, "", "is not a parameter")),
        (FULL_PARAMS.replace(line, &line.replace("\t9", "\t6")), (17, "TC_A0_X1_2", "the type \"6\"; give 9")),
        (device("3014666.5"), (4, "TC_A0_ID", "give a whole number")),
        (FULL_PARAMS.replace("3014666\t6", "3014666\t9"), (4, "TC_A0_ID", "the type \"9\"; give a whole number")),
        (device("0"), (4, "TC_A0_ID", "is 0: the instance is not used")),
        (more("TC_A0_TREF\t28\t9"), (count + 1, "TC_A0_TREF", "stands in line 7 too")),
        (more("TC_A_ENABLE\t0\t6"), (count + 1, "TC_A_ENABLE", "PX4 does not use")),
        (FULL_PARAMS.replacen("73.96679", "-17.7", 1), (6, "TC_A0_TMAX", "is not over TC_A0_TMIN")),
        (FULL_PARAMS.replace("-0.12027692294953742", "9.9"), (16, "TC_A0_X0_2", "the bias of A3 is")),
        (FULL_PARM.to_owned(), (1, "TC_A0_ID", "the file has not this instance")),
        (String::new(), (1, "TC_A0_ID", "the file has not this instance")),
    ] {
        is_refused(&text, Autopilot::Px4, fault);
    }
}

#[test]
fn a_broken_file_of_ardupilot_is_refused_with_line_and_key() {
    let more = |lines: &str| FULL_PARM.to_owned() + lines;
    let constants = "INS_ACC1_CALTEMP 25\nINS_ACCOFFS_X 0.5\nINS_ACCOFFS_Y 0.5\n";
    for (text, fault) in [
        (FULL_PARAMS.to_owned(), (1, "INS_TCAL1_ACC1_X", "the file has not this instance")),
        (FULL_PARM.replace("INS_TCAL1_GYR2_Y 5.229238668\n", ""), (2, "INS_TCAL1_GYR2_Y", "missing")),
        (FULL_PARM.replace("5.229238668", "inf"), (17, "INS_TCAL1_GYR2_Y", "give a finite number")),
        (FULL_PARM.replace("ENABLE 1", "ENABLE 2"), (1, "INS_TCAL1_ENABLE", "or still learns them")),
        (FULL_PARM.replace("TMAX 73.9", "TMAX -20"), (3, "INS_TCAL1_TMAX", "is not over INS_TCAL1_TMIN")),
        (more(constants), (22, "INS_ACCOFFS_Z", "missing")),
        (more("INS_GYROFFS_Y 0.1\n"), (22, "INS_GYR1_CALTEMP", "missing")),
        (more("INS_TCAL1_GYR1_X\n"), (22, "", "is not a parameter")),
        (more("@delete INS_TCAL1_ENABLE\n"), (22, "", "is not a parameter")),
        (more("INS_TCAL1_ACC1_X 1 2 3\n"), (22, "", "is not a parameter")),
        (more("INS_TCAL1_ACC1_X 1 twice\n"), (22, "", "is not a parameter")),
        ("@include base.parm\n".to_owned(), (1, "INS_TCAL1_ACC1_X", "line 1 includes another file")),
        (more("INS_GYR1_CALTEMP 25\n@include a.parm\n"), (22, "INS_GYROFFS_X", "line 23 includes another file")),
    ] {
        is_refused(&text, Autopilot::ArduPilot, fault);
    }
}

#[test]
fn all_faults_are_reported_together() {
    let text =
        FULL_PARM.replace("TMAX 73.9", "TMAX hot").replace("ACC1_X 1353", "ACC1_X x").replace("GYR3_Z", "GYR3_W");
    let found = faults(&text, &import_options(Autopilot::ArduPilot));
    let keys: Vec<_> = found.iter().map(|fault| (fault.line, fault.key.as_str())).collect();
    assert_eq!(keys, [(2, "INS_TCAL1_GYR3_Z"), (3, "INS_TCAL1_TMAX"), (4, "INS_TCAL1_ACC1_X")]);
    // A file of another kind is no list of a thousand faults.
    let found = faults(&"one two three\n".repeat(1000), &import_options(Autopilot::Px4));
    assert!(found.len() < 20, "{}", found.len());
}

#[test]
fn options_that_cannot_be_are_refused() {
    let options = import_options(Autopilot::Px4);
    for (options, said) in [
        (ImportOptions { instance: Some(4), ..options.clone() }, "the instance is 4; PX4 has 0 to 3"),
        (ImportOptions { interval_ns: 0, ..options.clone() }, "interval"),
        (ImportOptions { gravity: 0.98, ..options.clone() }, "imu.gravity: is 0.98"),
    ] {
        let error = import(FULL_PARAMS, &options).unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
        assert_eq!(Failure::from(error).exit as u8, 64);
    }
    // An instance that the file has, but does not use.
    let found = faults(FULL_PARAMS, &ImportOptions { instance: Some(1), ..options });
    assert_eq!((found[0].line, found[0].key.as_str()), (20, "TC_A1_ID"));
}

#[test]
fn any_text_is_survived() {
    for (autopilot, text) in [(Autopilot::Px4, FULL_PARAMS), (Autopilot::ArduPilot, FULL_PARM)] {
        for cut in (0..text.len()).step_by(23) {
            let mut other = text.to_owned();
            other.replace_range(cut..=cut, "\t-");
            for text in [&text[..cut], &text[cut..], &other] {
                let _ = import(text, &import_options(autopilot));
            }
        }
    }
}
