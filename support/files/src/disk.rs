//! Files that grow, as those of a recording, on a disk.
//!
//! A file to which bytes are only added grows in place. One whose end changes at each step, as the footer of a Parquet
//! file does, is two files that take turns, a visible one under the name and a hidden one. At a step the hidden file
//! gets what it lacks, then the end. Then the two files exchange their names in one step. A reader that opens the name,
//! also after a crash, gets all up to the last step.

use crate::place::{exchange, folder_of, sync_folder};
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
    fn create(
        &self,
        path: &Path,
        bytes: &[u8],
        end: &[u8],
        is_vacant: fn(&[u8]) -> bool,
    ) -> io::Result<Box<dyn GrowingFile>> {
        if path == Path::new("-") {
            return Ok(Box::new(GrowingStdout { first: [bytes, end].concat() }));
        }
        Ok(Box::new(DiskFile::create(path, bytes, end, is_vacant)?))
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
    fn grow(&mut self, more: &[u8], end: &[u8]) -> io::Result<()> {
        let (mut stdout, bytes) = (io::stdout(), [&self.first, more, end].concat());
        stdout.write_all(&bytes).and_then(|()| stdout.flush())?;
        self.first.clear();
        Ok(())
    }

    fn restart(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.first.clear();
        self.grow(bytes, &[])
    }
}

/// A file on a disk that grows. It is locked as long as it is written.
struct DiskFile {
    path: PathBuf,
    /// Length of what is kept, without the end \[bytes\].
    body: u64,
    /// The last bytes of the body: those that are not yet in both files.
    recent: Vec<u8>,
    /// The file under the name, and how much of the body it has \[bytes\].
    visible: (File, u64),
    /// The hidden file, in the same way; `None` before the first step, and always between steps if names cannot be
    /// exchanged.
    hidden: Option<(NamedTempFile, u64)>,
    /// Whether the file has an end behind the body.
    has_end: bool,
    /// Whether the file system can exchange two names; true until it refuses.
    exchanges: bool,
}

impl DiskFile {
    /// The file appears with its full content.
    fn create(path: &Path, bytes: &[u8], end: &[u8], is_vacant: fn(&[u8]) -> bool) -> io::Result<Self> {
        let mut file = hidden_file(path)?;
        file.write_all(bytes)?;
        file.write_all(end)?;
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
        let body = bytes.len() as u64;
        Ok(Self {
            path: path.to_owned(),
            body,
            recent: Vec::new(),
            visible: (file, body),
            hidden: None,
            has_end: !end.is_empty(),
            exchanges: true,
        })
    }

    fn append(&mut self, more: &[u8]) -> io::Result<()> {
        let (file, length) = &mut self.visible;
        if let Err(error) = file.write_all_at(more, self.body).and_then(|()| file.sync_data()) {
            file.set_len(self.body)?;
            return Err(error);
        }
        self.body += more.len() as u64;
        *length = self.body;
        Ok(())
    }

    /// Gives the hidden file a body of this length, whose last bytes are recent, and this end; and then the name.
    fn rewrite(&mut self, body: u64, end: &[u8]) -> io::Result<()> {
        let (hidden, has) = match &mut self.hidden {
            Some(hidden) => hidden,
            None => self.hidden.insert((hidden_file(&self.path)?, 0)),
        };
        let file = hidden.as_file();
        // First the bytes that only the visible file has, if the hidden one is new; then the bytes in memory; then the
        // end.
        let recent = body - self.recent.len() as u64;
        if *has < recent {
            copy(&self.visible.0, file, *has, recent)?;
            *has = recent;
        }
        file.write_all_at(&self.recent[(*has - recent) as usize..], *has)?;
        *has = body;
        file.write_all_at(end, body)?;
        file.set_len(body + end.len() as u64)?;
        file.sync_data()?;
        self.exchange()?;
        // Both files have the body up to here.
        let both = self.visible.1.min(self.hidden.as_ref().map_or(body, |(_, has)| *has));
        self.recent.drain(..(both.saturating_sub(recent) as usize).min(self.recent.len()));
        Ok(())
    }

    /// Exchanges the names of the hidden and the visible file.
    fn exchange(&mut self) -> io::Result<()> {
        let Some((hidden, has)) = &mut self.hidden else { return Ok(()) };
        if self.exchanges {
            self.exchanges = exchange(hidden.path(), &self.path)?;
        }
        if self.exchanges {
            std::mem::swap(hidden.as_file_mut(), &mut self.visible.0);
            std::mem::swap(has, &mut self.visible.1);
            return sync_folder(&self.path);
        }
        // The hidden file replaces the visible one, and the next step makes a new hidden file. If the user has removed
        // the file, this is an error, and the file is not created again.
        fs::metadata(&self.path)?;
        if let Some((hidden, has)) = self.hidden.take() {
            self.visible = (hidden.persist(&self.path).map_err(|error| error.error)?, has);
            sync_folder(&self.path)?;
        }
        Ok(())
    }
}

impl GrowingFile for DiskFile {
    fn grow(&mut self, more: &[u8], end: &[u8]) -> io::Result<()> {
        if end.is_empty() && !self.has_end {
            return self.append(more);
        }
        let (before, body) = (self.recent.len(), self.body + more.len() as u64);
        self.recent.extend_from_slice(more);
        // The bytes are given again after an error.
        self.rewrite(body, end).inspect_err(|_| self.recent.truncate(before))?;
        (self.body, self.has_end) = (body, true);
        Ok(())
    }

    fn restart(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut file = hidden_file(&self.path)?;
        file.write_all(bytes)?;
        file.as_file().sync_data()?;
        let file = file.persist(&self.path).map_err(|error| error.error)?;
        sync_folder(&self.path)?;
        self.body = bytes.len() as u64;
        (self.visible, self.hidden) = ((file, self.body), None);
        self.recent.clear();
        self.has_end = false;
        Ok(())
    }
}

fn copy(from: &File, to: &File, begin: u64, end: u64) -> io::Result<()> {
    let mut buffer = vec![0; 1 << 20];
    let mut at = begin;
    while at < end {
        let length = buffer.len().min((end - at) as usize);
        from.read_exact_at(&mut buffer[..length], at)?;
        to.write_all_at(&buffer[..length], at)?;
        at += length as u64;
    }
    Ok(())
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

    /// After every step the file has all bytes and the new end, with and without the exchange of names, also where the
    /// step before has failed and its bytes are given again.
    #[test]
    fn every_step_leaves_a_complete_file() {
        for exchanges in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("r");
            let mut file = DiskFile::create(&path, b"begin", b"end", |_| false).unwrap();
            file.exchanges = exchanges;
            let mut all = b"begin".to_vec();
            for (step, more) in [0, 1, 1000, 3, 0, 70_000].into_iter().enumerate() {
                let (more, end) = (vec![step as u8; more], vec![b'e'; 7 - step]);
                if step == 3 {
                    // The name is gone for a moment.
                    fs::rename(&path, folder.path().join("away")).unwrap();
                    assert!(file.grow(&more[..2], &end).is_err());
                    fs::rename(folder.path().join("away"), &path).unwrap();
                }
                file.grow(&more, &end).unwrap();
                all.extend(&more);
                assert!(fs::read(&path).unwrap() == [all.clone(), end].concat(), "{exchanges} {step}");
            }
            file.restart(b"anew").unwrap();
            file.grow(b" and more", &[]).unwrap();
            assert_eq!(fs::read(&path).unwrap(), b"anew and more");
            drop(file);
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left next to it");
        }
    }
}
