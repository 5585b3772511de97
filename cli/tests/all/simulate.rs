//! `simulate campaign` and `simulate run` of a whole IMU as a user types them. The physics is tested in
//! `calibration/fit/tests/gyroscopes`.

use isotherm_campaign::{Campaign, laboratory_axes};
use isotherm_fit::{CalibrationOptions, calibrate, read_measurements};
use isotherm_recording::{CampaignCsvReader, RawCsvReader};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::ARCSEC;
use isotherm_simulation::worst_gyroscope_errors;
use std::fs::{self, File};
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");

/// Runs `isotherm simulate` in `folder`, which must end with `code`. Returns what it printed on stderr.
fn simulate(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    let output = command.arg("simulate").args(arguments).current_dir(folder).output().unwrap();
    let err = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{err}");
    err
}

fn folder() -> TempDir {
    tempfile::Builder::new().prefix("iso-").tempdir().unwrap()
}

fn toml(path: &Path) -> toml::Table {
    fs::read_to_string(path).unwrap().parse().unwrap()
}

fn numbers(value: &toml::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_float().unwrap()).collect()
}

fn table(path: &Path) -> CoefficientTable {
    CoefficientTable::from_toml(&fs::read_to_string(path).unwrap(), None).unwrap()
}

fn header(path: &Path) -> String {
    fs::read_to_string(path).unwrap().lines().next().unwrap().to_owned()
}

/// Calibrates the campaign in `folder` with the library. The worst errors against its truth: D \[deg/h\], K \[ppm\], s
/// \[deg/h/g0\], M \[rad\].
fn errors(folder: &Path) -> [f64; 4] {
    let campaign = Campaign::from_toml(&fs::read_to_string(folder.join("campaign.toml")).unwrap()).unwrap();
    let rows = CampaignCsvReader::new(File::open(folder.join("samples.csv")).unwrap()).unwrap();
    let measurements = read_measurements(&campaign, rows).unwrap();
    let calibration = calibrate(&campaign, measurements, CalibrationOptions::default()).unwrap();
    worst_gyroscope_errors(&calibration.table, &table(&folder.join("truth.toml"))).unwrap()
}

fn assert_within_bounds(name: &str, errors: [f64; 4]) {
    println!(
        "{name}: D {:.4} deg/h, K {:.2} ppm, s {:.4} deg/h/g0, M {:.1e} rad",
        errors[0], errors[1], errors[2], errors[3]
    );
    assert!(errors.iter().zip([0.013, 4.0, 0.006, 7e-7]).all(|(error, bound)| *error < bound), "{name}: {errors:?}");
}

#[test]
fn a_campaign_with_gyroscopes_is_calibrated_to_its_truth() {
    let folder = folder();
    let at = |name: &str| folder.path().join("c").join(name);
    simulate(
        folder.path(),
        0,
        &["campaign", "-o", "c", "--gyroscopes", "--vary", "--seed", "4", "--latitude", "-33.9"],
    );
    let campaign = toml(&at("campaign.toml"));
    assert_eq!(campaign["latitude_deg"].as_float(), Some(-33.9));
    let turns: Vec<_> = campaign["turn"].as_array().unwrap().iter().map(|turn| turn.as_table().unwrap()).collect();
    let angles: Vec<_> = turns.iter().map(|turn| turn["angle_deg"].as_integer().unwrap()).collect();
    assert_eq!(angles, [720, -720, 720, -720, 720, -720]);
    assert_eq!((turns[0]["number"].as_integer(), turns[5]["number"].as_integer()), (Some(13), Some(18)));
    let truth = toml(&at("truth.toml"));
    assert_eq!(truth["format"].as_integer(), Some(2));
    let provenance = &truth["provenance"];
    assert_eq!(provenance["latitude_deg"].as_float(), Some(-33.9));
    let misalignment = numbers(&provenance["gyroscope_misalignment"][1]);
    assert!((misalignment[1] - 1.0).abs() < 1e-15 && misalignment[0].abs() < 2e-3, "{misalignment:?}");
    assert_eq!(provenance["turns"]["rest_s"].as_float(), Some(5.0));
    assert_eq!(provenance["noise"]["random_walk"].as_float(), Some(0.003));
    let earth = numbers(&provenance["earth_rate_deg_h"]);
    assert!((earth.iter().map(|w| w * w).sum::<f64>().sqrt() - 15.041067).abs() < 1e-6 && earth[2] < -8.0, "{earth:?}");
    assert_within_bounds("720 deg", errors(&folder.path().join("c")));
}

#[test]
#[ignore = "half a minute: cargo test -p isotherm-cli --test all fourteen -- --ignored --nocapture"]
fn fourteen_campaigns_of_each_angle() {
    for angle in ["360", "720"] {
        let mut worst = [0.0_f64; 4];
        for seed in 200..214 {
            let (folder, seed) = (folder(), seed.to_string());
            let vary = ["campaign", "-o", ".", "--gyroscopes", "--vary", "--turn-angle", angle, "--seed", &seed];
            simulate(folder.path(), 0, &vary);
            let errors = errors(folder.path());
            assert_within_bounds(&format!("{angle} deg, seed {seed}"), errors);
            worst = [0, 1, 2, 3].map(|k| worst[k].max(errors[k]));
        }
        assert_within_bounds(&format!("worst of 14, {angle} deg"), worst);
    }
}

#[test]
fn a_truth_with_gyroscopes_gives_a_run_with_them_at_angles_that_it_says() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    simulate(folder.path(), 0, &["run", "-o", "first", "--gyroscopes", "--hold", "60", "--ramp", "600"]);
    let arguments =
        ["--truth", "first/truth.toml", "--attitude", "0,1,-1", "--hold", "3600", "--ramp", "600", "--interval", "1"];
    simulate(folder.path(), 0, &[&["run", "-o", "run"][..], &arguments].concat());
    let truth = toml(&at("run/truth.toml"));
    let provenance = &truth["provenance"];
    let [outer, inner] = ["outer_deg", "inner_deg"].map(|key| provenance[key].as_float().unwrap());
    assert!((outer - 135.0).abs() < 0.01 && (inner.min(360.0 - inner)) < 0.01, "{outer} {inner}");
    // Over the first hold of an hour the truth gives Earth's rate at these angles: a random walk of 0.003 deg/sqrt(h),
    // an offset of 0.003 deg/h of the visit.
    let earth = numbers(&provenance["earth_rate_deg_h"]);
    let axes = laboratory_axes(outer, inner);
    let table = table(&at("run/truth.toml"));
    let mut sum = [0.0; 3];
    for raw in RawCsvReader::new(File::open(at("run/run.csv")).unwrap()).unwrap().take(3600) {
        let increment = answer(Some(&table), &raw.unwrap());
        assert_eq!(increment.flags, 0);
        (0..3).for_each(|i| sum[i] += increment.angle_increment[i] / ARCSEC / 3600.0);
    }
    for i in 0..3 {
        let right: f64 = (0..3).map(|k| axes[k][i] * earth[k]).sum();
        assert!((sum[i] - right).abs() < 0.02, "{i}: {} {right}", sum[i]);
    }
}

#[test]
fn without_gyroscopes_nothing_mentions_them() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let small = ["--set-points", "0:10:10", "--dwell", "20"];
    simulate(folder.path(), 0, &[&["campaign", "-o", "plain"][..], &small].concat());
    simulate(folder.path(), 0, &[&["campaign", "-o", "whole", "--gyroscopes"][..], &small].concat());
    for name in ["samples.csv", "campaign.toml", "truth.toml"] {
        let [plain, whole] = ["plain", "whole"].map(|folder| fs::read_to_string(at(folder).join(name)).unwrap());
        for word in ["gyro", "g1_", "turn", "latitude", "heading", "earth", "random_walk"] {
            assert!(!plain.contains(word), "{name} has {word}");
        }
        assert!(
            plain != whole && (whole.contains("gyro") || whole.contains("g1_") || whole.contains("turn")),
            "{name}"
        );
    }
    // The accelerometers of the first set point are the same numbers.
    let first = |folder: &str| -> Vec<String> {
        let text = fs::read_to_string(at(folder).join("samples.csv")).unwrap();
        text.lines().take(25).map(|line| line.split(',').take(17).collect::<Vec<_>>().join(",")).collect()
    };
    assert_eq!(first("plain"), first("whole"));
    assert!(
        header(&at("whole/samples.csv"))
            .ends_with(",g1_board,g2_positive,g2_negative,g2_head,g2_board,g3_positive,g3_negative,g3_head,g3_board")
    );
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = folder();
    let err = simulate(folder.path(), 64, &["run", "-o", "run", "--latitude", "50"]);
    assert!(err.contains("only gyroscopes feel it; give --gyroscopes too"), "{err}");
    let err = simulate(folder.path(), 64, &["campaign", "-o", "c", "--turn-angle", "360"]);
    assert!(err.contains("without gyroscopes there are no turns; give --gyroscopes too"), "{err}");
    let err = simulate(folder.path(), 64, &["run", "-o", "run", "--gyroscopes", "--latitude", "91"]);
    assert!(err.contains("give a number from -90 to 90, north positive"), "{err}");
    simulate(folder.path(), 64, &["campaign", "-o", "c", "--gyroscopes", "--turn-angle", "90"]);
    // A table of another kind of temperature gets gyroscopes with that temperature.
    let degrees = format!("{EXAMPLES}/tables/imu-b.toml");
    simulate(
        folder.path(),
        0,
        &[
            "run",
            "-o",
            "run",
            "--truth",
            &degrees,
            "--gyroscopes",
            "--temperatures",
            "0,20",
            "--ramp",
            "600",
            "--hold",
            "60",
        ],
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
