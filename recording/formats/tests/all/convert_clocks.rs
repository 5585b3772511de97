//! Bags whose temperatures have stamps of another clock than the rows, and honest bags, which must not be taken for
//! such.

use crate::convert_ros::{BEGIN, Bag, imu};
use crate::joined::Random;
use isotherm_recording_formats::convert::{Conversion, Settings, TimeSource};
use isotherm_recording_formats::ros::ImuMessage;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::io::Cursor;
use std::path::Path;

/// \[ns\]
const SECOND: f64 = 1e9;
/// What the findings about stamps of temperatures say.
const BY_RECORDING: &str = "warning [stamps]: ";
const APART: &str = "warning [clocks-apart]: ";
const ONE: &str = "warning [one-temperature]: ";

/// What a clock shows at a time \[ns\].
type Clock = fn(f64) -> f64;

/// An IMU and a thermometer that are recorded. Times are true ones after [`BEGIN`] \[ns\].
#[derive(Clone, Copy)]
struct Drive {
    hertz: f64,
    seconds: f64,
    /// Distance of the temperatures, and when the first and the last one is taken \[s\].
    every_s: f64,
    thermometer: [f64; 2],
    imu_clock: Clock,
    temperature_clock: Clock,
    /// When what is ready at a time is recorded.
    recorder: Clock,
    /// Jitter of the stamps as a part of the interval, rows of a burst, and the most that recording is late \[s\].
    jitter: f64,
    burst: u64,
    late_s: f64,
}

/// A message before it is written: when it is recorded, whether it is a temperature, its stamp, and its number.
#[derive(Clone, Copy)]
struct Recorded {
    log_ns: u64,
    is_temperature: bool,
    stamp_ns: u64,
    number: u64,
}

const fn same(time_ns: f64) -> f64 {
    time_ns
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            hertz: 50.0,
            seconds: 40.0,
            every_s: 1.0,
            thermometer: [0.013, 1e9],
            imu_clock: same,
            temperature_clock: same,
            recorder: same,
            jitter: 0.0,
            burst: 1,
            late_s: 0.0,
        }
    }
}

/// The temperature with this number.
fn celsius(number: u64) -> f64 {
    20.0 + number as f64 / 64.0
}

impl Drive {
    /// The messages in the order in which they are recorded.
    fn messages(self, seed: u64) -> Vec<Recorded> {
        let mut random = Random(seed);
        let step = SECOND / self.hertz;
        let absolute = |time_ns: f64| BEGIN.wrapping_add_signed(time_ns as i64);
        let mut all = Vec::new();
        for number in 0..(self.seconds * self.hertz) as u64 {
            let due = (number / self.burst * self.burst + self.burst) as f64 * step;
            let stamp = due + self.jitter * step * random.uniform().abs();
            all.push((stamp + 2e5, false, (self.imu_clock)(stamp), number));
        }
        let [first, last] = self.thermometer.map(|second| second.min(self.seconds) * SECOND);
        for number in 0..((last - first) / SECOND / self.every_s).max(0.0) as u64 + 1 {
            let due = first + number as f64 * self.every_s * SECOND;
            all.push((due + 1e5, true, (self.temperature_clock)(due), number));
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut last, mut block, mut late) = (f64::NEG_INFINITY, 0, 0.0);
        let of = |(ready, is_temperature, stamp, number): (f64, bool, f64, u64)| {
            // The disk is slow for tenths of a second.
            if (ready / 1e8) as u64 != block {
                (block, late) = ((ready / 1e8) as u64, self.late_s * SECOND * random.uniform().abs());
            }
            last = (self.recorder)(ready + late).max(last);
            Recorded { log_ns: absolute(last), is_temperature, stamp_ns: absolute(stamp), number }
        };
        all.into_iter().map(of).collect()
    }
}

/// The bag of messages.
fn bag(messages: &[Recorded]) -> Bag {
    let mut bag = Bag::new();
    for message in messages {
        let Recorded { log_ns, stamp_ns, number, .. } = *message;
        if message.is_temperature {
            bag.temperature_at(log_ns, "/t", stamp_ns, celsius(number));
        } else {
            bag.imu_at(log_ns, "/imu", &ImuMessage { stamp_ns, ..imu(number) });
        }
    }
    bag
}

/// The temperature of each row: the last one up to it by the stamps, or by the times of recording.
fn expected(messages: &[Recorded], time_ns: fn(&Recorded) -> u64) -> Vec<f64> {
    let mut temperatures: Vec<_> = messages.iter().filter(|message| message.is_temperature).collect();
    temperatures.sort_by_key(|message| time_ns(message));
    let of = |row: &Recorded| {
        let passed = temperatures.partition_point(|temperature| time_ns(temperature) <= time_ns(row));
        celsius(temperatures[passed.saturating_sub(1)].number)
    };
    messages.iter().filter(|message| !message.is_temperature).map(of).collect()
}

fn temperatures(samples: &[RawSample]) -> Vec<f64> {
    samples.iter().map(|sample| sample.accelerometers.head_temperature[0]).collect()
}

/// Temperatures of the rows, and what is reported of the topic `/t`.
fn converted(messages: &[Recorded], settings: &Settings) -> Result<(Vec<f64>, Vec<String>), Failure> {
    let (samples, told) = bag(messages).convert(settings)?;
    let words = ["/t", "recorded before it", ONE];
    let is_of_clocks = |line: &String| line.starts_with("warning") && words.iter().any(|word| line.contains(word));
    Ok((temperatures(&samples), told.into_iter().filter(is_of_clocks).collect()))
}

fn by_stamp(messages: &[Recorded]) -> Vec<f64> {
    expected(messages, |message| message.stamp_ns)
}

fn by_recording(messages: &[Recorded]) -> Vec<f64> {
    expected(messages, |message| message.log_ns)
}

/// Honest bags of many kinds have the temperatures of their stamps, and nothing is said of these.
#[test]
fn honest_bags_are_joined_by_their_stamps_without_a_word() {
    let mut random = Random(3);
    let mut any = |low: f64, high: f64| low * libm::pow(high / low, 0.5 + 0.5 * random.uniform());
    for case in 0..120 {
        let hertz = any(50.0, 1000.0);
        let seconds = any(2.0, 3000.0 / hertz.min(200.0)).min(6000.0 / hertz);
        let every_s = any(0.1, 10.0);
        // A fifth of the bags is cut in its middle, and a fifth has temperatures in a part of its time.
        let begin_s = if case % 5 == 1 { any(0.01, 0.5) * seconds } else { any(0.001, 1.0) };
        let end_s = if case % 5 == 2 { begin_s + any(0.3, 1.0) * seconds } else { 1e9 };
        let drive = Drive {
            hertz,
            seconds,
            every_s,
            thermometer: [begin_s.min(seconds), end_s],
            jitter: [0.0, 0.02, 0.4][case % 3],
            burst: [1, 1, 8][case % 3],
            late_s: [0.0, 0.1, 0.5][case / 3 % 3],
            ..Drive::default()
        };
        let mut messages = drive.messages(case as u64);
        if case % 5 == 3 {
            let third = messages.len() / 3;
            messages.drain(third..third + messages.len() / 4);
        }
        if !messages.iter().any(|message| message.is_temperature) {
            continue;
        }
        let (rows, told) = converted(&messages, &Settings::default()).unwrap();
        assert!(told.is_empty(), "{case}: {hertz} Hz, {every_s} s: {told:?}");
        assert!(rows == by_stamp(&messages), "{case}: {hertz} Hz, {every_s} s");
    }
}

/// Stamps of another clock, by which every row would have one temperature, are of no use; the order of recording is.
#[test]
fn where_stamps_are_of_no_use_the_order_of_recording_decides() {
    let zero: Clock = |_| -(BEGIN as f64);
    let ahead: Clock = |time| time + 3600.0 * SECOND;
    let boot: Clock = |time| time + 12.0 * SECOND - BEGIN as f64;
    let reset: Clock = |time| {
        let since = if time < 20.0 * SECOND { time + 5.0 * SECOND } else { time - 18.0 * SECOND };
        since - BEGIN as f64
    };
    // A driver that has no time during the first half.
    let late: Clock = |time| if time < 20.0 * SECOND { -(BEGIN as f64) } else { time };
    let normal = Drive::default();
    let fallen = [late, reset].map(|temperature_clock| Drive { temperature_clock, ..normal });
    let both = Drive { imu_clock: reset, temperature_clock: reset, ..normal };
    let zeros = Drive { temperature_clock: zero, ..normal };
    let others = [ahead, boot, reset].map(|imu_clock| Drive { imu_clock, ..normal });
    for (case, drive) in fallen.into_iter().chain([both, zeros]).chain(others).enumerate() {
        let messages = drive.messages(7);
        let (rows, told) = converted(&messages, &Settings::default()).unwrap();
        assert!(rows == by_recording(&messages), "{case}");
        let is_told = told.len() == 1 && told[0].starts_with(BY_RECORDING);
        assert!(is_told && (told[0].contains("0.0 % of") || told[0].contains("do not rise")), "{case}: {told:?}");
        // Where the times of recording are asked for, the stamps are not looked at.
        let settings = Settings { time: TimeSource::Log, ..Settings::default() };
        assert_eq!(converted(&messages, &settings).unwrap(), (by_recording(&messages), Vec::new()), "{case}");
        // Without them, nothing shows which temperature a row has.
        let unknown: Vec<_> = messages.iter().map(|message| Recorded { log_ns: 5, ..*message }).collect();
        let failure = converted(&unknown, &Settings::default()).unwrap_err();
        assert!(failure.exit == Exit::Data && failure.message.contains("do not rise either"), "{case}: {failure}");
        let given = Settings { temperature: Some(30.0), ..Settings::default() };
        assert_eq!(converted(&unknown, &given).unwrap(), (vec![30.0; 2000], Vec::new()), "{case}");
    }
}

/// Clocks that are apart by less than the recording are named; the stamps decide all the same.
#[test]
fn clocks_that_are_apart_are_named_with_their_difference() {
    let clocks: [(Clock, &str); 4] = [
        (|time| time + 20.0 * SECOND, "20.0"),
        (|time| time - 20.0 * SECOND, "20.0"),
        (|time| time + 2.3 * SECOND, "2.3"),
        (|time| time - 2.3 * SECOND, "2.3"),
    ];
    let slow = Drive { hertz: 20.0, seconds: 240.0, late_s: 0.1, ..Drive::default() };
    for (number, (clock, size)) in clocks.into_iter().enumerate() {
        for (side, drive) in [
            (number % 2, Drive { imu_clock: clock, ..slow }),
            (1 - number % 2, Drive { temperature_clock: clock, ..slow }),
        ] {
            let messages = drive.messages(1);
            let (rows, told) = converted(&messages, &Settings::default()).unwrap();
            let is_named = told.len() == 1 && told[0].starts_with(APART) && told[0].contains(size);
            assert!(is_named && told[0].contains(["ahead of", "behind"][side]), "{number}: {told:?}");
            assert!(rows == by_stamp(&messages));
        }
    }
    // By up to two distances between temperatures, or by a second, nothing is known.
    let within: [Drive; 2] = [
        Drive { imu_clock: |time| time + 15.0 * SECOND, every_s: 8.0, ..slow },
        Drive { imu_clock: |time| time - 0.8 * SECOND, every_s: 0.1, ..slow },
    ];
    for drive in within {
        assert_eq!(converted(&drive.messages(1), &Settings::default()).unwrap().1, Vec::<String>::new());
    }
}

/// What looks like clocks that are apart at first sight, and is none.
#[test]
fn thermometers_and_recorders_of_many_kinds_are_not_taken_for_other_clocks() {
    let drive = Drive { hertz: 20.0, seconds: 240.0, ..Drive::default() };
    // A thermometer that begins late or ends early; one that shows a single temperature.
    for (thermometer, every_s, is_told) in [
        ([150.0, 1e9], 1.0, false),
        ([0.1, 60.0], 1.0, false),
        ([0.1, 12.0], 1.0, true),
        ([230.0, 1e9], 1.0, true),
        ([100.0, 100.5], 1.0, false),
    ] {
        let messages = Drive { thermometer, every_s, ..drive }.messages(2);
        let (rows, told) = converted(&messages, &Settings::default()).unwrap();
        let is_right = |line: &String| line.starts_with(BY_RECORDING);
        let told: Vec<_> = told.into_iter().filter(|line| !line.starts_with(ONE)).collect();
        assert!(told.len() == usize::from(is_told) && told.iter().all(is_right), "{thermometer:?}: {told:?}");
        assert!(rows == if is_told { by_recording(&messages) } else { by_stamp(&messages) }, "{thermometer:?}");
    }
    // A bag that was played twice as fast, or at a tenth, and recorded again; its temperatures begin late.
    let recorders: [Clock; 2] = [|time| 3600.0 * SECOND + time / 2.0, |time| 3600.0 * SECOND + 10.0 * time];
    for recorder in recorders {
        let messages = Drive { recorder, thermometer: [150.0, 1e9], ..drive }.messages(3);
        assert_eq!(converted(&messages, &Settings::default()).unwrap(), (by_stamp(&messages), Vec::new()));
    }
    // Temperatures that are published with every row, stamped when they were read: every 30 s.
    let read: Clock = |time| (time / (30.0 * SECOND)).floor() * 30.0 * SECOND;
    let messages = Drive { temperature_clock: read, every_s: 0.05, ..drive }.messages(4);
    assert_eq!(converted(&messages, &Settings::default()).unwrap(), (by_stamp(&messages), Vec::new()));
}

/// Accelerometers and gyroscopes with a topic each: the temperature is that of the accelerometers.
#[test]
fn two_topics_have_the_temperatures_in_the_order_of_recording() {
    let messages = Drive { temperature_clock: |_| -(BEGIN as f64), ..Drive::default() }.messages(5);
    let mut bag = Bag::new();
    for Recorded { log_ns, is_temperature, stamp_ns, number } in messages.iter().copied() {
        if is_temperature {
            bag.temperature_at(log_ns, "/t", stamp_ns, celsius(number));
            continue;
        }
        let row = ImuMessage { stamp_ns, ..imu(number) };
        bag.imu_at(log_ns, "/accel", &ImuMessage { angular_velocity: Some([0.0; 3]), ..row.clone() });
        bag.imu_at(log_ns, "/gyro", &ImuMessage { linear_acceleration: Some([0.0; 3]), ..row });
    }
    let (samples, told) = bag.convert(&Settings::default()).unwrap();
    assert!(temperatures(&samples) == by_recording(&messages));
    assert!(told.iter().any(|line| line.starts_with(BY_RECORDING) && line.contains("/t")), "{told:?}");
}

/// One measured temperature in all rows of more than a minute is reported, of a text as of a bag.
#[test]
fn one_temperature_for_all_rows_of_more_than_a_minute_is_reported() {
    let mapping = |temperature: &str| {
        format!(
            "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"x\", \"y\", \"z\"]\n\
             kind = \"reading\"\nresolution = 1e-3\n[temperature]\n{temperature}\n"
        )
    };
    let text = |rows: u64, celsius: fn(u64) -> f64| {
        let row = |row: u64| format!("{:.1},{},2,9,{}\n", row as f64 / 10.0, row % 7, celsius(row));
        "t,x,y,z,c\n".to_owned() + &(0..rows).map(row).collect::<String>()
    };
    let told = |text: String, temperature: &str| {
        let mapping = mapping(temperature);
        let named = Some((Path::new("m.toml"), mapping.as_str()));
        let mut conversion =
            Conversion::of_text(Path::new("run.csv"), Cursor::new(text), named, &Settings::default()).unwrap();
        assert!(conversion.by_ref().all(|row| row.is_ok()));
        conversion.findings().iter().any(|finding| finding.name == "one-temperature")
    };
    let (column, constant) = ("columns = \"c\"", "constant = 23.5");
    assert!(told(text(610, |_| 23.5), column));
    assert!(!told(text(600, |_| 23.5), column), "a minute");
    assert!(!told(text(610, |row| if row < 600 { 23.5 } else { 23.6 }), column));
    assert!(!told(text(610, |_| 23.5), constant), "given");
    let slow = Drive { hertz: 10.0, seconds: 61.0, thermometer: [0.1, 0.5], ..Drive::default() };
    let one = |drive: Drive, settings: &Settings| {
        let told = bag(&drive.messages(1)).convert(settings).unwrap().1;
        told.iter().any(|line| line.starts_with(ONE))
    };
    assert!(one(slow, &Settings::default()));
    assert!(!one(slow, &Settings { temperature: Some(20.0), ..Settings::default() }), "given");
    assert!(!one(Drive { seconds: 59.0, ..slow }, &Settings::default()), "short");
}
