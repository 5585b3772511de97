//! `calibrate warm-up` on logs of autopilots, as a user types it.

use crate::common::{assert_page, folder, run};
use serde_json::Value;
use std::fs;

/// The heating of a real run, as ArduPilot logs it: 3500 rows.
const BIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../recording/formats/tests/data/autopilots/heating.BIN");

fn arguments<'a>(log: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["calibrate", "warm-up", log, "--imu", "imu-b", "-o", "imu-b.toml"], more].concat()
}

#[test]
fn one_command_leads_from_a_log_to_a_table_a_report_and_the_parameters_of_both_autopilots() {
    let folder = folder();
    let more = ["--report", "r.html", "--beside", "px4,ardupilot", "--export", "px4=i.params"];
    let more = [&more[..], &["--export", "ardupilot=i.parm", "--device-id", "3014666,3080202"]].concat();
    let (out, err) = run(folder.path(), 0, &arguments(BIN, &more));
    let lines: Vec<_> = err.lines().collect();
    assert!(
        out.is_empty() && lines[0].starts_with("isotherm: warning [one-direction]: no recordings heat and"),
        "{err}"
    );
    assert!(lines.contains(&"isotherm: the nominal interval is 0.1 s, found from the first 1000 rows; for recordings that belong together give it"), "{err}");
    assert!(err.contains("bias curves of order 3 from 1 recording at one attitude; their error is not known"), "{err}");
    assert!(err.contains("order 3, the autopilots' cubic") && err.contains("60 s behind their temperature"), "{err}");
    assert!(err.contains("parameters of PX4 in i.params; in float32 within "), "{err}");
    let page = folder.path().join("r.html");
    assert_page(&page, 17, &["Before and after", "ArduPilot", "1: heating", "SHA-256", "Error not known"]);
    let [params, parm] = ["i.params", "i.parm"].map(|name| fs::read_to_string(folder.path().join(name)).unwrap());
    // The report has the parameters, for a reader who has nothing else.
    let report = fs::read_to_string(&page).unwrap();
    for (name, start) in [("i.params", "%23%20"), ("i.parm", "INS_TCAL1_ENABLE%201%0A")] {
        let link = format!("<a download=\"{name}\" href=\"data:text/plain;charset=utf-8,{start}");
        assert!(report.contains(&link), "{link}");
    }
    assert!(params.contains("1\t1\tTC_A0_ID\t3014666\t6\n") && params.contains("TC_G0_X3_2\t"), "{params}");
    assert!(parm.starts_with("INS_TCAL1_ENABLE 1\n") && parm.contains("\nINS_TCAL1_GYR3_Z "), "{parm}");

    let (out, _) = run(folder.path(), 0, &["check", "imu-b.toml"]);
    assert!(out.contains("seal intact"), "{out}");
    // Its own rows are in its range, and have its interval.
    let (_, err) = run(folder.path(), 0, &["replay", "--table", "imu-b.toml", BIN, "-o", "increments.csv"]);
    assert!(err.ends_with("isotherm: 3500 increments, none flagged\n"), "{err}");
    // The parameters come back as a table with the same biases.
    let import = ["import", "i.params", "--from", "px4", "--imu", "imu-b", "--interval", "0.1", "-o", "back.toml"];
    run(folder.path(), 0, &import);
    run(
        folder.path(),
        0,
        &["export", "back.toml", "--to", "px4", "--device-id", "3014666,3080202", "-o", "again.params"],
    );
    assert_eq!(fs::read_to_string(folder.path().join("again.params")).unwrap(), params);
}

#[test]
fn a_recording_needs_a_nominal_table_and_then_gives_the_table_of_its_log() {
    let folder = folder();
    let (out, _) = run(folder.path(), 0, &arguments(BIN, &["--json"]));
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(document["method"], "one-attitude");
    assert_eq!(document["biases"][0]["unit"], "m/s2");
    assert_eq!(document["findings"][0]["name"], "one-direction");
    let convert = ["convert", BIN, "-o", "rows.csv", "--nominal", "nominal.toml", "--imu", "imu-b"];
    run(folder.path(), 0, &convert);
    let (_, err) = run(folder.path(), 65, &arguments("rows.csv", &[]));
    assert!(err.contains("a recording does not say what a pulse is") && err.contains("--nominal TABLE.toml"), "{err}");
    let (out, _) = run(folder.path(), 0, &arguments("rows.csv", &["--nominal", "nominal.toml", "--json"]));
    let of_rows: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(of_rows["digest"], document["digest"]);
    assert_eq!(of_rows["nominal_digest"], document["nominal_digest"]);
}

/// The table of a tumble has no gyroscopes and no interval: the readings have both.
#[test]
fn readings_complete_a_nominal_table() {
    let folder = folder();
    run(folder.path(), 0, &["convert", BIN, "-o", "rows.csv", "--nominal", "nominal.toml", "--imu", "imu-b"]);
    let nominal = fs::read_to_string(folder.path().join("nominal.toml")).unwrap();
    let accelerometers = nominal.split("[[gyroscope]]").next().unwrap().replace("format = 3", "format = 1");
    let kept =
        accelerometers.lines().filter(|line| !line.starts_with("digest") && !line.starts_with("nominal_interval"));
    fs::write(folder.path().join("tumble.toml"), kept.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    let (out, _) = run(folder.path(), 0, &arguments(BIN, &["--nominal", "nominal.toml", "--json"]));
    let whole: Value = serde_json::from_str(&out).unwrap();
    let (out, err) = run(folder.path(), 0, &arguments(BIN, &["--nominal", "tumble.toml", "--json"]));
    let completed: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(completed["digest"], whole["digest"]);
    assert!(err.contains("the nominal table has no gyroscopes: those of the readings' resolution are taken"), "{err}");
}

#[test]
fn what_is_wrong_stands_first() {
    let folder = folder();
    let first = |code, arguments: &[&str]| {
        let (_, err) = run(folder.path(), code, arguments);
        err.lines().next().unwrap().to_owned()
    };
    let line = first(65, &arguments(BIN, &["--interval", "0.2"]));
    assert!(line.contains("add up to") && line.contains("pulses would be counted twice"), "{line}");
    let line = first(65, &arguments(BIN, &["--interval", "0.01"]));
    assert!(line.contains("fault [interval]: ") && line.contains("rows of 0.01 s cover 10.0 % of the time"), "{line}");
    // Readings in g, of a text.
    run(folder.path(), 0, &["convert", BIN, "-o", "rows.csv", "--nominal", "nominal.toml", "--imu", "imu-b"]);
    let rows = fs::read_to_string(folder.path().join("rows.csv")).unwrap();
    // A part of the rows under another name.
    let part = rows.lines().enumerate().filter(|(row, _)| *row == 0 || *row > 700).map(|(_, line)| format!("{line}\n"));
    fs::write(folder.path().join("part.csv"), part.collect::<String>()).unwrap();
    let line = first(65, &arguments("rows.csv", &["part.csv", "--nominal", "nominal.toml"]));
    assert!(line.contains("fault [same-recording]: part.csv has rows of rows.csv"), "{line}");
    let net = |fields: &[&str], first: usize| {
        let count = |index: usize| fields[index].parse::<f64>().unwrap();
        (count(first) - count(first + 1)) / 9.80665e6
    };
    let header: Vec<_> = rows.lines().next().unwrap().split(',').collect();
    let at = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let columns = [at("timestamp_ns"), at("a1_positive"), at("a2_positive"), at("a3_positive"), at("a1_head")];
    let text: Vec<String> = rows
        .lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<_> = line.split(',').collect();
            let [x, y, z] = [1, 2, 3].map(|axis| net(&fields, columns[axis]));
            format!("{},{x},{y},{z},{}\n", fields[columns[0]], fields[columns[4]])
        })
        .collect();
    fs::write(folder.path().join("g.csv"), format!("t,x,y,z,c\n{}", text.concat())).unwrap();
    let mapping = |unit: &str| {
        let unit = if unit.is_empty() { String::new() } else { format!("unit = \"{unit}\"\n") };
        format!(
            "format = 1\n[time]\ncolumn = \"t\"\nunit = \"ns\"\ninterval_s = 0.1\n[accelerometer]\ncolumns = [\"x\", \"y\", \"z\"]\n\
             kind = \"reading\"\nresolution = 1e-7\n{unit}[temperature]\ncolumns = [\"c\"]\n"
        )
    };
    fs::write(folder.path().join("m.toml"), mapping("")).unwrap();
    let line = first(65, &arguments("g.csv", &["--mapping", "m.toml"]));
    assert!(
        line.contains("fault [not-gravity]: g.csv: 0.")
            && line.contains("the readings look like g, not m/s2: give accelerometer.unit = \"g\" in a mapping"),
        "{line}"
    );
    fs::write(folder.path().join("m.toml"), mapping("g")).unwrap();
    let line = first(0, &arguments("g.csv", &["--mapping", "m.toml"]));
    assert!(line.contains("[one-direction]"), "{line}");
}

#[test]
fn options_that_do_not_fit_are_refused() {
    let folder = folder();
    for (more, words) in [
        (&["--export", "mavlink=x"][..], "px4 or ardupilot"),
        (&["--export", "px4="], "give px4=FILE or ardupilot=FILE"),
        (&["--export", "px4=imu-b.toml"], "imu-b.toml"),
        (&["--method", "two-stage"], "unexpected argument '--method'"),
        (&["--scale-factor", "split"], "--scale-factor"),
        (&["--instance", "3"], "no IMU 3; choose one with --instance: 0"),
    ] {
        let (_, err) = run(folder.path(), 64, &arguments(BIN, more));
        assert!(err.contains(words), "{more:?}: {err}");
    }
    let (_, err) = run(folder.path(), 64, &["calibrate", "turntable", "x.toml", "-o", "t.toml", "--nominal", "n.toml"]);
    assert!(err.contains("unexpected argument '--nominal'"), "{err}");
    let campaign = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/campaign.toml");
    let (_, err) = run(folder.path(), 64, &arguments(campaign, &[]));
    assert!(err.contains("a campaign file; `isotherm calibrate turntable "), "{err}");
    // Nothing is left of them.
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Parameters that a log of the same run gave, by both firmwares' formulas, are judged on its rows.
#[test]
fn parameters_that_are_on_board_are_judged_beside_the_cubics() {
    let folder = folder();
    let export = ["--order", "3", "--export", "px4=i.params", "--export", "ardupilot=i.parm"];
    let more = [&export[..], &["--device-id", "3014666"]].concat();
    let (_, err) = run(folder.path(), 0, &arguments(BIN, &more));
    // The parameters have no lag, so none is a result.
    assert!(!err.contains("transients, rms") && err.contains("parameters of ArduPilot in i.parm"), "{err}");
    let wrong =
        fs::read_to_string(folder.path().join("i.parm")).unwrap().replace("INS_TCAL1_ACC1_X ", "INS_TCAL1_ACC1_X 9");
    fs::write(folder.path().join("worn.parm"), wrong).unwrap();
    let more = ["--order", "3", "--lag", "none", "--beside", "px4,i.params,i.parm,worn.parm", "--report", "r.html"];
    let (out, err) = run(folder.path(), 0, &[&arguments(BIN, &more)[..], &["--json"]].concat());
    assert!(err.is_empty() || !err.contains("transients, rms"), "{err}");
    let document: Value = serde_json::from_str(&out).unwrap();
    for bias in document["biases"].as_array().unwrap() {
        let left = |of: &Value| of["after"]["standard_deviation"].as_f64().unwrap();
        let beside = bias["beside"].as_array().unwrap();
        let names: Vec<_> = beside.iter().map(|it| it["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["PX4", "i.params", "i.parm", "worn.parm"]);
        for parameters in &beside[1..3] {
            // What float32 rounds.
            assert!((left(parameters) - left(bias)).abs() < 1e-3 * left(bias), "{bias}");
        }
        let is_worn = left(&beside[3]) > 10.0 * left(bias);
        assert_eq!(is_worn, bias["name"] == "A1", "{bias}");
    }
    assert_page(&folder.path().join("r.html"), 14, &["worn.parm", "i.params"]);
    let (_, err) = run(folder.path(), 0, &arguments(BIN, &["--beside", "worn.parm", "--order", "3"]));
    assert!(err.contains("\n    worn.parm  m/s2  "), "{err}");
    assert!(err.contains("transients, rms"), "{err}");
}

#[test]
fn what_cannot_be_shown_beside_is_refused() {
    let folder = folder();
    let (_, err) = run(folder.path(), 64, &arguments(BIN, &["--beside", "px5"]));
    assert!(err.contains("give px4 or ardupilot, or a file of parameters"), "{err}");
    fs::write(folder.path().join("none.parm"), "FRAME_CLASS 1\n").unwrap();
    let (_, err) = run(folder.path(), 78, &arguments(BIN, &["--beside", "none.parm"]));
    assert!(
        err.contains("none.parm: neither parameters of PX4") && !folder.path().join("imu-b.toml").exists(),
        "{err}"
    );
    let (_, err) = run(folder.path(), 78, &arguments(BIN, &["--beside", BIN]));
    assert!(err.contains("this is a log of ArduPilot (DataFlash); give the file of parameters"), "{err}");
    run(folder.path(), 74, &arguments(BIN, &["--beside", "missing.params"]));
    let (_, err) = run(folder.path(), 78, &arguments(BIN, &["--order", "0", "--export", "ardupilot=i.parm"]));
    assert!(err.contains("(order 0), so ArduPilot's parameters of the temperature would all be 0"), "{err}");
    assert!(!folder.path().join("i.parm").exists());
}
