use super::{options, seconds};
use crate::config::MAX_IMUS;
use crate::failure::{Exit, Failure};
use crate::record::columns::{Row, Stream};
use crate::record::files::{FileError, Files, Format, IMU, Rotation};
use crate::record::tally::{Ledger, Tally};
use crate::record::tap::Tap;
use clap::Args;
use isotherm_client::{Domain, ImuId, Realtime};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Pause when no row has come.
const PAUSE: Duration = Duration::from_millis(5);
/// Rows between two looks at the clock.
const BATCH: usize = 1024;
/// How often it is looked whether there is something to tell.
const LOOK: Duration = Duration::from_millis(500);
/// Losses that go on are told this often.
const TELL: Duration = Duration::from_secs(10);

/// Record raw samples and increments of running IMUs, without disturbing them
///
/// Waits for the service, goes on over restarts of service and acquisition, and ends on SIGINT or SIGTERM. At every moment the files
/// hold everything up to the last flush, even if the recorder is killed.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm record --imu imu-a -o flight.mcap\n  isotherm record --imu imu-a --imu imu-b -o flight-{imu}.parquet --rotate-time 3600\n  isotherm record --imu imu-a -o - | head"
)]
pub struct Record {
    /// An IMU to record; may be given several times
    #[arg(long = "imu", value_name = "ID", required = true)]
    imus: Vec<ImuId>,
    /// Where the rows go: .csv, .parquet or .mcap; {imu} in the name stands for the IMU; - is stdout (CSV)
    ///
    /// CSV and Parquet have one file a stream: FILE.csv for raw samples, FILE.increments.csv. A file that exists is never replaced.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// What the files are, whatever their name
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Only this stream; both unless given, and raw if they go to stdout
    #[arg(long, value_enum)]
    stream: Option<Stream>,
    /// Begin the next file at this size: bytes, or with k, M, G; files are then numbered, FILE-0001.csv
    #[arg(long, value_name = "SIZE", value_parser = size)]
    rotate_size: Option<u64>,
    /// Begin the next file after this time [s]; files are then numbered, FILE-0001.csv
    #[arg(long, value_name = "S", value_parser = seconds)]
    rotate_time: Option<Duration>,
    /// How often rows are made visible and lasting [s]
    #[arg(long, value_name = "S", default_value = "1", value_parser = seconds)]
    flush: Duration,
    /// End this long after the first row [s]
    #[arg(long, value_name = "S", value_parser = seconds)]
    duration: Option<Duration>,
    /// Real-time priority (SCHED_FIFO, 1 to 99) of the thread that takes the samples, which sleeps most of the time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(i32).range(1..=99))]
    priority: Option<i32>,
}

impl Record {
    pub fn run(self, domain: Domain) -> Result<(), Failure> {
        let (files, streams) = self.files()?;
        let end = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            let registered = signal_hook::flag::register(signal, Arc::clone(&end));
            registered.map_err(|error| Failure::new(Exit::Failed, format!("handling signals: {error}")))?;
        }
        let name = domain.name().to_owned();
        let realtime = Realtime { priority: self.priority, ..Realtime::default() };
        let tap = Tap::start(&self.imus, &streams, &options(domain, Duration::ZERO), realtime);
        let tap = tap.map_err(|error| {
            remove(&files);
            Failure::new(Exit::Failed, format!("starting the thread that takes the samples: {error}"))
        })?;
        let now = Instant::now();
        let mut recorder = Recorder {
            ledgers: vec![Ledger::default(); self.imus.len()],
            route: (0..self.imus.len()).map(|imu| if files.len() == 1 { 0 } else { imu }).collect(),
            names: files.iter().flat_map(Files::paths_now).collect(),
            started: now,
            first_row: None,
            flushed: now,
            stalled: false,
            told: Told { connected: 0, waiting: false, lost: 0, lost_at: None, looked: now },
            rotations: 0,
            domain: name,
            imus: self.imus,
            streams,
            files,
            tap,
        };
        let result = recorder.record(&end, self.flush, self.duration);
        recorder.end(result)
    }

    /// Checks the command line, and creates the files with their streams.
    fn files(&self) -> Result<(Vec<Files>, Streams), Failure> {
        let usage = |message: String| Err(Failure::new(Exit::Usage, message));
        let (output, name) = (&self.output, self.output.to_string_lossy());
        if let Some(twice) = self.imus.iter().enumerate().find(|(place, imu)| self.imus[..*place].contains(imu)) {
            return usage(format!("--imu {} is given twice", twice.1));
        }
        if self.imus.len() > MAX_IMUS {
            return usage(format!("{} IMUs; a service has up to {MAX_IMUS}", self.imus.len()));
        }
        let stdout = output == Path::new("-");
        let extension = output.extension().map(|extension| extension.to_string_lossy().to_lowercase());
        let format = match (self.format, extension.as_deref()) {
            (Some(format), _) => format,
            (None, Some("csv")) => Format::Csv,
            (None, Some("parquet")) => Format::Parquet,
            (None, Some("mcap")) => Format::Mcap,
            (None, _) if stdout => Format::Csv,
            (None, _) => return usage(format!("{name}: name it .csv, .parquet or .mcap, or give --format")),
        };
        let rotation = Rotation { size: self.rotate_size, time: self.rotate_time };
        if stdout
            && (format != Format::Csv || self.imus.len() > 1 || rotation.size.is_some() || rotation.time.is_some())
        {
            return usage("stdout takes one stream of one IMU as CSV, without rotation; name a file".to_owned());
        }
        let apart = name.contains(IMU);
        if self.imus.len() > 1 && format != Format::Mcap && !apart {
            return usage(format!("several IMUs need a file each: put {IMU} into the name {name}, or record MCAP"));
        }
        let kinds = match self.stream {
            Some(stream) => vec![stream],
            None if stdout => vec![Stream::Raw],
            None => Stream::BOTH.to_vec(),
        };
        let all = |imu: usize| kinds.iter().map(move |stream| (imu, *stream));
        let streams: Vec<_> = (0..self.imus.len()).flat_map(all).collect();
        let groups: Vec<Vec<_>> = match apart {
            true => (0..self.imus.len()).map(|imu| all(imu).collect()).collect(),
            false => vec![streams.clone()],
        };
        let mut files: Vec<Files> = Vec::new();
        for group in groups {
            match Files::create(output, format, rotation, &self.imus, &group) {
                Ok(made) => files.push(made),
                Err(error) => {
                    // All or none.
                    remove(&files);
                    return Err(refused(&error));
                }
            }
        }
        Ok((files, streams))
    }
}

/// Places in the list of IMUs, and which of their streams.
type Streams = Vec<(usize, Stream)>;

/// Takes files away in which nothing is.
fn remove(files: &[Files]) {
    files.iter().flat_map(Files::paths_now).for_each(|path| drop(std::fs::remove_file(path)));
}

fn refused(FileError(path, error): &FileError) -> Failure {
    if error.kind() == io::ErrorKind::AlreadyExists {
        let path = path.display();
        let remedy = "a recording is never replaced: name another, or rotate, which numbers the files";
        return Failure::new(Exit::Io, format!("{path} exists; {remedy}"));
    }
    Failure::io("writing", path, error)
}

struct Recorder {
    imus: Vec<ImuId>,
    streams: Streams,
    domain: String,
    tap: Tap,
    files: Vec<Files>,
    /// The files of each IMU.
    route: Vec<usize>,
    ledgers: Vec<Ledger>,
    names: Vec<PathBuf>,
    rotations: u64,
    started: Instant,
    first_row: Option<Instant>,
    flushed: Instant,
    /// There is no room; nothing is taken out of the queue until there is.
    stalled: bool,
    told: Told,
}

/// What the operator knows already.
struct Told {
    connected: u64,
    /// Whether it has been said which streams are waited for.
    waiting: bool,
    lost: u64,
    lost_at: Option<Instant>,
    looked: Instant,
}

impl Recorder {
    fn record(&mut self, end: &AtomicBool, flush: Duration, duration: Option<Duration>) -> Result<(), FileError> {
        loop {
            let ended = self.tap.has_ended();
            let came = !self.stalled && self.take()?;
            let due = !self.stalled && self.files.iter().any(Files::is_flush_due);
            if due || self.flushed.elapsed() >= flush {
                self.flush()?;
                self.flushed = Instant::now();
            }
            if self.told.looked.elapsed() >= flush.min(LOOK) {
                self.tell();
                self.told.looked = Instant::now();
            }
            if ended && !came {
                if self.stalled {
                    self.flush()?;
                }
                if !self.stalled {
                    // What waited for room, if there was some, has been taken.
                    while self.take()? {}
                }
                return Ok(());
            }
            let over = duration.zip(self.first_row).is_some_and(|(duration, first)| first.elapsed() >= duration);
            if over || end.load(Ordering::Relaxed) {
                self.tap.shared().end.store(true, Ordering::Relaxed);
            }
            if !came {
                thread::sleep(PAUSE);
            }
        }
    }

    /// Writes what has come, up to [`BATCH`] rows. Whether there was something.
    fn take(&mut self) -> Result<bool, FileError> {
        for count in 0..BATCH {
            let Some(row) = self.tap.pop() else { return Ok(count > 0) };
            self.first_row.get_or_insert_with(Instant::now);
            self.write(&row)?;
        }
        Ok(true)
    }

    fn write(&mut self, row: &Row) -> Result<(), FileError> {
        if !self.ledgers[row.imu].take(row.stream(), row.key()) {
            return Ok(());
        }
        self.files[self.route[row.imu]].write(row)
    }

    /// A disk that is full is waited for; anything else is an error.
    fn flush(&mut self) -> Result<(), FileError> {
        for files in &mut self.files {
            match files.flush() {
                Ok(None) => {}
                Ok(Some(next)) => {
                    self.rotations += 1;
                    self.names.extend(next);
                }
                Err(FileError(path, error)) if is_full(&error) => {
                    if !self.stalled {
                        let path = path.display();
                        say(&format!("writing {path}: {error}; what is written stays, the rest waits for room"));
                    }
                    self.stalled = true;
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
        }
        if self.stalled {
            say("there is room again, recording goes on");
        }
        self.stalled = false;
        Ok(())
    }

    /// Tells what the operator should know, as it happens.
    fn tell(&mut self) {
        let shared = self.tap.shared();
        let connected = shared.connected.load(Ordering::Relaxed);
        for (imu, id) in self.imus.iter().enumerate() {
            let bits = self.streams.iter().enumerate().filter(|(_, (of, _))| *of == imu);
            let mask: u64 = bits.map(|(place, _)| 1 << place).sum();
            if connected & mask == mask && self.told.connected & mask != mask {
                say(&format!("recording {id}"));
            } else if !self.told.waiting && connected & mask != mask {
                say(&format!("waiting for a service that serves {id} in domain {:?}", self.domain));
            }
        }
        self.told.connected |= connected;
        self.told.waiting = true;
        if let Some(trouble) = shared.take_trouble() {
            say(&format!("warning: {trouble}; trying again"));
        }
        let tallies = self.streams.iter().map(|&(imu, stream)| self.ledgers[imu].tally(stream));
        let lost = tallies.map(|tally| tally.missing).fold(0, u64::saturating_add);
        if lost > self.told.lost && self.told.lost_at.is_none_or(|at| at.elapsed() >= TELL) {
            self.told.lost_at = Some(Instant::now());
            self.told.lost = lost;
            say(&format!("warning: {lost} rows are missing so far, by their sequences"));
        }
    }

    /// Ends the files and sums up.
    fn end(mut self, result: Result<(), FileError>) -> Result<(), Failure> {
        let result = result.and_then(|()| self.files.iter_mut().try_for_each(Files::finish));
        // Only behind an error is something left over.
        self.tap.shared().end.store(true, Ordering::Relaxed);
        let mut lost = self.files.iter().map(Files::unflushed).sum::<u64>();
        while !self.tap.has_ended() {
            thread::sleep(PAUSE);
        }
        while self.tap.pop().is_some() {
            lost += 1;
        }
        let overflow = self.tap.shared().overflow.load(Ordering::Relaxed);
        let repeats = self.tap.finish();
        if self.streams.len() > self.imus.len() {
            self.ledgers.iter_mut().for_each(Ledger::settle);
        }
        for (place, &(imu, stream)) in self.streams.iter().enumerate() {
            let Tally { rows, sessions, missing, late, .. } = *self.ledgers[imu].tally(stream);
            let repeats = repeats.as_ref().map_or(0, |repeats| repeats[place]);
            let sessions = format!("{sessions} session{}", if sessions == 1 { "" } else { "s" });
            let late = match (late, stream) {
                (0, _) => String::new(),
                (_, Stream::Raw) => format!(", {late} too late and left out"),
                (_, Stream::Increment) => format!(", {late} behind a later one"),
            };
            let name = stream.name();
            say(&format!(
                "{} {name}: {rows} rows of {sessions}, {missing} missing, {repeats} repeats{late}",
                self.imus[imu]
            ));
        }
        if overflow > 0 {
            say(&format!("{overflow} rows had no place in memory while the disk was slow or full; they are missing"));
        }
        if lost > 0 {
            say(&format!("{lost} rows at the end could not be written"));
        }
        let (count, rotations) = (self.names.len(), self.rotations);
        let seconds = self.started.elapsed().as_secs_f64();
        if let Some(last) = self.names.last() {
            let files = if count == 1 { "file" } else { "files" };
            say(&format!("{seconds:.1} s, {count} {files}, the last {}, {rotations} rotations", last.display()));
        }
        match result {
            Err(FileError(_, error)) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            Err(error) => Err(refused(&error)),
            Ok(()) => repeats.map(|_| ()).map_err(Failure::from),
        }
    }
}

fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

fn say(message: &str) {
    let _ = writeln!(io::stderr(), "isotherm: {message}");
}

/// A size in bytes, with k, M or G for powers of 1000.
fn size(text: &str) -> Result<u64, String> {
    let (number, factor) = match text.as_bytes().last() {
        Some(b'k') => (&text[..text.len() - 1], 1_000),
        Some(b'M') => (&text[..text.len() - 1], 1_000_000),
        Some(b'G') => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    let size = number.parse::<u64>().ok().and_then(|number| number.checked_mul(factor)).filter(|size| *size > 0);
    size.ok_or_else(|| "give a number of bytes over 0, as 500M or 2G".to_owned())
}
