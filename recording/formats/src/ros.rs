//! The ROS messages `sensor_msgs/msg/Imu` and `sensor_msgs/msg/Temperature`, byte by byte.
//!
//! Sources: the message definitions of ROS's common_interfaces; OMG DDSI-RTPS 9.4.2.13 and the Common Data
//! Representation (CDR) of ROS 2; the serialization of ROS 1, which has no alignment, and a `seq` before the stamp.

/// A serialization of messages.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Encoding {
    /// That of ROS 2: an encapsulation header, then values that are aligned to their size.
    Cdr,
    /// That of ROS 1: little-endian, without alignment.
    Ros1,
}

/// `sensor_msgs/msg/Imu`, as far as it concerns an IMU without an orientation.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuMessage {
    /// Stamp of the header, Unix time \[ns\].
    pub stamp_ns: u64,
    /// Name of the frame.
    pub frame_id: String,
    /// Rates about x, y, z \[rad/s\]; `None` if the message says that there are none.
    pub angular_velocity: Option<[f64; 3]>,
    /// Specific force along x, y, z \[m/s2\]; `None` if the message says that there is none.
    pub linear_acceleration: Option<[f64; 3]>,
}

/// `sensor_msgs/msg/Temperature`.
#[derive(Clone, Debug, PartialEq)]
pub struct TemperatureMessage {
    /// Stamp of the header, Unix time \[ns\].
    pub stamp_ns: u64,
    /// Name of the frame.
    pub frame_id: String,
    /// Temperature \[degC\].
    pub celsius: f64,
}

/// Name of the schema of an [`ImuMessage`].
pub const IMU: &str = "sensor_msgs/msg/Imu";
/// Name of the schema of a [`TemperatureMessage`].
pub const TEMPERATURE: &str = "sensor_msgs/msg/Temperature";

/// The definition of an [`ImuMessage`] with all definitions that it needs, in the schema encoding `ros2msg`.
pub const IMU_DEFINITION: &str = "\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
";

/// The definition of a [`TemperatureMessage`] with all definitions that it needs, in the schema encoding `ros2msg`.
pub const TEMPERATURE_DEFINITION: &str = "\
std_msgs/Header header
float64 temperature
float64 variance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// First element of a covariance that says: there is no such value.
const NO_VALUE: f64 = -1.0;
/// Elements of a covariance.
const COVARIANCE: usize = 9;
/// Encapsulation of CDR, big-endian and little-endian.
const BIG_ENDIAN: [u8; 2] = [0, 0];
const LITTLE_ENDIAN: [u8; 2] = [0, 1];
/// Length of the encapsulation header \[bytes\].
const ENCAPSULATION: usize = 4;
/// Bytes that may follow a message: padding.
const MOST_PADDING: usize = 7;

impl ImuMessage {
    /// Reads a message.
    ///
    /// # Errors
    /// If it is cut, too long, or has a stamp that is no time.
    pub fn decode(encoding: Encoding, message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::new(encoding, message)?;
        let (stamp_ns, frame_id) = fields.header()?;
        // The orientation.
        fields.doubles::<4>()?;
        fields.doubles::<COVARIANCE>()?;
        let angular_velocity = fields.vector()?;
        let linear_acceleration = fields.vector()?;
        fields.end()?;
        Ok(Self { stamp_ns, frame_id, angular_velocity, linear_acceleration })
    }

    /// Appends the message in little-endian CDR. The orientation is unknown, and so are the covariances (0). A value
    /// that does not exist is 0, and one that could not be computed NaN, both with -1 in its covariance.
    ///
    /// # Errors
    /// If the stamp is after 2038, which the message cannot say.
    pub fn encode(&self, message: &mut Vec<u8>) -> Result<(), String> {
        begin(message, self.stamp_ns, &self.frame_id)?;
        append(message, &[0.0, 0.0, 0.0, 1.0]);
        append(message, &covariance(false));
        for vector in [self.angular_velocity, self.linear_acceleration] {
            append(message, &vector.unwrap_or_default());
            append(message, &covariance(vector.is_some_and(|vector| vector.iter().all(|value| value.is_finite()))));
        }
        Ok(())
    }
}

impl TemperatureMessage {
    /// Reads a message.
    ///
    /// # Errors
    /// As [`ImuMessage::decode`].
    pub fn decode(encoding: Encoding, message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::new(encoding, message)?;
        let (stamp_ns, frame_id) = fields.header()?;
        let [celsius, _variance] = fields.doubles()?;
        fields.end()?;
        Ok(Self { stamp_ns, frame_id, celsius })
    }

    /// Appends the message in little-endian CDR; the variance is unknown (0).
    ///
    /// # Errors
    /// As [`ImuMessage::encode`].
    pub fn encode(&self, message: &mut Vec<u8>) -> Result<(), String> {
        begin(message, self.stamp_ns, &self.frame_id)?;
        append(message, &[self.celsius, 0.0]);
        Ok(())
    }
}

/// Reads the fields of a message one after the other.
struct Fields<'a> {
    /// Without the encapsulation header.
    message: &'a [u8],
    at: usize,
    encoding: Encoding,
    big_endian: bool,
}

impl<'a> Fields<'a> {
    fn new(encoding: Encoding, message: &'a [u8]) -> Result<Self, String> {
        if encoding == Encoding::Ros1 {
            return Ok(Self { message, at: 0, encoding, big_endian: false });
        }
        let (kind, message) = message.split_at_checked(ENCAPSULATION).ok_or_else(cut)?;
        let big_endian = match [kind[0], kind[1]] {
            BIG_ENDIAN => true,
            LITTLE_ENDIAN => false,
            [a, b] => return Err(format!("CDR with the encapsulation {a:02x} {b:02x}, not 00 00 or 00 01")),
        };
        Ok(Self { message, at: 0, encoding, big_endian })
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], String> {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(N);
        }
        let bytes = self.message.get(self.at..).and_then(<[u8]>::first_chunk::<N>).ok_or_else(cut)?;
        self.at += N;
        let mut bytes = *bytes;
        if self.big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn word(&mut self) -> Result<u32, String> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn doubles<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_le_bytes(self.bytes()?);
        }
        Ok(values)
    }

    /// The stamp \[ns\] and the name of the frame.
    fn header(&mut self) -> Result<(u64, String), String> {
        if self.encoding == Encoding::Ros1 {
            // seq
            self.word()?;
        }
        let (seconds, nanoseconds) = (self.word()?, self.word()?);
        let is_right =
            (self.encoding == Encoding::Ros1 || i32::try_from(seconds).is_ok()) && nanoseconds < 1_000_000_000;
        if !is_right {
            return Err(format!("header.stamp is {} s {nanoseconds} ns, no time after 1970", seconds.cast_signed()));
        }
        let length = self.word()? as usize;
        let text = self.message.get(self.at..).and_then(|rest| rest.get(..length)).ok_or_else(cut)?;
        self.at += length;
        // In CDR the length counts the zero at the end.
        let text = String::from_utf8_lossy(text).trim_end_matches('\0').to_owned();
        Ok((u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds), text))
    }

    /// A vector with its covariance; `None` if the covariance says that there is no value.
    fn vector(&mut self) -> Result<Option<[f64; 3]>, String> {
        let vector = self.doubles()?;
        let covariance = self.doubles::<COVARIANCE>()?;
        Ok((covariance[0] != NO_VALUE).then_some(vector))
    }

    fn end(&self) -> Result<(), String> {
        let left = self.message.len().saturating_sub(self.at);
        if left <= MOST_PADDING {
            return Ok(());
        }
        Err(format!("a message with {left} bytes more than its type has"))
    }
}

fn cut() -> String {
    "a message that is shorter than its type".to_owned()
}

/// The encapsulation and the header, with the padding behind it.
fn begin(message: &mut Vec<u8>, stamp_ns: u64, frame_id: &str) -> Result<(), String> {
    let start = message.len() + ENCAPSULATION;
    let seconds = i32::try_from(stamp_ns / 1_000_000_000)
        .map_err(|_| format!("the time {stamp_ns} ns is after 2038, which header.stamp cannot say"))?;
    let nanoseconds = (stamp_ns % 1_000_000_000) as u32;
    message.extend_from_slice(&LITTLE_ENDIAN);
    message.extend_from_slice(&[0, 0]);
    message.extend_from_slice(&seconds.to_le_bytes());
    message.extend_from_slice(&nanoseconds.to_le_bytes());
    message.extend_from_slice(&(frame_id.len() as u32 + 1).to_le_bytes());
    message.extend_from_slice(frame_id.as_bytes());
    message.push(0);
    let padded = start + (message.len() - start).next_multiple_of(size_of::<f64>());
    message.resize(padded, 0);
    Ok(())
}

fn append(message: &mut Vec<u8>, values: &[f64]) {
    values.iter().for_each(|value| message.extend_from_slice(&value.to_le_bytes()));
}

/// A covariance that is unknown, or that says that there is no value.
fn covariance(has_value: bool) -> [f64; COVARIANCE] {
    let mut covariance = [0.0; COVARIANCE];
    if !has_value {
        covariance[0] = NO_VALUE;
    }
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imu(frame_id: &str) -> ImuMessage {
        ImuMessage {
            stamp_ns: 1_700_000_000_123_456_789,
            frame_id: frame_id.to_owned(),
            angular_velocity: Some([0.5, -0.25, 0.125]),
            linear_acceleration: Some([0.1, -9.81, 1e-9]),
        }
    }

    /// The same message in big-endian CDR, made from the little-endian one field by field.
    fn big_endian(message: &[u8], frame: usize) -> Vec<u8> {
        let mut big = message.to_vec();
        big[1] = 0;
        let words = (ENCAPSULATION..ENCAPSULATION + 12).step_by(4).map(|at| (at, 4));
        let doubles = ENCAPSULATION + (12 + frame + 1).next_multiple_of(8);
        words
            .chain((doubles..message.len()).step_by(8).map(|at| (at, 8)))
            .for_each(|(at, size)| big[at..at + size].reverse());
        big
    }

    #[test]
    fn messages_are_aligned_for_every_length_of_the_name() {
        for length in 0..20 {
            let frame = "f".repeat(length);
            let message = imu(&frame);
            let mut bytes = Vec::new();
            message.encode(&mut bytes).unwrap();
            // Stamp, length of the name, name and its zero, padding; 37 doubles.
            assert_eq!(bytes.len(), 4 + (12 + length + 1).next_multiple_of(8) + 37 * 8);
            assert_eq!(ImuMessage::decode(Encoding::Cdr, &bytes).unwrap(), message);
            assert_eq!(ImuMessage::decode(Encoding::Cdr, &big_endian(&bytes, length)).unwrap(), message);
            let doubles = 4 + (12 + length + 1).next_multiple_of(8);
            let ros1: Vec<u8> = [7_u32, 1_700_000_000, 123_456_789, length as u32]
                .iter()
                .flat_map(|word| word.to_le_bytes())
                .chain(frame.bytes())
                .chain(bytes[doubles..].iter().copied())
                .collect();
            assert_eq!(ImuMessage::decode(Encoding::Ros1, &ros1).unwrap(), message);
            let temperature = TemperatureMessage { stamp_ns: 5, frame_id: frame, celsius: -40.5 };
            let mut bytes = Vec::new();
            temperature.encode(&mut bytes).unwrap();
            assert_eq!(TemperatureMessage::decode(Encoding::Cdr, &bytes).unwrap(), temperature);
        }
    }

    #[test]
    fn what_does_not_exist_has_minus_one_in_its_covariance() {
        let mut bytes = Vec::new();
        let none =
            ImuMessage { angular_velocity: None, linear_acceleration: Some([f64::NAN, 0.0, 0.0]), ..imu("imu-a") };
        none.encode(&mut bytes).unwrap();
        let doubles: Vec<_> = bytes[4 + 24..].chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(doubles[..5], [0.0, 0.0, 0.0, 1.0, -1.0]);
        assert_eq!(doubles[13..17], [0.0, 0.0, 0.0, -1.0]);
        assert!(doubles[25].is_nan() && doubles[28] == -1.0);
        let read = ImuMessage::decode(Encoding::Cdr, &bytes).unwrap();
        assert_eq!((read.angular_velocity, read.linear_acceleration), (None, None));
        assert!(ImuMessage { stamp_ns: 1 << 62, ..imu("") }.encode(&mut bytes).unwrap_err().contains("after 2038"));
    }

    #[test]
    fn any_bytes_are_a_message_or_an_error() {
        let mut good = Vec::new();
        imu("imu-a").encode(&mut good).unwrap();
        for length in 0..good.len() {
            assert!(ImuMessage::decode(Encoding::Cdr, &good[..length]).is_err());
            let _ = ImuMessage::decode(Encoding::Ros1, &good[..length]);
            let _ = TemperatureMessage::decode(Encoding::Cdr, &good[..length]);
        }
        let mut long = good.clone();
        long.extend([0; 8]);
        assert!(ImuMessage::decode(Encoding::Cdr, &long).unwrap_err().contains("8 bytes more"));
        for place in 0..good.len() {
            for wrong in [0, 0x7f, 0xff] {
                let mut bytes = good.clone();
                bytes[place] = wrong;
                for encoding in [Encoding::Cdr, Encoding::Ros1] {
                    let _ = ImuMessage::decode(encoding, &bytes);
                    let _ = TemperatureMessage::decode(encoding, &bytes);
                }
            }
        }
        good[1] = 7;
        assert!(ImuMessage::decode(Encoding::Cdr, &good).unwrap_err().contains("encapsulation 00 07"));
    }
}
