//! When frames are in doubt, and where they are placed.

use super::line::{HELD_BACK_NS, Line};
use super::measured::Measured;
use super::number::{Numbers, Step};
use super::pace::{FRAMES, Pace, WINDOW_NS};
use super::{Doubt, Last, Observed, Place, Placed, Timeline};
use crate::frames::Arrival;

/// Time that a counter may seem to run ahead of the clock \[s\].
const AHEAD_S: f64 = 0.5;
/// The longest wait \[ns\].
const WAIT_NS: u64 = 250_000_000;
/// The longest wait of the first frames of all, while they contradict each other \[ns\].
const FIRST_WAIT_NS: u64 = 2_000_000_000;
/// Part of a turn of the counter by which frames may be late before the turn is in doubt.
const TURN: f64 = 0.35;
/// Part of the window of the rate by which frames may be late, or early, before the rate is in doubt.
const LATE: f64 = 0.3;
const EARLY: f64 = 0.2;
/// How late, in intervals, a frame of a device without counter and clock may be.
const LATE_INTERVALS: f64 = 0.75;
/// Times the mean jitter that arrivals may be off.
const JITTERS: f64 = 4.0;
/// Time by which a counter that went on may be off after a silence \[ns\], and the part of the silence \[1\]. Beyond it
/// the device has started again.
const GOES_ON: (f64, f64) = (10e6, 2e-4);
/// By how much time a number that has jumped may differ from the clock, beside two intervals and the jitter \[ns\].
const NUMBER_NS: f64 = 5e6;
/// Frames that came an interval apart, up to this part of it, show that none of them was late.
const STEADY: usize = 8;
const STEADY_PART: f64 = 0.4;
/// A counter that turns no faster than this tells by itself whether it went on \[ns\].
const SLOW_TURN_NS: f64 = 1e9;
/// Steps that datagrams may be behind.
const BEHIND: u64 = 32;
/// A number that rises by one period, in periods.
const ONE: std::ops::Range<f64> = 0.6..1.5;
/// Jitter of the first frames that counts \[ns\], and two intervals more.
const FIRST_JITTER_NS: f64 = 20e6;

impl<T> Timeline<T> {
    /// Why a frame has to wait, if it does.
    pub(super) fn doubt_of(&self, front: &Observed) -> Option<Doubt> {
        let Some(last) = self.last else { return Some(Doubt::Beginning) };
        let Arrival { after_ns, by_ns } = front.arrival.unwrap_or_default();
        let (line, interval) = (&last.line, self.numbering.interval);
        let (real, least, is_whole) = match self.step_from(&last.numbers, last.by_ns, front) {
            Step::Restarted => return Some(Doubt::Beginning),
            Step::Repeated => return None,
            Step::Passed { real, least, is_whole } => (real, least, is_whole),
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

    /// Periods in a turn of a counter without a clock beside it.
    fn turn(&self) -> Option<f64> {
        let counter = self.numbering.counter.filter(|_| self.numbering.clock.is_none());
        counter.map(|counter| counter.turn() as f64)
    }

    /// The step from a frame that came at `since_ns` to another one.
    fn step_from(&self, numbers: &Numbers, since_ns: u64, to: &Observed) -> Step {
        if self.is_behind(numbers, to) {
            return Step::Repeated;
        }
        let most = to.arrival.map_or(f64::INFINITY, |arrival| {
            arrival.by_ns.saturating_sub(since_ns) as f64 / self.numbering.interval
                + 2.0
                + AHEAD_S * 1e9 / self.numbering.interval
        });
        self.numbering.step(numbers, to, most)
    }

    /// Whether a datagram was overtaken by the one with these numbers.
    fn is_behind(&self, numbers: &Numbers, to: &Observed) -> bool {
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
                Some(Step::Passed { real, .. }) => self.trace.push(by_ns, real, observed.damaged > 0),
                Some(Step::Repeated) => {}
                Some(Step::Restarted) | None => {
                    self.trace.clear();
                    self.trace.push(by_ns, 0.0, false);
                }
            }
        }
        self.traced = self.waiting.len();
    }

    /// Whether what waits can be placed at this time \[ns\].
    pub(super) fn is_decided(&self, doubt: Doubt, front: &Observed, now_ns: u64) -> bool {
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
    fn is_steady(&self, last: &Last) -> bool {
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
    fn is_in_time(&self, last: &Last) -> bool {
        self.late_of_newest(last).is_some_and(|late| late.abs() <= self.tolerance(last))
    }

    /// By how much time a number that has jumped may differ from the clock \[ns\].
    fn tolerance(&self, last: &Last) -> f64 {
        2.0 * last.line.rate() + JITTERS * last.line.jitter() + NUMBER_NS
    }

    /// How late the newest of those that wait is \[ns\], if it was seen at its time.
    fn late_of_newest(&self, last: &Last) -> Option<f64> {
        let periods = self.steps(last).last().map_or(0, |(_, place)| *place);
        let arrival = self.waiting.back()?.0.arrival?;
        let is_seen = arrival.by_ns.saturating_sub(arrival.after_ns) as f64 <= HELD_BACK_NS;
        is_seen.then(|| last.line.late(arrival.by_ns, periods as f64))
    }

    /// Whether the newest of those that wait came at its time.
    fn has_caught_up(&self, last: &Last) -> bool {
        let line = &last.line;
        let allowed = 0.5 * LATE_INTERVALS * self.numbering.interval + 0.5 * JITTERS * line.jitter();
        self.late_of_newest(last).is_some_and(|late| late.abs() < allowed.max(1.5 * line.low().abs()))
    }

    /// Whether the number rises by one period again: what was missing was lost.
    fn is_regular_again(&self) -> bool {
        let Some(at) = self.waiting.len().checked_sub(2) else { return false };
        let (Some((before, _)), Some((newest, _))) = (self.waiting.get(at), self.waiting.back()) else { return false };
        let since_ns = before.arrival.unwrap_or_default().by_ns;
        let step = self.step_from(&Numbers::of(before), since_ns, newest);
        matches!(step, Step::Passed { real, is_whole: true, .. } if ONE.contains(&real)) || step == Step::Restarted
    }

    /// The steps of those that wait up to a new start of the device, and their places from the last frame on, as far as
    /// no turn of the counter is counted.
    fn steps(&self, last: &Last) -> Vec<(Step, u64)> {
        let (mut numbers, mut since_ns, mut place) = (last.numbers, last.by_ns, 0u64);
        let mut steps = Vec::with_capacity(self.waiting.len());
        for (observed, _) in &self.waiting {
            let step = self.step_from(&numbers, since_ns, observed);
            match step {
                Step::Restarted => break,
                Step::Repeated => {}
                Step::Passed { least, .. } => {
                    place = place.saturating_add(least);
                    (numbers, since_ns) = (Numbers::of(observed), observed.arrival.unwrap_or_default().by_ns);
                }
            }
            steps.push((step, place));
        }
        steps
    }

    /// Places all that waits, up to a new start of the device.
    pub(super) fn settle(&mut self, doubt: Doubt) {
        let last = self.last.filter(|_| doubt != Doubt::Beginning);
        match self.trace.pace(self.numbering.interval) {
            // Frames that were late and catch up come fast.
            _ if !self.has_pace => {}
            _ if doubt == Doubt::Time && last.is_some_and(|last| self.has_caught_up(&last)) => self.is_doubted = false,
            _ if doubt == Doubt::Number && self.is_regular_again() => self.is_doubted = false,
            Pace::Off { factor, .. }
                if factor < 1.0
                    && last.is_some_and(|last| self.late_of_newest(&last).is_none_or(|late| late > 0.0)) => {}
            Pace::Off { factor, step } => self.adopt(self.numbering.interval * factor, step),
            Pace::Right => self.is_doubted = false,
            Pace::Open => self.is_doubted = self.trace.is_suspicious(self.numbering.interval),
        }
        (self.doubt, self.traced) = (None, 0);
        let newest = self.take_overtaker();
        match self.last.filter(|_| doubt != Doubt::Beginning) {
            Some(last) => self.go_on(&last, doubt),
            None => self.begin(),
        }
        self.waiting.extend(newest);
    }

    /// Takes the newest of those that wait away, if it may have overtaken the next one.
    fn take_overtaker(&mut self) -> Option<(Observed, T)> {
        let at = self.waiting.len().checked_sub(2).filter(|_| self.may_overtake)?;
        let (before, _) = self.waiting.get(at)?;
        let since_ns = before.arrival.unwrap_or_default().by_ns;
        let step = self.step_from(&Numbers::of(before), since_ns, &self.waiting.back()?.0);
        let overtakes = matches!(step, Step::Passed { real, .. } if real >= ONE.end);
        if overtakes { self.waiting.pop_back() } else { None }
    }

    /// Begins a session with what waits.
    fn begin(&mut self) {
        let Some((first, _)) = self.waiting.front() else { return };
        let (first, interval) = (*first, self.numbering.interval);
        let Arrival { by_ns, .. } = first.arrival.unwrap_or_default();
        let numbers = Numbers::of(&first);
        let seed = Last { line: Line::new(by_ns, by_ns, interval, [0.0, 1.0]), numbers, clock_stamp_ns: 0, by_ns };
        // The first one itself is a repeat of what the steps begin with.
        let mut steps = self.steps_after_first(&seed);
        steps.insert(0, (Step::Repeated, 0));
        let lateness: Vec<_> = self.lateness(&seed.line, &steps).collect();
        let earliest = lateness.iter().map(|(late, _)| *late).fold(f64::INFINITY, f64::min).min(0.0);
        let origin = (by_ns as f64 + earliest).max(0.0) as u64;
        let most = FIRST_JITTER_NS + 2.0 * interval;
        let seen: Vec<_> = lateness.iter().filter(|(_, width)| *width <= most).collect();
        let sum: f64 = seen.iter().map(|(late, _)| (late - earliest).min(most)).sum();
        let jitter = sum / (seen.len() as f64).max(1.0);
        let timestamp_ns = first.clock_ns.filter(|_| self.numbering.clock.is_some()).unwrap_or(origin);
        let line = Line::new(origin, timestamp_ns, interval, [jitter, seen.len() as f64]);
        self.last = Some(Last { line, numbers, clock_stamp_ns: timestamp_ns, by_ns });
        let newest = self.waiting.get(steps.len() - 1).and_then(|(observed, _)| observed.arrival);
        self.measure_anew(newest);
        let placed = self.placed(Place::First, timestamp_ns);
        self.hand_out(placed);
        for _ in 1..steps.len() {
            self.place_front(0, 0.0, false);
        }
    }

    fn steps_after_first(&mut self, seed: &Last) -> Vec<(Step, u64)> {
        let Some(first) = self.waiting.pop_front() else { return Vec::new() };
        let steps = self.steps(seed);
        self.waiting.push_front(first);
        steps
    }

    /// How late each of those that wait is against a line \[ns\], and how long it may have been there before it was
    /// seen \[ns\].
    fn lateness<'a>(&'a self, line: &'a Line, steps: &'a [(Step, u64)]) -> impl Iterator<Item = (f64, f64)> + 'a {
        self.waiting.iter().zip(steps).map(|((observed, _), (_, place))| {
            let Arrival { after_ns, by_ns } = observed.arrival.unwrap_or_default();
            (line.late(by_ns, *place as f64), by_ns.saturating_sub(after_ns) as f64)
        })
    }

    /// Goes on with what waits, after the last frame.
    fn go_on(&mut self, last: &Last, doubt: Doubt) {
        let steps = self.steps(last);
        if steps.is_empty() {
            // The device has started again with the first of them.
            return self.begin();
        }
        let is_gap = |at: usize| {
            let damaged = self.waiting.get(at).is_some_and(|(observed, _)| observed.damaged > 0);
            damaged || matches!(steps.get(at), Some((Step::Passed { real, .. }, _)) if *real >= ONE.end)
        };
        let place = (0..steps.len()).find(|at| is_gap(*at)).unwrap_or(0);
        let (line, interval) = (&last.line, self.numbering.interval);
        let earliest = self.lateness(line, &steps).skip(place).map(|(late, _)| late).fold(f64::INFINITY, f64::min);
        let late = earliest - line.low();
        if matches!(steps.first(), Some((Step::Passed { is_whole: false, .. }, _))) {
            return self.begin();
        }
        let is_in_time = match doubt {
            Doubt::Number | Doubt::Beginning => late.abs() <= self.tolerance(last) || self.has_caught_up(last),
            Doubt::Time => self.has_caught_up(last) || late.abs() <= 0.5 * interval,
            Doubt::Outage => false,
        };
        // A device that has paused for a moment is late from then on.
        let is_off = late.abs() > LATE_INTERVALS * interval + JITTERS * line.jitter();
        let more = if doubt == Doubt::Number && is_off { late } else { 0.0 };
        let in_time = Lost { more, ..Lost::default() };
        let lost = if is_in_time { Some(in_time) } else { self.lost(last, &steps, place, late) };
        let Some(lost) = lost else { return self.begin() };
        // What the device did while nothing came is not known.
        if lost.periods > 0 || doubt == Doubt::Outage {
            let newest = self.waiting.get(steps.len() - 1).and_then(|(observed, _)| observed.arrival);
            self.measure_anew(newest);
        }
        for at in 0..steps.len() {
            match at == place {
                true => self.place_front(lost.periods, lost.more, lost.is_ambiguous),
                false => self.place_front(0, 0.0, false),
            }
        }
    }

    /// What was lost before frames that are late by so much \[ns\]; `None` if the device has started again.
    fn lost(&self, last: &Last, steps: &[(Step, u64)], place: usize, late: f64) -> Option<Lost> {
        let (rate, jitter) = (last.line.rate(), JITTERS * last.line.jitter());
        if self.numbering.clock.is_some() {
            return Some(Lost { more: late, ..Lost::default() });
        }
        let periods = late / rate;
        let Some(turn) = self.turn() else {
            let lost = periods.round().max(0.0);
            let is_ambiguous = (periods - lost).abs() > 0.35 || jitter > 0.5 * rate;
            return Some(Lost {
                periods: lost as u64,
                more: late - lost * rate,
                is_ambiguous: is_ambiguous && lost > 0.0,
            });
        };
        let lost = (periods / turn).round().max(0.0) * turn;
        let off = (periods - lost).abs();
        let tolerance = 2.0 * rate + jitter + GOES_ON.0 + GOES_ON.1 * late.abs();
        let is_next = matches!(steps.get(place), Some((Step::Passed { real, .. }, _)) if ONE.contains(real));
        // A counter that turns slowly begins anew with a jump.
        if turn * rate >= SLOW_TURN_NS && lost == 0.0 {
            return Some(Lost { more: late, ..Lost::default() });
        }
        // Where the jitter is as long as a turn, nothing shows whether the device has started again.
        let is_blind = tolerance >= TURN * turn * rate;
        if off * rate > tolerance && !is_blind && !is_next {
            return None;
        }
        let is_ambiguous = (is_blind || off > TURN * turn) && !is_next;
        Some(Lost { periods: lost as u64, more: late - lost * rate, is_ambiguous })
    }

    /// Places the frame of the front, which has waited: before it so many more periods are lost, and so much time
    /// \[ns\].
    fn place_front(&mut self, lost: u64, more: f64, is_ambiguous: bool) {
        let Some((front, _)) = self.waiting.front() else { return };
        let front = *front;
        let placed = self.place_after(&front, lost, more, is_ambiguous, false);
        self.hand_out(placed);
    }

    /// Places a frame that is not in doubt.
    pub(super) fn place(&mut self, observed: &Observed) -> Placed {
        self.is_doubted = false;
        self.place_after(observed, 0, 0.0, false, true)
    }

    fn place_after(&mut self, observed: &Observed, lost: u64, more: f64, is_ambiguous: bool, moves: bool) -> Placed {
        let by_ns = observed.arrival.map_or(0, |arrival| arrival.by_ns);
        let Some(mut last) = self.last else { return self.placed(Place::Repeated, 0) };
        let Step::Passed { least, .. } = self.step_from(&last.numbers, last.by_ns, observed) else {
            return self.placed(Place::Repeated, last.line.timestamp_ns);
        };
        let periods = least.max(1).saturating_add(lost);
        let on_line = last.line.pass(periods, more);
        let interval = self.numbering.interval;
        let timestamp_ns = self.stamp(&last, observed, on_line);
        if let (true, Some(arrival)) = (moves, observed.arrival) {
            last.line.follow(interval, periods, arrival);
        }
        // A device that says so for over 584 years counts something else.
        let Some(timestamp_ns) = timestamp_ns else {
            self.last = None;
            return self.place_anew(observed, last.line.timestamp_ns);
        };
        let numbers = Numbers::of(observed);
        let passed = self.numbering.clock.and_then(|clock| clock.passed(last.numbers.clock_ns, numbers.clock_ns));
        last.clock_stamp_ns = last.clock_stamp_ns.saturating_add(passed.unwrap_or_default());
        last.line.timestamp_ns = timestamp_ns;
        (last.numbers, last.by_ns) = (numbers, by_ns);
        self.last = Some(last);
        if let (Some(measured), Some(arrival)) = (&mut self.measured, observed.arrival) {
            match observed.after_outage {
                // What the device did while it was away is not known.
                true => *measured = Measured::after(arrival.by_ns),
                false => measured.count(arrival.by_ns, periods),
            }
        }
        self.placed(Place::Next { periods, is_ambiguous }, timestamp_ns)
    }

    /// The stamp of a frame, by the device's clock or by the line; `None` if it cannot rise.
    fn stamp(&self, last: &Last, observed: &Observed, on_line: Option<u64>) -> Option<u64> {
        let (Some(clock), Some(now)) = (self.numbering.clock, observed.clock_ns) else { return on_line };
        let interval = self.numbering.interval;
        let before = last.line.timestamp_ns;
        // A clock that is coarser than the interval may stand still.
        let least = if self.numbering.grain_ns > 0 { (0.6 * interval) as u64 } else { 1 };
        match clock.passed(last.numbers.clock_ns, now).unwrap_or_default() {
            0 => before.checked_add((interval as u64).max(1)),
            passed => Some(last.clock_stamp_ns.checked_add(passed)?.max(before.checked_add(least)?)),
        }
    }

    /// Looks whether the clock is coarser than the interval: it stands still between two frames that differ.
    pub(super) fn look_at_clock(&mut self, observed: &Observed) {
        let (Some(clock), Some(now)) = (self.numbering.clock, observed.clock_ns) else { return };
        let Some((before, stood)) = self.pushed_clock.replace((now, false)) else { return };
        match clock.passed(before, now) {
            Some(0) => self.pushed_clock = Some((now, stood || !observed.is_same)),
            Some(passed) if stood => {
                let grain = self.numbering.grain_ns;
                self.numbering.grain_ns = if grain == 0 { passed } else { grain.min(passed) };
            }
            _ => {}
        }
    }

    fn place_anew(&mut self, observed: &Observed, before_ns: u64) -> Placed {
        let by_ns = observed.arrival.map(|arrival| arrival.by_ns);
        // Two sessions of a file follow each other.
        let origin = by_ns.unwrap_or(before_ns.saturating_add(self.numbering.interval as u64));
        let clock_ns = observed.clock_ns.filter(|_| self.numbering.clock.is_some());
        let timestamp_ns = clock_ns.unwrap_or(origin);
        let line = Line::new(origin, timestamp_ns, self.numbering.interval, [0.0, 1.0]);
        let numbers = Numbers::of(observed);
        self.last = Some(Last { line, numbers, clock_stamp_ns: timestamp_ns, by_ns: by_ns.unwrap_or_default() });
        self.measure_anew(observed.arrival);
        self.placed(Place::First, timestamp_ns)
    }

    /// Places a frame that has no time of its own on this machine.
    pub(super) fn place_without_arrival(&mut self, observed: &Observed) -> Placed {
        let Some(last) = self.last else { return self.place_anew(observed, 0) };
        match self.step_from(&last.numbers, last.by_ns, observed) {
            Step::Restarted | Step::Passed { is_whole: false, .. } => self.place_anew(observed, last.line.timestamp_ns),
            Step::Repeated | Step::Passed { .. } => self.place_after(observed, 0, 0.0, false, false),
        }
    }

    fn placed(&self, place: Place, timestamp_ns: u64) -> Placed {
        Placed { place, timestamp_ns, interval_ns: self.numbering.interval as u64, is_certain: !self.is_doubted }
    }
}

/// What was lost before a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Lost {
    /// Periods beyond those that the device's numbers tell.
    periods: u64,
    /// Time beyond them \[ns\].
    more: f64,
    is_ambiguous: bool,
}
