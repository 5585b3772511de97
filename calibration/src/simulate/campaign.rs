//! Schedules: the campaign on the turntable, and a temperature run at rest.
//!
//! # The campaign
//! It begins in equilibrium at the first set point. At each set point the chamber ramps, then soaks; `soak_s` includes the
//! ramp. Each position then takes `move_s` for the motion and `dwell_s` at rest. Only the rest gives rows, as many whole
//! periods as fit into it. Each angle of each dwell has a random error.

use super::imu::SimulatedImu;
use super::model::{Chain, Noise, Truth};
use super::motion::Motion;
use super::random::RandomGenerator;
use super::turntable::specific_force;
use crate::positions::{Position, Scheme};
use core::fmt::Write as _;
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::Vector3;
use serde::Serialize;

/// Random stream of the errors of the turntable's angles.
const TURNTABLE_STREAM: u64 = 3;

/// The schedule of a simulated campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CampaignSchedule {
    /// Chamber temperatures, in order \[degC\].
    pub set_points_c: Vec<f64>,
    /// Magnitude of the chamber's ramp, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Time from leaving one set point to the first motion at the next one, ramp included \[s\].
    pub soak_s: f64,
    /// Duration of the motion to a position \[s\].
    pub move_s: f64,
    /// Time at rest in a position \[s\].
    pub dwell_s: f64,
    /// Period of a row \[ns\].
    pub interval_ns: u64,
    /// Positions at each set point, in order. In a position without angles the specific force is the stated one, without tilt
    /// and angle errors.
    #[serde(skip)]
    pub positions: Vec<Position>,
    /// The simulated hardware.
    pub chain: Chain,
    /// Random deviations.
    pub noise: Noise,
}

impl Default for CampaignSchedule {
    /// -25 to 45 degC every 5 degC at 1 degC/min; 70 min of soak, then twelve times 60 s of motion and 300 s at rest in rows
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
    /// Number of rows of a dwell; 0 if the dwell is shorter than the period, or the period is 0.
    fn rows_per_dwell(&self) -> u64 {
        nanoseconds(self.dwell_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// Number of rows of the campaign.
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
    /// The sample that the acquisition latched. Its sequence counts the rows from 0; its time is 0 when the campaign begins.
    pub raw: RawSample,
}

/// A simulated campaign: an iterator over its rows.
#[derive(Clone, Debug)]
pub struct SimulatedCampaign<'a> {
    schedule: &'a CampaignSchedule,
    imu: SimulatedImu,
    angle_noise: RandomGenerator,
    truth: Truth,
    /// Number of dwells that have begun.
    dwells: usize,
    /// Remaining rows of the current dwell.
    rows_left: u64,
    set_point_c: f64,
    position: u32,
    specific_force: [f64; AXES],
}

/// Simulates `schedule` with the IMU that `truth` describes.
#[must_use]
pub fn campaign<'a>(truth: &Truth, schedule: &'a CampaignSchedule, seed: u64) -> SimulatedCampaign<'a> {
    let first = schedule.set_points_c.first().copied().unwrap_or_default();
    SimulatedCampaign {
        schedule,
        imu: SimulatedImu::new(truth, &schedule.chain, &schedule.noise, first, seed),
        angle_noise: RandomGenerator::new(seed, TURNTABLE_STREAM),
        truth: truth.clone(),
        dwells: 0,
        rows_left: 0,
        set_point_c: first,
        position: 0,
        specific_force: [0.0; AXES],
    }
}

impl SimulatedCampaign<'_> {
    /// Begins the next dwell; `None` after the last one.
    fn next_dwell(&mut self) -> Option<()> {
        let (schedule, rows) = (self.schedule, self.schedule.rows_per_dwell());
        let visit = self.dwells.checked_div(schedule.positions.len()).filter(|_| rows > 0)?;
        let position = &schedule.positions[self.dwells % schedule.positions.len()];
        self.set_point_c = *schedule.set_points_c.get(visit)?;
        if self.dwells > 0 {
            self.imu.wait(nanoseconds(schedule.dwell_s) - rows * schedule.interval_ns);
        }
        if self.dwells.is_multiple_of(schedule.positions.len()) {
            self.imu.visit();
            self.imu.go_to(self.set_point_c, schedule.ramp_c_per_s);
            self.imu.wait(nanoseconds(schedule.soak_s));
        }
        self.imu.wait(nanoseconds(schedule.move_s));
        self.position = position.number;
        self.specific_force = self.specific_force_at(position);
        self.dwells += 1;
        self.rows_left = rows;
        Some(())
    }

    /// The specific force \[g0\] at the angles where the turntable comes to rest, their errors included.
    fn specific_force_at(&mut self, position: &Position) -> [f64; AXES] {
        let Some([outer, inner]) = position.angles else {
            let gravity = self.truth.gravity_local / self.truth.table.content().gravity;
            return position.specific_force.map(|f| f * gravity);
        };
        let mut error_deg = || (self.schedule.noise.positioning_rad * self.angle_noise.normal()).to_degrees();
        let (outer, inner) = (outer + error_deg(), inner + error_deg());
        specific_force(&self.truth, outer, inner)
    }
}

impl Iterator for SimulatedCampaign<'_> {
    type Item = SimulatedRow;

    fn next(&mut self) -> Option<SimulatedRow> {
        if self.rows_left == 0 {
            self.next_dwell()?;
        }
        self.rows_left -= 1;
        let raw = self.imu.step(&Motion::of_force(self.specific_force), self.schedule.interval_ns);
        Some(SimulatedRow { set_point_c: self.set_point_c, position: self.position, raw })
    }
}

/// The schedule of a temperature run at rest: hold, ramp, hold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RunSchedule {
    /// Direction of the specific force along A1, A2, A3; its length has no effect. The magnitude is the local gravity.
    pub direction: [f64; AXES],
    /// Chamber temperature at the beginning, in equilibrium \[degC\].
    pub from_c: f64,
    /// Chamber temperature at the end \[degC\].
    pub to_c: f64,
    /// Magnitude of the ramp between them, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Duration of the hold before the ramp, and of the hold after it \[s\].
    pub hold_s: f64,
    /// Control period \[ns\].
    pub interval_ns: u64,
    /// The simulated hardware.
    pub chain: Chain,
    /// Random deviations; the whole run is one visit of a set point.
    pub noise: Noise,
}

impl Default for RunSchedule {
    /// -25 to 45 degC at 20 degC/h, holds of half an hour, 10 samples a second. Every axis measures a part of gravity, A2 a
    /// negative one.
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
    /// Number of samples of the run; 0 if the period is 0.
    #[must_use]
    pub fn samples(&self) -> u64 {
        let ramp_s = if self.from_c == self.to_c { 0.0 } else { (self.to_c - self.from_c).abs() / self.ramp_c_per_s };
        nanoseconds(2.0 * self.hold_s + ramp_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// The specific force along the input axes \[g0\], with the local gravity of `truth`.
    #[must_use]
    pub fn specific_force(&self, truth: &Truth) -> [f64; AXES] {
        let direction = Vector3::from(self.direction);
        (direction * (truth.gravity_local / truth.table.content().gravity / direction.norm())).into()
    }
}

/// A simulated temperature run: an iterator over its samples.
#[derive(Clone, Debug)]
pub struct RunSamples<'a> {
    run: &'a RunSchedule,
    imu: SimulatedImu,
    specific_force: [f64; AXES],
    count: u64,
    /// Index of the sample at whose beginning the ramp starts.
    ramp_start: u64,
}

/// Simulates `run` with the IMU that `truth` describes.
#[must_use]
pub fn run<'a>(truth: &Truth, run: &'a RunSchedule, seed: u64) -> RunSamples<'a> {
    let mut imu = SimulatedImu::new(truth, &run.chain, &run.noise, run.from_c, seed);
    imu.visit();
    let ramp_start = nanoseconds(run.hold_s).checked_div(run.interval_ns).unwrap_or(0);
    RunSamples { run, imu, specific_force: run.specific_force(truth), count: 0, ramp_start }
}

impl Iterator for RunSamples<'_> {
    type Item = RawSample;

    fn next(&mut self) -> Option<RawSample> {
        if self.count == self.run.samples() {
            return None;
        }
        if self.count == self.ramp_start {
            self.imu.go_to(self.run.to_c, self.run.ramp_c_per_s);
        }
        self.count += 1;
        Some(self.imu.step(&Motion::of_force(self.specific_force), self.run.interval_ns))
    }
}

/// The text of a campaign file.
///
/// `samples` is the path of the samples, relative to the campaign file. `gravity_reference` is the value of 1 g0 and
/// `gravity_local` the gravity in the laboratory, both \[m/s2\]. `temperature_unit` is the unit of the telemetry.
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
        // Adding 0 turns -0 into 0.
        let [a1, a2, a3] = specific_force.map(|f| f + 0.0);
        let _ = writeln!(text, "specific_force = [{a1}, {a2}, {a3}]   # along A1, A2, A3, in local gravity");
    }
    text
}

/// Seconds as whole nanoseconds; negative seconds give 0.
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
