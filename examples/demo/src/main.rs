//! The demonstration as a separate program, which builds in a fraction of the time of `isotherm`.

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use isotherm_demo::Demo;
use isotherm_service::commands::serve::Serve;
use isotherm_service::commands::{domain, exit_code, finish};
use std::process::ExitCode;

/// Run Isotherm's demonstration, and nothing else
#[derive(Debug, Parser)]
#[command(
    name = "isotherm-demo",
    version,
    arg_required_else_help = true,
    after_help = "The other commands are in the program `isotherm`: cargo build --release, then target/release/isotherm --help"
)]
struct DemoProgram {
    /// Start the processes in this domain
    ///
    /// The demonstration starts its processes in this domain.
    #[arg(long, global = true, value_name = "NAME", hide = true)]
    domain: Option<String>,
    #[command(subcommand)]
    command: DemoCommand,
}

#[derive(Debug, Subcommand)]
enum DemoCommand {
    Demo(Demo),
    /// The demonstration's service
    #[command(hide = true)]
    Serve(Serve),
}

fn main() -> ExitCode {
    exit_code("isotherm-demo", || {
        let command = finish(DemoProgram::command().long_version(isotherm_version::LONG_VERSION), "isotherm-demo");
        let DemoProgram { domain: name, command } = DemoProgram::from_arg_matches(&command.try_get_matches()?)?;
        Ok(domain(name.as_deref()).and_then(|domain| match command {
            DemoCommand::Demo(demo) => demo.run(domain),
            DemoCommand::Serve(serve) => serve.run(&domain),
        }))
    })
}
