//! The automatic campaign with the simulated station: a whole campaign (`full`), faults in every phase (`faults`, or
//! `faults turn` for one), and kills at random moments (`kills`). All processes are real; the station runs faster than
//! a laboratory.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

mod faults;
mod full;
mod kills;
mod laboratory;

use isotherm_benches::BenchResult;
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let smoke = words.iter().any(|word| word == "--smoke");
    let result = match words.first().map(String::as_str) {
        // All processes of the laboratory run this program, too.
        Some("--domain" | "serve" | "simulate" | "campaign" | "status" | "calibrate") => {
            return isotherm_cli::main();
        }
        Some("full") => full::bench(),
        Some("faults") => faults::bench(smoke, words.get(1).map(String::as_str).filter(|word| *word != "--smoke")),
        Some("kills") => kills::bench(smoke),
        Some("--smoke") => faults::bench(true, None).and_then(|()| kills::bench(true)),
        None => all(),
        Some(other) => {
            Err(format!("{other:?}: give full, faults or kills; --smoke for a short look whether they work").into())
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("campaign: {error}");
            ExitCode::FAILURE
        }
    }
}

fn all() -> BenchResult<()> {
    full::bench()?;
    faults::bench(false, None)?;
    kills::bench(false)
}
