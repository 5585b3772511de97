//! Two devices.

use std::fs::File;

use super::super::join::{Ring, join};
use super::super::{IioClock, IioFault, IioSettings};
use super::records::{LSM6DSOX_ACCEL, LSM6DSOX_GYRO};
use super::tree::{Fake, Kept, SIX, push, read, settings};

/// 104 Hz.
const INTERVAL: i64 = 9_615_385;

fn both() -> (Fake, IioSettings) {
    let fake = Fake::with(&[LSM6DSOX_ACCEL, LSM6DSOX_GYRO]);
    let wanted = settings("lsm6dsox_accel lsm6dsox_gyro", SIX, "");
    (fake, IioSettings { interval_ns: INTERVAL as u64, ..wanted })
}

fn give(driver: &mut File, number: i16, timestamp: i64) {
    let mut scan: Vec<u8> = (0..3).flat_map(|axis| (3 * number + axis).to_le_bytes()).collect();
    scan.extend([0; 2]);
    scan.extend(timestamp.to_le_bytes());
    push(driver, &scan);
}

#[test]
fn scans_are_joined_by_their_timestamps() {
    let (fake, wanted) = both();
    let mut source = fake.open(&wanted).unwrap();
    assert_eq!((source.clock(), source.descriptors().count()), (&IioClock::Monotonic, 2));
    let (mut accel, mut gyro) = (fake.driver(0), fake.driver(1));
    give(&mut accel, 0, 0);
    assert_eq!(read(&mut source, 0), []);
    give(&mut accel, 1, INTERVAL);
    give(&mut gyro, 10, 1_000_000);
    give(&mut gyro, 11, INTERVAL + 1_000_000);
    let scans = read(&mut source, 0);
    assert_eq!(scans.len(), 2);
    assert_eq!((&scans[0].values[..], scans[0].timestamp_ns), (&[0, 1, 2, 30, 31, 32][..], Some(0)));
    assert_eq!((&scans[1].values[..], scans[1].timestamp_ns), (&[3, 4, 5, 33, 34, 35][..], Some(INTERVAL)));
    assert_eq!((source.counters().scans, source.counters().unpaired), (2, 0));
    drop(source);
    assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
    assert_eq!(fake.get("iio:device1/buffer0/enable"), "0");
}

/// The gyroscopes start two scans later, lose one, and come in other chunks: what has no partner is counted.
#[test]
fn what_finds_no_partner_is_counted_whatever_the_chunks() {
    let mut all: Option<Vec<Kept>> = None;
    for (chunk_a, chunk_b) in [(1, 1), (1, 7), (7, 1), (20, 20), (3, 5)] {
        let (fake, wanted) = both();
        let mut source = fake.open(&wanted).unwrap();
        let (mut accel, mut gyro) = (fake.driver(0), fake.driver(1));
        let (mut a, mut b) = (0_i16, 2_i16);
        let mut scans = Vec::new();
        while a < 20 || b < 20 {
            for _ in 0..chunk_a {
                if a < 20 {
                    give(&mut accel, a, i64::from(a) * INTERVAL);
                    a += 1;
                }
            }
            scans.extend(read(&mut source, 0));
            for _ in 0..chunk_b {
                if b < 20 {
                    if b != 9 {
                        give(&mut gyro, b, i64::from(b) * INTERVAL + if b % 2 == 0 { 2_000_000 } else { -3_000_000 });
                    }
                    b += 1;
                }
            }
            scans.extend(read(&mut source, 0));
        }
        let firsts: Vec<i64> = scans.iter().map(|scan| scan.values[0] / 3).collect();
        assert_eq!(firsts, [2, 3, 4, 5, 6, 7, 8, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]);
        assert!(scans.iter().all(|scan| scan.values[0] == scan.values[3]));
        assert_eq!(source.counters().unpaired, 3);
        assert_eq!(all.get_or_insert_with(|| scans.clone()), &scans);
    }
}

/// One device is silent for ever: the other's scans are dropped, oldest first, and memory is what it was.
#[test]
fn a_silent_partner_costs_no_memory() {
    let (fake, wanted) = both();
    let mut source = fake.open(&wanted).unwrap();
    let (mut accel, mut gyro) = (fake.driver(0), fake.driver(1));
    for number in 0..5000 {
        give(&mut accel, number, i64::from(number) * INTERVAL);
        assert_eq!(read(&mut source, 0), []);
    }
    let lost = source.counters().unpaired;
    assert!((4000..5000).contains(&lost), "{lost}");
    give(&mut gyro, 4999, 4999 * INTERVAL);
    let scans = read(&mut source, 0);
    assert_eq!((scans.len(), scans[0].values[0]), (1, 3 * 4999));
    assert_eq!(source.counters().unpaired, 4999);
}

#[test]
fn devices_without_a_common_clock_are_refused() {
    let (fake, wanted) = both();
    fake.remove("iio:device1/buffer0/in_timestamp_en");
    let fault = fake.fault(&wanted);
    assert_eq!(fault.kind, IioFault::Description);
    assert!(fault.to_string().contains("without timestamps two devices cannot be joined"), "{fault}");

    let (mut fake, wanted) = both();
    fake.refuse("iio:device1/current_timestamp_clock", rustix::io::Errno::INVAL);
    let fault = fake.fault(&wanted).to_string();
    assert!(fault.contains("Monotonic") && fault.contains("realtime"), "{fault}");
}

#[test]
fn extreme_timestamps_do_no_harm() {
    let (mut first, mut second) = (Ring::new(2, 1), Ring::new(2, 1));
    assert!(!first.push(i64::MIN, [1].into_iter()));
    assert!(!first.push(i64::MAX, [2].into_iter()));
    assert!(!second.push(i64::MAX, [3].into_iter()));
    let mut pairs = Vec::new();
    let lonely = join(&mut first, &mut second, 0, |timestamp, a, b| pairs.push((timestamp, a[0], b[0])));
    assert_eq!((lonely, &pairs[..]), (1, &[(i64::MAX, 2, 3)][..]));
    // A ring that is full gives its oldest row away.
    let lost: Vec<bool> = (0..5).map(|number| first.push(number, [number].into_iter())).collect();
    assert_eq!(lost, [false, false, true, true, true]);
}
