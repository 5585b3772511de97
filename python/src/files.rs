//! Results: files that appear whole or not at all, as those of the program.

use crate::errors::file;
use isotherm_files::{Output, StagedText};
use isotherm_support::failure::Failure;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Writes texts that belong together, the one that matters first, as a table before its report: all or none.
#[pyfunction]
pub(crate) fn write_texts(py: Python<'_>, texts: Vec<(PathBuf, String)>) -> PyResult<()> {
    if let [(path, text)] = &texts[..] {
        let write = || write_file(path, |output| output.write_all(text.as_bytes()));
        return py.detach(write).map_err(|error| unwritten(path, &error));
    }
    let write = || {
        let staged = texts.iter().map(|(path, text)| StagedText::create(Some(&resolved(path)))?.write(text));
        StagedText::finish_all(staged.collect::<Result<_, _>>()?)
    };
    py.detach(write).map_err(|failure: Failure| PyOSError::new_err(failure.message))
}

/// Writes a file with this function.
pub(crate) fn write_file(path: &Path, write: impl FnOnce(&mut Output) -> io::Result<()>) -> io::Result<()> {
    let mut output = Output::create(Some(&resolved(path)))?;
    write(&mut output)?;
    output.finish()
}

/// In the program `-` is the standard output; here it is a name like any other.
pub(crate) fn resolved(path: &Path) -> PathBuf {
    if path == Path::new("-") { Path::new(".").join(path) } else { path.to_owned() }
}

/// The exception for a file that cannot be written: of the class that Python has for the reason.
pub(crate) fn unwritten(path: &Path, error: &io::Error) -> PyErr {
    const ENOENT: i32 = 2;
    const EACCES: i32 = 13;
    const ENOTDIR: i32 = 20;
    const EISDIR: i32 = 21;
    let number = match error.kind() {
        io::ErrorKind::NotFound => ENOENT,
        io::ErrorKind::PermissionDenied => EACCES,
        io::ErrorKind::NotADirectory => ENOTDIR,
        io::ErrorKind::IsADirectory => EISDIR,
        _ => return file(path, error),
    };
    file(path, &io::Error::from_raw_os_error(number))
}
