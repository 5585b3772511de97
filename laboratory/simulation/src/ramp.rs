//! The schedule of a ramp recording: one stay of an IMU at rest, warming and cooling.

use super::campaign::heading_toml;
use super::run::{RunSamples, RunSchedule, run};
use crate::chain::is_zero;
use crate::model::Truth;
use isotherm_campaign::Ramp;
use nalgebra::Vector3;
use serde::Serialize;

/// Between the seeds of two recordings of one IMU.
const RECORDING_SEEDS: u64 = 1000;

/// The schedule of a ramp recording: hold, up, hold, down, hold.
///
/// It is a [`RunSchedule`] of two ramps, with what may go wrong in an afternoon. A single ramp only heats; `hold_s:
/// 0.0` leaves the holds out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RampSchedule {
    /// Attitude, temperatures, rate, number of ramps, holds, period of a row, hardware and random deviations.
    #[serde(flatten)]
    pub run: RunSchedule,
    /// Temperature of the whole IMU above the chamber's at the beginning, which is not soaked \[degC\].
    #[serde(skip_serializing_if = "is_zero")]
    pub case_offset_c: f64,
    /// Temperature of the sensing elements above their heads at the beginning, which are not soaked \[degC\].
    #[serde(skip_serializing_if = "is_zero")]
    pub element_offset_c: f64,
    /// How far the tilt of the base about the laboratory's X and Y drifts over the whole recording, at a constant rate
    /// \[rad\]. It adds to what the axes across gravity indicate.
    #[serde(skip_serializing_if = "is_zero")]
    pub tilt_drift_rad: [f64; 2],
}

impl Default for RampSchedule {
    /// A3 up, -25 to 45 degC and back at 20 degC/h, holds of half an hour, rows of 10 s, from equilibrium; no drift.
    fn default() -> Self {
        let run =
            RunSchedule { direction: [0.0, 0.0, 1.0], legs: 2, interval_ns: 10_000_000_000, ..RunSchedule::default() };
        Self { run, case_offset_c: 0.0, element_offset_c: 0.0, tilt_drift_rad: [0.0; 2] }
    }
}

impl RampSchedule {
    /// What a campaign file says of this recording, whose file is `samples`, relative to the campaign file.
    #[must_use]
    pub fn ramp(&self, samples: &str) -> Ramp {
        let direction = Vector3::from(self.run.direction).normalize();
        Ramp { samples: samples.to_owned(), specific_force: Some(direction.into()) }
    }
}

/// The seed of recording `number` of several of one IMU, counted from 1: each has its own noise and phase of the
/// chamber's oscillation, and so has a campaign of the IMU, which takes `seed` itself.
#[must_use]
pub const fn ramp_seed(seed: u64, number: u64) -> u64 {
    seed.wrapping_add(RECORDING_SEEDS.wrapping_mul(number))
}

/// The text of a campaign file of only `ramps`. `curves` is the path of the table that gives what they do not show,
/// relative to the campaign file.
#[must_use]
pub fn ramps_toml(truth: &Truth, curves: &str, ramps: &[Ramp]) -> String {
    let content = truth.table.content();
    let (imu, unit) = (content.imu.as_str(), &content.temperature_unit);
    let text = heading_toml(imu, ["curves", curves], content.gravity, truth.gravity_local, unit);
    ramps.iter().fold(text, |text, ramp| text + "\n" + &ramp.to_toml())
}

/// Simulates the recording of `schedule` with the IMU that `truth` describes.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{RampSchedule, Truth, ramp};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
/// let schedule = RampSchedule::default();
/// let heads: Vec<_> =
///     ramp(&Truth::of(table), &schedule, 1).map(|raw| raw.accelerometers.head_temperature[2]).collect();
/// let highest = heads.iter().copied().fold(0.0, f64::max);
/// // Up and down again: it ends near where it began.
/// assert!(highest - heads[0] > 2.5 && (heads[heads.len() - 1] - heads[0]).abs() < 0.2); // V
/// # Ok(())
/// # }
/// ```
#[must_use]
pub fn ramp<'a>(truth: &Truth, schedule: &'a RampSchedule, seed: u64) -> RunSamples<'a> {
    run(truth, &schedule.run, seed)
        .displaced(schedule.case_offset_c, schedule.element_offset_c)
        .drifting(truth, schedule.tilt_drift_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::{Chain, Noise};
    use crate::hysteresis::Play;
    use crate::model::typical_gyroscopes;
    use crate::random::RandomGenerator;
    use crate::schedule_tests::truth;
    use core::f64::consts::TAU;
    use isotherm_shared::compensate::answer;
    use isotherm_shared::polynomial::Polynomial;
    use isotherm_shared::table::CoefficientTable;
    use isotherm_shared::units::ARCSEC;
    use isotherm_shared::wire::{AXES, RawSample};

    const LAG_S: f64 = 240.0;
    /// Large, so that a pulse is less than 1e-4 of them \[g0/V, deg/h/V\].
    const TRANSIENTS: [[f64; AXES]; 2] = [[0.02, -0.01, 0.004], [2000.0, 0.0, -1000.0]];
    const PLAYS: [Play; 2] = [
        Play { half_width: 0.1, accelerometers: [0.03, 0.0, -0.02], gyroscopes: [500.0, 2000.0, 0.0] },
        Play { half_width: 0.6, accelerometers: [0.002, 0.005, 0.0], gyroscopes: [0.0, -300.0, 800.0] },
    ];

    /// An IMU with gyroscopes, without transients and plays. Its scale factors are constant, so that
    /// the age of their temperature does not matter, and its axes are aligned, so that each shows its own bias.
    fn still() -> Truth {
        let mut content = truth().table.content().clone();
        content.format = 2;
        let mut gyroscopes = typical_gyroscopes(&Chain::default()).unwrap();
        for axis in content.axes.iter_mut().chain(&mut gyroscopes.axes) {
            for scale_factor in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
                *scale_factor =
                    Polynomial::new(&scale_factor.coefficients()[..1], 0.0, 1.0, scale_factor.range()).unwrap();
            }
        }
        gyroscopes.alignment = None;
        content.alignment = None;
        content.gyroscopes = Some(gyroscopes);
        Truth::of(CoefficientTable::new(content).unwrap())
    }

    /// The same with them.
    fn moving() -> Truth {
        let still = still();
        let mut content = still.table.content().clone();
        content.lag_s = Some(LAG_S);
        for (axis, transient) in content.axes.iter_mut().zip(TRANSIENTS[0]) {
            axis.transient = transient / axis.bias_unit.factor();
        }
        for (axis, transient) in content.gyroscopes.as_mut().unwrap().axes.iter_mut().zip(TRANSIENTS[1]) {
            axis.transient = transient;
        }
        Truth { table: CoefficientTable::new(content).unwrap(), plays: PLAYS.to_vec(), ..still }
    }

    /// Rate \[g0, deg/h\] that the truth makes of a sample along each axis of the IMU.
    fn rates(truth: &Truth, raw: &RawSample) -> [[f64; AXES]; 2] {
        let increment = answer(Some(&truth.table), raw);
        let seconds = raw.interval_ns as f64 / 1e9;
        [
            increment.velocity_increment.map(|dv| dv / truth.table.content().gravity / seconds),
            increment.angle_increment.map(|angle| angle / ARCSEC / seconds),
        ]
    }

    /// A second implementation: chamber, heads, elements and plays in steps of 20 ms. Everything is in degC but the
    /// result.
    struct Integration {
        chain: Chain,
        phase: f64,
        time_s: f64,
        head: f64,
        element: f64,
        plays: [f64; 2],
    }

    impl Integration {
        const STEP_S: f64 = 0.02;

        fn new(chain: Chain, phase: f64, air_c: f64, case_c: f64, element_c: f64) -> Self {
            // The steady state of the oscillation behind a lag, and behind two.
            let angle = |tau_s: f64| TAU / chain.oscillation_s * tau_s;
            let (first, second) = (angle(chain.head_lag_s), angle(LAG_S));
            let size = chain.oscillation_c / libm::hypot(first, 1.0);
            let head = air_c + case_c + size * libm::sin(phase - libm::atan(first));
            let oscillation =
                size / libm::hypot(second, 1.0) * libm::sin(phase - libm::atan(first) - libm::atan(second));
            Self {
                chain,
                phase,
                time_s: 0.0,
                head,
                element: air_c + case_c + element_c + oscillation,
                plays: [head; 2],
            }
        }

        /// Mean over the next `seconds` of what transients and plays add, with the air at `air_c` of the time.
        fn mean(&mut self, seconds: f64, air_c: impl Fn(f64) -> f64) -> [[f64; AXES]; 2] {
            let steps = (seconds / Self::STEP_S).round();
            let slope = self.chain.temperature_slope;
            let mut mean = [[0.0; AXES]; 2];
            for _ in 0..steps as u64 {
                let middle_s = self.time_s + Self::STEP_S / 2.0;
                let air = air_c(middle_s)
                    + self.chain.oscillation_c * libm::sin(TAU * middle_s / self.chain.oscillation_s + self.phase);
                let change = (air - self.head) * Self::STEP_S / self.chain.head_lag_s;
                let head = self.head + change / 2.0;
                self.element += (head - self.element) * Self::STEP_S / LAG_S;
                self.head += change;
                self.time_s += Self::STEP_S;
                for (position, play) in self.plays.iter_mut().zip(PLAYS) {
                    let half_width = play.half_width / slope;
                    *position = position.clamp(self.head - half_width, self.head + half_width);
                }
                for kind in 0..2 {
                    for i in 0..AXES {
                        mean[kind][i] += TRANSIENTS[kind][i] * slope * (self.element - self.head) / steps;
                        for (position, play) in self.plays.iter().zip(PLAYS) {
                            let h = [play.accelerometers, play.gyroscopes][kind][i];
                            mean[kind][i] += h * slope * (position - self.head) / steps;
                        }
                    }
                }
            }
            mean
        }
    }

    /// The largest difference between what two IMUs indicate and `right`, relative to the largest of `right`, of any
    /// sensor.
    fn worst(found: &[[[f64; AXES]; 2]], right: &[[[f64; AXES]; 2]]) -> f64 {
        let mut worst = 0.0_f64;
        for (kind, i) in (0..2).flat_map(|kind| (0..AXES).map(move |i| (kind, i))) {
            let size = right.iter().map(|row| row[kind][i].abs()).fold(0.0, f64::max);
            let off = found.iter().zip(right).map(|(found, right)| (found[kind][i] - right[kind][i]).abs());
            worst = worst.max(off.fold(0.0, f64::max) / size);
        }
        worst
    }

    fn difference([a, b]: [[[f64; AXES]; 2]; 2]) -> [[f64; AXES]; 2] {
        [0, 1].map(|kind| core::array::from_fn(|i| a[kind][i] - b[kind][i]))
    }

    #[test]
    fn a_ramp_obeys_the_differential_equation_in_the_mean_of_each_row() {
        let chain = Chain { telemetry_lsb_micro: 0, oscillation_c: 0.5, ..Chain::default() };
        let phase = RandomGenerator::new(5, 1).between(0.0, TAU);
        for interval_s in [60_u32, 300] {
            let run = RunSchedule {
                from_c: -20.0,
                to_c: 30.0,
                ramp_c_per_s: 70.0 / 3600.0,
                hold_s: 900.0,
                legs: 4,
                interval_ns: u64::from(interval_s) * 1_000_000_000,
                chain,
                ..RampSchedule::default().run
            };
            let schedule = RampSchedule { run, case_offset_c: 4.0, element_offset_c: -3.0, ..RampSchedule::default() };
            let (still, moving) = (still(), moving());
            let mut exact = Integration::new(chain, phase, -20.0, 4.0, -3.0);
            let (interval_s, ramp_s) = (f64::from(interval_s), 50.0 * 3600.0 / 70.0);
            // A ramp begins with a row.
            let begin_s = |leg: f64| ((900.0 + leg * (ramp_s + 900.0)) / interval_s).floor() * interval_s;
            let air_c = |time_s: f64| {
                let leg = [3.0, 2.0, 1.0].into_iter().find(|leg| begin_s(*leg) <= time_s).unwrap_or(0.0);
                let part = ((time_s - begin_s(leg)) / ramp_s).clamp(0.0, 1.0);
                if leg % 2.0 == 0.0 { -20.0 + 50.0 * part } else { 30.0 - 50.0 * part }
            };
            let (mut found, mut right) = (Vec::new(), Vec::new());
            for (moved, stood) in ramp(&moving, &schedule, 5).zip(ramp(&still, &schedule, 5)) {
                // Temperature, time and sequence do not depend on what the biases do.
                assert_eq!(moved.gyroscopes.head_temperature, stood.gyroscopes.head_temperature);
                found.push(difference([rates(&still, &moved), rates(&still, &stood)]));
                right.push(exact.mean(interval_s, air_c));
            }
            assert_eq!(found.len() as u64, run.samples());
            let worst = worst(&found, &right);
            assert!(worst < 3e-4, "{interval_s} s: {worst}");
        }
    }

    #[test]
    fn a_drifting_base_is_felt_across_gravity() {
        let still = still();
        let chain = Chain { oscillation_c: 0.0, ..Chain::default() };
        let run = RunSchedule { noise: Noise::NONE, chain, ..RampSchedule::default().run };
        let schedule = RampSchedule { run, tilt_drift_rad: [1e-3, -2e-3], ..RampSchedule::default() };
        let rows: Vec<_> = ramp(&still, &schedule, 1).map(|raw| rates(&still, &raw)[0]).collect();
        // A3 is up at any inner angle; at 0, A1 would lean by -ty and A2 by tx.
        let (sine, cosine) = libm::sincos(run.angles_deg(&still)[1].to_radians());
        let leaning = [2e-3 * cosine + 1e-3 * sine, 1e-3 * cosine - 2e-3 * sine, 0.0];
        // The means of the first and the last hundred rows are a hundred rows less than the whole apart.
        let mean = |rows: &[[f64; AXES]]| [0, 1, 2].map(|i| rows.iter().map(|row| row[i]).sum::<f64>() / 100.0);
        let (first, last) = (mean(&rows[..100]), mean(&rows[rows.len() - 100..]));
        let part = 1.0 - 100.0 / rows.len() as f64;
        for (i, right) in leaning.map(|lean| lean * part).into_iter().enumerate() {
            let found = last[i] - first[i];
            assert!((found - right).abs() < 3e-6, "{i}: {found} {right}");
        }
    }
}
