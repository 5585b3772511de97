//! What the operating system says of the worker threads: settings in force, processor time, and time held back.

use crate::reload::TICK;
use crate::worker::counters::HeartbeatReader;
use isotherm_shared::status::WorkerStatus;
use std::fs;
use std::time::{Duration, Instant};

/// `SCHED_FIFO` in `/proc`.
const FIFO: &str = "1";
/// A thread with a real-time priority that has been held back for longer within a second has met the kernel's limit.
const HELD_BACK: Duration = Duration::from_millis(10);
/// A worker that has not moved for so many looks in a row, the control loop's, stands still: a second.
const STILL: u32 = (1_000 / TICK.as_millis()) as u32;

/// One thread of this process, looked at once in a while.
#[derive(Debug)]
pub struct WorkerThread {
    id: i32,
    imus: Vec<String>,
    last: Option<(Instant, Times)>,
    cpu_percent: f64,
    held_back: Duration,
    heartbeat: HeartbeatReader,
    last_count: u64,
    looks_without: u32,
}

/// What [`WorkerThread::check_heartbeat`] tells.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum HeartbeatChange {
    /// The loop has not turned for a second.
    Stopped,
    /// It turns again.
    Resumed,
}

/// Since the thread began.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    ran: Duration,
    waited: Duration,
}

impl WorkerThread {
    /// The thread with this id, which serves these IMUs.
    pub const fn new(id: i32, imus: Vec<String>, heartbeat: HeartbeatReader) -> Self {
        let (last_count, looks_without) = (0, 0);
        Self { id, imus, last: None, cpu_percent: 0.0, held_back: Duration::ZERO, heartbeat, last_count, looks_without }
    }

    /// Checks whether its loop has turned since the last check. Checks are counted, not time: none are made while the whole process is
    /// stopped. Tells when the loop has stopped, and when it turns again.
    pub fn check_heartbeat(&mut self) -> Option<HeartbeatChange> {
        let count = self.heartbeat.count();
        if count == self.last_count {
            self.looks_without = self.looks_without.saturating_add(1);
            (self.looks_without == STILL).then_some(HeartbeatChange::Stopped)
        } else {
            let stood_still = self.stands_still();
            (self.last_count, self.looks_without) = (count, 0);
            stood_still.then_some(HeartbeatChange::Resumed)
        }
    }

    /// Whether its loop has not turned for a second.
    pub const fn stands_still(&self) -> bool {
        self.looks_without >= STILL
    }

    /// The IMUs that it serves, for messages.
    pub fn imus(&self) -> String {
        self.imus.join(", ")
    }

    /// Looks at what it has done since the last look.
    pub fn look(&mut self) {
        let now = (Instant::now(), self.times());
        if let Some((then, times)) = self.last.replace(now) {
            let passed = now.0.duration_since(then).as_secs_f64();
            self.cpu_percent = 100.0 * now.1.ran.saturating_sub(times.ran).as_secs_f64() / passed.max(1e-9);
            self.held_back = now.1.waited.saturating_sub(times.waited);
        }
    }

    /// How long it has been held back between the last two looks, if that is more than a real-time thread should meet.
    pub fn held_back(&self) -> Option<Duration> {
        (self.priority().is_some() && self.held_back > HELD_BACK).then_some(self.held_back)
    }

    /// For the status.
    pub fn status(&self) -> WorkerStatus {
        let status = self.read("status");
        let cores = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
        // The slack of a thread is in the folder of a process of that number.
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
            stands_still: self.stands_still(),
        }
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(format!("/proc/self/task/{}/{name}", self.id)).unwrap_or_default()
    }

    /// proc_pid_stat(5): behind the name in brackets, field 40 is the priority and 41 the policy.
    fn priority(&self) -> Option<u32> {
        let stat = self.read("stat");
        let fields: Vec<_> = stat.rsplit(") ").next()?.split(' ').collect();
        (*fields.get(41 - 3)? == FIFO).then(|| fields.get(40 - 3)?.parse().ok())?
    }

    /// Nanoseconds on a core and in a run queue.
    fn times(&self) -> Times {
        let text = self.read("schedstat");
        let mut numbers = text.split(' ').map(|number| Duration::from_nanos(number.parse().unwrap_or(0)));
        Times { ran: numbers.next().unwrap_or_default(), waited: numbers.next().unwrap_or_default() }
    }
}

/// What the kernel allows real-time threads, as far as it says so.
pub fn kernels_limit() -> String {
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
