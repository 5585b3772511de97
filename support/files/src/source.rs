//! Paths as sources of bytes.

mod folder;

use crate::place::canonical;
use isotherm_support::failure::Failure;
use isotherm_support::source::{ByteStream, DataSource, Opener, ReadSeek};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Opens a recording for reading; `-` is stdin.
///
/// # Errors
/// If it cannot be opened.
pub fn open_recording(path: &Path) -> io::Result<Box<dyn Read>> {
    Ok(PathOpener(path.to_owned()).open()?)
}

/// The data at a path, which are opened when they are read; `-` is stdin.
pub fn source(path: impl Into<PathBuf>) -> DataSource {
    let path = path.into();
    DataSource::new(path.clone(), PathOpener(path))
}

/// The data at these paths; the folder of a bag of ROS 2 stands for the files of the bag.
///
/// # Errors
/// If a folder has no bag in MCAP, with the program that makes one.
pub fn sources(paths: &[PathBuf]) -> Result<Vec<DataSource>, Failure> {
    Ok(folder::files(paths)?.into_iter().map(source).collect())
}

struct PathOpener(PathBuf);

impl Opener for PathOpener {
    fn open(&self) -> io::Result<Box<dyn ReadSeek>> {
        if self.0 == Path::new("-") {
            return Ok(Box::new(ByteStream(io::stdin())));
        }
        let file = File::open(&self.0)?;
        if file.metadata()?.is_dir() {
            return Err(io::Error::from(io::ErrorKind::IsADirectory));
        }
        Ok(Box::new(file))
    }

    fn is_file(&self) -> io::Result<bool> {
        Ok(self.0 != Path::new("-") && fs::metadata(&self.0)?.is_file())
    }

    fn identity(&self) -> io::Result<PathBuf> {
        canonical(&self.0)
    }
}
