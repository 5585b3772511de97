//! Whether a process is the one that opened its streams, or a child with a copy of its memory.
//!
//! A child has its parent's handles, but must not use its ports. Handlers of `pthread_atfork` do not run in a child
//! that the system call `clone` made, and asking for the process id is a system call too. So the process is noted in a
//! page that the kernel clears in every child that gets a copy of the memory, however it was made: looking there is one
//! load.
//!
//! A child that shares the memory of its parent (`vfork`, `CLONE_VM`) is not noticed. It may only call `exec`.
#![expect(unsafe_code, reason = "mapping memory and handlers of forks have no safe binding")]

use crate::sync::AtomicU64;
use core::ptr;
use core::sync::atomic::Ordering;
use std::sync::OnceLock;

/// Number of the present process; 0 in a child that has not asked for one yet.
static NUMBER: OnceLock<&'static AtomicU64> = OnceLock::new();
/// Stands in for the page if there is no memory for it. It is cleared by `fork` only.
static WITHOUT_PAGE: AtomicU64 = AtomicU64::new(0);
/// The highest number that this process and the processes before it have used. A child begins with its parent's value.
static HIGHEST: AtomicU64 = AtomicU64::new(0);

/// A process, as long as its memory is not copied into another one.
#[derive(Clone, Copy, Debug)]
pub struct Process {
    number: u64,
    present: &'static AtomicU64,
}

impl Process {
    /// The calling process.
    #[must_use]
    pub fn current() -> Self {
        let present = *NUMBER.get_or_init(page);
        Self { number: number(present, &HIGHEST), present }
    }

    /// Whether this is the calling process. No system call.
    #[inline]
    #[must_use]
    pub fn is_current(&self) -> bool {
        self.present.load(Ordering::Relaxed) == self.number
    }
}

/// The number in `present`, or a new one above `highest` where there is none. It is the same for all threads.
fn number(present: &AtomicU64, highest: &AtomicU64) -> u64 {
    let number = present.load(Ordering::Relaxed);
    if number != 0 {
        return number;
    }
    let fresh = highest.fetch_add(1, Ordering::Relaxed) + 1;
    // Another thread may have been first.
    present.compare_exchange(0, fresh, Ordering::Relaxed, Ordering::Relaxed).err().unwrap_or(fresh)
}

/// Maps the page.
fn page() -> &'static AtomicU64 {
    const SIZE: usize = size_of::<AtomicU64>();
    // SAFETY: a new mapping of the kernel's choice, rounded up to one page.
    let address = unsafe {
        libc::mmap(
            ptr::null_mut(),
            SIZE,
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
            -1,
            0,
        )
    };
    let number = if address == libc::MAP_FAILED {
        &WITHOUT_PAGE
    } else {
        // A kernel or an emulator that does not know this leaves the handler below.
        // SAFETY: the mapping above, which nothing else uses yet.
        let _ = unsafe { libc::madvise(address, SIZE, libc::MADV_WIPEONFORK) };
        // SAFETY: aligned to a page, zero, and never unmapped.
        unsafe { &*address.cast::<AtomicU64>() }
    };
    // SAFETY: the function only stores a number, which is allowed in a forked child.
    let _ = unsafe { libc::pthread_atfork(None, None, Some(forked)) };
    number
}

extern "C" fn forked() {
    if let Some(number) = NUMBER.get() {
        number.store(0, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_itself_until_its_memory_is_in_a_child() {
        let process = Process::current();
        assert!(process.is_current() && Process::current().is_current());
        assert_eq!(process.number, Process::current().number);
        // SAFETY: the child calls only functions that are allowed after a fork; no memory is shared.
        let child = unsafe { libc::syscall(libc::SYS_clone, libc::c_long::from(libc::SIGCHLD), 0, 0, 0, 0) };
        if child == 0 {
            let noticed = !process.is_current();
            let own = Process::current();
            let code = i32::from(!(noticed && own.is_current() && !process.is_current()));
            // SAFETY: ends the child at once.
            unsafe { libc::_exit(code) };
        }
        assert!(child > 0);
        let mut status = 0;
        // SAFETY: the child of above, and a valid place for its status.
        assert_eq!(unsafe { libc::waitpid(child as libc::pid_t, &raw mut status, 0) }, child as libc::pid_t);
        assert_eq!(status, 0);
        assert!(process.is_current());
    }
}

#[cfg(test)]
#[cfg(isotherm_loom)]
mod explored {
    use super::*;
    use crate::sync::{explore, thread};
    use std::sync::Arc;

    #[test]
    fn explored_all_threads_have_one_number_and_a_child_has_another() {
        explore(|| {
            let words = Arc::new([const { AtomicU64::new(0) }; 2]);
            let of_a_thread = || {
                let words = Arc::clone(&words);
                thread::spawn(move || number(&words[0], &words[1]))
            };
            let others = [of_a_thread(), of_a_thread()];
            let own = number(&words[0], &words[1]);
            assert!(own > 0 && others.map(|other| other.join().unwrap()) == [own; 2]);
            // What `forked` does, or the kernel.
            words[0].store(0, Ordering::Relaxed);
            assert!(number(&words[0], &words[1]) > own);
        });
    }
}
