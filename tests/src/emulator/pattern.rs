//! The values that every emulated IMU sends.

/// What the fields of a frame say, under their names in the profile, after scale and offset.
pub type Values = Vec<(&'static str, f64)>;

/// The number of an axis in the pattern.
pub(super) const AXES: [&str; 6] = ["ax", "ay", "az", "gx", "gy", "gz"];

/// The pattern: -2000 to 2000 pulses of axis 0 to 5, in the order of [`AXES`]. Its sum over 4001 samples is 0.
pub(super) fn pulses(number: u64, axis: usize) -> i32 {
    let axis = axis as u64;
    ((number % 4001 * (13 + 2 * axis) + 331 * axis) % 4001) as i32 - 2000
}

/// The temperature of sensor 0 to 5 in 1/256 degC: from 25 degC up by 1/256 degC every 100 samples, for 100 000
/// samples.
pub(super) fn temperature(number: u64, sensor: usize) -> i16 {
    25 * 256 + (number / 100 % 1000) as i16 + 3 * sensor as i16
}
