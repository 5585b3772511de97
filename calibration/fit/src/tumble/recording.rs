//! A recording of a tumble.

use isotherm_campaign::implausible;
use isotherm_recording::{CampaignRow, Continuity, RecordingError};
use isotherm_shared::wire::RawSample;
use isotherm_support::finding::{Finding, Location};

/// The raw samples of one recording.
#[derive(Clone, Debug, Default)]
pub struct TumbleRecording {
    pub(super) name: String,
    pub(super) rows: Vec<RawSample>,
    /// What was found in its file before.
    pub(super) findings: Vec<Finding>,
}

impl TumbleRecording {
    /// An empty recording. `name` is what messages call it: its file.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), ..Self::default() }
    }

    /// The same recording, with what was found in its file. It is judged with all that is found in its rows.
    #[must_use]
    pub fn with_findings(self, findings: Vec<Finding>) -> Self {
        Self { findings, ..self }
    }

    /// What a finding about it concerns.
    pub(super) fn place(&self) -> Location {
        Location::Recording(self.name.clone())
    }

    /// The recording of these rows.
    ///
    /// # Errors
    /// At the first row that cannot be read or used, with its line; see [`add`](Self::add).
    pub fn read(
        name: impl Into<String>,
        rows: impl IntoIterator<Item = Result<CampaignRow, RecordingError>>,
    ) -> Result<Self, RecordingError> {
        let mut recording = Self::new(name);
        let (mut last, mut continuity) = (0, Continuity::default());
        for row in rows {
            let CampaignRow { line, sample, .. } = row?;
            recording.add(&sample).map_err(|message| RecordingError::Data { line, message })?;
            last = line;
            continuity.add(&sample);
            if continuity.overlap_so_far().is_some() {
                break;
            }
        }
        match continuity.overlap() {
            Some(overlap) => Err(RecordingError::Data { line: last, message: overlap.to_string() }),
            None => Ok(recording),
        }
    }

    /// Adds the next sample. Gaps are allowed.
    ///
    /// # Errors
    /// Why the sample cannot be used: see [`implausible`].
    pub fn add(&mut self, raw: &RawSample) -> Result<(), String> {
        // A new session has a new clock.
        let previous = self.rows.last().filter(|previous| previous.session == raw.session);
        match implausible(raw, previous.map(|previous| previous.timestamp_ns)) {
            Some(wrong) => Err(wrong),
            None => {
                self.rows.push(*raw);
                Ok(())
            }
        }
    }
}
