//! Logs go to stderr through `tracing`, the transport's own included.

use clap::ValueEnum;
use iceoryx2::prelude::{LogLevel, set_log_level};
use std::io::{self, IsTerminal as _};
use tracing_subscriber::EnvFilter;

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Human,
    /// One JSON object a line.
    Json,
}

/// Starts logging. `ISOTHERM_LOG` filters it, `info` by default, as in `ISOTHERM_LOG=debug,iceoryx2_bb_loggers=warn`.
pub fn start(format: LogFormat) {
    let asked = EnvFilter::try_from_env("ISOTHERM_LOG");
    // The transport decides by a level of its own what it hands over at all.
    set_log_level(if asked.is_ok() { LogLevel::Trace } else { LogLevel::Warn });
    let filter = asked.unwrap_or_else(|_| EnvFilter::new("info"));
    // A log that cannot be written, on a full disk or into a pipe that nobody reads, is lost; the service goes on.
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(io::stderr).log_internal_errors(false);
    // Fails only if logging has been started before, and then it runs.
    let _ = match format {
        LogFormat::Human => builder.with_ansi(io::stderr().is_terminal()).try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
}
