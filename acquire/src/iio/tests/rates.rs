//! Sampling frequencies.

use rustix::io::Errno;

use super::super::{IioFault, IioSettings};
use super::records::{ADIS16505, BMI270, LSM6DSOX_ACCEL, MPU6050};
use super::tree::{Fake, SIX, settings};

fn at(devices: &str, columns: &str, hz: f64) -> IioSettings {
    IioSettings { interval_ns: (1e9 / hz).round() as u64, ..settings(devices, columns, "") }
}

#[test]
fn the_nearest_rate_that_there_is_is_written_as_the_list_has_it() {
    let fake = Fake::with(&[MPU6050]);
    let _source = fake.open(&at("mpu6050", SIX, 199.0)).unwrap();
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "200");
    let fake = Fake::with(&[LSM6DSOX_ACCEL]);
    let _source = fake.open(&at("lsm6dsox", "accel_x", 104.0)).unwrap();
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "104.000");
}

#[test]
fn a_rate_that_there_is_not_is_refused_with_those_that_are() {
    let fake = Fake::with(&[LSM6DSOX_ACCEL]);
    let fault = fake.fault(&at("lsm6dsox", "accel_x", 100.0));
    assert_eq!(fault.kind, IioFault::Description);
    let text = fault.to_string();
    for part in ["the nearest rate is 104 Hz", "12.500 26.000 52.000 104.000", "timing.interval_s = 0.009615"] {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "26.000");
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
}

#[test]
fn accelerometers_and_gyroscopes_may_have_rates_of_their_own() {
    let fake = Fake::with(&[BMI270]);
    let _source = fake.open(&at("bmi270", SIX, 400.0)).unwrap();
    assert_eq!(fake.get("iio:device0/in_accel_sampling_frequency"), "400.000000");
    assert_eq!(fake.get("iio:device0/in_anglvel_sampling_frequency"), "400.000000");
    // Only what is wanted is set.
    let fake = Fake::with(&[BMI270]);
    let _source = fake.open(&at("bmi270", "accel_x", 50.0)).unwrap();
    assert_eq!(fake.get("iio:device0/in_accel_sampling_frequency"), "50.000000");
    assert_eq!(fake.get("iio:device0/in_anglvel_sampling_frequency"), "200.000000");
}

/// A driver without a list takes any rate and rounds it, as the ADIS16505's divides 2000 Hz by a whole number.
#[test]
fn what_the_driver_makes_of_a_rate_is_read_back() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.kernel(|path, value| match path.ends_with("sampling_frequency") {
        true => Ok(format!("{:.6}", 2000.0 / (2000.0 / value.parse::<f64>().unwrap()).round())),
        false => Ok(value.to_owned()),
    });
    let _source = fake.open(&at("adis16505", SIX, 400.5)).unwrap();
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "400.000000");
    let fault = fake.fault(&at("adis16505", SIX, 800.0));
    assert_eq!(fault.kind, IioFault::Description);
    let text = fault.to_string();
    assert!(text.contains("to 800 Hz") && text.contains("takes 666.666667 Hz") && text.contains("0.0015"), "{text}");
}

#[test]
fn a_rate_that_the_driver_refuses_is_named() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.refuse("iio:device0/sampling_frequency", Errno::INVAL);
    let fault = fake.fault(&at("adis16505", SIX, 3000.0));
    assert!(fault.to_string().contains("setting sampling_frequency to 3000 Hz"), "{fault}");
    assert!(fault.to_string().contains("the driver refuses it"), "{fault}");
    // A rate that is set already is not written.
    assert!(fake.open(&at("adis16505", SIX, 2000.0)).is_ok());
}

#[test]
fn a_range_takes_what_lies_in_it() {
    let fake = Fake::with(&[ADIS16505]);
    fake.set("iio:device0/sampling_frequency_available", "[1 1 2000]");
    let _source = fake.open(&at("adis16505", SIX, 125.0)).unwrap();
    assert_eq!(fake.get("iio:device0/sampling_frequency"), "125");
    let fault = fake.fault(&at("adis16505", SIX, 4000.0)).to_string();
    assert!(fault.contains("the nearest rate is 2000 Hz; there are [1 1 2000]"), "{fault}");
}

#[test]
fn a_device_without_a_rate_has_one() {
    let fake = Fake::with(&[ADIS16505]);
    fake.remove("iio:device0/sampling_frequency");
    assert!(fake.open(&at("adis16505", SIX, 77.0)).is_ok());
}
