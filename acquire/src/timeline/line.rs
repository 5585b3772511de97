//! The line of time through the arrivals of frames.

use crate::frames::FrameArrival;

/// By how much the rate of the line may differ from the interval.
pub(crate) const RATE_LIMIT: f64 = 0.05;
/// An arrival may have been up to so much earlier \[ns\], and two intervals more, to count for the time.
pub(super) const HELD_BACK_NS: f64 = 20e6;
/// Largest error of an arrival that counts \[ns\], and two intervals more.
const LARGEST_ERROR_NS: f64 = 50e6;
/// How much the time of a sample is moved at most, in intervals.
const LARGEST_STEP: f64 = 0.01;
/// Two stamps are at least so many intervals apart, also where the line turns out to be late.
const LEAST_STEP: f64 = 0.6;
/// Angular frequency w of the line's loop \[1/s\], and its damping z.
const LOOP: (f64, f64) = (2.0, 0.7);

/// The line, at the last frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// What times of the line count from \[ns\].
    pub(super) origin: u64,
    /// Its time \[ns\].
    time: f64,
    /// Its rate \[ns\].
    rate: f64,
    /// Frames that moved it.
    moved: u64,
    pub(super) timestamp_ns: u64,
    jitter: Jitter,
}

/// How far the arrivals lie from the line \[ns\].
#[derive(Clone, Copy, Debug, Default)]
struct Jitter {
    /// The mean, without sign.
    mean: f64,
    /// The earliest of about the last second.
    low: f64,
}

impl Line {
    /// A line that begins with frames of which the earliest came at `origin`. `jitter` is how late the others were on
    /// average \[ns\], and `frames` how many there were.
    pub(super) fn new(origin: u64, timestamp_ns: u64, interval: f64, [jitter, frames]: [f64; 2]) -> Self {
        let jitter = Jitter { mean: jitter, low: 0.0 };
        Self { origin, time: 0.0, rate: interval, moved: (frames as u64).max(1), timestamp_ns, jitter }
    }

    /// How late a moment is against the frame of so many periods later \[ns\].
    pub(super) fn late(&self, at_ns: u64, periods: f64) -> f64 {
        at_ns as f64 - self.origin as f64 - self.time - periods * self.rate
    }

    /// How far arrivals usually lie from the line \[ns\].
    pub(super) fn jitter(&self) -> f64 {
        self.jitter.mean
    }

    /// How late the earliest arrivals usually are \[ns\].
    pub(super) fn low(&self) -> f64 {
        self.jitter.low
    }

    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// Goes on by so many periods, and by so much more, as after frames were lost \[ns\]. Returns the stamp of the
    /// frame.
    pub(super) fn pass(&mut self, periods: u64, more: f64) -> Option<u64> {
        self.time = (self.time + periods as f64 * self.rate + more).max(0.0);
        let least = (LEAST_STEP * self.rate).max(1.0) as u64;
        let time = self.origin.checked_add(self.time.round() as u64)?;
        Some(time.max(self.timestamp_ns.checked_add(least)?))
    }

    /// Takes the rate of another interval.
    pub(super) fn set_rate(&mut self, interval: f64) {
        (self.rate, self.moved) = (interval, 1);
    }

    /// Moves the line to the arrival of the frame at which it is, which came so many periods after the one before.
    pub(super) fn follow(&mut self, interval: f64, periods: u64, arrival: FrameArrival) {
        let (frequency, damping) = LOOP;
        let periods = periods as f64;
        let largest = LARGEST_ERROR_NS + 2.0 * interval;
        let error = self.late(arrival.by_ns, 0.0).min(largest);
        // Seen late, so it shows no more than that.
        if arrival.by_ns.saturating_sub(arrival.after_ns) as f64 > HELD_BACK_NS + 2.0 * interval {
            return;
        }
        let step = (frequency * interval / 1e9).min(0.2);
        self.moved += 1;
        let (settled, beginning) = (2.0 * damping * step, 1.0 / self.moved as f64);
        let weight = settled.max(beginning);
        let usual = error.abs().min(2.0 * self.jitter.mean + interval);
        self.jitter.mean += weight * (usual - self.jitter.mean);
        let low = if error < self.jitter.low { 1.0 } else { settled };
        self.jitter.low += low * (error - self.jitter.low);
        // The times of two samples never differ visibly from the interval, whatever the arrivals do.
        let slowly = LARGEST_STEP * interval * periods;
        let moved = (weight * error).clamp(-slowly, slowly);
        self.time = (self.time + moved).max(0.0);
        self.jitter.low -= moved;
        if beginning < settled {
            let slowest = interval * (1.0 + RATE_LIMIT);
            let rate = self.rate + step * step * error / periods;
            self.rate = rate.clamp(interval * (1.0 - RATE_LIMIT), slowest);
        }
    }
}
