//! Files that grow, as those of a recording, on a disk.

use crate::place::{folder_of, sync_folder};
use crate::staged::HIDDEN;
use isotherm_support::source::ReadSeek;
use isotherm_support::storage::{GrowingFile, Storage};
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open, statvfs};
use std::fs::{self, File, Metadata, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{FileExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

/// The longest file without rows \[bytes\]: an MCAP file of many IMUs.
const MOST: u64 = 1 << 20;

/// The files of the operating system. `-` is the standard output.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Storage for Disk {
    fn create(&self, path: &Path, bytes: &[u8], is_vacant: fn(&[u8]) -> bool) -> io::Result<Box<dyn GrowingFile>> {
        if path == Path::new("-") {
            return Ok(Box::new(GrowingStdout { first: bytes.to_owned() }));
        }
        Ok(Box::new(DiskFile::create(path, bytes, is_vacant)?))
    }

    fn exists(&self, path: &Path) -> bool {
        fs::symlink_metadata(path).is_ok()
    }

    fn is_vacant(&self, path: &Path, is_vacant: fn(&[u8]) -> bool) -> bool {
        !self.exists(path) || vacant(path, is_vacant).is_ok_and(|file| file.is_some())
    }

    fn names_beside(&self, path: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    }

    fn free_beside(&self, path: &Path) -> Option<u64> {
        let found = statvfs(folder_of(path)).ok()?;
        Some(found.f_bavail.saturating_mul(found.f_frsize))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn is_own(&self, path: &Path, is_own: fn(&mut dyn ReadSeek) -> io::Result<bool>) -> bool {
        unwritten(path).ok().flatten().is_some_and(|(mut file, _)| is_own(&mut file).unwrap_or(false))
    }

    fn now(&self) -> Duration {
        static BEGIN: OnceLock<Instant> = OnceLock::new();
        BEGIN.get_or_init(Instant::now).elapsed()
    }
}

/// The standard output.
struct GrowingStdout {
    /// What comes before the first step.
    first: Vec<u8>,
}

impl GrowingFile for GrowingStdout {
    fn grow(&mut self, more: &[u8]) -> io::Result<()> {
        let (mut stdout, bytes) = (io::stdout(), [&self.first, more].concat());
        stdout.write_all(&bytes).and_then(|()| stdout.flush())?;
        self.first.clear();
        Ok(())
    }

    fn restart(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.first.clear();
        self.grow(bytes)
    }
}

/// A file on a disk that grows. It is locked as long as it is written.
struct DiskFile {
    path: PathBuf,
    file: File,
    /// Length of what is kept \[bytes\].
    length: u64,
}

impl DiskFile {
    /// The file appears with its full content.
    fn create(path: &Path, bytes: &[u8], is_vacant: fn(&[u8]) -> bool) -> io::Result<Self> {
        let mut file = hidden_file(path)?;
        file.write_all(bytes)?;
        file.as_file().sync_data()?;
        let file = match file.persist_noclobber(path) {
            Ok(file) => file,
            Err(refused) if refused.error.kind() != io::ErrorKind::AlreadyExists => return Err(refused.error),
            Err(refused) => {
                // Locked until it is replaced.
                let Some(_vacant) = vacant(path, is_vacant)? else { return Err(refused.error) };
                refused.file.persist(path).map_err(|error| error.error)?
            }
        };
        sync_folder(path)?;
        Ok(Self { path: path.to_owned(), file, length: bytes.len() as u64 })
    }
}

impl GrowingFile for DiskFile {
    fn grow(&mut self, more: &[u8]) -> io::Result<()> {
        if let Err(error) = self.file.write_all_at(more, self.length).and_then(|()| self.file.sync_data()) {
            self.file.set_len(self.length)?;
            return Err(error);
        }
        self.length += more.len() as u64;
        Ok(())
    }

    fn restart(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut file = hidden_file(&self.path)?;
        file.write_all(bytes)?;
        file.as_file().sync_data()?;
        self.file = file.persist(&self.path).map_err(|error| error.error)?;
        self.length = bytes.len() as u64;
        sync_folder(&self.path)
    }
}

/// A file in the folder of `path` with a temporary name. It is locked before it has its name: no other process takes it
/// for one that nobody writes. Where the file system has no locks, none does.
fn hidden_file(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // The umask still applies.
    builder.prefix(HIDDEN).permissions(Permissions::from_mode(0o666));
    let file = builder.tempfile_in(folder_of(path)).map_err(|error| io::Error::from(error.kind()))?;
    let _ = flock(file.as_file(), FlockOperation::NonBlockingLockExclusive);
    Ok(file)
}

/// The file `path` if it is one of this user that no process writes, and whose bytes are those of a vacant one. It then
/// stays locked by the file that is returned.
fn vacant(path: &Path, is_vacant: fn(&[u8]) -> bool) -> io::Result<Option<File>> {
    let Some((file, about)) = unwritten(path)?.filter(|(_, about)| about.len() <= MOST) else { return Ok(None) };
    let mut bytes = Vec::new();
    (&file).take(MOST).read_to_end(&mut bytes)?;
    // Between its opening and the lock another process may have replaced it.
    let named = fs::symlink_metadata(path)?;
    let is_named = (named.dev(), named.ino(), named.len()) == (about.dev(), about.ino(), bytes.len() as u64);
    Ok((is_named && is_vacant(&bytes)).then_some(file))
}

/// The regular file of this user with this one name, if there is one and no process is writing it. It stays locked.
fn unwritten(path: &Path) -> io::Result<Option<(File, Metadata)>> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let Ok(file) = open(path, flags, Mode::empty()).map(File::from) else { return Ok(None) };
    let about = file.metadata()?;
    let is_own = about.is_file() && about.nlink() == 1 && about.uid() == rustix::process::geteuid().as_raw();
    let is_free = || flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok();
    Ok((is_own && is_free()).then_some((file, about)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_leaves_a_complete_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r");
        let mut file = DiskFile::create(&path, b"begin", |_| false).unwrap();
        file.grow(b" and more").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"begin and more");
        file.restart(b"anew").unwrap();
        file.grow(b" and more").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"anew and more");
        assert!(DiskFile::create(&path, b"other", |_| true).is_err(), "it is being written");
        drop(file);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left next to it");
    }
}
