//! Telemetry logs of MAVLink (`.tlog`), which are recognised and not converted.
//!
//! Source: the MAVLink guide, "Serialization", and the messages of its common set. A ground station writes each message
//! behind the time of its arrival: microseconds, 8 bytes, big-endian. A message of version 1 is `FE`, length, 4 bytes,
//! its number in 1 byte, payload, checksum; of version 2 `FD`, length, flags, 4 bytes, its number in 3 bytes, payload,
//! checksum, and a signature of 13 bytes if a flag says so. Zeros at the end of a payload of version 2 are not sent.
//!
//! Why they are not converted: PX4 takes its corrections off before it sends, and the temperature is the barometer's.
//! ArduPilot sends whole mg and mrad/s (1000 ug0, 206 deg/h), corrected, at a few Hz. A table of these would repeat the
//! correction that was in force.

use isotherm_autopilot::logs::first_message;
use std::collections::BTreeMap;

/// Longest name of a message in a log of ArduPilot.
const LOG_NAME: usize = 4;
/// Messages that follow each other in what is recognised.
const CHAIN: usize = 3;
/// The number, the name and the place of the temperature in the payload. `None` is that of the barometer.
const IMU_MESSAGES: [(u32, &str, Option<usize>); 5] = [
    (26, "SCALED_IMU", Some(22)),
    (27, "RAW_IMU", Some(27)),
    (105, "HIGHRES_IMU", None),
    (116, "SCALED_IMU2", Some(22)),
    (129, "SCALED_IMU3", Some(22)),
];

/// A message.
struct MavlinkFrame<'a> {
    number: u32,
    payload: &'a [u8],
    length: usize,
}

/// Why data that begin with these bytes are refused; `None` if they are no telemetry log, nor one as lines of JSON.
pub(super) fn reason(beginning: &[u8]) -> Option<String> {
    if let Some(message) = first_message(beginning) {
        // Names of MAVLink's messages are long; those of ArduPilot's logs have up to four letters.
        let is_temperature = message.name().len() > LOG_NAME && message.name() != "BAD_DATA";
        return is_temperature.then(|| refusal("as lines of JSON"));
    }
    // With the times of arrival, and without.
    let stamp = [8, 0].into_iter().find(|stamp| frames(beginning, *stamp).take(CHAIN).count() == CHAIN)?;
    let mut found = BTreeMap::new();
    for frame in frames(beginning, stamp) {
        let known = IMU_MESSAGES.iter().find(|(number, ..)| *number == frame.number);
        let Some((_, name, at)) = known else { continue };
        let of_imu = at.and_then(|at| frame.payload.get(at..)).is_some_and(|rest| rest.iter().take(2).any(|b| *b != 0));
        let has_temperature = found.entry(*name).or_insert((at.is_none(), false));
        has_temperature.1 |= of_imu;
    }
    let told =
        |(name, (is_of_barometer, has_temperature)): (&&str, &(bool, bool))| match (is_of_barometer, has_temperature) {
            (true, _) => format!("{name} (with the temperature of the barometer)"),
            (false, true) => format!("{name} (with a temperature)"),
            (false, false) => format!("{name} (without a temperature)"),
        };
    let found: Vec<_> = found.iter().map(told).collect();
    let found = if found.is_empty() { "no message of an IMU at its beginning".to_owned() } else { found.join(", ") };
    Some(refusal(&format!("it has {found}")))
}

/// The reason; `what` is known of the log.
fn refusal(what: &str) -> String {
    format!(
        "a telemetry log of MAVLink; {what}. Its messages of IMUs are what the autopilot sent after its own corrections, SCALED_IMU \
         and RAW_IMU in whole mg and mrad/s: no calibration can be made of them. Give the log that the autopilot wrote \
         on its card at the same time: .bin of ArduPilot, with LOG_DISARMED 1, or .ulg of PX4"
    )
}

/// The messages at the beginning of the data, as far as they follow each other behind stamps of this length.
fn frames(data: &[u8], stamp: usize) -> impl Iterator<Item = MavlinkFrame<'_>> {
    let mut rest = data;
    std::iter::from_fn(move || {
        let frame = MavlinkFrame::read(rest.get(stamp..)?)?;
        rest = rest.get(stamp + frame.length..)?;
        Some(frame)
    })
}

impl<'a> MavlinkFrame<'a> {
    /// The message that the data begin with.
    fn read(data: &'a [u8]) -> Option<Self> {
        let (header, number, signature) = match *data.get(..10)? {
            [0xfe, _, _, _, _, number, ..] => (6, number.into(), 0),
            [0xfd, _, flags @ (0 | 1), _, _, _, _, a, b, c] => {
                (10, u32::from_le_bytes([a, b, c, 0]), 13 * usize::from(flags))
            }
            _ => return None,
        };
        let end = header + usize::from(data[1]);
        Some(Self { number, payload: data.get(header..end)?, length: end + 2 + signature })
    }
}
