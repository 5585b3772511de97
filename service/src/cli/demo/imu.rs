//! A simulated IMU at rest, for the demonstration: it obeys a coefficient table, plus noise.

use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};

/// Control period \[ns\]: 10 samples a second.
pub const INTERVAL_NS: u64 = 100_000_000;
/// Temperatures at the ends of the run \[degC\], and the telemetry there \[V\].
const COLD: (f64, f64) = (-25.0, 1.1);
const HOT: (f64, f64) = (45.0, 3.9);
/// Chamber ramp \[degC/s\]: the range in one hour.
const RAMP: f64 = (HOT.0 - COLD.0) / 3600.0;
/// Time constants of sensor head and converter board behind the chamber \[s\].
const HEAD_LAG: f64 = 120.0;
const BOARD_LAG: f64 = 240.0;
/// White noise of a sensor over one period, one sigma \[g0\].
const SENSOR_NOISE: f64 = 10e-6;
/// White noise of a telemetry reading, one sigma \[V\], and its resolution (16 bits over 5 V).
const TELEMETRY_NOISE: f64 = 0.1e-3;
const TELEMETRY_LSB: f64 = 5.0 / 65536.0;
/// A telemetry reading is taken every so many periods.
const TELEMETRY_EVERY: u64 = 10;

/// Specific force along A1, A2, A3 \[g0\]: at rest, tilted so that every axis carries a part of gravity, A2 a negative one.
pub const SPECIFIC_FORCE: [f64; AXES] = [0.6, -0.48, 0.64];

/// What the demonstration says about the IMU.
pub const DESCRIPTION: &str = "simulated IMU at rest, specific force (0.60, -0.48, 0.64) g0 along A1, A2, A3; \
     -25..45 degC at 70 degC/h; sensor noise 10 ug0 a sample at 10 Hz, telemetry noise 0.1 mV, 16 bits, pulses quantised";

/// Where the chamber is going.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Chamber {
    Heating,
    Holding,
    Cooling,
}

/// The IMU with everything that it remembers.
pub struct Imu<'a> {
    truth: &'a CoefficientTable,
    chamber: f64,
    head: f64,
    board: f64,
    /// Charge that has not made a whole pulse yet, by axis.
    residue: [f64; AXES],
    telemetry: ([f64; AXES], [f64; AXES]),
    count: u64,
    noise: Noise,
}

impl<'a> Imu<'a> {
    /// At the cold end, in equilibrium.
    pub fn new(truth: &'a CoefficientTable, seed: u64) -> Self {
        let (chamber, head, board) = (COLD.0, COLD.0, COLD.0);
        Self {
            truth,
            chamber,
            head,
            board,
            residue: [0.0; AXES],
            telemetry: ([0.0; AXES], [0.0; AXES]),
            count: 0,
            noise: Noise(seed),
        }
    }

    /// Whether the sensor head has come within 0.5 degC of the end that the chamber is going to.
    pub fn has_arrived(&self, chamber: Chamber) -> bool {
        match chamber {
            Chamber::Heating => self.head > HOT.0 - 0.5,
            Chamber::Cooling => self.head < COLD.0 + 0.5,
            Chamber::Holding => true,
        }
    }

    /// Lets one control period pass and fills in what the acquisition would latch.
    pub fn step(&mut self, chamber: Chamber, raw: &mut RawSample) {
        let ts = INTERVAL_NS as f64 / 1e9;
        self.count += 1;
        self.chamber = match chamber {
            Chamber::Heating => (self.chamber + RAMP * ts).min(HOT.0),
            Chamber::Holding => self.chamber,
            Chamber::Cooling => (self.chamber - RAMP * ts).max(COLD.0),
        };
        self.head += (self.chamber - self.head) * ts / HEAD_LAG;
        self.board += (self.chamber - self.board) * ts / BOARD_LAG;
        if self.count % TELEMETRY_EVERY == 1 {
            self.telemetry = ([(); AXES].map(|()| self.read(self.head)), [(); AXES].map(|()| self.read(self.board)));
        }
        raw.timestamp_ns = self.count * INTERVAL_NS;
        raw.interval_ns = INTERVAL_NS;
        raw.telemetry_ns = (self.count - (self.count - 1) % TELEMETRY_EVERY) * INTERVAL_NS;
        (raw.head_temperature, raw.board_temperature) = self.telemetry;
        (raw.positive_pulses, raw.negative_pulses) = ([0; AXES], [0; AXES]);
        for (index, force) in SPECIFIC_FORCE.into_iter().enumerate() {
            // Equation (17) the other way round: the bias is part of what the sensor indicates.
            let axis = &self.truth.content().axes[index];
            let indicated = force + axis.bias_at(volts(self.head)).0 + SENSOR_NOISE * self.noise.normal();
            let scale_factor = if indicated > 0.0 {
                axis.positive_scale_factor_at(volts(self.board)).0
            } else {
                axis.negative_scale_factor_at(volts(self.board)).0
            };
            self.residue[index] += scale_factor.abs() * indicated * ts;
            let whole = self.residue[index].trunc();
            self.residue[index] -= whole;
            let pulses = if whole > 0.0 { &mut raw.positive_pulses } else { &mut raw.negative_pulses };
            pulses[index] = whole.abs() as u32;
        }
    }

    fn read(&mut self, temperature: f64) -> f64 {
        let volts = volts(temperature) + TELEMETRY_NOISE * self.noise.normal();
        (volts / TELEMETRY_LSB).round() * TELEMETRY_LSB
    }
}

fn volts(temperature: f64) -> f64 {
    COLD.1 + (temperature - COLD.0) * (HOT.1 - COLD.1) / (HOT.0 - COLD.0)
}

/// Telemetry in the middle of the run \[V\].
pub fn middle() -> f64 {
    (COLD.1 + HOT.1) / 2.0
}

/// SplitMix64 and the Box-Muller transform: reproducible from a seed, and good enough for noise.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (core::f64::consts::TAU * self.uniform()).cos()
    }
}
