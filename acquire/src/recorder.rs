//! Records samples in a thread of its own, so that a slow disk does not hold the line up.

use isotherm_client::{ImuId, RawSample, unix_s};
use isotherm_failure::{Exit, Failure, shown, tell};
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::write::{FileError, Files, Format, Rotation, is_vacant};
use isotherm_shared::stream::StreamKind;
use isotherm_shared::wire::StreamSample;
use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Rows that may wait for the disk: 8 s at 2 kHz.
const QUEUE: usize = 1 << 14;
/// How often rows are made visible and lasting.
const FLUSH: Duration = Duration::from_secs(1);

/// Records samples into a file.
pub(crate) struct Recorder {
    rows: Option<SyncSender<RecordedRow>>,
    thread: Option<JoinHandle<Result<(), FileError>>>,
    /// Rows that were not recorded.
    pub(crate) lost: u64,
}

impl Recorder {
    /// The format of a recording that does not exist yet, or has no rows, whose ending names it.
    ///
    /// # Errors
    /// If there is such a file with rows, or the ending names no format.
    pub(crate) fn check(path: &Path) -> Result<Format, Failure> {
        let name = || format!("{}: name the recording .csv, .parquet or .mcap", shown(path));
        let format = Format::of_path(path).ok_or_else(|| Failure::new(Exit::Usage, name()))?;
        match is_vacant(path) {
            true => Ok(format),
            false => Err(FileError(path.to_owned(), io::ErrorKind::AlreadyExists.into()).into()),
        }
    }

    /// Creates the file, whose ending names its format.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(crate) fn create(path: &Path, imu: &ImuId) -> Result<Self, Failure> {
        let format = Self::check(path)?;
        let (path, imus) = (path.to_owned(), [imu.clone()]);
        let (sender, receiver) = sync_channel(QUEUE);
        let (created, is_created) = sync_channel(1);
        let body = move || {
            let files = Files::create(&path, format, Rotation::default(), &imus, &[(0, StreamKind::Raw)]);
            let (files, result) = match files {
                Ok(files) => (Some(files), Ok(())),
                Err(error) => (None, Err(error)),
            };
            // The other side waits for it.
            let _ = created.send(result);
            files.map_or(Ok(()), |mut files| {
                // A recording into which nothing could be written is not left.
                write(&mut files, &receiver).inspect_err(|_| files.remove_without_rows())
            })
        };
        let failed =
            |error: &dyn std::fmt::Display| Failure::new(Exit::Failed, format!("starting the recorder: {error}"));
        let thread = thread::Builder::new().name("record".to_owned()).spawn(body).map_err(|error| failed(&error))?;
        is_created.recv().map_err(|error| failed(&error))??;
        Ok(Self { rows: Some(sender), thread: Some(thread), lost: 0 })
    }

    /// Adds a row. Never waits: a row for which the queue has no room is lost.
    pub(crate) fn take(&mut self, raw: &RawSample) {
        let recorded_ns = (unix_s() * 1e9) as u64;
        let row = RecordedRow { imu: 0, recorded_ns, sample: StreamSample::Raw(*raw) };
        if self.rows.as_ref().is_none_or(|rows| rows.try_send(row).is_err()) {
            if self.lost == 0 {
                tell("isotherm", "warning: rows are not recorded: the disk is too slow, full or gone; sending goes on");
            }
            self.lost += 1;
        }
    }

    /// Writes what waits, and finishes the file.
    ///
    /// # Errors
    /// If rows were not written.
    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        self.rows = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let ended = || Failure::new(Exit::Failed, "the recorder's thread ended");
        thread.join().map_err(|_| ended())??;
        match self.lost {
            0 => Ok(()),
            lost => Err(Failure::new(Exit::Io, format!("{lost} rows were not recorded, since the disk was too slow"))),
        }
    }
}

fn write(files: &mut Files, rows: &Receiver<RecordedRow>) -> Result<(), FileError> {
    let mut flushed = Instant::now();
    loop {
        match rows.recv_timeout(FLUSH) {
            Ok(row) => drop(files.write(&row)?),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return files.finish(),
        }
        if files.is_flush_due() || flushed.elapsed() >= FLUSH {
            files.flush()?;
            flushed = Instant::now();
        }
    }
}
