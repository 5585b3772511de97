//! The functions `export_parameters` and `import_parameters`.

use crate::connection::imu_id;
use crate::errors::{TableError, faults, in_python};
use crate::table::Table;
use crate::value::{Reduced, reduced};
use isotherm_autopilot::{Autopilot, Effect, EffectLoss, ExportError, ExportOptions, ImportError, ImportOptions};
use isotherm_fit::Origin;
use isotherm_recording::LogImu;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use std::fmt::Display;

/// The parameters of a table. `str()` gives the text.
///
/// >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
/// >>> isotherm.export_parameters(table, to="ardupilot").text.splitlines()[-1]
/// 'INS_TCAL1_GYR3_Z 0.010818368'
#[pyclass(frozen, eq, hash, module = "isotherm")]
#[derive(Clone, Deserialize, Serialize)]
pub struct Exported {
    text: String,
    lost: Vec<Lost>,
    difference: (f64, Option<f64>),
    notes: Vec<String>,
}

/// Name of an effect, sensors, and its sizes \[m/s2, rad/s\].
type Lost = (String, Vec<String>, Option<f64>, Option<f64>);

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

/// The biases of a table in degC as parameters of an autopilot, as `isotherm export` writes them.
///
/// `to` is "px4" or "ardupilot", `instance` the number of the IMU there: 0 to 3 of PX4, 1 to 5 of ArduPilot. PX4 needs
/// the device number, or those of accelerometers and gyroscopes. Without them they are those of the log that made the
/// table. With `at` [degC] ArduPilot's constants are written too: CALTEMP, and as OFFS the biases at that temperature.
/// `drop` names what is left out: scale-temperature, negative-scale, alignment, lag, g-sensitivity, order, ranges.
///
/// Raises TableError if the table has what parameters cannot say and is not dropped, with the size of what would be
/// lost; ValueError for other arguments.
///
/// >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
/// >>> print(isotherm.export_parameters(table, to="ardupilot").text.splitlines()[0])
/// INS_TCAL1_ENABLE 1
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
    exported(table, autopilot(to, "to")?, (instance, device_id), at, &drop).map(|found| Exported::new(&found))
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
    Ok(Exported::new(&isotherm_autopilot::vehicle(autopilot, &all)))
}

/// The parameters of a table, for the instance and the device numbers that are given, otherwise those of the log that
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
            PyValueError::new_err(in_python(&error.to_string()))
        }
        _ => TableError::new_err((in_python(&error.to_string()), Vec::<(usize, String, String)>::new())),
    })
}

/// The table of an autopilot's parameters ("px4", "ardupilot"), as `isotherm import` makes it: that of readings in m/s2
/// and rad/s at the nominal `interval` [s], with the biases that the firmware subtracts. ArduPilot's are 0 at 35 degC
/// unless the text has CALTEMP and OFFS.
///
/// Raises TableError with all faults of the text.
///
/// >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
/// >>> parameters = isotherm.export_parameters(table, to="ardupilot").text
/// >>> isotherm.import_parameters(parameters, "ardupilot", imu="imu-d", interval=0.0025).imu
/// 'imu-d'
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
        other => PyValueError::new_err(in_python(&other.to_string())),
    })?;
    let text = table.to_toml();
    Ok(Table::new(table, &text))
}

impl Exported {
    fn new(found: &isotherm_autopilot::ExportedParameters) -> Self {
        let loss = |loss: &EffectLoss| {
            let sensors = loss.sensors.iter().map(|name| (*name).to_owned()).collect();
            (loss.effect.name().to_owned(), sensors, loss.accelerometers, loss.gyroscopes)
        };
        Self {
            text: found.text.clone(),
            lost: found.lost.iter().map(loss).collect(),
            difference: (found.difference.accelerometers, found.difference.gyroscopes),
            notes: found.notes.clone(),
        }
    }
}

#[pymethods]
impl Exported {
    /// The text of a .params or .parm file.
    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    /// What was left out: name, sensors, the size of accelerometers [m/s2] and of gyroscopes [rad/s], if any has it.
    #[getter]
    fn lost(&self) -> Vec<Lost> {
        self.lost.clone()
    }

    /// Largest difference over the range between what the firmware subtracts, in float32, and the written biases [m/s2;
    /// rad/s].
    #[getter]
    fn difference(&self) -> (f64, Option<f64>) {
        self.difference
    }

    /// What you should also know.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn __str__(&self) -> &str {
        &self.text
    }

    fn __repr__(&self) -> String {
        format!("Exported({} lines)", self.text.lines().count())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        reduced(py, self)
    }
}
