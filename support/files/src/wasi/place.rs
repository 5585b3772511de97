//! Places of files where only one program has them: nobody else can have put anything there.

use std::fs::{self, File};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Where something is written that is to be found at `path`.
///
/// # Errors
/// None.
pub fn output_place(path: &Path) -> io::Result<PathBuf> {
    Ok(path.to_owned())
}

/// Makes the folder `path` for results, and those above it, unless it is there.
///
/// # Errors
/// If it cannot be made.
pub fn create_folder(path: &Path) -> io::Result<()> {
    fs::create_dir_all(path)
}

/// The one name of what is at a path: links are none of ours, and the folder of the program is the root of all.
///
/// # Errors
/// If there is nothing.
pub(crate) fn canonical(path: &Path) -> io::Result<PathBuf> {
    fs::metadata(path)?;
    let mut name = PathBuf::from("/");
    for part in path.components() {
        match part {
            Component::ParentDir => _ = name.pop(),
            Component::Normal(part) => name.push(part),
            Component::Prefix(_) | Component::RootDir | Component::CurDir => {}
        }
    }
    Ok(name)
}

/// Opens a file for reading.
///
/// # Errors
/// If it cannot be opened.
pub fn open_without_waiting(path: &Path) -> io::Result<File> {
    File::open(path)
}
