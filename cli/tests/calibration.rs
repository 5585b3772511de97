//! `calibrate`, `regress`, `verify` and `simulate` as a user types them.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]

use serde_json::Value;
use std::fs;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Command, Output};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/tests/data");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

fn isotherm(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_isotherm")).args(arguments).current_dir(folder).output().unwrap()
}

/// Runs a command that must end with `code`. Returns what it printed on stdout and stderr.
fn run(folder: &Path, code: i32, arguments: &[&str]) -> (String, String) {
    let output = isotherm(folder, arguments);
    let texts = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}\n{}", texts.0, texts.1);
    texts
}

fn folder() -> TempDir {
    tempfile::Builder::new().prefix("iso-").tempdir().unwrap()
}

/// Checks that a report loads nothing from elsewhere, and has these texts.
fn assert_self_contained(path: &Path, contains: &[&str]) {
    let html = fs::read_to_string(path).unwrap();
    for word in ["http://", "https://", "<script", "<link", "src=", "NaN", "inf<"] {
        assert!(!html.contains(word), "{}: {word}", path.display());
    }
    for word in contains {
        assert!(html.contains(word), "{}: {word}", path.display());
    }
    assert!(html.matches("<svg").count() > 6 && html.matches("<svg").count() == html.matches("</svg>").count());
}

/// A row without pulses.
fn dead(header: &str, line: &str) -> String {
    let fields = header.split(',').zip(line.split(','));
    let zero = |name: &str| name.ends_with("_positive") || name.ends_with("_negative");
    fields.map(|(name, value)| if zero(name) { "0" } else { value }).collect::<Vec<_>>().join(",") + "\n"
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
    let calibrate = ["calibrate", "campaign/campaign.toml", "-o", "table.toml", "--report", "r.html", "--alignment"];
    let (out, err) = run(folder.path(), 0, &calibrate);
    assert!(out.is_empty() && err.contains("180 dwells at 15 set points, one-stage fit"), "{out}{err}");
    let (out, _) = run(folder.path(), 0, &["check", "table.toml"]);
    assert!(out.contains("seal intact"), "{out}");
    assert_self_contained(&at("r.html"), &["Error budget", "Order tables", "Dwell check list", "SHA-256"]);
    run(folder.path(), 0, &["simulate", "run", "-o", "run", "--seed", "5", "--vary", "--interval", "1"]);
    let verify = ["verify", "--table", "table.toml", "run/run.csv", "--attitude", "0.6,-0.48,0.64", "--gravity-local"];
    let verified = |more: &[&str], code| run(folder.path(), code, &[&verify[..], &[gravity], more].concat());
    let (out, _) = verified(&["--require", "10", "--report", "v.html"], 0);
    let factors: Vec<f64> = ["A1", "A2", "A3"]
        .iter()
        .map(|axis| out.lines().find(|line| line.trim_start().starts_with(axis)).unwrap())
        .map(|line| line.split_whitespace().last().unwrap().parse().unwrap())
        .collect();
    println!("factors {factors:?}");
    assert!(factors.iter().all(|factor| *factor > 10.0), "{out}");
    assert!(out.contains("Length of the output against local gravity, 1620 still windows"), "{out}");
    assert_self_contained(&at("v.html"), &["Requirement met", "Error budget"]);
    let (out, err) = verified(&["--require", "1e6"], 1);
    assert!(err.contains("1000000 are required") && out.contains("Output stability"), "{err}");
    // An output with the wrong length for a body at rest is a warning, not a failure.
    let raw = fs::read_to_string(at("run/run.csv")).unwrap();
    let mut lines = raw.lines();
    let header = lines.next().unwrap();
    let dead: String = lines.map(|line| dead(header, line)).collect();
    fs::write(at("dead.csv"), format!("{header}\n{dead}")).unwrap();
    let (_, err) = run(folder.path(), 0, &["verify", "--table", "table.toml", "dead.csv"]);
    assert!(err.contains("dead.csv: the output is 0.00") && err.contains("a dead converter"), "{err}");
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
        let (out, err) = run(folder.path(), code, &[&["calibrate", "campaign.toml", "-o", "t.toml"], more].concat());
        assert!(out.is_empty() && !folder.path().join("t.toml").exists(), "{out}");
        err
    };
    write(&campaign, &samples);
    run(folder.path(), 0, &["calibrate", "campaign.toml", "-o", "-"]);
    // No input is overwritten, and table and report must be different files.
    for more in [
        &["-o", "samples.csv"][..],
        &["-o", "campaign.toml"],
        &["-o", "./samples.csv"],
        &["-o", "t.toml", "--report", "samples.csv"],
        &["-o", "t.toml", "--report", "t.toml"],
        &["-o", "-", "--report", "-"],
    ] {
        run(folder.path(), 64, &[&["calibrate", "campaign.toml"], more].concat());
    }
    assert!(fs::read_to_string(folder.path().join("samples.csv")).unwrap() == samples);
    // Either both files are written or none.
    run(folder.path(), 74, &["calibrate", "campaign.toml", "-o", "t.toml", "--report", "nowhere/r.html"]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    for wrong in [&["--order", "8"][..], &["--method", "magic"], &["--exclude", "5"], &["--exclude", "5/99"]] {
        refused(64, wrong);
    }
    write(&campaign.replace("gravity_local", "gravity_lokal"), &samples);
    assert!(refused(78, &[]).contains("campaign.toml:5: gravity_lokal: unknown key"));
    let no_up = campaign.replace("[0, 0, 1]", "[0, 1, 0]").replace("up = \"+z\"", "up = \"+y\"");
    write(&no_up, &samples);
    let err = refused(78, &[]);
    assert!(err.contains("A3: K+ ") && err.contains("one with A3 pointing up"), "{err}");
    write(&campaign, &samples.replacen("\n-25,1,3,", "\n-25,one,3,", 1));
    assert!(refused(65, &[]).contains("samples.csv:5: position is \"one\""));
    let missing: String =
        samples.lines().filter(|line| !line.starts_with("5,8,")).map(|line| format!("{line}\n")).collect();
    write(&campaign, &missing);
    let err = refused(65, &[]);
    assert!(err.contains("set point 5 degC: position 8 of the campaign file is missing"), "{err}");
    let (_, err) = run(folder.path(), 0, &["calibrate", "campaign.toml", "-o", "t.toml", "--exclude", "5/8"]);
    assert!(err.contains("179 dwells"), "{err}");
    assert!(fs::read_to_string(folder.path().join("t.toml")).unwrap().contains("excluded = [\"5/8\"]"));
    fs::remove_file(folder.path().join("samples.csv")).unwrap();
    run(folder.path(), 74, &["calibrate", "campaign.toml", "-o", "t.toml"]);
}

#[test]
fn regress_writes_what_scripts_rely_on() {
    let folder = folder();
    let set: Value = serde_json::from_str(&fs::read_to_string(format!("{DATA}/nist/Filip.json")).unwrap()).unwrap();
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
