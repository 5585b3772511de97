//! `verify` of a whole IMU through the command: Earth's rate, the lag, samples of another device, and a recording in
//! motion.

use isotherm_recording::{Layout, RawCsvReader, RawCsvWriter};
use isotherm_shared::lag::Lag;
use isotherm_shared::table::Axis;
use isotherm_shared::wire::{RawSample, Triad, device};
use isotherm_tests::{TestDomain, WHOLE_TABLE, table, text};
use serde_json::Value;
use std::fs;
use std::ops::Index;
use std::process::Output;

const RUN_IN_MOTION: &str = include_str!("../../data/run-g.csv");
const GRAVITY: f64 = 9.8015;
/// Earth's rate in the base, deg/h.
const EARTH: [f64; 3] = [9.1, -6.9, 9.648];
const ANGLES: [f64; 2] = [50.0, 130.0];
const SECONDS: f64 = 10.0;
const GYROSCOPES: Layout = Layout { device: false, gyroscopes: true, lag: false, unix_offset: false };

/// The table with the provenance of a station, whose base is level.
fn table_text(earth: [f64; 3]) -> String {
    format!(
        "{WHOLE_TABLE}\n[provenance]\ngravity_local = {GRAVITY}\nset_points = 15\nearth_rate_deg_h = {earth:?}\n\
         earth_rate_standard_error = [0.001, 0.001]\n"
    )
}

/// `v` of the base in IMU coordinates at the angles.
fn in_imu([outer, inner]: [f64; 2], v: [f64; 3]) -> [f64; 3] {
    let ((so, co), (si, ci)) = (libm::sincos(outer.to_radians()), libm::sincos(inner.to_radians()));
    let y = co * v[1] + so * v[2];
    [ci * v[0] + si * y, -si * v[0] + ci * y, -so * v[1] + co * v[2]]
}

fn times(matrix: &impl Index<(usize, usize), Output = f64>, v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| (0..3).map(|j| matrix[(i, j)] * v[j]).sum())
}

/// The pulses of a sensor in SECONDS that indicates `value` [base unit] without its bias, and what they leave in
/// `charge` [base unit * s].
fn pulses(axis: &Axis, triad: &mut Triad, index: usize, value: f64, charge: &mut f64) {
    let (head, board) = (triad.head_temperature[index], triad.board_temperature[index]);
    let bias = (axis.bias.at(head) + axis.transient * (triad.head_lagged[index] - head)) * axis.bias_unit.factor();
    *charge += (value + bias) * SECONDS;
    let (positive, k) = match *charge > 0.0 {
        true => (true, axis.positive_scale_factor_at(board).0),
        false => (false, axis.negative_scale_factor_at(board).0),
    };
    let count = (*charge * k).floor();
    *charge -= count / k;
    let channel = if positive { &mut triad.positive_pulses } else { &mut triad.negative_pulses };
    channel[index] = count as u32;
}

/// What this IMU sends at rest while its temperature rises, without lagged temperature and without noise.
fn at_rest(angles: [f64; 2]) -> Vec<RawSample> {
    let table = table(WHOLE_TABLE);
    let content = table.content();
    let gyroscopes = content.gyroscopes.as_ref().unwrap();
    let (force, rate) = (in_imu(angles, [0.0, 0.0, 1.0]), in_imu(angles, EARTH));
    let of_force = times(&content.alignment.unwrap().try_inverse().unwrap(), force);
    let of_rate = times(&gyroscopes.alignment.unwrap().try_inverse().unwrap(), rate);
    let by_force = gyroscopes.g_sensitivity.map(|s| s.map_or(0.0, |s| (0..3).map(|j| s[j] * force[j]).sum::<f64>()));
    let mut lag = Lag::new(table.lag_ns());
    let mut charges = [[0.0; 3]; 2];
    (0..400_u64)
        .map(|index| {
            let temperature = 1.2 + 2.6 * index as f64 / 400.0;
            let triad =
                Triad { head_temperature: [temperature; 3], board_temperature: [temperature; 3], ..Triad::default() };
            let mut raw = RawSample {
                sequence: index,
                timestamp_ns: (index + 1) * 10_000_000_000,
                interval_ns: 10_000_000_000,
                accelerometers: triad,
                gyroscopes: triad,
                ..RawSample::default()
            };
            lag.follow(&raw);
            lag.fill(&mut raw);
            for axis in 0..3 {
                pulses(&content.axes[axis], &mut raw.accelerometers, axis, of_force[axis], &mut charges[0][axis]);
                let value = of_rate[axis] + by_force[axis];
                pulses(&gyroscopes.axes[axis], &mut raw.gyroscopes, axis, value, &mut charges[1][axis]);
            }
            raw
        })
        .collect()
}

fn write(domain: &TestDomain, name: &str, layout: Layout, samples: &[RawSample]) {
    let mut writer = RawCsvWriter::with_layout(Vec::new(), "", false, layout).unwrap();
    samples.iter().for_each(|raw| writer.write("", raw).unwrap());
    fs::write(domain.path(name), writer.finish().unwrap()).unwrap();
}

fn verify(domain: &TestDomain, arguments: &[&str]) -> Output {
    domain.run(&[&["verify", "--table", "imu-g.toml"], arguments].concat())
}

/// Asserts the exit code, and gives stdout and stderr.
#[track_caller]
fn expect(output: &Output, code: i32) -> (String, String) {
    let (out, err) = (text(&output.stdout).to_owned(), text(&output.stderr).to_owned());
    assert_eq!(output.status.code(), Some(code), "{out}{err}");
    (out, err)
}

#[test]
fn earths_rate_is_taken_off_with_the_angles_and_not_judged_without() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", &table_text(EARTH));
    write(&domain, "run.csv", GYROSCOPES, &at_rest(ANGLES));
    let require = ["--require", "bias=20ug0,level=5arcsec,rate=0.1deg/h,factor=2"];
    let (out, _) =
        expect(&verify(&domain, &[&["run.csv", "--angles", "50,130", "--report", "r.html"], &require[..]].concat()), 0);
    for words in
        ["output minus Earth's rate [deg/h]", "400 of 400 windows at rest", "rate: G", "deg/h is required: met"]
    {
        assert!(out.contains(words), "no {words:?} in\n{out}");
    }
    let report = fs::read_to_string(domain.path("r.html")).unwrap();
    assert!(
        report.contains("The largest error of the gyroscopes is that of G") && report.contains("G3 over temperature")
    );
    let (out, _) = expect(&verify(&domain, &["run.csv", "--angles", "50,130", "--json"]), 0);
    let document: Value = serde_json::from_str(&out).unwrap();
    let part = &document["gyroscopes"];
    let right = in_imu(ANGLES, EARTH);
    assert_eq!(document["windows_left_out"]["count"], 0);
    assert_eq!(part["axes"][0]["hysteresis"]["not_judged"], "only one direction");
    // The lag is computed, from a filter that begins soaked.
    assert_eq!(document["hysteresis_left_out_s"], 720.0);
    for axis in 0..3 {
        let constant = &part["axes"][axis]["constant_deg_h"];
        assert!(constant["value"].as_f64().unwrap().abs() < 0.002, "{part}");
        assert!((part["earth_rate_deg_h"][axis].as_f64().unwrap() - right[axis]).abs() < 1e-9, "{part}");
        assert!(constant["interval"].as_f64() >= part["earth_rate_interval_deg_h"][axis].as_f64(), "{part}");
    }
    // Without the angles.
    let attitude = ["run.csv", "--attitude", "0.5868,-0.4924,0.6428"];
    let (out, _) = expect(&verify(&domain, &attitude), 0);
    assert!(
        out.contains("not judged") && out.contains("; give --angles OUTER,INNER, the angles in the run\n"),
        "{out}"
    );
    let (_, err) = expect(&verify(&domain, &[&attitude[..], &["--require", "rate=1deg/h"]].concat()), 1);
    assert!(err.contains("rate: at most 1.0000 deg/h is required: not judged, without the angles"), "{err}");
    // Both, which agree or not; angles of another attitude.
    expect(&verify(&domain, &[&attitude[..], &["--angles", "50,130"], &require[..]].concat()), 0);
    let (_, err) = expect(&verify(&domain, &["run.csv", "--angles", "50,130", "--attitude", "0,0,1"]), 64);
    assert!(err.contains("--angles and --attitude do not agree: the angles give (0.5868, -0.4924, 0.6428)"), "{err}");
    expect(&verify(&domain, &["run.csv", "--angles", "50,310"]), 65);
    // The other hemisphere, and a table that does not know.
    domain.replace("imu-g.toml", &table_text([EARTH[0], EARTH[1], -EARTH[2]]));
    let (_, err) = expect(&verify(&domain, &["run.csv", "--angles", "50,130", "--require", "rate=5deg/h"]), 1);
    assert!(err.contains("deg/h is required: missed"), "{err}");
    domain.replace("imu-g.toml", WHOLE_TABLE);
    let (_, err) = expect(&verify(&domain, &["run.csv", "--angles", "50,130"]), 64);
    assert!(err.contains("earth_rate_deg_h"), "{err}");
}

#[test]
fn the_lag_of_the_table_is_computed_as_in_replay() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", &table_text(EARTH));
    write(&domain, "run.csv", GYROSCOPES, &at_rest(ANGLES));
    let arguments = ["run.csv", "--angles", "50,130", "--require", "bias=20ug0,rate=0.1deg/h"];
    for lag in [&[][..], &["--lag", "240"]] {
        let (out, _) = expect(&verify(&domain, &[&arguments[..], lag].concat()), 0);
        assert!(!out.contains("flagged"), "{out}");
    }
    let (out, err) = expect(&verify(&domain, &[&arguments[..], &["--lag", "none"]].concat()), 1);
    assert!(out.contains("windows have flagged samples") && err.contains("missed"), "{out}{err}");
}

#[test]
fn samples_of_another_device_are_refused_unless_wanted() {
    let domain = TestDomain::new();
    let with_serial = table_text(EARTH).replace("id = \"imu-g\"", "id = \"imu-g\"\nserial = \"SN 7 \"");
    assert!(with_serial.contains("SN 7"));
    domain.write("imu-g.toml", &with_serial);
    let of_unit = |serial: &str| {
        let samples = at_rest(ANGLES);
        samples.into_iter().map(|raw| RawSample { device: device(serial), ..raw }).collect::<Vec<_>>()
    };
    write(&domain, "own.csv", Layout { device: true, ..GYROSCOPES }, &of_unit("SN 7"));
    write(&domain, "other.csv", Layout { device: true, ..GYROSCOPES }, &of_unit("SN 8"));
    let arguments = ["--angles", "50,130", "--require", "rate=0.1deg/h"];
    let (own, _) = expect(&verify(&domain, &[&["own.csv"], &arguments[..]].concat()), 0);
    let (out, err) = expect(&verify(&domain, &[&["other.csv"], &arguments[..]].concat()), 65);
    assert!(
        out.is_empty()
            && err.contains("400 samples are of another device than the table's, which has the serial number \"SN 7\""),
        "{err}"
    );
    assert!(err.contains("--other-device"), "{err}");
    let (other, err) = expect(&verify(&domain, &[&["other.csv", "--other-device"], &arguments[..]].concat()), 0);
    assert!(
        err.contains("warning [other-device]: other.csv: 400 samples are of another device than the table's")
            && other == own,
        "{err}{other}"
    );
    // `replay` computes, warns once and counts.
    let (_, err) = expect(&domain.run(&["replay", "--table", "imu-g.toml", "other.csv", "-o", "increments.csv"]), 0);
    assert_eq!(err.matches("another device").count(), 1, "{err}");
    assert!(err.contains("400 increments, 400 flagged: other-device 400"), "{err}");
}

/// The first half of this recording is plausible, but the IMU is not at rest.
#[test]
fn nothing_is_claimed_of_a_recording_in_motion() {
    let domain = TestDomain::new();
    domain.write("imu-g.toml", WHOLE_TABLE);
    assert!(RawCsvReader::new(RUN_IN_MOTION.as_bytes()).unwrap().count() >= 1000);
    let half: String = RUN_IN_MOTION.lines().take(1001).map(|line| format!("{line}\n")).collect();
    domain.write("half.csv", &half);
    let (out, err) = expect(&verify(&domain, &["half.csv"]), 0);
    assert!(out.contains("Nothing can be claimed: the output is 1.3990 g0 long"), "{out}");
    assert!(out.ends_with("hold it still.\n") && out.contains("The gyroscopes are not judged: in only "), "{out}");
    assert!(err.contains("warning [not-gravity]: half.csv: the output is 1.3990 g0 long"), "{err}");
    expect(&verify(&domain, &["half.csv", "--require", "rate=100deg/h"]), 1);
}
