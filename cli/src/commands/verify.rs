//! `verify`: the stability of a recording under a table.

use super::common::{choice, inputs};
use crate::parse::{direction, gravity, over_0, seconds};
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_calibration::provenance::{now, tool};
use isotherm_calibration::report::{self, verification::VerificationSource};
use isotherm_calibration::stability::{Collector, Setup};
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, tell};
use isotherm_files::{StagedText, WorldWritable, check_stdout, check_written, load_table, print, refuse_overlap};
use isotherm_recording_formats::read::Samples;
use isotherm_shared::wire::AXES;
use std::path::PathBuf;
use std::time::Duration;

/// Show how stable the output of a recording is, before and after compensation
///
/// The IMU must be held still while its temperature runs. Before: the table's coefficients frozen at the run's mid
/// temperature. After: the full model. Where the IMU was still, the three outputs together are compared with gravity too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm verify --table imu-a.toml run.csv --attitude 0.6,-0.48,0.64 --report verify.html\n  isotherm verify --table imu-a.toml run.csv --require 10"
)]
pub struct Verify {
    /// Coefficient table
    #[arg(long, value_name = "TABLE")]
    table: PathBuf,
    /// The IMU whose samples are read, in a recording of several IMUs [default: the table's IMU]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Recording of raw samples (CSV, Parquet, MCAP), or the pieces of one in any order; - is stdin
    #[arg(value_name = "RAW", required = true)]
    recording: Vec<PathBuf>,
    /// Length of the windows that means are taken over [s]
    #[arg(long, value_name = "S", default_value = "10", allow_negative_numbers = true, value_parser = seconds)]
    window: Duration,
    /// Fail unless every axis is FACTOR times more stable after than before
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, value_parser = over_0)]
    require: Option<f64>,
    /// Direction of the specific force along A1, A2, A3 [default: the median of the compensated output]
    #[arg(long, value_name = "F1,F2,F3", allow_hyphen_values = true, value_parser = direction)]
    attitude: Option<[f64; AXES]>,
    /// Local gravity in m/s2 [default: the table's]
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    /// Where the report goes (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
}

impl Verify {
    pub fn run(self) -> Result<(), Failure> {
        let mut files = inputs(&self.recording);
        files.push((&self.table, "the table"));
        refuse_overlap(&files, &[self.report.as_deref()])?;
        check_written(None, check_stdout())?;
        let (table, _) = load_table(&self.table, None, WorldWritable::Allow)?;
        let page = self.report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let bar = bytes_bar(&self.recording, "reading");
        let window_s = self.window.as_secs_f64();
        let mut collector = Collector::new(&table, window_s);
        for sample in Samples::open(&self.recording, choice(self.imu, &table), &bar)? {
            collector.add(&sample?);
        }
        bar.finish_and_clear();
        let names: Vec<_> = self.recording.iter().map(|path| path.display().to_string()).collect();
        let recording = names.join(", ");
        let stability = collector.finish(&Setup::new(self.attitude, self.gravity_local, &table));
        let stability = stability.map_err(|error| Failure::new(Exit::Data, format!("{recording}: {error}")))?;
        if let Some(warning) = stability.gravity_mismatch() {
            tell("isotherm", format_args!("warning: {recording}: {warning}"));
        }
        print(&report::text::stability(&stability, window_s, table.content().alignment.is_some()))?;
        if let Some(page) = page {
            let source = VerificationSource {
                tool: tool(),
                time: now(),
                table: self.table.display().to_string(),
                recording,
                window_s,
                required: self.require,
            };
            page.write(&report::verification::html(&table, &stability, &source))?.finish()?;
        }
        let verdict = self.require.map_or(Ok(()), |factor| stability.require(factor));
        verdict.map_err(|message| Failure::new(Exit::Failed, message))
    }
}
