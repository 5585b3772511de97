//! The function `calibrate` and its result.

use crate::errors::{CalibrationError, faults, recording};
use crate::offline::tool;
use crate::records::{Fields, RAW, document, python};
use crate::table::Table;
use isotherm_calibration::{
    Accuracy, AlignmentChoice, Calibration as Figures, CalibrationOptions, CampaignSource, Finding, FittedRun, Hashed,
    LagChoice, Measurements, Method, RampCalibration, RampRecording, Severity, calibrate as fit,
    calibrate_ramps as fit_ramps, name, observable, read_measurements, sealed_ramp_table, sealed_table, sha256,
};
use isotherm_campaign::{Campaign, Dwell, select_imu};
use isotherm_client::TimeConstant;
use isotherm_recording::{CampaignCsvReader, CampaignRow, RecordingError, SequenceRule};
use isotherm_report::{calibration, json, ramps};
use isotherm_shared::table::CoefficientTable;
use isotherm_statistics::OrderTable;
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::Value;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Size of a row: a raw sample, the set point and the position \[bytes\].
const ROW: usize = RAW + 16;

/// The result of a calibration.
#[pyclass(frozen, module = "isotherm._isotherm")]
pub struct Calibration {
    campaign: Campaign,
    result: FittedCampaign,
    source: CampaignSource,
    /// File of the samples, or `samples`.
    place: String,
    text: String,
}

/// What the campaign gave.
enum FittedCampaign {
    /// Positions, and the ramps beside them.
    Positions(Box<Figures>),
    /// Ramps alone.
    Ramps(Box<RampCalibration>),
}

/// The sample files that a campaign file's text names; None with ramps alone.
#[pyfunction]
pub(crate) fn samples_of(text: &str, name: &str, imu: Option<&str>) -> PyResult<Option<Vec<String>>> {
    let campaign = campaign_of(text, name, imu)?;
    Ok((!campaign.has_ramps_alone()).then_some(campaign.samples))
}

/// The campaign of `imu`, or the only one.
pub(crate) fn campaign_of(text: &str, name: &str, imu: Option<&str>) -> PyResult<Campaign> {
    let campaigns = Campaign::batch_from_toml(text).map_err(|all| faults(name, &all))?;
    select_imu(campaigns, imu).map_err(|message| PyValueError::new_err(format!("{name}: {message}")))
}

/// Text of a campaign file.
#[pyfunction]
pub(crate) fn read_text(path: PathBuf) -> PyResult<String> {
    crate::table::read_text(&path)
}

/// Calibrates: makes a table from a campaign; `samples` is a path, or the bytes of rows; None with ramps alone.
/// `folder` is that of the campaign file, and `lag` a time constant \[s\], 0 for no transients or None.
#[pyfunction]
#[expect(
    clippy::too_many_arguments,
    reason = "the options of the command, named in the Python function that calls this"
)]
pub(crate) fn calibrate(
    py: Python<'_>,
    text: &str,
    name: String,
    folder: PathBuf,
    samples: Option<&Bound<'_, PyAny>>,
    order: Option<usize>,
    method: &str,
    alignment: Option<bool>,
    exclude: Vec<(f64, u32)>,
    accept: Vec<String>,
    strict: bool,
    other_device: bool,
    lag: Option<f64>,
    imu: Option<&str>,
) -> PyResult<Calibration> {
    let campaign = campaign_of(text, &name, imu)?;
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
    let lag = match lag {
        None => LagChoice::Search,
        Some(0.0) => LagChoice::None,
        Some(seconds) => {
            let checked = TimeConstant::from_seconds(seconds);
            checked.map_err(|error| PyValueError::new_err(format!("lag: {error}")))?;
            LagChoice::Given(seconds)
        }
    };
    let options =
        CalibrationOptions { method: *method, order, alignment, exclude, accept, strict, lag, predecessor_lag_s: None };
    let alone = campaign.has_ramps_alone();
    if !alone {
        observable(&campaign).map_err(|error| failed("", &error))?;
    }
    let no_samples = || PyValueError::new_err("samples: positions need them, and ramps alone have none");
    let (place, (mut measurements, samples_sha256)) = match samples {
        None if alone => (String::new(), Default::default()),
        Some(samples) if !alone => read_samples(py, &campaign, samples)?,
        _ => return Err(no_samples()),
    };
    let (recordings, ramps_sha256) = py.detach(|| read_ramps(&campaign, &folder))?;
    let mut source = CampaignSource {
        tool: tool(),
        time: String::new(),
        campaign: name,
        campaign_sha256: sha256(text.as_bytes()),
        samples_sha256,
        ramps_sha256,
    };
    let result = match campaign.curves.as_ref().filter(|_| alone) {
        Some(file) => {
            let path = folder.join(file);
            let table = CoefficientTable::from_toml(&crate::table::read_text(&path)?, Some(&campaign.imu));
            let table = table.map_err(|all| faults(&path.display().to_string(), &all))?;
            let fitted = py.detach(|| fit_ramps(&campaign, &recordings, &table, options));
            FittedCampaign::Ramps(Box::new(fitted.map_err(|error| failed(&place, &error))?))
        }
        None => {
            measurements.ramps = recordings;
            let fitted = py.detach(|| fit(&campaign, measurements, options));
            FittedCampaign::Positions(Box::new(fitted.map_err(|error| failed(&place, &error))?))
        }
    };
    source.time = python(py, "_files", "now")?.call0()?.extract()?;
    let text = match &result {
        FittedCampaign::Positions(figures) => sealed_table(&campaign, figures, &source),
        FittedCampaign::Ramps(figures) => sealed_ramp_table(&campaign, figures, &source),
    };
    let text = text.map_err(CalibrationError::new_err)?;
    Ok(Calibration { campaign, result, source, place, text })
}

/// What messages call the samples, and what they are with their SHA-256.
fn read_samples(
    py: Python<'_>,
    campaign: &Campaign,
    samples: &Bound<'_, PyAny>,
) -> PyResult<(String, (Measurements, String))> {
    if let Ok(path) = samples.extract::<PathBuf>() {
        let read = py.detach(|| of_file(campaign, &path)).map_err(|e| recording(&path, &e))?;
        return Ok((path.display().to_string(), read));
    }
    let rows: PyReadonlyArray1<'_, u8> = samples.extract()?;
    let rows = rows.as_slice()?;
    let read = py.detach(|| of_rows(campaign, rows));
    Ok(("samples".to_owned(), read.map_err(|error| recording(Path::new("samples"), &error))?))
}

/// The ramps of a campaign file in `folder`, with the SHA-256 of each.
fn read_ramps(campaign: &Campaign, folder: &Path) -> PyResult<(Vec<RampRecording>, Vec<String>)> {
    let one = |path: &Path| {
        let mut hashed = Hashed::new(File::open(path)?);
        let recording = RampRecording::from_csv(path.display().to_string(), &mut hashed)?;
        Ok((recording, hashed.finish().1))
    };
    let paths = campaign.ramps.iter().map(|ramp| folder.join(&ramp.samples));
    let all: PyResult<Vec<_>> = paths.map(|path| one(&path).map_err(|error| recording(&path, &error))).collect();
    Ok(all?.into_iter().unzip())
}

fn of_file(campaign: &Campaign, path: &Path) -> Result<(Measurements, String), RecordingError> {
    let mut hashed = Hashed::new(File::open(path)?);
    let measurements = read_measurements(campaign, CampaignCsvReader::new(&mut hashed)?)?;
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
    let measurements = read_measurements(campaign, rows.chunks_exact(ROW).enumerate().map(row))?;
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

fn failed(place: &str, error: &isotherm_calibration::CalibrationError) -> PyErr {
    use isotherm_calibration::CalibrationError::{Empty, Faults};
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
    /// The calibration of the positions; None with ramps alone.
    fn positions(&self) -> Option<&Figures> {
        match &self.result {
            FittedCampaign::Positions(figures) => Some(figures),
            FittedCampaign::Ramps(_) => None,
        }
    }

    /// The dwells and turns of the gyroscopes.
    fn runs(&self) -> &[FittedRun] {
        self.positions().and_then(|figures| figures.gyroscopes.as_ref()).map_or(&[], |found| &found.runs)
    }
}

#[pymethods]
impl Calibration {
    #[getter]
    fn table(&self) -> Table {
        let table = match &self.result {
            FittedCampaign::Positions(figures) => &figures.table,
            FittedCampaign::Ramps(figures) => &figures.table,
        };
        Table::new(table.clone(), &self.text)
    }

    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    #[getter]
    fn findings(&self) -> Vec<(&'static str, Option<u64>, String)> {
        let findings = match &self.result {
            FittedCampaign::Positions(figures) => &figures.findings,
            FittedCampaign::Ramps(figures) => &figures.findings,
        };
        findings.iter().map(|each| finding("", each)).collect()
    }

    /// The bottom line: of the accelerometers, or of ramps alone.
    #[getter]
    fn accuracy(&self) -> String {
        match &self.result {
            FittedCampaign::Positions(figures) => Accuracy::of(figures).to_string(),
            FittedCampaign::Ramps(figures) => figures.accuracy(),
        }
    }

    /// The bottom line of the gyroscopes.
    #[getter]
    fn gyroscope_accuracy(&self) -> Option<String> {
        self.positions().and_then(Accuracy::of_gyroscopes).map(|accuracy| accuracy.to_string())
    }

    /// The document of `isotherm calibrate --json`.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let locate = |line| format!("{}:{line}", self.place);
        let summary = match &self.result {
            FittedCampaign::Positions(figures) => json::calibration(figures, locate),
            FittedCampaign::Ramps(figures) => json::ramps(figures, locate),
        };
        document(py, &summary)
    }

    /// The order tables by sensor and quantity, as JSON: A1, A2, A3, then the gyroscopes if there are any.
    fn orders(&self) -> String {
        let figures = self.positions().into_iter();
        let gyroscopes =
            figures.clone().filter_map(|figures| figures.gyroscopes.as_ref()).flat_map(|found| &found.orders);
        let sensors = figures.flat_map(|figures| &figures.orders).chain(gyroscopes);
        let tables = sensors.map(|sensor| sensor.iter().map(OrderTable::json).collect());
        Value::Array(tables.collect()).to_string()
    }

    /// The residuals by dwell and axis \[g0\].
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let residuals = self.positions().map_or(&[][..], |figures| &figures.solution.residuals);
        let all: Vec<f64> = residuals.iter().flatten().copied().collect();
        PyArray1::from_vec(py, all).reshape([residuals.len(), 3])
    }

    /// For each dwell: set point, number of the position, first and last row, seconds.
    fn dwells(&self) -> Vec<(f64, u32, u64, u64, f64)> {
        let one = |dwell: &Dwell| {
            let number = self.campaign.positions[dwell.position].number;
            let [first, last] = dwell.lines;
            (dwell.set_point_c, number, first, last, dwell.sums.seconds)
        };
        self.positions().map_or(&[][..], |figures| &figures.dwells).iter().map(one).collect()
    }

    /// The residuals of the gyroscopes by dwell or turn \[arcsec\]; no row without gyroscopes.
    fn gyroscope_residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let all: Vec<f64> = self.runs().iter().flat_map(|run| run.residual).collect();
        PyArray1::from_vec(py, all).reshape([self.runs().len(), 3])
    }

    /// For each dwell and then each turn of the gyroscopes: set point, number, first and last row, seconds.
    fn gyroscope_runs(&self) -> Vec<(f64, u32, u64, u64, f64)> {
        let Some(figures) = self.positions() else { return Vec::new() };
        let one = |run: &FittedRun| {
            let set_point_c = figures.set_points[run.set_point].set_point_c;
            let [first, last] = run.lines;
            (set_point_c, run.place.number(&self.campaign).value(), first, last, run.seconds)
        };
        self.runs().iter().map(one).collect()
    }

    fn html(&self) -> String {
        match &self.result {
            FittedCampaign::Positions(figures) => calibration::html(&self.campaign, figures, &self.source),
            FittedCampaign::Ramps(figures) => ramps::html(&self.campaign, figures, &self.source),
        }
    }
}
