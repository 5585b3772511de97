//! The simulated IMU: the samples that an acquisition would latch, one for each period.
//!
//! # Equations
//! Over a period Ts \[s\] the accelerometers indicate, with the misalignment M, the specific force f and the bias A, all \[g0\]:
//!
//! ```text
//! x = M f + A(U_head) + offset of the visit + white noise * 1/sqrt(Ts) + vibration
//! ```
//! and the gyroscopes, if the truth has them, what [`SimulatedGyroscopes`] says. Temperatures are those of the middle of the period. The charge
//! of each converter becomes pulses as in [`SimulatedTriad`]. The gyroscopes have random streams of their own, so that the accelerometers' output
//! does not depend on whether there are gyroscopes.

use super::chain::{Chain, Noise};
use super::chamber::{SLOW_STREAM, SimulatedChamber};
use super::model::Truth;
use super::motion::InertialMotion;
use super::random::RandomGenerator;
use super::triad::{SimulatedGyroscopes, SimulatedTriad};
use core::f64::consts::TAU;
use isotherm_shared::wire::{AXES, RawSample, Triad};
use nalgebra::{Matrix3, Vector3};

/// Random stream of the noise of the accelerometers and their telemetry.
const FAST_STREAM: u64 = 2;

/// Random stream of the gyroscopes' offsets of each visit.
const GYROSCOPE_SLOW_STREAM: u64 = 5;

/// Random stream of the noise of the gyroscopes and their telemetry.
const GYROSCOPE_FAST_STREAM: u64 = 6;

/// Integration steps in a period of the vibration.
const SUB_STEPS: f64 = 20.0;

/// An IMU in a chamber. Its state: temperatures, charges, the last telemetry, the time.
#[derive(Clone, Debug)]
pub struct SimulatedImu {
    accelerometers: SimulatedTriad,
    misalignment: Matrix3<f64>,
    gyroscopes: Option<SimulatedGyroscopes>,
    chain: Chain,
    noise: Noise,
    chamber: SimulatedChamber,
    /// Of the accelerometers, as `fast`.
    slow: RandomGenerator,
    fast: RandomGenerator,
    gyroscope_slow: RandomGenerator,
    gyroscope_fast: RandomGenerator,
    /// The last sample, but with the sequence of the next one.
    latest: RawSample,
}

impl SimulatedImu {
    /// An IMU in equilibrium at the chamber temperature `temperature_c` \[degC\]. Time and sequence begin at 0.
    #[must_use]
    pub fn new(truth: &Truth, chain: &Chain, noise: &Noise, temperature_c: f64, seed: u64) -> Self {
        let mut slow = RandomGenerator::new(seed, SLOW_STREAM);
        let phase = slow.between(0.0, TAU);
        Self {
            accelerometers: SimulatedTriad::new(&truth.table.content().axes),
            misalignment: truth.misalignment,
            gyroscopes: SimulatedGyroscopes::of(truth),
            chain: *chain,
            noise: *noise,
            chamber: SimulatedChamber::with_phase(chain, temperature_c, phase),
            slow,
            fast: RandomGenerator::new(seed, FAST_STREAM),
            gyroscope_slow: RandomGenerator::new(seed, GYROSCOPE_SLOW_STREAM),
            gyroscope_fast: RandomGenerator::new(seed, GYROSCOPE_FAST_STREAM),
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

    /// Begins a visit of a set point: draws new offsets of biases and scale factors, which stay until the next visit.
    pub fn visit(&mut self) {
        let noise = &self.noise;
        self.accelerometers.visit(noise.bias_g0, noise.scale_factor, || self.slow.normal());
        if let Some(gyroscopes) = &mut self.gyroscopes {
            gyroscopes.visit(noise.gyroscope_bias, noise.gyroscope_scale_factor, || self.gyroscope_slow.normal());
        }
    }

    /// Advances by `time_ns` without a sample; the converter keeps its charge.
    pub fn wait(&mut self, time_ns: u64) {
        self.chamber.wait(time_ns as f64 / 1e9);
        self.latest.timestamp_ns += time_ns;
    }

    /// Lets the gyroscopes' converters run for `seconds` with `motion`, and discards their pulses: then each holds the part of a pulse that this
    /// motion leaves. Time, temperatures and random numbers do not advance.
    pub fn settle(&mut self, motion: &InertialMotion, seconds: f64) {
        let (head_c, board_c) = self.chamber.head_and_board_c();
        let telemetry = self.gyroscope_telemetry(head_c, board_c);
        if let Some(gyroscopes) = &mut self.gyroscopes {
            gyroscopes.feel(motion, seconds, telemetry, [0.0; AXES], &mut Triad::default());
        }
    }

    /// True telemetry of the gyroscopes' heads and boards.
    fn gyroscope_telemetry(&self, head_c: f64, board_c: f64) -> [[f64; AXES]; 2] {
        let chain = &self.chain;
        [
            chain.gyroscope_head_offset_c.map(|offset_c| chain.telemetry(head_c + offset_c)),
            chain.gyroscope_board_offset_c.map(|offset_c| chain.telemetry(board_c + offset_c)),
        ]
    }

    /// Advances by one control period of `interval_ns` with what the IMU feels in it, and returns the sample that the acquisition latches
    /// at its end. Session and `sent_ns` are 0.
    pub fn step(&mut self, motion: &InertialMotion, interval_ns: u64) -> RawSample {
        let ts = interval_ns as f64 / 1e9;
        self.chamber.wait(ts / 2.0);
        let (head_c, board_c) = self.chamber.head_and_board_c();
        self.chamber.wait(ts / 2.0);

        let begin_ns = self.latest.timestamp_ns;
        let mut raw = RawSample { timestamp_ns: begin_ns + interval_ns, interval_ns, ..self.latest };
        for triad in [&mut raw.accelerometers, &mut raw.gyroscopes] {
            triad.positive_pulses = [0; AXES];
            triad.negative_pulses = [0; AXES];
        }
        self.count_pulses(&mut raw, &motion.specific_force, head_c, board_c);
        let telemetry = self.gyroscope_telemetry(head_c, board_c);
        if let Some(gyroscopes) = &mut self.gyroscopes {
            // 1 deg/sqrt(h) is 60 arcsec/sqrt(s).
            let size = self.noise.random_walk * 60.0 * ts.sqrt();
            let walk = [(); AXES].map(|()| size * self.gyroscope_fast.normal());
            gyroscopes.feel(motion, ts, telemetry, walk, &mut raw.gyroscopes);
        }
        // The first sample (sequence 0) always reads the telemetry.
        if raw.sequence == 0 || raw.timestamp_ns - raw.telemetry_ns >= (self.chain.telemetry_s * 1e9).round() as u64 {
            self.read_telemetry(&mut raw);
        }
        self.latest = RawSample { sequence: raw.sequence + 1, ..raw };
        raw
    }

    /// Adds the pulses of the accelerometers in one period to `raw`.
    fn count_pulses(&mut self, raw: &mut RawSample, specific_force: &[f64; AXES], head_c: f64, board_c: f64) {
        let chain = &self.chain;
        let ts = raw.interval_ns as f64 / 1e9;
        let force = self.misalignment * Vector3::from(*specific_force);
        let white = self.noise.sensor_g0 / ts.sqrt();
        let steady: [f64; AXES] = core::array::from_fn(|i| {
            let head = chain.telemetry(head_c + chain.head_offset_c[i]);
            force[i] + self.accelerometers.bias(i, head) + white * self.fast.normal()
        });
        let board = chain.board_offset_c.map(|offset_c| chain.telemetry(board_c + offset_c));
        let scale_factors = self.accelerometers.scale_factors(board);
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
            let indicated = steady.map(|steady| steady * (ts / steps) + vibration);
            self.accelerometers.convert(indicated, &scale_factors, &mut raw.accelerometers);
        }
    }

    /// Reads the telemetry at the end of the period.
    fn read_telemetry(&mut self, raw: &mut RawSample) {
        let (head_c, board_c) = self.chamber.head_and_board_c();
        let (chain, sigma) = (&self.chain, self.noise.telemetry);
        let read = |triad: &mut Triad,
                    [head_offset_c, board_offset_c]: [[f64; AXES]; 2],
                    random: &mut RandomGenerator| {
            let mut reading = |temperature_c| chain.quantised(chain.telemetry(temperature_c) + sigma * random.normal());
            for i in 0..AXES {
                triad.head_temperature[i] = reading(head_c + head_offset_c[i]);
                triad.board_temperature[i] = reading(board_c + board_offset_c[i]);
            }
        };
        read(&mut raw.accelerometers, [chain.head_offset_c, chain.board_offset_c], &mut self.fast);
        if self.gyroscopes.is_some() {
            let offsets_c = [chain.gyroscope_head_offset_c, chain.gyroscope_board_offset_c];
            read(&mut raw.gyroscopes, offsets_c, &mut self.gyroscope_fast);
        }
        raw.telemetry_ns = raw.timestamp_ns;
    }
}
