//! What `examples/acquire/arduino-mpu6050.ino` prints: raw counts of an MPU-6050. Source: RM-MPU-6000A-00 rev. 4.2, p.
//! 29 to 31.

use super::own::DeviceStamp;
use super::pattern::{AXES, Values, pulses, temperature};

/// First counter and first time [us]: they wrap within the first samples.
const COUNTER: u64 = 65_500;
const MICROS: u32 = 0xFFFE_0000;
/// 1 g in a range of 4 g.
const GRAVITY: i32 = 8192;

fn counts(number: u64) -> [i32; 6] {
    let gravity = [0, 0, GRAVITY, 0, 0, 0];
    std::array::from_fn(|axis| pulses(number, axis) + gravity[axis])
}

/// The temperature as text [degC], from raw counts of 1/340 degC.
fn degrees(number: u64) -> String {
    let raw = ((f64::from(temperature(number, 0)) / 256.0 - 36.53) * 340.0).round();
    format!("{:.3}", raw / 340.0 + 36.53)
}

fn counter(own: DeviceStamp) -> u16 {
    (own.from(COUNTER) + own.count(1)) as u16
}

fn micros(own: DeviceStamp) -> u32 {
    own.from(MICROS).wrapping_add(own.time(5000) as u32)
}

pub(super) fn frame(number: u64, own: DeviceStamp) -> Vec<u8> {
    let [ax, ay, az, gx, gy, gz] = counts(number);
    let (counter, micros, degrees) = (counter(own), micros(own), degrees(number));
    let text = format!("IMU,{counter},{micros},{ax},{ay},{az},{degrees},{gx},{gy},{gz}");
    let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("${text}*{sum:02X}\r\n").into_bytes()
}

pub(super) fn expected(number: u64) -> Values {
    let own = DeviceStamp::regular(number);
    let mut values: Values = vec![
        ("counter", f64::from(counter(own))),
        ("micros", f64::from(micros(own))),
        ("temperature", degrees(number).parse().unwrap()),
    ];
    values.extend(AXES.into_iter().zip(counts(number).map(f64::from)));
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_as_the_sketch_prints_them() {
        let line = String::from_utf8(frame(0, DeviceStamp::regular(0))).unwrap();
        assert_eq!(line, "$IMU,65500,4294836224,-2000,-1669,6854,25.001,-1007,-676,-345*7A\r\n");
        assert_eq!(expected(36)[0], ("counter", 0.0));
        assert!(expected(27)[1].1 < expected(26)[1].1);
    }
}
