//! Calibration and verification without a turntable, on arrays and files.

use crate::calibration::campaign_of;
use crate::errors::{CalibrationError, StabilityError, recording};
use crate::offline::{tool, with_lag};
use crate::records::{Fields, RAW, document, python};
use crate::table::Table;
use isotherm_calibration::{
    CampaignSource, GravityOnlyCalibration as Figures, GravityOnlyOptions, Hashed, ScaleFactorChoice, TumbleRecording,
    calibrate_gravity_only as fit, sealed_gravity_only_table, sha256,
};
use isotherm_campaign::Campaign;
use isotherm_recording::{CampaignRow, RawCsvReader, RecordingError};
use isotherm_report::{gravity_only as report, lengths as lengths_report};
use isotherm_verification::{Lengths, LocalGravity, Requirement};
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A recording: the path of a file, or the bytes of rows.
#[derive(FromPyObject)]
pub(crate) enum Recorded<'py> {
    Rows(PyReadonlyArray1<'py, u8>),
    File(PathBuf),
}

/// The result of a calibration without a turntable.
#[pyclass(frozen, module = "isotherm")]
pub struct GravityOnlyCalibration {
    campaign: Campaign,
    figures: Figures,
    source: CampaignSource,
    digests: Vec<String>,
    text: String,
}

/// Calibrates without a turntable. `text` is that of a campaign file called `name`.
#[pyfunction]
#[expect(
    clippy::too_many_arguments,
    clippy::needless_pass_by_value,
    reason = "the options of the command, named in the Python function that calls this"
)]
pub(crate) fn calibrate_gravity_only(
    py: Python<'_>,
    text: &str,
    name: String,
    imu: Option<&str>,
    recordings: Vec<Recorded<'_>>,
    window: f64,
    order: Option<usize>,
    scale_factor: &str,
    misalignment: bool,
    exclude: Vec<usize>,
    temperature_range: Option<[f64; 2]>,
    other_device: bool,
) -> PyResult<GravityOnlyCalibration> {
    let campaign = campaign_of(text, &name, imu)?;
    if !campaign.gravity_only {
        return Err(PyValueError::new_err(format!("{name} has no method = \"gravity-only\"; use calibrate")));
    }
    let found = ScaleFactorChoice::NAMES.iter().find(|(_, known)| *known == scale_factor);
    let Some((choice, _)) = found else {
        return Err(PyValueError::new_err(format!(
            "scale_factor is {scale_factor:?}, give \"auto\", \"single\" or \"split\""
        )));
    };
    let options = GravityOnlyOptions {
        window_s: window,
        order,
        scale_factor: *choice,
        misalignment,
        exclude,
        temperature_range,
        other_device,
    };
    let (mut all, mut digests) = (Vec::new(), Vec::new());
    for (index, recorded) in recordings.iter().enumerate() {
        let (recording, digest) = match recorded {
            Recorded::File(path) => of_file(path).map_err(|error| recording(path, &error))?,
            Recorded::Rows(rows) => {
                let name = format!("recording {}", index + 1);
                let rows = rows.as_slice()?;
                let read = TumbleRecording::read(name.clone(), raw_rows(rows));
                (read.map_err(|error| recording(Path::new(&name), &error))?, sha256(rows))
            }
        };
        all.push(recording);
        digests.push(digest);
    }
    let fitted = py.detach(|| fit(&campaign, &all, &options));
    let figures = fitted.map_err(|error| CalibrationError::new_err(error.to_string()))?;
    let source = CampaignSource {
        tool: tool(),
        time: python(py, "_files", "now")?.call0()?.extract()?,
        campaign: name,
        campaign_sha256: sha256(text.as_bytes()),
        samples_sha256: String::new(),
        ramps_sha256: Vec::new(),
    };
    let text = sealed_gravity_only_table(&campaign, &figures, &source, &digests).map_err(CalibrationError::new_err)?;
    Ok(GravityOnlyCalibration { campaign, figures, source, digests, text })
}

/// Compares the lengths over the standstills of samples with local gravity: the document of `isotherm
/// verify --standstills --json`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn lengths<'py>(
    py: Python<'py>,
    table: &Table,
    samples: PyReadonlyArray1<'py, u8>,
    window: f64,
    gravity_local: Option<f64>,
    other_device: bool,
    require: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let required: Option<Requirement> =
        require.map(str::parse).transpose().map_err(|message| PyValueError::new_err(format!("require: {message}")))?;
    let bytes = samples.as_slice()?;
    let found = py.detach(|| {
        let rows: Vec<_> = with_lag(bytes, &table.0).collect();
        Lengths::of(&table.0, &rows, window, LocalGravity::of(gravity_local, &table.0), other_device)
    });
    let found = found.map_err(|error| StabilityError::new_err(error.to_string()))?;
    document(py, &lengths_report::json(&found, window, required))
}

/// The rows of an array. Messages count them from 0, as in the array.
fn raw_rows(bytes: &[u8]) -> impl Iterator<Item = Result<CampaignRow, RecordingError>> {
    bytes.chunks_exact(RAW).enumerate().map(|(line, record)| {
        Ok(CampaignRow { line: line as u64, set_point_c: 0.0, position: None, sample: Fields(record).raw() })
    })
}

fn of_file(path: &Path) -> Result<(TumbleRecording, String), RecordingError> {
    let mut hashed = Hashed::new(File::open(path)?);
    let recording = of_csv(path.display().to_string(), &mut hashed)?;
    Ok((recording, hashed.finish().1))
}

fn of_csv(name: String, source: impl Read) -> Result<TumbleRecording, RecordingError> {
    let mut reader = RawCsvReader::new(source)?;
    let rows = core::iter::from_fn(|| {
        let sample = reader.next()?;
        let line = reader.line();
        Some(sample.map(|sample| CampaignRow { line, set_point_c: 0.0, position: None, sample }))
    });
    TumbleRecording::read(name, rows)
}

#[pymethods]
impl GravityOnlyCalibration {
    #[getter]
    fn table(&self) -> Table {
        Table::new(self.figures.table.clone(), &self.text)
    }

    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    /// The document of `isotherm calibrate --gravity-only --json`.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &report::json(&self.figures))
    }

    #[pyo3(signature = (path, *, report = None))]
    fn save(&self, py: Python<'_>, path: PathBuf, report: Option<PathBuf>) -> PyResult<()> {
        let mut texts = vec![(path, self.text.clone())];
        texts.extend(report.map(|page| (page, self.html())));
        python(py, "_files", "write_together")?.call1((texts,)).map(drop)
    }

    fn report(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        python(py, "_files", "write_text")?.call1((path, self.html())).map(drop)
    }

    fn __str__(&self) -> String {
        report::text(&self.figures)
    }
}

impl GravityOnlyCalibration {
    fn html(&self) -> String {
        report::html(&self.campaign, &self.figures, &self.source, &self.digests)
    }
}
