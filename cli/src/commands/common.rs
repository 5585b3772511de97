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
    /// In bytes, or with k, M or G. The files are then numbered, as in FILE-0001.csv.
    #[arg(long, value_name = "SIZE", value_parser = isotherm_offline::parse::bytes)]
    rotate_size: Option<u64>,
    /// Begin the next file after this time [s]
    ///
    /// The files are then numbered, as in FILE-0001.csv.
    #[arg(long, value_name = "S", value_parser = isotherm_offline::parse::seconds)]
    rotate_time: Option<Duration>,
    /// Leave this much of the disk free
    ///
    /// In bytes, or with k, M or G. If less is free, rows wait as they do on a full disk.
    #[arg(long, value_name = "SIZE", value_parser = isotherm_offline::parse::bytes)]
    keep_free: Option<u64>,
    /// Delete the oldest files to free space
    ///
    /// Deletes numbered files of this name to keep the space of --keep-free.
    ///
    /// Only files that a recorder of this user has written under this name are deleted, the lowest number first, and
    /// never a file that is still being written
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
