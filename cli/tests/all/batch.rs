//! `calibrate` of several IMUs of one campaign file, as a user types it.

use crate::common::{assert_page, assert_self_contained, folder, other_device, run};
use serde_json::Value;
use std::fs;
use std::path::Path;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data");
const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// The campaign file of the example for three IMUs: `imu-b` is turned by a quarter about A3.
fn campaign() -> String {
    let imus = "imus = [{ id = \"imu-a\", serial = \"17\" }, { id = \"imu-b\", mounting = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] }, { id = \"imu-c\" }]\n\
                samples = \"{imu}.csv\"";
    let text = fs::read_to_string(format!("{EXAMPLES}/campaign/campaign.toml")).unwrap();
    text.replace("imu = \"imu-paper\"\nsamples = \"samples.csv\"", imus)
}

/// The samples of the example as an IMU sees them that is turned by a quarter about A3: its A1 is along the old A2, its
/// A2 against the old A1.
fn turned(samples: &str) -> String {
    let mut lines = samples.lines();
    let header: Vec<_> = lines.next().unwrap().split(',').collect();
    let source = |name: &str| {
        let old = match name {
            "a2_positive" => "a1_negative".to_owned(),
            "a2_negative" => "a1_positive".to_owned(),
            _ => match name.split_once('_') {
                Some(("a1", rest)) => format!("a2_{rest}"),
                Some(("a2", rest)) => format!("a1_{rest}"),
                _ => name.to_owned(),
            },
        };
        header.iter().position(|column| *column == old).unwrap()
    };
    let order: Vec<_> = header.iter().map(|name| source(name)).collect();
    let rows = lines.map(|line| {
        let fields: Vec<_> = line.split(',').collect();
        order.iter().map(|index| fields[*index]).collect::<Vec<_>>().join(",") + "\n"
    });
    header.join(",") + "\n" + &rows.collect::<String>()
}

/// A table file without the line for the time.
fn timeless(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains("\ntime = \""));
    text.lines().filter(|line| !line.starts_with("time = ")).collect::<Vec<_>>().join("\n")
}

#[test]
fn one_bad_imu_of_three_is_dropped_and_the_others_are_as_alone() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    fs::write(at("campaign.toml"), campaign()).unwrap();
    fs::write(at("imu-a.csv"), &samples).unwrap();
    fs::write(at("imu-b.csv"), turned(&samples)).unwrap();
    // Nine seconds for ten: a fault.
    fs::write(at("imu-c.csv"), samples.replace(",10000000000,", ",9000000000,")).unwrap();
    for name in ["tables", "reports", "alone"] {
        fs::create_dir(at(name)).unwrap();
    }
    let (out, _) = run(folder.path(), 0, &["check", "campaign.toml"]);
    assert!(out.contains("campaign of imu-a, imu-b, imu-c, 12 positions that observe everything"), "{out}");
    let batch = [
        "calibrate",
        "turntable",
        "campaign.toml",
        "-o",
        "tables/{imu}.toml",
        "--report",
        "reports/{imu}.html",
        "--batch",
        "batch.html",
    ];
    let (_, err) = run(folder.path(), 1, &batch);
    assert!(err.contains("\nisotherm: imu-c is dropped: fault [interval]: "), "{err}");
    assert!(err.ends_with("\nisotherm: campaign.toml: 1 of 3 IMUs dropped, the reasons are above: imu-c\n"), "{err}");
    assert!(
        err.contains("batch of 2 devices\n") && err.contains("2 devices are too few to say whether one stands out"),
        "{err}"
    );
    assert!(!at("tables/imu-c.toml").exists() && !at("reports/imu-c.html").exists());
    assert_self_contained(&at("reports/imu-b.html"), &["imu-b", "Error budget"]);
    assert_page(&at("batch.html"), 2, &["imu-c is dropped", "[interval]", "A1 bias slope", "One curve for all"]);
    // By itself: the same file, and a choice.
    for imu in ["imu-a", "imu-b"] {
        run(folder.path(), 0, &["calibrate", "turntable", "campaign.toml", "-o", "alone/{imu}.toml", "--imu", imu]);
        let [table, alone] = ["tables", "alone"].map(|name| timeless(&at(&format!("{name}/{imu}.toml"))));
        assert_eq!(table, alone);
    }
    assert!(timeless(&at("tables/imu-a.toml")).contains("serial = \"17\""));
    let (_, err) = run(
        folder.path(),
        65,
        &["calibrate", "turntable", "campaign.toml", "-o", "alone/imu-c.toml", "--imu", "imu-c"],
    );
    assert!(err.contains("[interval]"), "{err}");
    // The turned IMU's A1 is the other's A2, by its curves.
    let swapped = fs::read_to_string(at("tables/imu-b.toml")).unwrap();
    let a = fs::read_to_string(at("tables/imu-a.toml")).unwrap();
    let c0 = |text: &str, axis: usize, quantity: &str| -> f64 {
        let part = text.split("[[axis]]").nth(axis).unwrap();
        let line = part.lines().find(|line| line.starts_with(quantity)).unwrap();
        line.split("c0 = ").nth(1).unwrap().split([',', ' ', '}']).next().unwrap().parse().unwrap()
    };
    assert!((c0(&swapped, 1, "bias") - c0(&a, 2, "bias")).abs() < 0.01);
    assert!((c0(&swapped, 2, "bias") + c0(&a, 1, "bias")).abs() < 0.01);
    assert!((c0(&swapped, 2, "positive_scale_factor") + c0(&a, 1, "negative_scale_factor")).abs() < 0.1);
    // As JSON.
    let (out, err) = run(folder.path(), 1, &[&batch[..], &["--json"]].concat());
    let document: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}{err}"));
    assert_eq!(document["imus"][1]["calibration"]["imu"], "imu-b");
    assert_eq!(document["imus"][2]["dropped"]["exit_code"], 65);
    assert_eq!(document["batch"]["devices"], serde_json::json!(["imu-a", "imu-b"]));
    // A file that is missing drops its IMU too; of what is left there are no statistics.
    fs::remove_file(at("imu-a.csv")).unwrap();
    let (_, err) = run(folder.path(), 1, &batch);
    assert!(err.contains("imu-a is dropped: ") && err.contains("2 of 3 IMUs dropped"), "{err}");
    assert!(err.contains("statistics of the batch: there are fewer than two tables"), "{err}");
}

#[test]
fn an_output_that_fails_ends_the_command() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let text = campaign();
    fs::write(at("campaign.toml"), &text).unwrap();
    let samples = fs::read_to_string(format!("{EXAMPLES}/campaign/samples.csv")).unwrap();
    for (more, imu) in ["imu-a", "imu-b", "imu-c"].into_iter().enumerate() {
        fs::write(at(&format!("{imu}.csv")), other_device(&samples, more as u32)).unwrap();
    }
    // No folder: no IMU can have its table.
    let (_, err) = run(folder.path(), 74, &["calibrate", "turntable", "campaign.toml", "-o", "none/{imu}.toml"]);
    assert!(err.contains("there is no folder none") && !err.contains("dropped") && !err.contains("imu-b:"), "{err}");
    // A place that cannot be written, after the fit of the first one.
    fs::create_dir(at("imu-b.toml")).unwrap();
    let (_, err) = run(folder.path(), 74, &["calibrate", "turntable", "campaign.toml", "-o", "{imu}.toml"]);
    assert!(err.contains("imu-b.toml") && !err.contains("dropped") && at("imu-a.toml").exists(), "{err}");
    assert!(!at("imu-c.toml").exists());
    // The table of one IMU in the place of another one's samples, which is read later: nothing is written.
    let text = text.replace("id = \"imu-a\"", "id = \"x-imu-c\"").replace("{imu}.csv", "x-{imu}.csv");
    fs::write(at("crossed.toml"), text).unwrap();
    for imu in ["x-imu-c", "imu-b", "imu-c"] {
        fs::write(at(&format!("x-{imu}.csv")), &samples).unwrap();
    }
    let (_, err) = run(folder.path(), 64, &["calibrate", "turntable", "crossed.toml", "-o", "{imu}.csv"]);
    assert!(err.contains("x-imu-c.csv is the recording; write to another file"), "{err}");
    assert_eq!(fs::read_to_string(at("x-imu-c.csv")).unwrap(), samples);
}

#[test]
fn names_that_imus_would_share_are_refused() {
    let folder = folder();
    fs::write(folder.path().join("campaign.toml"), campaign()).unwrap();
    let refused = |arguments: &[&str], expected: &str| {
        let (_, err) = run(folder.path(), 64, &[&["calibrate", "turntable", "campaign.toml"], arguments].concat());
        assert!(err.contains(expected), "{err}");
    };
    refused(
        &["-o", "table.toml"],
        "-o table.toml: there are 3 IMUs; give a name with {imu} in it, or choose one with --imu",
    );
    refused(&["-o", "{imu}.toml", "--report", "r.html"], "--report r.html: there are 3 IMUs");
    refused(&["samples.csv", "-o", "{imu}.toml"], "samples: there are 3 IMUs");
    refused(
        &["-o", "{imu}.toml", "--imu", "imu-d"],
        "--imu: campaign.toml: there is no imu-d; it has imu-a, imu-b, imu-c",
    );
    let (_, err) = run(
        folder.path(),
        64,
        &["calibrate", "turntable", "campaign.toml", "-o", "{imu}.toml", "--batch", "campaign.toml"],
    );
    assert!(err.contains("campaign.toml"), "{err}");
    let twice = campaign().replace("imu-c", "imu-a");
    fs::write(folder.path().join("twice.toml"), twice).unwrap();
    let (_, err) = run(folder.path(), 78, &["calibrate", "turntable", "twice.toml", "-o", "{imu}.toml"]);
    assert!(
        err.contains("twice.toml:2: imus.3.id: imu-a is there twice")
            || err.contains("line 2: imus.3.id: imu-a is there twice"),
        "{err}"
    );
}

#[test]
fn five_real_units_without_a_turntable() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let names: Vec<_> = (0..5).map(|unit| format!("imu{unit}")).collect();
    for name in &names {
        fs::copy(format!("{DATA}/any_lab/five_mpu9150/{name}.csv"), at(&format!("{name}.csv"))).unwrap();
    }
    let imus: Vec<_> = names.iter().map(|name| format!("{{ id = \"{name}\" }}")).collect();
    let text = format!(
        "format = 1\nmethod = \"gravity-only\"\nimus = [{}]\nsamples = \"{{imu}}.csv\"\ngravity_reference = 9.81\n\
         gravity_local = 9.81\ntemperature_unit = \"degC\"\n",
        imus.join(", ")
    );
    fs::write(at("campaign.toml"), text).unwrap();
    let range = ["--temperature-range", "20,30", "--json", "--batch", "batch.html"];
    let (out, err) =
        run(folder.path(), 0, &[&["calibrate", "tumble", "campaign.toml", "-o", "{imu}.toml"], &range[..]].concat());
    let document: Value = serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error}: {out}{err}"));
    let quantity = |name: &str| {
        let all = document["batch"]["quantities"].as_array().unwrap();
        all.iter().find(|quantity| quantity["name"].as_str().unwrap().starts_with(name)).unwrap()
    };
    // The published values of the same devices, in 1e-3 g0.
    let published = fs::read_to_string(format!("{DATA}/any_lab/five_mpu9150/batch.csv")).unwrap();
    let biases =
        published.lines().filter(|line| line.contains(",A3 bias mg,")).map(|line| line.rsplit(',').next().unwrap());
    for (found, published) in quantity("A3 bias at ")["values_in_unit"].as_array().unwrap().iter().zip(biases) {
        let published: f64 = published.parse().unwrap();
        assert!((found.as_f64().unwrap() / 1e3 - published).abs() < 0.2, "{found} {published}");
    }
    // One temperature: a constant is one quantity, and a single K too. Three biases, three K, three misalignments, the
    // residual.
    assert_eq!(document["batch"]["quantities"].as_array().unwrap().len(), 10, "{out}");
    assert_eq!(document["batch"]["stand_outs"], serde_json::json!([]));
    assert!(fs::read_to_string(at("batch.html")).unwrap().contains("No device stands out"));
    // The other options of a calibration without a turntable.
    let more = ["--scale-factor", "single", "--window", "2", "--no-misalignment"];
    let command = [&["calibrate", "tumble", "campaign.toml", "-o", "{imu}.toml"], &range[..], &more[..]].concat();
    let (out, _) = run(folder.path(), 0, &command);
    let document: Value = serde_json::from_str(&out).unwrap();
    let names: Vec<_> = document["batch"]["quantities"].as_array().unwrap().iter().map(|it| &it["name"]).collect();
    assert!(names.len() >= 7 && !names.iter().any(|name| name.as_str().unwrap().contains("misalignment")), "{names:?}");
    assert_eq!(document["batch"]["stand_outs"], serde_json::json!([]));
}
