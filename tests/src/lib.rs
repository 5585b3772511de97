//! The harness of the end-to-end tests. Each test gets a domain and a folder of its own, starts real processes in them,
//! is ended by a watchdog if it hangs, and leaves nothing behind.
//!
//! Over 400 lines: every test uses both types, and they share the list of processes.
#![allow(
    clippy::expect_used,
    clippy::missing_panics_doc,
    clippy::panic,
    clippy::print_stderr,
    clippy::unwrap_used,
    reason = "in a test the panic is the report"
)]

pub mod emulator;
pub mod laboratory;
pub mod programs;

use isotherm_client::{
    Acquisition, CompensatedIncrement, Domain, Flags, ImuId, IncrementReader, Lag, Options, RawSample, Triad, device,
};
use isotherm_install::Acceptance;
use isotherm_recording::RawCsvReader;
use isotherm_shared::table::CoefficientTable;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Condvar, Mutex, Once, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use std::{env, fs};
use tempfile::TempDir;

/// The coefficient table of the recording, for `imu-a`.
pub const TABLE: &str = include_str!("../data/imu-a.toml");
/// The recording.
pub const RUN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run.csv");
/// The exact increments of the recording, computed with the table.
pub const RUN_EXPECTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/run.expected.csv");

/// A table of format 2, for `imu-g`: gyroscopes with g-sensitivity, both alignments, transient terms with a lag of 240
/// s.
pub const WHOLE_TABLE: &str = include_str!("../data/imu-g.toml");

/// Time limit of every wait. It is generous: it only bounds a failing test.
pub const TIMEOUT: Duration = Duration::from_secs(20);
/// Time limit of a test; the watchdog aborts it then. A machine that does other things makes a test several times
/// longer.
const WATCHDOG_TIMEOUT: Duration = Duration::from_secs(600);

/// The domain and the folder of one test. Dropping it ends its processes and removes its files and shared memory.
pub struct TestDomain {
    folder: TempDir,
    domain: Domain,
    /// Process ids to kill at the end.
    pids: Arc<Mutex<Vec<u32>>>,
    /// Dropping it stops the watchdog.
    _watchdog: mpsc::Sender<()>,
}

impl Default for TestDomain {
    fn default() -> Self {
        Self::new()
    }
}

impl TestDomain {
    /// A new domain in a new temporary folder.
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let folder = tempfile::Builder::new().prefix("iso-").tempdir().unwrap();
        let name = format!("t{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let domain = Domain::new(&name, &format!("{}/{name}", folder.path().display())).unwrap();
        let pids = Arc::<Mutex<Vec<u32>>>::default();
        let (watchdog, end_of_test) = mpsc::channel();
        let (pids_to_kill, prefix) = (Arc::clone(&pids), domain.prefix());
        thread::spawn(move || {
            if end_of_test.recv_timeout(WATCHDOG_TIMEOUT) == Err(RecvTimeoutError::Timeout) {
                eprintln!("watchdog: a test has hung for {} s", WATCHDOG_TIMEOUT.as_secs());
                pids_to_kill.lock().unwrap().iter().for_each(|pid| kill(*pid, Signal::KILL));
                remove_shared_memory(&prefix);
                std::process::abort();
            }
        });
        Self { folder, domain, pids, _watchdog: watchdog }
    }

    /// The domain as the client library names it.
    pub fn client_domain(&self) -> &Domain {
        &self.domain
    }

    /// A path in the test's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file into the test's folder.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }

    /// Writes a file under a temporary name and renames it over the old one, as most editors do.
    pub fn replace(&self, name: &str, text: &str) {
        fs::rename(self.write(&format!("{name}.new"), text), self.path(name)).unwrap();
    }

    /// Accepts a table for an IMU by its digest, as the command `reload` does.
    pub fn accept(&self, imu: &str, text: &str) {
        let table = CoefficientTable::from_toml(text, None).unwrap();
        Acceptance::write(&self.domain, &id(imu), &table.digest().to_string()).unwrap();
    }

    /// Whether an acceptance of the operator waits to be used up.
    pub fn is_accepted(&self, imu: &str) -> bool {
        !Acceptance::read_all(&self.domain, &id(imu)).is_empty()
    }

    /// Client options for this domain.
    pub fn options(&self) -> Options {
        Options::new(self.domain.clone(), TIMEOUT)
    }

    /// An acquisition in this process.
    pub fn acquisition(&self, imu: &str) -> Acquisition {
        Acquisition::connect(&id(imu), &self.options()).unwrap()
    }

    /// A connected reader in this process.
    pub fn reader(&self, imu: &str) -> IncrementReader {
        IncrementReader::connect(id(imu), &self.options()).unwrap()
    }

    /// A command that runs `isotherm` with these arguments in this domain and folder.
    pub fn isotherm(&self, arguments: &[&str]) -> Command {
        self.program("isotherm", arguments)
    }

    /// A command that runs a program of this build with these arguments in this domain and folder.
    pub fn program(&self, name: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(binary(name));
        command.args(arguments).stdin(Stdio::null()).current_dir(self.folder.path());
        command.env("ISOTHERM_DOMAIN", self.domain.name()).env("ISOTHERM_ROOT", self.folder.path());
        for variable in ["ISOTHERM_LOG", "ISOTHERM_STATE", "STATE_DIRECTORY"] {
            command.env_remove(variable);
        }
        command
    }

    /// Runs `isotherm` and waits for its end.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.finish(self.isotherm(arguments))
    }

    /// Runs a command and waits for its end.
    pub fn finish(&self, mut command: Command) -> Output {
        let child = spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
        let pid = child.id();
        self.pids.lock().unwrap().push(pid);
        let output = child.wait_with_output().unwrap();
        self.pids.lock().unwrap().retain(|other| *other != pid);
        output
    }

    /// Runs `isotherm`, asserts that it exits with 0, and returns its standard output.
    pub fn run_ok(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}\n{}", output.status, text(&output.stderr));
        text(&output.stdout)
    }

    /// Starts a service and waits until it is ready.
    pub fn serve(&self, arguments: &[&str]) -> Process {
        let service = self.spawn(&[&["serve"], arguments].concat());
        service.wait_for_log("ready");
        service
    }

    /// Starts a service for `imu-a` with the table of the recording.
    pub fn serve_recording(&self) -> Process {
        self.write("imu-a.toml", TABLE);
        self.serve(&["--imu", "imu-a=imu-a.toml"])
    }

    /// Starts a service for `imu-g` with [`WHOLE_TABLE`].
    pub fn serve_whole(&self) -> Process {
        self.write("imu-g.toml", WHOLE_TABLE);
        self.serve(&["--imu", "imu-g=imu-g.toml"])
    }

    /// Starts the exporter of metrics, and returns it with its address.
    pub fn export(&self) -> (Process, String) {
        let exporter = self.start(self.program("isotherm-exporter", &["--listen", "127.0.0.1:0"]));
        exporter.wait_for_log("metrics at http://");
        let log = exporter.log();
        let (_, rest) = log.split_once("metrics at http://").unwrap();
        let address = rest.split('/').next().unwrap().to_owned();
        (exporter, address)
    }

    /// Starts `isotherm` in the background.
    pub fn spawn(&self, arguments: &[&str]) -> Process {
        self.start(self.isotherm(arguments))
    }

    /// As [`isotherm`](Self::isotherm), but a shell runs the commands in `preparation` first. With options for
    /// `unshare`, the shell runs in new namespaces.
    pub fn isotherm_after(&self, unshare: &[&str], preparation: &str, arguments: &[&str]) -> Command {
        let plain = self.isotherm(arguments);
        let mut command = match unshare {
            [] => Command::new("sh"),
            options => {
                let mut command = Command::new("unshare");
                command.args(options).arg("sh");
                command
            }
        };
        command
            .args(["-c", &format!("{preparation} && exec \"$0\" \"$@\"")])
            .arg(plain.get_program())
            .args(plain.get_args());
        command.envs(plain.get_envs().filter_map(|(name, value)| Some((name, value?)))).env_remove("ISOTHERM_LOG");
        command.stdin(Stdio::null()).current_dir(self.folder.path());
        command
    }

    /// Starts a command in the background.
    pub fn start(&self, mut command: Command) -> Process {
        let mut child = spawn(command.stdout(Stdio::null()).stderr(Stdio::piped()));
        self.pids.lock().unwrap().push(child.id());
        let pids = Arc::clone(&self.pids);
        let log = Arc::<(Mutex<Vec<String>>, Condvar)>::default();
        let (sink, stderr) = (Arc::clone(&log), BufReader::new(child.stderr.take().unwrap()));
        let reader = thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                sink.0.lock().unwrap().push(line);
                sink.1.notify_all();
            }
        });
        Process { child, log, reader: Some(reader), pids }
    }

    /// Registers a process that was started elsewhere: it is killed when this is dropped, and by the watchdog.
    pub fn register_process(&self, pid: u32) {
        self.pids.lock().unwrap().push(pid);
    }

    /// The output of `isotherm status --json`.
    pub fn status(&self) -> Value {
        serde_json::from_str(&self.run_ok(&["status", "--json"])).unwrap()
    }

    /// The status of the only IMU, or of the first.
    pub fn imu_status(&self) -> Value {
        self.status()["imus"][0].clone()
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        let pids: Vec<_> = self.pids.lock().unwrap().drain(..).collect();
        pids.iter().for_each(|pid| kill(*pid, Signal::KILL));
        // A process that is still ending could write into the folder while it is removed: also one that a process of
        // the test has started.
        let deadline = Instant::now() + TIMEOUT;
        loop {
            let left = users_of(self.folder.path());
            if left.is_empty() || Instant::now() > deadline {
                break;
            }
            left.into_iter().for_each(|pid| kill(pid, Signal::KILL));
            thread::sleep(Duration::from_millis(1));
        }
        remove_shared_memory(&self.domain.prefix());
    }
}

/// A running `isotherm`.
pub struct Process {
    child: Child,
    log: Arc<(Mutex<Vec<String>>, Condvar)>,
    reader: Option<JoinHandle<()>>,
    pids: Arc<Mutex<Vec<u32>>>,
}

impl Process {
    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// All log lines so far.
    pub fn log(&self) -> String {
        self.log.0.lock().unwrap().join("\n")
    }

    /// The number of log lines so far that contain `text`.
    pub fn count_in_log(&self, text: &str) -> usize {
        self.log.0.lock().unwrap().iter().filter(|line| line.contains(text)).count()
    }

    /// Waits until a log line contains `text`.
    pub fn wait_for_log(&self, text: &str) {
        self.wait_for_log_lines(text, 1);
    }

    /// Waits until `count` log lines contain `text`.
    pub fn wait_for_log_lines(&self, text: &str, count: usize) {
        let (lines, line_added) = &*self.log;
        let too_few = |lines: &mut Vec<String>| lines.iter().filter(|line| line.contains(text)).count() < count;
        let (lines, waited) = line_added.wait_timeout_while(lines.lock().unwrap(), TIMEOUT, too_few).unwrap();
        assert!(!waited.timed_out(), "{count} x {text:?} did not appear in the log:\n{}", lines.join("\n"));
    }

    /// Whether it has ended.
    pub fn has_ended(&self) -> bool {
        fs::read_to_string(format!("/proc/{}/stat", self.pid()))
            .map_or(true, |stat| stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('Z')))
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        kill(self.child.id(), signal);
    }

    /// Sends SIGSTOP and waits until every thread has stopped.
    pub fn stop(&self) {
        self.signal(Signal::STOP);
        wait_until("the stop", || {
            let threads = fs::read_dir(format!("/proc/{}/task", self.pid())).unwrap();
            threads.flatten().all(|thread| {
                let stat = fs::read_to_string(thread.path().join("stat")).unwrap_or_default();
                stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('T'))
            })
        });
    }

    /// Sends SIGCONT.
    pub fn resume(&self) {
        self.signal(Signal::CONT);
    }

    /// Sends SIGKILL and waits for the end.
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Sends SIGTERM and asserts that the process exits with 0.
    pub fn terminate(self) {
        self.signal(Signal::TERM);
        let (status, log) = self.wait();
        assert!(status.success(), "{status}\n{log}");
    }

    /// Waits for the end. Returns the exit status and the whole log.
    pub fn wait(mut self) -> (ExitStatus, String) {
        let deadline = Instant::now() + TIMEOUT;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "it does not end:\n{}", self.log());
            thread::sleep(Duration::from_millis(2));
        };
        // The reader thread may not have read the last lines yet.
        self.reader.take().unwrap().join().unwrap();
        (status, self.log())
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Fails if the process has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking() {
            // The panic may be that of a wait for a line, which holds the log.
            let log = self.log.0.lock().unwrap_or_else(PoisonError::into_inner).join("\n");
            eprintln!("log of process {}:\n{log}", self.pid());
        }
        self.pids.lock().unwrap().retain(|pid| *pid != self.child.id());
    }
}

/// Sends a signal to a process by its id.
pub fn kill(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(pid.cast_signed()).unwrap();
    // Fails if the process has ended already.
    let _ = kill_process(pid, signal);
}

/// The processes that live and have a test's folder in their environment.
fn users_of(folder: &Path) -> Vec<u32> {
    let variable = format!("ISOTHERM_ROOT={}\0", folder.display());
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    // That of a process that has ended is empty.
    let environment = |pid: u32| fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    pids.filter(|pid| environment(*pid).windows(variable.len()).any(|part| part == variable.as_bytes())).collect()
}

fn remove_shared_memory(prefix: &str) {
    for entry in fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The path of a program of this build.
pub fn binary(name: &str) -> PathBuf {
    let test = env::current_exe().unwrap();
    let binary = test.parent().and_then(Path::parent).unwrap().join(name);
    assert!(binary.exists(), "{} is not built; run `cargo test --workspace`", binary.display());
    binary
}

/// Sends a request to an exporter of metrics, and returns everything that is received until the connection ends.
pub fn exchange(address: &str, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(TIMEOUT)).unwrap();
    let mut answer = Vec::new();
    // Ignore errors: a server that refuses a request before its end, or replaces this connection, resets it.
    let _ = stream.write_all(request).and_then(|()| stream.read_to_end(&mut answer));
    text(&answer)
}

/// The page of an exporter of metrics; `None` if it has none, or the connection ends within it.
pub fn metrics_page(address: &str) -> Option<String> {
    let answer = exchange(address, b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
    let (head, page) = answer.split_once("\r\n\r\n")?;
    let is_whole = head.contains(&format!("Content-Length: {}\r\n", page.len()));
    let is_page = head.starts_with("HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4");
    (is_page && is_whole).then(|| page.to_owned())
}

/// Starts a command. A program that a test has just written is busy while a process that another test has forked
/// meanwhile still has its file open: until that process executes its own program.
fn spawn(command: &mut Command) -> Child {
    static DEFAULT_IN_CHILDREN: Once = Once::new();
    // Under `nohup` SIGHUP is ignored, and programs inherit that. A handler they do not: for them it is the default
    // again.
    DEFAULT_IN_CHILDREN.call_once(|| {
        signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::default()).unwrap();
    });
    let mut child = None;
    wait_until("the start of a program that is not busy", || match command.spawn() {
        Err(error) if error.kind() == ErrorKind::ExecutableFileBusy => false,
        started => {
            child = Some(started.unwrap());
            true
        }
    });
    child.unwrap()
}

/// The id of an IMU.
pub fn id(name: &str) -> ImuId {
    name.parse().unwrap()
}

/// Why a test cannot run: what kind of thing is missing.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Needs {
    /// A program that can be installed. CI has it.
    Program,
    /// A permission or a property of the machine. CI cannot install it.
    Machine,
}

/// Whether all is tried of which the usual run tries a share: `ISOTHERM_NIGHTLY` is set, as `.ci/nightly` does.
pub fn is_nightly() -> bool {
    env::var_os("ISOTHERM_NIGHTLY").is_some()
}

/// Reports that the running test, or a part of it, is skipped, and why. The caller then returns.
///
/// With `ISOTHERM_TESTS_STRICT=1`, as in CI, a missing program fails the test. What the machine lacks is added to the
/// file that `ISOTHERM_TESTS_SKIPPED` names; CI prints that file at its end.
pub fn skip(why: &str, needs: Needs) {
    let name = thread::current().name().unwrap_or("?").to_owned();
    eprintln!("not tested: {why}");
    if env::var("ISOTHERM_TESTS_STRICT").as_deref() != Ok("1") {
        return;
    }
    assert!(needs == Needs::Machine, "{name} is not done: {why}; install it, or unset ISOTHERM_TESTS_STRICT");
    let list =
        env::var_os("ISOTHERM_TESTS_SKIPPED").expect("ISOTHERM_TESTS_STRICT needs ISOTHERM_TESTS_SKIPPED, a file");
    let mut list = fs::File::options().create(true).append(true).open(list).unwrap();
    writeln!(list, "{name}: {why}").unwrap();
}

/// Whether this user may mount file systems in a mount namespace. If not, the test is reported as skipped.
pub fn may_mount() -> bool {
    let tried = Command::new("unshare").args(["-m", "mount", "-t", "tmpfs", "tmpfs", "/dev/shm"]).output();
    let may = tried.is_ok_and(|output| output.status.success());
    if !may {
        skip("this user may not mount", Needs::Machine);
    }
    may
}

/// The id of the thread of a process that has this name.
pub fn thread_of(pid: u32, name: &str) -> i32 {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let mut named = tasks.filter(|task| fs::read_to_string(task.path().join("comm")).unwrap().trim() == name);
    named.next().unwrap().file_name().into_string().unwrap().parse().unwrap()
}

/// Bytes as text; invalid UTF-8 is replaced.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Parses a valid coefficient table.
pub fn table(text: &str) -> CoefficientTable {
    CoefficientTable::from_toml(text, None).unwrap()
}

/// The samples of the recording.
pub fn recording() -> Vec<RawSample> {
    RawCsvReader::new(fs::File::open(RUN).unwrap()).unwrap().map(Result::unwrap).collect()
}

/// Samples of a whole IMU that heats up and turns, 50 ms each. The temperature is measured in every 20th sample, and
/// `telemetry_ns` and all that an acquisition adds are 0.
pub fn whole_recording(count: usize) -> Vec<RawSample> {
    let mut state = 7_u32;
    let mut pulses = |limit: u32| {
        [(); 3].map(|()| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) % limit
        })
    };
    let triad = |index: usize, offset: f64, pulses: [[u32; 3]; 2]| {
        let temperature = 1.2 + offset + 0.004 * (index / 20) as f64;
        Triad {
            positive_pulses: pulses[0],
            negative_pulses: pulses[1],
            head_temperature: [temperature, temperature + 0.01, temperature + 0.02],
            board_temperature: [temperature - 0.01, temperature, temperature + 0.03],
            head_lagged: [0.0; 3],
        }
    };
    (0..count)
        .map(|index| RawSample {
            sequence: index as u64,
            timestamp_ns: 50_000_000 * (index as u64 + 1),
            interval_ns: 50_000_000,
            accelerometers: triad(index, 0.0, [pulses(5_000), pulses(100)]),
            gyroscopes: triad(index, 0.2, [pulses(40_000), pulses(2_000)]),
            ..RawSample::default()
        })
        .collect()
}

/// The samples as an acquisition sends them that follows their temperature with this time constant, for a unit of this
/// serial number.
pub fn completed(samples: &[RawSample], lag_ns: u64, serial: &str) -> Vec<RawSample> {
    let mut lag = Lag::new(lag_ns);
    let complete = |sample: &RawSample| {
        let mut raw = RawSample { device: device(serial), ..*sample };
        lag.follow(&raw);
        lag.fill(&mut raw);
        raw
    };
    samples.iter().map(complete).collect()
}

/// The table of the recording with another gravity. It has another digest and gives other increments.
pub fn variant(number: u32) -> String {
    TABLE.replace("9.8015", &format!("{:.4}", 9.8 + f64::from(number) * 1e-4))
}

/// Sends a sample with the acquisition's own session and sequence, and waits for its increment.
pub fn round_trip(acquisition: &mut Acquisition, sample: &RawSample) -> CompensatedIncrement {
    let mut loan = acquisition.loan().unwrap();
    *loan = RawSample { session: loan.session, sequence: loan.sequence, ..*sample };
    acquisition.compensate(loan, TIMEOUT).unwrap()
}

/// Whether two increments are equal bit by bit, apart from the delivery flags and the latency.
pub fn same(a: &CompensatedIncrement, b: &CompensatedIncrement) -> bool {
    let sample_flags = |increment: &CompensatedIncrement| increment.flags & Flags::SAMPLE.0;
    let bits = |increment: &CompensatedIncrement| {
        (increment.velocity_increment.map(f64::to_bits), increment.angle_increment.map(f64::to_bits))
    };
    (a.session, a.sequence, a.timestamp_ns, a.interval_ns) == (b.session, b.sequence, b.timestamp_ns, b.interval_ns)
        && (a.table, sample_flags(a), bits(a)) == (b.table, sample_flags(b), bits(b))
}

/// Waits until `condition` holds.
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + TIMEOUT;
    while !condition() {
        assert!(Instant::now() < deadline, "{what} did not happen");
        thread::sleep(Duration::from_micros(500));
    }
}
