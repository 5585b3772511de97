//! The place of one frame after the one before.

use super::line::Line;
use super::measured::RateMeasurement;
use super::number::{FrameStep, Numbers};
use super::{FrameObservation, FramePlace, FramePlacement, LastFrame, Timeline};

impl<T> Timeline<T> {
    /// Places the frame of the front, which has waited: before it so many more periods are lost, and so much time
    /// \[ns\].
    pub(super) fn place_front(&mut self, lost: u64, more: f64, is_ambiguous: bool) {
        let Some((front, _)) = self.waiting.front() else { return };
        let front = *front;
        let placed = self.place_after(&front, lost, more, is_ambiguous, false);
        self.hand_out(placed);
    }

    /// Places a frame that is not in doubt.
    pub(super) fn place(&mut self, observed: &FrameObservation) -> FramePlacement {
        self.is_doubted = false;
        self.place_after(observed, 0, 0.0, false, true)
    }

    fn place_after(
        &mut self,
        observed: &FrameObservation,
        lost: u64,
        more: f64,
        is_ambiguous: bool,
        moves: bool,
    ) -> FramePlacement {
        let by_ns = observed.arrival.map_or(0, |arrival| arrival.by_ns);
        let Some(mut last) = self.last else { return self.placed(FramePlace::Repeated, 0) };
        let FrameStep::Passed { least, .. } = self.step_from(&last.numbers, last.by_ns, observed) else {
            return self.placed(FramePlace::Repeated, last.line.timestamp_ns);
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
                true => *measured = RateMeasurement::after(arrival.by_ns),
                false => measured.count(arrival.by_ns, periods),
            }
        }
        self.placed(FramePlace::Next { periods, is_ambiguous }, timestamp_ns)
    }

    /// The stamp of a frame, by the device's clock or by the line; `None` if it cannot rise.
    fn stamp(&self, last: &LastFrame, observed: &FrameObservation, on_line: Option<u64>) -> Option<u64> {
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
    pub(super) fn look_at_clock(&mut self, observed: &FrameObservation) {
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

    fn place_anew(&mut self, observed: &FrameObservation, before_ns: u64) -> FramePlacement {
        let by_ns = observed.arrival.map(|arrival| arrival.by_ns);
        // Two sessions of a file follow each other.
        let origin = by_ns.unwrap_or(before_ns.saturating_add(self.numbering.interval as u64));
        let clock_ns = observed.clock_ns.filter(|_| self.numbering.clock.is_some());
        let timestamp_ns = clock_ns.unwrap_or(origin);
        let line = Line::new(origin, timestamp_ns, self.numbering.interval, [0.0, 1.0]);
        let numbers = Numbers::of(observed);
        self.last = Some(LastFrame { line, numbers, clock_stamp_ns: timestamp_ns, by_ns: by_ns.unwrap_or_default() });
        self.measure_anew(observed.arrival);
        self.placed(FramePlace::First, timestamp_ns)
    }

    /// Places a frame that has no time of its own on this machine.
    pub(super) fn place_without_arrival(&mut self, observed: &FrameObservation) -> FramePlacement {
        let Some(last) = self.last else { return self.place_anew(observed, 0) };
        match self.step_from(&last.numbers, last.by_ns, observed) {
            FrameStep::Restarted | FrameStep::Passed { is_whole: false, .. } => {
                self.place_anew(observed, last.line.timestamp_ns)
            }
            FrameStep::Repeated | FrameStep::Passed { .. } => self.place_after(observed, 0, 0.0, false, false),
        }
    }

    pub(super) fn placed(&self, place: FramePlace, timestamp_ns: u64) -> FramePlacement {
        FramePlacement {
            place,
            timestamp_ns,
            interval_ns: self.numbering.interval as u64,
            is_certain: !self.is_doubted,
        }
    }
}
