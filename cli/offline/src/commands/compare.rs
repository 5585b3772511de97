//! `compare`: what has changed between the tables of one IMU.

use super::common::{AcceptanceArgs, JsonOption, or_document};
use clap::Args;
use isotherm_analysis::{ComparisonRequirement, compare};
use isotherm_documents::{LoadError, read_text};
use isotherm_files::{StagedText, Trust, check_stdout, check_written, print, refuse_overlap};
use isotherm_fit::{TableFile, tool};
use isotherm_pipeline::{JobFailure, now};
use isotherm_report::comparison::{ComparisonSource, document, html, text};
use isotherm_support::failure::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Show what changed between tables of one IMU
///
/// Shows the changes that exceed the errors of the tables.
///
/// Curves are compared, not coefficients, so different orders, units, centres and values of 1 g0 do not matter. The
/// errors come from both provenances; without them only the values are shown. If there are three or more tables, the
/// oldest and the newest are compared, and the report has a line over the dates for each quantity.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm compare 2025.toml 2026.toml --require bias=20ug0,scale=50ppm,alignment=20urad\n  isotherm compare 2023.toml 2024.toml 2025.toml 2026.toml --report years.html"
)]
pub struct Compare {
    /// Compare these tables, the old one first
    ///
    /// Give the old one and the new one, or three or more in any order.
    #[arg(value_name = "TABLE.toml", required = true, num_args = 2..)]
    tables: Vec<PathBuf>,
    /// Fail unless differences are within these bounds
    ///
    /// Give bounds such as bias=20ug0,scale=50ppm,alignment=20urad,rate=0.05deg/h.
    ///
    /// bias: of every accelerometer (ug0, mg0). scale: of K+ and K- of every sensor (ppm). alignment: of every entry of
    /// the matrices (urad, arcsec). rate: of the bias of every gyroscope (deg/h). The whole band counts: a difference
    /// whose band exceeds the bound is undecided, which also fails
    #[arg(long, value_name = "BOUNDS", allow_negative_numbers = true)]
    require: Vec<ComparisonRequirement>,
    /// Accept tables of different IMUs
    ///
    /// They are refused otherwise.
    #[arg(long)]
    other_device: bool,
    /// Write the report to this file (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    #[command(flatten)]
    acceptance: AcceptanceArgs,
    #[command(flatten)]
    json: JsonOption,
}

impl Compare {
    pub(crate) fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.show())
    }

    /// Prints the results.
    fn show(self) -> Result<(), JobFailure> {
        let require = joined(&self.require)?;
        let files: Vec<(&Path, &str)> = self.tables.iter().map(|path| (path.as_path(), "a table")).collect();
        refuse_overlap(&files, &[self.report.as_deref()])?;
        check_written(None, check_stdout())?;
        let load = |path: &PathBuf| {
            let (text, _) = read_text(path, Trust::Any)?;
            let table = TableFile::from_toml(path.display().to_string(), &text);
            table.map_err(|faults| Failure::from(LoadError::Refused { path: path.clone(), faults }))
        };
        let tables: Vec<_> = self.tables.iter().map(load).collect::<Result<_, Failure>>()?;
        let comparison = compare(tables, self.other_device).map_err(Failure::from)?;
        self.acceptance.admit("", comparison.findings.clone())?;
        if let Some(path) = &self.report {
            let source = ComparisonSource { tool: tool(), time: now(), required: require };
            StagedText::create(Some(path))?.write(&html(&comparison, &source))?.finish()?;
        }
        if !self.json.is_given() {
            print(&text(&comparison, require.as_ref()))?;
        }
        let verdict = require.map_or(Ok(()), |require| comparison.check(&require));
        let name = &comparison.new_table().name;
        let verdict = verdict.map_err(|message| Failure::new(Exit::Failed, format!("{name}: {message}")));
        self.json.finish(document(&comparison, require.as_ref()), verdict)
    }
}

/// The requirement of all `--require`; `None` without one.
fn joined(require: &[ComparisonRequirement]) -> Result<Option<ComparisonRequirement>, Failure> {
    let Some((first, others)) = require.split_first() else { return Ok(None) };
    let all = others.iter().try_fold(*first, |all, more| all.and(*more));
    all.map(Some).map_err(|message| Failure::new(Exit::Usage, format!("--require: {message}")))
}
