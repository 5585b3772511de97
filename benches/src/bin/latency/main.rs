//! Latency that users can check: Isotherm is compared with what it is built on and what it replaces, in one run on one
//! machine.
//!
//! Without a subcommand: round trips at the rate of an IMU through every path in alternating blocks, with every waiting
//! strategy ([`paced`]), then round trips one after the other ([`closed`]). The subcommands measure under load, with
//! many IMUs, with many samples in flight, and with a recorder.
//!
//! All processes are real: this one is the acquisition; its children run this program as the service, an echo or a
//! socket server.

mod closed;
mod floor;
mod load;
mod open;
mod paced;
mod pairs;
mod paths;
mod readers;
mod record;
mod scale;
mod socket;
mod throughput;

use clap::{Parser, Subcommand};
use isotherm_benches::{BenchResult, Common, OtherBuild, pin, run};
use serde_json::json;
use std::process::ExitCode;

/// Measures the latency of Isotherm compared with bare shared memory, iceoryx2 and a Unix socket
#[derive(Debug, Parser)]
struct LatencyArguments {
    #[command(subcommand)]
    command: Option<LatencyCommand>,
    #[command(flatten)]
    common: Common,
    /// Measure the service of another build in the same run, without a subcommand or before `paced`; may be repeated
    #[arg(long, value_name = "NAME=PROGRAM")]
    other: Vec<OtherBuild>,
}

#[derive(Debug, Subcommand)]
enum LatencyCommand {
    /// Only the first part: round trips at the rate of an IMU
    Paced,
    /// Round trips next to two CPU-hungry neighbours, with and without real-time settings, with and without reloads
    Load,
    /// 1, 8 and 32 IMUs: one sending, and all together, compared with as many bare pairs
    Scale,
    /// 16 samples in flight
    Throughput,
    /// 4 IMUs at 10 kHz, with and without a recorder
    Record,
    /// Processor time of a reader that waits, compared with one that polls and a bare eventfd
    Readers,
}

fn main() -> ExitCode {
    run(child, bench)
}

/// Runs this program as a recorder, or as the process behind a path on the core that it is given.
fn child(words: &[&str]) -> BenchResult<ExitCode> {
    if let ["record", ..] = words {
        return Ok(isotherm_cli::main());
    }
    let ["child", core, role @ ..] = words else { return Err("unknown words".into()) };
    pin(core.parse().ok());
    match role {
        ["floor", path] => floor::answer(path)?,
        ["echo", domain, root, depth, pairs] => paths::echo(domain, root, depth.parse()?, pairs.parse()?)?,
        ["socket", path] => socket::socket_server(path)?,
        ["hungry"] => load::spin_forever(),
        _ => return Err("unknown role".into()),
    }
    Ok(ExitCode::SUCCESS)
}

fn bench(LatencyArguments { command, common, other }: LatencyArguments) -> BenchResult<()> {
    let document = match command {
        None => {
            let paced = paced::measure(common, &other)?;
            let mut document = closed::measure(common, &other)?;
            document["paced"] = paced;
            document
        }
        Some(LatencyCommand::Paced) => json!({"paced": paced::measure(common, &other)?}),
        Some(LatencyCommand::Load) => load::measure(common)?,
        Some(LatencyCommand::Scale) => scale::measure(common)?,
        Some(LatencyCommand::Throughput) => throughput::measure(common)?,
        Some(LatencyCommand::Record) => record::measure(common)?,
        Some(LatencyCommand::Readers) => readers::measure(common)?,
    };
    common.show(document);
    Ok(())
}
