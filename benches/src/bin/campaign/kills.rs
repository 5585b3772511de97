//! The runner is killed (SIGKILL) at random moments: completed dwells and turns stay as they were, and the campaign is
//! completed.

use crate::laboratory::{BenchLaboratory, SHORT, TIMEOUT};
use isotherm_benches::{BenchResult, Random};
use std::time::{Duration, Instant};

/// Laboratory time divided by real time.
const SPEED: u32 = 1000;
/// Dwells and turns of the short campaign.
const UNITS: usize = 2 * (12 + 6);
/// Changes of the plan: dwells and turns so long that most of the time is spent in them.
const DWELL: (&str, &str) = ("time_s = 60\n", "time_s = 600\n");
const TURNS: (&str, &str) = ("[turns]\n", "[turns]\nrate_deg_s = 0.6\n");
/// Rows of a dwell of this length.
const ROWS: u64 = 60;
/// Longest time before a runner is killed \[s\].
const LIFE_S: f64 = 6.0;

/// Kills 30 runners; with `smoke` one.
pub(crate) fn bench(smoke: bool) -> BenchResult<()> {
    let (campaigns, kills) = if smoke { (1, 1) } else { (6, 5) };
    let mut random = Random::default();
    let (mut lost, mut differences) = (0, 0);
    println!("{campaigns} campaigns of {UNITS} dwells and turns, each runner killed {kills} times at random moments");
    println!("  campaign   killed in                                         units repeated    s");
    let changes: Vec<_> = SHORT.into_iter().chain([DWELL, TURNS]).collect();
    for campaign in 1..=campaigns {
        let laboratory = BenchLaboratory::new(SPEED, "1", &changes, false)?;
        let (begun, mut phases, mut before) = (Instant::now(), Vec::new(), Vec::new());
        let mut repeated = 0;
        for _ in 0..kills {
            let runner = laboratory.run(&[])?;
            let started = laboratory.events("started")?.len();
            laboratory.wait_until("the runner", || {
                Ok(laboratory.events("started")?.len() > started || !laboratory.phase().is_empty())
            })?;
            std::thread::sleep(Duration::from_secs_f64(LIFE_S * random.unit()));
            drop(runner);
            let phase = laboratory.phase();
            repeated += usize::from(["travel", "settle", "dwell", "turn"].contains(&phase.as_str()));
            phases.push(if phase.is_empty() { "start".to_owned() } else { phase });
            let end = laboratory.events("kept")?.last().map_or(0, |unit| unit["to"].as_u64().unwrap_or_default());
            let samples = laboratory.file("campaign.csv");
            differences += usize::from(!samples.starts_with(&before));
            before = samples.get(..end as usize).ok_or("samples that the journal lists are not there")?.to_vec();
        }
        if !laboratory.run(&[])?.succeeds_within(TIMEOUT)? {
            return Err(laboratory.domain.failure(&format!("campaign {campaign} was not completed")));
        }
        differences += usize::from(!laboratory.file("campaign.csv").starts_with(&before));
        if let Some(wrong) = laboratory.wrong(UNITS, ROWS)? {
            return Err(wrong.into());
        }
        println!("  {campaign:>8}   {:<50} {repeated:>14}   {:.0}", phases.join(", "), begun.elapsed().as_secs_f64());
        lost += repeated;
    }
    println!(
        "{campaigns} of {campaigns} campaigns completed after {} kills: every unit once, {lost} in progress taken again, completed units \
         that differ in a byte afterwards: {differences}",
        campaigns * kills
    );
    if differences > 0 { Err("completed units were changed".into()) } else { Ok(()) }
}
