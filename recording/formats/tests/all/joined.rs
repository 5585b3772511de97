//! Accelerometers and gyroscopes of two topics or two files, joined by time.

use crate::convert_ros::{BEGIN, Bag, imu};
use crate::foreign::{Files, foreign};
use isotherm_files::{source, sources};
use isotherm_recording::Progress;
use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_recording_formats::read::{ImuChoice, Recording, RowKind};
use isotherm_recording_formats::ros::ImuMessage;
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_support::failure::{Exit, Failure};
use std::path::{Path, PathBuf};

const ACCEL: &str = "/camera/accel/sample";
const GYRO: &str = "/camera/gyro/sample";
const G: f64 = 9.806_65;

/// Numbers that look random.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// From -1 to 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1_u64 << 30) as f64 - 1.0
    }

    /// Normal, with a standard deviation of 1.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).fold(0.0, |sum, _| sum + self.uniform()) / 2.0
    }
}

/// A stream of readings at a rate \[Hz\]: mean and standard deviation, jitter as a part of the interval, and the time
/// of the first one \[intervals\].
#[derive(Clone, Copy)]
struct Readings {
    hertz: f64,
    mean: f64,
    deviation: f64,
    jitter: f64,
    begin: f64,
}

impl Readings {
    const fn new(hertz: f64, mean: f64, deviation: f64) -> Self {
        Self { hertz, mean, deviation, jitter: 0.0, begin: 0.0 }
    }

    /// Times \[ns\] and values, for some seconds.
    fn values(self, seconds: f64, random: &mut Random) -> Vec<(u64, f64)> {
        let at = |row: f64| BEGIN + ((row + 1.0) * 1e9 / self.hertz).round() as u64;
        let rows = 0..(seconds * self.hertz) as u64;
        rows.map(|row| {
            let time = at(row as f64 + self.begin + self.jitter * random.uniform());
            (time, self.mean + self.deviation * random.normal())
        })
        .collect()
    }
}

/// A bag as a camera with an IMU publishes it: a topic each, and zeros for what is in the other one.
fn bag(accelerometers: &[(u64, f64)], gyroscopes: &[(u64, f64)], absent: Option<[f64; 3]>) -> Vec<u8> {
    let mut bag = Bag::new();
    for (stamp_ns, value) in accelerometers {
        let linear_acceleration = Some([*value, -0.123_4, 0.3]);
        bag.imu(ACCEL, &ImuMessage { stamp_ns: *stamp_ns, linear_acceleration, angular_velocity: absent, ..imu(0) });
    }
    for (stamp_ns, value) in gyroscopes {
        let angular_velocity = Some([*value, 0.001_7, -0.002_3]);
        bag.imu(GYRO, &ImuMessage { stamp_ns: *stamp_ns, linear_acceleration: absent, angular_velocity, ..imu(0) });
    }
    bag.bytes()
}

fn converted(path: &Path, settings: &Settings) -> Result<(Vec<RawSample>, Conversion), Failure> {
    let mut conversion = Conversion::open(&source(path), None, settings)?;
    let rows = (&mut conversion).collect::<Result<_, _>>()?;
    Ok((rows, conversion))
}

fn told(conversion: &Conversion) -> String {
    let findings = conversion.findings().into_iter().map(|finding| finding.to_string());
    findings.chain(conversion.notes()).collect::<Vec<_>>().join("\n")
}

/// The values of the first axis, as they come back.
fn values(rows: &[RawSample], triad: impl Fn(&RawSample) -> &Triad) -> Vec<f64> {
    let value = |triad: &Triad| (f64::from(triad.positive_pulses[0]) - f64::from(triad.negative_pulses[0])) * 1e-6;
    rows.iter().map(|row| value(triad(row))).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The noise density by the Allan deviation of blocks of so many values.
fn density(values: &[f64], interval_s: f64, block: usize) -> f64 {
    let means: Vec<_> = values.chunks_exact(block).map(mean).collect();
    let squares: f64 = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    (squares / (2.0 * (means.len() - 1) as f64) * interval_s * block as f64).sqrt()
}

#[test]
fn noise_densities_and_biases_are_those_of_each_topic() {
    for (hertz, jitter, begin) in [
        ([100.0, 200.0], [0.0, 0.0], 0.0),
        ([100.0, 200.0], [0.03, 0.03], 0.5),
        ([63.0, 200.0], [0.02, 0.05], 0.2),
        ([250.0, 200.0], [0.04, 0.0], 0.1),
        ([400.0, 200.0], [0.0, 0.04], 0.0),
        ([200.0, 200.0], [0.08, 0.08], 0.5),
    ] {
        let files = Files::new();
        let mut random = Random(7);
        let a = Readings { jitter: jitter[0], ..Readings::new(hertz[0], G, 0.017_3) };
        let g = Readings { jitter: jitter[1], begin, ..Readings::new(hertz[1], 0.012_345_6, 0.001_7) };
        let (of_a, of_g) = (a.values(150.0, &mut random), g.values(150.0, &mut random));
        let (rows, conversion) =
            converted(&files.write("a.mcap", bag(&of_a, &of_g, Some([0.0; 3]))), &Settings::default()).unwrap();
        let slower = hertz[0].min(hertz[1]);
        assert!((conversion.interval_ns() as f64 * slower / 1e9 - 1.0).abs() < 1e-4, "{hertz:?}");
        let given = of_a.len().min(of_g.len());
        assert!(rows.len() <= given && given - rows.len() < 3, "{hertz:?}: {} of {given}", rows.len());
        assert!(rows.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1), "{hertz:?}");
        let joined = [values(&rows, |row| &row.accelerometers), values(&rows, |row| &row.gyroscopes)];
        for (joined, (stream, own)) in joined.iter().zip([(a, &of_a), (g, &of_g)]) {
            let own: Vec<_> = own.iter().map(|(_, value)| *value).collect();
            let error = stream.deviation / (own.len() as f64).sqrt();
            assert!((mean(joined) - mean(&own)).abs() < 0.2 * error + 1e-9, "{hertz:?}: {}", mean(joined));
            let truth = stream.deviation / stream.hertz.sqrt();
            for block in [1, 2, 5, 20] {
                let found = density(joined, 1.0 / slower, block) / truth;
                let limit = 0.008 + 2.5 * (block as f64 / joined.len() as f64).sqrt();
                assert!((found - 1.0).abs() < limit, "{hertz:?}, {block}: {found}");
            }
        }
        assert!(told(&conversion).contains(&format!("of {ACCEL} and the ")) || hertz[0] > hertz[1]);
    }
}

#[test]
fn at_one_rate_each_reading_is_in_one_row_whatever_the_offset_and_the_jitter() {
    for begin in [0.0, 0.1, 0.25, 0.49, 0.5, 0.51, 0.75, 0.99, 3.5] {
        let files = Files::new();
        let mut random = Random(11);
        let stream = |mean, begin| Readings { jitter: 0.08, begin, ..Readings::new(100.0, mean, 0.01) };
        let of_a = stream(G, 0.0).values(40.0, &mut random);
        let of_g = stream(0.1, begin).values(40.0, &mut random);
        let path = files.write("a.mcap", bag(&of_a, &of_g, None));
        let (rows, conversion) = converted(&path, &Settings::default()).unwrap();
        // Each row has a reading as it is, and the next row the next one.
        let found = values(&rows, |row| &row.gyroscopes);
        let pulses: Vec<_> = of_g.iter().map(|(_, value)| (value * 1e6).round()).collect();
        let first = pulses.iter().position(|value| (value - found[0] * 1e6).abs() < 0.1).unwrap();
        let same = found.iter().zip(&pulses[first..]).filter(|(found, own)| (*found * 1e6 - **own).abs() < 0.1).count();
        assert!(same == rows.len() && rows.len() >= 3995, "{begin}: {same} of {}", rows.len());
        let told = told(&conversion);
        assert!(told.contains("with 1.000 readings of the gyroscopes a row"), "{told}");
    }
}

#[test]
fn clocks_that_run_apart_lose_no_reading_and_slip_seldom() {
    let files = Files::new();
    let mut random = Random(5);
    let of_a = Readings { jitter: 0.05, ..Readings::new(100.0, G, 0.01) }.values(200.0, &mut random);
    let of_g = Readings { jitter: 0.05, ..Readings::new(100.02, 0.1, 0.01) }.values(200.0, &mut random);
    let path = files.write("a.mcap", bag(&of_a, &of_g, Some([0.0; 3])));
    let (rows, conversion) = converted(&path, &Settings::default()).unwrap();
    let joined = values(&rows, |row| &row.gyroscopes);
    let own: Vec<_> = of_g.iter().map(|(_, value)| *value).collect();
    assert!((mean(&joined) - mean(&own)).abs() < 2e-5 && rows.len() >= 19_997);
    let pulses: std::collections::HashSet<_> = own.iter().map(|value| (value * 1e6).round() as i64).collect();
    let as_it_is = joined.iter().filter(|value| pulses.contains(&((*value * 1e6).round() as i64))).count();
    assert!(as_it_is > 19_950, "{as_it_is}: {}", told(&conversion));
}

#[test]
fn a_hole_of_the_gyroscopes_is_a_gap_and_a_single_lost_reading_is_none() {
    let files = Files::new();
    let mut random = Random(3);
    let of_a = Readings::new(100.0, G, 0.01).values(30.0, &mut random);
    let mut of_g = Readings::new(100.0, 0.1, 0.01).values(30.0, &mut random);
    // A hole of a second, and three single readings.
    of_g.drain(1000..1100);
    for row in [2500, 2000, 500] {
        of_g.remove(row);
    }
    let (rows, conversion) = converted(&files.write("a.mcap", bag(&of_a, &of_g, None)), &Settings::default()).unwrap();
    assert_eq!(rows.len(), 2900);
    let gaps: Vec<_> = rows.windows(2).filter(|pair| pair[1].sequence != pair[0].sequence + 1).collect();
    assert!(gaps.len() == 1 && gaps[0][1].sequence - gaps[0][0].sequence == 101, "{gaps:?}");
    let told = told(&conversion);
    assert!(told.contains("3 rows of the accelerometers have no reading of the gyroscopes next to them"), "{told}");
    assert!(told.contains("100 rows of the accelerometers have no reading of the gyroscopes, nor do"), "{told}");
    assert!(told.contains("100 rows missing by the time"), "{told}");
    // Where the rows have the hole, the readings in it are left out.
    let (rows, conversion) = converted(&files.write("b.mcap", bag(&of_g, &of_a, None)), &Settings::default()).unwrap();
    assert_eq!(rows.len(), of_g.len());
    assert!(self::told(&conversion).contains("readings of the gyroscopes lie in gaps of the accelerometers"));
}

#[test]
fn topics_are_joined_where_two_have_one_kind_each_or_are_named() {
    let files = Files::new();
    let mut random = Random(9);
    let of_a = Readings::new(100.0, G, 0.01).values(2.0, &mut random);
    let of_g = Readings::new(200.0, 0.1, 0.01).values(2.0, &mut random);
    let both = files.write("a.mcap", bag(&of_a, &of_g, Some([0.0; 3])));
    let named = |topic: Option<&str>, gyroscope_topic: Option<&str>| Settings {
        topic: topic.map(str::to_owned),
        gyroscope_topic: gyroscope_topic.map(str::to_owned),
        ..Settings::default()
    };
    let (rows, _) = converted(&both, &Settings::default()).unwrap();
    assert_eq!(converted(&both, &named(Some(ACCEL), Some(&GYRO[1..]))).unwrap().0, rows);
    assert_eq!(converted(&both, &named(None, Some(GYRO))).unwrap().0, rows);
    // A single topic is read as it was.
    let (alone, _) = converted(&both, &named(Some(ACCEL), None)).unwrap();
    assert!(alone.len() == 200 && alone[0].gyroscopes.positive_pulses == [0; 3] && !alone[0].gyroscopes.is_absent());
    // Three topics are a choice, which the message names.
    let mut bag = Bag::new();
    for row in 0..50 {
        bag.imu("/imu", &imu(row)).imu(ACCEL, &ImuMessage { angular_velocity: None, ..imu(row) });
        bag.imu(GYRO, &ImuMessage { linear_acceleration: None, ..imu(row) });
    }
    let three = files.write("b.mcap", bag.bytes());
    let refused = |settings: &Settings| converted(&three, settings).map(drop).unwrap_err();
    let failure = refused(&Settings::default());
    assert!(failure.exit == Exit::Data && failure.message.contains("with --topic and --gyroscope-topic"), "{failure}");
    assert!(refused(&named(Some(ACCEL), Some("/none"))).message.contains("no topic /none"));
    let (rows, conversion) = converted(&three, &named(Some(ACCEL), Some(GYRO))).unwrap();
    assert_eq!((rows.len(), rows[7].gyroscopes.positive_pulses), (50, [500_000, 0, 7]));
    assert!(conversion.layout().gyroscopes);
}

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"x\", \"y\", \"z\"]\n\
     kind = \"reading\"\nresolution = 1e-6\nunit = \"g\"\n[gyroscope]\ncolumns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n\
     resolution = 1e-5\nunit = \"deg/s\"\nrange = 500\n[temperature]\ncolumns = \"T\"\n";

/// Texts of accelerometers in g and of gyroscopes in deg/s, at 50 and 100 Hz.
fn texts(files: &Files) -> [PathBuf; 2] {
    let mut random = Random(21);
    let (mut acc, mut gyr) = ("t,x,y,z,T\n".to_owned(), "t,x,y,z\n".to_owned());
    for row in 0..400 {
        let time = 5.0 + f64::from(row) * 0.02;
        acc += &format!("{time:.3},{:.6},0.1,-0.7,{:.2}\n", 0.7 + 1e-3 * random.normal(), 20.0 + f64::from(row) * 0.01);
    }
    for row in 0..800 {
        gyr += &format!("{:.4},{:.5},1.1,-0.3\n", 5.0013 + f64::from(row) * 0.01, -2.3 + 0.01 * random.normal());
    }
    [files.write("Accelerometer.csv", acc), files.write("Gyroscope.csv", gyr)]
}

fn read(paths: &[PathBuf], mapping: &str, settings: Settings) -> Result<(Vec<RawSample>, Recording), Failure> {
    read_with(paths, Some(mapping), settings)
}

fn read_with(
    paths: &[PathBuf],
    mapping: Option<&str>,
    settings: Settings,
) -> Result<(Vec<RawSample>, Recording), Failure> {
    let foreign = isotherm_recording_formats::convert::Foreign { settings, ..foreign(mapping) };
    let mut recording = Recording::open_hashed(
        &sources(paths).unwrap(),
        RowKind::Sample,
        (ImuChoice::Any, foreign),
        &Progress::default(),
    )?;
    let rows: Result<Vec<_>, _> = recording.by_ref().map(|row| row.map(|row| row.sample)).collect();
    match rows {
        Ok(rows) => Ok((rows, recording)),
        Err(error) => Err(recording.failure(&error)),
    }
}

#[test]
fn two_texts_are_joined_with_the_option_and_by_their_names() {
    let files = Files::new();
    let [acc, gyr] = texts(&files);
    let given = || Settings { gyroscope_file: Some(source(&gyr)), ..Settings::default() };
    let (rows, recording) = read(std::slice::from_ref(&acc), MAPPING, given()).unwrap();
    assert_eq!((rows.len(), rows[0].timestamp_ns, rows[0].interval_ns), (400, 5_000_000_000, 20_000_000));
    assert_eq!(rows[100].accelerometers.negative_pulses[2], 700_000);
    assert_eq!((rows[100].gyroscopes.positive_pulses[1], rows[100].gyroscopes.negative_pulses[2]), (110_000, 30_000));
    assert!((rows[100].gyroscopes.head_temperature[0] - 21.0).abs() < 1e-9);
    let found = recording.nominal(&ImuId::new("imu-a").unwrap()).unwrap();
    assert!(found.has_gyroscopes && (found.resolution.accelerometer / (1e-6 * 9.806_65) - 1.0).abs() < 1e-12);
    assert!((found.resolution.gyroscope / 1e-5f64.to_radians() - 1.0).abs() < 1e-12);
    assert!(
        found.max_specific_force.is_none() && (found.max_angular_rate.unwrap() - 500f64.to_radians()).abs() < 1e-12
    );
    let sha256 = recording.sha256().unwrap();
    for paths in [[gyr.clone(), acc.clone()], [acc.clone(), gyr.clone()]] {
        let (by_name, recording) = read(&paths, MAPPING, Settings::default()).unwrap();
        assert_eq!(by_name, rows);
        assert!(recording.notes()[0].contains("by their names: they are joined by time"), "{:?}", recording.notes());
        assert_eq!(recording.sha256().unwrap(), sha256);
    }
}

/// imu_tk's files of counts, and those of ulog2csv, which need no mapping.
#[test]
fn two_texts_of_a_known_layout_are_joined_without_a_mapping() {
    let files = Files::new();
    let counts = |begin: f64, values: [f64; 3]| -> String {
        let row = |row: u32| {
            let time = begin + f64::from(row) * 0.05;
            let [x, y, z] = values.map(|value| value + f64::from(row % 3));
            format!("   {time:.8e}   {x:.8e}   {y:.8e}   {z:.8e}\n")
        };
        (0..100).map(row).collect()
    };
    let acc = files.write("acc.mat", counts(100.0, [36_930.0, 32_734.0, 32_847.0]));
    let gyr = files.write("gyr.mat", counts(100.004, [32_763.0, 32_772.0, 32_780.0]));
    let topic = |header: &str, begin: u32, of: fn(u32) -> [f64; 3], last: &str| -> String {
        let row = |row: u32| {
            let [x, y, z] = of(row);
            let time = begin + 5000 * row;
            format!("{time},{time},1310988,{x:.5},{y:.5},{z:.5},{last}\n")
        };
        format!("{header}\n{}", (0..100).map(row).collect::<String>())
    };
    let names = "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count";
    let force = |row: u32| [0.1, -0.2, 9.8 + 0.001 * f64::from(row % 5)];
    let rate = |row: u32| [0.01, -0.02, 0.03 + 0.001 * f64::from(row % 5)];
    let accel = files.write("log_sensor_accel_0.csv", topic(names, 1_000_000, force, "41.3,0"));
    let gyro = files.write("log_sensor_gyro_0.csv", topic(names, 1_000_700, rate, "42.1,0"));
    for (one, other, pulses, resolution) in
        [(&acc, &gyr, [-5, 4, 12], None), (&accel, &gyro, [10_000, -20_000, 30_000], Some(1e-6))]
    {
        let by_name = read_with(&[other.clone(), one.clone()], None, Settings::default()).unwrap();
        let given = Settings { gyroscope_file: Some(source(other)), ..Settings::default() };
        let (rows, recording) = read_with(std::slice::from_ref(one), None, given).unwrap();
        assert_eq!(rows, by_name.0);
        let Triad { positive_pulses, negative_pulses, .. } = rows[0].gyroscopes;
        let net = [0, 1, 2].map(|axis| i64::from(positive_pulses[axis]) - i64::from(negative_pulses[axis]));
        assert_eq!((rows.len(), net), (100, pulses), "{one:?}");
        let scale = recording.scale().map(|scale| scale.resolution.gyroscope).ok();
        assert_eq!(scale, resolution, "{one:?}");
    }
}

#[test]
fn what_two_texts_lack_is_said_with_the_file() {
    let files = Files::new();
    let [acc, gyr] = texts(&files);
    let pair = [acc.clone(), gyr.clone()];
    let refused =
        |paths: &[PathBuf], mapping: &str, settings: Settings| read(paths, mapping, settings).map(drop).unwrap_err();
    let lacking = MAPPING.split_once("[gyroscope]").unwrap();
    let lacking = format!("{}[temperature]\nconstant = 20.5\n", lacking.0);
    let failure = refused(&pair, &lacking, Settings::default());
    assert!(
        failure.exit == Exit::Usage && failure.message.contains("the mapping has none: give [gyroscope]"),
        "{failure}"
    );
    let given = |file: &PathBuf| Settings { gyroscope_file: Some(source(file)), ..Settings::default() };
    let failure = refused(&pair[..1], &lacking, given(&gyr));
    assert!(failure.message.contains("the mapping has no gyroscopes; give [gyroscope]"), "{failure}");
    // Without the option a column of both is a mistake, and the message names the option.
    let failure = refused(&pair[..1], MAPPING, Settings::default());
    assert!(failure.message.contains("or its own file with --gyroscope-file"), "{failure}");
    let text = std::fs::read_to_string(&gyr).unwrap();
    let broken = files.write("broken.csv", text.replace("5.0", "5.o"));
    let failure = refused(&pair[..1], MAPPING, given(&broken));
    assert!(failure.message.starts_with(&format!("{}:2: t is", broken.display())), "{failure}");
    let late = files.write("late.csv", text.replace('\n', "\n1").trim_end_matches('1'));
    let failure = refused(&pair[..1], MAPPING, given(&late));
    assert!(failure.message.contains("do not overlap: they begin at 5000000000 ns and 15001300000 ns"), "{failure}");
    let none = MAPPING.replace("column = \"t\"\nunit = \"s\"", "interval_s = 0.02");
    let failure = refused(&pair[..1], &none, given(&gyr));
    assert!(failure.message.contains("are joined by time, but no time rises"), "{failure}");
    let failure = refused(&[acc, gyr.clone(), late], MAPPING, given(&gyr));
    assert!(failure.exit == Exit::Usage && failure.message.contains("goes with one file"), "{failure}");
}
