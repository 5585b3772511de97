//! `calibrate turntable`: a table from a campaign on a turntable, also of each IMU on it.

use super::campaign::{CampaignJob, job_of_campaign};
use super::outcome::fit;
use super::table::TableArgs;
use crate::commands::common::or_document;
use crate::parse::{lag_choice, one_of};
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_campaign::Campaign;
use isotherm_files::{StagedText, print_data};
use isotherm_fit::{AlignmentChoice, CalibrationOptions, LagChoice, Method};
use isotherm_pipeline::{CampaignFile, Inputs, JobFailure, JobOutcome, RowSource, propose};
use isotherm_recording_formats::convert::Foreign;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::name;
use std::path::{Path, PathBuf};

/// Make a table from a turntable campaign
///
/// Checks the samples, reduces every set point, chooses the orders of the polynomials, fits them, and writes a sealed
/// table with its provenance. Parameters that the positions cannot observe are refused, never guessed. A campaign with
/// turns also calibrates the gyroscopes. Ramps give the lag of the sensing elements behind their temperature, and the
/// transients of the biases if they are significant. A campaign with only ramps also gives the bias curves at one
/// attitude.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm calibrate turntable campaign.toml -o imu-a.toml --report imu-a.html
  isotherm calibrate turntable campaign.toml -o imu-a.toml --order 3 --method two-stage --exclude -25/3
  isotherm calibrate turntable ramps.toml -o imu-a.toml --lag 240
  isotherm calibrate turntable --propose measured/ -o campaign.toml
  isotherm calibrate turntable campaign.toml -o 'tables/{imu}.toml' --batch batch.html")]
pub(super) struct Turntable {
    /// Read this campaign file, which names the samples
    #[arg(value_name = "CAMPAIGN.toml", required_unless_present = "propose")]
    campaign: Option<PathBuf>,
    /// Read these samples instead of the campaign file's
    ///
    /// CSV or MCAP, or the pieces of one recording in any order.
    #[arg(value_name = "SAMPLES")]
    samples: Vec<PathBuf>,
    /// Write the table to this file
    ///
    /// - is stdout. For several IMUs, {imu} in the name stands for the name of each.
    #[arg(short, long, value_name = "TABLE.toml", required_unless_present = "propose")]
    output: Option<PathBuf>,
    /// Propose a campaign file for a folder
    ///
    /// The folder has a file for each position at each set point, or a sheet of means. The campaign file is written to
    /// -o, or to stdout. Set points and positions are taken from the names of the files. Gravity distinguishes
    /// accelerometers from temperatures. Everything that the files do not show is "?" there, or a comment.
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["campaign", "report", "batch", "json"])]
    propose: Option<PathBuf>,
    #[command(flatten)]
    table: TableArgs,
    /// Calibrate only this one of several IMUs
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    /// Write the report of a batch (HTML)
    ///
    /// For a campaign file with several IMUs. The report shows their spread, and names the ones that stand out. In -o
    /// and --report, {imu} stands for the name of each.
    #[arg(long, value_name = "BATCH.html")]
    batch: Option<PathBuf>,
    /// Choose how the fit treats set points
    ///
    /// one-stage fits all dwells at once, each with its own temperature; two-stage fits each set point first, then the
    /// polynomials [default: one-stage].
    #[arg(long, value_name = "METHOD", value_parser = one_of(Method::NAMES))]
    method: Option<Method>,
    /// Give the table an alignment matrix
    ///
    /// The matrix is made from the misalignments [default: if one exceeds its 99 % interval and 1e-6 rad]. It rotates
    /// the axes of the output onto those of the turntable, and includes the mounting of the IMU on the fixture. If
    /// there are gyroscopes, either both triads get a matrix or neither.
    #[arg(long, conflicts_with = "no_alignment")]
    alignment: bool,
    /// Give the table no alignment matrix
    ///
    /// The outputs then stay along the input axes of the sensors.
    #[arg(long)]
    no_alignment: bool,
    /// Set the lag behind the temperature [s]
    ///
    /// The time constant, for example that of another device of the same type; or none, for a table without transients
    /// [default: found in the ramps]. A given time constant need not be significant in the ramps. A transient of a bias
    /// is still written only if it predicts the sweeps that are left out.
    #[arg(long, value_name = "auto|S|none", value_parser = lag_choice)]
    lag: Option<LagChoice>,
    /// Leave out a dwell or a turn
    ///
    /// Give the set point in degC and the number of the position or turn. Can be repeated.
    #[arg(long, value_name = "SET_POINT/NUMBER", allow_hyphen_values = true, value_parser = dwell)]
    exclude: Vec<(f64, u32)>,
    /// Write curves of ramps with unknown errors
    ///
    /// Also replaces curves that depend on temperature or have an error. This is the same as --accept one-direction.
    #[arg(long)]
    replace_curves: bool,
}

/// Set point \[degC\] and number of a position or a turn.
fn dwell(text: &str) -> Result<(f64, u32), String> {
    let place = text.split_once('/').and_then(|(set_point, number)| {
        let set_point: f64 = set_point.trim().parse().ok()?;
        Some((set_point, number.trim().parse().ok()?)).filter(|_| set_point.is_finite())
    });
    place.ok_or_else(|| "give SET_POINT/NUMBER, for example -25/3".to_owned())
}

impl Turntable {
    pub(super) fn run(&self, verbose: bool) -> Result<(), Failure> {
        match &self.propose {
            Some(folder) => self.write_proposal(folder),
            None => or_document(self.table.json, self.make_tables(verbose)),
        }
    }

    /// Writes the campaign file that the files of a folder would have.
    fn write_proposal(&self, folder: &Path) -> Result<(), Failure> {
        let output = self.output.as_deref().filter(|path| *path != Path::new("-"));
        let beside = output.and_then(Path::parent).unwrap_or(Path::new(""));
        let text = propose(folder, beside)?;
        match output {
            Some(path) => StagedText::create(Some(path))?.write(&text)?.finish(),
            None => print_data(&text),
        }
    }

    fn make_tables(&self, verbose: bool) -> Result<(), JobFailure> {
        let (Some(path), Some(output)) = (&self.campaign, &self.output) else {
            return Err(Failure::new(Exit::Usage, "give a campaign file, and -o TABLE.toml").into());
        };
        self.table.check_stdout(output)?;
        let file = CampaignFile::read(path)?;
        let campaigns = file.campaigns()?;
        if campaigns.iter().any(|campaign| campaign.is_tumble) {
            let (file, job) = (shown(path), job_of_campaign(path));
            let message =
                format!("{file}: a campaign without a turntable; `isotherm calibrate {job} {file}` makes the table");
            return Err(Failure::new(Exit::Usage, message).into());
        }
        let job = CampaignJob {
            table: &self.table,
            output,
            file: Some(&file),
            samples: &self.samples,
            batch: self.batch.as_deref(),
            others: Vec::new(),
            calibrate: &|campaign| self.calibrate(campaign, &file, verbose),
        };
        job.run(campaigns, self.imu.as_ref())
    }

    fn calibrate(&self, campaign: &Campaign, file: &CampaignFile, verbose: bool) -> Result<JobOutcome, JobFailure> {
        let accept = self.table.accepted(self.replace_curves.then_some(name::ONE_DIRECTION));
        let options = CalibrationOptions {
            method: self.method.unwrap_or_default(),
            order: self.table.order.0,
            alignment: AlignmentChoice::of(self.alignment, self.no_alignment),
            exclude: self.exclude.clone(),
            accept: accept.clone(),
            strict: self.table.acceptance.strict,
            lag: self.lag.unwrap_or_default(),
            ..CalibrationOptions::default()
        };
        let input = self.table.input(Foreign::default(), verbose)?;
        let samples = RowSource::files(&self.samples);
        let inputs = Inputs::turntable(campaign, file, samples, options, &input, &bytes_bar)?;
        fit(inputs, (campaign, Some(file)), &accept)
    }
}
