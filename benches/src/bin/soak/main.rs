//! Long runs and kills: whether everything that is sent is answered exactly once, in order and to the bit, whoever dies meanwhile.
//!
//! `soak --minutes N` runs two systems side by side: one whose service lives on under reloads, readers that come and go and clients that
//! are killed, where nothing may grow; and one whose service is killed again and again, where nothing may be lost. `soak kills` kills every kind
//! of process at every kind of moment and counts.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

mod endure;
mod feeder;
mod kills;

use clap::{Parser, Subcommand};
use isotherm_benches::{Outcome, become_child};
use isotherm_client::Options;
use std::process::ExitCode;

#[derive(Parser)]
#[command(about = "Runs Isotherm for long, kills its processes, and checks every increment")]
struct Cli {
    #[command(subcommand)]
    part: Option<Part>,
    /// How long the soak runs
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// A few seconds only, to see that everything works
    #[arg(long, global = true)]
    smoke: bool,
}

#[derive(Subcommand)]
enum Part {
    /// The kill matrix: who was killed when, how often, what was lost
    Kills,
}

fn main() -> ExitCode {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let result = match words[..] {
        // What the service's own program does.
        ["serve" | "status", ..] => {
            become_child();
            return isotherm_service::main(env!("CARGO_PKG_VERSION"));
        }
        ["send", imu] => child(|options| feeder::send_for_ever(imu, options)),
        ["read", imu] => child(|options| feeder::read_for_ever(imu, options)),
        _ => {
            let cli = Cli::parse();
            match cli.part {
                Some(Part::Kills) => kills::run(cli.smoke),
                None => endure::run(if cli.smoke { 0.15 } else { cli.minutes }),
            }
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("soak: {error}");
            ExitCode::FAILURE
        }
    }
}

fn child(role: impl FnOnce(&Options) -> Outcome<()>) -> Outcome<()> {
    become_child();
    role(&Options::from_environment()?)
}
