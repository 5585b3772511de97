//! The limits of a change that follow from what a table states about itself: its errors, and its ranges.
//!
//! ```text
//! limit = 10 E + share * span     E: half width of the 95 % interval of the curve, the transient or the coefficient
//!                                 span: what the quantity ranges over in the sensors of the triad
//!                                 share: 0.15 for scale factors, 0.4 for all else
//! limit = 10 E                    if only one number of the table changes
//! ```
//! Two calibrations differ by their errors, by less than 4 E, and by what has become of the IMU in between. That is not
//! in the errors of a campaign. It comes from the same stresses in the sensors that make the quantity depend on the
//! temperature, and it is a small part of that. A calibration fits everything anew, so no number stays as it was. A
//! change of a single number is an edited one, or a lost digit.

use super::content::{Axis, Content};
use super::curves::{UnitCurve, points, unit_factor};
use super::errors::{G_SENSITIVITY, MISALIGNMENT, StatedErrors, TRANSIENT, first};
use super::model::CoefficientTable;
use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::units::SensorKind;
use crate::wire::AXES;
use nalgebra::Matrix3;

/// What the errors of a campaign are multiplied with.
const ERRORS: f64 = 10.0;
/// The part of its span that a scale factor may change by from one calibration to the next, and that all else may.
const SHARE_OF_SCALE_FACTORS: f64 = 0.15;
const SHARE: f64 = 0.4;

/// What an old table states about the limits of a change to a new one, in the units of the differences.
pub(super) struct StatedLimits<'t> {
    errors: &'t StatedErrors,
    content: &'t Content,
    /// Whether only one number changes.
    is_single: bool,
}

impl<'t> StatedLimits<'t> {
    pub(super) fn of(old: &'t CoefficientTable, new: &CoefficientTable) -> Self {
        let content = old.content();
        let all = numbers(content).into_iter().zip(numbers(new.content()));
        let is_single = all.filter(|(old, new)| old != new).count() <= 1;
        Self { errors: old.errors(), content, is_single }
    }

    /// Of an error and a span; `None` if the table does not state both.
    fn limit(&self, error: Option<f64>, share: f64, span: impl FnOnce() -> f64) -> Option<f64> {
        let of_errors = ERRORS * error?;
        if self.is_single {
            return Some(of_errors);
        }
        let span = span();
        (span > 0.0).then_some(of_errors + share * span)
    }

    /// Of a curve, whose unit times this factor is that of its difference.
    pub(super) fn curve(&self, (kind, axis, quantity): (SensorKind, usize, usize), factor: f64) -> Option<f64> {
        let error = self.errors.of(first(kind) + axis, quantity).map(|error| error * factor.abs());
        let share = if quantity == 0 { SHARE } else { SHARE_OF_SCALE_FACTORS };
        self.limit(error, share, || self.span(kind, quantity))
    }

    /// Of a transient times the range, which counts as bias. `factor` is that of the bias.
    pub(super) fn transient(&self, kind: SensorKind, axis: usize, factor: f64) -> Option<f64> {
        let error = self.errors.of(first(kind) + axis, TRANSIENT).map(|error| error * factor);
        self.limit(error, SHARE, || self.span(kind, 0))
    }

    /// Of the g-sensitivities of a gyroscope.
    pub(super) fn g_sensitivity(&self, axis: usize) -> Option<f64> {
        let all = self.content.gyroscopes.iter().flat_map(|gyroscopes| gyroscopes.g_sensitivity.iter().flatten());
        let span = || all.flatten().fold(0.0, |most: f64, coefficient| most.max(coefficient.abs()));
        self.limit(self.errors.of(AXES + axis, G_SENSITIVITY), SHARE, span)
    }

    /// Of the alignment of a triad, which is this matrix \[rad\].
    pub(super) fn alignment(&self, kind: SensorKind, matrix: &Matrix3<f64>) -> Option<f64> {
        self.limit(self.errors.largest(kind, MISALIGNMENT), SHARE, || {
            (matrix - Matrix3::from_diagonal(&matrix.diagonal())).amax()
        })
    }

    /// What a bias ranges over in the sensors of a triad, or the most that a scale factor does.
    fn span(&self, kind: SensorKind, quantity: usize) -> f64 {
        let axes: &[Axis] = match (kind, &self.content.gyroscopes) {
            (SensorKind::Accelerometer, _) => &self.content.axes,
            (SensorKind::Gyroscope, Some(gyroscopes)) => &gyroscopes.axes,
            (SensorKind::Gyroscope, None) => &[],
        };
        let curves = axes.iter().flat_map(|axis| {
            let [bias, positive, negative] = UnitCurve::of_sensor(kind, axis, self.content.gravity);
            if quantity == 0 { vec![bias] } else { vec![positive, negative] }
        });
        let span = |curve: UnitCurve| {
            let values = points(curve.polynomial().range()).into_iter().map(|u| curve.at(u));
            let (low, high) =
                values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
            ((high - low) * unit_factor(kind, quantity, f64::midpoint(low, high))).abs()
        };
        curves.map(span).fold(0.0, f64::max)
    }
}

/// All numbers of a table that an output is computed from, in one order for all tables.
fn numbers(content: &Content) -> Vec<f64> {
    let mut all = vec![content.gravity];
    let gyroscopes = content.gyroscopes.as_ref();
    let of_polynomial = |polynomial: &Polynomial| {
        let coefficients = polynomial.coefficients().iter().copied().chain([0.0; MAX_ORDER + 1]);
        coefficients.take(MAX_ORDER + 1).chain([polynomial.center(), polynomial.scale()]).collect::<Vec<_>>()
    };
    for axis in content.axes.iter().chain(gyroscopes.iter().flat_map(|gyroscopes| &gyroscopes.axes)) {
        all.push(axis.transient);
        let curves = [&axis.bias, &axis.positive_scale_factor, &axis.negative_scale_factor];
        all.extend(curves.into_iter().flat_map(of_polynomial));
    }
    all.extend(gyroscopes.iter().flat_map(|it| it.g_sensitivity.iter().flat_map(|row| row.unwrap_or_default())));
    for matrix in [content.alignment, gyroscopes.and_then(|gyroscopes| gyroscopes.alignment)] {
        all.extend(matrix.unwrap_or_else(Matrix3::identity).iter());
    }
    all
}
