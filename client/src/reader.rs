//! Reading the streams of an IMU: for navigation, loggers and recorders.

mod joining;

use crate::arrival::ArrivalEvent;
use crate::clock::monotonic_ns;
use crate::connect::{Options, deadline, retry_until};
use crate::error::ConnectError;
use crate::heartbeat::SharedStatus;
use crate::helper::MovedPorts;
use crate::status::StatusError;
use crate::transport::ports::{Incoming, Payload, copied};
use core::mem;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_shared::protocol::{self, ReaderState, SequenceTracker};
use isotherm_shared::sequence::Seen;
use isotherm_shared::wire::{CompensatedIncrement, RawSample};
use joining::{Answer, Question, RETRY, ReaderHelper, ReaderPorts, start_helper};
use rustix::event::epoll;
use rustix::time::{ClockId, clock_gettime};
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Pause between two polls of a stream without an event.
const POLL: Duration = Duration::from_micros(200);
/// Pause between two attempts to find the event.
const EVENT_RETRY: Duration = Duration::from_secs(1);
/// Pause between two looks whether the reader was cut off from the stream, while nothing comes \[ns\].
const LOOK_NS: u64 = 250_000_000;

/// So often the event is lowered after something came, where the queue is empty; then after each pause \[ns\].
const LOOKS: u8 = 2;
const LOWERING_NS: u64 = 5_000_000;

/// Reads the increments of one IMU as they are published: for navigation and loggers.
///
/// The queue holds [`INCREMENT_DEPTH`](crate::transport::stream::INCREMENT_DEPTH) increments. If the reader sleeps for
/// longer, the oldest are overwritten.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_client::{IncrementReader, Options};
/// use std::time::Duration;
///
/// let mut reader = IncrementReader::connect("imu-a".parse()?, &Options::from_environment()?)?;
/// while let Some(increment) = reader.receive_timeout(Duration::from_secs(1))? {
///     println!("{:?} m/s", increment.velocity_increment);
/// }
/// # Ok(())
/// # }
/// ```
pub type IncrementReader = Reader<CompensatedIncrement>;

/// Reads the raw samples of one IMU as the acquisition sends them: for recorders.
///
/// The queue holds [`RECORDER_DEPTH`](crate::transport::stream::RECORDER_DEPTH) samples. If the reader sleeps for
/// longer, the newest are lost. Acquisition and service are not affected.
pub type RawReader = Reader<RawSample>;

/// Reads one stream of an IMU as it is published, beginning when it is connected: [`IncrementReader`], [`RawReader`].
///
/// It may be created before or after the service, and it stays connected across restarts of service and acquisition. If
/// the shared memory is removed under it, it joins the stream again when a service is there. It returns each (session,
/// sequence) once, although a resend after a restart publishes some twice. It cannot disturb other processes: if its
/// queue is full, only this reader loses samples, which is a gap in `sequence`.
///
/// Sequences rise, with one exception: after a restart of the service, or a loss, a new sample may come before samples
/// that are sent again. [`isotherm_shared::protocol`] has the rules.
#[derive(Debug)]
pub struct Reader<T: Payload> {
    domain: Domain,
    imu: ImuId,
    state: ReaderState,
    /// The order of what was returned, and the place of the last one in it.
    order: SequenceTracker,
    last: Option<protocol::Arrival>,
    times: PublicationTimes,
    /// When the event is looked for again.
    next_event_attempt: Instant,
    /// `CLOCK_MONOTONIC` when the service's worker was last seen at work, as far as is known \[ns\].
    heartbeat_ns: Option<u64>,
    /// When to look whether it was cut off, `CLOCK_MONOTONIC` \[ns\].
    next_look_ns: u64,
    /// Whether anything has come since the last look.
    has_received: bool,
    /// How often the event is yet lowered at once where the queue is empty, and when it is lowered next \[ns\].
    looks_left: u8,
    next_lowering_ns: u64,
    /// For a caller that polls the event by itself. It stays the same when the reader joins the stream again.
    descriptor: Option<OwnedFd>,
    /// That of all readers of the process.
    status: Option<Arc<SharedStatus>>,
    /// `None` while it is not connected.
    ports: Option<ReaderPorts<T>>,
    /// `None` if the thread could not be started.
    helper: Option<ReaderHelper<T>>,
}

impl<T: Payload> Reader<T> {
    /// A reader that connects at once if the service is there, and otherwise in a later call, as soon as it is; it
    /// never waits (the time-out of `options` is not used).
    ///
    /// Where [`is_connected`](Self::is_connected) is true after this, nothing is missed that is published from now on.
    /// Where it is false, what is published before the call that connects it is not received: the first sample or
    /// increment that comes may be any of its session. What prevents it from ever connecting is the error of the next
    /// call.
    #[must_use]
    pub fn new(imu: ImuId, options: &Options) -> Self {
        // Why it fails is the error of the next call.
        let ports = ReaderPorts::attach(&mut None, &options.domain, &imu).ok();
        Self::with(ports, imu, options)
    }

    fn with(ports: Option<ReaderPorts<T>>, imu: ImuId, options: &Options) -> Self {
        Self {
            helper: start_helper(&imu, &options.domain).ok(),
            domain: options.domain.clone(),
            imu,
            state: ReaderState::new(),
            order: SequenceTracker::default(),
            last: None,
            times: PublicationTimes::default(),
            next_event_attempt: Instant::now(),
            heartbeat_ns: None,
            next_look_ns: 0,
            has_received: false,
            looks_left: 0,
            next_lowering_ns: 0,
            descriptor: None,
            status: None,
            ports,
        }
    }

    /// A connected reader; waits for the service up to the time-out of `options`.
    ///
    /// # Errors
    /// If it could not connect in that time.
    pub fn connect(imu: ImuId, options: &Options) -> Result<Self, ConnectError> {
        let (domain, mut node) = (&options.domain, None);
        let ports = retry_until(deadline(options.timeout), || ReaderPorts::attach(&mut node, domain, &imu))?;
        Ok(Self::with(Some(ports), imu, options))
    }

    /// Whether the stream has been found. Stays true when the service stops; false while the reader is cut off from the
    /// stream, since its shared memory was removed.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.ports.is_some()
    }

    /// The IMU.
    #[must_use]
    pub const fn imu(&self) -> &ImuId {
        &self.imu
    }

    /// Samples or increments that came again after a resend and were not returned.
    #[must_use]
    pub const fn repeats(&self) -> u64 {
        self.state.repeats()
    }

    /// The control periods that are missing right before the sample or increment that was returned last: holes in
    /// `sequence`, also those of a reader that was too slow, and the time between two sessions of the same clock.
    /// `None` if that is unknown: where time steps, between sessions whose timestamps are of different clocks, are 0,
    /// or do not agree with the reader's clock to within 0.25 s, and before the first that this reader returns. A
    /// reader may read as seldom as its queue allows: what it reads at once is placed by the timestamps, within the
    /// time in which it can have come.
    ///
    /// Where samples are sent again, later ones may come before them. What is not there then counts as missing, and
    /// comes behind, with nothing missing before it.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_client::{IncrementReader, Options};
    ///
    /// let mut reader = IncrementReader::connect("imu-a".parse()?, &Options::from_environment()?)?;
    /// while let Some(increment) = reader.receive()? {
    ///     match reader.lost_before() {
    ///         Some(0) => println!("{:?} m/s", increment.velocity_increment),
    ///         Some(periods) => println!("{periods} periods of {} ns to bridge", increment.interval_ns),
    ///         None => println!("navigation begins anew"),
    ///     }
    /// }
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn lost_before(&self) -> Option<u64> {
        self.last?.lost()
    }

    /// The next sample or increment, or `None` if there is none now (or no service yet). Does not wait.
    ///
    /// # Errors
    /// [`ConnectError`] if connecting cannot succeed (another user's domain, no reader place free) or reading fails.
    pub fn receive(&mut self) -> Result<Option<T>, ConnectError> {
        let received = self.next()?;
        if received.is_some() || self.descriptor.is_none() {
            return Ok(received);
        }
        self.find_event();
        if !self.may_be_raised() {
            return Ok(None);
        }
        if let Some(arrival) = self.arrival() {
            // What comes after the event is lowered raises it again.
            arrival.lower();
        }
        self.next()
    }

    /// Whether the event may be raised although the queue is empty: the service raises it after it has published. Where
    /// it did so late, the second look finds that, or one some milliseconds later.
    fn may_be_raised(&mut self) -> bool {
        let now = coarse_ns();
        if self.looks_left == 0 && now < self.next_lowering_ns {
            return false;
        }
        self.looks_left = self.looks_left.saturating_sub(1);
        self.next_lowering_ns = now + LOWERING_NS;
        true
    }

    fn next(&mut self) -> Result<Option<T>, ConnectError> {
        if self.ports.is_none() {
            self.join()?;
        }
        loop {
            let Some(ports) = &self.ports else { return Ok(None) };
            let sample =
                T::receive(&ports.subscriber).map_err(|error| ConnectError::transport("reading the stream", error))?;
            let Some(received) = sample.map(taken) else {
                let now = coarse_ns();
                self.times.drained(now);
                self.look_for_loss(now);
                return Ok(None);
            };
            (self.has_received, self.looks_left) = (true, LOOKS);
            let period = received.period();
            let at_ns = self.times.of(period.timestamp_ns, coarse_ns());
            if self.state.first_time(period.session, period.sequence) {
                self.last = Some(self.order.note(Seen { period, at_ns }));
                return Ok(Some(received));
            }
        }
    }

    /// As [`receive`](Self::receive), but waits up to `timeout`. It sleeps until the service notifies that increments
    /// are there. Where no event signals it, for raw samples and in the domain of a relay, it polls every 0.2 ms. For
    /// the least delay call `receive` in a loop.
    ///
    /// # Errors
    /// As [`receive`](Self::receive).
    pub fn receive_timeout(&mut self, timeout: Duration) -> Result<Option<T>, ConnectError> {
        let started = Instant::now();
        loop {
            if let Some(received) = self.next()? {
                return Ok(Some(received));
            }
            let left = timeout.saturating_sub(started.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            if !self.is_connected() {
                thread::sleep(left.min(RETRY));
                continue;
            }
            self.find_event();
            match self.arrival() {
                Some(arrival) => arrival.wait(left),
                None => thread::sleep(left.min(POLL)),
            }
        }
    }

    const fn arrival(&self) -> Option<&ArrivalEvent> {
        match &self.ports {
            Some(ports) => ports.arrival.as_ref(),
            None => None,
        }
    }

    /// Opens the event of a connected reader, if its stream has one.
    fn listen(&mut self) -> Result<(), ConnectError> {
        let Some(ports) = self.ports.as_mut().filter(|ports| ports.arrival.is_none()) else { return Ok(()) };
        ports.listen(&self.imu)?;
        self.watch_event()
    }

    /// Has the descriptor of the caller show the event.
    fn watch_event(&self) -> Result<(), ConnectError> {
        match (&self.descriptor, self.arrival()) {
            (Some(descriptor), Some(arrival)) => watch(descriptor, arrival),
            _ => Ok(()),
        }
    }

    /// Opens the event if there is none yet and it is time to look for it again. Without it the reader polls, which
    /// costs more and loses nothing.
    fn find_event(&mut self) {
        if self.arrival().is_none() && Instant::now() >= self.next_event_attempt {
            self.next_event_attempt = Instant::now() + EVENT_RETRY;
            let _ = self.listen();
        }
    }

    /// While nothing comes: has the helper thread look whether the reader is cut off from the stream, and leaves it
    /// then.
    fn look_for_loss(&mut self, now: u64) {
        let Some(helper) = &mut self.helper else { return };
        if let Some(Answer::Loss(true)) = helper.answer() {
            return self.leave();
        }
        if now < self.next_look_ns {
            return;
        }
        self.next_look_ns = now + LOOK_NS;
        if let (false, true, Some(ports)) = (mem::take(&mut self.has_received), helper.is_free(), &self.ports) {
            helper.ask(Question::Loss(Arc::clone(&ports.objects)));
        }
    }

    fn leave(&mut self) {
        if let Some(status) = self.status.take() {
            status.lose();
        }
        let listens = self.arrival().is_some();
        let old = self.ports.take().map(MovedPorts::new);
        self.next_event_attempt = Instant::now();
        if let Some(helper) = &mut self.helper {
            helper.ask(Question::Ports { old, listens });
        }
    }

    /// Has the helper thread connect the reader, and takes the ports as soon as they are there.
    fn join(&mut self) -> Result<(), ConnectError> {
        let Some(helper) = &mut self.helper else {
            return Err(ConnectError::Exhausted("the helper thread of a reader could not be started".to_owned()));
        };
        match helper.answer() {
            Some(Answer::Ports(ports)) => {
                self.ports = ports?.map(MovedPorts::take);
                self.watch_event()
            }
            Some(Answer::Loss(_)) | None => {
                if helper.is_free() {
                    helper.ask(Question::Ports { old: None, listens: self.descriptor.is_some() });
                }
                Ok(())
            }
        }
    }

    /// How long ago the service's worker of this IMU was last seen at work: under 0.3 s while the service lives and is
    /// on time. `None` if no service was seen yet.
    ///
    /// The first call of a process may return up to 1 s more; from then on the service publishes its status ten times a
    /// second. All readers of the process share one place of the status.
    ///
    /// # Errors
    /// If the status cannot be read, as when all its places are taken or it is of another version.
    pub fn heartbeat_age(&mut self) -> Result<Option<Duration>, ConnectError> {
        if !self.is_connected() {
            self.join()?;
        }
        if !self.is_connected() {
            return Ok(None);
        }
        let unread = |error: StatusError| error.connecting(&self.domain);
        let status = match &self.status {
            Some(status) => status,
            None => match SharedStatus::of(&self.domain).map_err(unread) {
                Ok(status) => self.status.insert(status),
                Err(ConnectError::NoService(_)) => return Ok(None),
                Err(error) => return Err(error),
            },
        };
        self.heartbeat_ns = status.heartbeat_ns(&self.imu).map_err(unread)?.or(self.heartbeat_ns);
        Ok(self.heartbeat_ns.map(|beat| Duration::from_nanos(monotonic_ns().saturating_sub(beat))))
    }
}

/// When samples were published, as far as is known: a reader that reads seldom finds many at once, at a time that says
/// little about each of them.
///
/// A sample was published after the queue was found empty, and before it is read. In between it was when its timestamp
/// says, if the acquisition's clock goes on as it did: the last sample before an empty queue has shown how far it is
/// from this machine's. One of another clock is nearly always out of these bounds.
#[derive(Clone, Copy, Debug, Default)]
struct PublicationTimes {
    /// When the queue was last found empty \[ns\].
    empty_ns: u64,
    /// How far the clock of this machine is ahead of the timestamps \[ns\], as a difference that wraps; `None` before
    /// it was measured.
    ahead_ns: Option<u64>,
    /// The same of the last sample; `None` without one since the queue was empty, or without a timestamp.
    newest_ns: Option<u64>,
}

impl PublicationTimes {
    /// When a sample with this timestamp was published that is read now.
    fn of(&mut self, timestamp_ns: u64, now: u64) -> u64 {
        self.newest_ns = (timestamp_ns != 0).then(|| now.wrapping_sub(timestamp_ns));
        match self.ahead_ns.filter(|_| timestamp_ns != 0) {
            Some(ahead_ns) => timestamp_ns.wrapping_add(ahead_ns).clamp(self.empty_ns.min(now), now),
            None => now,
        }
    }

    /// The queue is empty.
    fn drained(&mut self, now: u64) {
        self.empty_ns = now;
        self.ahead_ns = self.newest_ns.take().or(self.ahead_ns);
    }
}

/// Copies a sample out of shared memory, and returns its place.
fn taken<T: Payload>(sample: Incoming<T>) -> T {
    let copy = copied(&*sample);
    T::give_back(sample);
    copy
}

/// `CLOCK_MONOTONIC` to within some milliseconds \[ns\]: it costs a reader that spins less.
fn coarse_ns() -> u64 {
    let now = clock_gettime(ClockId::MonotonicCoarse);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// Makes a caller's descriptor readable while the event is raised. It forgets an event that is closed by itself.
fn watch(descriptor: &OwnedFd, arrival: &ArrivalEvent) -> Result<(), ConnectError> {
    let added = epoll::add(descriptor, arrival.descriptor(), epoll::EventData::new_u64(0), epoll::EventFlags::IN);
    added.map_err(|error| ConnectError::transport("watching the event of the increments", error))
}

impl Reader<CompensatedIncrement> {
    /// A descriptor for `poll`, `epoll` and the like: readable when increments may have come. Then call
    /// [`receive`](Self::receive) until it returns `None`, which makes it unreadable, at most 5 ms later where the
    /// notification came late. It stays the same as long as the reader.
    ///
    /// Wait for at most some 100 ms at once, and call `receive` after that too: a notification can be lost.
    ///
    /// # Errors
    /// [`ConnectError::NoService`] while the reader is not connected, and where no event signals increments, as in the
    /// domain of a relay; if the process cannot wait.
    pub fn descriptor(&mut self) -> Result<BorrowedFd<'_>, ConnectError> {
        self.listen()?;
        let descriptor = match self.descriptor.take() {
            Some(descriptor) => descriptor,
            None => {
                let no_service = || ConnectError::NoService(self.domain.name().to_owned());
                let arrival = self.arrival().ok_or_else(no_service)?;
                let failed = |error| ConnectError::transport("making a descriptor", error);
                let descriptor = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(failed)?;
                watch(&descriptor, arrival)?;
                descriptor
            }
        };
        let descriptor: &OwnedFd = self.descriptor.insert(descriptor);
        Ok(descriptor.as_fd())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::sequence::Period;

    const MS: u64 = 1_000_000;

    /// A logger that reads every 0.5 s, of sessions of 1 kHz. The second one begins 0.3 s after the end of the first,
    /// by a clock that goes on, has been set by some seconds, or begins anew.
    #[test]
    fn a_reader_that_reads_seldom_counts_the_periods_between_sessions() {
        for (shift_ns, lost) in [(0, Some(300)), (3_000 * MS, None), (u64::MAX - 1_000_000 * MS, None)] {
            let published = (0..2_600).chain(2_900..6_000).map(|ms| {
                let (session, shift_ns) = if ms < 2_600 { (1, 0) } else { (2, shift_ns) };
                let timestamp_ns = (1_000_000 + ms) * MS;
                let timestamp_ns = timestamp_ns.wrapping_add(shift_ns);
                (ms * MS + 50 * MS, Period { session, sequence: ms, timestamp_ns, interval_ns: MS })
            });
            for pause_ms in [1, 100, 500] {
                let (mut times, mut order) = (PublicationTimes::default(), SequenceTracker::default());
                let (mut queue, mut found) = (published.clone().peekable(), None);
                for now in (0..7_000).step_by(pause_ms).map(|ms| ms * MS) {
                    while let Some((_, period)) = queue.next_if(|(published, _)| *published <= now) {
                        let at_ns = times.of(period.timestamp_ns, now);
                        let arrival = order.note(Seen { period, at_ns });
                        if arrival.begins && period.session == 2 {
                            found = Some(arrival.lost());
                        }
                    }
                    times.drained(now);
                }
                assert_eq!(found, Some(lost), "{shift_ns} ns, read every {pause_ms} ms");
            }
        }
    }

    #[test]
    fn without_timestamps_and_before_a_measurement_the_time_is_that_of_reading() {
        let mut times = PublicationTimes::default();
        assert_eq!([times.of(5, 100), times.of(6, 100)], [100; 2]);
        times.drained(100);
        assert_eq!([times.of(7, 150), times.of(40, 150), times.of(u64::MAX, 150)], [101, 134, 100]);
        assert_eq!(times.of(0, 170), 170);
        times.drained(200);
        assert_eq!(times.of(10, 300), 200, "the last sample had no timestamp, and the clock of before goes on");
    }
}
