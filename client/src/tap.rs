//! Takes samples off streams in a thread of its own, for recorders and campaigns.

use crate::clock::monotonic_ns;
use crate::connect::Options;
use crate::error::ConnectError;
use crate::reader::{IncrementReader, RawReader};
use crate::realtime::Realtime;
use crate::sync::{AtomicBool, AtomicU64};
use crate::transport::stream::INCREMENT_DEPTH;
use crate::unix_time::{UnixClock, UnixOffset};
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::wire::StreamSample;
use std::io;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Samples that are taken from one stream before the next stream's turn.
const BATCH: usize = 64;
/// Pause between two updates of the list of connected streams, and of the offset of Unix time.
const UPDATE: Duration = Duration::from_millis(50);

/// Settings of a tap.
#[derive(Clone, Debug)]
pub struct TapSettings {
    /// Samples that may wait to be popped. Further samples are lost and counted; each loss is a gap in the sequence.
    pub depth: usize,
    /// Pause when no stream has a sample.
    pub pause: Duration,
    /// Real-time settings of the thread.
    pub realtime: Realtime,
}

/// A sample taken off a stream.
#[derive(Clone, Copy, Debug)]
pub struct TappedSample {
    /// Index of the stream in the list that the tap was started with.
    pub stream: usize,
    /// `CLOCK_MONOTONIC` when it was received \[ns\].
    pub received_ns: u64,
    /// Unix time when it was received \[ns\].
    pub unix_ns: u64,
    /// How far Unix time is ahead of `CLOCK_MONOTONIC`, measured within the 50 ms before.
    pub unix_offset: UnixOffset,
    /// The sample.
    pub sample: StreamSample,
}

/// Reads up to 64 streams in a thread of its own. Dropping it ends the thread.
pub struct Tap {
    samples: Receiver<TappedSample>,
    shared: Arc<TapShare>,
    thread: Option<JoinHandle<Result<Vec<u64>, ConnectError>>>,
}

/// State shared with the thread.
#[derive(Debug, Default)]
struct TapShare {
    end: AtomicBool,
    overflow: AtomicU64,
    /// One bit for each stream, in the order of the list.
    connected: AtomicU64,
    warning: Mutex<Option<String>>,
}

enum StreamReader {
    Raw(RawReader),
    Increment(IncrementReader),
}

impl Tap {
    /// Starts to read `streams`.
    ///
    /// # Errors
    /// If the operating system refuses the thread or its real-time settings.
    pub fn start(streams: &[(ImuId, StreamKind)], options: &Options, settings: TapSettings) -> io::Result<Self> {
        let (sender, samples) = sync_channel(settings.depth);
        let shared = Arc::<TapShare>::default();
        let (streams, options, state) = (streams.to_vec(), options.clone(), Arc::clone(&shared));
        let (applied, result) = mpsc::channel();
        let TapSettings { pause, realtime, .. } = settings;
        // Readers are not `Send`, so the thread creates them.
        let thread = thread::Builder::new().name("tap".to_owned()).spawn(move || {
            // Fails only if the receiver has been dropped.
            let _ = applied.send(realtime.apply());
            let readers = streams.into_iter().map(|(imu, kind)| match kind {
                StreamKind::Raw => StreamReader::Raw(RawReader::new(imu, &options)),
                StreamKind::Increment => StreamReader::Increment(IncrementReader::new(imu, &options)),
            });
            drain(readers.collect(), &sender, pause, &state)
        })?;
        if let Ok(Err(error)) = result.recv() {
            return Err(io::Error::other(error));
        }
        Ok(Self { samples, shared, thread: Some(thread) })
    }

    /// The next waiting sample.
    #[must_use]
    pub fn pop(&self) -> Option<TappedSample> {
        self.samples.try_recv().ok()
    }

    /// Asks the thread to end. It first takes the samples that are in the streams' queues.
    pub fn end(&self) {
        self.shared.end.store(true, Relaxed);
    }

    /// Whether the thread has ended. Samples that wait to be popped remain.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Samples that were lost because [`TapSettings::depth`] samples waited already.
    #[must_use]
    pub fn overflow(&self) -> u64 {
        self.shared.overflow.load(Relaxed)
    }

    /// One bit for each stream that has been found, in the order of the list.
    #[must_use]
    pub fn connected(&self) -> u64 {
        self.shared.connected.load(Relaxed)
    }

    /// The last transport error since the previous call, if any. The thread continues after such an error.
    #[must_use]
    pub fn take_warning(&self) -> Option<String> {
        self.shared.warning.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Ends the thread and waits for it. Returns the repeats of each stream
    /// ([`Reader::repeats`](crate::Reader::repeats)).
    ///
    /// # Errors
    /// The error that ended the thread.
    ///
    /// # Panics
    /// If the thread has panicked.
    pub fn finish(mut self) -> Result<Vec<u64>, ConnectError> {
        self.end();
        let ended = self.thread.take().map_or(Ok(Ok(Vec::new())), JoinHandle::join);
        ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

impl Drop for Tap {
    fn drop(&mut self) {
        self.end();
        // A panic of the thread has been printed already.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

fn drain(
    mut readers: Vec<StreamReader>,
    samples: &SyncSender<TappedSample>,
    pause: Duration,
    shared: &TapShare,
) -> Result<Vec<u64>, ConnectError> {
    let (mut updated, mut unix) = (Instant::now(), UnixClock::new());
    // After `end` the queues are emptied, in a limited number of rounds: a stream that never pauses must not prevent
    // the end.
    let mut last_rounds = INCREMENT_DEPTH.div_ceil(BATCH);
    loop {
        let mut received = false;
        for (stream, reader) in readers.iter_mut().enumerate() {
            match take(stream, reader, unix.offset(), samples, shared) {
                Ok(any) => received |= any,
                // For example, a peer died during the call. A later call reaches its successor.
                Err(ConnectError::Transport { phase, cause }) => {
                    let warning = Some(format!("{phase}: {cause}"));
                    *shared.warning.lock().unwrap_or_else(PoisonError::into_inner) = warning;
                }
                Err(permanent) => return Err(permanent),
            }
        }
        if shared.end.load(Relaxed) {
            last_rounds = last_rounds.saturating_sub(1);
            if last_rounds == 0 || !received {
                break;
            }
        }
        if !received {
            thread::sleep(pause);
        }
        if updated.elapsed() > UPDATE {
            updated = Instant::now();
            // A step shows in the offset.
            unix.look();
            let bit = |(stream, reader): (usize, &StreamReader)| u64::from(reader.is_connected()) << stream;
            shared.connected.store(readers.iter().enumerate().map(bit).sum(), Relaxed);
        }
    }
    Ok(readers.iter().map(StreamReader::repeats).collect())
}

/// Takes up to [`BATCH`] samples off a stream. Returns whether there was one.
fn take(
    stream: usize,
    reader: &mut StreamReader,
    unix_offset: UnixOffset,
    samples: &SyncSender<TappedSample>,
    shared: &TapShare,
) -> Result<bool, ConnectError> {
    for count in 0..BATCH {
        let sample = match reader {
            StreamReader::Raw(reader) => reader.receive()?.map(StreamSample::Raw),
            StreamReader::Increment(reader) => reader.receive()?.map(StreamSample::Increment),
        };
        let Some(sample) = sample else { return Ok(count > 0) };
        let unix_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let sample = TappedSample { stream, received_ns: monotonic_ns(), unix_ns, unix_offset, sample };
        if samples.try_send(sample).is_err() {
            shared.overflow.fetch_add(1, Relaxed);
        }
    }
    Ok(true)
}

impl StreamReader {
    const fn is_connected(&self) -> bool {
        match self {
            Self::Raw(reader) => reader.is_connected(),
            Self::Increment(reader) => reader.is_connected(),
        }
    }

    const fn repeats(&self) -> u64 {
        match self {
            Self::Raw(reader) => reader.repeats(),
            Self::Increment(reader) => reader.repeats(),
        }
    }
}

#[cfg(test)]
#[cfg(isotherm_loom)]
mod explored {
    use super::*;
    use crate::sync::{explore, thread};

    /// The thread of a tap whose recorder does not keep up, until it is asked to end. No loss is uncounted.
    #[test]
    fn explored_losses_are_counted_and_the_end_is_seen() {
        explore(|| {
            let shared = Arc::<TapShare>::default();
            let thread = {
                let shared = Arc::clone(&shared);
                thread::spawn(move || {
                    let mut lost = 0;
                    loop {
                        shared.overflow.fetch_add(1, Relaxed);
                        lost += 1;
                        if shared.end.load(Relaxed) {
                            return lost;
                        }
                        shared.connected.store(1, Relaxed);
                        thread::yield_now();
                    }
                })
            };
            let before = shared.overflow.load(Relaxed);
            shared.end.store(true, Relaxed);
            assert!(shared.overflow.load(Relaxed) >= before && shared.connected.load(Relaxed) < 2);
            assert_eq!(thread.join().unwrap(), shared.overflow.load(Relaxed));
        });
    }
}
