//! Rows of a simulation, written as they come.

use super::options::{SimulatedFiles, usage};
use isotherm_files::{check_stdout, check_written, create_folder};
use isotherm_offline::progress::rows_bar;
use isotherm_recording::{Layout, RawCsvWriter};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_simulation::{Chain, RunSchedule, Truth};
use isotherm_support::failure::Failure;
use serde::Serialize;
use std::fmt::Display;
use std::path::Path;
/// Most rows of a file: a hundred hours at 1 kHz, some 50 GB.
pub(super) const MAX_ROWS: u64 = 360_000_000;

/// Rows between two updates of the progress bar.
pub(super) const BAR_ROWS: u64 = 4096;

/// What truth.toml says of the attitude of a run.
#[derive(Serialize)]
pub(super) struct AttitudeDocument {
    /// \[g0\]
    pub(super) specific_force: [f64; AXES],
    /// \[deg\]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) outer_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) inner_deg: Option<f64>,
}

impl AttitudeDocument {
    /// Only gyroscopes feel the angles.
    pub(super) fn of(truth: &Truth, run: &RunSchedule) -> Self {
        let angles = truth.table.content().gyroscopes.as_ref().map(|_| run.angles_deg(truth));
        Self {
            specific_force: run.specific_force(truth),
            outer_deg: angles.map(|[outer, _]| outer),
            inner_deg: angles.map(|[_, inner]| inner),
        }
    }
}

/// Refuses chamber temperatures outside the range of the truth's coefficients.
pub(super) fn reachable(truth: &Truth, chain: &Chain, temperatures_c: &[f64]) -> Result<(), Failure> {
    let low = temperatures_c.iter().copied().fold(f64::INFINITY, f64::min);
    let high = temperatures_c.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    match truth.outside(chain, low, high) {
        None => Ok(()),
        Some(place) => Err(usage(format!("the chamber would leave the truth: {place}"))),
    }
}

/// The columns of a file.
pub(super) struct Columns {
    /// Those before the sample's, with commas.
    pub(super) leading: &'static str,
    pub(super) telemetry_ns: bool,
    pub(super) layout: Layout,
}

impl Columns {
    /// Those of the simulated samples.
    pub(super) fn of(truth: &Truth, chain: &Chain) -> Self {
        let layout = Layout { gyroscopes: truth.table.content().gyroscopes.is_some(), ..Layout::default() };
        Self { leading: "", telemetry_ns: chain.temperature_s > 0.0, layout }
    }
}

/// Adds the file `name` with `rows` to `files`, with a progress bar on a terminal.
pub(super) fn write_rows(
    folder: &Path,
    name: &str,
    columns: Columns,
    count: u64,
    rows: impl Iterator<Item = (impl Display, RawSample)>,
    files: &mut SimulatedFiles,
) -> Result<(), Failure> {
    if count > MAX_ROWS {
        return Err(usage(format!("{count} rows; up to {MAX_ROWS} can be simulated, give a longer interval")));
    }
    check_written(None, check_stdout())?;
    create_folder(folder).map_err(|error| Failure::io("making", folder, &error))?;
    let bar = rows_bar(count);
    files.add_with(folder.join(name), |sink| {
        let mut writer = RawCsvWriter::with_layout(sink, columns.leading, columns.telemetry_ns, columns.layout)?;
        for (index, (leading, raw)) in (0u64..).zip(rows) {
            if index.is_multiple_of(BAR_ROWS) {
                bar.set_position(index);
            }
            writer.write(leading, &raw)?;
        }
        bar.finish_and_clear();
        Ok(())
    })
}
