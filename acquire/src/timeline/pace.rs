//! Whether a device sends at the rate that its counter, its clock and the described interval say.
//!
//! Bytes may be late, and never early. So the times count that are earliest against the device's own: of each quarter
//! of a window the earliest frame. A device that is slow or fast is so from each quarter to the next; a line that
//! stands still for a while is not.

use std::collections::VecDeque;

/// Frames that a window has at least, and its time \[ns\].
pub(super) const FRAMES: usize = 20;
pub(super) const WINDOW_NS: f64 = 0.1e9;
/// From this ratio of intervals on a rate is another one, either way; up to this it is the same.
const OTHER: f64 = 1.3;
const SAME: f64 = 1.15;
/// The change from one quarter to the next that shows another rate.
const EACH: f64 = 0.13;
/// Below this ratio frames had waited somewhere, and come together.
const LEAST: f64 = 0.05;
/// Frames that are kept.
const KEPT: usize = 4096;

/// What the frames of a window show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pace {
    /// Not enough frames yet, or they contradict each other.
    Open,
    /// The interval is as described.
    Right,
    /// It is another one.
    Off {
        /// The true interval over the one that was taken for it.
        factor: f64,
        /// The true step from frame to frame in the device's own count, over the one that was taken for it.
        step: f64,
    },
}

/// Frames since a doubt began.
#[derive(Clone, Debug, Default)]
pub(super) struct Trace {
    frames: VecDeque<TracedFrame>,
}

#[derive(Clone, Copy, Debug)]
struct TracedFrame {
    by_ns: u64,
    /// Periods since the first frame by the device's count.
    place: f64,
    /// Periods since the frame before; NaN if frames between them were damaged.
    step: f64,
}

impl Trace {
    pub(super) fn clear(&mut self) {
        self.frames.clear();
    }

    /// Adds a frame; `step` is that from the frame before, by the device's count.
    pub(super) fn push(&mut self, by_ns: u64, step: f64, is_damaged: bool) {
        let place = self.frames.back().map_or(0.0, |last| last.place + step);
        if self.frames.len() == KEPT {
            self.frames.pop_front();
        }
        self.frames.push_back(TracedFrame { by_ns, place, step: if is_damaged { f64::NAN } else { step } });
    }

    /// What the frames show, for a device with this interval \[ns\].
    pub(super) fn pace(&self, interval: f64) -> Pace {
        let (Some(first), Some(last)) = (self.frames.front(), self.frames.back()) else { return Pace::Open };
        let span = last.by_ns.saturating_sub(first.by_ns) as f64;
        let fresh = self.frames.iter().filter(|frame| frame.by_ns > first.by_ns).count();
        if fresh < FRAMES - 1 || span < WINDOW_NS {
            return Pace::Open;
        }
        let Some(step) = self.step() else { return Pace::Open };
        // The earliest frame of each quarter, as its place and how late it is.
        let mut quarters = [None::<(f64, f64)>; 4];
        for frame in &self.frames {
            let since = frame.by_ns.saturating_sub(first.by_ns) as f64;
            let place = frame.place * interval;
            let quarter = quarters.get_mut(((4.0 * since / span) as usize).min(3));
            if let Some(quarter) = quarter
                && quarter.is_none_or(|(_, late)| since - place < late)
            {
                *quarter = Some((place, since - place));
            }
        }
        let [Some(a), Some(b), Some(c), Some(d)] = quarters else { return Pace::Open };
        let slope = |from: (f64, f64), to: (f64, f64)| (to.1 - from.1) / (to.0 - from.0).max(1.0);
        let each = [slope(a, b), slope(b, c), slope(c, d)];
        let ratio = 1.0 + slope(a, d);
        if (1.0 / SAME..=SAME).contains(&ratio) {
            return if is_one(step) { Pace::Right } else { Pace::Off { factor: step, step } };
        }
        let is_slow = ratio > OTHER && each.iter().all(|slope| *slope > EACH);
        let is_fast = ratio < 1.0 / OTHER && each.iter().all(|slope| *slope < -EACH);
        if is_slow || is_fast { Pace::Off { factor: step * ratio, step } } else { Pace::Open }
    }

    /// Whether the few frames that are there contradict the interval \[ns\]: not if they came together, as what had
    /// waited somewhere.
    pub(super) fn is_suspicious(&self, interval: f64) -> bool {
        let (Some(first), Some(last)) = (self.frames.front(), self.frames.back()) else { return false };
        let span = last.by_ns.saturating_sub(first.by_ns) as f64;
        let arrivals = self.frames.iter().zip(self.frames.iter().skip(1));
        let longest = arrivals.map(|(a, b)| b.by_ns.saturating_sub(a.by_ns)).max().unwrap_or_default() as f64;
        if self.frames.len() < 4 || longest > 0.5 * span {
            return false;
        }
        let ratio = span / ((last.place - first.place) * interval).max(1.0);
        self.step().is_none_or(|step| !is_one(step)) || ratio > OTHER || (LEAST..1.0 / OTHER).contains(&ratio)
    }

    /// The step from frame to frame: that of most frames, if these are alike; 1 if frames are missing here and there.
    /// `None` if it is not known.
    fn step(&self) -> Option<f64> {
        let mut steps: Vec<_> =
            self.frames.iter().skip(1).map(|frame| frame.step).filter(|step| !step.is_nan()).collect();
        steps.sort_by(f64::total_cmp);
        let median = *steps.get(steps.len() / 2)?;
        let alike = steps.iter().filter(|step| (**step - median).abs() <= 0.25 * median).count();
        match alike * 5 >= steps.len() * 4 {
            true => Some(median),
            // Steps of a clock that is coarse, or losses at random: their mean is what arrivals are compared with.
            false if median < 1.5 => Some(1.0),
            false => None,
        }
    }
}

fn is_one(step: f64) -> bool {
    (1.0 / OTHER..OTHER).contains(&step)
}

/// Ratios of intervals that devices have: whole numbers, their inverses, and a few more.
const RATIOS: [f64; 6] = [1.5, 2.5, 4.0 / 3.0, 1.0 / 1.5, 0.4, 0.75];
/// A measured ratio is one of them within this.
const NEAR: f64 = 0.03;

/// The ratio of intervals that a measured one stands for, if it is a usual one.
pub(super) fn usual(measured: f64) -> Option<f64> {
    let whole = measured.round().clamp(1.0, 64.0);
    let part = 1.0 / (1.0 / measured).round().clamp(1.0, 64.0);
    let error = |ratio: &f64| (measured / ratio - 1.0).abs();
    let all = [whole, part].into_iter().chain(RATIOS);
    all.filter(|ratio| error(ratio) <= NEAR).min_by(|a, b| error(a).total_cmp(&error(b)))
}
