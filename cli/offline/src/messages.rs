//! Messages on stderr. They are events of `tracing`, also those of the libraries, and a line each:
//! `isotherm: warning [name]: ..`. The failure that ends a command is printed in any case.

use isotherm_support::failure::{printable, tell_as_events, tell_plainly};
use std::fmt::{Debug, Write as _};
use std::io::{self, Write as _};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Subscriber, enabled, warn};
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};
use tracing_subscriber::registry;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Prints the message of each event behind the name of the program.
struct PlainLines;

/// The message of an event. The client library names the IMU that it warns of.
#[derive(Default)]
struct Message {
    imu: Option<String>,
    text: String,
}

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        match field.name() {
            "imu" => self.imu = Some(format!("{value:?}")),
            // Writing to a String cannot fail.
            "message" => drop(write!(self.text, "{value:?}")),
            _ => {}
        }
    }
}

impl<S: Subscriber> Layer<S> for PlainLines {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut message = Message::default();
        event.record(&mut message);
        match message.imu {
            Some(imu) => tell_plainly("isotherm", format_args!("warning: IMU {imu}: {}", message.text)),
            None => tell_plainly("isotherm", message.text),
        }
    }
}

/// Starts the messages: all but errors with `quiet`, those for the curious with `verbose`.
pub fn start(quiet: bool, verbose: bool) {
    let level = match (quiet, verbose) {
        (true, _) => LevelFilter::ERROR,
        (false, true) => LevelFilter::DEBUG,
        (false, false) => LevelFilter::INFO,
    };
    // The transport logs by itself.
    let own = Targets::new().with_target("isotherm", level);
    // This fails only if another program of this process has started its messages.
    if registry().with(PlainLines.with_filter(own)).try_init().is_ok() {
        tell_as_events();
    }
}

/// Whether results that go to stderr, and progress, are shown.
pub fn is_shown() -> bool {
    enabled!(Level::INFO)
}

/// Prints lines of a result that goes to stderr, without the name of the program.
pub fn print_text(text: &str) {
    if is_shown() {
        // There is no other place for it if stderr is closed.
        let _ = io::stderr().write_all(printable(text).as_bytes());
    }
}

/// Prints findings, as they have been put into lines.
pub fn tell_findings(findings: impl IntoIterator<Item = String>) {
    findings.into_iter().for_each(|finding| warn!("{finding}"));
}
