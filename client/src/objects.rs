//! The files of a domain in folders that other users share, such as `/dev/shm`.
//!
//! Everybody can compute a domain's prefix and can put a pipe, a link, a device or a huge file of that name there.
//! Therefore, all code of Isotherm that walks such a folder walks it here: nothing is followed, nothing blocks, and
//! only regular files of this user count.

use crate::error::ConnectError;
pub(crate) use crate::transport::own_storage::SHARED_MEMORY;
use crate::transport::stream::CREATION_TIMEOUT;
use isotherm_shared::names::{Domain, ImuId};
use isotherm_support::failure::shown;
use rustix::fs::{AtFlags, Mode, OFlags, open, openat, renameat, unlinkat};
use rustix::process::geteuid;
use std::collections::HashMap;
use std::fs::{self, DirEntry, File, Metadata, Permissions};
use std::hash::{BuildHasher as _, RandomState};
use std::io::{self, Read as _, Write as _};
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

/// How long a sweep waits for files that are being created. It covers the age at which one counts as left behind, with
/// a reserve.
const SWEEP_LIMIT: Duration = Duration::from_secs(2);
/// Pause between two looks of a sweep.
const SWEEP_PAUSE: Duration = Duration::from_millis(5);
/// How the name of a note ends that is being written.
const STAGED: &str = ".staged";
/// A note is written in less than this time; one that is older was left by a process that was killed meanwhile.
const STAGED_LIMIT: Duration = Duration::from_secs(60);
/// Permissions on a file that its group and other users have.
const OTHERS: u32 = 0o077;

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

    /// Time since its last change; `None` if that lies in the future, since the clock was set back.
    #[must_use]
    pub fn age(&self) -> Option<Duration> {
        self.metadata.modified().ok().and_then(|modified| SystemTime::now().duration_since(modified).ok())
    }

    /// Whether it has no size yet: the transport makes its objects with this mode, and changes the mode when they are
    /// complete.
    #[must_use]
    pub fn is_half_created(&self) -> bool {
        self.mode() == 0o200
    }

    /// Whether it is a note that a process which was killed has left half-written.
    #[must_use]
    pub fn is_half_written(&self) -> bool {
        let is_staged = self.path.as_os_str().as_encoded_bytes().ends_with(STAGED.as_bytes());
        is_staged && self.age().is_some_and(|age| age > STAGED_LIMIT)
    }

    /// Takes the permissions of its group and of other users from it. The transport makes its counter of nodes with all
    /// permissions; programs that use it without Isotherm's client make one in shared memory.
    pub fn close_to_others(&self) {
        let mode = self.mode() & !OTHERS;
        if mode != self.mode() {
            // Its creator may just be removing it.
            let _ = self.set_mode(mode);
        }
    }

    /// Sets its permissions. It is not opened for that: closing a file releases every lock that the process has on it.
    fn set_mode(&self, mode: u32) -> io::Result<()> {
        let file = File::from(open(&self.path, OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC, Mode::empty())?);
        self.check(&file)?;
        fs::set_permissions(format!("/proc/self/fd/{}", file.as_raw_fd()), Permissions::from_mode(mode))
    }

    /// Opens it for writing, if it is still the same file.
    ///
    /// # Errors
    /// The operating system's; `NotFound` if another file has taken its place.
    pub fn open(&self) -> io::Result<File> {
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = File::options().write(true).custom_flags(flags.bits().cast_signed()).open(&self.path)?;
        self.check(&file).map(|()| file)
    }

    /// Whether an open file is this one.
    fn check(&self, file: &File) -> io::Result<()> {
        let now = file.metadata()?;
        let same = (now.dev(), now.ino()) == (self.metadata.dev(), self.metadata.ino());
        if same { Ok(()) } else { Err(io::ErrorKind::NotFound.into()) }
    }
}

/// Looks at a directory entry without following or opening what it names. `None` unless it is a regular file of this
/// user, which nobody else can replace: in a folder that everybody may write, the sticky bit protects it.
fn own_file(entry: &DirEntry) -> Option<OwnFile> {
    let metadata = entry.metadata().ok()?;
    is_own(&metadata).then(|| OwnFile { path: entry.path(), metadata })
}

/// Whether it is a regular file of this user.
pub(crate) fn is_own(found: &Metadata) -> bool {
    found.is_file() && found.uid() == geteuid().as_raw()
}

pub(crate) fn entries(folder: &Path, prefix: &str) -> impl Iterator<Item = DirEntry> + use<> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let prefix = prefix.as_bytes().to_owned();
    entries.filter(move |entry| entry.file_name().as_encoded_bytes().starts_with(&prefix))
}

/// The regular files of this user in `folder` whose names begin with `prefix`. What belongs to other users, and
/// anything that is no regular file, is left out; a folder that cannot be read has no files.
pub fn own_files<P: AsRef<Path>>(folder: P, prefix: &str) -> impl Iterator<Item = OwnFile> + use<P> {
    entries(folder.as_ref(), prefix).filter_map(|entry| own_file(&entry))
}

/// An object in shared memory under the prefix of `domain` that is no regular file of this user, if there is one.
/// Isotherm ignores it, unless a stream needs its name.
#[must_use]
pub fn foreign_object(domain: &Domain) -> Option<PathBuf> {
    let foreign = |entry: &DirEntry| entry.metadata().is_ok_and(|found| !is_own(&found));
    entries(Path::new(SHARED_MEMORY), &domain.prefix()).find(foreign).map(|entry| entry.path())
}

/// Refuses an object of another user in the place of a stream's memory.
///
/// The name of a stream's memory has the time of its creation in it, so that it cannot be known before. But a stream
/// whose memory is gone, as after a restart of the machine, leaves its file, and other users may have seen the name.
/// The transport would report an internal error ([`OwnStorage`](crate::transport::own_storage::OwnStorage)); this names
/// the object.
///
/// # Errors
/// [`ConnectError::Foreign`].
pub(crate) fn refuse_foreign(domain: &Domain) -> Result<(), ConnectError> {
    let services = Path::new(domain.root_path()).join("services");
    // Other users may make any number of objects, so names are compared before anything is looked at.
    let files = entries(&services, &domain.prefix());
    let files = files.filter(|entry| entry.metadata().is_ok_and(|found| is_own(&found)));
    let memories: Vec<_> = files.filter_map(|entry| memory_name(&entry.path())).collect();
    let in_use = |entry: &DirEntry| {
        let name = entry.file_name();
        memories.iter().any(|memory| name.as_encoded_bytes().ends_with(memory.as_bytes()))
    };
    let foreign = |entry: &DirEntry| in_use(entry) && entry.metadata().is_ok_and(|found| !is_own(&found));
    let Some(entry) = entries(Path::new(SHARED_MEMORY), &domain.prefix()).find(foreign) else { return Ok(()) };
    Err(ConnectError::Foreign(format!("{} is not this user's; its owner or root can remove it", shown(&entry.path()))))
}

/// Why the streams of `domain` cannot be opened, if their memory was removed: their files are there without it. A
/// running service makes them anew within a second or two.
pub(crate) fn removed_memory(domain: &Domain) -> Option<String> {
    let files = entries(&Path::new(domain.root_path()).join("services"), &domain.prefix());
    let mut memories = files.filter_map(|entry| memory_name(&entry.path()));
    let exists = |memory: &String| {
        let mut objects = entries(Path::new(SHARED_MEMORY), &domain.prefix());
        objects.any(|entry| entry.file_name().as_encoded_bytes().ends_with(memory.as_bytes()))
    };
    memories.any(|memory| !exists(&memory)).then(|| {
        "its shared memory was removed, by systemd-logind at a logout (RemoveIPC) or by another process that cleaned \
         up /dev/shm; a running service creates it again within some seconds"
            .to_owned()
    })
}

/// How the name of a stream's memory ends, from the stream's file: it has both halves of the stream's number, each in a
/// line of its own.
pub(crate) fn memory_name(stream: &Path) -> Option<String> {
    let text = fs::read_to_string(stream).ok()?;
    let half =
        |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = ")?.parse::<u64>().ok());
    let number = (u128::from(half("unique_value")?) << 64) | u128::from(half("payload_value")?);
    Some(format!("_{number}.dynamic"))
}

/// A small file in the folder of a domain, which outlives the processes of the domain: by it one process informs
/// another that may be away.
#[derive(Clone, Debug)]
pub struct Note {
    folder: PathBuf,
    name: String,
}

impl Note {
    /// More than a note has, that with a whole status too \[bytes\].
    const MAX_BYTES: u64 = 1 << 20;

    /// The note of this name.
    #[must_use]
    pub fn new(domain: &Domain, name: &str) -> Self {
        Self { folder: domain.root_path().into(), name: format!("{}{name}", domain.prefix()) }
    }

    /// The tally of an IMU's acquisition, in JSON: `isotherm acquire` writes it once a second, and the exporter of
    /// metrics reads it.
    #[must_use]
    pub fn of_tally(domain: &Domain, imu: &ImuId) -> Self {
        Self::new(domain, &format!("tally-{imu}.json"))
    }

    /// What is in it; `None` if it is not there, or is not this user's.
    #[must_use]
    pub fn read(&self) -> Option<Vec<u8>> {
        self.read_of(geteuid().as_raw())
    }

    /// What is in it if it is this user's; `None` if it is not there, or is another user's.
    #[must_use]
    pub fn read_of(&self, owner: u32) -> Option<Vec<u8>> {
        let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits().cast_signed();
        let file = File::options().read(true).custom_flags(flags).open(self.path()).ok()?;
        file.metadata().ok().filter(|found| found.is_file() && found.uid() == owner)?;
        let mut text = Vec::new();
        file.take(Self::MAX_BYTES).read_to_end(&mut text).ok()?;
        Some(text)
    }

    /// Writes it. A crash leaves the old one or the new one. It belongs to whom the folder belongs to, so that the
    /// service can read what root writes.
    ///
    /// # Errors
    /// The operating system's.
    pub fn write(&self, text: &[u8]) -> io::Result<()> {
        // The open folder cannot be exchanged for another one.
        let folder = File::open(&self.folder)?;
        let owner = folder.metadata()?.uid();
        // A name that nobody else can know before.
        let word = RandomState::new().hash_one(std::process::id());
        let staged = format!("{}.{word:016x}{STAGED}", self.name);
        let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::CLOEXEC;
        let mut file = File::from(openat(&folder, &staged, flags, Mode::from_raw_mode(0o600))?);
        let owned = if geteuid().as_raw() == owner { Ok(()) } else { fchown(&file, Some(owner), None) };
        let renamed = || Ok(renameat(&folder, &staged, &folder, &self.name)?);
        let written = owned.and_then(|()| file.write_all(text)).and_then(|()| renamed());
        // A folder that is full needs no half of it.
        written.inspect_err(|_| _ = unlinkat(&folder, &staged, AtFlags::empty()))
    }

    /// Its file.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }

    /// Removes it; there may be none.
    pub fn remove(&self) {
        let _ = fs::remove_file(self.folder.join(&self.name));
    }
}

/// Removes the files that the process which began to create them has left: those that were last changed before twice
/// the transport's creation time-out. `unfinished` lists the files that are not complete now.
///
/// Waits until each younger file is complete or has this age, two seconds at most. A time in the future, as after the
/// clock was set back, shows no age: such a file may be one that is just being created, so it is removed when it has
/// been watched for as long.
///
/// # Errors
/// A file that may still be being created at the end of that time.
pub fn sweep<I: Iterator<Item = OwnFile>>(
    unfinished: impl Fn() -> I,
    mut remove: impl FnMut(&Path),
) -> Result<(), PathBuf> {
    let (limit, started) = (2 * CREATION_TIMEOUT, Instant::now());
    let mut watched_since: HashMap<PathBuf, Instant> = HashMap::new();
    loop {
        let mut waiting = None;
        for file in unfinished() {
            let watched = watched_since.entry(file.path.clone()).or_insert_with(Instant::now).elapsed();
            if file.age().is_some_and(|age| age > limit) || watched > limit {
                remove(&file.path);
            } else {
                waiting = Some(file.path);
            }
        }
        match waiting {
            None => return Ok(()),
            Some(path) if started.elapsed() > SWEEP_LIMIT => return Err(path),
            Some(_) => thread::sleep(SWEEP_PAUSE),
        }
    }
}

/// This user's files of `domain` in shared memory, then in the domain's folder.
pub fn domain_files(domain: &Domain) -> impl Iterator<Item = OwnFile> + use<> {
    let folder = own_files(domain.root_path().to_owned(), &domain.prefix());
    own_files(SHARED_MEMORY, &domain.prefix()).chain(folder)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn a_file_of_the_future_is_left_until_it_has_been_watched() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, modified: SystemTime| {
            let path = folder.path().join(name);
            File::create(&path).unwrap().set_modified(modified).unwrap();
            fs::set_permissions(&path, Permissions::from_mode(0o200)).unwrap();
            path
        };
        let now = SystemTime::now();
        let (old, future) = (now - Duration::from_secs(60), now + Duration::from_secs(3600));
        let (left, begun) = (make("left", old), make("begun", future));
        let (looks, mut removed) = (Cell::new(0), Vec::new());
        // Its creator completes one between the first look and the second.
        let unfinished = || {
            if looks.replace(looks.get() + 1) == 1 {
                fs::set_permissions(&begun, Permissions::from_mode(0o400)).unwrap();
            }
            own_files(folder.path(), "").filter(OwnFile::is_half_created)
        };
        let mut remove = |path: &Path| {
            fs::remove_file(path).unwrap();
            removed.push(path.to_owned());
        };
        assert_eq!(sweep(unfinished, &mut remove), Ok(()));
        // Nobody completes this one.
        let stays = make("stays", future);
        assert_eq!(sweep(|| own_files(folder.path(), "").filter(OwnFile::is_half_created), &mut remove), Ok(()));
        assert_eq!(removed, [left, stays]);
        assert!(begun.exists());
    }
}
