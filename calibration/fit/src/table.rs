//! The table of fitted curves.

use isotherm_campaign::Campaign;
use isotherm_shared::polynomial::{MAX_ORDER, Polynomial};
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, Content, ContentFault, GYROSCOPE_NAMES, OutOfRange};
use isotherm_shared::units::{BiasUnit, SensorKind};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, QUANTITIES};
use nalgebra::Matrix3;

/// The table of the curves A, K+ and K- of each axis, with what the campaign gives it unchanged.
pub(crate) fn table_of(
    campaign: &Campaign,
    curves: [&[Curve; 3]; AXES],
    alignment: Option<Matrix3<f64>>,
) -> Result<CoefficientTable, Vec<ContentFault>> {
    CoefficientTable::new(Content {
        format: 1,
        imu: campaign.imu.clone(),
        serial: campaign.serial.clone(),
        gravity: campaign.gravity_reference,
        nominal_interval_s: None,
        temperature_unit: campaign.temperature_unit.clone(),
        out_of_range: campaign.out_of_range.unwrap_or(OutOfRange::Clamp),
        max_age_s: campaign.max_age_s,
        lag_s: None,
        axes: axes(curves, BiasUnit::MicroG0, 1e6, campaign.max_rate)?,
        alignment,
        gyroscopes: None,
    })
}

/// A sensor of a table; `None` if it has no gyroscopes.
#[must_use]
pub fn axis_of(content: &Content, kind: SensorKind, axis: usize) -> Option<&Axis> {
    match kind {
        SensorKind::Accelerometer => content.axes.get(axis),
        SensorKind::Gyroscope => content.gyroscopes.as_ref()?.axes.get(axis),
    }
}

/// A sensor of a table that has gyroscopes if one of them is meant.
pub(crate) fn axis_mut(content: &mut Content, kind: SensorKind, axis: usize) -> &mut Axis {
    let axes = match (kind, &mut content.gyroscopes) {
        (SensorKind::Gyroscope, Some(gyroscopes)) => &mut gyroscopes.axes,
        _ => &mut content.axes,
    };
    &mut axes[axis]
}

/// Makes `curve`, in the unit of the fit, the bias of a sensor.
pub(crate) fn set_bias(axis: &mut Axis, curve: &Polynomial) {
    let factor = axis.bias_unit.factor();
    let coefficients: Vec<_> = curve.coefficients().iter().map(|c| c / factor).collect();
    axis.bias = Polynomial::new(&coefficients, curve.center(), curve.scale(), curve.range()).unwrap_or(axis.bias);
}

/// Bias, K+ and K- of the gyroscopes as a table has them.
pub(crate) fn gyroscope_axes(curves: [&[Curve; 3]; AXES]) -> Result<[Axis; AXES], Vec<ContentFault>> {
    axes(curves, BiasUnit::DegreePerHour, 1.0, None)
}

/// The sensors of a triad, whose biases are in `unit` after multiplication by `factor`.
fn axes(
    curves: [&[Curve; 3]; AXES],
    unit: BiasUnit,
    factor: f64,
    max_rate: Option<f64>,
) -> Result<[Axis; AXES], Vec<ContentFault>> {
    let (kind, names) = match unit {
        BiasUnit::DegreePerHour => ("gyroscope", GYROSCOPE_NAMES),
        _ => ("axis", AXIS_NAMES),
    };
    let refuse = |axis: usize, quantity: usize| {
        let key = format!("{kind}.{}.{}", names[axis], QUANTITIES[quantity]);
        vec![ContentFault { key, message: format!("tables hold orders up to {MAX_ORDER}") }]
    };
    let axis = |axis: usize| -> Result<Axis, Vec<ContentFault>> {
        let polynomial = |q: usize, factor: f64| curves[axis][q].polynomial(factor).ok_or_else(|| refuse(axis, q));
        Ok(Axis {
            bias_unit: unit,
            bias: polynomial(0, factor)?,
            transient: 0.0,
            positive_scale_factor: polynomial(1, 1.0)?,
            negative_scale_factor: polynomial(2, 1.0)?,
            max_rate,
        })
    };
    Ok([axis(0)?, axis(1)?, axis(2)?])
}
