//! How Isotherm's programs read and write files.
//!
//! A result file appears whole or not at all ([`Output`]):
//! it is written under a temporary name and renamed when it is complete. A recording grows under its own name
//! ([`Disk`]).
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use isotherm_files::Output;
//! use std::io::Write as _;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("imu.txt");
//! let mut output = Output::create(Some(&path))?;
//! output.write_all(b"whole\n")?;
//! assert!(!path.exists()); // it has a temporary name yet
//! output.finish()?;
//! assert_eq!(std::fs::read_to_string(&path)?, "whole\n");
//! # Ok(())
//! # }
//! ```

// Where a page of a browser keeps the files, there are no other users, processes and signals.
#[cfg(not(target_os = "wasi"))]
mod disk;
mod identity;
#[cfg(not(target_os = "wasi"))]
mod install;
mod output;
#[cfg_attr(target_os = "wasi", path = "wasi/place.rs")]
mod place;
#[cfg_attr(target_os = "wasi", path = "wasi/signals.rs")]
mod signals;
mod source;
#[cfg_attr(target_os = "wasi", path = "wasi/staged.rs")]
mod staged;
#[cfg_attr(target_os = "wasi", path = "wasi/stdout.rs")]
mod stdout;
mod trust;

#[cfg(not(target_os = "wasi"))]
pub use disk::Disk;
pub use identity::{Identity, uninterrupted};
#[cfg(not(target_os = "wasi"))]
pub use install::Installation;
pub use output::{Output, StagedText, check_written, print, print_data, refuse_overlap, replace};
#[cfg(not(target_os = "wasi"))]
pub use place::{check_own_folder, create_own_folder, sync_folder, target_of};
pub use place::{create_folder, open_without_waiting, output_place};
#[cfg(not(target_os = "wasi"))]
pub use signals::{end_flag, end_signals};
pub use signals::{remove_unfinished_on_signals, report_file_limit};
pub use source::{open_recording, source, sources};
pub use stdout::check_stdout;
pub use trust::Trust;
