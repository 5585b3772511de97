//! `calibrate` with ramps, as a user types it: next to positions and without them, with a time constant that is found,
//! given or refused, and what becomes of recordings that show nothing.

use crate::common::{assert_self_contained, folder, run};
use isotherm_shared::table::{Axis, CoefficientTable};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/ramp");
const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/campaign/samples.csv");
const STATIC: &str = include_str!("../../../examples/tables/imu-paper.toml");

/// Truth of the data: t tau \[ug0 s/V\], and how far the estimate may be off.
const TRUTH: [(f64, f64); 3] = [(35.0 * 240.0, 0.10), (-20.0 * 240.0, 0.10), (12.0 * 240.0, 0.30)];
/// Bounds of the rms of the sweeps left out, without and with what is written \[ug0\].
const LEFT_OUT: [(f64, f64); 3] = [(6.0, 1.2), (3.3, 1.3), (2.2, 1.2)];

/// The campaign with ramps next to its positions, and with only ramps, in `folder`.
fn campaigns(folder: &Path) {
    let text = fs::read_to_string(format!("{DATA}/campaign.toml")).unwrap();
    for name in ["ramp-1.csv", "ramp-2.csv"] {
        fs::copy(format!("{DATA}/{name}"), folder.join(name)).unwrap();
    }
    let lines = text.lines().map(|line| match line.starts_with("samples = \"..") {
        true => format!("samples = {SAMPLES:?}\n"),
        false => format!("{line}\n"),
    });
    fs::write(folder.join("beside.toml"), lines.collect::<String>()).unwrap();
    let (head, ramps) = (text.split_once("[[position]]").unwrap().0, text.split_once("[[ramp]]").unwrap().1);
    let head: String = head.lines().filter(|line| !line.starts_with("samples")).flat_map(|line| [line, "\n"]).collect();
    fs::write(folder.join("alone.toml"), format!("curves = \"static.toml\"\n{head}[[ramp]]{ramps}")).unwrap();
    fs::write(folder.join("static.toml"), STATIC).unwrap();
}

/// The document of `calibrate --json`, and the table.
fn calibrated(folder: &Path, campaign: &str, more: &[&str]) -> (Value, CoefficientTable) {
    let arguments =
        [&["calibrate", "turntable", campaign, "-o", "table.toml", "--report", "report.html", "--json"], more].concat();
    let (out, _) = run(folder, 0, &arguments);
    let table = fs::read_to_string(folder.join("table.toml")).unwrap();
    (serde_json::from_str(&out).unwrap(), CoefficientTable::from_toml(&table, None).unwrap())
}

/// The messages of a `calibrate` that must end with `code` and write nothing.
fn refused(folder: &Path, code: i32, campaign: &str, more: &[&str]) -> String {
    let (out, err) = run(folder, code, &[&["calibrate", "turntable", campaign, "-o", "refused.toml"], more].concat());
    assert_eq!(out, "");
    assert!(!folder.join("refused.toml").exists());
    err
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn the_known_lag_is_written() {
    let folder = folder();
    campaigns(folder.path());
    for campaign in ["beside.toml", "alone.toml"] {
        let (document, table) = calibrated(folder.path(), campaign, &[]);
        let found = &document["transients"];
        let tau = &found["time_constant"];
        let value_s = number(&tau["value_s"]);
        println!("{campaign}: {} {tau}", found["words"][0]);
        assert_eq!(found["verdict"], "lag");
        assert!((199.0..=321.0).contains(&value_s));
        assert!(number(&tau["interval_s"][0]) < 240.0 && 240.0 < number(&tau["interval_s"][1]));
        assert_eq!((&tau["given"], &tau["kept"], &tau["at_end"]), (&false.into(), &false.into(), &false.into()));
        assert_eq!(table.content().lag_s, Some(value_s));
        let biases = found["biases"].as_array().unwrap();
        let axes = &table.content().axes;
        for (((bias, axis), (t_tau, part)), (before, after)) in biases.iter().zip(axes).zip(TRUTH).zip(LEFT_OUT) {
            assert_eq!(bias["unit"], "ug0");
            assert!((number(&bias["transient"]) / axis.transient - 1.0).abs() < 1e-12);
            let off = axis.transient * value_s / t_tau - 1.0;
            let prediction = &bias["prediction"];
            println!("{}: t tau {:.1} % off, {prediction}", bias["name"], 100.0 * off);
            assert!(off.abs() < part);
            assert!(number(&prediction["static"]) > before && number(&prediction["written"]) < after);
            assert!(number(&bias["band"]["after"]) < 0.4 * number(&bias["band"]["before"]));
            let conditions = bias["conditions"].as_array().unwrap();
            assert!(conditions.len() == 4 && conditions.iter().all(|condition| condition["met"] == true));
        }
        let contains =
            ["A1 without transient", "A3 with transient", "Search over the time constant", "lag-not-hysteresis"];
        assert_self_contained(&folder.path().join("report.html"), &contains);
        let (_, text) = run(folder.path(), 0, &["calibrate", "turntable", campaign, "-o", "table.toml"]);
        assert!(text.contains("transients are written for A1, A2, A3"), "{text}");
        assert_eq!(text.contains("the constant of each bias: not measured"), campaign == "alone.toml", "{text}");
    }
    let checked = |file| run(folder.path(), 0, &["check", file]);
    assert!(checked("beside.toml").0.contains("12 positions that observe everything, 2 ramps"));
    assert!(checked("alone.toml").0.contains("2 ramps only, curves of static.toml"));
    checked("table.toml");
}

#[test]
fn a_time_constant_is_given_or_refused() {
    let folder = folder();
    campaigns(folder.path());
    for campaign in ["beside.toml", "alone.toml"] {
        let (document, table) = calibrated(folder.path(), campaign, &["--lag", "240"]);
        assert_eq!(document["transients"]["time_constant"]["given"], true);
        assert_eq!(table.content().lag_s, Some(240.0));
        for (axis, (t_tau, _)) in table.content().axes.iter().zip(TRUTH) {
            assert!((axis.transient - t_tau / 240.0).abs() < 1.5, "{}", axis.transient);
        }
        let (document, table) = calibrated(folder.path(), campaign, &["--lag", "none"]);
        assert_eq!(document["transients"]["words"][0], "no transient is written, as asked for");
        assert_eq!((table.content().lag_s, table.content().format), (None, 1));
    }
    for wrong in ["0", "x", "1e9"] {
        refused(folder.path(), 64, "alone.toml", &["--lag", wrong]);
    }
}

#[test]
fn what_is_no_ramp_is_refused() {
    let folder = folder();
    let path = folder.path();
    campaigns(path);
    let text = fs::read_to_string(path.join("alone.toml")).unwrap();
    let ramp = fs::read_to_string(path.join("ramp-1.csv")).unwrap();
    let short: String = ramp.lines().take(20).flat_map(|line| [line, "\n"]).collect();
    let constant = ramp.lines().enumerate().map(|(line, row)| match line {
        0 => format!("{row}\n"),
        _ => {
            let mut fields: Vec<_> = row.split(',').collect();
            [6, 7, 10, 11, 14, 15].iter().for_each(|field| fields[*field] = "2.5");
            fields.join(",") + "\n"
        }
    });
    fs::write(path.join("short.csv"), short).unwrap();
    fs::write(path.join("constant.csv"), constant.collect::<String>()).unwrap();
    fs::write(path.join("copy.csv"), &ramp).unwrap();
    fs::write(path.join("words.csv"), ramp.replacen("\n100,", "\n1,", 1)).unwrap();
    let (head, _) = text.split_once("[[ramp]]").unwrap();
    let with = |ramps: &[&str]| {
        ramps.iter().fold(head.to_owned(), |text, name| text + &format!("[[ramp]]\nsamples = {name:?}\n"))
    };
    let change = |from: &str, to: &str| text.replacen(from, to, 1);
    let cases = [
        (with(&["missing.csv"]), 74, "missing.csv"),
        (
            with(&["short.csv"]),
            65,
            "short.csv: 190 s give 19 means of a second or a row, and 19 of them in blocks without a gap; 24 are needed at least",
        ),
        (with(&["constant.csv"]), 65, "the head temperature of A1 does not change"),
        (with(&["ramp-1.csv", "copy.csv"]), 65, "copy.csv has rows of ramp-1.csv"),
        (with(&["ramp-1.csv", "./ramp-1.csv"]), 65, "has rows of ramp-1.csv"),
        (with(&["ramp-1.csv", "ramp-1.csv"]), 78, "is there twice"),
        (with(&["words.csv"]), 65, "words.csv:102: sequence 1 after 99"),
        (change("imu = \"imu-paper\"", "imu = \"other\""), 78, "this table belongs to imu-paper, not to other"),
        (
            change("= \"V\"", "= \"degC\""),
            78,
            "the temperature of curves is in \"V\", and temperature_unit is \"degC\"",
        ),
        (change("gravity_reference = 9.8015", "gravity_reference = 9.80665"), 78, "1 g0 of curves is 9.8015 m/s2"),
        (change("static.toml", "nothing.toml"), 74, "nothing.toml"),
        (change("static.toml", "ramp-1.csv"), 78, "give the coefficient table"),
        (change("curves = \"static.toml\"\n", ""), 78, "curves: missing"),
        (change("[0, 0, 1]", "[0, 1, 0]"), 65, "fault [wrong-position]: ramp-1.csv: A2 indicates 0.00"),
    ];
    for (campaign, code, message) in cases {
        fs::write(path.join("wrong.toml"), campaign).unwrap();
        let err = refused(path, code, "wrong.toml", &[]);
        assert!(err.contains(message), "{message}\n{err}");
    }
    for (more, message) in [
        (&["--order", "3"][..], "are for positions"),
        (&["ramp-1.csv"], "samples are for positions"),
        (&["--report", "static.toml"], "static.toml"),
    ] {
        let err = refused(path, 64, "alone.toml", more);
        assert!(err.contains(message), "{err}");
    }
    assert_eq!(fs::read_to_string(path.join("static.toml")).unwrap(), STATIC);
    // A time constant without ramps.
    let beside = fs::read_to_string(path.join("beside.toml")).unwrap();
    fs::write(path.join("still.toml"), beside.split_once("[[ramp]]").unwrap().0).unwrap();
    assert!(refused(path, 64, "still.toml", &["--lag", "240"]).contains("a time constant of the lag is for ramps"));
}

#[test]
fn one_direction_replaces_no_curves_unless_asked() {
    let folder = folder();
    let path = folder.path();
    campaigns(path);
    let ramp = fs::read_to_string(path.join("ramp-1.csv")).unwrap();
    let heating: String = ramp.lines().take(1500).flat_map(|line| [line, "\n"]).collect();
    fs::write(path.join("ramp-1.csv"), heating).unwrap();
    let text = fs::read_to_string(path.join("alone.toml")).unwrap();
    fs::write(path.join("one.toml"), text.rsplit_once("[[ramp]]").unwrap().0).unwrap();
    let err = refused(path, 1, "one.toml", &[]);
    assert!(err.contains("fault [one-direction]: no ramp heats and cools over half of the range"), "{err}");
    let (_, words) = run(path, 0, &["calibrate", "turntable", "one.toml", "-o", "table.toml", "--replace-curves"]);
    assert!(words.contains("warning [one-direction]") && words.contains("\nthe errors of the curves are not known"));
    let table = fs::read_to_string(path.join("table.toml")).unwrap();
    assert!(!table.contains("curve_error") && table.contains("accepted = [\"one-direction\"]"), "{table}");
    // Both ways, the error is in the table, and in the first line.
    let (_, words) = run(path, 0, &["calibrate", "turntable", "alone.toml", "-o", "both.toml"]);
    assert!(words.contains("\nerrors of the curves, half of the band between sweeps: A1 "), "{words}");
    let table = fs::read_to_string(path.join("both.toml")).unwrap();
    assert_eq!(table.matches("curve_error = ").count(), 3, "{table}");
}

/// Rows of the thermal run.
const ROWS: u32 = 8400;
const ROW_S: f64 = 2.0;

/// Temperature of the thermal run \[degC\]: 51, -17, 74, 32, without a hold.
fn temperature(t: f64) -> f64 {
    let turns = [(0.0, 51.0), (0.28, -17.0), (0.74, 74.0), (1.0, 32.0)];
    let part = t / (f64::from(ROWS) * ROW_S);
    let leg = turns.windows(2).find(|leg| part <= leg[1].0).unwrap();
    leg[0].1 + (leg[1].1 - leg[0].1) * libm::pow((part - leg[0].0) / (leg[1].0 - leg[0].0), 0.8)
}

/// A thermal run of a consumer IMU with gyroscopes: biases that move by 100 mm/s2 and 1 deg/s, and hysteresis; no lag.
fn thermal_run() -> String {
    const CURVES: [[f64; 3]; 6] = [
        [8e-3, 1.1e-4, -2e-6],
        [-4e-3, -8e-5, 1e-6],
        [5e-3, 1.2e-4, 3e-6],
        [900.0, 12.0, -0.2],
        [-700.0, -9.0, 0.1],
        [400.0, 20.0, 0.15],
    ];
    const HYSTERESIS: [f64; 6] = [4e-4, -3e-4, 5e-4, 40.0, -30.0, 25.0];
    const NOISE: [f64; 6] = [8e-5, 8e-5, 8e-5, 8.0, 8.0, 8.0];
    // Pulses a second of 1 g0 and of 1 deg/h.
    const RATES: [f64; 6] = [1e6, 1e6, 1e6, 500.0, 500.0, 500.0];
    let mut random = isotherm_simulation::RandomGenerator::new(7, 0);
    let mut text = "sequence,timestamp_ns,interval_ns".to_owned();
    for sensor in ["a1", "a2", "a3", "g1", "g2", "g3"] {
        let _ = write!(text, ",{sensor}_positive,{sensor}_negative,{sensor}_head,{sensor}_board");
    }
    text.push('\n');
    let mut play = temperature(0.0);
    let mut rest = [0.0; 6];
    for row in 0..ROWS {
        let u = temperature((f64::from(row) + 0.5) * ROW_S);
        play = play.clamp(u - 6.0, u + 6.0);
        let temperature = ((u + 0.02 * random.normal()) * 100.0).round() / 100.0;
        let end_ns = (1000.0 + f64::from(row + 1) * ROW_S) * 1e9;
        let _ = write!(text, "{row},{end_ns:.0},{:.0}", ROW_S * 1e9);
        for sensor in 0..6 {
            let x = u - 25.0;
            let [c0, c1, c2] = CURVES[sensor];
            let bias = c0 + (c1 + c2 * x) * x + HYSTERESIS[sensor] * (play - u) / 6.0;
            let still = if sensor == 2 { 1.0 } else { 0.0 };
            rest[sensor] += (still + bias + NOISE[sensor] * random.normal()) * RATES[sensor] * ROW_S;
            let pulses = f64::round(rest[sensor]);
            rest[sensor] -= pulses;
            let _ = write!(text, ",{:.0},{:.0},{temperature},{temperature}", pulses.max(0.0), (-pulses).max(0.0));
        }
        text.push('\n');
    }
    text
}

/// Constant scale factors and no biases.
fn simple_table(gyroscopes: bool) -> String {
    let mut text = format!(
        "format = {}\n[imu]\nid = \"phone\"\ngravity = 9.80665\n[temperature]\nunit = \"degC\"\nout_of_range = \"clamp\"\n",
        if gyroscopes { 2 } else { 1 }
    );
    let kinds = [("axis", "A", "ug0", "pulse/(s*g0)", "1e6"), ("gyroscope", "G", "deg/h", "pulse/arcsec", "500.0")];
    for (section, letter, bias, unit, k) in kinds.into_iter().take(1 + usize::from(gyroscopes)) {
        for number in 1..=3 {
            let _ = write!(
                text,
                "[[{section}]]\nname = \"{letter}{number}\"\nbias = {{ unit = \"{bias}\", range = [-40, 85], c0 = 0.0 }}\n\
                 positive_scale_factor = {{ unit = \"{unit}\", range = [-40, 85], c0 = {k} }}\n\
                 negative_scale_factor = {{ unit = \"{unit}\", range = [-40, 85], c0 = -{k} }}\n"
            );
        }
    }
    text
}

#[test]
fn hysteresis_of_a_consumer_imu_is_not_written() {
    let folder = folder();
    let path = folder.path();
    let run_csv = thermal_run();
    fs::write(path.join("run.csv"), &run_csv).unwrap();
    fs::write(path.join("simple.toml"), simple_table(true)).unwrap();
    let file = "format = 1\nimu = \"phone\"\ncurves = \"simple.toml\"\ngravity_reference = 9.80665\ngravity_local = 9.81\n\
                temperature_unit = \"degC\"\n[[ramp]]\nsamples = \"run.csv\"\n";
    fs::write(path.join("ramps.toml"), file).unwrap();
    let (document, table) = calibrated(path, "ramps.toml", &[]);
    let found = &document["transients"];
    let words = found["words"].to_string();
    println!("{words}");
    assert_ne!(found["verdict"], "lag");
    assert!(words.contains("hysteresis explains as much") && words.contains("no transient is written"));
    let content = table.content();
    let gyroscopes = &content.gyroscopes.as_ref().unwrap().axes;
    assert!(content.lag_s.is_none() && content.axes.iter().chain(gyroscopes).all(|axis| axis.transient == 0.0));
    let names: Vec<_> = found["biases"].as_array().unwrap().iter().map(|bias| bias["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["A1", "A2", "A3", "G1", "G2", "G3"]);
    let not_known = document["not_known"].to_string();
    assert!(not_known.contains("Earth's rate (up to 15 deg/h)") && not_known.contains("f dK/K"), "{not_known}");
    // The curves are those of the run but for their constants.
    let change = |axis: &Axis| axis.bias_at(70.0).0 - axis.bias_at(-10.0).0;
    let right = |[c1, c2]: [f64; 2]| c1 * 80.0 + c2 * (45.0 * 45.0 - 35.0 * 35.0);
    assert!((change(&content.axes[0]) - right([1.1e-4, -2e-6])).abs() < 1e-3, "{}", change(&content.axes[0]));
    assert!((change(&gyroscopes[0]) - right([12.0, -0.2])).abs() < 100.0, "{}", change(&gyroscopes[0]));
    assert_self_contained(
        &path.join("report.html"),
        &["What this method does not show: scale factors", "G3 without transient", "hysteresis explains as much"],
    );
    run(path, 0, &["check", "table.toml"]);

    // With a time constant the prediction decides; what it did without is warned of.
    let (document, table) = calibrated(path, "ramps.toml", &["--lag", "60"]);
    assert_eq!(document["transients"]["time_constant"]["given"], true);
    assert_eq!(table.content().lag_s, Some(60.0));
    assert!(
        document["transients"]["warnings"].to_string().contains("left to find the lag, the ramps would not show it")
    );

    // Gyroscopes on one side only.
    let names = |document: &Value| {
        document["findings"].as_array().unwrap().iter().map(|finding| finding["name"].clone()).collect::<Vec<_>>()
    };
    fs::write(path.join("simple.toml"), simple_table(false)).unwrap();
    let (document, table) = calibrated(path, "ramps.toml", &[]);
    assert!(names(&document) == ["ramp-sweeps", "ramp-gyroscopes"] && table.content().gyroscopes.is_none());
    let without = run_csv.lines().map(|line| line.split(',').take(15).collect::<Vec<_>>().join(",") + "\n");
    fs::write(path.join("run.csv"), without.collect::<String>()).unwrap();
    fs::write(path.join("simple.toml"), simple_table(true)).unwrap();
    let (document, table) = calibrated(path, "ramps.toml", &[]);
    assert_eq!(names(&document), ["ramp-sweeps", "ramp-gyroscopes"]);
    assert!(document["not_known"].to_string().contains("the gyroscopes: the ramps have none"));
    let before = CoefficientTable::from_toml(&simple_table(true), None).unwrap();
    assert_eq!(table.content().gyroscopes, before.content().gyroscopes);
}

#[test]
fn time_that_is_lost_in_a_ramp_is_a_warning() {
    let folder = folder();
    campaigns(folder.path());
    let arguments = ["calibrate", "turntable", "alone.toml", "-o", "table.toml"];
    let (_, words) = run(folder.path(), 0, &arguments);
    assert!(!words.contains("time-step"), "{words}");
    // Three rows of the first hour, the others numbered anew.
    let ramp = folder.path().join("ramp-1.csv");
    let text = fs::read_to_string(&ramp).unwrap();
    let (header, body) = text.split_once('\n').unwrap();
    let kept = body.lines().enumerate().filter(|(row, _)| ![100, 150, 200].contains(row));
    let rows = kept.enumerate().map(|(number, (_, row))| format!("{number},{}\n", row.split_once(',').unwrap().1));
    fs::write(&ramp, format!("{header}\n{}", rows.collect::<String>())).unwrap();
    let (_, words) = run(folder.path(), 0, &arguments);
    assert!(words.contains("warning [time-step]: ramp-1.csv: over ") && words.contains("without a hole"), "{words}");
    assert!(words.contains("; in all 0 rows missing in 0 gaps, 3 time steps"), "{words}");
}
