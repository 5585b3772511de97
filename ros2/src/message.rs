//! The messages, with their fields in the order of their definitions: a serializer of CDR writes what ROS 2 reads.

use serde::{Deserialize, Serialize};

/// Package and name of [`SensorImu`].
pub const IMU: (&str, &str) = ("sensor_msgs", "Imu");
/// Package and name of [`SensorTemperature`].
pub const TEMPERATURE: (&str, &str) = ("sensor_msgs", "Temperature");
/// Package and name of [`DiagnosticArrayMessage`].
pub const DIAGNOSTIC_ARRAY: (&str, &str) = ("diagnostic_msgs", "DiagnosticArray");

/// `builtin_interfaces/Time`: Unix time.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct TimeMessage {
    /// Whole seconds.
    pub sec: i32,
    /// The rest \[ns\], 0 to 999 999 999.
    pub nanosec: u32,
}

impl TimeMessage {
    /// The time of a Unix time \[ns\]; `None` if the message cannot hold it.
    #[must_use]
    pub fn of_unix_ns(unix_ns: i64) -> Option<Self> {
        let sec = i32::try_from(unix_ns.div_euclid(1_000_000_000)).ok()?;
        let nanosec = u32::try_from(unix_ns.rem_euclid(1_000_000_000)).ok()?;
        Some(Self { sec, nanosec })
    }

    /// The Unix time \[ns\].
    #[must_use]
    pub const fn unix_ns(self) -> i64 {
        self.sec as i64 * 1_000_000_000 + self.nanosec as i64
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct HeaderMessage {
    /// When it was measured.
    pub stamp: TimeMessage,
    /// The frame that the values are in.
    pub frame_id: String,
}

/// `geometry_msgs/Quaternion`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct QuaternionMessage {
    /// Of the vector.
    pub x: f64,
    /// Of the vector.
    pub y: f64,
    /// Of the vector.
    pub z: f64,
    /// The scalar.
    pub w: f64,
}

/// No rotation.
impl Default for QuaternionMessage {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/Vector3`.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct VectorMessage {
    /// Along X.
    pub x: f64,
    /// Along Y.
    pub y: f64,
    /// Along Z.
    pub z: f64,
}

impl From<[f64; 3]> for VectorMessage {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<VectorMessage> for [f64; 3] {
    fn from(vector: VectorMessage) -> Self {
        [vector.x, vector.y, vector.z]
    }
}

/// `sensor_msgs/Imu`. A covariance of 0 is unknown; -1 as its first element: there is no such value.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct SensorImu {
    /// When and where.
    pub header: HeaderMessage,
    /// Not used.
    pub orientation: QuaternionMessage,
    /// Row by row.
    pub orientation_covariance: [f64; 9],
    /// \[rad/s\].
    pub angular_velocity: VectorMessage,
    /// Row by row.
    pub angular_velocity_covariance: [f64; 9],
    /// \[m/s2\].
    pub linear_acceleration: VectorMessage,
    /// Row by row.
    pub linear_acceleration_covariance: [f64; 9],
}

/// `sensor_msgs/Temperature`.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct SensorTemperature {
    /// When and where.
    pub header: HeaderMessage,
    /// \[degC\].
    pub temperature: f64,
    /// 0 is unknown.
    pub variance: f64,
}

/// `level` of `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub enum DiagnosticLevel {
    /// All is as it should be.
    Ok = 0,
    /// Somebody should look at it.
    Warn = 1,
    /// It does not do what it is for.
    Error = 2,
    /// Nothing new is known.
    Stale = 3,
}

/// `diagnostic_msgs/KeyValue`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct KeyValueMessage {
    /// What it is.
    pub key: String,
    /// Its value, as a text.
    pub value: String,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct DiagnosticMessage {
    /// A [`DiagnosticLevel`].
    pub level: u8,
    /// What it is about.
    pub name: String,
    /// One line for people.
    pub message: String,
    /// The device.
    pub hardware_id: String,
    /// All values.
    pub values: Vec<KeyValueMessage>,
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct DiagnosticArrayMessage {
    /// When.
    pub header: HeaderMessage,
    /// One for each part.
    pub status: Vec<DiagnosticMessage>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unix_time_that_a_message_can_hold_comes_back() {
        for unix_ns in [0, 1, 999_999_999, 1_000_000_000, -1, -1_000_000_000, 1_799_999_999_123_456_789] {
            assert_eq!(TimeMessage::of_unix_ns(unix_ns).map(TimeMessage::unix_ns), Some(unix_ns));
        }
        assert_eq!(TimeMessage::of_unix_ns(i64::MAX), None);
        let absurd = TimeMessage { sec: i32::MIN, nanosec: u32::MAX };
        assert!(absurd.unix_ns() < 0);
    }
}
