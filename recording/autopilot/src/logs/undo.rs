//! What ArduPilot corrects before it logs, undone.
//!
//! Source: ArduPilot's documentation of the parameters, and the order in which AP_InertialSensor applies them (4.1 to
//! 4.7): a reading r in the sensor's frame becomes
//!
//! ```text
//! R (scale * (r - p(T) + p(Tcal) - offset)),   p(t) = 1e-6 (c1 + (c2 + c3 d) d) d,   d = t - 35 degC
//! ```
//!
//! with t within INS_TCALn_TMIN and _TMAX, p only with INS_TCALn_ENABLE 1, the scale only for accelerometers, and R of
//! AHRS_ORIENTATION. So r = (R' v) / scale + offset + p(T) - p(Tcal).

use isotherm_shared::wire::AXES;
use std::collections::HashMap;

/// Temperature that the polynomials are about \[degC\].
const REFERENCE: f64 = 35.0;
/// A coefficient is in millionths.
const COEFFICIENT: f64 = 1e-6;
/// Orders of the polynomials.
const ORDERS: usize = 3;
/// INS_TCALn_ENABLE: the polynomials are applied. 0 is off, and 2 learns without applying.
const ENABLED: f64 = 1.0;
/// Calibration temperature that says: there was no calibration \[degC\]. It counts as TMIN.
const NO_CALIBRATION: f64 = -300.0;
/// TMIN and TMAX by default \[degC\].
const RANGE: [f64; 2] = [0.0, 70.0];
/// Names of the axes.
const NAMES: [&str; AXES] = ["X", "Y", "Z"];

/// Roll, pitch and yaw \[45 degrees\] of each AHRS_ORIENTATION that is a multiple of it; the others are refused.
#[rustfmt::skip]
const ORIENTATIONS: [(u8, [u8; 3]); 42] = [
    (0, [0, 0, 0]), (1, [0, 0, 1]), (2, [0, 0, 2]), (3, [0, 0, 3]), (4, [0, 0, 4]), (5, [0, 0, 5]), (6, [0, 0, 6]),
    (7, [0, 0, 7]), (8, [4, 0, 0]), (9, [4, 0, 1]), (10, [4, 0, 2]), (11, [4, 0, 3]), (12, [0, 4, 0]), (13, [4, 0, 5]),
    (14, [4, 0, 6]), (15, [4, 0, 7]), (16, [2, 0, 0]), (17, [2, 0, 1]), (18, [2, 0, 2]), (19, [2, 0, 3]),
    (20, [6, 0, 0]), (21, [6, 0, 1]), (22, [6, 0, 2]), (23, [6, 0, 3]), (24, [0, 2, 0]), (25, [0, 6, 0]),
    (26, [0, 4, 2]), (27, [0, 4, 6]), (28, [2, 2, 0]), (29, [4, 2, 0]), (30, [6, 2, 0]), (31, [2, 4, 0]),
    (32, [6, 4, 0]), (33, [2, 6, 0]), (34, [4, 6, 0]), (35, [6, 6, 0]), (36, [2, 4, 2]), (37, [2, 0, 6]),
    (39, [0, 7, 0]), (40, [2, 7, 0]), (42, [1, 0, 0]), (43, [7, 0, 0]),
];

/// The corrections of an IMU.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Corrections {
    accelerometers: SensorCorrection,
    gyroscopes: SensorCorrection,
    /// TMIN and TMAX \[degC\].
    range: [f64; 2],
    orientation: u8,
    /// What turns the sensor's frame into that of the vehicle.
    rotation: [[f64; AXES]; AXES],
    /// Whether the log has the offsets.
    has_offsets: bool,
}

#[derive(Clone, Debug, PartialEq)]
struct SensorCorrection {
    offset: [f64; AXES],
    scale: [f64; AXES],
    /// Of the axes; `None` if they are not applied.
    polynomials: Option<[[f64; ORDERS]; AXES]>,
    /// Where offset and scale were found \[degC\].
    calibrated_at: f64,
}

/// Names of the parameters of an IMU.
struct ParameterNames {
    /// Begin those of temperature, such as `INS_TCAL1_`.
    temperature: String,
    /// Begin those of accelerometers and gyroscopes: `INS_ACC`, `INS_ACC2`, `INS4_ACC`.
    sensors: [String; 2],
    /// Begin calibration temperatures: `INS_ACC1_`.
    calibration: [String; 2],
}

impl ParameterNames {
    /// Of the IMU with this number, from 0.
    fn new(instance: u8) -> Self {
        let number = u32::from(instance) + 1;
        let both = |begin: &str, end: &str| ["ACC", "GYR"].map(|sensor| format!("{begin}{sensor}{end}"));
        if number > 3 {
            let begin = format!("INS{number}_");
            let temperature = format!("{begin}TCAL_");
            return Self { temperature, sensors: both(&begin, ""), calibration: both(&begin, "_") };
        }
        let own = if number == 1 { String::new() } else { number.to_string() };
        Self {
            temperature: format!("INS_TCAL{number}_"),
            sensors: both("INS_", &own),
            calibration: both("INS_", &format!("{number}_")),
        }
    }
}

/// Whether a parameter may concern an IMU.
pub(super) fn concerns(parameter: &str) -> bool {
    parameter.starts_with("INS") || parameter == ORIENTATION
}

const ORIENTATION: &str = "AHRS_ORIENTATION";

/// The device ids of accelerometers and gyroscopes.
pub(super) fn devices(parameters: &HashMap<String, f64>, instance: u8) -> [Option<u32>; 2] {
    ParameterNames::new(instance).sensors.map(|begin| {
        let id = parameters.get(&format!("{begin}_ID")).copied()?;
        (id > 0.0 && id <= f64::from(u32::MAX)).then_some(id as u32)
    })
}

impl Corrections {
    /// Of the IMU with this number, from the parameters of the log.
    ///
    /// # Errors
    /// What cannot be undone.
    pub(super) fn new(parameters: &HashMap<String, f64>, instance: u8) -> Result<Self, String> {
        let names = ParameterNames::new(instance);
        let of = |name: &str| parameters.get(name).copied();
        let enable = format!("{}ENABLE", names.temperature);
        let enabled = of(&enable).unwrap_or(0.0);
        if ![0.0, ENABLED, 2.0].contains(&enabled) {
            return Err(format!("{enable} is {enabled}, which is not known; set it to 0 and log again"));
        }
        let limit = |name: &str, default| of(&format!("{}{name}", names.temperature)).unwrap_or(default);
        let number = of(ORIENTATION).unwrap_or(0.0);
        let orientation = ORIENTATIONS.iter().find(|(known, _)| f64::from(*known) == number);
        let (orientation, angles) = orientation
            .ok_or_else(|| format!("{ORIENTATION} is {number}, which cannot be undone; set it to 0 and log again"))?;
        let sensor = |index: usize| SensorCorrection::new(parameters, &names, index, enabled == ENABLED);
        Ok(Self {
            accelerometers: sensor(0)?,
            gyroscopes: sensor(1)?,
            range: [limit("TMIN", RANGE[0]), limit("TMAX", RANGE[1])],
            orientation: *orientation,
            rotation: rotation(*angles),
            has_offsets: of(&format!("{}OFFS_X", names.sensors[0])).is_some(),
        })
    }

    /// What the sensors read: \[m/s2, rad/s\] at a temperature \[degC\].
    pub(super) fn undo(&self, logged: [[f64; AXES]; 2], celsius: f64) -> [[f64; AXES]; 2] {
        let [acceleration, rate] = logged.map(|vector| self.turned_back(vector));
        [self.accelerometers.undo(acceleration, celsius, self.range), self.gyroscopes.undo(rate, celsius, self.range)]
    }

    /// Whether another orientation holds.
    pub(super) const fn turns_unlike(&self, other: &Self) -> bool {
        self.orientation != other.orientation
    }

    /// What is undone, in words.
    pub(super) fn told(&self) -> String {
        let mut undone = Vec::new();
        let Self { accelerometers, gyroscopes, .. } = self;
        if accelerometers.offset != [0.0; AXES] || accelerometers.scale != [1.0; AXES] {
            undone.push("offsets and scale of the accelerometers".to_owned());
        }
        if gyroscopes.offset != [0.0; AXES] {
            undone.push("offsets of the gyroscopes".to_owned());
        }
        if accelerometers.polynomials.is_some() {
            undone.push("the temperature calibration in force (INS_TCAL)".to_owned());
        }
        if self.orientation != 0 {
            undone.push(format!("{ORIENTATION} {}", self.orientation));
        }
        let offsets = if self.has_offsets { "" } else { "; the log has no INS_ACCOFFS: they count as 0" };
        let undone = if undone.is_empty() { "nothing, all are neutral".to_owned() } else { undone.join(", ") };
        format!("of ArduPilot's corrections undone: {undone}{offsets}")
    }

    /// The inverse of a rotation is its transpose.
    fn turned_back(&self, vector: [f64; AXES]) -> [f64; AXES] {
        core::array::from_fn(|axis| (0..AXES).map(|row| self.rotation[row][axis] * vector[row]).sum())
    }
}

impl SensorCorrection {
    /// Of accelerometers (0) or gyroscopes (1).
    fn new(
        parameters: &HashMap<String, f64>,
        names: &ParameterNames,
        index: usize,
        is_enabled: bool,
    ) -> Result<Self, String> {
        let of = |name: String| parameters.get(&name).copied();
        let (begin, kind) = (&names.sensors[index], ["ACC", "GYR"][index]);
        let mut sensor = Self {
            offset: [0.0; AXES],
            scale: [1.0; AXES],
            polynomials: is_enabled.then_some([[0.0; ORDERS]; AXES]),
            calibrated_at: of(format!("{}CALTEMP", names.calibration[index])).unwrap_or(NO_CALIBRATION),
        };
        for (axis, name) in NAMES.into_iter().enumerate() {
            sensor.offset[axis] = of(format!("{begin}OFFS_{name}")).unwrap_or(0.0);
            if index == 0 {
                let scale = of(format!("{begin}SCAL_{name}")).unwrap_or(1.0);
                if scale == 0.0 {
                    return Err(format!("{begin}SCAL_{name} is 0, which cannot be undone; set it to 1 and log again"));
                }
                sensor.scale[axis] = scale;
            }
            for (order, coefficient) in sensor.polynomials.iter_mut().flat_map(|all| all[axis].iter_mut().enumerate()) {
                let parameter = format!("{}{kind}{}_{name}", names.temperature, order + 1);
                *coefficient = of(parameter).unwrap_or(0.0) * COEFFICIENT;
            }
        }
        Ok(sensor)
    }

    fn undo(&self, value: [f64; AXES], celsius: f64, [least, most]: [f64; 2]) -> [f64; AXES] {
        let within = |celsius: f64| celsius.max(least).min(most.max(least)) - REFERENCE;
        core::array::from_fn(|axis| {
            let polynomial = |d: f64| {
                let [c1, c2, c3] = self.polynomials.map_or([0.0; ORDERS], |all| all[axis]);
                (c1 + (c2 + c3 * d) * d) * d
            };
            let drift = polynomial(within(celsius)) - polynomial(within(self.calibrated_at));
            value[axis] / self.scale[axis] + self.offset[axis] + drift
        })
    }
}

/// The matrix of roll, then pitch, then yaw about fixed axes, each in 45 degrees.
fn rotation(angles: [u8; 3]) -> [[f64; AXES]; AXES] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|eighths| {
        let half = core::f64::consts::FRAC_1_SQRT_2;
        let sines = [0.0, half, 1.0, half, 0.0, -half, -1.0, -half];
        let at = usize::from(eighths) % sines.len();
        (sines[at], sines[(at + 2) % sines.len()])
    });
    [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
}
