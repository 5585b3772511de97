//! Long runs and kills. They check that everything that is sent is answered exactly once, in order and to the bit, even
//! if processes are killed meanwhile.
//!
//! `soak --minutes N` runs two services side by side. The first one keeps running under reloads, with readers that come
//! and go and clients that are killed: its use of memory and files may not grow. The second one is killed again and
//! again: nothing may be lost. `soak kills` kills every kind of process in every phase and counts what is lost.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

mod endure;
mod feeder;
mod kills;

use clap::{Parser, Subcommand};
use isotherm_benches::{BenchResult, run};
use isotherm_client::Options;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Runs Isotherm for long, kills its processes, and checks every increment")]
struct SoakArguments {
    #[command(subcommand)]
    command: Option<SoakCommand>,
    /// How long the soak runs
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// A few seconds only, to see that everything works
    #[arg(long, global = true)]
    smoke: bool,
}

#[derive(Subcommand)]
enum SoakCommand {
    /// The kill matrix: who was killed when, how often, what was lost
    Kills,
}

fn main() -> ExitCode {
    run(child, |SoakArguments { command, minutes, smoke }| match command {
        Some(SoakCommand::Kills) => kills::run(smoke),
        None => endure::run(if smoke { 0.15 } else { minutes }),
    })
}

/// Runs this program as a client that is killed.
fn child(words: &[&str]) -> BenchResult<ExitCode> {
    let options = Options::from_environment()?;
    match words {
        ["send", imu] => feeder::send_for_ever(imu, &options)?,
        ["read", imu] => feeder::read_for_ever(imu, &options)?,
        _ => return Err("unknown words".into()),
    }
    Ok(ExitCode::SUCCESS)
}
