//! Logging to stderr through `tracing`, including the transport's log.

use clap::ValueEnum;
use iceoryx2::prelude::{LogLevel, set_log_level};
use isotherm_failure::printable;
use std::env;
use std::io::{self, IsTerminal as _};
use tracing::Level;
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::debug_fn;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{fmt, registry};

/// The format of log lines.
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
    let requested = env::var("ISOTHERM_LOG").ok().and_then(|filter| filter.parse::<Targets>().ok());
    // The transport filters by its own level before it hands records on.
    set_log_level(if requested.is_some() { LogLevel::Trace } else { LogLevel::Warn });
    let filter = requested.unwrap_or_else(|| Targets::new().with_default(Level::INFO));
    // A line that cannot be written, for example to a full disk or a closed pipe, is lost; the service continues.
    let lines = fmt::layer().with_writer(io::stderr).log_internal_errors(false);
    let colours = io::stderr().is_terminal();
    let fields = debug_fn(|writer, field, value| {
        let text = format!("{value:?}");
        match field.name() {
            "message" => write!(writer, "{}", printable(&text)),
            // A line end in the name of a file would begin a line that looks like the service's own.
            name => write!(writer, "{name}={}", printable(&text).replace('\n', "\\n")),
        }
    });
    // This fails only if logging was started before; then that logging stays in use.
    let _ = match format {
        LogFormat::Human => {
            let lines = lines.fmt_fields(fields.delimited(" ")).with_ansi(colours);
            registry().with(lines.with_filter(filter)).try_init()
        }
        LogFormat::Json => registry().with(lines.json().with_filter(filter)).try_init(),
    };
}
