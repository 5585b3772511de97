//! How a description names devices and channels.

use super::super::device::{devices, find};
use super::super::{IioFault, IioSettings};
use super::records::{ADIS16505, BMI270, LSM6DSOX_ACCEL, LSM6DSOX_GYRO, MPU6050};
use super::tree::{Fake, SIX, settings};

fn found(fake: &Fake, wanted: &str) -> Result<u32, String> {
    find(&devices(&fake.tree), wanted).map(|device| device.index).map_err(|fault| fault.to_string())
}

#[test]
fn a_name_its_beginning_a_label_or_a_number_is_a_device() {
    let fake = Fake::with(&[ADIS16505, BMI270, LSM6DSOX_ACCEL, LSM6DSOX_GYRO]);
    for (wanted, index) in [
        ("adis16505-2", 0),
        ("adis", 0),
        ("bmi270", 1),
        ("lsm6dsox_a", 2),
        ("imu-left", 2),
        ("imu", 2),
        ("iio:device3", 3),
        ("3", 3),
    ] {
        assert_eq!(found(&fake, wanted), Ok(index), "{wanted}");
    }
}

#[test]
fn an_exact_name_goes_before_a_beginning_and_a_number() {
    let fake = Fake::with(&["name: bmi270_aux", "name: bmi270", "name: 0"]);
    assert_eq!(found(&fake, "bmi270"), Ok(1));
    assert_eq!(found(&fake, "0"), Ok(2));
}

#[test]
fn what_could_be_several_is_refused_with_the_candidates() {
    let fake = Fake::with(&[LSM6DSOX_ACCEL, LSM6DSOX_GYRO, BMI270, BMI270]);
    let fault = found(&fake, "lsm6dsox").unwrap_err();
    assert!(fault.contains("lsm6dsox_accel (iio:device0, label imu-left), lsm6dsox_gyro (iio:device1)"), "{fault}");
    let fault = found(&fake, "bmi270").unwrap_err();
    assert!(fault.contains("2 devices match: bmi270 (iio:device2), bmi270 (iio:device3)"), "{fault}");
    assert!(fault.contains("by its label or as iio:deviceN"), "{fault}");
}

#[test]
fn what_is_not_there_is_told_with_what_is() {
    let fake = Fake::with(&[BMI270]);
    for wanted in ["adis16505", "1", "iio:device7", ""] {
        let fault = found(&fake, wanted).unwrap_err();
        assert!(fault.contains("there are bmi270 (iio:device0)"), "{wanted}: {fault}");
    }
    let fault = Fake::new().fault(&settings("bmi270", SIX, ""));
    assert_eq!(fault.kind, IioFault::Absent);
    assert!(fault.to_string().contains("no IIO device") && fault.to_string().contains("modprobe"), "{fault}");
}

#[test]
fn a_column_that_is_no_scan_element_is_told_with_those_that_are() {
    let fake = Fake::with(&[BMI270]);
    let fault = fake.fault(&settings("bmi270", "accel_x magn_x", ""));
    assert_eq!(fault.kind, IioFault::Description);
    let text = fault.to_string();
    assert!(text.contains("IIO channel magn_x") && text.contains("bmi270 (iio:device0) has accel_x accel_y"), "{text}");
}

#[test]
fn a_channel_of_both_devices_is_named_with_its_device() {
    let fake = Fake::with(&[MPU6050, BMI270]);
    let fault = fake.fault(&settings("mpu6050 bmi270", SIX, "")).to_string();
    assert!(fault.contains("several devices have it: mpu6050") && fault.contains("DEVICE/CHANNEL"), "{fault}");
    let columns = "mpu6050/accel_x mpu6050/accel_y mpu6050/accel_z bmi270/anglvel_x bmi/anglvel_y 1/anglvel_z";
    let source = fake.open(&settings("mpu6050 bmi270", columns, "mpu6050/temp")).unwrap();
    assert_eq!(source.descriptors().count(), 2);
    assert_eq!(source.scales()[0].scale, 0.000_598);
    assert_eq!(source.scales()[5].scale, 0.001_065);
}

#[test]
fn devices_must_be_one_or_two_different_ones_that_give_something() {
    let fake = Fake::with(&[MPU6050, BMI270, LSM6DSOX_ACCEL]);
    for (devices, cause) in [
        ("", "names 0 devices"),
        ("mpu6050 bmi270 lsm6dsox_accel", "names 3 devices"),
        ("mpu6050 iio:device0", "both names are mpu6050 (iio:device0)"),
    ] {
        let fault = fake.fault(&settings(devices, SIX, "")).to_string();
        assert!(fault.contains(cause), "{fault}");
    }
    let fault = fake.fault(&settings("mpu6050 lsm6dsox_accel", "anglvel_x", "")).to_string();
    assert!(fault.contains("lsm6dsox_accel") && fault.contains("no column is one of its channels"), "{fault}");
}

#[test]
fn settings_without_a_column_or_an_interval_are_refused() {
    let fake = Fake::with(&[MPU6050]);
    for wanted in [settings("mpu6050", "", ""), IioSettings { interval_ns: 0, ..settings("mpu6050", SIX, "") }] {
        assert_eq!(fake.fault(&wanted).kind, IioFault::Description);
    }
}
