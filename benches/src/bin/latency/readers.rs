//! What a reader of increments costs that waits at the rate of an IMU: processor time of its thread compared with one
//! that polls and with one that does nothing but wait for an eventfd, all three woken by the same samples.

use isotherm_benches::{BenchDomain, BenchResult, Common, IMU, TIMEOUT, median, pooled_ratio, sample};
use isotherm_client::{
    Acquisition, CompensatedIncrement, ConnectError, IncrementReader, Options, RawSample, monotonic_ns,
};
use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::OwnedFd;
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use std::thread;
use std::time::Duration;

/// Rate of the samples \[Hz\].
const RATE: u64 = 400;
/// Samples of a block.
const BLOCK: usize = 50;
/// Samples before the first block: the service sees that somebody waits, and learns the rate.
const WARM_UP: usize = 400;

/// Processor time of a thread, block by block \[ns\].
type Blocks = Vec<u32>;

pub(crate) fn measure(common: Common) -> BenchResult<Value> {
    let blocks = common.rounds(1, 160);
    let samples = WARM_UP + blocks * BLOCK;
    let domain = BenchDomain::new()?;
    let _service = domain.serve(None, "")?;
    let mut acquisition = domain.acquisition(IMU)?;
    let event = eventfd(0, EventfdFlags::CLOEXEC)?;
    let [waiting, polling, bare] = thread::scope(|scope| {
        let options = domain.options();
        let (waits, polls) = (options.clone(), options);
        let readers = [
            scope.spawn(move || read(&waits, samples, IncrementReader::receive_timeout)),
            scope.spawn(move || read(&polls, samples, poll)),
            scope.spawn(|| wait_for_event(&event, samples)),
        ];
        // Readers see what is published after they have connected.
        let connected = || Ok(domain.readers().is_ok_and(|readers| readers >= 3));
        // Without them it is measured what fails.
        let _ = domain.wait_until("the readers do not come", [TIMEOUT, Duration::from_millis(10)], connected);
        let sent = send(&mut acquisition, &event, samples);
        if sent.is_err() {
            // Lets the reader of the eventfd end.
            rustix::io::write(&event, &(samples as u64).to_ne_bytes())?;
        }
        sent?;
        let blocks = readers.map(|reader| reader.join().map_err(|_| "a reader panicked".to_owned()).and_then(|it| it));
        let [waiting, polling, bare] = blocks;
        Ok::<_, Box<dyn std::error::Error>>([waiting?, polling?, bare?])
    })?;
    let figures = |blocks: &Blocks| {
        let per_sample = median(blocks.iter().map(|ns| f64::from(*ns) / BLOCK as f64).collect());
        json!({"ns_a_sample_p50": per_sample, "percent_of_a_core": per_sample.map(|ns| ns * RATE as f64 / 1e7)})
    };
    let ratio = |upper: &Blocks, lower: &Blocks| {
        let turns = |blocks: &Blocks| blocks.iter().map(|ns| vec![*ns]).collect::<Vec<_>>();
        pooled_ratio(&turns(upper), &turns(lower), 0.5)
    };
    let ratios = json!({"waiting/eventfd": ratio(&waiting, &bare), "polling/eventfd": ratio(&polling, &bare)});
    let readers = json!({"waiting": figures(&waiting), "polling": figures(&polling), "eventfd": figures(&bare)});
    Ok(json!({"readers": readers, "ratios": ratios, "rate_hz": RATE, "blocks": blocks}))
}

/// Sends at the rate of the samples, and writes the eventfd with each of them.
fn send(acquisition: &mut Acquisition, event: &OwnedFd, samples: usize) -> BenchResult<()> {
    let period = 1_000_000_000 / RATE;
    let beginning = monotonic_ns() + period;
    for turn in 0..samples as u64 {
        let due = beginning + turn * period;
        thread::sleep(Duration::from_nanos(due.saturating_sub(monotonic_ns())));
        let mut loan = acquisition.loan()?;
        *loan = RawSample { session: loan.session, sequence: loan.sequence, ..sample() };
        acquisition.send(loan)?;
        rustix::io::write(event, &1_u64.to_ne_bytes())?;
        acquisition.receive_timeout(TIMEOUT)?.ok_or("the service does not answer")?;
    }
    Ok(())
}

/// Reads all samples, each by `receive`.
fn read<E: ToString>(
    options: &Options,
    samples: usize,
    receive: fn(&mut IncrementReader, Duration) -> Result<Option<CompensatedIncrement>, E>,
) -> Result<Blocks, String> {
    let imu = IMU.parse().map_err(|error: isotherm_shared::names::InvalidName| error.to_string())?;
    let mut reader = IncrementReader::connect(imu, options).map_err(|error| error.to_string())?;
    blocks(samples, || {
        let received = receive(&mut reader, TIMEOUT).map_err(|error| error.to_string())?;
        received.map(drop).ok_or_else(|| "an increment is missing".to_owned())
    })
}

/// As a reader does that cannot wait.
fn poll(reader: &mut IncrementReader, timeout: Duration) -> Result<Option<CompensatedIncrement>, ConnectError> {
    let deadline = monotonic_ns() + timeout.as_nanos() as u64;
    loop {
        let received = reader.receive()?;
        if received.is_some() || monotonic_ns() >= deadline {
            return Ok(received);
        }
        thread::sleep(Duration::from_micros(200));
    }
}

fn wait_for_event(event: &OwnedFd, samples: usize) -> Result<Blocks, String> {
    let mut read = 0;
    blocks(samples, || {
        // One read can take several: then the next calls have nothing to wait for.
        if read == 0 {
            let mut count = [0; 8];
            rustix::io::read(event, &mut count).map_err(|error| error.to_string())?;
            read = u64::from_ne_bytes(count);
        }
        read -= 1;
        Ok(())
    })
}

/// The processor time of this thread for each block of calls.
fn blocks(samples: usize, mut call: impl FnMut() -> Result<(), String>) -> Result<Blocks, String> {
    let now = || {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
    };
    (0..WARM_UP).try_for_each(|_| call())?;
    let block = |_| {
        let before = now();
        (0..BLOCK).try_for_each(|_| call())?;
        Ok(u32::try_from(now() - before).unwrap_or(u32::MAX))
    };
    (0..(samples - WARM_UP) / BLOCK).map(block).collect()
}
