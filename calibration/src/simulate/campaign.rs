//! Schedules: the campaign on the turntable, and a temperature run at rest.
//!
//! # The campaign
//! It begins in equilibrium at the first set point. At each set point the chamber ramps, then soaks; `soak_s` counts from
//! the moment it leaves the last set point. Then for each position `move_s` of moving and `dwell_s` of rest; only the rest
//! gives rows, as many whole periods as fit. Each angle has its error.

use super::imu::SimulatedImu;
use super::turntable::specific_force;
use super::{Chain, Noise, Random, Truth};
use crate::positions::{Position, Scheme};
use core::fmt::Write as _;
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::Vector3;
use serde::Serialize;

/// The stream of a seed for the turntable.
const TURNTABLE: u64 = 3;

/// How a campaign goes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CampaignSchedule {
    /// SimulatedChamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// The chamber's ramp, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// From leaving one set point to the first move at the next, ramp included \[s\].
    pub soak_s: f64,
    /// What moving to a position takes \[s\].
    pub move_s: f64,
    /// Rest in a position \[s\].
    pub dwell_s: f64,
    /// Period of a row \[ns\].
    pub interval_ns: u64,
    /// Positions at each set point, in order. One without angles is taken as its specific force says, without tilt and error.
    #[serde(skip)]
    pub positions: Vec<Position>,
    /// The hardware.
    pub chain: Chain,
    /// What differs each time.
    pub noise: Noise,
}

impl Default for CampaignSchedule {
    /// -25 to 45 degC every 5 degC at 1 degC/min; 70 min of soak, then twelve times 60 s of moving and 300 s of rest in rows
    /// of 10 s.
    fn default() -> Self {
        Self {
            set_points_c: (-5..=9).map(|step| 5.0 * f64::from(step)).collect(),
            ramp_c_per_s: 1.0 / 60.0,
            soak_s: 4200.0,
            move_s: 60.0,
            dwell_s: 300.0,
            interval_ns: 10_000_000_000,
            positions: Scheme::SixFacesTwoHeadings.positions(),
            chain: Chain::default(),
            noise: Noise::default(),
        }
    }
}

impl CampaignSchedule {
    /// Rows of a dwell; none if the dwell is shorter than the period, or the period 0.
    fn rows_per_dwell(&self) -> u64 {
        nanoseconds(self.dwell_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// Rows of the campaign.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.set_points_c.len() as u64 * self.positions.len() as u64 * self.rows_per_dwell()
    }
}

/// A row of a campaign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatedRow {
    /// Set point of the chamber \[degC\].
    pub set_point_c: f64,
    /// Number of the position.
    pub position: u32,
    /// What the acquisition latched; the sequence counts the rows from 0, the time the campaign from 0.
    pub raw: RawSample,
}

/// The rows of a campaign, one after the other.
#[derive(Clone, Debug)]
pub struct SimulatedCampaign<'a> {
    plan: &'a CampaignSchedule,
    imu: SimulatedImu,
    turntable: Random,
    truth: Truth,
    /// Dwells that have begun.
    dwells: usize,
    /// Rows left of this one.
    left: u64,
    set_point_c: f64,
    position: u32,
    specific_force: [f64; AXES],
}

/// Lets the IMU that `truth` describes through `plan`.
#[must_use]
pub fn campaign<'a>(truth: &Truth, plan: &'a CampaignSchedule, seed: u64) -> SimulatedCampaign<'a> {
    let first = plan.set_points_c.first().copied().unwrap_or_default();
    SimulatedCampaign {
        plan,
        imu: SimulatedImu::new(truth, &plan.chain, &plan.noise, first, seed),
        turntable: Random::new(seed, TURNTABLE),
        truth: truth.clone(),
        dwells: 0,
        left: 0,
        set_point_c: first,
        position: 0,
        specific_force: [0.0; AXES],
    }
}

impl SimulatedCampaign<'_> {
    /// Moves on; `None` at the end.
    fn next_dwell(&mut self) -> Option<()> {
        let (plan, rows) = (self.plan, self.plan.rows_per_dwell());
        let visit = self.dwells.checked_div(plan.positions.len()).filter(|_| rows > 0)?;
        let position = &plan.positions[self.dwells % plan.positions.len()];
        self.set_point_c = *plan.set_points_c.get(visit)?;
        if self.dwells > 0 {
            self.imu.wait(nanoseconds(plan.dwell_s) - rows * plan.interval_ns);
        }
        if self.dwells.is_multiple_of(plan.positions.len()) {
            self.imu.visit();
            self.imu.go_to(self.set_point_c, plan.ramp_c_per_s);
            self.imu.wait(nanoseconds(plan.soak_s));
        }
        self.imu.wait(nanoseconds(plan.move_s));
        self.position = position.number;
        self.specific_force = self.at(position);
        self.dwells += 1;
        self.left = rows;
        Some(())
    }

    /// The specific force where the turntable comes to rest \[g0\].
    fn at(&mut self, position: &Position) -> [f64; AXES] {
        let Some([outer, inner]) = position.angles else {
            let gravity = self.truth.gravity_local / self.truth.table.content().gravity;
            return position.specific_force.map(|f| f * gravity);
        };
        let mut missed = || (self.plan.noise.positioning_rad * self.turntable.normal()).to_degrees();
        let (outer, inner) = (outer + missed(), inner + missed());
        specific_force(&self.truth, outer, inner)
    }
}

impl Iterator for SimulatedCampaign<'_> {
    type Item = SimulatedRow;

    fn next(&mut self) -> Option<SimulatedRow> {
        if self.left == 0 {
            self.next_dwell()?;
        }
        self.left -= 1;
        let raw = self.imu.step(&self.specific_force, self.plan.interval_ns);
        Some(SimulatedRow { set_point_c: self.set_point_c, position: self.position, raw })
    }
}

/// How a temperature run at rest goes: hold, ramp, hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RunSchedule {
    /// Direction of the specific force along A1, A2, A3; a unit vector. Its size is the local gravity.
    pub direction: [f64; AXES],
    /// SimulatedChamber at the beginning, in equilibrium \[degC\].
    pub from_c: f64,
    /// SimulatedChamber at the end \[degC\].
    pub to_c: f64,
    /// The ramp between them, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Before the ramp, and again after it \[s\].
    pub hold_s: f64,
    /// Control period \[ns\].
    pub interval_ns: u64,
    /// The hardware.
    pub chain: Chain,
    /// What differs each time; the run is one visit.
    pub noise: Noise,
}

impl Default for RunSchedule {
    /// -25 to 45 degC at 20 degC/h, half an hour of holding at the ends, 10 samples a second, every axis with a part of
    /// gravity, A2 with a negative one.
    fn default() -> Self {
        Self {
            direction: [0.6, -0.48, 0.64],
            from_c: -25.0,
            to_c: 45.0,
            ramp_c_per_s: 20.0 / 3600.0,
            hold_s: 1800.0,
            interval_ns: 100_000_000,
            chain: Chain::default(),
            noise: Noise::default(),
        }
    }
}

impl RunSchedule {
    /// Samples of the run; none if the period is 0.
    #[must_use]
    pub fn samples(&self) -> u64 {
        let ramp_s = if self.from_c == self.to_c { 0.0 } else { (self.to_c - self.from_c).abs() / self.ramp_c_per_s };
        nanoseconds(2.0 * self.hold_s + ramp_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// The specific force \[g0\] under `truth`.
    #[must_use]
    pub fn specific_force(&self, truth: &Truth) -> [f64; AXES] {
        let direction = Vector3::from(self.direction);
        (direction * (truth.gravity_local / truth.table.content().gravity / direction.norm())).into()
    }
}

/// The samples of a run, one after the other.
#[derive(Clone, Debug)]
pub struct RunSamples<'a> {
    run: &'a RunSchedule,
    imu: SimulatedImu,
    specific_force: [f64; AXES],
    count: u64,
    /// The sample at whose beginning the chamber leaves.
    leaves: u64,
}

/// Lets the IMU that `truth` describes through `run`.
#[must_use]
pub fn run<'a>(truth: &Truth, run: &'a RunSchedule, seed: u64) -> RunSamples<'a> {
    let mut imu = SimulatedImu::new(truth, &run.chain, &run.noise, run.from_c, seed);
    imu.visit();
    let leaves = nanoseconds(run.hold_s).checked_div(run.interval_ns).unwrap_or(0);
    RunSamples { run, imu, specific_force: run.specific_force(truth), count: 0, leaves }
}

impl Iterator for RunSamples<'_> {
    type Item = RawSample;

    fn next(&mut self) -> Option<RawSample> {
        if self.count == self.run.samples() {
            return None;
        }
        if self.count == self.leaves {
            self.imu.go_to(self.run.to_c, self.run.ramp_c_per_s);
        }
        self.count += 1;
        Some(self.imu.step(&self.specific_force, self.run.interval_ns))
    }
}

/// The text of the file that describes a campaign's samples.
///
/// `samples` is their file, relative to this one; `gravity_reference` is 1 g0 and `gravity_local` that of the laboratory,
/// both \[m/s2\]; `temperature_unit` is the telemetry's.
#[must_use]
pub fn campaign_toml(
    imu: &str,
    samples: &str,
    gravity_reference: f64,
    gravity_local: f64,
    temperature_unit: &str,
    positions: &[Position],
) -> String {
    let quoted = |text: &str| toml::Value::from(text).to_string();
    let mut text = format!(
        "format = 1\nimu = \"{imu}\"\nsamples = {}\n\
         gravity_reference = {gravity_reference}   # m/s2, the value of 1 g0\n\
         gravity_local = {gravity_local}   # m/s2, at the station\n\
         temperature_unit = {}\n",
        quoted(samples),
        quoted(temperature_unit)
    );
    for Position { number, label, angles, specific_force } in positions {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n[[position]]\nnumber = {number}\nup = {}\n", quoted(label));
        if let Some([outer, inner]) = angles {
            let _ = writeln!(text, "outer_deg = {outer}\ninner_deg = {inner}");
        }
        // -0 is 0.
        let [a1, a2, a3] = specific_force.map(|f| f + 0.0);
        let _ = writeln!(text, "specific_force = [{a1}, {a2}, {a3}]   # along A1, A2, A3, in local gravity");
    }
    text
}

/// Seconds as nanoseconds; negative ones are 0.
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
