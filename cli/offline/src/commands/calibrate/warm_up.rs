//! `calibrate warm-up`: bias curves from recordings or logs at one attitude.

mod export;
mod vehicle;

use super::campaign::job_of_campaign;
use super::outcome::{fit, tell_outcome};
use super::table::{TableArgs, TableFiles, path_of};
use super::tumble::is_campaign;
use crate::commands::common::{ForeignArgs, inputs, or_document};
use crate::commands::export::{ParameterArgs, tell_left_out};
use crate::parse::{gravity, lag_choice};
use crate::progress::bytes_bar;
use clap::Args;
use export::{ParameterFile, ShownParameters, exported, named, on_board, staged_exports};
use isotherm_autopilot::HIGHEST_ORDER;
use isotherm_campaign::Campaign;
use isotherm_documents::load_table;
use isotherm_files::{StagedText, Trust, refuse_overlap};
use isotherm_fit::{LagChoice, WarmUpOptions};
use isotherm_pipeline::{InputOptions, Inputs, JobFailure, JobOutcome, RowSource, Vehicle, VehicleImu};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};

/// Make bias curves from recordings of a warm-up
///
/// The curves are fitted to recordings at one attitude while the IMU warms up or cools, as PX4 and ArduPilot do it.
/// Logs of autopilots and third-party data need no table. The error of the curves is the band between heating and
/// cooling. If a log has several IMUs, each gets a table, named by --imu and the number in the log. --report and
/// --export are then for all IMUs together.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm calibrate warm-up warm-up.ulg --imu imu-b -o imu-b.toml --export px4=imu-b.params
  isotherm calibrate warm-up warm-up.BIN --imu my-drone -o 'my-drone-{instance}.toml' --export ardupilot=my-drone.parm
  isotherm calibrate warm-up warm-up.csv --nominal tumble.toml --imu imu-b -o imu-b.toml")]
pub(super) struct WarmUp {
    /// Read these logs or recordings
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Name the IMU that was measured
    #[arg(long, value_name = "ID")]
    imu: ImuId,
    /// Write the table to this file
    ///
    /// - is stdout. For a log with several IMUs it is a folder, or a name that contains {instance}.
    #[arg(short, long, value_name = "TABLE.toml")]
    output: PathBuf,
    #[command(flatten)]
    table: TableArgs,
    /// Take everything but the biases from this table
    ///
    /// It is a table that was measured in several attitudes, or the nominal one that convert --nominal writes [default:
    /// made from the resolution of the readings]. {instance} in its name stands for the number of the IMU in the log.
    #[arg(long, value_name = "TABLE.toml")]
    nominal: Option<PathBuf>,
    /// Set the value of 1 g0 [m/s2]
    ///
    /// It is written into a table that is made from readings [default: 9.80665].
    #[arg(long, value_name = "G", value_parser = gravity)]
    gravity_reference: Option<f64>,
    /// Keep the nominal accelerometer bias at this temperature
    ///
    /// The default is the middle of the range.
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = crate::parse::number)]
    at: Option<f64>,
    /// Set the lag behind the temperature [s]
    ///
    /// The time constant; or none, for a table without transients [default: found in the recordings; none with
    /// --export].
    #[arg(long, value_name = "auto|S|none", value_parser = lag_choice)]
    lag: Option<LagChoice>,
    /// Compare with the residuals of autopilots' parameters
    ///
    /// Compares the table with the cubics that autopilots would fit to the same rows, or with the parameters in a file,
    /// such as those on board.
    #[arg(long, value_name = "px4,ardupilot,FILE", value_delimiter = ',')]
    beside: Vec<ShownParameters>,
    /// Also write the biases as parameters
    ///
    /// Can be repeated. The orders are then at most 3, and there is no lag unless --lag gives one.
    #[arg(long, value_name = "px4=FILE|ardupilot=FILE")]
    export: Vec<ParameterFile>,
    #[command(flatten)]
    parameters: ParameterArgs,
    #[command(flatten)]
    foreign: ForeignArgs,
}

impl WarmUp {
    pub(super) fn run(&self, verbose: bool) -> Result<(), Failure> {
        or_document(self.table.json, self.make_tables(verbose))
    }

    /// Makes the table, or those of all IMUs of a log, and the parameters that are asked for.
    fn make_tables(&self, verbose: bool) -> Result<(), JobFailure> {
        self.table.check_stdout(&self.output)?;
        if let Some(path) = self.logs.iter().find(|path| is_campaign(path)) {
            let (file, job) = (shown(path), job_of_campaign(path));
            let message = format!("{file}: a campaign file; `isotherm calibrate {job} {file}` makes the table");
            return Err(Failure::new(Exit::Usage, message).into());
        }
        let input = self.table.input(self.foreign.read()?, verbose)?;
        let vehicle = Vehicle::of(&self.imu, &self.logs, &input.foreign, &bytes_bar)?;
        match vehicle.imus.as_slice() {
            [only] => self.make_alone(only, &input),
            _ => self.make_vehicle(&vehicle, &input),
        }
    }

    /// Makes the table of the only IMU. Either all files are written or none.
    fn make_alone(&self, of: &VehicleImu, input: &InputOptions) -> Result<(), JobFailure> {
        let (output, report) = (self.table_of(of), self.report(&of.imu));
        self.refuse_overlaps(&[Some(&output), report.as_deref()])?;
        let files = TableFiles::create(&output, report.as_deref())?;
        let exports = staged_exports(&self.export)?;
        let (campaign, outcome) = self.calibrate(of, input)?;
        let exported = exported(&self.export, &self.parameters, &outcome)?;
        tell_outcome(&outcome, self.table.json);
        let mut texts = files.write(&campaign, &outcome, &named(&self.export, &exported))?;
        for (staged, exported) in exports.into_iter().zip(&exported) {
            texts.push(staged.write(&exported.text)?);
        }
        StagedText::finish_all(texts)?;
        for (file, exported) in self.export.iter().zip(&exported) {
            tell_left_out(exported);
            file.tell(exported);
        }
        Ok(self.table.json.print(&outcome.json())?)
    }

    /// The table of an IMU of a vehicle.
    fn calibrate(&self, of: &VehicleImu, input: &InputOptions) -> Result<(Campaign, JobOutcome), JobFailure> {
        let nominal = self.nominal.as_deref().map(|path| load_table(&of.path(path), Some(&of.imu), Trust::Any));
        let nominal = nominal.transpose()?.map(|(table, _)| table);
        let input = of.input(input);
        let accept = self.table.accepted(None);
        let exports = !self.export.is_empty();
        // An autopilot has no lag.
        let unless_given = if exports { LagChoice::None } else { LagChoice::Search };
        let shown = self.beside.iter().filter_map(ShownParameters::file);
        let on_board = shown.map(|path| on_board(path, input.foreign.settings.instance));
        let options = WarmUpOptions {
            order: self.table.order.0,
            highest_order: exports.then_some(HIGHEST_ORDER),
            lag: self.lag.unwrap_or(unless_given),
            at: self.at,
            beside: self.beside.iter().filter_map(ShownParameters::cubic).collect(),
            on_board: on_board.collect::<Result<_, _>>()?,
            accept: accept.clone(),
            strict: self.table.acceptance.strict,
        };
        let (sources, nominal) = (RowSource::files(&self.logs), (nominal, self.gravity_reference));
        let (campaign, inputs) = Inputs::warm_up(&of.imu, sources, nominal, options, &input, &bytes_bar)?;
        let outcome = fit(inputs, (&campaign, None), &accept)?;
        Ok((campaign, outcome))
    }

    /// Where the table of an IMU goes: into the folder, or with its names in the name.
    fn table_of(&self, of: &VehicleImu) -> PathBuf {
        match self.output.is_dir() {
            true => self.output.join(format!("{}.toml", of.imu)),
            false => of.path(&self.output),
        }
    }

    fn report(&self, imu: &ImuId) -> Option<PathBuf> {
        self.table.report.as_deref().map(|path| path_of(path, imu))
    }

    /// Refuses outputs that are an input, or that are there twice.
    fn refuse_overlaps(&self, tables: &[Option<&Path>]) -> Result<(), Failure> {
        let mut files = inputs(&self.logs);
        files.extend(self.foreign.inputs());
        files.extend(self.beside.iter().filter_map(ShownParameters::file).map(|path| (path, "the parameters")));
        files.extend(self.nominal.as_deref().map(|path| (path, "the nominal table")));
        let exports: Vec<_> = self.export.iter().map(|file| file.path.as_path()).collect();
        if self.output == Path::new("-") && exports.contains(&Path::new("-")) {
            return Err(Failure::new(Exit::Usage, "-o - and --export both go to stdout; give one of them a file"));
        }
        refuse_overlap(&files, &tables.iter().copied().chain(exports.into_iter().map(Some)).collect::<Vec<_>>())
    }
}
