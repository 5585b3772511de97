//! What is simulated: the truth, the hardware and its random errors.

use super::random::RandomGenerator;
use crate::gyroscopes::earth::{horizontal, vertical};
use isotherm_shared::polynomial::{Polynomial, Side};
use isotherm_shared::table::{AXIS_NAMES, Axis, CoefficientTable, Content, Refusal};
use isotherm_shared::units::ARCSEC;
use isotherm_shared::wire::AXES;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// The random stream of a seed from which a truth is drawn.
const TRUTH: u64 = 4;

/// A typical misalignment of an IMU; see [`Truth::misalignment`].
pub const MISALIGNMENT: Matrix3<f64> = Matrix3::new(1.0, 3e-4, -2e-4, -1.5e-4, 1.0, 2.5e-4, 1e-4, -3e-4, 1.0);

/// A typical tilt of a turntable \[rad\]; see [`Truth::tilt_rad`].
pub const TILT_RAD: [f64; 2] = [4e-5, -6e-5];

/// Latitude of the turntable unless another is given \[deg\]; see [`Truth::latitude_deg`].
pub const LATITUDE_DEG: f64 = 39.9;

/// Heading of the turntable unless another is given \[deg\]; see [`Truth::heading_deg`].
pub const HEADING_DEG: f64 = 30.0;

/// The true values that the data are simulated from.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Bias and scale factors. Its alignment is the inverse of `misalignment`, or absent without misalignment.
    pub table: CoefficientTable,
    /// M: indicated = M * specific force + bias. One row for each sensor; columns A1, A2, A3.
    pub misalignment: Matrix3<f64>,
    /// Tilt (tx, ty) of the turntable's base about the laboratory's X and Y \[rad\].
    pub tilt_rad: [f64; 2],
    /// Gravity at the location of the IMU \[m/s2\].
    pub gravity_local: f64,
    /// Latitude of the turntable, north positive \[deg\]. Only gyroscopes feel it.
    pub latitude_deg: f64,
    /// Heading of the base's X, which is the outer axis: clockwise from north, seen from above \[deg\]. Only gyroscopes feel it.
    pub heading_deg: f64,
}

impl Truth {
    /// A truth from `content`. Its alignment is replaced by the inverse of `misalignment`. The turntable is at [`LATITUDE_DEG`] and
    /// [`HEADING_DEG`].
    ///
    /// # Errors
    /// If `misalignment` has no inverse; else every reason why the table is not valid.
    pub fn new(
        mut content: Content,
        misalignment: Matrix3<f64>,
        tilt_rad: [f64; 2],
        gravity_local: f64,
    ) -> Result<Self, Vec<Refusal>> {
        let singular = || vec![Refusal { key: "misalignment".to_owned(), message: "has no inverse".to_owned() }];
        content.alignment = Some(misalignment.try_inverse().ok_or_else(singular)?);
        let table = CoefficientTable::new(content)?;
        Ok(Self { table, misalignment, tilt_rad, gravity_local, latitude_deg: LATITUDE_DEG, heading_deg: HEADING_DEG })
    }

    /// A truth from `table` as it is. The misalignment is the inverse of its alignment, if it has one. No tilt; the local
    /// gravity is 1 g0. The turntable is at [`LATITUDE_DEG`] and [`HEADING_DEG`].
    #[must_use]
    pub fn of(table: CoefficientTable) -> Self {
        let misalignment = inverse(table.content().alignment);
        let gravity_local = table.content().gravity;
        Self {
            table,
            misalignment,
            tilt_rad: [0.0; 2],
            gravity_local,
            latitude_deg: LATITUDE_DEG,
            heading_deg: HEADING_DEG,
        }
    }

    /// M of the gyroscopes, the inverse of the table's gyroscope alignment: indicated = M * rate + bias. One row for each gyroscope; columns along
    /// A1, A2, A3. The identity without an alignment or without gyroscopes.
    #[must_use]
    pub fn gyroscope_misalignment(&self) -> Matrix3<f64> {
        inverse(self.table.content().gyroscopes.as_ref().and_then(|gyroscopes| gyroscopes.alignment))
    }

    /// Earth's rate along the base's X, Y and Z \[deg/h\].
    #[must_use]
    pub fn earth_rate(&self) -> [f64; AXES] {
        let [tx, ty] = self.tilt_rad;
        let up = Vector3::new(-ty, tx, 1.0).normalize();
        // Right-handed about Z the heading runs from X to north.
        let (sine, cosine) = self.heading_deg.to_radians().sin_cos();
        let north = Vector3::new(cosine, sine, 0.0);
        let north = (north - up * up.dot(&north)).normalize();
        (north * horizontal(self.latitude_deg) + up * vertical(self.latitude_deg)).into()
    }

    /// Another IMU of the same kind as `content`, in another laboratory, drawn from `seed`. Bias constants differ by up to
    /// 300 ug0, scale factor constants by up to 2 %, all higher coefficients by up to 20 %. The standard deviation is 3e-4
    /// for misalignments and 5e-5 rad for tilts. The local gravity is 9.78 to 9.83 m/s2.
    ///
    /// # Errors
    /// If the drawn values are not a valid table, which may happen if `content` is close to the limits.
    pub fn varied(content: &Content, seed: u64) -> Result<Self, Vec<Refusal>> {
        let mut random = RandomGenerator::new(seed, TRUTH);
        let mut content = content.clone();
        for axis in &mut content.axes {
            let unit = axis.bias_unit.factor();
            let constant = axis.bias.coefficients().first().copied().unwrap_or_default();
            axis.bias = varied(&axis.bias, constant + random.between(-300e-6, 300e-6) / unit, &mut random);
            for scale_factor in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
                let constant = scale_factor.coefficients().first().copied().unwrap_or_default();
                *scale_factor = varied(scale_factor, constant * random.between(0.98, 1.02), &mut random);
            }
        }
        let misalignment = Matrix3::from_fn(|i, j| if i == j { 1.0 } else { 3e-4 * random.normal() });
        let tilt_rad = [5e-5 * random.normal(), 5e-5 * random.normal()];
        Self::new(content, misalignment, tilt_rad, random.between(9.78, 9.83))
    }

    /// A message about the first telemetry that leaves a range of the table while the chamber is between `low_c` and
    /// `high_c` \[degC\]; `None` if none does. A table defines no values outside its ranges, so nothing can be simulated
    /// there.
    #[must_use]
    pub fn outside(&self, chain: &Chain, low_c: f64, high_c: f64) -> Option<String> {
        let margin_c = chain.oscillation_c.abs();
        AXIS_NAMES.iter().zip(&self.table.content().axes).enumerate().find_map(|(index, (name, axis))| {
            let Axis { bias, positive_scale_factor, negative_scale_factor, .. } = axis;
            let (head_c, board_c) = (chain.head_offset_c[index], chain.board_offset_c[index]);
            let quantities = [
                ("bias", bias, head_c),
                ("positive_scale_factor", positive_scale_factor, board_c),
                ("negative_scale_factor", negative_scale_factor, board_c),
            ];
            quantities.into_iter().find_map(|(quantity, polynomial, offset_c)| {
                let ends = [low_c - margin_c, high_c + margin_c].map(|end_c| chain.telemetry(end_c + offset_c));
                let outside = ends.into_iter().find(|&end| polynomial.side(end) != Side::Inside)?;
                let [low, high] = polynomial.range();
                Some(format!("telemetry {outside:.4} is outside the range {low} to {high} of axis.{name}.{quantity}"))
            })
        })
    }

    /// The sealed text of the table, followed by a `[provenance]` section. The section has the other values of the truth,
    /// the `tool`, the `seed`, and all parameters of the schedule, a [`CampaignSchedule`](super::CampaignSchedule) or a
    /// [`RunSchedule`](super::RunSchedule).
    ///
    /// # Errors
    /// If the seed is over 2^63 - 1, the largest integer of TOML.
    pub fn to_toml(&self, tool: &str, seed: u64, schedule: &impl Serialize) -> Result<String, toml::ser::Error> {
        #[derive(Serialize)]
        struct TruthProvenance<'a, T> {
            tool: &'a str,
            seed: u64,
            gravity_local: f64,
            tilt_rad: [f64; 2],
            misalignment: [[f64; AXES]; AXES],
            #[serde(flatten)]
            schedule: &'a T,
        }
        #[derive(Serialize)]
        struct TruthFile<'a, T> {
            provenance: TruthProvenance<'a, T>,
        }
        let misalignment = self.misalignment.transpose().into();
        let Self { gravity_local, tilt_rad, .. } = *self;
        let provenance = TruthProvenance { tool, seed, gravity_local, tilt_rad, misalignment, schedule };
        Ok(format!("{}\n{}", self.table.to_toml(), toml::to_string(&TruthFile { provenance })?))
    }
}

/// The inverse of a table's alignment, which is never singular; the identity without one.
fn inverse(alignment: Option<Matrix3<f64>>) -> Matrix3<f64> {
    alignment.and_then(|alignment| alignment.try_inverse()).unwrap_or_else(Matrix3::identity)
}

/// `polynomial` with another constant, and with its higher coefficients changed by up to 20 %.
fn varied(polynomial: &Polynomial, constant: f64, random: &mut RandomGenerator) -> Polynomial {
    let mut coefficients = polynomial.coefficients().to_vec();
    coefficients.iter_mut().skip(1).for_each(|coefficient| *coefficient *= random.between(0.8, 1.2));
    if let Some(first) = coefficients.first_mut() {
        *first = constant;
    }
    // This can fail only if a product overflows, for coefficients near 1e308.
    Polynomial::new(&coefficients, polynomial.center(), polynomial.scale(), polynomial.range()).unwrap_or(*polynomial)
}

/// Largest error of the bias \[1e-6 g0\] and of the scale factors \[ppm\] of `table` against `truth`, over the ranges of
/// `table`.
#[must_use]
pub fn worst_errors(table: &CoefficientTable, truth: &CoefficientTable) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    for (axis, right) in table.content().axes.iter().zip(&truth.content().axes) {
        for i in 0..=400 {
            let at = |[low, high]: [f64; 2]| low + (high - low) * f64::from(i) / 400.0;
            let (head, board) = (at(axis.bias.range()), at(axis.positive_scale_factor.range()));
            worst[0] = worst[0].max((axis.bias_at(head).0 - right.bias_at(head).0).abs() * 1e6);
            let plus = axis.positive_scale_factor_at(board).0 / right.positive_scale_factor_at(board).0 - 1.0;
            let minus = axis.negative_scale_factor_at(board).0 / right.negative_scale_factor_at(board).0 - 1.0;
            worst[1] = worst[1].max(plus.abs() * 1e6).max(minus.abs() * 1e6);
        }
    }
    worst
}

/// The hardware: properties that are the same in every simulation.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Chain {
    /// Time constant of the sensor heads after the chamber's air \[s\], over 0.
    pub head_lag_s: f64,
    /// Time constant of the converter boards after the chamber's air \[s\], over 0.
    pub board_lag_s: f64,
    /// Temperature of each head above the chamber's \[degC\].
    pub head_offset_c: [f64; AXES],
    /// Temperature of each board above the chamber's, by its own heat \[degC\].
    pub board_offset_c: [f64; AXES],
    /// Temperature of each gyroscope's head above the chamber's \[degC\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_head_offset_c: [f64; AXES],
    /// Temperature of each gyroscope's board above the chamber's, by its own heat \[degC\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_board_offset_c: [f64; AXES],
    /// Amplitude of the chamber's slow oscillation \[degC\]; 0 for none.
    pub oscillation_c: f64,
    /// Period of the oscillation \[s\], over 0. The seed determines its phase.
    pub oscillation_s: f64,
    /// Telemetry at 0 degC, in the table's unit.
    pub telemetry_zero: f64,
    /// Telemetry per degC, in the table's unit.
    pub telemetry_slope: f64,
    /// Resolution of the telemetry in 1e-6 of the table's unit; 0 for none.
    pub telemetry_lsb_micro: u32,
    /// Interval between two readings of the telemetry \[s\]; 0 for a reading in every sample.
    pub telemetry_s: f64,
    /// Amplitude of a vibration along all input axes, in phase \[g0\]; 0 for none.
    pub vibration_g0: f64,
    /// Frequency of the vibration \[Hz\].
    pub vibration_hz: f64,
}

impl Default for Chain {
    /// Telemetry in volts, 1.1 V at -25 degC and 3.9 V at 45 degC, 16 bits over 5 V, read every sample; no vibration.
    fn default() -> Self {
        Self {
            head_lag_s: 300.0,
            board_lag_s: 420.0,
            head_offset_c: [0.0, 0.625, 1.25],
            board_offset_c: [4.0, 3.5, 3.0],
            gyroscope_head_offset_c: [1.75, 2.25, 2.75],
            gyroscope_board_offset_c: [2.5, 2.0, 1.5],
            oscillation_c: 0.05,
            oscillation_s: 3600.0,
            telemetry_zero: 2.1,
            telemetry_slope: 0.04,
            telemetry_lsb_micro: 76,
            telemetry_s: 0.0,
            vibration_g0: 0.0,
            vibration_hz: 0.0,
        }
    }
}

impl Chain {
    /// Telemetry at `temperature_c` \[degC\], without noise and resolution.
    #[must_use]
    pub fn telemetry(&self, temperature_c: f64) -> f64 {
        self.telemetry_zero + self.telemetry_slope * temperature_c
    }

    /// The nearest multiple of the resolution, as a double that prints with at most six decimals.
    pub(super) fn quantised(&self, telemetry: f64) -> f64 {
        match f64::from(self.telemetry_lsb_micro) {
            0.0 => telemetry,
            // Adding 0 turns -0 into 0.
            lsb => (telemetry * 1e6 / lsb).round() * lsb / 1e6 + 0.0,
        }
    }
}

/// Random differences: standard deviations of Gaussian numbers, 0 for none.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Noise {
    /// White noise of a sensor in a mean over 1 s \[g0\]; in a mean over Ts it is 1/sqrt(Ts) times as large.
    pub sensor_g0: f64,
    /// Noise of a telemetry reading, in the table's unit.
    pub telemetry: f64,
    /// Offset of the bias in each visit of a set point \[g0\].
    pub bias_g0: f64,
    /// Relative offsets of K+ and K- in each visit of a set point.
    pub scale_factor: f64,
    /// Error of each angle of the turntable in each dwell, and where a turn begins \[rad\].
    pub positioning_rad: f64,
    /// Random walk of a gyroscope's angle \[deg/sqrt(h)\]: in an interval of Ts seconds it is `60 * sqrt(Ts)` arcsec times this.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub random_walk: f64,
    /// Offset of a gyroscope's bias in each visit of a set point \[deg/h\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_bias: f64,
    /// Relative offsets of a gyroscope's K+ and K- in each visit of a set point.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gyroscope_scale_factor: f64,
    /// Error of the angle of each turn \[rad\].
    #[serde(default, skip_serializing_if = "is_zero")]
    pub turn_rad: f64,
}

/// Whether a value says nothing, as those of the gyroscopes do where there are none.
fn is_zero<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for Noise {
    /// Accelerometers 5 ug0 in 1 s, telemetry 0.1 mV, visits 0.2 ug0 and 0.3 ppm, angles 1 arcsec. Gyroscopes 0.003 deg/sqrt(h), visits
    /// 0.003 deg/h and 0.5 ppm, turns 0.2 arcsec.
    fn default() -> Self {
        Self {
            sensor_g0: 5e-6,
            telemetry: 1e-4,
            bias_g0: 0.2e-6,
            scale_factor: 0.3e-6,
            positioning_rad: (1.0_f64 / 3600.0).to_radians(),
            random_walk: 0.003,
            gyroscope_bias: 0.003,
            gyroscope_scale_factor: 0.5e-6,
            turn_rad: 0.2 * ARCSEC,
        }
    }
}

impl Noise {
    /// No noise: everything repeats exactly.
    pub const NONE: Self = Self {
        sensor_g0: 0.0,
        telemetry: 0.0,
        bias_g0: 0.0,
        scale_factor: 0.0,
        positioning_rad: 0.0,
        random_walk: 0.0,
        gyroscope_bias: 0.0,
        gyroscope_scale_factor: 0.0,
        turn_rad: 0.0,
    };
}
