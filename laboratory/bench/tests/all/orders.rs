//! The stop orders, and what is said of the safe state.

use crate::course::{assert_done, assert_in_standby, at, events, faults_at, of_both, one_set_point, requests, said};
use isotherm_laboratory_bench::{Campaign, DrawnFault, ScriptAction, ScriptStep, Setup, Trigger, events_on_page};
use isotherm_station::{ChamberProtocol, InjectedFault};
use isotherm_support::failure::Exit;

const SIGINT: usize = 2;
/// Number of attempts at the safe state of an instrument.
const SAFE_ATTEMPTS: usize = 5;
/// Longest time until the first orders have gone out \[s\].
const ORDERS_S: f64 = 5.0;
/// The stop orders of the turntable.
const TURNTABLE_ORDERS: [&str; 4] = [":mode:off 1", ":interlock:open 1", ":mode:off 2", ":interlock:open 2"];

/// One set point, with these keys of both lines, on serial lines or on TCP.
fn with_lines(tcp: bool, keys: &str) -> Setup {
    let [chamber, table] = ["driver = \"espec\"\n", "driver = \"acutrol\"\n"];
    let [chamber_keys, table_keys] = [chamber, table].map(|driver| format!("{driver}{keys}"));
    Setup { tcp: [tcp; 2], ..one_set_point() }.with(&[(chamber, &chamber_keys), (table, &table_keys)])
}

/// Asserts that the orders come first, and within [`ORDERS_S`] of `after_s`. Before them may be a request that was
/// under way, or the rest of these orders, which a pause sends to a turntable that moves.
fn assert_first(orders: &[&str], requests: &[(f64, String)], after_s: f64) {
    let is = |at: usize, order: &str| requests.get(at).is_some_and(|(_, request)| request == order);
    let begins = |at: usize| orders.iter().enumerate().all(|(number, order)| is(at + number, order));
    let are_orders = |at: usize| requests[..at].iter().all(|(_, request)| orders.contains(&request.as_str()));
    let first = (0..=orders.len()).find(|&at| begins(at) && (at <= 1 || are_orders(at)));
    let first = first.unwrap_or_else(|| panic!("{requests:?}"));
    let last_s = requests[first + orders.len() - 1].0;
    assert!(last_s - after_s <= ORDERS_S, "the last of {orders:?} comes {:.1} s after the signal", last_s - after_s);
}

/// Asserts that each order came at every attempt.
fn assert_repeated(orders: &[&str], requests: &[(f64, String)]) {
    for order in orders {
        let count = requests.iter().filter(|(_, request)| request == order).count();
        assert!(count >= SAFE_ATTEMPTS, "{order}: {count} of {SAFE_ATTEMPTS} in {requests:?}");
    }
}

#[test]
fn an_alarm_ends_it_in_the_safe_state_at_once() {
    let campaign = Campaign::new(&one_set_point());
    campaign.then(vec![faults_at("reached", 1, &[DrawnFault::Chamber(InjectedFault::Alarm)])]);
    let ended = campaign.run_once();
    assert!(said(&ended).contains("alarm"), "{ended:?}");
    assert!(events(&campaign, "paused").is_empty());
    assert_in_standby(&campaign);
    campaign.world.set_faults(&[]);
    // After the alarm is cleared the campaign can be started again. A signal ends it in the safe state too.
    campaign.then(vec![at("kept", 1, ScriptAction::Signal(SIGINT))]);
    let ended = campaign.run_once();
    assert!(said(&ended).contains("stopped by SIGINT"), "{ended:?}");
    assert_in_standby(&campaign);
    assert_eq!(events_on_page(&campaign.file("live.html")), ["start", "alarm or fault", "start", "stop"]);
}

#[test]
fn an_alarm_ends_the_campaign_while_the_other_instrument_is_disconnected() {
    let campaign = Campaign::new(&one_set_point());
    let (lost, alarm) = (DrawnFault::Turntable(InjectedFault::PortLoss), DrawnFault::Chamber(InjectedFault::Alarm));
    campaign.then(vec![faults_at("reached", 1, &[lost]), faults_at("paused", 1, &[lost, alarm])]);
    let ended = campaign.run_once();
    // The turntable is disconnected and cannot be stopped.
    assert_eq!(ended.exit, Some(Exit::Unavailable));
    for part in ["the chamber has an alarm", "turntable NOT known to be stopped", "GO THERE AND LOOK"] {
        assert!(said(&ended).contains(part), "{ended:?}");
    }
    campaign.world.set_faults(&[]);
    let (text, certain) = campaign.stop().unwrap();
    assert!(certain && text.contains("turntable stopped at"), "{text}");
    assert_in_standby(&campaign);
    assert!(!isotherm_automation::journal::needs_safe_state(&campaign.plan.output), "nothing is left to do");
}

#[test]
fn reconnecting_the_turntable_does_not_reset_a_fault_that_came_meanwhile() {
    let campaign = Campaign::new(&one_set_point());
    let of_table = |fault| DrawnFault::Turntable(fault);
    let both = [of_table(InjectedFault::PortLoss), of_table(InjectedFault::Alarm)];
    campaign.then(vec![faults_at("kept", 1, &both), faults_at("paused", 1, &[])]);
    let ended = campaign.run_once();
    assert!(said(&ended).contains("the turntable has a fault: interlock of axis 1: Fault"), "{ended:?}");
    assert_in_standby(&campaign);
}

/// However the lines disturb, the orders arrive before any request that waits for something, and the runner says what
/// is not sure.
#[test]
fn the_orders_go_out_first_on_lines_that_do_not_work() {
    for (tcp, fault) in [false, true].into_iter().flat_map(|tcp| {
        [InjectedFault::Babble, InjectedFault::Garbled, InjectedFault::Missing].map(|fault| (tcp, fault))
    }) {
        let campaign = Campaign::new(&with_lines(tcp, "quiet_s = 0.2\nretries = 1\n"));
        campaign.then(vec![
            faults_at("kept", 1, &of_both(fault)),
            at("paused", 1, ScriptAction::Note),
            ScriptStep(Trigger::After(1.0), ScriptAction::Signal(SIGINT)),
        ]);
        let ended = campaign.run_once();
        assert_eq!(ended.exit, Some(Exit::Unavailable), "{ended:?}");
        assert!(said(&ended).contains("stopped by SIGINT") && said(&ended).contains("GO THERE AND LOOK"), "{ended:?}");
        let signal_s = campaign.world.steps_s()[2];
        let of = |to_turntable| requests(&campaign, to_turntable, signal_s);
        assert_first(&["MODE,STANDBY"], &of(false), signal_s);
        assert_first(&TURNTABLE_ORDERS, &of(true), signal_s);
        assert_repeated(&["MODE,STANDBY"], &of(false));
        assert_repeated(&TURNTABLE_ORDERS, &of(true));
        if fault == InjectedFault::Babble {
            assert!(said(&ended).contains("babble: it sends without a request"), "{ended:?}");
            let safe = events(&campaign, "safe").pop().unwrap();
            assert!(safe["table"].as_str().unwrap().contains("babble:"), "{safe}");
        }
        // The next command finds still lines and confirms.
        campaign.world.set_faults(&[]);
        assert!(campaign.stop().unwrap().1);
        assert_in_standby(&campaign);
    }
}

/// The lines may wait a minute for a reply, but not once the safe state is wanted.
#[test]
fn the_orders_wait_for_no_time_out() {
    for tcp in [false, true] {
        let campaign = Campaign::new(&with_lines(tcp, "timeout_s = 60\nquiet_s = 0.2\n"));
        campaign.then(vec![
            faults_at("kept", 1, &of_both(InjectedFault::Missing)),
            // The runner waits for the reply to the last request.
            ScriptStep(Trigger::After(20.0), ScriptAction::Signal(SIGINT)),
        ]);
        let _ = campaign.run_once();
        let signal_s = campaign.world.steps_s()[1];
        assert_first(&["MODE,STANDBY"], &requests(&campaign, false, signal_s), signal_s);
        assert_first(&TURNTABLE_ORDERS, &requests(&campaign, true, signal_s), signal_s);
    }
}

/// A turntable that takes nothing does not delay the chamber's order; neither does a second signal change anything.
#[test]
fn a_dead_turntable_does_not_hold_the_chambers_order() {
    for tcp in [false, true] {
        let campaign = Campaign::new(&with_lines(tcp, "timeout_s = 2\nquiet_s = 0.2\nretries = 1\n"));
        campaign.then(vec![
            faults_at("kept", 1, &[DrawnFault::Turntable(InjectedFault::Dead)]),
            at("paused", 1, ScriptAction::Signal(SIGINT)),
            ScriptStep(Trigger::After(1.0), ScriptAction::Signal(SIGINT)),
        ]);
        let ended = campaign.run_once();
        assert_eq!(ended.exit, Some(Exit::Unavailable), "{ended:?}");
        let signal_s = campaign.world.steps_s()[1];
        assert_first(&["MODE,STANDBY"], &requests(&campaign, false, signal_s), signal_s);
        // A connection takes what nobody reads, a serial line nothing.
        assert!(tcp || requests(&campaign, true, signal_s).is_empty());
        let safe = events(&campaign, "safe").pop().unwrap();
        assert!(safe["chamber"].as_str().unwrap().starts_with("chamber in standby"), "{safe}");
        assert!(safe["table"].as_str().unwrap().starts_with("turntable NOT known to be stopped"), "{safe}");
    }
}

/// One set point at this chamber, with this safe state.
fn with_chamber(chamber: ChamberProtocol, safe: &str) -> Setup {
    let with_keys = |driver: &str| format!("{driver}quiet_s = 0.2\nretries = 0\n");
    let [driver, turntable] = [<&str>::from(chamber), "acutrol"].map(|driver| format!("driver = {driver:?}\n"));
    Setup { chamber, ..one_set_point() }.with(&[
        (&driver, &with_keys(&driver)),
        (&turntable, &with_keys(&turntable)),
        ("chamber = \"standby\"", &format!("chamber = {safe:?}")),
    ])
}

/// The write of 62 to register 2730.
const F4T_STOP: &str = "\\x01\\x06\\n\\xaa\\x00>";

/// A process that has not reached the chamber before orders what it knows: without the unit of a Watlow F4T its stop in
/// place of ambient, without the outputs of an ASCII-2 chamber nothing.
#[test]
fn a_new_process_orders_what_it_can_on_lines_that_do_not_work() {
    use ChamberProtocol::{Ascii2, WatlowF4t};
    let babbles = of_both(InjectedFault::Babble);
    for (chamber, safe, order, attempts) in [
        // Attempts at ambient, then at standby.
        (WatlowF4t, "ambient", Some(F4T_STOP), 2 * SAFE_ATTEMPTS),
        (Ascii2, "standby", None, 0),
    ] {
        let campaign = Campaign::new(&with_chamber(chamber, safe));
        campaign.then(vec![at("reached", 1, ScriptAction::Kill)]);
        assert!(campaign.run_once().is_killed);
        campaign.world.set_faults(&babbles);
        let begun_s = campaign.world.now_s();
        let (text, certain) = campaign.stop().unwrap();
        assert!(!certain, "{text}");
        let to_chamber = requests(&campaign, false, begun_s);
        match order {
            Some(order) => {
                let orders = to_chamber.iter().filter(|(_, request)| request.starts_with(order));
                assert!(orders.count() >= attempts, "{to_chamber:?}");
            }
            None => assert!(to_chamber.iter().all(|(_, request)| request == "$01I"), "{to_chamber:?}"),
        }
        assert_repeated(&TURNTABLE_ORDERS, &requests(&campaign, true, begun_s));
        // The next command finds still lines and confirms.
        campaign.world.set_faults(&[]);
        assert!(campaign.stop().unwrap().1);
        assert_in_standby(&campaign);
    }
}

/// A line that works gives the unit in time, and the chamber is not stopped.
#[test]
fn a_new_process_holds_a_watlow_at_ambient() {
    let campaign = Campaign::new(&with_chamber(ChamberProtocol::WatlowF4t, "ambient"));
    campaign.then(vec![at("kept", 1, ScriptAction::Kill)]);
    assert!(campaign.run_once().is_killed);
    let begun_s = campaign.world.now_s();
    let (text, certain) = campaign.stop().unwrap();
    assert!(certain && text.contains("chamber held at 20.0 degC"), "{text}");
    assert!(!requests(&campaign, false, begun_s).iter().any(|(_, request)| request.starts_with(F4T_STOP)));
    assert_done(&campaign.run_once());
}

/// A pause in a motion begins with the stop orders.
#[test]
fn a_pause_in_a_motion_sends_the_stop_orders() {
    let campaign = Campaign::new(&one_set_point().with(&[("rate_deg_s = 10", "rate_deg_s = 0.5")]));
    campaign.then(vec![
        ScriptStep(
            Trigger::Phase("travel", 1),
            ScriptAction::Faults(vec![DrawnFault::Turntable(InjectedFault::Garbled)]),
        ),
        faults_at("paused", 1, &[]),
    ]);
    assert_done(&campaign.run_once());
    let paused_s = campaign.world.steps_s()[1];
    assert_first(&TURNTABLE_ORDERS, &requests(&campaign, true, paused_s - 0.3), paused_s);
}
