//! KVH 1750, format A with delta angles in radians and whole degC. Source: ICD 56-0298 Rev. B, tables 5-1 to 5-10
//! (p. 14-18).

use super::checksum::crc32;
use super::own::DeviceStamp;
use super::pattern::{AXES, Values, pulses, temperature};

/// Gyroscopes [rad] and accelerometers [g]: multiples of powers of two, exact as f32.
fn readings(number: u64) -> [f32; 6] {
    let reading = |axis: usize| {
        let pulses = pulses(number, axis) as f32;
        if axis < 3 { pulses * 2_f32.powi(-20) } else { pulses * 2_f32.powi(-28) }
    };
    let mut readings: [f32; 6] = std::array::from_fn(reading);
    readings[2] += 1.0;
    readings
}

fn degrees(number: u64) -> i16 {
    temperature(number, 0) >> 8
}

pub(super) fn frame(number: u64, own: DeviceStamp) -> Vec<u8> {
    let [ax, ay, az, gx, gy, gz] = readings(number);
    encode([gx, gy, gz, ax, ay, az], 0x77, (own.count(1) % 128) as u8, degrees(number))
}

fn encode(readings: [f32; 6], status: u8, sequence: u8, degrees: i16) -> Vec<u8> {
    let mut bytes = vec![0xFE, 0x81, 0xFF, 0x55];
    for reading in readings {
        bytes.extend_from_slice(&reading.to_be_bytes());
    }
    bytes.extend_from_slice(&[status, sequence]);
    bytes.extend_from_slice(&degrees.to_be_bytes());
    let crc = crc32(&bytes);
    bytes.extend_from_slice(&crc.to_be_bytes());
    bytes
}

pub(super) fn expected(number: u64) -> Values {
    let mut values: Values = vec![
        ("status", f64::from(0x77)),
        ("sequence", (number % 128) as f64),
        ("temperature", f64::from(degrees(number))),
    ];
    values.extend(AXES.into_iter().zip(readings(number).map(f64::from)));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sample output of the ICD, 5.2.1 (p. 18).
    #[test]
    fn the_sample_of_the_manual_is_encoded_again() {
        let readings =
            [0x37A9_6A6E, 0x3858_6C1F, 0xB75B_F862, 0xBF80_3E78, 0xBB65_0D28, 0x3B0A_37AC].map(f32::from_bits);
        let bytes = encode(readings, 0x77, 0x3D, 40);
        assert_eq!(bytes.len(), 36);
        assert_eq!(bytes[28..], [0x77, 0x3D, 0x00, 0x28, 0x4B, 0xFA, 0x34, 0xD8]);
    }

    /// A real device: TRECVT/ros_kvh1750, test/utest.cpp, case basic.
    #[test]
    fn a_frame_of_a_real_device_is_encoded_again() {
        let readings =
            [0xB3D0_BBE7, 0x3219_3EF4, 0x30AC_19A5, 0xBA8F_78D6, 0x3A29_0594, 0x3F7E_CBD4].map(f32::from_bits);
        assert_eq!(encode(readings, 0x77, 104, 29)[32..], [0xAD, 0xC5, 0xF6, 0x51]);
    }
}
