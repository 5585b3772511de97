//! Takes the streams' copies out of shared memory, in a thread that does nothing else.

use super::columns::{Row, Sample, Stream};
use isotherm_client::{ConnectError, ImuId, IncrementReader, Options, RawReader, Realtime};
use isotherm_shared::stream::INCREMENT_DEPTH;
use rtrb::{Consumer, Producer, RingBuffer};
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Rows that may wait for the disk, for each IMU: over three seconds at 10 kHz.
const QUEUE: usize = 1 << 16;
/// Pause when nothing has come.
const PAUSE: Duration = Duration::from_micros(500);
/// Rows of a stream that are taken at a time.
const BATCH: usize = 64;

/// The tap's end where rows come out.
pub struct Tap {
    rows: Consumer<Row>,
    shared: Arc<Shared>,
    thread: JoinHandle<Result<Vec<u64>, ConnectError>>,
}

/// What both threads look at.
#[derive(Debug, Default)]
pub struct Shared {
    /// Set to end the tap.
    pub end: AtomicBool,
    /// Rows for which the queue had no room.
    pub overflow: AtomicU64,
    /// One bit for each stream that has been found, in the order of the list.
    pub connected: AtomicU64,
    /// What the transport complained about last.
    trouble: Mutex<Option<String>>,
}

impl Shared {
    fn trouble(&self, message: String) {
        *self.trouble.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }

    /// What the transport has complained about since this was asked last.
    pub fn take_trouble(&self) -> Option<String> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

enum Reader {
    Raw(RawReader),
    Increment(IncrementReader),
}

impl Tap {
    /// Begins to tap `streams`: places in the list `imus`, and which of their streams; in a thread with these settings.
    ///
    /// # Errors
    /// If the operating system gives no thread, or no such one.
    pub fn start(
        imus: &[ImuId],
        streams: &[(usize, Stream)],
        options: &Options,
        realtime: Realtime,
    ) -> io::Result<Self> {
        let (producer, rows) = RingBuffer::new(QUEUE * imus.len());
        let shared = Arc::<Shared>::default();
        let (imus, streams, options) = (imus.to_vec(), streams.to_vec(), options.clone());
        let both = Arc::clone(&shared);
        let (applied, result) = mpsc::channel();
        // Readers stay in the thread that made them.
        let thread = thread::Builder::new().name("tap".to_owned()).spawn(move || {
            // Nobody listens only if nobody is there any more.
            let _ = applied.send(realtime.apply());
            let readers = streams.iter().map(|&(imu, stream)| match stream {
                Stream::Raw => (imu, Reader::Raw(RawReader::new(imus[imu].clone(), &options))),
                Stream::Increment => (imu, Reader::Increment(IncrementReader::new(imus[imu].clone(), &options))),
            });
            drain(readers.collect(), producer, &both)
        })?;
        if let Ok(Err(error)) = result.recv() {
            return Err(io::Error::other(error));
        }
        Ok(Self { rows, shared, thread })
    }

    /// The next row, if there is one.
    pub fn pop(&mut self) -> Option<Row> {
        self.rows.pop().ok()
    }

    /// What both threads look at.
    pub fn shared(&self) -> &Shared {
        &self.shared
    }

    /// Whether nothing comes any more but what is in the queue.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// The repeats of each stream, or why it could not be read. To be called when it has ended.
    pub fn finish(self) -> Result<Vec<u64>, ConnectError> {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

fn drain(
    mut readers: Vec<(usize, Reader)>,
    mut rows: Producer<Row>,
    shared: &Shared,
) -> Result<Vec<u64>, ConnectError> {
    let mut looked = Instant::now();
    // What was in the queues when the end was asked for is taken, but no more of a stream that never pauses.
    let mut last_rounds = INCREMENT_DEPTH.div_ceil(BATCH);
    loop {
        let mut came = false;
        for (imu, reader) in &mut readers {
            match take(*imu, reader, &mut rows, shared) {
                Ok(some) => came |= some,
                // A peer that dies at the wrong moment; the next attempt meets its successor.
                Err(ConnectError::Transport { phase, cause }) => shared.trouble(format!("{phase}: {cause}")),
                Err(hopeless) => return Err(hopeless),
            }
        }
        if shared.end.load(Ordering::Relaxed) {
            last_rounds = last_rounds.saturating_sub(1);
            if last_rounds == 0 || !came {
                break;
            }
        }
        if !came {
            thread::sleep(PAUSE);
        }
        if looked.elapsed() > Duration::from_millis(50) {
            looked = Instant::now();
            let connected = |(place, (_, reader)): (usize, &(usize, Reader))| u64::from(reader.is_connected()) << place;
            shared.connected.store(readers.iter().enumerate().map(connected).sum(), Ordering::Relaxed);
        }
    }
    Ok(readers.iter().map(|(_, reader)| reader.repeats()).collect())
}

/// Takes what a stream has, up to [`BATCH`] rows. Whether there was something.
fn take(imu: usize, reader: &mut Reader, rows: &mut Producer<Row>, shared: &Shared) -> Result<bool, ConnectError> {
    for count in 0..BATCH {
        let sample = match reader {
            Reader::Raw(reader) => reader.receive()?.map(Sample::Raw),
            Reader::Increment(reader) => reader.receive()?.map(Sample::Increment),
        };
        let Some(sample) = sample else { return Ok(count > 0) };
        if rows.push(Row { imu, recorded_ns: utc_ns(), sample }).is_err() {
            shared.overflow.fetch_add(1, Ordering::Relaxed);
        }
    }
    Ok(true)
}

fn utc_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64)
}

impl Reader {
    fn is_connected(&self) -> bool {
        match self {
            Self::Raw(reader) => reader.is_connected(),
            Self::Increment(reader) => reader.is_connected(),
        }
    }

    fn repeats(&self) -> u64 {
        match self {
            Self::Raw(reader) => reader.repeats(),
            Self::Increment(reader) => reader.repeats(),
        }
    }
}
