//! Recordings from files, and of a simulated tumble.

use isotherm_campaign::Campaign;
use isotherm_fit::{CalibrationError, TumbleCalibration, TumbleOptions, TumbleRecording, calibrate_tumble};
use isotherm_recording::RawCsvReader;
use isotherm_shared::names::ImuId;
use isotherm_shared::wire::RawSample;
use isotherm_simulation::RandomGenerator;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use serde_json::Value;
use std::fs::File;

pub(crate) const STANDARD: f64 = 9.80665;

pub(crate) fn path(name: &str) -> String {
    format!("{}/tests/data/any_lab/{name}", env!("CARGO_MANIFEST_DIR"))
}

pub(crate) fn samples(name: &str) -> Vec<RawSample> {
    let file = File::open(path(name)).unwrap();
    RawCsvReader::new(file).unwrap().map(Result::unwrap).collect()
}

pub(crate) fn json(name: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path(name)).unwrap()).unwrap()
}

pub(crate) fn recording(rows: &[RawSample]) -> TumbleRecording {
    let mut recording = TumbleRecording::new("tumble.csv");
    rows.iter().for_each(|row| recording.add(row).unwrap());
    recording
}

pub(crate) fn campaign(gravity: [f64; 2]) -> Campaign {
    Campaign::tumble(ImuId::new("imu-t").unwrap(), gravity, "degC")
}

/// The calibration of rows at one temperature or more, with gravity 9.81 for both.
pub(crate) fn calibrated(
    rows: &[RawSample],
    change: impl FnOnce(&mut TumbleOptions),
) -> Result<TumbleCalibration, CalibrationError> {
    let mut options = TumbleOptions::default();
    change(&mut options);
    calibrate_tumble(&campaign([9.81, 9.81]), &[recording(rows)], &options)
}

/// The truth of a simulated IMU. Curves are in (T - 25)/40.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    /// A \[g0\], K+ and |K-| \[pulse/(s*g0)\] of each axis: coefficients 0 and 1.
    pub axes: [[[f64; 2]; 3]; 3],
    /// M, with 1 on the diagonal and 0 below.
    pub misalignment: Matrix3<f64>,
}

impl Truth {
    pub(crate) fn random(seed: u64) -> Self {
        let mut random = RandomGenerator::new(seed, 1);
        let axes = [0, 1, 2].map(|_| {
            let scale_factor = 90_000.0 * (1.0 + 0.05 * random.normal());
            let slope = scale_factor * 1e-3 * random.normal();
            let ratio = 1.0 + 2e-3 * random.normal();
            [
                [2e-3 * random.normal(), 2e-4 * random.normal()],
                [scale_factor, slope],
                [scale_factor * ratio, slope * ratio],
            ]
        });
        let [m12, m13, m23] = [0, 1, 2].map(|_| 1.5e-3 * random.normal());
        Self { axes, misalignment: Matrix3::new(1.0, m12, m13, 0.0, 1.0, m23, 0.0, 0.0, 1.0) }
    }

    pub(crate) fn value(&self, axis: usize, quantity: usize, temperature_c: f64) -> f64 {
        let [c0, c1] = self.axes[axis][quantity];
        c0 + c1 * (temperature_c - 25.0) / 40.0
    }
}

/// The 26 faces, edges and corners of a cube.
pub(crate) fn cube() -> Vec<Vector3<f64>> {
    let signs = [-1.0, 0.0, 1.0];
    let all = signs.into_iter().flat_map(|x| signs.into_iter().flat_map(move |y| signs.map(|z| Vector3::new(x, y, z))));
    all.filter(|direction| direction.norm() > 0.0).map(|direction| direction.normalize()).collect()
}

/// `direction` tilted by up to `degrees` each about two axes across it.
pub(crate) fn off(random: &mut RandomGenerator, direction: &Vector3<f64>, degrees: f64) -> Vector3<f64> {
    let across = Unit::new_normalize(direction.cross(&Vector3::new(0.3, -0.5, 0.8)));
    let other = Unit::new_normalize(direction.cross(&across));
    let mut tilt = |axis| Rotation3::from_axis_angle(&axis, random.between(-degrees, degrees).to_radians());
    tilt(across) * tilt(other) * direction
}

/// An IMU that counts pulses in intervals of 50 ms.
pub(crate) struct SimulatedImu {
    truth: Truth,
    random: RandomGenerator,
    gravity: f64,
    /// Noise of a row along each axis \[g0\].
    pub noise: f64,
    /// What is not counted yet \[pulse\], of each channel of each axis.
    left: [[f64; 2]; 3],
    time_s: f64,
    pub rows: Vec<RawSample>,
}

pub(crate) const INTERVAL_S: f64 = 0.05;

impl SimulatedImu {
    pub(crate) fn new(truth: Truth, seed: u64, gravity: f64) -> Self {
        let random = RandomGenerator::new(seed, 2);
        Self { truth, random, gravity, noise: 3e-5, left: [[0.0; 2]; 3], time_s: 0.0, rows: Vec::new() }
    }

    /// A row of a specific force along the body's axes, in units of local gravity.
    pub(crate) fn row(&mut self, direction: &Vector3<f64>, temperature_c: f64, shake: f64) {
        self.time_s += INTERVAL_S;
        let x = self.truth.misalignment * direction * self.gravity;
        let mut sample = RawSample {
            sequence: self.rows.len() as u64,
            timestamp_ns: (self.time_s * 1e9).round() as u64,
            interval_ns: (INTERVAL_S * 1e9) as u64,
            ..RawSample::default()
        };
        let triad = &mut sample.accelerometers;
        for axis in 0..3 {
            let head = temperature_c + 0.4 * axis as f64;
            // Temperature has digits of 0.01.
            let temperature = |temperature: f64| (temperature * 100.0).round() / 100.0;
            (triad.head_temperature[axis], triad.board_temperature[axis]) =
                (temperature(head), temperature(head + 2.5));
            let indicated = x[axis] + self.truth.value(axis, 0, head) + (self.noise + shake) * self.random.normal();
            let (channel, quantity) = if indicated >= 0.0 { (0, 1) } else { (1, 2) };
            let left = &mut self.left[axis][channel];
            *left += indicated.abs() * self.truth.value(axis, quantity, head + 2.5) * INTERVAL_S;
            let whole = left.floor();
            *left -= whole;
            let counts = if channel == 0 { &mut triad.positive_pulses } else { &mut triad.negative_pulses };
            counts[axis] = whole as u32;
        }
        self.rows.push(sample);
    }

    /// A static pose of `seconds`.
    pub(crate) fn rest(&mut self, direction: &Vector3<f64>, temperature_c: f64, seconds: f64) {
        for _ in 0..(seconds / INTERVAL_S).round() as usize {
            self.row(direction, temperature_c, 0.0);
        }
    }

    /// A movement by hand from one attitude to another.
    pub(crate) fn movement(&mut self, from: &Vector3<f64>, to: &Vector3<f64>, temperature_c: f64) {
        let rows = (self.random.between(1.0, 2.5) / INTERVAL_S) as usize;
        let bow = Vector3::new(self.random.normal(), self.random.normal(), self.random.normal()) * 0.5;
        for k in 1..rows {
            let part = k as f64 / rows as f64;
            let way = from * (1.0 - part) + to * part + bow * (part * (1.0 - part));
            self.row(&way.normalize(), temperature_c, 0.05);
        }
    }

    /// A gap: the recording goes on later.
    pub(crate) fn gap(&mut self, seconds: f64) {
        self.time_s += seconds;
    }

    /// Every direction at `temperature_c`, with movements between, while the temperature creeps.
    pub(crate) fn tumble(&mut self, directions: &[Vector3<f64>], temperature_c: f64) {
        for (index, direction) in directions.iter().enumerate() {
            let temperature = temperature_c + 0.4 * index as f64 / directions.len() as f64;
            if index > 0 {
                self.movement(&directions[index - 1], direction, temperature);
            }
            let seconds = self.random.between(3.0, 5.5);
            self.rest(direction, temperature, seconds);
        }
        self.gap(1800.0);
    }
}

/// Static poses without movements, at one temperature: a gap lies between, which is exact for what attitudes allow.
pub(crate) fn put_down(directions: &[Vector3<f64>], temperatures_c: &[f64]) -> Vec<RawSample> {
    let mut imu = SimulatedImu::new(Truth::random(3), 3, 1.0);
    imu.noise = 2e-5;
    for temperature in temperatures_c {
        for direction in directions {
            imu.rest(direction, *temperature, 1.0);
            imu.gap(10.0);
        }
    }
    imu.rows
}

/// The findings of a calibration, a line each.
pub(crate) fn messages(found: &TumbleCalibration) -> Vec<String> {
    found.findings.iter().map(ToString::to_string).collect()
}
