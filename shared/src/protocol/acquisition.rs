//! An acquisition's part of the protocol: which samples wait for an answer, which answer leaves next, and when which
//! samples are sent again.

use super::pending::Pending;
use crate::sequence::rises;
use std::collections::VecDeque;

/// Pause between two checks of the service while samples are unanswered.
const CHECK_NS: u64 = 5_000_000;
/// After this many polls that found nothing the clock is read, to find out whether a check is due.
const EMPTY_POLLS: u32 = 16;
/// If no answer comes for this long, something is sent again even to the same service; then after twice as long, and so
/// on. A service that is only stopped gets few repeats in its queue this way.
const SILENCE_NS: u64 = 1_000_000_000;
/// Samples that later answers have overtaken are sent again at once, and once more after this part of that pause.
const OVERTAKEN_PART: u64 = 10;
/// Repeats of single samples, after silences, that the service's queue has room for.
const SINGLE_REPEATS: usize = 4;

/// No service has this id.
const NO_SERVICE: u128 = 0;

/// Raw samples that the service's queue holds if `depth` samples may be in flight. There is room for each of them
/// twice: a new service finds those in its queue that were sent before the acquisition noticed it, and then all that
/// were sent again.
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

/// The state of an acquisition that sends samples `S` and receives answers `A`. Never allocates after construction,
/// except in
/// [`set_depth`](Self::set_depth).
#[derive(Clone, Debug)]
pub struct AcquisitionState<S, A> {
    session: u64,
    /// Of the last sample of this session that was [taken in](Self::take).
    last_sequence: Option<u64>,
    /// The highest number of this session that was loaned or sent.
    highest: Option<u64>,
    /// Numbers that were left out before the last sample, and samples whose sending has failed; in all sessions.
    lost: u64,
    pending: Pending<S, A>,
    /// Answers that came while another one was waited for, oldest first; at most `depth`.
    aside: VecDeque<A>,
    /// Answers for which there was no room among them.
    aside_dropped: u64,
    /// Samples that the service's queue holds.
    queue: usize,
    /// Id of the service that all pending samples were sent to.
    service: u128,
    empty_polls: u32,
    checked_ns: u64,
    /// Since when samples have been unanswered, no answer has come and nothing was sent again; updated by checks, so a
    /// few ms late.
    silent_since_ns: u64,
    /// Since when samples have been unanswered and no answer has come.
    unanswered_since_ns: u64,
    /// How long that may last before something is sent again.
    resend_after_ns: u64,
    /// When samples were last sent again to the same service.
    resent_ns: u64,
    /// Whether an answer has been handed out since the last check.
    progress: bool,
    /// What has been sent in addition to the samples in flight, since the beginning: repeats, and sends that failed.
    /// Each sample has this number of the moment when it was first sent as its mark.
    surplus: u64,
    /// How much of that the service has taken for certain. It takes in order, so an answer shows it for the mark of its
    /// sample.
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
    /// Begins a session with the service of this id, whose queue holds this many samples. At most `depth` samples, and
    /// at least one, can be unanswered.
    #[must_use]
    pub fn new(session: u64, depth: usize, queue: usize, service: u128) -> Self {
        Self {
            session,
            last_sequence: None,
            highest: None,
            lost: 0,
            pending: Pending::new(depth.max(1)),
            aside: VecDeque::with_capacity(depth.max(1)),
            aside_dropped: 0,
            queue: queue.max(1),
            service,
            empty_polls: 0,
            checked_ns: 0,
            silent_since_ns: 0,
            unanswered_since_ns: 0,
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

    /// The number for the next loan: one above the highest that was loaned or sent. After the highest number of 64 bits
    /// it stays.
    #[inline]
    #[must_use]
    pub const fn next_sequence(&self) -> u64 {
        match self.highest {
            Some(highest) => highest.saturating_add(1),
            None => 0,
        }
    }

    /// Gives a sample that is loaned now its number. If it is not sent, its number is left out, and the service reports
    /// the gap.
    #[inline]
    pub const fn loan(&mut self) -> u64 {
        let number = self.next_sequence();
        self.highest = Some(number);
        number
    }

    /// Takes the number of a loan back that stands for no control period. Only the last loan's: another one stays left
    /// out.
    pub fn cancel(&mut self, number: u64) {
        if self.highest == Some(number) && self.rises(number) {
            self.highest = number.checked_sub(1);
        }
    }

    /// Takes in a sample with this number, which rises: it is sent now, or waits and is sent later. Lower numbers that
    /// were not taken in are left out.
    #[inline]
    pub fn take(&mut self, sequence: u64) {
        self.lost = self.lost.saturating_add(self.left_out(sequence));
        self.last_sequence = Some(sequence);
        self.highest = self.highest.max(Some(sequence));
    }

    /// A sample that was taken in is lost before it was sent.
    pub const fn lose(&mut self) {
        self.lost = self.lost.saturating_add(1);
    }

    /// How many numbers a sample leaves out that is taken in now.
    #[inline]
    fn left_out(&self, sequence: u64) -> u64 {
        match self.last_sequence {
            Some(last) => sequence - last - 1,
            // The first may have any number. Up to the highest loaned, the lower ones were given to loans.
            None if self.highest >= Some(sequence) => sequence,
            None => 0,
        }
    }

    /// Control periods of all sessions that have a number and will not be sent: samples that were discarded or are
    /// still on loan, numbers that the user left out, samples that were dropped while they waited, and samples whose
    /// sending has failed.
    #[must_use]
    pub fn lost(&self) -> u64 {
        let after_last = match (self.highest, self.last_sequence) {
            (Some(highest), Some(last)) => highest - last,
            (Some(highest), None) => highest.saturating_add(1),
            (None, _) => 0,
        };
        self.lost.saturating_add(after_last)
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

    /// Whether no sample can be sent now: `depth` samples are in flight, or the service's queue may be full, which
    /// takes several restarts within a short time.
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
    pub fn begin_session(&mut self, session: u64) -> Result<(), usize> {
        match self.in_flight() {
            0 => {
                self.lost = self.lost();
                (self.session, self.last_sequence, self.highest) = (session, None, None);
                Ok(())
            }
            in_flight => Err(in_flight),
        }
    }

    /// Whether a sample with this sequence may be [taken in](Self::take): it is above the last one.
    #[inline]
    #[must_use]
    pub const fn rises(&self, sequence: u64) -> bool {
        rises(self.last_sequence, sequence)
    }

    /// Whether a sample with this sequence may be taken in and sent now.
    ///
    /// # Errors
    /// Why not.
    #[inline]
    pub const fn may_send(&self, sequence: u64) -> Result<(), Refusal> {
        if self.is_full() {
            Err(Refusal::Full)
        } else if self.rises(sequence) {
            Ok(())
        } else {
            Err(Refusal::Sequence)
        }
    }

    /// Keeps a copy of a sample that is sent now, after [`take`](Self::take) and while there is room
    /// ([`is_full`](Self::is_full)). Returns the copy.
    #[inline]
    pub fn send(&mut self, sequence: u64, sample: &S, now: u64) -> &mut S {
        if self.pending.len() == 0 {
            (self.silent_since_ns, self.unanswered_since_ns) = (now, now);
            self.resend_after_ns = SILENCE_NS;
        }
        self.pending.push(sequence, self.surplus, sample)
    }

    /// Takes the last [`send`](Self::send) back: the transport failed, and the caller informs its user. Some receivers
    /// may have got the sample, so no other sample gets its sequence.
    pub const fn send_failed(&mut self) {
        self.pending.pop_newest();
        self.surplus += 1;
        self.lost = self.lost.saturating_add(1);
    }

    /// Keeps an answer that was handed out while the caller waits for a later one. If `depth` of them are kept, the
    /// oldest is dropped.
    pub fn keep_aside(&mut self, answer: A) {
        if self.aside.len() >= self.depth() {
            self.aside.pop_front();
            self.aside_dropped += 1;
        }
        self.aside.push_back(answer);
    }

    /// The oldest answer that was kept aside.
    #[inline]
    pub fn next_aside(&mut self) -> Option<A> {
        self.aside.pop_front()
    }

    /// Takes the answer that is kept aside and fits, if there is one.
    pub fn take_aside(&mut self, fits: impl Fn(&A) -> bool) -> Option<A> {
        let place = self.aside.iter().position(fits)?;
        self.aside.remove(place)
    }

    /// Answers that are kept aside.
    #[must_use]
    pub fn aside(&self) -> usize {
        self.aside.len()
    }

    /// Answers that were dropped because too many were kept aside.
    #[must_use]
    pub const fn aside_dropped(&self) -> u64 {
        self.aside_dropped
    }

    /// The next answer that came before the answer to an earlier sample, if it may leave now.
    #[inline]
    pub fn next_kept(&mut self) -> Option<A> {
        let answer = self.pending.pop_answered();
        self.progress |= answer.is_some();
        answer
    }

    /// An answer has come. True: it is the answer to the oldest sample, and the caller hands it out. False: it is kept
    /// until then, or ignored because it is a repeat or of another session.
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
            (self.silent_since_ns, self.unanswered_since_ns) = (now, now);
            self.resend_after_ns = SILENCE_NS;
            return false;
        }
        self.pending.len() > 0
    }

    /// What is sent again now that the service with this id is seen. The caller sends [`samples`](Self::samples), then
    /// calls [`resent`](Self::resent).
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

    /// The samples of a resend, oldest first. Those whose answers wait for an earlier answer are among them: without
    /// them a new service would report a gap.
    pub fn samples(&self, resend: Resend) -> impl Iterator<Item = &S> {
        self.pending.samples(self.pending.len() - self.count(resend))
    }

    /// The places of the samples that are unanswered, and of others.
    pub fn places_mut(&mut self) -> impl Iterator<Item = &mut S> {
        self.pending.places_mut()
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

    /// Whether this is the service that all samples in flight were sent to.
    #[must_use]
    pub const fn is_known(&self, service: u128) -> bool {
        self.service == service
    }

    /// Another service is there, or the streams were joined anew: at most `depth` samples, and at least one, can be
    /// unanswered from now on, and the queue of the service holds this many. Returns the newest unanswered samples that
    /// have no place any more, oldest first: they wait again. Allocates.
    pub fn set_depth(&mut self, depth: usize, queue: usize) -> Vec<S> {
        self.queue = queue.max(1);
        if self.depth() == depth.max(1) { Vec::new() } else { self.pending.resize(depth.max(1)) }
    }

    /// The streams were joined anew, with other ports: nothing that was sent before is certain to be in the service's
    /// queue, which has room for it all. Everything that is unanswered is sent again.
    pub const fn rejoined(&mut self, now: u64) {
        self.service = NO_SERVICE;
        self.surplus_taken = self.surplus;
        self.silent_since_ns = now;
    }

    /// How long samples have been unanswered and no answer has come, at this time \[ns\]; 0 while none is unanswered.
    /// It is updated by checks, so a few ms late.
    #[must_use]
    pub const fn silence_ns(&self, now: u64) -> u64 {
        if self.pending.len() == 0 { 0 } else { now.saturating_sub(self.unanswered_since_ns) }
    }

    /// For the search: everything but times, and what only decides when they are looked at.
    #[cfg(test)]
    pub(super) fn hash_untimed(&self, hasher: &mut impl core::hash::Hasher) {
        use core::hash::Hash as _;
        let room = |mark: u64| (self.surplus - mark).min(self.queue as u64);
        (self.session, self.last_sequence, self.highest, self.service, room(self.surplus_taken)).hash(hasher);
        self.pending.marks().for_each(|mark| room(mark).hash(hasher));
        self.pending.keys().for_each(|key| key.hash(hasher));
        self.pending.len().hash(hasher);
    }

    /// For the search: how long after an answer or a resend a check may send overtaken samples again, and how long the
    /// newest.
    #[cfg(test)]
    pub(super) const fn pauses_ns(&self) -> [u64; 2] {
        [self.resend_after_ns / OVERTAKEN_PART + CHECK_NS, self.resend_after_ns.saturating_add(CHECK_NS)]
    }

    /// For the search: sequence of each sample in flight, oldest first, and whether its answer has come.
    #[cfg(test)]
    pub(super) fn keys(&self) -> impl Iterator<Item = (u64, bool)> {
        self.pending.keys()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> AcquisitionState<(), u64> {
        AcquisitionState::new(1, 2, queue_depth(2), 1)
    }

    fn send(state: &mut AcquisitionState<(), u64>, sequence: u64) {
        state.take(sequence);
        state.send(sequence, &(), 0);
    }

    #[test]
    fn what_waits_is_not_lost_until_it_is_dropped() {
        let mut state = state();
        (0..4).for_each(|_| _ = state.loan());
        (0..4).for_each(|number| state.take(number));
        assert_eq!((state.lost(), state.may_send(3)), (0, Err(Refusal::Sequence)));
        state.lose();
        state.send(1, &(), 0);
        assert_eq!((state.lost(), state.in_flight()), (1, 1));
    }

    #[test]
    fn a_smaller_depth_leaves_the_oldest_in_flight_and_a_larger_one_all() {
        let mut state = AcquisitionState::<u64, u64>::new(1, 4, queue_depth(4), 1);
        for sequence in 0..4 {
            state.take(sequence);
            state.send(sequence, &sequence, 0);
        }
        assert!(!state.answered(1, 1, &1) && !state.answered(1, 3, &3));
        assert_eq!(state.set_depth(2, queue_depth(2)), [2, 3]);
        assert_eq!(state.keys().collect::<Vec<_>>(), [(0, false), (1, true)]);
        assert!(state.is_full() && state.answered(1, 0, &0));
        assert_eq!(state.next_kept(), Some(1));
        assert_eq!((state.set_depth(8, queue_depth(8)).len(), state.depth(), state.in_flight()), (0, 8, 0));
    }

    #[test]
    fn a_loan_has_one_above_the_highest_that_was_loaned_or_sent() {
        let mut state = state();
        assert_eq!([state.loan(), state.loan()], [0, 1]);
        send(&mut state, 0);
        assert_eq!(state.loan(), 2, "1 is on loan, or was dropped");
        send(&mut state, 40);
        assert_eq!(state.loan(), 41, "the user has raised a sequence");
        state.cancel(40);
        state.cancel(2);
        assert_eq!(state.loan(), 42, "only the last loan's number is taken back");
        state.cancel(42);
        assert_eq!(state.loan(), 42);
        let mut state = self::state();
        state.loan();
        state.cancel(0);
        assert_eq!(state.loan(), 0);
        send(&mut state, u64::MAX);
        assert_eq!(state.loan(), u64::MAX, "sequences do not wrap");
        state.cancel(u64::MAX);
        assert_eq!(state.may_send(u64::MAX), Err(Refusal::Sequence), "what was sent cannot be cancelled");
    }

    #[test]
    fn numbers_that_were_not_sent_are_lost() {
        let mut state = state();
        (0..3).for_each(|_| _ = state.loan());
        assert_eq!(state.lost(), 3);
        send(&mut state, 2);
        assert_eq!(state.lost(), 2);
        state.answered(1, 2, &2);
        send(&mut state, 7);
        assert_eq!(state.lost(), 6);
        state.send_failed();
        state.loan();
        assert_eq!(state.lost(), 8);
        state.begin_session(2).unwrap();
        state.loan();
        send(&mut state, 1000);
        assert_eq!(state.lost(), 8, "a session may begin anywhere");
        state.loan();
        state.cancel(1001);
        assert_eq!(state.lost(), 8);
    }

    #[test]
    fn the_newest_answers_are_kept_aside() {
        let mut state = state();
        (1..=5).for_each(|answer| state.keep_aside(answer));
        assert_eq!((state.aside(), state.aside_dropped(), state.in_flight(), state.is_full()), (2, 3, 0, false));
        assert_eq!([state.take_aside(|answer| *answer == 5), state.take_aside(|answer| *answer == 3)], [Some(5), None]);
        assert_eq!([state.next_aside(), state.next_aside()], [Some(4), None]);
    }
}
