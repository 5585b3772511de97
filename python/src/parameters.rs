//! The functions `export_parameters` and `import_parameters`.

use crate::connection::imu_id;
use crate::errors::{TableError, faults};
use crate::table::Table;
use isotherm_autopilot::{Autopilot, Effect, EffectLoss, ExportError, ExportOptions, ImportError, ImportOptions};
use isotherm_fit::Origin;
use isotherm_recording::LogImu;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::fmt::Display;

/// The parameters of a table.
#[pyclass(frozen, module = "isotherm")]
pub struct Exported(isotherm_autopilot::ExportedParameters);

/// Name of an effect, sensors, and its sizes \[m/s2, rad/s\].
type Lost = (&'static str, Vec<&'static str>, Option<f64>, Option<f64>);

/// One device number for both kinds of sensor, or one for each.
#[derive(FromPyObject)]
pub(crate) enum Devices {
    One(u32),
    Each([u32; 2]),
}

/// A `ValueError` for an argument.
fn argument(name: &str, message: impl Display) -> PyErr {
    PyValueError::new_err(format!("{name}: {message}"))
}

fn autopilot(name: &str, argument_name: &str) -> PyResult<Autopilot> {
    name.parse().map_err(|message| argument(argument_name, message))
}

/// The biases of a table as parameters of an autopilot.
#[pyfunction]
#[pyo3(signature = (table, *, to, instance = None, device_id = None, at = None, drop = Vec::new()))]
#[expect(clippy::needless_pass_by_value, reason = "an argument of a Python function")]
pub(crate) fn export_parameters(
    table: &Table,
    to: &str,
    instance: Option<u8>,
    device_id: Option<Devices>,
    at: Option<f64>,
    drop: Vec<String>,
) -> PyResult<Exported> {
    let device_id = device_id.map(|devices| match devices {
        Devices::One(id) => [id; 2],
        Devices::Each(ids) => ids,
    });
    exported(table, autopilot(to, "to")?, (instance, device_id), at, &drop).map(Exported)
}

/// The parameters of all IMUs of a vehicle as one file: tables with their names, `None` of an IMU that has none.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments of a Python function")]
pub(crate) fn export_vehicle(
    imus: Vec<(String, Option<PyRef<'_, Table>>)>,
    to: &str,
    at: Option<f64>,
    drop: Vec<String>,
) -> PyResult<Exported> {
    let autopilot = autopilot(to, "to")?;
    let one = |(name, table): &(String, Option<PyRef<'_, Table>>)| {
        let exported = table.as_ref().map(|table| exported(table, autopilot, (None, None), at, &drop)).transpose()?;
        Ok((name.clone(), exported))
    };
    let all = imus.iter().map(one).collect::<PyResult<Vec<_>>>()?;
    let all: Vec<_> = all.iter().map(|(name, exported)| (name.as_str(), exported.as_ref())).collect();
    Ok(Exported(isotherm_autopilot::vehicle(autopilot, &all)))
}

/// The parameters of a table, for the instance and the device numbers that are given, or else those of the log that
/// made it.
fn exported(
    table: &Table,
    autopilot: Autopilot,
    (instance, device_id): (Option<u8>, Option<[u32; 2]>),
    at_c: Option<f64>,
    drop: &[String],
) -> PyResult<isotherm_autopilot::ExportedParameters> {
    let effect = |name: &String| name.parse::<Effect>().map_err(|message| argument("drop", message));
    let log_imu = Origin::of_toml(table.text(), &table.0).log_imu;
    let of_log = |imu: LogImu| ExportOptions::of_log(autopilot, imu.instance, imu.devices);
    let options = log_imu.map_or_else(|| ExportOptions::new(autopilot), of_log).with(instance, device_id);
    let drop = drop.iter().map(effect).collect::<PyResult<_>>()?;
    isotherm_autopilot::export(&table.0, &ExportOptions { at_c, drop, ..options }).map_err(|error| match error {
        ExportError::Instance(_) | ExportError::Device(_) | ExportError::At(_) => {
            PyValueError::new_err(error.to_string())
        }
        _ => TableError::new_err((error.to_string(), Vec::<(usize, String, String)>::new())),
    })
}

/// The table of an autopilot's parameters.
#[pyfunction]
#[pyo3(signature = (text, autopilot, *, imu, interval, instance = None, gravity = 9.80665))]
pub(crate) fn import_parameters(
    text: &str,
    autopilot: &str,
    imu: &str,
    interval: f64,
    instance: Option<u8>,
    gravity: f64,
) -> PyResult<Table> {
    let options = ImportOptions {
        autopilot: self::autopilot(autopilot, "autopilot")?,
        instance,
        imu: imu_id(imu)?,
        // What is no time becomes 0, which is refused.
        interval_ns: (interval * 1e9).round() as u64,
        gravity,
    };
    let table = isotherm_autopilot::import(text, &options).map_err(|error| match error {
        ImportError::Text(all) => faults("parameters", &all),
        other => PyValueError::new_err(other.to_string()),
    })?;
    let text = table.to_toml();
    Ok(Table::new(table, &text))
}

#[pymethods]
impl Exported {
    #[getter]
    fn text(&self) -> &str {
        &self.0.text
    }

    /// Name, sensors, m/s2 and rad/s of each effect that was left out.
    #[getter]
    fn lost(&self) -> Vec<Lost> {
        let loss = |loss: &EffectLoss| (loss.effect.name(), loss.sensors.clone(), loss.accelerometers, loss.gyroscopes);
        self.0.lost.iter().map(loss).collect()
    }

    #[getter]
    fn difference(&self) -> (f64, Option<f64>) {
        (self.0.difference.accelerometers, self.0.difference.gyroscopes)
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    fn __str__(&self) -> &str {
        &self.0.text
    }

    fn __repr__(&self) -> String {
        format!("Exported({} lines)", self.0.text.lines().count())
    }
}
