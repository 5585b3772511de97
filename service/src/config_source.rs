//! Where the configuration of a service comes from: a file, the command line, or both.
//!
//! The service keeps the text of the last file with which it has started in the state folder. If the file can no longer
//! be used, as after a crash during an edit, the next start uses that text. Somebody then has to correct the file and
//! to restart the service.

use crate::config::{AtStart, Config, Imu, MAX_IMUS};
use crate::memory::StateFolder;
use isotherm_client::{Domain, ImuId};
use isotherm_documents::LoadError;
use isotherm_files::Trust;
use isotherm_support::failure::{Exit, Failure, shown};
use std::fs;
use std::path::{Path, PathBuf};

/// What the command line says of the configuration.
#[derive(Clone, Debug)]
pub(crate) struct ConfigSource {
    /// Its file, if there is one.
    pub file: Option<PathBuf>,
    /// IMUs in addition to those of the file.
    pub imus: Vec<(ImuId, PathBuf)>,
    /// Whether a file that everybody may write is taken.
    pub trust: Trust,
}

/// The file of the configuration that is in use.
#[derive(Clone, Debug)]
pub(crate) struct ConfigFile {
    /// Its canonical path.
    pub path: PathBuf,
    /// The text that is in use.
    pub text: String,
    /// Why the file is not used, and the text that was kept is; `None` if the text is that of the file.
    pub refused: Option<String>,
}

/// A configuration that can be used, and its file if there is one.
pub(crate) type LoadedConfig = (Config, Option<ConfigFile>);

/// Why there is no configuration.
#[derive(Debug)]
pub(crate) enum ConfigError {
    /// The file is there and cannot be used. One that was kept may take its place.
    Unusable(Failure),
    /// The service cannot start with it.
    Final(Failure),
}

impl ConfigSource {
    /// Reads the file, and adds what the command line says.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(crate) fn load(&self) -> Result<LoadedConfig, ConfigError> {
        let Some(path) = &self.file else {
            return self.complete(Config::default()).map(|config| (config, None)).map_err(ConfigError::Final);
        };
        let (config, text) = Config::load(path, self.trust).map_err(|error| match error {
            LoadError::Refused { ref faults, .. } if faults.0.iter().all(|fault| fault.key != "domain.group") => {
                ConfigError::Unusable(error.into())
            }
            error => ConfigError::Final(error.into()),
        })?;
        let file = ConfigFile { path: canonical(path), text, refused: None };
        self.complete(config).map(|config| (config, Some(file))).map_err(ConfigError::Final)
    }

    /// As [`load`](Self::load), with the text that is kept of the file, which is refused because of `failure`.
    ///
    /// # Errors
    /// `failure` if nothing is kept that can be used, or if it says that the service is to end then.
    pub(crate) fn load_kept(&self, domain: &Domain, failure: Failure) -> Result<LoadedConfig, Failure> {
        let kept = self.file.as_ref().and_then(|path| {
            let text = StateFolder::of(domain).ok()?.load_configuration(&canonical(path))?;
            let config = Config::from_toml(&text, path.parent().unwrap_or(Path::new(""))).ok()?;
            let file = ConfigFile { path: canonical(path), text, refused: Some(failure.message.clone()) };
            (config.at_start == AtStart::Keep).then_some((config, file))
        });
        let Some((config, file)) = kept else { return Err(failure) };
        self.complete(config).map(|config| (config, Some(file)))
    }

    /// Adds the IMUs of the command line.
    fn complete(&self, mut config: Config) -> Result<Config, Failure> {
        for (id, table) in &self.imus {
            if config.imus.iter().any(|known| known.id == *id) {
                return Err(Failure::new(Exit::Usage, format!("IMU {id} is given twice; give every IMU once")));
            }
            config.imus.push(Imu::new(id.clone(), table.clone(), config.max_change));
        }
        if config.imus.is_empty() || config.imus.len() > MAX_IMUS {
            let count = config.imus.len();
            let message = format!("{count} IMUs to serve; give one to {MAX_IMUS} with --imu ID=TABLE or --config FILE");
            return Err(Failure::new(Exit::Usage, message));
        }
        Ok(config)
    }
}

impl ConfigFile {
    /// What an operator must know if the file is not used: in one line, with the remedy.
    pub(crate) fn warning(&self) -> Option<String> {
        let (file, faults) = (shown(&self.path), self.refused.as_ref()?.replace('\n', "; "));
        Some(format!(
            "the configuration {file} was refused at the start, and the last one that worked is in use: {faults}; correct the file, see \
             `isotherm check {file}`, and restart the service"
        ))
    }
}

/// The path of a file without links, by which it is known; as it is if that cannot be found out.
fn canonical(path: &Path) -> PathBuf {
    fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}
