//! The plan of a campaign: everything that is asked for, checked before anything moves.

mod read;

use super::limits::Limits;
use isotherm_calibration::campaign::Campaign;
use isotherm_calibration::positions::Position;
use isotherm_files::{Guard, LoadError, read_text};
use isotherm_instruments::{ChamberConfig, TurntableConfig};
use isotherm_shared::document::{Document, Faults};
use isotherm_shared::stream::ImuId;
use std::path::{Path, PathBuf};

/// The samples' file in the campaign's folder.
pub const SAMPLES: &str = "campaign.csv";

/// A checked plan. Times \[s\] are the laboratory's.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Whose campaign it is.
    pub imu: ImuId,
    /// Folder of everything that the campaign writes.
    pub output: PathBuf,
    /// Chamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// At each set point, in order; all with angles.
    pub positions: Vec<Position>,
    /// When a set point counts as reached and settled.
    pub soak: Soak,
    /// What is taken in a position.
    pub dwell: Dwell,
    /// How the chamber is led.
    pub ramp_c_per_s: f64,
    /// How the table moves, and when it counts as arrived.
    pub motion: Motion,
    /// What no command and no reading may exceed.
    pub limits: Limits,
    /// How long things may take that should not.
    pub patience: Patience,
    /// The safe state's chamber: a set point to hold \[degC\], or standby.
    pub ambient_c: Option<f64>,
    /// Verification runs.
    pub verify: Option<Verify>,
    /// Where the table goes if the verification holds.
    pub install: Option<PathBuf>,
    /// The chamber's driver and line.
    pub chamber: ChamberConfig,
    /// The table's driver and line.
    pub table: TurntableConfig,
    /// The campaign file that will lie beside the samples.
    pub campaign_toml: String,
    /// The same, read.
    pub campaign: Campaign,
}

/// When a set point counts as settled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Soak {
    /// At the set point before the first position.
    pub time_s: f64,
    /// At the set point in all.
    pub stay_s: f64,
    /// The air is at the set point within this \[degC\].
    pub tolerance_c: f64,
    /// Rates of change are taken over this.
    pub window_s: f64,
    /// Largest rate of change of the air \[degC/h\].
    pub chamber_c_per_h: f64,
    /// Largest rate of change of each of the IMU's temperatures \[unit/h\].
    pub telemetry_per_h: Option<f64>,
}

/// What is taken in a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dwell {
    /// Counted time.
    pub time_s: f64,
    /// Samples are summed into rows of this; 0 for every sample.
    pub row_s: f64,
}

/// How the table moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// \[deg/s\]
    pub rate_deg_s: f64,
    /// \[deg/s2\]
    pub acceleration_deg_s2: f64,
    /// Arrived: this near \[deg\],
    pub tolerance_deg: f64,
    /// this slow \[deg/s\],
    pub still_deg_s: f64,
    /// for this long.
    pub settle_s: f64,
}

/// How long things may take that should not, before the campaign pauses or gives up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// A pause: an instrument or the IMU's stream is away.
    pub pause_s: f64,
    /// Without a usable sample.
    pub stream_s: f64,
    /// To the set point, beyond the ramp.
    pub approach_s: f64,
    /// Until stable, beyond the soak.
    pub stable_s: f64,
    /// Until the table has settled, beyond the way.
    pub settle_s: f64,
    /// An interruption that is longer makes the soak begin anew.
    pub resoak_s: f64,
    /// Attempts at one dwell, and interruptions between two.
    pub attempts: u32,
}

/// Verification: the IMU at rest while the chamber runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verify {
    /// How many.
    pub runs: u32,
    /// Chamber at the beginning \[degC\].
    pub from_c: f64,
    /// Chamber at the end \[degC\].
    pub to_c: f64,
    /// The ramp between them \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Before the ramp, and again after it.
    pub hold_s: f64,
    /// Outer and inner angle \[deg\].
    pub angles_deg: [f64; 2],
    /// Direction of the specific force there.
    pub attitude: [f64; 3],
}

impl Verify {
    /// Where the IMU is at rest.
    pub const fn position(&self) -> Position {
        let label = String::new();
        Position { number: 0, label, angles: Some(self.angles_deg), specific_force: self.attitude }
    }
}

impl Plan {
    /// Reads a plan. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// Everything that is wrong with the file.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, Guard::Lax)?;
        Self::from_toml(&text, folder(path)).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// As [`load`](Self::load), for a plan that is to be run here: the folder of `install` must be there.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_to_run(path: &Path) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, Guard::Lax)?;
        Self::parse(&text, folder(path), true).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// Reads a plan's text; `folder` is where its relative paths begin.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, Faults> {
        Self::parse(text, folder, false)
    }

    fn parse(text: &str, folder: &Path, to_run: bool) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the campaign plan")?;
        let root = document.root();
        let plan = read::plan(&root, folder, to_run);
        root.finish();
        document.finish(plan)
    }

    /// Whether the text of a TOML file is a plan.
    #[must_use]
    pub fn is_meant(document: &Document<'_>) -> bool {
        ["set_points", "soak", "dwell", "chamber", "limits", "patience", "verify"].iter().any(|key| document.has(key))
    }

    /// What makes the data what they are, for telling whether a journal is this plan's: key and value.
    #[must_use]
    pub fn identity(&self) -> Vec<(String, String)> {
        let pair = |key: &str, value: String| (key.to_owned(), value);
        let Self { soak, dwell, motion, .. } = self;
        let numbers = [
            ("soak.time_s", soak.time_s),
            ("soak.stay_s", soak.stay_s),
            ("soak.window_s", soak.window_s),
            ("soak.chamber_c_per_h", soak.chamber_c_per_h),
            ("dwell.time_s", dwell.time_s),
            ("dwell.row_s", dwell.row_s),
            ("chamber.ramp_c_per_min", self.ramp_c_per_s * 60.0),
            ("chamber.tolerance_c", soak.tolerance_c),
            ("table.rate_deg_s", motion.rate_deg_s),
            ("table.acceleration_deg_s2", motion.acceleration_deg_s2),
            ("table.tolerance_deg", motion.tolerance_deg),
            ("table.still_deg_s", motion.still_deg_s),
            ("table.settle_s", motion.settle_s),
        ];
        let mut identity: Vec<_> = numbers.iter().map(|(key, value)| pair(key, format!("{value:?}"))).collect();
        identity.push(pair("set_points", format!("{:?}", self.set_points_c)));
        identity.extend(soak.telemetry_per_h.map(|limit| pair("soak.telemetry_per_h", format!("{limit:?}"))));
        if let Some(verify) = &self.verify {
            let Verify { runs, from_c, to_c, ramp_c_per_s, hold_s, angles_deg, .. } = verify;
            let ramp = ramp_c_per_s * 3600.0;
            let value = format!(
                "{runs} runs, {from_c:?} to {to_c:?} degC at {ramp:?} degC/h, hold {hold_s:?} s, at {angles_deg:?} deg"
            );
            identity.push(pair("verify", value));
        }
        // What stands above the positions: imu, gravity and the like.
        let above = self.campaign_toml.lines().take_while(|line| !line.starts_with('['));
        identity
            .extend(above.filter_map(|line| line.split_once(" = ")).map(|(key, value)| pair(key, value.to_owned())));
        identity.extend(self.positions.iter().map(|position| {
            let Position { number, angles, specific_force, .. } = position;
            pair(&format!("position.{number}"), format!("{:?} deg, {specific_force:?}", angles.unwrap_or_default()))
        }));
        identity
    }
}

/// Where the relative paths of a plan begin.
fn folder(plan: &Path) -> &Path {
    plan.parent().unwrap_or(Path::new(""))
}

#[cfg(test)]
mod tests;
