//! Bags and texts that were split: their pieces are joined where their times go on.

use crate::convert_ros::{BEGIN, Bag, STEP, imu};
use crate::foreign::{Files, foreign};
use isotherm_files::sources;
use isotherm_recording::Progress;
use isotherm_recording_formats::convert::{Foreign, Settings};
use isotherm_recording_formats::read::{ImuChoice, Input, Pieces, Recording, RowKind};
use isotherm_recording_formats::ros::ImuMessage;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use std::fs;
use std::path::{Path, PathBuf};

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[accelerometer]\ncolumns = [\"x\", \"y\", \"z\"]\n\
     kind = \"reading\"\nresolution = 1e-5\n[temperature]\nconstant = 23.4\n";

fn bag(rows: core::ops::Range<u64>) -> Vec<u8> {
    let mut bag = Bag::new();
    for row in rows {
        bag.imu("/imu", &ImuMessage { linear_acceleration: Some([row as f64 * 1e-3, 0.1, -9.7]), ..imu(row) });
    }
    bag.bytes()
}

fn text(rows: core::ops::Range<u32>, step: f64) -> String {
    let row = |row: u32| format!("{:.4},{:.3},0.1,9.7\n", 3.3 + f64::from(row) * step, f64::from(row) * 0.001);
    "t,x,y,z\n".to_owned() + &rows.map(row).collect::<String>()
}

fn read(paths: &[PathBuf], foreign: Foreign) -> Result<(Vec<RawSample>, Recording), Failure> {
    let mut recording =
        Recording::open(&sources(paths)?, RowKind::Sample, (ImuChoice::Any, foreign), &Progress::default())?;
    let rows: Result<Vec<_>, _> = recording.by_ref().map(|row| row.map(|row| row.sample)).collect();
    match rows {
        Ok(rows) => Ok((rows, recording)),
        Err(error) => Err(recording.failure(&error)),
    }
}

/// Session, sequence and whole milliseconds since [`BEGIN`] of the first row of each stretch.
fn stretches(rows: &[RawSample]) -> Vec<(u64, u64)> {
    let begins = |before: Option<&RawSample>, row: &RawSample| {
        before.is_none_or(|before| before.session != row.session || before.sequence + 1 != row.sequence)
    };
    let before = std::iter::once(None).chain(rows.iter().map(Some));
    before.zip(rows).filter(|(before, row)| begins(*before, row)).map(|(_, row)| (row.session, row.sequence)).collect()
}

#[test]
fn the_pieces_of_a_bag_are_the_whole_bag_in_any_order_and_as_a_folder() {
    let files = Files::new();
    let whole = read(&[files.write("whole.mcap", bag(0..900))], Foreign::default()).unwrap().0;
    let folder = files.write("x", "").with_file_name("drive");
    fs::create_dir(&folder).unwrap();
    // In the order of names piece 10 comes before 2. The last piece has two rows, which show no interval.
    let pieces = [("drive_2.mcap", 0..450), ("drive_10.mcap", 450..898), ("drive_11.mcap", 898..900)];
    let paths: Vec<_> = pieces.map(|(name, rows)| (folder.join(name), bag(rows))).into_iter().collect();
    paths.iter().for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
    let paths: Vec<_> = paths.into_iter().map(|(path, _)| path).collect();
    let metadata = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n";
    fs::write(folder.join("metadata.yaml"), metadata).unwrap();
    for order in [vec![2, 0, 1], vec![0, 1, 2]] {
        let named: Vec<_> = order.iter().map(|place: &usize| paths[*place].clone()).collect();
        let (rows, recording) = read(&named, Foreign::default()).unwrap();
        assert!(rows == whole, "{order:?}");
        let notes = recording.notes();
        assert!(notes[0].contains("drive_11.mcap: 3 pieces are joined, since the time continues"), "{notes:?}");
        assert_eq!(
            notes.iter().filter(|note| note.contains("the nominal interval is 0.005 s")).count(),
            1,
            "{notes:?}"
        );
        let findings = recording.findings();
        assert!(findings.len() == 1 && findings[0].name == "no-temperature", "{findings:?}");
    }
    assert!(read(std::slice::from_ref(&folder), Foreign::default()).unwrap().0 == whole);
    // The description lists the files.
    let listed =
        format!("{metadata}  relative_file_paths:\n    - drive_10.mcap\n    - \"drive_2.mcap\"\n  duration:\n");
    fs::write(folder.join("metadata.yaml"), listed).unwrap();
    assert!(read(std::slice::from_ref(&folder), Foreign::default()).unwrap().0 == whole[..898]);
    fs::write(folder.join("drive_0.db3"), "SQLite format 3\0").unwrap();
    let failure = read(std::slice::from_ref(&folder), Foreign::default()).map(drop).unwrap_err();
    for words in ["ros2 bag convert -i FOLDER -o to_mcap.yaml", "storage_id: mcap", "rosbags-convert --src FOLDER"] {
        assert!(failure.exit == Exit::Data && failure.message.contains(words), "{failure}");
    }
    let empty = folder.with_file_name("empty");
    fs::create_dir(&empty).unwrap();
    assert!(read(&[empty], Foreign::default()).map(drop).unwrap_err().message.contains("without a bag of ROS in MCAP"));
}

#[test]
fn lost_rows_between_pieces_are_missing_and_a_pause_or_another_rate_is_another_session() {
    let files = Files::new();
    let joined = |second: Vec<u8>| {
        let paths = [files.write("a.mcap", bag(0..300)), files.write("b.mcap", second)];
        let (rows, recording) = read(&paths, Foreign::default()).unwrap();
        (stretches(&rows), recording.notes()[0].clone())
    };
    assert_eq!(joined(bag(300..500)).0, [(0, 0)]);
    let (rows, note) = joined(bag(303..500));
    assert!(rows == [(0, 0), (0, 303)] && note.ends_with("; 3 rows are missing between them"), "{rows:?} {note}");
    let (rows, note) = joined(bag(310..500));
    assert!(
        rows == [(0, 0), (2, 0)] && note.contains("begins 0.055 s after its end, over 10 intervals"),
        "{rows:?} {note}"
    );
    // Another rate.
    let mut slower = Bag::new();
    for row in 0..100 {
        slower.imu("/imu", &ImuMessage { stamp_ns: BEGIN + 300 * STEP + row * 2 * STEP, ..imu(0) });
    }
    let (rows, note) = joined(slower.bytes());
    assert!(rows == [(0, 0), (2, 0)] && note.ends_with("has another interval"), "{rows:?} {note}");
}

#[test]
fn a_row_in_two_pieces_is_refused_with_both() {
    let files = Files::new();
    let paths = [files.write("a.mcap", bag(0..300)), files.write("b.mcap", bag(299..500))];
    let failure = read(&paths, Foreign::default()).map(drop).unwrap_err();
    let words = format!("its first row, of {} ns, is there twice; the piece before is", BEGIN + 299 * STEP);
    assert!(failure.exit == Exit::Data && failure.message.contains(&words), "{failure}");
    // The same file twice, under another name.
    let paths = [files.write("a.mcap", bag(0..300)), files.write("b.mcap", bag(0..300))];
    assert!(read(&paths, Foreign::default()).map(drop).unwrap_err().message.contains("is there twice"));
}

#[test]
fn pieces_that_begin_with_a_jitter_have_one_interval() {
    let files = Files::new();
    // 100 Hz, and what a clock that drifts makes of it.
    let paths = [files.write("a.csv", text(0..1500, 0.01)), files.write("b.csv", text(1500..2500, 0.010_03))];
    let (rows, recording) = read(&paths, foreign(Some(MAPPING))).unwrap();
    assert!(rows.iter().all(|row| row.interval_ns == 10_000_000));
    assert!(recording.findings().is_empty(), "{:?}", recording.findings());
    let alone = read(&paths[1..], foreign(Some(MAPPING))).unwrap().0;
    assert!(alone[0].interval_ns.abs_diff(10_030_000) < 100, "{}", alone[0].interval_ns);
}

#[test]
fn texts_without_a_time_are_joined_where_the_user_says_so() {
    let files = Files::new();
    let mapping = MAPPING.replace("column = \"t\"\nunit = \"s\"", "interval_s = 0.01");
    let paths = [files.write("b.csv", text(0..100, 0.01)), files.write("a.csv", text(100..150, 0.01))];
    let (rows, recording) = read(&paths, foreign(Some(&mapping))).unwrap();
    assert_eq!(stretches(&rows), [(0, 0), (2, 0)]);
    assert!(recording.notes()[0].contains("with --in-order each continues where the one before ends"));
    let settings = Settings { in_order: true, ..Settings::default() };
    let (rows, recording) = read(&paths, Foreign { settings: settings.clone(), ..foreign(Some(&mapping)) }).unwrap();
    assert_eq!((stretches(&rows).len(), rows.len(), rows[149].timestamp_ns), (1, 150, 1_500_000_000));
    assert!(recording.notes()[0].contains("in the order in which they are named: no clock shows theirs"));
    // Times that do not overlap show the order, and the option says that it does nothing.
    let paths = [files.write("d.csv", text(100..150, 0.01)), files.write("c.csv", text(0..100, 0.01))];
    let (rows, recording) = read(&paths, Foreign { settings: settings.clone(), ..foreign(Some(MAPPING)) }).unwrap();
    assert_eq!(stretches(&rows).len(), 1);
    assert!(recording.notes()[0].contains("--in-order has no effect: the times of the pieces do not overlap"));
    // Clocks that start again show none: the later one is named first.
    let early = text(0..100, 0.01).replace(",0.1,", ",0.2,").replace("\n3.30", "\n3.29");
    let paths = [files.write("f.csv", text(0..90, 0.01)), files.write("e.csv", early)];
    let first = |settings: Settings| {
        read(&paths, Foreign { settings, ..foreign(Some(MAPPING)) }).unwrap().0[0].accelerometers.positive_pulses[1]
    };
    assert_eq!([first(settings), first(Settings::default())], [10_000, 20_000]);
}

#[test]
fn of_several_recordings_each_has_its_own_pieces_and_hash() {
    let files = Files::new();
    let paths = [
        files.write("a.mcap", bag(0..300)),
        files.write("c.mcap", bag(5000..5200)),
        files.write("b.mcap", bag(300..500)),
    ];
    let split = |input: Input| {
        let (mut left, mut found) =
            (Some(Pieces::new(&sources(&paths).unwrap(), RowKind::Sample, input).unwrap()), Vec::new());
        while let Some(pieces) = left.take() {
            let first = pieces.paths().next().map(Path::to_owned).unwrap();
            let mut recording = pieces.first_recording_hashed(&Progress::default()).unwrap();
            let rows = recording.by_ref().filter(Result::is_ok).count();
            left = recording.others();
            found.push((first, rows, recording.sha256().unwrap()));
        }
        found
    };
    let digest = |paths: &[&PathBuf]| {
        let bytes: Vec<u8> = paths.iter().flat_map(|path| fs::read(path).unwrap()).collect();
        let digest = <sha2::Sha256 as sha2::Digest>::digest(bytes);
        digest.iter().map(|byte| format!("{byte:02x}")).collect::<String>()
    };
    let [a, c, b] = &paths;
    let hashes = [digest(&[a, b]), digest(&[c])];
    let input = || Input::from((ImuChoice::Any, Foreign::default()));
    let [first, second] = hashes;
    assert_eq!(split(input()), [(a.clone(), 500, first.clone()), (c.clone(), 200, second.clone())]);
    // A part ends within the first piece of each; its other pieces are none of their own.
    let part = isotherm_recording_formats::read::Part::new(None, Some("0.5".parse().unwrap())).unwrap();
    assert_eq!(split(input().within(part)), [(a.clone(), 100, first), (c.clone(), 100, second)]);
}
