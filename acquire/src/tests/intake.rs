//! From rows to samples: what is missing, and what other messages leave alone.

use super::profile;
use crate::Value;
use crate::description::Description;
use crate::frames::Arrival;
use crate::intake::{Came, Intake};
use crate::profiles::PROFILES;
use isotherm_client::RawSample;

/// A row with these numbers, by the names of its columns; others are not there.
fn row(description: &Description, numbers: &[(&str, f64)]) -> Vec<Value> {
    let value = |name: &String| {
        let number = numbers.iter().find(|(of, _)| of == name).map(|(_, number)| *number);
        number.map_or(Value::ABSENT, |number| Value { number, whole: Some((number as i64).cast_unsigned()) })
    };
    description.columns().iter().map(value).collect()
}

const SENSORS: [(&str, f64); 6] = [("ax", 0.0), ("ay", 0.0), ("az", 9.8), ("gx", 0.0), ("gy", 0.0), ("gz", 0.0)];

/// A clock below 0 is none, not one of centuries.
#[test]
fn a_negative_time_is_no_time() {
    let description = profile("arduino-mpu6050");
    let mut intake = Intake::new(&description, 0.0, false);
    let times = [5000.0, 10_000.0, -5.0, 20_000.0].map(|micros: f64| {
        let own = [("counter", (micros / 5000.0).max(0.0)), ("micros", micros), ("temperature", 25.0)];
        let row = row(&description, &[&SENSORS[..], &own].concat());
        let mut taken = None;
        intake.take(&row, Came::default(), &mut |raw, session| taken = Some((raw.timestamp_ns, session)));
        taken
    });
    assert_eq!(times, [Some((5_000_000, 1)), Some((10_000_000, 1)), None, Some((20_000_000, 1))]);
    assert_eq!((intake.tally.incomplete, intake.tally.missing), (1, 1));
}

/// A device with a counter of 8 bits, whose frames may be messages without the sensors.
fn with_messages() -> Description {
    let text = PROFILES.iter().find(|(name, _)| *name == "mtdata2").unwrap().1;
    let text =
        text.replace("time = { column = \"time\", unit = \"us\" }", "counter = { column = \"counter\", bits = 8 }");
    Description::from_toml(&text).unwrap()
}

/// A frame of a device that sends 100 Hz, and was on for this time \[s\].
fn take(intake: &mut Intake, seconds: f64, numbers: &[(&str, f64)]) -> Option<(u64, u64)> {
    let by_ns = 1_000_000_000 + (seconds * 1e9) as u64;
    let arrival = Some(Arrival { after_ns: by_ns, by_ns });
    let own = [("counter", (seconds * 100.0).round() % 256.0), ("status", 0.0)];
    let row = row(&with_messages(), &[numbers, &own].concat());
    let mut taken = None;
    let mut sink = |raw: RawSample, session| taken = Some((session, raw.sequence));
    intake.take(&row, Came { arrival, ..Came::default() }, &mut sink);
    intake.settle(&mut sink);
    taken
}

#[test]
fn a_period_before_the_first_sample_of_a_session_is_not_missing_and_a_later_one_is() {
    let mut intake = Intake::new(&with_messages(), 0.0, false);
    assert_eq!(take(&mut intake, 0.01, &SENSORS), None, "before the first temperature");
    assert_eq!((intake.tally.without_temperature, intake.tally.missing), (1, 0));
    assert_eq!(take(&mut intake, 0.015, &[("temperature", 30.0)]), None);
    assert_eq!(take(&mut intake, 0.02, &SENSORS), Some((1, 1)));
    // Away for two periods, and the temperature is forgotten.
    intake.outage(&mut |_, _| {});
    assert_eq!(take(&mut intake, 0.05, &SENSORS), None);
    assert_eq!((intake.tally.without_temperature, intake.tally.missing), (2, 3));
}

#[test]
fn another_message_does_not_hide_that_the_device_was_away() {
    let mut intake = Intake::new(&with_messages(), 0.0, false);
    take(&mut intake, 0.01, &[("temperature", 30.0)]);
    assert_eq!(take(&mut intake, 0.02, &SENSORS), Some((1, 0)));
    intake.outage(&mut |_, _| {});
    assert_eq!(take(&mut intake, 9.01, &[("temperature", 31.0)]), None);
    assert_eq!(take(&mut intake, 9.02, &SENSORS), Some((2, 0)), "away for over a turn of the counter");
    assert_eq!((intake.tally.others, intake.tally.outages), (2, 1));
}
