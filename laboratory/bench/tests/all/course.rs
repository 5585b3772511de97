//! What the tests ask a campaign.

use isotherm_laboratory_bench::{
    Campaign, CampaignEnd, DrawnFault, Request, ScriptAction, ScriptStep, Setup, Trigger, assert_units,
};
use isotherm_station::InjectedFault;
use serde_json::Value;

/// Positions of a set point.
pub(crate) const POSITIONS: usize = 12;

/// A campaign of one set point with twelve positions.
pub(crate) fn one_set_point() -> Setup {
    Setup::short(0, isotherm_laboratory_bench::FaultPlan::default())
        .with(&[("four-point-tumble", "six-faces-two-headings"), ("list_c = [20, 21]", "list_c = [20]")])
}

/// When the journal has so many of this event.
pub(crate) fn at(event: &'static str, count: usize, act: ScriptAction) -> ScriptStep {
    ScriptStep(Trigger::Journal(event, count), act)
}

/// These faults, from when the journal has so many of this event.
pub(crate) fn faults_at(event: &'static str, count: usize, faults: &[DrawnFault]) -> ScriptStep {
    at(event, count, ScriptAction::Faults(faults.to_vec()))
}

/// The same fault of both instruments.
pub(crate) fn of_both(fault: InjectedFault) -> [DrawnFault; 2] {
    [DrawnFault::Chamber(fault), DrawnFault::Turntable(fault)]
}

/// The lines of the journal with this event.
pub(crate) fn events(campaign: &Campaign, event: &str) -> Vec<Value> {
    let text = campaign.file("journal.jsonl");
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    lines.filter(|line| line["event"] == event).collect()
}

/// The message of a runner that has failed.
pub(crate) fn said(ended: &CampaignEnd) -> &str {
    ended.failure.as_deref().unwrap_or_else(|| panic!("it has not failed: {ended:?}"))
}

/// Asserts that all is complete.
pub(crate) fn assert_done(ended: &CampaignEnd) {
    assert_eq!(ended.failure, None);
}

/// Asserts that the last safe state was reached: the chamber is in standby and the turntable is stopped.
pub(crate) fn assert_in_standby(campaign: &Campaign) {
    let safe = events(campaign, "safe");
    let last = safe.last().unwrap();
    assert!(last["chamber"].as_str().unwrap().starts_with("chamber in standby"), "{last}");
    assert!(last["table"].as_str().unwrap().starts_with("turntable stopped at"), "{last}");
}

/// Asserts that the journal and the file have every unit exactly once, in order.
pub(crate) fn assert_complete(campaign: &Campaign, units: usize) {
    assert_units(&events(campaign, "kept"), &campaign.file("campaign.csv"), units, 4);
}

/// Kills the runner there, and asserts that what it has kept is as it was after the runner before, whose rows `before`
/// has.
pub(crate) fn kill_at(campaign: &Campaign, steps: Vec<ScriptStep>, before: &mut String) {
    campaign.then(steps);
    assert!(campaign.run_once().is_killed);
    let end = events(campaign, "kept").last().unwrap()["to"].as_u64().unwrap() as usize;
    let samples = campaign.file("campaign.csv");
    assert!(samples.starts_with(&*before) && samples.len() >= end);
    samples[..end].clone_into(before);
}

/// The requests that an instrument gets after a time \[s\], as text, with the time of each.
pub(crate) fn requests(campaign: &Campaign, to_turntable: bool, after_s: f64) -> Vec<(f64, String)> {
    let all = campaign.world.requests().into_iter();
    let mine = all.filter(|request: &Request| request.to_turntable == to_turntable && request.at_s > after_s);
    mine.map(|request| (request.at_s, request.bytes.trim_ascii_end().escape_ascii().to_string())).collect()
}
