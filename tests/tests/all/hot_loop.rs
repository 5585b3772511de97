//! While samples flow, worker and client do not allocate and, with the spin strategy, make no system calls. The tests
//! measure this with a counting allocator and with ptrace.

use isotherm_tests::{Needs, TIMEOUT, TestDomain, WHOLE_TABLE, skip, thread_of, wait_until};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use std::io::{BufRead as _, BufReader, Lines, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Waiting strategies.
const STRATEGIES: [&str; 3] = ["spin", "anticipate", "block"];

/// A running `counted` in the test's domain, with its input and output.
struct Counted {
    child: Child,
    input: ChildStdin,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Counted {
    fn start(domain: &TestDomain, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_counted"));
        command.args(arguments).current_dir(domain.path(""));
        command.env("ISOTHERM_DOMAIN", domain.client_domain().name()).env("ISOTHERM_ROOT", domain.path(""));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        domain.register_process(child.id());
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        Self { child, input, lines: BufReader::new(output).lines() }
    }

    /// Sends a line to its input.
    fn send_line(&mut self) {
        writeln!(self.input).unwrap();
    }

    /// Waits for the next number that it prints.
    fn number(&mut self) -> u64 {
        self.lines.next().unwrap().unwrap().parse().unwrap()
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The tests of this file run one after the other: two tests have four spinning threads, too many for two cores.
fn exclusive() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn configure(domain: &TestDomain, strategy: &str) {
    // With gyroscopes, transient terms and a lag: everything that the kernel can have to do.
    domain.write("imu-a.toml", &WHOLE_TABLE.replace("\"imu-g\"", "\"imu-a\""));
    let imu = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    domain.write("service.toml", &format!("{imu}[wait]\nstrategy = \"{strategy}\"\n"));
}

#[test]
fn neither_side_allocates_for_a_sample() {
    let _exclusive = exclusive();
    for strategy in STRATEGIES {
        let domain = TestDomain::new();
        configure(&domain, strategy);
        let mut service = Counted::start(&domain, &["serve", "--config", "service.toml"]);
        let mut client = Counted::start(&domain, &["send", "imu-a", "20000"]);
        client.number();
        let mut workers = || {
            service.send_line();
            service.number()
        };
        let before = workers();
        assert!(before > 0, "nothing is counted");
        client.send_line();
        assert_eq!(client.number(), 0, "allocations of the client, {strategy}");
        assert_eq!(workers() - before, 0, "allocations of the worker, {strategy}");
    }
}

#[test]
fn spinning_makes_no_system_call_on_either_side() {
    let source = fs::read_to_string("/sys/devices/system/clocksource/clocksource0/current_clocksource");
    if !source.as_ref().is_ok_and(|name| ["tsc", "kvm-clock", "arch_sys_counter"].contains(&name.trim())) {
        skip(&format!("on this machine reading the clock is a system call ({source:?})"), Needs::Machine);
        return;
    }
    let _exclusive = exclusive();
    for (strategy, without_calls) in [("spin", true), ("block", false)] {
        let domain = TestDomain::new();
        configure(&domain, strategy);
        let service = domain.serve(&["--config", "service.toml"]);
        // More samples than it can send during the test.
        let mut client = Counted::start(&domain, &["send", "imu-a", "1000000000000"]);
        client.send_line();
        let received = || domain.imu_status()["received"].as_u64().unwrap();
        // So few because both sides may spin on the same core for a while, and then a sample takes several time slices.
        wait_until("samples", || received() > 500);
        let worker = Pid::from_raw(thread_of(service.pid(), "worker-0"));
        let main = Pid::from_raw(client.child.id().cast_signed());
        for thread in [worker, main] {
            let (mut calls, before) = (0, received());
            // Trace until enough samples have arrived, however long this takes on a loaded machine.
            let samples = loop {
                let mut since = None;
                let is_over = || since.get_or_insert_with(Instant::now).elapsed() > Duration::from_millis(500);
                let Some(more) = system_calls(thread, is_over) else {
                    skip("this user may not trace a process", Needs::Machine);
                    return;
                };
                calls += more.len();
                let samples = received() - before;
                if samples > 1_000 {
                    break samples;
                }
            };
            if without_calls {
                assert_eq!(calls, 0, "in {samples} samples");
            } else if thread == worker {
                // Check of the method: a blocking worker makes system calls, while it is traced for every sample.
                assert!(calls > 10, "{calls} calls in {samples} samples");
            }
        }
    }
}

/// The numbers of a thread's system calls until something is so; `None` if it may not be traced.
pub(crate) fn system_calls(thread: Pid, mut is_over: impl FnMut() -> bool) -> Option<Vec<i64>> {
    ptrace::seize(thread, ptrace::Options::PTRACE_O_TRACESYSGOOD).ok()?;
    // Only a stopped thread can be made to stop at every system call.
    ptrace::interrupt(thread).unwrap();
    let (started, mut calls) = (Instant::now(), vec![]);
    let (mut is_tracing, mut is_entry, mut detaching) = (false, false, false);
    loop {
        match waitpid(thread, Some(WaitPidFlag::WNOHANG | WaitPidFlag::__WALL)).unwrap() {
            WaitStatus::StillAlive => {
                assert!(started.elapsed() < 2 * TIMEOUT, "what the traced thread should do does not happen");
                if is_tracing && !detaching && is_over() {
                    detaching = true;
                    ptrace::interrupt(thread).unwrap();
                }
                thread::sleep(Duration::from_micros(200));
            }
            // The thread can be detached at any stop.
            WaitStatus::PtraceSyscall(_) | WaitStatus::PtraceEvent(..) | WaitStatus::Stopped(..) if detaching => {
                ptrace::detach(thread, None).unwrap();
                return Some(calls);
            }
            WaitStatus::PtraceSyscall(_) => {
                // Each call stops the thread twice: on entry and on exit.
                is_entry = !is_entry;
                if is_entry {
                    let call = fs::read_to_string(format!("/proc/{thread}/syscall")).unwrap();
                    calls.push(call.split(' ').next().unwrap().parse().unwrap());
                }
                ptrace::syscall(thread, None).unwrap();
            }
            WaitStatus::PtraceEvent(..) | WaitStatus::Stopped(..) => {
                // From here on it stops at every call.
                is_tracing = true;
                ptrace::syscall(thread, None).unwrap();
            }
            other => panic!("{other:?}"),
        }
    }
}
