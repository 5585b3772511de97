//! Temperatures that logs of autopilots do not have: only for the gyroscopes, for some rows, under another name.

use crate::logs::{Dataflash, IMU_FORMAT, IMU_NAMES, Ulog, convert, converted, refused};
use isotherm_autopilot::logs::GyroscopeTemperature;
use isotherm_recording_formats::convert::Settings;
use isotherm_support::failure::Exit;

/// A warm-up whose gyroscopes have this temperature at a row.
fn warm_up(celsius: impl Fn(u64) -> f32) -> Vec<u8> {
    let mut log = Ulog::new();
    for row in 0..100_u64 {
        let time_us = 1_000_000 + row * 100_000;
        log.gyro(0, time_us, [0.125, 0.0, -0.5], celsius(row));
        log.accel(0, time_us, [0.5, -0.25, -9.5], 20.0 + row as f32 / 10.0);
    }
    log.bytes
}

#[test]
fn gyroscopes_without_a_temperature_are_left_out_unless_they_are_lent_one() {
    for (at, told_as) in [
        (f32::NAN, "sensor_gyro has no temperature in any row"),
        (0.0, "the temperature of sensor_gyro stands at 0 degC, while that of sensor_accel moves by 9.9 degC"),
        (36.5, "the temperature of sensor_gyro stands at 36.5 degC"),
    ] {
        let log = warm_up(|_| at);
        let (samples, told) = converted(&log, "ulg", &Settings::default());
        assert!(samples.len() == 100 && samples.iter().all(|row| row.gyroscopes.is_absent()), "{told}");
        let remedy = "the rows have no gyroscopes; --gyroscope-temperature accelerometer takes";
        assert!(told.contains("warning [no-temperature]") && told.contains(told_as) && told.contains(remedy), "{told}");
        let lent = GyroscopeTemperature::Accelerometer;
        let (samples, told) = converted(&log, "ulg", &Settings { gyroscope_temperature: lent, ..Settings::default() });
        assert!(samples.iter().all(|row| row.gyroscopes.head_temperature == row.accelerometers.head_temperature));
        assert_eq!(samples[99].gyroscopes.head_temperature, [f64::from(29.9_f32); 3]);
        assert!(
            told.contains("the temperature of the gyroscopes is that of the accelerometers, as asked for"),
            "{told}"
        );
        let (samples, _) = converted(&log, "ulg", &Settings { temperature: Some(31.0), ..Settings::default() });
        assert_eq!((samples.len(), samples[5].gyroscopes.head_temperature), (100, [31.0; 3]));
    }
    // One that moves is its own.
    let (samples, told) = converted(&warm_up(|row| 30.0 + row as f32), "ulg", &Settings::default());
    assert!(samples[99].gyroscopes.head_temperature == [129.0; 3] && !told.contains("warning"), "{told}");
}

#[test]
fn rows_of_gyroscopes_without_a_temperature_are_left_out() {
    let log = warm_up(|row| if row % 10 == 5 { f32::NAN } else { 30.0 + row as f32 });
    let (samples, told) = converted(&log, "ulg", &Settings::default());
    assert_eq!(samples.len(), 90);
    assert!(samples.iter().all(|row| row.gyroscopes.head_temperature[0] > 29.0));
    assert!(told.contains("10 rows of sensor_gyro 0 have no temperature"), "{told}");
}

#[test]
fn the_option_is_for_logs_of_autopilots() {
    let settings = Settings { gyroscope_temperature: GyroscopeTemperature::Accelerometer, ..Settings::default() };
    let (exit, message) = refused(b"t,x\n", "csv", &settings);
    assert!(exit == Exit::Usage && message.contains("the temperature of the gyroscopes is named, but"), "{message}");
}

#[test]
fn old_logs_call_the_temperature_temp() {
    let mut log = Dataflash::new();
    let letters = IMU_FORMAT.replacen('B', "", 1);
    let names = IMU_NAMES.replace("I,", "").replace(",T,GH,AH", ",Temp,GyHlt,AcHlt");
    for row in 0..10_u64 {
        let time = (row * 20_000 + 1).to_string();
        let ill = if row == 3 { "0" } else { "1" };
        let values = [&time, "0", "0", "0", "0.5", "0", "9.5", "0", "0", "35.25", ill, "1", "1000", "1000"];
        log.message("IMU", &letters, &names, &values);
    }
    let (samples, told) = converted(&log.bytes, "bin", &Settings::default());
    assert_eq!((samples.len(), samples[9].accelerometers.head_temperature), (10, [35.25; 3]));
    assert!(told.contains("in 1 rows the IMU reports to be ill") && !told.contains("no-temperature"), "{told}");
}

/// A message of MAVLink, behind its time.
fn frame(stamped: bool, number: u8, payload: &[u8]) -> Vec<u8> {
    let stamp = 1_700_000_000_000_000_u64.to_be_bytes();
    let header = [0xfd, payload.len() as u8, 0, 0, 7, 1, 1, number, 0, 0];
    [if stamped { &stamp[..] } else { &[] }, &header, payload, &[0x12, 0x34]].concat()
}

#[test]
fn a_telemetry_log_is_named_with_the_log_that_has_the_rows() {
    for stamped in [true, false] {
        let mut log = Vec::new();
        for _ in 0..20 {
            log.extend(frame(stamped, 0, &[1; 9]));
            log.extend(frame(stamped, 26, &[2; 22]));
            log.extend(frame(stamped, 116, &[2; 24]));
            log.extend(frame(stamped, 105, &[2; 62]));
        }
        let (exit, message) = refused(&log, "tlog", &Settings::default());
        assert_eq!(exit, Exit::Data);
        for part in [
            "a telemetry log of MAVLink; it has HIGHRES_IMU (with the temperature of the barometer), SCALED_IMU (without \
             a temperature), SCALED_IMU2 (with a temperature)",
            "Give the log that the autopilot wrote on its card",
        ] {
            assert!(message.contains(part), "{message}");
        }
    }
    // What only begins like one is not.
    let failure = convert(&[&frame(true, 26, &[2; 22])[..], &[0; 100]].concat(), "tlog", &Settings::default());
    assert!(!failure.err().unwrap().message.contains("MAVLink"));
}
