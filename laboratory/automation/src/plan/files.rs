//! The names of the files in a campaign's folder. Those of an IMU of a batch have its name in them.

use super::model::Plan;
use isotherm_documents::read_text;
use isotherm_files::{Trust, replace};
use isotherm_support::failure::{Failure, shown};

/// The file of the dwells' samples of a single IMU.
pub const SAMPLES: &str = "campaign.csv";
/// Begin of the names of the verification runs' files; the number of the run follows, from 1.
pub const RUN_FILE: &str = "verify-";
/// The same for the ramps.
pub const RAMP_FILE: &str = "ramp-";
/// Begin of the names of the files with the read-backs.
pub const READBACKS: &str = "readbacks";

/// The file of the dwells' samples. `imu` is the name of an IMU of a batch, `None` for a single one.
pub(super) fn samples_file(imu: Option<&str>) -> String {
    imu.map_or_else(|| SAMPLES.to_owned(), |imu| format!("{imu}.csv"))
}

/// The file of a ramp's samples; the ramp is counted from 0.
pub(super) fn ramp_file(ramp: usize, imu: Option<&str>) -> String {
    own_file(&format!("{RAMP_FILE}{}", ramp + 1), "csv", imu)
}

fn own_file(stem: &str, extension: &str, imu: Option<&str>) -> String {
    let imu = imu.map_or_else(String::new, |imu| format!("-{imu}"));
    format!("{stem}{imu}.{extension}")
}

/// Why an IMU of a batch cannot have this name: its samples would have a name that other files have. `None` if it can.
pub(super) fn taken_name(imu: &str) -> Option<String> {
    let taken = [RUN_FILE, RAMP_FILE, READBACKS].into_iter().find(|begin| imu.starts_with(begin))?;
    let file = samples_file(Some(imu));
    Some(format!(
        "is {imu:?}, its samples would be {file}, but other files have names that begin with {taken}; run it by itself, or give it another name"
    ))
}

impl Plan {
    /// The name in the IMU's files: that of an IMU of a batch, `None` for a single one.
    fn name_in_files(&self) -> Option<&str> {
        self.member.as_ref().map(|member| member.imu.as_str())
    }

    /// The file of the dwells' and turns' samples.
    #[must_use]
    pub fn samples_file(&self) -> String {
        samples_file(self.name_in_files())
    }

    /// The file of a ramp's samples; the ramp is counted from 0.
    #[must_use]
    pub fn ramp_file(&self, ramp: usize) -> String {
        ramp_file(ramp, self.name_in_files())
    }

    /// The file of a verification run's samples; the run is counted from 0.
    #[must_use]
    pub fn run_file(&self, run: usize) -> String {
        self.file(&format!("{RUN_FILE}{}", run + 1), "csv")
    }

    /// Names of the verification runs' files.
    #[must_use]
    pub fn run_files(&self) -> Vec<String> {
        (0..self.verify.as_ref().map_or(0, |verify| verify.runs as usize)).map(|run| self.run_file(run)).collect()
    }

    /// Another file of the IMU: `stem` and `extension`, and between them the name of an IMU of a batch.
    #[must_use]
    pub fn file(&self, stem: &str, extension: &str) -> String {
        own_file(stem, extension, self.name_in_files())
    }

    /// Writes the campaign file next to the samples. If another text is there, the log says so: the fit takes what the
    /// plan says.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write_campaign_file(&self) -> Result<(), Failure> {
        let path = self.output.join("campaign.toml");
        match read_text(&path, Trust::Any) {
            Ok((text, _)) if text == self.campaign_toml => return Ok(()),
            Ok((text, _)) => {
                // What is there less is at the end.
                let pairs = text.lines().chain([""]).zip(self.campaign_toml.lines().chain([""]));
                let different = (1..).zip(pairs).find(|(_, (there, planned))| there != planned);
                let different = different.map_or_else(String::new, |(number, (there, planned))| {
                    format!(": line {number} was `{there}`, is `{planned}`")
                });
                tracing::warn!(
                    "{} was not what the plan gives; it is written again from the plan{different}",
                    shown(&path)
                );
            }
            Err(_) => {}
        }
        replace(&path, &self.campaign_toml).map_err(|error| Failure::io("writing", &path, &error))
    }
}
