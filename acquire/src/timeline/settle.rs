//! What has waited is placed with what came after it.

use super::doubt::{JITTERS, LATE_INTERVALS, ONE, TURN};
use super::line::Line;
use super::number::{FrameStep, Numbers};
use super::pace::Pace;
use super::{Doubt, FrameObservation, FramePlace, LastFrame, Timeline};
use crate::frames::FrameArrival;

/// Time by which a counter that went on may be off after a silence \[ns\], and the part of the silence \[1\]. Beyond it
/// the device has started again.
const GOES_ON: (f64, f64) = (10e6, 2e-4);
/// A counter that turns no faster than this shows by itself whether it continued \[ns\].
const SLOW_TURN_NS: f64 = 1e9;
/// Jitter of the first frames that counts \[ns\], and two intervals more.
const FIRST_JITTER_NS: f64 = 20e6;

impl<T> Timeline<T> {
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
    fn take_overtaker(&mut self) -> Option<(FrameObservation, T)> {
        let at = self.waiting.len().checked_sub(2).filter(|_| self.may_overtake)?;
        let (before, _) = self.waiting.get(at)?;
        let since_ns = before.arrival.unwrap_or_default().by_ns;
        let step = self.step_from(&Numbers::of(before), since_ns, &self.waiting.back()?.0);
        let overtakes = matches!(step, FrameStep::Passed { real, .. } if real >= ONE.end);
        if overtakes { self.waiting.pop_back() } else { None }
    }

    /// Begins a session with what waits.
    fn begin(&mut self) {
        let Some((first, _)) = self.waiting.front() else { return };
        let (first, interval) = (*first, self.numbering.interval);
        let FrameArrival { by_ns, .. } = first.arrival.unwrap_or_default();
        let numbers = Numbers::of(&first);
        let seed = LastFrame { line: Line::new(by_ns, by_ns, interval, [0.0, 1.0]), numbers, clock_stamp_ns: 0, by_ns };
        // The first one itself is a repeat of what the steps begin with.
        let mut steps = self.steps_after_first(&seed);
        steps.insert(0, (FrameStep::Repeated, 0));
        let lateness: Vec<_> = self.lateness(&seed.line, &steps).collect();
        let earliest = lateness.iter().map(|(late, _)| *late).fold(f64::INFINITY, f64::min).min(0.0);
        let origin = (by_ns as f64 + earliest).max(0.0) as u64;
        let limit = FIRST_JITTER_NS + 2.0 * interval;
        let seen: Vec<_> = lateness.iter().filter(|(_, width)| *width <= limit).collect();
        let sum: f64 = seen.iter().map(|(late, _)| (late - earliest).min(limit)).sum();
        let jitter = sum / (seen.len() as f64).max(1.0);
        let timestamp_ns = first.clock_ns.filter(|_| self.numbering.clock.is_some()).unwrap_or(origin);
        let line = Line::new(origin, timestamp_ns, interval, [jitter, seen.len() as f64]);
        self.last = Some(LastFrame { line, numbers, clock_stamp_ns: timestamp_ns, by_ns });
        let newest = self.waiting.get(steps.len() - 1).and_then(|(observed, _)| observed.arrival);
        self.measure_anew(newest);
        let placed = self.placed(FramePlace::First, timestamp_ns);
        self.hand_out(placed);
        for _ in 1..steps.len() {
            self.place_front(0, 0.0, false);
        }
    }

    fn steps_after_first(&mut self, seed: &LastFrame) -> Vec<(FrameStep, u64)> {
        let Some(first) = self.waiting.pop_front() else { return Vec::new() };
        let steps = self.steps(seed);
        self.waiting.push_front(first);
        steps
    }

    /// Goes on with what waits, after the last frame.
    fn go_on(&mut self, last: &LastFrame, doubt: Doubt) {
        let steps = self.steps(last);
        if steps.is_empty() {
            // The device has started again with the first of them.
            return self.begin();
        }
        let is_gap = |at: usize| {
            let damaged = self.waiting.get(at).is_some_and(|(observed, _)| observed.damaged > 0);
            damaged || matches!(steps.get(at), Some((FrameStep::Passed { real, .. }, _)) if *real >= ONE.end)
        };
        let place = (0..steps.len()).find(|at| is_gap(*at)).unwrap_or(0);
        let (line, interval) = (&last.line, self.numbering.interval);
        let earliest = self.lateness(line, &steps).skip(place).map(|(late, _)| late).fold(f64::INFINITY, f64::min);
        let late = earliest - line.low();
        if matches!(steps.first(), Some((FrameStep::Passed { is_whole: false, .. }, _))) {
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
        let in_time = FrameLoss { more, ..FrameLoss::default() };
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
    fn lost(&self, last: &LastFrame, steps: &[(FrameStep, u64)], place: usize, late: f64) -> Option<FrameLoss> {
        let (rate, jitter) = (last.line.rate(), JITTERS * last.line.jitter());
        if self.numbering.clock.is_some() {
            return Some(FrameLoss { more: late, ..FrameLoss::default() });
        }
        let periods = late / rate;
        let Some(turn) = self.turn() else {
            let lost = periods.round().max(0.0);
            let is_ambiguous = (periods - lost).abs() > 0.35 || jitter > 0.5 * rate;
            return Some(FrameLoss {
                periods: lost as u64,
                more: late - lost * rate,
                is_ambiguous: is_ambiguous && lost > 0.0,
            });
        };
        let lost = (periods / turn).round().max(0.0) * turn;
        let off = (periods - lost).abs();
        let tolerance = 2.0 * rate + jitter + GOES_ON.0 + GOES_ON.1 * late.abs();
        let is_next = matches!(steps.get(place), Some((FrameStep::Passed { real, .. }, _)) if ONE.contains(real));
        // A counter that turns slowly begins anew with a jump.
        if turn * rate >= SLOW_TURN_NS && lost == 0.0 {
            return Some(FrameLoss { more: late, ..FrameLoss::default() });
        }
        // Where the jitter is as long as a turn, nothing shows whether the device has started again.
        let is_blind = tolerance >= TURN * turn * rate;
        if off * rate > tolerance && !is_blind && !is_next {
            return None;
        }
        let is_ambiguous = (is_blind || off > TURN * turn) && !is_next;
        Some(FrameLoss { periods: lost as u64, more: late - lost * rate, is_ambiguous })
    }
}

/// What was lost before a frame.
#[derive(Clone, Copy, Debug, Default)]
struct FrameLoss {
    /// Periods beyond those that the device's numbers show.
    periods: u64,
    /// Time beyond them \[ns\].
    more: f64,
    is_ambiguous: bool,
}
