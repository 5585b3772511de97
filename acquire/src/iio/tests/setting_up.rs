//! What is written into sysfs.

use std::sync::{Arc, Mutex};

use rustix::io::Errno;

use super::super::IioClock;
use super::records::{ADIS16505, BMI270, LSM6DSOX_ACCEL, LSM6DSOX_GYRO, MPU6050};
use super::tree::{Fake, SIX, settings};

#[test]
fn the_buffer_is_on_while_the_source_is() {
    let fake = Fake::with(&[ADIS16505]);
    let mut wanted = settings("adis16505", SIX, "temp0");
    wanted.watermark = 8;
    let source = fake.open(&wanted).unwrap();
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "1");
    assert_eq!(fake.get("iio:device0/buffer0/watermark"), "8");
    assert_eq!(fake.get("iio:device0/buffer0/length"), "64");
    assert_eq!(fake.get("iio:device0/current_timestamp_clock"), "monotonic");
    assert_eq!(source.clock(), &IioClock::Monotonic);
    assert_eq!(source.descriptors().count(), 1);
    drop(source);
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
    // The folders of before 5.11 are another view of the same: they are not written.
    assert_eq!(fake.get("iio:device0/buffer/length"), "2");
}

/// The kernel refuses all settings but `enable` while the buffer is on, so the order matters.
#[test]
fn a_buffer_that_a_killed_program_left_on_is_started_anew() {
    let mut fake = Fake::with(&[MPU6050]);
    fake.set("iio:device0/buffer/enable", "1");
    let log = Arc::new(Mutex::new(Vec::new()));
    let written = Arc::clone(&log);
    fake.kernel(move |path, value| {
        let mut log = written.lock().unwrap();
        let is_on = log.iter().rev().find(|(path, _): &&(String, String)| path.ends_with("enable"));
        let is_on = is_on.is_none_or(|(_, value)| value == "1");
        log.push((path.to_owned(), value.to_owned()));
        if is_on && !path.ends_with("enable") { Err(Errno::BUSY.into()) } else { Ok(value.to_owned()) }
    });
    let source = fake.open(&settings("mpu6050", SIX, "")).unwrap();
    assert_eq!(fake.get("iio:device0/buffer/enable"), "1");
    drop(source);
    let log = log.lock().unwrap();
    let enabled: Vec<&str> =
        log.iter().filter(|(path, _)| path.ends_with("enable")).map(|(_, on)| on.as_str()).collect();
    assert_eq!(enabled, ["0", "1", "0"]);
}

/// The two devices of a chip share its rate, and the driver changes it while both are off.
#[test]
fn both_devices_are_off_before_one_is_set_up() {
    let mut fake = Fake::with(&[LSM6DSOX_ACCEL, LSM6DSOX_GYRO]);
    fake.set("iio:device1/buffer0/enable", "1");
    let other = fake.tree.devices().join("iio:device1/buffer0/enable");
    fake.kernel(move |path, value| {
        let is_on = std::fs::read_to_string(&other)?.trim() == "1";
        if is_on && path == "iio:device0/sampling_frequency" { Err(Errno::BUSY.into()) } else { Ok(value.to_owned()) }
    });
    let mut wanted = settings("lsm6dsox_accel lsm6dsox_gyro", SIX, "");
    wanted.interval_ns = 1_000_000_000 / 104;
    let _source = fake.open(&wanted).unwrap();
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "104.000");
    assert_eq!(fake.get("iio:device1/buffer0/enable"), "1");
}

#[test]
fn a_failed_start_leaves_no_buffer_on() {
    let mut fake = Fake::with(&[LSM6DSOX_ACCEL, LSM6DSOX_GYRO]);
    fake.refuse("iio:device1/buffer0/enable", Errno::IO);
    let mut wanted = settings("lsm6dsox_accel lsm6dsox_gyro", SIX, "");
    wanted.interval_ns = 1_000_000_000 / 104;
    assert!(fake.open(&wanted).is_err());
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
}

#[test]
fn a_trigger_is_set_by_its_name() {
    let fake = Fake::with(&[BMI270]);
    fake.folder("trigger0", "name: sysfstrig0");
    fake.folder("trigger1", "name: imu-clock\nsampling_frequency: 10.000000");
    let mut wanted = settings("bmi270", SIX, "");
    wanted.trigger = Some("imu-clock".to_owned());
    let _source = fake.open(&wanted).unwrap();
    assert_eq!(fake.get("iio:device0/trigger/current_trigger"), "imu-clock");
    // A timer decides the rate; the chip's own stay.
    assert_eq!(fake.get("trigger1/sampling_frequency"), "100");
    assert_eq!(fake.get("iio:device0/in_anglvel_sampling_frequency"), "200.000000");
}

#[test]
fn a_clock_that_stays_is_named() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.refuse("iio:device0/current_timestamp_clock", Errno::INVAL);
    let source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    assert_eq!(source.clock(), &IioClock::Other("realtime".to_owned()));
    assert!(source.remarks().iter().any(|remark| remark.contains("clock realtime")), "{:?}", source.remarks());

    let fake = Fake::with(&[ADIS16505]);
    fake.remove("iio:device0/current_timestamp_clock");
    let source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    assert_eq!(source.clock(), &IioClock::Other("realtime".to_owned()));
}

/// A buffer in hardware has its own length, and old kernels have no watermark.
#[test]
fn a_length_that_cannot_be_set_stays() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.set("iio:device0/buffer0/length", "512");
    fake.remove("iio:device0/buffer0/watermark");
    fake.refuse("iio:device0/buffer0/length", Errno::PERM);
    let source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    drop(source);
    assert_eq!(fake.get("iio:device0/buffer0/length"), "512");
}

#[test]
fn scales_that_the_kernel_cuts_off_are_told() {
    let fake = Fake::with(&[ADIS16505]);
    let source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    let scale = source.scales()[3];
    assert_eq!((scale.scale, scale.offset), (0.000_000_006, 0.0));
    assert!((scale.rounding - 1.0 / 6.0).abs() < 1e-12);
    let remark = source.remarks().iter().find(|remark| remark.starts_with("anglvel_x")).unwrap();
    assert!(remark.contains("17 % more") && remark.contains("data sheet"), "{remark}");

    let fake = Fake::with(&[MPU6050]);
    let source = fake.open(&settings("mpu6050", SIX, "")).unwrap();
    assert_eq!(source.remarks(), [] as [String; 0]);
}
