//! The bits of an increment's `flags`, for C.

/// Head telemetry of A1 below the bias range.
pub const ISOTHERM_FLAG_A1_HEAD_BELOW: u32 = 1 << 0;
/// Head telemetry of A2 below the bias range.
pub const ISOTHERM_FLAG_A2_HEAD_BELOW: u32 = 1 << 1;
/// Head telemetry of A3 below the bias range.
pub const ISOTHERM_FLAG_A3_HEAD_BELOW: u32 = 1 << 2;
/// Head telemetry of A1 above the bias range.
pub const ISOTHERM_FLAG_A1_HEAD_ABOVE: u32 = 1 << 3;
/// Head telemetry of A2 above the bias range.
pub const ISOTHERM_FLAG_A2_HEAD_ABOVE: u32 = 1 << 4;
/// Head telemetry of A3 above the bias range.
pub const ISOTHERM_FLAG_A3_HEAD_ABOVE: u32 = 1 << 5;
/// Board telemetry of A1 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A1_BOARD_BELOW: u32 = 1 << 6;
/// Board telemetry of A2 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A2_BOARD_BELOW: u32 = 1 << 7;
/// Board telemetry of A3 below the range of K+ or K-.
pub const ISOTHERM_FLAG_A3_BOARD_BELOW: u32 = 1 << 8;
/// Board telemetry of A1 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A1_BOARD_ABOVE: u32 = 1 << 9;
/// Board telemetry of A2 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A2_BOARD_ABOVE: u32 = 1 << 10;
/// Board telemetry of A3 above the range of K+ or K-.
pub const ISOTHERM_FLAG_A3_BOARD_ABOVE: u32 = 1 << 11;
/// Telemetry of A1 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A1_NOT_FINITE: u32 = 1 << 12;
/// Telemetry of A2 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A2_NOT_FINITE: u32 = 1 << 13;
/// Telemetry of A3 NaN or infinite; the increment is NaN under any policy.
pub const ISOTHERM_FLAG_A3_NOT_FINITE: u32 = 1 << 14;
/// More pulses per second on A1 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A1_RATE: u32 = 1 << 15;
/// More pulses per second on A2 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A2_RATE: u32 = 1 << 16;
/// More pulses per second on A3 than the table's `max_rate`.
pub const ISOTHERM_FLAG_A3_RATE: u32 = 1 << 17;
/// Interval 0 or over ISOTHERM_MAX_INTERVAL_NS; the increment is NaN.
pub const ISOTHERM_FLAG_INTERVAL: u32 = 1 << 18;
/// The IMU is served without a table (`--allow-uncalibrated`); the increment is NaN.
pub const ISOTHERM_FLAG_NO_TABLE: u32 = 1 << 19;
/// The telemetry is older than the table's `max_age_s`.
pub const ISOTHERM_FLAG_TELEMETRY_STALE: u32 = 1 << 20;
/// Samples of this session are missing before this one.
pub const ISOTHERM_FLAG_GAP: u32 = 1 << 24;
/// The latency was over the configured budget.
pub const ISOTHERM_FLAG_LATE: u32 = 1 << 25;
