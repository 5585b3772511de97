//! What counter and clock of a device say about the step from one frame to the next.

use crate::frames::FrameArrival;

/// The device's counter.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Counter {
    /// It counts modulo 2 to this power, 1 to 64.
    pub(crate) bits: u32,
    /// What it rises by from frame to frame.
    pub(crate) step: u64,
}

/// The device's clock.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct DeviceClock {
    /// After this time it begins at 0 again \[ns\]; `None`: never.
    pub(crate) turn_ns: Option<u64>,
}

/// What is known of a frame's time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct FrameObservation {
    /// When it was sampled, if bytes were never late: its arrival less all known delays; `None` if its bytes do not
    /// come at their time, as from a file.
    pub(crate) arrival: Option<FrameArrival>,
    /// The counter.
    pub(crate) counter: Option<u64>,
    /// The device's clock \[ns\].
    pub(crate) clock_ns: Option<u64>,
    /// Frames lost before it, as far as damaged bytes show them.
    pub(crate) damaged: u64,
    /// Whether the device was away before it.
    pub(crate) after_outage: bool,
    /// Whether it says the same as the frame before it, in all its numbers.
    pub(crate) is_same: bool,
}

/// The numbers of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Numbers {
    pub(super) counter: u64,
    pub(super) clock_ns: u64,
}

impl Numbers {
    pub(super) fn of(observed: &FrameObservation) -> Self {
        let FrameObservation { counter, clock_ns, .. } = *observed;
        Self { counter: counter.unwrap_or_default(), clock_ns: clock_ns.unwrap_or_default() }
    }
}

/// The step from one frame to the next, as the device has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FrameStep {
    /// The device has started again, or its counter or clock jumped.
    Restarted,
    /// The frame before once more.
    Repeated,
    /// So much later.
    Passed {
        /// Periods as a real number; 1 without counter and clock.
        real: f64,
        /// Periods, as far as no turn of the counter is counted; 1 or more.
        least: u64,
        /// Whether the counter rose by whole steps.
        is_whole: bool,
    },
}

/// How a device numbers its frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameNumbering {
    /// The interval that the device is taken to have \[ns\].
    pub(super) interval: f64,
    pub(super) counter: Option<Counter>,
    pub(super) clock: Option<DeviceClock>,
    /// How coarse the clock is seen to be \[ns\]; 0 if it is finer than the interval.
    pub(super) grain_ns: u64,
}

impl FrameNumbering {
    /// The step to a frame, of which at most `most` periods can have passed by the clock of this machine.
    pub(super) fn step(&self, last: &Numbers, observed: &FrameObservation, limit: f64) -> FrameStep {
        let by_clock = match (&self.clock, observed.clock_ns) {
            (Some(clock), Some(now)) => {
                // Set back, which counts as nearly a turn.
                let passed = clock.passed(last.clock_ns, now).filter(|ns| *ns as f64 / self.interval <= limit);
                let Some(passed) = passed.filter(|_| observed.arrival.is_some() || !clock.is_back(last.clock_ns, now))
                else {
                    return FrameStep::Restarted;
                };
                Some(passed)
            }
            _ => None,
        };
        if let (Some(counter), Some(now)) = (&self.counter, observed.counter) {
            let rise = wrapped(now.wrapping_sub(last.counter), counter.bits);
            if rise == 0 && by_clock.is_none_or(|passed| (passed as f64) < self.interval) {
                return FrameStep::Repeated;
            }
            let (real, is_whole) = (rise as f64 / counter.step as f64, rise.is_multiple_of(counter.step));
            if real > limit {
                return FrameStep::Restarted;
            }
            // The clock counts the turns of the counter.
            let turn = counter.turn() as f64;
            let passed = by_clock.map_or(0.0, |ns| ns as f64 / self.interval);
            let turns = ((passed - real) / turn).round().max(0.0);
            let least = ((real + turns * turn) as u64).max(1);
            return FrameStep::Passed { real: real + turns * turn, least, is_whole };
        }
        match by_clock {
            Some(0) if observed.is_same => FrameStep::Repeated,
            // A clock that is coarser than the interval stands still between two frames.
            Some(passed) if passed <= self.grain_ns => FrameStep::Passed { real: 1.0, least: 1, is_whole: true },
            Some(passed) => {
                let real = (passed - self.grain_ns) as f64 / self.interval;
                FrameStep::Passed { real, least: (real.round() as u64).max(1), is_whole: true }
            }
            None => FrameStep::Passed { real: 1.0, least: 1 + observed.damaged, is_whole: true },
        }
    }

    /// Whether the device itself shows how many periods have passed.
    pub(super) const fn counts(&self) -> bool {
        self.counter.is_some() || self.clock.is_some()
    }
}

impl Counter {
    /// Periods in one turn; 2^64 counts as one less.
    #[must_use]
    pub(crate) const fn turn(&self) -> u64 {
        match 1u64.checked_shl(self.bits) {
            Some(turn) => turn / self.step,
            None => u64::MAX / self.step,
        }
    }

    /// By how much it rose.
    pub(super) const fn rise(&self, last: u64, now: u64) -> u64 {
        wrapped(now.wrapping_sub(last), self.bits)
    }
}

impl DeviceClock {
    /// The time from one reading to the next \[ns\]; `None` if it was set back.
    pub(super) fn passed(&self, last: u64, now: u64) -> Option<u64> {
        match (now.checked_sub(last), self.turn_ns) {
            (Some(passed), _) => Some(passed),
            (None, Some(turn)) => now.checked_add(turn)?.checked_sub(last),
            (None, None) => None,
        }
    }

    /// Whether it was set back, as far as less than half a turn can show.
    fn is_back(&self, last: u64, now: u64) -> bool {
        self.turn_ns.is_some_and(|turn| self.passed(last, now).is_none_or(|passed| passed > turn / 2))
    }
}

const fn wrapped(number: u64, bits: u32) -> u64 {
    if bits >= 64 { number } else { number & ((1 << bits) - 1) }
}
