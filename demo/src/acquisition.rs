//! The demonstration's acquisition process: sends the simulated IMU's samples, one at a time, and judges what returns.

use super::imu::{DemoImu, INTERVAL_NS, SPECIFIC_FORCE, TemperatureRun};
use isotherm_client::{Acquisition, ImuId, Options};
use isotherm_failure::{Exit, Failure};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, CompensatedIncrement};
use serde::{Deserialize, Serialize};
use std::io::{self, Write as _};
use std::time::{Duration, Instant};

/// MeanStability is judged by means over 10 s.
const SAMPLES_A_MEAN: u32 = (10_000_000_000 / INTERVAL_NS) as u32;
/// How long one answer may take.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long the new table may take to be in force.
const RELOAD_PATIENCE: Duration = Duration::from_secs(5);

/// What the process tells its parent, a JSON line each.
#[derive(Debug, Deserialize, Serialize)]
pub enum Message {
    /// Share of the run that is done.
    Progress(f64),
    /// At the hot end, samples going on: time for the new table.
    Turning,
    /// The end.
    Outcome(Box<Outcome>),
}

/// What came of the run.
#[derive(Debug, Default, Deserialize, Serialize)]
pub struct Outcome {
    /// MeanStability while heating, under the first table.
    pub before: [MeanStability; AXES],
    /// MeanStability while cooling, under the second.
    pub after: [MeanStability; AXES],
    /// Tables that increments named, in order.
    pub tables: Vec<u64>,
    /// Samples sent.
    pub sent: u64,
    /// Increments that came back.
    pub answered: u64,
    /// Increments whose sequence was not the one expected.
    pub out_of_order: u64,
    /// Increments with any sample flag or a gap.
    pub flagged: u64,
    /// Increments between asking for the reload and the first one under the new table.
    pub during_reload: u64,
    /// From asking for the reload to the first increment under the new table \[ns\].
    pub reload_ns: u64,
    /// Round trips, sorted \[ns\].
    pub round_trips_ns: Vec<u32>,
}

/// Output minus the specific force that the attitude asks for, 10 s means.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
pub struct MeanStability {
    /// Number of means.
    pub means: u32,
    /// Standard deviation \[g0\].
    pub deviation: f64,
    /// Root mean square about zero \[g0\].
    pub rms: f64,
}

/// Runs the acquisition against the service of `options`.
///
/// # Errors
/// If the service does not answer or does not take the new table.
pub fn run(imu: &ImuId, truth: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let mut bench = Bench {
        acquisition: Acquisition::connect(imu, options)?,
        imu: DemoImu::new(truth, 1),
        outcome: Outcome::default(),
        gravity: truth.content().gravity,
    };
    bench.outcome.before = bench.leg(TemperatureRun::Heating, 0.0)?;
    bench.turn()?;
    bench.outcome.after = bench.leg(TemperatureRun::Cooling, 0.5)?;
    bench.outcome.round_trips_ns.sort_unstable();
    tell(&Message::Outcome(Box::new(bench.outcome)))
}

struct Bench {
    acquisition: Acquisition,
    imu: DemoImu,
    outcome: Outcome,
    gravity: f64,
}

impl Bench {
    /// Heats or cools until the IMU has arrived.
    fn leg(&mut self, chamber: TemperatureRun, done: f64) -> Result<[MeanStability; AXES], Failure> {
        let mut means = [const { Vec::new() }; AXES];
        // An hour's ramp; the head's lag makes it a little longer.
        let expected = 3600.0 * 1.2 / 10.0;
        while !self.imu.has_arrived(chamber) {
            let mut sum = [0.0; AXES];
            for _ in 0..SAMPLES_A_MEAN {
                let increment = self.round_trip(chamber)?;
                for (sum, dv) in sum.iter_mut().zip(increment.velocity_increment) {
                    *sum += dv;
                }
            }
            let time = f64::from(SAMPLES_A_MEAN) * INTERVAL_NS as f64 / 1e9;
            for ((means, sum), force) in means.iter_mut().zip(sum).zip(SPECIFIC_FORCE) {
                means.push(sum / time / self.gravity - force);
            }
            if means[0].len() % 8 == 0 {
                tell(&Message::Progress(done + 0.5 * (means[0].len() as f64 / expected).min(1.0)))?;
            }
        }
        Ok(means.map(|means| MeanStability::of(&means)))
    }

    /// Holds the temperature, samples going on, until the service uses another table.
    fn turn(&mut self) -> Result<(), Failure> {
        let old = self.outcome.tables.last().copied();
        tell(&Message::Turning)?;
        let asked = Instant::now();
        while self.outcome.tables.last().copied() == old {
            self.round_trip(TemperatureRun::Holding)?;
            self.outcome.during_reload += 1;
            if asked.elapsed() > RELOAD_PATIENCE {
                return Err(Failure::new(Exit::Failed, "the service did not take the new table"));
            }
        }
        self.outcome.reload_ns = asked.elapsed().as_nanos() as u64;
        Ok(())
    }

    fn round_trip(&mut self, chamber: TemperatureRun) -> Result<CompensatedIncrement, Failure> {
        let mut raw = self.acquisition.loan()?;
        self.imu.step(chamber, &mut raw);
        self.outcome.sent += 1;
        let sent = Instant::now();
        let increment = self.acquisition.compensate(raw, PATIENCE);
        let round_trip = sent.elapsed();
        let increment = increment.map_err(|error| Failure::new(Exit::Failed, error.to_string()))?;
        let outcome = &mut self.outcome;
        outcome.round_trips_ns.push(u32::try_from(round_trip.as_nanos()).unwrap_or(u32::MAX));
        outcome.out_of_order += u64::from(increment.sequence != outcome.answered);
        outcome.flagged += u64::from(increment.flags & !isotherm_shared::wire::Flags::LATE.0 != 0);
        outcome.answered += 1;
        if outcome.tables.last() != Some(&increment.table) {
            outcome.tables.push(increment.table);
        }
        Ok(increment)
    }
}

impl MeanStability {
    fn of(means: &[f64]) -> Self {
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        let squares = |about: f64| means.iter().map(|value| (value - about).powi(2)).sum::<f64>();
        Self {
            means: means.len() as u32,
            deviation: (squares(mean) / (n - 1.0)).sqrt(),
            rms: (squares(0.0) / n).sqrt(),
        }
    }
}

fn tell(message: &Message) -> Result<(), Failure> {
    let line = serde_json::to_string(message).unwrap_or_default();
    let mut stdout = io::stdout().lock();
    let told = writeln!(stdout, "{line}").and_then(|()| stdout.flush());
    told.map_err(|error| Failure::new(Exit::Io, format!("telling the demonstration: {error}")))
}
