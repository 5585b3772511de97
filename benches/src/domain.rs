//! A domain of a bench's own, its processes, and their removal, even if the bench is killed.

use crate::child::{BenchResult, GUARDIAN, child_of};
use crate::machine::shared_memory;
use crate::sample::{IMU, TABLE, TIMEOUT};
use isotherm_client::{Acquisition, Domain, Options, fetch_status};
use rustix::process::{Pid, Signal, kill_process};
use std::fs::{self, File};
use std::io::Write as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tempfile::TempDir;

/// The file in a domain's folder that its processes log to.
const LOG: &str = "log";
/// The file in a domain's folder for the standard output of its processes.
const OUTPUT: &str = "output";

/// The service as every domain runs it.
const SERVE: [&str; 3] = ["serve", "--config", "service.toml"];
/// Time in which the operating system ends killed processes.
const ENDING: Duration = Duration::from_millis(100);
/// The guardian gives up on processes that do not end.
const MAX_LOOKS: u32 = 100;

/// A domain and a folder of this bench's own. Dropping it removes them; its processes must have ended. If the bench is
/// killed, its guardian does both.
pub struct BenchDomain {
    folder: TempDir,
    domain: Domain,
}

impl BenchDomain {
    /// Makes a domain in a new temporary folder.
    ///
    /// # Errors
    /// If the temporary folder cannot be used.
    pub fn new() -> BenchResult<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("bench-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let moment = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos() as u32;
        let (parent, folder) = (std::env::temp_dir(), format!("iso-{moment:08x}"));
        let path = parent.join(&folder);
        let domain = Domain::new(&name, &format!("{}/{name}", path.display()))?;
        // Before the folder is made: a bench can be killed between any two steps.
        tell_guardian(&domain.prefix(), &path)?;
        let folder = tempfile::Builder::new().prefix(&folder).rand_bytes(0).tempdir_in(parent)?;
        Ok(Self { folder, domain })
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

    /// Connects an acquisition of this IMU.
    ///
    /// # Errors
    /// If the service does not come.
    pub fn acquisition(&self, imu: &str) -> BenchResult<Acquisition> {
        Ok(Acquisition::connect(&imu.parse()?, &self.options())?)
    }

    /// Writes a file under another name, and renames it over the file `name`. Returns the moment of the rename.
    ///
    /// # Errors
    /// If that is not possible.
    pub fn replace(&self, name: &str, text: &str) -> BenchResult<Instant> {
        let (next, path) = (self.path("next.new"), self.path(name));
        fs::write(&next, text)?;
        let renamed = Instant::now();
        fs::rename(next, path)?;
        Ok(renamed)
    }

    /// Writes `table.toml` and `service.toml` for [`IMU`]. `settings` is appended to the configuration; keys of the IMU
    /// must come first in it.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn configure(&self, settings: &str) -> BenchResult<()> {
        fs::write(self.path("table.toml"), TABLE)?;
        let service = format!("[[imu]]\nid = \"{IMU}\"\ntable = \"table.toml\"\n{settings}");
        Ok(fs::write(self.path("service.toml"), service)?)
    }

    /// Starts the service for [`IMU`], as [`configure`](Self::configure) does: this program, or another one that has
    /// the command `serve`.
    ///
    /// # Errors
    /// If files cannot be written or the process not started.
    pub fn serve(&self, program: Option<&Path>, settings: &str) -> BenchResult<BenchProcess> {
        self.configure(settings)?;
        program.map_or_else(|| self.serve_again(), |program| self.spawn_program(program, &SERVE))
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
        self.serve_again()
    }

    /// Starts the service with the configuration that it had.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn serve_again(&self) -> BenchResult<BenchProcess> {
        self.spawn(&SERVE)
    }

    /// Compiles a C program of this crate with `cc` against the shared library in the folder `libraries`. Returns its
    /// path.
    ///
    /// # Errors
    /// If there is no library, or `cc` cannot compile it.
    pub fn compiled(&self, source: &str, libraries: &Path) -> BenchResult<PathBuf> {
        const FOLDER: &str = env!("CARGO_MANIFEST_DIR");
        let (program, libraries) = (self.path("acquisition"), std::path::absolute(libraries)?);
        let folder = libraries.display();
        if !libraries.join("libisotherm_client.so.0").exists() {
            return Err(format!("{folder} has no libisotherm_client.so; `cargo build [--release]` makes it").into());
        }
        let mut compiler = self.command(Path::new("cc"));
        compiler.args(["-std=c11", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        compiler.arg(format!("-I{FOLDER}/../client/include")).arg(format!("{FOLDER}/src/{source}"));
        compiler.arg(format!("-L{folder}")).arg(format!("-Wl,-rpath,{folder}")).arg("-lisotherm_client");
        let status = compiler.arg("-o").arg(&program).status()?;
        if status.success() { Ok(program) } else { Err(format!("cc cannot compile {source}").into()) }
    }

    /// Starts this program as another process of the domain.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn spawn(&self, words: &[&str]) -> BenchResult<BenchProcess> {
        self.spawn_program(&std::env::current_exe()?, words)
    }

    /// Starts a program as another process of the domain. Its output is appended to files of the folder.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn spawn_program(&self, program: &Path, words: &[&str]) -> BenchResult<BenchProcess> {
        let file = |name| File::options().append(true).create(true).open(self.path(name));
        let mut command = self.command(program);
        command.args(words).stdin(Stdio::null()).stdout(file(OUTPUT)?).stderr(file(LOG)?);
        Ok(BenchProcess(command.spawn()?))
    }

    /// A command that belongs to the domain, in its folder: there the guardian finds its process.
    pub fn command(&self, program: &Path) -> Command {
        let (mut command, folder) = (child_of(program), self.folder.path());
        command.current_dir(folder).env("ISOTHERM_DOMAIN", self.domain.name()).env("ISOTHERM_ROOT", folder);
        command
    }

    /// All that processes of the domain have logged.
    pub fn whole_log(&self) -> String {
        fs::read_to_string(self.path(LOG)).unwrap_or_default()
    }

    /// Forgets what has been logged.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn clear_log(&self) -> BenchResult<()> {
        Ok(fs::write(self.path(LOG), "")?)
    }

    /// An error with the last lines that processes of the domain have logged.
    pub fn failure(&self, text: &str) -> Box<dyn std::error::Error> {
        let log = self.whole_log();
        let lines: Vec<_> = log.lines().collect();
        format!("{text}:\n{}", lines[lines.len().saturating_sub(20)..].join("\n")).into()
    }

    /// Waits until `condition` holds; `pause` lies between two looks. `what` names in the error what did not happen.
    ///
    /// # Errors
    /// That of `condition`, or after `timeout`.
    pub fn wait_until(
        &self,
        what: &str,
        [timeout, pause]: [Duration; 2],
        condition: impl Fn() -> BenchResult<bool>,
    ) -> BenchResult<()> {
        let begun = Instant::now();
        while !condition()? {
            if begun.elapsed() > timeout {
                return Err(self.failure(what));
            }
            sleep(pause);
        }
        Ok(())
    }
}

impl Drop for BenchDomain {
    fn drop(&mut self) {
        remove_shared_memory(&self.domain.prefix());
    }
}

/// Settings of a service that waits by `strategy`, with its worker on `core`.
pub fn served_by(strategy: &str, core: Option<usize>) -> String {
    let realtime = core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
    format!("[wait]\nstrategy = \"{strategy}\"\n{realtime}")
}

/// The name of IMU number `index`.
pub fn imu(index: usize) -> String {
    format!("imu-{index}")
}

fn remove_shared_memory(prefix: &str) {
    // An object that is not there any more need not be removed.
    shared_memory(prefix).for_each(|entry| drop(fs::remove_file(entry.path())));
}

/// Informs the guardian of a new domain; the first call starts it. Its input ends with this process, however that ends.
fn tell_guardian(prefix: &str, folder: &Path) -> BenchResult<()> {
    static INPUT: Mutex<Option<ChildStdin>> = Mutex::new(None);
    let mut input = INPUT.lock().map_err(|_| "a thread that informed the guardian has panicked")?;
    if input.is_none() {
        // In a group of its own, because who kills a bench often kills its group.
        let mut command = child_of(&std::env::current_exe()?);
        command.arg(GUARDIAN).process_group(0).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        *input = command.spawn()?.stdin;
    }
    // In one write, so that the guardian never reads half a path.
    let line = format!("{prefix} {}\n", folder.display());
    Ok(input.iter_mut().try_for_each(|input| input.write_all(line.as_bytes()))?)
}

/// The guardian: when its bench has ended, ends the processes and removes the domains that it has left.
pub(crate) fn guard() -> BenchResult<ExitCode> {
    let domains = std::io::stdin().lines().collect::<Result<Vec<_>, _>>()?;
    let domains = domains.iter().filter_map(|line| line.split_once(' '));
    let left: Vec<_> =
        domains.map(|(prefix, folder)| (prefix, Path::new(folder))).filter(|(_, it)| it.exists()).collect();
    // A process that the bench has just started may not be in its folder yet, and one that is killed may have started
    // another: the guardian looks until it finds none twice.
    let (mut looks, mut quiet) = (0, if left.is_empty() { 2 } else { 0 });
    while quiet < 2 && looks < MAX_LOOKS {
        (looks, quiet) = (looks + 1, if end_processes(&left)? { 0 } else { quiet + 1 });
        sleep(ENDING);
    }
    for (prefix, folder) in left {
        remove_shared_memory(prefix);
        // What cannot be removed must not keep the others.
        let _ = fs::remove_dir_all(folder);
    }
    Ok(ExitCode::SUCCESS)
}

/// Kills the processes in the folders of these domains. Returns whether there were any.
fn end_processes(left: &[(&str, &Path)]) -> BenchResult<bool> {
    let mut found = false;
    for process in fs::read_dir("/proc")?.flatten() {
        let here = fs::read_link(process.path().join("cwd"))
            .is_ok_and(|cwd| left.iter().any(|(_, folder)| cwd.starts_with(folder)));
        if let Some(pid) =
            process.file_name().to_str().and_then(|pid| pid.parse().ok()).and_then(Pid::from_raw).filter(|_| here)
        {
            found = true;
            // Fails if it has ended meanwhile.
            let _ = kill_process(pid, Signal::KILL);
        }
    }
    Ok(found)
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
            sleep(Duration::from_millis(5));
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
