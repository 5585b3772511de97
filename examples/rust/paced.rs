//! An acquisition at the pace of its hardware: 400 samples a second, each sent when its control period ends.
//!
//!     example-paced IMU [PERIODS [CORE PRIORITY]]
//!
//! Start with this program. It loses no control period while the service is replaced, and says so where one is lost all
//! the same. Replace `wait_for_period` and `latch` by your hardware, and `navigate` by your navigation. CORE and
//! PRIORITY (`SCHED_FIFO`, 1 to 99) are for a machine that has a core to spare; they need rights, see docs/operate.md.
//! The environment variable `ISOTHERM_DOMAIN` names the domain.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that prints")]

use isotherm_client::{
    Acquisition, CompensateError, CompensatedIncrement, Flags, Loan, LoansNotMerged, Options, RawSample, Realtime,
    SendError, Sensor, monotonic_ns,
};
use std::env;
use std::error::Error;
use std::num::NonZeroU64;
use std::thread::sleep;
use std::time::Duration;

const PERIOD_NS: u64 = 2_500_000;
/// An increment that takes longer is late. It leaves time for the rest of the period.
const TIMEOUT: Duration = Duration::from_millis(1);
/// Telemetry is measured every 40th period: ten times a second.
const TELEMETRY_PERIODS: u64 = 40;
/// `prepare` takes some ten microseconds in cold caches.
const PREPARE_NS: u64 = 100_000;

struct Paced {
    acquisition: Acquisition,
    /// A sample for which there was no room; the next periods are added to it.
    waiting: Option<Loan>,
    head: f64,
    measured_ns: u64,
    answered: u64,
    late: u64,
    merged: u64,
    velocity: [f64; 3],
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = env::args().skip(1).collect();
    let [imu, rest @ ..] = words.as_slice() else {
        return Err("usage: example-paced IMU [PERIODS [CORE PRIORITY]]".into());
    };
    let periods = rest.first().map_or(Ok(4000), |word| word.parse())?;
    // Before connecting, so that all memory is resident. Without arguments only sleeps become exact, which needs no
    // right.
    let mut realtime = Realtime { timer_slack_ns: NonZeroU64::new(1), ..Realtime::default() };
    if let [_, core, priority] = rest {
        realtime =
            Realtime { core: Some(core.parse()?), priority: Some(priority.parse()?), lock_memory: true, ..realtime };
    }
    realtime.apply()?;
    let options = Options { serial: env::var("SERIAL").ok(), ..Options::from_environment()? };
    let acquisition = Acquisition::connect(&imu.parse()?, &options)?;
    let (waiting, head, measured_ns, velocity) = (None, 0.0, 0, [0.0; 3]);
    Paced { acquisition, waiting, head, measured_ns, answered: 0, late: 0, merged: 0, velocity }.run(periods)
}

impl Paced {
    fn run(mut self, periods: u64) -> Result<(), Box<dyn Error>> {
        let began = monotonic_ns();
        for period in 0..periods {
            let end = began + (period + 1) * PERIOD_NS;
            self.wait_for_period(end);
            let mut sample = self.acquisition.loan()?;
            self.latch(&mut sample, period, end);
            self.add(sample);
            self.exchange()?;
        }
        // The last periods: wait for a service that is away, 20 s.
        for _ in 0..20_000 {
            if self.waiting.is_none() && self.acquisition.in_flight() == 0 {
                break;
            }
            self.exchange()?;
            sleep(Duration::from_millis(1));
        }
        let Self { answered, late, merged, velocity, waiting, acquisition, .. } = self;
        drop(waiting);
        let closing = acquisition.close();
        println!("{periods} periods: {answered} answered in time, {late} late, {merged} merged, {} lost", closing.lost);
        println!("velocity {:.9} {:.9} {:.9} m/s", velocity[0], velocity[1], velocity[2]);
        Ok(())
    }

    /// Waits for the end of a period. While it waits it warms the way of the sample.
    fn wait_for_period(&mut self, end: u64) {
        sleep_until(end - PREPARE_NS);
        if monotonic_ns() < end {
            self.acquisition.prepare();
        }
        sleep_until(end);
    }

    /// What the hardware has counted and measured. Every field that is not set is 0.
    fn latch(&mut self, sample: &mut RawSample, period: u64, end: u64) {
        if period.is_multiple_of(TELEMETRY_PERIODS) {
            // A new measurement. The library keeps its lag; a value that is only repeated is not given again.
            self.head = 2.5 + 1e-6 * period as f64;
            self.measured_ns = end;
            for (sensor, _) in &Sensor::NAMES[..3] {
                self.acquisition.reading(*sensor, self.head, self.measured_ns);
            }
        }
        sample.timestamp_ns = end;
        sample.interval_ns = PERIOD_NS; // the measured gate length
        sample.telemetry_ns = self.measured_ns;
        sample.accelerometers.positive_pulses = [140, 141, 142];
        sample.accelerometers.head_temperature = [self.head; 3];
        sample.accelerometers.board_temperature = [self.head; 3];
    }

    /// Adds a period to the one that waits, or gives up the one that waits.
    fn add(&mut self, sample: Loan) {
        let Some(waiting) = &mut self.waiting else { return self.waiting = Some(sample) };
        match self.acquisition.merge(waiting, sample) {
            Ok(()) => self.merged += 1,
            // A sum does not fit: over an hour without a service. The sample that waits is dropped, which is a gap for
            // every reader.
            Err(LoansNotMerged { later, .. }) => self.waiting = Some(later),
        }
    }

    /// Sends what waits and takes all increments that are there. A full queue leaves the sample to the next period.
    fn exchange(&mut self) -> Result<(), Box<dyn Error>> {
        if let Some(sample) = self.waiting.take() {
            match self.acquisition.compensate(sample, TIMEOUT) {
                Ok(increment) => {
                    self.answered += 1;
                    self.navigate(&increment);
                }
                // It was sent; its increment comes from `receive`.
                Err(CompensateError::Timeout) => {}
                Err(CompensateError::Send(SendError::Full(sample))) => self.waiting = Some(sample),
                Err(other) => return Err(other.into()),
            }
        }
        while let Some(increment) = self.acquisition.receive()? {
            self.late += 1;
            self.navigate(&increment);
        }
        Ok(())
    }

    /// A value counts if it is finite, whatever the flags say.
    fn navigate(&mut self, increment: &CompensatedIncrement) {
        let flags = Flags(increment.flags);
        if flags.intersects(Flags::LOST) {
            eprintln!("{}: time is missing before this increment", increment.sequence);
        }
        if flags.intersects(Flags::INVALID) || flags.intersects(Flags::DEGRADED) {
            eprintln!("{}: {flags}", increment.sequence);
        }
        for (velocity, dv) in self.velocity.iter_mut().zip(increment.velocity_increment) {
            if dv.is_finite() {
                *velocity += dv;
            }
        }
    }
}

fn sleep_until(time_ns: u64) {
    sleep(Duration::from_nanos(time_ns.saturating_sub(monotonic_ns())));
}
