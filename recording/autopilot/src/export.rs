//! A table as the parameters of an autopilot.

use crate::autopilot::{Autopilot, InstanceError};
use crate::curve::{common, points};
use crate::effect::{Effect, EffectLoss, losses, together};
use crate::firmware::{ARDUPILOT_REFERENCE, ArduPilotTriad, Constants, Px4Triad};
use crate::parameters::{Parameters, ReadError};
use crate::triad::{Triad, TriadCurve, triads};
use crate::{ardupilot, px4, size};
use isotherm_shared::table::{CoefficientTable, OutOfRange};
use isotherm_shared::units::{CELSIUS, SensorKind};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure};

/// Whose parameters a table becomes, and what it does not say.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportOptions {
    /// The autopilot.
    pub autopilot: Autopilot,
    /// The instance of the IMU: 0 to 3 of PX4, 1 to 5 of ArduPilot; the first one without a number.
    pub instance: Option<u8>,
    /// PX4's device numbers of accelerometers and gyroscopes, 1 to 2^31 - 1: by them it knows whose the parameters are.
    pub device_id: Option<[u32; 2]>,
    /// ArduPilot's calibration temperature \[degC\], within the range: for this one the constants are written.
    pub at_c: Option<f64>,
    /// What is left out, if the table has it.
    pub drop: Vec<Effect>,
}

impl ExportOptions {
    /// Of the first instance, without anything else.
    #[must_use]
    pub const fn new(autopilot: Autopilot) -> Self {
        Self { autopilot, instance: None, device_id: None, at_c: None, drop: Vec::new() }
    }

    /// Of an IMU as a log of an autopilot names it: its number there, from 0, and the device numbers of accelerometers
    /// and gyroscopes, which only PX4 wants. ArduPilot counts from 1, and its logs from 0.
    ///
    /// ```
    /// use isotherm_autopilot::{Autopilot, ExportOptions};
    ///
    /// let options = ExportOptions::of_log(Autopilot::ArduPilot, 2, [Some(3_014_666), None]);
    /// assert_eq!((options.instance, options.device_id), (Some(3), None));
    /// ```
    #[must_use]
    pub fn of_log(autopilot: Autopilot, instance: u32, [accelerometers, gyroscopes]: [Option<u32>; 2]) -> Self {
        let first = *autopilot.instances().start();
        let instance = u8::try_from(instance).unwrap_or(u8::MAX).saturating_add(first);
        let devices = accelerometers.map(|device| [device, gyroscopes.unwrap_or(device)]);
        let device_id = devices.filter(|_| autopilot == Autopilot::Px4);
        Self { instance: Some(instance), device_id, ..Self::new(autopilot) }
    }

    /// The same with what is given, in the place of what a log says.
    #[must_use]
    pub fn with(self, instance: Option<u8>, device_id: Option<[u32; 2]>) -> Self {
        Self { instance: instance.or(self.instance), device_id: device_id.or(self.device_id), ..self }
    }
}

/// The parameters of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportedParameters {
    /// The text of a `.params` or `.parm` file.
    pub text: String,
    /// What was left out, as permitted.
    pub lost: Vec<EffectLoss>,
    /// Largest difference between what the firmware subtracts, by its own formula in float32, and the written biases,
    /// over the range.
    pub difference: Difference,
    /// The range of the accelerometers' biases \[degC\].
    pub range: [f64; 2],
    /// What the user should also know, in sentences.
    pub notes: Vec<String>,
}

/// A largest difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Of the accelerometers \[m/s2\].
    pub accelerometers: f64,
    /// Of the gyroscopes, if there are any \[rad/s\].
    pub gyroscopes: Option<f64>,
}

/// Why a table does not become parameters.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExportError {
    /// The autopilot does not have this instance.
    #[error("parameters of a table: {0}")]
    Instance(#[from] InstanceError),
    /// PX4 without its device numbers, or ArduPilot with them, or a number that cannot be.
    #[error("parameters of a table: {0}")]
    Device(&'static str),
    /// A calibration temperature that cannot be.
    #[error("parameters of a table: {0}")]
    At(String),
    /// The temperature is no temperature in degC.
    #[error(
        "parameters of a table: its temperature is in {0:?}, and autopilots have degC; calibrate against the temperature"
    )]
    Unit(String),
    /// The table has what parameters cannot say.
    #[error("parameters of a table: they cannot say all of it; {}", described(.0))]
    Effects(Vec<EffectLoss>),
    /// The biases have no range that all have.
    #[error("parameters of a table: no temperature is in the ranges of all biases; calibrate them over one range")]
    NoCommonRange,
    /// A table of constants for ArduPilot, without a calibration temperature.
    #[error(
        "parameters of a table: its biases do not depend on the temperature (order 0), so ArduPilot's parameters of the \
         temperature would all be 0 and correct nothing; calibrate over a wider range, or with a fixed order (--order 1) if a \
         curve is meant; an `isotherm export` with a calibration temperature (--at T) writes the constants"
    )]
    Constants,
    /// Numbers that no float32 can hold.
    #[error("parameters of a table: in float32 they are not right ({0}); calibrate over a wider range")]
    Float32(String),
}

fn described(losses: &[EffectLoss]) -> String {
    let list: Vec<_> = losses.iter().map(|loss| format!("{loss}; --drop {} leaves it out", loss.effect)).collect();
    list.join("\n")
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Self {
        let exit = match &error {
            ExportError::Instance(_) | ExportError::Device(_) | ExportError::At(_) => Exit::Usage,
            _ => Exit::Config,
        };
        Self::new(exit, error.to_string())
    }
}

/// The parameters of a table, for one instance. A1, A2, A3 become X, Y, Z.
///
/// The biases become powers of (T - TREF), or of (T - 35 degC), exactly. Each number is then rounded to float32, once.
///
/// # Errors
/// What the parameters cannot say, unless it is dropped, each with the size of what would be lost; options that cannot
/// be.
pub fn export(table: &CoefficientTable, options: &ExportOptions) -> Result<ExportedParameters, ExportError> {
    let content = table.content();
    let autopilot = options.autopilot;
    let instance = autopilot.instance(options.instance)?;
    let devices = devices(options)?;
    if !CELSIUS.contains(&content.temperature_unit.as_str()) {
        return Err(ExportError::Unit(content.temperature_unit.clone()));
    }
    let triads = triads(content);
    let written = triads.iter().map(|triad| ExportText::of(triad, &triads, autopilot));
    let written: Vec<ExportText> = written.collect::<Result<_, _>>()?;
    let (lost, refused): (Vec<_>, Vec<_>) = losses(&triads, autopilot, content.lag_s)
        .into_iter()
        .partition(|loss: &EffectLoss| options.drop.contains(&loss.effect));
    if !refused.is_empty() {
        return Err(ExportError::Effects(refused));
    }
    let text = match autopilot {
        Autopilot::Px4 => {
            let all: Vec<_> = written.iter().map(|triad| (triad.kind, triad.px4())).collect();
            px4::write(&all, instance, devices)
        }
        Autopilot::ArduPilot => {
            check_at(options.at_c, &written)?;
            let all: Vec<_> = written.iter().map(|triad| (triad.kind, triad.ardupilot(options.at_c))).collect();
            let range = all.first().map_or([0.0; 2], |(_, triad)| triad.range);
            ardupilot::write(range, &all, instance)
        }
    };
    let difference = difference(&text, instance, options, &written)?;
    let range = written.first().map_or([0.0; 2], |triad| triad.range);
    Ok(ExportedParameters {
        text,
        lost,
        difference,
        range,
        notes: notes(options, content.out_of_range, &triads, &written),
    })
}

/// What is written of a triad.
struct ExportText {
    kind: SensorKind,
    /// The range of the autopilot's parameters \[degC\].
    range: [f64; 2],
    curves: [TriadCurve; AXES],
}

impl ExportText {
    fn of(triad: &Triad<'_>, triads: &[Triad<'_>], autopilot: Autopilot) -> Result<Self, ExportError> {
        let range = common(together(triads, triad, autopilot).into_iter()).ok_or(ExportError::NoCommonRange)?;
        let overflow = || ExportError::Float32("a bias overflows".to_owned());
        Ok(Self { kind: triad.kind, range, curves: triad.curves().ok_or_else(overflow)? })
    }

    /// The centre that all curves have, if it is within the range, otherwise the middle of the range.
    fn reference(&self) -> f32 {
        let [low, high] = self.range;
        let [first, ..] = &self.curves;
        let center = first.center();
        let shared = (low..=high).contains(&center) && self.curves.iter().all(|curve| curve.center() == center);
        (if shared { center } else { f64::midpoint(low, high) }) as f32
    }

    fn px4(&self) -> Px4Triad {
        let reference = self.reference();
        let coefficients = self.curves.map(|curve| curve.powers(reference.into()).map(|power| power as f32));
        Px4Triad { range: self.range.map(|end| end as f32), reference, coefficients }
    }

    fn ardupilot(&self, at_c: Option<f64>) -> ArduPilotTriad {
        let coefficients = self.curves.map(|curve| {
            let [_, a1, a2, a3] = curve.powers(ARDUPILOT_REFERENCE.into());
            [a1, a2, a3].map(|power| (power * 1e6) as f32)
        });
        let constants = at_c.map(|at| {
            let temperature = at as f32;
            Constants { temperature, offsets: self.curves.map(|curve| curve.at(temperature.into()) as f32) }
        });
        ArduPilotTriad { range: self.range.map(|end| end as f32), coefficients, constants }
    }

    /// The largest bias at a temperature.
    fn largest_at(&self, temperature: f64) -> f64 {
        let [low, high] = self.range;
        self.curves.iter().map(|curve| curve.at(temperature.clamp(low, high)).abs()).fold(0.0, f64::max)
    }
}

fn devices(options: &ExportOptions) -> Result<[u32; 2], ExportError> {
    let refused = |message| Err(ExportError::Device(message));
    if options.autopilot == Autopilot::Px4 && options.at_c.is_some() {
        return Err(ExportError::At("PX4 has the constants at every temperature; leave it out".to_owned()));
    }
    match (options.autopilot, options.device_id) {
        (Autopilot::Px4, None) => refused("PX4 knows by its device number whose they are; give it (--device-id ID)"),
        (Autopilot::Px4, Some(devices)) if devices.iter().all(|id| (1..=i32::MAX as u32).contains(id)) => Ok(devices),
        (Autopilot::Px4, Some(_)) => refused("a device number is from 1 to 2147483647; give that of TC_A0_ID"),
        (Autopilot::ArduPilot, Some(_)) => refused("ArduPilot needs no device number; leave it out"),
        (Autopilot::ArduPilot, None) => Ok([0; 2]),
    }
}

/// Checks ArduPilot's calibration temperature.
fn check_at(at_c: Option<f64>, written: &[ExportText]) -> Result<(), ExportError> {
    let curves = || written.iter().flat_map(|triad| &triad.curves);
    let outside = |at: f64| written.iter().find(|triad| !(triad.range[0]..=triad.range[1]).contains(&at));
    match at_c {
        None if curves().all(TriadCurve::is_constant) => Err(ExportError::Constants),
        None => Ok(()),
        Some(at) => outside(at).map_or(Ok(()), |ExportText { range: [low, high], .. }| {
            Err(ExportError::At(format!(
                "the calibration temperature is {at} degC, give one of the range, {low} to {high}"
            )))
        }),
    }
}

/// Largest differences between what the firmware makes of the text, and the curves.
fn difference(
    text: &str,
    instance: u8,
    options: &ExportOptions,
    written: &[ExportText],
) -> Result<Difference, ExportError> {
    let parameters = Parameters::read(text, options.autopilot, Some(instance)).map_err(|error| match error {
        ReadError::Instance(error) => error.into(),
        ReadError::Text(faults) => ExportError::Float32(faults.to_string()),
    })?;
    let relative = options.autopilot == Autopilot::ArduPilot && options.at_c.is_none();
    let of = |triad: &ExportText| {
        let [low, high] = triad.range;
        // Without constants the curves are 0 at ArduPilot's reference, or at the end of the range next to it.
        let zero = f64::from(ARDUPILOT_REFERENCE).clamp(low, high);
        let zeros = triad.curves.map(|curve| if relative { curve.at(zero) } else { 0.0 });
        let at = |temperature: f64| {
            let temperature = temperature as f32;
            let offset = parameters.offset(triad.kind, temperature).unwrap_or([f32::NAN; AXES]);
            let exact = f64::from(temperature).clamp(low, high);
            let each = offset.iter().zip(&triad.curves).zip(zeros);
            each.map(|((offset, curve), zero)| (f64::from(*offset) - (curve.at(exact) - zero)).abs())
                .fold(0.0, f64::max)
        };
        points(triad.range).map(at).fold(0.0, f64::max)
    };
    let kind = |kind| written.iter().find(|triad| triad.kind == kind).map(of);
    Ok(Difference {
        accelerometers: kind(SensorKind::Accelerometer).unwrap_or(0.0),
        gyroscopes: kind(SensorKind::Gyroscope),
    })
}

/// What the user should also know.
fn notes(options: &ExportOptions, policy: OutOfRange, triads: &[Triad<'_>], written: &[ExportText]) -> Vec<String> {
    let mut notes = Vec::new();
    let title = options.autopilot.title();
    if policy != OutOfRange::Clamp {
        notes.push(format!("outside of the range the table has the policy {:?}; {title} clamps", policy.name()));
    }
    for triad in triads {
        let names = triad.kind.names().join(", ");
        let scales = triad.axes.each_ref().map(|axis| {
            let [low, high] = axis.positive_scale_factor.range();
            axis.positive_scale_factor.at(f64::midpoint(low, high))
        });
        let [first, ..] = scales;
        let spread = scales.iter().map(|scale| (scale / first - 1.0).abs()).fold(0.0, f64::max);
        if spread > 0.0 {
            notes.push(format!(
                "the scale factors of {names} differ by {} %; they are not written: {title} has its own",
                size(spread * 100.0)
            ));
        }
    }
    if options.autopilot == Autopilot::ArduPilot {
        notes.push(constants_note(options.at_c, written));
    }
    notes
}

/// What ArduPilot does with the constants.
fn constants_note(at_c: Option<f64>, written: &[ExportText]) -> String {
    let reference = f64::from(ARDUPILOT_REFERENCE);
    let has_gyroscopes = written.iter().any(|triad| triad.kind == SensorKind::Gyroscope);
    match at_c {
        Some(_) if has_gyroscopes => {
            "ArduPilot measures the offsets of its gyroscopes at each start, unless INS_GYR_CAL is 0".to_owned()
        }
        Some(_) => "the constants are those of the table, not of a calibration on the vehicle".to_owned(),
        None => {
            let sizes = written.iter().map(|triad| {
                let unit = if triad.kind == SensorKind::Gyroscope { "rad/s" } else { "m/s2" };
                format!("{} {unit}", size(triad.largest_at(reference)))
            });
            let sizes = sizes.collect::<Vec<_>>().join(" and ");
            format!(
                "the constants of the biases, up to {sizes} at 35 degC, are not written: the vehicle's own \
                 calibration gives them, or an export with a calibration temperature"
            )
        }
    }
}
