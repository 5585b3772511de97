//! Shared parts of the benches: a domain of their own with the service as a child process, pinning to cores, and
//! figures from `/proc`.

pub mod statistics;

use isotherm_client::{Domain, Options, RawSample, fetch_status};
use isotherm_shared::wire::Triad;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::error::Error;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::str::FromStr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The table that the service starts with: that of a whole IMU, with everything that the kernel can have to do.
pub const TABLE: &str = include_str!("../../examples/tables/imu-whole.toml");
/// The IMU of [`TABLE`].
pub const IMU: &str = "imu-whole";
/// Time constant of [`TABLE`] \[ns\].
pub const LAG_NS: u64 = 240_000_000_000;
/// Longest wait for an answer; after it the bench fails.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// The sample that the benches send: an IMU at rest.
pub fn sample() -> RawSample {
    let telemetry = Triad {
        head_temperature: [2.4, 2.41, 2.42],
        board_temperature: [2.5, 2.51, 2.52],
        head_lagged: [2.38, 2.39, 2.4],
        ..Triad::default()
    };
    RawSample {
        interval_ns: 2_500_000,
        lag_ns: LAG_NS,
        accelerometers: Triad { positive_pulses: [140, 0, 150], negative_pulses: [0, 110, 0], ..telemetry },
        gyroscopes: Triad { positive_pulses: [20, 0, 3], negative_pulses: [0, 17, 4], ..telemetry },
        ..RawSample::default()
    }
}

/// The file in a domain's folder that its processes log to.
const LOG: &str = "log";
/// The file in a domain's folder for the standard output of its processes.
const OUTPUT: &str = "output";

/// Another build of the service, which is measured in the same run.
#[derive(Clone, Debug)]
pub struct OtherBuild {
    /// Its name in the figures.
    pub name: String,
    /// A program with the command `serve`, as `isotherm` and `isothermd` are.
    pub program: PathBuf,
}

impl FromStr for OtherBuild {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=').filter(|(name, program)| !name.is_empty() && !program.is_empty());
        let (name, program) = parts.ok_or("give NAME=PROGRAM, for example before=old/isotherm")?;
        let program = fs::canonicalize(program).map_err(|error| format!("{program}: {error}"))?;
        Ok(Self { name: name.to_owned(), program })
    }
}

/// The result of a step of a bench.
pub type BenchResult<T> = Result<T, Box<dyn Error>>;

/// A domain and a folder of this bench's own, removed at its end.
pub struct BenchDomain {
    folder: TempDir,
    domain: Domain,
    _cleaner: Cleaner,
}

impl BenchDomain {
    /// Makes a domain in a new temporary folder.
    ///
    /// # Errors
    /// If the temporary folder cannot be used.
    pub fn new() -> BenchResult<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let folder = tempfile::Builder::new().prefix("iso-").tempdir()?;
        let name = format!("bench-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let domain = Domain::new(&name, &format!("{}/{name}", folder.path().display()))?;
        let cleaner = Cleaner(domain.prefix());
        Ok(Self { folder, domain, _cleaner: cleaner })
    }

    /// The domain as the client library takes it.
    pub const fn as_domain(&self) -> &Domain {
        &self.domain
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A path in shared memory. It is removed with the domain.
    pub fn shared_memory(&self, name: &str) -> PathBuf {
        PathBuf::from(format!("/dev/shm/{}{name}", self.domain.prefix()))
    }

    /// How many processes or threads read the increments of the first IMU.
    ///
    /// # Errors
    /// If no service runs.
    pub fn readers(&self) -> BenchResult<usize> {
        Ok(fetch_status(&self.options())?.imus.first().map_or(0, |imu| imu.readers))
    }

    /// The options of clients of this domain.
    pub fn options(&self) -> Options {
        Options::new(self.domain.clone(), TIMEOUT)
    }

    /// Writes `table.toml`, and starts the service for [`IMU`] with it. `settings` is appended to the configuration;
    /// keys of the IMU must come first in it. The program of this bench must hand the command `serve` to
    /// `isotherm_service::main`.
    ///
    /// # Errors
    /// If files cannot be written or the process not started.
    pub fn serve(&self, settings: &str) -> BenchResult<BenchProcess> {
        self.serve_by(None, settings)
    }

    /// Writes `table.toml` and `service.toml` for [`IMU`], as for [`serve`](Self::serve).
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn configure(&self, settings: &str) -> BenchResult<()> {
        fs::write(self.path("table.toml"), TABLE)?;
        let service = format!("[[imu]]\nid = \"{IMU}\"\ntable = \"table.toml\"\n{settings}");
        Ok(fs::write(self.path("service.toml"), service)?)
    }

    /// Compiles a C program of this crate with `cc` against the shared library in the folder `libraries`. Returns its
    /// path.
    ///
    /// # Errors
    /// If there is no library, or `cc` cannot compile it.
    pub fn compiled(&self, source: &str, libraries: &Path) -> BenchResult<PathBuf> {
        const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
        let (program, folder) = (self.path("acquisition"), libraries.display());
        if !libraries.join("libisotherm_client.so.0").exists() {
            return Err(format!("{folder} has no libisotherm_client.so; `cargo build [--release]` makes it").into());
        }
        let mut compiler = Command::new("cc");
        compiler.args(["-std=c11", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        compiler.arg(format!("-I{FOLDER}/../client/include")).arg(format!("{FOLDER}/src/{source}"));
        compiler.arg(format!("-L{folder}")).arg(format!("-Wl,-rpath,{folder}")).arg("-lisotherm_client");
        let status = compiler.arg("-o").arg(&program).status()?;
        if status.success() { Ok(program) } else { Err(format!("cc cannot compile {source}").into()) }
    }

    /// As [`serve`](Self::serve), with another program if one is given. It must have the command `serve`.
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn serve_by(&self, program: Option<&Path>, settings: &str) -> BenchResult<BenchProcess> {
        self.configure(settings)?;
        let own = std::env::current_exe()?;
        self.spawn_program(program.unwrap_or(&own), &["serve", "--config", "service.toml"])
    }

    /// Starts the service for `count` IMUs, each with a table of its own, spread over `workers`.
    ///
    /// # Errors
    /// If files cannot be written or the process not started.
    pub fn serve_many(&self, count: usize, workers: usize, settings: &str) -> BenchResult<BenchProcess> {
        let mut config = String::new();
        for (index, id) in (0..count).map(|index| (index, imu(index))) {
            let file = format!("{id}.toml");
            fs::write(self.path(&file), TABLE.replace(&format!("\"{IMU}\""), &format!("\"{id}\"")))?;
            config += &format!("[[imu]]\nid = \"{id}\"\ntable = \"{file}\"\nworker = {}\n", index % workers);
        }
        fs::write(self.path("service.toml"), config + settings)?;
        self.spawn(&["serve", "--config", "service.toml"])
    }

    /// Starts this program as another process of the domain.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn spawn(&self, words: &[&str]) -> BenchResult<BenchProcess> {
        self.spawn_program(&std::env::current_exe()?, words)
    }

    /// Starts a program as another process of the domain, in its folder.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn spawn_program(&self, program: &Path, words: &[&str]) -> BenchResult<BenchProcess> {
        let mut command = Command::new(program);
        command.args(words).current_dir(self.folder.path());
        command.env("ISOTHERM_DOMAIN", self.domain.name()).env("ISOTHERM_ROOT", self.folder.path());
        let log = File::options().append(true).create(true).open(self.path(LOG))?;
        let output = File::options().append(true).create(true).open(self.path(OUTPUT))?;
        Ok(BenchProcess(command.stdin(Stdio::null()).stdout(output).stderr(log).spawn()?))
    }

    /// All that processes of the domain have written to stdout.
    pub fn output(&self) -> String {
        fs::read_to_string(self.path(OUTPUT)).unwrap_or_default()
    }

    /// The last lines that processes of the domain have logged.
    pub fn log(&self) -> String {
        let text = fs::read_to_string(self.path(LOG)).unwrap_or_default();
        let lines: Vec<_> = text.lines().collect();
        lines[lines.len().saturating_sub(20)..].join("\n")
    }
}

/// The name of IMU number `index`.
pub fn imu(index: usize) -> String {
    format!("imu-{index}")
}

/// A child process that does not outlive the bench.
pub struct BenchProcess(Child);

impl BenchProcess {
    /// Stops the process, so that it does not compete for the cores while something else is measured.
    pub fn pause(&self) {
        self.signal(Signal::STOP);
    }

    /// Lets the process run again.
    pub fn resume(&self) {
        self.signal(Signal::CONT);
    }

    /// Asks the process to end.
    pub fn terminate(&self) {
        self.signal(Signal::TERM);
    }

    fn signal(&self, signal: Signal) {
        // Fails only if the process has died. The bench then fails because answers are missing.
        let _ = kill_process(Pid::from_child(&self.0), signal);
    }

    /// The process id.
    pub fn pid(&self) -> u32 {
        self.0.id()
    }

    /// Waits for the end of the process. Returns whether it has succeeded.
    ///
    /// # Errors
    /// If it does not end within `timeout`.
    pub fn succeeds_within(&mut self, timeout: Duration) -> BenchResult<bool> {
        let begun = Instant::now();
        while begun.elapsed() < timeout {
            if let Some(status) = self.0.try_wait()? {
                return Ok(status.success());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Err("a process does not end".into())
    }
}

impl Drop for BenchProcess {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Removes what the bench's domain leaves in shared memory.
struct Cleaner(String);

impl Drop for Cleaner {
    fn drop(&mut self) {
        for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&self.0) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

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

/// To be called first in a child process: the child ends with its parent, and may use every core even if its parent is
/// pinned.
pub fn become_child() {
    // Both calls fail only where they are not supported. The bench works without them.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
    let mut all = CpuSet::new();
    (0..CpuSet::MAX_CPU).for_each(|core| all.set(core));
    let _ = sched_setaffinity(None, &all);
}

/// A busy wait with a time limit. The clock is read rarely.
#[derive(Debug, Default)]
pub struct Spin {
    turns: u32,
    since: Option<Instant>,
}

impl Spin {
    /// One turn of the busy wait.
    ///
    /// # Errors
    /// If the wait has been longer than [`TIMEOUT`].
    #[inline]
    pub fn turn(&mut self) -> BenchResult<()> {
        core::hint::spin_loop();
        self.turns = self.turns.wrapping_add(1);
        if self.turns.is_multiple_of(1 << 16) && self.since.get_or_insert_with(Instant::now).elapsed() > TIMEOUT {
            return Err("no answer; the other process has stopped".into());
        }
        Ok(())
    }
}

/// Processor time of the service's worker threads so far.
pub fn worker_time(service: &BenchProcess) -> Duration {
    let tasks = fs::read_dir(format!("/proc/{}/task", service.pid())).into_iter().flatten().flatten();
    let workers =
        tasks.filter(|task| fs::read_to_string(task.path().join("comm")).is_ok_and(|name| name.starts_with("worker")));
    let ran = |task: fs::DirEntry| {
        let text = fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    workers.filter_map(ran).sum()
}

/// Involuntary context switches of all threads of a process so far.
pub fn preemptions(pid: u32) -> u64 {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let count = |task: fs::DirEntry| {
        let status = fs::read_to_string(task.path().join("status")).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("nonvoluntary_ctxt_switches:"))?;
        line.trim().parse::<u64>().ok()
    };
    tasks.filter_map(count).sum()
}

/// Steal time so far, which the host of this virtual machine has given to others, in ticks of 10 ms.
pub fn stolen_ticks() -> u64 {
    let stat = fs::read_to_string("/proc/stat").unwrap_or_default();
    let cpu = stat.lines().next().unwrap_or_default();
    cpu.split_whitespace().nth(8).and_then(|ticks| ticks.parse().ok()).unwrap_or(0)
}

/// The first line of a file.
pub fn first_line(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().and_then(|text| text.lines().next().map(str::to_owned))
}
