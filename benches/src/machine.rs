//! The machine: its cores, and figures from `/proc`.

use crate::BenchProcess;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde_json::{Value, json};
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

/// The cores that this process may use: those of the first call, before a thread is bound to one of them.
pub fn cores() -> Vec<usize> {
    static CORES: OnceLock<Vec<usize>> = OnceLock::new();
    let asked = || {
        let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
        (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
    };
    CORES.get_or_init(asked).clone()
}

/// Binds the calling thread to a core, if one is given.
pub fn pin(core: Option<usize>) {
    if let Some(core) = core {
        let mut set = CpuSet::new();
        set.set(core);
        // If this is not allowed, the figures are only noisier.
        let _ = sched_setaffinity(None, &set);
    }
}

/// Binds the calling thread to the first core, if there is a second one for the process that answers. Returns that one.
pub fn pin_apart() -> Option<usize> {
    let cores = cores();
    let theirs = cores.get(1).copied();
    pin(cores.first().copied().filter(|_| theirs.is_some()));
    theirs
}

/// Lets the calling thread use every core.
pub(crate) fn unpin() {
    let mut all = CpuSet::new();
    (0..CpuSet::MAX_CPU).for_each(|core| all.set(core));
    // If this is not allowed, the process stays on the core of its parent.
    let _ = sched_setaffinity(None, &all);
}

/// The threads of a process, as folders of `/proc`.
fn threads(pid: u32) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    entries.map(|entry| entry.path())
}

/// Processor time of the service's worker threads so far.
pub fn worker_time(service: &BenchProcess) -> Duration {
    let workers = threads(service.pid())
        .filter(|thread| fs::read_to_string(thread.join("comm")).is_ok_and(|name| name.starts_with("worker")));
    let ran = |thread: PathBuf| {
        let text = fs::read_to_string(thread.join("schedstat")).ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    workers.filter_map(ran).sum()
}

/// Involuntary context switches of all threads of a process so far.
pub fn preemptions(pid: u32) -> u64 {
    threads(pid).filter_map(|thread| status_number(&thread, "nonvoluntary_ctxt_switches")).sum()
}

/// A number in the file `status` of a folder of `/proc`; of memory in kB.
pub fn status_number(folder: &Path, name: &str) -> Option<u64> {
    let status = fs::read_to_string(folder.join("status")).ok()?;
    let number = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    number.split_whitespace().next()?.parse().ok()
}

/// The objects in shared memory whose names begin with the prefix of a domain.
pub fn shared_memory(prefix: &str) -> impl Iterator<Item = DirEntry> {
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().flatten();
    entries.filter(move |entry| entry.file_name().to_string_lossy().starts_with(prefix))
}

/// Steal time so far, which the host of this virtual machine has given to others, in ticks of 10 ms.
pub fn stolen_ticks() -> u64 {
    let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
    let cpu = stat.lines().next().unwrap_or_default();
    cpu.split_whitespace().nth(8).and_then(|ticks| ticks.parse().ok()).unwrap_or(0)
}

/// The description of the machine.
pub(crate) fn machine() -> Value {
    let processors = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = processors.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(": "));
    json!({
        "cpu": model.map(|(_, name)| name),
        "cores": cores().len(),
        "virtual": processors.contains(" hypervisor"),
        "kernel": first_line("/proc/sys/kernel/osrelease"),
        "clock_source": first_line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        "governor": first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
    })
}

fn first_line(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().and_then(|text| text.lines().next().map(str::to_owned))
}
