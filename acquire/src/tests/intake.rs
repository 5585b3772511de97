//! From rows to samples: what is missing, and what other messages leave unchanged.

use super::profile;
use crate::Value;
use crate::description::Description;
use crate::frames::FrameArrival;
use crate::intake::{Intake, RowArrival};
use crate::profiles::PROFILES;
use isotherm_client::RawSample;
use isotherm_support::failure::Exit;

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
        intake.take(&row, RowArrival::default(), &mut |raw, session| taken = Some((raw.timestamp_ns, session)));
        taken
    });
    assert_eq!(times, [Some((5_000_000, 1)), Some((10_000_000, 1)), None, Some((20_000_000, 1))]);
    assert_eq!((intake.tally.incomplete, intake.tally.missing), (1, 1));
}

/// The exit code that ends an acquisition from this source, if its device sends half the described rate.
fn refused_at_half_the_rate(source: &str) -> Option<Exit> {
    let text = PROFILES.iter().find(|(name, _)| *name == "arduino-mpu6050").unwrap().1;
    let serial = "serial = \"/dev/ttyUSB0\"\nbaud = 115200";
    assert!(text.contains(serial));
    let description = Description::from_toml(&text.replace(serial, source)).unwrap();
    let mut intake = Intake::new(&description, 0.0, false);
    (0..200).find_map(|number: u64| {
        let by_ns = 1_000_000_000 + number * 10_000_000;
        let own = [("counter", number as f64), ("micros", by_ns as f64 / 1e3), ("temperature", 25.0)];
        let row = row(&description, &[&SENSORS[..], &own].concat());
        let arrival = Some(FrameArrival { after_ns: by_ns, by_ns });
        intake.take(&row, RowArrival { arrival, ..RowArrival::default() }, &mut |_, _| {});
        Some(intake.judge().err()?.exit)
    })
}

/// Anybody may have sent it who reaches a network; what a line of this machine sends is its device's.
#[test]
fn what_contradicts_the_description_ends_a_network_source_for_now_and_a_line_for_good() {
    for (source, exit) in [
        ("serial = \"/dev/ttyUSB0\"\nbaud = 115200", Exit::Config),
        ("tcp = \"127.0.0.1:4000\"", Exit::Temporary),
        ("udp = \"127.0.0.1:4000\"\npeer = \"127.0.0.1\"", Exit::Temporary),
    ] {
        assert_eq!(refused_at_half_the_rate(source), Some(exit), "{source}");
    }
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
    let arrival = Some(FrameArrival { after_ns: by_ns, by_ns });
    let own = [("counter", (seconds * 100.0).round() % 256.0), ("status", 0.0)];
    let row = row(&with_messages(), &[numbers, &own].concat());
    let mut taken = None;
    let mut sink = |raw: RawSample, session| taken = Some((session, raw.sequence));
    intake.take(&row, RowArrival { arrival, ..RowArrival::default() }, &mut sink);
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

/// A device whose own clock has just begun is taken to be soaked, unless the clock may have turned.
#[test]
fn a_device_that_was_just_powered_is_soaked() {
    let soaked = |name: &str, from: &str, to: &str, numbers: [(&str, f64); 3]| {
        let text = PROFILES.iter().find(|(of, _)| *of == name).unwrap().1;
        assert!(text.contains(from), "{from}");
        let description = Description::from_toml(&text.replace(from, to)).unwrap();
        let mut intake = Intake::new(&description, 0.0, false);
        let row = row(&description, &[&SENSORS[..], &numbers].concat());
        assert!(super::take(&mut intake, &row).is_some(), "{name}");
        (intake.soaked.session, intake.soaked.until_ns)
    };
    let vn100 = |seconds: f64| [("time", seconds * 1e9), ("temperature", 25.0), ("delta_time", 0.0025)];
    assert_eq!(soaked("vn100", "imu", "imu", vn100(9.9)), (1, 19_900_000_000));
    assert_eq!(soaked("vn100", "imu", "imu", vn100(10.1)), (0, 0));
    // A clock of 32 bits in microseconds turns after 71 minutes.
    let arduino = |counter: f64| [("counter", counter), ("micros", 5000.0 * counter), ("temperature", 25.0)];
    let clock = "time = { column = \"micros\", unit = \"us\", bits = 32 }\n";
    assert_eq!(soaked("arduino-mpu6050", "imu", "imu", arduino(1.0)), (0, 0));
    // Its counter of 16 bits after 5 minutes, one of 32 bits after 248 days.
    assert_eq!(soaked("arduino-mpu6050", clock, "", arduino(1.0)), (0, 0));
    let wide = "counter = { column = \"counter\", bits = 32 }\n";
    let narrow = "counter = { column = \"counter\", bits = 16 }\n";
    let both = format!("{narrow}{clock}");
    assert_eq!(soaked("arduino-mpu6050", &both, wide, arduino(1999.0)).0, 1);
    assert_eq!(soaked("arduino-mpu6050", &both, wide, arduino(2001.0)), (0, 0));
    // What never changes has no lag.
    let constant = ("columns = \"temperature\"", "constant = 25.0");
    assert_eq!(soaked("vn100", constant.0, constant.1, vn100(100.0)), (1, u64::MAX));
}

/// The bit of a channel blanks that channel, one without a channel its triad, and one of a description without axes
/// all.
#[test]
fn a_status_of_one_axis_blanks_that_axis() {
    let unhealthy = |description: &Description, status: &[(&str, f64)]| {
        let mut intake = Intake::new(description, 0.0, false);
        let mut all = SENSORS.to_vec();
        let columns = description.columns();
        all.extend(columns.iter().filter(|name| name.starts_with("temperature")).map(|name| (&**name, 25.0)));
        all.extend([("counter", 2.0), ("sequence", 1.0), ("latency", 0.0)]);
        all.retain(|(name, _)| !status.iter().any(|(of, _)| of == name));
        all.extend(status);
        let (raw, _) = super::take(&mut intake, &row(description, &all)).unwrap();
        let heads = [raw.accelerometers.head_temperature, raw.gyroscopes.head_temperature].concat();
        let boards = [raw.accelerometers.board_temperature, raw.gyroscopes.board_temperature].concat();
        let names = ["A1", "A2", "A3", "G1", "G2", "G3"];
        assert!(heads.iter().zip(&boards).all(|(head, board)| head.is_nan() == board.is_nan()));
        let nan = names.into_iter().zip(heads).filter(|(_, head)| head.is_nan()).map(|(name, _)| name);
        (nan.collect::<Vec<_>>().join(" "), intake.tally.unhealthy)
    };
    let stim = |of: &str, status: [f64; 4]| {
        let names = ["status", "status_a", "status_tg", "status_ta"];
        unhealthy(&profile(of), &names.into_iter().zip(status).collect::<Vec<_>>())
    };
    for name in ["stim300", "stim300-rate"] {
        assert_eq!(stim(name, [0.0; 4]), (String::new(), 0));
        // An overload of the gyroscope X; an error of two accelerometers, and of a temperature of the gyroscope Z.
        assert_eq!(stim(name, [17.0, 0.0, 0.0, 0.0]), ("G1".to_owned(), 1));
        assert_eq!(stim(name, [0.0, 14.0, 12.0, 0.0]), ("A2 A3 G3".to_owned(), 1));
        // The start-up names no channel.
        assert_eq!(stim(name, [64.0, 0.0, 0.0, 0.0]), ("G1 G2 G3".to_owned(), 1));
        assert_eq!(stim(name, [64.0, 64.0, 0.0, 0.0]), ("A1 A2 A3 G1 G2 G3".to_owned(), 1));
    }
    // A bit for each sensor that is valid.
    let kvh = |status: f64| unhealthy(&profile("kvh1750"), &[("status", status)]);
    assert_eq!(kvh(119.0), (String::new(), 0));
    assert_eq!(kvh(87.0), ("A2".to_owned(), 1));
    assert_eq!(kvh(0.0), ("A1 A2 A3 G1 G2 G3".to_owned(), 1));
    let text = PROFILES.iter().find(|(of, _)| *of == "kvh1750").unwrap().1;
    let begin = text.find("[[status.axes]]").unwrap();
    let end = begin + text[begin..].find("[frame]").unwrap();
    let before = Description::from_toml(&[&text[..begin], &text[end..]].concat()).unwrap();
    assert_eq!(unhealthy(&before, &[("status", 87.0)]), ("A1 A2 A3 G1 G2 G3".to_owned(), 1));
    for (from, to, fault) in [
        (
            "columns = \"status\"\nsensors",
            "columns = \"sequence\"\nsensors",
            "has a column that columns of [status] lacks",
        ),
        ("bits = [0x01,", "bits = [0x80,", "has bits that mask lacks"),
        ("bits = [0x01, ", "bits = [", "has 5, and sensors 6"),
        ("sensors = [\"gx\"", "sensors = [\"status\"", "none of [accelerometer] and [gyroscope]"),
        ("sensors = [\"gx\"", "sensor = 1\nsensors = [\"gx\"", "unknown key"),
    ] {
        assert!(text.contains(from), "{from}");
        let faults = Description::from_toml(&text.replacen(from, to, 1)).err().unwrap().to_string();
        assert!(faults.contains(fault), "{faults}");
    }
}
