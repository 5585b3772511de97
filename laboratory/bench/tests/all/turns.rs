//! Campaigns of a whole IMU: turns after the positions, disturbed and killed.

use crate::course::{
    POSITIONS, assert_complete, assert_done, assert_in_standby, at, events, faults_at, kill_at, one_set_point, said,
};
use crate::restarts::fitted;
use isotherm_fit::AlignmentChoice;
use isotherm_laboratory_bench::{Campaign, DrawnFault, GYROSCOPES, ScriptAction, ScriptStep, Setup, Trigger};
use isotherm_simulation::{worst_errors, worst_gyroscope_errors};
use isotherm_station::{InjectedFault, TurntableProtocol};
use isotherm_support::failure::Exit;

/// Turns of a set point.
const TURNS: usize = 6;
const UNITS: usize = POSITIONS + TURNS;
const SIGTERM: usize = 15;

fn whole() -> Setup {
    Setup { more_truth: GYROSCOPES, interval_ns: 1_000_000_000, ..one_set_point() }
}

/// A single set point with turns so slow that each can be disturbed.
fn slow_turns() -> Setup {
    whole().with(&[("[turns]\n", "[turns]\nrate_deg_s = 1\n")])
}

/// In the turn after the positions: the rest before it is over.
fn in_first_turn(act: ScriptAction) -> [ScriptStep; 2] {
    [ScriptStep(Trigger::Phase("turn", POSITIONS), ScriptAction::Note), ScriptStep(Trigger::After(60.0), act)]
}

#[test]
fn turns_of_an_imu_without_gyroscopes_end_at_its_first_sample() {
    let campaign = Campaign::new(&one_set_point().with(&[
        ("temperature_unit = ", "latitude_deg = 39.9   # north positive\ntemperature_unit = "),
        ("[chamber]", "[turns]\n\n[chamber]"),
    ]));
    assert_eq!(campaign.plan.size(), "1 set points x (12 positions and 6 turns)");
    let ended = campaign.run_once();
    assert_eq!(ended.exit, Some(Exit::Data), "{ended:?}");
    for part in ["have no gyroscopes", "leave [turns] out of the plan", "safe state: turntable stopped"] {
        assert!(said(&ended).contains(part), "{ended:?}");
    }
    assert_eq!(events(&campaign, "kept").len(), 0);
    assert_in_standby(&campaign);
}

/// A campaign whose runner is killed at several moments of turns, and its table against the truth.
#[test]
fn killed_in_turns_it_ends_with_a_good_table_of_both_triads() {
    let campaign = Campaign::new(&whole().with(&[
        ("list_c = [20]", "list_c = [10, 18, 26, 34]"),
        ("time_s = 60\nstay_s = 0", "time_s = 300\nstay_s = 0"),
        ("time_s = 20\nrow_s = 5", "time_s = 60\nrow_s = 15"),
        ("ramp_c_per_min = 1", "ramp_c_per_min = 3"),
    ]));
    let mut before = String::new();
    for (turn, wait_s) in [(0, 0.0), (2, 14.0), (5, 42.0), (UNITS + 3, 28.0), (UNITS + 4, 3.5)] {
        let unit = POSITIONS + turn;
        let steps = vec![
            ScriptStep(Trigger::Phase("turn", unit), ScriptAction::Note),
            ScriptStep(Trigger::After(wait_s), ScriptAction::Kill),
        ];
        kill_at(&campaign, steps, &mut before);
    }
    assert_done(&campaign.run_once());
    assert!(campaign.file("campaign.csv").starts_with(&before));
    assert_complete(&campaign, 4 * UNITS);
    assert_in_standby(&campaign);
    for turn in events(&campaign, "kept").iter().filter(|kept| !kept["turn"].is_null()) {
        let turn = &turn["turn"];
        let read_back = |key: &str| [0, 1].map(|axis| turn[key][axis].as_f64().unwrap());
        let [before, after] = ["before_deg", "after_deg"].map(read_back);
        let turned = (after[0] - before[0]) + (after[1] - before[1]);
        assert!((turned - turn["angle_deg"].as_f64().unwrap()).abs() < 5e-4, "{turn}");
    }
    let table = fitted(&campaign, AlignmentChoice::With);
    let truth = &campaign.truths[0].table;
    assert!(table.content().serial.is_some() && table.content().serial == truth.content().serial);
    let [bias, scale_factor] = worst_errors(&table, truth);
    // A unit in pieces would be wrong by hundreds of ppm.
    assert!(bias < 6.0 && scale_factor < 20.0, "{bias} ug0, {scale_factor} ppm");
    let [bias, scale_factor, g_sensitivity, misalignment] = worst_gyroscope_errors(&table, truth).unwrap();
    let errors = format!("{bias} deg/h, {scale_factor} ppm, {g_sensitivity} deg/h/g0, {misalignment} rad");
    assert!(bias < 0.1 && scale_factor < 20.0 && g_sensitivity < 0.1 && misalignment < 2e-5, "{errors}");
}

/// Each disturbance of a turn costs this turn, and nothing else.
#[test]
fn a_turn_that_is_disturbed_is_taken_again() {
    let campaign = Campaign::new(&slow_turns());
    let steps = [
        in_first_turn(ScriptAction::Faults(vec![DrawnFault::Turntable(InjectedFault::Missing)])).to_vec(),
        vec![faults_at("paused", 1, &[]), at("resumed", 1, ScriptAction::Note)],
        // The turntable oscillates.
        in_first_turn(ScriptAction::Faults(vec![DrawnFault::Turntable(InjectedFault::NoSettle)])).to_vec(),
        vec![faults_at("discarded", 1, &[]), ScriptStep(Trigger::Phase("travel", POSITIONS), ScriptAction::Note)],
        // The acquisition is restarted: the stream goes on with another session.
        in_first_turn(ScriptAction::Restart).to_vec(),
        vec![
            at("discarded", 2, ScriptAction::Note),
            ScriptStep(Trigger::Phase("travel", POSITIONS), ScriptAction::Note),
        ],
    ];
    campaign.then(steps.concat());
    assert_done(&campaign.run_once());
    assert_eq!(campaign.world.steps_s().len(), 12, "every step was done, before the turn was kept");
    assert_complete(&campaign, UNITS);
    assert_in_standby(&campaign);
}

#[test]
fn an_alarm_or_a_stop_in_a_turn_ends_it_in_the_safe_state_and_the_turn_is_taken_again() {
    let campaign = Campaign::new(&slow_turns());
    campaign.then(in_first_turn(ScriptAction::Faults(vec![DrawnFault::Turntable(InjectedFault::Alarm)])).to_vec());
    let ended = campaign.run_once();
    assert!(said(&ended).contains("the turntable has a fault"), "{ended:?}");
    assert_in_standby(&campaign);
    campaign.world.set_faults(&[]);
    let steps = in_first_turn(ScriptAction::Signal(SIGTERM));
    campaign.then([vec![ScriptStep(Trigger::Phase("soak", POSITIONS), ScriptAction::Note)], steps.to_vec()].concat());
    let ended = campaign.run_once();
    assert!(said(&ended).contains("stopped by SIGTERM"), "{ended:?}");
    assert_in_standby(&campaign);
    assert_eq!(events(&campaign, "kept").len(), POSITIONS);
    assert_done(&campaign.run_once());
    assert_complete(&campaign, UNITS);
}

/// A turntable that takes angles modulo 360 degrees does not move for a whole turn.
#[test]
fn a_turntable_that_wraps_turns_in_several_moves() {
    for table in [TurntableProtocol::Acutrol, TurntableProtocol::Aerosmith] {
        let campaign = Campaign::new(&Setup { table, wrap: true, ..whole() });
        assert_done(&campaign.run_once());
        assert_complete(&campaign, UNITS);
        for unit in &events(&campaign, "kept")[POSITIONS..] {
            for key in ["before_deg", "after_deg"] {
                let angles = [0, 1].map(|axis| unit["turn"][key][axis].as_f64().unwrap());
                assert!(angles.iter().all(|angle| (0.0..360.0001).contains(angle)), "{unit}");
            }
        }
    }
}
