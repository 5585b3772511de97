//! Pauses, and what ends them.

use crate::course::{assert_complete, assert_done, at, events, faults_at, one_set_point, said};
use isotherm_laboratory_bench::{Campaign, DrawnFault, ScriptAction, ScriptStep, Trigger, events_on_page};
use isotherm_station::InjectedFault;

#[test]
fn an_instrument_that_disconnects_pauses_the_campaign_until_it_is_back() {
    // The turntable is so slow that every travel can be interrupted.
    let slow = one_set_point().with(&[("rate_deg_s = 10", "rate_deg_s = 0.5")]);
    let campaign = Campaign::new(&slow);
    let disconnected = [
        (0, "soak", DrawnFault::Chamber(InjectedFault::PortLoss)),
        (1, "travel", DrawnFault::Turntable(InjectedFault::Missing)),
        (2, "travel", DrawnFault::Chamber(InjectedFault::Garbled)),
        (3, "travel", DrawnFault::Turntable(InjectedFault::PortLoss)),
        (4, "dwell", DrawnFault::Chamber(InjectedFault::Garbled)),
    ];
    let steps = disconnected.into_iter().enumerate().flat_map(|(number, (kept, phase, fault))| {
        [
            ScriptStep(Trigger::Phase(phase, kept), ScriptAction::Faults(vec![fault])),
            faults_at("paused", number + 1, &[]),
            at("resumed", number + 1, ScriptAction::Note),
        ]
    });
    campaign.then(steps.collect());
    assert_done(&campaign.run_once());
    assert_eq!(campaign.world.steps_s().len(), 15, "every step was done");
    assert_complete(&campaign, 12);
    let events_on_page = events_on_page(&campaign.file("live.html"));
    let count = |name: &str| events_on_page.iter().filter(|event| *event == name).count();
    let journalled = ["paused", "resumed", "discarded"].map(|event| events(&campaign, event).len());
    assert_eq!(["pause", "resume", "repeated dwell"].map(count), journalled, "{events_on_page:?}");
    assert!(journalled[0] == 5 && campaign.file("live.html").contains("class=\"mark\""));
}

#[test]
fn a_stream_that_stops_pauses_the_campaign_until_samples_come_again() {
    let campaign = Campaign::new(&one_set_point());
    let is_paused = |folder: &std::path::Path| {
        let status = std::fs::read_to_string(folder.join("status.json")).unwrap();
        let status: serde_json::Value = serde_json::from_str(&status).unwrap();
        std::fs::write(folder.join("was-paused"), status["paused"].is_string().to_string()).unwrap();
    };
    campaign.then(vec![
        // At the start, before the first sample.
        ScriptStep(Trigger::After(0.0), ScriptAction::Faults(vec![DrawnFault::Silent])),
        ScriptStep(Trigger::After(20.0), ScriptAction::Faults(Vec::new())),
        at("kept", 1, ScriptAction::Call(is_paused)),
        ScriptStep(Trigger::After(0.0), ScriptAction::Faults(vec![DrawnFault::Silent])),
        faults_at("paused", 1, &[]),
    ]);
    assert_done(&campaign.run_once());
    assert_eq!(campaign.world.steps_s().len(), 5, "every step was done");
    assert_eq!(campaign.file("was-paused"), "false", "it is over");
    let cause = events(&campaign, "paused")[0]["cause"].as_str().unwrap().to_owned();
    // The first of these, unless the dwell is over its time before.
    let causes = ["no usable sample of imu-a for ", " s of usable samples in "];
    assert!(causes.iter().any(|words| cause.contains(words)), "{cause}");
    assert_complete(&campaign, 12);
}

/// A mode that somebody sets at the controller is no reason to command the chamber again.
#[test]
fn a_chamber_that_somebody_sets_to_manual_ends_the_campaign() {
    use isotherm_station::ChamberProtocol::WatlowF4t;
    let campaign = Campaign::new(&isotherm_laboratory_bench::Setup { chamber: WatlowF4t, ..one_set_point() });
    // 54 into register 2730.
    let manual = vec![1, 6, 0x0a, 0xaa, 0, 54, 0x2a, 0x24];
    campaign.then(vec![at("kept", 1, ScriptAction::OrderChamber(manual))]);
    let ended = campaign.run_once();
    assert!(said(&ended).contains("it was changed to manual mode (54) by someone else"), "{ended:?}");
    assert!(said(&ended).contains("chamber in standby"), "{ended:?}");
}
