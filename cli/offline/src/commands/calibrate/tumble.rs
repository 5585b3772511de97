//! `calibrate tumble`: a table without a turntable, from recordings in many attitudes.

use super::campaign::{CampaignJob, job_of_campaign};
use super::outcome::fit;
use super::table::TableArgs;
use crate::commands::common::{ForeignArgs, or_document};
use crate::parse::{gravity, height, latitude, numbers, one_of, seconds};
use crate::progress::bytes_bar;
use clap::Args;
use isotherm_campaign::{Campaign, Place};
use isotherm_fit::{ScaleFactorChoice, TumbleOptions};
use isotherm_pipeline::{CampaignFile, Inputs, JobFailure, JobOutcome, RowSource};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Make a table from recordings in many attitudes
///
/// The static poses in the recordings are found, and the magnitude of gravity is the reference. Each file is a separate
/// recording, or third-party data. A campaign file with method = "gravity-only" can take the place of the recordings
/// and of the options that describe them.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm calibrate tumble tumble.csv --imu imu-b --gravity-local 9.8123 --gravity-reference 9.80665 --temperature-unit degC -o imu-b.toml
  isotherm calibrate tumble cold.csv warm.csv --imu imu-b --latitude 48.1 --height 520 --gravity-reference 9.80665 --temperature-unit degC -o imu-b.toml
  isotherm calibrate tumble campaign.toml -o imu-b.toml --scale-factor single")]
pub(super) struct Tumble {
    /// Read these recordings, or a campaign file (.toml)
    ///
    /// Recordings that follow a campaign file replace those that it names.
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
    /// Write the table to this file
    ///
    /// - is stdout. For several IMUs, {imu} in the name stands for the name of each.
    #[arg(short, long, value_name = "TABLE.toml")]
    output: PathBuf,
    /// Name the IMU that was measured
    ///
    /// If a campaign file has several IMUs, only the table of this one is made.
    #[arg(long, value_name = "ID")]
    imu: Option<ImuId>,
    #[command(flatten)]
    gravity: GravityArgs,
    #[command(flatten)]
    table: TableArgs,
    /// Write the report of a batch (HTML)
    ///
    /// For a campaign file with several IMUs. The report shows their spread, and names the ones that stand out.
    #[arg(long, value_name = "BATCH.html")]
    batch: Option<PathBuf>,
    /// Choose how many scale factors an axis has
    ///
    /// single: K- = -K+. split: K+ and K- are separate curves. auto: single, unless split is significant and the
    /// attitudes allow it [default: auto].
    #[arg(long, value_name = "CHOICE", value_parser = one_of(ScaleFactorChoice::NAMES))]
    scale_factor: Option<ScaleFactorChoice>,
    /// Estimate no misalignments
    ///
    /// They remain in the errors, and the table has no alignment matrix.
    #[arg(long)]
    no_misalignment: bool,
    /// Search static poses with windows this long [s]
    ///
    /// The default is 0.5, or 1 if the noise is correlated over that time.
    #[arg(long, value_name = "S", value_parser = seconds)]
    window: Option<Duration>,
    /// State where order 0 is valid
    ///
    /// In the unit of the temperature. Required if the temperature is constant [default: the measured range].
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = range)]
    temperature_range: Option<[f64; 2]>,
    /// Leave out the static pose of this number
    #[arg(long, value_name = "NUMBER")]
    exclude: Vec<usize>,
    #[command(flatten)]
    foreign: ForeignArgs,
}

/// What recordings do not say, and a campaign file does.
#[derive(Debug, Args)]
#[command(next_help_heading = "Recordings without a campaign file")]
struct GravityArgs {
    /// Set gravity at the recordings' place [m/s2]
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_local: Option<f64>,
    /// Set the geodetic latitude there [deg]
    ///
    /// North is positive. With --height, it is used to check --gravity-local. Without --gravity-local, it gives normal
    /// gravity, whose error of 102 ppm (95 %) is then contained in the scale factors.
    #[arg(long, value_name = "DEG", requires = "height", allow_hyphen_values = true, value_parser = latitude)]
    latitude: Option<f64>,
    /// Set the height above the sea there [m]
    #[arg(long, value_name = "M", requires = "latitude", allow_hyphen_values = true, value_parser = height)]
    height: Option<f64>,
    /// Set the value of 1 g0 [m/s2]
    ///
    /// It is written into the table.
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_reference: Option<f64>,
    /// Name the unit of the temperature
    ///
    /// The unit is a label.
    #[arg(long, value_name = "UNIT")]
    temperature_unit: Option<String>,
}

fn range(text: &str) -> Result<[f64; 2], String> {
    let [low, high] = numbers::<2>(text)?;
    if low < high { Ok([low, high]) } else { Err("give the lower end first".to_owned()) }
}

impl GravityArgs {
    /// The campaign of `imu` that the options describe.
    ///
    /// # Errors
    /// With the options that are missing.
    fn campaign(&self, imu: Option<&ImuId>) -> Result<Campaign, Failure> {
        let place = self.latitude.zip(self.height).and_then(|(latitude, height)| Place::new(latitude, height).ok());
        let local = self.gravity_local.or(place.map(Place::normal_gravity));
        let (Some(imu), Some(local), Some(reference), Some(unit)) =
            (imu, local, self.gravity_reference, &self.temperature_unit)
        else {
            let needed = [
                ("--imu <ID>", imu.is_some()),
                ("--gravity-local <G>|--latitude <DEG> --height <M>", local.is_some()),
                ("--gravity-reference <G>", self.gravity_reference.is_some()),
                ("--temperature-unit <UNIT>", self.temperature_unit.is_some()),
            ];
            let missing: Vec<_> = needed.iter().filter(|(_, given)| !given).map(|(name, _)| *name).collect();
            let message = format!(
                "recordings do not say all that a tumble needs; give {}, or a campaign file with method = \"gravity-only\"",
                missing.join(", ")
            );
            return Err(Failure::new(Exit::Usage, message));
        };
        let campaign = Campaign::tumble(imu.clone(), [local, reference], unit);
        Ok(match place {
            Some(place) if self.gravity_local.is_some() => campaign.at_place(place),
            Some(place) => campaign.with_normal_gravity(place),
            None => campaign,
        })
    }

    /// Refuses what a campaign file says itself.
    fn refuse(&self) -> Result<(), Failure> {
        let given = [
            ("--gravity-local", self.gravity_local.is_some()),
            ("--latitude", self.latitude.is_some()),
            ("--gravity-reference", self.gravity_reference.is_some()),
            ("--temperature-unit", self.temperature_unit.is_some()),
        ];
        let Some((name, _)) = given.iter().find(|(_, given)| *given) else { return Ok(()) };
        Err(Failure::new(Exit::Usage, format!("{name} is only for recordings: a campaign file has it as a key")))
    }
}

/// Whether a path is that of a campaign file. Recordings have other endings.
pub(super) fn is_campaign(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

impl Tumble {
    pub(super) fn run(&self, verbose: bool) -> Result<(), Failure> {
        or_document(self.table.json, self.make_tables(verbose))
    }

    fn make_tables(&self, verbose: bool) -> Result<(), JobFailure> {
        self.table.check_stdout(&self.output)?;
        let (file, samples) = match self.recordings.split_first() {
            Some((first, others)) if is_campaign(first) => (Some(CampaignFile::read(first)?), others),
            _ => (None, self.recordings.as_slice()),
        };
        let campaigns = match &file {
            Some(file) => {
                self.gravity.refuse()?;
                campaigns_of(file)?
            }
            None => vec![self.gravity.campaign(self.imu.as_ref())?],
        };
        let file = file.as_ref();
        let job = CampaignJob {
            table: &self.table,
            output: &self.output,
            file,
            samples,
            batch: self.batch.as_deref(),
            others: self.foreign.inputs().collect(),
            calibrate: &|campaign| self.calibrate(campaign, file, samples, verbose),
        };
        job.run(campaigns, self.imu.as_ref())
    }

    fn calibrate(
        &self,
        campaign: &Campaign,
        file: Option<&CampaignFile>,
        samples: &[PathBuf],
        verbose: bool,
    ) -> Result<JobOutcome, JobFailure> {
        let accept = self.table.accepted(None);
        let options = TumbleOptions {
            window_s: self.window.map(|window| window.as_secs_f64()),
            order: self.table.order.0,
            scale_factor: self.scale_factor.unwrap_or_default(),
            misalignment: !self.no_misalignment,
            exclude: self.exclude.clone(),
            temperature_range: self.temperature_range,
            accept: accept.clone(),
            strict: self.table.acceptance.strict,
        };
        let input = self.table.input(self.foreign.read()?, verbose)?;
        let inputs = Inputs::tumble(campaign, file, RowSource::files(samples), options, &input, &bytes_bar)?;
        fit(inputs, (campaign, file), &accept)
    }
}

/// The campaigns of a file, which are tumbles.
fn campaigns_of(file: &CampaignFile) -> Result<Vec<Campaign>, Failure> {
    let campaigns = file.campaigns()?;
    if campaigns.iter().all(|campaign| campaign.is_tumble) {
        return Ok(campaigns);
    }
    let (path, job) = (shown(&file.path), job_of_campaign(&file.path));
    let message = format!("{path}: a campaign on a turntable; `isotherm calibrate {job} {path}` makes the table");
    Err(Failure::new(Exit::Usage, message))
}
