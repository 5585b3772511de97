//! The version, the clocks, and real-time settings of a thread.

use crate::code::isotherm_code;
use crate::handle::without_handle;
use core::ffi::{CStr, c_char};
use core::num::NonZeroU64;
use isotherm_client::Realtime;

/// The version of the library. ISOTHERM_VERSION is the version of the header.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => c"",
    };
    VERSION.as_ptr()
}

/// CLOCK_MONOTONIC [ns], the clock of `sent_ns`.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_monotonic_ns() -> u64 {
    isotherm_client::monotonic_ns()
}

/// The number of the machine's present start, with which CLOCK_MONOTONIC began; 0 if the kernel does not report it.
/// Save it with isotherm_save_lag: times of another start are of another clock.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_boot() -> u64 {
    isotherm_client::boot()
}

/// Applies real-time settings to the calling thread. Call it in the thread that sends and receives, before it connects.
///
/// `core`: the core that the thread is bound to; -1: no change. `priority`: SCHED_FIFO priority, 1 to 99; 0: no change.
/// `lock_memory`: keeps all memory of the process resident, including memory that it gets later. `timer_slack_ns`: how
/// much later than requested a sleep may end [ns]; 0: no change (the default of the kernel is 50 000).
///
/// ISOTHERM_OK, ISOTHERM_ERROR_REALTIME for the first setting that fails. The settings before it, in this order, are in
/// force.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_realtime(core: i32, priority: i32, lock_memory: bool, timer_slack_ns: u64) -> isotherm_code {
    without_handle(|| {
        let core = (core != -1).then(|| usize::try_from(core).unwrap_or(usize::MAX));
        let priority = (priority != 0).then_some(priority);
        let timer_slack_ns = NonZeroU64::new(timer_slack_ns);
        Ok(Realtime { core, priority, lock_memory, timer_slack_ns }.apply()?)
    })
}
