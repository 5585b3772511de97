//! The way to the service: what is decoded is sent in order. What the service has no room for waits in the acquisition,
//! half a minute of it; what comes before there is a service, or before a session may begin, waits here.

use crate::note::{AcquisitionNote, KeptLag};
use crate::recorder::Recorder;
use isotherm_client::{Acquisition, ConnectError, ImuId, Options, RawSample, monotonic_ns};
use isotherm_shared::wire::Flags;
use isotherm_support::failure::{Exit, Failure, tell};
use serde::Serialize;
use std::collections::VecDeque;
use std::hash::{BuildHasher as _, RandomState};
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// How long samples are kept for a service that does not take them, and while none was there yet: then their session
/// has no number, and they are recorded late.
const KEPT: Duration = Duration::from_secs(30);
const KEPT_UNCONNECTED: Duration = Duration::from_secs(1);
/// Samples that are kept at least, and at most: 4 MiB.
const KEPT_SAMPLES: RangeInclusive<usize> = 16..=16_384;
/// Pause between two attempts to reach the service.
const RETRY: Duration = Duration::from_millis(250);

/// What became of the samples.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct LinkCounts {
    /// Sent to the service.
    pub sent: u64,
    /// Answered by it.
    pub answered: u64,
    /// Answers with a sensor that is invalid.
    pub invalid: u64,
    /// Given up, since the service took none for half a minute.
    pub dropped: u64,
    /// Sent and not answered at the end: a gap for every reader, but for those that were answered all the same.
    pub unanswered: u64,
    /// Connections to the service.
    pub connections: u64,
}

/// A sample that waits, and the session that it belongs to.
struct QueuedSample {
    raw: RawSample,
    session: u64,
}

/// The samples before which a device was soaked, since it says that it was just powered: those of a session up to a
/// time.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SoakSpan {
    /// As counted from 1.
    pub(crate) session: u64,
    /// Of the samples \[ns\].
    pub(crate) until_ns: u64,
}

impl SoakSpan {
    fn contains(self, sample: &QueuedSample) -> bool {
        sample.session == self.session && sample.raw.timestamp_ns <= self.until_ns
    }
}

/// Goes on with the lag of before in a session that has just begun. Where that is not possible, the IMU is soaked or
/// its lag is not known.
fn resume(acquisition: &mut Acquisition, before: Option<KeptLag>, first: &RawSample, is_soaked: bool) {
    let lag_ns = acquisition.lag().state().lag_ns;
    match before.and_then(|before| before.resumed(first, lag_ns, monotonic_ns())) {
        Some(lag) => acquisition.lag().restore(&lag),
        None if is_soaked => acquisition.lag().soaked(),
        None => {
            acquisition.lag().forget();
            if lag_ns > 0 {
                let seconds = 3.0 * lag_ns as f64 / 1e9;
                tell(
                    "isotherm",
                    format!(
                        "what the temperatures were before is not known: increments are flagged lag-unknown for {seconds:.0} s"
                    ),
                );
            }
        }
    }
}

/// The sample that the lag of an acquisition has followed last.
#[derive(Clone, Copy, Default)]
struct LastSample {
    /// Its time \[ns\].
    sample_ns: u64,
    /// When it was followed \[ns\].
    sent_ns: u64,
}

impl LastSample {
    fn now(raw: &RawSample) -> Self {
        Self { sample_ns: raw.timestamp_ns, sent_ns: monotonic_ns() }
    }

    /// The lag of an acquisition after this sample.
    fn lag(self, acquisition: &mut Acquisition) -> KeptLag {
        KeptLag { lag: *acquisition.lag().state(), sample_ns: self.sample_ns, sent_ns: self.sent_ns }
    }
}

/// How many samples are kept.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
struct QueueLimits {
    /// For a service that does not take them.
    connected: usize,
    /// While no service was there yet.
    unconnected: usize,
}

impl QueueLimits {
    /// For samples that come at this interval; `None`: without a limit.
    fn new(interval_ns: Option<u64>) -> Self {
        let samples = |time: Duration| {
            interval_ns.map_or(usize::MAX, |interval_ns| {
                let samples = (time.as_nanos() as u64 / interval_ns.max(1)) as usize;
                samples.clamp(*KEPT_SAMPLES.start(), *KEPT_SAMPLES.end())
            })
        };
        Self { connected: samples(KEPT), unconnected: samples(KEPT_UNCONNECTED) }
    }
}

/// A random number for a first session.
pub(crate) fn any_session() -> u64 {
    RandomState::new().hash_one(monotonic_ns())
}

/// The acquisition, and the samples that wait for it.
pub(crate) struct Link {
    imu: ImuId,
    /// The exit code if the samples cannot be those of the table.
    contradiction: Exit,
    options: Options,
    acquisition: Option<Acquisition>,
    waiting: VecDeque<QueuedSample>,
    limits: QueueLimits,
    /// Whether samples come at their time. Others wait for the service, and are sent as fast as it takes them.
    is_live: bool,
    /// The session of the samples that were sent last on this connection, as counted here; 0 before.
    session: u64,
    /// The number of session 1 for samples of which none of their session was sent.
    first: u64,
    next_attempt: Instant,
    since: Instant,
    give_up: Option<Duration>,
    /// The last message on why the acquisition waits for the service.
    told_cause: Option<String>,
    /// For the successor of this process; `None` for a source that is no device.
    note: Option<AcquisitionNote>,
    /// The lag of the process before this one, or of the last connection, until a session goes on with it.
    lag: Option<KeptLag>,
    last: LastSample,
    /// Where the device is taken to be soaked.
    pub(crate) soaked: SoakSpan,
    pub(crate) sent: LinkCounts,
    /// To the acquisition, less those that it has dropped: they were sent, or wait.
    handed_over: u64,
    /// The interval for which readings become pulses \[ns\]: that of the table, once one is known.
    pub(crate) pulse_ns: u64,
    pub(crate) recorder: Option<Recorder>,
}

impl Link {
    /// `contradiction` is the exit code if the samples cannot be those of the table. `interval_ns` is that of samples
    /// which come at their time; `None`: they wait for the service, all of them.
    pub(crate) fn new(
        (imu, contradiction): (ImuId, Exit),
        options: Options,
        interval_ns: Option<u64>,
        note: Option<AcquisitionNote>,
        recorder: Option<Recorder>,
    ) -> Self {
        let limits = QueueLimits::new(interval_ns);
        let give_up = Some(options.timeout).filter(|timeout| !timeout.is_zero());
        let now = Instant::now();
        Self {
            imu,
            contradiction,
            pulse_ns: options.pulses.map_or(0, |pulses| pulses.interval_ns),
            options: Options {
                timeout: Duration::ZERO,
                kept: limits.connected.min(isotherm_client::MOST_KEPT),
                ..options
            },
            acquisition: None,
            waiting: VecDeque::with_capacity(interval_ns.map_or(0, |_| limits.unconnected + 1)),
            limits,
            is_live: interval_ns.is_some(),
            session: 0,
            first: any_session(),
            next_attempt: now,
            since: now,
            give_up,
            told_cause: None,
            lag: note.as_ref().and_then(AcquisitionNote::lag),
            note,
            last: LastSample::default(),
            soaked: SoakSpan::default(),
            sent: LinkCounts::default(),
            handed_over: 0,
            recorder,
        }
    }

    /// Takes the next sample. Sessions are counted from 1.
    pub(crate) fn take(&mut self, raw: RawSample, session: u64) {
        self.waiting.push_back(QueuedSample { raw, session });
        let limit = if self.acquisition.is_some() { self.limits.connected } else { self.limits.unconnected };
        while self.waiting.len() > limit {
            let Some(lost) = self.waiting.pop_front() else { return };
            self.sent.dropped += 1;
            if let Some(acquisition) = self.acquisition.as_mut().filter(|_| self.session != 0) {
                acquisition.lag().follow(&lost.raw);
                self.last = LastSample::now(&lost.raw);
            }
            self.record(&lost);
        }
    }

    /// Whether samples wait for room, or for the service.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty() || self.acquisition.as_ref().is_some_and(|acquisition| acquisition.kept() > 0)
    }

    /// Whether everything was sent and answered, or nobody is there to do it.
    pub(crate) fn is_done(&self) -> bool {
        let Some(acquisition) = &self.acquisition else { return true };
        self.waiting.is_empty() && acquisition.kept() == 0 && acquisition.in_flight() == 0
    }

    /// Sends what can be sent, and takes the answers that are there. Never waits.
    ///
    /// # Errors
    /// If the service cannot be reached by waiting, or was not for the time that it may take.
    pub(crate) fn pump(&mut self) -> Result<(), Failure> {
        if self.acquisition.is_none() {
            self.connect()?;
        }
        self.exchange();
        Ok(())
    }

    /// A failure of the transport is a silence here, which has the acquisition join its streams anew.
    fn exchange(&mut self) {
        let Some(acquisition) = &mut self.acquisition else { return };
        loop {
            while let Ok(Some(answer)) = acquisition.receive() {
                self.sent.answered += 1;
                self.sent.invalid += u64::from(Flags(answer.flags).intersects(Flags::INVALID));
            }
            let _ = acquisition.send_kept();
            self.sent.sent = self.handed_over - acquisition.kept();
            if let Some(pulse_ns) = acquisition.pulse_interval().filter(|pulse_ns| *pulse_ns != self.pulse_ns)
                && let Some(pulses) = self.options.pulses
            {
                // What waits gets the pulses of the table in force.
                self.waiting.iter_mut().for_each(|sample| pulses.rescale(&mut sample.raw, self.pulse_ns, pulse_ns));
                self.pulse_ns = pulse_ns;
            }
            let Some(next) = self.waiting.front().filter(|_| self.is_live || !acquisition.is_full()) else { return };
            if next.session != self.session {
                let before = if self.session == 0 { self.lag } else { Some(self.last.lag(acquisition)) };
                if acquisition.begin_session().is_err() {
                    // Not before the last session is answered.
                    return;
                }
                (self.session, self.lag) = (next.session, None);
                if self.note.is_some() {
                    resume(acquisition, before, &next.raw, self.soaked.contains(next));
                } else {
                    // As in a recording.
                    acquisition.lag().soaked();
                }
            }
            acquisition.lag().follow(&next.raw);
            self.last = LastSample::now(&next.raw);
            let mut sent = next.raw;
            acquisition.complete(&mut sent);
            let Ok(loan) = acquisition.loan_record(&next.raw) else { return };
            let drops_oldest = acquisition.kept() >= self.limits.connected as u64;
            let handed_over = if self.is_live { acquisition.keep(loan) } else { acquisition.send(loan) };
            match handed_over {
                Ok(()) => {
                    // The newest waits in the place of one that was counted.
                    let count = if drops_oldest { &mut self.sent.dropped } else { &mut self.handed_over };
                    *count += 1;
                    if let Some(note) = &mut self.note {
                        note.keep(&self.last.lag(acquisition));
                    }
                }
                // It cannot be sent any more, so readers see a gap.
                Err(error) => {
                    self.sent.dropped += 1;
                    tell("isotherm", format!("sample {} is lost: {error}", next.raw.sequence));
                }
            }
            self.waiting.pop_front();
            if let Some(recorder) = &mut self.recorder {
                recorder.take(&sent);
            }
        }
    }

    fn connect(&mut self) -> Result<(), Failure> {
        let now = Instant::now();
        if now < self.next_attempt {
            return Ok(());
        }
        let error = match Acquisition::connect(&self.imu, &self.options) {
            Ok(acquisition) => {
                tell("isotherm", format!("connected to the service as the acquisition of {}", self.imu));
                self.acquisition = Some(acquisition);
                // The next sample begins a session, and goes on with the lag.
                self.session = 0;
                self.sent.connections += 1;
                self.told_cause = None;
                return Ok(());
            }
            Err(error) => error,
        };
        self.next_attempt = Instant::now() + RETRY;
        let goes_on = self.sent.sent > 0 || self.note.as_ref().is_some_and(AcquisitionNote::has_sent);
        let is_over = error.is_permanent() && !goes_on;
        if is_over || self.give_up.is_some_and(|longest| now - self.since > longest) {
            let exit = match error {
                ConnectError::Pulses { .. } => self.contradiction,
                _ => return Err(error.into()),
            };
            return Err(Failure::new(exit, error.to_string()));
        }
        let text = error.to_string();
        // A service that starts is there within this time.
        let is_soon = now - self.since < Duration::from_millis(500) && !matches!(error, ConnectError::NoService(_));
        if !is_soon && self.told_cause.as_ref() != Some(&text) {
            tell("isotherm", format!("waiting: {text}"));
            self.told_cause = Some(text);
        }
        Ok(())
    }

    /// Records a sample that was never sent. If the service has not seen its session, that has a number of its own:
    /// sequences rise within a session, in a record too.
    fn record(&mut self, lost: &QueuedSample) {
        let begun = self.acquisition.as_ref().filter(|_| lost.session == self.session);
        let session = begun.map_or(self.first.wrapping_add(lost.session), Acquisition::session);
        if let Some(recorder) = &mut self.recorder {
            recorder.take(&RawSample { session, ..lost.raw });
        }
    }

    /// Ends the link: what still waits is dropped. Returns how many samples that are, or were not answered.
    pub(crate) fn close(&mut self) -> u64 {
        let mut lost = 0;
        while let Some(next) = self.waiting.pop_front() {
            self.sent.dropped += 1;
            lost += 1;
            self.record(&next);
        }
        let of_session = self.acquisition.as_mut().filter(|_| self.session != 0);
        if let (Some(note), Some(acquisition)) = (&mut self.note, of_session) {
            note.end(&self.last.lag(acquisition));
        }
        let Some(acquisition) = self.acquisition.take() else { return lost };
        let (kept, unanswered) = (acquisition.kept(), acquisition.close().unanswered);
        self.sent.sent = self.handed_over - kept;
        self.sent.dropped += kept;
        self.sent.unanswered = unanswered;
        lost + kept + unanswered
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_client::Domain;

    #[test]
    fn what_is_kept_is_bounded_in_time_and_number() {
        let of_interval = |interval_ns| {
            let options = Options::new(Domain::new("none", "/tmp/none").unwrap(), Duration::ZERO);
            Link::new(("imu-a".parse().unwrap(), Exit::Config), options, Some(interval_ns), None, None)
        };
        let limits = [3_000_000_000, 2_500_000, 100_000].map(|ns| of_interval(ns).limits);
        let expected = [(16, 16), (12_000, 400), (16_384, 10_000)];
        assert_eq!(limits, expected.map(|(connected, unconnected)| QueueLimits { connected, unconnected }));
        let mut link = of_interval(3_000_000_000);
        (0..20).for_each(|sequence| link.take(RawSample { sequence, ..RawSample::default() }, 1));
        assert_eq!((link.sent.dropped, link.waiting.front().unwrap().raw.sequence), (4, 4));
    }
}
