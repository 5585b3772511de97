//! `noise`: the Allan deviation of a recording at rest.

use super::common::{
    AcceptanceArgs, ForeignArgs, JsonOption, OfData, choice, inputs, joined_paths, load_with_origin, or_document,
};
use super::part::PartArgs;
use crate::progress::{bytes_bar, spinner};
use clap::Args;
use isotherm_analysis::{NoiseAnalysis, NoiseRows, imu_yaml};
use isotherm_campaign::rate_at_rest;
use isotherm_files::{StagedText, check_stdout, check_written, print, print_data, refuse_overlap, sources};
use isotherm_fit::tool;
use isotherm_pipeline::{JobFailure, now};
use isotherm_recording::MISSING;
use isotherm_recording_formats::read::{ImuChoice, Input, Recording, Samples};
use isotherm_report::noise;
use isotherm_report::noise::NoiseSource;
use isotherm_shared::lag::ReadingLimits;
use isotherm_shared::names::ImuId;
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::Finding;
use std::path::PathBuf;

/// Show the noise of an IMU at rest
///
/// Computes the Allan deviation, and the coefficients of quantisation, white noise, bias instability and random walk.
///
/// The longest stretch of rows without a long gap, a movement or a new session is analysed. It needs 1000 rows, and
/// several hours for a random walk. Gaps of up to 16 rows are bridged; if they contain more than 2 % of the rows, no
/// file for Kalibr is written. With a table the outputs are compensated, in g0 and deg/h; without one they are counts
/// per second. The model with Q, N, B and K is fitted with the exact covariance of the Allan variances. A coefficient
/// that is not significant is given as "below" a limit. If the model does not describe the data, no ranges are given.
///
/// If a straight line of the rate over head temperature explains a part of the curve, temperature contaminates the
/// noise. The curve without that line is then shown, too.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm noise --table imu-a.toml night.csv --report noise.html\n  isotherm noise night.csv --from 3600 --json\n  isotherm noise --table imu-g.toml night-????.mcap --kalibr imu.yaml"
)]
pub struct NoiseCommand {
    /// Read this recording of raw samples
    ///
    /// A recording of raw samples (CSV, MCAP) or third-party data, or the pieces of one recording in any
    /// order; - is stdin.
    #[arg(value_name = "RAW", required = true)]
    recording: Vec<PathBuf>,
    /// Read this coefficient table
    #[arg(long, value_name = "TABLE")]
    table: Option<PathBuf>,
    /// Read the samples of this IMU
    ///
    /// For a recording of several IMUs [default: the IMU of the table]
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    #[command(flatten)]
    part: PartArgs,
    /// Write the report to this file (HTML)
    #[arg(long, value_name = "R.html")]
    report: Option<PathBuf>,
    /// Write the noise as Kalibr's imu.yaml
    ///
    /// It contains N and K of the worst axis of each triad, in m/s2 and rad/s.
    #[arg(long, value_name = "FILE.yaml", requires = "table")]
    kalibr: Option<PathBuf>,
    #[command(flatten)]
    acceptance: AcceptanceArgs,
    #[command(flatten)]
    json: JsonOption,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl NoiseCommand {
    pub(crate) fn run(self) -> Result<(), Failure> {
        or_document(self.json, self.show())
    }

    fn show(self) -> Result<(), JobFailure> {
        let part = self.part.get()?;
        let mut files = inputs(&self.recording);
        files.extend(self.table.as_deref().map(|table| (table, "the table")));
        files.extend(self.foreign.inputs());
        refuse_overlap(&files, &[self.report.as_deref(), self.kalibr.as_deref()])?;
        check_written(None, check_stdout())?;
        let table = match &self.table {
            Some(path) => Some(load_with_origin(path)?),
            None => None,
        };
        let (table, origin) = table.unzip();
        let origin = origin.unwrap_or_default();
        let staged = |path: &Option<PathBuf>| path.as_deref().map(|path| StagedText::create(Some(path))).transpose();
        let (page, yaml) = (staged(&self.report)?, staged(&self.kalibr)?);
        let imu = match (&self.imu, &table) {
            (imu, Some(table)) => choice(imu.clone(), table),
            (Some(imu), None) => ImuChoice::Only(imu.clone()),
            (None, None) => ImuChoice::Any,
        };
        let bar = bytes_bar(&self.recording, "reading");
        let input = Input::from((imu, self.foreign.read_for(table.as_ref(), &origin)?)).within(part);
        let mut samples = Samples::open(&sources(&self.recording)?, input, &bar)?;
        samples.set_lag(table.as_ref().map_or(0, |table| table.lag_ns()));
        samples.set_limits(table.as_ref().map(ReadingLimits::of));
        let mut rows = NoiseRows::new(table.as_ref(), [0.0, f64::INFINITY]);
        for row in samples.by_ref() {
            rows.push(&row?);
        }
        bar.finish();
        let recording = joined_paths(&self.recording);
        let of_rows = samples.recording();
        rows.leave_out(of_rows.left_out_by_stamps());
        let of_data = OfData::of(of_rows).with_unit(&origin, of_rows).with_other_device();
        let spinner = spinner("fitting");
        let continuity = rows.continuity().clone();
        let analysis = rows.analyse().map(|analysis| analysis.behind(of_rows.left_out()));
        spinner.finish_and_clear();
        let analysis = analysis.map_err(|error| {
            let found = continuity.findings(MISSING).into_iter().map(Finding::warned).collect();
            let _ = of_data.findings_alone().admit(&AcceptanceArgs::default(), &recording, found);
            let failure = Failure::new(Exit::Data, format!("{recording}: {error}"));
            if let [file] = self.recording.as_slice() { failure.at(file, None) } else { failure }
        })?;
        let mut found = analysis.findings();
        if table.is_none() {
            found.extend(rate_of_counts(&analysis, of_rows));
        }
        of_data.admit(&self.acceptance, &recording, found)?;
        if let Some(lost) = analysis.lost().filter(|_| yaml.is_some()) {
            let message = format!("{recording}: no file for Kalibr is written, as its figures would be wrong: {lost}");
            return Err(Failure::new(Exit::Data, message).into());
        }
        let mut texts = Vec::new();
        if let (Some(yaml), Some(table)) = (yaml, &table) {
            let text = imu_yaml(&analysis, table.content().gravity, &recording);
            let text = text.ok_or_else(|| Failure::new(Exit::Usage, "--kalibr needs --table: counts have no unit"))?;
            texts.push(yaml.write(&text)?);
        }
        if let Some(page) = page {
            let of_table = table.as_ref().map(|table| table.content().imu.to_string());
            let source = NoiseSource {
                tool: tool(),
                time: now(),
                imu: of_table.or(self.imu.map(|imu| imu.to_string())).unwrap_or_else(|| recording.clone()),
                recording,
                table: (self.table.iter().zip(&table))
                    .map(|(path, table)| [path.display().to_string(), table.digest().to_string()])
                    .next(),
            };
            texts.push(page.write(&noise::html(&analysis, &source))?);
        }
        StagedText::finish_all(texts)?;
        if self.json.is_given() {
            Ok(print_data(&format!("{:#}\n", noise::json::document(&analysis)))?)
        } else {
            Ok(print(&noise::text::text(&analysis))?)
        }
    }
}

/// The rate at rest that no gyroscope has, of counts whose scale is that of the data.
fn rate_of_counts(analysis: &NoiseAnalysis, recording: &Recording) -> Option<Finding> {
    let [.., a, b, c] = &analysis.sensors[..] else { return None };
    let gyroscopes = [a, b, c];
    if gyroscopes.iter().any(|sensor| sensor.sensor != SensorKind::Gyroscope) {
        return None;
    }
    let nominal = recording.nominal(&ImuId::new("imu")?).ok()?;
    // Seconds of arc a second are deg/h.
    let pulse = nominal.resolution.gyroscope * nominal.interval_ns as f64 / 1e9 / ARCSEC;
    rate_at_rest(gyroscopes.map(|sensor| sensor.mean * pulse))
}
