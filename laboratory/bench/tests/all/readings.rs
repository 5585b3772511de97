//! Readings that are wrong, late or cut.

use crate::course::{assert_complete, assert_done, at, events, one_set_point, requests, said};
use isotherm_laboratory_bench::{
    Campaign, DrawnFault, FaultPlan, ScriptAction, ScriptStep, Setup, Trigger, violations,
};

/// Within a campaign, in a dwell or a motion \[s\].
const MISREAD_S: f64 = 130.0;

/// The turntable is stopped at once, and a second reading shows that the first was wrong.
#[test]
fn a_misread_angle_stops_the_turntable_and_does_not_end_the_campaign() {
    for tcp in [false, true] {
        let faults = FaultPlan(vec![(DrawnFault::Misread, MISREAD_S..MISREAD_S)]);
        let campaign = Campaign::new(&Setup { faults, tcp: [false, tcp], ..one_set_point() });
        let ended = campaign.run_once();
        assert_done(&ended);
        assert_complete(&campaign, 12);
        let causes: Vec<_> = events(&campaign, "paused").iter().map(|paused| paused["cause"].to_string()).collect();
        assert!(causes.len() == 1 && causes[0].contains("498.12345 deg is outside limits.outer_deg"), "{causes:?}");
        assert!(causes[0].contains("a second reading on a fresh line does not confirm it"), "{causes:?}");
        let after = requests(&campaign, true, MISREAD_S);
        let stopped = after.iter().find(|(_, request)| request == ":mode:off 1").unwrap();
        assert!(stopped.0 < MISREAD_S + 3.0, "{stopped:?}");
    }
}

/// A turntable that is beyond its limits is stopped and read again, and the campaign ends.
#[test]
fn a_turntable_beyond_its_limits_ends_the_campaign() {
    let campaign = Campaign::new(&Setup {
        // In the soak nobody sends the turntable anywhere else.
        faults: FaultPlan(vec![(DrawnFault::RunAway, 10.0..10.0)]),
        ..one_set_point()
    });
    let ended = campaign.run_once();
    assert!(said(&ended).contains("is outside limits.outer_deg"), "{ended:?}");
    assert!(events(&campaign, "paused").is_empty());
}

/// Replies that come when the request was given up and the line was quiet are never those of other requests.
#[test]
fn replies_that_are_later_than_the_quiet_time_are_never_anothers() {
    for seed in 0..24 {
        let faults = FaultPlan(vec![(DrawnFault::Slow { turntable: seed % 4 != 2 }, 150.0..300.0)]);
        let campaign = Campaign::new(&Setup { seed, faults, tcp: [false, seed % 2 == 1], ..one_set_point() });
        let ended = campaign.run();
        assert_eq!(violations(&campaign, &ended), Vec::<String>::new(), "seed {seed}");
    }
}

/// A reply of which the end is missing is no reading: also not to a process that has seen no other one.
#[test]
fn a_cut_reply_is_never_an_angle() {
    for (seed, kept) in (1..40).step_by(2).zip(4..24) {
        let campaign = Campaign::short(seed, FaultPlan::default());
        campaign.then(vec![at("kept", kept % 8, ScriptAction::Kill)]);
        let mut ended = vec![campaign.run_once()];
        campaign.world.set_faults(&[DrawnFault::CutReply]);
        campaign.then(vec![ScriptStep(Trigger::After(60.0), ScriptAction::Faults(Vec::new()))]);
        ended.extend(campaign.run());
        assert_eq!(violations(&campaign, &ended), Vec::<String>::new(), "seed {seed}");
    }
}
