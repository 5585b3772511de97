//! Scans of one device.

use super::super::{IioClock, IioFault};
use super::records::{ADIS16505, ADIS16505_SCANS, MPU6050, bytes};
use super::tree::{Fake, Kept, SIX, push, read, settings};

const DELTAS: &str = "deltavelocity_x deltavelocity_y deltavelocity_z";

/// The kernel's own example, byte for byte.
#[test]
fn recorded_scans_of_an_adis16505_are_what_the_kernel_documents() {
    let fake = Fake::with(&[ADIS16505]);
    fake.remove("iio:device0/buffer0/in_timestamp_en");
    let mut source = fake.open(&settings("adis16505", DELTAS, "temp0")).unwrap();
    push(&mut fake.driver(0), &bytes(ADIS16505_SCANS));
    let scans = read(&mut source, 0);
    assert_eq!(scans.len(), 13);
    let first =
        Kept { values: vec![-273, 18367, 210_261], temperatures: vec![28.7], timestamp_ns: None, polled_ns: None };
    assert_eq!(scans[0], first);
    assert_eq!(scans[12].values, [-463, 18090, 210_935]);
    assert_eq!((source.clock(), source.counters().scans), (&IioClock::None, 13));
    assert_eq!(source.scales()[0].scale, 0.000_000_046);
}

#[test]
fn any_chunks_give_the_same_scans() {
    let fake = Fake::with(&[ADIS16505]);
    fake.remove("iio:device0/buffer0/in_timestamp_en");
    let bytes = bytes(ADIS16505_SCANS);
    let mut all: Option<Vec<Kept>> = None;
    for chunk in (1..=40).chain([bytes.len()]) {
        let mut source = fake.open(&settings("adis16505", DELTAS, "temp0")).unwrap();
        let mut driver = fake.driver(0);
        let scans: Vec<Kept> = bytes
            .chunks(chunk)
            .flat_map(|chunk| {
                push(&mut driver, chunk);
                read(&mut source, 0)
            })
            .collect();
        assert_eq!(scans.len(), 13);
        assert_eq!(all.get_or_insert_with(|| scans.clone()), &scans, "chunks of {chunk} bytes");
    }
}

/// Seven channels of 2 bytes, two bytes of padding, a timestamp; `scan_elements` as before Linux 5.11.
#[test]
fn an_mpu6050_gives_columns_in_the_order_that_is_wanted() {
    let fake = Fake::with(&[MPU6050]);
    let mut wanted = settings("mpu6050", "anglvel_z accel_x accel_y accel_z anglvel_x anglvel_y", "temp");
    wanted.trigger = Some("mpu6050-dev0".to_owned());
    fake.folder("trigger0", "name: mpu6050-dev0");
    let mut source = fake.open(&wanted).unwrap();
    let mut scan = Vec::new();
    for number in [220_i16, -887, 16384, -3920, 5, -6, 7] {
        scan.extend(number.to_be_bytes());
    }
    scan.extend([0xaa, 0xaa]);
    scan.extend(1_622_000_000_123_456_789_i64.to_le_bytes());
    push(&mut fake.driver(0), &scan);
    let scans = read(&mut source, 0);
    assert_eq!(scans.len(), 1);
    assert_eq!(scans[0].values, [7, 220, -887, 16384, 5, -6]);
    assert_eq!(scans[0].timestamp_ns, Some(1_622_000_000_123_456_789));
    // (-3920 + 12420) * 2.941176 milli-degC.
    assert!((scans[0].temperatures[0] - 24.999_996).abs() < 1e-9, "{:?}", scans[0]);
    assert_eq!(source.scales()[1].scale, 0.000_598);
}

#[test]
fn channels_that_nobody_wants_are_off() {
    let fake = Fake::with(&[ADIS16505]);
    fake.set("iio:device0/buffer0/in_deltavelocity_x_en", "1");
    let _source = fake.open(&settings("adis16505", SIX, "temp0")).unwrap();
    for (channel, state) in [("deltavelocity_x", "0"), ("accel_x", "1"), ("temp0", "1"), ("timestamp", "1")] {
        assert_eq!(fake.get(&format!("iio:device0/buffer0/in_{channel}_en")), state, "{channel}");
    }
}

/// A long silence, then all at once; a call takes a bounded part, and nothing is lost.
#[test]
fn what_has_piled_up_is_read_in_parts() {
    let fake = Fake::with(&[ADIS16505]);
    let mut source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    let mut driver = fake.driver(0);
    let mut bytes = Vec::new();
    for number in 0..2000_i32 {
        (0..6).for_each(|axis| bytes.extend((6 * number + axis).to_be_bytes()));
        bytes.extend((i64::from(number) * 10_000_000).to_le_bytes());
    }
    // A pipe holds 64 KiB, as many as 2048 scans of 32 bytes.
    push(&mut driver, &bytes);
    let mut scans = Vec::new();
    while scans.len() < 2000 {
        let part = read(&mut source, 0);
        assert!(!part.is_empty() && part.len() <= 2048);
        scans.extend(part);
    }
    for (number, scan) in (0..).zip(&scans) {
        let first = 6 * number;
        // The scan has the gyroscopes first.
        assert_eq!(scan.values, [first + 3, first + 4, first + 5, first, first + 1, first + 2]);
        assert_eq!(scan.timestamp_ns, Some(number * 10_000_000));
    }
}

#[test]
fn nothing_there_is_no_error_and_an_end_is() {
    let fake = Fake::with(&[ADIS16505]);
    let mut source = fake.open(&settings("adis16505", SIX, "")).unwrap();
    assert_eq!(read(&mut source, 0), []);
    let mut driver = fake.driver(0);
    assert_eq!(read(&mut source, 0), []);
    push(&mut driver, &[0; 33]);
    assert_eq!(read(&mut source, 0).len(), 1);
    drop(driver);
    let fault = source.read(0, &mut |_| panic!("no scan is whole")).unwrap_err();
    assert_eq!(fault.kind, IioFault::Gone, "{fault}");
    assert!(fault.to_string().contains("adis16505-2 (iio:device0)"), "{fault}");
}
