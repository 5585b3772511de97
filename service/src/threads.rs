//! What the operating system reports about the worker threads: settings in force, processor time, and time held back.

use crate::reload::TICK;
use crate::worker::counters::HeartbeatReader;
use isotherm_client::monotonic_ns;
use isotherm_shared::status::WorkerStatus;
use std::fs;
use std::time::{Duration, Instant};

/// The number of `SCHED_FIFO` in `/proc`.
const FIFO: &str = "1";
/// If a real-time thread was held back for longer than this within a second, the kernel's limit or another thread
/// stopped it.
const HELD_BACK: Duration = Duration::from_millis(10);
/// After so many checks in a row without a heartbeat, which is one second, a worker counts as standing still.
const STILL_CHECKS: u32 = (1_000 / TICK.as_millis()) as u32;

/// One worker thread, as it is measured and checked from time to time.
#[derive(Debug)]
pub(crate) struct WorkerThread {
    id: i32,
    imus: Vec<String>,
    last: Option<(Instant, ThreadTimes)>,
    cpu_percent: f64,
    held_back: Duration,
    heartbeat: HeartbeatReader,
    last_count: u64,
    /// When the count was last seen to have risen \[ns\].
    beat_ns: u64,
    checks_without_beat: u32,
}

/// The result of [`WorkerThread::check_heartbeat`].
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum HeartbeatChange {
    /// The loop has not turned for a second.
    Stopped,
    /// It turns again.
    Resumed,
}

/// ThreadTimes since the thread began.
#[derive(Clone, Copy, Debug, Default)]
struct ThreadTimes {
    /// On a core.
    ran: Duration,
    /// In a run queue.
    waited: Duration,
}

impl WorkerThread {
    /// The thread with this id, which serves these IMUs.
    pub(crate) fn new(id: i32, imus: Vec<String>, heartbeat: HeartbeatReader) -> Self {
        let (last_count, beat_ns, checks_without_beat) = (0, monotonic_ns(), 0);
        Self {
            id,
            imus,
            last: None,
            cpu_percent: 0.0,
            held_back: Duration::ZERO,
            heartbeat,
            last_count,
            beat_ns,
            checks_without_beat,
        }
    }

    /// Checks whether its loop has turned since the last check. Returns a change: the loop has stopped, or turns again.
    /// Checks are counted and not time, since there are no checks while the whole process is stopped.
    pub(crate) fn check_heartbeat(&mut self) -> Option<HeartbeatChange> {
        let count = self.heartbeat.count();
        if count == self.last_count {
            self.checks_without_beat = self.checks_without_beat.saturating_add(1);
            (self.checks_without_beat == STILL_CHECKS).then_some(HeartbeatChange::Stopped)
        } else {
            let stood_still = self.stands_still();
            (self.last_count, self.beat_ns, self.checks_without_beat) = (count, monotonic_ns(), 0);
            stood_still.then_some(HeartbeatChange::Resumed)
        }
    }

    /// Whether its loop has not turned for a second.
    pub(crate) const fn stands_still(&self) -> bool {
        self.checks_without_beat >= STILL_CHECKS
    }

    /// The IMUs that it serves, for messages.
    pub(crate) fn imus(&self) -> String {
        self.imus.join(", ")
    }

    /// Measures processor time and time held back since the last measurement.
    pub(crate) fn measure(&mut self) {
        let now = (Instant::now(), self.times());
        if let Some((then, times)) = self.last.replace(now) {
            let passed = now.0.duration_since(then).as_secs_f64();
            self.cpu_percent = 100.0 * now.1.ran.saturating_sub(times.ran).as_secs_f64() / passed.max(1e-9);
            self.held_back = now.1.waited.saturating_sub(times.waited);
        }
    }

    /// How long it was held back between the last two measurements, if it has a real-time priority and this is over the
    /// limit.
    pub(crate) fn held_back(&self) -> Option<Duration> {
        (self.priority().is_some() && self.held_back > HELD_BACK).then_some(self.held_back)
    }

    /// Its part of the status document.
    pub(crate) fn status(&self) -> WorkerStatus {
        let status = self.read("status");
        let cores = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
        // The kernel shows the slack of a thread in `/proc/<thread id>`, not in the thread's folder.
        let slack = fs::read_to_string(format!("/proc/{}/timerslack_ns", self.id));
        let times = self.last.map(|(_, times)| times).unwrap_or_default();
        WorkerStatus {
            thread: self.id,
            imus: self.imus.clone(),
            cores: cores.unwrap_or("?").trim().to_owned(),
            priority: self.priority(),
            timer_slack_ns: slack.ok().and_then(|slack| slack.trim().parse().ok()),
            cpu_percent: self.cpu_percent,
            cpu_s: times.ran.as_secs_f64(),
            held_back_s: times.waited.as_secs_f64(),
            held_back_ms: self.held_back.as_secs_f64() * 1e3,
            heartbeat_ns: self.beat_ns,
            stands_still: self.stands_still(),
        }
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(format!("/proc/self/task/{}/{name}", self.id)).unwrap_or_default()
    }

    /// The real-time priority, if it has one. proc_pid_stat(5): field 40 is the priority and field 41 the policy; the
    /// fields after the name in brackets start at 3.
    fn priority(&self) -> Option<u32> {
        let stat = self.read("stat");
        let fields: Vec<_> = stat.rsplit(") ").next()?.split(' ').collect();
        (*fields.get(41 - 3)? == FIFO).then(|| fields.get(40 - 3)?.parse().ok())?
    }

    /// The first two numbers of `schedstat`: time on a core and time in a run queue \[ns\].
    fn times(&self) -> ThreadTimes {
        let text = self.read("schedstat");
        let mut numbers = text.split(' ').map(|number| Duration::from_nanos(number.parse().unwrap_or(0)));
        ThreadTimes { ran: numbers.next().unwrap_or_default(), waited: numbers.next().unwrap_or_default() }
    }
}

/// The kernel's limit on real-time threads, as far as this process may read it.
pub(crate) fn kernel_limit() -> String {
    let number = |path: &str| fs::read_to_string(path).ok().and_then(|text| text.trim().parse::<i64>().ok());
    let runtime = number("/proc/sys/kernel/sched_rt_runtime_us");
    let period = number("/proc/sys/kernel/sched_rt_period_us");
    let server = number("/sys/kernel/debug/sched/fair_server/cpu0/runtime");
    let mut limits = Vec::new();
    if let (Some(runtime), Some(period)) = (runtime, period) {
        limits.push(match runtime {
            -1 => "sched_rt_runtime_us -1 (no limit)".to_owned(),
            _ => format!("sched_rt_runtime_us {runtime} of {period}"),
        });
    }
    limits.extend(server.map(|runtime| format!("fair server {} ms of each second", runtime / 1_000_000)));
    if limits.is_empty() { "not told".to_owned() } else { limits.join(", ") }
}
