//! A triad of a calibration, as it is shown: what accelerometers and gyroscopes have in common. Texts, reports,
//! provenance and accuracy of both triads come from this.

use crate::gyroscopes::GyroscopeCalibration;
use crate::reduce::sensors;
use crate::result::Calibration;
use crate::sensor::{ReducedSensor, TriadUnits};
use isotherm_shared::table::{AXIS_NAMES, GYROSCOPE_NAMES};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, OrderTable};
use isotherm_support::finding::Finding;

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
    /// What gyroscopes have in addition to that.
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
        let reduced = set_points.map(|(stay, reduced)| (stay.set_point_c, sensors(reduced, stay.dwells.len())));
        let is_known = !calibration.solution.tilt_is_open;
        Self {
            names: AXIS_NAMES,
            units: TriadUnits::of(SensorKind::Accelerometer),
            curves: axes.each_ref().map(|axis| &axis.curves),
            orders: &calibration.orders,
            misalignment: axes.each_ref().map(|axis| axis.misalignment),
            misalignment_error: axes.each_ref().map(|axis| axis.misalignment_error.filter(|_| is_known)),
            misalignment_interval: axes
                .each_ref()
                .map(|axis| axis.misalignment_interval(CONFIDENCE).filter(|_| is_known)),
            set_points: reduced.collect(),
            findings: &calibration.findings[..first_of_gyroscopes],
            gyroscopes: None,
        }
    }

    /// The gyroscopes of a calibration.
    pub fn gyroscopes(calibration: &'a Calibration, found: &'a GyroscopeCalibration) -> Self {
        let axes = &found.solution.gyroscopes;
        let set_points = calibration.set_points.iter().zip(&found.reduced);
        let reduced = set_points.map(|(stay, sensors)| (stay.set_point_c, sensors.sensors()));
        Self {
            names: GYROSCOPE_NAMES,
            units: TriadUnits::of(SensorKind::Gyroscope),
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
