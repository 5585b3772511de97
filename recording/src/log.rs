//! An IMU as the log of an autopilot names it.

use core::fmt;
use isotherm_shared::wire::device;

/// An IMU as the log of an autopilot names it.
///
/// A device number is made of bus, address and type. It is the same on all boards of a model, so that it never
/// distinguishes one board from another; it distinguishes the IMUs of one board.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct LogImu {
    /// Its number in the log, from 0.
    pub instance: u32,
    /// Device numbers of accelerometers and gyroscopes, where the log has them.
    pub devices: [Option<u32>; 2],
}

impl LogImu {
    /// Whether this is another IMU of a vehicle than `other`: by the device numbers that both have, and where they have
    /// none in common, by the instance. The instance of a device may change from one start to the next.
    ///
    /// ```
    /// use isotherm_recording::LogImu;
    ///
    /// let first = LogImu { instance: 0, devices: [Some(3_014_666), None] };
    /// assert!(!first.differs_from(&LogImu { instance: 1, ..first }));
    /// assert!(first.differs_from(&LogImu { devices: [Some(2_621_450), None], ..first }));
    /// assert!(first.differs_from(&LogImu { instance: 1, devices: [None; 2] }));
    /// ```
    #[must_use]
    pub fn differs_from(&self, other: &Self) -> bool {
        let both = self.devices.into_iter().zip(other.devices).filter_map(|(one, other)| one.zip(other));
        let same: Vec<_> = both.map(|(one, other)| one == other).collect();
        if same.is_empty() { self.instance != other.instance } else { same.contains(&false) }
    }

    /// The device of a row of this IMU, as samples have it; 0 where the log has no number.
    #[must_use]
    pub fn device(&self) -> u64 {
        self.devices[0].map_or(0, |id| device(&id.to_string()))
    }

    /// The device numbers, for messages: `device 3014666, that of the gyroscopes 3080202`.
    #[must_use]
    pub fn devices_told(&self) -> Option<String> {
        match self.devices {
            [Some(one), Some(other)] if one != other => Some(format!("device {one}, that of the gyroscopes {other}")),
            [Some(one), _] | [None, Some(one)] => Some(format!("device {one}")),
            [None, None] => None,
        }
    }
}

/// `IMU 1 (device 3014666)`.
impl fmt::Display for LogImu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "IMU {}", self.instance)?;
        self.devices_told().map_or(Ok(()), |devices| write!(f, " ({devices})"))
    }
}
