//! What accelerometers and gyroscopes have in common before they are calibrated: units,
//! limits, sensors at one set point.

use crate::effects::{BIAS_EFFECT, GYROSCOPE_BIAS_EFFECT, GYROSCOPE_SCALE_FACTOR_EFFECT, SCALE_FACTOR_EFFECT};
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::AXES;

/// What the figures of a triad are shown in.
#[derive(Debug)]
pub struct TriadUnits {
    /// One of its sensors.
    pub sensor: &'static str,
    /// Unit of the bias in the table and in texts.
    pub bias: &'static str,
    /// Factor from a bias of the fit to that unit.
    pub bias_factor: f64,
    /// Decimals of a bias in that unit.
    pub bias_decimals: usize,
    /// Decimals of its accuracy in the bottom line.
    pub accuracy_decimals: usize,
    /// All of them.
    pub(crate) names: [&'static str; AXES],
    /// Smallest changes of the bias, in its unit in the fit, and of a scale factor, relative, that matter.
    pub(crate) effects: [f64; 2],
    /// Constant part of the limit of a residual, in the residual's unit: g0, arcsec/sqrt(s).
    pub(crate) outlier_floor: f64,
    /// What stands behind a bias in a text, whose unit is as large as `bias`.
    pub(crate) behind_bias: &'static str,
    /// Unit of the bias in the fit.
    pub fitted_bias: &'static str,
    /// Unit of the bias on a page, which is as large as `bias`.
    pub bias_on_page: &'static str,
    /// Unit of a scale factor.
    pub scale_factor: &'static str,
    /// The same on a page.
    pub scale_factor_on_page: &'static str,
    /// Decimals of a scale factor.
    pub scale_factor_decimals: usize,
}

const ACCELEROMETERS: TriadUnits = TriadUnits {
    sensor: "accelerometer",
    names: SensorKind::Accelerometer.names(),
    effects: [BIAS_EFFECT, SCALE_FACTOR_EFFECT],
    outlier_floor: 1e-6,
    behind_bias: "e-6 g0",
    bias: "ug0",
    bias_factor: 1e6,
    bias_decimals: 3,
    accuracy_decimals: 2,
    fitted_bias: "g0",
    bias_on_page: "1e-6 g0",
    scale_factor: "pulse/(s*g0)",
    scale_factor_on_page: "pulse/(s g0)",
    scale_factor_decimals: 3,
};

const GYROSCOPES: TriadUnits = TriadUnits {
    sensor: "gyroscope",
    names: SensorKind::Gyroscope.names(),
    effects: [GYROSCOPE_BIAS_EFFECT, GYROSCOPE_SCALE_FACTOR_EFFECT],
    outlier_floor: 0.05,
    behind_bias: " deg/h",
    bias: "deg/h",
    bias_factor: 1.0,
    bias_decimals: 4,
    accuracy_decimals: 4,
    fitted_bias: "deg/h",
    bias_on_page: "deg/h",
    scale_factor: "pulse/arcsec",
    scale_factor_on_page: "pulse/arcsec",
    scale_factor_decimals: 7,
};

impl TriadUnits {
    /// A bias of the fit with its unit, as texts give its accuracy.
    #[must_use]
    pub fn bias_text(&self, bias: f64) -> String {
        format!("{:.*} {}", self.accuracy_decimals, bias * self.bias_factor, self.bias)
    }

    /// A bias of the fit in m/s2 or rad/s; `gravity` is 1 g0 \[m/s2\].
    #[must_use]
    pub fn si(&self, bias: f64, gravity: f64) -> (f64, &'static str) {
        if self.sensor == ACCELEROMETERS.sensor { (bias * gravity, "m/s2") } else { (bias * ARCSEC, "rad/s") }
    }

    /// The same with three digits and both units: `0.00141 m/s2 (144 ug0)`.
    #[must_use]
    pub fn si_text(&self, bias: f64, gravity: f64) -> String {
        let (value, unit) = self.si(bias, gravity);
        format!("{} {unit} ({} {})", three_digits(value), three_digits(bias * self.bias_factor), self.bias)
    }

    /// Those of a kind of sensors.
    pub const fn of(kind: SensorKind) -> &'static Self {
        match kind {
            SensorKind::Accelerometer => &ACCELEROMETERS,
            SensorKind::Gyroscope => &GYROSCOPES,
        }
    }

    /// Unit of a quantity in the table: of the bias, then of K+ and K-.
    pub const fn in_table(&self, quantity: usize) -> &'static str {
        if quantity == 0 { self.bias } else { self.scale_factor }
    }

    /// Unit of a quantity in the fit.
    pub const fn in_fit(&self, quantity: usize) -> &'static str {
        if quantity == 0 { self.fitted_bias } else { self.scale_factor }
    }

    /// Unit of a quantity on a page.
    pub const fn on_page(&self, quantity: usize) -> &'static str {
        if quantity == 0 { self.bias_on_page } else { self.scale_factor_on_page }
    }

    /// Factor from a value of the fit to the units of the table and of a page.
    pub const fn factor(&self, quantity: usize) -> f64 {
        if quantity == 0 { self.bias_factor } else { 1.0 }
    }
}

/// A sensor at one set point, reduced by itself.
#[derive(Debug)]
pub struct ReducedSensor<'a> {
    /// Effective temperature of bias, K+ and K-.
    pub temperature: [f64; 3],
    /// Bias, K+, K-, the misalignments \[rad\], and whatever comes after them.
    pub values: &'a [f64],
    /// Their standard errors.
    pub standard_errors: &'a [f64],
    /// Degrees of freedom of the errors.
    pub freedom: usize,
}

/// Three digits at least, as a decimal number.
fn three_digits(value: f64) -> String {
    let before = libm::log10(value.abs().max(1e-12)).floor();
    format!("{value:.*}", (2.0 - before).clamp(0.0, 12.0) as usize)
}
