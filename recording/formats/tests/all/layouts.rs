//! Which columns a recording has: those of files that exist already, those of an IMU with gyroscopes or a lag, and what
//! happens when they come late. And the lagged temperature of recordings that have none.

use isotherm_files::{Disk, sources};
use isotherm_recording::Progress;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::read::{ImuChoice, Part, Samples, read_numbers};
use isotherm_recording_formats::write::{Files, Format, Rotation};
use isotherm_shared::compensate::answer;
use isotherm_shared::lag::Lag;
use isotherm_shared::names::{ImuId, StreamKind};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{CompensatedIncrement, RawSample, StreamSample, Triad};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
const RUNS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data");
const FORMATS: [(Format, &str); 2] = [(Format::Csv, "csv"), (Format::Mcap, "mcap")];

fn imu(name: &str) -> ImuId {
    name.parse().unwrap()
}

fn open(files: &[PathBuf]) -> Samples {
    Samples::open(&sources(files).unwrap(), ImuChoice::Any, &Progress::default()).unwrap()
}

fn read(files: &[PathBuf]) -> Vec<RawSample> {
    open(files).map(Result::unwrap).collect()
}

fn run(name: &str) -> Vec<RawSample> {
    read(&[Path::new(RUNS).join(name)])
}

fn table(name: &str) -> CoefficientTable {
    CoefficientTable::from_toml(&fs::read_to_string(Path::new(RUNS).join(name)).unwrap(), None).unwrap()
}

/// What can be compared: NaN is not equal to itself.
fn bits(raw: &RawSample) -> String {
    let triad = |triad: &Triad| {
        let temperature = [triad.head_temperature, triad.board_temperature, triad.head_lagged];
        format!(
            "{:?} {:?} {:?}",
            triad.positive_pulses,
            triad.negative_pulses,
            temperature.map(|of| of.map(f64::to_bits))
        )
    };
    let RawSample { session, sequence, timestamp_ns, interval_ns, telemetry_ns, lag_ns, device, .. } = raw;
    let (a, g) = (triad(&raw.accelerometers), triad(&raw.gyroscopes));
    format!("{session} {sequence} {timestamp_ns} {interval_ns} {telemetry_ns} {lag_ns} {device} {a} {g}")
}

/// Whether two numbers have the same bits; all NaNs are the same.
fn is_same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan()
}

fn assert_same(read: &[RawSample], expected: &[RawSample]) {
    assert_eq!(read.len(), expected.len());
    for (read, expected) in read.iter().zip(expected) {
        assert_eq!(bits(read), bits(expected));
    }
}

/// A recorder's files of some IMUs.
struct Recorder(Files);

impl Recorder {
    fn new(path: &Path, format: Format, imus: &[&str]) -> Self {
        let imus: Vec<_> = imus.iter().map(|name| imu(name)).collect();
        let streams: Vec<_> = (0..imus.len()).flat_map(|imu| StreamKind::BOTH.map(|stream| (imu, stream))).collect();
        Self(Files::create(&Disk, path, format, Rotation::default(), &imus, &streams).ok().unwrap())
    }

    /// Writes samples and their increments. Returns how often the rows went on in the next files.
    fn write(&mut self, imu: usize, table: &CoefficientTable, samples: &[RawSample]) -> usize {
        let mut next = 0;
        for raw in samples {
            let increment = CompensatedIncrement { latency_ns: 1234, ..answer(Some(table), raw) };
            for sample in [StreamSample::Raw(*raw), StreamSample::Increment(increment)] {
                let recorded_ns = 1_700_000_000_000_000_000 + raw.sequence;
                next += usize::from(self.0.write(&RecordedRow::new(imu, recorded_ns, sample)).ok().unwrap().is_some());
            }
        }
        next
    }

    fn flush(&mut self) {
        assert!(self.0.flush().ok().unwrap().is_none());
    }

    fn finish(mut self) {
        self.0.finish().ok().unwrap();
    }
}

/// The names of the columns of a stream, by the library of the format; in MCAP of each channel.
fn columns(path: &Path, topic: &str) -> Vec<Vec<String>> {
    let end = if topic.ends_with("/increment") { ".increments" } else { "" };
    let of_stream = || {
        let name = path.file_stem().unwrap().to_string_lossy();
        path.with_file_name(format!("{name}{end}.{}", path.extension().unwrap().to_string_lossy()))
    };
    match path.extension().unwrap().to_str().unwrap() {
        "csv" => {
            let text = fs::read_to_string(of_stream()).unwrap();
            vec![text.lines().next().unwrap().split(',').map(str::to_owned).collect()]
        }
        _ => {
            let summary = mcap::Summary::read(&fs::read(path).unwrap()).unwrap().unwrap();
            let counts = summary.stats.unwrap().channel_message_counts;
            let has_messages =
                |channel: &&Arc<mcap::Channel<'_>>| channel.topic == topic && counts.contains_key(&channel.id);
            let mut channels: Vec<_> = summary.channels.values().filter(has_messages).collect();
            channels.sort_by_key(|channel| channel.id);
            let units =
                |channel: &mcap::Channel<'_>| channel.metadata.keys().filter(|key| *key != "imu").cloned().collect();
            channels.into_iter().map(|channel| units(channel)).collect()
        }
    }
}

/// In alphabetical order, as the metadata of an MCAP channel are.
fn sorted(mut names: Vec<String>) -> Vec<String> {
    names.sort();
    names
}

/// The samples and increments of the old files, which were written before there were gyroscopes.
fn old() -> Vec<RawSample> {
    let mut samples = run("run.csv");
    samples.truncate(40);
    for raw in &mut samples {
        (raw.session, raw.sent_ns, raw.telemetry_ns) = (7, 5, raw.timestamp_ns);
    }
    samples[3].accelerometers.head_temperature[1] = f64::from_bits(0xfff8_0000_0000_1234);
    samples
}

#[test]
fn files_from_before_gyroscopes_are_read_as_they_were() {
    let table = table("imu-a.toml");
    for (format, extension) in FORMATS {
        let mut expected: Vec<_> = old().iter().map(|raw| RawSample { sent_ns: 0, ..*raw }).collect();
        if format == Format::Csv {
            expected[3].accelerometers.head_temperature[1] = f64::NAN;
        }
        let samples = read(&[Path::new(DATA).join(format!("old.{extension}"))]);
        assert_same(&samples, &expected);
        let increments = if format == Format::Mcap { "old.mcap" } else { &format!("old.increments.{extension}") };
        let names = ["a1_dv", "a2_dv", "a3_dv", "flag_bits", "latency_ns"];
        let number = |_, text: &str| text.parse::<f64>().map_err(|_| "a number");
        let files = [Path::new(DATA).join(increments)];
        let rows = read_numbers(
            &sources(&files).unwrap(),
            &names,
            &ImuChoice::Any,
            Part::default(),
            &Progress::default(),
            number,
        )
        .unwrap()
        .rows;
        assert_eq!(rows.len(), 40);
        for (row, raw) in rows.iter().zip(&samples) {
            let increment = answer(Some(&table), raw);
            assert!(row.values[..3].iter().zip(increment.velocity_increment).all(|(read, own)| is_same(*read, own)));
            assert_eq!(row.values[3..], [increment.flags as f64, 1234.0]);
        }
    }
}

/// An IMU without gyroscopes, lag and device gets the same columns as ever.
#[test]
fn an_imu_without_gyroscopes_gets_no_new_column() {
    let folder = TempDir::new().unwrap();
    for (format, extension) in FORMATS {
        let path = folder.path().join(format!("new.{extension}"));
        let mut recorder = Recorder::new(&path, format, &["imu-a"]);
        assert_eq!(recorder.write(0, &table("imu-a.toml"), &old()), 0);
        recorder.finish();
        let old = Path::new(DATA).join(format!("old.{extension}"));
        for stream in ["raw", "increment"] {
            let topic = format!("isotherm/imu-a/{stream}");
            assert_eq!(columns(&path, &topic), columns(&old, &topic));
        }
        if format == Format::Csv {
            for end in [".csv", ".increments.csv"] {
                let [new, old] = [folder.path().join("new"), Path::new(DATA).join("old")]
                    .map(|path| fs::read_to_string(format!("{}{end}", path.display())).unwrap());
                assert_eq!(new, old);
            }
        }
    }
}

const NEW_RAW: [&str; 20] = [
    "device",
    "g1_positive",
    "g1_negative",
    "g1_head",
    "g1_board",
    "g2_positive",
    "g2_negative",
    "g2_head",
    "g2_board",
    "g3_positive",
    "g3_negative",
    "g3_head",
    "g3_board",
    "lag_ns",
    "a1_head_lagged",
    "a2_head_lagged",
    "a3_head_lagged",
    "g1_head_lagged",
    "g2_head_lagged",
    "g3_head_lagged",
];

/// A whole IMU: every sample knows its unit.
fn whole() -> Vec<RawSample> {
    run("run-g.csv").iter().map(|raw| RawSample { device: 42, ..*raw }).collect()
}

#[test]
fn the_rows_before_the_first_flush_decide_the_columns() {
    let folder = TempDir::new().unwrap();
    let (table, samples) = (table("imu-g.toml"), whole());
    for (format, extension) in FORMATS {
        let path = folder.path().join(format!("r.{extension}"));
        let mut recorder = Recorder::new(&path, format, &["imu-g"]);
        recorder.flush();
        assert!(read(std::slice::from_ref(&path)).is_empty(), "a recording that waits for rows has none");
        // The first samples come without their lag and device, as before the acquisition knows them.
        let first: Vec<_> = samples[..10].iter().map(|raw| RawSample { lag_ns: 0, device: 0, ..*raw }).collect();
        assert_eq!(recorder.write(0, &table, &first), 0);
        assert_eq!(recorder.write(0, &table, &samples[10..1500]), 0);
        recorder.flush();
        assert_same(&read(std::slice::from_ref(&path)), &[&first, &samples[10..1500]].concat());
        assert_eq!(recorder.write(0, &table, &samples[1500..]), 0);
        recorder.finish();
        assert_same(&read(std::slice::from_ref(&path)), &[&first, &samples[10..]].concat());
        let raw = columns(&path, "isotherm/imu-g/raw");
        assert_eq!(raw.len(), 1);
        assert!(NEW_RAW.iter().all(|name| raw[0].iter().any(|column| column == name)), "{raw:?}");
        let increments = columns(&path, "isotherm/imu-g/increment");
        let mut expected: Vec<_> =
            "recorded_ns,session,sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,g1_da,g2_da,g3_da,\
                                    table,flags,delivery,flag_bits,latency_ns"
                .split(',')
                .map(str::to_owned)
                .collect();
        if format == Format::Mcap {
            expected = sorted(expected);
        }
        assert_eq!(increments, [expected]);
        assert_increments(&path, "imu-g", &table, &read(std::slice::from_ref(&path)));
    }
    let left = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 3, "no file besides those of the streams");
}

/// The increments of a recording have every angle to the last bit; flags have 64 bits.
fn assert_increments(path: &Path, id: &str, table: &CoefficientTable, samples: &[RawSample]) {
    let name = path.file_stem().unwrap().to_string_lossy();
    let path = match path.extension().unwrap().to_str().unwrap() {
        "mcap" => path.to_owned(),
        extension => path.with_file_name(format!("{name}.increments.{extension}")),
    };
    let names = ["a1_dv", "a2_dv", "a3_dv", "g1_da", "g2_da", "g3_da", "flag_bits"];
    let number = |_, text: &str| text.parse::<f64>().map_err(|_| "a number");
    let bar = Progress::default();
    let rows =
        read_numbers(&sources(&[path]).unwrap(), &names, &ImuChoice::Only(imu(id)), Part::default(), &bar, number)
            .unwrap()
            .rows;
    assert_eq!(rows.len(), samples.len());
    for (row, raw) in rows.iter().zip(samples) {
        let increment = answer(Some(table), raw);
        let values = [increment.velocity_increment, increment.angle_increment].concat();
        for (read, own) in row.values.iter().zip(values) {
            assert!(is_same(*read, own), "{read} {own}");
        }
        assert_eq!(row.values[6], increment.flags as f64);
    }
}

#[test]
fn columns_that_come_late_begin_the_next_files() {
    let folder = TempDir::new().unwrap();
    let (table, whole) = (table("imu-g.toml"), whole());
    let parts: [Vec<RawSample>; 3] = [
        whole[..20].iter().map(|raw| RawSample { lag_ns: 0, device: 0, gyroscopes: Triad::ABSENT, ..*raw }).collect(),
        whole[20..40].iter().map(|raw| RawSample { gyroscopes: Triad::ABSENT, ..*raw }).collect(),
        whole[40..60].to_vec(),
    ];
    let expected: Vec<_> = parts.concat().iter().map(kept).collect();
    for (format, extension) in FORMATS {
        let path = folder.path().join(format!("late.{extension}"));
        // A name that is taken is left out.
        fs::write(folder.path().join(format!("late-0002.{extension}")), "precious").unwrap();
        let mut recorder = Recorder::new(&path, format, &["imu-g"]);
        let mut next = 0;
        for part in &parts {
            // A table without gyroscopes for samples without, as before a reload.
            let plain = CoefficientTable::from_toml(&plain_table(), None).unwrap();
            let table = if part[0].gyroscopes.is_absent() { &plain } else { &table };
            next += recorder.write(0, table, part);
            recorder.flush();
        }
        recorder.finish();
        let names = ["late", "late-0003", "late-0004"].map(|name| folder.path().join(format!("{name}.{extension}")));
        if format == Format::Mcap {
            assert_eq!((next, columns(&path, "isotherm/imu-g/raw").len()), (0, 3), "a channel for each layout");
            assert_eq!(columns(&path, "isotherm/imu-g/increment").len(), 2);
            assert_same(&read(std::slice::from_ref(&path)), &expected);
        } else {
            assert_eq!(next, 2);
            for (name, expected) in names.iter().zip(expected.chunks(20)) {
                assert_same(&read(std::slice::from_ref(name)), expected);
            }
            assert_same(&read(&names), &expected);
            let of = |name: &Path, stream: &str| columns(name, &format!("isotherm/imu-g/{stream}"))[0].len();
            assert_eq!(
                names.each_ref().map(|name| (of(name, "raw"), of(name, "increment"))),
                [(19, 13), (24, 13), (39, 16)]
            );
        }
        assert_eq!(fs::read(folder.path().join(format!("late-0002.{extension}"))).unwrap(), b"precious");
    }
}

/// A sample as a recording without lag keeps it.
fn kept(raw: &RawSample) -> RawSample {
    let mut kept = *raw;
    if kept.lag_ns == 0 {
        kept.accelerometers.head_lagged = [0.0; 3];
        kept.gyroscopes.head_lagged = [0.0; 3];
    }
    kept
}

/// The accelerometers of the table with gyroscopes, without a lag.
fn plain_table() -> String {
    let text = fs::read_to_string(Path::new(RUNS).join("imu-g.toml")).unwrap();
    let accelerometers = text.split("[[gyroscope]]").next().unwrap();
    accelerometers
        .replace("[lag]\ntime_constant_s = 240.0\n", "")
        .replace(", transient = -35.0", "")
        .replace(", transient = 12.5", "")
}

#[test]
fn each_imu_of_a_file_has_its_own_columns() {
    let folder = TempDir::new().unwrap();
    let (table_a, table_g) = (table("imu-a.toml"), table("imu-g.toml"));
    let (plain, whole) = (old(), whole());
    let path = folder.path().join("all.mcap");
    let mut recorder = Recorder::new(&path, Format::Mcap, &["imu-a", "imu-g", "imu-late"]);
    recorder.write(0, &table_a, &plain[..20]);
    recorder.write(1, &table_g, &whole[..20]);
    recorder.flush();
    recorder.write(0, &table_a, &plain[20..]);
    recorder.write(1, &table_g, &whole[20..40]);
    recorder.write(2, &table_g, &whole[..40]);
    recorder.finish();
    let new = |id: &str| {
        let all = columns(&path, &format!("isotherm/{id}/raw"));
        all.iter().map(|names| names.iter().filter(|name| NEW_RAW.contains(&name.as_str())).count()).collect::<Vec<_>>()
    };
    assert_eq!((new("imu-a"), new("imu-g"), new("imu-late")), (vec![0], vec![20], vec![20]));
    for (id, expected) in [("imu-a", &plain[..]), ("imu-g", &whole[..40]), ("imu-late", &whole[..40])] {
        let expected: Vec<_> = expected.iter().map(|raw| RawSample { sent_ns: 0, ..*raw }).collect();
        for choice in [ImuChoice::Only(imu(id)), ImuChoice::Prefer(imu(id))] {
            let read =
                Samples::open(&sources(std::slice::from_ref(&path)).unwrap(), choice, &Progress::default()).unwrap();
            assert_same(&read.map(Result::unwrap).collect::<Vec<_>>(), &expected);
        }
    }
    assert_increments(&path, "imu-g", &table_g, &whole[..40]);
}

/// Writes the run of the whole IMU without its lagged temperature.
fn without_lag(folder: &Path, format: Format, name: &str, samples: &[RawSample]) -> PathBuf {
    let path = folder.join(name);
    let mut recorder = Recorder::new(&path, format, &["imu-g"]);
    let bare: Vec<_> = samples.iter().map(|raw| kept(&RawSample { lag_ns: 0, ..*raw })).collect();
    recorder.write(0, &table("imu-g.toml"), &bare);
    recorder.finish();
    path
}

#[test]
fn the_lag_of_a_recording_without_one_is_computed() {
    const LAG_NS: u64 = 240_000_000_000;
    let folder = TempDir::new().unwrap();
    // Two sessions, each with temperature every 20 samples.
    let mut samples = run("run-g.csv");
    samples.truncate(1000);
    samples[500..].iter_mut().for_each(|raw| raw.session = 1);
    let mut lag = Lag::new(LAG_NS);
    let mut expected = samples.clone();
    for (index, raw) in expected.iter_mut().enumerate() {
        if index == 500 {
            lag.reset();
        }
        lag.follow(raw);
        lag.fill(raw);
    }
    let of_session = |raw: &RawSample| (raw.gyroscopes.head_lagged[0] - raw.gyroscopes.head_temperature[0]).abs();
    assert!(of_session(&expected[499]) > 0.01 && of_session(&expected[500]) == 0.0, "each session begins soaked");
    for (format, extension) in FORMATS {
        let files = [
            without_lag(folder.path(), format, &format!("1.{extension}"), &samples[..300]),
            without_lag(folder.path(), format, &format!("2.{extension}"), &samples[300..]),
        ];
        let mut reading = open(&files);
        reading.set_lag(LAG_NS);
        assert_same(&reading.map(Result::unwrap).collect::<Vec<_>>(), &expected);
        // Without a time constant there is no lag.
        assert!(read(&files).iter().all(|raw| raw.lag_ns == 0 && raw.gyroscopes.head_lagged == [0.0; 3]));
        // Another one from the middle on, as after a reload: L is kept.
        let mut reading = open(&files);
        reading.set_lag(LAG_NS);
        for _ in 0..300 {
            reading.next().unwrap().unwrap();
        }
        reading.set_lag(7);
        let next = reading.next().unwrap().unwrap();
        assert_eq!(next.lag_ns, 7);
    }
}

#[test]
fn the_lag_of_a_recording_that_has_one_is_used_as_it_is() {
    let folder = TempDir::new().unwrap();
    let samples = run("run-g.csv");
    let path = Path::new(RUNS).join("run-g.csv");
    let mut reading = open(std::slice::from_ref(&path));
    reading.set_lag(60_000_000_000);
    assert_same(&reading.map(Result::unwrap).collect::<Vec<_>>(), &samples);
    // A piece that has none, before one that has.
    let before = without_lag(folder.path(), Format::Mcap, "before.mcap", &samples[..400]);
    let rest = folder.path().join("rest.csv");
    let text = fs::read_to_string(&path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    fs::write(
        &rest,
        format!("{header}\n{}", rows.lines().skip(400).map(|line| format!("{line}\n")).collect::<String>()),
    )
    .unwrap();
    let mut reading = open(&[rest, before]);
    reading.set_lag(60_000_000_000);
    let read: Vec<_> = reading.map(Result::unwrap).collect();
    assert!(read[..400].iter().all(|raw| raw.lag_ns == 60_000_000_000 && raw.gyroscopes.head_lagged[0] > 0.0));
    assert_same(&read[400..], &samples[400..]);
}
