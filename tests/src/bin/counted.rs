//! A service and an acquisition with a counting allocator, for `tests/hot_loop.rs`, and a way to run a program without
//! real-time permissions, for `tests/realtime.rs`.
//!
//! * `counted serve ...` is `isotherm serve ...`. For every line of input it prints how often its workers have
//!   allocated or freed memory so far.
//! * `counted send IMU SAMPLES` sends samples as fast as they are answered: first 1000, and after a line of input
//!   SAMPLES more. After each part it prints how often the part allocated or freed memory. It ends after the second
//!   part and one more line, or the end, of its input.
//! * `counted without-rights PROGRAM ...` executes a program that may not set real-time priorities or lock memory.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]
#![expect(unsafe_code, reason = "an allocator is unsafe to implement")]

use isotherm_client::{Acquisition, Flags, LagOption, Options, Sensor, TimeConstant};
use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::{CapabilitySet, remove_capability_from_bounding_set};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::stdin;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

struct CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Allocations, reallocations and frees by threads whose name begins with `worker`.
static WORKERS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// Allocations, reallocations and frees by this thread.
    static MINE: Cell<u64> = const { Cell::new(0) };
    /// Whether this thread is a worker.
    static WORKER: Cell<bool> = const { Cell::new(false) };
}

/// Calls of a thread in which its name is checked. A thread gets its name before it has allocated this often.
const NAME_CHECKS: u64 = 100;

fn count() {
    MINE.set(MINE.get() + 1);
    if !WORKER.get() && MINE.get() < NAME_CHECKS {
        let mut name = [0_u8; 16];
        // SAFETY: writes at most 16 bytes.
        unsafe { libc::prctl(libc::PR_GET_NAME, name.as_mut_ptr()) };
        WORKER.set(name.starts_with(b"worker"));
    }
    if WORKER.get() {
        WORKERS.fetch_add(1, Relaxed);
    }
}

// SAFETY: every call is forwarded to the system's allocator.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's contract.
        unsafe { System.dealloc(block, layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's contract.
        unsafe { System.realloc(block, layout, size) }
    }
}

fn main() -> ExitCode {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["serve", ..] => {
            std::thread::spawn(|| stdin().lines().for_each(|_| println!("{}", WORKERS.load(Relaxed))));
            isotherm_service::main(env!("CARGO_PKG_VERSION"))
        }
        ["send", imu, samples] => {
            send(imu, samples.parse().unwrap());
            ExitCode::SUCCESS
        }
        ["without-rights", program, rest @ ..] => {
            // This fails in an unprivileged process, which lacks these capabilities anyway.
            for capability in [CapabilitySet::SYS_NICE, CapabilitySet::IPC_LOCK, CapabilitySet::SYS_RESOURCE] {
                let _ = remove_capability_from_bounding_set(capability);
            }
            let none = Rlimit { current: Some(0), maximum: Some(0) };
            setrlimit(Resource::Rtprio, none).unwrap();
            setrlimit(Resource::Memlock, none).unwrap();
            panic!("{}", Command::new(program).args(rest).exec());
        }
        other => panic!("unknown role {other:?}"),
    }
}

/// Samples that take longer than 4 ms, because the kernel suspended one of the processes, are not counted: the client
/// then checks whether the service has been replaced, and that query of the transport allocates.
fn send(imu: &str, samples: u64) {
    const UNINTERRUPTED: Duration = Duration::from_millis(4);
    let options = Options::from_environment().unwrap();
    // The table's: the service computes the transient terms.
    let lag = LagOption::Fixed(TimeConstant::from_seconds(240.0).unwrap());
    let options = Options { serial: Some("SN 42".to_owned()), lag, ..options };
    let mut acquisition = Acquisition::connect(&imu.parse().unwrap(), &options).unwrap();
    acquisition.lag().soaked();
    // The first part makes the connections and lets the queues grow to their final size.
    for part in [1000, samples] {
        let mut allocations = 0;
        for number in 0..part {
            let (before, started) = (MINE.get(), Instant::now());
            // Not part of the sending path, but while the time constant stays it costs no more than that.
            let head = 2.5 + (number % 10) as f64 * 0.01;
            for (sensor, _) in Sensor::NAMES {
                acquisition.lag().read(sensor, head, 1_000_000_000 * number);
            }
            if number.is_multiple_of(2) {
                acquisition.prepare();
            }
            let mut loan = acquisition.loan().unwrap();
            loan.interval_ns = 1;
            loan.accelerometers.head_temperature = [head; 3];
            loan.gyroscopes.head_temperature = [head; 3];
            acquisition.send(loan).unwrap();
            let mut polls = 0_u64;
            let increment = loop {
                if let Some(increment) = acquisition.receive().unwrap() {
                    break increment;
                }
                core::hint::spin_loop();
                polls += 1;
                if polls.is_multiple_of(1 << 24) {
                    // Without a service this loop does not end; the harness then kills this process.
                    std::thread::sleep(Duration::from_millis(1));
                }
            };
            assert!(!Flags(increment.flags).intersects(Flags::LAG_UNKNOWN), "the transient terms are left out");
            if started.elapsed() < UNINTERRUPTED {
                allocations += MINE.get() - before;
            }
        }
        println!("{allocations}");
        let _ = stdin().read_line(&mut String::new());
    }
}
