//! Files with a temporary name, which get their own when they are complete.

use crate::place::{folder_of, sync_folder};
use crate::signals::{UnfinishedFile, hold_signals};
use std::fs::{File, Metadata, Permissions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, fchown};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// How the names of files begin that are not complete.
pub(crate) const HIDDEN: &str = ".isotherm-";

/// A file with a temporary name. Dropping it removes the file.
pub struct StagedFile {
    writer: BufWriter<File>,
    temporary: TempPath,
    target: PathBuf,
    /// Dropped after the file is removed or renamed.
    _unfinished: UnfinishedFile,
}

impl StagedFile {
    pub(crate) fn create(target: &Path, existing: Option<&Metadata>) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(HIDDEN).permissions(Permissions::from_mode(mode_of(existing)));
        // Until the file is listed: a signal between creating and listing removes it too.
        let _held = hold_signals();
        // Keep only the kind of the error: its text names the temporary file, which the user does not know.
        let staged = builder.tempfile_in(folder_of(target)).map_err(|error| io::Error::from(error.kind()))?;
        let (file, temporary) = staged.into_parts();
        let unfinished = UnfinishedFile::list(&temporary);
        give_mode_and_owner(&file, existing);
        Ok(Self { writer: BufWriter::new(file), temporary, target: target.to_owned(), _unfinished: unfinished })
    }

    /// Gives the file its name, and makes that durable.
    pub(crate) fn rename(self) -> io::Result<()> {
        self.temporary.persist(&self.target).map_err(|error| error.error)?;
        sync_folder(&self.target)
    }

    /// Makes what was written durable, under the temporary name.
    pub(crate) fn sync(&self) -> io::Result<()> {
        self.writer.get_ref().sync_all()
    }
}

impl Write for StagedFile {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.writer.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// The permissions to create a file with that replaces the `existing` one. The umask applies to them.
pub(crate) fn mode_of(existing: Option<&Metadata>) -> u32 {
    existing.map_or(0o666, |existing| existing.mode() & 0o777)
}

/// Gives a new file owner and permissions of the `existing` one that it replaces, as far as this user and the file
/// system allow.
pub(crate) fn give_mode_and_owner(file: &File, existing: Option<&Metadata>) {
    if let Some(existing) = existing {
        let _ = fchown(file, Some(existing.uid()), Some(existing.gid()));
        // The umask does not apply here.
        let _ = file.set_permissions(Permissions::from_mode(mode_of(Some(existing))));
    }
}
