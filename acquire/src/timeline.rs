//! Which control period a frame is, and when it was sampled.
//!
//! # Periods
//! From one frame to the next n periods pass. The number is
//! * with a counter of M periods a turn: of its rise d plus whole turns, the one nearest to the time that has passed;
//! * with a clock of the device: the time that has passed on it over the interval, rounded;
//! * with neither: 1, and what damaged bytes show; and the time over the interval, rounded, after a silence of a
//!   quarter of a second. Whole frames that vanish without a trace in less time are not seen then.
//!
//! Where bytes were damaged or the device was away, the time counts at once. Else frames may be late and catch up, as
//! after a pause of an adapter: then turns and silences count once frames have been late for a quarter of a second, and
//! the gap is said to be ambiguous.
//!
//! # Time
//! Bytes arrive late, by the line's delays and in bursts, as from USB. So the moment of a sample is a line through the
//! arrivals, whose phase and rate follow with a time constant of about a second: with the error e of an arrival,
//! ```text
//! x = t + n r        t = x + a e        r = r + b e / n
//! a = 2 z w T, or 1/(m + 1) for the m-th frame while that is more      b = (w T)^2 after the first second
//! w = 2 / s, z = 0.7; w T is at most 0.2
//! ```
//! A sample is moved by 1 % of the interval at most. The rate r begins with the nominal interval and stays within 5 %
//! of it. An arrival that was not seen at its time, since this process was held back, moves neither. One that is
//! earlier than its time by more than bursts explain begins the line anew: the frames before had waited somewhere.

use crate::frames::Arrival;

/// By how much the measured rate may differ from the nominal one.
pub(crate) const RATE_LIMIT: f64 = 0.05;
/// Time that a counter may seem to run ahead of the clock \[s\].
const AHEAD_S: f64 = 0.5;
/// A silence that shows lost periods of a device without counter and clock \[s\].
const SILENCE_S: f64 = 0.25;
/// How long frames that are late may take to catch up \[s\].
const CATCH_UP_S: f64 = 0.25;
/// An arrival may have been up to so much earlier \[ns\], and two intervals more, to count for the time.
const HELD_BACK_NS: f64 = 20e6;
/// Largest error of an arrival that counts \[ns\], and two intervals more.
const LARGEST_ERROR_NS: f64 = 50e6;
/// How much the time of a sample is moved at most, in intervals.
const LARGEST_STEP: f64 = 0.01;
/// Angular frequency w of the line's loop \[1/s\], and its damping z.
const LOOP: (f64, f64) = (2.0, 0.7);

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
pub(crate) struct Observed {
    /// When it was sampled, if bytes were never late: its arrival less all known delays; `None` if its bytes do not
    /// come at their time, as from a file.
    pub(crate) arrival: Option<Arrival>,
    /// The counter.
    pub(crate) counter: Option<u64>,
    /// The device's clock \[ns\].
    pub(crate) clock_ns: Option<u64>,
    /// Frames lost before it, as far as damaged bytes show them.
    pub(crate) damaged: u64,
    /// Whether the device was away before it.
    pub(crate) after_outage: bool,
}

/// The place of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Placed {
    /// The first of a session: the first of all, or after the device has started again or was away for longer than a
    /// turn of its counter.
    First {
        /// When it was sampled \[ns\].
        timestamp_ns: u64,
    },
    /// So many periods after the frame before.
    Next {
        /// 1 or more; all but the last are missing.
        periods: u64,
        /// When it was sampled \[ns\].
        timestamp_ns: u64,
        /// Whether another number of turns of the counter is about as near.
        is_ambiguous: bool,
    },
    /// The frame before once more.
    Repeated,
}

/// The frames of one source on the line of time.
#[derive(Clone, Debug)]
pub(crate) struct Timeline {
    interval: f64,
    counter: Option<Counter>,
    clock: Option<DeviceClock>,
    last: Option<Last>,
    measured: Option<Measured>,
    /// Since when frames come later than the interval explains \[ns\].
    late_since: Option<u64>,
}

/// The measurement of the rate.
#[derive(Clone, Copy, Debug)]
struct Measured {
    /// When it began or will begin \[ns\].
    since: f64,
    /// Periods since then.
    periods: u64,
    has_begun: bool,
}

impl Measured {
    /// Begins a second later: what comes first may have waited.
    const fn after(by_ns: u64) -> Self {
        Self { since: by_ns as f64 + 1e9, periods: 0, has_begun: false }
    }

    fn count(&mut self, by_ns: u64, periods: u64) {
        let now = by_ns as f64;
        if self.has_begun {
            self.periods += periods;
        } else if now >= self.since {
            *self = Self { since: now, periods: 0, has_begun: true };
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Last {
    /// What times of the line count from \[ns\].
    origin: u64,
    /// Its time on the line \[ns\].
    time: f64,
    /// Rate of the line \[ns\].
    rate: f64,
    /// Frames that moved the line.
    moved: u64,
    counter: u64,
    clock_ns: u64,
    timestamp_ns: u64,
}

impl Timeline {
    /// A line without frames. `interval_ns` is the nominal interval.
    #[must_use]
    pub(crate) fn new(interval_ns: u64, counter: Option<Counter>, clock: Option<DeviceClock>) -> Self {
        Self { interval: interval_ns as f64, counter, clock, last: None, measured: None, late_since: None }
    }

    /// Places a frame.
    pub(crate) fn place(&mut self, observed: Observed) -> Placed {
        let Some(last) = self.last else { return self.begin(&observed) };
        let (least, periods, is_ambiguous) = match self.periods(&last, &observed) {
            Periods::Restarted => return self.begin(&observed),
            Periods::Passed { periods: 0, .. } => return Placed::Repeated,
            Periods::Passed { least, periods, is_ambiguous } => (least, periods, is_ambiguous),
        };
        let mut next = last;
        self.follow(&mut next, periods, observed.arrival);
        let clock_ns = observed.clock_ns.unwrap_or_default();
        let timestamp_ns = match &self.clock {
            Some(clock) => {
                // A clock that is coarser than the interval may stand still.
                let passed = clock.passed(last.clock_ns, clock_ns).unwrap_or_default().max(1);
                last.timestamp_ns.checked_add(passed)
            }
            None => {
                let time = next.origin.checked_add(next.time.round() as u64);
                time.map(|time| time.max(last.timestamp_ns.saturating_add(1)))
            }
        };
        // A device that says so for over 584 years counts something else.
        let Some(timestamp_ns) = timestamp_ns.filter(|time| *time > last.timestamp_ns) else {
            return self.begin(&observed);
        };
        next.timestamp_ns = timestamp_ns;
        (next.counter, next.clock_ns) = (observed.counter.unwrap_or_default(), clock_ns);
        self.last = Some(next);
        if let (Some(measured), Some(arrival)) = (&mut self.measured, observed.arrival) {
            match observed.after_outage {
                // What the device did while it was away is not known.
                true => *measured = Measured::after(arrival.by_ns),
                // What the time alone explains would hide a rate that is not the nominal one.
                false => measured.count(arrival.by_ns, if is_ambiguous { least } else { periods }),
            }
        }
        Placed::Next { periods, timestamp_ns: next.timestamp_ns, is_ambiguous }
    }

    /// How much the measured interval is over the nominal one, relative, and over how long that was measured \[s\].
    /// `None` for a source without arrivals.
    #[must_use]
    pub(crate) fn deviation(&self, arrival: Option<Arrival>) -> Option<(f64, f64)> {
        let Measured { since, periods, .. } = self.measured?;
        let passed = arrival?.by_ns as f64 - since;
        (periods > 0).then(|| (passed / (periods as f64 * self.interval) - 1.0, passed / 1e9))
    }

    /// Measures the rate from this arrival on.
    pub(crate) fn measure_anew(&mut self, arrival: Option<Arrival>) {
        self.measured = arrival.map(|arrival| Measured::after(arrival.by_ns));
    }

    fn begin(&mut self, observed: &Observed) -> Placed {
        let arrival = observed.arrival.map(|arrival| arrival.by_ns);
        let clock_ns = observed.clock_ns.unwrap_or_default();
        let origin = match (arrival, self.last) {
            (Some(by_ns), _) => by_ns,
            // Two sessions of a file follow each other.
            (None, Some(last)) => last.timestamp_ns.saturating_add(self.interval as u64),
            (None, None) => self.interval as u64,
        };
        let timestamp_ns = self.clock.map_or(origin, |_| clock_ns);
        let counter = observed.counter.unwrap_or_default();
        self.last = Some(Last { origin, time: 0.0, rate: self.interval, moved: 1, counter, clock_ns, timestamp_ns });
        (self.measured, self.late_since) = (arrival.map(Measured::after), None);
        Placed::First { timestamp_ns }
    }

    /// How many periods have passed since the last frame.
    fn periods(&mut self, last: &Last, observed: &Observed) -> Periods {
        // How many periods have passed by the clock of this machine: at least, and at most.
        let by_clock = observed.arrival.map(|arrival| {
            let passed = |at: u64| (at as f64 - last.origin as f64 - last.time) / self.interval;
            [passed(arrival.after_ns), passed(arrival.by_ns)]
        });
        let most = by_clock.map_or(f64::INFINITY, |[_, most]| most + 2.0 + AHEAD_S * 1e9 / self.interval);
        let by_device = match (&self.clock, observed.clock_ns) {
            (Some(clock), Some(now)) => {
                let passed = clock.passed(last.clock_ns, now).map(|ns| ns as f64 / self.interval);
                // Set back, which counts as nearly a turn.
                let Some(passed) = passed.filter(|passed| *passed <= most) else { return Periods::Restarted };
                if by_clock.is_none() && clock.is_back(last.clock_ns, now) {
                    return Periods::Restarted;
                }
                Some([passed; 2])
            }
            _ => None,
        };
        let periods = match (&self.counter, observed.counter) {
            (Some(counter), Some(count)) => {
                let passed = by_device.or(by_clock);
                counter.periods(last.counter, count, passed, most, observed)
            }
            _ => match (by_device, by_clock) {
                (Some([0.0, _]), _) => Periods::certain(0),
                (Some([passed, _]), _) => Periods::certain(passed.round().max(1.0) as u64),
                (None, by_clock) => {
                    let silent = by_clock.map_or(0.0, |[least, _]| least);
                    let is_silence = silent > (SILENCE_S * 1e9 / self.interval).max(1.5);
                    let silent = if is_silence { silent.round() as u64 } else { 1 };
                    let least = 1 + observed.damaged;
                    Periods::Passed { least, periods: silent.max(least), is_ambiguous: false }
                }
            },
        };
        if by_device.is_some() { periods } else { self.believed(periods, observed) }
    }

    /// Whether frames without a trace of damage are missing, or late. Late ones catch up, as after a pause of this
    /// machine or of an adapter; so the time alone is believed after a quarter of a second.
    fn believed(&mut self, found: Periods, observed: &Observed) -> Periods {
        let Periods::Passed { least, periods, .. } = found else { return found };
        let late = observed.arrival.filter(|_| periods > least && observed.damaged == 0 && !observed.after_outage);
        let Some(arrival) = late else {
            self.late_since = None;
            return found;
        };
        let since = *self.late_since.get_or_insert(arrival.by_ns);
        if (arrival.by_ns.saturating_sub(since) as f64) < CATCH_UP_S * 1e9 {
            return Periods::certain(least);
        }
        self.late_since = None;
        Periods::Passed { least, periods, is_ambiguous: true }
    }

    /// Moves the line to a frame that came so many periods later.
    fn follow(&self, next: &mut Last, periods: u64, arrival: Option<Arrival>) {
        let (frequency, damping) = LOOP;
        let periods = periods as f64;
        next.time += periods * next.rate;
        let Some(arrival) = arrival.filter(|_| self.late_since.is_none()) else { return };
        let largest = LARGEST_ERROR_NS + 2.0 * self.interval;
        let error = (arrival.by_ns as f64 - next.origin as f64 - next.time).min(largest);
        if error < -(HELD_BACK_NS + 2.0 * self.interval) {
            // No sample comes before its time: the line began with frames that had waited somewhere.
            (next.time, next.moved) = ((next.time + error).max(0.0), 1);
            return;
        }
        // Seen late, so it tells no more than that.
        if arrival.by_ns.saturating_sub(arrival.after_ns) as f64 > HELD_BACK_NS + 2.0 * self.interval {
            return;
        }
        let step = (frequency * self.interval / 1e9).min(0.2);
        next.moved += 1;
        let (settled, beginning) = (2.0 * damping * step, 1.0 / next.moved as f64);
        // The times of two samples never differ visibly from the interval, whatever the arrivals do.
        let slowly = LARGEST_STEP * self.interval * periods;
        next.time = (next.time + (settled.max(beginning) * error).clamp(-slowly, slowly)).max(0.0);
        if beginning < settled {
            let slowest = self.interval * (1.0 + RATE_LIMIT);
            let rate = next.rate + step * step * error / periods;
            next.rate = rate.clamp(self.interval * (1.0 - RATE_LIMIT), slowest);
        }
    }
}

enum Periods {
    Passed {
        /// By the counter alone, or by the damage alone.
        least: u64,
        /// By the time, too.
        periods: u64,
        is_ambiguous: bool,
    },
    Restarted,
}

impl Periods {
    const fn certain(periods: u64) -> Self {
        Self::Passed { least: periods, periods, is_ambiguous: false }
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

    fn periods(&self, last: u64, now: u64, passed: Option<[f64; 2]>, most: f64, observed: &Observed) -> Periods {
        let rise = wrapped(now.wrapping_sub(last), self.bits);
        let turn = self.turn() as f64;
        if !rise.is_multiple_of(self.step) {
            return Periods::Restarted;
        }
        let rise = rise / self.step;
        if rise as f64 > most {
            return Periods::Restarted;
        }
        let Some([least, latest]) = passed else { return Periods::certain(rise) };
        if observed.after_outage && latest > turn {
            return Periods::Restarted;
        }
        let turns = ((least - rise as f64) / turn).round().max(0.0);
        let periods = rise as f64 + turns * turn;
        let is_far = (least - periods).abs() > 0.35 * turn;
        let is_open = observed.damaged > 0 && latest > periods + 0.5 * turn;
        Periods::Passed { least: rise, periods: periods as u64, is_ambiguous: is_far || is_open }
    }
}

impl DeviceClock {
    /// The time from one reading to the next \[ns\]; `None` if it was set back.
    fn passed(&self, last: u64, now: u64) -> Option<u64> {
        match (now.checked_sub(last), self.turn_ns) {
            (Some(passed), _) => Some(passed),
            (None, Some(turn)) => now.checked_add(turn)?.checked_sub(last),
            (None, None) => None,
        }
    }

    /// Whether it was set back, as far as less than half a turn can tell.
    fn is_back(&self, last: u64, now: u64) -> bool {
        self.turn_ns.is_some_and(|turn| self.passed(last, now).is_none_or(|passed| passed > turn / 2))
    }
}

const fn wrapped(number: u64, bits: u32) -> u64 {
    if bits >= 64 { number } else { number & ((1 << bits) - 1) }
}
