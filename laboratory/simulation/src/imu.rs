//! The simulated IMU: the samples that an acquisition would latch, one for each period.
//!
//! # Equations
//! Over a period Ts \[s\] the accelerometers indicate, with the misalignment M, the specific force f and the bias A,
//! all \[g0\]:
//!
//! ```text
//! x = M f + A(U_head) + memory + offset of the visit + white noise * 1/sqrt(Ts) + vibration
//! ```
//! and the gyroscopes, if the truth has them, what [`SimulatedGyroscopes`] says. Temperatures are those of the middle
//! of the period. The memory is what the past of the temperature adds to a bias: with the truth's transient t, the
//! temperature L that the sensing element would give, and the [plays](crate::hysteresis::Play), the mean of t (L - U) +
//! S h (z - U) over the period, plus the random walk of the bias. The charge of each converter becomes pulses as in
//! [`SimulatedTriad`]. The gyroscopes have random streams of their own, so that the accelerometers' output does not
//! depend on whether there are gyroscopes.

use super::chain::{Chain, Noise};
use super::chamber::{SLOW_STREAM, SimulatedChamber};
use super::hysteresis::SimulatedPlay;
use super::model::Truth;
use super::motion::InertialMotion;
use super::random::RandomGenerator;
use super::triad::{SimulatedGyroscopes, SimulatedTriad};
use core::f64::consts::TAU;
use isotherm_shared::table::Axis;
use isotherm_shared::wire::{AXES, RawSample, Triad};
use nalgebra::{Matrix3, Vector3};

/// Random stream of the noise of the accelerometers and their temperature.
const FAST_STREAM: u64 = 2;

/// Random stream of the gyroscopes' offsets of each visit.
const GYROSCOPE_SLOW_STREAM: u64 = 5;

/// Random stream of the noise of the gyroscopes and their temperature.
const GYROSCOPE_FAST_STREAM: u64 = 6;

/// Random stream of the random walks of the biases.
const BIAS_WALK_STREAM: u64 = 9;

/// Longest step in which a play follows the temperature \[s\]. In it, the temperature of a head that follows its
/// chamber is a line to within some 1e-6 of its range.
const PLAY_STEP_S: f64 = 1.0;

/// Integration steps in a period of the vibration.
const SUB_STEPS: f64 = 20.0;

/// An IMU in a chamber. Its state: temperatures, plays, charges, the last temperature, the time.
#[derive(Clone, Debug)]
pub struct SimulatedImu {
    accelerometers: SimulatedTriad,
    misalignment: Matrix3<f64>,
    gyroscopes: Option<SimulatedGyroscopes>,
    chain: Chain,
    noise: Noise,
    chamber: SimulatedChamber,
    /// Transients of accelerometers and gyroscopes per unit of temperature \[g0, deg/h\].
    transients: [[f64; AXES]; 2],
    /// Those of a head without offset: the play of a head with an offset is as far ahead.
    plays: Vec<SimulatedPlay>,
    /// Random walk of the biases of accelerometers and gyroscopes so far \[g0, deg/h\].
    bias_walk: [[f64; AXES]; 2],
    bias_walk_noise: RandomGenerator,
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
        let content = truth.table.content();
        let chamber = SimulatedChamber::with_phase(chain, temperature_c, phase);
        let chamber = match content.lag_s {
            Some(lag_s) => chamber.with_elements(lag_s, chain),
            None => chamber,
        };
        let head = chain.temperature(chamber.head_and_board_c().0);
        let transients = |axes: &[Axis; AXES]| axes.each_ref().map(|axis| axis.transient * axis.bias_unit.factor());
        Self {
            accelerometers: SimulatedTriad::new(&content.axes),
            misalignment: truth.misalignment,
            gyroscopes: SimulatedGyroscopes::of(truth),
            chain: *chain,
            noise: *noise,
            chamber,
            transients: [
                transients(&content.axes),
                content.gyroscopes.as_ref().map_or([0.0; AXES], |gyroscopes| transients(&gyroscopes.axes)),
            ],
            plays: truth.plays.iter().map(|play| SimulatedPlay::new(*play, head)).collect(),
            bias_walk: [[0.0; AXES]; 2],
            bias_walk_noise: RandomGenerator::new(seed, BIAS_WALK_STREAM),
            slow,
            fast: RandomGenerator::new(seed, FAST_STREAM),
            gyroscope_slow: RandomGenerator::new(seed, GYROSCOPE_SLOW_STREAM),
            gyroscope_fast: RandomGenerator::new(seed, GYROSCOPE_FAST_STREAM),
            latest: RawSample::default(),
        }
    }

    /// Moves the whole IMU by `case_c` away from equilibrium with the chamber, and the sensing elements by another
    /// `element_c` away from their heads \[degC\]: an IMU that is not soaked. Without a time constant in the truth,
    /// elements have the temperature of their heads. The plays are in their middle.
    pub fn displace(&mut self, case_c: f64, element_c: f64) {
        self.chamber.displace(case_c, element_c);
        let head = self.chain.temperature(self.head_c());
        for play in &mut self.plays {
            *play = SimulatedPlay::new(play.play, head);
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
        let time_s = time_ns as f64 / 1e9;
        self.walk_biases(time_s);
        self.move_plays(time_s);
        self.chamber.wait(time_s);
        self.latest.timestamp_ns += time_ns;
    }

    /// Lets the gyroscopes' converters run for `seconds` with `motion`, and discards their pulses: then each holds the
    /// part of a pulse that this motion leaves. Time, temperatures and random numbers do not advance.
    pub fn settle(&mut self, motion: &InertialMotion, seconds: f64) {
        let (head_c, board_c) = self.chamber.head_and_board_c();
        let temperature = self.gyroscope_temperature(head_c, board_c);
        let plays: Vec<_> = self.plays.iter().map(SimulatedPlay::ahead).collect();
        let [_, memory] = self.bias_memory(self.chamber.element_c() - head_c, &plays);
        if let Some(gyroscopes) = &mut self.gyroscopes {
            gyroscopes.feel(motion, seconds, temperature, memory.map(|bias| bias * seconds), &mut Triad::default());
        }
    }

    /// What the past adds to the biases of accelerometers \[g0\] and gyroscopes \[deg/h\], with the sensing elements
    /// `element_c` above their heads \[degC\] and each play ahead of the temperature by one of `plays`.
    fn bias_memory(&self, element_c: f64, plays: &[f64]) -> [[f64; AXES]; 2] {
        let difference = self.chain.temperature_slope * element_c;
        core::array::from_fn(|kind| {
            core::array::from_fn(|i| {
                let hysteresis: f64 = self
                    .plays
                    .iter()
                    .zip(plays)
                    .map(|(SimulatedPlay { play, .. }, ahead)| [play.accelerometers, play.gyroscopes][kind][i] * ahead)
                    .sum();
                self.transients[kind][i] * difference + hysteresis + self.bias_walk[kind][i]
            })
        })
    }

    /// Lets the biases walk for `time_s` \[s\].
    fn walk_biases(&mut self, time_s: f64) {
        let sizes = [self.noise.bias_walk, self.noise.gyroscope_bias_walk];
        if sizes == [0.0; 2] {
            return;
        }
        // Both kinds take their numbers, so that the accelerometers' output does not depend on whether there are
        // gyroscopes.
        for (size, walk) in sizes.into_iter().zip(&mut self.bias_walk) {
            for bias in walk {
                *bias += size * (time_s / 3600.0).sqrt() * self.bias_walk_noise.normal();
            }
        }
    }

    /// Moves the plays on by `time_s` \[s\], before the chamber. Returns how far each is ahead of the temperature in
    /// the mean over this time.
    fn move_plays(&mut self, time_s: f64) -> Vec<f64> {
        let mut means = vec![0.0; self.plays.len()];
        if self.plays.is_empty() {
            return means;
        }
        let mut chamber = self.chamber.clone();
        let steps = (time_s / PLAY_STEP_S).ceil().max(1.0);
        for _ in 0..steps as u64 {
            chamber.wait(time_s / steps);
            let head = self.chain.temperature(chamber.head_and_board_c().0);
            for (play, mean) in self.plays.iter_mut().zip(&mut means) {
                let before = play.ahead();
                play.follow(head);
                *mean += (before + play.ahead()) / 2.0 / steps;
            }
        }
        means
    }

    /// True temperature of the gyroscopes' heads and boards.
    fn gyroscope_temperature(&self, head_c: f64, board_c: f64) -> [[f64; AXES]; 2] {
        let chain = &self.chain;
        [
            chain.gyroscope_head_offset_c.map(|offset_c| chain.temperature(head_c + offset_c)),
            chain.gyroscope_board_offset_c.map(|offset_c| chain.temperature(board_c + offset_c)),
        ]
    }

    /// Advances by one control period of `interval_ns` with what the IMU feels in it, and returns the sample that the
    /// acquisition latches at its end. Session and `sent_ns` are 0.
    pub fn step(&mut self, motion: &InertialMotion, interval_ns: u64) -> RawSample {
        let ts = interval_ns as f64 / 1e9;
        self.walk_biases(ts);
        let plays = self.move_plays(ts);
        let element_c = self.chamber.element_c();
        self.chamber.wait(ts / 2.0);
        let (head_c, board_c) = self.chamber.head_and_board_c();
        self.chamber.wait(ts / 2.0);
        let memory = self.bias_memory(self.chamber.mean_element_above_head_c(element_c, ts), &plays);

        let begin_ns = self.latest.timestamp_ns;
        let mut raw = RawSample { timestamp_ns: begin_ns + interval_ns, interval_ns, ..self.latest };
        for triad in [&mut raw.accelerometers, &mut raw.gyroscopes] {
            triad.positive_pulses = [0; AXES];
            triad.negative_pulses = [0; AXES];
        }
        self.count_pulses(&mut raw, &motion.specific_force, [head_c, board_c], memory[0]);
        let temperature = self.gyroscope_temperature(head_c, board_c);
        if let Some(gyroscopes) = &mut self.gyroscopes {
            // 1 deg/sqrt(h) is 60 arcsec/sqrt(s).
            let size = self.noise.random_walk * 60.0 * ts.sqrt();
            let added = memory[1].map(|bias| bias * ts + size * self.gyroscope_fast.normal());
            gyroscopes.feel(motion, ts, temperature, added, &mut raw.gyroscopes);
        }
        // The first sample (sequence 0) always reads the temperature.
        if raw.sequence == 0 || raw.timestamp_ns - raw.telemetry_ns >= (self.chain.temperature_s * 1e9).round() as u64 {
            self.read_temperature(&mut raw);
        }
        self.latest = RawSample { sequence: raw.sequence + 1, ..raw };
        raw
    }

    /// Adds the pulses of the accelerometers in one period to `raw`. `memory` is what the past adds to the biases
    /// \[g0\].
    fn count_pulses(
        &mut self,
        raw: &mut RawSample,
        specific_force: &[f64; AXES],
        [head_c, board_c]: [f64; 2],
        memory: [f64; AXES],
    ) {
        let chain = &self.chain;
        let ts = raw.interval_ns as f64 / 1e9;
        let force = self.misalignment * Vector3::from(*specific_force);
        let white = self.noise.sensor_g0 / ts.sqrt();
        let steady: [f64; AXES] = core::array::from_fn(|i| {
            let head = chain.temperature(head_c + chain.head_offset_c[i]);
            force[i] + self.accelerometers.bias(i, head) + memory[i] + white * self.fast.normal()
        });
        let board = chain.board_offset_c.map(|offset_c| chain.temperature(board_c + offset_c));
        let scale_factors = self.accelerometers.scale_factors(board);
        let vibrates = chain.vibration_g0 != 0.0 && chain.vibration_hz > 0.0;
        let steps = if vibrates { (ts * chain.vibration_hz * SUB_STEPS).ceil().max(1.0) } else { 1.0 };
        let begin = (((raw.timestamp_ns - raw.interval_ns) as f64 / 1e9) * chain.vibration_hz).fract();
        // The integral of a sin(w t) over a sub-step is a/w (cos(w t0) - cos(w t1)).
        let cos = |step: f64| libm::cos(TAU * (begin + ts * chain.vibration_hz * step / steps));
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

    /// Reads the temperature at the end of the period.
    fn read_temperature(&mut self, raw: &mut RawSample) {
        let (head_c, board_c) = self.chamber.head_and_board_c();
        let (chain, sigma) = (&self.chain, self.noise.temperature);
        let read =
            |triad: &mut Triad, [head_offset_c, board_offset_c]: [[f64; AXES]; 2], random: &mut RandomGenerator| {
                let mut reading =
                    |temperature_c| chain.quantised(chain.temperature(temperature_c) + sigma * random.normal());
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
