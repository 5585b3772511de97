//! Parameters of autopilots that `calibrate warm-up` shows and writes.

use crate::commands::export::{ParameterArgs, tell_exported};
use isotherm_autopilot::{Autopilot, ExportOptions, ExportedParameters, Parameters, ReadError, export};
use isotherm_documents::{LoadError, read_parameters};
use isotherm_files::StagedText;
use isotherm_fit::OnBoard;
use isotherm_pipeline::JobOutcome;
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What is shown next to the curves of a table.
#[derive(Clone, Debug)]
pub(super) enum ShownParameters {
    /// The cubic that an autopilot's own script would make.
    Cubic(Autopilot),
    /// The parameters in a file.
    File(PathBuf),
}

impl FromStr for ShownParameters {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            Ok(autopilot) => Ok(Self::Cubic(autopilot)),
            Err(_) if text.contains(['.', '/']) => Ok(Self::File(PathBuf::from(text))),
            Err(error) => Err(format!("{error}, or a file of parameters, such as vehicle.params")),
        }
    }
}

impl ShownParameters {
    pub(super) fn cubic(&self) -> Option<Autopilot> {
        if let Self::Cubic(autopilot) = self { Some(*autopilot) } else { None }
    }

    pub(super) fn file(&self) -> Option<&Path> {
        if let Self::File(path) = self { Some(path) } else { None }
    }
}

/// A file of parameters that is to be written.
#[derive(Clone, Debug)]
pub(super) struct ParameterFile {
    pub autopilot: Autopilot,
    pub path: PathBuf,
}

impl FromStr for ParameterFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (autopilot, file) =
            text.split_once('=').filter(|(_, file)| !file.is_empty()).ok_or("give px4=FILE or ardupilot=FILE")?;
        Ok(Self { autopilot: autopilot.parse()?, path: PathBuf::from(file) })
    }
}

impl ParameterFile {
    /// Prints what was written.
    pub(super) fn tell(&self, exported: &ExportedParameters) {
        tell_exported(exported, self.autopilot, &self.path);
    }
}

/// The files of parameters, which wait to be written.
pub(super) fn staged_exports(files: &[ParameterFile]) -> Result<Vec<StagedText>, Failure> {
    files.iter().map(|file| StagedText::create(Some(&file.path))).collect()
}

/// The parameters by the names of their files, as a report offers them.
pub(super) fn named<'a>(files: &'a [ParameterFile], exported: &'a [ExportedParameters]) -> Vec<(&'a str, &'a str)> {
    let name =
        |file: &'a ParameterFile| file.path.file_name().and_then(|name| name.to_str()).filter(|name| *name != "-");
    let both = files.iter().zip(exported);
    both.filter_map(|(file, exported)| Some((name(file)?, exported.text.as_str()))).collect()
}

/// The parameters of a table, for each file.
pub(super) fn exported(
    files: &[ParameterFile],
    parameters: &ParameterArgs,
    outcome: &JobOutcome,
) -> Result<Vec<ExportedParameters>, Failure> {
    let one = |file: &ParameterFile| {
        let options = parameters.options(file.autopilot, None, outcome.source.log_imu);
        // Only PX4 wants them, not ArduPilot.
        let device_id = options.device_id.filter(|_| file.autopilot == Autopilot::Px4);
        export(outcome.fitted.table(), &ExportOptions { device_id, ..options })
    };
    Ok(files.iter().map(one).collect::<Result<_, _>>()?)
}

/// The parameters in a file, of either autopilot, for the IMU with this number in its log.
pub(super) fn on_board(path: &Path, instance: Option<u32>) -> Result<OnBoard, Failure> {
    let text = read_parameters(path)?;
    let Some(autopilot) = Autopilot::of_text(&text) else {
        let message = format!(
            "{}: neither parameters of PX4 for the temperature, which are TC_.., nor those of ArduPilot, which are INS_TCAL..; give a file \
             with those of one of them",
            shown(path)
        );
        return Err(Failure::new(Exit::Config, message).at(path, None));
    };
    let number = instance.and_then(|number| u8::try_from(number).ok());
    let instance = number.map(|number| number.saturating_add(*autopilot.instances().start()));
    let parameters = Parameters::read(&text, autopilot, instance).map_err(|error| match error {
        ReadError::Instance(error) => Failure::new(Exit::Usage, error.to_string()),
        ReadError::Text(faults) => LoadError::Refused { path: path.to_owned(), faults }.into(),
    })?;
    let name = path.file_name().map_or(path, Path::new);
    Ok(OnBoard { name: shown(name).to_string(), parameters })
}
