//! The function `calibrate` and its result.

use crate::errors::{CalibrationError, faults, recording};
use crate::offline::tool;
use crate::records::{Fields, RAW, document, python};
use crate::table::Table;
use isotherm_calibration::accuracy::Accuracy;
use isotherm_calibration::alignment::AlignmentChoice;
use isotherm_calibration::calibrate::{Calibration as Figures, CalibrationOptions, Method};
use isotherm_calibration::campaign::{Campaign, Dwell};
use isotherm_calibration::checks::{Finding, Severity, name};
use isotherm_calibration::gyroscopes::{FittedRun, Measurements, calibrate as fit, observable, read};
use isotherm_calibration::order::OrderTable;
use isotherm_calibration::provenance::{CampaignSource, Hashed, sealed_table, sha256};
use isotherm_calibration::report::calibration::html;
use isotherm_calibration::report::json;
use isotherm_recording::{CampaignCsvReader, CampaignRow, RecordingError, SequenceRule};
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Size of a row: a raw sample, the set point and the position \[bytes\].
const ROW: usize = RAW + 16;

/// The result of a calibration.
#[pyclass(frozen, module = "isotherm._isotherm")]
pub struct Calibration {
    campaign: Campaign,
    figures: Figures,
    source: CampaignSource,
    /// File of the samples, or `samples`.
    place: String,
    text: String,
}

/// The sample files that a campaign file's text names.
#[pyfunction]
pub fn samples_of(text: &str, name: &str) -> PyResult<Vec<String>> {
    Campaign::from_toml(text).map(|campaign| campaign.samples).map_err(|all| faults(name, &all))
}

/// Text of a campaign file.
#[pyfunction]
pub fn read_text(path: PathBuf) -> PyResult<String> {
    crate::table::read_text(&path)
}

/// Calibrates: makes a table from a campaign; `samples` is a path, or the bytes of rows.
#[pyfunction]
#[expect(
    clippy::too_many_arguments,
    reason = "the options of the command, named in the Python function that calls this"
)]
pub fn calibrate(
    py: Python<'_>,
    text: &str,
    name: String,
    samples: &Bound<'_, PyAny>,
    order: Option<usize>,
    method: &str,
    alignment: Option<bool>,
    exclude: Vec<(f64, u32)>,
    accept: Vec<String>,
    strict: bool,
    other_device: bool,
) -> PyResult<Calibration> {
    let campaign = Campaign::from_toml(text).map_err(|all| faults(&name, &all))?;
    let found = Method::NAMES.iter().find(|(_, known)| *known == method);
    let Some((method, _)) = found else {
        return Err(PyValueError::new_err(format!("method is {method:?}, give \"one-stage\" or \"two-stage\"")));
    };
    if let Some(order) = order.filter(|order| *order > 7) {
        return Err(PyValueError::new_err(format!("order is {order}, give None or 0 to 7")));
    }
    let accept = accept.iter().map(|text| name::acceptable(text)).collect::<Result<Vec<_>, _>>();
    let mut accept = accept.map_err(|message| PyValueError::new_err(format!("accept: {message}")))?;
    accept.extend(other_device.then_some(name::OTHER_DEVICE));
    let alignment = AlignmentChoice::of(alignment == Some(true), alignment == Some(false));
    let options = CalibrationOptions { method: *method, order, alignment, exclude, accept, strict };
    observable(&campaign).map_err(|error| failed("", &error))?;
    let (place, (measurements, samples_sha256)) = match samples.extract::<PathBuf>() {
        Ok(path) => {
            (path.display().to_string(), py.detach(|| of_file(&campaign, &path)).map_err(|e| recording(&path, &e))?)
        }
        Err(_) => {
            let rows: PyReadonlyArray1<'_, u8> = samples.extract()?;
            let rows = rows.as_slice()?;
            let read = py.detach(|| of_rows(&campaign, rows));
            ("samples".to_owned(), read.map_err(|error| recording(Path::new("samples"), &error))?)
        }
    };
    let figures = py.detach(|| fit(&campaign, measurements, options)).map_err(|error| failed(&place, &error))?;
    let source = CampaignSource {
        tool: tool(),
        time: python(py, "_files", "now")?.call0()?.extract()?,
        campaign: name,
        campaign_sha256: sha256(text.as_bytes()),
        samples_sha256,
    };
    let text = sealed_table(&campaign, &figures, &source).map_err(CalibrationError::new_err)?;
    Ok(Calibration { campaign, figures, source, place, text })
}

fn of_file(campaign: &Campaign, path: &Path) -> Result<(Measurements, String), RecordingError> {
    let mut hashed = Hashed::new(File::open(path)?);
    let measurements = read(campaign, CampaignCsvReader::new(&mut hashed)?)?;
    Ok((measurements, hashed.finish().1))
}

/// The dwells and turns of an array's rows. Messages count the rows from 0, as in the array.
fn of_rows(campaign: &Campaign, rows: &[u8]) -> Result<(Measurements, String), RecordingError> {
    let mut rule = SequenceRule::default();
    let row = |(line, bytes): (usize, &[u8])| {
        let mut fields = Fields(bytes);
        let (sample, set_point_c, position) = (fields.raw(), fields.float(), fields.signed());
        let line = line as u64;
        let fault = |message: String| Err(RecordingError::Data { line, message });
        if !set_point_c.is_finite() {
            return fault(format!("set_point_c is {set_point_c}, give the chamber's set point in degC"));
        }
        let position = match position {
            -1 => None,
            number => match u32::try_from(number) {
                Ok(number) => Some(number),
                Err(_) => {
                    return fault(format!(
                        "position is {number}, give a position's number, or -1 while the turntable moves"
                    ));
                }
            },
        };
        if let Err(message) = rule.check(&sample) {
            return fault(message);
        }
        Ok(CampaignRow { line, set_point_c, position, sample })
    };
    let measurements = read(campaign, rows.chunks_exact(ROW).enumerate().map(row))?;
    Ok((measurements, sha256(rows)))
}

/// Severity, line and the rest of the line that the command prints: `[name]: message`.
fn finding(place: &str, finding: &Finding) -> (&'static str, Option<u64>, String) {
    let severity = if finding.severity == Severity::Warning { "warning" } else { "fault" };
    let located = match finding.line {
        Some(line) if !place.is_empty() => format!("{place}:{line}: {finding}"),
        _ => finding.to_string(),
    };
    (severity, finding.line, format!("[{}]: {located}", finding.name))
}

fn failed(place: &str, error: &isotherm_calibration::calibrate::CalibrationError) -> PyErr {
    use isotherm_calibration::calibrate::CalibrationError::{Empty, Faults};
    match error {
        Faults { diagnosis, findings } => {
            let locate = |line| if place.is_empty() { format!("row {line}") } else { format!("{place}:{line}") };
            let lines = error.lines(false, |each| each.tagged(locate));
            // The mistake that explains them is the first, as it is in the message.
            let first = diagnosis.as_deref().map(|diagnosis| &diagnosis.finding);
            let all: Vec<_> = first.into_iter().chain(findings).map(|each| finding(place, each)).collect();
            CalibrationError::new_err((lines.join("\n"), all))
        }
        Empty => CalibrationError::new_err(format!("{place}: {error}")),
        _ => CalibrationError::new_err(error.to_string()),
    }
}

impl Calibration {
    /// The dwells and turns of the gyroscopes.
    fn runs(&self) -> &[FittedRun] {
        self.figures.gyroscopes.as_ref().map_or(&[], |found| &found.runs)
    }
}

#[pymethods]
impl Calibration {
    #[getter]
    fn table(&self) -> Table {
        Table(Arc::new(self.figures.table.clone()))
    }

    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    #[getter]
    fn findings(&self) -> Vec<(&'static str, Option<u64>, String)> {
        self.figures.findings.iter().map(|each| finding("", each)).collect()
    }

    /// The bottom line of the accelerometers.
    #[getter]
    fn accuracy(&self) -> String {
        Accuracy::of(&self.figures).to_string()
    }

    /// The bottom line of the gyroscopes.
    #[getter]
    fn gyroscope_accuracy(&self) -> Option<String> {
        Accuracy::of_gyroscopes(&self.figures).map(|accuracy| accuracy.to_string())
    }

    /// The document of `isotherm calibrate --json`.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &json::calibration(&self.figures, |line| format!("{}:{line}", self.place)))
    }

    /// The order tables by sensor and quantity, as JSON: A1, A2, A3, then the gyroscopes if there are any.
    fn orders(&self) -> String {
        let gyroscopes = self.figures.gyroscopes.iter().flat_map(|found| &found.orders);
        let sensors = self.figures.orders.iter().chain(gyroscopes);
        let tables = sensors.map(|sensor| sensor.iter().map(OrderTable::json).collect());
        Value::Array(tables.collect()).to_string()
    }

    /// The residuals by dwell and axis \[g0\].
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all: Vec<f64> = self.figures.solution.residuals.iter().flatten().copied().collect();
        PyArray1::from_vec(py, all).reshape([self.figures.dwells.len(), 3])
    }

    /// For each dwell: set point, number of the position, first and last row, seconds.
    fn dwells(&self) -> Vec<(f64, u32, u64, u64, f64)> {
        let one = |dwell: &Dwell| {
            let number = self.campaign.positions[dwell.position].number;
            let [first, last] = dwell.lines;
            (dwell.set_point_c, number, first, last, dwell.sums.seconds)
        };
        self.figures.dwells.iter().map(one).collect()
    }

    /// The residuals of the gyroscopes by dwell or turn \[arcsec\]; no row without gyroscopes.
    fn gyroscope_residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all: Vec<f64> = self.runs().iter().flat_map(|run| run.residual).collect();
        PyArray1::from_vec(py, all).reshape([self.runs().len(), 3])
    }

    /// For each dwell and then each turn of the gyroscopes: set point, number, first and last row, seconds.
    fn gyroscope_runs(&self) -> Vec<(f64, u32, u64, u64, f64)> {
        let one = |run: &FittedRun| {
            let set_point_c = self.figures.set_points[run.set_point].set_point_c;
            let [first, last] = run.lines;
            (set_point_c, run.place.number(&self.campaign).value(), first, last, run.seconds)
        };
        self.runs().iter().map(one).collect()
    }

    fn html(&self) -> String {
        html(&self.campaign, &self.figures, &self.source)
    }
}
