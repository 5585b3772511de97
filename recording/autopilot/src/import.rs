//! Parameters as the nominal table of readings with the biases that the firmware subtracts.

use crate::autopilot::{Autopilot, InstanceError};
use crate::curve::hull;
use crate::firmware::{ARDUPILOT_REFERENCE, ArduPilotTriad, Constants, Px4Triad};
use crate::lines::Lines;
use crate::parameters::{Parameters, ReadError, bias_name};
use isotherm_shared::document::{Fault, Faults};
use isotherm_shared::names::ImuId;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable, Content, ContentFault, Nominal, nominal_content};
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure};

/// Which parameters are read, and what they do not say.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportOptions {
    /// Whose parameters they are.
    pub autopilot: Autopilot,
    /// The instance of the IMU: 0 to 3 of PX4, 1 to 5 of ArduPilot; the first one without a number.
    pub instance: Option<u8>,
    /// The IMU of the table.
    pub imu: ImuId,
    /// The nominal interval between two samples \[ns\].
    pub interval_ns: u64,
    /// The value of 1 g0 \[m/s2\], usually [`STANDARD_GRAVITY`](isotherm_shared::table::STANDARD_GRAVITY).
    pub gravity: f64,
}

/// Why parameters do not become a table.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum ImportError {
    /// The autopilot does not have this instance.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// All that is wrong with the text, with line and parameter.
    #[error(transparent)]
    Text(#[from] Faults),
    /// Interval or gravity is none that a table can have.
    #[error("the table of parameters: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Settings(Vec<ContentFault>),
}

impl From<ReadError> for ImportError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Instance(error) => Self::Instance(error),
            ReadError::Text(faults) => Self::Text(faults),
        }
    }
}

impl From<ImportError> for Failure {
    fn from(error: ImportError) -> Self {
        let exit = match &error {
            ImportError::Text(_) => Exit::Config,
            ImportError::Instance(_) | ImportError::Settings(_) => Exit::Usage,
        };
        Self::new(exit, error.to_string())
    }
}

/// The table of an instance's parameters: nominal scale factors for readings in m/s2 and rad/s
/// ([`nominal_content`]), with the biases that the firmware subtracts, over its range, clamped outside of it as the
/// firmware clamps. A1, A2, A3 are X, Y, Z.
///
/// ArduPilot's curves by themselves are relative; without `CALTEMP` and `OFFS` in the text their biases are 0 at 35
/// degC, or at the end of the range next to it.
///
/// # Errors
/// All that is wrong with the text, with line and parameter; a bias that no table can have; options that cannot be.
pub fn import(text: &str, options: &ImportOptions) -> Result<CoefficientTable, ImportError> {
    let parameters = Parameters::read(text, options.autopilot, options.instance)?;
    let (accelerometers, gyroscopes) = match parameters {
        Parameters::Px4(accelerometers, gyroscopes) => (of_px4(&accelerometers), gyroscopes.as_ref().map(of_px4)),
        Parameters::ArduPilot(accelerometers, gyroscopes) => {
            (of_ardupilot(&accelerometers), gyroscopes.as_ref().map(of_ardupilot))
        }
    };
    let range = hull([accelerometers.range].into_iter().chain(gyroscopes.map(|gyroscopes| gyroscopes.range)));
    let nominal = Nominal {
        gravity: options.gravity,
        has_gyroscopes: gyroscopes.is_some(),
        ..Nominal::new(options.imu.clone(), options.interval_ns, range)
    };
    let mut content = nominal_content(&nominal).map_err(|refusal| ImportError::Settings(vec![refusal]))?;
    // No finite float32 overflows as a double, so this cannot fail.
    let overflow = || ContentFault { key: "bias".to_owned(), message: "overflows; give other parameters".to_owned() };
    write(&mut content, &accelerometers, gyroscopes.as_ref()).ok_or_else(|| ImportError::Settings(vec![overflow()]))?;
    CoefficientTable::new(content).map_err(|refusals| of_table(text, options, refusals))
}

/// Biases of a triad \[m/s2 or rad/s\], as powers of (T - center) over degC^k.
#[derive(Clone, Copy)]
struct Biases {
    range: [f64; 2],
    center: f64,
    coefficients: [[f64; 4]; AXES],
}

fn of_px4(triad: &Px4Triad) -> Biases {
    Biases {
        range: triad.range.map(f64::from),
        center: triad.reference.into(),
        coefficients: triad.coefficients.map(|axis| axis.map(f64::from)),
    }
}

fn of_ardupilot(triad: &ArduPilotTriad) -> Biases {
    let range @ [low, high] = triad.range.map(f64::from);
    let center = f64::from(ARDUPILOT_REFERENCE);
    let unknown = Constants { temperature: ARDUPILOT_REFERENCE, offsets: [0.0; AXES] };
    let Constants { temperature, offsets } = triad.constants.unwrap_or(unknown);
    let t = f64::from(temperature).max(low).min(high) - center;
    let mut coefficients = [[0.0; 4]; AXES];
    for ((all, of_axis), offset) in coefficients.iter_mut().zip(&triad.coefficients).zip(offsets) {
        let [c1, c2, c3] = of_axis.map(|c| f64::from(c) * 1e-6);
        *all = [f64::from(offset) - ((c3 * t + c2) * t + c1) * t, c1, c2, c3];
    }
    Biases { range, center, coefficients }
}

/// Writes the biases into a content; `None` if one overflows.
fn write(content: &mut Content, accelerometers: &Biases, gyroscopes: Option<&Biases>) -> Option<()> {
    let set = |axes: &mut [Axis; AXES], biases: &Biases, unit: f64| {
        for (axis, coefficients) in axes.iter_mut().zip(biases.coefficients) {
            let coefficients = coefficients.map(|coefficient| coefficient / unit / axis.bias_unit.factor());
            axis.bias = Polynomial::new(&coefficients, biases.center, 1.0, biases.range)?;
        }
        Some(())
    };
    set(&mut content.axes, accelerometers, content.gravity)?;
    if let (Some(triad), Some(gyroscopes)) = (&mut content.gyroscopes, gyroscopes) {
        set(&mut triad.axes, gyroscopes, ARCSEC)?;
    }
    Some(())
}

/// What a table refuses: a bias is a fault of its parameters, everything else comes from the options.
fn of_table(text: &str, options: &ImportOptions, refusals: Vec<ContentFault>) -> ImportError {
    let (lines, mut faults) = (Lines::parse(text), Vec::new());
    let Ok(instance) = options.autopilot.instance(options.instance) else { return ImportError::Settings(refusals) };
    for kind in [SensorKind::Accelerometer, SensorKind::Gyroscope] {
        for (axis, name) in kind.names().into_iter().enumerate() {
            let of_axis = |refusal: &&ContentFault| refusal.key.ends_with(&format!(".{name}.bias"));
            let Some(ContentFault { message, .. }) = refusals.iter().find(of_axis) else { continue };
            let key = bias_name(options.autopilot, instance, kind, axis);
            let line = lines.line(&key).unwrap_or(1);
            faults.push(Fault { line, key, message: format!("the bias of {name} {message}") });
        }
    }
    faults.sort_by_key(|fault| fault.line);
    if faults.is_empty() { ImportError::Settings(refusals) } else { Faults(faults).into() }
}
