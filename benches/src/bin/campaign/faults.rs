//! Each fault of an instrument in each phase of a campaign: how the campaign ends, and which units are repeated.

use crate::laboratory::{BenchLaboratory, SHORT, TIMEOUT};
use isotherm_benches::BenchResult;
use std::time::{Duration, Instant};

/// Laboratory time divided by real time.
const SPEED: u32 = 500;
/// Duration of a fault in real time. It is longer than the retries of an instrument's driver.
const LASTS: Duration = Duration::from_secs(8);
/// Units of the campaign: 12 dwells, 6 turns and a verification run.
const UNITS: usize = 12 + 6 + 1;
/// Turns so slow that a fault meets one of them.
const SLOW_TURNS: (&str, &str) = ("[turns]\n", "[turns]\nrate_deg_s = 0.5\n");
const VERIFY: (&str, &str) =
    ("[safe]", "[verify]\nruns = 1\nfrom_c = 25\nto_c = 27\nramp_c_per_h = 60\nhold_s = 60\n\n[safe]");

const PHASES: [&str; 6] = ["approach", "soak", "travel", "dwell", "turn", "sweep"];
const FAULTS: [(&str, &[&str]); 12] = [
    ("babble", &["chamber", "table"]),
    ("dead", &["chamber", "table"]),
    ("garbled", &["chamber", "table"]),
    ("late", &["chamber", "table"]),
    ("missing", &["chamber", "table"]),
    ("duplicated", &["chamber", "table"]),
    ("na", &["chamber", "table"]),
    ("alarm", &["chamber", "table"]),
    ("port-loss", &["chamber", "table"]),
    ("no-settle", &["table"]),
    ("overshoot", &["chamber"]),
    ("never-there", &["chamber"]),
];

/// Tries each fault in each phase, or in `only` one; with `smoke` one fault in one phase.
pub(crate) fn bench(smoke: bool, only: Option<&str>) -> BenchResult<()> {
    let phases: Vec<_> = PHASES.into_iter().filter(|phase| only.is_none_or(|only| only == *phase)).collect();
    if phases.is_empty() {
        return Err(format!("{only:?}: give one of {}", PHASES.join(", ")).into());
    }
    println!("each fault for {:.1} s in each phase; chamber | table", LASTS.as_secs_f64());
    println!(
        "  recovered: went on by itself; paused: and went on; again: units begun again; safe: table stopped, chamber in standby"
    );
    println!(
        "  {:12} {:8} {}",
        "fault",
        "at",
        phases.iter().map(|phase| format!("{phase:<20}")).collect::<Vec<_>>().join(" ")
    );
    let mut wrong = Vec::new();
    for (fault, instruments) in FAULTS.iter().filter(|(fault, _)| !smoke || *fault == "missing") {
        for instrument in instruments.iter().filter(|instrument| !smoke || **instrument == "table") {
            let mut cells = Vec::new();
            for phase in &phases {
                if smoke && *phase != "dwell" {
                    continue;
                }
                let outcome = case(fault, instrument, phase)?;
                wrong.extend(outcome.wrong.map(|wrong| format!("{fault} {instrument} {phase}: {wrong}")));
                cells.push(format!("{:<20}", outcome.words));
            }
            println!("  {fault:12} {instrument:8} {}", cells.join(" "));
        }
    }
    if wrong.is_empty() {
        println!("completed units lost or changed: 0");
        Ok(())
    } else {
        Err(wrong.join("\n").into())
    }
}

struct CaseResult {
    words: String,
    wrong: Option<String>,
}

fn case(fault: &str, instrument: &str, phase: &str) -> BenchResult<CaseResult> {
    let changes: Vec<_> = SHORT
        .into_iter()
        .chain([("list_c = [20, 23]", "list_c = [25]"), VERIFY])
        .chain((phase == "turn").then_some(SLOW_TURNS))
        .collect();
    let laboratory = BenchLaboratory::new(SPEED, "1", &changes, false)?;
    let mut runner = laboratory.run(&[])?;
    laboratory.wait_until(phase, || {
        let first = phase != "dwell" || !laboratory.events("kept")?.is_empty();
        Ok(laboratory.phase() == phase && first || runner_has_gone(&laboratory)?)
    })?;
    let before = laboratory.events("kept")?.last().map_or(0, |unit| unit["to"].as_u64().unwrap_or_default());
    let taken = laboratory.file("campaign.csv").get(..before as usize).unwrap_or_default().to_vec();
    laboratory.set_faults(&format!("{fault}:{instrument}\n"))?;
    let begun = Instant::now();
    while begun.elapsed() < LASTS && !runner_has_gone(&laboratory)? {
        std::thread::sleep(Duration::from_millis(5));
    }
    laboratory.set_faults("")?;
    let well = runner.succeeds_within(TIMEOUT)?;
    let paused = laboratory.events("paused")?.len();
    let again = laboratory.events("discarded")?.len();
    let safe = laboratory.events("safe")?;
    let known = safe.last().is_some_and(|safe| {
        let text = safe.to_string();
        text.contains("table stopped at") && text.contains("chamber in standby")
    });
    let mut words = match (well, paused, known) {
        (true, 0, _) => "recovered".to_owned(),
        (true, paused, _) => format!("paused {paused}x"),
        (false, _, true) => "safe".to_owned(),
        (false, _, false) => "safe, not confirmed".to_owned(),
    };
    if again > 0 {
        words += &format!(", {again} again");
    }
    let mut wrong =
        (!laboratory.file("campaign.csv").starts_with(&taken)).then(|| "completed units have changed".to_owned());
    if well {
        wrong = wrong.or(laboratory.wrong(UNITS, 6)?);
    } else if safe.is_empty() {
        wrong = Some(laboratory.domain.failure("no safe state").to_string());
    }
    Ok(CaseResult { words, wrong })
}

fn runner_has_gone(laboratory: &BenchLaboratory) -> BenchResult<bool> {
    Ok(!laboratory.events("safe")?.is_empty())
}
