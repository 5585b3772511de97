//! The repair of a recording, from a file into a file.

use isotherm_files::{Output, check_written, refuse_overlap, source};
use isotherm_recording_formats::repair::{RepairReport, repair};
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;
use std::{fs, io};

/// Takes what is whole of the recording `from` into `target`, in the same format. Returns what was taken and lost.
///
/// # Errors
/// If `target` exists, if nothing can be taken, or if a file cannot be read or written.
pub fn repair_into(from: &Path, target: &Path) -> Result<RepairReport, Failure> {
    refuse_overlap(&[(from, "the recording")], &[Some(target)])?;
    let refuse_existing = || match fs::symlink_metadata(target) {
        Ok(_) => {
            let message = format!("{} exists; a recording is never replaced: name another", shown(target));
            Err(Failure::new(Exit::Io, message).at(target, None))
        }
        Err(_) => Ok(()),
    };
    refuse_existing()?;
    let written = |result: io::Result<Output>| match result {
        Ok(output) => Ok(output),
        Err(error) => {
            check_written(Some(target), Err(error))?;
            Err(Failure::new(Exit::Io, format!("writing {}", shown(target))))
        }
    };
    let mut output = written(Output::create(Some(target)))?;
    let repaired = repair(&source(from), &mut output).map_err(|failure| match failure.exit {
        // An error of the output has no other place.
        Exit::Io if failure.place.is_none() => Failure::new(Exit::Io, format!("{}: {failure}", shown(target))),
        _ => failure,
    })?;
    refuse_existing()?;
    check_written(Some(target), output.finish())?;
    Ok(repaired)
}
