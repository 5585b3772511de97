//! Real-time settings of a thread: its core, its real-time priority, resident memory, and sleeps that end in time.
//!
//! ```no_run
//! # fn main() -> Result<(), isotherm_client::RealtimeError> {
//! use isotherm_client::Realtime;
//!
//! // In the thread that sends and receives, before it connects.
//! Realtime { core: Some(2), priority: Some(50), lock_memory: true, ..Realtime::default() }.apply()
//! # }
//! ```
//! The kernel stops a thread that never sleeps and has a real-time priority for about 50 ms of every second, unless it
//! has a core of its own and the kernel's limit is switched off: see `docs/operate.md`.
#![expect(unsafe_code, reason = "SCHED_FIFO and the bounds of a thread's stack have no safe binding")]

use core::fmt;
use core::hint::black_box;
use core::mem::MaybeUninit;
use core::ops::Range;
use core::ptr;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};
use std::num::NonZeroU64;
use std::{fs, io, thread};

/// How much of the stack is touched at most when memory is locked, so that no later call waits for one of its pages
/// \[bytes\].
const STACK: usize = 256 * 1024;
/// What is left untouched at the end of the stack: a page, the frames of this call, and that of a signal which comes
/// just then \[bytes\].
const SPARE: usize = 12 * 1024;
/// Size of a frame that touches the stack; smaller than a page \[bytes\].
const FRAME: usize = 1024;

/// Real-time settings of a thread. A setting that is not given stays unchanged.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct Realtime {
    /// The core that the thread is bound to.
    pub core: Option<usize>,
    /// `SCHED_FIFO` priority, 1 to 99.
    pub priority: Option<i32>,
    /// Keeps all memory of the process resident, including memory that it gets later, so that no access waits for a
    /// page.
    pub lock_memory: bool,
    /// How much later than requested a sleep may end, so that the kernel can combine it with others \[ns\]; the default
    /// of the kernel is 50 000. It has no effect under `SCHED_FIFO`, where sleeps are exact.
    pub timer_slack_ns: Option<NonZeroU64>,
}

/// A setting that failed, the cause, and a remedy.
#[derive(Debug, thiserror::Error)]
#[error("{setting}: {cause}; {remedy}")]
pub struct RealtimeError {
    /// The setting, by its name in [`Realtime`].
    pub setting: &'static str,
    cause: String,
    remedy: String,
}

impl Realtime {
    /// Applies the settings to the calling thread, and the memory lock to the process.
    ///
    /// # Errors
    /// The first setting that fails. The settings before it, in the order of the fields, are in force.
    pub fn apply(&self) -> Result<(), RealtimeError> {
        if let Some(core) = self.core {
            bind(core).map_err(|cause| RealtimeError {
                setting: "core",
                cause: format!("binding to core {core}: {cause}"),
                remedy: format!("this process may use {}; give one of them", allowed_cores()),
            })?;
        }
        if let Some(priority) = self.priority {
            set_fifo(priority).map_err(|cause| RealtimeError {
                setting: "priority",
                cause: format!("SCHED_FIFO {priority}: {cause}"),
                remedy: format!(
                    "grant CAP_SYS_NICE (systemd: AmbientCapabilities=CAP_SYS_NICE) or raise the limit to {priority} (`ulimit -r`; systemd: \
                     LimitRTPRIO={priority}; now {}); in a control group with cpu.rt_runtime_us that must not be 0",
                    limit(Resource::Rtprio, 1)
                ),
            })?;
        }
        if self.lock_memory {
            // Before memory is locked: a main thread whose stack grows over the limit of locked memory would be killed,
            // whereas locking what it has is refused.
            touch_stack();
            mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(lock_refused)?;
        }
        if let Some(slack) = self.timer_slack_ns {
            set_current_timer_slack(Some(slack)).map_err(|cause| RealtimeError {
                setting: "timer_slack_ns",
                cause: format!("setting {slack} ns: {cause}"),
                remedy: "leave it out".to_owned(),
            })?;
        }
        Ok(())
    }
}

impl Realtime {
    /// What [`apply`](Self::apply) would refuse in this process, setting by setting. Nothing changes: a thread of its
    /// own, which ends at once, tries what belongs to a thread; whether memory may be locked follows from the process's
    /// capabilities and limit.
    #[must_use]
    pub fn refusals(&self) -> Vec<RealtimeError> {
        let [mut core, mut priority, mut slack] = [Self::default(); 3];
        (core.core, priority.priority, slack.timer_slack_ns) = (self.core, self.priority, self.timer_slack_ns);
        let tried = [core, priority, slack].map(|setting| thread::Builder::new().spawn(move || setting.apply()));
        // Without a thread nothing is tried; the service will say so.
        let refused = tried.into_iter().filter_map(|thread| thread.ok()?.join().ok()?.err());
        let lock =
            (self.lock_memory && !may_lock_memory()).then(|| lock_refused("neither capability nor limit allow it"));
        refused.chain(lock).collect()
    }
}

fn lock_refused(cause: impl fmt::Display) -> RealtimeError {
    RealtimeError {
        setting: "lock_memory",
        cause: format!("locking memory: {cause}"),
        remedy: format!(
            "grant CAP_IPC_LOCK (systemd: AmbientCapabilities=CAP_IPC_LOCK) or raise the limit (`ulimit -l`; systemd: \
             LimitMEMLOCK=infinity; now {} kB, the process has {} kB)",
            limit(Resource::Memlock, 1024),
            process_kb("VmSize").map_or_else(|| "?".to_owned(), |kb| kb.to_string())
        ),
    }
}

/// Whether the process has `CAP_IPC_LOCK`, or its limit is not below its size.
fn may_lock_memory() -> bool {
    const CAP_IPC_LOCK: u64 = 1 << 14;
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let capabilities = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let capabilities = capabilities.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok());
    let size = process_kb("VmSize").unwrap_or(0).saturating_mul(1024);
    capabilities.is_some_and(|all| all & CAP_IPC_LOCK != 0)
        || getrlimit(Resource::Memlock).current.is_none_or(|limit| limit >= size)
}

/// The value of `name` (`VmSize`, `VmLck`, `VmRSS`) in `/proc/self/status` \[kB\].
#[must_use]
pub fn process_kb(name: &str) -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    line.split_whitespace().next()?.parse().ok()
}

fn bind(core: usize) -> io::Result<()> {
    if core >= CpuSet::MAX_CPU {
        return Err(io::Error::from(io::ErrorKind::InvalidInput));
    }
    let mut set = CpuSet::new();
    set.set(core);
    Ok(sched_setaffinity(None, &set)?)
}

fn allowed_cores() -> String {
    let status = fs::read_to_string("/proc/thread-self/status").unwrap_or_default();
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")).map(str::trim);
    format!("cores {}", list.unwrap_or("?"))
}

fn limit(resource: Resource, unit: u64) -> String {
    getrlimit(resource).current.map_or_else(|| "unlimited".to_owned(), |limit| (limit / unit).to_string())
}

fn set_fifo(priority: i32) -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: a system call on the calling thread (0) that reads one structure, which is valid during the call.
    let result = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Makes the kernel allocate the next [`STACK`] bytes of the calling thread's stack, or what the stack has left. Does
/// nothing on another stack than the thread's own, as in a coroutine, and where its bounds are not known.
fn touch_stack() {
    let here = address();
    if let Some(stack) = own_stack().filter(|stack| stack.contains(&here)) {
        touch_down_to(stack.start.saturating_add(SPARE).max(here.saturating_sub(STACK)));
    }
}

/// An address in the present frame, or near it.
#[inline(always)]
fn address() -> usize {
    let local = 0_u8;
    black_box(&raw const local) as usize
}

/// Touches one frame after the other until one lies below `end`.
#[inline(never)]
fn touch_down_to(end: usize) {
    let frame = [0_u8; FRAME];
    if black_box(&frame).as_ptr() as usize > end {
        touch_down_to(end);
    }
    // Keeps the frame until here.
    black_box(&frame);
}

/// Addresses of the calling thread's stack, without its guard. `None` if the system does not report them.
fn own_stack() -> Option<Range<usize>> {
    let mut attributes = MaybeUninit::<libc::pthread_attr_t>::uninit();
    // SAFETY: the calling thread, and a place for its attributes, which is initialized if the result is 0.
    if unsafe { libc::pthread_getattr_np(libc::pthread_self(), attributes.as_mut_ptr()) } != 0 {
        return None;
    }
    let (mut lowest, mut size, mut guard) = (ptr::null_mut(), 0, 0);
    // SAFETY: the attributes of above and places for three values. The attributes are not used after they are freed.
    let known = unsafe {
        let stack = libc::pthread_attr_getstack(attributes.as_ptr(), &raw mut lowest, &raw mut size);
        let guards = libc::pthread_attr_getguardsize(attributes.as_ptr(), &raw mut guard);
        libc::pthread_attr_destroy(attributes.as_mut_ptr());
        stack == 0 && guards == 0
    };
    // C libraries before glibc 2.27 count the guard as part of the stack.
    known.then(|| (lowest as usize).saturating_add(guard)..(lowest as usize).saturating_add(size))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many pages of the calling thread's stack that lie in the [`STACK`] bytes below this call are in memory, and
    /// how many there are without [`SPARE`].
    fn resident() -> (usize, usize) {
        // SAFETY: no pointers.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let stack = own_stack().unwrap();
        let here = address();
        assert!(stack.contains(&here));
        let first = (stack.start + SPARE).max(here - STACK).next_multiple_of(page);
        let mut pages = vec![0_u8; (here - first).div_ceil(page)];
        // SAFETY: pages of this thread's stack, and a place for one byte of each.
        let asked = unsafe { libc::mincore(first as *mut libc::c_void, here - first, pages.as_mut_ptr()) };
        assert_eq!(asked, 0);
        (pages.iter().filter(|page| **page & 1 == 1).count(), pages.len())
    }

    #[test]
    fn the_stack_is_touched_as_far_as_there_is_one() {
        for kilobytes in [64, 128, 1024] {
            let touch = || {
                let (before, _) = resident();
                touch_stack();
                let (after, all) = resident();
                // The frames of this function itself lie below where `touch_stack` begins.
                assert!(before < all / 2 && after + 1 >= all, "{before}, then {after} of {all} pages");
            };
            thread::Builder::new().stack_size(kilobytes << 10).spawn(touch).unwrap().join().unwrap();
        }
    }
}
