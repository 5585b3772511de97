//! The schedule of a temperature run at rest: hold, ramp, hold.

use super::campaign::nanoseconds;
use super::chain::{Chain, Noise};
use super::imu::SimulatedImu;
use super::model::Truth;
use super::motion::InertialMotion;
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::Vector3;
use serde::Serialize;

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

    /// Outer and inner angle \[deg\] at which the base's tilt gives this direction. At an attitude with the inner axis vertical, which a tilted
    /// base may not reach, those that come nearest.
    #[must_use]
    pub fn angles_deg(&self, truth: &Truth) -> [f64; 2] {
        let direction = Vector3::from(self.direction).normalize();
        let [tx, ty] = truth.tilt_rad;
        let up = Vector3::new(-ty, tx, 1.0).normalize();
        // R' up = direction; its third row is up_z cos(outer) - up_y sin(outer) = direction_z.
        let size = up.y.hypot(up.z);
        let outer = (direction.z / size).clamp(-1.0, 1.0).acos() - up.y.atan2(up.z);
        let (sine, cosine) = outer.sin_cos();
        // Rx(outer)' up, which the inner angle turns into the direction.
        let before_inner = [up.x, up.y * cosine + up.z * sine];
        let inner = before_inner[1].atan2(before_inner[0]) - direction.y.atan2(direction.x);
        [outer.to_degrees(), inner.to_degrees().rem_euclid(360.0)]
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
    motion: InertialMotion,
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
    let at_rest = InertialMotion::at_rest(truth, run.angles_deg(truth), run.interval_ns as f64 / 1e9);
    let motion = InertialMotion { specific_force: run.specific_force(truth), ..at_rest };
    RunSamples { run, imu, motion, count: 0, ramp_start }
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
        Some(self.imu.step(&self.motion, self.run.interval_ns))
    }
}
