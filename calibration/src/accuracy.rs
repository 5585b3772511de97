//! How accurate the curves of a calibration are: one figure for the bias and one for the scale factors.
//!
//! Each curve has a 95 % interval at every telemetry, from the covariance of its coefficients by Student's t with the curve's degrees of
//! freedom. The figure is the largest half width over the range of the data. A constant error that all set points share (a wrong position, a
//! wrong local gravity) is not in it; where a warning shows one, the line says that it is left out.

use crate::calibrate::Calibration;
use crate::campaign::range;
use crate::checks::name;
use crate::curve::{CONFIDENCE, Curve, student_quantile};
use core::fmt;
use isotherm_shared::wire::AXES;
use serde::Serialize;

/// The intervals are evaluated at the ends of this many equal steps over the range.
const STEPS: u32 = 64;
/// With fewer set points the errors are themselves so uncertain that a caution is printed.
const FEW_SET_POINTS: usize = 8;

/// The largest 95 % half widths over the range of the data.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// Bias of each accelerometer \[g0\]; `None` without degrees of freedom.
    pub bias: [Option<f64>; AXES],
    /// K+ and K- of each accelerometer, the larger one, relative; `None` without degrees of freedom.
    pub scale_factor: [Option<f64>; AXES],
    /// Lowest and highest telemetry of the data.
    pub range: [f64; 2],
    /// Unit of the telemetry.
    pub unit: String,
    /// Number of set points.
    pub set_points: usize,
    /// The fewest degrees of freedom of a curve.
    pub freedom: usize,
    /// What warnings, or faults that were accepted, show beyond these figures; empty without such a warning.
    pub without: String,
}

/// Warnings about errors that the intervals do not contain.
const BEYOND: [&str; 3] = [name::INTERVAL, name::LEVEL, name::LACK_OF_FIT];

/// What the intervals do not contain, in words.
fn without(calibration: &Calibration) -> String {
    // The intervals contain the scatter of the set points. What a stated order is too low for is no scatter.
    let counts = |name: &str| name != name::LACK_OF_FIT || calibration.options.order.is_some();
    let found = |name: &&str| counts(name) && calibration.findings.iter().any(|finding| finding.name == *name);
    let mut names: Vec<&str> = BEYOND.into_iter().filter(found).collect();
    names.extend(calibration.accepted.iter().filter(|name| !BEYOND.contains(name)));
    let names: Vec<_> = names.into_iter().map(|name| format!("[{name}]")).collect();
    let warnings = match names.as_slice() {
        [] => String::new(),
        [one] => format!("the errors of warning {one}"),
        many => format!("the errors of warnings {}", many.join(", ")),
    };
    let position = calibration.suspect_position.map(|number| format!("what position {number} adds"));
    position.into_iter().chain(Some(warnings).filter(|text| !text.is_empty())).collect::<Vec<_>>().join(" and ")
}

impl Accuracy {
    /// The accuracy of a calibration.
    #[must_use]
    pub fn of(calibration: &Calibration) -> Self {
        let curves = |axis: usize| &calibration.solution.axes[axis].curves;
        let half_width = |axis: usize, quantity: usize, relative| largest_interval(&curves(axis)[quantity], relative);
        let scale_factor = |axis: usize| Some(half_width(axis, 1, true)?.max(half_width(axis, 2, true)?));
        Self {
            bias: [0, 1, 2].map(|axis| half_width(axis, 0, false)),
            scale_factor: [0, 1, 2].map(scale_factor),
            range: range((0..AXES).flat_map(|axis| curves(axis).iter().map(|curve| curve.range()))),
            unit: calibration.table.content().temperature_unit.clone(),
            set_points: calibration.set_points.len(),
            freedom: (0..AXES).flat_map(|axis| curves(axis).iter().map(Curve::freedom)).min().unwrap_or_default(),
            without: without(calibration),
        }
    }

    /// What the reader must know about the figures, if the set points are few.
    #[must_use]
    pub fn caution(&self) -> Option<String> {
        let known = self.bias.iter().chain(&self.scale_factor).all(Option::is_some);
        match self.set_points {
            _ if !known => {
                Some("a curve has no degrees of freedom: its error is not known; measure more set points".to_owned())
            }
            few if few < FEW_SET_POINTS => {
                let (noun, quantile) =
                    (if self.freedom == 1 { "degree" } else { "degrees" }, student_quantile(CONFIDENCE, self.freedom));
                Some(format!(
                    "from {few} set points these figures are themselves uncertain: with {} {noun} of freedom intervals are +- {quantile:.1} \
                     standard errors, and a curve that does not fit widens those of the accelerometer's other curves; {FEW_SET_POINTS} or more \
                     set points make them firm",
                    self.freedom
                ))
            }
            _ => None,
        }
    }
}

/// The largest half width of the 95 % interval of a curve over its range, in the curve's unit or relative to its value; `None` without
/// degrees of freedom.
#[must_use]
pub fn largest_interval(curve: &Curve, relative: bool) -> Option<f64> {
    let [low, high] = curve.range();
    let points = (0..=STEPS).map(|step| low + (high - low) * f64::from(step) / f64::from(STEPS));
    let widths = points.map(|u| Some(curve.interval(u, CONFIDENCE)? / if relative { curve.at(u).abs() } else { 1.0 }));
    widths.collect::<Option<Vec<_>>>().map(|widths| widths.into_iter().fold(0.0, f64::max))
}

/// The bottom line.
impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = |values: &[Option<f64>; AXES], digits: usize| {
            let all = values.iter().copied().collect::<Option<Vec<_>>>();
            let most = all.map(|values| values.into_iter().fold(0.0, f64::max) * 1e6);
            most.map(|most| format!("+- {most:.digits$}"))
        };
        let figure = |values: &[Option<f64>; AXES], unit: &str| {
            most(values, 2)
                .map_or_else(|| "not known (no degrees of freedom)".to_owned(), |most| format!("{most} {unit}"))
        };
        write!(
            f,
            "bias {}, scale factor {} over {:.4}..{:.4} {}, 95 %, from {} set points",
            figure(&self.bias, "ug0"),
            figure(&self.scale_factor, "ppm"),
            self.range[0],
            self.range[1],
            self.unit,
            self.set_points
        )?;
        if self.without.is_empty() { Ok(()) } else { write!(f, ", without {}", self.without) }
    }
}
