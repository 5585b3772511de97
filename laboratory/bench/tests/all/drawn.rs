//! Campaigns with faults drawn from seeds. `ISOTHERM_SEED` is the first of them, `ISOTHERM_SEEDS` their number.

use isotherm_laboratory_bench::{Campaign, FaultPlan, Setup, violations};
use std::collections::BTreeMap;

/// Faults begin within this time \[s\].
const FAULTY_S: f64 = 1200.0;
/// Number of seeds of a plan.
const SEEDS: u64 = 40;

fn from_environment(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|number| number.parse().ok())
}

fn check(setup: &Setup) -> (Vec<String>, f64) {
    let campaign = Campaign::new(setup);
    let ended = campaign.run();
    (violations(&campaign, &ended), campaign.world.now_s())
}

/// Runs the campaigns of all seeds, and counts the faults by kind.
fn hold(plan: fn(u64, FaultPlan) -> Setup) {
    let first = from_environment("ISOTHERM_SEED").unwrap_or(1);
    let seeds = from_environment("ISOTHERM_SEEDS").unwrap_or(SEEDS);
    let (mut wrong, mut lasted_s, mut kinds) = (0, 0.0, BTreeMap::<String, usize>::new());
    for seed in first..first + seeds {
        let setup = plan(seed, FaultPlan::drawn(seed, FAULTY_S));
        for (fault, _) in &setup.faults.0 {
            *kinds.entry(format!("{fault:?}")).or_default() += 1;
        }
        let (found, seconds) = check(&setup);
        lasted_s += seconds;
        if !found.is_empty() {
            wrong += 1;
            println!("seed {seed}: {found:#?}\n{:?}", setup.faults);
        }
    }
    println!(
        "{seeds} seeds, {:.1} h of laboratory time, {wrong} with violations; faults: {kinds:?}",
        lasted_s / 3600.0
    );
    assert_eq!(wrong, 0, "of {seeds} seeds");
}

#[test]
fn without_a_fault_a_campaign_is_complete() {
    for plan in [Setup::short, Setup::ramp] {
        assert_eq!(check(&plan(0, FaultPlan::default())).0, Vec::<String>::new());
    }
}

#[test]
fn campaigns_with_faults_hold_what_must_be_true() {
    hold(Setup::short);
}

#[test]
fn ramps_with_faults_hold_what_must_be_true() {
    hold(Setup::ramp);
}
