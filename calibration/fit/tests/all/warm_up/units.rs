//! Units whose biases are of a known order, and their warm-ups with hysteresis and lag.

use super::curves::{RESOLUTION, interval_ns, sample};
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_simulation::RandomGenerator;

/// A1 to G3.
pub(super) const SENSORS: usize = 2 * AXES;
/// Time constants of what makes a floor of flicker together [s].
const FLICKER_S: [f64; 5] = [10.0, 30.0, 100.0, 300.0, 1000.0];
/// Half width of the play that makes hysteresis [degC].
const PLAY: f64 = 3.0;

/// How the temperature changes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Path {
    /// It rises by this much in all, and slows down by so many time constants.
    Exponential(f64),
    Linear,
    /// It rises as above for 0.6 of the time, and falls.
    AndCools(f64),
}

/// A kind of warm-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct WarmUp {
    pub path: Path,
    /// Rows a second.
    pub rate_hz: u32,
    pub minutes: f64,
    /// Noise of a row of an accelerometer [m/s2]; a gyroscope has a tenth [rad/s].
    pub noise: f64,
    /// Floor of flicker, in parts of the noise of a row.
    pub flicker: f64,
    /// Largest error by hysteresis, usually [m/s2]; a gyroscope has a tenth [rad/s].
    pub hysteresis: f64,
    /// Lag of the elements behind the temperature [s].
    pub lag_s: f64,
}

impl WarmUp {
    pub(super) const fn new(path: Path, rate_hz: u32, minutes: f64, noise: f64) -> Self {
        Self { path, rate_hz, minutes, noise, flicker: 0.0, hysteresis: 0.0, lag_s: 0.0 }
    }

    fn temperature(&self, part: f64) -> f64 {
        let heating =
            |part: f64, shape: f64| -17.0 + 69.0 * (1.0 - libm::exp(-part * shape)) / (1.0 - libm::exp(-shape));
        match self.path {
            Path::Exponential(shape) => heating(part, shape),
            Path::Linear => -15.0 + 70.0 * part,
            Path::AndCools(shape) if part < 0.6 => heating(part / 0.6, shape),
            Path::AndCools(shape) => 15.0 + 37.0 * libm::exp(-(part - 0.6) / 0.4 * shape),
        }
    }
}

/// The biases of a unit: polynomials of the temperature less 25 degC [m/s2, rad/s].
#[derive(Clone, Debug)]
pub(super) struct Unit(pub [[f64; 4]; SENSORS]);

impl Unit {
    /// Cubics of this order, as large as those of consumer IMUs.
    pub(super) fn new(order: usize, random: &mut RandomGenerator) -> Self {
        const SIZES: [[f64; 4]; 2] = [[0.05, 2e-3, 3e-5, 2e-7], [0.01, 2e-4, 3e-6, 2e-8]];
        let of = |sensor: usize, k: usize, random: &mut RandomGenerator| {
            SIZES[sensor / AXES][k] * random.normal() * f64::from(u8::from(k <= order))
        };
        Self(core::array::from_fn(|sensor| core::array::from_fn(|k| of(sensor, k, random))))
    }

    pub(super) fn at(&self, sensor: usize, temperature: f64) -> f64 {
        let x = temperature - 25.0;
        self.0[sensor].iter().rev().fold(0.0, |sum, c| sum * x + c)
    }
}

/// The rows of a warm-up.
pub(super) fn rows(unit: &Unit, kind: &WarmUp, random: &mut RandomGenerator) -> Vec<RawSample> {
    let interval_s = 1.0 / f64::from(kind.rate_hz);
    let count = (kind.minutes * 60.0 / interval_s) as usize;
    let attitude = [0.1, -0.2, -9.79, 0.0, 0.0, 0.0];
    let mut flicker: Vec<[f64; SENSORS]> =
        FLICKER_S.iter().map(|_| core::array::from_fn(|_| random.normal())).collect();
    let plays: [f64; SENSORS] = core::array::from_fn(|_| kind.hysteresis * random.normal());
    let mut element = kind.temperature(0.0);
    let mut play = element;
    let row = |i: usize| {
        let temperature = kind.temperature(i as f64 / (count - 1) as f64);
        element += if kind.lag_s > 0.0 {
            (temperature - element) * (-libm::expm1(-interval_s / kind.lag_s))
        } else {
            temperature - element
        };
        play = play.max(temperature - PLAY).min(temperature + PLAY);
        if kind.flicker > 0.0 {
            for (state, tau) in flicker.iter_mut().zip(FLICKER_S) {
                let keep = libm::exp(-interval_s / tau);
                state.iter_mut().for_each(|x| *x = keep * *x + (1.0 - keep * keep).sqrt() * random.normal());
            }
        }
        let reading = |sensor: usize| {
            let part = if sensor < AXES { 1.0 } else { 0.1 };
            let floor: f64 = flicker.iter().map(|state| state[sensor]).sum::<f64>() / (FLICKER_S.len() as f64).sqrt();
            let noise = kind.noise * (random.normal() + kind.flicker * floor);
            let off = plays[sensor] * (play - temperature) / PLAY;
            attitude[sensor] + unit.at(sensor, element) + part * (noise + off)
        };
        let readings: [f64; SENSORS] = core::array::from_fn(reading);
        sample(i, interval_ns(f64::from(kind.rate_hz)), temperature, &readings)
    };
    (0..count).map(row).collect()
}

/// The plain cubic of all rows, which weigh alike, of each sensor: the place, from -1 to 1, of a temperature, and the
/// coefficients.
pub(super) fn plain_cubics(rows: &[RawSample]) -> impl Fn(usize, f64) -> f64 {
    use nalgebra::{Matrix4, Vector4};
    let of = |raw: &RawSample| raw.accelerometers.head_temperature[0];
    let [low, high] = rows.iter().map(of).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], t| [a.min(t), b.max(t)]);
    let powers = move |t: f64| {
        let x = (2.0 * t - low - high) / (high - low);
        Vector4::new(1.0, x, x * x, x * x * x)
    };
    let normal: Matrix4<f64> = rows.iter().map(|raw| powers(of(raw)) * powers(of(raw)).transpose()).sum();
    let inverse = normal.try_inverse().unwrap();
    let fits: [Vector4<f64>; SENSORS] = core::array::from_fn(|sensor| {
        let value = |raw: &RawSample| {
            let (triad, axis) = ([&raw.accelerometers, &raw.gyroscopes][sensor / AXES], sensor % AXES);
            let resolution = [RESOLUTION.accelerometer, RESOLUTION.gyroscope][sensor / AXES];
            (f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])) * resolution
        };
        inverse * rows.iter().map(|raw| powers(of(raw)) * value(raw)).sum::<Vector4<f64>>()
    });
    move |sensor, t| fits[sensor].dot(&powers(t))
}
