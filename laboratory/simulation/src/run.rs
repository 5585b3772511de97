//! The schedule of a temperature run at rest: hold, ramp, hold; and back again.

use super::campaign::nanoseconds;
use crate::chain::{Chain, Noise};
use crate::imu::SimulatedImu;
use crate::model::Truth;
use crate::motion::InertialMotion;
use crate::turntable::specific_force;
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::Vector3;
use serde::Serialize;

/// The schedule of a temperature run at rest: hold, ramp, hold; and back again as often as it says.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RunSchedule {
    /// Direction of the specific force along A1, A2, A3; its length has no effect. The magnitude is the local gravity.
    pub direction: [f64; AXES],
    /// Chamber temperature at the beginning, in equilibrium \[degC\].
    pub from_c: f64,
    /// Chamber temperature at the end of the first ramp \[degC\].
    pub to_c: f64,
    /// Magnitude of the ramp between them, over 0 \[degC/s\].
    pub ramp_c_per_s: f64,
    /// Number of ramps: 1 from `from_c` to `to_c`, 2 also back again, and so on.
    #[serde(skip_serializing_if = "is_one")]
    pub legs: u32,
    /// Duration of the hold before the first ramp, and of the hold after each \[s\].
    pub hold_s: f64,
    /// Control period \[ns\].
    pub interval_ns: u64,
    /// The simulated hardware.
    pub chain: Chain,
    /// Random deviations; the whole run is one visit of a set point.
    pub noise: Noise,
}

impl Default for RunSchedule {
    /// Once from -25 to 45 degC at 20 degC/h, holds of half an hour, 10 samples a second. Every axis measures a part of
    /// gravity, A2 a negative one.
    fn default() -> Self {
        Self {
            direction: [0.6, -0.48, 0.64],
            from_c: -25.0,
            to_c: 45.0,
            ramp_c_per_s: 20.0 / 3600.0,
            legs: 1,
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
        self.whole_periods(f64::from(self.legs) * (self.ramp_s() + self.hold_s) + self.hold_s)
    }

    /// Index of the sample at whose beginning a ramp starts, counted from 0.
    fn start(&self, leg: u32) -> u64 {
        self.whole_periods(self.hold_s + f64::from(leg) * (self.ramp_s() + self.hold_s))
    }

    /// Duration of a ramp \[s\].
    fn ramp_s(&self) -> f64 {
        if self.from_c == self.to_c { 0.0 } else { (self.to_c - self.from_c).abs() / self.ramp_c_per_s }
    }

    fn whole_periods(&self, time_s: f64) -> u64 {
        nanoseconds(time_s).checked_div(self.interval_ns).unwrap_or(0)
    }

    /// Outer and inner angle \[deg\] at which the base's tilt gives this direction. At an attitude with the inner axis
    /// vertical, which a tilted base may not reach, those that come nearest.
    #[must_use]
    pub fn angles_deg(&self, truth: &Truth) -> [f64; 2] {
        let direction = Vector3::from(self.direction).normalize();
        let [tx, ty] = truth.tilt_rad;
        let up = Vector3::new(-ty, tx, 1.0).normalize();
        // R' up = direction; its third row is up_z cos(outer) - up_y sin(outer) = direction_z.
        let size = libm::hypot(up.y, up.z);
        let outer = libm::acos((direction.z / size).clamp(-1.0, 1.0)) - libm::atan2(up.y, up.z);
        let (sine, cosine) = libm::sincos(outer);
        // Rx(outer)' up, which the inner angle turns into the direction.
        let before_inner = [up.x, up.y * cosine + up.z * sine];
        let inner = libm::atan2(before_inner[1], before_inner[0]) - libm::atan2(direction.y, direction.x);
        [outer.to_degrees(), inner.to_degrees().rem_euclid(360.0)]
    }

    /// The specific force along the input axes \[g0\], with the local gravity of `truth`.
    #[must_use]
    pub fn specific_force(&self, truth: &Truth) -> [f64; AXES] {
        let direction = Vector3::from(self.direction);
        (direction * (truth.gravity_local / truth.table.content().gravity / direction.norm())).into()
    }
}

/// Whether there is one ramp, of which truth.toml says nothing.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde gives a reference")]
const fn is_one(legs: &u32) -> bool {
    *legs == 1
}

/// A simulated temperature run or ramp recording: an iterator over its samples.
#[derive(Clone, Debug)]
pub struct RunSamples<'a> {
    run: &'a RunSchedule,
    imu: SimulatedImu,
    motion: InertialMotion,
    tilt_drift: Option<TiltDrift>,
    count: u64,
    /// Number of ramps that have begun.
    legs: u32,
}

/// A base whose tilt drifts.
#[derive(Clone, Debug)]
struct TiltDrift {
    truth: Truth,
    /// Over the whole recording \[rad\].
    drift_rad: [f64; 2],
    angles_deg: [f64; 2],
}

impl TiltDrift {
    /// What the drift adds to the specific force along the input axes \[g0\] after this part of the recording.
    fn added(&self, part: f64) -> Vector3<f64> {
        let [outer, inner] = self.angles_deg;
        let force = |truth: &Truth| Vector3::from(specific_force(truth, outer, inner));
        let tilt_rad = [0, 1].map(|i| self.truth.tilt_rad[i] + self.drift_rad[i] * part);
        force(&Truth { tilt_rad, ..self.truth.clone() }) - force(&self.truth)
    }
}

/// Simulates `run` with the IMU that `truth` describes.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{RunSchedule, Truth, run};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
/// let truth = Truth::of(table);
/// // From 10 to 20 degC at 0.02 degC/s, a sample each second.
/// let temperatures = RunSchedule { from_c: 10.0, to_c: 20.0, ramp_c_per_s: 0.02, ..RunSchedule::default() };
/// let schedule = RunSchedule { interval_ns: 1_000_000_000, ..temperatures };
/// let samples: Vec<_> = run(&truth, &schedule, 1).collect();
/// assert_eq!(samples.len() as u64, schedule.samples());
/// let [begin, end] = [0, samples.len() - 1].map(|i| samples[i].accelerometers.head_temperature[0]);
/// assert!((end - begin - 0.4).abs() < 0.01); // 40 mV for each degC
/// assert!(run(&truth, &schedule, 1).eq(samples)); // the same seed gives the same data
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn run<'a>(truth: &Truth, run: &'a RunSchedule, seed: u64) -> RunSamples<'a> {
    let mut imu = SimulatedImu::new(truth, &run.chain, &run.noise, run.from_c, seed);
    imu.visit();
    let at_rest = InertialMotion::at_rest(truth, run.angles_deg(truth), run.interval_ns as f64 / 1e9);
    let motion = InertialMotion { specific_force: run.specific_force(truth), ..at_rest };
    RunSamples { run, imu, motion, tilt_drift: None, count: 0, legs: 0 }
}

impl RunSamples<'_> {
    /// The same with an IMU that is not soaked at the beginning, see [`SimulatedImu::displace`].
    pub(super) fn displaced(mut self, case_c: f64, element_c: f64) -> Self {
        self.imu.displace(case_c, element_c);
        self
    }

    /// The same on a base whose tilt drifts by `drift_rad` over the whole recording \[rad\].
    pub(super) fn drifting(self, truth: &Truth, drift_rad: [f64; 2]) -> Self {
        let tilt_drift = (drift_rad != [0.0; 2]).then(|| TiltDrift {
            truth: truth.clone(),
            drift_rad,
            angles_deg: self.run.angles_deg(truth),
        });
        Self { tilt_drift, ..self }
    }
}

impl Iterator for RunSamples<'_> {
    type Item = RawSample;

    fn next(&mut self) -> Option<RawSample> {
        let samples = self.run.samples();
        if self.count == samples {
            return None;
        }
        // Where there are no holds, two ramps may begin with one sample.
        while self.legs < self.run.legs && self.count >= self.run.start(self.legs) {
            let target_c = if self.legs.is_multiple_of(2) { self.run.to_c } else { self.run.from_c };
            self.imu.go_to(target_c, self.run.ramp_c_per_s);
            self.legs += 1;
        }
        let mut motion = self.motion;
        if let Some(drift) = &self.tilt_drift {
            let part = (self.count as f64 + 0.5) / samples as f64;
            motion.specific_force = (Vector3::from(motion.specific_force) + drift.added(part)).into();
        }
        self.count += 1;
        Some(self.imu.step(&motion, self.run.interval_ns))
    }
}
