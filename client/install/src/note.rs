//! What the service notes of the tables that it serves, and how another process reads it.

use isotherm_client::{ConnectError, Domain, ImuId, Note, domain_owner, own_files};
use rustix::fs::OFlags;
use rustix::process::{Flock, FlockType, fcntl_getlk};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// How the names of the notes begin. No name of an IMU has a dot.
const NAME: &str = "table-";

/// What a service notes of one IMU's table. Without a service that lives it is out of date.
#[derive(Clone, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct TableNote {
    /// The file that the service reads, an absolute path.
    pub table_file: String,
    /// Digest of the table that it serves; `None` if there is none.
    pub served: Option<String>,
    /// Its last judgement of the file; `None` if there is no file, or it was not read yet.
    pub judged: Option<TableJudgement>,
}

/// What a service decides about one state of a table's file.
#[derive(Clone, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct TableJudgement {
    /// The state, as [`Identity`](isotherm_files::Identity) prints it.
    pub file: String,
    /// Digest of the table in it; `None` if it is no valid table.
    pub digest: Option<String>,
    /// Why it is refused; `None` if it is taken.
    pub refused: Option<String>,
}

impl TableNote {
    /// Writes it for this IMU.
    ///
    /// # Errors
    /// The operating system's.
    pub fn write(&self, domain: &Domain, imu: &ImuId) -> std::io::Result<()> {
        note(domain, imu).write(serde_json::to_string(self)?.as_bytes())
    }

    /// Reads that of this IMU; `None` if there is none.
    ///
    /// # Errors
    /// As [`domain_owner`].
    pub(crate) fn read(domain: &Domain, imu: &ImuId) -> Result<Option<Self>, ConnectError> {
        let Some(owner) = domain_owner(domain)? else { return Ok(None) };
        let text = note(domain, imu).read_of(owner);
        Ok(text.and_then(|text| serde_json::from_slice(&text).ok()))
    }
}

fn note(domain: &Domain, imu: &ImuId) -> Note {
    Note::new(domain, &format!("{NAME}{imu}.json"))
}

/// Removes the notes of the service before, which this one has taken the lock of.
pub fn remove_notes(domain: &Domain) {
    let prefix = format!("{}{NAME}", domain.prefix());
    own_files(domain.root_path(), &prefix).for_each(|file| _ = fs::remove_file(file.path));
}

/// Whether there is a note of any IMU.
pub(crate) fn has_notes(domain: &Domain) -> bool {
    let prefix = format!("{}{NAME}", domain.prefix());
    let mut entries = fs::read_dir(domain.root_path()).into_iter().flatten().flatten();
    entries.any(|entry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()))
}

/// The file that the service of a domain keeps locked as long as it lives.
#[must_use]
pub fn service_lock(domain: &Domain) -> PathBuf {
    Path::new(domain.root_path()).join(format!("{}service.lock", domain.prefix()))
}

/// Whether a service of the domain lives.
///
/// # Errors
/// As [`domain_owner`].
pub(crate) fn is_served(domain: &Domain) -> Result<bool, ConnectError> {
    let Some(owner) = domain_owner(domain)? else { return Ok(false) };
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed();
    let Ok(file) = File::options().read(true).custom_flags(flags).open(service_lock(domain)) else { return Ok(false) };
    let is_owners = file.metadata().is_ok_and(|found| found.is_file() && found.uid() == owner);
    Ok(is_owners && matches!(fcntl_getlk(&file, &Flock::from(FlockType::WriteLock)), Ok(Some(_))))
}
