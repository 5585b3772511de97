//! What the hot loop and the client do not do while samples flow: allocate, and, when spinning, call the system. Seen from outside.
#![allow(clippy::panic, clippy::print_stderr, clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_tests::{Needs, PATIENCE, TABLE, World, skip, thread_of, wait_until};
use nix::sys::ptrace;
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use std::fs;
use std::io::{BufRead as _, BufReader, Lines, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Waiting strategies.
const STRATEGIES: [&str; 3] = ["spin", "anticipate", "block"];

/// `counted` in a world, and the lines that it prints.
struct Counted {
    child: Child,
    input: ChildStdin,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Counted {
    fn start(world: &World, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_counted"));
        command.args(arguments).current_dir(world.path(""));
        command.env("ISOTHERM_DOMAIN", world.domain().name()).env("ISOTHERM_ROOT", world.path(""));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        world.watch(child.id());
        let (input, output) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        Self { child, input, lines: BufReader::new(output).lines() }
    }

    /// Gives it a line.
    fn go_on(&mut self) {
        writeln!(self.input).unwrap();
    }

    /// The next number that it prints.
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

/// Four threads that spin at once get in each other's way on two cores.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn configure(world: &World, strategy: &str) {
    world.write("imu-a.toml", TABLE);
    let imu = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\n";
    world.write("service.toml", &format!("{imu}[wait]\nstrategy = \"{strategy}\"\n"));
}

#[test]
fn neither_side_allocates_for_a_sample() {
    let _alone = alone();
    for strategy in STRATEGIES {
        let world = World::new();
        configure(&world, strategy);
        let mut service = Counted::start(&world, &["serve", "--config", "service.toml"]);
        let mut client = Counted::start(&world, &["send", "imu-a", "20000"]);
        client.number();
        let mut workers = || {
            service.go_on();
            service.number()
        };
        let before = workers();
        assert!(before > 0, "nothing is counted");
        client.go_on();
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
    let _alone = alone();
    for (strategy, none) in [("spin", true), ("block", false)] {
        let world = World::new();
        configure(&world, strategy);
        let service = world.serve(&["--config", "service.toml"]);
        // More than it can send while it is watched.
        let mut client = Counted::start(&world, &["send", "imu-a", "1000000000000"]);
        client.go_on();
        let received = || world.imu_status()["received"].as_u64().unwrap();
        wait_until("samples", || received() > 5_000);
        let worker = Pid::from_raw(thread_of(service.pid(), "worker-0"));
        let main = Pid::from_raw(client.child.id().cast_signed());
        for thread in [worker, main] {
            let (mut calls, before) = (0, received());
            // Watched until enough has come, however little a machine that is busy with other things lets through.
            let samples = loop {
                let Some(more) = system_calls(thread, Duration::from_millis(500)) else {
                    skip("this user may not trace a process", Needs::Machine);
                    return;
                };
                calls += more;
                let samples = received() - before;
                if samples > 1_000 {
                    break samples;
                }
            };
            if none {
                assert_eq!(calls, 0, "in {samples} samples");
            } else if thread == worker {
                // The counting counts: a worker that sleeps calls the system, while it is watched for every sample.
                assert!(calls > 10, "{calls} calls in {samples} samples");
            }
        }
    }
}

/// System calls of a thread within a time; `None` if it may not be traced.
fn system_calls(thread: Pid, time: Duration) -> Option<u64> {
    ptrace::seize(thread, ptrace::Options::PTRACE_O_TRACESYSGOOD).ok()?;
    // Only a stopped thread can be told to stop at every system call.
    ptrace::interrupt(thread).unwrap();
    let (started, mut since, mut stops) = (Instant::now(), None::<Instant>, 0);
    let mut over = false;
    loop {
        match waitpid(thread, Some(WaitPidFlag::WNOHANG | WaitPidFlag::__WALL)).unwrap() {
            WaitStatus::StillAlive => {
                assert!(started.elapsed() < time + PATIENCE, "the traced thread does not stop");
                if since.is_some_and(|since| since.elapsed() > time) && !over {
                    over = true;
                    ptrace::interrupt(thread).unwrap();
                }
                thread::sleep(Duration::from_micros(200));
            }
            // Either kind of stop will do for letting go.
            WaitStatus::PtraceSyscall(_) | WaitStatus::PtraceEvent(..) | WaitStatus::Stopped(..) if over => {
                ptrace::detach(thread, None).unwrap();
                // One stop at the beginning and one at the end of each.
                return Some(stops / 2);
            }
            WaitStatus::PtraceSyscall(_) => {
                stops += 1;
                ptrace::syscall(thread, None).unwrap();
            }
            WaitStatus::PtraceEvent(..) | WaitStatus::Stopped(..) => {
                // From here on it stops at every call.
                since.get_or_insert_with(Instant::now);
                ptrace::syscall(thread, None).unwrap();
            }
            other => panic!("{other:?}"),
        }
    }
}
