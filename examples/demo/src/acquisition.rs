//! The demonstration's acquisition process: sends the samples of the simulated IMU one at a time and evaluates the
//! increments.

use super::imu::{DemoImu, INTERVAL_NS, RampPhase};
use isotherm_client::{Acquisition, ImuId, Options};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::{AXES, CompensatedIncrement};
use isotherm_support::failure::{Exit, Failure};
use serde::{Deserialize, Serialize};
use std::io::{self, Write as _};
use std::time::{Duration, Instant};

/// The stability of the accelerometers is calculated from means over 10 s.
const SAMPLES_PER_MEAN: u32 = (10_000_000_000 / INTERVAL_NS) as u32;
/// That of the gyroscopes is calculated from ten times longer means: in shorter ones their random walk hides the
/// temperature.
const LONGER: usize = 10;
/// Longest time for one answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Longest time until the service uses the new table.
const RELOAD_TIMEOUT: Duration = Duration::from_secs(5);

/// A message from the acquisition process to its parent, one JSON line on stdout.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) enum Message {
    /// Completed part of the run, 0 to 1.
    Progress(f64),
    /// The hot end is reached, and samples continue: the parent installs the new table now.
    Turning,
    /// The run is finished.
    RunOutcome(Box<RunOutcome>),
}

/// The results of the run.
#[derive(Debug, Default, Deserialize, Serialize)]
pub(crate) struct RunOutcome {
    /// Stability while heating, with the first table.
    pub before: ImuStability,
    /// Stability while cooling, with the second table.
    pub after: ImuStability,
    /// Identifiers of the tables that the increments name, in order.
    pub tables: Vec<u64>,
    /// Samples sent.
    pub sent: u64,
    /// Increments received.
    pub answered: u64,
    /// Increments with another sequence than the expected one.
    pub out_of_order: u64,
    /// Increments with any flag except `LATE`.
    pub flagged: u64,
    /// Increments from the request of the reload to the first one with the new table.
    pub during_reload: u64,
    /// Time from the request of the reload to the first increment with the new table \[ns\].
    pub reload_ns: u64,
    /// Round-trip times, sorted \[ns\].
    pub round_trips_ns: Vec<u32>,
}

/// Stability of both triads.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
pub(crate) struct ImuStability {
    /// Output minus specific force \[g0\].
    pub accelerometers: [MeanStability; AXES],
    /// Output minus Earth's rate \[deg/h\].
    pub gyroscopes: [MeanStability; AXES],
}

/// Statistics of means of an output minus its true value, in the unit of the triad.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
pub(crate) struct MeanStability {
    /// Number of means.
    pub means: u32,
    /// Standard deviation.
    pub deviation: f64,
    /// Root mean square about zero.
    pub rms: f64,
}

/// Runs the acquisition with the service that `options` select.
///
/// # Errors
/// If the service does not answer or does not take the new table.
pub(crate) fn run(imu: &ImuId, truth: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let mut run = AcquisitionRun {
        acquisition: Acquisition::connect(imu, options)?,
        imu: DemoImu::new(truth, 1),
        outcome: RunOutcome::default(),
        gravity: truth.content().gravity,
    };
    run.outcome.before = run.ramp(RampPhase::Heating, 0.0)?;
    run.hold_until_reload()?;
    run.outcome.after = run.ramp(RampPhase::Cooling, 0.5)?;
    run.outcome.round_trips_ns.sort_unstable();
    send(&Message::RunOutcome(Box::new(run.outcome)))
}

struct AcquisitionRun {
    acquisition: Acquisition,
    imu: DemoImu,
    outcome: RunOutcome,
    gravity: f64,
}

impl AcquisitionRun {
    /// Sends samples while the chamber heats or cools, until the IMU has reached the end. `done` is the part of the
    /// run, 0 to 1, that was completed before.
    fn ramp(&mut self, phase: RampPhase, done: f64) -> Result<ImuStability, Failure> {
        let mut forces = [const { Vec::new() }; AXES];
        let mut rates = [const { Vec::new() }; AXES];
        let time = f64::from(SAMPLES_PER_MEAN) * INTERVAL_NS as f64 / 1e9;
        let motion = *self.imu.motion();
        // Estimate: a ramp of one hour with 20 % for the lag of the head, in means of 10 s.
        let expected_means = 3600.0 * 1.2 / 10.0;
        while !self.imu.has_arrived(phase) {
            let (mut velocity, mut angle) = ([0.0; AXES], [0.0; AXES]);
            for _ in 0..SAMPLES_PER_MEAN {
                let increment = self.round_trip(phase)?;
                for axis in 0..AXES {
                    velocity[axis] += increment.velocity_increment[axis];
                    angle[axis] += increment.angle_increment[axis];
                }
            }
            for axis in 0..AXES {
                forces[axis].push(velocity[axis] / time / self.gravity - motion.specific_force[axis]);
                // 1 arcsec/s is 1 deg/h.
                let earth_rate = motion.angle[axis] / (INTERVAL_NS as f64 / 1e9);
                rates[axis].push(angle[axis] / ARCSEC / time - earth_rate);
            }
            if forces[0].len() % 8 == 0 {
                send(&Message::Progress(done + 0.5 * (forces[0].len() as f64 / expected_means).min(1.0)))?;
            }
        }
        let longer = |means: &Vec<f64>| {
            let sums = means.chunks_exact(LONGER).map(|means| means.iter().sum::<f64>());
            sums.map(|sum| sum / LONGER as f64).collect::<Vec<_>>()
        };
        Ok(ImuStability {
            accelerometers: forces.each_ref().map(|means| MeanStability::of(means)),
            gyroscopes: rates.each_ref().map(|means| MeanStability::of(&longer(means))),
        })
    }

    /// Holds the temperature and sends samples until the service uses another table.
    fn hold_until_reload(&mut self) -> Result<(), Failure> {
        let old = self.outcome.tables.last().copied();
        send(&Message::Turning)?;
        let requested = Instant::now();
        while self.outcome.tables.last().copied() == old {
            self.round_trip(RampPhase::Holding)?;
            self.outcome.during_reload += 1;
            if requested.elapsed() > RELOAD_TIMEOUT {
                return Err(Failure::new(Exit::Failed, "the service did not take the new table"));
            }
        }
        self.outcome.reload_ns = requested.elapsed().as_nanos() as u64;
        Ok(())
    }

    fn round_trip(&mut self, phase: RampPhase) -> Result<CompensatedIncrement, Failure> {
        let mut raw = self.acquisition.loan()?;
        self.imu.step(phase, &mut raw);
        self.outcome.sent += 1;
        let sent = Instant::now();
        let increment = self.acquisition.compensate(raw, ANSWER_TIMEOUT);
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

fn send(message: &Message) -> Result<(), Failure> {
    let line = serde_json::to_string(message).unwrap_or_default();
    let mut stdout = io::stdout().lock();
    let written = writeln!(stdout, "{line}").and_then(|()| stdout.flush());
    written.map_err(|error| Failure::new(Exit::Io, format!("sending to the demonstration: {error}")))
}
