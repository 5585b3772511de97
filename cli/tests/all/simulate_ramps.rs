//! `simulate` of IMUs whose temperature moves: ramps, lags and plays, as a user types them. The physics is tested in
//! `laboratory/simulation/src/ramp.rs`.

use crate::common::{folder, run};
use isotherm_campaign::Campaign;
use isotherm_fit::{CurveSource, LagChoice, RampRecording, TransientOptions, TransientVerdict, Transients, fit};
use isotherm_recording::RawCsvReader;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::SensorKind;
use std::fs::{self, File};
use std::path::Path;

/// Time constant \[s\] and transients \[ug0/V\], as options and as numbers.
const LAG: [&str; 4] = ["--lag", "240", "--transient", "35,-20,12"];
const TAU_S: f64 = 240.0;
const TRANSIENTS: [f64; 3] = [35.0, -20.0, 12.0];

fn simulate(folder: &Path, arguments: &[&[&str]]) {
    run(folder, 0, &[&["simulate"][..], &arguments.concat()].concat());
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    run(folder, 64, &[&["simulate"], arguments].concat()).1
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap()
}

fn table(path: &Path) -> CoefficientTable {
    CoefficientTable::from_toml(&read(path), None).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort_unstable();
    names
}

/// What the ramps of the campaign file in `folder` show, with the curves of `curves` at mid range.
fn fitted(folder: &Path, curves: &str) -> Transients {
    let campaign = Campaign::from_toml(&read(&folder.join("campaign.toml"))).unwrap();
    let recordings: Vec<_> = campaign
        .ramps
        .iter()
        .map(|ramp| {
            let mut recording = RampRecording::new(ramp.samples.clone());
            for raw in RawCsvReader::new(File::open(folder.join(&ramp.samples)).unwrap()).unwrap() {
                recording.add(&raw.unwrap()).unwrap();
            }
            recording
        })
        .collect();
    let options = TransientOptions { curves: CurveSource::Ramps, lag: LagChoice::Search, predecessor_s: None };
    fit(&recordings, &table(&folder.join(curves)), &options).unwrap()
}

fn assert_transients(found: &Transients, right: &[f64]) {
    assert_eq!(found.verdict, TransientVerdict::Lag, "{:?}", found.words);
    for (bias, transient) in found.biases.iter().zip(right) {
        let unit = if bias.kind == SensorKind::Gyroscope { 1.0 } else { 1e6 };
        let ratio = bias.transient * unit * found.time_constant.value_s / (transient * TAU_S);
        println!("{}: t {:.3}, t tau {ratio:.3} of the truth", bias.name(), bias.transient * unit);
        assert!((ratio - 1.0).abs() < 0.3, "{} {ratio}", bias.name());
    }
}

#[test]
fn ramps_alone_show_the_lag_of_their_truth() {
    let folder = folder();
    let at = |name: &str| folder.path().join("ramps").join(name);
    simulate(folder.path(), &[&["ramp", "-o", "ramps", "--seed", "5", "--attitude", "0.36,-0.48,0.8"], &LAG]);
    assert_eq!(
        names(&folder.path().join("ramps")),
        ["campaign.toml", "ramp-1.csv", "ramp-2.csv", "table.toml", "truth.toml"]
    );
    let campaign = Campaign::from_toml(&read(&at("campaign.toml"))).unwrap();
    assert!(campaign.has_ramps_alone() && campaign.curves.as_deref() == Some("table.toml"));
    assert_eq!(campaign.ramps[1].specific_force, Some([0.36, -0.48, 0.8]));
    let truth = table(&at("truth.toml"));
    assert_eq!(truth.content().lag_s, Some(TAU_S));
    assert_eq!(truth.content().axes.each_ref().map(|axis| axis.transient), TRANSIENTS);
    // The table in force before knows nothing of it, and is the truth otherwise.
    let before = table(&at("table.toml"));
    assert_eq!((before.content().format, before.content().lag_s), (1, None));
    for (axis, right) in before.content().axes.iter().zip(&truth.content().axes) {
        assert_eq!(axis.transient, 0.0);
        assert_eq!((&axis.bias, &axis.positive_scale_factor), (&right.bias, &right.positive_scale_factor));
    }
    let provenance = &read(&at("truth.toml")).parse::<toml::Table>().unwrap()["provenance"];
    let ramps = provenance["ramps"].as_array().unwrap();
    assert_eq!((ramps.len(), ramps[1]["samples"].as_str()), (2, Some("ramp-2.csv")));
    assert_eq!((ramps[0]["legs"].as_integer(), ramps[0]["hold_s"].as_float()), (Some(2), Some(1800.0)));
    assert!((ramps[1]["ramp_c_per_s"].as_float().unwrap() * 3600.0 - 70.0).abs() < 1e-9);
    let found = fitted(&folder.path().join("ramps"), "table.toml");
    println!("time constant {:.0} {:?} s", found.time_constant.value_s, found.time_constant.interval_s);
    assert!(found.time_constant.interval_s[0] < TAU_S && TAU_S < found.time_constant.interval_s[1]);
    assert_transients(&found, &TRANSIENTS);

    // The same seed gives the same files; another seed, and the other recording, other noise.
    simulate(folder.path(), &[&["ramp", "-o", "same", "--seed", "5", "--attitude", "0.36,-0.48,0.8"], &LAG]);
    simulate(
        folder.path(),
        &[&["ramp", "-o", "other", "--seed", "6", "--attitude", "0.36,-0.48,0.8", "--rate", "20,20,40"], &LAG],
    );
    for name in names(&folder.path().join("ramps")) {
        assert_eq!(read(&at(&name)), read(&folder.path().join("same").join(&name)), "{name}");
    }
    let other = |name: &str| read(&folder.path().join("other").join(name));
    assert!(other("ramp-1.csv") != read(&at("ramp-1.csv")) && other("ramp-1.csv") != other("ramp-2.csv"));
    assert!(other("ramp-3.csv").lines().count() < other("ramp-2.csv").lines().count());
}

#[test]
fn a_play_is_hysteresis_and_no_lag() {
    let folder = folder();
    let plays = ["--play", "0.2", "--hysteresis", "-60,40,20", "--play", "0.6", "--hysteresis", "-20,0,30"];
    simulate(folder.path(), &[&["ramp", "-o", "play"], &plays]);
    let at = |name: &str| folder.path().join("play").join(name);
    let provenance = &read(&at("truth.toml")).parse::<toml::Table>().unwrap()["provenance"];
    let plays = provenance["plays"].as_array().unwrap();
    assert_eq!((plays.len(), plays[1]["half_width"].as_float()), (2, Some(0.6)));
    assert!((plays[0]["accelerometers"][0].as_float().unwrap() + 60e-6).abs() < 1e-18);
    let found = fitted(&folder.path().join("play"), "table.toml");
    println!("{:?}", found.words);
    assert_ne!(found.verdict, TransientVerdict::Lag, "{:?}", found.words);
    assert!(found.biases.iter().all(|bias| bias.transient == 0.0));
    // Cooling less heating is 2 h w of each play, where both have gone over: 2 (60 * 0.2 + 20 * 0.6) = 48 ug0.
    let band = isotherm_statistics::band(&found.biases[0].before).unwrap() * 1e6;
    assert!((40.0..52.0).contains(&band), "{band}");
}

#[test]
fn gyroscopes_have_transients_of_their_own() {
    let folder = folder();
    let gyroscopes = ["--gyroscopes", "--gyroscope-transient", "0.9,-0.6,0.5"];
    simulate(folder.path(), &[&["ramp", "-o", "whole"], &LAG, &gyroscopes]);
    let whole = folder.path().join("whole");
    let truth = table(&whole.join("truth.toml"));
    let axes = &truth.content().gyroscopes.as_ref().unwrap().axes;
    assert_eq!(axes.each_ref().map(|axis| axis.transient), [0.9, -0.6, 0.5]);
    let before = table(&whole.join("table.toml"));
    assert!(before.content().gyroscopes.as_ref().unwrap().axes.iter().all(|axis| axis.transient == 0.0));
    assert!(read(&whole.join("ramp-2.csv")).starts_with("sequence,timestamp_ns,interval_ns,a1_positive"));
    assert_transients(&fitted(&whole, "table.toml"), &[35.0, -20.0, 12.0, 0.9, -0.6, 0.5]);
    // The accelerometers are the same numbers without gyroscopes.
    simulate(folder.path(), &[&["ramp", "-o", "plain"], &LAG]);
    let columns = |name: &str| -> Vec<String> {
        let text = read(&folder.path().join(name).join("ramp-2.csv"));
        text.lines().map(|line| line.split(',').take(15).collect::<Vec<_>>().join(",")).collect()
    };
    assert_eq!(columns("plain"), columns("whole"));
}

#[test]
fn a_campaign_takes_ramps_beside_its_positions() {
    let folder = folder();
    let small = ["--set-points", "-25:45:35", "--dwell", "20"];
    simulate(folder.path(), &[&["campaign", "-o", "with", "--ramps"], &LAG, &small]);
    simulate(folder.path(), &[&["campaign", "-o", "without"], &LAG, &small]);
    let at = |folder_name: &str, name: &str| folder.path().join(folder_name).join(name);
    assert_eq!(read(&at("with", "samples.csv")), read(&at("without", "samples.csv")));
    let [with, without] = ["with", "without"].map(|name| read(&at(name, "campaign.toml")));
    let added = with.strip_prefix(&without).unwrap();
    assert!(added.starts_with("\n[[ramp]]\nsamples = \"ramp-1.csv\"\nspecific_force = [0, 0, 1]"), "{added}");
    let campaign = Campaign::from_toml(&with).unwrap();
    assert_eq!((campaign.positions.len(), campaign.ramps.len(), campaign.curves), (12, 2, None));
    assert_transients(&fitted(&folder.path().join("with"), "truth.toml"), &TRANSIENTS);
    simulate(folder.path(), &[&["campaign", "-o", "three", "--ramps", "30,40,50"], &LAG, &small]);
    assert!(at("three", "ramp-3.csv").exists());
    let truth = read(&at("three", "truth.toml")).parse::<toml::Table>().unwrap();
    assert_eq!(truth["provenance"]["ramps"].as_array().unwrap().len(), 3);
}

#[test]
fn a_run_both_ways_is_behind_while_it_heats_and_ahead_while_it_cools() {
    let folder = folder();
    let both = ["run", "-o", "both", "--both-ways", "--interval", "1", "--hold", "600", "--ramp", "70"];
    simulate(folder.path(), &[&both, &["--lag", "240", "--transient", "400,0,-400"]]);
    let path = folder.path().join("both");
    assert_eq!(names(&path), ["run.csv", "truth.toml"]);
    let truth = table(&path.join("truth.toml"));
    let specific_force = [0.6, -0.48, 0.64];
    // Mean error of the static terms about 10 degC, where heads are at 2.5 V: of a quarter of an hour in each
    // direction.
    let mut rates = [[0.0; 3]; 2];
    let mut counts = [0.0; 2];
    let rows: Vec<_> =
        RawCsvReader::new(File::open(path.join("run.csv")).unwrap()).unwrap().map(Result::unwrap).collect();
    for (index, raw) in rows.iter().enumerate() {
        let direction = usize::from(index >= rows.len() / 2);
        if (raw.accelerometers.head_temperature[0] - 2.5).abs() < 0.2 {
            let increment = answer(Some(&truth), raw);
            counts[direction] += 1.0;
            for i in 0..3 {
                rates[direction][i] += increment.velocity_increment[i] / 9.8015 - specific_force[i];
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 400.0), "{counts:?}");
    // L - U is -tau dU/dt while it heats: 240 s * 70 degC/h * 0.04 V/degC = 0.1867 V.
    for (i, transient) in [400.0, 0.0, -400.0].into_iter().enumerate() {
        let right = transient * 0.1867;
        let [heating, cooling] = [0, 1].map(|direction| rates[direction][i] / counts[direction] * 1e6);
        println!("A{}: heating {heating:.2}, cooling {cooling:.2} ug0; {right:.2}", i + 1);
        assert!(((cooling - heating) / 2.0 - right).abs() < 1.5, "A{}: {heating} {cooling}", i + 1);
    }
}

#[test]
fn without_lag_and_plays_no_file_mentions_them() {
    let folder = folder();
    let short = ["--hold", "60", "--ramp", "600", "--interval", "5"];
    simulate(folder.path(), &[&["run", "-o", "run"], &short]);
    simulate(folder.path(), &[&["campaign", "-o", "campaign", "--set-points", "0:10:10", "--dwell", "20"]]);
    // An element that lags without a transient changes no pulse.
    simulate(folder.path(), &[&["run", "-o", "zero", "--lag", "240", "--transient", "0,0,0"], &short]);
    for (name, words) in [
        ("run/truth.toml", &["lag]", "time_constant", "transient", "plays", "legs", "bias_walk", "format = 2"][..]),
        ("campaign/truth.toml", &["lag]", "time_constant", "transient", "plays", "ramps", "bias_walk", "format = 2"]),
        ("campaign/campaign.toml", &["ramp", "curves"]),
    ] {
        let text = read(&folder.path().join(name));
        assert!(words.iter().all(|word| !text.contains(word)), "{name}:\n{text}");
    }
    assert_eq!(read(&folder.path().join("run/run.csv")), read(&folder.path().join("zero/run.csv")));
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let folder = folder();
    for (arguments, message) in [
        (&["ramp", "-o", "o", "--transient", "1,2,3"][..], "give --lag too"),
        (&["run", "-o", "o", "--lag", "240"], "no bias has a transient that would show it; give --transient too"),
        (&["campaign", "-o", "o", "--lag", "0.01", "--transient", "1,2,3"], "--lag <S>"),
        (&["ramp", "-o", "o", "--play", "0.2"], "give each --play its --hysteresis"),
        (&["ramp", "-o", "o", "--hysteresis", "1,2,3"], "give each --play its --hysteresis"),
        (&["ramp", "-o", "o", "--play", "0", "--hysteresis", "1,2,3"], "give a number over 0"),
        (&["ramp", "-o", "o", "--lag", "9", "--gyroscope-transient", "1,2,3"], "give --gyroscopes too"),
        (&["ramp", "-o", "o", "--play", "1", "--gyroscope-hysteresis", "1,2,3"], "give --gyroscopes too"),
        (&["ramp", "-o", "o", "--rate", "20,"], "give a number of degC/h"),
        (&["ramp", "-o", "o", "--rate", "20,0"], "give a ramp from 0.1 to 3600 degC/h"),
        (&["ramp", "-o", "o", "--temperatures", "20,20"], "a ramp leads from one temperature to another"),
        (&["ramp", "-o", "o", "--temperatures", "-25,90"], "the chamber would leave the truth"),
        (
            &["campaign", "-o", "o", "--set-points", "20:20:5", "--ramps"],
            "a ramp leads from one temperature to another",
        ),
        (&["ramp", "-o", "o", "--interval", "0.001", "--rate", "0.1"], "rows; up to"),
    ] {
        let err = refused(folder.path(), arguments);
        assert!(err.contains(message), "{arguments:?}: {err}");
    }
    // Larger than a bias may be: the truth would be no table.
    let (_, err) = run(folder.path(), 78, &["simulate", "ramp", "-o", "o", "--lag", "240", "--transient", "1e9,0,0"]);
    assert!(err.contains("the truth cannot be a table: axis.A1.bias.transient"), "{err}");
    assert_eq!(names(folder.path()), Vec::<String>::new(), "nothing is written");
}
