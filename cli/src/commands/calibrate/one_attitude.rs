//! `calibrate --one-attitude`: bias curves from recordings or logs at one attitude.

use super::arguments::{Beside, Calibrate, PolynomialOrder};
use crate::commands::common::inputs;
use crate::commands::export::{tell_exported, tell_left_out};
use crate::progress::{bytes_bar, spinner};
use isotherm_autopilot::{Autopilot, ExportOptions, Exported, HIGHEST_ORDER, Parameters, ReadError, export};
use isotherm_campaign::Campaign;
use isotherm_client::ImuId;
use isotherm_files::{LoadError, StagedText, Trust, load_table, read_parameters, refuse_overlap};
use isotherm_fit::{LagChoice, OnBoard, WarmUpOptions};
use isotherm_pipeline::{FitOptions, Inputs, Made, Refused, Source, Vehicle, VehicleImu};
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};

/// The recordings of a calibration at one attitude, and the options of its fit.
pub(super) struct WarmUp {
    pub(super) files: Vec<PathBuf>,
    pub(super) options: FitOptions,
}

/// A file of parameters that is to be written.
type StagedExport<'a> = (Autopilot, &'a Path, StagedText);

impl Calibrate {
    /// Makes the table, or those of all IMUs of a log, and the parameters that are asked for. The inner result tells
    /// which IMUs were dropped.
    pub(super) fn make_at_one_attitude(&self, imu: &ImuId) -> Result<Result<(), Failure>, Refused> {
        self.without_turntable.refuse_options()?;
        let options = FitOptions {
            at_one_attitude: self.options_at_one_attitude(),
            foreign: self.foreign.read()?,
            part: self.part.get()?,
            symptoms: self.verbose,
            ..FitOptions::default()
        };
        let files = self.campaign.iter().chain(&self.samples).cloned().collect();
        let warm_up = WarmUp { files, options };
        let vehicle = Vehicle::of(imu, &warm_up.files, &warm_up.options.foreign, &bytes_bar)?;
        match vehicle.imus.as_slice() {
            [only] => Ok(Ok(self.make_alone(only, &warm_up)?)),
            _ => self.make_vehicle(imu, &vehicle, &warm_up),
        }
    }

    /// Makes the table of the only IMU. Either all files are written or none.
    fn make_alone(&self, of: &VehicleImu, warm_up: &WarmUp) -> Result<(), Refused> {
        let output = self.table_of(of);
        let [_, report] = self.outputs(&of.imu);
        self.refuse_overlaps_at_one_attitude(&warm_up.files, &[Some(&output), report.as_deref()])?;
        let table = StagedText::create(Some(&output))?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let exports = self.staged_exports()?;
        let (campaign, made) = self.fit_at_one_attitude(of, warm_up)?;
        let exported = self.exported(&made)?;
        let (mut others, mut written) = (Vec::new(), Vec::new());
        for ((to, path, staged), exported) in exports.into_iter().zip(exported) {
            others.push(staged.write(&exported.text)?);
            written.push((exported, to, path));
        }
        self.write(&campaign, &made, table, page, others)?;
        for (exported, to, path) in &written {
            tell_left_out(exported);
            tell_exported(exported, *to, path);
        }
        Ok(self.print_json(&made.json())?)
    }

    /// The table of an IMU of a vehicle.
    pub(super) fn fit_at_one_attitude(&self, of: &VehicleImu, warm_up: &WarmUp) -> Result<(Campaign, Made), Refused> {
        let nominal = self.at_one_attitude.nominal.as_deref().map(|path| of.path(path));
        let nominal = nominal.map(|path| load_table(&path, Some(&of.imu), Trust::Any));
        let nominal = nominal.transpose()?.map(|(table, _)| table);
        let gravity = self.without_turntable.gravity_reference;
        let mut options = of.options(&warm_up.options);
        options.at_one_attitude.on_board = self.on_board(options.foreign.settings.instance)?;
        let sources = Source::files(&warm_up.files);
        let read = Inputs::at_one_attitude(&of.imu, sources, nominal, gravity, &options, &bytes_bar)?;
        let (campaign, inputs) = read;
        let spinner = spinner("fitting");
        let made = inputs.fit(&campaign, None);
        spinner.finish_and_clear();
        Ok((campaign, self.named(made)?))
    }

    /// Where the table of an IMU goes: into the folder, or with its names in the name.
    pub(super) fn table_of(&self, of: &VehicleImu) -> PathBuf {
        match self.output().is_dir() {
            true => self.output().join(format!("{}.toml", of.imu)),
            false => of.path(self.output()),
        }
    }

    /// The files of parameters, which wait to be written.
    pub(super) fn staged_exports(&self) -> Result<Vec<StagedExport<'_>>, Failure> {
        let staged = |(to, path): &'_ (Autopilot, PathBuf)| StagedText::create(Some(path)).map(|staged| (*to, staged));
        let all = self.at_one_attitude.export.iter();
        all.map(|export| staged(export).map(|(to, staged)| (to, export.1.as_path(), staged))).collect()
    }

    /// The parameters of a table, for each `--export`.
    pub(super) fn exported(&self, made: &Made) -> Result<Vec<Exported>, Failure> {
        let all = self.at_one_attitude.export.iter();
        let one = |(to, _): &(Autopilot, PathBuf)| {
            let options = self.at_one_attitude.parameters.options(*to, None, made.source.log_imu);
            // Of two autopilots only PX4 wants them.
            let device_id = options.device_id.filter(|_| *to == Autopilot::Px4);
            export(made.fitted.table(), &ExportOptions { device_id, ..options })
        };
        Ok(all.map(one).collect::<Result<_, _>>()?)
    }

    fn options_at_one_attitude(&self) -> WarmUpOptions {
        let args = &self.at_one_attitude;
        let exports = !args.export.is_empty();
        let cubics = args.beside.iter().filter_map(|beside| match beside {
            Beside::Cubic(autopilot) => Some(*autopilot),
            Beside::Parameters(_) => None,
        });
        // An autopilot has no lag.
        let unless_given = if exports { LagChoice::None } else { LagChoice::Search };
        WarmUpOptions {
            order: match self.order {
                PolynomialOrder::Auto => None,
                PolynomialOrder::Fixed(order) => Some(order),
            },
            highest_order: exports.then_some(HIGHEST_ORDER),
            lag: self.lag.unwrap_or(unless_given),
            at: args.at,
            beside: cubics.collect(),
            on_board: Vec::new(),
            accept: self.accepted(),
            strict: self.acceptance.strict,
        }
    }

    /// The files of parameters that are shown beside.
    fn parameter_files(&self) -> impl Iterator<Item = &Path> {
        self.at_one_attitude.beside.iter().filter_map(|beside| match beside {
            Beside::Cubic(_) => None,
            Beside::Parameters(path) => Some(path.as_path()),
        })
    }

    /// The parameters that are shown beside, of an instance of the log.
    fn on_board(&self, instance: Option<u32>) -> Result<Vec<OnBoard>, Failure> {
        let number = instance.and_then(|number| u8::try_from(number).ok());
        self.parameter_files().map(|path| on_board(path, number)).collect()
    }

    /// Refuses outputs that are an input, or that are there twice.
    pub(super) fn refuse_overlaps_at_one_attitude(
        &self,
        files: &[PathBuf],
        tables: &[Option<&Path>],
    ) -> Result<(), Failure> {
        let args = &self.at_one_attitude;
        if self.output() == Path::new("-") && args.export.iter().any(|(_, path)| path == Path::new("-")) {
            return Err(Failure::new(Exit::Usage, "-o - and --export both go to stdout; give one of them a file"));
        }
        let mut all = inputs(files);
        all.extend(self.foreign.inputs());
        all.extend(self.parameter_files().map(|path| (path, "the parameters")));
        all.extend(args.nominal.as_deref().map(|path| (path, "the nominal table")));
        let exports = args.export.iter().map(|(_, path)| Some(path.as_path()));
        refuse_overlap(&all, &tables.iter().copied().chain(exports).collect::<Vec<_>>())
    }
}

/// The parameters in a file, of either autopilot, for the IMU with this number in its log.
fn on_board(path: &Path, number: Option<u8>) -> Result<OnBoard, Failure> {
    let text = read_parameters(path)?;
    let Some(autopilot) = Autopilot::of_text(&text) else {
        let message = format!(
            "{}: neither parameters of PX4 for the temperature, which are TC_.., nor those of ArduPilot, which are INS_TCAL..; give a file \
             with those of one of them",
            shown(path)
        );
        return Err(Failure::new(Exit::Config, message).at(path, None));
    };
    let instance = number.map(|number| number.saturating_add(*autopilot.instances().start()));
    let parameters = Parameters::read(&text, autopilot, instance).map_err(|error| match error {
        ReadError::Instance(error) => Failure::new(Exit::Usage, error.to_string()),
        ReadError::Text(faults) => LoadError::Refused { path: path.to_owned(), faults }.into(),
    })?;
    let name = path.file_name().map_or(path, Path::new);
    Ok(OnBoard { name: shown(name).to_string(), parameters })
}
