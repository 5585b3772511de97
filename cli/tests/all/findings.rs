//! `--accept` and `--strict` of the commands that find something in recordings and tables.

use crate::common::{folder, run};
use serde_json::Value;
use std::fs;
use std::path::Path;

const TABLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/any_lab/compare");
/// Accelerations with a gap, and without a temperature.
const READINGS: &str = "t,x,y,z\n0.01,1,2,3\n0.02,1,2,3\n0.03,1,2,3\n0.07,1,2,3\n0.08,1,2,3\n0.09,1,2,3\n";
const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\nconstant = 25\n";

/// A warning is printed, is a fault with `--strict`, and with `--accept` only its name. The refusal as JSON has it.
fn is_judged(folder: &Path, command: &[&str], name: &str, json: bool) {
    let with = |code, more: &[&str]| run(folder, code, &[command, more].concat());
    let (_, told) = with(0, &[]);
    assert!(told.contains(&format!("isotherm: warning [{name}]: ")), "{told}");
    let (out, refused) = with(65, &["--strict"]);
    assert!(out.is_empty() && refused.contains(&format!("fault [{name}]: ")), "{out}{refused}");
    let (_, accepted) = with(0, &["--strict", "--accept", name]);
    assert!(accepted.contains(&format!("warning [{name}]: ")) && accepted.contains("; accepted"), "{accepted}");
    with(65, &["--strict", "--accept", "soak"]);
    let (_, unknown) = with(64, &["--accept", "no-such-name"]);
    assert!(unknown.contains("give the name of a finding"), "{unknown}");
    if json {
        let refused: Value = serde_json::from_str(&with(65, &["--strict", "--json"]).0).unwrap();
        let finding = &refused["findings"][0];
        assert_eq!((finding["name"].as_str(), finding["severity"].as_str()), (Some(name), Some("fault")), "{refused}");
        assert_eq!(refused["exit_code"], 65);
        let made: Value = serde_json::from_str(&with(0, &["--json"]).0).unwrap();
        assert_eq!(made["findings"][0]["name"], name, "{made}");
    }
}

#[test]
fn tables_in_the_wrong_order() {
    let folder = folder();
    for name in ["2023.toml", "2024.toml"] {
        fs::copy(format!("{TABLES}/{name}"), folder.path().join(name)).unwrap();
    }
    is_judged(folder.path(), &["compare", "2024.toml", "2023.toml"], "dates", true);
    run(folder.path(), 0, &["compare", "2023.toml", "2024.toml", "--strict"]);
}

#[test]
fn what_convert_refuses_leaves_no_file() {
    let folder = folder();
    fs::write(folder.path().join("readings.csv"), READINGS).unwrap();
    fs::write(folder.path().join("mapping.toml"), MAPPING).unwrap();
    let command = ["convert", "readings.csv", "--mapping", "mapping.toml", "-o", "run.csv"];
    let files = || fs::read_dir(folder.path()).unwrap().count();
    let strict = [&command[..], &["--strict"]].concat();
    let (_, refused) = run(folder.path(), 65, &strict);
    assert!(refused.contains("fault [missing-rows]: 1 gaps, 3 rows missing by the time"), "{refused}");
    assert_eq!(files(), 2, "neither the output nor a part of it");
    is_judged(folder.path(), &command, "missing-rows", false);
}

#[test]
fn lost_time_in_a_run() {
    let folder = folder();
    let simulate = ["simulate", "run", "-o", "run", "--temperatures", "20,20.3", "--ramp", "1", "--hold", "1"];
    run(folder.path(), 0, &[&simulate[..], &["--sensor-noise", "40", "--seed", "3"]].concat());
    let text = fs::read_to_string(folder.path().join("run/run.csv")).unwrap();
    // 5 s are lost without a hole in the sequence.
    let row = |(number, line): (usize, &str)| {
        let mut fields: Vec<_> = line.split(',').map(str::to_owned).collect();
        if number > 3000 {
            fields[1] = (fields[1].parse::<u64>().unwrap() + 5_000_000_000).to_string();
        }
        fields.join(",") + "\n"
    };
    fs::write(folder.path().join("lost.csv"), text.lines().enumerate().map(row).collect::<String>()).unwrap();
    let verify = ["verify", "--table", "run/truth.toml", "--window", "10", "lost.csv"];
    is_judged(folder.path(), &verify, "time-step", true);
    is_judged(folder.path(), &["noise", "--table", "run/truth.toml", "lost.csv"], "time-step", true);
}
