//! Recordings as arrays: files of every format, read and written, and the order of rows.

use crate::connection::imu_id;
use crate::convert::{PartOptions, exception, part_of};
use crate::errors::{RecordingFault, file};
use crate::files::{resolved, unwritten, write_file};
use crate::records::{Fields, INCREMENT, RAW, Values, array, increment_bytes, raw_bytes};
use crate::work::Work;
use isotherm_files::{source, sources};
use isotherm_recording::{IncrementCsvWriter, IncrementLayout, Layout, Observer, Progress, RawCsvWriter};
use isotherm_recording_formats::read::{ImuChoice, Input, RowOrder, Samples};
use isotherm_recording_formats::write::{Format, RowWriter};
use isotherm_shared::names::StreamKind;
use isotherm_shared::wire::{CompensatedIncrement, StreamSample};
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::failure::Failure;
use isotherm_support::finding::Finding;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// The first of these raw samples that is out of order, and why.
pub(crate) fn order_fault(samples: &[u8]) -> Option<(usize, String)> {
    let mut order = RowOrder::default();
    let mut rows = samples.chunks_exact(RAW).map(|record| Fields(record).raw()).enumerate();
    rows.find_map(|(row, sample)| order.check(&sample).err().map(|message| (row, message)))
}

/// Refuses raw samples that are out of order, as the readers of recordings do.
///
/// # Errors
/// `RecordingFault`, with the row.
pub(crate) fn refuse_disorder(name: &str, samples: &[u8]) -> PyResult<()> {
    order_fault(samples).map_or(Ok(()), |(row, message)| {
        Err(RecordingFault::new_err((format!("{name}: row {row}: {message}"), Some(row))))
    })
}

/// What is to be said while data are read.
#[derive(Clone, Default)]
struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    fn take(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Observer for Warnings {
    fn warn(&self, message: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(message.to_owned());
    }
}

/// The raw samples of the pieces of a recording, as bytes, and what the user should know.
#[pyfunction]
pub(crate) fn read_recording<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    imu: Option<&str>,
    part: PartOptions,
) -> PyResult<(Bound<'py, PyArray1<u8>>, Vec<String>)> {
    let paths: Vec<_> = paths.iter().map(|path| resolved(path)).collect();
    for path in &paths {
        // Python's own exception for a file that cannot be opened.
        File::open(path).map_err(|error| file(path, &error))?;
    }
    let input = Input::from(choice_of(imu)?).within(part_of(part)?);
    let warnings = Warnings::default();
    let progress = warnings.clone();
    let read = move || -> Result<(Vec<u8>, Vec<Finding>), Failure> {
        let mut bytes = Vec::new();
        let mut samples = Samples::open(&sources(&paths)?, input, &Progress::new(progress))?;
        for sample in samples.by_ref() {
            checkpoint();
            bytes.extend_from_slice(&raw_bytes(&sample?));
        }
        Ok((bytes, samples.recording().findings()))
    };
    let (bytes, findings) = Work::new(None).run(py, read)?.map_err(|failure| exception(failure, None))?;
    Ok((array(py, bytes), warnings.take().into_iter().chain(findings.iter().map(told)).collect()))
}

/// The increments of a file of any format, as bytes, and what the user should know.
#[pyfunction]
pub(crate) fn read_increments<'py>(
    py: Python<'py>,
    path: PathBuf,
    imu: Option<&str>,
) -> PyResult<(Bound<'py, PyArray1<u8>>, Vec<String>)> {
    let path = resolved(&path);
    // Python's own exception for a file that cannot be opened.
    File::open(&path).map_err(|error| file(&path, &error))?;
    let choice = choice_of(imu)?;
    let warnings = Warnings::default();
    let progress = warnings.clone();
    let read = move || -> Result<(Vec<u8>, Vec<Finding>), Failure> {
        let mut bytes = Vec::new();
        let take = |increment: CompensatedIncrement| {
            checkpoint();
            bytes.extend_from_slice(&increment_bytes(&increment));
        };
        let progress = Progress::new(progress);
        let findings = isotherm_recording_formats::read::read_increments(&source(path), &choice, &progress, take)?;
        Ok((bytes, findings))
    };
    let (bytes, findings) = Work::new(None).run(py, read)?.map_err(|failure| exception(failure, None))?;
    Ok((array(py, bytes), warnings.take().into_iter().chain(findings.iter().map(told)).collect()))
}

/// A finding as a warning says it.
fn told(finding: &Finding) -> String {
    finding.tagged(|line| line.to_string()).to_string()
}

fn choice_of(imu: Option<&str>) -> PyResult<ImuChoice> {
    imu.map_or(Ok(ImuChoice::Any), |imu| imu_id(imu).map(ImuChoice::Only))
}

/// Writes raw samples as a recording of `imu`, in the format that the name of the file says.
#[pyfunction]
pub(crate) fn write_recording(py: Python<'_>, path: PathBuf, samples: Values<u8>, imu: &str) -> PyResult<()> {
    let (format, imu) = (Format::named(&path).map_err(PyValueError::new_err)?, imu_id(imu)?);
    let work = Work::new(None);
    let write = || -> io::Result<()> {
        let all = || samples.chunks_exact(RAW).map(|record| Fields(record).raw());
        let has_temperature = all().any(|raw| raw.telemetry_ns != 0);
        let layout = all().fold(Layout::default(), |layout, raw| layout.with(Layout::of(&StreamSample::Raw(raw))));
        write_file(&path, |sink| {
            let mut writer = match format {
                Format::Csv if all().any(|raw| raw.session != 0) => {
                    RawCsvWriter::of_sessions(sink, has_temperature, layout)?.into()
                }
                Format::Csv => RawCsvWriter::with_layout(sink, "", has_temperature, layout)?.into(),
                Format::Mcap | Format::Ros => RowWriter::mcap(sink, &imu, StreamKind::Raw, layout)?,
            };
            work.rows(0, all()).try_for_each(|raw| writer.write(StreamSample::Raw(raw)))?;
            writer.finish().map(drop)
        })
    };
    work.run(py, write)?.map_err(|error| unwritten(&path, &error))
}

/// Writes increments of `imu` in the format that the name of the file says: as text as `replay` does, or with
/// `delivery` as `feed --delivery` does, otherwise as `record` does.
#[pyfunction]
pub(crate) fn write_increments(
    py: Python<'_>,
    path: PathBuf,
    increments: Values<u8>,
    delivery: bool,
    imu: &str,
) -> PyResult<()> {
    let (format, imu) = (Format::named(&path).map_err(PyValueError::new_err)?, imu_id(imu)?);
    let work = Work::new(None);
    let write = || -> io::Result<()> {
        let all = || increments.chunks_exact(INCREMENT).map(|record| Fields(record).increment());
        let gyroscopes = all().any(|increment| Layout::of(&StreamSample::Increment(increment)).gyroscopes);
        let layout = Layout { gyroscopes, ..Layout::default() };
        write_file(&path, |sink| {
            let mut writer = match format {
                Format::Csv => IncrementCsvWriter::new(sink, IncrementLayout { gyroscopes, delivery })?.into(),
                Format::Mcap | Format::Ros => RowWriter::mcap(sink, &imu, StreamKind::Increment, layout)?,
            };
            work.rows(0, all()).try_for_each(|increment| writer.write(StreamSample::Increment(increment)))?;
            writer.finish().map(drop)
        })
    };
    work.run(py, write)?.map_err(|error| unwritten(&path, &error))
}
