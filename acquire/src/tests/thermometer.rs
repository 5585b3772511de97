//! Thermometers that die, pause, are slow, or never come.

use crate::Value;
use crate::description::Description;
use crate::frames::FrameArrival;
use crate::intake::{Intake, RowArrival};
use crate::message_queue::{MessageQueue, MessageStamps};
use crate::messages::MessageSettings;
use crate::thermometer::Thermometer;
use isotherm_client::{RawSample, Resolution};

const SECOND: u64 = 1_000_000_000;
/// 10 Hz.
const INTERVAL: u64 = SECOND / 10;
const BEGIN: u64 = 1_000 * SECOND;
const TOPIC: &str = "/driver/imu/temperature";

fn description(temperature: Option<f64>, temperature_max_age_s: Option<f64>) -> Description {
    let settings = MessageSettings {
        imu: "imu-a".parse().unwrap(),
        serial: None,
        interval_ns: INTERVAL,
        resolution: Resolution::default(),
        stamps: MessageStamps::Sample,
        has_gyroscopes: true,
        has_gravity: true,
        temperature,
        temperature_name: TOPIC.to_owned(),
        temperature_max_age_s,
    };
    Description::of_messages(settings, &MessageQueue::default())
}

/// A device that sends ten frames a second.
struct Source {
    intake: Intake,
    /// Frames so far.
    frames: u64,
    /// What its clock shows with the first one \[ns\].
    begin_ns: u64,
}

impl Source {
    fn new(temperature: Option<f64>, max_age_s: Option<f64>) -> Self {
        let intake = Intake::new(&description(temperature, max_age_s), 0.0, true);
        Self { intake, frames: 0, begin_ns: BEGIN }
    }

    /// The sample of the next frame.
    fn frame(&mut self, temperature: Option<f64>) -> Option<RawSample> {
        let stamp_ns = self.begin_ns + self.frames * INTERVAL;
        self.frames += 1;
        let values = [0.0, 0.0, 9.8, 0.0, 0.0, 0.0].map(Value::real);
        let row: Vec<_> = values.into_iter().chain(temperature.map(Value::real)).collect();
        let arrival = Some(FrameArrival { after_ns: stamp_ns, by_ns: stamp_ns });
        let mut taken = None;
        let mut sink = |raw: RawSample, _| taken = Some(raw);
        self.intake.take(&row, RowArrival { arrival, stamp: Some(stamp_ns), ..RowArrival::default() }, &mut sink);
        self.intake.settle(&mut sink);
        taken
    }

    /// So many seconds with a temperature every so many frames; 0: none. Returns how many samples are marked.
    fn run(&mut self, seconds: u64, every: u64) -> u64 {
        let is_marked = |number: u64| {
            let temperature = (every != 0 && number.is_multiple_of(every)).then_some(25.0);
            self.frame(temperature).is_some_and(|raw| raw.is_marked_stale())
        };
        (0..seconds * SECOND / INTERVAL).map(is_marked).map(u64::from).sum()
    }
}

#[test]
fn a_temperature_that_stops_is_marked_after_five_pauses_and_samples_go_on() {
    // Its pace in frames, and after how many frames it is stale: five times the pace, and 5 s at least.
    for (every, limit) in [(1, 50), (5, 50), (10, 50), (20, 100), (100, 500)] {
        let mut source = Source::new(None, None);
        assert_eq!(source.run(100, every), 0, "{every}");
        let last = source.frames - every;
        let dead: Vec<_> = (0..1000).map(|_| source.frame(None).unwrap()).collect();
        for raw in &dead {
            let age = (raw.timestamp_ns - BEGIN) / INTERVAL - last;
            assert_eq!(raw.temperature_time_ns(), BEGIN + last * INTERVAL, "{every}");
            assert_eq!(raw.is_marked_stale(), age > limit, "{every}: {age}");
            assert_eq!(raw.accelerometers.head_temperature, [25.0; 3]);
        }
        assert!(!source.frame(Some(25.0)).unwrap().is_marked_stale(), "it has come again, with the same value");
        assert_eq!(source.intake.tally.stale, dead.iter().filter(|raw| raw.is_marked_stale()).count() as u64);
    }
}

#[test]
fn what_is_no_number_is_no_reading() {
    let mut source = Source::new(None, None);
    assert_eq!(source.run(10, 1), 0);
    let marked = (0..100).filter(|_| source.frame(Some(f64::NAN)).unwrap().is_marked_stale()).count();
    assert_eq!(marked, 50);
}

/// Until three distances are known a minute is allowed.
#[test]
fn a_slow_thermometer_is_not_marked_once_it_has_shown_its_pace() {
    let mut source = Source::new(None, None);
    // The first three pauses of 61 s are a second too long each.
    assert_eq!((0..3).map(|_| source.run(61, 610)).collect::<Vec<_>>(), [9; 3]);
    assert_eq!((0..30).map(|_| source.run(61, 610)).sum::<u64>(), 0);
    assert_eq!(source.run(400, 0), 4000 - 3050 + 609);
    // One that was fast and slows down is given the minute no more.
    let mut source = Source::new(None, None);
    assert_eq!(source.run(1, 1), 0);
    assert!(source.run(60, 600) > 500);
    // A long pause counts until 20 shorter ones have followed.
    let mut source = Source::new(None, None);
    assert_eq!((source.run(60, 100), source.run(20, 10)), (0, 0));
    assert_eq!(source.run(49, 0), 0, "one of 20 pauses is still of 10 s");
    assert_eq!((source.run(25, 10), source.run(6, 0)), (0, 10 + 9));
}

#[test]
fn the_key_is_the_limit() {
    let mut source = Source::new(None, Some(0.5));
    assert_eq!(source.run(10, 5), 0);
    assert_eq!(source.run(2, 10), 4 + 4, "0.6 s to 0.9 s after each reading");
    let mut source = Source::new(None, Some(60.5));
    assert_eq!((0..10).map(|_| source.run(60, 600)).sum::<u64>(), 0);
    let mut source = Source::new(None, Some(f64::INFINITY));
    assert_eq!((source.run(1, 10), source.run(10_000, 0)), (0, 0));
    // A temperature that is always the same has no age.
    let mut source = Source::new(Some(25.0), None);
    assert_eq!(source.run(1000, 0), 0);
    assert_eq!(source.frame(None).unwrap().telemetry_ns, 0);
}

#[test]
fn a_device_that_was_away_keeps_the_pace_and_a_new_clock_does_not_make_an_old_temperature_new() {
    let mut source = Source::new(None, None);
    assert_eq!((source.run(100, 100), source.run(30, 0)), (0, 0));
    source.intake.outage(&mut |_, _| {});
    source.frames += 10_000;
    assert_eq!(source.frame(None), None, "its temperature is forgotten");
    assert!(!source.frame(Some(25.0)).unwrap().is_marked_stale());
    assert_eq!((source.run(49, 0), source.run(10, 0)), (0, 90), "50 s, as before");
    // The device starts again, and its clock with it: a new session.
    source.begin_ns = 5 * SECOND;
    source.frames = 0;
    assert_eq!(source.run(60, 0), 600);
    assert_eq!(source.intake.tally.sessions, 2);
    assert_eq!(source.run(20, 100), 0);
    // Not stale before: the age is counted from the first sample of the session.
    (source.begin_ns, source.frames) = (SECOND, 0);
    assert_eq!((source.run(50, 0), source.run(1, 0)), (0, 9));
}

/// Each sensor of a STIM300 has a thermometer.
#[test]
fn one_of_several_thermometers_is_enough() {
    let description = super::profile("stim300");
    let names = description.columns();
    let mut thermometer = Thermometer::new(&description);
    let mut at = |second: u64, dead: &str| {
        let of = |name: &String| if name == dead { Value::ABSENT } else { Value::real(25.0) };
        let row: Vec<_> = names.iter().map(of).collect();
        thermometer.take(&row, BEGIN + second * SECOND);
        thermometer.judge(BEGIN + second * SECOND).1
    };
    assert_eq!((0..10).find_map(|second| at(second, "")), None);
    let text = (10..20).find_map(|second| at(second, "temperature_gy")).unwrap();
    assert!(text.contains("temperature_gy is 6.0 s old, and it is stale after 5.0 s"), "{text}");
    assert!(text.contains("temperature_max_age_s"), "{text}");
}

/// At once, then once a minute, and at the end; one that comes and goes is not said more often.
#[test]
fn a_stale_temperature_is_said_once_a_minute() {
    let mut thermometer = Thermometer::new(&description(None, Some(2.0)));
    let row = [0.0; 7].map(Value::real);
    let mut said = |seconds: core::ops::Range<u64>, comes: &dyn Fn(u64) -> bool| {
        let mut all = Vec::new();
        for second in seconds {
            if comes(second) {
                thermometer.take(&row, BEGIN + second * SECOND);
            }
            all.extend(thermometer.judge(BEGIN + second * SECOND).1.map(|text| (second, text)));
        }
        all
    };
    assert_eq!(said(0..10, &|_| true), []);
    let dead = said(10..200, &|_| false);
    assert_eq!(dead.iter().map(|(second, _)| *second).collect::<Vec<_>>(), [12, 72, 132, 192]);
    assert!(dead[1].1.contains("is 63.0 s old, and it is stale after 2.0 s"), "{dead:?}");
    let back = said(200..250, &|_| true);
    assert!(back.len() == 1 && back[0].0 == 200 && back[0].1.contains("has come again"), "{back:?}");
    // Every fourth second: each minute a beginning and its end.
    let flickers = said(252..852, &|second| second.is_multiple_of(4));
    assert_eq!(flickers.len(), 20, "{flickers:?}");
}

#[test]
fn a_temperature_that_never_comes_is_named_every_ten_seconds() {
    let mut thermometer = Thermometer::new(&description(None, None));
    let told: Vec<_> =
        (0..350).filter_map(|frame| Some((frame, thermometer.waiting_text(BEGIN + frame * INTERVAL)?))).collect();
    assert_eq!(told.iter().map(|(frame, _)| *frame).collect::<Vec<_>>(), [100, 200, 300]);
    assert!(told[1].1.contains(&format!("no temperature of {TOPIC} has come for 20 s")), "{told:?}");
    // Lines without names have numbers.
    let text = "format = 1\nimu = \"imu-a\"\n[source]\nkind = \"lines\"\nfile = \"-\"\n[timing]\ninterval_s = 0.1\n[lines]\n\
                [accelerometer]\ncolumns = [2, 3, 4]\nkind = \"reading\"\nresolution = 1\n[temperature]\ncolumns = 7\n\
                temperature_max_age_s = 3\n";
    let mut thermometer = Thermometer::new(&Description::from_toml(text).unwrap());
    thermometer.waiting_text(BEGIN);
    assert!(thermometer.waiting_text(BEGIN + 11 * SECOND).unwrap().contains("column 7 has come for 11 s"));
    let faulty = text.replace("columns = 7", "constant = 25");
    let faults = Description::from_toml(&faulty).err().unwrap().to_string();
    assert!(faults.contains("temperature.temperature_max_age_s: is there without columns"), "{faults}");
}

/// A temperature that is polled so seldom is not stale between two polls, from the beginning.
#[test]
fn a_poll_is_a_pace() {
    let text = crate::profiles::PROFILES.iter().find(|(name, _)| *name == "bmi270").unwrap().1;
    let of =
        |poll: &str| Description::from_toml(&text.replacen("poll_s = 1.0", &format!("poll_s = {poll}"), 1)).unwrap();
    for (poll, seconds) in [("1", 60), ("30", 150), ("3600", 18_000)] {
        let description = of(poll);
        let mut thermometer = Thermometer::new(&description);
        let row: Vec<_> = description.columns().iter().map(|_| Value::real(25.0)).collect();
        thermometer.take(&row, BEGIN);
        assert!(!thermometer.judge(BEGIN + seconds * SECOND).0, "{poll}");
        assert!(thermometer.judge(BEGIN + seconds * SECOND + 1).0, "{poll}");
    }
}
