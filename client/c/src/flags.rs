//! The bits of an increment's `flags`, for C.

/// Head temperature of A1 below the bias range.
pub const ISOTHERM_FLAG_A1_HEAD_BELOW: u64 = 1 << 0;
/// Head temperature of A2 below the bias range.
pub const ISOTHERM_FLAG_A2_HEAD_BELOW: u64 = 1 << 1;
/// Head temperature of A3 below the bias range.
pub const ISOTHERM_FLAG_A3_HEAD_BELOW: u64 = 1 << 2;
/// Head temperature of A1 above the bias range.
pub const ISOTHERM_FLAG_A1_HEAD_ABOVE: u64 = 1 << 3;
/// Head temperature of A2 above the bias range.
pub const ISOTHERM_FLAG_A2_HEAD_ABOVE: u64 = 1 << 4;
/// Head temperature of A3 above the bias range.
pub const ISOTHERM_FLAG_A3_HEAD_ABOVE: u64 = 1 << 5;
/// Board temperature of A1 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A1_BOARD_BELOW: u64 = 1 << 6;
/// Board temperature of A2 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A2_BOARD_BELOW: u64 = 1 << 7;
/// Board temperature of A3 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A3_BOARD_BELOW: u64 = 1 << 8;
/// Board temperature of A1 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A1_BOARD_ABOVE: u64 = 1 << 9;
/// Board temperature of A2 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A2_BOARD_ABOVE: u64 = 1 << 10;
/// Board temperature of A3 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A3_BOARD_ABOVE: u64 = 1 << 11;
/// Temperature of A1 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A1_NOT_FINITE: u64 = 1 << 12;
/// Temperature of A2 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A2_NOT_FINITE: u64 = 1 << 13;
/// Temperature of A3 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A3_NOT_FINITE: u64 = 1 << 14;
/// More pulses per second on A1 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A1_RATE: u64 = 1 << 15;
/// More pulses per second on A2 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A2_RATE: u64 = 1 << 16;
/// More pulses per second on A3 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A3_RATE: u64 = 1 << 17;
/// Interval 0 or over ISOTHERM_MAX_INTERVAL_NS; the increments are NaN.
pub const ISOTHERM_FLAG_INTERVAL: u64 = 1 << 18;
/// The IMU is served without a table (`--allow-uncalibrated`); the increments are NaN.
pub const ISOTHERM_FLAG_NO_TABLE: u64 = 1 << 19;
/// The temperature is older than the table's `max_age_s`, or as much newer than the end of the control period; or the
/// acquisition has marked it.
pub const ISOTHERM_FLAG_TELEMETRY_STALE: u64 = 1 << 20;
/// A bias had to do without its transient term: the sample's time constant is not the table's, or the lag difference is
/// not finite or larger than the bias's range.
pub const ISOTHERM_FLAG_LAG_UNKNOWN: u64 = 1 << 21;
/// The sample is of another device than the table's.
pub const ISOTHERM_FLAG_OTHER_DEVICE: u64 = 1 << 22;
/// A velocity increment is NaN, so that an angle was computed without its g-sensitivity.
pub const ISOTHERM_FLAG_G_UNKNOWN: u64 = 1 << 23;
/// Samples of this session are missing before this one.
pub const ISOTHERM_FLAG_GAP: u64 = 1 << 24;
/// The latency was over the configured budget.
pub const ISOTHERM_FLAG_LATE: u64 = 1 << 25;
/// No sequence is missing before this sample, and its `timestamp_ns` is not one `interval_ns` after that of the sample
/// before: the step differs from the interval by more than half of it. Time was lost, or the interval is wrong.
pub const ISOTHERM_FLAG_TIME_STEP: u64 = 1 << 26;
/// The first sample of a session other than the one that was served last for this IMU, by this service or by the one
/// before it since boot. Time may be missing before it.
pub const ISOTHERM_FLAG_SESSION: u64 = 1 << 27;
/// Head temperature of G1 below the bias range.
pub const ISOTHERM_FLAG_G1_HEAD_BELOW: u64 = 1 << 32;
/// Head temperature of G2 below the bias range.
pub const ISOTHERM_FLAG_G2_HEAD_BELOW: u64 = 1 << 33;
/// Head temperature of G3 below the bias range.
pub const ISOTHERM_FLAG_G3_HEAD_BELOW: u64 = 1 << 34;
/// Head temperature of G1 above the bias range.
pub const ISOTHERM_FLAG_G1_HEAD_ABOVE: u64 = 1 << 35;
/// Head temperature of G2 above the bias range.
pub const ISOTHERM_FLAG_G2_HEAD_ABOVE: u64 = 1 << 36;
/// Head temperature of G3 above the bias range.
pub const ISOTHERM_FLAG_G3_HEAD_ABOVE: u64 = 1 << 37;
/// Board temperature of G1 below the range of K+ or K-.
pub const ISOTHERM_FLAG_G1_BOARD_BELOW: u64 = 1 << 38;
/// Board temperature of G2 below the range of K+ or K-.
pub const ISOTHERM_FLAG_G2_BOARD_BELOW: u64 = 1 << 39;
/// Board temperature of G3 below the range of K+ or K-.
pub const ISOTHERM_FLAG_G3_BOARD_BELOW: u64 = 1 << 40;
/// Board temperature of G1 above the range of K+ or K-.
pub const ISOTHERM_FLAG_G1_BOARD_ABOVE: u64 = 1 << 41;
/// Board temperature of G2 above the range of K+ or K-.
pub const ISOTHERM_FLAG_G2_BOARD_ABOVE: u64 = 1 << 42;
/// Board temperature of G3 above the range of K+ or K-.
pub const ISOTHERM_FLAG_G3_BOARD_ABOVE: u64 = 1 << 43;
/// Temperature of G1 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_G1_NOT_FINITE: u64 = 1 << 44;
/// Temperature of G2 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_G2_NOT_FINITE: u64 = 1 << 45;
/// Temperature of G3 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_G3_NOT_FINITE: u64 = 1 << 46;
/// More pulses per second on G1 than the table's `max_rate`.
pub const ISOTHERM_FLAG_G1_RATE: u64 = 1 << 47;
/// More pulses per second on G2 than the table's `max_rate`.
pub const ISOTHERM_FLAG_G2_RATE: u64 = 1 << 48;
/// More pulses per second on G3 than the table's `max_rate`.
pub const ISOTHERM_FLAG_G3_RATE: u64 = 1 << 49;
/// The table has a nominal interval, and the sample's is not within 1 % of 1 to 64 times that: the scale factors are of
/// another interval. The increment is computed.
pub const ISOTHERM_FLAG_INTERVAL_NOT_NOMINAL: u64 = 1 << 50;

/// Mask: an increment could not be computed and is NaN, on one axis or on all. interval, no-table, not-finite.
pub const ISOTHERM_MASK_INVALID: u64 = ISOTHERM_FLAG_INTERVAL
    | ISOTHERM_FLAG_NO_TABLE
    | ISOTHERM_FLAG_A1_NOT_FINITE
    | ISOTHERM_FLAG_A2_NOT_FINITE
    | ISOTHERM_FLAG_A3_NOT_FINITE
    | ISOTHERM_FLAG_G1_NOT_FINITE
    | ISOTHERM_FLAG_G2_NOT_FINITE
    | ISOTHERM_FLAG_G3_NOT_FINITE;
/// Mask: computed, outside of what the calibration covers or without a part of it; the ranges give NaN where the
/// table's policy is `reject`. Ranges, rate, telemetry-stale, lag-unknown, other-device, g-unknown,
/// interval-not-nominal.
pub const ISOTHERM_MASK_DEGRADED: u64 =
    0x00038fff00738fff | ISOTHERM_FLAG_G_UNKNOWN | ISOTHERM_FLAG_INTERVAL_NOT_NOMINAL;
/// Mask: time is missing before this increment, or may be. gap, time-step, session.
pub const ISOTHERM_MASK_LOST: u64 = ISOTHERM_FLAG_GAP | ISOTHERM_FLAG_TIME_STEP | ISOTHERM_FLAG_SESSION;
/// Mask: says nothing against the increment. late.
pub const ISOTHERM_MASK_INFORMATION: u64 = ISOTHERM_FLAG_LATE;

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_client::Flags;

    #[test]
    fn the_masks_are_those_of_rust() {
        assert_eq!(ISOTHERM_MASK_INVALID, Flags::INVALID.0);
        assert_eq!(ISOTHERM_MASK_DEGRADED, Flags::DEGRADED.0);
        assert_eq!(ISOTHERM_MASK_LOST, Flags::LOST.0);
        assert_eq!(ISOTHERM_MASK_INFORMATION, Flags::INFORMATION.0);
    }
}
