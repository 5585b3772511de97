//! Foreign data as pieces of a recording.

use crate::convert_ros::{BEGIN, Bag, STEP, imu};
use isotherm_files::{source, sources};
use isotherm_recording::Progress;
use isotherm_recording_formats::convert::{Conversion, Foreign, Settings};
use isotherm_recording_formats::read::{ImuChoice, Recording, RowKind, Samples};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::Nominal;
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure};
use sha2::{Digest as _, Sha256};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const TEXT: &str = "t,x,y,z,T\n0.01,0.5,-0.25,9.8,21\n0.02,0.5,-0.25,9.81,22\n0.03,0.5,-0.25,9.82,23\n";
const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"s\"\ninterval_s = 0.01\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\nresolution = 1e-5\n[temperature]\ncolumns = \"T\"\n";
const NOVATEL: &str = "%RAWIMUSA,2209,491612.254;2209,491612.253588,ea5afe00,329303960,-2512321,4410363,309705,607017,-1009773*1fb76c28\n";

pub(crate) struct Files(TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    }
}

pub(crate) fn foreign(mapping: Option<&str>) -> Foreign {
    Foreign { mapping: mapping.map(|text| ("m.toml".into(), text.to_owned())), settings: Settings::default() }
}

fn open(paths: &[PathBuf], foreign: Foreign) -> Result<Recording, Failure> {
    let input = (ImuChoice::Any, foreign);
    Recording::open_hashed(&sources(paths).unwrap(), RowKind::Sample, input, &Progress::default())
}

/// The rows, and the recording after the last of them.
fn read(paths: &[PathBuf], foreign: Foreign) -> (Vec<RawSample>, Recording) {
    let mut recording = open(paths, foreign).unwrap();
    let rows = recording.by_ref().map(|row| row.unwrap().sample).collect();
    (rows, recording)
}

fn refused(paths: &[PathBuf], foreign: Foreign) -> Failure {
    let recording = match open(paths, foreign) {
        Ok(recording) => recording,
        Err(failure) => return failure,
    };
    let mut recording = recording;
    let error = recording.find_map(Result::err).unwrap();
    recording.failure(&error)
}

fn converted(path: &Path, mapping: Option<&str>) -> Vec<RawSample> {
    let named = mapping.map(|text| (Path::new("m.toml"), text));
    Conversion::open(&source(path), named, &Settings::default()).unwrap().map(Result::unwrap).collect()
}

fn nominal(recording: &Recording) -> Result<Nominal, String> {
    recording.nominal(&ImuId::new("imu-a").unwrap()).map_err(|failure| {
        assert_eq!(failure.exit, Exit::Data, "{failure}");
        failure.message
    })
}

fn bag(rows: core::ops::Range<u64>) -> Vec<u8> {
    let mut bag = Bag::new();
    bag.temperature("/t", BEGIN, 30.0);
    for row in rows {
        bag.imu("/imu", &imu(row));
    }
    bag.temperature("/t", BEGIN + 9 * STEP, 31.0);
    bag.bytes()
}

#[test]
fn the_rows_are_those_of_the_conversion_and_the_hash_is_that_of_the_bytes() {
    let files = Files::new();
    let (text, bytes) = (files.write("a.csv", TEXT), bag(0..5));
    let ros = files.write("b.mcap", &bytes);
    for (path, mapping, bytes) in [(&text, Some(MAPPING), TEXT.as_bytes()), (&ros, None, &bytes)] {
        let (rows, recording) = read(std::slice::from_ref(path), foreign(mapping));
        assert_eq!(rows, converted(path, mapping));
        let digest: String = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(recording.sha256().unwrap(), digest);
    }
    // The hash of two pieces is that of their bytes, one after the other.
    let later = TEXT.replace("0.0", "1.0");
    let both = [files.write("later.csv", &later), text];
    let (rows, recording) = read(&both, foreign(Some(MAPPING)));
    assert_eq!((rows.len(), recording.places().locate(6)), (6, format!("{}:2", both[0].display())));
    let digest: String = Sha256::digest(TEXT.to_owned() + &later).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(recording.sha256().unwrap(), digest);
}

#[test]
fn what_a_pulse_is_must_be_known_and_the_same_in_all_pieces() {
    let files = Files::new();
    let text = files.write("a.csv", TEXT);
    let later = files.write("b.csv", TEXT.replace("0.0", "1.0").replace(",23", ",33"));
    let (_, recording) = read(&[text.clone(), later.clone()], foreign(Some(MAPPING)));
    let found = nominal(&recording).unwrap();
    assert_eq!((found.interval_ns, found.resolution.accelerometer, found.range), (10_000_000, 1e-5, [21.0, 33.0]));
    assert!(!found.has_gyroscopes && found.max_specific_force.is_none());
    let notes = recording.notes();
    let apart = "is a session of its own: it does not continue";
    assert!(
        notes.len() == 1
            && notes[0].contains(apart)
            && notes[0].ends_with("begins 0.98 s after its end, over 10 intervals"),
        "{notes:?}"
    );
    let in_g = MAPPING.replace("1e-5", "1e-5\nunit = \"g\"\nrange = 16");
    let found = nominal(&read(std::slice::from_ref(&text), foreign(Some(&in_g))).1).unwrap();
    assert!((found.resolution.accelerometer - 9.80665e-5).abs() < 1e-18);
    assert!((found.max_specific_force.unwrap() - 16.0 * 9.80665).abs() < 1e-12);
    // A temperature that does not change says little of a range.
    let constant = MAPPING.replace("columns = \"T\"", "constant = 20");
    let found = nominal(&read(std::slice::from_ref(&text), foreign(Some(&constant))).1).unwrap();
    assert_eq!(found.range, [19.0, 21.0]);
    let ros = files.write("c.mcap", bag(0..5));
    let found = nominal(&read(std::slice::from_ref(&ros), Foreign::default()).1).unwrap();
    assert_eq!((found.interval_ns, found.resolution.gyroscope, found.range), (STEP, 1e-6, [29.0, 31.0]));
    // Without a given interval each piece has its own.
    let found = MAPPING.replace("interval_s = 0.01\n", "");
    let slower = files.write("s.csv", "t,x,y,z,T\n2.01,0.5,0,9.8,21\n2.03,0.5,0,9.8,22\n2.05,0.5,0,9.8,23\n");
    let (_, recording) = read(&[text.clone(), slower], foreign(Some(&found)));
    assert!(nominal(&recording).unwrap_err().contains("s.csv: no nominal table: the nominal interval is not that of"));
    let findings: Vec<_> = recording.findings().iter().map(ToString::to_string).collect();
    assert!(findings[0].contains("the nominal interval is 0.02 s, but that of"), "{findings:?}");
    let log = files.write("d.log", NOVATEL);
    let interval = Settings { interval_ns: Some(10_000_000), ..Settings::default() };
    let (_, recording) = read(&[log], Foreign { mapping: None, settings: interval });
    assert!(nominal(&recording).unwrap_err().contains("the counts of these logs are increments"));
}

#[test]
fn data_that_are_no_recording_are_refused_without_foreign_and_positions_have_none() {
    let files = Files::new();
    let (text, ros) = (files.write("a.csv", TEXT), files.write("b.mcap", bag(0..5)));
    for path in [&text, &ros] {
        let alone = Samples::open(&sources(std::slice::from_ref(path)).unwrap(), ImuChoice::Any, &Progress::default());
        let failure = alone.and_then(|samples| samples.collect::<Result<Vec<_>, _>>()).unwrap_err();
        assert_eq!(failure.exit, Exit::Data, "{failure}");
        let input = (ImuChoice::Any, foreign(Some(MAPPING)));
        let campaign = Recording::open(
            &sources(std::slice::from_ref(path)).unwrap(),
            RowKind::Campaign,
            input,
            &Progress::default(),
        );
        assert!(campaign.is_err() || campaign.unwrap().next().unwrap().is_err());
    }
    // An own recording in MCAP is one, whatever is said.
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/old.mcap");
    let (rows, recording) = read(std::slice::from_ref(&own), Foreign::default());
    assert!(!rows.is_empty() && recording.notes().is_empty());
    assert!(nominal(&recording).unwrap_err().contains("a recording does not say what a pulse is"));
    let failure = refused(&[own], foreign(Some(MAPPING)));
    assert!(failure.exit == Exit::Usage && failure.message.contains("leave out what is for other data: mapping"));
}

#[test]
fn no_beginning_of_foreign_data_makes_it_panic() {
    let files = Files::new();
    for (bytes, mapping) in [(TEXT.as_bytes().to_vec(), Some(MAPPING)), (bag(0..3), None), (NOVATEL.into(), None)] {
        for length in 0..bytes.len() {
            let path = files.write("cut", &bytes[..length]);
            let ended = open(&[path], foreign(mapping)).map(|mut recording| {
                let error = recording.find_map(Result::err);
                error.map(|error| recording.failure(&error))
            });
            if let Some(failure) = ended.unwrap_or_else(Some) {
                assert!([Exit::Data, Exit::Usage].contains(&failure.exit), "{length}: {failure}");
            }
        }
    }
}

#[test]
fn an_error_has_the_line_in_its_piece() {
    let files = Files::new();
    let text = files.write("a.csv", TEXT);
    let later = files.write("b.csv", TEXT.replace("0.0", "1.0").replace("9.82", "9.x2"));
    let failure = refused(&[later.clone(), text], foreign(Some(MAPPING)));
    assert!(failure.message.starts_with(&format!("{}:4: z is \"9.x2\"", later.display())), "{failure}");
    assert_eq!(failure.place, Some((later, Some(4))));
}
