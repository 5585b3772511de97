//! Foreign data as raw samples, and increments as ROS messages, on arrays. The library does the work; this module
//! converts arguments and results.

use crate::errors::{RecordingFault, faults, file, in_python};
use crate::files::{unwritten, write_file};
use crate::records::{Fields, INCREMENT, RAW, Values, array, raw_bytes};
use crate::table::Table;
use crate::work::Work;
use isotherm_recording::rows::RecordedRow;
use isotherm_recording_formats::convert::{Conversion, KnownColumns, Mapping, Settings, TimeSource};
use isotherm_recording_formats::read::{Part, RecordingTime};
use isotherm_recording_formats::write::{RosTable, RosWriter};
use isotherm_shared::table::PulseScale;
use isotherm_shared::wire::StreamSample;
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::failure::{Exit, Failure};
use numpy::PyArray1;
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use std::fs::File;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

/// Foreign data: a file, or a text.
#[derive(FromPyObject)]
pub(crate) enum Foreign {
    Text(Vec<u8>),
    File(PathBuf),
}

/// The ends of the part of each recording that is read: seconds or time stamps, as the command takes them.
pub(crate) type PartOptions = (Option<String>, Option<String>);

/// The part.
///
/// # Errors
/// `ValueError`.
pub(crate) fn part_of((start, end): PartOptions) -> PyResult<Part> {
    let moment = |name: &str, text: Option<String>| {
        let parsed =
            text.map(|text| text.parse::<RecordingTime>().map_err(|message| format!("{name} is {text}: {message}")));
        parsed.transpose().map_err(PyValueError::new_err)
    };
    let part = Part::new(moment("start", start)?, moment("end", end)?);
    part.map_err(|message| PyValueError::new_err(format!("start is not before end: {message}")))
}

/// Topics of both sensors, of only gyroscopes and of temperatures, the file of the gyroscopes, and where the times come
/// from.
pub(crate) type OriginOptions = (Option<String>, Option<String>, Option<String>, Option<PathBuf>, String);

/// Where foreign data come from.
///
/// # Errors
/// `ValueError`.
pub(crate) fn settings_of(origin: OriginOptions) -> PyResult<Settings> {
    let (topic, gyroscope_topic, temperature_topic, gyroscope_file, time) = origin;
    let time = match time.as_str() {
        "header" => TimeSource::Header,
        "log" => TimeSource::Log,
        "rate" => TimeSource::Rate,
        other => return Err(PyValueError::new_err(format!("time is {other}, give header, log or rate"))),
    };
    let gyroscope_file = gyroscope_file.map(isotherm_files::source);
    Ok(Settings { topic, gyroscope_topic, temperature_topic, gyroscope_file, time, ..Settings::default() })
}

/// The raw samples of foreign data as bytes, and what the user should know. `mapping` is the name and the text of a
/// mapping file, `first_row` the line of the first row of a text that is a table in memory.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "those of the function of the package, which have names there")]
pub(crate) fn convert<'py>(
    py: Python<'py>,
    source: Foreign,
    first_row: Option<u64>,
    mapping: Option<(PathBuf, String)>,
    temperature: Option<f64>,
    interval_ns: Option<u64>,
    origin: OriginOptions,
    session: u64,
    instance: Option<u32>,
    part: PartOptions,
    table: Option<PyRef<'py, Table>>,
) -> PyResult<(Bound<'py, PyArray1<u8>>, Vec<String>)> {
    if let Foreign::File(path) = &source {
        // Python's own exception for a file that cannot be opened.
        File::open(path).map_err(|error| file(path, &error))?;
    }
    let table = table.map(|table| PulseScale::of(&table.0));
    let settings = Settings { temperature, interval_ns, session, instance, first_row, table, ..settings_of(origin)? };
    let part = part_of(part)?;
    let named = mapping.as_ref().map(|(name, text)| (name.as_path(), text.as_str()));
    let read = || -> Result<(Vec<u8>, Vec<String>), Failure> {
        let conversion = match source {
            Foreign::Text(text) => Conversion::of_text(Path::new("array"), Cursor::new(text), named, &settings)?,
            Foreign::File(path) => Conversion::open(&isotherm_files::source(path), named, &settings)?,
        };
        let (mut rows, mut bytes) = (part.of_conversion(conversion), Vec::new());
        for sample in &mut rows {
            checkpoint();
            bytes.extend_from_slice(&raw_bytes(&sample?));
        }
        let found = rows.conversion().findings();
        Ok((bytes, found.iter().map(|finding| format!("[{}]: {finding}", finding.name)).collect()))
    };
    let (bytes, findings) = Work::new(None).run(py, read)?.map_err(|failure| exception(failure, named))?;
    Ok((array(py, bytes), findings))
}

pub(crate) fn exception(failure: Failure, mapping: Option<(&Path, &str)>) -> PyErr {
    let line = failure.place.as_ref().and_then(|(_, line)| *line);
    let said = in_python(&failure.message);
    match (failure.exit, mapping) {
        (Exit::Config, Some((name, text))) => {
            let name = name.display().to_string();
            let (whole, known) = (Mapping::from_toml(text).err(), KnownColumns::from_toml(text).err());
            let all = [whole, known].into_iter().flatten();
            let all = all.map(|all| (format!("{name}:{}", all.0.first().map_or(0, |fault| fault.line)), all));
            let mut all_said = all.filter(|(begin, _)| failure.message.starts_with(begin));
            all_said.next().map_or_else(|| PyValueError::new_err(said), |(_, all)| faults(&name, &all))
        }
        (Exit::Data, _) => RecordingFault::new_err((said, line)),
        (Exit::Io, _) => PyOSError::new_err(said),
        _ => PyValueError::new_err(said),
    }
}

/// Writes increments, and the temperatures of samples, as ROS messages in MCAP. `table_file` is the name of the table's
/// file.
#[pyfunction]
pub(crate) fn write_ros(
    py: Python<'_>,
    path: PathBuf,
    table: &Table,
    increments: Values<u8>,
    samples: Option<Values<u8>>,
    table_file: PathBuf,
) -> PyResult<()> {
    let samples = samples.unwrap_or_default();
    let known = RosTable::new(&table.0, &table_file);
    let write = || -> io::Result<()> {
        write_file(&path, |sink| {
            let mut writer = RosWriter::new(sink, &[(0, known.imu())], std::slice::from_ref(&known))?;
            let mut write = |recorded_ns, sample| writer.write(&RecordedRow::new(0, recorded_ns, sample));
            let mut raw = samples.chunks_exact(RAW).map(|record| Fields(record).raw());
            for record in increments.chunks_exact(INCREMENT) {
                checkpoint();
                let increment = Fields(record).increment();
                if let Some(raw) = raw.next() {
                    write(raw.timestamp_ns, StreamSample::Raw(raw))?;
                }
                write(increment.timestamp_ns, StreamSample::Increment(increment))?;
            }
            writer.finish().map(drop)
        })
    };
    Work::new(None).run(py, write)?.map_err(|error| match error.kind() {
        io::ErrorKind::InvalidData => PyValueError::new_err(error.to_string()),
        _ => unwritten(&path, &error),
    })
}
