//! A service and an acquisition under an allocator that counts, for `tests/hot_loop.rs`; and a way to lose rights.
//!
//! * `counted serve ...` is `isotherm serve ...`; to every line of its input it says how often its workers have allocated or
//!   freed memory so far.
//! * `counted send IMU SAMPLES` sends samples as fast as they are answered: first some, then, after a line of input, as many as asked
//!   for. It says how often that allocated, and ends with its input.
//! * `counted without-rights PROGRAM ...` becomes a program that may ask for nothing real-time.
#![allow(clippy::panic, clippy::print_stdout, clippy::unwrap_used, reason = "in a test the panic is the report")]
#![expect(unsafe_code, reason = "an allocator is unsafe to implement")]

use isotherm_client::{Acquisition, Options};
use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::{CapabilitySet, remove_capability_from_bounding_set};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::stdin;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// By threads named `worker..`.
static WORKERS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static MINE: Cell<u64> = const { Cell::new(0) };
    static WORKER: Cell<bool> = const { Cell::new(false) };
}

/// A thread gets its name before it allocates this often.
const NAMELESS: u64 = 100;

fn count() {
    MINE.set(MINE.get() + 1);
    if !WORKER.get() && MINE.get() < NAMELESS {
        let mut name = [0_u8; 16];
        // SAFETY: writes at most 16 bytes.
        unsafe { libc::prctl(libc::PR_GET_NAME, name.as_mut_ptr()) };
        WORKER.set(name.starts_with(b"worker"));
    }
    if WORKER.get() {
        WORKERS.fetch_add(1, Relaxed);
    }
}

// SAFETY: hands everything to the system's allocator.
unsafe impl GlobalAlloc for Counting {
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
            // A process that lacks them already may not give them up; it does not have to.
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

/// A sample that is not answered for milliseconds, since one of the two was not allowed to run, does not count: the client
/// then looks whether the service is another one, and asking the transport allocates.
fn send(imu: &str, samples: u64) {
    const FLOWING: Duration = Duration::from_millis(4);
    let mut acquisition = Acquisition::connect(&imu.parse().unwrap(), &Options::from_environment().unwrap()).unwrap();
    // Connections are made with the first, and queues grow to their size.
    for part in [1000, samples] {
        let mut allocations = 0;
        for _ in 0..part {
            let (before, started) = (MINE.get(), Instant::now());
            let mut loan = acquisition.loan().unwrap();
            loan.interval_ns = 1;
            acquisition.send(loan).unwrap();
            let mut looks = 0_u64;
            while acquisition.receive().unwrap().is_none() {
                core::hint::spin_loop();
                looks += 1;
                if looks.is_multiple_of(1 << 24) {
                    // The harness ends this process if the service is gone.
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
            if started.elapsed() < FLOWING {
                allocations += MINE.get() - before;
            }
        }
        println!("{allocations}");
        let _ = stdin().read_line(&mut String::new());
    }
}
