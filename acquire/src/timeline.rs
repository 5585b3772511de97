//! Which control period a frame is, and when it was sampled.
//!
//! # Periods
//! From one frame to the next n periods pass. The number is
//! * with a counter of M periods a turn: of its rise d plus whole turns, the one nearest to the time that has passed;
//! * with a clock of the device: the time that has passed on it over the interval, rounded;
//! * with neither: 1, and what damaged bytes show; and the time that has passed over the interval, rounded, where
//!   frames come later than the line's jitter explains.
//!
//! # Waiting
//! What is in doubt waits, a quarter of a second at most, and is then placed with the frames that came after it: the
//! first frames of a session, those after an outage or a silence, those that come late or early, and a number that
//! rises otherwise than by one period where no bytes were damaged. Frames that were late and catch up are no gap. The
//! very first frames wait until the rate is decided, too ([`pace`]).
//!
//! # Time
//! Bytes arrive late, by the line's delays and in bursts, as from USB. So the moment of a sample is a line through the
//! arrivals ([`line`]), whose phase and rate follow with a time constant of about a second: with the error e of an
//! arrival,
//! ```text
//! x = t + n r        t = x + a e        r = r + b e / n
//! a = 2 z w T, or 1/(m + 1) for the m-th frame while that is more      b = (w T)^2 after the first second
//! w = 2 / s, z = 0.7; w T is at most 0.2
//! ```
//! A sample is moved by 1 % of the interval at most. The rate r begins with the interval and stays within 5 % of it. An
//! arrival that was not seen at its time, since this process was held back, moves neither. After a doubt the line goes
//! through the earliest arrivals of those that have waited: bytes are late, and never early.

mod doubt;
mod line;
mod measured;
mod number;
mod pace;
mod place;
mod settle;

pub(crate) use line::RATE_LIMIT;
pub(crate) use number::{Counter, DeviceClock, FrameObservation};

use crate::frames::FrameArrival;
use line::Line;
use measured::RateMeasurement;
use number::{FrameNumbering, Numbers};
use pace::Trace;
use std::collections::VecDeque;

/// The place of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FramePlace {
    /// The first of a session: the first of all, or after the device has started again or was away for longer than a
    /// turn of its counter.
    First,
    /// So many periods after the frame before.
    Next {
        /// 1 or more; all but the last are missing.
        periods: u64,
        /// Whether another number of turns of the counter, or of periods, is about as near.
        is_ambiguous: bool,
    },
    /// The frame before once more.
    Repeated,
}

/// A frame on the line of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FramePlacement {
    pub(crate) place: FramePlace,
    /// When it was sampled \[ns\].
    pub(crate) timestamp_ns: u64,
    /// Its control period \[ns\].
    pub(crate) interval_ns: u64,
    /// Whether nothing contradicts that interval.
    pub(crate) is_certain: bool,
}

/// Why frames wait.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Doubt {
    /// A session begins.
    Beginning,
    /// They came after an outage.
    Outage,
    /// They come later, or earlier, than the line explains.
    Time,
    /// Their number rises otherwise than by one period.
    Number,
}

/// The frames of one source on the line of time, each with something that belongs to it.
#[derive(Clone, Debug)]
pub(crate) struct Timeline<T> {
    /// The interval of the description \[ns\], and the step of its counter.
    described: (f64, u64),
    numbering: FrameNumbering,
    /// Whether two frames may come in the wrong order, as datagrams may.
    may_overtake: bool,
    /// Whether the arrivals show the rate.
    has_pace: bool,
    last: Option<LastFrame>,
    waiting: VecDeque<(FrameObservation, T)>,
    doubt: Option<Doubt>,
    /// What those that wait show of the rate, and how many of them it has.
    trace: Trace,
    traced: usize,
    /// Whether the interval is contradicted and no other one is known yet.
    is_doubted: bool,
    placed: VecDeque<(FramePlacement, T)>,
    measured: Option<RateMeasurement>,
    /// The device's time of the frame that was taken last, and whether it stood still before that.
    pushed_clock: Option<(u64, bool)>,
}

/// The frame that was placed last.
#[derive(Clone, Copy, Debug)]
struct LastFrame {
    line: Line,
    numbers: Numbers,
    /// The stamp of the first frame with its time of the device \[ns\].
    clock_stamp_ns: u64,
    /// When it came \[ns\].
    by_ns: u64,
}

impl<T> Timeline<T> {
    /// A line without frames. `interval_ns` is the described interval.
    #[must_use]
    pub(crate) fn new(interval_ns: u64, counter: Option<Counter>, clock: Option<DeviceClock>) -> Self {
        let interval = interval_ns as f64;
        Self {
            described: (interval, counter.map_or(1, |counter| counter.step)),
            numbering: FrameNumbering { interval, counter, clock, grain_ns: 0 },
            may_overtake: false,
            has_pace: true,
            last: None,
            waiting: VecDeque::new(),
            doubt: None,
            trace: Trace::default(),
            traced: 0,
            is_doubted: false,
            placed: VecDeque::new(),
            measured: None,
            pushed_clock: None,
        }
    }

    /// For frames with the time of this clock.
    pub(crate) fn with_clock(mut self, clock: DeviceClock) -> Self {
        self.numbering.clock = Some(clock);
        self
    }

    /// For frames of which two may come in the wrong order.
    pub(crate) fn of_datagrams(self) -> Self {
        Self { may_overtake: true, ..self }
    }

    /// For frames whose arrivals show nothing of the rate.
    pub(crate) fn at_any_pace(self) -> Self {
        Self { has_pace: false, ..self }
    }

    /// Takes the next frame, with what belongs to it. [`next`](Self::next) gives what is placed.
    pub(crate) fn push(&mut self, observed: FrameObservation, of: T) {
        self.look_at_clock(&observed);
        let Some(arrival) = observed.arrival else {
            let placed = self.place_without_arrival(&observed);
            self.placed.push_back((placed, of));
            return;
        };
        self.waiting.push_back((observed, of));
        self.put_in_order();
        self.decide(arrival.by_ns, false);
    }

    /// The next frame that is placed, in their order.
    pub(crate) fn next(&mut self) -> Option<(FramePlacement, T)> {
        self.placed.pop_front()
    }

    /// Places what has waited long enough at this time \[ns\].
    pub(crate) fn look(&mut self, now_ns: u64) {
        self.decide(now_ns, false);
    }

    /// Places all that waits: nothing more comes for now.
    pub(crate) fn settle_all(&mut self) {
        self.decide(u64::MAX, true);
    }

    /// Whether frames wait.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// The interval that the device is taken to have \[ns\], and the step of its counter.
    pub(crate) fn taken(&self) -> (f64, u64) {
        (self.numbering.interval, self.numbering.counter.map_or(1, |counter| counter.step))
    }

    /// Whether the device sends at another rate than the described one, or its counter rises by other steps.
    pub(crate) fn is_other_rate(&self) -> bool {
        self.taken() != self.described
    }

    /// How much the measured interval is over the one that is taken, relative, and over how long that was measured
    /// \[s\]. `None` for a source without arrivals.
    #[must_use]
    pub(crate) fn deviation(&self, arrival: Option<FrameArrival>) -> Option<(f64, f64)> {
        self.measured?.deviation(self.numbering.interval, arrival?.by_ns)
    }

    /// Measures the rate from this arrival on.
    pub(crate) fn measure_anew(&mut self, arrival: Option<FrameArrival>) {
        self.measured = arrival.map(|arrival| RateMeasurement::after(arrival.by_ns));
    }

    /// Takes this interval for the device's \[ns\], and a step of its counter so many times as large. An interval near
    /// to a usual part or multiple of the described one is taken for that.
    pub(crate) fn adopt(&mut self, interval: f64, step: f64) {
        let described = self.described.0;
        let ratio = pace::usual(interval / described);
        self.numbering.interval = ratio.map_or(interval, |ratio| described * ratio).round().max(1.0);
        if let Some(counter) = &mut self.numbering.counter {
            counter.step = ((counter.step as f64 * step).round() as u64).max(1);
        }
        if let Some(last) = &mut self.last {
            last.line.set_rate(self.numbering.interval);
            self.measured = Some(RateMeasurement::after(last.by_ns));
        }
        self.is_doubted = false;
    }

    /// Places frames of the front until one has to wait.
    fn decide(&mut self, now_ns: u64, at_once: bool) {
        while let Some((front, _)) = self.waiting.front() {
            let front = *front;
            let doubt = match self.doubt {
                Some(doubt) => doubt,
                None => match self.doubt_of(&front) {
                    None => {
                        let placed = self.place(&front);
                        self.hand_out(placed);
                        continue;
                    }
                    Some(doubt) => self.begin_doubt(doubt),
                },
            };
            self.extend_trace();
            if !at_once && !self.is_decided(doubt, &front, now_ns) {
                return;
            }
            self.settle(doubt);
        }
    }

    /// Hands out the frame of the front.
    fn hand_out(&mut self, placed: FramePlacement) {
        if let Some((_, of)) = self.waiting.pop_front() {
            self.placed.push_back((placed, of));
        }
    }
}
