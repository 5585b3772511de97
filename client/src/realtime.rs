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
#![expect(unsafe_code, reason = "SCHED_FIFO has no safe binding")]

use core::fmt;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};
use std::num::NonZeroU64;
use std::{fs, io, thread};

/// Size of the stack that is touched when memory is locked, so that no later call waits for one of its pages \[bytes\].
const STACK: usize = 256 * 1024;

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
            mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(lock_refused)?;
            touch_stack();
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
    /// own, which ends at once, tries what belongs to a thread; whether memory may be locked is told from the process's
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

#[inline(never)]
fn touch_stack() {
    core::hint::black_box([1_u8; STACK]);
}
