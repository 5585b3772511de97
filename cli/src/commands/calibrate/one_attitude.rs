//! `calibrate --one-attitude`: bias curves from recordings or logs at one attitude.

use super::arguments::{Beside, Calibrate, PolynomialOrder};
use crate::commands::common::inputs;
use crate::commands::export::tell_exported;
use crate::progress::{bytes_bar, spinner};
use isotherm_calibration::{LagChoice, OnBoard, OneAttitudeOptions};
use isotherm_client::ImuId;
use isotherm_failure::{Exit, Failure, shown};
use isotherm_files::{LoadError, StagedText, Trust, load_table, read_parameters, refuse_overlap};
use isotherm_job::{FitOptions, Inputs, Refused, Source};
use isotherm_parameters::{Autopilot, ExportOptions, HIGHEST_ORDER, Parameters, ReadError, export};
use std::path::{Path, PathBuf};

impl Calibrate {
    /// Makes the table, and the parameters that are asked for. Either all files are written or none.
    pub(super) fn make_at_one_attitude(&self, imu: &ImuId) -> Result<(), Refused> {
        self.without_turntable.refuse_options()?;
        let args = &self.at_one_attitude;
        let files: Vec<PathBuf> = core::iter::once(&self.campaign).chain(&self.samples).cloned().collect();
        let [output, report] = self.outputs(imu);
        self.refuse_overlaps_at_one_attitude(&files, [output.as_deref(), report.as_deref()])?;
        let nominal = args.nominal.as_deref().map(|path| load_table(path, Some(imu), Trust::Any));
        let nominal = nominal.transpose()?.map(|(table, _)| table);
        let table = StagedText::create(output.as_deref())?;
        let page = report.as_deref().map(|path| StagedText::create(Some(path))).transpose()?;
        let staged = args.export.iter().map(|(to, path)| Ok((*to, path.as_path(), StagedText::create(Some(path))?)));
        let staged: Vec<(Autopilot, &Path, StagedText)> = staged.collect::<Result<_, Failure>>()?;
        let gravity = self.without_turntable.gravity_reference;
        let options = FitOptions {
            at_one_attitude: OneAttitudeOptions { on_board: self.on_board()?, ..self.options_at_one_attitude() },
            foreign: self.foreign.read()?,
            symptoms: self.verbose,
            ..FitOptions::default()
        };
        let read = Inputs::at_one_attitude(imu, Source::files(&files), nominal, gravity, &options, &bytes_bar)?;
        let (campaign, inputs) = read;
        let spinner = spinner("fitting");
        let made = inputs.fit(&campaign, None);
        spinner.finish_and_clear();
        let made = self.named(made)?;
        let (mut others, mut written) = (Vec::new(), Vec::new());
        for (to, path, staged) in staged {
            let options = self.export_options(to, made.devices);
            let exported = export(made.fitted.table(), &options).map_err(Failure::from)?;
            others.push(staged.write(&exported.text)?);
            written.push((exported, to, path));
        }
        self.write(&campaign, &made, table, page, others)?;
        written.iter().for_each(|(exported, to, path)| tell_exported(exported, *to, path));
        Ok(self.print_json(&made.json())?)
    }

    /// The parameters are of the instance that the log was read of; ArduPilot's count from 1.
    fn export_options(&self, autopilot: Autopilot, [accelerometers, gyroscopes]: [Option<u32>; 2]) -> ExportOptions {
        let parameters = &self.at_one_attitude.parameters;
        let first = *autopilot.instances().start();
        let logged = accelerometers.map(|device| [device, gyroscopes.unwrap_or(device)]);
        let device_id = parameters.device_id.or(logged).filter(|_| autopilot == Autopilot::Px4);
        let instance = self.foreign.instance.and_then(|number| u8::try_from(number).ok());
        let drop = parameters.drop.clone();
        ExportOptions {
            instance: instance.map(|number| number.saturating_add(first)),
            device_id,
            drop,
            ..ExportOptions::new(autopilot)
        }
    }

    fn options_at_one_attitude(&self) -> OneAttitudeOptions {
        let args = &self.at_one_attitude;
        let exports = !args.export.is_empty();
        let cubics = args.beside.iter().filter_map(|beside| match beside {
            Beside::Cubic(autopilot) => Some(*autopilot),
            Beside::Parameters(_) => None,
        });
        // An autopilot has no lag.
        let unless_given = if exports { LagChoice::None } else { LagChoice::Search };
        OneAttitudeOptions {
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

    /// The parameters that are shown beside, of the instance that the log is read of.
    fn on_board(&self) -> Result<Vec<OnBoard>, Failure> {
        let number = self.foreign.instance.and_then(|number| u8::try_from(number).ok());
        self.parameter_files().map(|path| on_board(path, number)).collect()
    }

    /// Refuses outputs that are an input, or that are there twice.
    fn refuse_overlaps_at_one_attitude(&self, files: &[PathBuf], tables: [Option<&Path>; 2]) -> Result<(), Failure> {
        let args = &self.at_one_attitude;
        if self.output == Path::new("-") && args.export.iter().any(|(_, path)| path == Path::new("-")) {
            return Err(Failure::new(Exit::Usage, "-o - and --export both go to stdout; give one of them a file"));
        }
        let mut all = inputs(files);
        all.extend(self.foreign.inputs());
        all.extend(self.parameter_files().map(|path| (path, "the parameters")));
        all.extend(args.nominal.as_deref().map(|path| (path, "the nominal table")));
        let exports = args.export.iter().map(|(_, path)| Some(path.as_path()));
        refuse_overlap(&all, &tables.into_iter().chain(exports).collect::<Vec<_>>())
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
