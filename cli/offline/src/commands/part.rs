//! `--from` and `--to` of the commands that read recordings.

use clap::Args;
use isotherm_recording_formats::read::{Part, RecordingTime};
use isotherm_support::failure::{Exit, Failure};

/// The part of each recording that is read.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(super) struct PartArgs {
    /// Skip data before this time
    ///
    /// In seconds since the beginning of the recording, or as a time stamp.
    ///
    /// A time stamp is that of a row, such as 12500000000ns. If the rows count from 1970 or from midnight, it can also
    /// be 2026-05-01T12:34:56Z or 12:34:56. Each of several recordings has its own beginning; the pieces of one
    /// recording share it
    #[arg(long, value_name = "S|STAMP", allow_negative_numbers = true)]
    from: Option<RecordingTime>,
    /// Skip data after this time
    ///
    /// The time is given as with --from. Later data are not read.
    #[arg(long, value_name = "S|STAMP", allow_negative_numbers = true)]
    to: Option<RecordingTime>,
}

impl PartArgs {
    /// The part.
    ///
    /// # Errors
    /// If it ends before it begins.
    pub(super) fn get(self) -> Result<Part, Failure> {
        let part = Part::new(self.from, self.to);
        part.map_err(|message| Failure::new(Exit::Usage, format!("--from is not before --to: {message}")))
    }
}
