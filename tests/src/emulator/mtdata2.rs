//! Xsens MTData2 in f32, as real devices send it (einride/xsens-go, testdata): temperature once a second, an item that
//! no profile knows, and messages of GNSS that count, too. Source: MTi User Manual MT0605P.E, p. 23, 24, 53, 54.

use super::checksum::negative_sum;
use super::own::DeviceStamp;
use super::pattern::{AXES, Values, pulses, temperature};

/// Samples between two messages of GNSS, of which each has a counter of its own, and between two temperatures.
const GNSS_EVERY: u64 = 25;
const TEMPERATURE_EVERY: u64 = 100;
/// First counter and first time [0.1 ms]: they wrap within the first samples.
const COUNTER: u64 = 65_500;
const TIME: u32 = 0xFFFF_F000;
/// 9.8125 m/s2 in multiples of 2^-12 m/s2.
const GRAVITY: i32 = 40_192;
/// What looks like the beginning of another message, as the data of an item.
const LOOKS_LIKE_A_MESSAGE: [u8; 12] = [0xFA, 0xFF, 0x36, 4, 0x10, 0x20, 2, 0, 0, 0, 0, 0];

/// Accelerations [m/s2] and rates [rad/s]: multiples of powers of two, exact as f32.
fn readings(number: u64) -> [f32; 6] {
    std::array::from_fn(|axis| match axis {
        0 | 1 => pulses(number, axis) as f32 * 2_f32.powi(-12),
        2 => (pulses(number, axis) + GRAVITY) as f32 * 2_f32.powi(-12),
        _ => pulses(number, axis) as f32 * 2_f32.powi(-18),
    })
}

fn degrees(number: u64) -> f32 {
    f32::from(temperature(number / TEMPERATURE_EVERY * TEMPERATURE_EVERY, 0)) / 256.0
}

/// It counts messages of GNSS, too.
fn counter(own: DeviceStamp) -> u16 {
    (own.from(COUNTER) + own.count(1) + own.frames / GNSS_EVERY) as u16
}

fn time(own: DeviceStamp) -> u32 {
    own.from(TIME).wrapping_add(own.time(100) as u32)
}

pub(super) fn frame(number: u64, own: DeviceStamp) -> Vec<u8> {
    let mut bytes = Vec::new();
    if own.frames > 0 && own.frames.is_multiple_of(GNSS_EVERY) {
        bytes.extend(gnss(own));
    }
    let [ax, ay, az, gx, gy, gz] = readings(number).map(f32::to_be_bytes);
    let mut items = vec![
        (0x1020, counter(own).to_be_bytes().to_vec()),
        (0x1060, time(own).to_be_bytes().to_vec()),
        (0x1010, LOOKS_LIKE_A_MESSAGE.to_vec()),
        (0xE020, 5_u32.to_be_bytes().to_vec()),
    ];
    if number.is_multiple_of(TEMPERATURE_EVERY) || own.frames == 0 {
        items.push((0x0810, degrees(number).to_be_bytes().to_vec()));
    }
    items.push((0x4020, [ax, ay, az].concat()));
    items.push((0x8020, [gx, gy, gz].concat()));
    bytes.extend(message(&items));
    bytes
}

/// A message of GNSS before a sample. Its time is earlier than that of the sample before.
fn gnss(own: DeviceStamp) -> Vec<u8> {
    message(&[
        (0x7010, vec![0x5A; 94]),
        (0x1060, time(own).wrapping_sub(400).to_be_bytes().to_vec()),
        (0x1020, counter(own).wrapping_sub(1).to_be_bytes().to_vec()),
    ])
}

fn message(items: &[(u16, Vec<u8>)]) -> Vec<u8> {
    let mut data = Vec::new();
    for (id, content) in items {
        data.extend_from_slice(&id.to_be_bytes());
        data.push(content.len() as u8);
        data.extend_from_slice(content);
    }
    xbus(0x36, &data)
}

/// A message with this identifier.
pub(super) fn xbus(id: u8, data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xFA, 0xFF, id, data.len() as u8];
    bytes.extend_from_slice(data);
    bytes.push(negative_sum(&bytes[1..]));
    bytes
}

/// The temperature is the last one sent.
pub(super) fn expected(number: u64) -> Values {
    let own = DeviceStamp::regular(number);
    let mut values: Values = vec![
        ("counter", f64::from(counter(own))),
        ("time", f64::from(time(own)) * 100.0),
        ("status", 5.0),
        ("temperature", f64::from(degrees(number))),
    ];
    values.extend(AXES.into_iter().zip(readings(number).map(f64::from)));
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::tests::value;

    #[test]
    fn messages_count_and_wrap() {
        let counters = |number: u64| value(&expected(number), "counter");
        assert_eq!([0, 24, 25, 34, 35].map(counters), [65_500.0, 65_524.0, 65_526.0, 65_535.0, 0.0]);
        assert_eq!(counters(50), 16.0);
        assert!(value(&expected(41), "time") < value(&expected(40), "time"));
        // 4 + 5 + 7 + 15 + 7 + 15 + 15 + 1 bytes; a temperature has 7, a message of GNSS 114.
        assert_eq!([0, 1, 25, 100].map(|number| frame(number, DeviceStamp::regular(number)).len()), [76, 69, 183, 190]);
        for number in 0..30 {
            let bytes = frame(number, DeviceStamp::regular(number));
            assert_eq!(bytes[..3], [0xFA, 0xFF, 0x36]);
            let first = usize::from(bytes[3]) + 5;
            assert_eq!(negative_sum(&bytes[1..first]), 0);
            assert!(first == bytes.len() || bytes[first] == 0xFA && negative_sum(&bytes[first + 1..]) == 0);
        }
    }

    /// A real device: einride/xsens-go, testdata/5/output.bin, frame 0.
    #[test]
    fn a_message_of_a_real_device_is_encoded_again() {
        let items = [
            (0x1020, vec![0xAB, 0x16]),
            (0x1060, vec![0x03, 0x15, 0x9B, 0x54]),
            (0x1070, vec![0x00, 0x00, 0x14, 0x36]),
            (0x1010, vec![0x22, 0x5B, 0x2A, 0x80, 0x07, 0xE3, 0x01, 0x14, 0x0D, 0x2F, 0x1C, 0x37]),
            (0xE020, vec![0x01, 0x80, 0x00, 0x05]),
            (0x3010, vec![0x00, 0x01, 0x8C, 0x0D]),
        ];
        let bytes = message(&items);
        assert_eq!((bytes[3], bytes.len(), bytes.last()), (0x30, 53, Some(&0x16)));
    }
}
