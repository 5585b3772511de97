//! Latency that users can check: Isotherm is compared with what it is built on and what it replaces, in one run on one
//! machine.
//!
//! Without a subcommand: round trips at the rate of an IMU through every path in alternating blocks, with every waiting
//! strategy ([`paced`]), then round trips one after the other ([`closed`]). The subcommands measure under load, with
//! many IMUs, with many samples in flight, and with a recorder.
//!
//! All processes are real: this one is the acquisition; its children run this program as the service, an echo or a
//! socket server.
#![allow(clippy::print_stdout, reason = "the tables are the product")]

mod closed;
mod floor;
mod load;
mod open;
mod paced;
mod pairs;
mod paths;
mod readers;
mod record;
mod report;
mod scale;
mod socket;
mod throughput;

use clap::{Parser, Subcommand};
use isotherm_benches::{BenchResult, OtherBuild, become_child, pin};
use serde_json::{Value, json};
use std::process::ExitCode;
use std::time::Instant;

/// Measures the latency of Isotherm beside bare shared memory, iceoryx2 and a Unix socket
#[derive(Debug, Parser)]
struct LatencyArguments {
    #[command(subcommand)]
    command: Option<LatencyCommand>,
    /// Print one JSON document
    #[arg(long, global = true)]
    json: bool,
    /// Ten times the samples, for deep tails
    #[arg(long, global = true, conflicts_with = "smoke")]
    long: bool,
    /// A few samples only, to see that everything works
    #[arg(long, global = true)]
    smoke: bool,
    /// Measure the service of another build in the same run, without a subcommand or before `paced`; may be repeated
    #[arg(long, value_name = "NAME=PROGRAM")]
    other: Vec<OtherBuild>,
}

#[derive(Debug, Subcommand)]
enum LatencyCommand {
    /// Only the first part: round trips at the rate of an IMU
    Paced,
    /// Round trips beside two CPU-hungry neighbours, with and without real-time settings, with and without reloads
    Load,
    /// 1, 8 and 32 IMUs: one sending, and all together beside as many bare pairs
    Scale,
    /// 16 samples in flight
    Throughput,
    /// 4 IMUs at 10 kHz, with and without a recorder
    Record,
    /// Processor time of a reader that waits, beside one that polls and a bare eventfd
    Readers,
}

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// As little as shows that everything works.
    Smoke,
    /// One to one and a half minutes.
    Usual,
    /// Ten times that.
    Long,
}

impl Effort {
    /// The number for this effort: `smoke`, `usual`, or ten times `usual`.
    pub fn of(self, smoke: usize, usual: usize) -> usize {
        match self {
            Self::Smoke => smoke,
            Self::Usual => usual,
            Self::Long => usual * 10,
        }
    }

    /// The round trips of a block: `usual`, or as few as have a median.
    pub fn of_block(self, usual: usize) -> usize {
        if matches!(self, Self::Smoke) { 40 } else { usual }
    }
}

fn main() -> ExitCode {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["serve", "--config", ..] => {
            become_child();
            return isotherm_service::main(env!("CARGO_PKG_VERSION"));
        }
        ["record", "-o", ..] => {
            become_child();
            return isotherm_cli::main();
        }
        ["child", core, role @ ..] => {
            become_child();
            pin(core.parse().ok());
            child(role)
        }
        _ => bench(&LatencyArguments::parse()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("latency: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs this program in the role of a child process.
fn child(role: &[&str]) -> BenchResult<()> {
    match role {
        ["floor", path] => floor::answer(path),
        ["echo", domain, root, depth, pairs] => paths::echo(domain, root, depth.parse()?, pairs.parse()?),
        ["socket", path] => socket::socket_server(path),
        ["hungry"] => load::spin_forever(),
        _ => Err("unknown role".into()),
    }
}

fn bench(arguments: &LatencyArguments) -> BenchResult<()> {
    let (started, machine) = (Instant::now(), report::machine());
    let effort = match (arguments.smoke, arguments.long) {
        (true, _) => Effort::Smoke,
        (_, true) => Effort::Long,
        _ => Effort::Usual,
    };
    let mut document = match arguments.command {
        None => {
            let paced = paced::measure(effort, &arguments.other)?;
            let mut document = closed::measure(effort, &arguments.other)?;
            document["paced"] = paced;
            document
        }
        Some(LatencyCommand::Paced) => json!({"paced": paced::measure(effort, &arguments.other)?}),
        Some(LatencyCommand::Load) => load::measure(effort)?,
        Some(LatencyCommand::Scale) => scale::measure(effort)?,
        Some(LatencyCommand::Throughput) => throughput::measure(effort)?,
        Some(LatencyCommand::Record) => record::measure(effort)?,
        Some(LatencyCommand::Readers) => readers::measure(effort)?,
    };
    document["machine"] = machine;
    document["seconds"] = Value::from(started.elapsed().as_secs_f64());
    if arguments.json {
        println!("{document:#}");
    } else if document["record"].is_object() {
        record::print(&document);
    } else if document["readers"].is_object() {
        readers::print(&document);
    } else {
        report::print(&document);
    }
    Ok(())
}
