//! The end of a process whose memory the kernel can no longer give.
//!
//! Shared memory is reserved when it is created, so that this happens only if somebody cuts its files. The thread that touches them cannot go
//! on and must not return from the signal: it would touch them again. So the message is written, and the process ended, where the signal finds it.
#![expect(unsafe_code, reason = "what runs within a signal must be chosen with care")]

use isotherm_failure::Exit;
use signal_hook::consts::SIGBUS;
use signal_hook::low_level;
use std::io;

const MESSAGE: &[u8] = b"isotherm: SIGBUS: shared memory that is in use has been taken away; somebody has cut files in /dev/shm, or it is \
full: make room there and start again\n";

/// From now on SIGBUS ends the process with a message and the exit code for files that cannot be read or written.
///
/// # Errors
/// If the operating system refuses the handler.
pub fn explain() -> io::Result<()> {
    let end = || {
        let _ = rustix::io::write(rustix::stdio::stderr(), MESSAGE);
        low_level::exit(Exit::Io as i32);
    };
    // SAFETY: the action is one system call to write a constant and one to end the process; it allocates nothing, takes no lock and does
    // not return into the code that was interrupted.
    unsafe { low_level::register(SIGBUS, end) }.map(drop)
}
