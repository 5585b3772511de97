//! The nominal table of readings: what only the resolution says, before any calibration.

use super::content::{Axis, Content, ContentFault, Gyroscopes, OutOfRange};
use super::model::CoefficientTable;
use crate::names::ImuId;
use crate::polynomial::Polynomial;
use crate::readings::{Resolution, checked_interval, checked_resolution};
use crate::units::{ARCSEC, BiasUnit, SensorKind};
use crate::wire::AXES;

/// The value of 1 g0 unless another one is given \[m/s2\].
pub const STANDARD_GRAVITY: f64 = 9.80665;

/// What is known of an IMU whose data are readings in m/s2 and rad/s.
#[derive(Clone, Debug, PartialEq)]
pub struct Nominal {
    /// The IMU.
    pub imu: ImuId,
    /// The nominal interval between two samples \[ns\], 1 to one hour.
    pub interval_ns: u64,
    /// Lowest and highest temperature.
    pub range: [f64; 2],
    /// Unit of the temperature, a label.
    pub temperature_unit: String,
    /// What one pulse over the nominal interval stands for.
    pub resolution: Resolution,
    /// The value of 1 g0 \[m/s2\].
    pub gravity: f64,
    /// Whether the IMU has gyroscopes.
    pub has_gyroscopes: bool,
    /// Largest reading of an accelerometer, as its type has it \[m/s2\]; a larger one will be flagged.
    pub max_specific_force: Option<f64>,
    /// Largest reading of a gyroscope, as its type has it \[rad/s\]; a larger one will be flagged.
    pub max_angular_rate: Option<f64>,
}

impl Nominal {
    /// In degC, with the usual [`Resolution`] and gravity, with gyroscopes, without largest readings.
    #[must_use]
    pub fn new(imu: ImuId, interval_ns: u64, range: [f64; 2]) -> Self {
        Self {
            imu,
            interval_ns,
            range,
            temperature_unit: "degC".to_owned(),
            resolution: Resolution::default(),
            gravity: STANDARD_GRAVITY,
            has_gyroscopes: true,
            max_specific_force: None,
            max_angular_rate: None,
        }
    }
}

/// The content of the table that turns pulses of [`Readings`](crate::readings::Readings) back into these readings. With
/// the nominal interval T it has
///
/// ```text
/// K+ = -K- = g0 / (resolution * T)          pulse/(s*g0)    of accelerometers
/// K+ = -K- = arcsec / (resolution * T)      pulse/arcsec    of gyroscopes; arcsec: 1 arcsec in rad
/// max_rate = (largest / resolution + 1) / T pulse/s         a largest reading itself, rounded up, is not over it
/// ```
/// and no bias, in ug0 and deg/h; temperature outside of the range is clamped. A caller may add what else is known,
/// such as bias curves. The interval in nanoseconds is [`nominal_ns`](crate::nominal::nominal_ns) of one in seconds.
///
/// # Errors
/// The resolution, interval or range that cannot be, with the table's key that follows from it. Everything else is
/// checked by [`CoefficientTable::new`].
pub fn nominal_content(nominal: &Nominal) -> Result<Content, ContentFault> {
    let accelerometers = axes(nominal, SensorKind::Accelerometer)?;
    let gyroscopes = nominal.has_gyroscopes.then(|| axes(nominal, SensorKind::Gyroscope)).transpose()?;
    let mut content = Content {
        format: 1,
        imu: nominal.imu.clone(),
        serial: None,
        gravity: nominal.gravity,
        nominal_interval_s: Some(nominal.interval_ns as f64 / 1e9),
        temperature_unit: nominal.temperature_unit.clone(),
        out_of_range: OutOfRange::Clamp,
        max_age_s: None,
        lag_s: None,
        axes: accelerometers,
        alignment: None,
        gyroscopes: gyroscopes.map(|axes| Gyroscopes { axes, g_sensitivity: [None; AXES], alignment: None }),
    };
    content.format = content.least_format();
    Ok(content)
}

/// Three alike.
fn axes(nominal: &Nominal, kind: SensorKind) -> Result<[Axis; AXES], ContentFault> {
    let Resolution { accelerometer, gyroscope } = nominal.resolution;
    let (section, bias_unit, one, resolution, largest) = match kind {
        SensorKind::Accelerometer => {
            ("axis", BiasUnit::MicroG0, nominal.gravity, accelerometer, nominal.max_specific_force)
        }
        SensorKind::Gyroscope => ("gyroscope", BiasUnit::DegreePerHour, ARCSEC, gyroscope, nominal.max_angular_rate),
    };
    let refusal =
        |key: &str, message: &dyn ToString| ContentFault { key: key.to_owned(), message: message.to_string() };
    let interval = checked_interval(nominal.interval_ns).map_err(|error| refusal("imu.nominal_interval_s", &error))?;
    let resolution = checked_resolution(resolution).map_err(|error| refusal(section, &error))?;
    let interval_s = interval / 1e9;
    let [low, high] = nominal.range;
    let no_range = || format!("the range of the temperature is {low:?} to {high:?}; give a lower and a higher value");
    let constant =
        |value| Polynomial::new(&[value], 0.0, 1.0, nominal.range).ok_or_else(|| refusal(section, &no_range()));
    let scale_factor = one / (resolution * interval_s);
    let axis = Axis {
        bias_unit,
        bias: constant(0.0)?,
        transient: 0.0,
        positive_scale_factor: constant(scale_factor)?,
        negative_scale_factor: constant(-scale_factor)?,
        max_rate: largest.map(|largest| (largest / resolution + 1.0) / interval_s),
    };
    Ok([axis.clone(), axis.clone(), axis])
}

/// The table of [`nominal_content`].
///
/// # Errors
/// All that is wrong with it, as in [`CoefficientTable::new`].
pub fn nominal_table(nominal: &Nominal) -> Result<CoefficientTable, Refusals> {
    let content = nominal_content(nominal).map_err(|refusal| Refusals(vec![refusal]))?;
    CoefficientTable::new(content).map_err(Refusals)
}

/// The faults of a content, as one error.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("the nominal table: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
pub struct Refusals(pub Vec<ContentFault>);
