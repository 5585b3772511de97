//! The simulated hardware and its random errors.

use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::AXES;
use serde::{Deserialize, Serialize};

/// The hardware: properties that are the same in every simulation.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Chain {
    /// Time constant of the sensor heads after the chamber's air \[s\], over 0.
    pub head_lag_s: f64,
    /// Time constant of the converter boards after the chamber's air \[s\], over 0.
    pub board_lag_s: f64,
    /// Temperature of each head above the chamber's \[degC\].
    pub head_offset_c: [f64; AXES],
    /// Temperature of each board above the chamber's, by its own heat \[degC\].
    pub board_offset_c: [f64; AXES],
    /// Temperature of each gyroscope's head above the chamber's \[degC\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_head_offset_c: [f64; AXES],
    /// Temperature of each gyroscope's board above the chamber's, by its own heat \[degC\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_board_offset_c: [f64; AXES],
    /// Amplitude of the chamber's slow oscillation \[degC\]; 0 for none.
    pub oscillation_c: f64,
    /// Period of the oscillation \[s\], over 0. The seed determines its phase.
    pub oscillation_s: f64,
    /// Temperature at 0 degC, in the table's unit.
    pub temperature_zero: f64,
    /// Temperature per degC, in the table's unit.
    pub temperature_slope: f64,
    /// Resolution of the temperature in 1e-6 of the table's unit; 0 for none.
    pub telemetry_lsb_micro: u32,
    /// Interval between two readings of the temperature \[s\]; 0 for a reading in every sample.
    pub temperature_s: f64,
    /// Amplitude of a vibration along all input axes, in phase \[g0\]; 0 for none.
    pub vibration_g0: f64,
    /// Frequency of the vibration \[Hz\].
    pub vibration_hz: f64,
}

impl Default for Chain {
    /// Temperature in volts, 1.1 V at -25 degC and 3.9 V at 45 degC, 16 bits over 5 V, read every sample; no vibration.
    fn default() -> Self {
        Self {
            head_lag_s: 300.0,
            board_lag_s: 420.0,
            head_offset_c: [0.0, 0.625, 1.25],
            board_offset_c: [4.0, 3.5, 3.0],
            gyroscope_head_offset_c: [1.75, 2.25, 2.75],
            gyroscope_board_offset_c: [2.5, 2.0, 1.5],
            oscillation_c: 0.05,
            oscillation_s: 3600.0,
            temperature_zero: 2.1,
            temperature_slope: 0.04,
            telemetry_lsb_micro: 76,
            temperature_s: 0.0,
            vibration_g0: 0.0,
            vibration_hz: 0.0,
        }
    }
}

impl Chain {
    /// Temperature at `temperature_c` \[degC\], without noise and resolution.
    ///
    /// ```
    /// use isotherm_simulation::Chain;
    ///
    /// let chain = Chain::default();
    /// assert!((chain.temperature(-25.0) - 1.1).abs() < 1e-12 && (chain.temperature(45.0) - 3.9).abs() < 1e-12); // V
    /// ```
    #[must_use]
    pub fn temperature(&self, temperature_c: f64) -> f64 {
        self.temperature_zero + self.temperature_slope * temperature_c
    }

    /// The nearest multiple of the resolution, as a double that prints with at most six decimals.
    pub(super) fn quantised(&self, temperature: f64) -> f64 {
        match f64::from(self.telemetry_lsb_micro) {
            0.0 => temperature,
            // Adding 0 turns -0 into 0.
            lsb => (temperature * 1e6 / lsb).round() * lsb / 1e6 + 0.0,
        }
    }
}

/// Random differences: standard deviations of Gaussian numbers, 0 for none.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Noise {
    /// White noise of a sensor in a mean over 1 s \[g0\]; in a mean over Ts it is 1/sqrt(Ts) times as large.
    pub sensor_g0: f64,
    /// Noise of a temperature reading, in the table's unit.
    pub temperature: f64,
    /// Offset of the bias in each visit of a set point \[g0\].
    pub bias_g0: f64,
    /// Relative offsets of K+ and K- in each visit of a set point.
    pub scale_factor: f64,
    /// Error of each angle of the turntable in each dwell \[rad\].
    pub positioning_rad: f64,
    /// Random walk of a gyroscope's angle \[deg/sqrt(h)\]: in an interval of Ts seconds it is `60 * sqrt(Ts)` arcsec
    /// times this.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub random_walk: f64,
    /// Offset of a gyroscope's bias in each visit of a set point \[deg/h\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_bias: f64,
    /// Relative offsets of a gyroscope's K+ and K- in each visit of a set point.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_scale_factor: f64,
    /// Error of the angle of each turn \[rad\]. The axis that stands is exact.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn_rad: f64,
    /// Random walk of each accelerometer's bias \[g0/sqrt(h)\]. It begins at 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub bias_walk: f64,
    /// Random walk of each gyroscope's bias \[deg/h/sqrt(h)\]. It begins at 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_bias_walk: f64,
}

/// Whether a value says nothing, as those of the gyroscopes do where there are none.
pub fn is_zero<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for Noise {
    /// Accelerometers 5 ug0 in 1 s, temperature 0.1 mV, visits 0.2 ug0 and 0.3 ppm, angles 1 arcsec. Gyroscopes 0.003
    /// deg/sqrt(h), visits 0.003 deg/h and 0.5 ppm, turns 0.2 arcsec. No random walk of a bias.
    fn default() -> Self {
        Self {
            sensor_g0: 5e-6,
            temperature: 1e-4,
            bias_g0: 0.2e-6,
            scale_factor: 0.3e-6,
            positioning_rad: (1.0_f64 / 3600.0).to_radians(),
            random_walk: 0.003,
            gyroscope_bias: 0.003,
            gyroscope_scale_factor: 0.5e-6,
            turn_rad: 0.2 * ARCSEC,
            bias_walk: 0.0,
            gyroscope_bias_walk: 0.0,
        }
    }
}

impl Noise {
    /// No noise: everything repeats exactly.
    pub const NONE: Self = Self {
        sensor_g0: 0.0,
        temperature: 0.0,
        bias_g0: 0.0,
        scale_factor: 0.0,
        positioning_rad: 0.0,
        random_walk: 0.0,
        gyroscope_bias: 0.0,
        gyroscope_scale_factor: 0.0,
        turn_rad: 0.0,
        bias_walk: 0.0,
        gyroscope_bias_walk: 0.0,
    };
}
