//! `calibrate` of a whole IMU, as a user types it: the campaign with a known truth, see
//! `calibration/fit/tests/data/gyro/README.md`, and what becomes of it when something is wrong.
//!
//! Over 400 lines: one campaign, and one mistake after another in it.

use crate::common::{assert_self_contained, folder, run};
use isotherm_shared::table::{CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::device;
use serde_json::Value;
use std::fs;
use std::path::Path;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/gyro");

fn text(name: &str) -> String {
    fs::read_to_string(format!("{DATA}/{name}")).unwrap()
}

fn json(name: &str) -> Value {
    serde_json::from_str(&text(name)).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

/// The value of a key in a table's provenance; it is JSON too.
fn provenance(table: &str, key: &str) -> Value {
    let value =
        table.lines().find_map(|line| line.strip_prefix(&format!("{key} = "))).unwrap_or_else(|| panic!("no {key}"));
    serde_json::from_str(value).unwrap()
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Set point and number of a row; `None` of the header.
fn place(line: &str) -> Option<(f64, u32)> {
    let mut fields = line.split(',');
    Some((fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
}

/// The campaign in `folder`: the file as `file` makes it, the rows as `row` makes them, by line and place.
fn campaign(folder: &Path, file: impl Fn(String) -> String, row: impl Fn(usize, (f64, u32), &str) -> Option<String>) {
    fs::write(folder.join("campaign.toml"), file(text("campaign.toml"))).unwrap();
    let rows = text("samples.csv");
    let rows = rows.lines().enumerate().filter_map(|(index, line)| match place(line) {
        Some(place) => row(index + 1, place, line),
        None => Some(line.to_owned()),
    });
    fs::write(folder.join("samples.csv"), rows.map(|line| line + "\n").collect::<String>()).unwrap();
}

fn same(_: usize, _: (f64, u32), line: &str) -> Option<String> {
    Some(line.to_owned())
}

/// Calibrates the campaign in `folder`; the command must end with `code`. Returns what it printed to stderr.
fn calibrate(folder: &Path, code: i32, more: &[&str]) -> String {
    let (out, err) =
        run(folder, code, &[&["calibrate", "turntable", "campaign.toml", "-o", "table.toml"], more].concat());
    assert_eq!(out, "");
    assert_eq!(folder.join("table.toml").exists(), code == 0, "{err}");
    err
}

/// The document of `--json`; the command must end with `code`.
fn document(folder: &Path, code: i32, more: &[&str]) -> Value {
    let arguments = [&["calibrate", "turntable", "campaign.toml", "-o", "table.toml", "--json"], more].concat();
    serde_json::from_str(&run(folder, code, &arguments).0).unwrap()
}

/// Largest differences of the table from the truth: D \[deg/h\], K \[ppm\], s \[deg/h/g0\].
fn differences(table: &CoefficientTable, truth: &Value) -> [f64; 3] {
    let gyroscopes = table.content().gyroscopes.as_ref().unwrap();
    let mut worst = [0.0_f64; 3];
    for (axis, name) in GYROSCOPE_NAMES.into_iter().enumerate() {
        let part = &gyroscopes.axes[axis];
        let right = &truth["gyroscopes"][name];
        let curves = [&part.bias, &part.positive_scale_factor, &part.negative_scale_factor];
        for (q, (key, curve)) in ["bias", "kp", "kn"].into_iter().zip(curves).enumerate() {
            let values = numbers(&right[key]);
            let [low, high] = curve.range();
            for step in 0..=64 {
                let u = low + (high - low) * f64::from(step) / 64.0;
                let right = polynomial(&values, u);
                let error = (curve.at(u) - right).abs();
                let (place, error) = if q == 0 { (0, error) } else { (1, error / right.abs() * 1e6) };
                worst[place] = worst[place].max(error);
            }
        }
        for (got, right) in gyroscopes.g_sensitivity[axis].unwrap().into_iter().zip(numbers(&right["g_sensitivity"])) {
            worst[2] = worst[2].max((got - right).abs());
        }
    }
    worst
}

#[test]
fn the_campaign_with_a_known_truth() {
    let folder = folder();
    campaign(folder.path(), |file| file, same);
    let err = calibrate(folder.path(), 0, &["--report", "r.html"]);
    assert!(err.starts_with("180 dwells and 90 turns at 15 set points, one-stage fit, digest sha256:"), "{err}");
    for line in [
        "  G1 bias                        3  +-  0.0",
        "  G3 g-sensitivity along A1 0.28",
        "  Earth's horizontal rate 11.539",
        "[deg/h, 95 %], at the stated latitude 11.5390\n",
        "  with alignment matrices of both triads;",
        "\naccelerometers: bias +- 0.43 ug0, scale factor +- 0.98 ppm over 1.0899..4.0572 V, 95 % for each whole curve, from 15 \
         set points\n",
        "\ngyroscopes: bias +- 0.0105 deg/h, scale factor +- 4.86 ppm over ",
        " deg/h/g0, misalignment +- 0.5",
        "e-6 rad, 95 % for each whole curve, from 15 set points\n",
    ] {
        assert!(err.contains(line), "{line}: {err}");
    }
    // The table that was written, read again.
    let written = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    let table = CoefficientTable::from_toml(&written, None).unwrap();
    assert!(err.contains(&table.digest().to_string()), "{err}");
    assert!(run(folder.path(), 0, &["check", "table.toml"]).0.contains("seal intact"));
    let truth = json("truth.json");
    let off = differences(&table, &truth);
    assert!(off[0] < 0.013 && off[1] < 4.0 && off[2] < 0.006, "{off:?}");
    let misalignment = provenance(&written, "gyroscope_misalignment");
    for axis in 0..3 {
        let (found, right) = (numbers(&misalignment[axis]), numbers(&truth["gyroscope_misalignment"][axis]));
        assert!(found.iter().zip(&right).all(|(found, right)| (found - right).abs() < 7e-7), "{found:?} {right:?}");
    }
    // What a verification run takes from it.
    assert_eq!(provenance(&written, "latitude_deg"), 39.9);
    let (found, right) = (provenance(&written, "earth_rate_deg_h"), &truth["earth_in_base_deg_h"]);
    assert!(numbers(&found).iter().zip(numbers(right)).all(|(found, right)| (found - right).abs() < 0.003), "{found}");
    assert!(numbers(&provenance(&written, "earth_rate_standard_error")).iter().all(|e| (1e-5..0.003).contains(e)));
    assert!(!written.contains("mounting"), "the identity");
    assert_eq!(written.matches("[[provenance.curve]]").count(), 18);
    assert_eq!(written.matches("unit = \"pulse/arcsec\"\norder = 3").count(), 6);
    assert_eq!(written.matches("axis = \"G2\"\nquantity = \"bias\"\nunit = \"deg/h\"").count(), 1);
    assert_eq!((provenance(&written, "turns"), provenance(&written, "warnings")), (90.into(), Value::Array(vec![])));
    assert!(err.contains(provenance(&written, "gyroscope_accuracy").as_str().unwrap()));
    // The random walk that the data were made with, and a little for the pulses.
    let walks = numbers(&provenance(&written, "random_walk_deg_sqrt_h"));
    assert!(walks.iter().zip([0.003, 0.003, 0.004]).all(|(walk, right)| (walk / right - 1.0).abs() < 0.1), "{walks:?}");
    report(folder.path());
    the_document(folder.path(), &table);
}

fn report(folder: &Path) {
    let contains = [
        "Residuals, accelerometers",
        "Order tables, gyroscopes",
        "g-sensitivities [°/h/g]",
        "Turn check list",
        "26 of 26 unknowns",
        "at a latitude of 39.9 degrees it is 11.5390 °/h",
        "°/√h",
        "Turns: axis, where they begin",
        "G3 <span class=\"unit\">/ arcsec</span>",
    ];
    assert_self_contained(&folder.join("r.html"), &contains);
    let html = fs::read_to_string(folder.join("r.html")).unwrap();
    for (quantity, unit) in [("Bias", "°/h"), ("K+", "pulse/arcsec"), ("K-", "pulse/arcsec")] {
        for gyroscope in GYROSCOPE_NAMES {
            assert!(
                html.contains(&format!("{quantity} of {gyroscope}: {quantity} / {unit} over ")),
                "{gyroscope} {quantity}"
            );
            assert!(html.contains(&format!("{quantity} of {gyroscope}: set point less table: Residual / ")));
            assert!(html.contains(&format!("{gyroscope} {quantity}: orders, in {unit}")));
        }
    }
    assert_eq!(html.matches(" / 13</th>").count(), 15, "each turn at each set point");
}

fn the_document(folder: &Path, table: &CoefficientTable) {
    let document = document(folder, 0, &[]);
    assert_eq!(document["digest"], table.digest().to_string());
    let found = &document["gyroscopes"];
    assert_eq!((&found["turns"], &found["caution"], &found["left_over"]), (&90.into(), &Value::Null, &Value::Null));
    assert_eq!(found["observability"]["rank"], found["observability"]["unknowns"]);
    assert!((found["earth"]["horizontal_rate_deg_h"].as_f64().unwrap() - 11.539).abs() < 0.003);
    assert_eq!(found["curves"].as_array().unwrap().len(), 9);
    assert_eq!((&found["curves"][0]["axis"], &found["curves"][0]["unit"]), (&"G1".into(), &"deg/h".into()));
    let content = table.content().gyroscopes.as_ref().unwrap();
    for axis in 0..3 {
        let part = &found["axes"][axis];
        let pairs = numbers(&part["g_sensitivity_deg_h_g0"]).into_iter().zip(content.g_sensitivity[axis].unwrap());
        assert!(pairs.into_iter().all(|(found, right)| (found - right).abs() < 1e-12), "{part}");
        assert!((1e-4..0.013).contains(&part["bias_interval_deg_h"].as_f64().unwrap()), "{part}");
        assert!((0.1..4.0).contains(&part["scale_factor_interval_ppm"].as_f64().unwrap()), "{part}");
    }
}

#[test]
fn both_triads_get_an_alignment_matrix_or_neither() {
    let folder = folder();
    campaign(folder.path(), |file| file, same);
    for (more, matrices) in [(&["--alignment"], 2), (&["--no-alignment"], 0)] {
        let err = calibrate(folder.path(), 0, more);
        let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
        assert_eq!(table.matches("alignment]\n").count(), matrices, "{table}");
        let left = "without an alignment matrix, which this IMU needs: misalignments leave up to ";
        assert_eq!(err.contains(left), matrices == 0, "{err}");
        assert_eq!(err.contains("e-6 of the rate (--alignment)"), matrices == 0, "{err}");
    }
}

/// What is wrong, the exit code, and what the message has.
type Refusal<'a> =
    (&'a dyn Fn(String) -> String, &'a dyn Fn(usize, (f64, u32), &str) -> Option<String>, i32, &'a [&'a str]);

#[test]
fn what_is_wrong_is_refused_by_name_with_file_and_line() {
    let folder = folder();
    let good = |file: String| file;
    // Line of the first row of a turn at 20 degC.
    let samples = text("samples.csv");
    let first = |number: u32| 1 + samples.lines().position(|line| place(line) == Some((20.0, number))).unwrap();
    let (turn13, turn14) = (first(13), first(14));
    let [at13, at14] = [turn13, turn14].map(|line| format!("samples.csv:{line}: set point 20 degC, turn "));
    let interrupted = |line: usize, _: (f64, u32), row: &str| (line != turn13 + 20).then(|| row.to_owned());
    let gap = format!("fault [turn-gap]: {at13}13: rows are missing by their sequences");
    let exchanged = |_: usize, (set_point, number): (f64, u32), row: &str| {
        let other = match (set_point, number) {
            (20.0, 13) => 14,
            (20.0, 14) => 13,
            _ => number,
        };
        Some(row.replacen(&format!(",{number},"), &format!(",{other},"), 1))
    };
    let [sign14, sign13] = [
        format!("fault [turn-angle]: {at13}14: the pulses of G1 say the opposite"),
        format!("{at14}13: the pulses of G1 say the opposite"),
    ];
    let doubled = |file: String| file.replacen("angle_deg = 360", "angle_deg = 720", 1);
    let without = |_: usize, (set_point, number): (f64, u32), row: &str| {
        ((set_point, number) != (20.0, 15)).then(|| row.to_owned())
    };
    let cut = |_: usize, (_, number): (f64, u32), row: &str| (number != 13).then(|| row.to_owned());
    let no_positive = |file: String| file.replacen("angle_deg = 360", "angle_deg = -360", 1);
    let latitude = |file: String| file.replace("latitude_deg = 39.9", "latitude_deg = 40.9");
    let no_latitude = |file: String| file.replace("latitude_deg", "# latitude_deg");
    let long_axis = |file: String| file.replacen("axis = [1, 0, 0]", "axis = [1, 1, 0]", 1);
    let skew_axis = |file: String| file.replacen("axis = [1, 0, 0]", "axis = [0, 1, 0]", 1);
    let axis_line = 1 + text("campaign.toml").lines().position(|line| line.starts_with("axis = [1, 0, 0]")).unwrap();
    let axis_place = format!("campaign.toml:{axis_line}: turn.1.axis");
    let dead = |line: usize, _: (f64, u32), row: &str| {
        let mut fields: Vec<_> = row.split(',').collect();
        if line == turn13 {
            fields[19] = "nan";
        }
        Some(fields.join(","))
    };
    let dead_place = format!("samples.csv:{turn13}: set point 20 degC, position 13: g1_head is NaN");
    let cases: [(&str, Refusal<'_>); 12] = [
        ("interrupted", (&good, &interrupted, 65, &[&gap])),
        ("exchanged", (&good, &exchanged, 65, &[&sign14, &sign13])),
        (
            "another angle",
            (
                &doubled,
                &same,
                65,
                &[
                    "fault [turn-angle]: samples.csv:362: turn 13, at every set point: the pulses of G1 show 360.9 deg",
                    "and the campaign file 720 deg",
                ],
            ),
        ),
        (
            "missing",
            (
                &good,
                &without,
                65,
                &["fault [missing-turn]: set point 20 degC: turn 15 of the campaign file is missing"],
            ),
        ),
        (
            "missing everywhere",
            (
                &good,
                &cut,
                65,
                &["isotherm: fault [missing-turn]: turn 13 of the campaign file is missing at every set point"],
            ),
        ),
        (
            "K+ never seen",
            (
                &no_positive,
                &same,
                78,
                &["campaign.toml: K+ of G1: no turn drives it positive; add angle_deg > 0 about [1, 0, 0]"],
            ),
        ),
        (
            "a degree of latitude",
            (
                &latitude,
                &same,
                65,
                &[
                    "fault [latitude]: latitude_deg = 40.9: Earth's horizontal rate is 11.539",
                    "looks like 39.90 or -39.90",
                ],
            ),
        ),
        ("no latitude", (&no_latitude, &same, 78, &["campaign.toml", "latitude_deg: missing"])),
        ("axis too long", (&long_axis, &same, 78, &[&axis_place])),
        ("axis of no turntable", (&skew_axis, &same, 78, &[&axis_place])),
        ("temperature", (&good, &dead, 65, &[&dead_place])),
        (
            "no gyroscopes",
            (
                &good,
                &|_, _, row| Some(accelerometers_only(row)),
                65,
                &["the campaign file has turns, but the samples have no gyroscopes"],
            ),
        ),
    ];
    for (name, (file, row, code, expected)) in cases {
        campaign(folder.path(), file, row);
        if name == "no gyroscopes" {
            let path = folder.path().join("samples.csv");
            let rows = fs::read_to_string(&path).unwrap();
            let (header, rows) = rows.split_once('\n').unwrap();
            fs::write(&path, format!("{}\n{rows}", accelerometers_only(header))).unwrap();
        }
        let err = calibrate(folder.path(), code, &[]);
        println!("{name}: {err}");
        for words in expected {
            assert!(err.contains(words), "{name}: {words}: {err}");
        }
    }
}

/// The columns before those of the gyroscopes.
fn accelerometers_only(row: &str) -> String {
    row.split(',').take(17).collect::<Vec<_>>().join(",")
}

#[test]
fn a_disturbed_turn_is_left_out_or_accepted() {
    let folder = folder();
    let samples = text("samples.csv");
    let turn = |number: u32| 1 + samples.lines().position(|line| place(line) == Some((20.0, number))).unwrap();
    let lost = turn(13) + 20;
    campaign(folder.path(), |file| file, |line, _, row| (line != lost).then(|| row.to_owned()));
    // The document has the fault's name, line, place and turn.
    let refused = document(folder.path(), 65, &[]);
    let finding = &refused["findings"][0];
    assert_eq!((&finding["name"], &finding["severity"]), (&"turn-gap".into(), &"fault".into()), "{refused}");
    assert_eq!((&finding["turn"], &finding["position"]), (&13.into(), &Value::Null));
    assert_eq!((&finding["line"], &finding["set_point_c"]), (&turn(13).into(), &20.0.into()));
    assert_eq!(finding["place"], format!("samples.csv:{}", turn(13)));
    // Accepted by one of its names, it needs the other.
    let err = calibrate(folder.path(), 65, &["--accept", "turn-gap"]);
    assert!(err.contains("these faults must be accepted too") && err.contains("--accept turn-gap,turn-angle"), "{err}");
    let err = calibrate(folder.path(), 0, &["--accept", "turn-gap,turn-angle"]);
    assert!(err.contains("warning [turn-gap]: samples.csv:") && err.contains("; accepted"), "{err}");
    let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    assert_eq!(provenance(&table, "accepted"), serde_json::json!(["turn-gap", "turn-angle"]));
    // The errors of the turn are not in the figures of the gyroscopes, and those of the accelerometers have none.
    let of = |sensors: &str| err.lines().find(|line| line.starts_with(sensors)).unwrap();
    assert!(of("gyroscopes: ").ends_with(", without the errors of warnings [turn-gap], [turn-angle]"), "{err}");
    assert!(of("accelerometers: ").ends_with("from 15 set points"), "{err}");
    // What is wrong with a turn everywhere is one finding, and every run of the turn has the remark.
    campaign(folder.path(), |file| file.replacen("angle_deg = 360", "angle_deg = 380", 1), same);
    let err = calibrate(folder.path(), 0, &["--accept", "turn-angle,latitude", "--report", "r.html"]);
    assert!(err.contains("warning [turn-angle]: samples.csv:362: turn 13, at every set point: "), "{err}");
    let html = fs::read_to_string(folder.path().join("r.html")).unwrap();
    let checks = html.split(" / 13</th>").skip(1).filter_map(|row| row.split("</tr>").next());
    assert_eq!(checks.filter(|row| row.contains("see result")).count(), 15);
    campaign(folder.path(), |file| file, |line, _, row| (line != lost).then(|| row.to_owned()));
    fs::remove_file(folder.path().join("table.toml")).unwrap();
    // Without the turn, nothing drives the channel at this set point; with a second turn of its kind, something does.
    let err = calibrate(folder.path(), 65, &["--exclude", "20/13"]);
    assert!(err.contains("set point 20 degC: K+ of G1: no turn drives it positive"), "{err}");
    let err = calibrate(folder.path(), 64, &["--exclude", "20/19"]);
    assert!(err.contains("--exclude: there is no dwell or turn at set point 20 degC with the number 19"), "{err}");
    let err = calibrate(folder.path(), 64, &["--exclude", "20/"]);
    assert!(err.contains("give SET_POINT/NUMBER"), "{err}");
}

#[test]
fn a_campaign_without_turns_calibrates_the_accelerometers_and_says_so() {
    let folder = folder();
    let no_turns = |file: String| {
        let file = &file[..file.find("[[turn]]").unwrap()];
        file.replace("latitude_deg", "# latitude_deg")
    };
    let dwells = |_: usize, (_, number): (f64, u32), row: &str| (number <= 12).then(|| row.to_owned());
    campaign(folder.path(), no_turns, dwells);
    let err = calibrate(folder.path(), 0, &[]);
    let expected = "isotherm: warning [no-turns]: the samples have gyroscopes, but the campaign file has no [[turn]]: only the accelerometers are calibrated\n";
    assert!(err.starts_with(expected), "{err}");
    assert!(err.contains("\n180 dwells at 15 set points") && err.contains("\nbias +- 0.43 ug0"), "{err}");
    let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    assert!(table.starts_with("format = 1\n") && !table.contains("gyroscope_"), "{table}");
    let document = document(folder.path(), 0, &[]);
    assert!(document.get("gyroscopes").is_none(), "{document}");
    fs::remove_file(folder.path().join("table.toml")).unwrap();
    calibrate(folder.path(), 65, &["--strict"]);
    // The rows of turns belong to no position of such a file.
    campaign(folder.path(), no_turns, same);
    let err = calibrate(folder.path(), 65, &[]);
    assert!(err.contains("position 13: no such position; the campaign file lists 1, 2"), "{err}");
}

#[test]
fn without_angles_what_earths_rate_leaves_is_said() {
    let folder = folder();
    let no_angles = |file: String| {
        let kept = file.lines().filter(|line| !line.starts_with("outer_deg") && !line.starts_with("inner_deg"));
        kept.map(|line| format!("{line}\n")).collect::<String>()
    };
    campaign(folder.path(), no_angles, same);
    let err = calibrate(folder.path(), 0, &["--report", "r.html"]);
    assert!(
        err.contains("warning [earth-rate]: without angles, the horizontal part of Earth's rate is not known"),
        "{err}"
    );
    assert!(err.contains("does not cancel in turn 13, turn 14, turn 15, turn 16:"), "{err}");
    let last = err.lines().last().unwrap();
    assert!(
        last.starts_with("gyroscopes: ") && last.ends_with(", without the errors of warning [earth-rate]"),
        "{err}"
    );
    assert!(!err.contains("Earth's horizontal rate "), "{err}");
    let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    assert!(!table.contains("latitude_deg") && !table.contains("earth_rate_deg_h"), "{table}");
    let document = document(folder.path(), 0, &[]);
    let left = &document["gyroscopes"]["left_over"];
    assert!(left["scale_factor_ppm"].as_f64().unwrap() > 10.0 && document["gyroscopes"]["earth"].is_null(), "{left}");
    assert!(table.contains("[provenance.earth_rate_left_over]\nbias_deg_h = "), "{table}");
    assert_self_contained(&folder.path().join("r.html"), &["Left of Earth", "ppm of scale factor"]);
}

#[test]
fn samples_of_another_device_are_refused() {
    let folder = folder();
    // The unit of each row in the last column; a row of a turn is of another one.
    let marked = |other: &str| {
        let other = other.to_owned();
        move |_: usize, (_, number): (f64, u32), row: &str| {
            let serial = if number == 15 { &other } else { "S/N 7" };
            Some(format!("{row},{:016x}", device(serial)))
        }
    };
    let header = || {
        let path = folder.path().join("samples.csv");
        let rows = fs::read_to_string(&path).unwrap();
        fs::write(&path, rows.replacen('\n', ",device\n", 1)).unwrap();
    };
    let serial = |serial: &'static str| move |file: String| format!("serial = \"{serial}\"\n{file}");
    let first = |wanted: u32| {
        let samples = text("samples.csv");
        1 + samples.lines().position(|line| place(line).is_some_and(|(_, number)| number == wanted)).unwrap()
    };
    campaign(folder.path(), serial(" S/N 7 "), marked("S/N 7"));
    header();
    calibrate(folder.path(), 0, &["--strict"]);
    fs::remove_file(folder.path().join("table.toml")).unwrap();
    campaign(folder.path(), serial("S/N 8"), marked("S/N 7"));
    header();
    let err = calibrate(folder.path(), 65, &[]);
    let [seven, eight] = ["S/N 7", "S/N 8"].map(|serial| format!("{:016x}", device(serial)));
    let expected = format!(
        "fault [other-device]: samples.csv:2: the row is from device {seven}, but \"S/N 8\", the serial number of the campaign file, is device {eight};"
    );
    assert!(err.contains(&expected), "{err}");
    for option in [&["--other-device"][..], &["--accept", "other-device"]] {
        let err = calibrate(folder.path(), 0, option);
        assert!(err.contains("warning [other-device]: samples.csv:2:"), "{err}");
        let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
        assert_eq!(provenance(&table, "accepted"), serde_json::json!(["other-device"]));
        fs::remove_file(folder.path().join("table.toml")).unwrap();
    }
    // Two units in one campaign, of which none is stated.
    campaign(folder.path(), |file| file, marked("S/N 8"));
    header();
    let err = calibrate(folder.path(), 65, &[]);
    let expected =
        format!("samples.csv:{}: the row is from device {eight}, and those before are from device {seven};", first(15));
    assert!(err.contains(&expected), "{err}");
    let document = document(folder.path(), 65, &[]);
    assert_eq!(document["findings"][0]["name"], "other-device");
}
