//! What the first reading of a log finds of the rows of a sensor.

use super::timeline::{LogTimeline, UsableTimes};
use std::collections::BTreeMap;

/// Most devices that are distinguished.
const MAX_DEVICES: usize = 64;
/// A thermometer stands still if others move by so much meanwhile \[degC\].
const MOVES: f64 = 1.0;
/// Fewer rows do not show that it stands still.
const FEWEST: u64 = 20;
/// Rows outside of those that are kept may be this part of all: an autopilot that was started again has more.
const MOST_OUTSIDE: u64 = 4;

/// What is found of the rows of a sensor.
#[derive(Debug, Default)]
pub(super) struct Survey {
    timeline: LogTimeline,
    /// How many rows each device has.
    devices: BTreeMap<Option<u32>, u64>,
    /// Rows with a temperature, the least and the largest one \[degC\].
    celsius: (u64, f64, f64),
    /// Whether rows have a place for a temperature.
    has_field: bool,
}

/// Why a sensor has no temperature of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NoThermometer {
    /// None in any row.
    None,
    /// It stands at this temperature, while that of another sensor moves \[degC\].
    Stands { at: f64, other: f64 },
}

impl Survey {
    pub(super) fn take(&mut self, time_us: u64, device: Option<u32>, celsius: Option<f64>) {
        self.timeline.take(time_us);
        if self.devices.len() < MAX_DEVICES || self.devices.contains_key(&device) {
            *self.devices.entry(device).or_default() += 1;
        }
        self.has_field |= celsius.is_some();
        if let Some(celsius) = celsius.filter(|celsius| celsius.is_finite()) {
            let (count, least, most) = self.celsius;
            let (least, most) = if count == 0 { (celsius, celsius) } else { (least, most) };
            self.celsius = (count + 1, least.min(celsius), most.max(celsius));
        }
    }

    pub(super) const fn rows(&self) -> u64 {
        self.timeline.rows()
    }

    /// The device of most rows.
    pub(super) fn device(&self) -> Option<u32> {
        self.devices.iter().max_by_key(|(_, rows)| **rows).and_then(|(device, _)| *device)
    }

    /// The rows that are kept by their time.
    ///
    /// # Errors
    /// If too many are not: the autopilot was started again.
    pub(super) fn kept(&self, of: &str) -> Result<UsableTimes, String> {
        let kept = self.timeline.kept();
        let (rows, outside) = (self.rows(), kept.outside(self.rows()));
        if outside > 1 && outside > rows / MOST_OUTSIDE {
            return Err(format!(
                "{outside} of {rows} rows of {of} have times that do not rise with those of the others: the autopilot \
                 was started again within the log, or the log is damaged; give the parts one by one"
            ));
        }
        Ok(kept)
    }

    /// Why this sensor has no temperature of its own, next to one that has; `None` if it has.
    pub(super) fn no_thermometer(&self, beside: &Self) -> Option<NoThermometer> {
        let ((count, at, most), (others, low, high)) = (self.celsius, beside.celsius);
        if !self.has_field || others == 0 {
            return None;
        }
        if count == 0 {
            return Some(NoThermometer::None);
        }
        let stands = at == most && count >= FEWEST && high - low >= MOVES;
        stands.then_some(NoThermometer::Stands { at, other: high - low })
    }
}
