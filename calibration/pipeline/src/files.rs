//! The files of a calibration.

use isotherm_campaign::{Campaign, select_imu};
use isotherm_documents::{LoadError, read_text};
use isotherm_files::Trust;
use isotherm_recording::{Observer, Progress};
use isotherm_recording_formats::convert::Mapping;
use isotherm_shared::document::Faults;
use isotherm_support::failure::{Exit, Failure, shown, tell};
use std::path::{Path, PathBuf};

/// Makes the progress bar for reading these files, with a word of what is done.
pub type Bar<'a> = &'a dyn Fn(&[PathBuf], &'static str) -> Progress;

/// No progress bar.
#[must_use]
pub fn no_bar(_: &[PathBuf], _: &'static str) -> Progress {
    Progress::new(NoBar)
}

/// Prints only warnings.
struct NoBar;

impl Observer for NoBar {
    fn warn(&self, message: &str) {
        tell("isotherm", message);
    }
}

/// A campaign file: its path, and its text.
#[derive(Clone, Debug)]
pub struct CampaignFile {
    /// Its path; messages name it, and the files that it names are next to it.
    pub path: PathBuf,
    /// Its text.
    pub text: String,
}

impl CampaignFile {
    /// Reads the file.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let (text, _) = read_text(path, Trust::Any)?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// The campaigns of all of its IMUs.
    ///
    /// # Errors
    /// As [`checked`](Self::checked).
    pub fn campaigns(&self) -> Result<Vec<Campaign>, Failure> {
        Ok(self.checked().map_err(|faults| LoadError::Refused { path: self.path.clone(), faults })?)
    }

    /// The campaigns of all of its IMUs.
    ///
    /// # Errors
    /// Everything that is wrong in the text, also in what it says of the columns of its samples, with line and key.
    pub fn checked(&self) -> Result<Vec<Campaign>, Faults> {
        match (Campaign::batch_from_toml(&self.text), Mapping::of_campaign(&self.text)) {
            (Ok(campaigns), Ok(_)) => Ok(campaigns),
            (Err(faults), Ok(_)) | (Ok(_), Err(faults)) => Err(faults),
            (Err(Faults(mut all)), Err(Faults(of_columns))) => {
                all.extend(of_columns);
                all.sort_by_key(|fault| fault.line);
                Err(Faults(all))
            }
        }
    }

    /// What the columns of the samples are, if it says so.
    pub(crate) fn mapping(&self) -> Result<Option<Mapping>, Failure> {
        let mapping = Mapping::of_campaign(&self.text);
        Ok(mapping.map_err(|faults| LoadError::Refused { path: self.path.clone(), faults })?)
    }

    /// The campaign of `imu`, or the only one.
    ///
    /// # Errors
    /// As [`campaigns`](Self::campaigns), and if it is not in the file.
    pub fn campaign(&self, imu: Option<&str>) -> Result<Campaign, Failure> {
        let chosen = select_imu(self.campaigns()?, imu);
        chosen.map_err(|message| Failure::new(Exit::Usage, format!("{}: {message}", shown(&self.path))))
    }

    /// Its name without the folder.
    #[must_use]
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// A file that the campaign file names.
    #[must_use]
    pub fn beside(&self, name: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(name)
    }

    /// The recordings of the ramps of `campaign`.
    #[must_use]
    pub fn ramps(&self, campaign: &Campaign) -> Vec<PathBuf> {
        campaign.ramps.iter().map(|ramp| self.beside(&ramp.samples)).collect()
    }

    /// The table that gives the curves of only ramps.
    #[must_use]
    pub fn curves(&self, campaign: &Campaign) -> Option<PathBuf> {
        campaign.curves.as_ref().map(|name| self.beside(name))
    }
}
