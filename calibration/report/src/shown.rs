//! What text and page of a verification show in the same way.

use isotherm_shared::table::AXIS_NAMES;
use isotherm_verification::{Errors, Stability};

/// How figures of a triad are shown.
#[derive(Clone, Copy)]
pub(crate) struct FigureFormat {
    /// From the triad's base unit to that of the page.
    pub(crate) factor: f64,
    /// Decimals.
    pub(crate) places: usize,
    pub(crate) unit: &'static str,
}

pub(crate) const MICRO_G0: FigureFormat = FigureFormat { factor: 1e6, places: 3, unit: "1e-6 g0" };
pub(crate) const DEGREES_PER_HOUR: FigureFormat = FigureFormat { factor: 1.0, places: 4, unit: "deg/h" };
pub(crate) const RANDOM_WALK: FigureFormat = FigureFormat { places: 5, unit: "deg/sqrt(h)", ..DEGREES_PER_HOUR };

/// Why samples are flagged.
pub(crate) const FLAGGED: &str =
    "temperature out of the table's range or not plausible, or a lag that is not the table's";
/// Why the hysteresis band begins late.
pub(crate) const SOAKED: &str = "there the lagged temperature begins soaked, which the IMU may not have been";

/// The errors of each accelerometer, of the length and of the level, with their names.
pub(crate) fn named_errors(stability: &Stability) -> impl Iterator<Item = (&'static str, &Errors)> {
    let verdict = &stability.verdict;
    let length = verdict.length.iter().map(|errors| ("length", errors));
    AXIS_NAMES.into_iter().zip(&verdict.axes).chain(length).chain([("level", &verdict.level)])
}
