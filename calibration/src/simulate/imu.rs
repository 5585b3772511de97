//! The simulated IMU: the samples that an acquisition would latch, one for each period.
//!
//! # Equations
//! Over a period Ts \[s\] the indicated specific force is, with the misalignment M, the specific force f and the bias A,
//! all \[g0\]:
//!
//! ```text
//! x = M f + A(U_head) + offset of the visit + white noise * 1/sqrt(Ts) + vibration
//! ```
//! Temperatures are those of the middle of the period. The converter holds the charge q \[g0*s\], which grows by the integral
//! of x. While q >= 1/K+, the converter gives a positive pulse and subtracts 1/K+ from q; while q <= -1/|K-|, it gives a
//! negative pulse and adds 1/|K-|. So over any time N+/K+ + N-/K- is the integral of x to within one pulse.

use super::chamber::{SLOW_STREAM, SimulatedChamber};
use super::model::{Chain, Noise, Truth};
use super::random::RandomGenerator;
use core::f64::consts::TAU;
use isotherm_shared::table::Axis;
use isotherm_shared::wire::{AXES, RawSample};
use nalgebra::{Matrix3, Vector3};

/// Random stream of the noise of sensors and telemetry.
const FAST_STREAM: u64 = 2;

/// Integration steps in a period of the vibration.
const SUB_STEPS: f64 = 20.0;

/// An IMU in a chamber. Its state: temperatures, charges, the last telemetry, the time.
#[derive(Clone, Debug)]
pub struct SimulatedImu {
    axes: [Axis; AXES],
    misalignment: Matrix3<f64>,
    chain: Chain,
    noise: Noise,
    chamber: SimulatedChamber,
    slow: RandomGenerator,
    fast: RandomGenerator,
    offsets: [VisitOffset; AXES],
    /// Charge that is less than a pulse \[g0*s\].
    charge: [f64; AXES],
    /// The last sample, but with the sequence of the next one.
    latest: RawSample,
}

/// Offsets of an axis that change from one visit of a set point to the next.
#[derive(Clone, Copy, Debug, Default)]
struct VisitOffset {
    /// Of the bias \[g0\].
    bias: f64,
    /// Of K+ and K-, relative.
    scale_factors: [f64; 2],
}

impl SimulatedImu {
    /// An IMU in equilibrium at the chamber temperature `temperature_c` \[degC\]. Time and sequence begin at 0.
    #[must_use]
    pub fn new(truth: &Truth, chain: &Chain, noise: &Noise, temperature_c: f64, seed: u64) -> Self {
        let mut slow = RandomGenerator::new(seed, SLOW_STREAM);
        let phase = slow.between(0.0, TAU);
        Self {
            axes: truth.table.content().axes.clone(),
            misalignment: truth.misalignment,
            chain: *chain,
            noise: *noise,
            chamber: SimulatedChamber::with_phase(chain, temperature_c, phase),
            slow,
            fast: RandomGenerator::new(seed, FAST_STREAM),
            offsets: [VisitOffset::default(); AXES],
            charge: [0.0; AXES],
            latest: RawSample::default(),
        }
    }

    /// Starts a ramp of the chamber to `target_c` \[degC\] at `ramp_c_per_s` \[degC/s\], which must be over 0.
    pub fn go_to(&mut self, target_c: f64, ramp_c_per_s: f64) {
        self.chamber.go_to(target_c, ramp_c_per_s);
    }

    /// Temperature of the chamber's air, without its oscillation \[degC\].
    #[must_use]
    pub const fn chamber_c(&self) -> f64 {
        self.chamber.air_c()
    }

    /// Temperature of the sensor heads, without their offsets \[degC\].
    #[must_use]
    pub fn head_c(&self) -> f64 {
        self.chamber.head_and_board_c().0
    }

    /// Begins a visit of a set point: draws new offsets of bias and scale factors, which stay until the next visit.
    pub fn visit(&mut self) {
        let (bias, scale_factor) = (self.noise.bias_g0, self.noise.scale_factor);
        for offset in &mut self.offsets {
            let mut draw = || self.slow.normal();
            *offset =
                VisitOffset { bias: bias * draw(), scale_factors: [scale_factor * draw(), scale_factor * draw()] };
        }
    }

    /// Advances by `time_ns` without a sample; the converter keeps its charge.
    pub fn wait(&mut self, time_ns: u64) {
        self.chamber.wait(time_ns as f64 / 1e9);
        self.latest.timestamp_ns += time_ns;
    }

    /// Advances by one control period of `interval_ns` under `specific_force` \[g0\] along the body's axes, and returns the
    /// sample that the acquisition latches at its end. Session and `sent_ns` are 0.
    pub fn step(&mut self, specific_force: &[f64; AXES], interval_ns: u64) -> RawSample {
        let ts = interval_ns as f64 / 1e9;
        self.chamber.wait(ts / 2.0);
        let (head_c, board_c) = self.chamber.head_and_board_c();
        self.chamber.wait(ts / 2.0);

        let begin_ns = self.latest.timestamp_ns;
        let mut raw = RawSample { timestamp_ns: begin_ns + interval_ns, interval_ns, ..self.latest };
        raw.accelerometers.positive_pulses = [0; AXES];
        raw.accelerometers.negative_pulses = [0; AXES];
        self.count_pulses(&mut raw, specific_force, head_c, board_c);
        // The first sample (sequence 0) always reads the telemetry.
        if raw.sequence == 0 || raw.timestamp_ns - raw.telemetry_ns >= (self.chain.telemetry_s * 1e9).round() as u64 {
            self.read_telemetry(&mut raw);
        }
        self.latest = RawSample { sequence: raw.sequence + 1, ..raw };
        raw
    }

    /// Adds the pulses of one period to `raw`.
    fn count_pulses(&mut self, raw: &mut RawSample, specific_force: &[f64; AXES], head_c: f64, board_c: f64) {
        let chain = &self.chain;
        let ts = raw.interval_ns as f64 / 1e9;
        let force = self.misalignment * Vector3::from(*specific_force);
        let white = self.noise.sensor_g0 / ts.sqrt();
        let steady: [f64; AXES] = core::array::from_fn(|i| {
            let head = chain.telemetry(head_c + chain.head_offset_c[i]);
            force[i] + self.axes[i].bias_at(head).0 + self.offsets[i].bias + white * self.fast.normal()
        });
        let scale_factors: [[f64; 2]; AXES] = core::array::from_fn(|i| {
            let board = chain.telemetry(board_c + chain.board_offset_c[i]);
            let [positive, negative] = self.offsets[i].scale_factors;
            let axis = &self.axes[i];
            [
                axis.positive_scale_factor_at(board).0 * (1.0 + positive),
                axis.negative_scale_factor_at(board).0 * (1.0 + negative),
            ]
        });
        let vibrates = chain.vibration_g0 != 0.0 && chain.vibration_hz > 0.0;
        let steps = if vibrates { (ts * chain.vibration_hz * SUB_STEPS).ceil().max(1.0) } else { 1.0 };
        let begin = (((raw.timestamp_ns - raw.interval_ns) as f64 / 1e9) * chain.vibration_hz).fract();
        // The integral of a sin(w t) over a sub-step is a/w (cos(w t0) - cos(w t1)).
        let cos = |step: f64| (TAU * (begin + ts * chain.vibration_hz * step / steps)).cos();
        let mut before = if vibrates { cos(0.0) } else { 0.0 };
        for step in 1..=steps as u64 {
            let mut vibration = 0.0;
            if vibrates {
                let after = cos(step as f64);
                vibration = chain.vibration_g0 / (TAU * chain.vibration_hz) * (before - after);
                before = after;
            }
            for i in 0..AXES {
                self.charge[i] += steady[i] * (ts / steps) + vibration;
                let [positive, negative] = balance(&mut self.charge[i], scale_factors[i]);
                raw.accelerometers.positive_pulses[i] = raw.accelerometers.positive_pulses[i].saturating_add(positive);
                raw.accelerometers.negative_pulses[i] = raw.accelerometers.negative_pulses[i].saturating_add(negative);
            }
        }
    }

    /// Reads the telemetry at the end of the period.
    fn read_telemetry(&mut self, raw: &mut RawSample) {
        let (head_c, board_c) = self.chamber.head_and_board_c();
        let (chain, sigma) = (&self.chain, self.noise.telemetry);
        for i in 0..AXES {
            let mut reading =
                |temperature_c| chain.quantised(chain.telemetry(temperature_c) + sigma * self.fast.normal());
            raw.accelerometers.head_temperature[i] = reading(head_c + chain.head_offset_c[i]);
            raw.accelerometers.board_temperature[i] = reading(board_c + chain.board_offset_c[i]);
        }
        raw.telemetry_ns = raw.timestamp_ns;
    }
}

/// Takes all whole pulses out of `charge` \[g0*s\] and returns the numbers of positive and negative pulses. K+ > 0 and
/// K- < 0 \[pulse/(s*g0)\].
fn balance(charge: &mut f64, [positive, negative]: [f64; 2]) -> [u32; 2] {
    let scale_factor = if *charge >= 0.0 { positive } else { negative };
    let pulses = (*charge * scale_factor).floor();
    *charge -= pulses / scale_factor;
    if scale_factor > 0.0 { [pulses as u32, 0] } else { [0, pulses as u32] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_converter_gives_whole_pulses_and_keeps_the_rest() {
        let factors = [8.0, -4.0];
        let mut charge = 1.0 + 0.1;
        assert_eq!(balance(&mut charge, factors), [8, 0]);
        assert!((charge - 0.1).abs() < 1e-15);
        // 0.1 is less than a positive pulse of 1/8, and -0.2 less than a negative one of 1/4.
        assert_eq!(balance(&mut charge, factors), [0, 0]);
        charge -= 0.3;
        assert_eq!(balance(&mut charge, factors), [0, 0]);
        charge -= 0.55;
        assert_eq!(balance(&mut charge, factors), [0, 3]);
        assert!(charge.abs() < 1e-15);
    }
}
