//! `simulate ramp`: recordings of a stay each that warms and cools; `simulate campaign --ramps` makes them next to its
//! positions.

use super::options::{SimulatedFiles, SimulatedImuOptions, truth_toml, usage};
use super::rows::{AttitudeDocument, Columns, reachable, write_rows};
use clap::Args;
use isotherm_campaign::Ramp;
use isotherm_offline::parse::{Rates, direction, interval, numbers, rates, seconds, size};
use isotherm_shared::wire::AXES;
use isotherm_simulation as simulation;
use isotherm_simulation::{RampSchedule, RunSchedule, Truth};
use isotherm_support::failure::Failure;
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// Rates of the ramps unless others are given \[degC/h\].
pub(super) const RATES: &str = "20,70";

/// Simulate ramps at rest, which show transients
///
/// The chamber ramps up and down. Writes campaign.toml, a recording for each rate (ramp-1.csv and so on), table.toml
/// and truth.toml.
///
/// Each recording is complete: hold, up, hold, down, hold. The campaign file has only the ramps. table.toml is the
/// static part of the truth, and provides what ramps do not show.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate ramp -o ramps --lag 240 --transient 35,-20,12\n  isotherm simulate ramp -o slow --lag 600 --transient 35,0,12 --rate 10,20,40 --hold 3600 --attitude 0.36,-0.48,0.8\n  isotherm simulate ramp -o play --play 0.2 --hysteresis -60,40,20\n  isotherm simulate ramp -o whole --gyroscopes --lag 240 --transient 35,-20,12 --gyroscope-transient 0.5,-0.3,0"
)]
pub(super) struct SimulateRamp {
    #[command(flatten)]
    imu: SimulatedImuOptions,
    /// Ramp the chamber at these rates [degC/h]
    ///
    /// Each rate makes a recording with a ramp up and a ramp down
    #[arg(long, value_name = "R1,R2", default_value = RATES, value_parser = rates)]
    rate: Rates,
    /// Set the hold before and after ramps [s]
    ///
    /// The chamber holds before the first ramp, and after each ramp
    #[arg(long, value_name = "S", default_value = "1800", value_parser = seconds)]
    hold: Duration,
    /// Set the interval of the rows [s]
    #[arg(long, value_name = "S", default_value = "10", value_parser = interval)]
    interval: Duration,
    /// Set the direction of the specific force
    ///
    /// Along A1, A2, A3. The magnitude of the vector does not matter.
    #[arg(long, value_name = "A1,A2,A3", default_value = "0,0,1", allow_hyphen_values = true, value_parser = direction)]
    attitude: [f64; AXES],
    /// Ramp between these temperatures [degC]
    ///
    /// The chamber begins and ends at the first temperature
    #[arg(long, value_name = "FROM,TO", default_value = "-25,45", allow_hyphen_values = true, value_parser = numbers::<2>)]
    temperatures: [f64; 2],
    /// Set the interval of temperature readings [s]
    ///
    /// 0 gives a reading in every row.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = size)]
    temperature_every: f64,
}

impl SimulateRamp {
    pub(super) fn run(self) -> Result<(), Failure> {
        let truth = self.imu.truth()?;
        let (chain, noise) = self.imu.chain_and_noise(&truth, self.temperature_every)?;
        let [from_c, to_c] = self.temperatures;
        let run = RunSchedule {
            direction: self.attitude,
            from_c,
            to_c,
            hold_s: self.hold.as_secs_f64(),
            interval_ns: self.interval.as_nanos() as u64,
            chain,
            noise,
            ..RampSchedule::default().run
        };
        let recordings = RampRecordings::new(&truth, run, &self.rate)?;
        let SimulatedImuOptions { output, seed, .. } = &self.imu;
        let mut files = SimulatedFiles::default();
        recordings.write(&truth, output, *seed, &mut files)?;
        files.add(output.join("table.toml"), &truth.static_table().to_toml())?;
        #[derive(Serialize)]
        struct RampsDocument<'a> {
            ramps: Vec<RampDocument<'a>>,
        }
        let schedule = RampsDocument { ramps: recordings.documents(&truth) };
        files.add(output.join("truth.toml"), &truth_toml(&truth, "isotherm simulate ramp", *seed, &schedule)?)?;
        let text = simulation::ramps_toml(&truth, "table.toml", &recordings.ramps());
        files.add(output.join("campaign.toml"), &text)?;
        files.finish()
    }
}

/// Recordings of one IMU, each with the name of its file.
pub(super) struct RampRecordings(Vec<(String, RampSchedule)>);

impl RampRecordings {
    /// Those of `run` at each of the rates.
    pub(super) fn new(truth: &Truth, run: RunSchedule, rates: &Rates) -> Result<Self, Failure> {
        let ends_c = [run.from_c, run.to_c];
        reachable(truth, &run.chain, &ends_c)?;
        if ends_c[0] == ends_c[1] {
            return Err(usage("a ramp leads from one temperature to another; give two"));
        }
        let schedule = RampSchedule { run, ..RampSchedule::default() };
        let recording = |(number, rate): (u64, &f64)| {
            let mut schedule = schedule;
            schedule.run.ramp_c_per_s = rate / 3600.0;
            (format!("ramp-{number}.csv"), schedule)
        };
        Ok(Self((1..).zip(&rates.0).map(recording).collect()))
    }

    /// Simulates and writes them.
    pub(super) fn write(
        &self,
        truth: &Truth,
        folder: &Path,
        seed: u64,
        files: &mut SimulatedFiles,
    ) -> Result<(), Failure> {
        for (number, (name, schedule)) in (1..).zip(&self.0) {
            let rows = simulation::ramp(truth, schedule, simulation::ramp_seed(seed, number)).map(|raw| ("", raw));
            let columns = Columns::of(truth, &schedule.run.chain);
            write_rows(folder, name, columns, schedule.run.samples(), rows, files)?;
        }
        Ok(())
    }

    /// Their part of the campaign file.
    pub(super) fn ramps(&self) -> Vec<Ramp> {
        self.0.iter().map(|(name, schedule)| schedule.ramp(name)).collect()
    }

    /// Their part of truth.toml.
    pub(super) fn documents(&self, truth: &Truth) -> Vec<RampDocument<'_>> {
        let documents = self.0.iter().map(|(samples, schedule)| RampDocument {
            samples,
            attitude: AttitudeDocument::of(truth, &schedule.run),
            schedule,
        });
        documents.collect()
    }
}

/// What truth.toml says of a recording.
#[derive(Serialize)]
pub(super) struct RampDocument<'a> {
    samples: &'a str,
    #[serde(flatten)]
    attitude: AttitudeDocument,
    #[serde(flatten)]
    schedule: &'a RampSchedule,
}
