//! Samples sent by the clock. The schedule does not wait for answers, so that slow answers do not reduce the number of
//! samples (no coordinated omission). The sender sleeps once it has all answers: the operating system would throttle
//! one that spins at a real-time priority.

use isotherm_benches::{BenchResult, TIMEOUT, figures, sample};
use isotherm_client::{Acquisition, RawSample, monotonic_ns};
use serde_json::{Map, Value};
use std::collections::VecDeque;
use std::time::Duration;

/// What is sent, and how the sender waits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SendSchedule {
    /// One sample for each IMU in every period.
    pub period: Duration,
    /// Periods that are not counted, while the service learns the rate.
    pub warm_up: usize,
    /// Periods that are counted.
    pub count: usize,
}

/// Latencies in the order of sending \[ns\].
#[derive(Clone, Debug, Default)]
pub(crate) struct Latencies {
    /// From the moment at which the sample was to be sent.
    pub intended: Vec<u32>,
    /// From the moment at which the sample was sent.
    pub sent: Vec<u32>,
}

impl Latencies {
    /// Appends the latencies of another run.
    pub(crate) fn append(&mut self, mut other: Self) {
        self.intended.append(&mut other.intended);
        self.sent.append(&mut other.sent);
    }

    /// Percentiles from the intended moment and, under `from_send`, from the actual one.
    pub(crate) fn figures(self) -> Map<String, Value> {
        let mut all = figures(self.intended);
        all.insert("from_send".to_owned(), figures(self.sent).into());
        all
    }
}

/// A sample in flight.
struct Sent {
    intended: u64,
    sent: u64,
    counted: bool,
}

/// Sends by `schedule`.
///
/// # Errors
/// If an answer does not come.
pub(crate) fn run(acquisitions: &mut [Acquisition], schedule: SendSchedule) -> BenchResult<Latencies> {
    let mut latencies = Latencies::default();
    let mut in_flight: Vec<VecDeque<Sent>> = acquisitions.iter().map(|_| VecDeque::new()).collect();
    let period = u64::try_from(schedule.period.as_nanos())?;
    let beginning = monotonic_ns() + period;
    for turn in 0..schedule.warm_up + schedule.count {
        let due = beginning + turn as u64 * period;
        loop {
            collect(acquisitions, &mut in_flight, &mut latencies)?;
            let now = monotonic_ns();
            if now >= due {
                break;
            }
            if in_flight.iter().all(VecDeque::is_empty) {
                std::thread::sleep(Duration::from_nanos(due - now));
            }
            core::hint::spin_loop();
        }
        for index in 0..acquisitions.len() {
            let full = |in_flight: &[VecDeque<Sent>], acquisitions: &[Acquisition]| {
                in_flight[index].len() >= acquisitions[index].depth()
            };
            let deadline = monotonic_ns() + TIMEOUT.as_nanos() as u64;
            while full(&in_flight, acquisitions) {
                collect(acquisitions, &mut in_flight, &mut latencies)?;
                if monotonic_ns() > deadline {
                    return Err("the service does not answer".into());
                }
            }
            let mut loan = acquisitions[index].loan()?;
            let (session, sequence) = (loan.session, loan.sequence);
            *loan = RawSample { session, sequence, ..sample() };
            let sent = monotonic_ns();
            acquisitions[index].send(loan)?;
            in_flight[index].push_back(Sent { intended: due, sent, counted: turn >= schedule.warm_up });
        }
    }
    let deadline = monotonic_ns() + TIMEOUT.as_nanos() as u64;
    while in_flight.iter().any(|in_flight| !in_flight.is_empty()) {
        collect(acquisitions, &mut in_flight, &mut latencies)?;
        if monotonic_ns() > deadline {
            return Err("not every sample was answered".into());
        }
    }
    Ok(latencies)
}

/// Takes the answers that have come. They come in the order of sending.
fn collect(
    acquisitions: &mut [Acquisition],
    in_flight: &mut [VecDeque<Sent>],
    latencies: &mut Latencies,
) -> BenchResult<()> {
    for (acquisition, in_flight) in acquisitions.iter_mut().zip(in_flight) {
        while !in_flight.is_empty() && acquisition.receive()?.is_some() {
            let now = monotonic_ns();
            if let Some(Sent { intended, sent, counted: true }) = in_flight.pop_front() {
                let since = |then: u64| u32::try_from(now.saturating_sub(then)).unwrap_or(u32::MAX);
                latencies.intended.push(since(intended));
                latencies.sent.push(since(sent));
            }
        }
    }
    Ok(())
}
