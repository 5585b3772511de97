//! Simulated warm-ups at one attitude, reading by reading, with a known truth.

use isotherm_campaign::Campaign;
use isotherm_fit::{CalibrationError, LagChoice, RampRecording, WarmUpCalibration, WarmUpOptions, calibrate_warm_up};
use isotherm_recording::CampaignRow;
use isotherm_shared::names::ImuId;
use isotherm_shared::readings::Resolution;
use isotherm_shared::table::{Nominal, nominal_table};
use isotherm_shared::wire::{AXES, RawSample, Triad};
use isotherm_simulation::RandomGenerator;
use std::ops::Range;

/// 1 g0 \[m/s2\].
pub(super) const GRAVITY: f64 = 9.80665;
/// A reading of a sensor of 16 bits \[m/s2\] and \[rad/s\].
pub(super) const LSB: [f64; 2] = [4.0 * GRAVITY / 32768.0, 35.0 / 32768.0];

/// Of the rows of a log.
pub(super) const RESOLUTION: Resolution = Resolution { accelerometer: 1e-6, gyroscope: 1e-7 };

/// How the temperature goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Course {
    /// With this part of the duration as time constant.
    Exponential(f64),
    Linear,
    /// There and back.
    HeatAndCool,
}

/// A recording that is simulated.
#[derive(Clone, Debug)]
pub(super) struct Setting {
    /// Rows a second.
    pub rate: f64,
    pub minutes: f64,
    /// From and to \[degC\].
    pub range: [f64; 2],
    pub course: Course,
    /// White noise of a row \[m/s2\] and \[rad/s\].
    pub noise: [f64; 2],
    /// A flicker floor, as a part of the white noise.
    pub flicker: f64,
    /// Step and noise of the thermometer \[degC\].
    pub thermometer: [f64; 2],
    /// Step of the readings, as a part of the white noise; 0 of none.
    pub coarse: f64,
    /// Self-heating after the start: size \[degC\] and time constant \[s\].
    pub start: [f64; 2],
}

impl Setting {
    pub(super) fn usual() -> Self {
        Self {
            rate: 1.0,
            minutes: 25.0,
            range: [-15.0, 55.0],
            course: Course::Exponential(0.25),
            noise: [0.02, 0.002],
            flicker: 0.0,
            thermometer: [0.0, 0.02],
            coarse: 0.0,
            start: [0.0, 20.0],
        }
    }

    /// A setting of any kind, with at most `rows` rows.
    pub(super) fn drawn(random: &mut RandomGenerator, rows: f64) -> Self {
        let log = |random: &mut RandomGenerator, [low, high]: [f64; 2]| low * libm::pow(high / low, random.uniform());
        let rate = [1.0, 1.0, 2.0, 5.0, 10.0, 50.0, 200.0][(random.uniform() * 7.0) as usize];
        let low = random.between(-30.0, 25.0);
        Self {
            rate,
            minutes: random.between(20.0, 120.0).min(rows / rate / 60.0).max(5.0),
            range: [low, low + random.between(15.0, 70.0)],
            course: match random.uniform() {
                part if part < 0.6 => Course::Exponential(log(random, [0.08, 0.5])),
                part if part < 0.8 => Course::Linear,
                _ => Course::HeatAndCool,
            },
            noise: [log(random, [0.002, 0.03]), log(random, [0.0002, 0.003])],
            flicker: if random.uniform() < 0.4 { random.between(0.05, 0.5) } else { 0.0 },
            thermometer: [
                [0.0, 0.0, 0.01, 1.0 / 256.0, 0.1, 0.5, 1.0][(random.uniform() * 7.0) as usize],
                [0.0, 0.01, 0.05, 0.2][(random.uniform() * 4.0) as usize],
            ],
            coarse: if random.uniform() < 0.3 { log(random, [0.3, 8.0]) } else { 0.0 },
            start: [if random.uniform() < 0.5 { random.between(0.0, 8.0) } else { 0.0 }, random.between(5.0, 60.0)],
        }
    }

    pub(super) fn rows(&self) -> usize {
        (self.minutes * 60.0 * self.rate) as usize
    }
}

/// A row of readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub seconds: f64,
    /// \[m/s2\], then \[rad/s\].
    pub sensors: [f64; 6],
    pub celsius: f64,
}

/// A unit, and what it recorded.
#[derive(Clone, Debug)]
pub(super) struct WarmUp {
    pub setting: Setting,
    pub rows: Vec<Row>,
    /// The true curves over the place in the range, -1 to 1: powers 1, 2, 3.
    powers: [[f64; 3]; 6],
}

/// Noise with a flicker floor: sums of first-order processes, an octave apart.
struct Flicker([f64; 8]);

impl Flicker {
    fn next(&mut self, random: &mut RandomGenerator) -> f64 {
        for (octave, state) in self.0.iter_mut().enumerate() {
            let part = 0.5_f64.powi(2 * octave as i32);
            *state += -part * *state + (2.0 * part - part * part).sqrt() * random.normal();
        }
        self.0.iter().sum::<f64>() / 8.0_f64.sqrt()
    }
}

impl WarmUp {
    pub(super) fn new(setting: &Setting, seed: u64) -> Self {
        let mut random = RandomGenerator::new(seed, 50);
        let powers = core::array::from_fn(|sensor| {
            let size = if sensor < AXES { 0.1 } else { 0.005 };
            [1.0, 0.4, 0.25].map(|part| size * part * random.normal())
        });
        let constants = [0.1, -0.2, -9.79, 0.008, -0.002, 0.004];
        let n = setting.rows();
        let seconds = setting.minutes * 60.0;
        let [low, high] = setting.range;
        let mut flickers: [Flicker; 6] = core::array::from_fn(|_| Flicker(core::array::from_fn(|_| random.normal())));
        let mut rows = Vec::with_capacity(n);
        for number in 0..n {
            let t = number as f64 / setting.rate;
            let part = match setting.course {
                Course::Exponential(part) => (1.0 - libm::exp(-t / (part * seconds))) / (1.0 - libm::exp(-1.0 / part)),
                Course::Linear => t / seconds,
                Course::HeatAndCool => 1.0 - (2.0 * t / seconds - 1.0).abs(),
            };
            let start = setting.start[0] * (1.0 - libm::exp(-t / setting.start[1]));
            let whole = high - low;
            let celsius = low + (whole - setting.start[0]).max(0.5 * whole) * part + start;
            let x = (2.0 * celsius - low - high) / whole;
            let sensors = core::array::from_fn(|sensor| {
                let noise = setting.noise[sensor / AXES];
                let [one, two, three] = powers[sensor];
                let flicker = if setting.flicker > 0.0 { flickers[sensor].next(&mut random) } else { 0.0 };
                let value = constants[sensor]
                    + x * (one + x * (two + x * three))
                    + noise * (random.normal() + setting.flicker * flicker);
                let step = setting.coarse * noise;
                if step > 0.0 { (value / step).round() * step } else { value }
            });
            let [step, noise] = setting.thermometer;
            let indicated = celsius + noise * random.normal();
            let indicated = if step > 0.0 { (indicated / step).round() * step } else { indicated };
            rows.push(Row { seconds: t, sensors, celsius: indicated });
        }
        Self { setting: setting.clone(), rows, powers }
    }

    /// The true change of a bias from mid range \[m/s2 or rad/s\].
    pub(super) fn truth(&self, sensor: usize, celsius: f64) -> f64 {
        let [low, high] = self.setting.range;
        let x = (2.0 * celsius - low - high) / (high - low);
        let [one, two, three] = self.powers[sensor];
        x * (one + x * (two + x * three))
    }

    pub(super) fn recording(&self) -> RampRecording {
        let rows = self.rows.iter().enumerate();
        screened(rows.map(|(number, row)| sample(number, interval_ns(self.setting.rate), row.celsius, &row.sensors)))
    }

    /// The calibration, with curves of order 3 unless another is given.
    pub(super) fn calibrated_with(
        &self,
        options: WarmUpOptions,
        in_use: Vec<Range<u64>>,
    ) -> Result<WarmUpCalibration, CalibrationError> {
        let options = WarmUpOptions { lag: LagChoice::None, order: options.order.or(Some(3)), ..options };
        calibrated(self.recording().with_in_use(in_use), self.setting.rate, &options)
    }

    pub(super) fn calibrated(&self) -> Result<WarmUpCalibration, CalibrationError> {
        self.calibrated_with(WarmUpOptions::default(), Vec::new())
    }

    /// The rms error of each curve over the inner 90 % of the range, without its mean, over the white noise of a row.
    pub(super) fn errors(&self, found: &WarmUpCalibration) -> [f64; 6] {
        core::array::from_fn(|sensor| {
            let bias = &found.biases[sensor];
            let factor = if sensor < AXES { GRAVITY } else { core::f64::consts::PI / 180.0 / 3600.0 };
            let [low, high] = self.setting.range;
            let place = |i: i32| low + (high - low) * (0.05 + 0.9 * f64::from(i) / 60.0);
            let error = |i: i32| {
                let at = place(i);
                bias.curve.at(at) * factor - self.truth(sensor, at)
            };
            let all: Vec<f64> = (0..=60).map(error).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let squares = all.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / all.len() as f64;
            squares.sqrt() / self.setting.noise[sensor / AXES]
        })
    }
}

/// Interval of rows of this rate [1/s].
pub(super) fn interval_ns(rate: f64) -> u64 {
    (1e9 / rate) as u64
}

/// A row of readings [m/s2, rad/s], as readers of logs make it.
pub(super) fn sample(number: usize, interval_ns: u64, celsius: f64, sensors: &[f64; 2 * AXES]) -> RawSample {
    // What fits in no counter is a full one.
    let pulses = |value: f64, resolution: f64| {
        let pulses = (value / resolution).round();
        match pulses.abs() < f64::from(u32::MAX) {
            true => [pulses.max(0.0) as u32, (-pulses).max(0.0) as u32],
            false => [u32::MAX, 0],
        }
    };
    let triad = |first: usize, resolution: f64| {
        let all = [0, 1, 2].map(|axis| pulses(sensors[first + axis], resolution));
        Triad {
            positive_pulses: all.map(|[positive, _]| positive),
            negative_pulses: all.map(|[_, negative]| negative),
            head_temperature: [celsius; AXES],
            board_temperature: [celsius; AXES],
            head_lagged: [0.0; AXES],
        }
    };
    RawSample {
        sequence: number as u64,
        timestamp_ns: 1_000_000_000 + (number as u64 + 1) * interval_ns,
        interval_ns,
        accelerometers: triad(0, RESOLUTION.accelerometer),
        gyroscopes: triad(AXES, RESOLUTION.gyroscope),
        ..RawSample::default()
    }
}

/// A recording of rows, read as the command reads a log.
pub(super) fn screened(samples: impl Iterator<Item = RawSample>) -> RampRecording {
    let row = |(line, sample): (usize, RawSample)| {
        Ok(CampaignRow { line: line as u64 + 2, set_point_c: 0.0, position: None, sample })
    };
    RampRecording::read_screened("log", samples.enumerate().map(row)).unwrap()
}

/// The calibration of a recording with the nominal table of its readings.
pub(super) fn calibrated(
    recording: RampRecording,
    rate: f64,
    options: &WarmUpOptions,
) -> Result<WarmUpCalibration, CalibrationError> {
    let imu = ImuId::new("a").unwrap();
    let nominal = nominal_table(&Nominal::new(imu.clone(), interval_ns(rate), [-100.0, 200.0])).unwrap();
    let campaign = Campaign::warm_up(imu, GRAVITY, "degC", &["log".to_owned()]);
    calibrate_warm_up(&campaign, &[recording], &nominal, options)
}
