//! Where samples go: to the service, or to the standard output.

use crate::link::{Link, SoakSpan, any_session};
use crate::recorder::Recorder;
use crate::tally::Tally;
use isotherm_client::{ImuId, RawSample, unix_s};
use isotherm_files::Disk;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::write::{FileError, Files, Format, Rotation};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::StreamSample;
use isotherm_support::failure::{Failure, tell};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

/// How long the end may wait for answers.
const LAST_ANSWERS: Duration = Duration::from_millis(250);

/// Where samples go.
pub(crate) enum Sink {
    Service(Box<Link>),
    Rows(Box<PrintedRows>),
}

impl Sink {
    pub(crate) fn take(&mut self, raw: RawSample, session: u64) {
        match self {
            Self::Service(link) => link.take(raw, session),
            Self::Rows(rows) => rows.take(raw, session),
        }
    }

    pub(crate) const fn note_soaked(&mut self, soaked: SoakSpan) {
        if let Self::Service(link) = self {
            link.soaked = soaked;
        }
    }

    /// The interval for which the pulses of readings are to be made \[ns\]; `None` if that is their own.
    pub(crate) fn pulse_interval(&self) -> Option<u64> {
        match self {
            Self::Service(link) => Some(link.pulse_ns),
            Self::Rows(_) => None,
        }
    }

    /// Hands on what waits. Returns whether no more is wanted.
    pub(crate) fn pump(&mut self) -> Result<bool, Failure> {
        match self {
            Self::Service(link) => link.pump().map(|()| false),
            Self::Rows(rows) => rows.pump(),
        }
    }

    /// Whether a sample was sent to the service.
    pub(crate) fn has_sent(&self) -> bool {
        matches!(self, Self::Service(link) if link.sent.sent > 0)
    }

    pub(crate) fn is_waiting(&self) -> bool {
        matches!(self, Self::Service(link) if link.is_waiting())
    }

    pub(crate) fn finish(&mut self) -> Result<(), Failure> {
        match self {
            Self::Service(link) => {
                let began = Instant::now();
                while !link.is_done() && began.elapsed() < LAST_ANSWERS {
                    link.pump()?;
                    std::thread::sleep(Duration::from_micros(200));
                }
                let lost = link.close();
                if lost > 0 {
                    tell("isotherm", format!("{lost} samples at the end were not sent, or not answered"));
                }
                link.recorder.as_mut().map_or(Ok(()), Recorder::finish)
            }
            Self::Rows(rows) => rows.finish(),
        }
    }

    pub(crate) fn count(&self, tally: &mut Tally) {
        let recorder = match self {
            Self::Service(link) => {
                tally.service = link.sent;
                &link.recorder
            }
            Self::Rows(rows) => &rows.recorder,
        };
        [tally.recorded, tally.not_recorded] = recorder.as_ref().map_or([0; 2], Recorder::counts);
    }
}

/// Rows on the standard output.
pub(crate) struct PrintedRows {
    files: Files,
    left: Option<u64>,
    /// The number of session 1.
    first: u64,
    failed: Option<FileError>,
    flushed: Instant,
    recorder: Option<Recorder>,
}

impl PrintedRows {
    pub(crate) fn new(imu: ImuId, limit: Option<u64>, recorder: Option<Recorder>) -> Result<Self, Failure> {
        let files =
            Files::create(&Disk, Path::new("-"), Format::Csv, Rotation::default(), &[imu], &[(0, StreamKind::Raw)])?;
        let first = any_session();
        Ok(Self { files, left: limit, first, failed: None, flushed: Instant::now(), recorder })
    }

    fn take(&mut self, raw: RawSample, session: u64) {
        if self.left == Some(0) || self.failed.is_some() {
            return;
        }
        self.left = self.left.map(|left| left - 1);
        let raw = RawSample { session: self.first.wrapping_add(session - 1), ..raw };
        let recorded_ns = (unix_s() * 1e9) as u64;
        let row = RecordedRow::new(0, recorded_ns, StreamSample::Raw(raw));
        self.failed = self.files.write(&row).err();
        if let Some(recorder) = &mut self.recorder {
            recorder.take(&raw);
        }
    }

    fn pump(&mut self) -> Result<bool, Failure> {
        if self.flushed.elapsed() >= Duration::from_millis(100) || self.left == Some(0) {
            self.flushed = Instant::now();
            if let Err(error) = self.files.flush() {
                self.failed.get_or_insert(error);
            }
        }
        match self.failed.take() {
            Some(FileError(_, error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(true),
            Some(error) => Err(error.into()),
            None => Ok(self.left == Some(0)),
        }
    }

    fn finish(&mut self) -> Result<(), Failure> {
        let written = match self.files.finish() {
            Err(FileError(_, error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            other => other.map_err(Failure::from),
        };
        let recorded = self.recorder.as_mut().map_or(Ok(()), Recorder::finish);
        written.and(recorded)
    }
}
