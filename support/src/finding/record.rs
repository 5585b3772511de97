//! A finding, as text and as JSON.

use crate::finding::name::explanations;
use core::fmt;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Nothing is made.
    Fault,
    /// The result is made; the user should look at the message.
    Warning,
}

impl Severity {
    /// Its name: `fault` or `warning`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Warning => "warning",
        }
    }
}

/// The number of a position or of a turn, as the samples carry it in the column `position`.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub enum RunNumber {
    /// Of a position.
    Position(u32),
    /// Of a turn.
    Turn(u32),
}

impl RunNumber {
    /// Only the number.
    #[must_use]
    pub const fn value(self) -> u32 {
        match self {
            Self::Position(number) | Self::Turn(number) => number,
        }
    }
}

/// `position 3` or `turn 15`.
impl fmt::Display for RunNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Position(number) => write!(f, "position {number}"),
            Self::Turn(number) => write!(f, "turn {number}"),
        }
    }
}

/// What a finding concerns.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub enum Location {
    /// A set point \[degC\] of a campaign, or one position or turn there.
    SetPoint(f64, Option<RunNumber>),
    /// A static pose, by its number over all recordings.
    StaticPose(usize),
    /// A recording, by what messages call it.
    Recording(String),
}

/// `set point 5 degC, position 3`, `static_pose 7` or the name of the recording.
impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SetPoint(set_point_c, Some(number)) => write!(f, "set point {set_point_c} degC, {number}"),
            Self::SetPoint(set_point_c, None) => write!(f, "set point {set_point_c} degC"),
            Self::StaticPose(number) => write!(f, "static pose {number}"),
            Self::Recording(name) => f.write_str(name),
        }
    }
}

/// A fault or a warning.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is, one of [`name::SUBJECTS`](crate::finding::name::SUBJECTS); `--accept` takes it.
    #[serde(deserialize_with = "known")]
    pub name: FindingName,
    /// Line of the samples, if the finding concerns one.
    pub line: Option<u64>,
    /// What it concerns; everything if `None`.
    pub place: Option<Location>,
    /// The cause and the remedy.
    pub message: String,
}

/// By another name, so that `serde` does not borrow it from what it reads.
type FindingName = &'static str;

/// The name of a finding, as the program has it.
fn known<'de, D: Deserializer<'de>>(deserializer: D) -> Result<&'static str, D::Error> {
    let text = String::deserialize(deserializer)?;
    let known = explanations().map(|explanation| explanation.name).find(|name| *name == text);
    known.ok_or_else(|| D::Error::custom(format!("no finding is named {text}")))
}

impl Finding {
    /// A finding about everything.
    #[must_use]
    pub const fn whole(severity: Severity, name: &'static str, message: String) -> Self {
        Self { severity, name, line: None, place: None, message }
    }

    /// A warning about everything.
    #[must_use]
    pub const fn warning(name: &'static str, message: String) -> Self {
        Self::whole(Severity::Warning, name, message)
    }

    /// A fault of everything.
    #[must_use]
    pub const fn fault(name: &'static str, message: String) -> Self {
        Self::whole(Severity::Fault, name, message)
    }

    /// The same finding about `place`.
    #[must_use]
    pub fn at(self, place: Location) -> Self {
        Self { place: Some(place), ..self }
    }

    /// The same finding as a warning.
    #[must_use]
    pub fn warned(self) -> Self {
        Self { severity: Severity::Warning, ..self }
    }

    /// `fault [name]: `, then as [`located`](Self::located).
    #[must_use]
    pub fn tagged(&self, locate: impl Fn(u64) -> String) -> String {
        format!("{} [{}]: {}", self.severity.name(), self.name, self.located(locate))
    }

    /// The finding as text, with file and line in front if it has a line. `locate` gives file and line of a row.
    #[must_use]
    pub fn located(&self, locate: impl Fn(u64) -> String) -> String {
        match self.line {
            Some(line) => format!("{}: {self}", locate(line)),
            None => self.to_string(),
        }
    }

    /// The finding as JSON documents have it.
    pub fn record(&self, locate: impl Fn(u64) -> String) -> Record<'_> {
        let (set_point_c, number) = match self.place {
            Some(Location::SetPoint(set_point_c, number)) => (Some(set_point_c), number),
            _ => (None, None),
        };
        Record {
            name: self.name,
            severity: self.severity,
            line: self.line,
            place: self.line.map(locate),
            set_point_c,
            position: number
                .and_then(|number| if let RunNumber::Position(number) = number { Some(number) } else { None }),
            message: &self.message,
            turn: number.and_then(|number| if let RunNumber::Turn(number) = number { Some(number) } else { None }),
            static_pose: if let Some(Location::StaticPose(number)) = self.place { Some(number) } else { None },
            recording: if let Some(Location::Recording(name)) = &self.place { Some(name) } else { None },
        }
    }
}

/// `set point 5 degC, position 3: message`, without the line.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        f.write_str(&self.message)
    }
}

/// A finding in a JSON document.
#[derive(Debug, Serialize)]
pub struct Record<'a> {
    name: &'static str,
    severity: Severity,
    line: Option<u64>,
    /// File and line.
    place: Option<String>,
    set_point_c: Option<f64>,
    position: Option<u32>,
    message: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    turn: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    static_pose: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<&'a str>,
}
