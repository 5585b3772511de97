//! `noise` as a user types it: text, document, report and Kalibr's file, and what is refused.

use crate::common::{assert_page, folder, run};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A recording of 18 minutes at rest in `night`, with its table; 40e-6 g0 of white noise, 1.1 to 1.2 counts a row.
fn recording(folder: &Path) {
    let simulate = ["simulate", "run", "-o", "night", "--temperatures", "20,20.3", "--ramp", "1", "--hold", "1"];
    run(folder, 0, &[&simulate[..], &["--sensor-noise", "40", "--seed", "3"]].concat());
}

const NOISE: [&str; 4] = ["noise", "night/run.csv", "--table", "night/truth.toml"];

fn document(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_str(&run(folder, 0, &[arguments, &["--json"]].concat()).0).unwrap()
}

fn white(sensor: &Value) -> (f64, [f64; 2]) {
    let coefficient = &sensor["model"]["coefficients"][1];
    assert_eq!(coefficient["letter"], "N");
    let range = &coefficient["range_in_unit"];
    (coefficient["value_in_unit"].as_f64().unwrap(), [0, 1].map(|end| range[end].as_f64().unwrap()))
}

#[test]
fn a_recording_at_rest() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    recording(folder.path());
    let (text, err) = run(folder.path(), 0, &[&NOISE[..], &["--report", "r.html", "--kalibr", "imu.yaml"]].concat());
    assert!(text.starts_with("rows 1 to 10820 of 10820, 0.0 s to 1082.0 s, one every 0.100000 s: "), "{text}");
    assert!(text.contains("velocity random walk") && text.contains("g0/sqrt(Hz)"), "{text}");
    assert_eq!(err, "");
    let with_table = document(folder.path(), &NOISE);
    assert_eq!((&with_table["first_row"], &with_table["last_row"]), (&1.into(), &10820.into()));
    for sensor in with_table["sensors"].as_array().unwrap() {
        let (value, [low, high]) = white(sensor);
        assert!((low..=high).contains(&40e-6) && (value / 40e-6 - 1.0).abs() < 0.05, "{sensor}");
        let [two, one] = ["two_sided_density", "one_sided_density"].map(|key| &sensor["model"][key]["value_in_unit"]);
        assert!((one.as_f64().unwrap() / two.as_f64().unwrap() - 2_f64.sqrt()).abs() < 1e-12, "{sensor}");
        let walk = &sensor["model"]["coefficients"][3];
        assert!(walk["below_in_unit"].is_number() && sensor["limit_cycle"] == false, "{walk}");
        let columns = ["tau_s", "adev_in_unit", "interval_in_unit", "degrees_of_freedom"];
        let lengths = columns.map(|key| sensor[key].as_array().unwrap().len());
        assert_eq!(lengths, [33; 4], "{sensor}");
        let last = &sensor["interval_in_unit"][32];
        assert!((6.0..30.0).contains(&(last[1].as_f64().unwrap() / last[0].as_f64().unwrap())), "{last}");
    }
    // Counts a second without a table: A1 has about 9e4 of them for 1 g0.
    let counts = document(folder.path(), &NOISE[..2]);
    let ratio = white(&counts["sensors"][0]).0 / white(&with_table["sensors"][0]).0;
    assert!(counts["sensors"][0]["unit"] == "pulse/s" && (8e4..1e5).contains(&ratio), "{ratio}");
    assert_page(&at("r.html"), 2, &["Floor of B, 0.664 B", "one-sided as in data sheets", "times apart"]);
    let yaml = fs::read_to_string(at("imu.yaml")).unwrap();
    for start in
        ["rostopic: ", "update_rate: 10.000000", "accelerometer_noise_density: 3.", "accelerometer_random_walk: "]
    {
        assert!(yaml.lines().any(|line| line.starts_with(start)), "{start}: {yaml}");
    }
    assert!(
        yaml.contains("# gyroscope_noise_density: not written, the recording or the table has no gyroscopes"),
        "{yaml}"
    );
    // A part of it.
    let part = document(folder.path(), &[&NOISE[..], &["--from", "100", "--to", "600.0"]].concat());
    assert_eq!((&part["first_row"], &part["last_row"], &part["rows"]), (&1001.into(), &6000.into(), &5000.into()));
    assert_eq!((&part["from_s"], &part["to_s"]), (&100.0.into(), &600.0.into()));
}

#[test]
fn times_that_are_a_thousand_times_too_short_are_no_noise() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    recording(folder.path());
    let text = fs::read_to_string(at("night/run.csv")).unwrap();
    let mut lines = text.lines();
    let header: Vec<_> = lines.next().unwrap().split(',').collect();
    let [time, interval] =
        ["timestamp_ns", "interval_ns"].map(|name| header.iter().position(|it| *it == name).unwrap());
    let mut fast = header.join(",") + "\n";
    for line in lines {
        let mut fields: Vec<_> = line.split(',').map(str::to_owned).collect();
        for field in [time, interval] {
            fields[field] = (fields[field].parse::<u64>().unwrap() / 1000).to_string();
        }
        fast += &(fields.join(",") + "\n");
    }
    fs::write(at("fast.csv"), fast).unwrap();
    let words = "[not-gravity]: fast.csv: 1000.0 g0 at rest";
    let table = ["--table", "night/truth.toml"];
    let (out, err) = run(folder.path(), 65, &[&["noise", "fast.csv", "--kalibr", "imu.yaml"], &table[..]].concat());
    assert!(out.is_empty() && err.contains(words) && !at("imu.yaml").exists(), "{err}");
    let (_, err) = run(folder.path(), 0, &[&["replay", "fast.csv", "-o", "i.csv"], &table[..]].concat());
    assert!(err.contains(words), "{err}");
    run(folder.path(), 65, &[&["replay", "fast.csv", "--strict", "-o", "j.csv"], &table[..]].concat());
    let (_, err) = run(folder.path(), 0, &[&["verify", "fast.csv", "--static-poses"], &table[..]].concat());
    assert!(err.contains(words), "{err}");
    // The right times.
    for command in [&["replay", "night/run.csv", "--strict", "-o", "k.csv"][..], &["verify", "night/run.csv"]] {
        let (_, err) = run(folder.path(), 0, &[command, &table[..]].concat());
        assert!(!err.contains("not-gravity"), "{err}");
    }
}

#[test]
fn what_is_refused() {
    let folder = folder();
    recording(folder.path());
    let refused = |code, more: &[&str]| run(folder.path(), code, &[&NOISE[..], more].concat()).1;
    let err = refused(65, &["--to", "50"]);
    let reason = "night/run.csv: the longest stretch without a gap, a movement, a new session or an output that is not a number has 500 rows, 1 to 500; \
                  at least 1000 rows are needed: record longer at rest";
    assert!(err.contains(reason), "{err}");
    assert!(refused(65, &["--from", "2000"]).contains("no row from "), "{err}");
    assert!(refused(64, &["--from", "5", "--to", "5"]).contains("--from is not before --to"));
    assert!(refused(64, &["--from", "-1"]).contains("give seconds since the begin"));
    refused(64, &["--report", "night/run.csv"]);
    refused(74, &["--report", "nowhere/r.html"]);
    let (_, err) = run(folder.path(), 64, &["noise", "night/run.csv", "--kalibr", "imu.yaml"]);
    assert!(err.contains("--table"), "{err}");
    run(folder.path(), 74, &["noise", "none.csv"]);
    run(folder.path(), 78, &["noise", "night/run.csv", "--table", "night/run.csv"]);
    let (out, _) = run(folder.path(), 65, &[&NOISE[..], &["--to", "50", "--json"]].concat());
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&document["exit_code"], &document["file"]), (&65.into(), &"night/run.csv".into()));
    // Nothing is written when nothing is found.
    refused(65, &["--to", "50", "--report", "r.html", "--kalibr", "imu.yaml"]);
    assert!(!folder.path().join("r.html").exists() && !folder.path().join("imu.yaml").exists());
}

/// A few lost rows leave the figures what they are; many make no file for Kalibr, and nothing is half written.
#[test]
fn lost_rows_are_bridged_up_to_a_part() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    recording(folder.path());
    let text = fs::read_to_string(at("night/run.csv")).unwrap();
    let without = |each: usize| {
        let kept = text.lines().enumerate().filter(|(line, _)| *line < 2 || line % each != 0);
        kept.map(|(_, line)| format!("{line}\n")).collect::<String>()
    };
    let lost = |name: &str, each: usize| fs::write(at(name), without(each)).unwrap();
    lost("few.csv", 100);
    lost("many.csv", 30);
    let table = ["--table", "night/truth.toml"];
    let outputs = ["--kalibr", "imu.yaml", "--report", "r.html"];
    let (out, err) = run(folder.path(), 0, &[&["noise", "few.csv"], &table[..], &outputs[..]].concat());
    let told = "108 rows are missing in 108 gaps, 1.00 % of the 10820 that are analysed; they are bridged";
    assert!(err.contains(&format!("warning [missing-rows]: few.csv: {told}")) && out.contains(told), "{err}{out}");
    assert!(at("imu.yaml").exists());
    assert_page(&at("r.html"), 2, &[told]);
    let few = document(folder.path(), &[&["noise", "few.csv"], &table[..]].concat());
    let whole = document(folder.path(), &NOISE);
    assert_eq!((&few["bridged"]["rows"], &whole["bridged"]["rows"]), (&108.into(), &0.into()));
    for (a, b) in few["sensors"].as_array().unwrap().iter().zip(whole["sensors"].as_array().unwrap()) {
        let [a, b] = [a, b].map(|sensor| white(sensor).0);
        assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    }
    fs::remove_file(at("imu.yaml")).unwrap();
    fs::remove_file(at("r.html")).unwrap();
    let (out, err) = run(folder.path(), 65, &[&["noise", "many.csv"], &table[..], &outputs[..]].concat());
    assert!(out.is_empty() && !at("imu.yaml").exists() && !at("r.html").exists(), "{out}");
    let why = "many.csv: no file for Kalibr is written, as its figures would be wrong: 360 rows are missing in 360 \
               gaps, 3.33 %";
    assert!(err.contains(why) && err.contains("look for what loses them, or take a part that has fewer"), "{err}");
    let (out, _) = run(folder.path(), 0, &[&["noise", "many.csv"], &table[..]].concat());
    assert!(out.contains("no file for Kalibr is written"), "{out}");
}

/// Readings in deg/s that are taken for rad/s are a fault, with a table and without.
#[test]
fn a_rate_that_no_gyroscope_has_at_rest_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let mut text = "t,ax,ay,az,gx,gy,gz\n".to_owned();
    for row in 0..3000_u64 {
        let noise = |axis: u64| ((row * (7 + axis) * 2_654_435_761) >> 13) as f64 % 1009.0 / 1009.0 - 0.5;
        text += &format!(
            "{:.2},{:.4},{:.4},{:.4}",
            row as f64 / 100.0,
            noise(0) / 50.0,
            noise(1) / 50.0,
            9.8 + noise(2) / 50.0
        );
        text += &format!(",{:.5},{:.5},{:.5}\n", -1.71 + noise(3) / 9.0, 0.3 + noise(4) / 9.0, noise(5) / 9.0);
    }
    fs::write(at("deg.csv"), text).unwrap();
    let mapping = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
        kind = \"reading\"\nresolution = 1e-4\n[gyroscope]\ncolumns = [\"gx\", \"gy\", \"gz\"]\nkind = \"reading\"\n\
        resolution = 1e-5\n[temperature]\nconstant = 25.0\n";
    fs::write(at("map.toml"), mapping).unwrap();
    let convert = ["convert", "deg.csv", "--mapping", "map.toml", "-o", "run.csv", "--nominal", "n.toml"];
    run(folder.path(), 0, &convert);
    let fault = "fault [rate-at-rest]: deg.csv: G1 is -97.9";
    let noise = ["noise", "deg.csv", "--mapping", "map.toml"];
    let with_table = [&noise[..], &["--table", "n.toml", "--kalibr", "imu.yaml"]].concat();
    for arguments in [&noise[..], &with_table] {
        let (out, err) = run(folder.path(), 65, arguments);
        assert!(out.is_empty() && err.contains(fault) && !at("imu.yaml").exists(), "{err}");
    }
    let (_, err) = run(folder.path(), 0, &[&with_table[..], &["--accept", "rate-at-rest"]].concat());
    assert!(err.contains("[rate-at-rest]") && at("imu.yaml").exists(), "{err}");
}
