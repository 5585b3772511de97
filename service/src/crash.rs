//! The last line of a process that a fault of its memory ends, and the mark that its next start finds.
//!
//! - SIGBUS: the kernel can no longer provide its shared memory. That is reserved when it is created, so SIGBUS comes
//!   only if somebody truncates its files, or fills the rest within the microseconds before an object's first page is
//!   reserved.
//! - SIGSEGV, SIGABRT: the transport's structures in shared memory are damaged, or the program has a fault.
//!
//! The thread that was interrupted cannot continue: it would access the same memory again. So the handler itself writes
//! the line and ends the process.
#![expect(unsafe_code, reason = "a signal handler may call only async-signal-safe functions")]

use isotherm_support::failure::Exit;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags, open};
use rustix::io::write;
use rustix::stdio::stderr;
use signal_hook::consts::{SIGABRT, SIGBUS, SIGSEGV};
use std::ffi::{CString, c_int};
use std::io;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::sync::OnceLock;

/// What a crash adds to the mark of the start.
pub(crate) const CRASH: u8 = b'x';

const BUS: &[u8] = b"isotherm: SIGBUS: shared memory that is in use has been taken away; a process has cut files in \
/dev/shm, or it is full: make room there and start again\n";
const SEGV: &[u8] = b"isotherm: SIGSEGV: an access to memory that is not there; if what lies in shared memory is \
damaged, the next start removes it when no other process uses the domain, otherwise the one after the next\n";
const ABRT: &[u8] =
    b"isotherm: SIGABRT: ended by itself, or by the watchdog of the service manager; if what lies in shared memory \
is damaged, the next start removes it when no other process uses the domain, otherwise the one after the next\n";

/// The mark of this start.
static MARK: OnceLock<CString> = OnceLock::new();

/// Names the file to which a crash adds [`CRASH`], while it is there; the first one counts.
pub(crate) fn mark_in(path: &Path) {
    if let Ok(path) = CString::new(path.as_os_str().as_bytes()) {
        let _ = MARK.set(path);
    }
}

/// Adds [`CRASH`] to the mark of this start. A signal handler may call it.
fn mark() {
    let flags = OFlags::WRONLY | OFlags::APPEND | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    if let Some(Ok(mark)) = MARK.get().map(|path| open(path, flags, Mode::empty())) {
        let _ = write(mark, &[CRASH]);
    }
}

/// Installs handlers: SIGBUS, SIGSEGV and SIGABRT then end the process with a last line, SIGBUS with the exit code for
/// files that cannot be read or written, the others as they would without a handler. A panic leaves the mark, too.
///
/// # Errors
/// If the operating system refuses a handler.
pub(crate) fn install_handlers() -> io::Result<()> {
    for signal in [SIGBUS, SIGSEGV, SIGABRT] {
        // SAFETY: all bytes of the structure may be 0.
        let mut action: libc::sigaction = unsafe { core::mem::zeroed() };
        action.sa_sigaction = end as extern "C" fn(c_int) as usize;
        // On the thread's stack for signals, since its own may have overflowed; the next time the signal ends it.
        action.sa_flags = libc::SA_ONSTACK | libc::SA_RESETHAND;
        // SAFETY: `action` is complete; what `end` calls is async-signal-safe: it allocates nothing, takes no lock, and
        // does not return into the code that was interrupted.
        if unsafe { libc::sigaction(signal, &raw const action, core::ptr::null_mut()) } != 0 {
            return Err(io::Error::last_os_error());
        }
    }
    let say = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        mark();
        say(panic);
    }));
    Ok(())
}

extern "C" fn end(signal: c_int) {
    mark();
    let line = match signal {
        SIGBUS => BUS,
        SIGSEGV => SEGV,
        _ => ABRT,
    };
    // Nobody may be reading.
    let mut ready = [PollFd::from_borrowed_fd(stderr(), PollFlags::OUT)];
    if poll(&mut ready, Some(&Timespec::default())).is_ok_and(|ready| ready > 0) {
        let _ = write(stderr(), line);
    }
    if signal == SIGBUS {
        signal_hook::low_level::exit(Exit::Io as i32);
    }
    // It is delivered when this function returns, and has its default action again.
    // SAFETY: a system call without a pointer.
    let _ = unsafe { libc::raise(signal) };
}
