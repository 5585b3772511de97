//! What the benches share: a domain of their own with the service in it as a child process, and pinning to cores.

use isotherm_client::{Domain, Options};
use rustix::process::{Pid, Signal, kill_process};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// The table that the service starts with.
pub const TABLE: &str = include_str!("../../examples/tables/imu-paper.toml");
/// The IMU that it is for.
pub const IMU: &str = "imu-paper";
/// No answer takes longer, or something is broken.
pub const PATIENCE: Duration = Duration::from_secs(5);

/// What a bench does, or why it cannot.
pub type Outcome<T> = Result<T, Box<dyn Error>>;

/// A domain and a folder of this bench's own, removed at its end.
pub struct World {
    folder: TempDir,
    domain: Domain,
    _cleaner: Cleaner,
}

impl World {
    /// A new one.
    ///
    /// # Errors
    /// If the temporary folder cannot be used.
    pub fn new() -> Outcome<Self> {
        let folder = tempfile::Builder::new().prefix("iso-").tempdir()?;
        let name = format!("bench-{}", std::process::id());
        let domain = Domain::new(&name, &format!("{}/{name}", folder.path().display()))?;
        let cleaner = Cleaner(domain.prefix());
        Ok(Self { folder, domain, _cleaner: cleaner })
    }

    /// The domain.
    pub const fn domain(&self) -> &Domain {
        &self.domain
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// How clients reach the domain.
    pub fn options(&self) -> Options {
        Options { domain: self.domain.clone(), timeout: PATIENCE }
    }

    /// Starts the service for [`IMU`] with `table.toml`, which is written first. The program must hand `serve` to
    /// `isotherm_service::main`.
    ///
    /// # Errors
    /// If files cannot be written or the process not started.
    pub fn serve(&self, strategy: &str, core: Option<usize>) -> Outcome<Partner> {
        let realtime = core.map(|core| format!("[realtime]\ncore = {core}\n")).unwrap_or_default();
        let imu = format!("[[imu]]\nid = \"{IMU}\"\ntable = \"table.toml\"\n");
        fs::write(self.path("table.toml"), TABLE)?;
        fs::write(self.path("service.toml"), format!("{imu}[wait]\nstrategy = \"{strategy}\"\n{realtime}"))?;
        self.spawn(&["serve", "--config", "service.toml"])
    }

    /// Starts this very program as another process of the domain.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn spawn(&self, words: &[&str]) -> Outcome<Partner> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(words).current_dir(self.folder.path());
        command.env("ISOTHERM_DOMAIN", self.domain.name()).env("ISOTHERM_ROOT", self.folder.path());
        Ok(Partner(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?))
    }
}

/// A child process that does not outlive the bench.
pub struct Partner(Child);

impl Partner {
    /// Sends a signal, for example to stop it while it is not measured.
    pub fn signal(&self, signal: Signal) {
        // Fails only if it has died, which the missing answers will tell.
        let _ = kill_process(Pid::from_child(&self.0), signal);
    }
}

impl Drop for Partner {
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

/// The cores that this process may use.
pub fn cores() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
    (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
}

/// Binds the calling thread to a core, if there is one to bind it to.
pub fn pin(core: Option<usize>) {
    if let Some(core) = core {
        let mut set = CpuSet::new();
        set.set(core);
        // Where it is not allowed the figures are only noisier.
        let _ = sched_setaffinity(None, &set);
    }
}
