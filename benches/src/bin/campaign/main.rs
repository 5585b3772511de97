//! The automatic campaign with the simulated station: a whole campaign (`full`), faults in every phase (`faults`, or
//! `faults turn` for one), and kills at random moments (`kills`). All processes are real; the station runs faster than
//! a laboratory.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

mod faults;
mod full;
mod kills;
mod laboratory;

use clap::{Parser, Subcommand};
use isotherm_benches::{BenchResult, run};
use std::process::ExitCode;

/// Runs automatic campaigns with the simulated station; without a subcommand all three
#[derive(Debug, Parser)]
struct CampaignArguments {
    #[command(subcommand)]
    command: Option<CampaignCommand>,
    /// A short look whether faults and kills work
    #[arg(long, global = true)]
    smoke: bool,
}

#[derive(Debug, Subcommand)]
enum CampaignCommand {
    /// A whole campaign, compared with its simulation without instruments
    Full,
    /// Each fault of an instrument in each phase, or in one
    Faults { phase: Option<String> },
    /// Kills of the runner at random moments
    Kills,
}

fn main() -> ExitCode {
    // All processes of the laboratory run this program, too.
    run(|_| Ok(isotherm_cli::main()), bench)
}

fn bench(CampaignArguments { command, smoke }: CampaignArguments) -> BenchResult<()> {
    match command {
        Some(CampaignCommand::Full) => full::bench(),
        Some(CampaignCommand::Faults { phase }) => faults::bench(smoke, phase.as_deref()),
        Some(CampaignCommand::Kills) => kills::bench(smoke),
        None => {
            if !smoke {
                full::bench()?;
            }
            faults::bench(smoke, None)?;
            kills::bench(smoke)
        }
    }
}
