//! The files of a domain in folders that other users share, such as `/dev/shm`.
//!
//! Everybody can compute a domain's prefix and can put a pipe, a link, a device or a huge file of that name there. Therefore all code
//! of Isotherm that walks such a folder walks it here: nothing is followed, nothing blocks, and only regular files of this user count.

use crate::error::ConnectError;
use crate::resources::SHARED_MEMORY;
use isotherm_shared::stream::Domain;
use rustix::fs::{Mode, OFlags, open};
use std::fs::{self, File, Metadata, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Permissions that other users have on a file.
const OTHERS: u32 = 0o007;

/// A regular file of this process's user.
#[derive(Debug)]
pub struct OwnFile {
    /// Where it is.
    pub path: PathBuf,
    metadata: Metadata,
}

impl OwnFile {
    /// Its permissions, without the type of the file.
    #[must_use]
    pub fn mode(&self) -> u32 {
        self.metadata.permissions().mode() & 0o7777
    }

    /// Its size \[bytes\].
    #[must_use]
    pub fn size(&self) -> u64 {
        self.metadata.size()
    }

    /// Bytes that the file system has not allocated yet.
    #[must_use]
    pub fn missing(&self) -> u64 {
        self.metadata.size().saturating_sub(self.metadata.blocks() * 512)
    }

    /// Time since its last change; `None` if the clock was set back meanwhile.
    #[must_use]
    pub fn age(&self) -> Option<Duration> {
        self.metadata.modified().ok().and_then(|modified| SystemTime::now().duration_since(modified).ok())
    }

    /// Opens it for writing, if it is still the same file.
    ///
    /// # Errors
    /// The operating system's; `NotFound` if another file has taken its place.
    pub fn open(&self) -> io::Result<File> {
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = File::options().write(true).custom_flags(flags.bits().cast_signed()).open(&self.path)?;
        let now = file.metadata()?;
        let same = (now.dev(), now.ino()) == (self.metadata.dev(), self.metadata.ino());
        if same { Ok(file) } else { Err(io::ErrorKind::NotFound.into()) }
    }
}

/// Looks at a directory entry without following or opening what it names. `None` unless it is a regular file of this user.
fn own_file(path: PathBuf) -> Option<OwnFile> {
    let flags = OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let metadata = File::from(open(&path, flags, Mode::empty()).ok()?).metadata().ok()?;
    let own = metadata.is_file() && metadata.uid() == rustix::process::geteuid().as_raw();
    own.then_some(OwnFile { path, metadata })
}

fn entries(folder: &Path, prefix: &str) -> impl Iterator<Item = PathBuf> + use<> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let prefix = prefix.as_bytes().to_owned();
    entries.filter(move |entry| entry.file_name().as_encoded_bytes().starts_with(&prefix)).map(|entry| entry.path())
}

/// The regular files of this user in `folder` whose names begin with `prefix`. What belongs to other users, and anything that is no
/// regular file, is left out; a folder that cannot be read has no files.
pub fn own_files<P: AsRef<Path>>(folder: P, prefix: &str) -> impl Iterator<Item = OwnFile> + use<P> {
    entries(folder.as_ref(), prefix).filter_map(own_file)
}

/// What is in shared memory under the prefix of `domain` and is no regular file of this user. Isotherm ignores it, unless a stream
/// needs its name.
#[must_use]
pub fn foreign_objects(domain: &Domain) -> Vec<PathBuf> {
    let gone = |path: &PathBuf| fs::symlink_metadata(path).is_err();
    let foreign = |path: &PathBuf| own_file(path.clone()).is_none() && !gone(path);
    entries(Path::new(SHARED_MEMORY), &domain.prefix()).filter(foreign).collect()
}

/// Refuses an object of another user in the place of a stream's memory: the transport would wait for it without limit.
///
/// A stream's memory has the stream's number in its name, which cannot be guessed. But a stream whose memory is gone, as after a
/// restart of the machine, leaves a file that tells the number to nobody but this user, and other users may have seen the name before.
///
/// # Errors
/// [`ConnectError::Transport`].
pub(crate) fn refuse_foreign(domain: &Domain) -> Result<(), ConnectError> {
    let foreign = foreign_objects(domain);
    if foreign.is_empty() {
        return Ok(());
    }
    let services = Path::new(domain.root_path()).join("services");
    let services: Vec<_> =
        own_files(services, &domain.prefix()).filter_map(|file| fs::read_to_string(file.path).ok()).collect();
    // The file of a stream has both halves of its number, each in a line of its own.
    let in_use = |path: &PathBuf| {
        let Some(name) = path.to_str().and_then(|path| path.strip_suffix(".dynamic")) else { return false };
        let Some(number) = name.rsplit('_').next().and_then(|number| number.parse::<u128>().ok()) else { return false };
        let lines = [format!("unique_value = {}", number >> 64), format!("payload_value = {}", number as u64)];
        services.iter().any(|text| lines.iter().all(|wanted| text.lines().any(|line| line == wanted)))
    };
    let Some(path) = foreign.into_iter().find(in_use) else { return Ok(()) };
    let cause = format!("{} is not this user's; its owner or root can remove it", path.display());
    Err(ConnectError::transport("joining the domain", cause))
}

/// Takes the permissions of other users from this user's objects in shared memory. Isotherm makes none with such permissions, but a
/// program that uses iceoryx2 without Isotherm's client does.
pub fn close_to_others(domain: &Domain) {
    for object in own_files(SHARED_MEMORY, &domain.prefix()).filter(|object| object.mode() & OTHERS != 0) {
        let mode = object.mode() & !OTHERS;
        // Its creator may just be removing it.
        let _ = object.open().and_then(|file| file.set_permissions(Permissions::from_mode(mode)));
    }
}
