//! The offline tools on arrays. The libraries do the arithmetic; this module converts arguments and results.

use crate::errors::{StabilityError, in_python};
use crate::recordings::{order_fault, refuse_disorder};
use crate::records::{
    Fields, INCREMENT, RAW, Values, array, document, increment_bytes, increments, python, screen, view,
};
use crate::table::Table;
use crate::value::{Reduced, Value, reduced};
use crate::work::Work;
use isotherm_fit::{Origin, tool};
use isotherm_pipeline::now;
use isotherm_recording::Continuity;
use isotherm_report::json::verification;
use isotherm_report::verification::{VerificationSource, html as report_html};

use isotherm_shared::compensate::answer;
use isotherm_shared::lag::{LagCompletion, ReadingLimits};
use isotherm_shared::sequence::Period;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::RawSample;
use isotherm_statistics::{
    DataPoint, DoubleDouble, LinearColumn, MAX_ORDER, OrderTable, Regression, Rule, default_order,
};
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::finding::{Finding, name};
use isotherm_verification::{Collector, LocalGravity, Requirement, Setup, Stability as Figures};
use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;
use std::path::PathBuf;

/// The increments of raw samples; samples and increments are bytes.
#[pyfunction]
pub(crate) fn replay<'py>(
    py: Python<'py>,
    table: &Table,
    samples: Values<u8>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let out = increments(py, samples.len() / RAW);
    let mut writable = out.readwrite();
    let places = writable.as_slice_mut()?;
    let work = Work::new(progress);
    work.run(py, || {
        for (sample, place) in
            work.rows(samples.len() / RAW, with_lag(&samples, &table.0)).zip(places.chunks_exact_mut(INCREMENT))
        {
            place.copy_from_slice(&increment_bytes(&answer(Some(&table.0), &sample)));
        }
    })?;
    drop(writable);
    Ok(out)
}

/// What the commands refuse or warn of: rows out of order, intervals that are not the time from row to row, lost time,
/// missing rows, scale factors of another interval.
#[pyfunction]
pub(crate) fn time_warnings(py: Python<'_>, table: &Table, samples: Values<u8>) -> PyResult<Vec<String>> {
    let rows = samples.chunks_exact(RAW).map(|record| Period::from(&Fields(record).raw()));
    Work::new(None).run(py, || {
        let out_of_order = order_fault(&samples).map(|(row, message)| format!("row {row}: {message}"));
        let rows = rows.enumerate().inspect(|(row, _)| {
            if row % 4096 == 0 {
                checkpoint();
            }
        });
        let continuity: Continuity = rows.map(|(_, period)| period).collect();
        let found = continuity.findings(0.0).into_iter().chain(continuity.not_nominal(&table.0));
        out_of_order.into_iter().chain(found.map(|finding| finding.message)).collect()
    })
}

/// The samples of an array. If none has a time constant, the lagged temperature is computed with the table's, as the
/// commands do for a recording without it; each session begins soaked.
pub(crate) fn with_lag(samples: &[u8], table: &CoefficientTable) -> impl Iterator<Item = RawSample> {
    let all = || samples.chunks_exact(RAW).map(|record| Fields(record).raw());
    let has_lag = table.lag_ns() == 0 || all().any(|sample| sample.lag_ns != 0);
    let mut lag = LagCompletion::new(table.lag_ns());
    lag.set_limits(Some(ReadingLimits::of(table)));
    all().map(move |mut sample| {
        lag.complete(&mut sample, has_lag);
        sample
    })
}

/// One polynomial regression with its order table, as the JSON document of `isotherm regress --json`.
#[pyfunction]
pub(crate) fn regress(
    py: Python<'_>,
    x: Values<f64>,
    y: Values<f64>,
    weights: Option<Values<f64>>,
    linear: Vec<(String, Values<f64>)>,
    max_order: Option<usize>,
    min_effect: Option<f64>,
) -> PyResult<String> {
    if x.len() != y.len() || weights.as_ref().is_some_and(|weights| weights.len() != x.len()) {
        return Err(PyValueError::new_err("x, y and weights must be of one length"));
    }
    if let Some(order) = max_order.filter(|order| !(1..=MAX_ORDER).contains(order)) {
        return Err(PyValueError::new_err(format!("max_order is {order}, give 1 to {MAX_ORDER}")));
    }
    if let Some(effect) = min_effect.filter(|effect| !(effect.is_finite() && *effect >= 0.0)) {
        return Err(PyValueError::new_err(format!("min_effect is {effect}, give a number from 0")));
    }
    let document = Work::new(None).run(py, || {
        let points = (0..x.len())
            .map(|i| point(i, x[i], y[i], weights.as_ref().map(|weights| weights[i])))
            .collect::<Result<_, _>>()?;
        let column = |(name, values): &(String, Values<f64>)| {
            let values =
                values.iter().enumerate().map(|(i, value)| decimal(name, i, *value)).collect::<Result<_, _>>()?;
            Ok::<_, String>(LinearColumn { name: name.clone(), values })
        };
        let linear: Vec<_> = linear.iter().map(column).collect::<Result<_, _>>()?;
        let order = max_order.unwrap_or_else(|| default_order(&x, linear.len()));
        let regression = Regression::with_linear(points, "x", linear, order).map_err(|error| error.to_string())?;
        Ok::<_, String>(OrderTable::choose(regression, &Rule { effect: min_effect, ..Rule::default() }).json())
    });
    document?.map(|document| document.to_string()).map_err(PyValueError::new_err)
}

/// The shortest decimal number that reads back to `value`, as a file would contain it; `name[index]` stands in the
/// error.
fn decimal(name: &str, index: usize, value: f64) -> Result<DoubleDouble, String> {
    DoubleDouble::parse(&format!("{value:?}"))
        .ok_or_else(|| format!("{name}[{index}] is {value:?}, give a finite number, 0 or of size 1e-140 to 1e140"))
}

fn point(index: usize, x: f64, y: f64, weight: Option<f64>) -> Result<DataPoint, String> {
    let weight = weight.map_or(Ok(DoubleDouble::ONE), |weight| decimal("weights", index, weight))?;
    if weight > DoubleDouble::ZERO {
        Ok(DataPoint { x: decimal("x", index, x)?, y: decimal("y", index, y)?, weight })
    } else {
        Err(format!("weights[{index}] is not over 0"))
    }
}

/// Stability of an output by axis. The figures are of (mean of a window - specific force) [g0], over all windows that
/// count.
///
/// >>> table = isotherm.calibrate_turntable("campaign/campaign.toml").table
/// >>> stability = isotherm.verify(table, isotherm.read_recording("still.csv"), attitude=(0.6, -0.48, 0.64))
/// >>> [(bound, met) for bound, met, message in stability.judge("bias=100ug0,factor=5")]
/// [('factor', True), ('bias', True)]
#[pyclass(frozen, eq, hash, module = "isotherm")]
pub struct Stability {
    table: Table,
    figures: Figures,
    window_s: f64,
    recording: String,
}

/// What is required: a factor of stability, or bounds as the command takes them.
#[derive(FromPyObject)]
enum Require {
    Factor(f64),
    Bounds(String),
}

impl Require {
    fn requirement(self) -> PyResult<Requirement> {
        let text = match self {
            Self::Factor(factor) => factor.to_string(),
            Self::Bounds(text) => text,
        };
        text.parse().map_err(|message| PyValueError::new_err(format!("require: {message}")))
    }
}

/// Computes the stability before and after compensation.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "those of the function of the package, which have names there")]
pub(crate) fn verify(
    py: Python<'_>,
    table: &Table,
    samples: Values<u8>,
    window: f64,
    attitude: Option<[f64; 3]>,
    angles: Option<[f64; 2]>,
    gravity_local: Option<f64>,
    other_device: bool,
    accept: Vec<String>,
    recording: String,
    progress: Option<Py<PyAny>>,
) -> PyResult<Stability> {
    let accepts_holes = crate::calibration::accepted(&accept)?.contains(&name::NOT_COVERED);
    let setup = Setup { other_device, ..Setup::new(attitude, LocalGravity::of(gravity_local, &table.0)) };
    let setup = setup.at_angles(&table.0, angles).map_err(|message| PyValueError::new_err(in_python(&message)))?;
    let work = Work::new(progress);
    let figures = work.run(py, || {
        refuse_disorder(&recording, &samples)?;
        let mut collector = Collector::new(&table.0, window);
        work.rows(samples.len() / RAW, with_lag(&samples, &table.0)).for_each(|sample| collector.add(&sample));
        let made_the_table = Origin::of_toml(table.text(), &table.0).is_made_from(collector.marks(), "");
        let found = collector.finish(&setup);
        let found = found.map_err(|error| StabilityError::new_err(in_python(&error.to_string())))?;
        Ok::<_, PyErr>(Figures { made_the_table, accepts_holes, ..found })
    })??;
    Ok(Stability { table: table.share(), figures, window_s: window, recording })
}

impl Stability {
    fn by_axis(&self, of: impl Fn(&isotherm_verification::AxisStability) -> f64) -> (f64, f64, f64) {
        let [a1, a2, a3] = &self.figures.axes;
        (of(a1), of(a2), of(a3))
    }
}

impl Value for Stability {
    const NAME: &'static str = "Stability";
    /// The text of the table, the figures, the length of a window, and the name of the recording.
    type State = (String, Figures, f64, String);

    fn state(&self) -> Cow<'_, Self::State> {
        Cow::Owned((self.table.text().to_owned(), self.figures.clone(), self.window_s, self.recording.clone()))
    }

    fn of((table, figures, window_s, recording): Self::State) -> PyResult<Self> {
        Ok(Self { table: Table::of(table)?, figures, window_s, recording })
    }
}

#[pymethods]
impl Stability {
    /// Standard deviation with the coefficients frozen at mid temperature.
    #[getter]
    fn sd_before(&self) -> (f64, f64, f64) {
        self.by_axis(|axis| axis.sd_before)
    }

    /// Root mean square with the coefficients frozen at mid temperature.
    #[getter]
    fn rms_before(&self) -> (f64, f64, f64) {
        self.by_axis(|axis| axis.rms_before)
    }

    /// Standard deviation of the full model.
    #[getter]
    fn sd_after(&self) -> (f64, f64, f64) {
        self.by_axis(|axis| axis.sd_after)
    }

    /// Root mean square of the full model.
    #[getter]
    fn rms_after(&self) -> (f64, f64, f64) {
        self.by_axis(|axis| axis.rms_after)
    }

    /// Ratio of the standard deviations, before / after.
    #[getter]
    fn factor(&self) -> (f64, f64, f64) {
        self.by_axis(isotherm_verification::AxisStability::factor)
    }

    /// The specific force, which is subtracted from the outputs [g0].
    #[getter]
    fn specific_force(&self) -> (f64, f64, f64) {
        self.figures.specific_force.into()
    }

    /// Whether the attitude was given; otherwise it is the median of the output.
    #[getter]
    fn stated(&self) -> bool {
        self.figures.stated
    }

    /// Samples without a valid interval.
    #[getter]
    fn left_out(&self) -> u64 {
        self.figures.left_out
    }

    /// Why nothing can be claimed: the length of the output is far from gravity, or over 1 % of the windows are left
    /// out. Otherwise, None.
    #[getter]
    fn warning(&self) -> Option<String> {
        self.figures.nothing_claimed().map(|message| in_python(&message))
    }

    /// Where time is lost without a hole in `sequence`, or the intervals are wrong; otherwise None. `verdict["losses"]`
    /// has the counts.
    #[getter]
    fn time_warning(&self) -> Option<String> {
        self.figures.time_fault.map(|fault| fault.to_string())
    }

    /// What `isotherm verify` prints: severity and the rest of the line, without the recording.
    #[getter]
    fn findings(&self) -> Vec<(&'static str, String)> {
        let line = |finding: &Finding| (finding.severity.name(), in_python(&format!("[{}]: {finding}", finding.name)));
        self.figures.findings(false).iter().map(line).collect()
    }

    /// The errors that the run allows to be claimed: the document of `isotherm verify --json`, without a requirement.
    ///
    /// Each of `axes` and `length` has `constant_g0`, `variation_g0` and `worst_g0`, and `level` the same in `_rad`,
    /// each with `value` and `interval`, the half width of the 95 % interval. What cannot be judged is None: every
    /// constant error but that of the length if the attitude is not stated, and the length if local gravity is unknown.
    /// `covered` says which part of the table's range the run covers, the largest hole in it, and which channels the
    /// run drives. `gyroscopes`, where the table or the samples have any, has the same in `_deg_h`, and
    /// `random_walk_deg_sqrt_h`; or `not_judged`.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        document(py, &verification(&self.figures, self.window_s, None))
    }

    /// Judges each bound of `require`: (bound, whether the run shows that it is met, the judgement in words).
    ///
    /// `require` is as that of the command, for example "bias=20ug0,scale=50ppm,level=5arcsec,rate=0.1deg/h"; a number
    /// is the least factor of stability.
    fn judge(&self, require: Require) -> PyResult<Vec<(&'static str, bool, String)>> {
        let judgements = require.requirement()?.judge(&self.figures);
        Ok(judgements
            .into_iter()
            .map(|judgement| (judgement.bound, judgement.met, in_python(&judgement.message)))
            .collect())
    }

    /// Raises StabilityError where `isotherm verify --require` ends with exit code 1.
    ///
    /// That is, if nothing can be claimed (see `warning`), if the run has fewer than 12 windows, or if a bound of
    /// `require` is not met. The message has a line for each reason; the last one has the remedies.
    fn check(&self, require: Require) -> PyResult<()> {
        let requirement = require.requirement()?;
        let verdict = requirement.check(&self.figures);
        verdict.map_err(|message| StabilityError::new_err(in_python(&format!("{}: {message}", self.recording))))
    }

    /// All windows, as WINDOW.
    #[getter]
    fn windows<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut bytes = Vec::new();
        for window in &self.figures.windows {
            let times = [window.time_s, window.seconds];
            let means = [window.before, window.after, window.head, window.board];
            let floats = times.iter().chain(means.iter().flatten());
            floats.for_each(|value| bytes.extend_from_slice(&value.to_ne_bytes()));
            bytes.extend([window.flagged, window.counts, window.still].map(u8::from));
        }
        view(array(py, bytes), "WINDOW")
    }

    /// The report as HTML, with the judgement of what is required.
    #[pyo3(signature = (*, require = None))]
    fn html(&self, require: Option<Require>) -> PyResult<String> {
        let source = VerificationSource {
            tool: tool(),
            time: now(),
            table: self.table.0.content().imu.to_string(),
            recording: self.recording.clone(),
            window_s: self.window_s,
            required: require.map(Require::requirement).transpose()?,
        };
        Ok(report_html(&self.table.0, &self.figures, &source))
    }

    /// Writes the report (HTML), with the judgement of what is required.
    #[pyo3(signature = (path, *, require = None))]
    fn report(&self, py: Python<'_>, path: PathBuf, require: Option<Require>) -> PyResult<()> {
        python(py, "_files", "write_text")?.call1((path, self.html(require)?)).map(drop)
    }

    fn _repr_html_(&self) -> PyResult<String> {
        Ok(screen(&self.html(None)?))
    }

    /// Draws the errors before and after compensation over time, for each axis. Needs matplotlib; returns the axes.
    #[pyo3(signature = (**options))]
    fn plot<'py>(slf: &Bound<'py, Self>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        python(slf.py(), "_plot", "stability")?.call((slf,), options)
    }

    fn __repr__(&self) -> String {
        let (a1, a2, a3) = self.factor();
        format!("Stability(factor=({a1:.2}, {a2:.2}, {a3:.2}))")
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
