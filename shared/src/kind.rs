//! The kinds of TOML files, recognised by their keys. All programs use this rule, so that they agree on what a file is.

use crate::document::Document;

/// A kind of TOML file.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum FileKind {
    /// A campaign plan: what an automatic campaign is to do.
    Plan,
    /// A campaign file: what a laboratory states about the samples of a campaign.
    Campaign,
    /// A mapping: what the columns of foreign data are.
    Mapping,
    /// The description of an acquisition's source.
    Source,
    /// The description of a node of ROS 2.
    Node,
    /// A configuration of the service.
    Configuration,
    /// A coefficient table.
    Table,
}

impl FileKind {
    /// The kind that a document is meant to be: it has one of the keys of that kind, valid or not. `None` if it has
    /// none of any.
    ///
    /// A plan is tried first, because it may have positions like a campaign. A configuration has a list `[[imu]]`, a
    /// table a section `[imu]`.
    #[must_use]
    pub fn of(document: &Document<'_>) -> Option<Self> {
        let has = |keys: &[&str]| keys.iter().any(|key| document.has(key));
        if has(&["set_points", "soak", "dwell", "chamber", "limits", "patience", "verify"]) {
            Some(Self::Plan)
        } else if has(&["position", "ramp", "samples", "gravity_reference"]) {
            Some(Self::Campaign)
        } else if has(&["publish", "subscribe", "ros2"]) {
            Some(Self::Node)
        } else if has(&["source", "timing", "frame", "lines", "iio"]) {
            Some(Self::Source)
        } else if has(&["accelerometer", "time"]) || document.has("gyroscope") && !document.is_list("gyroscope") {
            // A table has a list of gyroscopes.
            Some(Self::Mapping)
        } else if document.is_list("imu") || has(&["wait", "latency", "realtime", "metrics"]) {
            Some(Self::Configuration)
        } else if has(&["axis", "imu", "temperature", "alignment", "format", "digest"]) {
            Some(Self::Table)
        } else {
            None
        }
    }

    /// Its name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plan => "a campaign plan",
            Self::Campaign => "a campaign file",
            Self::Mapping => "a mapping",
            Self::Source => "the description of a source",
            Self::Node => "the description of a node of ROS 2",
            Self::Configuration => "a service configuration",
            Self::Table => "a coefficient table",
        }
    }
}
