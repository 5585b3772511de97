//! Runs a program, looks at its system calls, and kills it, delays it or lets a call fail at any of them.
//!
//! The thread that starts the program traces it. It waits only for what it traces, so other tests keep their children.

use isotherm_tests::TIMEOUT;
use nix::errno::Errno;
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A system call that a thread is about to make.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct Call {
    /// Its name, without `at`.
    pub(super) name: &'static str,
    /// The file, folder, socket or object that it is about; of a rename the new name.
    pub(super) path: String,
    /// Whether it creates, changes or removes something.
    pub(super) changes: bool,
}

/// What becomes of a call.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Fate {
    Happens,
    /// The process is killed before the call.
    Kills,
    /// The call happens later.
    Waits(Duration),
    Fails(Errno),
}

/// How a traced process ended.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum End {
    Exited(i32),
    Killed(Signal),
}

/// How long a traced program may take for what another one does within [`TIMEOUT`]. Each of its thousands of system
/// calls changes from it to the tracer and back twice, and on a loaded machine each change waits for its turn.
pub(super) const TRACED_TIMEOUT: Duration = Duration::from_secs(4 * TIMEOUT.as_secs());

type Decide = Box<dyn FnMut(&Call) -> Fate + Send>;

/// A traced process.
pub(super) struct Traced {
    pub(super) pid: u32,
    log: Arc<(Mutex<Vec<String>>, Condvar)>,
    end: Receiver<End>,
    thread: Option<JoinHandle<()>>,
}

impl Traced {
    /// Starts a command; `decide` is asked about each call of each of its threads.
    pub(super) fn start(command: Command, decide: impl FnMut(&Call) -> Fate + Send + 'static) -> Self {
        let (started, pid) = mpsc::channel();
        let (ended, end) = mpsc::channel();
        let log = Arc::<(Mutex<Vec<String>>, Condvar)>::default();
        let sink = Arc::clone(&log);
        let thread = thread::spawn(move || {
            let (leader, stderr) = spawn(command);
            let lines = BufReader::new(stderr).lines().map_while(Result::ok);
            let reader = thread::spawn(move || {
                for line in lines {
                    sink.0.lock().unwrap().push(line);
                    sink.1.notify_all();
                }
            });
            started.send(leader.as_raw().cast_unsigned()).unwrap();
            let end = Tracer { leader, decide: Box::new(decide), threads: BTreeMap::new() }.run();
            reader.join().unwrap();
            let _ = ended.send(end);
        });
        Self { pid: pid.recv().unwrap(), log, end, thread: Some(thread) }
    }

    pub(super) fn log(&self) -> String {
        self.log.0.lock().unwrap().join("\n")
    }

    /// Waits until a log line contains `text`, at most for `limit`. Returns whether one does.
    pub(super) fn has_logged(&self, text: &str, limit: Duration) -> bool {
        let missing = |lines: &mut Vec<String>| !lines.iter().any(|line| line.contains(text));
        let (lines, _) = self.log.1.wait_timeout_while(self.log.0.lock().unwrap(), limit, missing).unwrap();
        lines.iter().any(|line| line.contains(text))
    }

    pub(super) fn signal(&self, signal: Signal) {
        let _ = kill(Pid::from_raw(self.pid.cast_signed()), signal);
    }

    /// How it has ended; `None` if it does not end in this time.
    pub(super) fn end(&mut self, limit: Duration) -> Option<End> {
        let end = self.end.recv_timeout(limit).ok()?;
        self.thread.take().map(JoinHandle::join).transpose().unwrap();
        Some(end)
    }
}

impl Drop for Traced {
    fn drop(&mut self) {
        self.signal(Signal::SIGKILL);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Starts the command stopped, and seizes it.
#[allow(clippy::zombie_processes, reason = "the tracer waits for it")]
fn spawn(command: Command) -> (Pid, impl std::io::Read + Send + 'static) {
    let mut shell = Command::new("sh");
    shell.args(["-c", "kill -STOP $$ && exec \"$0\" \"$@\""]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => shell.env(name, value),
            None => shell.env_remove(name),
        };
    }
    if let Some(folder) = command.get_current_dir() {
        shell.current_dir(folder);
    }
    let mut child = shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let (pid, stderr) = (Pid::from_raw(child.id().cast_signed()), child.stderr.take().unwrap());
    let stopped = waitpid(pid, Some(WaitPidFlag::WUNTRACED)).unwrap();
    assert_eq!(stopped, WaitStatus::Stopped(pid, Signal::SIGSTOP));
    let options = Options::PTRACE_O_TRACESYSGOOD
        | Options::PTRACE_O_TRACECLONE
        | Options::PTRACE_O_TRACEEXEC
        | Options::PTRACE_O_EXITKILL;
    ptrace::seize(pid, options).unwrap();
    kill(pid, Signal::SIGCONT).unwrap();
    (pid, stderr)
}

struct Tracer {
    leader: Pid,
    decide: Decide,
    threads: BTreeMap<i32, Thread>,
}

#[derive(Default)]
struct Thread {
    /// The call that is under way fails with this error.
    fails: Option<Errno>,
    /// It is held until then.
    until: Option<Instant>,
}

impl Tracer {
    fn run(mut self) -> End {
        let flags = WaitPidFlag::__WALL | WaitPidFlag::__WNOTHREAD | WaitPidFlag::WNOHANG;
        let mut has_begun = false;
        let mut idle = 0_u32;
        loop {
            self.release();
            match waitpid(None, Some(flags)) {
                Ok(WaitStatus::StillAlive) => {
                    idle += 1;
                    // Spinning keeps the traced program fast; a program that waits must not cost a core.
                    if idle > 200 {
                        thread::sleep(Duration::from_micros(300));
                    } else {
                        thread::yield_now();
                    }
                    continue;
                }
                Ok(WaitStatus::Exited(pid, code)) if pid == self.leader => return End::Exited(code),
                Ok(WaitStatus::Signaled(pid, signal, _)) if pid == self.leader => return End::Killed(signal),
                Ok(WaitStatus::PtraceSyscall(pid)) if has_begun => self.stopped(pid),
                Ok(WaitStatus::PtraceEvent(pid, signal, event)) => {
                    has_begun |= event == libc::PTRACE_EVENT_EXEC;
                    // A stop of the whole group, which SIGCONT ends.
                    let is_stop = event == libc::PTRACE_EVENT_STOP && signal != Signal::SIGTRAP;
                    let _ = if is_stop { ptrace::cont(pid, None) } else { ptrace::syscall(pid, None) };
                }
                Ok(WaitStatus::Stopped(pid, signal)) => drop(ptrace::syscall(pid, signal)),
                Ok(status) => drop(status.pid().map(|pid| ptrace::syscall(pid, None))),
                Err(Errno::ECHILD) => return End::Killed(Signal::SIGKILL),
                Err(_) => {}
            }
            idle = 0;
        }
    }

    /// Lets the threads go on whose time has come.
    fn release(&mut self) {
        let now = Instant::now();
        for (tid, thread) in &mut self.threads {
            if thread.until.is_some_and(|until| until <= now) {
                thread.until = None;
                let _ = ptrace::syscall(Pid::from_raw(*tid), None);
            }
        }
    }

    /// A thread begins or ends a call.
    fn stopped(&mut self, tid: Pid) {
        let Ok(mut registers) = ptrace::getregs(tid) else { return };
        let thread = self.threads.entry(tid.as_raw()).or_default();
        // A call that is left out ends as it begins: as one that the kernel does not have.
        let begins = thread.fails.is_none() && registers.rax == (-i64::from(libc::ENOSYS)).cast_unsigned();
        if !begins {
            if let Some(errno) = thread.fails.take() {
                registers.rax = (-i64::from(errno as i32)).cast_unsigned();
                let _ = ptrace::setregs(tid, registers);
            }
            let _ = ptrace::syscall(tid, None);
            return;
        }
        let call = describe(tid, &registers);
        match call.map_or(Fate::Happens, |call| (self.decide)(&call)) {
            Fate::Happens => drop(ptrace::syscall(tid, None)),
            Fate::Kills => drop(kill(self.leader, Signal::SIGKILL)),
            Fate::Waits(time) => thread.until = Some(Instant::now() + time),
            Fate::Fails(errno) => {
                registers.orig_rax = u64::MAX;
                thread.fails = Some(errno);
                let _ = ptrace::setregs(tid, registers);
                let _ = ptrace::syscall(tid, None);
            }
        }
    }
}

/// What a call is about, if it is about a file.
fn describe(tid: Pid, registers: &libc::user_regs_struct) -> Option<Call> {
    use libc as c;
    let arguments = [registers.rdi, registers.rsi, registers.rdx, registers.r10, registers.r8];
    let text = |address: usize| Arguments { tid, arguments }.path(address, None);
    let text_at = |folder: usize, address: usize| Arguments { tid, arguments }.path(address, Some(folder));
    let file = |argument: usize| descriptor(tid, arguments[argument] as i32);
    let call =
        |name, path: Option<PathBuf>, changes| Some(Call { name, path: path?.to_string_lossy().into_owned(), changes });
    let writes = |flags: u64| flags as i32 & (c::O_WRONLY | c::O_RDWR | c::O_CREAT) != 0;
    match registers.orig_rax as i64 {
        c::SYS_open => call("open", text(0), writes(arguments[1])),
        c::SYS_openat => call("open", text_at(0, 1), writes(arguments[2])),
        c::SYS_stat | c::SYS_lstat => call("stat", text(0), false),
        c::SYS_newfstatat | c::SYS_statx => call("stat", text_at(0, 1), false),
        c::SYS_write => call("write", file(0), true),
        c::SYS_fsync | c::SYS_fdatasync => call("fsync", file(0), true),
        c::SYS_ftruncate => call("ftruncate", file(0), true),
        c::SYS_fallocate => call("fallocate", file(0), true),
        c::SYS_rename => call("rename", text(1), true),
        c::SYS_renameat | c::SYS_renameat2 => call("rename", text_at(2, 3), true),
        c::SYS_link => call("link", text(1), true),
        c::SYS_linkat => call("link", text_at(2, 3), true),
        c::SYS_unlink | c::SYS_rmdir => call("unlink", text(0), true),
        c::SYS_unlinkat => call("unlink", text_at(0, 1), true),
        c::SYS_mkdir => call("mkdir", text(0), true),
        c::SYS_mkdirat => call("mkdir", text_at(0, 1), true),
        c::SYS_chmod => call("chmod", text(0), true),
        c::SYS_fchmodat => call("chmod", text_at(0, 1), true),
        c::SYS_fchmod => call("chmod", file(0), true),
        c::SYS_bind => call("bind", Some(PathBuf::from("socket")), true),
        c::SYS_mmap if arguments[3] as i32 & c::MAP_SHARED != 0 => call("mmap", file(4), true),
        _ => None,
    }
    .filter(|call| call.path.starts_with('/') || call.name == "bind" || call.name == "write")
}

struct Arguments {
    tid: Pid,
    arguments: [u64; 5],
}

impl Arguments {
    /// The path in the argument with this number, in the folder that another argument names.
    fn path(&self, address: usize, folder: Option<usize>) -> Option<PathBuf> {
        let memory = File::open(format!("/proc/{}/mem", self.tid)).ok()?;
        let mut bytes = [0; 512];
        let address = self.arguments[address];
        // A page may end behind the path.
        let read = memory.read_at(&mut bytes, address).or_else(|_| {
            let to_the_page_end = 4096 - (address % 4096) as usize;
            memory.read_at(&mut bytes[..to_the_page_end.min(512)], address)
        });
        let text = bytes.get(..read.ok()?)?.split(|byte| *byte == 0).next()?;
        let path = PathBuf::from(String::from_utf8_lossy(text).into_owned());
        if path.is_absolute() {
            return Some(path);
        }
        let folder = match folder.map(|folder| self.arguments[folder] as i32) {
            Some(folder) if folder != libc::AT_FDCWD => descriptor(self.tid, folder)?,
            _ => fs::read_link(format!("/proc/{}/cwd", self.tid)).ok()?,
        };
        Some(if path == Path::new("") { folder } else { folder.join(path) })
    }
}

/// What a descriptor leads to.
fn descriptor(tid: Pid, descriptor: i32) -> Option<PathBuf> {
    fs::read_link(format!("/proc/{tid}/fd/{descriptor}")).ok()
}
