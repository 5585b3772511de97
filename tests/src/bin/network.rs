//! Compares the increments on both sides of a network tunnel bit by bit, counts them, and measures the added latency
//! with one clock. It also measures how relay and tunnels change the round trips of the service. Both sides must be
//! domains of this machine: `examples/network/try.sh` makes two hosts with network namespaces.
#![allow(clippy::print_stdout, reason = "the figures are the product")]

use clap::Parser;
use isotherm_client::{
    Acquisition, CompensatedIncrement, ImuId, IncrementReader, Options, RawSample, domain, monotonic_ns,
};
use rustix::process::{Pid, Signal, kill_process};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

type NetworkResult<T> = Result<T, Box<dyn Error>>;

/// The IMU whose increments are compared.
const IMU: &str = "imu-whole";
/// Longest wait for an answer.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Pause between two polls of both sides. Increments of the same poll count as simultaneous.
const POLL_PAUSE: Duration = Duration::from_micros(50);
/// A side without increments for this time is reported as silent.
const SILENCE: Duration = Duration::from_millis(500);
/// Shortest wait after the last increment of the near side, so that the far side can deliver the rest.
const GRACE: Duration = Duration::from_secs(2);

#[derive(Parser)]
enum NetworkCommand {
    /// Compare the increments of a domain with those that arrive in another one, until they have stopped
    Compare {
        near: String,
        far: String,
        /// End the comparison after this time without any increment, in seconds
        #[arg(long, default_value_t = 5.0)]
        idle: f64,
    },
    /// Round trips at 2 kHz in alternating blocks: with relay and tunnels, and without
    RoundTrips {
        near: String,
        far: String,
        /// A program that runs relay and tunnels until SIGTERM
        link: PathBuf,
        #[arg(long, default_value_t = 12)]
        blocks: usize,
    },
}

fn main() -> NetworkResult<()> {
    match NetworkCommand::parse() {
        NetworkCommand::Compare { near, far, idle } => compare(&near, &far, Duration::from_secs_f64(idle)),
        NetworkCommand::RoundTrips { near, far, link, blocks } => round_trips(&near, &far, &link, blocks),
    }
}

fn options(name: &str) -> NetworkResult<Options> {
    Ok(Options::new(domain(Some(name))?, TIMEOUT))
}

fn reader(name: &str) -> NetworkResult<IncrementReader> {
    Ok(IncrementReader::new(IMU.parse::<ImuId>()?, &options(name)?))
}

/// The increments of both sides so far.
#[derive(Default)]
struct TunnelComparison {
    /// Increments that have not come at the far side yet, by session and sequence, with their time at the near side
    /// \[ns\].
    waiting: BTreeMap<(u64, u64), (u64, CompensatedIncrement)>,
    /// Increments that came at the far side before they were read at the near side.
    early: BTreeMap<(u64, u64), CompensatedIncrement>,
    near: u64,
    far: u64,
    near_missing: u64,
    different: u64,
    added_ns: Vec<u64>,
    last: Option<(u64, u64)>,
}

impl TunnelComparison {
    fn near(&mut self, now: u64, increment: CompensatedIncrement) {
        let (session, sequence) = (increment.session, increment.sequence);
        if let Some((_, last)) = self.last.filter(|(last, _)| *last == session) {
            self.near_missing += sequence.saturating_sub(last + 1);
        }
        self.last = Some((session, sequence));
        self.near += 1;
        match self.early.remove(&(session, sequence)) {
            Some(copy) => self.pair(&increment, &copy, 0),
            None => drop(self.waiting.insert((session, sequence), (now, increment))),
        }
    }

    fn far(&mut self, now: u64, increment: CompensatedIncrement) {
        self.far += 1;
        let key = (increment.session, increment.sequence);
        match self.waiting.remove(&key) {
            Some((then, original)) => self.pair(&original, &increment, now.saturating_sub(then)),
            None => drop(self.early.insert(key, increment)),
        }
    }

    fn pair(&mut self, original: &CompensatedIncrement, copy: &CompensatedIncrement, added_ns: u64) {
        self.different += u64::from(bits(original) != bits(copy));
        self.added_ns.push(added_ns);
    }

    fn print(mut self) {
        self.added_ns.sort_unstable();
        println!(
            "  near {} ({} missing), far {}: {} different, {} unknown to the near side, {} lost",
            self.near,
            self.near_missing,
            self.far,
            self.different,
            self.early.len(),
            self.waiting.len()
        );
        if !self.added_ns.is_empty() {
            println!("  added latency [ms]: {}", percentiles(&self.added_ns, 1e6));
        }
    }
}

/// Every bit of an increment.
fn bits(increment: &CompensatedIncrement) -> [u64; 13] {
    let CompensatedIncrement {
        session,
        sequence,
        timestamp_ns,
        interval_ns,
        velocity_increment,
        angle_increment,
        table,
        flags,
        latency_ns,
    } = *increment;
    let [[x, y, z], [r, s, t]] = [velocity_increment, angle_increment].map(|triad| triad.map(f64::to_bits));
    [session, sequence, timestamp_ns, interval_ns, x, y, z, r, s, t, table, flags, latency_ns]
}

fn percentiles(sorted: &[u64], unit: f64) -> String {
    let rank = |part: f64| ((sorted.len() as f64 * part).ceil() as usize).clamp(1, sorted.len().max(1));
    let at = |part| sorted.get(rank(part) - 1).copied().unwrap_or_default() as f64 / unit;
    format!("p50 {:.2}, p99 {:.2}, p99.9 {:.2}, max {:.2}", at(0.5), at(0.99), at(0.999), at(1.0))
}

fn compare(near: &str, far: &str, idle: Duration) -> NetworkResult<()> {
    let (mut near, mut far) = (reader(near)?, reader(far)?);
    let (started, mut comparison) = (Instant::now(), TunnelComparison::default());
    let (mut near_at, mut far_at) = (started, started);
    let (mut silent, mut paused) = (true, true);
    while near_at.elapsed() < idle.max(GRACE) {
        while let Some(increment) = near.receive()? {
            if paused {
                println!("  {:8.3} s: near side flows", started.elapsed().as_secs_f64());
            }
            (near_at, paused) = (Instant::now(), false);
            comparison.near(monotonic_ns(), increment);
        }
        while let Some(increment) = far.receive()? {
            if silent {
                let key = (increment.session, increment.sequence);
                println!(
                    "  {:8.3} s: far side flows, {} increments behind it have not come",
                    started.elapsed().as_secs_f64(),
                    comparison.waiting.range(..key).count()
                );
            }
            (far_at, silent) = (Instant::now(), false);
            comparison.far(monotonic_ns(), increment);
        }
        if !silent && far_at.elapsed() > SILENCE {
            println!("  {:8.3} s: far side silent", (far_at - started).as_secs_f64());
            silent = true;
        }
        if !paused && near_at.elapsed() > SILENCE {
            println!("  {:8.3} s: near side silent", (near_at - started).as_secs_f64());
            paused = true;
        }
        thread::sleep(POLL_PAUSE);
    }
    comparison.print();
    Ok(())
}

/// Relay and tunnels. Dropping them ends them.
struct Link(Child);

impl Drop for Link {
    fn drop(&mut self) {
        // With SIGTERM they clean up by themselves, so that the next block need not.
        let _ = kill_process(Pid::from_child(&self.0), Signal::TERM);
        let _ = self.0.wait();
    }
}

fn round_trips(near: &str, far: &str, link: &Path, blocks: usize) -> NetworkResult<()> {
    let mut acquisition = Acquisition::connect(&IMU.parse()?, &options(near)?)?;
    let mut times = [Vec::new(), Vec::new()];
    for block in 0..2 * blocks {
        let with = block % 2;
        let _link = if with == 1 { Some(Link(Command::new(link).stdin(Stdio::null()).spawn()?)) } else { None };
        let (mut far, started) = (reader(far)?, Instant::now());
        while with == 1 && far.receive()?.is_none() {
            send(&mut acquisition, Duration::from_millis(10), &mut Vec::new())?;
            if started.elapsed() > 4 * TIMEOUT {
                return Err("nothing arrives at the far side".into());
            }
        }
        send(&mut acquisition, Duration::from_millis(200), &mut Vec::new())?;
        send(&mut acquisition, Duration::from_secs(2), &mut times[with])?;
    }
    for (name, times) in ["without", "with"].iter().zip(&mut times) {
        times.sort_unstable();
        println!("  {name:8} [us]: {} ({} round trips)", percentiles(times, 1e3), times.len());
    }
    Ok(())
}

/// Round trips at 2 kHz, spinning for the answer.
fn send(acquisition: &mut Acquisition, duration: Duration, times: &mut Vec<u64>) -> NetworkResult<()> {
    let started = Instant::now();
    let mut due = started;
    while started.elapsed() < duration {
        due += Duration::from_micros(500);
        thread::sleep(due.saturating_duration_since(Instant::now()));
        let mut loan = acquisition.loan()?;
        let (session, sequence) = (loan.session, loan.sequence);
        *loan = RawSample { session, sequence, interval_ns: 500_000, ..RawSample::default() };
        let begun = Instant::now();
        acquisition.compensate(loan, TIMEOUT)?;
        times.push(begun.elapsed().as_nanos() as u64);
    }
    Ok(())
}
