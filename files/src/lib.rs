//! Files of Isotherm's programs.
//!
//! Tables and configurations are read with care ([`load_table`], [`read_text`]): a pipe, a giant or a file that changes under the reader is
//! refused. Results appear whole or not at all ([`Output`]): they are written under a temporary name and renamed when they are complete.

mod load;
mod output;

pub use load::{Guard, Identity, LoadError, load_table, read_text};
pub use output::{Output, StagedText, check_written, print, refuse_overlap, remove_unfinished_on_signals, replace};

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Opens a recording to read; `-` is stdin.
///
/// # Errors
/// If it cannot be opened.
pub fn open_recording(path: &Path) -> io::Result<Box<dyn Read>> {
    if path == Path::new("-") {
        return Ok(Box::new(io::stdin()));
    }
    let file = File::open(path)?;
    if file.metadata()?.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory));
    }
    Ok(Box::new(file))
}
