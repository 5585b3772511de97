//! How many attitudes a recording has, roughly, by the directions of the specific force.

use isotherm_shared::wire::{AXES, RawSample};

/// Length of a window \[ns\].
const WINDOW_NS: u64 = 1_000_000_000;
/// Directions of two windows that follow each other differ by no more while the IMU rests \[rad\].
const AT_REST: f64 = 0.03;
/// Attitudes differ by more \[rad\].
const ANOTHER: f64 = 0.35;
/// Windows that follow each other, at least, at an attitude.
const LASTING: u32 = 2;
/// The largest number of attitudes that are distinguished.
const MOST: usize = 64;

/// Counts attitudes, and the windows in which the IMU turns.
#[derive(Debug, Default)]
pub(super) struct AttitudeTally {
    begin_ns: Option<u64>,
    sum: [f64; AXES],
    before: Option<[f64; AXES]>,
    lasting: u32,
    found: Vec<[f64; AXES]>,
    windows: u64,
    turning: u64,
}

impl AttitudeTally {
    pub(super) fn take(&mut self, row: &RawSample) {
        let begin = *self.begin_ns.get_or_insert(row.timestamp_ns);
        // A clock that starts again begins a window, too.
        if row.timestamp_ns.wrapping_sub(begin) >= WINDOW_NS {
            self.close();
            self.begin_ns = Some(row.timestamp_ns);
        }
        let of = &row.accelerometers;
        for (sum, (positive, negative)) in self.sum.iter_mut().zip(of.positive_pulses.iter().zip(&of.negative_pulses)) {
            *sum += f64::from(*positive) - f64::from(*negative);
        }
    }

    fn close(&mut self) {
        let length = self.sum.iter().map(|part| part * part).sum::<f64>().sqrt();
        let direction = core::mem::take(&mut self.sum).map(|part| part / length);
        if !length.is_normal() {
            return;
        }
        self.windows += 1;
        let turns = self.before.replace(direction).is_some_and(|before| between(before, direction) > AT_REST);
        self.turning += u64::from(turns);
        self.lasting = if turns { 1 } else { self.lasting + 1 };
        let is_known = self.found.iter().any(|known| between(*known, direction) <= ANOTHER);
        if self.lasting >= LASTING && !is_known && self.found.len() < MOST {
            self.found.push(direction);
        }
    }

    /// The number of attitudes, and the part of the time in which the IMU turns.
    pub(super) fn found(&self) -> (usize, f64) {
        (self.found.len(), self.turning as f64 / self.windows.max(1) as f64)
    }
}

/// The chord between two directions, which is nearly their angle.
fn between(one: [f64; AXES], other: [f64; AXES]) -> f64 {
    one.iter().zip(other).map(|(one, other)| (one - other) * (one - other)).sum::<f64>().sqrt()
}
