//! Temperatures.

use super::super::IioFault;
use super::records::{ADIS16505, BMI270, LSM6DSOX_ACCEL, LSM6DSOX_GYRO};
use super::tree::{Fake, SIX, push, read, settings};

const SECOND: u64 = 1_000_000_000;

fn scan_of(numbers: [i16; 6], timestamp: i64) -> Vec<u8> {
    let mut scan: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    scan.extend([0; 4]);
    scan.extend(timestamp.to_le_bytes());
    scan
}

#[test]
fn a_temperature_outside_the_scan_is_polled_when_it_is_due() {
    let fake = Fake::with(&[BMI270]);
    let mut source = fake.open(&settings("bmi270", SIX, "temp")).unwrap();
    let mut driver = fake.driver(0);
    let mut at = |now_ns: u64| {
        push(&mut driver, &scan_of([1, 2, 3, 4, 5, 6], 7));
        let scans = read(&mut source, now_ns);
        assert_eq!((scans.len(), &scans[0].values[..]), (1, &[1, 2, 3, 4, 5, 6][..]));
        (scans[0].temperatures[0], scans[0].polled_ns)
    };
    // (1024 + 11776) * 1.953125 = 25 000 milli-degC, at once.
    assert_eq!(at(5 * SECOND), (25.0, Some(5 * SECOND)));
    fake.set("iio:device0/in_temp_raw", "1536");
    assert_eq!(at(6 * SECOND - 1), (25.0, Some(5 * SECOND)));
    assert_eq!(at(6 * SECOND), (26.0, Some(6 * SECOND)));
    // One that cannot be read stays, with its time, and is counted.
    fake.set("iio:device0/in_temp_raw", "busy");
    assert_eq!(at(8 * SECOND), (26.0, Some(6 * SECOND)));
    fake.set("iio:device0/in_temp_raw", "-1024");
    assert_eq!(at(9 * SECOND), (21.0, Some(9 * SECOND)));
    assert_eq!(source.counters().failed_polls, 1);
}

#[test]
fn an_input_is_milli_degrees_as_it_is() {
    let fake = Fake::with(&[LSM6DSOX_ACCEL, "name: tmp117\nin_temp_input: -7812.500000\nin_temp_scale: 7.8125"]);
    let mut wanted = settings("lsm6dsox", "accel_x", "tmp117/temp");
    wanted.interval_ns = SECOND / 104;
    let mut source = fake.open(&wanted).unwrap();
    push(&mut fake.driver(0), &[0; 16]);
    assert_eq!(read(&mut source, 0)[0].temperatures, [-7.8125]);
}

#[test]
fn a_device_without_a_temperature_is_told_where_there_are_some() {
    let fake = Fake::with(&[LSM6DSOX_ACCEL, LSM6DSOX_GYRO, "name: tmp117\nin_temp_raw: 3200\nin_temp_scale: 7.8125"]);
    let fault = fake.fault(&settings("lsm6dsox_accel", "accel_x", "temp"));
    assert_eq!(fault.kind, IioFault::Description);
    let text = fault.to_string();
    assert!(text.contains("temperatures are tmp117/temp") && text.contains("constant"), "{text}");
}

#[test]
fn several_temperatures_keep_their_order() {
    let fake = Fake::with(&[ADIS16505, BMI270]);
    let mut source = fake.open(&settings("adis16505", "accel_x", "bmi270/temp temp0")).unwrap();
    let mut scan = 5_i32.to_be_bytes().to_vec();
    scan.extend(305_i16.to_be_bytes());
    scan.extend([0; 2]);
    scan.extend(9_i64.to_le_bytes());
    push(&mut fake.driver(0), &scan);
    let scans = read(&mut source, 1);
    assert_eq!((&scans[0].temperatures[..], scans[0].polled_ns), (&[25.0, 30.5][..], Some(1)));
}

#[test]
fn a_temperature_that_cannot_be_read_is_found_at_the_start() {
    let fake = Fake::with(&[BMI270]);
    fake.set("iio:device0/in_temp_raw", "");
    let fault = fake.fault(&settings("bmi270", SIX, "temp")).to_string();
    assert!(fault.contains("reading the temperature temp"), "{fault}");
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
}

/// Many drivers let an attribute be read only while the buffer is off.
#[test]
fn a_driver_that_is_busy_while_it_scans_is_told_with_the_remedy() {
    let fake = Fake::with(&[BMI270]);
    let all = super::super::device::devices(&fake.tree);
    let polled = super::super::temperature::PolledTemperature::open(&all[0], "temp").unwrap();
    let fault = polled.failed(&rustix::io::Errno::BUSY.into());
    assert_eq!(fault.kind, IioFault::Description);
    assert!(fault.to_string().contains("while its buffer runs") && fault.to_string().contains("constant"), "{fault}");
}

/// As the two devices of an ICM-42688: each has the chip's temperature in its scan.
#[test]
fn of_two_devices_with_a_temperature_the_first_gives_it() {
    let with_temperature = |record: &str, raw: i16| {
        let record = record.replace("in_timestamp_index: 3", "in_timestamp_index: 4");
        let more = "buffer0/in_temp_en: 0\nbuffer0/in_temp_index: 3\nbuffer0/in_temp_type: le:s16/16>>0";
        format!("{record}\n{more}\nin_temp_offset: 3312\nin_temp_scale: 7.548309\nin_temp_raw: {raw}")
    };
    let fake = Fake::with(&[&with_temperature(LSM6DSOX_ACCEL, 1), &with_temperature(LSM6DSOX_GYRO, 2)]);
    let mut wanted = settings("lsm6dsox_accel lsm6dsox_gyro", SIX, "temp");
    wanted.interval_ns = SECOND / 104;
    let mut source = fake.open(&wanted).unwrap();
    assert_eq!(fake.get("iio:device0/buffer0/in_temp_en"), "1");
    assert_eq!(fake.get("iio:device1/buffer0/in_temp_en"), "0");
    let scan = |numbers: [i16; 4]| {
        let mut scan: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        scan.extend(5_i64.to_le_bytes());
        scan
    };
    push(&mut fake.driver(0), &scan([1, 2, 3, -64]));
    push(&mut fake.driver(1), &scan([4, 5, 6, 0]));
    let scans = read(&mut source, 0);
    assert_eq!(scans[0].values, [1, 2, 3, 4, 5, 6]);
    // (-64 + 3312) * 7.548309 milli-degC.
    assert!((scans[0].temperatures[0] - 24.516_907_632).abs() < 1e-9, "{:?}", scans[0]);
}
