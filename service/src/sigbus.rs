//! Ends the process with a message when the kernel can no longer provide its shared memory (SIGBUS).
//!
//! Shared memory is reserved when it is created, so SIGBUS comes only if somebody truncates its files, or fills the
//! rest within the microseconds before an object's first page is reserved. The thread that accesses them cannot
//! continue, and must not return from the signal handler: it would access them again. So the handler itself writes the
//! message and ends the process.
#![expect(unsafe_code, reason = "a signal handler may call only async-signal-safe functions")]

use isotherm_failure::Exit;
use signal_hook::consts::SIGBUS;
use signal_hook::low_level;
use std::io;

const MESSAGE: &[u8] = b"isotherm: SIGBUS: shared memory that is in use has been taken away; somebody has cut files in /dev/shm, or it is \
full: make room there and start again\n";

/// Installs the handler: SIGBUS then ends the process with a message and the exit code for files that cannot be read or
/// written.
///
/// # Errors
/// If the operating system refuses the handler.
pub(crate) fn install_handler() -> io::Result<()> {
    let end = || {
        let _ = rustix::io::write(rustix::stdio::stderr(), MESSAGE);
        low_level::exit(Exit::Io as i32);
    };
    // SAFETY: the action is one system call to write a constant and one to end the process; it allocates nothing, takes
    // no lock and does not return into the code that was interrupted.
    unsafe { low_level::register(SIGBUS, end) }.map(drop)
}
