//! `calibrate tumble` and `verify` of its tables, as a user types them.

use crate::common::{assert_page, folder, isotherm, run};
use serde_json::Value;
use std::fs;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration/fit/tests/data/any_lab");

fn arguments<'a>(recording: &'a str, gravity: [&'a str; 2], more: &[&'a str]) -> Vec<&'a str> {
    let [local, reference] = gravity;
    let options = ["--imu", "imu-t", "--gravity-local", local, "--gravity-reference", reference];
    let unit = ["--temperature-unit", "degC", "-o", "table.toml"];
    [&["calibrate", "tumble", recording][..], &options, &unit, more].concat()
}

#[test]
fn a_table_without_a_turntable_is_verified_by_lengths() {
    let folder = folder();
    let tumble = format!("{DATA}/tumble3/recording.csv");
    let calibrate = arguments(&tumble, ["9.79179", "9.80665"], &["--report", "r.html"]);
    let (out, err) = run(folder.path(), 0, &calibrate);
    assert!(
        out.is_empty() && err.starts_with("78 static poses in 3 groups at 3 temperatures, 0 too short, digest sha256:"),
        "{out}{err}"
    );
    assert!(err.contains("not observable without a turntable: a rotation"), "{err}");
    let (out, _) = run(folder.path(), 0, &["check", "table.toml"]);
    assert!(out.contains("seal intact"), "{out}");
    assert_page(&folder.path().join("r.html"), 9, &["without a turntable", "SHA-256 of a recording"]);
    // Local gravity is that of the provenance, and the lengths are compared without being asked for.
    // It is the recording that made the table, also a part of it, and from stdin.
    let (out, err) = run(folder.path(), 0, &["verify", "--table", "table.toml", &tumble]);
    assert!(out.starts_with("this recording made the table: no evidence\n78 static poses"), "{out}");
    assert!(err.starts_with(&format!("isotherm: warning [own-recording]: {tumble}: this recording made")), "{err}");
    let text = fs::read_to_string(&tumble).unwrap();
    let part: Vec<_> = text.lines().enumerate().filter(|(row, _)| *row == 0 || *row > 3000).collect();
    let part: String = part.into_iter().map(|(_, line)| format!("{line}\n")).collect();
    fs::write(folder.path().join("part.csv"), part).unwrap();
    let own = ["verify", "--table", "table.toml", "part.csv", "--require", "scale=50ppm"];
    let (out, err) = run(folder.path(), 1, &own);
    assert!(out.starts_with("this recording made the table: no evidence\n"), "{out}");
    assert!(err.contains("Nothing can be claimed: this recording made the table: no evidence."), "{err}");
    // Without the rows' marks and hashes it is any recording.
    let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    let kept = table.lines().filter(|line| !line.starts_with("rows = ") && !line.starts_with("recordings_sha256 = "));
    fs::write(folder.path().join("table.toml"), kept.map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    let verify = ["verify", "--table", "table.toml", &tumble, "--require", "scale=50ppm", "--report", "v.html"];
    let (out, _) = run(folder.path(), 0, &verify);
    assert!(out.starts_with("78 static poses, 0 too short\nLocal gravity 9.79179 m/s2, from the provenance"), "{out}");
    assert!(out.contains("at most 50.000 ppm is required: met"), "{out}");
    assert_page(&folder.path().join("v.html"), 0, &["Met", "scale: the length"]);
    let (out, err) = run(folder.path(), 1, &[&verify[..5], &["scale=1ppm,bias=20ug0"]].concat());
    assert!(out.contains("missed") && err.contains("bias: not judged, static poses"), "{out}{err}");
    let (out, _) = run(folder.path(), 0, &["verify", "--table", "table.toml", &tumble, "--json"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&document["judged_by"], &document["static_poses"]), (&"static_poses".into(), &78.into()));
    // Compensated by replay, a static pose has the length that verify says.
    run(folder.path(), 0, &["replay", "--table", "table.toml", &tumble, "-o", "increments.csv"]);
    let rows: Vec<Vec<f64>> = fs::read_to_string(folder.path().join("increments.csv"))
        .unwrap()
        .lines()
        .skip(1)
        .take(96)
        .map(|line| line.split(',').take(6).map(|field| field.parse().unwrap()).collect())
        .collect();
    let sum = |column: usize| rows.iter().map(|row| row[column]).sum::<f64>() / (96.0 * 0.05);
    let length = libm::hypot(libm::hypot(sum(3), sum(4)), sum(5)) / 9.80665 - 9.79179 / 9.80665;
    let first = document["static_pose"][0].clone();
    assert_eq!(first["rows"], 96);
    assert!((length - first["error_g0"].as_f64().unwrap()).abs() < 1e-9, "{length} {first}");
}

#[test]
fn a_campaign_file_and_the_options_give_the_same_digest() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let xsens = format!("{DATA}/xsens/recording.csv");
    run(folder.path(), 0, &arguments(&xsens, ["9.81", "9.81"], &["--temperature-range", "0,50"]));
    fs::copy(&xsens, at("desk.csv")).unwrap();
    let file = "format = 1\nmethod = \"gravity-only\"\nimu = \"imu-t\"\nsamples = \"desk.csv\"\ngravity_reference = 9.81\ngravity_local = 9.81\n\
                temperature_unit = \"degC\"\n";
    fs::write(at("campaign.toml"), file).unwrap();
    let (out, _) = run(folder.path(), 0, &["check", "campaign.toml"]);
    assert!(out.contains("campaign.toml"), "{out}");
    let calibrate =
        ["calibrate", "tumble", "campaign.toml", "--temperature-range", "0,50", "-o", "other.toml", "--json"];
    let (out, _) = run(folder.path(), 0, &calibrate);
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(document["static_poses"], 40);
    assert_eq!(document["scale_factor"], "single");
    let digest = |name: &str| {
        let text = fs::read_to_string(at(name)).unwrap();
        text.lines().find(|line| line.starts_with("digest = ")).unwrap().to_owned()
    };
    assert_eq!(digest("table.toml"), digest("other.toml"));
    // Verified at one attitude, the run is one as any other.
    let (_, err) =
        run(folder.path(), 64, &["calibrate", "turntable", "campaign.toml", "-o", "x.toml", "--method", "two-stage"]);
    assert!(err.contains("a campaign without a turntable; `isotherm calibrate tumble campaign.toml` makes"), "{err}");
    let (_, err) =
        run(folder.path(), 64, &["calibrate", "tumble", "campaign.toml", "-o", "x.toml", "--gravity-local", "9.8"]);
    assert!(err.contains("--gravity-local is only for recordings"), "{err}");
    let plain = format!("{}/../examples/campaign/campaign.toml", env!("CARGO_MANIFEST_DIR"));
    let (_, err) = run(folder.path(), 64, &["calibrate", "tumble", &plain, "-o", "x.toml", "--scale-factor", "single"]);
    assert!(err.contains("a campaign on a turntable; `isotherm calibrate turntable "), "{err}");
    let (_, err) = run(folder.path(), 64, &["calibrate", "turntable", &plain, "-o", "x.toml", "--exclude", "3"]);
    assert!(err.contains("SET_POINT/NUMBER"), "{err}");
}

#[test]
fn a_refusal_names_parameters_and_writes_nothing() {
    let folder = folder();
    let ferraris = format!("{DATA}/ferraris/recording.csv");
    let gravity = ["9.81", "9.81"];
    let json = isotherm(folder.path(), &arguments(&ferraris, gravity, &["--temperature-range", "0,50", "--json"]));
    assert_eq!(json.status.code(), Some(65));
    let document: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(document["parameters"], serde_json::json!(["m12", "m13", "m23"]));
    assert!(document["attitude"].as_str().unwrap().contains("up"), "{document}");
    let (_, err) = run(folder.path(), 65, &arguments(&ferraris, gravity, &[]));
    assert!(err.contains("6 static poses for 9 unknowns"), "{err}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    let without = arguments(&ferraris, gravity, &["--temperature-range", "0,50", "--no-misalignment", "--json"]);
    let (out, _) = run(folder.path(), 0, &without);
    let document: Value = serde_json::from_str(&out).unwrap();
    assert!(document["bias_standard_error_g0"].is_null() && document["degrees_of_freedom"] == 0, "{document}");
    // All four facts are needed.
    let (_, err) = run(folder.path(), 64, &["calibrate", "tumble", &ferraris, "-o", "t.toml", "--imu", "i"]);
    assert!(err.contains("--gravity-local"), "{err}");
    let (_, err) = run(
        folder.path(),
        65,
        &arguments(&ferraris, gravity, &["--strict", "--no-misalignment", "--temperature-range", "0,50"]),
    );
    assert!(err.contains("fault [no-freedom]: "), "{err}");
}

/// Gravity of a place that the person does not know, and a check where he does.
#[test]
fn local_gravity_comes_from_latitude_and_height() {
    let folder = folder();
    let tumble = format!("{DATA}/tumble3/recording.csv");
    let facts = ["--imu", "imu-t", "--gravity-reference", "9.80665", "--temperature-unit", "degC", "-o", "table.toml"];
    let calibrate =
        |code, more: &[&str]| run(folder.path(), code, &[&["calibrate", "tumble", &tumble][..], &facts, more].concat());
    let place = ["--latitude", "28.9", "--height", "200"];
    let (_, err) = calibrate(0, &[&place[..], &["--report", "r.html"]].concat());
    let words =
        "local gravity 9.79178 +- 0.00100 m/s2, normal gravity at latitude 28.9 and height 200 m: its 102 ppm are in";
    assert!(err.contains(words) && err.contains(" +- 102.3 ppm") && !err.contains("local-gravity"), "{err}");
    let table = fs::read_to_string(folder.path().join("table.toml")).unwrap();
    let keys = "gravity_source = \"normal\"\ngravity_half_width = 0.00099876";
    assert!(table.contains(keys) && table.contains("\nlatitude_deg = 28.9\nheight_m = 200.0\n"), "{table}");
    let page = fs::read_to_string(folder.path().join("r.html")).unwrap();
    assert!(page.contains("9.79178 ± 0.00100 m/s², normal gravity at latitude 28.9"));
    let (out, _) = calibrate(0, &[&place[..], &["--json"]].concat());
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(document["gravity_source"], "normal");
    assert!((document["gravity_half_width_ppm"].as_f64().unwrap() - 102.0).abs() < 1e-9, "{document}");
    let (_, err) = calibrate(0, &[&place[..], &["--gravity-local", "9.79179"]].concat());
    assert!(err.contains(" +- 7.8 ppm") && !err.contains("local gravity"), "{err}");
    let wrong = ["--latitude", "-28.9", "--height", "1200", "--gravity-local", "9.79179"];
    let (_, err) = calibrate(0, &wrong);
    assert!(
        err.contains("warning [local-gravity]: local gravity is 9.79179, but normal gravity at latitude -28.9"),
        "{err}"
    );
    let (_, err) = calibrate(65, &[&wrong[..], &["--strict"]].concat());
    assert!(err.contains("fault [local-gravity]: "), "{err}");
    for (more, words) in [
        (&["--latitude", "28.9"][..], "--height <M>"),
        (&["--height", "200", "--gravity-local", "9.79179"], "--latitude <DEG>"),
        (&["--latitude", "NaN", "--height", "200"], "give a number from -90 to 90, north positive"),
        (&["--latitude", "28.9", "--height", "-1001"], "give a number of metres from -1000 to 9000"),
        (&[], "--gravity-local <G>|--latitude <DEG> --height <M>"),
    ] {
        let (_, err) = calibrate(64, more);
        assert!(err.contains(words), "{more:?}: {err}");
    }
}
