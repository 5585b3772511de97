//! An acquisition's part of the protocol: which samples wait for an answer, which answer leaves next, and when which samples are
//! sent again.

use super::pending::Pending;
use crate::sequence::rises;

/// Pause between two checks of the service while samples are unanswered.
const CHECK_NS: u64 = 5_000_000;
/// After this many polls that found nothing the clock is read, to find out whether a check is due.
const EMPTY_POLLS: u32 = 16;
/// If no answer comes for this long, something is sent again even to the same service; then after twice as long, and so on. A
/// service that is only stopped gets few repeats in its queue this way.
const SILENCE_NS: u64 = 1_000_000_000;
/// Samples that later answers have overtaken are sent again at once, and once more after this part of that pause.
const OVERTAKEN_PART: u64 = 10;
/// Repeats of single samples, after silences, that the service's queue has room for.
const SINGLE_REPEATS: usize = 4;

/// Raw samples that the service's queue holds if `depth` samples may be in flight. There is room for each of them twice: a new
/// service finds those in its queue that were sent before the acquisition noticed it, and then all that were sent again.
#[must_use]
pub const fn queue_depth(depth: usize) -> usize {
    2 * depth + SINGLE_REPEATS
}

/// How many samples may be in flight with a queue of this depth: the reverse of [`queue_depth`], at least 1.
#[must_use]
pub const fn depth_in_flight(queue: usize) -> usize {
    let depth = queue.saturating_sub(SINGLE_REPEATS) / 2;
    if depth > 0 { depth } else { 1 }
}

/// The state of an acquisition that sends samples `S` and receives answers `A`. Never allocates after construction.
#[derive(Clone, Debug)]
pub struct AcquisitionState<S, A> {
    session: u64,
    /// Of the last sample of this session.
    last_sequence: Option<u64>,
    pending: Pending<S, A>,
    /// Samples that the service's queue holds.
    queue: usize,
    /// Id of the service that all pending samples were sent to.
    service: u128,
    empty_polls: u32,
    checked_ns: u64,
    /// Since when samples have been unanswered and no answer has come; updated by checks, so a few ms late.
    silent_since_ns: u64,
    /// How long that may last before something is sent again.
    resend_after_ns: u64,
    /// When samples were last sent again to the same service.
    resent_ns: u64,
    /// Whether an answer has been handed out since the last check.
    progress: bool,
    /// What has been sent beside the samples in flight, since the beginning: repeats, and sends that failed. Each sample has this number
    /// of the moment when it was first sent as its mark.
    surplus: u64,
    /// How much of that the service has taken for certain. It takes in order, so an answer shows it for the mark of its sample.
    surplus_taken: u64,
}

/// Why a sample is not sent.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Refusal {
    /// As many samples are unanswered as may be, or the service's queue may be full of samples that were sent again.
    Full,
    /// The sequence is not above that of the last sample.
    Sequence,
}

/// Which samples are sent again, in the order of their sequence.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Resend {
    /// All from the oldest unanswered one on.
    All,
    /// The newest.
    Newest,
}

impl<S: Copy + Default, A: Copy + Default> AcquisitionState<S, A> {
    /// Begins a session with the service of this id, whose queue holds this many samples. At most `depth` samples, and at least
    /// one, can be unanswered.
    #[must_use]
    pub fn new(session: u64, depth: usize, queue: usize, service: u128) -> Self {
        Self {
            session,
            last_sequence: None,
            pending: Pending::new(depth.max(1)),
            queue: queue.max(1),
            service,
            empty_polls: 0,
            checked_ns: 0,
            silent_since_ns: 0,
            resend_after_ns: SILENCE_NS,
            resent_ns: 0,
            progress: false,
            surplus: 0,
            surplus_taken: 0,
        }
    }

    /// The session of all samples.
    #[inline]
    #[must_use]
    pub const fn session(&self) -> u64 {
        self.session
    }

    /// The lowest sequence that the next sample may have; the highest number of 64 bits if there is none.
    #[inline]
    #[must_use]
    pub const fn next_sequence(&self) -> u64 {
        match self.last_sequence {
            Some(last) => last.saturating_add(1),
            None => 0,
        }
    }

    /// The most samples that can be unanswered at once.
    #[must_use]
    pub const fn depth(&self) -> usize {
        self.pending.depth()
    }

    /// Samples that have been sent and whose answers have not been handed out.
    #[inline]
    #[must_use]
    pub const fn in_flight(&self) -> usize {
        self.pending.len()
    }

    /// Whether no sample can be sent now: `depth` samples are in flight, or the service's queue may be full, which takes several
    /// restarts within a short time.
    #[inline]
    #[must_use]
    pub const fn is_full(&self) -> bool {
        // One sample can always be sent: its answer shows that the surplus is gone.
        let (in_flight, surplus) = (self.pending.len() as u64, self.surplus - self.surplus_taken);
        self.pending.is_full() || in_flight > 0 && in_flight + surplus >= self.queue as u64
    }

    /// Begins another session: the next sample may have any sequence.
    ///
    /// # Errors
    /// The number of samples in flight, if there are any.
    pub const fn begin_session(&mut self, session: u64) -> Result<(), usize> {
        match self.in_flight() {
            0 => {
                self.session = session;
                self.last_sequence = None;
                Ok(())
            }
            in_flight => Err(in_flight),
        }
    }

    /// Whether a sample with this sequence may be sent now.
    ///
    /// # Errors
    /// Why not.
    #[inline]
    pub const fn may_send(&self, sequence: u64) -> Result<(), Refusal> {
        if self.is_full() {
            Err(Refusal::Full)
        } else if rises(self.last_sequence, sequence) {
            Ok(())
        } else {
            Err(Refusal::Sequence)
        }
    }

    /// Keeps a copy of a sample that is sent now, after [`may_send`](Self::may_send).
    #[inline]
    pub fn send(&mut self, sequence: u64, sample: &S, now: u64) {
        if self.pending.len() == 0 {
            self.silent_since_ns = now;
            self.resend_after_ns = SILENCE_NS;
        }
        self.last_sequence = Some(sequence);
        self.pending.push(sequence, self.surplus, sample);
    }

    /// Takes the last [`send`](Self::send) back: the transport failed, and the caller tells its user. Some receivers may have got
    /// the sample, so no other sample gets its sequence.
    pub const fn send_failed(&mut self) {
        self.pending.pop_newest();
        self.surplus += 1;
    }

    /// The next answer that came before the answer to an earlier sample, if it may leave now.
    #[inline]
    pub fn next_kept(&mut self) -> Option<A> {
        let answer = self.pending.pop_answered();
        self.progress |= answer.is_some();
        answer
    }

    /// An answer has come. True: it is the answer to the oldest sample, and the caller hands it out. False: it is kept until then,
    /// or ignored because it is a repeat or of another session.
    #[inline]
    pub fn answered(&mut self, session: u64, sequence: u64, answer: &A) -> bool {
        if session != self.session {
            return false;
        }
        let (leaves, mark) = self.pending.accept(sequence, answer);
        self.surplus_taken = self.surplus_taken.max(mark);
        self.progress |= leaves;
        leaves
    }

    /// A poll has found nothing. True: the caller reads the clock and asks [`check_due`](Self::check_due).
    #[inline]
    pub const fn nothing_came(&mut self) -> bool {
        self.empty_polls = self.empty_polls.wrapping_add(1);
        self.pending.len() > 0 && self.empty_polls.is_multiple_of(EMPTY_POLLS)
    }

    /// Whether the caller looks which service is there and asks [`resend_due`](Self::resend_due).
    pub const fn check_due(&mut self, now: u64) -> bool {
        if now.saturating_sub(self.checked_ns) < CHECK_NS {
            return false;
        }
        self.checked_ns = now;
        // While answers come, no check is necessary. It would allocate memory in the transport.
        if self.progress {
            self.progress = false;
            self.silent_since_ns = now;
            self.resend_after_ns = SILENCE_NS;
            return false;
        }
        self.pending.len() > 0
    }

    /// What is sent again now that the service with this id is seen. The caller sends [`samples`](Self::samples), then calls
    /// [`resent`](Self::resent).
    #[must_use]
    pub fn resend_due(&self, service: u128, now: u64) -> Option<Resend> {
        let silent = || now.saturating_sub(self.silent_since_ns) > self.resend_after_ns;
        if service != self.service {
            Some(Resend::All)
        } else if self.pending.is_overtaken() {
            // The service answers in order. So an unanswered sample before an answered one never reached it.
            (now.saturating_sub(self.resent_ns) > self.resend_after_ns / OVERTAKEN_PART).then_some(Resend::All)
        } else {
            silent().then_some(Resend::Newest)
        }
    }

    /// The samples of a resend, oldest first. Those whose answers wait for an earlier answer are among them: without them a new
    /// service would report a gap.
    pub fn samples(&self, resend: Resend) -> impl Iterator<Item = &S> {
        self.pending.samples(self.pending.len() - self.count(resend))
    }

    const fn count(&self, resend: Resend) -> usize {
        match resend {
            Resend::Newest if self.pending.len() > 0 => 1,
            Resend::All | Resend::Newest => self.pending.len(),
        }
    }

    /// The resend is done.
    pub const fn resent(&mut self, resend: Resend, service: u128, now: u64) {
        // Not less with a new service: its queue may have existed before its publisher was seen.
        self.surplus += self.count(resend) as u64;
        if service == self.service {
            self.resend_after_ns = self.resend_after_ns.saturating_mul(2);
        }
        self.service = service;
        self.silent_since_ns = now;
        self.resent_ns = now;
    }

    /// For the search: everything but times, and what only decides when they are looked at.
    #[cfg(test)]
    pub(super) fn hash_untimed(&self, hasher: &mut impl core::hash::Hasher) {
        use core::hash::Hash as _;
        let room = |mark: u64| (self.surplus - mark).min(self.queue as u64);
        (self.session, self.last_sequence, self.service, room(self.surplus_taken)).hash(hasher);
        self.pending.marks().for_each(|mark| room(mark).hash(hasher));
        self.pending.keys().for_each(|key| key.hash(hasher));
        self.pending.len().hash(hasher);
    }

    /// For the search: how long after an answer or a resend a check may send overtaken samples again, and how long the newest.
    #[cfg(test)]
    pub(super) const fn pauses_ns(&self) -> [u64; 2] {
        [self.resend_after_ns / OVERTAKEN_PART + CHECK_NS, self.resend_after_ns.saturating_add(CHECK_NS)]
    }

    /// For the search: sequence of each sample in flight, oldest first, and whether its answer has come.
    #[cfg(test)]
    pub(super) fn keys(&self) -> impl Iterator<Item = (u64, bool)> {
        self.pending.keys()
    }

    /// For the search: whether this is the service that all samples in flight were sent to.
    #[cfg(test)]
    pub(super) const fn is_known(&self, service: u128) -> bool {
        self.service == service
    }
}
