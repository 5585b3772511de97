//! The IMUs of a vehicle: one calibration of the warm-up for each IMU of an autopilot's logs.

use crate::calibrate::InputOptions;
use crate::files::Bar;
use isotherm_autopilot::logs::{FoundImu, found_listed};
use isotherm_campaign::IMU;
use isotherm_files::source;
use isotherm_recording_formats::convert::{Foreign, Settings, imus_of_log};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure};
use std::path::{Path, PathBuf};

/// In names of files, the number of an IMU in its log.
pub const INSTANCE: &str = "{instance}";

/// The IMUs of which recordings are, each of which gets a table of its own. Recordings and logs with one IMU have one.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// The IMUs, by their numbers in the logs.
    pub imus: Vec<VehicleImu>,
    /// What the logs have, for messages: `0 (device 3014666, 3500 rows), 1 (device 2621450, 3500 rows)`.
    pub listed: String,
}

/// One of the IMUs.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct VehicleImu {
    /// Its name: the given one, and with a number behind it where there are several.
    pub imu: ImuId,
    /// Its number in the logs, from 0; `None` of other data.
    pub instance: Option<u32>,
    /// Whether the logs have several IMUs, so that it must be chosen.
    is_chosen: bool,
}

impl Vehicle {
    /// The IMUs of these files, of which `imu` is the name or, where there are several, the beginning of their names.
    /// An IMU that only some of the logs have is one of them. A log is read once for this; where `foreign` names the
    /// instance, no file is read.
    ///
    /// # Errors
    /// If a file cannot be read, if a log has no rows of an IMU, or if a name is too long.
    pub fn of(imu: &ImuId, files: &[PathBuf], foreign: &Foreign, bar: Bar<'_>) -> Result<Self, Failure> {
        if let Some(instance) = foreign.settings.instance {
            let imus = vec![VehicleImu { imu: imu.clone(), instance: Some(instance), is_chosen: true }];
            return Ok(Self { imus, listed: String::new() });
        }
        let bar = bar(files, "looking for IMUs");
        let settings = Settings { progress: bar.clone(), ..foreign.settings.clone() };
        let (mut found, mut has_several): (Vec<FoundImu>, _) = (Vec::new(), false);
        for file in files {
            let of_file = imus_of_log(&source(file), &settings)?;
            has_several |= of_file.len() > 1;
            for other in of_file {
                match found.iter_mut().find(|known| known.imu.instance == other.imu.instance) {
                    Some(known) => known.rows += other.rows,
                    None => found.push(other),
                }
            }
        }
        bar.finish();
        found.sort_by_key(|found| found.imu.instance);
        let imus = if has_several {
            let numbered = |found: &FoundImu| VehicleImu::numbered(imu, found.imu.instance);
            found.iter().map(numbered).collect::<Result<_, _>>()?
        } else {
            let instance = found.first().map(|found| found.imu.instance);
            vec![VehicleImu { imu: imu.clone(), instance, is_chosen: false }]
        };
        Ok(Self { imus, listed: found_listed(&found) })
    }
}

impl VehicleImu {
    fn numbered(imu: &ImuId, instance: u32) -> Result<Self, Failure> {
        let name = format!("{imu}-{instance}");
        let numbered = name.parse();
        let numbered = numbered.map_err(|error| Failure::new(Exit::Usage, format!("the IMU {name}: {error}")))?;
        Ok(Self { imu: numbered, instance: Some(instance), is_chosen: true })
    }

    /// The path with the names of this IMU: for [`IMU`] its name, for [`INSTANCE`] its number, 0 where it has none.
    #[must_use]
    pub fn path(&self, path: &Path) -> PathBuf {
        let number = self.instance.unwrap_or_default().to_string();
        let text = path.to_str().map(|text| text.replace(IMU, self.imu.as_str()).replace(INSTANCE, &number));
        text.map_or_else(|| path.to_owned(), PathBuf::from)
    }

    /// Whether the paths of several IMUs of a vehicle differ.
    #[must_use]
    pub fn tells_apart(path: &Path) -> bool {
        let text = path.to_string_lossy();
        [IMU, INSTANCE].iter().any(|word| text.contains(word))
    }

    /// The options by which only its rows are read.
    #[must_use]
    pub fn input(&self, options: &InputOptions) -> InputOptions {
        let mut own = options.clone();
        if self.is_chosen {
            own.foreign.settings.instance = self.instance;
        }
        own
    }
}
