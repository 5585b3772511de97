//! Laboratory time, and the offset of the acquisition's clock from it.

use isotherm_instruments::{Moment, Time};
use std::sync::Arc;

/// Span of the clock offset's maximum: in laboratory time, and at least this in real time \[s\].
const OFFSET_SPAN_S: [f64; 2] = [300.0, 30.0];
/// The offset is stable if it has not risen for so long: in laboratory time, and at least this in real time \[s\].
const STABLE_S: [f64; 2] = [30.0, 3.0];
/// Rises up to this are none: in laboratory time, and at least this in real time \[s\].
const RISE_S: [f64; 2] = [0.1, 0.001];

/// Laboratory time: real time multiplied by the speed of a simulated laboratory.
#[derive(Clone)]
pub struct LaboratoryClock {
    pub(super) time: Arc<dyn Time>,
    pub(super) origin: Moment,
    /// Ratio of laboratory time to real time.
    pub speed: f64,
}

impl LaboratoryClock {
    /// A clock that begins at 0 now.
    pub fn new(time: Arc<dyn Time>, speed: f64) -> Self {
        Self { origin: time.now(), time, speed }
    }

    /// The present laboratory time \[s\].
    pub fn now(&self) -> f64 {
        self.at(self.time.now().ns())
    }

    /// The clocks behind it.
    pub fn time(&self) -> &dyn Time {
        self.time.as_ref()
    }

    /// The present Unix time \[s\].
    pub fn unix_s(&self) -> f64 {
        self.time.unix_s()
    }

    /// The laboratory time \[s\] at a time of `CLOCK_MONOTONIC` \[ns\].
    pub fn at(&self, ns: u64) -> f64 {
        (ns as f64 - self.origin.ns() as f64) / 1e9 * self.speed
    }
}

/// Offset of the acquisition's clock from laboratory time \[s\]: the largest over the last one to two spans, which is
/// that of the sample with the least delay.
pub(super) struct ClockOffset {
    speed: f64,
    /// When the present span began.
    began_at: f64,
    /// The largest offset of the present span, and of the one before.
    largest: [f64; 2],
    /// When the first sample and the last sample were sent.
    samples_at: Option<[f64; 2]>,
    /// The largest offset at its last rise, and when that was.
    risen: [f64; 2],
}

impl ClockOffset {
    pub(super) const fn new(speed: f64) -> Self {
        let none = [f64::NEG_INFINITY; 2];
        Self { speed, began_at: f64::NEG_INFINITY, largest: none, samples_at: None, risen: none }
    }

    /// A time in laboratory time, and at least in real time \[s\].
    fn span(&self, [laboratory_s, real_s]: [f64; 2]) -> f64 {
        laboratory_s.max(real_s * self.speed)
    }

    pub(super) fn add(&mut self, at: f64, offset: f64) {
        if at - self.began_at > self.span(OFFSET_SPAN_S) {
            self.began_at = at;
            self.largest = [f64::NEG_INFINITY, self.largest[0]];
        }
        self.largest[0] = self.largest[0].max(offset);
        self.samples_at = Some([self.samples_at.map_or(at, |[first, _]| first), at]);
        if self.largest() > self.risen[0] + self.span(RISE_S) {
            self.risen = [self.largest(), at];
        }
    }

    pub(super) fn largest(&self) -> f64 {
        self.largest[0].max(self.largest[1])
    }

    /// Whether the offset has not risen for a while, or is known for its whole span: clocks may drift.
    pub(super) fn is_stable(&self) -> bool {
        self.samples_at.is_some_and(|[first, last]| {
            last - self.risen[1] >= self.span(STABLE_S) || last - first >= self.span(OFFSET_SPAN_S)
        })
    }
}
