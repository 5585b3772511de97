//! The program `isotherm-ros2`: compensated IMUs as topics of ROS 2, and drivers' topics as IMUs. What it says and
//! hears is in the library `isotherm-ros2`; here are the network and the threads.
//!
//! # Threads
//! - **main** reads the status, publishes temperature and diagnostics, and looks whether the end is asked for.
//! - **output**, one for each IMU that is published: it waits for increments and publishes them.
//! - **input** and **thermometer**, for each driver: they wait for messages and hand them to the acquisition.
//! - **acquisition**, one for each driver: `isotherm acquire`, with messages as its source.
//! - **graph** keeps the list of subscribers. The transport has two threads of its own.

mod input;
mod network;
mod output;
mod report;

use clap::FromArgMatches as _;
use input::Input;
use isotherm_client::Options;
use isotherm_files::end_signals;
use isotherm_ros2::{NetworkSettings, NodeArguments, command, write_nominal};
use isotherm_service::{StatusSource, commands, logging};
use isotherm_support::failure::{Exit, Failure, tell, tell_as_events};
use network::Network;
use output::Output;
use report::Reporter;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tracing::info;

/// The transport sends in a thread of its own, and does not say when it has: so long it gets at the end.
const LAST: Duration = Duration::from_millis(100);
/// Pause between two looks at the status and the end.
const LOOK: Duration = Duration::from_millis(50);

fn main() -> ExitCode {
    commands::exit_code("isotherm-ros2", || {
        let matches = command(isotherm_version::LONG_VERSION).try_get_matches()?;
        Ok(run(&NodeArguments::from_arg_matches(&matches)?))
    })
}

fn run(arguments: &NodeArguments) -> Result<(), Failure> {
    let description = arguments.description()?;
    if let Some(output) = &arguments.nominal {
        return write_nominal(arguments, &description, output);
    }
    let domain = commands::domain(arguments.domain.as_deref())?;
    let variable = |name: &str| std::env::var(name).ok();
    let settings = NetworkSettings::of(&description, variable);
    let settings = settings.map_err(|message| Failure::new(Exit::Usage, message))?;
    logging::start_beside(arguments.log_format, &["rustdds", "ros2_client"]);
    tell_as_events();
    if let Some(warning) = NetworkSettings::warning(variable) {
        tell("isotherm-ros2", warning);
    }
    let end = Arc::new(AtomicBool::new(false));
    for signal in end_signals() {
        let registered = signal_hook::flag::register(signal, Arc::clone(&end));
        registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
    }
    let status = StatusSource::connect(domain.clone())?;
    let mut network = Network::open(&description.name, settings)?;
    let options = Options::new(domain.clone(), Duration::ZERO);
    let outputs = description.outputs.iter().map(|output| Output::start(output, &mut network, &options, &end));
    let mut outputs = outputs.collect::<Result<Vec<_>, _>>()?;
    let inputs = description.inputs.iter().map(|input| Input::start(input, &mut network, &options, &end));
    let mut inputs = inputs.collect::<Result<Vec<_>, _>>()?;
    let mut reporter = Reporter::new(&description, status, &mut network)?;
    network.watch()?;
    info!(domain = domain.name(), ros_domain_id = settings.domain_id, "{}", description.summary());
    while !end.load(Ordering::Relaxed) && !inputs.iter().any(Input::has_ended) {
        std::thread::sleep(LOOK);
        reporter.turn(&outputs, &mut inputs, &network);
    }
    end.store(true, Ordering::Relaxed);
    let failures = inputs.iter_mut().filter_map(|input| input.finish().err());
    let failures: Vec<_> = failures.chain(outputs.iter_mut().filter_map(|output| output.finish().err())).collect();
    reporter.tell(&outputs, &inputs);
    std::thread::sleep(LAST);
    info!("stopped");
    Failure::all(failures).map_or(Ok(()), Err)
}
