//! Files with a temporary name, which get their own when they are complete.

use crate::live::{give_mode_and_owner, mode_of};
use crate::place::{folder_of, sync_folder};
use crate::signals::{UnfinishedFile, hold_signals};
use isotherm_support::failure::{Failure, shown};
use std::fs::{self, File, Metadata, Permissions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// How the names of files begin that are not complete, or no longer needed.
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

    /// Gives the file that is about to be replaced, if there is one, a hidden name, and waits until that is durable.
    pub(crate) fn set_aside(&self) -> io::Result<Option<Aside>> {
        let path = &self.target;
        match tempfile::Builder::new().prefix(HIDDEN).make_in(folder_of(path), |hidden| fs::rename(path, hidden)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            // Keep only the kind of the error, as in `create`.
            Err(error) => Err(io::Error::from(error.kind())),
            Ok(hidden) => {
                let aside = Aside { hidden: hidden.into_temp_path(), path: path.clone() };
                sync_folder(path).map(|()| Some(aside))
            }
        }
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

/// An old file under a hidden name. Dropping it removes the file.
pub(crate) struct Aside {
    hidden: TempPath,
    path: PathBuf,
}

impl Aside {
    /// Gives the file its name again, because of this failure. If that fails too, the message says where the file is.
    pub(crate) fn put_back(failure: Failure, aside: Self) -> Failure {
        let hidden = aside.hidden.to_path_buf();
        let Err(error) = aside.hidden.persist(&aside.path) else { return failure };
        let _ = error.path.keep();
        Failure::new(failure.exit, format!("{failure}; the old {} is {}", shown(&aside.path), shown(&hidden)))
    }
}
