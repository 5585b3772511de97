//! Whether something can be written to standard output at all.
//!
//! If standard output is closed when a program begins, Rust's start-up code opens /dev/null in its place, and the
//! standard library also ignores a descriptor that cannot be written. Both make every write succeed while all data are
//! lost. Afterwards nothing distinguishes that /dev/null from one that the caller has chosen: Python's
//! `subprocess.DEVNULL` opens it for reading and writing too. Therefore the descriptor is looked at before the start-up
//! code runs, by a function in the section `.init_array`.
#![allow(unsafe_code, reason = "no safe code runs before the start-up code; see docs/unsafe.md")]

use rustix::fs::{OFlags, fcntl_getfl};
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether standard output was closed, or open for reading only, when the process began.
static UNUSABLE: AtomicBool = AtomicBool::new(false);

extern "C" fn look() {
    let usable = fcntl_getfl(rustix::stdio::stdout())
        .is_ok_and(|flags| !flags.contains(OFlags::PATH) && flags & OFlags::RWMODE != OFlags::RDONLY);
    UNUSABLE.store(!usable, Ordering::Relaxed);
}

// SAFETY: the section holds pointers to functions that take no argument, and the C library calls each one once before
// `main`. `look` makes one system call and one store. It uses nothing that the start-up code of Rust's standard library
// prepares.
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

/// Checks that standard output was open for writing when the process began.
///
/// # Errors
/// If it was not.
pub fn check_stdout() -> io::Result<()> {
    if UNUSABLE.load(Ordering::Relaxed) {
        return Err(io::Error::other(
            "it is closed or cannot be written; send it to a file, or to /dev/null if it is not needed",
        ));
    }
    Ok(())
}
