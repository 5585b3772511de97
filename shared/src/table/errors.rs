//! What a table states of its own errors: half widths of 95 % intervals, in its `[provenance]`.
//!
//! `calibrate` writes them. A service that keeps a table keeps them too, in the form of [`StatedErrors::to_toml`].

use super::content::{Axis, Content};
use crate::document::LenientSection;
use crate::units::{ARCSEC, SensorKind};
use crate::wire::AXES;
use core::fmt::Write as _;

/// What has an error, by its name in a `[[provenance.curve]]`: the curves in the order of
/// [`QUANTITIES`](super::difference::QUANTITIES), then what is no curve.
const STATED: [&str; 6] =
    ["bias", "positive_scale_factor", "negative_scale_factor", "transient", "g_sensitivity", "misalignment"];
/// Indices of what is no curve.
pub(super) const TRANSIENT: usize = 3;
pub(super) const G_SENSITIVITY: usize = 4;
pub(super) const MISALIGNMENT: usize = 5;

/// From a standard error to the half width of a 95 % interval, where the degrees of freedom are not stated.
const HALF_WIDTH: f64 = 2.0;

/// The stated errors of A1 to G3: half widths of 95 % intervals, the largest over the range of a curve, in the units of
/// the table; those of misalignments in rad. `None` where the table states none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StatedErrors([[Option<f64>; STATED.len()]; 2 * AXES]);

impl StatedErrors {
    /// Reads them from the provenance of a table with this content. What cannot be right is not stated: the provenance
    /// is free for the user.
    pub(super) fn read(provenance: LenientSection<'_, '_>, content: &Content) -> Self {
        let mut stated = Self::default();
        for record in provenance.list("curve") {
            let Some((index, kind, axis)) = sensor(record, content) else { continue };
            let factor = unit_factor(record, kind, axis, content.gravity);
            match STATED.iter().position(|quantity| record.is_text("quantity", quantity)) {
                // Scale factors and what is no curve have one unit.
                Some(quantity) => {
                    let factor = if quantity == 0 || quantity == TRANSIENT { factor } else { Some(1.0) };
                    stated.widen(index, quantity, record.number("largest_interval"), factor);
                }
                // Recordings at one attitude give only biases.
                None => {
                    for key in ["interval_95", "band"] {
                        stated.widen(index, 0, record.number(key), factor);
                    }
                }
            }
        }
        for record in provenance.section("transients").map(|it| it.list("bias")).unwrap_or_default() {
            let Some((index, kind, axis)) = sensor(record, content) else { continue };
            let factor = unit_factor(record, kind, axis, content.gravity);
            stated.widen(index, 0, record.number("curve_error"), factor);
            stated.widen(index, TRANSIENT, record.number("standard_error"), factor.map(|it| it * HALF_WIDTH));
        }
        for (key, first, quantity) in [
            ("misalignment_standard_error", 0, MISALIGNMENT),
            ("gyroscope_misalignment_standard_error", AXES, MISALIGNMENT),
            ("g_sensitivity_standard_error", AXES, G_SENSITIVITY),
        ] {
            let rows = provenance.matrix(key).unwrap_or_default();
            for (row, index) in rows.iter().zip(first..first + AXES) {
                stated.widen(index, quantity, row.iter().copied().reduce(f64::max), Some(HALF_WIDTH));
            }
        }
        stated
    }

    /// Notes an error, unless a larger one is known.
    fn widen(&mut self, sensor: usize, quantity: usize, error: Option<f64>, factor: Option<f64>) {
        let error = error.zip(factor).map(|(error, factor)| error * factor);
        let error = error.filter(|error| *error > 0.0 && error.is_finite());
        let known = self.0[sensor][quantity];
        self.0[sensor][quantity] = known.into_iter().chain(error).reduce(f64::max);
    }

    /// The error of a quantity of a sensor, A1 to G3.
    pub(super) const fn of(&self, sensor: usize, quantity: usize) -> Option<f64> {
        self.0[sensor][quantity]
    }

    /// The largest error of a quantity in a triad.
    pub(super) fn largest(&self, kind: SensorKind, quantity: usize) -> Option<f64> {
        let first = first(kind);
        self.0[first..first + AXES].iter().filter_map(|errors| errors[quantity]).reduce(f64::max)
    }

    /// The lines of a `[provenance]` that state the same for a table with this content.
    #[must_use]
    pub fn to_toml(&self, content: &Content) -> String {
        let mut text = String::new();
        for (index, kind, name, axis) in sensors(content) {
            for (quantity, error) in STATED.iter().zip(&self.0[index]) {
                let Some(error) = error else { continue };
                let unit = match *quantity {
                    "bias" | "transient" => axis.bias_unit.name(),
                    "g_sensitivity" => "deg/h/g0",
                    "misalignment" => "rad",
                    _ => kind.scale_factor_unit(),
                };
                // Writing to a String cannot fail.
                let _ = write!(
                    text,
                    "[[provenance.curve]]\naxis = \"{name}\"\nquantity = \"{quantity}\"\nunit = \"{unit}\"\nlargest_interval = {error:?}\n"
                );
            }
        }
        text
    }
}

/// The index of the first sensor of a triad.
pub(super) const fn first(kind: SensorKind) -> usize {
    match kind {
        SensorKind::Accelerometer => 0,
        SensorKind::Gyroscope => AXES,
    }
}

/// The sensors of a content, A1 to G3.
fn sensors(content: &Content) -> impl Iterator<Item = (usize, SensorKind, &'static str, &Axis)> {
    let gyroscopes = content.gyroscopes.as_ref().map(|gyroscopes| (SensorKind::Gyroscope, &gyroscopes.axes));
    let triads = [Some((SensorKind::Accelerometer, &content.axes)), gyroscopes].into_iter().flatten();
    triads.flat_map(|(kind, axes)| {
        (first(kind)..).zip(kind.names()).zip(axes).map(move |((index, name), axis)| (index, kind, name, axis))
    })
}

/// The sensor that a record is of.
fn sensor<'c>(record: LenientSection<'_, '_>, content: &'c Content) -> Option<(usize, SensorKind, &'c Axis)> {
    let mut all = sensors(content);
    all.find(|(_, _, name, _)| record.is_text("axis", name)).map(|(index, kind, _, axis)| (index, kind, axis))
}

/// From the unit of a record of a bias to the unit that the bias has in the table; `None` if it is another quantity's.
fn unit_factor(record: LenientSection<'_, '_>, kind: SensorKind, axis: &Axis, gravity: f64) -> Option<f64> {
    let own = axis.bias_unit;
    let si = match kind {
        SensorKind::Accelerometer => ("m/s2", 1.0 / (gravity * own.factor())),
        SensorKind::Gyroscope => ("rad/s", 1.0 / (ARCSEC * own.factor())),
    };
    let known = [(own.name(), 1.0), si];
    known.into_iter().find(|(name, _)| record.is_text("unit", name)).map(|(_, factor)| factor)
}
