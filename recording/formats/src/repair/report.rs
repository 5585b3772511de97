//! What was taken of a recording, and what was lost.

use serde::Serialize;
use std::fmt;
use std::io;

/// A format of recordings.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingFormat {
    /// Text
    Csv,
    /// Apache Parquet
    Parquet,
    /// MCAP
    Mcap,
}

impl RecordingFormat {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Csv => "CSV",
            Self::Parquet => "Parquet",
            Self::Mcap => "MCAP",
        }
    }
}

/// Why nothing was taken.
pub(super) enum RepairError {
    /// Nothing can be, and why.
    Nothing(String),
    /// The source cannot be read.
    Read(io::Error),
    /// The sink cannot be written.
    Write(io::Error),
}

/// What was taken of a recording, and what was lost.
#[derive(Clone, Debug, Serialize)]
pub struct RepairReport {
    /// Its format.
    pub format: RecordingFormat,
    /// Whether all of it has checks.
    pub has_checks: bool,
    /// The rows of each stream.
    pub streams: Vec<StreamRows>,
    /// The damaged places, in order.
    pub holes: Vec<Hole>,
    /// Rows that were there already, and are left out.
    pub repeats: u64,
    /// What else is left out or written anew, a sentence each.
    pub notes: Vec<String>,
}

/// The rows of a stream that were taken.
#[derive(Clone, Debug, Eq, PartialEq, Serialize)]
pub struct StreamRows {
    /// The stream: `raw`, or with the IMU that the file names, `imu-a raw`.
    pub name: String,
    /// Rows.
    pub rows: u64,
    /// Sessions.
    pub sessions: u64,
}

/// A damaged place.
#[derive(Clone, Debug, Eq, PartialEq, Serialize)]
pub struct Hole {
    /// Where it is: lines, row group, bytes.
    pub place: String,
    /// What is wrong there.
    pub cause: String,
    /// What is lost of each stream.
    pub losses: Vec<Loss>,
}

/// Rows of a stream that are lost.
#[derive(Clone, Debug, Eq, PartialEq, Serialize)]
pub struct Loss {
    /// The stream.
    pub stream: String,
    /// How many, if that is known.
    pub rows: Option<u64>,
    /// The last row before them.
    pub before: Option<RowTime>,
    /// The first row behind them.
    pub behind: Option<RowTime>,
    /// Whether a session begins behind them that is not in the source.
    pub begins_session: bool,
}

/// Which row it is, and when.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq, Serialize)]
pub struct RowTime {
    /// Session; 0 if rows have none.
    pub session: u64,
    /// Sequence.
    pub sequence: u64,
    /// End of the control period, acquisition's clock \[ns\]; 0 if it is not given.
    pub timestamp_ns: u64,
}

impl RepairReport {
    /// The rows that were taken, of all streams.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.streams.iter().map(|stream| stream.rows).sum()
    }

    /// The rows that are lost, of all streams; `None` if it is not known how many.
    #[must_use]
    pub fn lost(&self) -> Option<u64> {
        self.holes.iter().flat_map(|hole| &hole.losses).map(|loss| loss.rows).sum()
    }
}

/// `59997 rows of 2 sessions, checked; 3 rows lost in 1 place`
impl fmt::Display for RepairReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let several = self.streams.len() > 1;
        for (number, StreamRows { name, rows, sessions }) in self.streams.iter().enumerate() {
            let comma = if number > 0 { ", " } else { "" };
            let name = if several { format!("{name} ") } else { String::new() };
            write!(f, "{comma}{name}{} of {}", counted(*rows, "row"), counted(*sessions, "session"))?;
        }
        if self.streams.is_empty() {
            write!(f, "no rows")?;
        }
        if self.repeats > 0 {
            write!(f, ", {} left out", counted(self.repeats, "repeated row"))?;
        }
        if self.holes.is_empty() {
            return write!(f, "; nothing is damaged");
        }
        let places = counted(self.holes.len() as u64, "damaged place");
        match self.lost() {
            Some(lost) => write!(f, "; {} lost in {places}", counted(lost, "row")),
            None => write!(f, "; an unknown number of rows lost in {places}"),
        }
    }
}

/// A line for the place, and one for each stream.
impl fmt::Display for Hole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.cause)?;
        self.losses.iter().try_for_each(|loss| write!(f, "\n  {loss}"))
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stream, rows, before, behind, begins_session } = self;
        write!(f, "{stream}: ")?;
        match rows {
            Some(0) => write!(f, "no row lost")?,
            Some(rows) => write!(f, "{} lost", counted(*rows, "row"))?,
            None => write!(f, "an unknown number of rows lost")?,
        }
        match (before, behind) {
            (Some(before), Some(behind)) if before.session == behind.session => {
                write!(f, " between {before} and {behind}")?;
            }
            (Some(before), Some(behind)) => {
                write!(
                    f,
                    " between {before} of session {} and {behind} of session {}",
                    before.session, behind.session
                )?;
            }
            (Some(before), None) => write!(f, " behind {before}")?,
            (None, Some(behind)) => write!(f, " before {behind}")?,
            (None, None) => {}
        }
        if *begins_session { write!(f, ", where a new session begins") } else { Ok(()) }
    }
}

/// `sequence 1016 (5.0425 s)`
impl fmt::Display for RowTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sequence, timestamp_ns, .. } = self;
        write!(f, "sequence {sequence}")?;
        if *timestamp_ns == 0 {
            return Ok(());
        }
        let fraction = format!("{:09}", timestamp_ns % 1_000_000_000);
        let fraction = fraction.trim_end_matches('0');
        let point = if fraction.is_empty() { "" } else { "." };
        write!(f, " ({}{point}{fraction} s)", timestamp_ns / 1_000_000_000)
    }
}

/// `1 row`, `3 rows`.
fn counted(count: u64, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
