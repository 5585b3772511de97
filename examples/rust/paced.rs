//! An acquisition at the pace of its hardware: 400 readings a second, each sent when its control period ends.
//!
//!     example-paced IMU [PERIODS [CORE PRIORITY]]
//!
//! Start with this program. It loses no control period while the service is away or replaced, and says so where one is
//! lost all the same. Replace `wait_for_period` and `read_imu` by your hardware, and `navigate` by your navigation.
//! The resolution is that of the table, here of examples/tables/imu-mems.toml; the period is your own. An IMU that
//! counts pulses writes them, and the measured gate length, into the sample itself. CORE and PRIORITY (`SCHED_FIFO`, 1
//! to 99) are for a machine that has a core to spare; they need rights, see docs/operate.md. The environment variable
//! `ISOTHERM_DOMAIN` names the domain.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that prints")]

use isotherm_client::{
    Acquisition, CompensatedIncrement, Flags, Options, RawSample, ReadingError, Realtime, Resolution, monotonic_ns,
};
use std::env;
use std::error::Error;
use std::num::NonZeroU64;
use std::thread::sleep;
use std::time::Duration;

const PERIOD_NS: u64 = 2_500_000;
const RESOLUTION: Resolution = Resolution { accelerometer: 1e-6, gyroscope: 1e-7 };
/// An increment that takes longer is late. It leaves time for the rest of the period.
const TIMEOUT: Duration = Duration::from_millis(1);
/// Temperature is measured every 40th period: ten times a second.
const TEMPERATURE_PERIODS: u64 = 40;
/// `prepare` takes some ten microseconds in cold caches.
const PREPARE_NS: u64 = 100_000;

struct Paced {
    acquisition: Acquisition,
    temperature: f64,
    measured_ns: u64,
    navigation: Navigation,
}

/// What the increments add up to.
#[derive(Default)]
struct Navigation {
    increments: u64,
    velocity: [f64; 3],
    angle: [f64; 3],
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
    let options =
        Options { serial: env::var("SERIAL").ok(), resolution: Some(RESOLUTION), ..Options::from_environment()? };
    let paced = Paced {
        acquisition: Acquisition::connect(&imu.parse()?, &options)?,
        temperature: 0.0,
        measured_ns: 0,
        navigation: Navigation::default(),
    };
    paced.run(periods)
}

/// Specific force \[m/s2\] and angular rate \[rad/s\], the means over the period, and temperature \[degC\].
fn read_imu(period: u64) -> ([f64; 3], [f64; 3], f64) {
    let turn = (period % 100) as f64;
    ([0.1 + 1e-4 * turn, -0.3, 9.80665], [0.01, 1e-5 * turn - 0.02, 7.292e-5], 31.25 + 1e-6 * period as f64)
}

impl Paced {
    fn run(mut self, periods: u64) -> Result<(), Box<dyn Error>> {
        let began = monotonic_ns();
        for period in 0..periods {
            let end = began + (period + 1) * PERIOD_NS;
            self.wait_for_period(end);
            let mut sample = self.acquisition.loan()?;
            if let Err(error) = self.latch(&mut sample, period, end) {
                eprintln!("{error}"); // the sample is dropped, a gap for every reader
                continue;
            }
            // While the service has no room, or is away, the sample waits, and a later call sends it.
            for increment in self.acquisition.exchange(sample, TIMEOUT)? {
                self.navigation.add(increment);
            }
        }
        // The last periods: wait for a service that is away, 20 s.
        for _ in 0..20 {
            while let Some(increment) = self.acquisition.receive_timeout(Duration::from_secs(1))? {
                self.navigation.add(&increment);
            }
            if self.acquisition.kept() == 0 && self.acquisition.in_flight() == 0 {
                break;
            }
        }
        let (Navigation { increments, velocity, angle }, lost) = (self.navigation, self.acquisition.close().lost);
        println!("{periods} periods: {increments} increments, {lost} lost");
        println!("velocity {:.9} {:.9} {:.9} m/s", velocity[0], velocity[1], velocity[2]);
        println!("angle {:.9} {:.9} {:.9} rad", angle[0], angle[1], angle[2]);
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

    /// What the hardware has measured. Temperature that is not set is NaN, every other field 0.
    fn latch(&mut self, sample: &mut RawSample, period: u64, end: u64) -> Result<(), ReadingError> {
        let (specific_force, angular_rate, temperature) = read_imu(period);
        if period.is_multiple_of(TEMPERATURE_PERIODS) {
            // A new measurement. The library keeps its lag; a value that is only repeated is not given again.
            (self.temperature, self.measured_ns) = (temperature, end);
            self.acquisition.lag().reading_of_all(temperature, end);
        }
        (sample.timestamp_ns, sample.interval_ns) = (end, PERIOD_NS);
        sample.telemetry_ns = self.measured_ns;
        self.acquisition.fill(sample, specific_force, Some(angular_rate))?;
        for triad in [&mut sample.accelerometers, &mut sample.gyroscopes] {
            (triad.head_temperature, triad.board_temperature) = ([self.temperature; 3], [self.temperature; 3]);
        }
        Ok(())
    }
}

impl Navigation {
    /// A value counts if it is finite, whatever the flags say.
    fn add(&mut self, increment: &CompensatedIncrement) {
        self.increments += 1;
        let flags = Flags(increment.flags);
        if flags.intersects(Flags::LOST) {
            eprintln!("{}: time is missing before this increment", increment.sequence);
        }
        if flags.intersects(Flags::INVALID) || flags.intersects(Flags::DEGRADED) {
            eprintln!("{}: {flags}", increment.sequence);
        }
        let sums = self.velocity.iter_mut().chain(&mut self.angle);
        for (sum, value) in sums.zip(increment.velocity_increment.iter().chain(&increment.angle_increment)) {
            if value.is_finite() {
                *sum += value;
            }
        }
    }
}

fn sleep_until(time_ns: u64) {
    sleep(Duration::from_nanos(time_ns.saturating_sub(monotonic_ns())));
}
