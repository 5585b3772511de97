//! What several live commands do with their arguments.

use clap::Args;
use isotherm_client::{Domain, Options};
use isotherm_recording_formats::write::Rotation;
use isotherm_support::failure::{Exit, Failure};
use std::time::Duration;

/// The options of a client.
pub(super) fn options(domain: Domain, timeout: Duration) -> Options {
    Options::new(domain, timeout)
}

/// When a recorder goes on in the next file, and what it leaves of the disk.
#[derive(Clone, Debug, Default, Args)]
pub(super) struct RotationArgs {
    /// Begin the next file at this size
    ///
    /// Begin the next file at this size: bytes, or with k, M, G; files are then numbered, FILE-0001.csv.
    #[arg(long, value_name = "SIZE", value_parser = isotherm_offline::parse::bytes)]
    rotate_size: Option<u64>,
    /// Begin the next file after this time [s]
    ///
    /// Begin the next file after this time [s]; files are then numbered, FILE-0001.csv.
    #[arg(long, value_name = "S", value_parser = isotherm_offline::parse::seconds)]
    rotate_time: Option<Duration>,
    /// Leave so much of the disk free
    ///
    /// Leave so much of the disk free: bytes, or with k, M, G; with less, rows wait as on a full disk.
    #[arg(long, value_name = "SIZE", value_parser = isotherm_offline::parse::bytes)]
    keep_free: Option<u64>,
    /// Remove the oldest files for room
    ///
    /// Remove the oldest numbered files of this name to keep the disk free.
    ///
    /// Only what a recorder of this user has written under this name, the lowest number first, and never what is being
    /// written
    #[arg(long, requires = "keep_free")]
    delete_oldest: bool,
}

impl RotationArgs {
    /// The rotation of a recording, and whether any option was given.
    ///
    /// # Errors
    /// If old files are to be removed, and there are none.
    pub(super) fn get(&self) -> Result<(Rotation, bool), Failure> {
        let Self { rotate_size, rotate_time, keep_free, delete_oldest } = *self;
        let rotation = Rotation { size: rotate_size, time: rotate_time, keep_free, delete_oldest };
        if delete_oldest && !rotation.is_enabled() {
            let message = "--delete-oldest removes numbered files: give --rotate-size or --rotate-time";
            return Err(Failure::new(Exit::Usage, message));
        }
        Ok((rotation, rotation.is_enabled() || keep_free.is_some()))
    }
}
