//! The clock of the timestamps.

use super::sysfs::Folder;

/// The clock of the timestamps.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum IioClock {
    /// CLOCK_MONOTONIC.
    Monotonic,
    /// Another one, by the kernel's name, as `realtime`: it may jump, so take the time of arrival.
    Other(String),
    /// There are no timestamps: take the time of arrival.
    None,
}

/// Sets the clock of the timestamps to CLOCK_MONOTONIC if that can be; what it is then.
pub(super) fn set_monotonic(folder: &Folder) -> IioClock {
    const CLOCK: &str = "current_timestamp_clock";
    let now = || folder.glance(CLOCK);
    // Old kernels have only the time of day.
    let Some(first) = now() else { return IioClock::Other("realtime".to_owned()) };
    if first != "monotonic" {
        // A driver that refuses keeps its clock, and says so below.
        let _ = folder.try_write(CLOCK, "monotonic");
    }
    match now() {
        Some(clock) if clock == "monotonic" => IioClock::Monotonic,
        clock => IioClock::Other(clock.unwrap_or(first)),
    }
}
