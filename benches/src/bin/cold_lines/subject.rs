//! What is traced: samples on their way through client, transport and worker, in one thread. A mark begins each step.

use isotherm_benches::{BenchDomain, BenchResult, IMU, TABLE, sample};
use isotherm_client::{Clock, RawSample, join};
use isotherm_service::config::Imu;
use isotherm_service::create::Creator;
use isotherm_service::worker::channel::{Channel, ChannelLink};
use isotherm_service::worker::counters::counters;
use isotherm_service::worker::rehearse::Rehearsals;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::table::difference::MaxChange;
use std::fs;
use std::hint::black_box;
use std::io::{Write as _, stderr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

/// Samples before those that are counted: every queue has gone round once.
const WARM_UP: usize = 200;
/// Samples that are counted.
pub(crate) const COUNTED: usize = 16;

/// Process and name of each step, in the order of a sample.
pub(crate) const STEPS: [(&str, &str); 8] = [
    ("worker", "rehearsal, polls"),
    ("client", "prepare"),
    ("client", "loan, fill"),
    ("client", "send"),
    ("client", "polls"),
    ("worker", "serve"),
    ("worker", "settle"),
    ("client", "receive"),
];
/// The first steps keep the processes warm.
pub(crate) const WARMING: usize = 2;

/// A store to one of these begins a step; one to the last ends the sample.
static MARKS: [AtomicU64; STEPS.len() + 1] = [const { AtomicU64::new(0) }; STEPS.len() + 1];

/// Sends the samples, with queues of this depth. Tells on stderr, where the trace is, where the marks and the program
/// are in memory.
pub(crate) fn run(depth: usize) -> BenchResult<()> {
    let (maps, program) = (fs::read_to_string("/proc/self/maps")?, std::env::current_exe()?);
    let base =
        maps.lines().find(|line| line.ends_with(&*program.to_string_lossy())).and_then(|line| line.split('-').next());
    // One write, so that no line of the trace comes between.
    let marks =
        format!("marks {:x} {}\n", MARKS.as_ptr() as usize, base.ok_or("the program is not in its own memory map")?);
    stderr().write_all(marks.as_bytes())?;
    let bench = BenchDomain::new()?;
    let domain = bench.as_domain();
    let node = join(domain)?;
    let (mut send_table, tables) = rtrb::RingBuffer::new(1);
    send_table.push(Arc::new(CoefficientTable::from_toml(TABLE, None).map_err(|faults| faults.to_string())?))?;
    let imu = Imu { depth, ..Imu::new(IMU.parse()?, PathBuf::new(), MaxChange::default()) };
    let link = ChannelLink { imu, tables, counters: counters().0, before: None };
    let (mut channel, _listener) = Channel::open(&node, domain, link, 50_000).map_err(|failure| failure.to_string())?;
    channel.take_table();
    let rehearsals = Rehearsals::open(&node, &Creator::new(&node, domain), 0, 1);
    let mut rehearsals = rehearsals.map_err(|failure| failure.to_string())?;
    let (mut clock, mut acquisition) = (Clock::new(), bench.acquisition(IMU)?);
    let filled = sample();
    for count in 0..WARM_UP + COUNTED {
        let begin = |step: usize| {
            if count >= WARM_UP {
                black_box(&MARKS)[step].store(1, Relaxed);
            }
        };
        begin(0);
        rehearsals.rehearse(std::slice::from_mut(&mut channel), 0, &mut clock);
        black_box(channel.serve(&mut clock));
        begin(1);
        acquisition.prepare();
        begin(2);
        let mut loan = acquisition.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, sequence, ..*black_box(&filled) };
        begin(3);
        acquisition.send(loan)?;
        begin(4);
        black_box(acquisition.receive()?);
        begin(5);
        black_box(channel.serve(&mut clock)).ok_or("the sample has not come")?;
        begin(6);
        channel.settle();
        begin(7);
        black_box(acquisition.receive()?).ok_or("the answer has not come")?;
        begin(8);
    }
    Ok(())
}
