//! `calibrate`, `regress`, `verify` and `simulate` as a user types them.
//!
//! Over 400 lines: one command's output is the next one's input.

use crate::common::{assert_self_contained, folder, other_device, run};
use serde_json::Value;
use std::os::unix::process::ExitStatusExt as _;
use std::process::Command;
use std::time::{Duration, Instant};
use std::{fs, thread};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// A row without pulses.
fn dead(header: &str, line: &str) -> String {
    let fields = header.split(',').zip(line.split(','));
    let zero = |name: &str| name.ends_with("_positive") || name.ends_with("_negative");
    fields.map(|(name, value)| if zero(name) { "0" } else { value }).collect::<Vec<_>>().join(",") + "\n"
}

/// A row whose temperature is not a number, but for the first 40 windows of 10 rows.
fn part(header: &str, row: usize, line: &str) -> String {
    let fields = header.split(',').zip(line.split(','));
    let lost = |name: &str| name == "a2_head" && row >= 400;
    fields.map(|(name, value)| if lost(name) { "nan" } else { value }).collect::<Vec<_>>().join(",") + "\n"
}

#[test]
fn the_closed_loop() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let simulate = ["simulate", "campaign", "-o", "campaign", "--seed", "5", "--vary"];
    run(folder.path(), 0, &simulate);
    run(folder.path(), 0, &["check", "campaign/campaign.toml", "campaign/truth.toml"]);
    let truth = fs::read_to_string(at("campaign/truth.toml")).unwrap();
    let gravity = truth.lines().find_map(|line| line.strip_prefix("gravity_local = ")).unwrap();
    let calibrate =
        ["calibrate", "turntable", "campaign/campaign.toml", "-o", "table.toml", "--report", "r.html", "--alignment"];
    let (out, err) = run(folder.path(), 0, &calibrate);
    assert!(out.is_empty() && err.contains("180 dwells at 15 set points, one-stage fit"), "{out}{err}");
    let (out, _) = run(folder.path(), 0, &["check", "table.toml"]);
    assert!(out.contains("seal intact"), "{out}");
    assert_self_contained(&at("r.html"), &["Error budget", "Order tables", "Dwell check list", "SHA-256"]);
    run(folder.path(), 0, &["simulate", "run", "-o", "run", "--seed", "5", "--vary", "--interval", "1"]);
    let verify = ["verify", "--table", "table.toml", "run/run.csv", "--attitude", "0.6,-0.48,0.64", "--gravity-local"];
    let verified = |more: &[&str], code| run(folder.path(), code, &[&verify[..], &[gravity], more].concat());
    let bounds = "10,bias=20ug0,scale=50ppm,level=5arcsec";
    let (out, _) = verified(&["--require", bounds, "--report", "v.html"], 0);
    let factors: Vec<f64> = ["A1", "A2", "A3"]
        .iter()
        .map(|axis| out.lines().find(|line| line.trim_start().starts_with(axis)).unwrap())
        .map(|line| line.split_whitespace().last().unwrap().parse().unwrap())
        .collect();
    println!("factors {factors:?}");
    assert!(factors.iter().all(|factor| *factor > 10.0), "{out}");
    assert!(out.contains("length: |output| minus local gravity, 1620 still windows"), "{out}");
    assert!(out.starts_with("all 1620 windows are judged\nLocal gravity "), "{out}");
    assert!(out.contains("\n  hysteresis band not judged: only one direction\n"), "{out}");
    assert!(
        out.contains("  covered: ") && out.contains("channels K+ of A1, K- of A2, K+ of A3; not judged beyond"),
        "{out}"
    );
    assert!(out.contains("intervals: of constant from slow changes of the run too"), "{out}");
    // Several --require are one.
    let (both, _) = verified(&["--require", "10", "--require", "bias=20\u{b5}g0"], 0);
    assert_eq!(both.matches("is required: met").count(), 2, "{both}");
    let (_, err) = verified(&["--require", "10", "--require", "12"], 64);
    assert!(err.contains("--require: factor is given twice"), "{err}");
    assert_eq!(out.matches("is required: met").count(), 4, "{out}");
    assert_self_contained(&at("v.html"), &["Requirement met", "Error budget"]);
    let (out, err) = verified(&["--require", "1e6,bias=0.1ug0"], 1);
    assert!(
        err.contains("is not met:\n  factor of stability: ")
            && err.ends_with("\nremedy: calibrate again, or look at the report\n"),
        "{err}"
    );
    assert!(err.contains("at least 1000000 is required: missed") && out.contains("Output stability"), "{err}");
    assert!(err.contains("at most 0.100 ug0 is required: missed"), "{err}");
    // If an output has the wrong magnitude for a body at rest, nothing is claimed, and it meets no requirement.
    let raw = fs::read_to_string(at("run/run.csv")).unwrap();
    let mut lines = raw.lines();
    let header = lines.next().unwrap();
    let dead: String = lines.map(|line| dead(header, line)).collect();
    fs::write(at("dead.csv"), format!("{header}\n{dead}")).unwrap();
    let dead = ["verify", "--table", "table.toml", "dead.csv", "--require", "1e-9"];
    let (out, err) = run(folder.path(), 0, &dead[..4]);
    assert!(err.contains("dead.csv: the output is 0.00") && err.contains("a dead converter"), "{err}");
    assert!(out.lines().last().unwrap().starts_with("Nothing can be claimed: the output is 0.00"), "{out}");
    let (out, err) = run(folder.path(), 1, &dead);
    assert!(
        err.starts_with(
            "isotherm: dead.csv: the requirement is not met:\n  Nothing can be claimed: the output is 0.00"
        ),
        "{err}"
    );
    assert_eq!(err.lines().count(), 3, "{err}");
    assert!(!out.contains(": met") && out.lines().last().unwrap().starts_with("Nothing can be claimed:"), "{out}");
    // Most of a run whose output is not a number: what is left of it meets no requirement.
    let part: String = raw.lines().skip(1).enumerate().map(|(row, line)| part(header, row, line)).collect();
    fs::write(at("part.csv"), format!("{header}\n{part}")).unwrap();
    let part =
        ["verify", "--table", "table.toml", "part.csv", "--attitude", "0.6,-0.48,0.64", "--require", "bias=20ug0"];
    let (out, err) = run(folder.path(), 0, &part[..6]);
    assert!(err.contains("part.csv: 1580 of 1620 windows are not at the attitude"), "{err}");
    assert!(out.lines().last().unwrap().starts_with("Nothing can be claimed: 1580 of 1620"), "{out}");
    assert!(
        out.starts_with("1580 of 1620 windows left out: in 1580 an output is not a number\n")
            && out.ends_with("; under half of the run is not enough to judge by.\n"),
        "{out}"
    );
    let (out, err) = run(folder.path(), 1, &part);
    assert!(err.contains("is not met:\n  Nothing can be claimed: 1580 of 1620 windows"), "{err}");
    assert!(out.contains(" ug0, at most 20.000 ug0 is required: not judged"), "{out}");
    // The first rows are at one temperature, and show nothing of the others. Fewer than 12 windows are not judged.
    let first =
        |rows: usize| fs::write(at("first.csv"), raw.lines().take(1 + rows).collect::<Vec<_>>().join("\n") + "\n");
    let arguments =
        ["verify", "--table", "table.toml", "first.csv", "--attitude", "0.6,-0.48,0.64", "--gravity-local", gravity];
    let required = [&arguments[..], &["--require", "bias=1mg0"]].concat();
    first(300).unwrap();
    let (out, err) = run(folder.path(), 1, &required);
    let covered = out.lines().find(|line| line.starts_with("  covered: ")).unwrap();
    assert!(covered.contains(" V of 1.") && covered.contains(" 2 %, the least;"), "{covered}");
    assert!(out.contains("is required: not shown over 1.") && err.contains("--accept not-covered"), "{out}{err}");
    let (out, _) = run(folder.path(), 0, &[&required[..], &["--accept", "not-covered"]].concat());
    assert!(out.contains("is required: met; not shown over 1."), "{out}");
    first(110).unwrap();
    let (out, err) = run(folder.path(), 1, &required);
    assert!(
        err.contains("  No requirement is judged by a run of 11 windows") && err.ends_with("\nremedy: record longer\n"),
        "{err}"
    );
    assert!(!out.contains(": met"), "{out}");
    // Another attitude than the stated one, and times that are a little off.
    let (_, err) = run(folder.path(), 65, &["verify", "--table", "table.toml", "run/run.csv", "--attitude", "0,0,1"]);
    assert!(
        err.contains(
            "this is another attitude than the one stated (--attitude, --angles), the table of another IMU, cables"
        ),
        "{err}"
    );
    first(1200).unwrap();
    let text = fs::read_to_string(at("first.csv")).unwrap().replace(",1000000000,", ",995000000,");
    fs::write(at("first.csv"), text).unwrap();
    let (_, err) = run(folder.path(), 0, &["verify", "--table", "table.toml", "first.csv"]);
    assert!(err.contains("warning [interval]: first.csv: interval_ns is 5000 ppm shorter than the time"), "{err}");
    // Too short for even three windows.
    let (_, err) = run(folder.path(), 65, &["verify", "--table", "run/truth.toml", "run/run.csv", "--window", "1e6"]);
    assert!(err.contains("windows of 1000000 s; at least 3 are needed"), "{err}");
}

#[test]
fn calibrate_reports_what_is_wrong_and_where() {
    let folder = folder();
    let campaign = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    let write = |campaign: &str, samples: &str| {
        fs::write(folder.path().join("campaign.toml"), campaign).unwrap();
        fs::write(folder.path().join("samples.csv"), samples).unwrap();
    };
    let refused = |code, more: &[&str]| {
        let (out, err) =
            run(folder.path(), code, &[&["calibrate", "turntable", "campaign.toml", "-o", "t.toml"], more].concat());
        assert!(out.is_empty() && !folder.path().join("t.toml").exists(), "{out}");
        err
    };
    write(&campaign, &samples);
    run(folder.path(), 0, &["calibrate", "turntable", "campaign.toml", "-o", "-"]);
    // No input is overwritten, and table and report must be different files.
    for more in [
        &["-o", "samples.csv"][..],
        &["-o", "campaign.toml"],
        &["-o", "./samples.csv"],
        &["-o", "t.toml", "--report", "samples.csv"],
        &["-o", "t.toml", "--report", "t.toml"],
        &["-o", "-", "--report", "-"],
    ] {
        run(folder.path(), 64, &[&["calibrate", "turntable", "campaign.toml"], more].concat());
    }
    assert!(fs::read_to_string(folder.path().join("samples.csv")).unwrap() == samples);
    // Either both files are written or none.
    run(folder.path(), 74, &["calibrate", "turntable", "campaign.toml", "-o", "t.toml", "--report", "nowhere/r.html"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    for wrong in [&["--order", "8"][..], &["--method", "magic"], &["--exclude", "5"], &["--exclude", "5/99"]] {
        refused(64, wrong);
    }
    write(&campaign.replace("gravity_local", "gravity_lokal"), &samples);
    assert!(refused(78, &[]).contains("campaign.toml:5: gravity_lokal: unknown key"));
    let turned = campaign.replacen("outer_deg = 0\n", "outer_deg = 0.5\n", 1);
    write(&turned, &samples);
    assert!(refused(78, &[]).contains("the angles of position 1 do not fit its specific_force"));
    let angle = |line: &&str| !line.starts_with("outer_deg") && !line.starts_with("inner_deg");
    let no_angles: String = campaign.lines().filter(angle).map(|line| format!("{line}\n")).collect();
    let no_up = no_angles.replace("[0, 0, 1]", "[0, 1, 0]").replace("up = \"+z\"", "up = \"+y\"");
    write(&no_up, &samples);
    let err = refused(78, &[]);
    assert!(err.contains("A3: K+ ") && err.contains("one with A3 pointing up"), "{err}");
    write(&campaign, &samples.replacen("\n-25,1,3,", "\n-25,one,3,", 1));
    let damaged = "samples.csv: 1 damaged place is left out; the first is line 5, behind row 3, ";
    let err = refused(65, &["--strict"]);
    assert!(err.contains(damaged) && err.contains("position is \"one\""), "{err}");
    let missing: String =
        samples.lines().filter(|line| !line.starts_with("5,8,")).map(|line| format!("{line}\n")).collect();
    write(&campaign, &missing);
    let err = refused(65, &[]);
    assert!(err.contains("set point 5 degC: position 8 of the campaign file is missing"), "{err}");
    let (_, err) =
        run(folder.path(), 0, &["calibrate", "turntable", "campaign.toml", "-o", "t.toml", "--exclude", "5/8"]);
    assert!(err.contains("179 dwells"), "{err}");
    assert!(fs::read_to_string(folder.path().join("t.toml")).unwrap().contains("excluded = [\"5/8\"]"));
    fs::remove_file(folder.path().join("samples.csv")).unwrap();
    run(folder.path(), 74, &["calibrate", "turntable", "campaign.toml", "-o", "t.toml"]);
}

#[test]
fn a_mistake_is_one_line_and_faults_can_be_accepted_by_name() {
    let folder = folder();
    let campaign = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    fs::write(folder.path().join("campaign.toml"), campaign).unwrap();
    let write = |samples: &str| fs::write(folder.path().join("samples.csv"), samples).unwrap();
    let calibrate = |code, more: &[&str]| {
        run(folder.path(), code, &[&["calibrate", "turntable", "campaign.toml", "-o", "t.toml"], more].concat()).1
    };
    write(&samples);
    calibrate(0, &["--strict"]);
    fs::remove_file(folder.path().join("t.toml")).unwrap();
    // Every row with its position exchanged.
    let exchange = |(index, line): (usize, &str)| {
        let mut fields: Vec<&str> = line.split(',').collect();
        if index > 0 {
            fields[1] = match fields[1] {
                "3" => "9",
                "9" => "3",
                other => other,
            };
        }
        fields.join(",") + "\n"
    };
    write(&samples.lines().enumerate().map(exchange).collect::<String>());
    let err = calibrate(65, &[]);
    let lines: Vec<_> = err.lines().collect();
    assert!(
        lines[0].contains("fault [positions-exchanged]: positions 3 and 9 look exchanged: exchange their numbers"),
        "{err}"
    );
    assert!(lines[1].ends_with("symptoms; with -v isotherm calibrate lists them") && lines.len() == 2, "{err}");
    let all = calibrate(65, &["-v"]);
    assert!(all.lines().next() == err.lines().next() && all.lines().count() > 20, "{all}");
    assert!(all.contains("fault [wrong-position]: ") && all.contains("samples.csv:"), "{all}");
    assert!(!folder.path().join("t.toml").exists());
    // The diagnosis is not enough: the last line has all that must be accepted.
    let err = calibrate(65, &["--accept", "positions-exchanged"]);
    assert!(err.lines().count() <= 12, "{err}");
    assert!(err.lines().last().unwrap().ends_with(": --accept positions-exchanged,wrong-position"), "{err}");
    // Rows of 10 s that state an interval of 9 s.
    write(&samples.replace(",10000000000,", ",9000000000,"));
    let err = calibrate(65, &[]);
    assert!(err.contains("fault [interval]: interval_ns is 0.9000 of the time from row to row in all dwells"), "{err}");
    let err = calibrate(0, &["--accept", "interval,soak", "--accept", "level"]);
    assert!(err.contains("warning [interval]: interval_ns is 0.9000") && err.contains("; accepted"), "{err}");
    let table = fs::read_to_string(folder.path().join("t.toml")).unwrap();
    assert!(table.contains("accepted = [\"interval\"]"), "{table}");
    // Unknown names, and names without which nothing is left to fit.
    let err = calibrate(64, &["--accept", "intervals"]);
    assert!(err.contains("give the name of a finding: ") && err.contains(" interval, interval-not-nominal, "), "{err}");
    assert!(
        calibrate(64, &["--accept", "no-pulses"])
            .contains("no-pulses cannot be accepted, because nothing is left to fit")
    );
    // A row in ten is missing: a warning, unless warnings are faults.
    let thin = samples.lines().enumerate().filter(|(index, _)| index % 10 != 7);
    write(&thin.map(|(_, line)| format!("{line}\n")).collect::<String>());
    assert!(calibrate(0, &[]).contains("warning [missing-rows]: "));
    assert!(calibrate(65, &["--strict"]).contains("fault [missing-rows]: "));
    calibrate(0, &["--strict", "--accept", "missing-rows"]);
}

/// Whether the number at this key of a document has its unit at the end, is a count, or a ratio.
fn has_unit(key: &str) -> bool {
    let units = ["_g0", "_rad", "_ppm", "_s", "_c", "_m_s2", "_in_unit"];
    let none = [
        "set_points",
        "dwells",
        "order",
        "line",
        "position",
        "windows",
        "windows_at_attitude",
        "samples_left_out",
        "missing",
        "gaps",
        "time_steps",
        "groups",
        "count",
        "not_a_number",
        "not_still",
        "elsewhere",
        "by_accelerometers",
        "shared_bins",
    ];
    let of_noise =
        ["rows", "first_row", "last_row", "recorded_rows", "degrees_of_freedom", "chi_square", "white_noise_counts"];
    units.iter().any(|unit| key.ends_with(unit))
        || none.contains(&key)
        || of_noise.contains(&key)
        || ["windows_in_group", "factor", "exit_code", "part", "interval_ratio"].contains(&key)
        || ["_urad", "_in_unit_per_year"].iter().any(|unit| key.ends_with(unit))
        || ["years", "degrees_of_freedom", "band_factor", "largest_ratio", "p", "chi2"].contains(&key)
        || ["t", "limit_t", "ratio", "gains"].contains(&key)
}

/// Asserts that each number has the unit of its key, or of the key above `value` and `interval`.
fn assert_units(key: &str, value: &Value) {
    match value {
        Value::Number(_) => assert!(has_unit(key), "{key}: {value}"),
        Value::Array(all) => all.iter().for_each(|each| assert_units(key, each)),
        Value::Object(all) => {
            let estimate = all.keys().all(|key| ["value", "interval"].contains(&key.as_str()));
            all.iter().for_each(|(inner, each)| assert_units(if estimate { key } else { inner }, each));
        }
        _ => {}
    }
}

#[test]
fn the_json_of_a_comparison_has_units() {
    let folder = folder();
    let [old, new, newest, other] =
        ["2023", "2024", "2026", "other_imu"].map(|name| format!("{DATA}/any_lab/compare/{name}.toml"));
    let document = |code, arguments: &[&str]| -> Value {
        let (out, err) = run(folder.path(), code, &[&["compare", "--json"], arguments].concat());
        let document = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}{err}"));
        assert_units("", &document);
        document
    };
    let found = document(1, &[&old, &new, "--require", "bias=2ug0"]);
    assert_eq!((&found["verdict"], &found["curves"][0]["verdict"]), (&"beyond".into(), &"beyond".into()));
    assert_eq!(found["curves"][1]["verdict"], Value::Null);
    let upper = found["curves"][0]["upper_in_unit"].as_f64().unwrap();
    assert!((upper - 4.77151).abs() < 1e-5, "{upper}");
    assert_eq!(found["curves"][0]["temperature"]["points_in_unit"].as_array().unwrap().len(), 41);
    let found = document(0, &[&newest, &new, &old]);
    assert_eq!((&found["old"], &found["verdict"]), (&old.as_str().into(), &Value::Null));
    assert_eq!(found["trends"].as_array().unwrap().len(), 9);
    let found = document(78, &[&old, &other]);
    assert_eq!(found["exit_code"], 78);
    assert!(found["error"].as_str().unwrap().contains("tables of two IMUs: imu-a, imu-b"), "{found}");
}

#[test]
fn the_json_of_a_batch_has_units() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let text = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let imus = "imus = [{ id = \"imu-a\" }, { id = \"imu-b\" }, { id = \"imu-c\" }]\nsamples = \"{imu}.csv\"";
    fs::write(at("campaign.toml"), text.replace("imu = \"imu-paper\"\nsamples = \"samples.csv\"", imus)).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    for name in ["imu-a", "imu-b"] {
        fs::write(at(&format!("{name}.csv")), &samples).unwrap();
    }
    // Two units from one recording: nothing says whose it is, and no table is written.
    let command = ["calibrate", "turntable", "campaign.toml", "-o", "{imu}.toml", "--json"];
    let (out, err) = run(folder.path(), 65, &command);
    assert!(err.starts_with("isotherm: fault [same-recording]: imu-a and imu-b have the same recording; "), "{err}");
    assert_eq!(serde_json::from_str::<Value>(&out).unwrap()["findings"][0]["name"], "same-recording");
    assert!(!at("imu-a.toml").exists() && !at("imu-b.toml").exists());
    fs::write(at("imu-b.csv"), other_device(&samples, 1)).unwrap();
    let (out, err) = run(folder.path(), 1, &command);
    let document: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}{err}"));
    assert_units("", &document);
    assert_eq!(document["imus"][2]["dropped"]["file"], "imu-c.csv");
    assert_eq!(document["batch"]["quantities"][0]["values_in_unit"].as_array().unwrap().len(), 2);
}

#[test]
fn json_is_one_document_also_of_a_failure() {
    let folder = folder();
    let campaign = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let json = |code, arguments: &[&str]| -> (Value, String) {
        let (out, err) = run(folder.path(), code, &[arguments, &["--json"]].concat());
        let document = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}{err}"));
        assert_units("", &document);
        (document, err)
    };
    let calibrate = ["calibrate", "turntable", "campaign.toml", "-o", "t.toml"];
    let failed = |code, arguments: &[&str]| {
        let (document, err) = json(code, arguments);
        assert_eq!(document["exit_code"], code);
        assert_eq!(err, format!("isotherm: {}\n", document["error"].as_str().unwrap()));
        document
    };
    // The campaign file, a missing file, a bad row, a wrong place, and an argument that only the data show to be wrong.
    write("samples.csv", &samples);
    write("campaign.toml", &campaign.replace("gravity_local = 9.8015", "gravity_local = 98.0"));
    let document = failed(78, &calibrate);
    assert_eq!((&document["file"], &document["line"]), (&"campaign.toml".into(), &5.into()));
    write("campaign.toml", &campaign);
    assert_eq!(failed(74, &["calibrate", "turntable", "none.toml", "-o", "t.toml"])["file"], "none.toml");
    write("samples.csv", &samples.replacen("\n-25,1,3,", "\n-25,99,3,", 1));
    let document = failed(65, &calibrate);
    assert_eq!((&document["file"], &document["line"]), (&"samples.csv".into(), &5.into()));
    write("samples.csv", &samples);
    failed(64, &[&calibrate[..], &["--exclude", "5/99"]].concat());
    failed(64, &["calibrate", "turntable", "campaign.toml", "-o", "-"]);
    failed(74, &[&calibrate[..], &["--report", "nowhere/r.html"]].concat());
    // A refusal has the diagnosis and the findings with their places.
    write("samples.csv", &samples.replace(",10000000000,", ",9000000000,"));
    let document = failed(65, &calibrate);
    assert_eq!(
        (&document["diagnosis"]["name"], &document["findings"]),
        (&"interval".into(), &Value::Array(Vec::new()))
    );
    let cut: Vec<_> = samples.lines().filter(|line| !line.starts_with("5,8,")).collect();
    write("samples.csv", &(cut.join("\n") + "\n"));
    let document = failed(65, &calibrate);
    let finding = &document["findings"][0];
    assert_eq!((&document["diagnosis"], &finding["name"]), (&Value::Null, &"missing-position".into()));
    assert_eq!(finding["place"], format!("samples.csv:{}", finding["line"]));
    assert!(!folder.path().join("t.toml").exists());
    // The results.
    write("samples.csv", &samples);
    let (document, _) = json(0, &calibrate);
    assert!(document["digest"].is_string() && document.get("error").is_none(), "{document}");
    let verify = ["verify", "--table", "t.toml", "run/run.csv", "--attitude", "0.6,-0.48,0.64"];
    run(folder.path(), 0, &["simulate", "run", "-o", "run", "--interval", "1"]);
    let (document, _) = json(0, &verify);
    assert!(
        document["axes"][0]["worst_g0"]["value"].is_number() && document["level"]["worst_rad"]["value"].is_number()
    );
    // A requirement that is missed is in the results, which are the only document.
    let (document, err) = json(1, &[&verify[..], &["--require", "bias=0.001ug0"]].concat());
    assert!(document["met"] == false && err.contains("the requirement is not met"), "{err}");
    failed(65, &[&verify[..], &["--window", "1e6"]].concat());
    let noise = ["noise", "run/run.csv", "--table", "t.toml"];
    let (document, _) = json(0, &noise);
    assert!(document["sensors"][2]["temperature"]["without"]["adev_in_unit"].is_array());
    assert_eq!(failed(65, &[&noise[..], &["--to", "9"]].concat())["file"], "run/run.csv");
    assert_eq!(failed(74, &["verify", "--table", "none.toml", "run/run.csv"])["file"], "none.toml");
    failed(74, &[&verify[..], &["--report", "nowhere/r.html"]].concat());
    let raw = fs::read_to_string(folder.path().join("run/run.csv")).unwrap();
    write("bad.csv", &raw.replacen("\n1,", "\n0,", 1));
    let lines = raw.lines().position(|line| line.starts_with("1,")).map(|index| index + 1);
    let document = failed(65, &["verify", "--table", "t.toml", "bad.csv"]);
    assert_eq!(
        (document["file"].as_str(), document["line"].as_u64()),
        (Some("bad.csv"), lines.map(|line| line as u64))
    );
}

#[test]
fn regress_writes_what_scripts_rely_on() {
    let folder = folder();
    let set: Value = serde_json::from_str(
        &fs::read_to_string(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../calibration/statistics/tests/data/nist/Filip.json"
        ))
        .unwrap(),
    )
    .unwrap();
    let column = |name: &str| set["text"][name].as_array().unwrap().iter().map(|v| v.as_str().unwrap());
    let rows: String = column("x").zip(column("y")).map(|(x, y)| format!("{y},{x},2\n")).collect();
    fs::write(folder.path().join("filip.csv"), format!("y,x,w\n{rows}")).unwrap();
    let regress = ["regress", "filip.csv", "--x", "x", "--y", "y"];
    let json = |more: &[&str]| -> Value {
        serde_json::from_str(&run(folder.path(), 0, &[&regress[..], &["--json"], more].concat()).0).unwrap()
    };
    let plain = json(&["--max-order", "10"]);
    assert_eq!(
        (&plain["n"], &plain["selected"], plain["orders"].as_array().unwrap().len()),
        (&82.into(), &10.into(), 10)
    );
    let ten = &plain["orders"][9];
    for (key, certified) in [("coefficients", "coefficients"), ("standard_errors", "sd")] {
        for (got, right) in
            ten[key].as_array().unwrap().iter().zip(set["exact_recomputed"][certified].as_array().unwrap())
        {
            let right: f64 = right.as_str().unwrap().parse().unwrap();
            assert!((got.as_f64().unwrap() / right - 1.0).abs() < 1e-14, "{key}: {got} {right}");
        }
    }
    for key in ["order", "residual_sd", "sse", "r_squared", "r", "f", "f_p"] {
        assert!(ten[key].is_number(), "{key}");
    }
    for key in ["term", "sum_of_squares", "f", "p"] {
        assert!(ten["partial"][9][key].is_number(), "{key}");
    }
    assert!(plain["reason"].as_str().unwrap().contains("order 10"));
    // Equal weights change only the sums.
    let weighted = json(&["--max-order", "10", "--weights", "w"]);
    for (a, b) in ten["standard_errors"]
        .as_array()
        .unwrap()
        .iter()
        .zip(weighted["orders"][9]["standard_errors"].as_array().unwrap())
    {
        assert!((a.as_f64().unwrap() / b.as_f64().unwrap() - 1.0).abs() < 1e-13, "{a} {b}");
    }
    assert!((weighted["orders"][9]["sse"].as_f64().unwrap() / ten["sse"].as_f64().unwrap() - 2.0).abs() < 1e-12);
    // A perfect fit has no F.
    fs::write(folder.path().join("line.csv"), "x,y\n0,1\n1,1.1\n2,1.2\n3,1.3\n").unwrap();
    let line = run(folder.path(), 0, &["regress", "line.csv", "--x", "x", "--y", "y", "--json"]).0;
    let line: Value = serde_json::from_str(&line).unwrap();
    assert_eq!(
        (&line["orders"][0]["f"], &line["orders"][0]["sse"], &line["selected"]),
        (&Value::Null, &0.0.into(), &1.into())
    );
    let (out, _) = run(folder.path(), 0, &regress);
    assert!(out.contains("Chosen: order ") && out.contains("basis centred at"), "{out}");
    for (code, wrong) in
        [(64, &["--max-order", "16"][..]), (64, &["--max-order", "0"]), (65, &["--weights", "nowhere"])]
    {
        run(folder.path(), code, &[&regress[..], wrong].concat());
    }
    let (_, err) = run(folder.path(), 65, &["regress", "line.csv", "--x", "x", "--y", "y", "--max-order", "4"]);
    assert!(err.contains("order 4 needs 5 different values of x, there are 4"), "{err}");
    fs::write(folder.path().join("bad.csv"), "x,y\n0,1\n1,one\n").unwrap();
    let (_, err) = run(folder.path(), 65, &["regress", "bad.csv", "--x", "x", "--y", "y"]);
    assert!(err.contains("bad.csv:3: y is \"one\", give a finite number, 0 or of size"), "{err}");
}

/// Temperature, the same behind a lag, a column whose name has a minus sign, and a quantity that depends on all, with
/// these separators.
fn ramp(separator: &str, decimal: &str, rows: i32) -> String {
    let header = ["u", "u_lagged", "board-2", "y"].join(separator);
    let row = |i: i32| {
        let time = f64::from(i) / 20.0;
        let (u, lagged) = (2.5 - 1.4 * libm::cos(time), 2.5 - 1.4 * libm::cos(time - 0.2));
        let y = 800.0 - 30.0 * u + 35.0 * (lagged - u) + 0.5 * libm::sin(1e4 * (time + 0.3));
        let numbers = [u, lagged, f64::from(i % 7) - 3.5, y].map(|value| format!("{value:.5}").replace('.', decimal));
        numbers.join(separator) + "\n"
    };
    format!("{header}\n{}", (0..rows).map(row).collect::<String>())
}

#[test]
fn regress_takes_further_columns_and_differences_linearly() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("ramp.csv"), ramp(",", ".", 260)).unwrap();
    let regress = ["regress", "ramp.csv", "--x", "u", "--x", "u_lagged-u", "--x", "board-2", "--y", "y"];
    let (out, _) = run(folder.path(), 0, &regress);
    assert!(out.starts_with("y as a polynomial of u, and linear in u_lagged-u, board-2: 260 points\n"), "{out}");
    assert!(out.contains("variance inflation") && out.contains("\nChosen: order 1; "), "{out}");
    let document: Value =
        serde_json::from_str(&run(folder.path(), 0, &[&regress[..], &["--json"]].concat()).0).unwrap();
    assert_eq!((&document["x"], &document["linear"]), (&"u".into(), &serde_json::json!(["u_lagged-u", "board-2"])));
    let fit = &document["orders"][1];
    assert_eq!((&fit["order"], &document["selected"]), (&1.into(), &1.into()));
    let transient = &fit["linear"][0];
    assert!((transient["coefficient"].as_f64().unwrap() - 35.0).abs() < 0.5, "{transient}");
    for key in ["standard_error", "sum_of_squares", "f", "p", "variance_inflation"] {
        assert!(transient[key].is_number(), "{key}");
    }
    assert!(fit["linear"][1]["p"].as_f64().unwrap() > 1e-4, "{fit}");
    // The difference of quantities too.
    run(folder.path(), 0, &["regress", "ramp.csv", "--x", "u", "--y", "y - u"]);
    for (wrong, cause) in [
        (
            &["--x", "u", "--x", "u_lagged", "--x", "u_lagged-u"][..],
            "columns u_lagged, u_lagged-u and u are linearly dependent",
        ),
        (&["--x", "u", "--x", "u"], "columns u and u are linearly dependent"),
        (&["--x", "u", "--x", "u-u"], "the column u-u has the same value in every row"),
        (&["--x", "u", "--x", "lag-u"], "missing columns: lag-u; found: u, u_lagged, board-2, y"),
    ] {
        let (_, err) = run(folder.path(), 65, &[&["regress", "ramp.csv", "--y", "y"], wrong].concat());
        assert!(err.contains("ramp.csv:") && err.contains(cause), "{err}");
    }
    // A name that is a column is no difference, and one that may be two differences is refused.
    fs::write(folder.path().join("names.csv"), "a,b,c,a-b,b-c\n1,2,9,1,4\n2,2,8,7,5\n3,7,1,2,6\n4,1,2,5,2\n").unwrap();
    let coefficient = |x: &str| {
        let arguments = ["regress", "names.csv", "--x", x, "--y", "c", "--max-order", "1", "--json"];
        let document: Value = serde_json::from_str(&run(folder.path(), 0, &arguments).0).unwrap();
        document["orders"][0]["coefficients"][1].as_f64().unwrap()
    };
    // By hand: the slopes of 9, 8, 1, 2 on 1, 7, 2, 5, and on 1-9, 2-8, 3-1, 4-2.
    assert!((coefficient("a-b") - 2.0 / 22.75).abs() < 1e-12 && (coefficient("a-c") + 64.0 / 83.0).abs() < 1e-12);
    let (_, err) = run(folder.path(), 65, &["regress", "names.csv", "--x", "a-b-c", "--y", "c"]);
    assert!(err.contains("names.csv:1: a-b-c may be \"a\" less \"b-c\", or \"a-b\" less \"c\"; give"), "{err}");
}

#[test]
fn regress_detects_separators_and_decimal_commas_or_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let regress = |data: &str| {
        fs::write(folder.path().join("data.txt"), data).unwrap();
        ["regress", "data.txt", "--x", "u", "--x", "u_lagged-u", "--y", "y", "--json"]
    };
    let read = |data: &str| {
        let (out, err) = run(folder.path(), 0, &regress(data));
        let mut document: Value = serde_json::from_str(&out).unwrap();
        let notes = document.as_object_mut().unwrap().remove("notes");
        (document, notes.map(|notes| notes[0].as_str().unwrap().to_owned()), err)
    };
    let (plain, no_note, _) = read(&ramp(",", ".", 60));
    assert_eq!(no_note, None);
    for (separator, decimal, note) in [
        (";", ".", "columns separated by semicolons, numbers with decimal points"),
        (";", ",", "columns separated by semicolons, numbers with decimal commas"),
        ("\t", ",", "columns separated by tabs, numbers with decimal commas"),
        ("   ", ".", "columns separated by spaces, numbers with decimal points"),
        (" ", ",", "columns separated by spaces, numbers with decimal commas"),
    ] {
        let (document, told, err) = read(&ramp(separator, decimal, 60));
        assert_eq!(document, plain, "{note}");
        assert_eq!(told.as_deref(), Some(format!("data.txt: {note}").as_str()));
        assert!(err.contains(note), "{err}");
    }
    let quoted =
        ramp(";", ",", 60).lines().map(|line| format!("\"{}\"\n", line.replace(';', "\",\""))).collect::<String>();
    assert_eq!(read(&quoted).0, plain);
    let three_digits =
        |separator: &str| "u u_lagged y\n1 2 3\n1,234 1,250 7,001\n2,345 2,300 8,001\n".replace(' ', separator);
    for (data, cause) in [
        (
            ramp(",", ",", 60),
            "data.txt:2: 8 fields, but the header has 4; if the comma is also the decimal mark, separate",
        ),
        (
            three_digits("\t"),
            "data.txt:3: 1,234 is 1.234 or 1234: every comma in these numbers stands before three digits",
        ),
        (
            "u;u_lagged;y\n1;2;3\n1,5;2;3\n2.5;2;3\n".to_owned(),
            "data.txt:4: u is \"2.5\", give a number with a decimal comma as in line 3",
        ),
        (
            "u;u_lagged;y\n1.234,5;2;3\n".to_owned(),
            "data.txt:2: u is \"1.234,5\", give a number without thousands separators",
        ),
        ("u;u_lagged;z\n1;2;3\n".to_owned(), "data.txt:1: missing columns: y; found: u, u_lagged, z"),
    ] {
        let (_, err) = run(folder.path(), 65, &regress(&data));
        assert!(err.contains(cause), "{err}");
    }
}

#[test]
fn an_interrupted_command_leaves_nothing_behind() {
    let folder = folder();
    for signal in ["-INT", "-TERM"] {
        let arguments = ["simulate", "run", "-o", ".", "--interval", "0.0001"];
        let mut child =
            Command::new(env!("CARGO_BIN_EXE_isotherm")).args(arguments).current_dir(folder.path()).spawn().unwrap();
        let begun = || fs::read_dir(folder.path()).unwrap().count() > 0;
        let deadline = Instant::now() + Duration::from_secs(60);
        while !begun() {
            assert!(Instant::now() < deadline && child.try_wait().unwrap().is_none(), "it never began to write");
            thread::sleep(Duration::from_millis(5));
        }
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let status = child.wait().unwrap();
        assert!(status.signal().is_some(), "{status}");
        assert!(!begun(), "{signal} left a file");
    }
}

#[test]
fn outliers_in_pieces_are_reported_by_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let row = |i: i32| format!("{i},{}\n", f64::from(i) * 0.5 + if i == 50 { 9.0 } else { 0.001 * f64::from(i % 3) });
    let rows = |range: std::ops::Range<i32>| format!("x,y\n{}", range.map(row).collect::<String>());
    fs::write(folder.path().join("p1.csv"), rows(0..30)).unwrap();
    fs::write(folder.path().join("p2.csv"), rows(30..60)).unwrap();
    let regress = ["regress", "p1.csv", "p2.csv", "--x", "x", "--y", "y", "--json"];
    let (out, err) = run(folder.path(), 0, &regress);
    let diagnostics = &serde_json::from_str::<Value>(&out).unwrap()["diagnostics"];
    assert_eq!(diagnostics["outlier_lines"], serde_json::json!([22]), "{diagnostics}");
    assert_eq!(diagnostics["outlier_places"], serde_json::json!(["p2.csv:22"]));
    assert!(err.contains("line p2.csv:22"), "{err}");
}
