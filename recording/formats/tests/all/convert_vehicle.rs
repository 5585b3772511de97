//! What the vehicle did by its own log: armed, flying.
#![allow(clippy::single_range_in_vec_init, reason = "a list of ranges may have one")]

use crate::logs::{Dataflash, ImuRow, Ulog, vehicle_state};
use isotherm_recording::foreign::VehicleState;
use std::ops::Range;

/// Milliseconds as the times of rows.
fn ranges<const N: usize>(all: [Range<u64>; N]) -> Vec<Range<u64>> {
    let ns = |ms: u64| ms.saturating_mul(1_000_000);
    all.into_iter().map(|range| ns(range.start)..ns(range.end)).collect()
}

const END: u64 = u64::MAX;

/// A log with these messages, each with its topic's number, time [ms] and value, among the rows.
fn ulog(said: &[(u16, u64, u8)]) -> VehicleState {
    let mut log = Ulog::new();
    log.message(b'F', b"vehicle_status:uint64_t timestamp;uint64_t armed_time;uint8_t arming_state;uint8_t nav_state;")
        .message(b'F', b"actuator_armed:uint64_t timestamp;bool armed;bool prearmed;")
        .message(b'F', b"vehicle_land_detected:uint64_t timestamp;float alt_max;bool freefall;bool landed;");
    log.subscribe(0, 20, "vehicle_status").subscribe(0, 21, "actuator_armed").subscribe(0, 22, "vehicle_land_detected");
    for ms in 1..=1000_u64 {
        if ms % 10 == 0 {
            log.imu(ms * 1000);
        }
        for (number, _, value) in said.iter().filter(|(_, at, _)| *at == ms) {
            let mut body = number.to_le_bytes().to_vec();
            body.extend((ms * 1000).to_le_bytes());
            body.extend(match number {
                20 => vec![0, 0, 0, 0, 0, 0, 0, 0, *value, 3],
                21 => vec![*value, 1],
                _ => vec![0, 0, 0, 0, 0, *value],
            });
            log.message(b'D', &body);
        }
    }
    vehicle_state(&log.bytes, "ulg")
}

#[test]
fn a_ulog_says_when_it_was_armed_and_flew() {
    assert_eq!(ulog(&[]), VehicleState::default());
    let state = ulog(&[(20, 5, 1), (20, 300, 2), (20, 400, 2), (22, 10, 1), (22, 350, 0), (22, 500, 1), (20, 600, 1)]);
    assert_eq!(state, VehicleState { armed: ranges([300..600]), flying: ranges([350..500]) });
    assert_eq!(state.in_use(), state.armed);
    // The log begins and ends armed; the other topic says more.
    let state = ulog(&[(20, 5, 2), (20, 100, 1), (20, 700, 2), (21, 6, 0), (21, 50, 1), (21, 120, 0)]);
    assert_eq!(state.armed, [&ranges([0..120])[..], &[700_000_000..END]].concat());
    assert_eq!(ulog(&[(20, 5, 1), (20, 500, 3), (21, 7, 0)]), VehicleState::default());
}

/// A log with these messages, each after the row of this time [ms].
fn dataflash(said: &[(u64, &str, &[&str])]) -> VehicleState {
    let mut log = Dataflash::new();
    for ms in (0..1000).step_by(20) {
        log.imu(&ImuRow { time_us: ms * 1000, ..ImuRow::default() });
        for (at, name, values) in said {
            if *at == ms {
                let (letters, names) = match *name {
                    "EV" => ("QB", "TimeUS,Id"),
                    "ARM" => ("QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
                    _ => ("QBBBB", "TimeUS,isFlying,isFlyProb,Armed,Safety"),
                };
                let time = (ms * 1000).to_string();
                log.message(name, letters, names, &[&[time.as_str()][..], values].concat());
            }
        }
    }
    let state = vehicle_state(&log.bytes, "bin");
    assert_eq!(vehicle_state(log.text.as_bytes(), "log"), state);
    state
}

#[test]
fn a_dataflash_log_says_when_it_was_armed_and_flew() {
    assert_eq!(dataflash(&[]), VehicleState::default());
    let state = dataflash(&[
        (100, "EV", &["10"]),
        (140, "EV", &["28"]),
        (160, "EV", &["25"]),
        (200, "EV", &["18"]),
        (300, "EV", &["11"]),
    ]);
    assert_eq!(state, VehicleState { armed: ranges([100..300]), flying: ranges([140..200]) });
    // A log that begins when the vehicle is armed already has only the end of it.
    assert_eq!(dataflash(&[(300, "EV", &["11"])]).armed, ranges([0..300]));
    let ended = dataflash(&[(100, "ARM", &["1", "0", "0", "2"]), (500, "ARM", &["0", "0", "0", "2"])]);
    assert_eq!(ended.armed, ranges([100..500]));
    let state = dataflash(&[(40, "STAT", &["0", "0", "1", "0"]), (80, "STAT", &["1", "99", "1", "0"])]);
    assert_eq!(state, VehicleState { armed: vec![0..END], flying: vec![80_000_000..END] });
    assert_eq!(state.in_use(), state.armed);
}
