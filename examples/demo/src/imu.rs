//! The demonstration's IMU: simulated, at rest, with the errors of a coefficient table plus noise.

use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_simulation::{Chain, InertialMotion, Noise, SimulatedImu, Truth};

/// Control period \[ns\]: 10 samples a second.
pub(crate) const INTERVAL_NS: u64 = 100_000_000;
/// Temperatures at the ends of the run \[degC\].
const COLD: f64 = -25.0;
const HOT: f64 = 45.0;
/// Rate of the ramp \[degC/s\]: the whole range in one hour.
const RAMP: f64 = (HOT - COLD) / 3600.0;

/// Outer and inner angle of the turntable that the IMU rests on \[deg\]: every accelerometer carries a part of gravity,
/// A2 a negative one.
const ANGLES_DEG: [f64; 2] = [50.0, 130.0];

/// Description of the IMU in the report.
pub(crate) const DESCRIPTION: &str = "simulated IMU at rest, specific force (0.59, -0.49, 0.64) g0 along A1, A2, A3, latitude 39.9 deg; \
     -25..45 degC at 70 degC/h; noise of an accelerometer 10 ug0 a sample at 10 Hz, of a gyroscope 0.003 deg/sqrt(h); temperature noise 0.1 mV, \
     16 bits, pulses quantised";

/// The current part of the temperature run.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum RampPhase {
    Heating,
    Holding,
    Cooling,
}

/// The simulated IMU in its chamber.
pub(crate) struct DemoImu {
    imu: SimulatedImu,
    /// What it feels in a control period.
    motion: InertialMotion,
}

impl DemoImu {
    /// An IMU in equilibrium at the cold end of the run.
    pub(crate) fn new(truth: &CoefficientTable, seed: u64) -> Self {
        // 10 ug0 for a sample of 0.1 s; `sensor_g0` refers to 1 s.
        let noise = Noise { sensor_g0: 10e-6 * 0.1_f64.sqrt(), ..Noise::default() };
        let truth = Truth::of(truth.clone());
        let motion = InertialMotion::at_rest(&truth, ANGLES_DEG, INTERVAL_NS as f64 / 1e9);
        Self { imu: SimulatedImu::new(&truth, &chain(), &noise, COLD, seed), motion }
    }

    /// What the IMU feels in a control period: gravity and Earth's rate.
    pub(crate) const fn motion(&self) -> &InertialMotion {
        &self.motion
    }

    /// Whether the sensor head is within 0.5 degC of the end temperature of `phase`.
    pub(crate) fn has_arrived(&self, phase: RampPhase) -> bool {
        match phase {
            RampPhase::Heating => self.imu.head_c() > HOT - 0.5,
            RampPhase::Cooling => self.imu.head_c() < COLD + 0.5,
            RampPhase::Holding => true,
        }
    }

    /// Advances by one control period and fills in the values that an acquisition would latch.
    pub(crate) fn step(&mut self, phase: RampPhase, raw: &mut RawSample) {
        let target = match phase {
            RampPhase::Heating => HOT,
            RampPhase::Holding => self.imu.chamber_c(),
            RampPhase::Cooling => COLD,
        };
        self.imu.go_to(target, RAMP);
        let RawSample { session, sequence, sent_ns, .. } = *raw;
        *raw = RawSample { session, sequence, sent_ns, ..self.imu.step(&self.motion, INTERVAL_NS) };
    }
}

/// Hardware with shorter time constants than the default, without temperature offsets of heads and boards. The
/// temperature is read once a second.
fn chain() -> Chain {
    Chain {
        head_lag_s: 120.0,
        board_lag_s: 240.0,
        head_offset_c: [0.0; AXES],
        board_offset_c: [0.0; AXES],
        gyroscope_head_offset_c: [0.0; AXES],
        gyroscope_board_offset_c: [0.0; AXES],
        oscillation_c: 0.0,
        temperature_s: 1.0,
        ..Chain::default()
    }
}

/// Temperature at the middle temperature of the run \[V\].
pub(crate) fn middle() -> f64 {
    chain().temperature((COLD + HOT) / 2.0)
}
