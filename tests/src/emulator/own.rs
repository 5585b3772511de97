//! What a device's own counter and clock know.

/// What a device's own counter and clock say with a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceStamp {
    /// Frames since it was powered.
    pub frames: u64,
    /// The time on its clock since it was powered, in intervals of its profile.
    pub intervals: f64,
    /// Whether its counter counts that time, and not frames.
    pub counts_time: bool,
    /// Whether it was reset. Counter and clock then began at 0, otherwise shortly before they wrap.
    pub was_reset: bool,
}

impl DeviceStamp {
    /// That of frame number `number` of a device that was never reset and always had one rate.
    pub fn regular(number: u64) -> Self {
        Self { frames: number, intervals: number as f64, counts_time: false, was_reset: false }
    }

    /// A number that began with `beginning`, or with 0 after a reset.
    pub fn from<T: Default>(self, beginning: T) -> T {
        if self.was_reset { T::default() } else { beginning }
    }

    /// What its counter has counted, which rises by `step` in an interval of the profile.
    pub fn count(self, step: u64) -> u64 {
        // The small number is for sums that are whole but for their rounding.
        if self.counts_time { (self.intervals * step as f64 + 1e-6) as u64 } else { self.frames * step }
    }

    /// The time on its clock, of a profile with this interval, in the interval's unit.
    pub fn time(self, interval: u64) -> u64 {
        (self.intervals * interval as f64).round() as u64
    }
}
