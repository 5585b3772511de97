//! The recorder: takes samples off the streams, writes them, and counts what is missing.

mod tally;

use isotherm_client::{ImuId, Options, Realtime, Tap, TapSettings, TappedSample};
use isotherm_recording::rows::{RecordedOffset, RecordedRow};
use isotherm_recording_formats::write::{FileError, Files, PatientFiles};
use isotherm_shared::names::StreamKind;
use isotherm_support::failure::{Exit, Failure, shown};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use std::{io, thread};
use tally::{StreamCounts, Tally};
use tracing::info;

/// Rows of each IMU that may wait for the disk: over 3 s of both streams at 10 kHz.
const QUEUE: usize = 1 << 16;
/// Pause of the tap's thread when no stream has a sample.
const TAP_PAUSE: Duration = Duration::from_micros(500);
/// Pause of the main thread when no row has come.
const PAUSE: Duration = Duration::from_millis(5);
/// Most rows that are written between two readings of the clock.
const BATCH: usize = 1024;
/// Longest time between two checks whether there is something to report.
const REPORT_CHECK: Duration = Duration::from_millis(500);
/// Shortest time between two reports of losses.
const REPORT: Duration = Duration::from_secs(10);

/// The streams to record: index into the list of IMUs, and kind.
pub(crate) type Streams = Vec<(usize, StreamKind)>;

/// Removes files that have just been created, when nothing is to be recorded into them.
pub(crate) fn remove(files: &[Files]) {
    files.iter().flat_map(Files::current_paths).for_each(|path| drop(std::fs::remove_file(path)));
}

/// A recorder of streams into files.
pub(crate) struct Recorder {
    imus: Vec<ImuId>,
    streams: Streams,
    domain: String,
    tap: Tap,
    files: PatientFiles,
    counts: Vec<StreamCounts>,
    /// Sessions of each of `streams` that its files have.
    sessions: Vec<u64>,
    started: Instant,
    first_row: Option<Instant>,
    flushed: Instant,
    reported: RecorderReport,
}

/// What has been reported to the operator.
struct RecorderReport {
    connected: u64,
    /// Whether the streams that are waited for have been reported.
    waiting: bool,
    /// Whether the last check found an error of the transport.
    trouble: bool,
    lost: u64,
    lost_at: Option<Instant>,
    checked: Instant,
}

impl Recorder {
    /// Begins to take the samples of `streams`. `files` has one entry for each IMU, or one for all IMUs.
    ///
    /// # Errors
    /// If the tap's thread cannot be started with these settings. The files are then removed.
    pub(crate) fn start(
        imus: Vec<ImuId>,
        streams: Streams,
        files: Vec<Files>,
        options: Options,
        realtime: Realtime,
    ) -> Result<Self, Failure> {
        let sources: Vec<_> = streams.iter().map(|&(imu, kind)| (imus[imu].clone(), kind)).collect();
        let domain = options.domain.name().to_owned();
        let settings = TapSettings { depth: QUEUE * imus.len(), pause: TAP_PAUSE, realtime };
        let tap = Tap::start(&sources, &options, settings).map_err(|error| {
            remove(&files);
            Failure::new(Exit::Failed, format!("starting the thread that takes the samples: {error}"))
        })?;
        let now = Instant::now();
        Ok(Self {
            counts: vec![StreamCounts::default(); imus.len()],
            sessions: vec![0; streams.len()],
            started: now,
            first_row: None,
            flushed: now,
            reported: RecorderReport {
                connected: 0,
                waiting: false,
                trouble: false,
                lost: 0,
                lost_at: None,
                checked: now,
            },
            domain,
            files: PatientFiles::new(imus.clone(), files, |message| info!("{message}")),
            imus,
            streams,
            tap,
        })
    }

    /// Records until `end` is set or `duration` has passed since the first row. Every `flush` the rows are made visible
    /// and lasting.
    ///
    /// # Errors
    /// If a file cannot be written, or the tap fails. What was written stays.
    pub(crate) fn run(mut self, end: &AtomicBool, flush: Duration, duration: Option<Duration>) -> Result<(), Failure> {
        let result = self.record(end, flush, duration);
        self.end(result)
    }

    fn record(&mut self, end: &AtomicBool, flush: Duration, duration: Option<Duration>) -> Result<(), FileError> {
        loop {
            let ended = self.tap.has_ended();
            // While the disk is full, nothing is taken out of the queue.
            let came = !self.files.is_stalled() && self.take()?;
            if self.files.is_flush_due() || self.flushed.elapsed() >= flush {
                self.flush()?;
                self.flushed = Instant::now();
            }
            if self.reported.checked.elapsed() >= flush.min(REPORT_CHECK) {
                self.report();
                self.reported.checked = Instant::now();
            }
            if ended && !came {
                return self.write_rest();
            }
            let over = duration.zip(self.first_row).is_some_and(|(duration, first)| first.elapsed() >= duration);
            if over || end.load(Ordering::Relaxed) {
                self.tap.end();
            }
            if !came {
                thread::sleep(PAUSE);
            }
        }
    }

    /// Writes what is left after the tap has ended.
    fn write_rest(&mut self) -> Result<(), FileError> {
        if self.files.is_stalled() {
            self.flush()?;
        }
        // The disk was not full, or has room again.
        while !self.files.is_stalled() && self.take()? {}
        Ok(())
    }

    /// Writes up to [`BATCH`] rows from the queue. Returns whether there was one.
    fn take(&mut self) -> Result<bool, FileError> {
        for count in 0..BATCH {
            let Some(tapped) = self.tap.pop() else { return Ok(count > 0) };
            self.first_row.get_or_insert_with(Instant::now);
            let TappedSample { stream, unix_ns, unix_offset, sample, .. } = tapped;
            let unix_offset = RecordedOffset::new(unix_offset.offset_ns, unix_offset.uncertainty_ns);
            let row = RecordedRow { unix_offset, ..RecordedRow::new(self.streams[stream].0, unix_ns, sample) };
            if self.counts[row.imu].take(row.stream(), row.period(), row.recorded_ns) {
                self.files.write(row)?;
                if self.files.is_stalled() {
                    return Ok(true);
                }
            }
        }
        Ok(true)
    }

    /// Flushes all files.
    fn flush(&mut self) -> Result<(), FileError> {
        let result = self.files.flush();
        self.note_sessions();
        result
    }

    /// Notes how many sessions are in the files, of each stream of which all rows are.
    fn note_sessions(&mut self) {
        for (stream, rows) in self.files.unwritten() {
            if let Some(place) = self.streams.iter().position(|of| *of == stream).filter(|_| rows == 0) {
                self.sessions[place] = self.counts[stream.0].tally(stream.1).sessions;
            }
        }
    }

    /// Reports connections, warnings and losses to the operator.
    fn report(&mut self) {
        let connected = self.tap.connected();
        for (imu, id) in self.imus.iter().enumerate() {
            let bits = self.streams.iter().enumerate().filter(|(_, (of, _))| *of == imu);
            let mask: u64 = bits.map(|(place, _)| 1 << place).sum();
            if connected & mask == mask && self.reported.connected & mask != mask {
                print_message(&format!("recording {id}"));
            } else if !self.reported.waiting && connected & mask != mask {
                print_message(&format!("waiting for a service that serves {id} in domain {:?}", self.domain));
            }
        }
        self.reported.connected |= connected;
        self.reported.waiting = true;
        // A peer that dies during a call is one error, and the next call reaches its successor.
        let trouble = self.tap.take_warning();
        if let Some(warning) = trouble.as_ref().filter(|_| self.reported.trouble) {
            print_message(&format!("warning: {warning}; trying again"));
        }
        self.reported.trouble = trouble.is_some();
        let lost = |&(imu, stream): &(usize, StreamKind)| (imu, stream, self.counts[imu].lost(stream));
        let lost: Vec<_> = self.streams.iter().map(lost).filter(|(.., rows)| *rows > 0).collect();
        let all = lost.iter().fold(0, |all: u64, (.., rows)| all.saturating_add(*rows));
        if all > self.reported.lost && self.reported.lost_at.is_none_or(|at| at.elapsed() >= REPORT) {
            self.reported.lost_at = Some(Instant::now());
            self.reported.lost = all;
            let each =
                lost.iter().map(|(imu, stream, rows)| format!("{rows} of {} {}", self.imus[*imu], stream.name()));
            let each = each.collect::<Vec<_>>().join(", ");
            print_message(&format!("warning: rows are missing so far, by their sequences: {each}"));
        }
    }

    /// Finishes the files and prints the totals. If nothing could be recorded, nothing is left.
    fn end(mut self, result: Result<(), FileError>) -> Result<(), Failure> {
        let result = result.and_then(|()| self.files.finish());
        self.note_sessions();
        // Rows are left over only after an error.
        self.tap.end();
        let mut lost = self.unwritten();
        while !self.tap.has_ended() {
            thread::sleep(PAUSE);
        }
        while let Some(sample) = self.tap.pop() {
            lost[sample.stream].1 += 1;
        }
        let overflow = self.tap.overflow();
        let (repeats, ended) = match self.tap.finish() {
            Ok(repeats) => (repeats, Ok(())),
            Err(error) => (vec![0; self.streams.len()], Err(Failure::from(error))),
        };
        let result = match result {
            Err(FileError(_, error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            result => result.map_err(Failure::from).and(ended),
        };
        if result.is_err() && self.first_row.is_none() {
            self.files.remove_without_rows();
            return result;
        }
        if self.streams.len() > self.imus.len() {
            self.counts.iter_mut().for_each(StreamCounts::count_missing_at_ends);
        }
        for (place, &(imu, stream)) in self.streams.iter().enumerate() {
            let (unwritten, left) = lost[place];
            let mut tally = *self.counts[imu].tally(stream);
            tally.rows = tally.rows.saturating_sub(unwritten);
            tally.missing = tally.missing.saturating_add(unwritten).saturating_add(left);
            tally.sessions = self.sessions[place];
            print_totals(&self.imus[imu], stream, tally, &self.counts[imu], repeats[place]);
        }
        let lost: u64 = lost.iter().map(|(unwritten, left)| unwritten + left).sum();
        if overflow > 0 {
            print_message(&format!(
                "{overflow} rows had no place in memory while the disk was slow or full; they are missing"
            ));
        }
        if lost > 0 {
            print_message(&format!("{lost} rows at the end could not be written; they are missing"));
        }
        let (names, rotations) = self.files.names();
        if let Some(last) = names.last() {
            let (seconds, count) = (self.started.elapsed().as_secs_f64(), names.len());
            let (files, last) = (if count == 1 { "file" } else { "files" }, shown(last));
            print_message(&format!("{seconds:.1} s, {count} {files}, the last {last}, {rotations} rotations"));
        }
        result
    }

    /// For each stream how many rows were counted that are not in its files; then 0 for those that were not counted.
    fn unwritten(&self) -> Vec<(u64, u64)> {
        let mut all = vec![(0, 0); self.streams.len()];
        for (stream, rows) in self.files.unwritten() {
            if let Some(place) = self.streams.iter().position(|of| *of == stream) {
                all[place].0 += rows;
            }
        }
        all
    }
}

/// Prints the totals of a stream.
fn print_totals(imu: &ImuId, stream: StreamKind, tally: Tally, counts: &StreamCounts, repeats: u64) {
    let Tally { rows, sessions, missing, late, .. } = tally;
    let sessions = format!("{sessions} session{}", if sessions == 1 { "" } else { "s" });
    let late = match (late, stream) {
        (0, _) => String::new(),
        (_, StreamKind::Raw) => format!(", {late} too late and left out"),
        (_, StreamKind::Increment) => format!(", {late} behind a later one"),
    };
    let continuity = counts.continuity(stream);
    let steps = match continuity.losses().time_steps {
        0 => String::new(),
        1 => ", 1 time step".to_owned(),
        steps => format!(", {steps} time steps"),
    };
    let between = continuity.losses().between_sessions().map(|words| format!(", {words}")).unwrap_or_default();
    let name = stream.name();
    print_message(&format!(
        "{imu} {name}: {rows} rows of {sessions}, {missing} missing, {repeats} repeats{late}{steps}{between}"
    ));
    if let Some(fault) = continuity.fault() {
        print_message(&format!("warning: {imu} {name}: {fault}"));
    }
}

fn print_message(message: &str) {
    info!("{message}");
}
