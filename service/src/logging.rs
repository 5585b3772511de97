//! Logs go to stderr through `tracing`, the transport's own included.

use clap::ValueEnum;
use iceoryx2::prelude::{LogLevel, set_log_level};
use std::env;
use std::io::{self, IsTerminal as _};
use tracing::Level;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{fmt, registry};

/// How log lines look.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Human,
    /// One JSON object a line.
    Json,
}

/// Starts logging. `ISOTHERM_LOG` filters it, `info` by default: a level, or levels by target, as in
/// `ISOTHERM_LOG=debug,iceoryx2_bb_loggers=warn`.
pub fn start(format: LogFormat) {
    let asked = env::var("ISOTHERM_LOG").ok().and_then(|filter| filter.parse::<Targets>().ok());
    // The transport has a level of its own, below which it hands nothing over.
    set_log_level(if asked.is_some() { LogLevel::Trace } else { LogLevel::Warn });
    let filter = asked.unwrap_or_else(|| Targets::new().with_default(Level::INFO));
    // A log that cannot be written, on a full disk or into a pipe that nobody reads, is lost; the service goes on.
    let lines = fmt::layer().with_writer(io::stderr).log_internal_errors(false);
    // Fails only if logging has been started before, and then it runs.
    let _ = match format {
        LogFormat::Human => registry().with(lines.with_ansi(io::stderr().is_terminal()).with_filter(filter)).try_init(),
        LogFormat::Json => registry().with(lines.json().with_filter(filter)).try_init(),
    };
}
