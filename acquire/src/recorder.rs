//! Records samples in a thread of its own, so that a slow disk does not hold the line up.

use isotherm_client::{ImuId, RawSample, UnixClock, unix_s};
use isotherm_files::Disk;
use isotherm_recording::rows::{RecordedOffset, RecordedRow};
use isotherm_recording_formats::write::{FileError, Files, Format, PatientFiles, Rotation, is_vacant};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::StreamSample;
use isotherm_support::failure::{Exit, Failure, shown, tell};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Rows that may wait for the disk: 8 s at 2 kHz.
const QUEUE: usize = 1 << 14;
/// How often rows are made visible and lasting, and a full disk is looked at.
const FLUSH: Duration = Duration::from_secs(1);
/// Pause of the thread while the disk is full.
const PAUSE: Duration = Duration::from_millis(20);

/// Where samples are recorded.
#[derive(Clone, Debug)]
pub struct RecordingTarget {
    /// The file; its ending names its format.
    pub path: PathBuf,
    /// When the next file begins, and what stays of the disk.
    pub rotation: Rotation,
}

/// Records samples into files. Each row that it takes is written, or counted as lost, or waits for the disk.
pub(crate) struct Recorder {
    rows: Option<SyncSender<RecordedRow>>,
    thread: Option<JoinHandle<Result<(), FileError>>>,
    shared: Arc<WriterState>,
    unix: UnixClock,
    /// Rows for which the queue had no room.
    overflow: u64,
}

/// What the thread reports, and what it is asked.
#[derive(Default)]
struct WriterState {
    written: AtomicU64,
    lost: AtomicU64,
    /// No more rows come, so that a full disk is not waited for.
    ended: AtomicBool,
}

impl Recorder {
    /// Whether there is a file with rows already where the first one would be.
    pub(crate) fn is_there(recording: &RecordingTarget) -> bool {
        !recording.rotation.is_enabled() && !is_vacant(&Disk, &recording.path)
    }

    /// The format of a recording that does not exist yet, or has no rows, whose ending names it.
    ///
    /// # Errors
    /// If there is such a file with rows, or the ending names no format.
    pub(crate) fn check(recording: &RecordingTarget) -> Result<Format, Failure> {
        let path = &recording.path;
        let format = Format::named(path).map_err(|message| Failure::new(Exit::Usage, message))?;
        match Self::is_there(recording) {
            false => Ok(format),
            true => Err(FileError(path.clone(), io::ErrorKind::AlreadyExists.into()).into()),
        }
    }

    /// Creates the file, whose ending names its format. A disk that is full is waited for.
    ///
    /// # Errors
    /// If it exists or cannot be written.
    pub(crate) fn create(recording: &RecordingTarget, imu: &ImuId) -> Result<Self, Failure> {
        let format = Self::check(recording)?;
        let (recording, imu) = (recording.clone(), imu.clone());
        let (sender, receiver) = sync_channel(QUEUE);
        let (created, is_created) = sync_channel(1);
        let shared = Arc::<WriterState>::default();
        let of_thread = Arc::clone(&shared);
        let body = move || {
            let mut writer = RecordingWriter { recording, format, imu, files: None, given: 0, shared: of_thread };
            let opened = writer.open(true);
            let is_open = opened.is_ok();
            // The other side waits for it.
            let _ = created.send(opened);
            if !is_open {
                return Ok(());
            }
            let result = writer.write(&receiver);
            writer.end(&receiver);
            result
        };
        let failed =
            |error: &dyn std::fmt::Display| Failure::new(Exit::Failed, format!("starting the recorder: {error}"));
        let thread = thread::Builder::new().name("record".to_owned()).spawn(body).map_err(|error| failed(&error))?;
        is_created.recv().map_err(|error| failed(&error))??;
        Ok(Self { rows: Some(sender), thread: Some(thread), shared, unix: UnixClock::new(), overflow: 0 })
    }

    /// Adds a row. Never waits: a row for which the queue has no room is lost.
    pub(crate) fn take(&mut self, raw: &RawSample) {
        let recorded_ns = (unix_s() * 1e9) as u64;
        // Measured for each row, so that a step shows at once.
        self.unix.look();
        let offset = self.unix.offset();
        let unix_offset = RecordedOffset::new(offset.offset_ns, offset.uncertainty_ns);
        let row = RecordedRow { unix_offset, ..RecordedRow::new(0, recorded_ns, StreamSample::Raw(*raw)) };
        if self.rows.as_ref().is_none_or(|rows| rows.try_send(row).is_err()) {
            if self.overflow == 0 {
                tell(
                    "isotherm",
                    "warning: rows are not recorded: the disk is too slow, full or gone; sending \
                    continues",
                );
            }
            self.overflow += 1;
        }
    }

    /// Rows that are lasting, and rows that are lost.
    pub(crate) fn counts(&self) -> [u64; 2] {
        let [written, lost] = [&self.shared.written, &self.shared.lost].map(|count| count.load(Ordering::Relaxed));
        [written, lost + self.overflow]
    }

    /// Writes what waits, and finishes the files.
    ///
    /// # Errors
    /// If rows were not written.
    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        self.shared.ended.store(true, Ordering::Relaxed);
        self.rows = None;
        let Some(thread) = self.thread.take() else { return Ok(()) };
        let result = thread.join().map_err(|_| Failure::new(Exit::Failed, "the recorder's thread ended"))?;
        let [_, lost] = self.counts();
        let rows = (lost > 0).then(|| {
            Failure::new(Exit::Io, format!("{lost} rows were not recorded, since the disk was too slow, full or gone"))
        });
        match Failure::all([result.err().map(Failure::from), rows].into_iter().flatten().collect()) {
            Some(failure) => Err(failure),
            None => Ok(()),
        }
    }
}

/// The recorder's thread.
struct RecordingWriter {
    recording: RecordingTarget,
    format: Format,
    imu: ImuId,
    /// `None` while the disk has no room to create the first.
    files: Option<PatientFiles>,
    /// Rows that were given to the files.
    given: u64,
    shared: Arc<WriterState>,
}

impl RecordingWriter {
    /// Creates the files. A full disk is reported the first time, and waited for.
    fn open(&mut self, is_first: bool) -> Result<(), FileError> {
        let RecordingTarget { path, rotation } = &self.recording;
        let imus = [self.imu.clone()];
        let told = |message| tell("isotherm", message);
        match Files::create(&Disk, path, self.format, *rotation, &imus, &[(0, StreamKind::Raw)]) {
            Ok(files) => self.files = Some(PatientFiles::new(imus.to_vec(), vec![files], told)),
            Err(error) if error.is_full() => {
                if is_first {
                    tell("isotherm", format!("writing {}: {}; rows wait for room", shown(&error.0), error.1));
                }
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Writes rows until no more come.
    fn write(&mut self, rows: &Receiver<RecordedRow>) -> Result<(), FileError> {
        let mut flushed = Instant::now();
        loop {
            match &mut self.files {
                Some(files) if !files.is_stalled() => match rows.recv_timeout(FLUSH) {
                    Ok(row) => {
                        self.given += 1;
                        files.write(row)?;
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return files.finish(),
                },
                // Nothing is taken out of the queue meanwhile. The last attempt is at the end.
                _ if self.shared.ended.load(Ordering::Relaxed) => return self.write_rest(rows),
                _ => thread::sleep(PAUSE),
            }
            let is_due = self.files.as_ref().is_some_and(PatientFiles::is_flush_due);
            if is_due || flushed.elapsed() >= FLUSH {
                self.flush()?;
                flushed = Instant::now();
            }
        }
    }

    fn write_rest(&mut self, rows: &Receiver<RecordedRow>) -> Result<(), FileError> {
        self.flush()?;
        let Some(files) = &mut self.files else {
            let cause = io::Error::from(io::ErrorKind::StorageFull);
            return Err(FileError(self.recording.path.clone(), cause));
        };
        while !files.is_stalled()
            && let Ok(row) = rows.recv()
        {
            self.given += 1;
            files.write(row)?;
        }
        files.finish()
    }

    fn flush(&mut self) -> Result<(), FileError> {
        match &mut self.files {
            Some(files) => files.flush()?,
            None => self.open(false)?,
        }
        self.count();
        Ok(())
    }

    /// Counts what is lasting. Returns how many rows are not.
    fn count(&self) -> u64 {
        let unwritten = self.files.iter().flat_map(PatientFiles::unwritten).map(|(_, rows)| rows).sum();
        self.shared.written.store(self.given.saturating_sub(unwritten), Ordering::Relaxed);
        unwritten
    }

    /// Counts all that is not written, also what still comes. A recording into which nothing could be written is not
    /// left.
    fn end(&self, rows: &Receiver<RecordedRow>) {
        self.shared.lost.store(self.count(), Ordering::Relaxed);
        while rows.recv().is_ok() {
            self.shared.lost.fetch_add(1, Ordering::Relaxed);
        }
        if self.shared.lost.load(Ordering::Relaxed) > 0
            && let Some(files) = &self.files
        {
            files.remove_without_rows();
        }
    }
}
