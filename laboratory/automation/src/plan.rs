//! The plan of a campaign: everything that the operator specifies. It is checked before anything moves.

mod files;
mod imus;
mod model;
mod number;
mod ramps;
mod read;
mod stay;
mod turns;
mod warnings;

pub use turns::MAX_ROW_DEG;

pub use files::{RAMP_FILE, READBACKS, RUN_FILE, SAMPLES};
pub use model::{
    DwellPlan, MotionPlan, Patience, Plan, PlannedTurn, RampPlan, SoakPlan, ThereAndBack, TurnPlan, VerificationPlan,
};

use isotherm_campaign::Position;
use isotherm_documents::{LoadError, read_text};
use isotherm_files::Trust;
use isotherm_shared::document::{Document, Faults};
use std::path::Path;

impl Plan {
    /// Reads a plan. Its paths are relative to the folder of the file.
    ///
    /// # Errors
    /// All faults of the file.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, Trust::Any)?;
        Self::from_toml(&text, folder(path)).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// As [`load`](Self::load), for a plan that will run on this computer: the folder of `install` must exist.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_to_run(path: &Path) -> Result<Self, LoadError> {
        let (text, _) = read_text(path, Trust::Any)?;
        Self::parse(&text, folder(path), true).map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })
    }

    /// Parses the text of a plan. Its paths are relative to `folder`.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_automation::plan::Plan;
    /// use std::path::Path;
    ///
    /// let text = include_str!("../../../examples/plan.toml").replace("time_s = 300", "time_s = -300");
    /// let faults = Plan::from_toml(&text, Path::new("/")).err().ok_or("a dwell has a time")?;
    /// assert!(faults.0.iter().any(|fault| fault.key.contains("time_s")), "{faults}");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All faults of the text.
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

    /// Number of dwells and turns of a set point.
    #[must_use]
    pub const fn units_of_set_point(&self) -> usize {
        self.positions.len() + self.turns.len()
    }

    /// Set points with positions and turns, and ramps, as messages show them.
    #[must_use]
    pub fn size(&self) -> String {
        let turns = if self.turns.is_empty() { String::new() } else { format!(" and {} turns", self.turns.len()) };
        let (set_points, positions) = (self.set_points_c.len(), self.positions.len());
        let [open, close] = if turns.is_empty() { ["", ""] } else { ["(", ")"] };
        let ramps = match self.ramps.len() {
            0 => String::new(),
            1 => ", 1 ramp".to_owned(),
            ramps => format!(", {ramps} ramps"),
        };
        format!("{set_points} set points x {open}{positions} positions{turns}{close}{ramps}")
    }

    /// The settings that determine the data, as keys and values. The journal keeps them to recognise the plan that it
    /// belongs to.
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
            ("turntable.rate_deg_s", motion.rate_deg_s),
            ("turntable.acceleration_deg_s2", motion.acceleration_deg_s2),
            ("turntable.tolerance_deg", motion.tolerance_deg),
            ("turntable.still_deg_s", motion.still_deg_s),
            ("turntable.settle_s", motion.settle_s),
        ];
        let mut identity: Vec<_> = numbers.iter().map(|(key, value)| pair(key, format!("{value:?}"))).collect();
        identity.push(pair("set_points", format!("{:?}", self.set_points_c)));
        identity.extend(soak.temperature_per_h.map(|limit| pair("soak.temperature_per_h", format!("{limit:?}"))));
        if let Some(verify) = &self.verify {
            let runs = (1..=verify.runs as usize).map(|run| (run, verify.attitude(run - 1)));
            identity
                .extend(runs.map(|(run, attitude)| (format!("{RUN_KEY}{run}"), there_and_back(&verify.way, attitude))));
        }
        let ramps = (1..).zip(&self.ramps);
        identity
            .extend(ramps.map(|(ramp, RampPlan { way, attitude })| {
                (format!("{RAMP_KEY}{ramp}"), there_and_back(way, attitude))
            }));
        // The keys before the first section of the campaign file: imu, gravity and others.
        let top = self.campaign_toml.lines().take_while(|line| !line.starts_with('['));
        let top = top
            .filter_map(|line| line.split_once(" = "))
            .filter(|(key, _)| !key.starts_with("imus") && !key.starts_with(' '));
        identity.extend(top.map(|(key, value)| pair(key, without_comment(value).to_owned())));
        let members = self.batch.iter().filter_map(|plan| plan.member.as_ref());
        identity.extend(members.map(|member| pair(&format!("imus.{}", member.imu), member.to_toml())));
        identity.extend(self.positions.iter().map(|position| {
            let Position { number, angles, specific_force, .. } = position;
            pair(&format!("position.{number}"), format!("{:?} deg, {specific_force:?}", angles.unwrap_or_default()))
        }));
        if !self.turns.is_empty() {
            let TurnPlan { rest_s, rate_deg_s, acceleration_deg_s2, row_s } = self.turn;
            let numbers = [
                ("turns.rest_s", rest_s),
                ("turns.rate_deg_s", rate_deg_s),
                ("turns.acceleration_deg_s2", acceleration_deg_s2),
                ("turns.row_s", row_s),
            ];
            identity.extend(numbers.iter().map(|(key, value)| pair(key, format!("{value:?}"))));
        }
        identity.extend(self.turns.iter().map(|PlannedTurn { number, from_deg, to_deg, .. }| {
            pair(&format!("turn.{number}"), format!("{from_deg:?} to {to_deg:?} deg"))
        }));
        identity
    }
}

/// Begin of the keys of [`Plan::identity`] for the verification runs; the number of the run follows, from 1.
pub const RUN_KEY: &str = "verify.";
/// The same for the ramps.
pub const RAMP_KEY: &str = "ramp.";
/// What the identity of a chamber's way there and back says of its end.
pub const BACK: &str = " and back";

/// A ramp or a verification run in [`Plan::identity`].
fn there_and_back(way: &ThereAndBack, attitude: &Position) -> String {
    let ThereAndBack { from_c, to_c, ramp_c_per_s, hold_s } = way;
    let (ramp, angles) = (ramp_c_per_s * 3600.0, attitude.angles.unwrap_or_default());
    format!("{from_c:?} to {to_c:?} degC{BACK} at {ramp:?} degC/h, hold {hold_s:?} s, at {angles:?} deg")
}

/// A value of the campaign file without its comment. Only numbers have comments there.
pub fn without_comment(value: &str) -> &str {
    if value.starts_with(['"', '\'']) { value } else { value.split('#').next().unwrap_or(value).trim_end() }
}

/// The folder of a plan's file, which its paths are relative to.
fn folder(plan: &Path) -> &Path {
    plan.parent().unwrap_or(Path::new(""))
}

#[cfg(test)]
mod tests;
