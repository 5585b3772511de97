//! A consumer IMU, whose noise and whose errors are larger than what a good one feels when it is moved.

use isotherm_report as report;
use isotherm_shared::table::*;
use isotherm_shared::wire::*;
use isotherm_simulation::RandomGenerator;
use isotherm_verification::{Collector, LocalGravity, Requirement, Setup, Stability};

const ROWS: u32 = 8400;
const INTERVAL_NS: u64 = 368_000_000;
const GRAVITY: f64 = 9.80665;
/// A3 is up.
const FORCE: [f64; AXES] = [0.0, 0.0, 1.0];

/// Scale factors of 1e6 pulses in a second and g0, 100 pulses in an arc second; constant biases, and no other errors.
fn table() -> CoefficientTable {
    let sensor = |kind: &str, name: &str, bias: &str, unit: &str, k: f64| {
        let curve = |name: &str, unit: &str, c0: f64| {
            format!("{name} = {{ unit = \"{unit}\", range = [-20.0, 80.0], c0 = {c0:?} }}\n")
        };
        format!(
            "[[{kind}]]\nname = \"{name}\"\n{}{}{}",
            curve("bias", bias, 0.0),
            curve("positive_scale_factor", unit, k),
            curve("negative_scale_factor", unit, -k)
        )
    };
    let of = |names: [&str; AXES], kind, bias, unit, k| names.map(|name| sensor(kind, name, bias, unit, k)).concat();
    let text = format!(
        "format = 2\n[imu]\nid = \"consumer\"\ngravity = {GRAVITY:?}\n[temperature]\nunit = \"degC\"\nout_of_range = \"clamp\"\n{}{}",
        of(AXIS_NAMES, "axis", "ug0", "pulse/(s*g0)", 1e6),
        of(GYROSCOPE_NAMES, "gyroscope", "deg/h", "pulse/arcsec", 100.0)
    );
    CoefficientTable::from_toml(&text, None).unwrap()
}

/// 51, -17, 74 and 32 degC at a constant rate, with the part of the run from 0 to 1.
fn temperature(part: f64) -> f64 {
    let (at, legs) = (193.0 * part, [(51.0, -17.0), (-17.0, 74.0), (74.0, 40.0)]);
    let mut begin = 0.0;
    for (from, to) in legs {
        let length = f64::abs(to - from);
        if at <= begin + length {
            return from + (to - from) * (at - begin) / length;
        }
        begin += length;
    }
    32.0
}

/// Errors of the biases over the range [g0]: 1, 3.5 and 6 mg0, which are 10, 34 and 58 mm/s2.
const CONSUMER: [f64; AXES] = [1e-3, 3.5e-3, 6e-3];

/// The recording of an IMU whose biases move by `errors` over the range, with white noise of 1.5 mg0 and 0.08 deg/s in
/// a row; the gyroscopes' move by 0.3 deg/s. `moved` adds specific force [g0] and rate [deg/h] to a row.
fn recording(errors: [f64; AXES], moved: impl Fn(u32) -> ([f64; AXES], [f64; AXES])) -> Vec<RawSample> {
    let mut random = RandomGenerator::new(8, 7);
    let seconds = INTERVAL_NS as f64 / 1e9;
    let row = |index: u32| {
        let celsius = temperature(f64::from(index) / f64::from(ROWS));
        let x = (celsius - 28.5) / 45.5;
        let shape = [0.5 * x, x * x, 0.5 * (x - 0.4 * x * x * x)];
        let (force, rate) = moved(index);
        let mut raw = RawSample {
            session: 1,
            sequence: index.into(),
            timestamp_ns: u64::from(index + 1) * INTERVAL_NS,
            interval_ns: INTERVAL_NS,
            ..RawSample::default()
        };
        for (axis, shape) in shape.into_iter().enumerate() {
            let acceleration = FORCE[axis] + force[axis] + errors[axis] * shape + 1.5e-3 * random.normal();
            let turning = rate[axis] + 1080.0 * shape + 288.0 * random.normal();
            for (triad, pulses) in [
                (&mut raw.accelerometers, acceleration * 1e6 * seconds),
                (&mut raw.gyroscopes, turning * 100.0 * seconds),
            ] {
                let channel = if pulses > 0.0 { &mut triad.positive_pulses } else { &mut triad.negative_pulses };
                channel[axis] = pulses.abs().round() as u32;
                triad.head_temperature[axis] = (celsius * 16.0).round() / 16.0;
                triad.board_temperature[axis] = triad.head_temperature[axis];
            }
        }
        raw
    };
    (0..ROWS).map(row).collect()
}

fn at_rest(_: u32) -> ([f64; AXES], [f64; AXES]) {
    ([0.0; AXES], [0.0; AXES])
}

fn verified(samples: &[RawSample], attitude: Option<[f64; AXES]>, gravity: LocalGravity) -> Stability {
    let table = table();
    let mut collector = Collector::new(&table, 10.0);
    samples.iter().for_each(|raw| collector.add(raw));
    collector.finish(&Setup::new(attitude, gravity)).unwrap()
}

fn first_line(found: &Stability) -> String {
    report::text::stability(found, 10.0, false).lines().next().unwrap().to_owned()
}

#[test]
fn every_window_of_a_consumer_imu_at_rest_is_judged() {
    let run = recording(CONSUMER, at_rest);
    for (attitude, gravity) in [
        (None, LocalGravity::Unknown),
        (Some(FORCE), LocalGravity::Unknown),
        (Some(FORCE), LocalGravity::Stated(GRAVITY)),
    ] {
        let found = verified(&run, attitude, gravity);
        // 27 rows are 9.9 s.
        assert_eq!((found.windows.len(), found.windows_left_out.count()), (311, 0), "{}", found.windows_left_out);
        assert_eq!(first_line(&found), "all 311 windows are judged");
        assert_eq!((found.nothing_claimed(), found.attitude_warning()), (None, None));
        let gyroscopes = found.judged_gyroscopes().unwrap();
        assert_eq!((gyroscopes.windows_left_out.count(), gyroscopes.unjudged()), (0, None));
        // The errors count: a third of the windows was over the old limit of 5 mg0 from the median.
        let variation = found.verdict.axes[1].variation;
        assert!((2e-3..4e-3).contains(&variation.value), "{variation:?}");
        let json = report::json::verification(&found, 10.0, None);
        assert_eq!(json["windows_left_out"]["count"], 0);
        assert_eq!(json["gyroscopes"]["windows_left_out"]["words"], "all 311 windows are judged");
    }
}

/// The error that is to be verified never decides what is judged, not even along the vertical.
#[test]
fn a_bias_that_drifts_by_50_mg0_counts_against_the_table() {
    let run = recording([0.05, 0.05, 0.1], at_rest);
    let found = verified(&run, Some(FORCE), LocalGravity::Stated(GRAVITY));
    assert_eq!((found.windows_left_out.count(), found.nothing_claimed()), (0, None));
    assert!(found.verdict.axes.iter().all(|errors| errors.worst.value > 0.02), "{:?}", found.verdict.axes);
    assert!(found.verdict.length.unwrap().worst.value > 0.02);
    let judgements = "bias=10mg0,scale=1%".parse::<Requirement>().unwrap().judge(&found);
    assert!(judgements.iter().all(|it| !it.met && it.message.ends_with(": missed")), "{judgements:?}");
    // A constant error is one of the table, or of the attitude that was stated.
    let tilted = verified(&recording(CONSUMER, at_rest), Some([0.03, 0.0, 1.0]), LocalGravity::Stated(GRAVITY));
    assert_eq!(tilted.windows_left_out.count(), 0);
    let warning = tilted.attitude_warning().unwrap();
    assert!(warning.starts_with("the output is on average off the stated specific force by (-0.03"), "{warning}");
    assert!(report::text::stability(&tilted, 10.0, false).contains(&warning));
    assert_eq!(report::json::verification(&tilted, 10.0, None)["attitude_warning"], warning.as_str());
}

/// Rows of 270 are 10 windows.
#[test]
fn windows_in_motion_are_left_out_and_counted() {
    let shaken = recording(CONSUMER, |row| {
        let on = (2700..2970).contains(&row);
        ([if on { 0.3 * libm::sin(f64::from(row) * 0.4) } else { 0.0 }; AXES], [0.0; AXES])
    });
    let tilted =
        recording(CONSUMER, |row| ([if (2700..2970).contains(&row) { 0.17 } else { 0.0 }, 0.0, 0.0], [0.0; AXES]));
    let turned =
        recording(CONSUMER, |row| ([0.0; AXES], [0.0, 0.0, if (2700..2970).contains(&row) { 7200.0 } else { 0.0 }]));
    let left_out = |run: &[RawSample]| {
        let found = verified(run, None, LocalGravity::Unknown);
        let of_gyroscopes = found.judged_gyroscopes().unwrap().windows_left_out;
        (found.windows_left_out, of_gyroscopes, first_line(&found), found)
    };
    let (of, of_gyroscopes, line, found) = left_out(&shaken);
    assert!(of.count() == 10 && of.moved >= 8 && of_gyroscopes.by_accelerometers == 10, "{of} {of_gyroscopes}");
    assert!(line.starts_with("10 of 311 windows left out: in "), "{line}");
    let reason = found.unjudged().unwrap();
    assert!(
        reason.starts_with("10 of 311 windows are not at the attitude, at most 1 % may be left out: in "),
        "{reason}"
    );
    assert!(!reason.contains("under half"), "{reason}");
    // The windows after it are those of the same attitude.
    assert!(found.windows[120..].iter().all(|window| window.counts));
    let (of, _, line, found) = left_out(&tilted);
    assert_eq!((of.count(), of.elsewhere, of.moved), (10, 10, 0), "{of}");
    assert_eq!(line, "10 of 311 windows left out: in 10 the IMU was at another attitude");
    assert!(
        "factor=1e-6".parse::<Requirement>().unwrap().check(&found).unwrap_err().contains("Nothing can be claimed")
    );
    let (of, of_gyroscopes, line, found) = left_out(&turned);
    assert_eq!((of.count(), of_gyroscopes.count(), of_gyroscopes.elsewhere), (0, 10, 10));
    assert_eq!(
        line,
        "all 311 windows are judged; of the gyroscopes 10 of 311 windows left out: in 10 the rate was another, as if the IMU turned"
    );
    assert!(found.judged_gyroscopes().unwrap().unjudged().is_some() && found.nothing_claimed().is_none());
}

#[test]
fn under_half_of_the_windows_is_not_enough() {
    let found = verified(
        &recording(CONSUMER, |row| {
            ([if row > 3000 { 0.3 * libm::sin(f64::from(row) * 0.4) } else { 0.0 }; AXES], [0.0; AXES])
        }),
        Some(FORCE),
        LocalGravity::Stated(GRAVITY),
    );
    let left_out = found.windows_left_out.count();
    // A window that is shaken about the attitude, with its mean there, counts.
    assert!((180..=205).contains(&left_out), "{left_out}");
    assert!(first_line(&found).starts_with(&format!("{left_out} of 311 windows left out: ")));
    let reason = found.nothing_claimed().unwrap();
    let text = report::text::stability(&found, 10.0, false);
    assert!(text.contains(&format!("Nothing can be claimed: {reason}.\n")), "{text}");
    assert!(found.unjudged().unwrap().ends_with("; under half of the run is not enough to judge by"), "{reason}");
    // What is left is far better than required, and meets nothing.
    assert!("bias=1g0".parse::<Requirement>().unwrap().check(&found).is_err());
}

/// In hand all the time: the recording's own noise must not excuse its motion.
#[test]
fn a_recording_in_motion_is_not_judged() {
    let run = recording(CONSUMER, |row| {
        let t = f64::from(row) * 0.368;
        (
            [0.5 * libm::sin(0.7 * t), 0.4 * libm::cos(0.31 * t), 0.3 * libm::sin(1.1 * t)],
            [9e4 * libm::sin(0.5 * t); AXES],
        )
    });
    let table = table();
    let mut collector = Collector::new(&table, 10.0);
    run.iter().for_each(|raw| collector.add(raw));
    let finished = collector.finish(&Setup::new(None, LocalGravity::Unknown));
    let judged = finished.is_ok_and(|found| found.nothing_claimed().is_none());
    assert!(!judged);
}
