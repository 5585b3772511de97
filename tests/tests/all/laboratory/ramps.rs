//! The automatic campaign with ramps: killed in them, with a real service and the processes of a simulated station
//! whose IMU lags.

use isotherm_shared::table::AXIS_NAMES;
use isotherm_tests::laboratory::{TestLaboratory, stdout_of_success, wait_long};
use isotherm_tests::{is_nightly, table, text};
use std::fs;

/// Dwells of the campaign, before its ramps.
const DWELLS: usize = 4 * 12;
/// The true time constant \[s\], and the true transients \[1e-6 g0/V\].
const LAG: &str = "240";
const TRANSIENTS: [f64; 3] = [600.0, -400.0, 300.0];

const RAMPS: &str = "
[[ramp]]
from_c = 10
to_c = 34
ramp_c_per_h = 60
hold_s = 1200

[[ramp]]
from_c = 34
to_c = 10
ramp_c_per_h = 120
hold_s = 1200

[verify]
runs = 2
attitudes_deg = [[50, 130], [230, 130]]
from_c = 10
to_c = 34
ramp_c_per_h = 60
hold_s = 600

[safe]";

/// Waits until the chamber is midway in the ramp after `kept` units, on the way back or there.
fn wait_for_ramp(laboratory: &TestLaboratory, kept: usize, end_c: f64, back: bool) {
    let before = laboratory.readbacks().len();
    wait_long("the middle of a ramp", || {
        assert!(laboratory.events("kept").len() <= kept, "the ramp was too fast");
        let readbacks = laboratory.readbacks();
        // Those of the runner before are of no interest.
        let mut of_ramp = readbacks[before..].iter().rev().take_while(|(phase, ..)| phase == "sweep");
        let Some((_, set_point_c, _)) = of_ramp.next() else { return false };
        laboratory.place().1 == kept as u64
            && (16.0..28.0).contains(set_point_c)
            && of_ramp.any(|(_, set_point_c, _)| *set_point_c == end_c) == back
    });
}

/// How many times a recording is at an end of its temperatures, in the outer quarters of their range: once more than it
/// goes from one to the other.
fn ends_of(recording: &str) -> usize {
    let mut rows = recording.lines();
    let column = rows.next().unwrap().split(',').position(|name| name == "a1_head").unwrap();
    let heads: Vec<f64> = rows.map(|row| row.split(',').nth(column).unwrap().parse().unwrap()).collect();
    let (low, high) = heads.iter().fold((f64::MAX, f64::MIN), |(low, high), head| (low.min(*head), high.max(*head)));
    let mut ends: Vec<_> = heads
        .iter()
        .map(|head| (head - low) / (high - low))
        .filter(|place| !(0.25..0.75).contains(place))
        .map(|place| place > 0.5)
        .collect();
    ends.dedup();
    ends.len()
}

/// The interval of the time constant in the provenance of a table \[s\].
fn interval_s(table: &str) -> [f64; 2] {
    let line = table.lines().find_map(|line| line.strip_prefix("interval_s = ")).unwrap();
    serde_json::from_str(line).unwrap()
}

#[test]
fn killed_in_ramps_it_ends_with_the_lag_of_the_truth() {
    let misaligned = "[alignment]\nmatrix = [[1, 2.8e-4, -1e-4], [1.2e-4, 1, 2e-4], [0, -1.5e-4, 1]]\n";
    let transients = TRANSIENTS.map(|transient| transient.to_string()).join(",");
    let station = ["--lag", LAG, "--transient", &transients, "--interval", "5"];
    // Longer than in other tests: what still lags is an error of the dwells.
    let soak = ("time_s = 600\n", "time_s = 1800\n");
    let changes = [("list_c = [20, 23]", "list_c = [10, 18, 26, 34]"), soak, ("\n[safe]", RAMPS)];
    let laboratory = TestLaboratory::with_truth(misaligned, &station, &changes);
    let domain = &laboratory.domain;
    let checked = domain.run_ok(&["campaign", "check", "station/plan.toml"]);
    assert!(checked.contains("4 set points x 12 positions, 2 ramps, 2 verification runs; about "), "{checked}");
    assert!(checked.contains("ramp 2: 34 to 10 degC and back, at rest at 0/0 deg"), "{checked}");
    // On the way to the other end of the first ramp, on the way back, and on the way there of the second.
    let kills = [(0, 34.0, false), (0, 34.0, true), (1, 10.0, false)];
    let tried = if is_nightly() { &kills[..] } else { &kills[1..2] };
    for &(ramp, end_c, back) in tried {
        let runner = laboratory.spawn();
        wait_for_ramp(&laboratory, DWELLS + ramp, end_c, back);
        let status = laboratory.status();
        let place = format!("{} of {} | sweep ramp {}: the chamber ", DWELLS + ramp, DWELLS + 4, ramp + 1);
        assert!(status.contains(&place) && status.contains(" left\n"), "{status}");
        runner.kill();
        let kept = laboratory.events("kept");
        assert_eq!(kept.len(), DWELLS + ramp);
        assert!(!laboratory.file(&format!("ramp-{}.csv", ramp + 1)).is_empty(), "it is being written");
    }
    // Without its transient A1 is off by 100e-6 g0 at this rate, each way. The runs are off by 50e-6 g0: in the middle
    // of a row the temperature is some seconds old, for the scale factors too.
    let require = ["--require", "bias=80ug0,scale=100ppm,level=20arcsec"];
    let output = laboratory.run(&[&["--calibrate", "--alignment"], &require[..]].concat());
    let said = text(&output.stderr);
    stdout_of_success(&output);
    laboratory.assert_complete(DWELLS + 4);
    laboratory.assert_in_standby();
    // Each ramp is one recording, whole, from a soak of its own.
    let kept = laboratory.events("kept");
    for (unit, file) in kept[DWELLS..].iter().zip(["ramp-1.csv", "ramp-2.csv", "verify-1.csv", "verify-2.csv"]) {
        let bytes = laboratory.file(file);
        assert_eq!((unit["file"].as_str(), unit["from"].as_u64()), (Some(file), Some(0)));
        assert_eq!(unit["to"].as_u64(), Some(bytes.len() as u64));
        assert_eq!(unit["rows"].as_u64().unwrap() as usize + 1, text(&bytes).lines().count());
    }
    // There and back, once.
    for file in ["ramp-1.csv", "ramp-2.csv"] {
        assert_eq!(ends_of(&text(&laboratory.file(file))), 3, "{file}");
    }
    // The table has the lag and the transients of the truth, and judged by runs that heat and cool it is installed.
    let fitted = text(&laboratory.file("table.toml"));
    let [low, high] = interval_s(&fitted);
    let truth: f64 = LAG.parse().unwrap();
    // Three standard errors, and 1 % for rows that a busy machine cut elsewhere. Whether 95 % intervals hold 95 % of
    // truths is tested with many seeds in calibration/tests/transients/rates.rs.
    let (estimate, sigma) = (f64::midpoint(low, high), (high - low) / (2.0 * 1.96));
    assert!((estimate - truth).abs() < 3.0 * sigma + 0.01 * truth, "{low} to {high} s\n{said}");
    assert!(high - low < 0.1 * truth, "{low} to {high} s\n{said}");
    // The command makes the same of the campaign's folder: the table byte for byte, but for the time, and the findings.
    let again =
        domain.run(&["calibrate", "turntable", "station/campaign/campaign.toml", "-o", "again.toml", "--alignment"]);
    stdout_of_success(&again);
    let without_time =
        |text: &str| text.lines().filter(|line| !line.starts_with("time = ")).collect::<Vec<_>>().join("\n");
    assert_eq!(without_time(&fs::read_to_string(domain.path("again.toml")).unwrap()), without_time(&fitted));
    let findings =
        |said: &str| said.lines().filter(|line| line.contains("warning [")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(findings(&text(&again.stderr)), findings(&said));
    let content = table(&fitted).content().clone();
    let lag_s = content.lag_s.unwrap();
    for ((axis, name), truth_ug0) in content.axes.iter().zip(AXIS_NAMES).zip(TRANSIENTS) {
        let transient_ug0 = axis.transient * axis.bias_unit.factor() * 1e6;
        let ratio = transient_ug0 * lag_s / (truth_ug0 * truth);
        assert!((0.8..1.2).contains(&ratio), "{name}: {transient_ug0} 1e-6 g0/V at {lag_s} s\n{said}");
    }
    assert_eq!(fs::read(domain.path("imu-a.toml")).unwrap(), laboratory.file("table.toml"));
    let status = laboratory.status();
    assert!(
        status.contains("; lag: time constant ") && status.contains("transients are written for A1, A2, A3"),
        "{status}"
    );
}
