//! Logging to stderr through `tracing`, including the transport's log.
//!
//! The reader of stderr may stop reading: a pipe is then full, and writing to it waits for ever. So lines go through a
//! bounded queue to a thread that is allowed to wait. What does not fit is dropped and counted. The thread reports the
//! number when there is room again.

use clap::ValueEnum;
use iceoryx2::prelude::{LogLevel, set_log_level};
use isotherm_support::failure::{printable, tell_plainly};
use std::env;
use std::fmt::Display;
use std::io::{self, IsTerminal as _, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use tracing::{Level, warn};
use tracing_subscriber::field::MakeExt as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::debug_fn;
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{fmt, registry};

/// Lines that may wait to be written.
const QUEUE: usize = 1024;
/// How long the end of the process waits for the last lines.
const FLUSH_LIMIT: Duration = Duration::from_millis(300);

/// The format of log lines.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    #[default]
    Human,
    /// One JSON object per line.
    Json,
}

/// The queue of lines, once logging has started.
static LINES: OnceLock<LineQueue> = OnceLock::new();

/// Lines on their way to stderr.
struct LineQueue {
    lines: SyncSender<Vec<u8>>,
    queued: AtomicU64,
    written: AtomicU64,
    dropped: AtomicU64,
}

impl LineQueue {
    fn push(&self, line: &[u8]) {
        self.queued.fetch_add(1, Ordering::Relaxed);
        if self.lines.try_send(line.to_owned()).is_err() {
            self.queued.fetch_sub(1, Ordering::Relaxed);
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn waiting(&self) -> u64 {
        self.queued.load(Ordering::Relaxed).saturating_sub(self.written.load(Ordering::Relaxed))
    }
}

/// Writes lines into the queue. The formatter writes each line at once.
struct LineWriter;

impl Write for LineWriter {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if let Some(queue) = LINES.get() {
            queue.push(line);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Starts logging. `ISOTHERM_LOG` filters it, `info` by default: a level, or levels by target, as in
/// `ISOTHERM_LOG=debug,iceoryx2_bb_loggers=warn`.
pub fn start(format: LogFormat) {
    start_beside(format, &[]);
}

/// As [`start`], but only errors of these targets are logged by default: libraries that say more than an operator
/// needs.
pub fn start_beside(format: LogFormat, quiet: &[&str]) {
    let requested = env::var("ISOTHERM_LOG").ok().and_then(|filter| filter.parse::<Targets>().ok());
    // The transport filters by its own level before it hands records on.
    set_log_level(if requested.is_some() { LogLevel::Trace } else { LogLevel::Warn });
    let quiet = quiet.iter().map(|target| (*target, Level::ERROR));
    let filter = requested.unwrap_or_else(|| Targets::new().with_default(Level::INFO).with_targets(quiet));
    start_queue();
    let lines = fmt::layer().with_writer(|| LineWriter).log_internal_errors(false);
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

/// Starts the thread that writes, unless there is one.
fn start_queue() {
    let (lines, queued) = sync_channel(QUEUE);
    let queue = LineQueue { lines, queued: AtomicU64::new(0), written: AtomicU64::new(0), dropped: AtomicU64::new(0) };
    if LINES.set(queue).is_ok() {
        // Without the thread all lines are dropped; the service goes on.
        let _ = thread::Builder::new().name("log".to_owned()).spawn(move || write_lines(&queued));
    }
}

/// Writes lines, and reports those that were dropped when there is room in the queue again.
fn write_lines(lines: &Receiver<Vec<u8>>) {
    let mut reported = 0;
    for line in lines {
        // A line that cannot be written, for example to a full disk or a closed pipe, is lost; the program continues.
        let _ = io::stderr().write_all(&line);
        let Some(queue) = LINES.get() else { continue };
        queue.written.fetch_add(1, Ordering::Relaxed);
        let dropped = queue.dropped.load(Ordering::Relaxed);
        if dropped > reported && queue.waiting() < QUEUE as u64 / 2 {
            warn!("{} log lines were dropped: stderr was not read", dropped - reported);
            reported = dropped;
        }
    }
}

/// Prints a last message for the operator, through the queue if logging has started, and waits for it to be written,
/// but not for long.
pub fn tell_last(program: &str, message: impl Display) {
    match LINES.get() {
        Some(queue) => {
            queue.push(format!("{program}: {}\n", printable(&message.to_string())).as_bytes());
            flush();
        }
        None => tell_plainly(program, message),
    }
}

/// Waits until all lines are written, at most for 0.3 s.
pub fn flush() {
    let begun = Instant::now();
    while LINES.get().is_some_and(|queue| queue.waiting() > 0) && begun.elapsed() < FLUSH_LIMIT {
        thread::sleep(Duration::from_millis(1));
    }
}
