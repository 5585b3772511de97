//! A document as structs that serde writes, and what all kinds of provenance have in common.

use crate::accuracy::largest_interval;
use crate::alignment::beside_diagonal;
use crate::triad::CalibratedTriad;
use isotherm_campaign::Campaign;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, root};
use nalgebra::Matrix3;
use serde::Serialize;

/// Declares a struct for a document: each key once, with its type and where its value comes from. `of` makes it of the
/// results in brackets. An unknown value is `None`: it is null in JSON, as a number that is not finite is, and TOML
/// leaves its key out.
#[macro_export]
macro_rules! view {
    ($(#[$about:meta])* $visible:vis $name:ident $(<$life:lifetime>)? ($($result:ident: $of:ty),* $(,)?) {
        $($(#[$attribute:meta])* $key:ident: $type:ty = $value:expr,)*
    }) => {
        $(#[$about])*
        #[derive(serde::Serialize)]
        $visible struct $name $(<$life>)? {
            $($(#[$attribute])* $key: $type,)*
        }

        impl $(<$life>)? $name $(<$life>)? {
            $visible fn of($($result: $of),*) -> Self {
                Self { $($key: $value,)* }
            }
        }
    };
}
pub(crate) use view;

#[derive(Serialize)]
struct Document<T> {
    provenance: T,
}

/// The text of `table` with digest and `provenance`, read back.
///
/// # Errors
/// If the text does not give the same table, or if the provenance cannot be written.
pub(crate) fn sealed(
    campaign: &Campaign,
    table: &CoefficientTable,
    provenance: impl Serialize,
) -> Result<String, String> {
    let failed = |cause: String| format!("writing the table: {cause}");
    let section = toml::to_string(&Document { provenance }).map_err(|error| failed(error.to_string()))?;
    let text = format!("{}\n{section}", table.to_toml());
    match CoefficientTable::from_toml(&text, Some(&campaign.imu)) {
        Ok(read) if read == *table => Ok(text),
        Ok(_) => Err(failed("it does not read back the same".to_owned())),
        Err(faults) => Err(failed(faults.to_string())),
    }
}

view! {
/// What is known of the errors of a curve, in the unit that it has times `factor`.
pub(crate) CurveErrorsRecord(curve: &Curve, factor: f64, covariance: Option<nalgebra::DMatrix<f64>>) {
    /// Largest half width of the curve's 95 % interval over its range.
    largest_interval: Option<f64> = largest_interval(curve, false).map(|half| half * factor),
    /// Of the coefficients in the table.
    standard_errors: Option<Vec<f64>> =
        covariance.as_ref().map(|c| c.diagonal().iter().map(|v| root(*v * (factor * factor))).collect()),
    covariance: Option<Vec<Vec<f64>>> =
        covariance.map(|c| c.row_iter().map(|row| row.iter().map(|v| v * (factor * factor)).collect()).collect()),
}}

impl CurveErrorsRecord {
    pub(crate) fn in_table(curve: &Curve, factor: f64) -> Self {
        Self::of(curve, factor, curve.table_covariance())
    }
}

/// The rows of a matrix.
pub(crate) fn matrix_rows(matrix: &Matrix3<f64>) -> [[f64; AXES]; AXES] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

/// The three values, if each is known.
pub(crate) fn known<T>([a, b, c]: [Option<T>; AXES]) -> Option<[T; AXES]> {
    Some([a?, b?, c?])
}

/// The matrix of the standard errors of misalignments.
pub(super) fn misalignment_error(triad: &CalibratedTriad<'_>) -> Option<[[f64; AXES]; AXES]> {
    Some(beside_diagonal(0.0, known(triad.misalignment_error)?))
}

/// Known values in millionths.
pub(super) fn millionths(values: [Option<f64>; AXES]) -> Option<[f64; AXES]> {
    known(values).map(|values| values.map(|value| value * 1e6))
}

/// `-25/3`, as `--exclude` takes it.
pub(super) fn place(set_point: f64, number: u32) -> String {
    format!("{set_point}/{number}")
}
