//! Sensonor STIM300, datagram 0xA5 without CR LF. Source: TS1524 rev. 31, tables 5-20 to 5-23 (p. 36-38), section
//! 7.5.2.2 (p. 48-56).

use super::checksum::crc32;
use super::own::DeviceStamp;
use super::pattern::{Values, pulses, temperature};

/// 1 g of a 10 g accelerometer in 1 ms, in pulses of 2^-22 m/s.
const GRAVITY: i32 = 41_131;
/// The counter counts 2000 times a second.
const STEP: u64 = 2;
/// Time from sample to time tick [us], as a real device shows it.
const LATENCY: u16 = 506;
/// From the time tick to the first byte [us]: table 5-2.
const TRANSMISSION: f64 = 81.0;

/// Pulses of the axes: accelerometers, gyroscopes.
fn counts(number: u64) -> [i32; 6] {
    let gravity = [0, 0, GRAVITY, 0, 0, 0];
    std::array::from_fn(|axis| pulses(number, axis) + gravity[axis])
}

pub(super) fn frame(number: u64, own: DeviceStamp) -> Vec<u8> {
    let counts = counts(number);
    let mut bytes = vec![0xA5];
    for sensors in [3..6, 0..3] {
        for count in &counts[sensors] {
            bytes.extend_from_slice(&count.to_be_bytes()[1..]);
        }
        bytes.push(0);
    }
    for sensors in [3..6, 0..3] {
        for sensor in sensors {
            bytes.extend_from_slice(&temperature(number, sensor).to_be_bytes());
        }
        bytes.push(0);
    }
    bytes.push(own.count(STEP) as u8);
    bytes.extend_from_slice(&LATENCY.to_be_bytes());
    let crc = padded_crc(&bytes);
    bytes.extend_from_slice(&crc.to_be_bytes());
    bytes
}

/// A datagram that is none of measurements, with its CRC.
pub(super) fn special(mut bytes: Vec<u8>) -> Vec<u8> {
    let crc = padded_crc(&bytes);
    bytes.extend_from_slice(&crc.to_be_bytes());
    bytes
}

/// The CRC with zeros up to a multiple of 4 bytes, which are not sent (5.5.7, p. 37).
fn padded_crc(bytes: &[u8]) -> u32 {
    let mut padded = bytes.to_vec();
    while !padded.len().is_multiple_of(4) {
        padded.push(0);
    }
    crc32(&padded)
}

/// Increments: the pulses.
pub(super) fn increments(number: u64) -> Values {
    values(number, 1.0, 1.0)
}

/// Accelerations [g] and rates [deg/s].
pub(super) fn rates(number: u64) -> Values {
    values(number, 2_f64.powi(-19), 2_f64.powi(-14))
}

fn values(number: u64, accelerometer: f64, gyroscope: f64) -> Values {
    let names =
        ["temperature_ax", "temperature_ay", "temperature_az", "temperature_gx", "temperature_gy", "temperature_gz"];
    let mut values: Values = vec![
        ("counter", (number * STEP % 256) as f64),
        ("latency", f64::from(LATENCY) + TRANSMISSION),
        ("status", 0.0),
        ("status_a", 0.0),
    ];
    for (axis, count) in counts(number).into_iter().enumerate() {
        let scale = if axis < 3 { accelerometer } else { gyroscope };
        values.push((super::pattern::AXES[axis], f64::from(count) * scale));
        values.push((names[axis], f64::from(temperature(number, axis)) / 256.0));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_as_in_the_data_sheet() {
        let bytes = frame(3, DeviceStamp::regular(3));
        assert_eq!(bytes.len(), 42);
        assert_eq!((bytes[0], bytes[10], bytes[20], bytes[27], bytes[34]), (0xA5, 0, 0, 0, 0));
        assert_eq!((bytes[35], u16::from_be_bytes([bytes[36], bytes[37]])), (6, 506));
        let count = |at: usize| i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8;
        assert_eq!([11, 14, 17, 1, 4, 7].map(count), counts(3));
        assert_eq!(frame(128, DeviceStamp::regular(128))[35], 0);
    }

    /// A real frame of datagram 0xAF: geirhovland/stim300, README.md; 55 bytes and one zero.
    #[test]
    fn the_crc_is_that_of_a_real_device() {
        let real = [
            0xAF, 0x00, 0x01, 0x24, 0xFF, 0xFA, 0xD6, 0x00, 0x03, 0x5B, 0x00, 0xFF, 0xE7, 0xA6, 0xFF, 0xDD, 0x36, 0x08,
            0x1C, 0x52, 0x00, 0xFF, 0x7E, 0x70, 0xFE, 0xBA, 0x0C, 0x3F, 0xFA, 0x1D, 0x00, 0x23, 0xA0, 0x23, 0xC0, 0x23,
            0xA0, 0x00, 0x23, 0x19, 0x23, 0x0A, 0x23, 0x1C, 0x00, 0x23, 0x95, 0x23, 0xB6, 0x23, 0x95, 0x00, 0xFF, 0xEF,
            0x02, 0x00, 0xE1, 0x01, 0xFA,
        ];
        assert_eq!(padded_crc(&real), 3_326_689_990);
    }
}
