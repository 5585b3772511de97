//! VectorNav VN-100, binary output: TimeStartup; Temp, DeltaTheta, DeltaVel. Source: UM001 v2.22, p. 32, 36, 47, 48.

use super::checksum::crc16;
use super::own::DeviceStamp;
use super::pattern::{AXES, Values, pulses, temperature};

/// The first sample's time since start-up [ns], and the interval.
const START_NS: u64 = 1_000_000_000;
const INTERVAL_NS: u64 = 2_500_000;
/// 1 g in an interval, in multiples of 2^-20 m/s.
const GRAVITY: i32 = 25_707;

/// Accelerometers [m/s] and gyroscopes [deg]: multiples of 2^-20, exact as f32.
fn increments(number: u64) -> [f32; 6] {
    let gravity = [0, 0, GRAVITY, 0, 0, 0];
    std::array::from_fn(|axis| (pulses(number, axis) + gravity[axis]) as f32 * 2_f32.powi(-20))
}

fn degrees(number: u64) -> f32 {
    f32::from(temperature(number, 0)) / 256.0
}

fn time_ns(own: DeviceStamp) -> u64 {
    own.from(START_NS) + own.time(INTERVAL_NS)
}

pub(super) fn frame(number: u64, own: DeviceStamp) -> Vec<u8> {
    let [ax, ay, az, gx, gy, gz] = increments(number);
    // Group 1 with field 0; group 3 with fields 4, 6 and 7.
    let mut bytes = vec![0xFA, 0b101, 0x01, 0x00, 0b1101_0000, 0x00];
    bytes.extend_from_slice(&time_ns(own).to_le_bytes());
    for value in [degrees(number), 0.0025, gx, gy, gz, ax, ay, az] {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    finish(bytes)
}

/// Adds the CRC of all after the sync byte, its high byte first.
fn finish(mut bytes: Vec<u8>) -> Vec<u8> {
    let crc = crc16(&bytes[1..]);
    bytes.extend_from_slice(&crc.to_be_bytes());
    bytes
}

pub(super) fn expected(number: u64) -> Values {
    let mut values: Values = vec![
        ("time", time_ns(DeviceStamp::regular(number)) as f64),
        ("temperature", f64::from(degrees(number))),
        ("delta_time", f64::from(0.0025_f32)),
    ];
    values.extend(AXES.into_iter().zip(increments(number).map(f64::from)));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_as_in_the_manual() {
        let bytes = frame(9, DeviceStamp::regular(9));
        assert_eq!(bytes.len(), 48);
        assert_eq!(crc16(&bytes[1..]), 0);
        assert_eq!(u64::from_le_bytes(bytes[6..14].try_into().unwrap()), 1_022_500_000);
    }

    /// The manual's example case 1.
    #[test]
    fn the_example_of_the_manual_is_encoded_again() {
        let mut bytes = vec![0xFA, 0x01, 0x08, 0x00];
        for value in [43.578_686_f32, 1.884_720_2, -0.002_024_965_4] {
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        assert_eq!(finish(bytes)[14..], [0x04, 0xBB, 0x92, 0x88]);
    }
}
