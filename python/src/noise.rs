//! The noise of rates and recordings.

use crate::errors::NoiseError;
use crate::offline::with_lag;
use crate::recordings::refuse_disorder;
use crate::records::{Fields, RAW, Values};
use crate::table::Table;
use crate::work::Work;
use isotherm_analysis::{Allan, MIN_ROWS, NoiseRows, TemperatureLine, imu_yaml};
use isotherm_fit::tool;
use isotherm_pipeline::now;
use isotherm_report::noise::{NoiseSource, html, json, rates_html};
use isotherm_support::finding::Severity;
use pyo3::prelude::*;

/// The document of `isotherm noise --json`, the report, with a table Kalibr's file, and the deviations of each model.
type Noise = (String, String, Option<String>, Vec<Model>);

/// The Allan deviations of a model at the averaging times; none where there is no model.
type Model = Vec<f64>;

fn model(allan: Option<&Allan>) -> Model {
    let Some((allan, fit)) = allan.and_then(|allan| Some((allan, allan.model.as_ref()?))) else { return Vec::new() };
    allan.points.iter().map(|point| fit.deviation(point.tau_s).0).collect()
}

/// The noise of a recording: the document of `isotherm noise --json`, the report, and with a table Kalibr's file.
#[pyfunction]
pub(crate) fn noise(
    py: Python<'_>,
    samples: Values<u8>,
    table: Option<&Table>,
    part: [f64; 2],
    recording: String,
    progress: Option<Py<PyAny>>,
) -> PyResult<Noise> {
    let time = now();
    let work = Work::new(progress);
    let found = work.run(py, || {
        refuse_disorder(&recording, &samples)?;
        let of_table = table.map(|table| &*table.0);
        let mut rows = NoiseRows::new(of_table, part);
        match table {
            Some(table) => {
                work.rows(samples.len() / RAW, with_lag(&samples, &table.0)).for_each(|row| rows.push(&row));
            }
            None => {
                let records = work.rows(samples.len() / RAW, samples.chunks_exact(RAW));
                records.for_each(|record| rows.push(&Fields(record).raw()));
            }
        }
        let table = of_table;
        let analysis = rows.analyse().map_err(|error| NoiseError::new_err(format!("{recording}: {error}")))?;
        if let Some(fault) = analysis.findings().iter().find(|finding| finding.severity == Severity::Fault) {
            return Err(NoiseError::new_err(format!("{recording}: {fault}")));
        }
        let imu = table.map_or_else(|| recording.clone(), |table| table.content().imu.to_string());
        let of_table = table.map(|table| [imu.clone(), table.digest().to_string()]);
        let yaml = table.and_then(|table| imu_yaml(&analysis, table.content().gravity, &recording));
        let source = NoiseSource { tool: tool(), time, recording, table: of_table, imu };
        let models = analysis.sensors.iter().map(|sensor| model(sensor.allan.as_ref())).collect();
        Ok((json::document(&analysis).to_string(), html(&analysis, &source), yaml, models))
    });
    found?
}

/// The noise of rates at one interval, as JSON.
#[pyfunction]
pub(crate) fn noise_of_rates(
    py: Python<'_>,
    rates: Values<f64>,
    interval_s: f64,
    temperature: Option<Values<f64>>,
) -> PyResult<(String, String, Model)> {
    if rates.len() < MIN_ROWS {
        return Err(NoiseError::new_err(format!("{} rates; at least {MIN_ROWS} are needed", rates.len())));
    }
    if let Some(index) = rates.iter().position(|rate| !rate.is_finite()) {
        return Err(NoiseError::new_err(format!("rates[{index}] is {}, give finite numbers", rates[index])));
    }
    let found = Work::new(None).run(py, || {
        let allan = Allan::of(&rates, interval_s);
        let allan = allan.ok_or_else(|| NoiseError::new_err("the rates never change"))?;
        let line = temperature.and_then(|temperature| TemperatureLine::of(&rates, &temperature, interval_s, &allan));
        let document = json::rates(&allan, line.as_ref()).to_string();
        Ok((document, rates_html(&allan, &tool()), model(Some(&allan))))
    });
    found?
}
