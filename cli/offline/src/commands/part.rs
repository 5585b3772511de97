//! `--from` and `--to` of the commands that read recordings.

use clap::Args;
use isotherm_recording_formats::read::{Part, RecordingTime};
use isotherm_support::failure::{Exit, Failure};

/// The part of each recording that is read.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(super) struct PartArgs {
    /// Leave out what is before this time
    ///
    /// Leave out what is before this time: seconds since the begin of the recording, or a time stamp.
    ///
    /// Time stamps are those of the rows, as 12500000000ns, or where the rows count from 1970 or from midnight, as
    /// 2026-05-01T12:34:56Z or 12:34:56. Of several recordings each has a begin of its own; the pieces of one have one
    #[arg(long, value_name = "S|STAMP", allow_negative_numbers = true)]
    from: Option<RecordingTime>,
    /// Leave out what is after this time
    ///
    /// Leave out what is after this time, as with --from; what comes later is not read.
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
