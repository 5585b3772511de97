//! The lines of the journal.

use crate::stamp::Stamp;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// Version of the format of the lines.
pub(super) const FORMAT: u32 = 1;

/// A line of the journal.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct JournalLine {
    /// When it was written.
    #[serde(flatten)]
    pub at: Stamp,
    /// The IMU of a batch that it is about; `None` if it is about all of them, or if there is only one IMU.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imu: Option<String>,
    /// The event.
    #[serde(flatten)]
    pub entry: Entry,
}

/// An event of the campaign.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Entry {
    /// The campaign begins: the first line, and again if the plan has changed before any unit was kept.
    Begin {
        /// Version of the format of the lines.
        format: u32,
        /// Name and version of the program.
        tool: String,
        /// The plan's settings that determine the data: [`Plan::identity`](crate::plan::Plan::identity).
        plan: Vec<(String, String)>,
    },
    /// A runner has started.
    Started {
        /// Its process id.
        pid: u32,
        /// Ratio of laboratory time to real time.
        speed: f64,
        /// Index of its first unit, from 0.
        unit: usize,
    },
    /// Both instruments have answered.
    Connected {
        /// Identity of the chamber.
        chamber: String,
        /// Identity of the turntable.
        #[serde(rename = "table")]
        turntable: String,
    },
    /// The chamber is at a set point.
    Reached {
        /// The set point \[degC\].
        set_point_c: f64,
    },
    /// The chamber has left the set point, by itself or on command.
    Left,
    /// A unit is complete.
    Kept(KeptStep),
    /// The unit in progress was discarded.
    Discarded {
        /// The reason.
        reason: String,
    },
    /// An IMU of a batch is dropped: no more of its samples are taken. The others go on.
    Dropped {
        /// The reason.
        reason: String,
    },
    /// A pause has begun: nothing is commanded until all is well again.
    Paused {
        /// The cause.
        cause: String,
    },
    /// The pause is over.
    Resumed {
        /// Laboratory time since all was well before the pause \[s\].
        after_s: f64,
    },
    /// A runner, or `campaign stop`, has brought the instruments into the safe state.
    Safe {
        /// The reason.
        reason: String,
        /// Whether an operator has asked for it.
        stopped: bool,
        /// The outcome for the turntable, as messages show it.
        #[serde(rename = "table")]
        turntable: String,
        /// The outcome for the chamber, as messages show it.
        chamber: String,
        /// Whether both instruments have confirmed the safe state.
        certain: bool,
    },
    /// The fit has begun: what became of an earlier one counts no longer.
    FitBegun,
    /// The coefficient table is fitted.
    Calibrated {
        /// Digest of the table.
        digest: String,
        /// The bottom line: errors of its curves.
        accuracy: String,
    },
    /// There is no table.
    NotCalibrated {
        /// The reason.
        reason: String,
    },
    /// A verification run is judged.
    Verified {
        /// The run's file.
        run: String,
        /// Outer and inner angle of its attitude \[deg\].
        angles_deg: Option<[f64; 2]>,
        /// The largest error that it shows; `None` if it shows none.
        largest: Option<LargestError>,
        /// Why the table must not be installed, one reason a line; `None` if nothing speaks against it.
        refused: Option<String>,
    },
    /// Something of the table is judged by no verification run.
    NotJudged {
        /// What, and why.
        reasons: Vec<String>,
    },
    /// The table is left aside.
    NotInstalled {
        /// The reasons, one a line. Those of a run are in [`Entry::Verified`].
        reason: String,
    },
    /// The coefficient table is installed.
    Installed {
        /// Digest of the table.
        digest: String,
        /// The installed file, absolute.
        file: PathBuf,
    },
}

/// The largest error of a verification run. Its numbers are finite: JSON has no others.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct LargestError {
    /// A1, A2, A3 or the length.
    pub of: String,
    /// The error \[g0\].
    pub error_g0: f64,
    /// Half width of its 95 % interval \[g0\].
    pub interval_g0: f64,
}

impl fmt::Display for LargestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:.3} +- {:.3}e-6 g0", self.of, self.error_g0 * 1e6, self.interval_g0 * 1e6)
    }
}

/// A complete unit.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct KeptStep {
    /// Its index, from 0.
    pub unit: usize,
    /// Its name, as messages show it.
    pub name: String,
    /// Outer and inner angle of the turntable, where a turn begins \[deg\].
    pub angles_deg: [f64; 2],
    /// The read-backs of a turn; `None` for other units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<TurnReadBacks>,
    /// The name of its file in the campaign's folder.
    pub file: String,
    /// Where it begins in the file \[bytes\].
    pub from: u64,
    /// Where it ends in the file \[bytes\].
    pub to: u64,
    /// SHA-256 of these bytes.
    pub sha256: String,
    /// Number of rows.
    pub rows: u64,
    /// Counted time \[s\].
    pub seconds: f64,
    /// End of its last sample, as written \[ns\].
    pub end_ns: u64,
    /// The acquisition's session.
    pub session: u64,
    /// Shift that was added to the session's timestamps \[ns\], so that time rises over all sessions.
    pub shift_ns: u64,
    /// Number of gaps in the sequence.
    pub gaps: u64,
    /// Number of samples left out: temperature too old or missing, counter saturated, interval or time invalid.
    pub left_out: u64,
    /// The same unit of the other IMUs of a batch that are not dropped. All of them are in one line, so that a unit is
    /// complete or not.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Self>,
}

impl KeptStep {
    /// The unit of each IMU.
    pub fn each(&self) -> impl Iterator<Item = &Self> {
        std::iter::once(self).chain(&self.others)
    }
}

/// The read-backs of a turn: outer and inner angle at rest \[deg\].
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct TurnReadBacks {
    /// The angle that was commanded, right-handed about the axis of the turntable \[deg\].
    pub angle_deg: f64,
    /// Before the turn.
    pub before_deg: [f64; 2],
    /// After the turn.
    pub after_deg: [f64; 2],
}
