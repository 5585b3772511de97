//! Campaigns on a virtual clock.

use isotherm_laboratory_bench::{Campaign, FaultPlan, violations};

/// Faults begin within this time \[s\].
const FAULTY_S: f64 = 1200.0;

fn check(seed: u64, faults: FaultPlan) -> Vec<String> {
    let campaign = Campaign::new(seed, faults);
    let ended = campaign.run();
    violations(&campaign, &ended)
}

#[test]
fn without_a_fault_a_campaign_is_complete() {
    assert_eq!(check(0, FaultPlan::default()), Vec::<String>::new());
}

#[test]
fn campaigns_with_faults_hold_what_must_be_true() {
    let first: u64 = std::env::var("ISOTHERM_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let seeds: u64 = std::env::var("ISOTHERM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(60);
    let mut wrong = 0;
    for seed in first..first + seeds {
        let faults = FaultPlan::drawn(seed, FAULTY_S);
        let found = check(seed, faults.clone());
        if !found.is_empty() {
            wrong += 1;
            println!("seed {seed}: {found:#?}\n{faults:?}");
        }
    }
    assert_eq!(wrong, 0, "of {seeds} seeds");
}
