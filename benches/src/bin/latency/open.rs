//! Samples sent by the clock: the schedule does not wait for answers, so that a slow answer is not left out by sending less.

use isotherm_benches::statistics::figures;
use isotherm_benches::{Outcome, PATIENCE, sample};
use isotherm_client::{Acquisition, RawSample, monotonic_ns};
use serde_json::{Map, Value};
use std::collections::VecDeque;
use std::time::Duration;

/// What is sent, and how the sender waits.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// One sample for each IMU in every period.
    pub period: Duration,
    /// Periods that are not counted, while the service learns the rate.
    pub warm_up: usize,
    /// Periods that are.
    pub count: usize,
    /// Whether the sender spins from one period to the next, or sleeps once it has all answers.
    pub spin: bool,
}

/// Latencies in the order of sending \[ns\].
#[derive(Clone, Debug, Default)]
pub struct Latencies {
    /// From the moment at which the schedule wanted the sample sent.
    pub intended: Vec<u32>,
    /// From the moment at which it was.
    pub sent: Vec<u32>,
}

impl Latencies {
    /// Adds those of another run.
    pub fn append(&mut self, mut other: Self) {
        self.intended.append(&mut other.intended);
        self.sent.append(&mut other.sent);
    }

    /// Percentiles from the intended moment, and, under `from_send`, from the other.
    pub fn figures(self) -> Map<String, Value> {
        let mut all = figures(self.intended);
        all.insert("from_send".to_owned(), figures(self.sent).into());
        all
    }
}

/// A sample on its way.
struct Sent {
    intended: u64,
    sent: u64,
    counted: bool,
}

/// Sends by `schedule`; `started` is called when the counted part begins.
///
/// # Errors
/// If an answer does not come.
pub fn run(acquisitions: &mut [Acquisition], schedule: Schedule, mut started: impl FnMut()) -> Outcome<Latencies> {
    let mut latencies = Latencies::default();
    let mut flying: Vec<VecDeque<Sent>> = acquisitions.iter().map(|_| VecDeque::new()).collect();
    let period = u64::try_from(schedule.period.as_nanos())?;
    let beginning = monotonic_ns() + period;
    for turn in 0..schedule.warm_up + schedule.count {
        let due = beginning + turn as u64 * period;
        loop {
            collect(acquisitions, &mut flying, &mut latencies)?;
            let now = monotonic_ns();
            if now >= due {
                break;
            }
            if !schedule.spin && flying.iter().all(VecDeque::is_empty) {
                std::thread::sleep(Duration::from_nanos(due - now));
            }
            core::hint::spin_loop();
        }
        if turn == schedule.warm_up {
            started();
        }
        for index in 0..acquisitions.len() {
            let full = |flying: &[VecDeque<Sent>], acquisitions: &[Acquisition]| {
                flying[index].len() >= acquisitions[index].depth()
            };
            let deadline = monotonic_ns() + PATIENCE.as_nanos() as u64;
            while full(&flying, acquisitions) {
                collect(acquisitions, &mut flying, &mut latencies)?;
                if monotonic_ns() > deadline {
                    return Err("the service does not answer".into());
                }
            }
            let mut loan = acquisitions[index].loan()?;
            let (session, sequence) = (loan.session, loan.sequence);
            *loan = RawSample { session, sequence, ..sample() };
            let sent = monotonic_ns();
            acquisitions[index].send(loan)?;
            flying[index].push_back(Sent { intended: due, sent, counted: turn >= schedule.warm_up });
        }
    }
    let deadline = monotonic_ns() + PATIENCE.as_nanos() as u64;
    while flying.iter().any(|flying| !flying.is_empty()) {
        collect(acquisitions, &mut flying, &mut latencies)?;
        if monotonic_ns() > deadline {
            return Err("not every sample was answered".into());
        }
    }
    Ok(latencies)
}

/// Takes what has been answered; answers come in the order of sending.
fn collect(acquisitions: &mut [Acquisition], flying: &mut [VecDeque<Sent>], latencies: &mut Latencies) -> Outcome<()> {
    for (acquisition, flying) in acquisitions.iter_mut().zip(flying) {
        while !flying.is_empty() && acquisition.receive()?.is_some() {
            let now = monotonic_ns();
            if let Some(Sent { intended, sent, counted: true }) = flying.pop_front() {
                let since = |then: u64| u32::try_from(now.saturating_sub(then)).unwrap_or(u32::MAX);
                latencies.intended.push(since(intended));
                latencies.sent.push(since(sent));
            }
        }
    }
    Ok(())
}
