//! What `calibrate`, `verify` and the gate say about the mistakes of laboratories, and about correct campaigns.
//!
//!     cargo run -p isotherm-fit --example mistakes             Markdown tables, five seeds a mistake
//!     cargo run -p isotherm-fit --example mistakes NAME          lines about mistakes named so, seed 1
//!     cargo run -p isotherm-fit --example mistakes correct [N]   refusals of 200 correct campaigns
//!
//! `tests/all/mistakes/gate.rs` says how the gate is tried, and what a wrong table is.
#![allow(
    clippy::panic,
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "a program of the developers prints its result, and a panic is its report"
)]

#[path = "../tests/all/mistakes/gate.rs"]
mod gate;
#[path = "../tests/all/mistakes/matrix.rs"]
mod matrix;

use gate::{ANGLES_DEG, Good, Installation, WRONG, faults, gate, install, true_error};
use isotherm_fit::{AlignmentChoice, CalibrationOptions};
use matrix::{Case, ExpectedOutcome, Mistake, calibrated, correct, mistakes, outcome, without_misalignment};
use std::collections::{BTreeMap, BTreeSet};
use std::process::ExitCode;

const SEEDS: u64 = 5;
const CORRECT: u64 = 200;

/// A turntable that repeats worse than this cannot show an error of 1e-3 g0 \[rad\].
const POOR_TURNTABLE: f64 = 1e-3;
/// Angles of the runs after correct campaigns \[deg\].
const ATTITUDES: [[f64; 2]; 4] = [ANGLES_DEG, [0.0, 0.0], [90.0, 0.0], [235.0, 300.0]];

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("correct") => {
            let count = std::env::args().nth(2).and_then(|count| count.parse().ok());
            correct_campaigns(count.unwrap_or(CORRECT))
        }
        Some(name) => {
            show(name);
            ExitCode::SUCCESS
        }
        None => tables(),
    }
}

/// Prints all lines about the mistakes with `name` in their name.
fn show(name: &str) {
    for mistake in mistakes().iter().filter(|mistake| mistake.name.contains(name)) {
        let case = (mistake.make)(1);
        println!("{}\n{}", mistake.name, outcome(&case).lines.join("\n"));
        let good = Good::of(&case, 1);
        let accepted = faults(&case);
        let installed = accepted.and_then(|accept| Ok((install(&case, &good, &accept, 1)?, accept)));
        match installed {
            Ok((Installation { true_error, gates, .. }, accept)) => {
                println!("true error {:.2}e-6 g0, accepted: {accept:?}", true_error * 1e6);
                for (gate, words) in gates.iter().zip(["no table in force", "the good table in force"]) {
                    println!("gate, {words}: {}", gate.causes.join("\n  "));
                }
                println!("{}", gates[0].last_line);
            }
            Err(text) => println!("no table whatever is accepted: {text}"),
        }
    }
}

/// Prints both tables and the totals. Fails if an outcome is not the expected one.
fn tables() -> ExitCode {
    println!(
        "The gate: two runs of the same IMU at {ANGLES_DEG:?} deg, temperature up and down, with what of the mistake stays in this laboratory; \
         the bounds of the fit and a factor of 10; without a table in force, and with the good one in force (of the same campaign without \
         the mistake). A table is wrong if its output is over 20e-6 g0 (20 ppm of 1 g0) off the simulated truth somewhere, and over 3 times as \
         far as that of the good table.\n"
    );
    println!(
        "| mistake | calibrate: refused | first line names the cause | what it says (seed 1) | verify (seed 1) | gate: refused | with the good \
         table in force | wrong tables | wrong tables installed |\n|---|---|---|---|---|---|---|---|---|"
    );
    let mut totals = Totals::default();
    let mut accepted = Vec::new();
    for mistake in mistakes() {
        accepted.extend(row(&mistake, &mut totals));
    }
    println!(
        "\n## Faults accepted with --accept\n\n| mistake | accepted | tables | verify (seed 1) | gate: refused | with the good table in force \
         | wrong tables | wrong tables installed |\n|---|---|---|---|---|---|---|---|"
    );
    accepted.iter().for_each(|line| println!("{line}"));
    let Totals { mistakes, refused, named, made, wrong, installed, in_principle, accepted, .. } = &totals;
    println!(
        "\n{mistakes} mistakes x {SEEDS} seeds: {refused} campaigns refused, first line or warning names the cause in {named}; {made} tables made, \
         {wrong} of them wrong; wrong tables installed: {installed}; more that are invisible in principle: {in_principle}"
    );
    println!(
        "faults accepted: {} tables made, {} of them wrong, {} wrong tables installed",
        accepted[0], accepted[1], accepted[2]
    );
    if totals.failed { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

#[derive(Default)]
struct Totals {
    mistakes: u64,
    refused: usize,
    named: usize,
    made: usize,
    wrong: usize,
    /// Wrong tables installed, that a campaign or a run could have shown; and the others.
    installed: usize,
    in_principle: usize,
    /// Tables made of accepted faults, wrong ones, wrong ones installed.
    accepted: [usize; 3],
    failed: bool,
}

/// Prints the row of a mistake. Returns its row of the second table, if its fault can be accepted.
fn row(mistake: &Mistake, totals: &mut Totals) -> Option<String> {
    let cases: Vec<_> = (1..=SEEDS).map(|seed| (seed, (mistake.make)(seed))).collect();
    let outcomes: Vec<_> = cases.iter().map(|(_, case)| outcome(case)).collect();
    let refused = outcomes.iter().filter(|outcome| outcome.errors.is_none()).count();
    let named = outcomes.iter().filter(|outcome| outcome.is(mistake.expected)).count();
    totals.mistakes += 1;
    totals.refused += refused;
    totals.failed |= named as u64 != SEEDS;
    let words = match mistake.expected {
        ExpectedOutcome::Refused(_) => format!("{named} of {SEEDS}"),
        ExpectedOutcome::Warned(_) | ExpectedOutcome::WarnedAlone(_) => format!("{named} of {SEEDS}, a warning"),
        ExpectedOutcome::Invisible(why) => format!("invisible in a campaign: {why}"),
        ExpectedOutcome::InPrinciple(why) => format!("invisible in principle, in campaign and run: {why}"),
    };
    if matches!(
        mistake.expected,
        ExpectedOutcome::Refused(_) | ExpectedOutcome::Warned(_) | ExpectedOutcome::WarnedAlone(_)
    ) {
        totals.named += named;
    }
    let tried: Vec<_> = (cases.iter().zip(&outcomes))
        .map(|((seed, case), outcome)| {
            let good = Good::of(case, *seed);
            let made = outcome.errors.is_some().then(|| install(case, &good, &[], *seed).unwrap());
            let accept = faults(case);
            let anyway =
                made.is_none().then(|| accept.and_then(|accept| Ok((install(case, &good, &accept, *seed)?, accept))));
            (made, anyway)
        })
        .collect();
    let made: Vec<&Installation> = tried.iter().filter_map(|(made, _)| made.as_ref()).collect();
    let line = outcomes[0].first().replace('|', "\\|");
    println!("| {} | {refused} of {SEEDS} | {words} | {line} | {} |", mistake.name, cells(&made));
    let [wrong, installed] = count(&made);
    totals.made += made.len();
    totals.wrong += wrong;
    let in_principle = matches!(mistake.expected, ExpectedOutcome::InPrinciple(_) | ExpectedOutcome::WarnedAlone(_));
    *if in_principle { &mut totals.in_principle } else { &mut totals.installed } += installed;
    totals.failed |= installed > 0 && !in_principle;
    let anyway: Vec<_> = tried.iter().filter_map(|(_, anyway)| anyway.as_ref()).collect();
    let tables: Vec<_> = anyway.iter().filter_map(|tried| tried.as_ref().ok()).collect();
    let first_error = anyway.iter().find_map(|tried| tried.as_ref().err());
    if anyway.is_empty() {
        return None;
    }
    let accept: BTreeSet<_> = tables.iter().flat_map(|(_, accept)| accept.iter().copied()).collect();
    let tables: Vec<&Installation> = tables.iter().map(|(made, _)| made).collect();
    let [wrong, installed] = count(&tables);
    for (total, more) in totals.accepted.iter_mut().zip([tables.len(), wrong, installed]) {
        *total += more;
    }
    let cells = if tables.is_empty() {
        let why = first_error.and_then(|text| text.lines().next()).unwrap_or_default().replace('|', "\\|");
        format!("no table: {why} | | | |")
    } else {
        cells(&tables)
    };
    let accept = accept.into_iter().collect::<Vec<_>>().join(", ");
    Some(format!("| {} | {accept} | {} of {SEEDS} | {cells} |", mistake.name, tables.len()))
}

/// Wrong tables, and wrong tables installed with or without a table in force.
fn count(tables: &[&Installation]) -> [usize; 2] {
    let wrong = tables.iter().filter(|made| made.wrong).count();
    [wrong, tables.iter().filter(|made| made.wrong_installed().contains(&true)).count()]
}

/// What verify says, what refuses, and what becomes of the tables.
fn cells(tables: &[&Installation]) -> String {
    let Some(first) = tables.first() else { return "no table | | | |".to_owned() };
    let gates = [0, 1].map(|k| {
        let refused = tables.iter().filter(|made| !made.gates[k].refused_by.is_empty()).count();
        let by: BTreeSet<_> = tables.iter().flat_map(|made| made.gates[k].refused_by.iter().copied()).collect();
        let by = by.into_iter().collect::<Vec<_>>().join(", ");
        if refused > 0 { format!("{refused} of {}: {by}", tables.len()) } else { format!("0 of {}", tables.len()) }
    });
    let [wrong, _] = count(tables);
    let installed = [0, 1].map(|k| tables.iter().filter(|made| made.wrong_installed()[k]).count());
    let worst = tables.iter().map(|made| made.true_error).fold(0.0, f64::max) * 1e6;
    format!(
        "{} | {} | {} | {wrong} of {} (up to {worst:.1}e-6 g0) | {}, {} with the good one in force",
        first.gates[0].last_line.replace('|', "\\|"),
        gates[0],
        gates[1],
        tables.len(),
        installed[0],
        installed[1]
    )
}

/// What becomes of correct campaigns.
#[derive(Default)]
struct CorrectCampaigns {
    campaigns: u64,
    refused: u64,
    /// Gates that judged, and those of tables within their bound that refuse: for another cause than the factor,
    /// because the turntable is poor, and for the factor.
    judged: u64,
    gated: u64,
    missed: u64,
    factors: u64,
    /// Gates of tables within [`WRONG`] of the truth, and of the others, each with those that refuse.
    near: [u64; 2],
    far: [u64; 2],
    /// The same of tables that are further off than their bound, by the reason.
    beyond: BTreeMap<&'static str, [u64; 2]>,
    /// Campaigns with each warning.
    warned: BTreeMap<String, u64>,
    /// Bound over upper end, with the campaign in words, angles and alignment.
    margins: Vec<(f64, String, [f64; 2], AlignmentChoice)>,
    failed: bool,
}

/// Counts the refusals among correct campaigns, and those of their tables by the gate with the bounds of the fit. Fails
/// if there is one of a campaign, or of a table that is within [`WRONG`] of the truth, by its bound.
fn correct_campaigns(count: u64) -> ExitCode {
    let mut found = CorrectCampaigns::default();
    (1..=count).for_each(|seed| found.add(seed));
    found.print();
    if found.failed || found.refused > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

impl CorrectCampaigns {
    fn add(&mut self, seed: u64) {
        self.campaigns += 1;
        let (case, words) = correct(seed);
        let outcome = outcome(&case);
        if outcome.errors.is_none() {
            self.refused += 1;
            println!("refused: {words}\n  {}", outcome.lines.join("\n  "));
            return;
        }
        let names = outcome.lines.iter().filter_map(|line| Some(line.split_once("]: ")?.0.to_owned()));
        for name in names.collect::<BTreeSet<_>>() {
            *self.warned.entry(name).or_default() += 1;
        }
        self.add_tables(&case, AlignmentChoice::IfNeeded, &words, seed);
        // An IMU without misalignment, whose table has no alignment matrix.
        self.add_tables(&without_misalignment(seed), AlignmentChoice::Without, &words, seed);
    }

    fn add_tables(&mut self, case: &Case, alignment: AlignmentChoice, words: &str, seed: u64) {
        let options = CalibrationOptions { alignment, ..CalibrationOptions::default() };
        let Ok(calibration) = calibrated(case, options) else {
            self.refused += 1;
            println!("refused without misalignment: {words}");
            return;
        };
        for angles in ATTITUDES {
            let gate = gate(case, &calibration, None, angles, Some(10.0), seed);
            self.judged += 1;
            let causes: Vec<_> = gate.causes.iter().filter(|cause| !cause.starts_with("factor")).collect();
            let refuses = !causes.is_empty();
            let error = true_error(case, &calibration.table);
            count_gate(if error <= WRONG { &mut self.near } else { &mut self.far }, refuses);
            let is_poor = case.schedule.noise.positioning_rad > POOR_TURNTABLE;
            if error > gate.bound {
                let reason = if calibration.left_without_alignment().is_some() {
                    "without the matrix that the fit asks for"
                } else if case.schedule.set_points_c.len() <= 3 {
                    "two or three set points"
                } else if is_poor {
                    "a turntable of 600 arcsec"
                } else {
                    "other causes"
                };
                count_gate(self.beyond.entry(reason).or_default(), refuses);
                continue;
            }
            if refuses && is_poor {
                self.missed += 1;
                continue;
            }
            if refuses {
                self.gated += 1;
                self.failed |= error <= WRONG;
                println!("gate at {angles:?} with {alignment:?} refuses, {:.0}e-6 g0 off: {words}", error * 1e6);
                causes.iter().for_each(|cause| println!("  {cause}"));
            }
            self.factors += u64::from(gate.refused_by.contains("factor"));
            self.margins.push((gate.margin, words.to_owned(), angles, alignment));
        }
    }

    fn print(&mut self) {
        let Self { campaigns, refused, judged, gated, missed, factors, near, far, beyond, warned, .. } = self;
        println!("{refused} of {campaigns} correct campaigns refused by calibrate");
        println!("tables within {:.0}e-6 g0 of the truth: {} of {} gates refuse", WRONG * 1e6, near[1], near[0]);
        println!("tables further off: {} of {} gates refuse", far[1], far[0]);
        for (because, [count, refuse]) in &*beyond {
            println!(
                "{count} of {judged} gates are for tables further off the truth than the bound, {because}: {refuse} refuse"
            );
        }
        let others = *judged - *missed - beyond.values().map(|[count, _]| count).sum::<u64>();
        println!(
            "{missed} refuse because a turntable of 600 arcsec misses the run's attitude; of the other {others} gates {gated} refuse, and \
             {factors} show no factor of 10, which is not among the default bounds"
        );
        let warned = core::mem::take(warned);
        self.print_margins();
        for (name, count) in warned {
            println!("{count} have {name}]");
        }
    }

    fn print_margins(&mut self) {
        self.margins.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (margin, words, angles, alignment) in self.margins.iter().take(5) {
            println!("bound / upper end {margin:.2} at {angles:?} with {alignment:?}: {words}");
        }
        let at_default = self.margins.iter().find(|(_, _, angles, _)| *angles == ANGLES_DEG);
        println!("smallest bound / upper end at {ANGLES_DEG:?}: {:.2}", at_default.map_or(f64::INFINITY, |it| it.0));
        if let Some((margin, ..)) = self.margins.get(self.margins.len() / 2) {
            println!("median of bound / upper end: {margin:.2}");
        }
    }
}

/// Counts a gate, and whether it refuses.
fn count_gate([gates, refusing]: &mut [u64; 2], refuses: bool) {
    *gates += 1;
    *refusing += u64::from(refuses);
}
