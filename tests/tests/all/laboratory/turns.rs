//! The automatic campaign of a whole IMU: turns after the positions, disturbed and killed, with a real service and the
//! processes of a simulated station.

use isotherm_client::device;
use isotherm_simulation::{worst_errors, worst_gyroscope_errors};
use isotherm_tests::laboratory::{
    GYROSCOPES, SERIAL, TestLaboratory, station_part, stdout_of_success, wait_for_end, wait_long,
};
use isotherm_tests::{table, text, wait_until};
use rustix::process::{Signal, kill_process};
use std::fs;
use std::time::Duration;

/// Positions and turns of a set point.
const POSITIONS: usize = 12;
const TURNS: usize = 6;
const UNITS: usize = POSITIONS + TURNS;

/// A laboratory of an IMU with gyroscopes, with more arguments for the station and changes of its plan.
fn laboratory(more: &[&str], changes: &[(&str, &str)]) -> TestLaboratory {
    TestLaboratory::with_truth(GYROSCOPES, &[&["--interval", "1"], more].concat(), changes)
}

/// A single set point with turns so slow that each can be disturbed.
fn slow_turns() -> TestLaboratory {
    let changes = [
        ("list_c = [20, 23]", "list_c = [20]"),
        ("[turns]\n", "[turns]\nrate_deg_s = 0.1\n"),
        ("stream_s = 30000", "stream_s = 60"),
        ("settle_s = 20000", "settle_s = 10000"),
    ];
    laboratory(&[], &changes)
}

/// Waits until the turntable turns in the unit after `kept` units.
fn wait_for_turn(laboratory: &TestLaboratory, kept: usize) {
    wait_long("a turn", || {
        assert!(laboratory.events("kept").len() <= kept, "the turn was too fast");
        laboratory.place() == ("turn".to_owned(), kept as u64)
    });
    // The rest before it takes a fiftieth of this.
    std::thread::sleep(Duration::from_millis(250));
}

/// A campaign whose runner is killed at several moments of turns, and its table against the truth.
#[test]
fn killed_in_turns_it_ends_with_a_good_table_of_both_triads() {
    let laboratory = laboratory(&[], &[("list_c = [20, 23]", "list_c = [10, 18, 26, 34]")]);
    let checked = laboratory.domain.run_ok(&["campaign", "check", "station/plan.toml"]);
    assert!(checked.contains("4 set points x (12 positions and 6 turns)"), "{checked}");
    let mut before = Vec::new();
    for (turn, wait_ms) in [(0, 0), (2, 20), (5, 60), (UNITS + 3, 40), (UNITS + 4, 5)] {
        let runner = laboratory.spawn();
        wait_long("a turn", || {
            let kept = laboratory.events("kept").len();
            laboratory.phase() == "turn" && kept >= POSITIONS + turn
        });
        std::thread::sleep(Duration::from_millis(wait_ms));
        runner.kill();
        let end = laboratory.events("kept").last().unwrap()["to"].as_u64().unwrap() as usize;
        let samples = laboratory.file("campaign.csv");
        assert!(samples.starts_with(&before) && samples.len() >= end);
        before = samples[..end].to_vec();
    }
    stdout_of_success(&laboratory.run(&["--calibrate", "--alignment"]));
    assert!(laboratory.file("campaign.csv").starts_with(&before));
    laboratory.assert_complete(4 * UNITS);
    laboratory.assert_in_standby();
    for turn in laboratory.events("kept").iter().filter(|kept| !kept["turn"].is_null()) {
        let turn = &turn["turn"];
        let read_back = |key: &str| [0, 1].map(|axis| turn[key][axis].as_f64().unwrap());
        let [before, after] = ["before_deg", "after_deg"].map(read_back);
        let turned = (after[0] - before[0]) + (after[1] - before[1]);
        assert!((turned - turn["angle_deg"].as_f64().unwrap()).abs() < 5e-4, "{turn}");
    }
    let samples = text(&laboratory.file("campaign.csv"));
    let device_column = samples.lines().next().unwrap().split(',').position(|column| column == "device").unwrap();
    let of_unit = format!("{:016x}", device(SERIAL));
    assert!(samples.lines().skip(1).all(|row| row.split(',').nth(device_column) == Some(&of_unit)));
    let truth = table(&fs::read_to_string(laboratory.domain.path("station/truth.toml")).unwrap());
    let fitted = table(&text(&laboratory.file("table.toml")));
    assert_eq!(fitted.content().serial.as_deref(), Some(SERIAL));
    let [bias, scale_factor] = worst_errors(&fitted, &truth);
    // A unit in pieces would be wrong by hundreds of ppm; the noise of this station depends on how busy the machine is.
    assert!(bias < 6.0 && scale_factor < 20.0, "{bias} ug0, {scale_factor} ppm");
    let [bias, scale_factor, g_sensitivity, misalignment] = worst_gyroscope_errors(&fitted, &truth).unwrap();
    let errors = format!("{bias} deg/h, {scale_factor} ppm, {g_sensitivity} deg/h/g0, {misalignment} rad");
    assert!(bias < 0.1 && scale_factor < 20.0 && g_sensitivity < 0.1 && misalignment < 2e-5, "{errors}");
}

/// Each disturbance of a turn costs this turn, and nothing else.
#[test]
fn a_turn_that_is_disturbed_is_taken_again() {
    let mut laboratory = slow_turns();
    let runner = laboratory.spawn();
    wait_for_turn(&laboratory, POSITIONS);
    let pauses = laboratory.events("paused").len();
    laboratory.faults("missing:table");
    laboratory.wait_for("paused", pauses + 1);
    laboratory.faults("");
    laboratory.wait_for("resumed", pauses + 1);
    assert_eq!(laboratory.events("kept").len(), POSITIONS);
    // The turntable oscillates.
    wait_for_turn(&laboratory, POSITIONS);
    let discarded = laboratory.events("discarded").len();
    laboratory.faults("no-settle:table");
    laboratory.wait_for("discarded", discarded + 1);
    laboratory.faults("");
    // Until then the status is that of the turn before.
    wait_long("the way back", || laboratory.phase() != "turn");
    assert_eq!(laboratory.events("kept").len(), POSITIONS);
    // The acquisition is restarted: the stream goes on with another session.
    let imu = station_part(&laboratory.station, "imu");
    wait_for_turn(&laboratory, POSITIONS);
    let discarded = laboratory.events("discarded").len();
    kill_process(imu, Signal::USR1).unwrap();
    laboratory.wait_for("discarded", discarded + 1);
    // Until then the status is that of the turn before.
    wait_long("the way back", || laboratory.phase() != "turn");
    assert_eq!(laboratory.events("kept").len(), POSITIONS);
    // The service is restarted: the acquisition sends what it has not answered again, so that nothing is missing.
    wait_for_turn(&laboratory, POSITIONS);
    let discarded = laboratory.events("discarded").len();
    laboratory.service.signal(Signal::KILL);
    wait_until("the end of the service", || laboratory.service.has_ended());
    laboratory.service = laboratory.domain.serve(&["--allow-uncalibrated", "--imu", "imu-a=imu-a.toml"]);
    laboratory.wait_for("kept", POSITIONS + 1);
    assert_eq!(laboratory.events("discarded").len(), discarded);
    let (success, log) = wait_for_end(runner);
    assert!(success, "{log}");
    laboratory.assert_complete(UNITS);
    laboratory.assert_in_standby();
}

#[test]
fn an_alarm_or_a_stop_in_a_turn_ends_it_in_the_safe_state_and_the_turn_is_taken_again() {
    let laboratory = slow_turns();
    let runner = laboratory.spawn();
    wait_for_turn(&laboratory, POSITIONS);
    laboratory.faults("alarm:table");
    let (ended, log) = wait_for_end(runner);
    assert!(!ended && log.contains("the table has a fault"), "{log}");
    laboratory.assert_in_standby();
    laboratory.faults("");
    let runner = laboratory.spawn();
    // The status of the runner before is still there.
    wait_long("the soak", || laboratory.phase() == "soak");
    wait_for_turn(&laboratory, POSITIONS);
    stdout_of_success(&laboratory.domain.run(&["campaign", "stop", "station/plan.toml"]));
    let (ended, log) = wait_for_end(runner);
    assert!(!ended && log.contains("stopped by SIG"), "{log}");
    laboratory.assert_in_standby();
    assert_eq!(laboratory.events("kept").len(), POSITIONS);
    stdout_of_success(&laboratory.run(&[]));
    laboratory.assert_complete(UNITS);
}

/// A turntable that takes angles modulo 360 degrees does not move for a whole turn.
#[test]
fn a_turntable_that_wraps_turns_in_several_moves() {
    for protocol in ["acutrol", "aerosmith"] {
        let laboratory = laboratory(&["--table", protocol, "--wrap"], &[("list_c = [20, 23]", "list_c = [20]")]);
        stdout_of_success(&laboratory.run(&[]));
        laboratory.assert_complete(UNITS);
        for unit in &laboratory.events("kept")[POSITIONS..] {
            for key in ["before_deg", "after_deg"] {
                let angles = [0, 1].map(|axis| unit["turn"][key][axis].as_f64().unwrap());
                assert!(angles.iter().all(|angle| (0.0..360.0001).contains(angle)), "{unit}");
            }
        }
    }
}
