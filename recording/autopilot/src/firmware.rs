//! What the firmwares make of their parameters: their formulas in float32, each operation rounded as they round it.
//!
//! The formulas are public documentation; `tests/data/golden.csv` has the numbers of the firmwares' own functions,
//! which these reproduce to the last bit.

use isotherm_shared::wire::AXES;

/// The temperature that ArduPilot's polynomials are about \[degC\].
pub const ARDUPILOT_REFERENCE: f32 = 35.0;

/// PX4's parameters of three accelerometers or three gyroscopes.
///
/// ```text
/// d = clamp(T, TMIN, TMAX) - TREF        offset = X0 + X1 d + X2 d^2 + X3 d^3        corrected = reading - offset
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Px4Triad {
    /// TMIN and TMAX \[degC\].
    pub range: [f32; 2],
    /// TREF \[degC\].
    pub reference: f32,
    /// X0 to X3 of each axis \[m/s2 or rad/s, over degC^k\].
    pub coefficients: [[f32; 4]; AXES],
}

impl Px4Triad {
    /// What the firmware subtracts from the readings at a temperature \[degC\], in m/s2 or rad/s.
    #[must_use]
    pub fn offset(&self, temperature: f32) -> [f32; AXES] {
        let d = clamp(temperature, self.range) - self.reference;
        self.coefficients.map(|[x0, x1, x2, x3]| {
            let square = d * d;
            ((x0 + x1 * d) + x2 * square) + x3 * (square * d)
        })
    }
}

/// ArduPilot's parameters of three accelerometers or three gyroscopes.
///
/// ```text
/// p(T) = 1e-6 (c1 t + c2 t^2 + c3 t^3)         t = clamp(T, TMIN, TMAX) - 35 degC
/// corrected = reading + (p(CALTEMP) - p(T)) - OFFS
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArduPilotTriad {
    /// TMIN and TMAX \[degC\].
    pub range: [f32; 2],
    /// c1, c2, c3 of each axis \[1e-6 m/s2 or 1e-6 rad/s, over degC^k\].
    pub coefficients: [[f32; 3]; AXES],
    /// Temperature and offsets of the vehicle's own calibration, if the parameters have them.
    pub constants: Option<Constants>,
}

/// The constants of ArduPilot: a temperature, and what the sensors indicated there without input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constants {
    /// CALTEMP \[degC\].
    pub temperature: f32,
    /// OFFS of each axis \[m/s2 or rad/s\].
    pub offsets: [f32; AXES],
}

impl ArduPilotTriad {
    /// What the firmware adds to the readings at a temperature after a calibration at another one \[degC\], in m/s2 or
    /// rad/s.
    #[must_use]
    pub fn correction(&self, temperature: f32, calibrated: f32) -> [f32; AXES] {
        let [now, then] = [temperature, calibrated].map(|at| clamp(at, self.range) - ARDUPILOT_REFERENCE);
        self.coefficients.map(|c| cubic(c, then) - cubic(c, now))
    }

    /// What the firmware subtracts from the readings at a temperature \[degC\], in m/s2 or rad/s: OFFS less the
    /// correction. Without constants it is relative to 35 degC, or to the end of the range next to it.
    #[must_use]
    pub fn offset(&self, temperature: f32) -> [f32; AXES] {
        let unknown = Constants { temperature: ARDUPILOT_REFERENCE, offsets: [0.0; AXES] };
        let Constants { temperature: calibrated, offsets } = self.constants.unwrap_or(unknown);
        let [x, y, z] = self.correction(temperature, calibrated);
        let [ox, oy, oz] = offsets;
        [ox - x, oy - y, oz - z]
    }
}

fn cubic([c1, c2, c3]: [f32; 3], t: f32) -> f32 {
    (((c3 * t + c2) * t + c1) * t) * 1e-6
}

fn clamp(temperature: f32, [low, high]: [f32; 2]) -> f32 {
    temperature.max(low).min(high)
}
