//! `compare` as a user types it.

use crate::common::{assert_self_contained, folder, run};
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/any_lab/compare");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

#[test]
fn years_of_tables() {
    let folder = folder();
    let table =
        |name: &str| fs::copy(format!("{DATA}/{name}.toml"), folder.path().join(format!("{name}.toml"))).unwrap();
    for name in [
        "2023",
        "2024",
        "2025",
        "2026",
        "same_other_form",
        "celsius",
        "far",
        "other_imu",
        "no_covariance",
        "full_alignment",
        "triangular_alignment",
    ] {
        table(name);
    }
    let compare = |code, arguments: &[&str]| run(folder.path(), code, &[&["compare"], arguments].concat());
    // A table with itself, with its copy, and with its copy under another name.
    let text = fs::read_to_string(folder.path().join("2023.toml")).unwrap();
    fs::write(folder.path().join("copy.toml"), &text).unwrap();
    let renamed: Vec<_> = text.lines().filter(|line| !line.starts_with("digest = ")).collect();
    fs::write(folder.path().join("renamed.toml"), renamed.join("\n").replace("imu-a", "imu-z")).unwrap();
    for (other, words) in [
        ("2023.toml", "the same table: 2023.toml and 2023.toml\n"),
        ("copy.toml", "the same table: 2023.toml and copy.toml\n"),
        ("renamed.toml", "the same table under another name: 2023.toml of imu-a, renamed.toml of imu-z\n"),
    ] {
        let (out, err) = compare(0, &["2023.toml", other, "--other-device"]);
        assert!(out.starts_with(words) && err == format!("isotherm: warning [same-table]: {words}"), "{out}{err}");
        compare(65, &["2023.toml", other, "--other-device", "--strict"]);
    }
    let (out, _) = compare(0, &["2023.toml", "2024.toml"]);
    assert!(
        out.starts_with("imu-a: 2024.toml (2024-03-05T10:00:00Z) less 2023.toml (2023-03-01T10:00:00Z)\n"),
        "{out}"
    );
    let line = out.lines().find(|line| line.starts_with("  A1 bias ")).unwrap();
    let figures: Vec<_> = line.split_whitespace().skip(2).collect();
    assert_eq!(figures, ["ug0", "4.038", "4.258", "1.1000", "0.064", "3.818", "4.772", "changed"]);
    assert!(out.contains("\nChanged by more than the errors: A1 bias, A1 positive_scale_factor, "), "{out}");
    assert!(out.contains("They do not hold what differs between two mountings of the IMU.\n"), "{out}");
    let bounds = |code, tables: [&str; 2], bounds: &str| compare(code, &[tables[0], tables[1], "--require", bounds]);
    let (_, err) = bounds(1, ["2023.toml", "2024.toml"], "bias=2ug0,scale=3ppm");
    assert!(
        err.starts_with(
            "isotherm: 2024.toml: the requirement is not met:\n  A1 bias: 4.258, with its band 3.818 to 4.772 ug0"
        ),
        "{err}"
    );
    assert!(err.ends_with(": beyond\nremedy: install the new table, and look for the cause\n"), "{err}");
    let (out, _) = bounds(0, ["2023.toml", "same_other_form.toml"], "bias=2ug0,scale=3ppm,alignment=1urad");
    assert!(
        out.contains("\nNothing has changed by more than the errors.\n") && out.ends_with("required: within\n"),
        "{out}"
    );
    let (_, err) = bounds(1, ["2023.toml", "2024.toml"], "bias=4.5ug0");
    assert!(err.ends_with(": undecided\nremedy: a longer campaign has smaller errors\n"), "{err}");
    let (out, err) = bounds(1, ["2023.toml", "no_covariance.toml"], "bias=2ug0");
    assert!(
        out.contains("only the values decide") && err.contains("5.130 ug0, errors not known, at most 2.000"),
        "{out}{err}"
    );
    for (name, reason) in [
        ("celsius.toml", "temperature in V and degC; give tables with one temperature"),
        ("other_imu.toml", "tables of two IMUs: imu-a, imu-b; give those of one, or --other-device"),
        ("far.toml", "A1 bias: no common range, [1.1, 3.9] and [4.0, 4.2]"),
    ] {
        let (_, err) = compare(78, &["2023.toml", name]);
        assert!(err.starts_with(&format!("isotherm: comparing tables: {reason}")), "{err}");
    }
    compare(0, &["2023.toml", "other_imu.toml", "--other-device"]);
    for (text, reason) in
        [("bias=2", "give a number with a unit"), ("10", "is not a bound"), ("bias=2ug0,bias=2ug0", "given twice")]
    {
        let (_, err) = bounds(64, ["2023.toml", "2024.toml"], text);
        assert!(err.contains(reason), "{err}");
    }
    compare(64, &["2023.toml"]);
    compare(74, &["2023.toml", "none.toml"]);
    let (out, _) = compare(0, &["2026.toml", "2023.toml", "2025.toml", "2024.toml", "--report", "years.html"]);
    assert!(
        out.contains(": 4 tables; the newest, 2026.toml (2026-") && out.contains("over the dates, at mid range"),
        "{out}"
    );
    let line = out.lines().rfind(|line| line.starts_with("  A1 bias ")).unwrap();
    assert!(line.contains(" ug0/year    3.996           0.075    1.89e-5"), "{line}");
    assert_self_contained(&folder.path().join("years.html"), &["Over the dates", "µg/year", "3.996 ± 0.075", "A3 K-"]);
    let (out, _) = compare(0, &["full_alignment.toml", "triangular_alignment.toml"]);
    assert!(out.contains("They are compared with three"), "{out}");
    // The report must not be a table.
    let (_, err) = compare(64, &["2023.toml", "2024.toml", "--report", "2024.toml"]);
    assert!(err.contains("2024.toml"), "{err}");
}

#[test]
fn tables_of_calibrate() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let campaign = format!("{EXAMPLES}/campaign/campaign.toml");
    run(folder.path(), 0, &["calibrate", "turntable", &campaign, "-o", "a.toml", "--alignment"]);
    run(folder.path(), 0, &["calibrate", "turntable", &campaign, "-o", "b.toml", "--alignment", "--order", "4"]);
    let require = ["--require", "bias=0.001ug0,scale=0.001ppm,alignment=0.01urad", "--json"];
    // A table equals itself, but its errors reach over a bound that is smaller than they are.
    let (out, _) = run(folder.path(), 1, &[&["compare", "a.toml", "a.toml"], &require[..]].concat());
    let found: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&found["verdict"], &found["errors_known"]), (&"undecided".into(), &true.into()), "{out}");
    assert_eq!(found["curves"][4]["largest_in_unit"], 0.0);
    assert!(found["alignments"][0]["half_width_urad"][0][1].as_f64().unwrap() > 0.0, "{out}");
    // Other orders are other coefficients of the same curves: 5 instead of 4.
    let (out, _) = run(folder.path(), 0, &["compare", "a.toml", "b.toml", "--require", "bias=20ug0,scale=50ppm"]);
    assert!(out.contains("\nNothing has changed by more than the errors.\n"), "{out}");
    // Without its provenance a table has values only, and no date.
    let text = fs::read_to_string(at("a.toml")).unwrap();
    fs::write(at("bare.toml"), &text[..text.find("[provenance]").unwrap()]).unwrap();
    let (out, _) = run(folder.path(), 0, &["compare", "a.toml", "bare.toml"]);
    assert!(out.contains("Whether anything has changed by more than the errors is not known.\n"), "{out}");
    let (_, err) = run(folder.path(), 78, &["compare", "a.toml", "bare.toml", "b.toml"]);
    assert!(err.contains("bare.toml: its provenance has no time; a line over the dates needs"), "{err}");
}

#[test]
fn gyroscopes() {
    let folder = folder();
    let campaign = format!("{DATA}/../../gyro/campaign.toml");
    run(folder.path(), 0, &["calibrate", "turntable", &campaign, "-o", "whole.toml"]);
    let (out, _) = run(
        folder.path(),
        0,
        &["compare", "whole.toml", "whole.toml", "--require", "bias=50ug0,rate=0.5deg/h,scale=100ppm"],
    );
    assert_eq!(out.matches(" not changed\n").count(), 18 + 2, "{out}");
    assert!(out.contains("\nThe g-sensitivities of the gyroscopes are not compared.\n"), "{out}");
    let judged =
        |name: &str| out.lines().filter(|line| line.contains(name) && line.ends_with("required: within")).count();
    assert_eq!((judged("deg/h"), judged("ppm"), judged("ug0")), (3, 12, 3), "{out}");
    // Next to a table without gyroscopes only the accelerometers are compared, and no bound of a gyroscope is met.
    let text = fs::read_to_string(folder.path().join("whole.toml")).unwrap();
    let bare = &text[..text.find("[[gyroscope]]").unwrap()];
    let bare: String =
        bare.lines().filter(|line| !line.starts_with("digest")).map(|line| format!("{line}\n")).collect();
    fs::write(folder.path().join("bare.toml"), bare).unwrap();
    let (out, err) = run(folder.path(), 1, &["compare", "whole.toml", "bare.toml", "--require", "rate=1deg/h"]);
    assert!(out.contains("\nbare.toml: no gyroscopes, so that those of the others are not compared.\n"), "{out}");
    assert!(err.contains("rate: not judged, the tables do not all have gyroscopes\nremedy: leave rate out"), "{err}");
}
