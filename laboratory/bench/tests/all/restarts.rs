//! Runners that end, and others that go on.

use crate::course::{assert_complete, assert_done, assert_in_standby, at, kill_at, one_set_point};
use isotherm_automation::finish::Finish;
use isotherm_automation::journal::Journal;
use isotherm_client::domain;
use isotherm_fit::{AlignmentChoice, LagChoice};
use isotherm_laboratory_bench::{Campaign, ScriptAction, ScriptStep, Trigger, events_on_page};
use isotherm_shared::table::CoefficientTable;
use isotherm_simulation::worst_errors;
use std::fs::{self, File};
use std::sync::atomic::AtomicUsize;

#[test]
fn killed_twice_it_continues_with_the_first_missing_dwell() {
    let campaign = Campaign::new(&one_set_point().with(&[("list_c = [20]", "list_c = [20, 23]")]));
    let mut before = String::new();
    for count in [5, 15] {
        kill_at(&campaign, vec![at("kept", count, ScriptAction::Kill)], &mut before);
    }
    assert_done(&campaign.run_once());
    // Completed dwells are unchanged to the byte, and every dwell is present once.
    assert!(campaign.file("campaign.csv").starts_with(&before));
    assert_complete(&campaign, 24);
    assert_in_standby(&campaign);
    assert_eq!(events_on_page(&campaign.file("live.html")), ["start", "start", "start", "end"]);
    let page = campaign.file("live.html");
    assert_eq!(page.matches("the runner before ended without the safe state").count(), 2);
}

/// The live page has the curves that the runner keeps. It does not read the readbacks again, which grow for days.
#[test]
fn the_live_page_has_the_earlier_curves_when_the_readbacks_are_truncated() {
    let campaign = Campaign::new(&one_set_point());
    let truncate = |folder: &std::path::Path| {
        let path = folder.join("readbacks.csv");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(folder.join("earlier"), (text.lines().count() - 1).to_string()).unwrap();
        let header = text.find('\n').unwrap() + 1;
        File::options().write(true).open(path).unwrap().set_len(header as u64).unwrap();
    };
    campaign.then(vec![at("kept", 1, ScriptAction::Call(truncate))]);
    assert_done(&campaign.run_once());
    let earlier: usize = campaign.file("earlier").parse().unwrap();
    let later = campaign.file("readbacks.csv").lines().count() - 1;
    assert!(earlier > 2 && later > 2, "{earlier} {later}");
    let page = campaign.file("live.html");
    assert!(page.contains("all data are taken"));
    let series = format!("Series: air ({0} points), set point ({0} points)", earlier + later);
    let found: Vec<_> = page.split("<desc>").skip(1).filter_map(|figure| figure.split("</desc>").next()).collect();
    assert!(found.contains(&series.as_str()), "{earlier} + {later} rows, but {found:?}");
}

/// A set point that was reached before the clock of day was set, and a runner that is killed in the soak: what is left
/// of the soak is waited for, by the clock that only rises.
#[test]
fn a_clock_that_is_set_does_not_shorten_a_soak() {
    let soak = ("time_s = 60\nstay_s = 0", "time_s = 1800\nstay_s = 0");
    let campaign = Campaign::new(&one_set_point().with(&[soak]));
    campaign.then(vec![
        at("reached", 1, ScriptAction::SetClock(3600.0)),
        ScriptStep(Trigger::After(30.0), ScriptAction::Kill),
    ]);
    assert!(campaign.run_once().is_killed);
    let [reached_s, _] = campaign.world.steps_s()[..] else { panic!("two steps") };
    campaign.then(vec![ScriptStep(Trigger::Phase("travel", 0), ScriptAction::Note)]);
    assert_done(&campaign.run_once());
    let soaked_s = campaign.world.steps_s()[2] - reached_s;
    assert!((1799.0..1900.0).contains(&soaked_s), "{soaked_s}");
}

/// Killed again and again, the rows give the table of the truth.
#[test]
fn the_table_of_a_campaign_that_was_killed_is_that_of_the_truth() {
    let campaign = Campaign::new(&one_set_point().with(&[
        ("list_c = [20]", "list_c = [10, 18, 26, 34]"),
        ("time_s = 60\nstay_s = 0", "time_s = 300\nstay_s = 0"),
        ("ramp_c_per_min = 1", "ramp_c_per_min = 3"),
    ]));
    for count in [3, 17, 30] {
        campaign.then(vec![at("kept", count, ScriptAction::Kill)]);
        assert!(campaign.run_once().is_killed);
    }
    assert_done(&campaign.run_once());
    assert_complete(&campaign, 48);
    let table = fitted(&campaign, AlignmentChoice::Without);
    let [bias, scale_factor] = worst_errors(&table, &campaign.truths[0].table);
    assert!(bias < 1.5 && scale_factor < 4.0, "{bias} ug0, {scale_factor} ppm");
}

/// The table that is made of a complete campaign.
pub(crate) fn fitted(campaign: &Campaign, alignment: AlignmentChoice) -> CoefficientTable {
    let (mut journal, _) = Journal::open(&campaign.plan).unwrap();
    let finish = Finish { require: None, alignment, lag: LagChoice::default(), accept: Vec::new(), strict: false };
    // Nobody serves it: nothing is installed.
    let nobody = domain(Some("bench")).unwrap();
    finish.run(&campaign.plan, &mut journal, &nobody, &AtomicUsize::default()).unwrap();
    CoefficientTable::from_toml(&campaign.file("table.toml"), None).unwrap()
}
