//! The service under a stand-in for systemd, with kills and faults at its system calls: whatever happens to it, to its
//! disk or to its log, it feeds the watchdog, obeys signals, and serves again.
//!
//! `cargo test` tries a share of the cases, spread over all of them. All are tried by
//!
//! ```text
//! cargo test -p isotherm-tests --test all faults -- --ignored --nocapture
//! ```
//!
//! which prints the tables of docs/figures.md.

mod acceptances;
mod disks;
mod installs;
mod kills;
mod leftovers;
mod names;
mod supervisor;
mod tables;
mod tracer;

use isotherm_tests::{Needs, TABLE, TestDomain, skip, table};
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};
use std::thread;

/// Cases that are tried at the same time: most of them wait.
const AT_ONCE: usize = 4;

/// K+ of A1 has lost a digit.
fn lost_digit() -> String {
    TABLE.replace("91733.0", "9173.0")
}

fn digest(text: &str) -> String {
    table(text).digest().to_string()
}

/// Whether this process may trace another one. If not, the test is reported as skipped.
fn may_trace() -> bool {
    let mut child = Command::new("sleep").arg("60").spawn().unwrap();
    let pid = nix::unistd::Pid::from_raw(child.id().cast_signed());
    let may = nix::sys::ptrace::seize(pid, nix::sys::ptrace::Options::empty()).is_ok();
    child.kill().unwrap();
    child.wait().unwrap();
    if !may {
        skip("this user may not trace a process", Needs::Machine);
    }
    may
}

/// A domain in which a service has served the table before.
struct Ground {
    domain: TestDomain,
}

impl Ground {
    fn new() -> Self {
        /// What a service has kept, by the names of the files.
        static KEPT: OnceLock<Vec<(String, Vec<u8>)>> = OnceLock::new();
        let ground = Self { domain: TestDomain::new() };
        ground.domain.write("imu-a.toml", TABLE);
        ground.domain.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
        let kept = KEPT.get_or_init(|| {
            let first = Self::empty();
            first.domain.serve(&["--config", "service.toml"]).terminate();
            let files = fs::read_dir(first.state()).unwrap().flatten();
            files.map(|file| (file.file_name().into_string().unwrap(), fs::read(file.path()).unwrap())).collect()
        });
        fs::create_dir_all(ground.state()).unwrap();
        for folder in [ground.domain.path(".state"), ground.state()] {
            fs::set_permissions(folder, std::os::unix::fs::PermissionsExt::from_mode(0o700)).unwrap();
        }
        for (name, bytes) in kept {
            fs::write(ground.state().join(name), bytes).unwrap();
        }
        ground
    }

    fn empty() -> Self {
        let ground = Self { domain: TestDomain::new() };
        ground.domain.write("imu-a.toml", TABLE);
        ground.domain.write("service.toml", "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n");
        ground
    }

    /// The state folder of the domain.
    fn state(&self) -> PathBuf {
        self.domain.path(".state").join(self.domain.client_domain().name())
    }

    fn serve(&self, supervisor: &supervisor::Supervisor) -> Command {
        let mut command = self.domain.program("isothermd", &["serve", "--config", "service.toml"]);
        command.envs(supervisor.environment());
        command
    }

    /// A note in the folder of the domain.
    fn note(&self, name: &str) -> PathBuf {
        let domain = self.domain.client_domain();
        PathBuf::from(domain.root_path()).join(format!("{}{name}", domain.prefix()))
    }

    /// The digest that is noted as kept.
    fn kept(&self) -> String {
        fs::read_to_string(self.note("kept-imu-a")).unwrap_or_default()
    }

    /// Whether the service is in the first second of its life. The start after a death in it clears the domain.
    fn is_in_its_first_second(&self) -> bool {
        self.note("starting").exists()
    }
}

/// Tries all cases, some at the same time, and gives the results in their order.
fn try_all<C: Sync, R: Send>(cases: &[C], attempt: impl Fn(&C) -> R + Sync) -> Vec<R> {
    let (next, results) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let index = cases.iter().position(|other| std::ptr::eq(other, case)).unwrap();
                    let result = attempt(case);
                    results.lock().unwrap().push((index, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap();
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}
