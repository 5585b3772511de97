//! How accurate the curves of a calibration are: one figure for the bias and one for the scale factors of a triad; of
//! gyroscopes also one for the g-sensitivities and one for the misalignments.
//!
//! Each curve has a 95 % interval at every temperature, from the covariance of its coefficients by Student's t with the
//! curve's degrees of freedom: it holds at a temperature that was chosen before (pointwise). The band that holds for
//! the whole curve at once is wider. The figure in the bottom line is the largest half width of the band over the range
//! of the data. A constant error that all set points share (a wrong position, a wrong local gravity, an angle that
//! every turn misses) is not in it; where a warning shows one, the line says that it is left out. Where the positions
//! leave the base's tilt open there is no figure: the scatter between the set points does not show what a tilt does.

use crate::gyroscopes::GyroscopeCalibration;
use crate::result::Calibration;
use crate::sensor::TriadUnits;
use crate::triad::CalibratedTriad;
use core::fmt;
use isotherm_campaign::joint_range;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{CONFIDENCE, Curve, largest, student_quantile};
use isotherm_support::finding::{Finding, name};

/// The intervals are evaluated at the ends of this many equal steps over the range.
const STEPS: u32 = 64;
/// With fewer set points the errors are themselves so uncertain that a caution is printed.
const FEW_SET_POINTS: usize = 8;

/// The largest 95 % half widths over the range of the data. A figure of a curve whose errors are not known is `None`.
#[derive(Clone, Debug)]
pub struct Accuracy {
    /// Bias of each sensor: of accelerometers \[g0\], of gyroscopes \[deg/h\]. At one temperature (pointwise).
    pub bias: [Option<f64>; AXES],
    /// K+ and K- of each sensor, the larger one, relative. At one temperature (pointwise).
    pub scale_factor: [Option<f64>; AXES],
    /// As `bias`, of the band that holds for the whole curve.
    pub bias_band: [Option<f64>; AXES],
    /// As `scale_factor`, of the band that holds for the whole curve.
    pub scale_factor_band: [Option<f64>; AXES],
    /// Of gyroscopes: what does not depend on temperature.
    pub constants: Option<ConstantsAccuracy>,
    /// Lowest and highest temperature of the data.
    pub range: [f64; 2],
    /// Unit of the temperature.
    pub unit: String,
    /// Number of set points.
    pub set_points: usize,
    /// The fewest degrees of freedom of a curve.
    pub freedom: usize,
    /// What warnings, or faults that were accepted, show beyond these figures; empty without such a warning.
    pub without: String,
    /// Why the errors are not known, if it is not for lack of degrees of freedom.
    unknown: Option<&'static str>,
    units: &'static TriadUnits,
}

/// The largest 95 % half widths of what gyroscopes have in addition to curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstantsAccuracy {
    /// The three g-sensitivities of each gyroscope \[deg/h/g0\].
    pub g_sensitivity: [Option<f64>; AXES],
    /// The two misalignments of each gyroscope \[rad\].
    pub misalignment: [Option<f64>; AXES],
}

/// Warnings about errors that the intervals do not contain.
const BEYOND: [&str; 5] = [name::INTERVAL, name::LEVEL, name::LACK_OF_FIT, name::LATITUDE, name::EARTH_RATE];

/// What the intervals do not contain, in words. `findings` are those of the triad.
fn without(calibration: &Calibration, findings: &[Finding], suspect_position: Option<u32>) -> String {
    // The intervals contain the scatter of the set points. What a stated order is too low for is no scatter.
    let counts = |name: &str| name != name::LACK_OF_FIT || calibration.options.order.is_some();
    let has = |name: &str| findings.iter().any(|finding| finding.name == name);
    let mut names: Vec<&str> = BEYOND.into_iter().filter(|name| counts(name) && has(name)).collect();
    names.extend(calibration.accepted.iter().filter(|name| !BEYOND.contains(name) && has(name)));
    let names: Vec<_> = names.into_iter().map(|name| format!("[{name}]")).collect();
    let warnings = match names.as_slice() {
        [] => String::new(),
        [one] => format!("the errors of warning {one}"),
        many => format!("the errors of warnings {}", many.join(", ")),
    };
    let position = suspect_position.map(|number| format!("what position {number} adds"));
    position.into_iter().chain(Some(warnings).filter(|text| !text.is_empty())).collect::<Vec<_>>().join(" and ")
}

impl Accuracy {
    /// The accuracy of the accelerometers.
    #[must_use]
    pub fn of(calibration: &Calibration) -> Self {
        Self::of_triad(calibration, &CalibratedTriad::accelerometers(calibration))
    }

    /// The accuracy of the gyroscopes; `None` without any.
    #[must_use]
    pub fn of_gyroscopes(calibration: &Calibration) -> Option<Self> {
        let found = calibration.gyroscopes.as_ref()?;
        Some(Self::of_triad(calibration, &CalibratedTriad::gyroscopes(calibration, found)))
    }

    /// The accuracy of one triad of `calibration`.
    pub fn of_triad(calibration: &Calibration, triad: &CalibratedTriad<'_>) -> Self {
        let scale_factor = |axis: usize, of: fn(&Curve, bool) -> Option<f64>| {
            Some(largest([of(&triad.curves[axis][1], true)?, of(&triad.curves[axis][2], true)?]))
        };
        let bias = |axis: usize, of: fn(&Curve, bool) -> Option<f64>| of(&triad.curves[axis][0], false);
        let curves = || triad.curves.into_iter().flatten();
        let suspect_position = calibration.suspect_position.filter(|_| triad.gyroscopes.is_none());
        Self {
            bias: [0, 1, 2].map(|axis| bias(axis, largest_interval)),
            scale_factor: [0, 1, 2].map(|axis| scale_factor(axis, largest_interval)),
            bias_band: [0, 1, 2].map(|axis| bias(axis, largest_band)),
            scale_factor_band: [0, 1, 2].map(|axis| scale_factor(axis, largest_band)),
            constants: triad.gyroscopes.map(|found| ConstantsAccuracy::of(found, triad)),
            range: joint_range(curves().map(|curve| curve.range())),
            unit: calibration.table.content().temperature_unit.clone(),
            set_points: calibration.set_points.len(),
            freedom: curves().map(|curve| curve.freedom() as usize).min().unwrap_or_default(),
            without: without(calibration, triad.findings, suspect_position),
            unknown: calibration.unknown_errors().filter(|_| triad.gyroscopes.is_none()),
            units: triad.units,
        }
    }

    /// What the reader must know about the figures, if the set points are few.
    #[must_use]
    pub fn caution(&self) -> Option<String> {
        let known = self.bias.iter().chain(&self.scale_factor).all(Option::is_some);
        match self.set_points {
            _ if self.unknown.is_some() => self.unknown.map(str::to_owned),
            _ if !known => {
                Some("a curve has no degrees of freedom: its error is not known; measure more set points".to_owned())
            }
            few if few < FEW_SET_POINTS => {
                let (noun, quantile) =
                    (if self.freedom == 1 { "degree" } else { "degrees" }, student_quantile(CONFIDENCE, self.freedom));
                Some(format!(
                    "from {few} set points these figures are themselves uncertain: with {} {noun} of freedom intervals are +- {quantile:.1} \
                     standard errors, and a curve that does not fit widens those of the {}'s other curves; {FEW_SET_POINTS} or more \
                     set points make them firm. If the residuals in the report miss a curve by more than their bars, take another order \
                     with --order",
                    self.freedom, self.units.sensor
                ))
            }
            _ => None,
        }
    }
}

impl ConstantsAccuracy {
    fn of(found: &GyroscopeCalibration, triad: &CalibratedTriad<'_>) -> Self {
        let g_sensitivity = |axis: usize| found.solution.gyroscopes[axis].g_sensitivity_interval(CONFIDENCE);
        Self {
            g_sensitivity: [0, 1, 2].map(|axis| g_sensitivity(axis).map(largest)),
            misalignment: triad.misalignment_interval.map(|intervals| intervals.map(largest)),
        }
    }
}

/// The largest half width of the 95 % interval of a curve over the measured temperature, in the curve's unit or
/// relative to its value; it holds at one temperature. `None` without degrees of freedom.
#[must_use]
pub fn largest_interval(curve: &Curve, relative: bool) -> Option<f64> {
    largest_half_width(curve, relative, curve.point_quantile(CONFIDENCE)?)
}

/// The same of the 95 % band that holds for the whole curve at once.
#[must_use]
pub fn largest_band(curve: &Curve, relative: bool) -> Option<f64> {
    largest_half_width(curve, relative, curve.band_quantile(CONFIDENCE)?)
}

fn largest_half_width(curve: &Curve, relative: bool, quantile: f64) -> Option<f64> {
    let [low, high] = curve.measured();
    let points = (0..=STEPS).map(|step| low + (high - low) * f64::from(step) / f64::from(STEPS));
    let widths = points.map(|u| Some(curve.half_width(u, quantile)? / if relative { curve.at(u).abs() } else { 1.0 }));
    widths.collect::<Option<Vec<_>>>().map(largest)
}

/// The bottom line.
impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figure = |values: &[Option<f64>; AXES], factor: f64, decimals: usize, unit: &str| {
            let all = values.iter().copied().collect::<Option<Vec<_>>>();
            let most = all.map(|values| largest(values) * factor);
            let why = if self.unknown.is_some() { "the tilt of the base is open" } else { "no degrees of freedom" };
            most.map_or_else(|| format!("not known ({why})"), |most| format!("+- {most:.decimals$}{unit}"))
        };
        let TriadUnits { bias, bias_factor, accuracy_decimals, .. } = *self.units;
        write!(
            f,
            "bias {}, scale factor {} over {:.4}..{:.4} {}, ",
            figure(&self.bias_band, bias_factor, accuracy_decimals, &format!(" {bias}")),
            figure(&self.scale_factor_band, 1e6, 2, " ppm"),
            self.range[0],
            self.range[1],
            self.unit,
        )?;
        if let Some(constants) = &self.constants {
            let s = figure(&constants.g_sensitivity, 1.0, 4, " deg/h/g0");
            let m = figure(&constants.misalignment, 1e6, 2, "e-6 rad");
            write!(f, "g-sensitivity {s}, misalignment {m}, ")?;
        }
        let known = self.bias_band.iter().chain(&self.scale_factor_band).any(Option::is_some);
        let whole = if known { " for each whole curve" } else { "" };
        write!(f, "95 %{whole}, from {} set points", self.set_points)?;
        if self.without.is_empty() { Ok(()) } else { write!(f, ", without {}", self.without) }
    }
}
