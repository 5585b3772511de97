//! `simulate`: data of an IMU with known coefficients, and a whole simulated station.

mod memory;
mod options;
mod ramp;
mod rows;
mod station;

use crate::commands::simulate::rows::{AttitudeDocument, Columns, reachable, write_rows};
use clap::{Args, Subcommand};
use isotherm_campaign::Scheme;
use isotherm_client::Domain;
use isotherm_offline::parse::{
    Rates, SetPoints, direction, interval, numbers, one_of, rates, seconds, set_points, size,
};
use isotherm_service::commands::no_domain;
use isotherm_shared::wire::AXES;
use isotherm_simulation as simulation;
use isotherm_simulation::{CampaignSchedule, RampSchedule, RunSchedule, Truth, TurnSchedule};
use isotherm_support::failure::Failure;
use options::{SimulatedFiles, SimulatedImuOptions, arcsec, truth_toml, usage};
use ramp::{RATES, RampDocument, RampRecordings};
use serde::Serialize;
use std::time::Duration;

/// Number of the first turn: behind those of the positions.
const FIRST_TURN: u32 = 13;
/// Angle of a turn unless another is given: twice around \[deg\].
const WHOLE_TURNS_DEG: f64 = 720.0;

/// Simulate an IMU with known coefficients
///
/// Makes a campaign, ramps or a temperature run of a simulated IMU with known coefficients, or runs a simulated
/// laboratory.
///
/// The true coefficients are written to truth.toml, next to the data.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    after_help = "Examples:\n  isotherm simulate campaign -o campaign\n  isotherm simulate ramp -o ramps --lag 240 --transient 35,-20,12\n  isotherm simulate run -o run"
)]
pub(crate) struct Simulate {
    #[command(subcommand)]
    simulation: Simulation,
}

#[derive(Debug, Subcommand)]
enum Simulation {
    #[command(arg = no_domain())]
    Campaign(SimulateCampaign),
    #[command(arg = no_domain())]
    Ramp(ramp::SimulateRamp),
    #[command(arg = no_domain())]
    Run(SimulateRun),
    Station(station::SimulateStation),
    #[command(hide = true)]
    StationPart(station::StationPart),
}

/// Simulate a campaign on a turntable
///
/// Simulates a two-axis turntable in a temperature chamber. Writes campaign.toml, samples.csv and truth.toml, and with
/// --ramps also ramps.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate campaign -o campaign\n  isotherm simulate campaign -o hundred --vary --seed 100 --set-points -20:40:10 --positions six-faces-six-edges\n  isotherm simulate campaign -o fast --interval 0.01 --temperature-every 1 --vibration 0.01,35\n  isotherm simulate campaign -o whole --gyroscopes --latitude -33.9\n  isotherm simulate campaign -o moving --lag 240 --transient 35,-20,12 --ramps"
)]
struct SimulateCampaign {
    #[command(flatten)]
    imu: SimulatedImuOptions,
    /// Choose the positions at each set point
    #[arg(long, value_name = "NAME", default_value = Scheme::NAMES[0].1, value_parser = one_of(Scheme::NAMES))]
    positions: Scheme,
    /// Set the set points of the chamber [degC]
    ///
    /// Both ends are included.
    #[arg(long, value_name = "FROM:TO:STEP", default_value = "-25:45:5", allow_hyphen_values = true, value_parser = set_points)]
    set_points: SetPoints,
    /// Set the soak time per set point [s]
    ///
    /// The time from leaving a set point to the first move at the next one, including the ramp of 1 degC/min
    #[arg(long, value_name = "S", default_value = "4200", value_parser = seconds)]
    soak: Duration,
    /// Set the dwell time in each position [s]
    #[arg(long, value_name = "S", default_value = "300", value_parser = seconds)]
    dwell: Duration,
    /// Set the interval of the rows [s]
    #[arg(long, value_name = "S", default_value = "10", value_parser = interval)]
    interval: Duration,
    /// Tilt the turntable's base [arcsec]
    ///
    /// About the laboratory's X and Y. Default: 8.3,-12.4, unless --vary draws it.
    #[arg(long, value_name = "TX,TY", allow_hyphen_values = true, value_parser = numbers::<2>)]
    tilt: Option<[f64; 2]>,
    /// Set the error of the angles [arcsec]
    ///
    /// One sigma, drawn for each dwell
    #[arg(long, value_name = "ARCSEC", default_value_t = 1.0, value_parser = size)]
    positioning: f64,
    /// Set the angle of the turns [deg]
    ///
    /// Of the six turns at each set point. Default: 720. Only with gyroscopes.
    #[arg(long, value_name = "DEG", value_parser = one_of([(360.0, "360"), (720.0, "720")]))]
    turn_angle: Option<f64>,
    /// Add ramps at these rates [degC/h]
    ///
    /// The ramps run from the first set point to the last and back, with A3 up and holds of 1800 s. Each rate has a
    /// file: ramp-1.csv and so on
    #[arg(long, value_name = "R1,R2", num_args = 0..=1, default_missing_value = RATES, value_parser = rates)]
    ramps: Option<Rates>,
    /// Set the interval of temperature readings [s]
    ///
    /// 0 gives a reading in every row.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = size)]
    temperature_every: f64,
}

/// Simulate a temperature run at rest
///
/// The temperature rises from cold to hot, and with --both-ways it also falls again. Writes run.csv and truth.toml.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm simulate run -o run\n  isotherm simulate run -o run --truth campaign/truth.toml --seed 2\n  isotherm simulate run -o fast --interval 0.01 --temperature-every 1 --ramp 60\n  isotherm simulate run -o whole --gyroscopes\n  isotherm simulate run -o moving --lag 240 --transient 35,-20,12 --both-ways"
)]
struct SimulateRun {
    #[command(flatten)]
    imu: SimulatedImuOptions,
    /// Set the control period [s]
    #[arg(long, value_name = "S", default_value = "0.1", value_parser = interval)]
    interval: Duration,
    /// Set the direction of the specific force
    ///
    /// Along A1, A2, A3. The magnitude of the vector does not matter.
    #[arg(long, value_name = "A1,A2,A3", default_value = "0.60,-0.48,0.64", allow_hyphen_values = true, value_parser = direction)]
    attitude: [f64; AXES],
    /// Set the first and last temperature [degC]
    #[arg(long, value_name = "FROM,TO", default_value = "-25,45", allow_hyphen_values = true, value_parser = numbers::<2>)]
    temperatures: [f64; 2],
    /// Set the ramp of the chamber [degC/h]
    #[arg(long, value_name = "DEGC/H", default_value_t = 20.0, value_parser = isotherm_offline::parse::ramp)]
    ramp: f64,
    /// Also ramp back, and hold again
    ///
    /// The run then has heating and cooling.
    #[arg(long)]
    both_ways: bool,
    /// Set the hold before and after ramps [s]
    ///
    /// The chamber holds before the first ramp, and after each ramp
    #[arg(long, value_name = "S", default_value = "1800", value_parser = seconds)]
    hold: Duration,
    /// Set the interval of temperature readings [s]
    ///
    /// 0 gives a reading in every row.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = size)]
    temperature_every: f64,
}

impl Simulate {
    /// Whether the command writes files, ends by itself and handles no signals of its own.
    pub(crate) fn writes_and_ends(&self) -> bool {
        matches!(self.simulation, Simulation::Campaign(_) | Simulation::Ramp(_) | Simulation::Run(_))
    }

    pub(crate) fn run(self, domain: &Domain) -> Result<(), Failure> {
        match self.simulation {
            Simulation::Campaign(campaign) => campaign.run(),
            Simulation::Ramp(ramp) => ramp.run(),
            Simulation::Run(run) => run.run(),
            Simulation::Station(station) => station.run(domain),
            Simulation::StationPart(part) => part.run(domain.clone()),
        }
    }
}

impl SimulateCampaign {
    fn run(self) -> Result<(), Failure> {
        let mut truth = self.imu.truth()?;
        if let Some(tilt) = self.tilt {
            truth.tilt_rad = tilt.map(arcsec);
        }
        let gyroscopes = truth.table.content().gyroscopes.is_some();
        if self.turn_angle.is_some() && !gyroscopes {
            return Err(usage("--turn-angle: without gyroscopes there are no turns; give --gyroscopes too"));
        }
        let (chain, mut noise) = self.imu.chain_and_noise(&truth, self.temperature_every)?;
        noise.positioning_rad = arcsec(self.positioning);
        let schedule = CampaignSchedule {
            set_points_c: self.set_points.0,
            soak_s: self.soak.as_secs_f64(),
            dwell_s: self.dwell.as_secs_f64(),
            interval_ns: self.interval.as_nanos() as u64,
            turns: gyroscopes.then(|| TurnSchedule::six_turns(FIRST_TURN, self.turn_angle.unwrap_or(WHOLE_TURNS_DEG))),
            positions: self.positions.positions(),
            chain,
            noise,
            ..CampaignSchedule::default()
        };
        reachable(&truth, &chain, &schedule.set_points_c)?;
        if self.interval > self.dwell {
            return Err(usage("the interval is longer than the dwell; no row would fit"));
        }
        let step_c = schedule.set_points_c.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        if step_c / schedule.ramp_c_per_s >= schedule.soak_s {
            return Err(usage("the chamber would still be ramping when the soak ends; give a longer --soak"));
        }
        let ramps = self.ramps.as_ref().map(|rates| ramps_beside(&truth, &schedule, rates)).transpose()?;
        let SimulatedImuOptions { output, seed, .. } = &self.imu;
        let rows = simulation::campaign(&truth, &schedule, *seed)
            .map(|row| (format!("{},{}", row.set_point_c, row.position), row.raw));
        let columns = Columns { leading: "set_point_c,position", ..Columns::of(&truth, &chain) };
        let mut files = SimulatedFiles::default();
        write_rows(output, "samples.csv", columns, schedule.rows(), rows, &mut files)?;
        #[derive(Serialize)]
        struct CampaignDocument<'a> {
            #[serde(flatten)]
            campaign: &'a CampaignSchedule,
            #[serde(skip_serializing_if = "Vec::is_empty")]
            ramps: Vec<RampDocument<'a>>,
        }
        let mut document = CampaignDocument { campaign: &schedule, ramps: Vec::new() };
        let mut text = schedule.campaign_toml(&truth, "samples.csv");
        if let Some(ramps) = &ramps {
            ramps.write(&truth, output, *seed, &mut files)?;
            document.ramps = ramps.documents(&truth);
            ramps.ramps().iter().for_each(|ramp| text += &format!("\n{}", ramp.to_toml()));
        }
        let truth_text = truth_toml(&truth, "isotherm simulate campaign", *seed, &document)?;
        files.add(output.join("truth.toml"), &truth_text)?;
        files.add(output.join("campaign.toml"), &text)?;
        files.finish()
    }
}

impl SimulateRun {
    fn run(self) -> Result<(), Failure> {
        let truth = self.imu.truth()?;
        let (chain, noise) = self.imu.chain_and_noise(&truth, self.temperature_every)?;
        let [from_c, to_c] = self.temperatures;
        let run = RunSchedule {
            legs: if self.both_ways { 2 } else { 1 },
            direction: self.attitude,
            from_c,
            to_c,
            ramp_c_per_s: self.ramp / 3600.0,
            hold_s: self.hold.as_secs_f64(),
            interval_ns: self.interval.as_nanos() as u64,
            chain,
            noise,
        };
        reachable(&truth, &chain, &self.temperatures)?;
        #[derive(Serialize)]
        struct RunDocument<'a> {
            #[serde(flatten)]
            attitude: AttitudeDocument,
            #[serde(flatten)]
            run: &'a RunSchedule,
        }
        let schedule = RunDocument { attitude: AttitudeDocument::of(&truth, &run), run: &run };
        let SimulatedImuOptions { output, seed, .. } = &self.imu;
        let rows = simulation::run(&truth, &run, *seed).map(|raw| ("", raw));
        let mut files = SimulatedFiles::default();
        write_rows(output, "run.csv", Columns::of(&truth, &chain), run.samples(), rows, &mut files)?;
        let text = truth_toml(&truth, "isotherm simulate run", *seed, &schedule)?;
        files.add(output.join("truth.toml"), &text)?;
        files.finish()
    }
}

/// The ramps next to the positions of `schedule`.
fn ramps_beside(truth: &Truth, schedule: &CampaignSchedule, rates: &Rates) -> Result<RampRecordings, Failure> {
    let CampaignSchedule { interval_ns, chain, noise, .. } = *schedule;
    let mut ends_c = schedule.set_points_c.iter().copied();
    let from_c = ends_c.next().unwrap_or_default();
    let to_c = ends_c.next_back().unwrap_or(from_c);
    let run = RunSchedule { from_c, to_c, interval_ns, chain, noise, ..RampSchedule::default().run };
    RampRecordings::new(truth, run, rates)
}
