//! What a description says.

/// What a description says of IIO devices.
#[derive(Clone, Debug, PartialEq)]
pub struct IioSettings {
    /// One device or two: each a name, its unique beginning, a label, `iio:deviceN`, or N.
    pub devices: Vec<String>,
    /// Name of the trigger, as in `/sys/bus/iio/devices/triggerN/name`; without it the device's own stays.
    pub trigger: Option<String>,
    /// Scans after which the kernel wakes the reader, 1 or more.
    pub watermark: u32,
    /// Nominal interval of two scans \[ns\], over 0.
    pub interval_ns: u64,
    /// Wanted channels, as in `in_CHANNEL_en`: `accel_x` to `anglvel_z`. `DEVICE/CHANNEL` where both devices have it.
    pub columns: Vec<String>,
    /// Channels of temperatures, as `temp` or `temp0`; scanned where they are scan elements, otherwise polled. Empty if
    /// the temperature comes from elsewhere. `DEVICE/CHANNEL` takes it from another IIO device; of two devices that
    /// both have the channel, as those of one chip, the first's is taken.
    pub temperature: Vec<String>,
    /// Time between two polls of a temperature \[ns\].
    pub poll_ns: u64,
}
