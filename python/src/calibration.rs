//! The functions of calibration and their result.

use crate::connection::imu_id;
use crate::convert::{OriginOptions, PartOptions, part_of, settings_of};
use crate::curves::{Curve, of_calibration};
use crate::errors::{CalibrationError, RecordingFault, TableError, faults, file, in_python};
use crate::records::{Fields, RAW, Values, parsed};
use crate::table::Table;
use crate::value;
use crate::work::Work;
use isotherm_campaign::{Campaign, Dwell, Place, select_imu};
use isotherm_client::TimeConstant;
use isotherm_fit::{
    Accuracy, AlignmentChoice, Calibration as Figures, CalibrationOptions, CalibrationOutcome, FittedRun,
    HashingStream, LagChoice, Method, Reading, ScaleFactorChoice, TableFile, TumbleOptions, WarmUpOptions,
};
use isotherm_pipeline::{CampaignFile, InputOptions, Inputs, JobFailure, JobOutcome, RowSource, Vehicle, VehicleImu};
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_recording_formats::convert::{Foreign, Settings};
use isotherm_recording_formats::read::RowOrder;
use isotherm_shared::table::CoefficientTable;
use isotherm_statistics::{OrderTable, mean};
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::{Finding, name};
use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;
use std::sync::Arc;

/// Size of a row: a raw sample, the set point and the position \[bytes\].
const ROW: usize = RAW + 16;

/// The result of a calibration: all that is shown of it. So it travels between processes without a fit.
#[pyclass(frozen, eq, hash, module = "isotherm._isotherm")]
#[derive(Clone, Default, Deserialize, Serialize)]
pub struct Calibration {
    /// The text of the table file.
    text: String,
    findings: Vec<(String, Option<u64>, String)>,
    /// What the command prints.
    in_words: String,
    accuracy: String,
    gyroscope_accuracy: Option<String>,
    /// The document of `isotherm calibrate turntable --json`.
    summary: String,
    /// The order tables by sensor and quantity, as JSON: A1, A2, A3, then the gyroscopes if there are any.
    orders: String,
    /// By dwell and axis \[g0\]; of a tumble by static pose.
    residuals: Vec<Vec<f64>>,
    dwells: Vec<Run>,
    /// By dwell or turn \[arcsec\].
    gyroscope_residuals: Vec<Vec<f64>>,
    gyroscope_runs: Vec<Run>,
    /// The report.
    html: String,
    /// Of bias, K+ and K- of each sensor, in the units of the table.
    curves: Vec<Curve>,
}

/// A dwell or a turn: set point, number, first and last row, seconds.
type Run = (f64, u32, u64, u64, f64);

/// A recording: the path of a file, or the bytes of rows.
#[derive(FromPyObject)]
pub(crate) enum RecordingSource {
    Rows(Values<u8>),
    File(PathBuf),
}

/// The options of a fit of any kind, checked.
struct FitOptions {
    turntable: CalibrationOptions,
    tumble: TumbleOptions,
    warm_up: WarmUpOptions,
    input: InputOptions,
}

/// The options of the command, with its names.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Options {
    order: Option<usize>,
    method: String,
    alignment: Option<bool>,
    exclude: Vec<(f64, u32)>,
    accept: Vec<String>,
    strict: bool,
    /// \[s\]; 0 for no transients.
    lag: Option<f64>,
    window: Option<f64>,
    scale_factor: String,
    misalignment: bool,
    static_poses: Vec<usize>,
    temperature_range: Option<[f64; 2]>,
    /// Latitude \[deg\] and height \[m\] that check local gravity.
    place: Option<[f64; 2]>,
    foreign: ForeignOptions,
    part: PartOptions,
    /// Reference temperature, and autopilots whose cubics are shown for comparison: at one attitude.
    at: Option<f64>,
    beside: Vec<String>,
}

/// Name and text of a mapping, temperature, interval \[ns\], where the data come from, instance.
type ForeignOptions = (Option<(PathBuf, String)>, Option<f64>, Option<u64>, OriginOptions, Option<u32>);

/// The campaign of `imu`, or the only one.
fn campaign_of(file: &CampaignFile, name: &str, imu: Option<&str>) -> PyResult<Campaign> {
    let campaigns = file.checked().map_err(|all| faults(name, &all))?;
    select_imu(campaigns, imu).map_err(|message| PyValueError::new_err(format!("{name}: {message}")))
}

/// Text of a campaign file.
#[pyfunction]
pub(crate) fn read_text(path: PathBuf) -> PyResult<String> {
    crate::table::read_text(&path)
}

/// Makes a table of a campaign. `path` is that of the campaign file with this `text`, and `recordings` replace those
/// that it names, `None` for these. `is_tumble` says which kind of campaign is expected.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "those of the function of the package, which have names there")]
pub(crate) fn calibrate_campaign(
    py: Python<'_>,
    text: String,
    path: PathBuf,
    imu: Option<&str>,
    recordings: Option<Vec<RecordingSource>>,
    is_tumble: bool,
    options: Options,
    progress: Option<Py<PyAny>>,
) -> PyResult<Calibration> {
    let campaign_file = CampaignFile { path, text };
    let name = campaign_file.name();
    let mut campaign = campaign_of(&campaign_file, &name, imu)?;
    if let Some([latitude_deg, height_m]) = options.place {
        campaign = campaign.at_place(Place::new(latitude_deg, height_m).map_err(PyValueError::new_err)?);
    }
    if campaign.is_tumble != is_tumble {
        let message = match is_tumble {
            true => format!("{name} has no method = \"gravity-only\"; use calibrate_turntable"),
            false => format!("{name} has method = \"gravity-only\"; use calibrate_tumble"),
        };
        return Err(PyValueError::new_err(message));
    }
    if recordings.is_some() && campaign.has_ramps_alone() {
        return Err(PyValueError::new_err("samples: positions need them, and only ramps have none"));
    }
    let options = options.checked()?;
    let given = recordings.is_some();
    let named = || campaign_file.samples(&campaign).map_err(|failure| failed(&JobFailure::from(failure)));
    let recordings = match recordings {
        Some(recordings) => recordings,
        None => named()?.into_iter().map(RecordingSource::File).collect(),
    };
    // Those that the campaign file names are read as it says.
    let rows = if is_tumble { Rows::OfRecordings } else { Rows::OfCampaign };
    let (work, shared) = (Work::new(progress), &recordings);
    let named = campaign_file.ramps(&campaign).into_iter().chain(campaign_file.curves(&campaign));
    for path in recordings.iter().filter_map(RecordingSource::path).cloned().chain(named) {
        fs::metadata(&path).map_err(|error| file(&path, &error))?;
    }
    let bar = work.bar();
    let outcome = work.run(py, || {
        let FitOptions { turntable, tumble, input, .. } = options;
        let sources = if given { sources(shared, rows, &work) } else { Vec::new() };
        let inputs = match is_tumble {
            true => Inputs::tumble(&campaign, Some(&campaign_file), sources, tumble, &input, &bar)?,
            false => Inputs::turntable(&campaign, &campaign_file, sources, turntable, &input, &bar)?,
        };
        inputs.fit(&campaign, Some(&campaign_file))
    });
    Ok(Calibration::new(&campaign, &outcome?.map_err(|refused| failed(&refused))?))
}

/// Makes a table of recordings of a warm-up. Without a `nominal` table they must be files of readings of other
/// programs. `gravity` is 1 g0 \[m/s2\].
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn calibrate_warm_up(
    py: Python<'_>,
    recordings: Vec<RecordingSource>,
    imu: &str,
    nominal: Option<&Table>,
    gravity: Option<f64>,
    options: Options,
    progress: Option<Py<PyAny>>,
) -> PyResult<Calibration> {
    let imu = imu_id(imu)?;
    let options = options.checked()?;
    for path in recordings.iter().filter_map(RecordingSource::path) {
        fs::metadata(path).map_err(|error| file(path, &error))?;
    }
    let nominal = nominal.map(|table| CoefficientTable::clone(&table.0));
    let work = Work::new(progress);
    let bar = work.bar();
    let made = work.run(py, || {
        let (nominal, FitOptions { warm_up, input, .. }) = ((nominal, gravity), options);
        let sources = sources(&recordings, Rows::OfRecordings, &work);
        let (campaign, inputs) = Inputs::warm_up(&imu, sources, nominal, warm_up, &input, &bar)?;
        inputs.fit(&campaign, None).map(|outcome| Calibration::new(&campaign, &outcome))
    });
    made?.map_err(|refused| failed(&refused))
}

/// The number of an IMU in the logs, its calibration, and the exception that refuses it.
type OfVehicle = (u32, Option<Calibration>, Option<PyErr>);

/// Makes a table of each IMU of an autopilot's logs of a warm-up. `nominal` are tables by the number of the IMU in
/// the logs. Each number comes with the calibration, or with the exception that refuses it.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments of a Python function")]
pub(crate) fn calibrate_vehicle(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    imu: &str,
    nominal: HashMap<u32, PyRef<'_, Table>>,
    gravity: Option<f64>,
    options: Options,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<OfVehicle>> {
    let imu = imu_id(imu)?;
    let options = options.checked()?;
    for path in &logs {
        fs::metadata(path).map_err(|error| file(path, &error))?;
    }
    let nominal: HashMap<_, _> =
        nominal.iter().map(|(instance, table)| (*instance, CoefficientTable::clone(&table.0))).collect();
    let work = Work::new(progress);
    let bar = work.bar();
    let made = work.run(py, || {
        let vehicle = Vehicle::of(&imu, &logs, &options.input.foreign, &bar)?;
        let one = |of: &VehicleImu| {
            let (input, instance) = (of.input(&options.input), of.instance.unwrap_or_default());
            let sources = RowSource::files(&logs);
            let nominal = (nominal.get(&instance).cloned(), gravity);
            let read = Inputs::warm_up(&of.imu, sources, nominal, options.warm_up.clone(), &input, &bar);
            let calibration = read.and_then(|(campaign, inputs)| {
                inputs.fit(&campaign, None).map(|outcome| Calibration::new(&campaign, &outcome))
            });
            (instance, calibration)
        };
        Ok::<_, Failure>(vehicle.imus.iter().map(one).collect::<Vec<_>>())
    });
    let made = made?.map_err(|failure| failed(&JobFailure::from(failure)))?;
    let split = |(instance, made): (u32, Result<Calibration, JobFailure>)| -> OfVehicle {
        match made {
            Ok(made) => (instance, Some(made), None),
            Err(refused) => (instance, None, Some(failed(&refused))),
        }
    };
    Ok(made.into_iter().map(split).collect())
}

impl RecordingSource {
    fn path(&self) -> Option<&PathBuf> {
        if let Self::File(path) = self { Some(path) } else { None }
    }
}

/// The names of findings that the user accepts.
pub(crate) fn accepted(names: &[String]) -> PyResult<Vec<&'static str>> {
    let names = names.iter().map(|text| name::acceptable(text)).collect::<Result<Vec<_>, _>>();
    names.map_err(|message| PyValueError::new_err(format!("accept: {message}")))
}

impl Options {
    fn checked(self) -> PyResult<FitOptions> {
        let wrong = |message: String| Err(PyValueError::new_err(message));
        let Some((method, _)) = Method::NAMES.iter().find(|(_, known)| *known == self.method) else {
            return wrong(format!("method is {:?}, give \"one-stage\" or \"two-stage\"", self.method));
        };
        let Some((choice, _)) = ScaleFactorChoice::NAMES.iter().find(|(_, known)| *known == self.scale_factor) else {
            return wrong(format!("scale_factor is {:?}, give \"auto\", \"single\" or \"split\"", self.scale_factor));
        };
        if let Some(order) = self.order.filter(|order| *order > 7) {
            return wrong(format!("order is {order}, give \"auto\" or a whole number from 0 to 7"));
        }
        let accept = accepted(&self.accept)?;
        let lag = match self.lag {
            None => LagChoice::Search,
            Some(0.0) => LagChoice::None,
            Some(seconds) => {
                let checked = TimeConstant::from_seconds(seconds);
                checked.map_err(|error| PyValueError::new_err(format!("lag: {error}")))?;
                LagChoice::Given(seconds)
            }
        };
        let (mapping, temperature, interval_ns, origin, instance) = self.foreign;
        let settings = Settings { temperature, interval_ns, instance, ..settings_of(origin)? };
        let part = part_of(self.part)?;
        let beside = self.beside.iter().map(|name| name.parse()).collect::<Result<Vec<_>, String>>();
        let beside = beside.map_err(|message| PyValueError::new_err(format!("beside: {message}")))?;
        Ok(FitOptions {
            warm_up: WarmUpOptions {
                on_board: Vec::new(),
                order: self.order,
                highest_order: None,
                lag,
                at: self.at,
                beside,
                accept: accept.clone(),
                strict: self.strict,
            },
            turntable: CalibrationOptions {
                method: *method,
                order: self.order,
                alignment: AlignmentChoice::of(self.alignment == Some(true), self.alignment == Some(false)),
                exclude: self.exclude,
                accept: accept.clone(),
                strict: self.strict,
                lag,
                predecessor_lag_s: None,
                ..CalibrationOptions::default()
            },
            tumble: TumbleOptions {
                window_s: self.window,
                order: self.order,
                scale_factor: *choice,
                misalignment: self.misalignment,
                exclude: self.static_poses,
                temperature_range: self.temperature_range,
                accept,
                strict: self.strict,
            },
            input: InputOptions { symptoms: false, foreign: Foreign { mapping, settings }, part },
        })
    }
}

/// What the rows of arrays are.
#[derive(Clone, Copy)]
enum Rows {
    OfRecordings,
    OfCampaign,
}

/// The recordings as the job takes them.
fn sources<'a>(recordings: &'a [RecordingSource], rows_are: Rows, work: &Arc<Work>) -> Vec<RowSource<'a>> {
    let source = |(index, recorded): (usize, &'a RecordingSource)| match recorded {
        RecordingSource::File(path) => RowSource::File(path.clone()),
        RecordingSource::Rows(rows) => {
            let bytes = &**rows;
            let sha256 = sha256_of(bytes);
            match rows_are {
                Rows::OfRecordings => {
                    let rows = work.rows(bytes.len() / RAW, raw_rows(bytes));
                    RowSource::Rows { name: format!("recording {}", index + 1), sha256, rows: Box::new(rows) }
                }
                Rows::OfCampaign => {
                    let rows = work.rows(bytes.len() / ROW, campaign_rows(bytes));
                    RowSource::Rows { name: "samples".to_owned(), sha256, rows: Box::new(rows) }
                }
            }
        }
    };
    recordings.iter().enumerate().map(source).collect()
}

/// The SHA-256 of an array, with checkpoints.
fn sha256_of(bytes: &[u8]) -> String {
    let mut hash = HashingStream::new(io::sink());
    for part in bytes.chunks(1 << 20) {
        checkpoint();
        // A sink takes all.
        let _ = hash.write_all(part);
    }
    hash.finish().1
}

/// The raw samples of an array. Messages count them from 0, as in the array.
fn raw_rows(bytes: &[u8]) -> impl Iterator<Item = Result<CampaignRow, RecordingError>> + Send {
    let mut order = RowOrder::default();
    bytes.chunks_exact(RAW).enumerate().map(move |(row, record)| {
        let (line, sample) = (row as u64, Fields(record).raw());
        order.check(&sample).map_err(|message| RecordingError::Data { line, message })?;
        Ok(CampaignRow { line, set_point_c: 0.0, position: None, sample })
    })
}

/// The rows of a campaign in an array. Messages count them from 0, as in the array.
fn campaign_rows(bytes: &[u8]) -> impl Iterator<Item = Result<CampaignRow, RecordingError>> + Send {
    let mut order = RowOrder::default();
    bytes.chunks_exact(ROW).enumerate().map(move |(line, bytes)| {
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
        if let Err(message) = order.check(&sample) {
            return fault(message);
        }
        Ok(CampaignRow { line, set_point_c, position, sample })
    })
}

/// Severity, line and the rest of the line that the command prints: `[name]: message`.
fn finding(finding: &Finding, locate: impl Fn(u64) -> String) -> (&'static str, Option<u64>, String) {
    (finding.severity.name(), finding.line, in_python(&format!("[{}]: {}", finding.name, finding.located(locate))))
}

/// The exception of what the command would end with.
fn failed(JobFailure { failure, fit, .. }: &JobFailure) -> PyErr {
    use isotherm_fit::CalibrationError::Faults;
    let message = in_python(&failure.message);
    match (fit.as_deref(), failure.exit) {
        (Some((Faults { diagnosis, findings }, places)), _) => {
            // The mistake that explains them is the first, as it is in the message.
            let first = diagnosis.as_deref().map(|diagnosis| &diagnosis.finding);
            let all = first.into_iter().chain(findings).map(|each| finding(each, |line| places.locate(line)));
            CalibrationError::new_err((message, all.collect::<Vec<_>>()))
        }
        (Some(_), _) => CalibrationError::new_err(message),
        (None, Exit::Config) => TableError::new_err((message, Vec::<(usize, String, String)>::new())),
        (None, Exit::Usage) => PyValueError::new_err(message),
        (None, Exit::Data) => {
            let line = failure.place.as_ref().and_then(|(_, line)| *line);
            RecordingFault::new_err((message, line))
        }
        (None, _) => PyOSError::new_err(message),
    }
}

impl Calibration {
    /// What a job has found.
    fn new(campaign: &Campaign, outcome: &JobOutcome) -> Self {
        let row = |line: u64| line.to_string();
        let findings = outcome.fitted.findings().iter();
        let findings = findings.map(|each| finding(&Finding { line: None, ..each.clone() }, row));
        let found = Self {
            text: outcome.table.clone(),
            findings: findings.map(|(severity, line, message)| (severity.to_owned(), line, message)).collect(),
            in_words: outcome.text(),
            accuracy: outcome.fitted.accuracy(),
            summary: outcome.json().to_string(),
            orders: Value::Array(Vec::new()).to_string(),
            html: outcome.html(campaign),
            // The table was made here, and is read without a fault.
            curves: TableFile::from_toml("table", &outcome.table)
                .map(|table| of_calibration(&outcome.fitted, campaign, &table))
                .unwrap_or_default(),
            ..Self::default()
        };
        match &outcome.fitted {
            CalibrationOutcome::Campaign(figures) => found.with_positions(campaign, figures),
            CalibrationOutcome::Tumble(figures) => Self {
                residuals: figures.residuals.iter().map(|residual| vec![*residual]).collect(),
                dwells: figures.readings.iter().map(static_pose).collect(),
                ..found
            },
            CalibrationOutcome::Ramps(_) | CalibrationOutcome::WarmUp(_) => found,
        }
    }

    /// With what a campaign on a turntable has of its positions and turns.
    fn with_positions(self, campaign: &Campaign, figures: &Figures) -> Self {
        let gyroscopes = figures.gyroscopes.as_ref();
        let sensors = figures.orders.iter().chain(gyroscopes.iter().flat_map(|found| &found.orders));
        let orders = sensors.map(|sensor| sensor.iter().map(OrderTable::json).collect());
        let runs = gyroscopes.map_or(&[][..], |found| &found.runs);
        let dwell = |dwell: &Dwell| {
            let [first, last] = dwell.lines;
            (dwell.set_point_c, campaign.positions[dwell.position].number, first, last, dwell.sums.seconds)
        };
        let run = |run: &FittedRun| {
            let [first, last] = run.lines;
            let set_point_c = figures.set_points[run.set_point].set_point_c;
            (set_point_c, run.place.number(campaign).value(), first, last, run.seconds)
        };
        Self {
            gyroscope_accuracy: Accuracy::of_gyroscopes(figures).map(|accuracy| accuracy.to_string()),
            orders: Value::Array(orders.collect()).to_string(),
            residuals: figures.solution.residuals.iter().map(|residuals| residuals.to_vec()).collect(),
            dwells: figures.dwells.iter().map(dwell).collect(),
            gyroscope_residuals: runs.iter().map(|run| run.residual.to_vec()).collect(),
            gyroscope_runs: runs.iter().map(run).collect(),
            ..self
        }
    }
}

/// A static pose as a dwell: its mean head temperature is that of the set point, and its rows are those of its
/// recording, from 0.
fn static_pose(reading: &Reading) -> Run {
    let number = u32::try_from(reading.number).unwrap_or(u32::MAX);
    let [first, last] = [reading.rows.start, reading.rows.end.saturating_sub(1)].map(|row| row as u64);
    (mean(&reading.head), number, first, last, reading.seconds)
}

/// Rows of equal length as an array of two dimensions, of `columns` where there are none.
fn matrix<'py>(py: Python<'py>, rows: &[Vec<f64>], columns: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let columns = rows.first().map_or(columns, Vec::len);
    PyArray1::from_vec(py, rows.concat()).reshape([rows.len(), columns])
}

#[pymethods]
impl Calibration {
    #[getter]
    fn table(&self) -> PyResult<Table> {
        value::Value::of(self.text.clone())
    }

    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    #[getter]
    fn findings(&self) -> Vec<(String, Option<u64>, String)> {
        self.findings.clone()
    }

    /// What the command prints: the bottom line, the curves, the static poses.
    fn __str__(&self) -> &str {
        &self.in_words
    }

    #[getter]
    fn accuracy(&self) -> &str {
        &self.accuracy
    }

    #[getter]
    fn gyroscope_accuracy(&self) -> Option<&str> {
        self.gyroscope_accuracy.as_deref()
    }

    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        parsed(py, &self.summary)
    }

    fn orders(&self) -> &str {
        &self.orders
    }

    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.residuals, 3)
    }

    fn dwells(&self) -> Vec<Run> {
        self.dwells.clone()
    }

    fn gyroscope_residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.gyroscope_residuals, 3)
    }

    fn gyroscope_runs(&self) -> Vec<Run> {
        self.gyroscope_runs.clone()
    }

    /// The curves of bias, K+ and K- of each sensor, in the units of the table.
    fn curves(&self) -> Vec<Curve> {
        self.curves.clone()
    }

    fn html(&self) -> &str {
        &self.html
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<value::Reduced<'py>> {
        value::reduced(py, self)
    }
}
