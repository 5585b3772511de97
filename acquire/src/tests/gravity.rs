//! Units that cannot be: against gravity, and against what a gyroscope measures.

use super::profile;
use crate::Value;
use crate::description::Description;
use crate::gravity::UnitCheck;
use crate::iio::IioScale;
use crate::message_queue::{MessageQueue, MessageStamps};
use crate::messages::MessageSettings;
use isotherm_client::Resolution;

const INTERVAL: u64 = 10_000_000;
/// At rest, at an angle \[m/s2\].
const REST: [f64; 3] = [0.0, -4.0, 8.944];

fn messages(has_gravity: bool) -> Description {
    let settings = MessageSettings {
        imu: "imu-a".parse().unwrap(),
        serial: None,
        interval_ns: INTERVAL,
        resolution: Resolution { accelerometer: 1e-6, gyroscope: 1e-6 },
        stamps: MessageStamps::Sample,
        has_gyroscopes: true,
        has_gravity,
        temperature: Some(25.0),
        temperature_name: String::new(),
        temperature_max_age_s: None,
    };
    Description::of_messages(settings, &MessageQueue::default())
}

/// A description of lines with these keys of the accelerometers and gyroscopes.
fn lines(root: &str, accelerometer: &str, gyroscope: &str) -> Description {
    let text = format!(
        "format = 1\nimu = \"imu-a\"\n{root}\n[source]\nkind = \"lines\"\nfile = \"-\"\n[timing]\ninterval_s = 0.01\n[lines]\n\
         names = [\"ax\", \"ay\", \"az\", \"gx\", \"gy\", \"gz\"]\n[accelerometer]\ncolumns = [\"ax\", \"ay\", \"az\"]\n\
         {accelerometer}\n[gyroscope]\ncolumns = [\"gx\", \"gy\", \"gz\"]\n{gyroscope}\n[temperature]\nconstant = 25\n"
    );
    Description::from_toml(&text).unwrap()
}

/// A row of accelerations and rates, as far as the description has these columns.
fn row(description: &Description, acceleration: [f64; 3], rate: [f64; 3]) -> Vec<Value> {
    let mut row = vec![Value::ABSENT; description.columns().len()];
    let columns = description.columns;
    let gyroscope = columns.gyroscope.unwrap();
    for (axes, values) in [(columns.accelerometer, acceleration), (gyroscope, rate)] {
        axes.columns.iter().zip(values).for_each(|(place, value)| row[*place] = Value::real(value));
    }
    row
}

/// What is said within a minute of a device with these accelerations, less a shaking that has no mean.
fn said(check: UnitCheck, description: &Description, acceleration: [f64; 3]) -> Option<String> {
    let mut check = check;
    let mut all = (0..6000).filter_map(|frame: u64| {
        let shaken = match frame {
            500 => acceleration,
            _ => acceleration.map(|value| value * if frame.is_multiple_of(2) { 3.0 } else { -1.0 }),
        };
        let text = check.gravity_text(&row(description, shaken, [0.0; 3]), 7 + frame * INTERVAL, INTERVAL)?;
        assert_eq!(frame, 500, "after 5 s");
        Some(text)
    });
    let first = all.next();
    assert_eq!(all.next(), None, "it is said once");
    first
}

fn of(description: &Description, factor: f64) -> Option<String> {
    said(UnitCheck::new(description), description, REST.map(|value| value * factor))
}

const READING: &str = "kind = \"reading\"\nresolution = 1e-6";
const G: f64 = 1.0 / 9.80665;

#[test]
fn a_length_that_is_not_gravity_names_the_unit_that_would_fit() {
    let description = messages(true);
    let message = |factor| of(&description, factor);
    for factor in [0.307, 1.0, 3.06] {
        assert_eq!(message(factor), None, "{factor}");
    }
    for (factor, part) in [
        (G, "give accelerometer_unit = \"g\";"),
        (1000.0 * G, "give accelerometer_unit = \"mg\";"),
        (2048.0, "seem to be counts, of 4.884e-4 m/s2 each"),
        (0.305, "give accelerometer_unit = \"g\";"),
        (3.07, "seem to be counts"),
        (0.001, "long, and gravity is 9.8: for a source without gravity give gravity = false"),
        (0.0, "for a source without gravity give gravity = false"),
    ] {
        let text = message(factor).unwrap();
        assert!(text.contains(part), "{factor}: {text}");
    }
    assert_eq!(of(&messages(false), G), None);
}

#[test]
fn the_remedy_is_that_of_the_description() {
    let unit = format!("{READING}\nunit = \"g\"");
    let scale = "kind = \"reading\"\nresolution = 1\nscale = 0.002";
    let increment = "kind = \"increment\"\nresolution = 1e-9\nscale = 1";
    for (keys, factor, part) in [
        (READING, 1.0, ""),
        (READING, G, "give unit = \"g\" in [accelerometer]"),
        (&unit, G, ""),
        (&unit, 1.0, "give unit = \"m/s2\" in [accelerometer]"),
        (&unit, 1000.0 * G, "give unit = \"mg\" in [accelerometer]"),
        (scale, 500.0, ""),
        (scale, 5000.0, "seem to be counts, of 2.000e-4 m/s2 each"),
        (scale, G, "give scale = 9.80665 in [accelerometer]"),
        // Increments of 10 ms.
        (increment, 0.01, ""),
        (increment, 0.01 * G, "give scale = 9.80665 in [accelerometer]"),
        // Counts of which nobody says what they are.
        ("kind = \"reading\"\nresolution = 1", 5000.0, ""),
        ("kind = \"increment\"\nresolution = 1", 5000.0, ""),
    ] {
        let kind = if keys == increment || keys.starts_with("kind = \"increment") { increment } else { READING };
        let description = lines("", keys, kind);
        let text = of(&description, factor);
        assert_eq!(text.is_none(), part.is_empty(), "{keys}: {text:?}");
        assert!(text.is_none_or(|text| text.contains(part)), "{keys}");
        assert_eq!(of(&lines("gravity = false", keys, kind), factor), None);
    }
}

/// The kernel's scale counts where the description has none.
#[test]
fn scales_of_the_kernel_are_units() {
    let description = profile("icm42688");
    let scales = |one: f64, rate: f64| {
        let of = |scale| IioScale { scale, offset: 0.0, rounding: 0.0 };
        [of(one), of(one), of(one), of(rate), of(rate), of(rate)]
    };
    let check = |one, rate| UnitCheck::new(&description).with_scales(&description, &scales(one, rate));
    let counts = REST.map(|value| value / 0.000_598);
    assert_eq!(said(UnitCheck::new(&description), &description, counts), None);
    assert_eq!(said(check(0.000_598, 1e-3), &description, counts), None);
    let text = said(check(0.000_598 * G, 1e-3), &description, counts).unwrap();
    assert!(text.contains("seem to be in g: give scale = 0.000598"), "{text}");
    let fast = row(&description, counts, [0.0, 0.0, -41_000.0]);
    assert!(check(0.000_598, 1e-3).rate_text(&fast, INTERVAL).unwrap().contains("41.0 rad/s"));
    assert_eq!(check(0.000_598, 1e-5).rate_text(&fast, INTERVAL), None);
}

#[test]
fn a_rate_that_no_gyroscope_measures_is_said() {
    let rate = |description: &Description, rate: f64| {
        UnitCheck::new(description).rate_text(&row(description, REST, [0.0, rate, f64::NAN]), INTERVAL)
    };
    assert_eq!(rate(&messages(true), 40.0), None);
    assert!(rate(&messages(true), -40.1).unwrap().contains("give gyroscope_unit = \"deg/s\""));
    assert!(rate(&messages(false), 100.0).is_some());
    let degrees = lines("", READING, "kind = \"reading\"\nresolution = 1e-6\nunit = \"deg/s\"");
    assert_eq!(rate(&degrees, 2000.0), None);
    assert!(rate(&degrees, 3000.0).unwrap().contains("unit = \"deg/s\" in [gyroscope]"));
    let increments = lines(
        "",
        "kind = \"increment\"\nresolution = 1e-9\nscale = 1",
        "kind = \"increment\"\nresolution = 1e-9\nscale = 1",
    );
    assert_eq!(rate(&increments, 0.39), None);
    assert!(rate(&increments, 0.41).unwrap().contains("compare scale in [gyroscope]"));
    assert_eq!(rate(&lines("", READING, "kind = \"reading\"\nresolution = 1"), 1e6), None, "counts");
}
