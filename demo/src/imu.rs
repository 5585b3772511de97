//! The demonstration's IMU: simulated, at rest, and it obeys a coefficient table, plus noise.

use isotherm_calibration::simulate::{self, Noise, Truth};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};

/// Control period \[ns\]: 10 samples a second.
pub const INTERVAL_NS: u64 = 100_000_000;
/// Temperatures at the ends of the run \[degC\].
const COLD: f64 = -25.0;
const HOT: f64 = 45.0;
/// TemperatureRun ramp \[degC/s\]: the range in one hour.
const RAMP: f64 = (HOT - COLD) / 3600.0;

/// Specific force along A1, A2, A3 \[g0\]: at rest, tilted so that every axis carries a part of gravity, A2 a negative one.
pub const SPECIFIC_FORCE: [f64; AXES] = [0.6, -0.48, 0.64];

/// What the demonstration says about the IMU.
pub const DESCRIPTION: &str = "simulated IMU at rest, specific force (0.60, -0.48, 0.64) g0 along A1, A2, A3; \
     -25..45 degC at 70 degC/h; sensor noise 10 ug0 a sample at 10 Hz, telemetry noise 0.1 mV, 16 bits, pulses quantised";

/// Where the chamber is going.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum TemperatureRun {
    Heating,
    Holding,
    Cooling,
}

/// The IMU in its chamber.
pub struct DemoImu(simulate::SimulatedImu);

impl DemoImu {
    /// At the cold end, in equilibrium.
    pub fn new(truth: &CoefficientTable, seed: u64) -> Self {
        // 10 ug0 in 0.1 s.
        let noise = Noise { sensor_g0: 10e-6 * 0.1_f64.sqrt(), ..Noise::default() };
        Self(simulate::SimulatedImu::new(&Truth::of(truth.clone()), &chain(), &noise, COLD, seed))
    }

    /// Whether the sensor head has come within 0.5 degC of the end that the chamber is going to.
    pub fn has_arrived(&self, chamber: TemperatureRun) -> bool {
        match chamber {
            TemperatureRun::Heating => self.0.head_c() > HOT - 0.5,
            TemperatureRun::Cooling => self.0.head_c() < COLD + 0.5,
            TemperatureRun::Holding => true,
        }
    }

    /// Lets one control period pass and fills in what the acquisition would latch.
    pub fn step(&mut self, chamber: TemperatureRun, raw: &mut RawSample) {
        let target = match chamber {
            TemperatureRun::Heating => HOT,
            TemperatureRun::Holding => self.0.chamber_c(),
            TemperatureRun::Cooling => COLD,
        };
        self.0.go_to(target, RAMP);
        let RawSample { session, sequence, sent_ns, .. } = *raw;
        *raw = RawSample { session, sequence, sent_ns, ..self.0.step(&SPECIFIC_FORCE, INTERVAL_NS) };
    }
}

/// Faster than in a laboratory; all parts of the IMU have the same temperature, which is read once a second.
fn chain() -> simulate::Chain {
    simulate::Chain {
        head_lag_s: 120.0,
        board_lag_s: 240.0,
        head_offset_c: [0.0; AXES],
        board_offset_c: [0.0; AXES],
        oscillation_c: 0.0,
        telemetry_s: 1.0,
        ..simulate::Chain::default()
    }
}

/// Telemetry in the middle of the run \[V\].
pub fn middle() -> f64 {
    chain().telemetry((COLD + HOT) / 2.0)
}
