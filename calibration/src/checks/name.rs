//! The names of findings, for `--accept` and for scripts.

/// A position of the campaign file is missing at a set point.
pub const MISSING_POSITION: &str = "missing-position";
/// There are fewer than two set points.
pub const SET_POINTS: &str = "set-points";
/// A channel gives no pulses where the accelerometer points its way.
pub const NO_PULSES: &str = "no-pulses";
/// Telemetry is the same at every set point.
pub const TELEMETRY_CONSTANT: &str = "telemetry-constant";
/// The intervals are not the time from row to row.
pub const INTERVAL: &str = "interval";
/// Over 1 % of the rows are missing.
pub const MISSING_ROWS: &str = "missing-rows";
/// Time is lost, or counted twice, within a dwell or a ramp, without a hole in the sequences.
pub const TIME_STEP: &str = "time-step";
/// A dwell is shorter than the others.
pub const SHORT_DWELL: &str = "short-dwell";
/// A set point was measured soon after the one before.
pub const SOAK: &str = "soak";
/// The turntable seems to turn faster than any can.
pub const IMPOSSIBLE_MOTION: &str = "impossible-motion";
/// The temperature seems to change faster than any IMU can.
pub const IMPOSSIBLE_RAMP: &str = "impossible-ramp";
/// The campaign seems to last longer than any does.
pub const DURATION: &str = "duration";
/// Telemetry of a row is far beyond that of all set points.
pub const TELEMETRY_READING: &str = "telemetry-reading";
/// Telemetry has the same digits at two set points.
pub const TELEMETRY_STUCK: &str = "telemetry-stuck";
/// Telemetry moves within a dwell or a set point.
pub const TELEMETRY_DRIFT: &str = "telemetry-drift";
/// Telemetry in degC or K is steeper than 1.5 against the set points.
pub const TELEMETRY_SLOPE: &str = "telemetry-slope";
/// Telemetry in degC or K is far from the set points.
pub const TELEMETRY_OFFSET: &str = "telemetry-offset";
/// Telemetry does not follow the order of the set points.
pub const TELEMETRY_ORDER: &str = "telemetry-order";
/// Two set points have the same telemetry.
pub const SET_POINT: &str = "set-point";
/// A converter is full.
pub const SATURATED: &str = "saturated";
/// A dwell is over 0.1 g0 from what its position asks for.
pub const WRONG_POSITION: &str = "wrong-position";
/// A position differs from the campaign file.
pub const POSITION_OFF: &str = "position-off";
/// The IMU moved within a dwell.
pub const NOT_STILL: &str = "not-still";
/// K+ and |K-| of an accelerometer differ beyond a factor of 1.5.
pub const CHANNELS_DIFFER: &str = "channels-differ";
/// The scale factors of two accelerometers differ beyond a factor of 3.
pub const AXES_DIFFER: &str = "axes-differ";
/// A residual in one position at all temperatures, or a level error that may not cancel.
pub const LEVEL: &str = "level";
/// A curve misses its set points.
pub const LACK_OF_FIT: &str = "lack-of-fit";
/// A curve has as many coefficients as there are set points.
pub const NO_FREEDOM: &str = "no-freedom";
/// A dwell is far off the fit.
pub const OUTLIER: &str = "outlier";
/// The residuals of a curve are not independent, or heating and cooling differ.
pub const RESIDUALS: &str = "residuals";
/// Diagnosis: two positions are exchanged, or their numbers shifted.
pub const POSITIONS_EXCHANGED: &str = "positions-exchanged";
/// Diagnosis: two accelerometers are exchanged, or the IMU is mounted otherwise.
pub const AXES_EXCHANGED: &str = "axes-exchanged";
/// Diagnosis: the channels of an accelerometer are exchanged, or a sign of the specific force.
pub const CHANNELS_EXCHANGED: &str = "channels-exchanged";
/// Diagnosis: the IMU is turned against the campaign file.
pub const HEADING: &str = "heading";

/// A turn of the campaign file is missing at a set point.
pub const MISSING_TURN: &str = "missing-turn";
/// A turn does not begin or end at rest.
pub const TURN_REST: &str = "turn-rest";
/// Samples of a turn are missing.
pub const TURN_GAP: &str = "turn-gap";
/// The rows of a turn are too long.
pub const TURN_ROWS: &str = "turn-rows";
/// The pulses of a turn say another angle than the campaign file.
pub const TURN_ANGLE: &str = "turn-angle";
/// Earth's rate is not that of the stated latitude, or looks like that of the other hemisphere.
pub const LATITUDE: &str = "latitude";
/// Without angles, a part of Earth's rate does not cancel.
pub const EARTH_RATE: &str = "earth-rate";
/// The samples have gyroscopes, but the campaign file has no turns.
pub const NO_TURNS: &str = "no-turns";

/// Rows are of another unit than the campaign file says, or of two units.
pub const OTHER_DEVICE: &str = "other-device";

/// A warning about lag and transients.
pub const TRANSIENT: &str = "transient";
/// Only one of ramps and table has gyroscopes.
pub const RAMP_GYROSCOPES: &str = "ramp-gyroscopes";

/// Every name, and whether a fault of this name can be accepted: those that cannot leave nothing to fit.
pub const ALL: [(&str, bool); 45] = [
    (MISSING_POSITION, false),
    (SET_POINTS, false),
    (NO_PULSES, false),
    (TELEMETRY_CONSTANT, false),
    (INTERVAL, true),
    (MISSING_ROWS, true),
    (TIME_STEP, true),
    (SHORT_DWELL, true),
    (SOAK, true),
    (IMPOSSIBLE_MOTION, true),
    (IMPOSSIBLE_RAMP, true),
    (DURATION, true),
    (TELEMETRY_READING, false),
    (TELEMETRY_STUCK, true),
    (TELEMETRY_DRIFT, true),
    (TELEMETRY_SLOPE, true),
    (TELEMETRY_OFFSET, true),
    (TELEMETRY_ORDER, true),
    (SET_POINT, true),
    (SATURATED, true),
    (WRONG_POSITION, true),
    (POSITION_OFF, true),
    (NOT_STILL, true),
    (CHANNELS_DIFFER, true),
    (AXES_DIFFER, true),
    (LEVEL, true),
    (LACK_OF_FIT, true),
    (NO_FREEDOM, true),
    (OUTLIER, true),
    (RESIDUALS, true),
    (POSITIONS_EXCHANGED, true),
    (AXES_EXCHANGED, true),
    (CHANNELS_EXCHANGED, true),
    (HEADING, true),
    (MISSING_TURN, false),
    (TURN_REST, true),
    (TURN_GAP, true),
    (TURN_ROWS, true),
    (TURN_ANGLE, true),
    (LATITUDE, true),
    (EARTH_RATE, true),
    (NO_TURNS, true),
    (OTHER_DEVICE, true),
    (TRANSIENT, true),
    (RAMP_GYROSCOPES, true),
];

/// The name of a finding that the user accepts.
///
/// # Errors
/// If no finding has this name, or if a fault of this name leaves nothing to fit. The message lists the names.
pub fn acceptable(text: &str) -> Result<&'static str, String> {
    match ALL.into_iter().find(|(name, _)| *name == text) {
        Some((name, true)) => Ok(name),
        Some((name, false)) => {
            Err(format!("{name} cannot be accepted, because nothing is left to fit; mend the data{}", remedy(name)))
        }
        None => {
            let names: Vec<_> = ALL.into_iter().filter(|(_, acceptable)| *acceptable).map(|(name, _)| name).collect();
            Err(format!("give the name of a finding: {}", names.join(", ")))
        }
    }
}

fn remedy(name: &str) -> &'static str {
    match name {
        MISSING_POSITION => ", or leave the position out knowingly with --exclude",
        MISSING_TURN => ", or leave the turn out knowingly with --exclude",
        TELEMETRY_READING => ", or leave the dwell out with --exclude",
        _ => "",
    }
}
