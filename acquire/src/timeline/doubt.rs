//! Why frames have to wait, and for how long.

use super::line::{HELD_BACK_NS, Line};
use super::number::{FrameStep, Numbers};
use super::pace::{FRAMES, Pace, WINDOW_NS};
use super::{Doubt, FrameObservation, LastFrame, Timeline};
use crate::frames::FrameArrival;

/// Time that a counter may seem to run ahead of the clock \[s\].
const AHEAD_S: f64 = 0.5;
/// The longest wait \[ns\].
const WAIT_NS: u64 = 250_000_000;
/// The longest wait of the first frames of all, while they contradict each other \[ns\].
const FIRST_WAIT_NS: u64 = 2_000_000_000;
/// Part of a turn of the counter by which frames may be late before the turn is in doubt.
pub(super) const TURN: f64 = 0.35;
/// Part of the window of the rate by which frames may be late, or early, before the rate is in doubt.
const LATE: f64 = 0.3;
const EARLY: f64 = 0.2;
/// How late, in intervals, a frame of a device without counter and clock may be.
pub(super) const LATE_INTERVALS: f64 = 0.75;
/// Times the mean jitter that arrivals may be off.
pub(super) const JITTERS: f64 = 4.0;
/// By how much time a number that has jumped may differ from the clock, in addition to two intervals and the jitter
/// \[ns\].
const NUMBER_NS: f64 = 5e6;
/// Frames that came an interval apart, up to this part of it, show that none of them was late.
const STEADY: usize = 8;
const STEADY_PART: f64 = 0.4;
/// Steps that datagrams may be behind.
const BEHIND: u64 = 32;
/// A number that rises by one period, in periods.
pub(super) const ONE: std::ops::Range<f64> = 0.6..1.5;

impl<T> Timeline<T> {
    /// Why a frame has to wait, if it does.
    pub(super) fn doubt_of(&self, front: &FrameObservation) -> Option<Doubt> {
        let Some(last) = self.last else { return Some(Doubt::Beginning) };
        let FrameArrival { after_ns, by_ns } = front.arrival.unwrap_or_default();
        let (line, interval) = (&last.line, self.numbering.interval);
        let (real, least, is_whole) = match self.step_from(&last.numbers, last.by_ns, front) {
            FrameStep::Restarted => return Some(Doubt::Beginning),
            FrameStep::Repeated => return None,
            FrameStep::Passed { real, least, is_whole } => (real, least, is_whole),
        };
        let (has_clock, turn) = (self.numbering.clock.is_some(), self.turn());
        if front.after_outage && !has_clock {
            let is_over = turn.is_some_and(|turn| line.late(by_ns, 0.0) > turn * interval);
            return Some(if is_over { Doubt::Beginning } else { Doubt::Outage });
        }
        let window = WINDOW_NS.max(FRAMES as f64 * interval);
        let jitter = JITTERS * line.jitter();
        let late = match (self.numbering.counts(), turn) {
            (false, _) => LATE_INTERVALS * interval + jitter,
            (true, Some(turn)) => (LATE * window + jitter).min(TURN * turn * interval),
            (true, None) => LATE * window + jitter,
        };
        let periods = least as f64;
        // One that was seen late may have come at any time since the line was known to be empty.
        let is_seen = by_ns.saturating_sub(after_ns) as f64 <= HELD_BACK_NS + 2.0 * interval;
        let least_ns = if is_seen { by_ns } else { after_ns };
        if line.late(least_ns, periods) > late || line.late(by_ns, periods) < -(EARLY * window + jitter) {
            return Some(Doubt::Time);
        }
        let is_explained = front.damaged > 0 || front.after_outage;
        let is_odd = !is_whole || !ONE.contains(&real) && !is_explained;
        (self.numbering.counts() && is_odd).then_some(Doubt::Number)
    }

    /// Periods in a turn of a counter without a clock in addition to it.
    pub(super) fn turn(&self) -> Option<f64> {
        let counter = self.numbering.counter.filter(|_| self.numbering.clock.is_none());
        counter.map(|counter| counter.turn() as f64)
    }

    /// The step from a frame that came at `since_ns` to another one.
    pub(super) fn step_from(&self, numbers: &Numbers, since_ns: u64, to: &FrameObservation) -> FrameStep {
        if self.is_behind(numbers, to) {
            return FrameStep::Repeated;
        }
        let limit = to.arrival.map_or(f64::INFINITY, |arrival| {
            arrival.by_ns.saturating_sub(since_ns) as f64 / self.numbering.interval
                + 2.0
                + AHEAD_S * 1e9 / self.numbering.interval
        });
        self.numbering.step(numbers, to, limit)
    }

    /// Whether a datagram was overtaken by the one with these numbers.
    fn is_behind(&self, numbers: &Numbers, to: &FrameObservation) -> bool {
        if !self.may_overtake {
            return false;
        }
        let to = Numbers::of(to);
        match (&self.numbering.counter, &self.numbering.clock) {
            (Some(counter), _) => {
                let behind = counter.rise(to.counter, numbers.counter);
                behind > 0 && behind <= BEHIND * counter.step && behind < counter.turn() * counter.step / 2
            }
            (None, Some(clock)) => {
                let behind = clock.passed(to.clock_ns, numbers.clock_ns);
                behind.is_some_and(|ns| ns > 0 && ns as f64 <= BEHIND as f64 * self.numbering.interval)
            }
            (None, None) => false,
        }
    }

    /// Puts the frame that came last before the one that has overtaken it, if that still waits.
    pub(super) fn put_in_order(&mut self) {
        let Some(at) = self.waiting.len().checked_sub(2) else { return };
        let overtakes = match (self.waiting.get(at), self.waiting.back()) {
            (Some((before, _)), Some((newest, _))) => self.is_behind(&Numbers::of(before), newest),
            _ => false,
        };
        if overtakes {
            self.waiting.swap(at, at + 1);
            if at == 0 {
                self.doubt = None;
            }
        }
    }

    pub(super) fn begin_doubt(&mut self, doubt: Doubt) -> Doubt {
        if !self.is_doubted || matches!(doubt, Doubt::Beginning | Doubt::Outage) {
            self.trace.clear();
            if let (Doubt::Number, Some(last)) = (doubt, &self.last) {
                self.trace.push(last.by_ns, 0.0, false);
            }
        }
        (self.doubt, self.traced) = (Some(doubt), 0);
        doubt
    }

    /// Adds what waits and is not there yet to the trace.
    pub(super) fn extend_trace(&mut self) {
        for at in self.traced..self.waiting.len() {
            let before = match at.checked_sub(1).and_then(|before| self.waiting.get(before)) {
                Some((before, _)) => Some((Numbers::of(before), before.arrival.unwrap_or_default().by_ns)),
                None => self.last.map(|last| (last.numbers, last.by_ns)),
            };
            let Some((observed, _)) = self.waiting.get(at) else { break };
            let by_ns = observed.arrival.unwrap_or_default().by_ns;
            match before.map(|(numbers, since_ns)| self.step_from(&numbers, since_ns, observed)) {
                Some(FrameStep::Passed { real, .. }) => self.trace.push(by_ns, real, observed.damaged > 0),
                Some(FrameStep::Repeated) => {}
                Some(FrameStep::Restarted) | None => {
                    self.trace.clear();
                    self.trace.push(by_ns, 0.0, false);
                }
            }
        }
        self.traced = self.waiting.len();
    }

    /// Whether what waits can be placed at this time \[ns\].
    pub(super) fn is_decided(&self, doubt: Doubt, front: &FrameObservation, now_ns: u64) -> bool {
        let interval = self.numbering.interval;
        let front_arrival = front.arrival.unwrap_or_default();
        let waited = now_ns.saturating_sub(front_arrival.by_ns);
        match (doubt, &self.last) {
            (Doubt::Beginning, None) if self.has_pace => {
                let newest = self.waiting.back().and_then(|(newest, _)| newest.arrival).unwrap_or(front_arrival);
                let silent = now_ns.saturating_sub(newest.by_ns) as f64 >= WAIT_NS as f64 + 3.0 * interval;
                let is_long = waited >= FIRST_WAIT_NS && self.waiting.len() >= FRAMES;
                self.trace.pace(interval) != Pace::Open || is_long || silent
            }
            _ if waited >= WAIT_NS => true,
            (Doubt::Time, Some(last)) => self.has_caught_up(last) || self.is_steady(last),
            (Doubt::Outage, Some(last)) => self.is_steady(last),
            (Doubt::Number, Some(last)) => {
                let is_clear = self.is_in_time(last) || self.has_caught_up(last) || self.is_steady(last);
                self.is_regular_again() && is_clear || self.has_pace && self.trace.pace(interval) != Pace::Open
            }
            _ => false,
        }
    }

    /// Whether the last few came an interval apart, and not faster, as those do that catch up.
    pub(super) fn is_steady(&self, last: &LastFrame) -> bool {
        let Some(from) = self.waiting.len().checked_sub(STEADY) else { return false };
        let steps = self.steps(last);
        if steps.len() < self.waiting.len() {
            return false;
        }
        let lateness = self.lateness(&last.line, &steps).skip(from).map(|(late, _)| late);
        let [low, high] =
            lateness.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], late| [low.min(late), high.max(late)]);
        high - low < STEADY_PART * self.numbering.interval
    }

    /// Whether the newest of those that wait came when its number says.
    pub(super) fn is_in_time(&self, last: &LastFrame) -> bool {
        self.late_of_newest(last).is_some_and(|late| late.abs() <= self.tolerance(last))
    }

    /// By how much time a number that has jumped may differ from the clock \[ns\].
    pub(super) fn tolerance(&self, last: &LastFrame) -> f64 {
        2.0 * last.line.rate() + JITTERS * last.line.jitter() + NUMBER_NS
    }

    /// How late the newest of those that wait is \[ns\], if it was seen at its time.
    pub(super) fn late_of_newest(&self, last: &LastFrame) -> Option<f64> {
        let periods = self.steps(last).last().map_or(0, |(_, place)| *place);
        let arrival = self.waiting.back()?.0.arrival?;
        let is_seen = arrival.by_ns.saturating_sub(arrival.after_ns) as f64 <= HELD_BACK_NS;
        is_seen.then(|| last.line.late(arrival.by_ns, periods as f64))
    }

    /// Whether the newest of those that wait came at its time.
    pub(super) fn has_caught_up(&self, last: &LastFrame) -> bool {
        let line = &last.line;
        let allowed = 0.5 * LATE_INTERVALS * self.numbering.interval + 0.5 * JITTERS * line.jitter();
        self.late_of_newest(last).is_some_and(|late| late.abs() < allowed.max(1.5 * line.low().abs()))
    }

    /// Whether the number rises by one period again: what was missing was lost.
    pub(super) fn is_regular_again(&self) -> bool {
        let Some(at) = self.waiting.len().checked_sub(2) else { return false };
        let (Some((before, _)), Some((newest, _))) = (self.waiting.get(at), self.waiting.back()) else { return false };
        let since_ns = before.arrival.unwrap_or_default().by_ns;
        let step = self.step_from(&Numbers::of(before), since_ns, newest);
        matches!(step, FrameStep::Passed { real, is_whole: true, .. } if ONE.contains(&real))
            || step == FrameStep::Restarted
    }

    /// The steps of those that wait up to a new start of the device, and their places from the last frame on, as far as
    /// no turn of the counter is counted.
    pub(super) fn steps(&self, last: &LastFrame) -> Vec<(FrameStep, u64)> {
        let (mut numbers, mut since_ns, mut place) = (last.numbers, last.by_ns, 0u64);
        let mut steps = Vec::with_capacity(self.waiting.len());
        for (observed, _) in &self.waiting {
            let step = self.step_from(&numbers, since_ns, observed);
            match step {
                FrameStep::Restarted => break,
                FrameStep::Repeated => {}
                FrameStep::Passed { least, .. } => {
                    place = place.saturating_add(least);
                    (numbers, since_ns) = (Numbers::of(observed), observed.arrival.unwrap_or_default().by_ns);
                }
            }
            steps.push((step, place));
        }
        steps
    }

    /// How late each of those that wait is against a line \[ns\], and how long it may have been there before it was
    /// seen \[ns\].
    pub(super) fn lateness<'a>(
        &'a self,
        line: &'a Line,
        steps: &'a [(FrameStep, u64)],
    ) -> impl Iterator<Item = (f64, f64)> + 'a {
        self.waiting.iter().zip(steps).map(|((observed, _), (_, place))| {
            let FrameArrival { after_ns, by_ns } = observed.arrival.unwrap_or_default();
            (line.late(by_ns, *place as f64), by_ns.saturating_sub(after_ns) as f64)
        })
    }
}
