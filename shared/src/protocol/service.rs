//! The service's part of the protocol: whether the samples of a session come in order, and what the increment says
//! about it. Every session number and sequence number is valid.

use crate::sequence::{Seen, periods_between, rises, time_step};
use crate::wire::Flags;

/// Number of remembered sessions, as many as a reader remembers: the running acquisition's, and its predecessors',
/// whose last samples may still arrive or come again.
const SESSIONS: usize = 4;

/// Of each of the last sessions, the sample with the highest sequence number.
#[derive(Clone, Copy, Debug, Default, Eq, Hash, PartialEq)]
pub struct SequenceTracker {
    /// The session of the last sample first, then that of the last sample of another session, and so on.
    highest: [Option<Seen>; SESSIONS],
    /// What the service before has noted, until the first sample comes.
    before: Option<LastSession>,
}

/// The session that a service has served last for an IMU, as it notes it for the next service.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub struct LastSession {
    /// Its number.
    pub session: u64,
    /// Its last sample; `None` where the service had no time to note it, since it was killed.
    pub last: Option<Seen>,
}

/// What session, sequence number and times say about a sample.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Arrival {
    /// Samples of its session that are missing before it.
    pub missing: u64,
    /// Its sequence number is not above the highest of its session: a resend.
    pub repeated: bool,
    /// It is the first of its session.
    pub begins: bool,
    /// None is missing before it, but its time is not one interval after that of the sample before: [`time_step`].
    pub time_step: bool,
    /// It is the first of a session other than the one that was served before.
    pub change: Option<SessionChange>,
}

/// Another session follows.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct SessionChange {
    /// Control periods between the two sessions; `None` if that is unknown: [`periods_between`].
    pub missing: Option<u64>,
}

impl SequenceTracker {
    /// Goes on from what the service before has noted, if anything: its session is not new when it goes on.
    #[must_use]
    pub const fn after(before: Option<LastSession>) -> Self {
        Self { highest: [None; SESSIONS], before }
    }

    /// The session of the last sample, with the highest sequence number of it.
    #[must_use]
    pub fn last(&self) -> Option<LastSession> {
        self.highest[0].map(|last| LastSession { session: last.period.session, last: Some(last) })
    }

    /// Notes the next sample.
    #[inline]
    pub fn note(&mut self, sample: Seen) -> Arrival {
        let [last, ..] = self.highest;
        let is_same = |last: &Seen| last.period.session == sample.period.session;
        let Some(Seen { period: last, .. }) = last.filter(is_same).or_else(|| self.turn_to(sample.period.session))
        else {
            return self.begin(sample);
        };
        if !rises(Some(last.sequence), sample.period.sequence) {
            return Arrival { repeated: true, ..Arrival::default() };
        }
        self.highest[0] = Some(sample);
        let missing = sample.period.sequence - last.sequence - 1;
        Arrival { missing, time_step: time_step(last, sample.period), ..Arrival::default() }
    }

    /// Puts a session first. Returns its highest sample; `None` if it is new, or was forgotten.
    #[cold]
    #[inline(never)]
    fn turn_to(&mut self, session: u64) -> Option<Seen> {
        let is_known = |known: &Option<Seen>| known.is_some_and(|known| known.period.session == session);
        let place = self.highest.iter().position(is_known);
        self.highest[..=place.unwrap_or(SESSIONS - 1)].rotate_right(1);
        self.highest[0].filter(|_| place.is_some())
    }

    /// Notes the first sample of a session, whose place is the first.
    #[cold]
    #[inline(never)]
    fn begin(&mut self, sample: Seen) -> Arrival {
        self.highest[0] = Some(sample);
        let of_this = self.highest[1].map(|last| LastSession { session: last.period.session, last: Some(last) });
        let before = of_this.or(self.before.take()).filter(|before| before.session != sample.period.session);
        let missing = |before: LastSession| before.last.and_then(|last| periods_between(last, sample));
        let change = before.map(|before| SessionChange { missing: missing(before) });
        Arrival { begins: true, change, ..Arrival::default() }
    }
}

impl Arrival {
    /// The control periods that are missing right before it, as far as that can be known: not where time steps, nor
    /// before the first sample of all, nor between sessions of different clocks. One that comes late has none: it was
    /// missing before a later one.
    #[must_use]
    pub fn lost(self) -> Option<u64> {
        match self.change {
            Some(change) => change.missing,
            None if self.begins || self.time_step => None,
            None => Some(self.missing),
        }
    }

    /// The [delivery flags](Flags::DELIVERY) of the increment, which is published this long after its sample was sent.
    #[inline]
    #[must_use]
    pub const fn flags(self, latency_ns: u64, budget_ns: u64) -> Flags {
        let gap = if self.missing > 0 { Flags::GAP.0 } else { 0 };
        let late = if latency_ns > budget_ns { Flags::LATE.0 } else { 0 };
        let time_step = if self.time_step { Flags::TIME_STEP.0 } else { 0 };
        let session = if self.change.is_some() { Flags::SESSION.0 } else { 0 };
        Flags(gap | late | time_step | session)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::Period;

    #[test]
    fn flags_of_gaps_and_late_answers() {
        let gap = Arrival { missing: 1, ..Arrival::default() };
        let repeat = Arrival { repeated: true, ..Arrival::default() };
        let step = Arrival { time_step: true, ..Arrival::default() };
        assert_eq!([step.flags(10, 10), step.flags(11, 10)], [Flags::TIME_STEP, Flags::TIME_STEP | Flags::LATE]);
        assert_eq!([gap.flags(10, 10), gap.flags(11, 10)], [Flags::GAP, Flags::GAP | Flags::LATE]);
        assert_eq!([repeat.flags(10, 10), repeat.flags(11, 10)], [Flags(0), Flags::LATE]);
        let first = Arrival { begins: true, ..Arrival::default() };
        let follows = Arrival { change: Some(SessionChange { missing: Some(0) }), ..first };
        assert_eq!([first.flags(10, 10), follows.flags(10, 10)], [Flags(0), Flags::SESSION]);
    }

    #[test]
    fn gaps_repeats_and_sessions() {
        let mut tracker = SequenceTracker::default();
        let (plain, begins) = (Arrival::default(), Arrival { begins: true, ..Arrival::default() });
        let follows = Arrival { change: Some(SessionChange { missing: None }), ..begins };
        let repeated = Arrival { repeated: true, ..plain };
        let arrivals = [(1, 5), (1, 6), (1, 9), (1, 7), (1, 9), (2, 9), (1, 0), (1, u64::MAX), (1, u64::MAX)];
        let expected = [
            begins,
            plain,
            Arrival { missing: 2, ..plain },
            repeated,
            repeated,
            follows,
            repeated,
            Arrival { missing: u64::MAX - 10, ..plain },
            repeated,
        ];
        assert_eq!(arrivals.map(|(session, sequence)| tracker.note(at(session, sequence, 0))), expected);
    }

    /// Samples of an earlier session that come again make no session, and hide no gap of the newer one.
    #[test]
    fn the_last_four_sessions_are_remembered() {
        let mut tracker = SequenceTracker::default();
        let mut note = |session, sequence| tracker.note(at(session, sequence, 0));
        let (repeated, begins) =
            (Arrival { repeated: true, ..Arrival::default() }, Arrival { begins: true, ..Arrival::default() });
        let follows = Arrival { change: Some(SessionChange { missing: None }), ..begins };
        assert_eq!(note(1, 9), begins);
        for session in 2..=4 {
            assert_eq!(note(session, 9), follows);
        }
        assert_eq!([note(1, 8), note(4, 9), note(2, 9), note(3, 1)], [repeated; 4]);
        assert_eq!(note(4, 12), Arrival { missing: 2, ..Arrival::default() });
        assert_eq!(note(1, 10), Arrival::default());
        // The session whose last sample is the longest ago is forgotten.
        assert_eq!(note(5, 0), follows);
        assert_eq!([note(1, 10), note(3, 9), note(4, 12), note(5, 0)], [repeated; 4]);
        assert_eq!(note(2, 9), follows);
    }

    #[test]
    fn what_is_lost_before_a_sample_is_a_number_or_unknown() {
        let mut tracker = SequenceTracker::default();
        let mut lost = |session, sequence, timestamp_ns| tracker.note(at(session, sequence, timestamp_ns)).lost();
        assert_eq!(
            [lost(1, 5, 100), lost(1, 6, 110), lost(1, 9, 140), lost(1, 8, 130)],
            [None, Some(0), Some(2), Some(0)]
        );
        assert_eq!([lost(1, 10, 170), lost(1, 11, 180)], [None, Some(0)], "a step of time");
        assert_eq!([lost(2, 0, 230), lost(2, 1, 240), lost(3, 0, 0)], [Some(4), Some(0), None]);
    }

    fn at(session: u64, sequence: u64, timestamp_ns: u64) -> Seen {
        Seen { period: Period { session, sequence, timestamp_ns, interval_ns: 10 }, at_ns: 1000 + timestamp_ns }
    }

    #[test]
    fn a_time_step_is_one_against_the_highest_sequence_of_the_session() {
        let mut tracker = SequenceTracker::default();
        let mut steps = |session, sequence, timestamp_ns| tracker.note(at(session, sequence, timestamp_ns)).time_step;
        assert!(!steps(1, 5, 100) && !steps(1, 6, 110) && steps(1, 7, 140), "30 ns for a period of 10 ns");
        // A repeat has none, and is not what the next sample is compared with.
        assert!(!steps(1, 7, 170) && !steps(1, 6, 110) && !steps(1, 8, 150));
        // Nor has a sample after a gap, the first of a session, or one without a timestamp on either side.
        assert!(!steps(1, 10, 900) && !steps(2, 11, 5) && !steps(2, 12, 0) && !steps(2, 13, 900) && steps(2, 14, 900));
    }

    /// The periods between are counted from the last sample of the session before, by the clock of both.
    #[test]
    fn a_session_that_follows_tells_how_many_periods_are_between() {
        let mut tracker = SequenceTracker::default();
        let mut change = |session, sequence, timestamp_ns| tracker.note(at(session, sequence, timestamp_ns)).change;
        let missing = |missing| Some(SessionChange { missing });
        assert_eq!([change(1, 5, 100), change(1, 6, 110), change(1, 5, 100)], [None; 3]);
        assert_eq!([change(2, 0, 150), change(2, 1, 160)], [missing(Some(3)), None]);
        // Without a timestamp nothing is known, nor of what follows it.
        assert_eq!([change(3, 0, 0), change(4, 0, 900)], [missing(None); 2]);
        // A session that is known is none that follows, and the next one follows it.
        assert_eq!([change(2, 2, 170), change(5, 0, 190)], [None, missing(Some(1))]);
    }

    #[test]
    fn the_session_that_was_noted_goes_on_and_every_other_one_follows_it() {
        let first = |noted: LastSession, sample| SequenceTracker::after(Some(noted)).note(sample);
        let begins = Arrival { begins: true, ..Arrival::default() };
        for last in [None, Some(at(7, 20, 100))] {
            assert_eq!(first(LastSession { session: 7, last }, at(7, 25, 150)), begins);
            let missing = last.map(|_| 4);
            let follows = Arrival { change: Some(SessionChange { missing }), ..begins };
            assert_eq!(first(LastSession { session: 7, last }, at(8, 25, 150)), follows);
        }
        // Once only: the next session follows the one that goes on.
        let mut tracker = SequenceTracker::after(Some(LastSession { session: 7, last: None }));
        let changes = [(7, 25, 150), (7, 26, 160), (9, 0, 190)];
        let changes = changes.map(|(session, sequence, time)| tracker.note(at(session, sequence, time)).change);
        assert_eq!(changes, [None, None, Some(SessionChange { missing: Some(2) })]);
    }
}
