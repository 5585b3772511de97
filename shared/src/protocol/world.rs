//! A small world for the search: one acquisition, one service at a time, one reader, and the transport's queues between
//! them. All decisions are the protocol's own; the world only carries out what the ports carry out.
//!
//! Time: a check of the service comes either soon, or after a silence that is long enough for a resend. Between looking
//! up the service and each sample of a resend, every other process may do something.
//!
//! Over 400 lines: every step works on the same state.

use crate::protocol::acquisition::{AcquisitionState, Refusal, Resend};
use crate::protocol::reader::ReaderState;
use crate::protocol::service::{LastSession, SequenceTracker};
use crate::sequence::{Period, Seen};
use std::collections::VecDeque;
use std::hash::{Hash, Hasher};

/// How large the world is, and how often each fault may happen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Samples that are sent, in all sessions.
    pub samples: u8,
    /// Samples that may be in flight.
    pub depth: usize,
    /// Samples that the service's queue holds.
    pub queue: usize,
    /// Answers that the acquisition's queue holds; a full queue overwrites the oldest.
    pub answers: usize,
    /// Resends to a service that is not new.
    pub resends: u8,
    pub service_kills: u8,
    pub acquisition_kills: u8,
    /// A session is begun without a restart.
    pub new_sessions: u8,
    /// A sample is lost between acquisition and service, as if the queue had overflowed.
    pub lost_samples: u8,
    /// The service takes a sample and cannot publish the increment.
    pub lost_answers: u8,
    /// The transport reports to the acquisition that a send has failed, whether or not the service has got the sample.
    pub failed_sends: u8,
    /// The user leaves a sequence out.
    pub skips: u8,
    /// Samples that the user may have on loan while it does something else, and then send, discard or cancel. With
    /// loans, every session begins with sequence 0.
    pub loans: usize,
    /// Whether there is a reader. It comes at any time.
    pub reader: bool,
    /// The shared memory of all is removed. Those that have it go on with it until each joins anew.
    pub removals: u8,
    /// The acquisition joins anew though nothing was removed.
    pub rejoins: u8,
}

/// What is broken on purpose, to show that the search finds it.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Mutation {
    /// A resend leaves out what has been answered.
    ResendsUnansweredOnly,
    /// After a silence the oldest sample is sent again, not the newest.
    SilenceRepeatsOldest,
    /// Only those overtaken samples are sent again that have no answer, not what follows them.
    ResendsOvertakenOnly,
    /// Nothing is sent again.
    NeverResends,
    /// A resend has only the newest sample.
    ResendsNewestOnly,
    /// The acquisition hands out every answer of its session as it comes.
    HandsOutAtOnce,
    /// The reader returns whatever comes.
    ReaderForgets,
    /// The service does not look at the session.
    OneSession,
    /// The acquisition does not count what else may lie in the service's queue.
    IgnoresSurplus,
    /// A loan that is discarded gives its number to the next one.
    DiscardingCancels,
    /// Cancelling a loan also takes back the number of one that was loaned before the last.
    CancelsAnyNumber,
    /// A service does not know which session the one before has served.
    ForgetsSessions,
    /// A service takes each session for a new one.
    EverySessionIsNew,
}

/// Something that one of the processes does, or a fault.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Step {
    Send,
    SendSkipping,
    SendIsLost,
    SendFails {
        reached: bool,
    },
    /// The user takes a sample on loan and keeps it.
    Loan,
    /// It sends the oldest or the newest sample on loan, discards it, or cancels it.
    SendLoaned(End),
    Discard(End),
    Cancel(End),
    Receive,
    CheckSoon,
    CheckAfterSilence,
    ResendOne,
    BeginSession,
    KillAcquisition,
    Serve,
    ServeWithoutPublishing,
    /// The service notes which session it has served last, for the next service.
    Note,
    KillService,
    /// A dead service is removed from the list of publishers.
    CleanUp,
    /// A new service creates its end of the raw stream.
    Subscribe,
    /// A new service creates its increment publisher and begins to serve.
    Publish,
    ReaderJoins,
    ReaderTakes,
    /// Somebody removes the shared memory.
    Remove,
    /// The service notices that, and ends to begin anew.
    BeginAnew,
    /// The acquisition notices that, or that it gets no answers, and joins anew.
    Rejoin,
    ReaderRejoins,
}

/// Which of the samples on loan.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum End {
    Oldest,
    Newest,
}

const STEPS: [Step; 31] = [
    Step::Send,
    Step::Loan,
    Step::SendLoaned(End::Oldest),
    Step::SendLoaned(End::Newest),
    Step::Discard(End::Oldest),
    Step::Discard(End::Newest),
    Step::Cancel(End::Oldest),
    Step::Cancel(End::Newest),
    Step::SendSkipping,
    Step::SendIsLost,
    Step::SendFails { reached: false },
    Step::SendFails { reached: true },
    Step::Receive,
    Step::CheckSoon,
    Step::CheckAfterSilence,
    Step::ResendOne,
    Step::BeginSession,
    Step::KillAcquisition,
    Step::Serve,
    Step::ServeWithoutPublishing,
    Step::Note,
    Step::KillService,
    Step::CleanUp,
    Step::Subscribe,
    Step::Publish,
    Step::ReaderJoins,
    Step::ReaderTakes,
    Step::Remove,
    Step::BeginAnew,
    Step::Rejoin,
    Step::ReaderRejoins,
];

#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
enum Phase {
    Dead,
    /// Its end of the raw stream exists, its increment publisher does not.
    Subscribed,
    Ready,
}

#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
struct Key {
    /// Which port sent it; each has a queue of its own.
    port: u8,
    session: u8,
    sequence: u8,
}

/// A set of the samples of all sessions: a session is a byte, a sequence a bit of 16.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
struct Samples([u16; 4]);

impl Samples {
    fn insert(&mut self, session: u8, sequence: u8) -> bool {
        let known = self.contains(session, sequence);
        self.0[usize::from(session)] |= 1 << sequence;
        !known
    }

    fn remove(&mut self, session: u8, sequence: u8) {
        self.0[usize::from(session)] &= !(1 << sequence);
    }

    const fn contains(self, session: u8, sequence: u8) -> bool {
        self.0[session as usize] & (1 << sequence) != 0
    }
}

#[derive(Clone, Debug)]
pub(super) struct World {
    left: Bounds,
    mutation: Option<Mutation>,
    now: u64,

    acquisition: AcquisitionState<u8, u8>,
    /// The numbers of the samples on loan, oldest first.
    loans: VecDeque<u8>,
    /// A resend under way: which, for which service, and how many samples of it have been sent.
    resend: Option<(Resend, u8, usize)>,
    /// Number of the acquisition's port.
    port: u8,
    answers: VecDeque<Key>,

    service: u8,
    phase: Phase,
    tracker: SequenceTracker,
    raw: VecDeque<Key>,
    /// The session of the last sample that is no repeat, and what is noted of it for the next service.
    served: Option<u8>,
    noted: Option<u8>,
    /// The publisher of increments that the acquisition would find; 0 for none.
    listed: u8,

    reader: Option<(ReaderState, VecDeque<Key>)>,

    /// How often the shared memory was removed, and how often it had been when each of them joined.
    removed: u8,
    acquisition_joined: u8,
    service_joined: u8,
    reader_joined: u8,

    // What the properties need to know.
    /// Sequences that were sent and not handed out, in order.
    expected: VecDeque<u8>,
    /// Samples that a fault has kept from being answered so far.
    missing: Samples,
    /// Sequences that the user has left out, or of which it knows that the send has failed.
    told: Samples,
    /// Sequences of loans that the user has discarded: control periods that were measured and not sent.
    discarded: Samples,
    returned: Samples,
    sessions: Sessions,
}

/// What is known of the sessions that any service has served. A session is a bit.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
struct Sessions {
    /// Served, the first of all too.
    begun: u8,
    /// Flagged by an increment that has gone out, or excused: the first session, and those whose flag a fault has lost.
    flagged: u8,
    /// Begun when their service was killed before it had noted them: they are flagged again.
    unnoted: u8,
    /// A service was killed before it had noted the first session: the next one has no flag.
    first_unnoted: bool,
}

impl World {
    pub(super) fn new(bounds: Bounds, mutation: Option<Mutation>) -> Self {
        let queue = if mutation == Some(Mutation::IgnoresSurplus) { usize::MAX } else { bounds.queue };
        Self {
            left: bounds,
            mutation,
            now: 0,
            acquisition: AcquisitionState::new(0, bounds.depth, queue, 1),
            loans: VecDeque::new(),
            resend: None,
            port: 1,
            answers: VecDeque::new(),
            service: 1,
            phase: Phase::Ready,
            tracker: SequenceTracker::default(),
            raw: VecDeque::new(),
            served: None,
            noted: None,
            listed: 1,
            reader: None,
            removed: 0,
            acquisition_joined: 0,
            service_joined: 0,
            reader_joined: 0,
            expected: VecDeque::new(),
            missing: Samples::default(),
            told: Samples::default(),
            discarded: Samples::default(),
            returned: Samples::default(),
            sessions: Sessions::default(),
        }
    }

    /// All that decides what can happen from here on. Times do not: see [`Step::CheckSoon`] and
    /// [`Step::CheckAfterSilence`].
    pub(super) fn hash_into(&self, hasher: &mut impl Hasher) {
        let left = self.left;
        let kills = [left.service_kills, left.acquisition_kills, left.new_sessions];
        let losses = [left.lost_samples, left.lost_answers, left.failed_sends, left.skips];
        (left.samples, left.resends, kills, losses, left.removals, left.rejoins).hash(hasher);
        (self.removed, self.acquisition_joined, self.service_joined, self.reader_joined).hash(hasher);
        self.acquisition.hash_untimed(hasher);
        let resend = self.resend.map(|(resend, service, sent)| (resend == Resend::All, service, sent));
        (resend, self.port, &self.answers, &self.loans, self.discarded).hash(hasher);
        (self.service, self.phase, self.tracker, &self.raw, self.listed).hash(hasher);
        (&self.reader, &self.expected, self.missing, self.told, self.returned).hash(hasher);
        (self.served, self.noted, self.sessions).hash(hasher);
    }

    /// Whether every sample has been answered, and the next one can be sent.
    pub(super) fn is_settled(&self) -> bool {
        self.expected.is_empty()
            && self.acquisition.in_flight() == 0
            && self.resend.is_none()
            && !self.acquisition.is_full()
    }

    /// The states that one step leads to.
    pub(super) fn next(&self) -> impl Iterator<Item = (Step, Result<Self, String>)> {
        STEPS.into_iter().filter(|step| self.left(*step) > 0).filter_map(|step| {
            let mut next = self.clone();
            next.step(step).transpose().map(|outcome| (step, outcome.map(|()| next)))
        })
    }

    /// This state without any more samples and faults.
    pub(super) fn left_alone(&self) -> Self {
        let nothing = Bounds { samples: 0, service_kills: 0, acquisition_kills: 0, ..self.left };
        let nothing =
            Bounds { new_sessions: 0, lost_samples: 0, lost_answers: 0, failed_sends: 0, skips: 0, ..nothing };
        let nothing = Bounds { removals: 0, rejoins: 0, ..nothing };
        Self { left: nothing, ..self.clone() }
    }

    /// The state after the next step of processes that all run.
    pub(super) fn goes_on(&self) -> Option<Result<Self, String>> {
        const FAIR: [Step; 8] = [
            Step::ResendOne,
            Step::BeginAnew,
            Step::Subscribe,
            Step::Publish,
            Step::Rejoin,
            Step::Serve,
            Step::Receive,
            Step::CheckAfterSilence,
        ];
        FAIR.into_iter().find_map(|step| {
            let mut next = self.clone();
            next.left.resends = 1;
            next.step(step).transpose().map(|outcome| outcome.map(|()| next))
        })
    }

    /// How often this may still happen.
    const fn left(&self, step: Step) -> u8 {
        match step {
            Step::Send | Step::Loan => self.left.samples,
            Step::SendSkipping => self.left.skips,
            Step::SendIsLost => self.left.lost_samples,
            Step::SendFails { .. } => self.left.failed_sends,
            Step::CheckAfterSilence => self.left.resends,
            Step::BeginSession => self.left.new_sessions,
            Step::KillAcquisition => self.left.acquisition_kills,
            Step::KillService => self.left.service_kills,
            Step::ServeWithoutPublishing => self.left.lost_answers,
            Step::Remove => self.left.removals,
            _ => 1,
        }
    }

    /// Does a step, or returns `None` if it is not possible here.
    fn step(&mut self, step: Step) -> Result<Option<()>, String> {
        let free = self.resend.is_none();
        let done = match step {
            Step::Send if free => return self.send(0, Transport::Works),
            Step::SendSkipping if free && spend(&mut self.left.skips).is_some() => {
                return self.send(1, Transport::Works);
            }
            Step::SendIsLost if free && spend(&mut self.left.lost_samples).is_some() => {
                return self.send(0, Transport::Loses);
            }
            Step::SendFails { reached } if free && spend(&mut self.left.failed_sends).is_some() => {
                return self.send(0, Transport::Fails { reached });
            }
            Step::Loan if free && self.loans.len() < self.left.loans => {
                spend(&mut self.left.samples);
                let number = self.loan()?;
                self.loans.push_back(number);
                Some(())
            }
            Step::SendLoaned(end) if free => return self.send_loaned(end),
            Step::Discard(end) if free => self.take_loan(end).map(|number| {
                self.discarded.insert(self.session(), number);
                self.told.insert(self.session(), number);
                if self.mutation == Some(Mutation::DiscardingCancels) {
                    self.acquisition.cancel(u64::from(number));
                }
            }),
            Step::Cancel(end) if free => self.take_loan(end).map(|number| self.cancel(number)),
            Step::Receive if free => return self.receive(),
            Step::CheckSoon if free => self.check(self.acquisition.pauses_ns()[0]),
            Step::CheckAfterSilence if free => self.check(self.acquisition.pauses_ns()[1]),
            Step::ResendOne => self.resend_one(),
            Step::BeginSession if free => self.begin_session(),
            Step::KillAcquisition => self.kill_acquisition(),
            Step::Serve => return self.serve(true),
            Step::ServeWithoutPublishing => {
                return if spend(&mut self.left.lost_answers).is_some() { self.serve(false) } else { Ok(None) };
            }
            Step::Note => (self.phase == Phase::Ready && self.noted != self.served).then(|| self.noted = self.served),
            Step::KillService => self.kill_service(),
            Step::CleanUp => {
                let dead = self.listed != 0 && (self.listed != self.service || self.phase == Phase::Dead);
                dead.then(|| self.listed = 0)
            }
            Step::Subscribe => (self.phase == Phase::Dead).then(|| {
                self.service += 1;
                self.service_joined = self.removed;
                self.phase = Phase::Subscribed;
                self.tracker = SequenceTracker::after(self.noted().map(|session| LastSession { session, last: None }));
                self.served = self.noted;
            }),
            Step::Publish => (self.phase == Phase::Subscribed).then(|| {
                self.phase = Phase::Ready;
                self.listed = self.service;
            }),
            Step::ReaderJoins => (self.left.reader && self.reader.is_none()).then(|| {
                self.reader = Some((ReaderState::new(), VecDeque::new()));
                self.reader_joined = self.removed;
            }),
            Step::ReaderTakes => return self.reader_takes(),
            Step::Remove => spend(&mut self.left.removals).map(|()| self.removed += 1),
            Step::BeginAnew => self.begin_anew(),
            Step::Rejoin if free => self.rejoin(),
            Step::ReaderRejoins => self.reader_rejoins(),
            _ => None,
        };
        Ok(done)
    }

    // The acquisition.

    /// Loans a sample and sends it at once.
    fn send(&mut self, skip: u8, transport: Transport) -> Result<Option<()>, String> {
        let session = self.session();
        if self.acquisition.is_full() || spend(&mut self.left.samples).is_none() {
            return Ok(None);
        }
        let first = if self.left.loans == 0 { first_sequence(session) } else { 0 };
        let next = self.loan()?.max(first);
        let sequence = next + skip;
        (skip > 0).then(|| self.told.insert(session, next));
        self.send_as(sequence, transport).map(Some)
    }

    fn loan(&mut self) -> Result<u8, String> {
        let number = self.acquisition.loan() as u8;
        if self.loans.contains(&number) {
            return Err(format!("two samples on loan have the same number {number}"));
        }
        Ok(number)
    }

    /// Sends a sample that was on loan. A full queue leaves it there.
    fn send_loaned(&mut self, end: End) -> Result<Option<()>, String> {
        let loans = self.loans.clone();
        let Some(number) = self.take_loan(end) else { return Ok(None) };
        match self.acquisition.may_send(u64::from(number)) {
            Ok(()) => self.send_as(number, Transport::Works).map(Some),
            Err(Refusal::Full) => {
                self.loans = loans;
                Ok(None)
            }
            // A later loan has been sent: nothing is left but to discard it.
            Err(Refusal::Sequence) => {
                self.discarded.insert(self.session(), number);
                self.told.insert(self.session(), number);
                Ok(Some(()))
            }
        }
    }

    fn send_as(&mut self, sequence: u8, transport: Transport) -> Result<(), String> {
        let session = self.session();
        assert_eq!(self.acquisition.may_send(u64::from(sequence)), Ok(()));
        if self.discarded.contains(session, sequence) {
            return Err(format!("a period is lost in silence: another one gets its sequence {sequence}"));
        }
        self.acquisition.take(u64::from(sequence));
        self.acquisition.send(u64::from(sequence), &sequence, self.now);
        // The user sends out of order: those before it cannot be sent any more.
        for before in self.loans.iter().filter(|number| **number < sequence) {
            self.told.insert(session, *before);
        }
        if let Transport::Fails { .. } = transport {
            self.acquisition.send_failed();
            self.told.insert(session, sequence);
        } else {
            self.expected.push_back(sequence);
        }
        if transport == Transport::Works || transport == (Transport::Fails { reached: true }) {
            self.deliver(sequence);
        } else {
            self.missing.insert(session, sequence);
        }
        Ok(())
    }

    fn take_loan(&mut self, end: End) -> Option<u8> {
        match end {
            End::Oldest => self.loans.pop_front(),
            // With one loan it is the oldest.
            End::Newest if self.loans.len() > 1 => self.loans.pop_back(),
            End::Newest => None,
        }
    }

    /// A loan that stands for no period, as one that was merged into another. Only the last loan's number is taken
    /// back.
    fn cancel(&mut self, number: u8) {
        let last = self.acquisition.next_sequence() == u64::from(number) + 1;
        if last || self.mutation != Some(Mutation::CancelsAnyNumber) {
            self.acquisition.cancel(u64::from(number));
        } else {
            (u64::from(number)..self.acquisition.next_sequence())
                .rev()
                .for_each(|higher| self.acquisition.cancel(higher));
        }
        if !last {
            self.told.insert(self.session(), number);
        }
    }

    /// Puts a sample into the service's queue, if there is a service. A full queue discards it.
    fn deliver(&mut self, sequence: u8) {
        let sample = Key { port: self.port, session: self.session(), sequence };
        let queued = self.raw.iter().filter(|queued| queued.port == self.port).count();
        let meets = self.phase != Phase::Dead && self.acquisition_joined == self.service_joined;
        if meets && queued < self.left.queue {
            self.raw.push_back(sample);
        }
    }

    fn receive(&mut self) -> Result<Option<()>, String> {
        let handed_out = if let Some(sequence) = self.acquisition.next_kept() {
            Some(sequence)
        } else if let Some(answer) = self.answers.pop_front() {
            let (session, sequence) = (u64::from(answer.session), u64::from(answer.sequence));
            let leaves = self.acquisition.answered(session, sequence, &answer.sequence)
                || (self.mutation == Some(Mutation::HandsOutAtOnce) && session == self.acquisition.session());
            leaves.then_some(answer.sequence)
        } else {
            return Ok(None);
        };
        match handed_out {
            Some(sequence) if self.expected.pop_front() != Some(sequence) => {
                Err(format!("the user gets the answer to {sequence} out of order or twice"))
            }
            _ => Ok(Some(())),
        }
    }

    /// A poll that found nothing, when a check is due.
    fn check(&mut self, later_ns: u64) -> Option<()> {
        if self.acquisition.in_flight() == 0
            || !self.answers.is_empty()
            || self.acquisition.clone().next_kept().is_some()
        {
            return None;
        }
        self.now = self.now.saturating_add(later_ns);
        // The first check after an answer only notes that there was one.
        if !self.acquisition.check_due(self.now) {
            self.now = self.now.saturating_add(later_ns);
            self.acquisition.check_due(self.now).then_some(())?;
        }
        let listed = self.found()?;
        let resend = self.acquisition.resend_due(u128::from(listed), self.now)?;
        if self.acquisition.is_known(u128::from(listed)) {
            spend(&mut self.left.resends)?;
        }
        self.resend = Some((resend, listed, 0));
        Some(())
    }

    fn resend_one(&mut self) -> Option<()> {
        let (resend, service, sent) = self.resend?;
        match self.samples(resend, service).get(sent) {
            Some(sequence) => {
                self.deliver(*sequence);
                self.resend = Some((resend, service, sent + 1));
            }
            None => {
                self.acquisition.resent(resend, u128::from(service), self.now);
                self.resend = None;
            }
        }
        Some(())
    }

    /// The samples of a resend.
    fn samples(&self, resend: Resend, service: u8) -> Vec<u8> {
        let keys: Vec<_> = self.acquisition.keys().map(|(sequence, answered)| (sequence as u8, answered)).collect();
        let unanswered = || keys.iter().filter(|(_, answered)| !answered).map(|(sequence, _)| *sequence);
        let newest_answered = keys.iter().rposition(|(_, answered)| *answered).unwrap_or(0);
        let same = self.acquisition.is_known(u128::from(service));
        match (self.mutation, resend) {
            (Some(Mutation::NeverResends), _) => vec![],
            (Some(Mutation::ResendsUnansweredOnly), Resend::All) => unanswered().collect(),
            (Some(Mutation::ResendsOvertakenOnly), Resend::All) if same => {
                unanswered().take_while(|sequence| *sequence < keys[newest_answered].0).collect()
            }
            (Some(Mutation::SilenceRepeatsOldest), Resend::Newest) => unanswered().take(1).collect(),
            (Some(Mutation::ResendsNewestOnly), _) => self.acquisition.samples(Resend::Newest).copied().collect(),
            _ => self.acquisition.samples(resend).copied().collect(),
        }
    }

    fn begin_session(&mut self) -> Option<()> {
        spend(&mut self.left.new_sessions)?;
        // Samples that are still on loan belong to the session that ends.
        self.loans.clear();
        self.acquisition.begin_session(self.acquisition.session() + 1).ok()
    }

    /// The acquisition dies, and another one connects to the service that is listed. What the dead one had sent stays
    /// in its queue.
    fn kill_acquisition(&mut self) -> Option<()> {
        spend(&mut self.left.acquisition_kills)?;
        // It finds what is there now, whatever the dead one had.
        self.acquisition_joined = self.removed;
        let listed = self.found()?;
        let session = self.acquisition.session() + 1;
        self.acquisition = AcquisitionState::new(session, self.left.depth, self.left.queue, u128::from(listed));
        self.port += 1;
        self.loans.clear();
        self.resend = None;
        self.answers.clear();
        self.expected.clear();
        Some(())
    }

    /// The service whose publisher the acquisition finds where it has joined.
    fn found(&self) -> Option<u8> {
        (self.listed != 0 && self.acquisition_joined == self.service_joined).then_some(self.listed)
    }

    /// The acquisition joins where a service is ready: because the memory that it has was removed, or because it gets
    /// no answer. What it had sent stays in the queue of its old port, if that was not removed.
    fn rejoin(&mut self) -> Option<()> {
        let is_ready = self.phase == Phase::Ready && self.service_joined == self.removed;
        let waits = self.acquisition.in_flight() > 0;
        if !is_ready || !waits || self.listed != self.service {
            return None;
        }
        if self.acquisition_joined == self.removed {
            spend(&mut self.left.rejoins)?;
        }
        self.acquisition_joined = self.removed;
        self.port += 1;
        self.answers.clear();
        self.acquisition.rejoined(self.now);
        Some(())
    }

    fn session(&self) -> u8 {
        self.acquisition.session() as u8
    }

    // The service.

    fn serve(&mut self, publishes: bool) -> Result<Option<()>, String> {
        if self.phase != Phase::Ready {
            return Ok(None);
        }
        let Some(sample) = self.raw.pop_front() else { return Ok(None) };
        let Key { session, sequence, .. } = sample;
        let noted = if self.mutation == Some(Mutation::OneSession) { 0 } else { u64::from(session) };
        let period = Period { session: noted, sequence: u64::from(sequence), ..Period::default() };
        let arrival = self.tracker.note(Seen { period, at_ns: 0 });
        self.check_session(session, arrival.change.is_some(), publishes)?;
        if !arrival.repeated {
            self.served = Some(session);
        }
        for missing in (1..=arrival.missing).map(|back| sequence - back as u8) {
            if !self.missing.contains(session, missing) && !self.told.contains(session, missing) {
                return Err(format!("a false gap before {sequence}: {missing} is not missing"));
            }
        }
        if !publishes {
            self.missing.insert(session, sequence);
            return Ok(Some(()));
        }
        self.missing.remove(session, sequence);
        let increment = Key { port: self.service, ..sample };
        if self.acquisition_joined == self.service_joined {
            overwriting_push(&mut self.answers, increment, self.left.answers);
        }
        if let Some((_, queue)) = &mut self.reader
            && self.reader_joined == self.service_joined
        {
            overwriting_push(queue, increment, self.acquisition.depth());
        }
        Ok(Some(()))
    }

    /// Every session but the first has one increment with the flag, and that is its first.
    fn check_session(&mut self, session: u8, is_flagged: bool, publishes: bool) -> Result<(), String> {
        let (bit, Sessions { begun, flagged, unnoted, first_unnoted }) = (1 << session, self.sessions);
        // The first session since boot, and the first of a service if none before had the time to note one.
        let needs_none = begun & !bit == 0 || first_unnoted && self.served.is_none();
        let is_new = begun & bit == 0;
        self.sessions.begun |= bit;
        if is_flagged && (begun & !bit == 0 || flagged & !unnoted & bit != 0) {
            return Err(format!("session {session} has a flag too much"));
        }
        if is_flagged || is_new && needs_none {
            self.sessions.flagged |= bit;
            self.sessions.unnoted &= !bit;
        } else if publishes && flagged & bit == 0 {
            return Err(format!("session {session} begins without its flag"));
        }
        Ok(())
    }

    /// What a new service finds noted.
    fn noted(&self) -> Option<u64> {
        match self.mutation {
            Some(Mutation::ForgetsSessions) => None,
            Some(Mutation::EverySessionIsNew) => self.noted.map(|_| u64::MAX),
            _ => self.noted.map(u64::from),
        }
    }

    fn kill_service(&mut self) -> Option<()> {
        if self.phase == Phase::Dead {
            return None;
        }
        spend(&mut self.left.service_kills)?;
        if let Some(session) = self.served.filter(|_| self.noted != self.served) {
            self.sessions.unnoted |= 1 << session;
            self.sessions.first_unnoted |= self.noted.is_none();
        }
        self.phase = Phase::Dead;
        self.raw.clear();
        Some(())
    }

    /// The service ends because the memory that it has was removed. Its publisher is gone, too.
    fn begin_anew(&mut self) -> Option<()> {
        if self.phase == Phase::Dead || self.service_joined == self.removed {
            return None;
        }
        (self.phase, self.listed) = (Phase::Dead, 0);
        self.noted = self.served;
        self.raw.clear();
        Some(())
    }

    // The reader.

    /// The reader joins anew, because the memory that it has was removed.
    fn reader_rejoins(&mut self) -> Option<()> {
        let (_, queue) = self.reader.as_mut()?;
        if self.reader_joined == self.removed {
            return None;
        }
        queue.clear();
        self.reader_joined = self.removed;
        Some(())
    }

    fn reader_takes(&mut self) -> Result<Option<()>, String> {
        let Some((state, queue)) = &mut self.reader else { return Ok(None) };
        let Some(Key { session, sequence, .. }) = queue.pop_front() else { return Ok(None) };
        let returns =
            state.first_time(u64::from(session), u64::from(sequence)) || self.mutation == Some(Mutation::ReaderForgets);
        if returns == self.returned.insert(session, sequence) {
            Ok(Some(()))
        } else {
            Err(format!("the reader returns sample {sequence} of session {session} twice or never"))
        }
    }
}

#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Transport {
    Works,
    Loses,
    Fails { reached: bool },
}

/// Each session begins with another sequence.
const fn first_sequence(session: u8) -> u8 {
    1 + 2 * session
}

/// `None` if nothing is left.
fn spend(left: &mut u8) -> Option<()> {
    *left = left.checked_sub(1)?;
    Some(())
}

/// A full queue loses its oldest entry. Each port has a queue of its own.
fn overwriting_push(queue: &mut VecDeque<Key>, entry: Key, capacity: usize) {
    let same_port = |queued: &Key| queued.port == entry.port;
    if queue.iter().filter(|queued| same_port(queued)).count() >= capacity
        && let Some(oldest) = queue.iter().position(same_port)
    {
        queue.remove(oldest);
    }
    queue.push_back(entry);
}
