//! Files with a temporary name, which get their own when they are complete, where nobody else writes files.

use isotherm_support::failure::{Failure, shown};
use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// How the names of files begin that are not complete, or no longer needed.
const HIDDEN: &str = ".isotherm-";

/// The name next to `path` of what is not complete, or no longer needed.
fn hidden(path: &Path, what: &str) -> PathBuf {
    let mut name = OsString::from(format!("{HIDDEN}{what}-"));
    name.push(path.file_name().unwrap_or_default());
    path.with_file_name(name)
}

pub(crate) use UnsharedFile as StagedFile;

/// A file with a temporary name. Dropping it removes the file.
pub struct UnsharedFile {
    writer: BufWriter<File>,
    temporary: PathBuf,
    target: PathBuf,
}

impl UnsharedFile {
    pub(crate) fn create(target: &Path, _: Option<&Metadata>) -> io::Result<Self> {
        let temporary = hidden(target, "new");
        let writer = BufWriter::new(File::create(&temporary)?);
        Ok(Self { writer, temporary, target: target.to_owned() })
    }

    /// Gives the file its name.
    pub(crate) fn rename(self) -> io::Result<()> {
        fs::rename(&self.temporary, &self.target)
    }

    /// What was written is durable as it is.
    #[allow(clippy::unused_self, clippy::unnecessary_wraps, reason = "a file of a disk does more")]
    pub(crate) const fn sync(&self) -> io::Result<()> {
        Ok(())
    }

    /// Gives the file that is about to be replaced, if there is one, a hidden name.
    pub(crate) fn set_aside(&self) -> io::Result<Option<Aside>> {
        let aside = Aside { hidden: hidden(&self.target, "old"), path: self.target.clone() };
        match fs::rename(&aside.path, &aside.hidden) {
            Ok(()) => Ok(Some(aside)),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }
}

impl Drop for UnsharedFile {
    fn drop(&mut self) {
        // Fails where it has its own name.
        let _ = fs::remove_file(&self.temporary);
    }
}

impl Write for UnsharedFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.writer.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// An old file under a hidden name. Dropping it removes the file.
pub(crate) struct Aside {
    hidden: PathBuf,
    path: PathBuf,
}

impl Aside {
    /// Gives the file its name again, because of this failure. If that fails too, the message says where the file is.
    pub(crate) fn put_back(failure: Failure, aside: Self) -> Failure {
        let Err(error) = fs::rename(&aside.hidden, &aside.path) else { return failure };
        Failure::new(failure.exit, format!("{failure}; the old {} is lost: {error}", shown(&aside.path)))
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.hidden);
    }
}
