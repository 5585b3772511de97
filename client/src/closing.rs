//! What an acquisition had lost when it closed. A file in the domain's folder tells the service, which may be away just then.

use crate::clock::unix_s;
use crate::objects::own_files;
use isotherm_shared::status::ClosedStatus;
use isotherm_shared::stream::{Domain, ImuId};
use std::fs::{self, File, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::PathBuf;

/// More than the file ever has \[bytes\].
const MAX_BYTES: u64 = 4096;

/// What an [`Acquisition`](crate::Acquisition) had lost when it closed. Nothing was lost if both are 0.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Closing {
    /// Control periods, of all its sessions, that have a sequence and were not sent: loans that were dropped, sequences that were left
    /// out, samples whose sending has failed.
    pub lost: u64,
    /// Samples that were sent and whose increments were not received. Other readers may have them.
    pub unanswered: u64,
}

fn path(domain: &Domain, imu: &ImuId) -> PathBuf {
    format!("{}/{}closed-{imu}.json", domain.root_path(), domain.prefix()).into()
}

/// Writes the file. A crash leaves the old one or the new one.
pub(crate) fn write(domain: &Domain, imu: &ImuId, session: u64, closing: Closing) -> io::Result<()> {
    let Closing { lost, unanswered } = closing;
    let status = ClosedStatus { session: format!("{session:016x}"), lost, unanswered, unix_s: unix_s() };
    let path = path(domain, imu);
    let staged = path.with_extension(format!("{}", std::process::id()));
    let mut file = File::options().write(true).create(true).truncate(true).mode(0o600).open(&staged)?;
    file.set_permissions(Permissions::from_mode(0o600))?;
    file.write_all(&serde_json::to_vec(&status)?)?;
    fs::rename(staged, path)
}

/// What the last acquisition of `imu` that closed with a loss had lost; `None` if there was none.
#[must_use]
pub fn last_closing(domain: &Domain, imu: &ImuId) -> Option<ClosedStatus> {
    let path = path(domain, imu);
    let name = path.file_name()?.to_str()?;
    let own = own_files(domain.root_path().to_owned(), name).find(|file| file.path == path)?;
    let mut text = Vec::new();
    File::open(own.path).ok()?.take(MAX_BYTES).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok()
}
