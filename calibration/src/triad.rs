//! A triad of a calibration, as it is shown: what accelerometers and gyroscopes have in common. Texts, reports,
//! provenance and accuracy of both triads come from this.

use crate::gyroscopes::GyroscopeCalibration;
use crate::result::Calibration;
use isotherm_campaign::PARAMETERS;
use isotherm_finding::Finding;
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, OrderTable};

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
    /// Effective telemetry of bias, K+ and K-.
    pub telemetry: [f64; 3],
    /// Bias, K+, K-, the misalignments \[rad\], and whatever comes after them.
    pub values: &'a [f64],
    /// Their standard errors.
    pub standard_errors: &'a [f64],
    /// Degrees of freedom of the errors.
    pub freedom: usize,
}

/// A triad of a calibration.
#[derive(Debug)]
pub struct CalibratedTriad<'a> {
    /// Its sensors.
    pub names: [&'static str; AXES],
    /// How its quantities are shown.
    pub units: &'static TriadUnits,
    /// Bias, K+ and K- of each sensor.
    pub curves: [&'a [Curve; 3]; AXES],
    /// The order tables, by sensor and quantity.
    pub orders: &'a [[OrderTable; 3]; AXES],
    /// Misalignment onto the next axis and onto the one after it \[rad\].
    pub misalignment: [[f64; 2]; AXES],
    /// Their standard errors \[rad\].
    pub misalignment_error: [Option<[f64; 2]>; AXES],
    /// Half widths of their 95 % intervals \[rad\].
    pub misalignment_interval: [Option<[f64; 2]>; AXES],
    /// Temperature of each set point \[degC\], and its sensors.
    pub set_points: Vec<(f64, [ReducedSensor<'a>; AXES])>,
    /// What was found about this triad.
    pub findings: &'a [Finding],
    /// What gyroscopes have beside that.
    pub gyroscopes: Option<&'a GyroscopeCalibration>,
}

impl<'a> CalibratedTriad<'a> {
    /// The triads of a calibration: the accelerometers, and the gyroscopes if there are any.
    pub fn all(calibration: &'a Calibration) -> impl Iterator<Item = Self> {
        let gyroscopes = calibration.gyroscopes.as_ref().map(|found| Self::gyroscopes(calibration, found));
        core::iter::once(Self::accelerometers(calibration)).chain(gyroscopes)
    }

    /// The accelerometers of a calibration.
    pub fn accelerometers(calibration: &'a Calibration) -> Self {
        let axes = &calibration.solution.axes;
        let all = calibration.findings.len();
        let first_of_gyroscopes = calibration.gyroscopes.as_ref().map_or(all, |found| found.first_finding);
        let set_points = calibration.set_points.iter().zip(&calibration.reduced);
        let reduced = set_points.map(|(stay, sensors)| {
            let freedom = stay.dwells.len().saturating_sub(PARAMETERS);
            let sensor = |axis: usize| ReducedSensor {
                telemetry: sensors[axis].telemetry,
                values: &sensors[axis].values,
                standard_errors: &sensors[axis].standard_errors,
                freedom,
            };
            (stay.set_point_c, [sensor(0), sensor(1), sensor(2)])
        });
        Self {
            names: AXIS_NAMES,
            units: &ACCELEROMETERS,
            curves: axes.each_ref().map(|axis| &axis.curves),
            orders: &calibration.orders,
            misalignment: axes.each_ref().map(|axis| axis.misalignment),
            misalignment_error: axes.each_ref().map(|axis| axis.misalignment_error),
            misalignment_interval: axes.each_ref().map(|axis| axis.misalignment_interval(CONFIDENCE)),
            set_points: reduced.collect(),
            findings: &calibration.findings[..first_of_gyroscopes],
            gyroscopes: None,
        }
    }

    /// The gyroscopes of a calibration.
    pub fn gyroscopes(calibration: &'a Calibration, found: &'a GyroscopeCalibration) -> Self {
        let axes = &found.solution.gyroscopes;
        let set_points = calibration.set_points.iter().zip(&found.reduced);
        let reduced = set_points.map(|(stay, sensors)| {
            let sensor = |axis: usize| ReducedSensor {
                telemetry: sensors.telemetry[axis],
                values: &sensors.values[axis],
                standard_errors: &sensors.standard_errors[axis],
                freedom: sensors.freedom,
            };
            (stay.set_point_c, [sensor(0), sensor(1), sensor(2)])
        });
        Self {
            names: GYROSCOPE_NAMES,
            units: &GYROSCOPES,
            curves: axes.each_ref().map(|axis| &axis.curves),
            orders: &found.orders,
            misalignment: axes.each_ref().map(|axis| axis.misalignment),
            misalignment_error: axes.each_ref().map(|axis| axis.misalignment_error),
            misalignment_interval: axes.each_ref().map(|axis| axis.misalignment_interval(CONFIDENCE)),
            set_points: reduced.collect(),
            findings: &calibration.findings[found.first_finding..],
            gyroscopes: Some(found),
        }
    }
}

/// The matrix with these values beside the diagonal: row i has the value onto the next axis and the one onto the axis
/// after it.
pub(crate) fn beside_diagonal(diagonal: f64, pairs: [[f64; 2]; AXES]) -> [[f64; AXES]; AXES] {
    let mut rows = [[diagonal; AXES]; AXES];
    for (axis, pair) in pairs.into_iter().enumerate() {
        for (k, value) in pair.into_iter().enumerate() {
            rows[axis][(axis + 1 + k) % AXES] = value;
        }
    }
    rows
}
