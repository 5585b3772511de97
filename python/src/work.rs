//! Long work: without the interpreter's lock, with progress, and it ends when a signal handler raises, as Ctrl-C does.

use isotherm_pipeline::no_bar;
use isotherm_recording::{Observer, Progress};
use isotherm_support::checkpoint::{checkpoint, watched};
use pyo3::prelude::*;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Time between two looks for Python's signals.
const EVERY: Duration = Duration::from_millis(20);
/// So many rows of an array are one step of the progress.
const ROWS: u64 = 1024;

/// How far the work is, and who is called there.
pub(crate) struct Work {
    /// Called with what is done and what there is, in bytes of files or rows of arrays.
    progress: Option<Py<PyAny>>,
    done: AtomicU64,
    total: AtomicU64,
    looked: Mutex<Looked>,
}

/// The last look.
struct Looked {
    at: Instant,
    shown: (u64, u64),
    raised: Option<PyErr>,
}

impl Work {
    pub(crate) fn new(progress: Option<Py<PyAny>>) -> Arc<Self> {
        let looked = Mutex::new(Looked { at: Instant::now(), shown: (0, 0), raised: None });
        Arc::new(Self { progress, done: AtomicU64::new(0), total: AtomicU64::new(0), looked })
    }

    /// Runs `work` in this thread. While it runs, other Python threads do; at its checkpoints signals are handled.
    ///
    /// # Errors
    /// The exception of a signal handler, such as `KeyboardInterrupt`, or of the progress: then the work has ended.
    pub(crate) fn run<T: Send>(self: &Arc<Self>, py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
        let watch = self.clone();
        let done = py.detach(|| watched(move || watch.look(), work).ok());
        // What reads damaged files takes an end for damage; the exception is what counts.
        let raised = self.looked.lock().ok().and_then(|mut looked| looked.raised.take());
        match (raised, done) {
            (Some(raised), _) => Err(raised),
            (None, Some(done)) => self.show(py).map(|()| done),
            (None, None) => Err(pyo3::exceptions::PyKeyboardInterrupt::new_err(())),
        }
    }

    /// Whether the work goes on.
    fn look(&self) -> bool {
        let Ok(mut looked) = self.looked.lock() else { return true };
        if looked.raised.is_some() {
            return false;
        }
        if looked.at.elapsed() < EVERY {
            return true;
        }
        let shown = (self.done.load(Relaxed), self.total.load(Relaxed));
        let is_new = shown != looked.shown;
        (looked.at, looked.shown) = (Instant::now(), shown);
        drop(looked);
        let seen = Python::attach(|py| {
            py.check_signals()?;
            if is_new { self.show(py) } else { Ok(()) }
        });
        let Err(raised) = seen else { return true };
        if let Ok(mut looked) = self.looked.lock() {
            looked.raised = Some(raised);
        }
        false
    }

    fn show(&self, py: Python<'_>) -> PyResult<()> {
        let (done, total) = (self.done.load(Relaxed), self.total.load(Relaxed));
        match &self.progress {
            Some(progress) if total > 0 => progress.call1(py, (done.min(total), total)).map(drop),
            _ => Ok(()),
        }
    }

    /// The bar of the reading of files.
    pub(crate) fn bar(self: &Arc<Self>) -> impl Fn(&[PathBuf], &'static str) -> Progress + use<> {
        let work = self.clone();
        move |paths: &[PathBuf], message: &'static str| {
            let bytes = paths.iter().filter_map(|path| fs::metadata(path).ok()).map(|it| it.len()).sum();
            work.total.fetch_add(bytes, Relaxed);
            let (from, inner) = (AtomicU64::new(work.done.load(Relaxed)), no_bar(paths, message));
            Progress::new(FileBar { work: work.clone(), from, bytes, inner })
        }
    }

    /// Counts the rows of an array as they are read.
    pub(crate) fn rows<I: Iterator>(self: &Arc<Self>, count: usize, rows: I) -> impl Iterator<Item = I::Item> + use<I> {
        self.total.fetch_add(count as u64, Relaxed);
        let (work, mut row) = (self.clone(), 0_u64);
        rows.inspect(move |_| {
            row += 1;
            if row.is_multiple_of(ROWS) || row == count as u64 {
                work.done.fetch_add(if row.is_multiple_of(ROWS) { ROWS } else { row % ROWS }, Relaxed);
                checkpoint();
            }
        })
    }
}

/// Counts the bytes of files.
struct FileBar {
    work: Arc<Work>,
    /// What was done before the files.
    from: AtomicU64,
    bytes: u64,
    inner: Progress,
}

impl Observer for FileBar {
    fn advance(&self, bytes: u64) {
        self.work.done.fetch_add(bytes, Relaxed);
        checkpoint();
    }

    fn restart(&self) {
        self.work.done.store(self.from.load(Relaxed), Relaxed);
    }

    fn finish(&self) {
        self.work.done.store(self.from.load(Relaxed) + self.bytes, Relaxed);
    }

    fn warn(&self, message: &str) {
        self.inner.warn(message);
    }
}
