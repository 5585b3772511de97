//! The truth: the true values that data are simulated from.

use super::chain::Chain;
use super::hysteresis::Play;
use super::random::RandomGenerator;
use isotherm_campaign::{horizontal_rate, vertical_rate};
use isotherm_shared::polynomial::{Polynomial, Side};
use isotherm_shared::table::{Axis, CoefficientTable, Content, ContentFault, Gyroscopes};
use isotherm_shared::units::{BiasUnit, SensorKind};
use isotherm_shared::wire::AXES;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// The random stream of a seed from which a truth is drawn.
const TRUTH: u64 = 4;

/// That of the gyroscopes and of the place, so that the rest does not depend on whether there are gyroscopes.
const GYROSCOPE_TRUTH: u64 = 8;

/// A typical misalignment of an IMU; see [`Truth::misalignment`].
pub const MISALIGNMENT: Matrix3<f64> = Matrix3::new(1.0, 3e-4, -2e-4, -1.5e-4, 1.0, 2.5e-4, 1e-4, -3e-4, 1.0);

/// A typical misalignment of the gyroscopes; see [`Truth::gyroscope_misalignment`].
pub const GYROSCOPE_MISALIGNMENT: Matrix3<f64> =
    Matrix3::new(1.0, -2.5e-4, 1.5e-4, 3.5e-4, 1.0, -1e-4, -2e-4, 3e-4, 1.0);

/// A typical tilt of a turntable \[rad\]; see [`Truth::tilt_rad`].
pub const TILT_RAD: [f64; 2] = [4e-5, -6e-5];

/// Latitude of the turntable unless another is given \[deg\]; see [`Truth::latitude_deg`].
pub const LATITUDE_DEG: f64 = 39.9;

/// Heading of the turntable unless another is given \[deg\]; see [`Truth::heading_deg`].
pub const HEADING_DEG: f64 = 30.0;

/// The true values that the data are simulated from.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_campaign::EARTH_RATE;
/// use isotherm_shared::table::CoefficientTable;
/// use isotherm_simulation::{MISALIGNMENT, TILT_RAD, Truth};
///
/// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
/// let content = table.content().clone();
/// let truth = Truth::new(content, MISALIGNMENT, TILT_RAD, 9.8012).map_err(|refusals| format!("{refusals:?}"))?;
/// // The table's alignment takes the misalignment out again.
/// let alignment = truth.table.content().alignment.ok_or("no alignment")?;
/// assert!((alignment * MISALIGNMENT - nalgebra::Matrix3::identity()).norm() < 1e-12);
/// assert!((nalgebra::Vector3::from(truth.earth_rate()).norm() - EARTH_RATE).abs() < 1e-9); // deg/h
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Bias and scale factors, the time constant of the sensing elements behind the true head temperature, and the
    /// transients of the biases. Its alignment is the inverse of `misalignment`, or absent without misalignment.
    pub table: CoefficientTable,
    /// Hysteresis of the biases, which no table describes.
    pub plays: Vec<Play>,
    /// M: indicated = M * specific force + bias. One row for each sensor; columns A1, A2, A3.
    pub misalignment: Matrix3<f64>,
    /// Tilt (tx, ty) of the turntable's base about the laboratory's X and Y \[rad\].
    pub tilt_rad: [f64; 2],
    /// Gravity at the location of the IMU \[m/s2\].
    pub gravity_local: f64,
    /// Latitude of the turntable, north positive \[deg\]. Only gyroscopes feel it.
    pub latitude_deg: f64,
    /// Heading of the base's X, which is the outer axis: clockwise from north, seen from above \[deg\]. Only gyroscopes
    /// feel it.
    pub heading_deg: f64,
}

impl Truth {
    /// A truth from `content`, without plays. Its alignment is replaced by the inverse of `misalignment`. The turntable
    /// is at [`LATITUDE_DEG`] and [`HEADING_DEG`].
    ///
    /// # Errors
    /// If `misalignment` has no inverse; otherwise every reason why the table is not valid.
    pub fn new(
        mut content: Content,
        misalignment: Matrix3<f64>,
        tilt_rad: [f64; 2],
        gravity_local: f64,
    ) -> Result<Self, Vec<ContentFault>> {
        let singular = || vec![ContentFault { key: "misalignment".to_owned(), message: "has no inverse".to_owned() }];
        content.alignment = Some(misalignment.try_inverse().ok_or_else(singular)?);
        let table = CoefficientTable::new(content)?;
        Ok(Self {
            table,
            plays: Vec::new(),
            misalignment,
            tilt_rad,
            gravity_local,
            latitude_deg: LATITUDE_DEG,
            heading_deg: HEADING_DEG,
        })
    }

    /// A truth from `table` as it is. The misalignment is the inverse of its alignment, if it has one. No plays, no
    /// tilt; the local gravity is 1 g0. The turntable is at [`LATITUDE_DEG`] and [`HEADING_DEG`].
    #[must_use]
    pub fn of(table: CoefficientTable) -> Self {
        let misalignment = inverse(table.content().alignment);
        let gravity_local = table.content().gravity;
        Self {
            table,
            plays: Vec::new(),
            misalignment,
            tilt_rad: [0.0; 2],
            gravity_local,
            latitude_deg: LATITUDE_DEG,
            heading_deg: HEADING_DEG,
        }
    }

    /// The table without time constant and transients, as a static campaign gives it.
    #[must_use]
    pub fn static_table(&self) -> CoefficientTable {
        let mut content = self.table.content().clone();
        let gyroscopes = content.gyroscopes.iter_mut().flat_map(|gyroscopes| &mut gyroscopes.axes);
        content.axes.iter_mut().chain(gyroscopes).for_each(|axis| axis.transient = 0.0);
        content.lag_s = None;
        content.format = content.least_format();
        // A table with fewer terms is as valid.
        CoefficientTable::new(content).unwrap_or_else(|_| self.table.clone())
    }

    /// M of the gyroscopes, the inverse of the table's gyroscope alignment: indicated = M * rate + bias. One row for
    /// each gyroscope; columns along A1, A2, A3. The identity without an alignment or without gyroscopes.
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
        let (sine, cosine) = libm::sincos(self.heading_deg.to_radians());
        let north = Vector3::new(cosine, sine, 0.0);
        let north = (north - up * up.dot(&north)).normalize();
        (north * horizontal_rate(self.latitude_deg) + up * vertical_rate(self.latitude_deg)).into()
    }

    /// Another IMU of the same kind as `content`, in another laboratory, drawn from `seed`. Bias constants differ by up
    /// to 300 ug0 or 3 deg/h, scale factor constants by up to 2 % or 0.5 %, all higher coefficients by up to 20 %,
    /// g-sensitivities by up to 1 deg/h/g0. The standard deviation is 3e-4 for misalignments and 5e-5 rad for tilts.
    /// The local gravity is 9.78 to 9.83 m/s2, the latitude -70 to 70 deg, the heading any.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::table::CoefficientTable;
    /// use isotherm_simulation::{Truth, worst_errors};
    ///
    /// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
    /// let truth = Truth::varied(table.content(), 42).map_err(|refusals| format!("{refusals:?}"))?;
    /// // As a sister unit, the table of one is wrong for the other: by some 100 ug0 and some 1000 ppm.
    /// let [bias, scale_factor] = worst_errors(&table, &truth.table);
    /// assert!(bias > 50.0 && scale_factor > 500.0, "{bias} ug0, {scale_factor} ppm");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If the drawn values are not a valid table, which may happen if `content` is close to the limits.
    pub fn varied(content: &Content, seed: u64) -> Result<Self, Vec<ContentFault>> {
        let mut random = RandomGenerator::new(seed, TRUTH);
        let mut content = content.clone();
        for axis in &mut content.axes {
            vary(axis, 300e-6, 0.02, &mut random);
        }
        let misalignment = varied_misalignment(&mut random);
        let tilt_rad = [5e-5 * random.normal(), 5e-5 * random.normal()];
        let gravity_local = random.between(9.78, 9.83);
        let mut random = RandomGenerator::new(seed, GYROSCOPE_TRUTH);
        if let Some(gyroscopes) = &mut content.gyroscopes {
            for (axis, g_sensitivity) in gyroscopes.axes.iter_mut().zip(&mut gyroscopes.g_sensitivity) {
                vary(axis, 3.0, 0.005, &mut random);
                *g_sensitivity = Some(g_sensitivity.unwrap_or_default().map(|s| s + random.between(-1.0, 1.0)));
            }
            gyroscopes.alignment = varied_misalignment(&mut random).try_inverse();
        }
        let truth = Self::new(content, misalignment, tilt_rad, gravity_local)?;
        Ok(Self { latitude_deg: random.between(-70.0, 70.0), heading_deg: random.between(0.0, 360.0), ..truth })
    }

    /// A message about the first temperature that leaves a range of the table while the chamber is between `low_c` and
    /// `high_c` \[degC\]; `None` if none does. A table defines no values outside its ranges, so nothing can be
    /// simulated there.
    #[must_use]
    pub fn outside(&self, chain: &Chain, low_c: f64, high_c: f64) -> Option<String> {
        let margin_c = chain.oscillation_c.abs();
        let content = self.table.content();
        let accelerometers =
            (SensorKind::Accelerometer, "axis", &content.axes, [chain.head_offset_c, chain.board_offset_c]);
        let gyroscopes = content.gyroscopes.as_ref().map(|gyroscopes| {
            let offsets_c = [chain.gyroscope_head_offset_c, chain.gyroscope_board_offset_c];
            (SensorKind::Gyroscope, "gyroscope", &gyroscopes.axes, offsets_c)
        });
        let sensors =
            [accelerometers].into_iter().chain(gyroscopes).flat_map(|(kind, section, axes, [head_c, board_c])| {
                (0..AXES).map(move |i| (section, kind.names()[i], &axes[i], head_c[i], board_c[i]))
            });
        sensors.into_iter().find_map(|(section, name, axis, head_c, board_c)| {
            let Axis { bias, positive_scale_factor, negative_scale_factor, .. } = axis;
            let quantities = [
                ("bias", bias, head_c),
                ("positive_scale_factor", positive_scale_factor, board_c),
                ("negative_scale_factor", negative_scale_factor, board_c),
            ];
            quantities.into_iter().find_map(|(quantity, polynomial, offset_c)| {
                let ends = [low_c - margin_c, high_c + margin_c].map(|end_c| chain.temperature(end_c + offset_c));
                let outside = ends.into_iter().find(|&end| polynomial.side(end) != Side::Inside)?;
                let [low, high] = polynomial.range();
                Some(format!(
                    "temperature {outside:.4} is outside the range {low} to {high} of {section}.{name}.{quantity}"
                ))
            })
        })
    }

    /// The sealed text of the table, followed by a `[provenance]` section. The section has the other values of the
    /// truth (with gyroscopes also their misalignment, latitude, heading and Earth's rate along the base's X, Y and Z;
    /// plays), the `tool`, the `seed`, and all parameters of the schedule.
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
            gyroscopes: Option<GyroscopeProvenance>,
            #[serde(flatten)]
            schedule: &'a T,
            #[serde(skip_serializing_if = "<[Play]>::is_empty")]
            plays: &'a [Play],
        }
        #[derive(Serialize)]
        struct GyroscopeProvenance {
            gyroscope_misalignment: [[f64; AXES]; AXES],
            latitude_deg: f64,
            heading_deg: f64,
            earth_rate_deg_h: [f64; AXES],
        }
        #[derive(Serialize)]
        struct TruthFile<'a, T> {
            provenance: TruthProvenance<'a, T>,
        }
        let rows = |matrix: Matrix3<f64>| matrix.transpose().into();
        let Self { gravity_local, tilt_rad, latitude_deg, heading_deg, .. } = *self;
        let gyroscopes = self.table.content().gyroscopes.is_some().then(|| GyroscopeProvenance {
            gyroscope_misalignment: rows(self.gyroscope_misalignment()),
            latitude_deg,
            heading_deg,
            earth_rate_deg_h: self.earth_rate(),
        });
        let misalignment = rows(self.misalignment);
        let provenance = TruthProvenance {
            tool,
            seed,
            gravity_local,
            tilt_rad,
            misalignment,
            gyroscopes,
            schedule,
            plays: &self.plays,
        };
        Ok(format!("{}\n{}", self.table.to_toml(), toml::to_string(&TruthFile { provenance })?))
    }
}

/// The inverse of a table's alignment, which is never singular; the identity without one.
fn inverse(alignment: Option<Matrix3<f64>>) -> Matrix3<f64> {
    alignment.and_then(|alignment| alignment.try_inverse()).unwrap_or_else(Matrix3::identity)
}

/// Draws another sensor of the same kind; its bias constant differs by up to `bias` \[g0 or deg/h\], its scale factor
/// constants relatively by up to `scale_factor`.
fn vary(axis: &mut Axis, bias: f64, scale_factor: f64, random: &mut RandomGenerator) {
    let unit = axis.bias_unit.factor();
    let constant = axis.bias.coefficients().first().copied().unwrap_or_default();
    axis.bias = varied(&axis.bias, constant + random.between(-bias, bias) / unit, random);
    for polynomial in [&mut axis.positive_scale_factor, &mut axis.negative_scale_factor] {
        let constant = polynomial.coefficients().first().copied().unwrap_or_default();
        *polynomial = varied(polynomial, constant * random.between(1.0 - scale_factor, 1.0 + scale_factor), random);
    }
}

/// A misalignment M with 1 on its diagonal and a standard deviation of 3e-4 next to it.
fn varied_misalignment(random: &mut RandomGenerator) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| if i == j { 1.0 } else { 3e-4 * random.normal() })
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

/// Largest error of the accelerometers' bias \[1e-6 g0\] and scale factors \[ppm\] of `table` against `truth`, over the
/// ranges of `table`.
#[must_use]
pub fn worst_errors(table: &CoefficientTable, truth: &CoefficientTable) -> [f64; 2] {
    let [bias, scale_factor] = worst_of_triad(&table.content().axes, &truth.content().axes);
    [bias * 1e6, scale_factor]
}

/// Largest error of the gyroscopes' bias \[deg/h\], scale factors \[ppm\], g-sensitivities \[deg/h/g0\] and
/// misalignments \[rad\] of `table` against `truth`, over the ranges of `table`; `None` if one of them has no
/// gyroscopes.
#[must_use]
pub fn worst_gyroscope_errors(table: &CoefficientTable, truth: &CoefficientTable) -> Option<[f64; 4]> {
    let (found, right) = (table.content().gyroscopes.as_ref()?, truth.content().gyroscopes.as_ref()?);
    let [bias, scale_factor] = worst_of_triad(&found.axes, &right.axes);
    let g_sensitivity = |gyroscopes: &Gyroscopes| gyroscopes.g_sensitivity.map(Option::unwrap_or_default);
    let pairs = g_sensitivity(found).into_iter().flatten().zip(g_sensitivity(right).into_iter().flatten());
    let misalignment = inverse(found.alignment) - inverse(right.alignment);
    Some([
        bias,
        scale_factor,
        pairs.map(|(found, right)| (found - right).abs()).fold(0.0, f64::max),
        misalignment.amax(),
    ])
}

/// Largest error of the bias \[g0 or deg/h\] and of the scale factors \[ppm\] of three sensors.
fn worst_of_triad(axes: &[Axis; AXES], truth: &[Axis; AXES]) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    for (axis, right) in axes.iter().zip(truth) {
        for i in 0..=400 {
            let at = |[low, high]: [f64; 2]| low + (high - low) * f64::from(i) / 400.0;
            let (head, board) = (at(axis.bias.range()), at(axis.positive_scale_factor.range()));
            worst[0] = worst[0].max((axis.bias_at(head).0 - right.bias_at(head).0).abs());
            let plus = axis.positive_scale_factor_at(board).0 / right.positive_scale_factor_at(board).0 - 1.0;
            let minus = axis.negative_scale_factor_at(board).0 / right.negative_scale_factor_at(board).0 - 1.0;
            worst[1] = worst[1].max(plus.abs() * 1e6).max(minus.abs() * 1e6);
        }
    }
    worst
}

/// Typical gyroscopes, with the temperature of `chain`, for a truth that has none: some deg/h of bias and some 1e-4 of
/// scale factor over -25 to 45 degC, K+ and K- about 1 pulse/arcsec, with g-sensitivity and misalignment. Defined
/// from -40 to 85 degC. `None` if the temperature of the chain does not change with the temperature.
#[must_use]
pub fn typical_gyroscopes(chain: &Chain) -> Option<Gyroscopes> {
    let [low, high] = [-40.0, 85.0].map(|temperature_c| chain.temperature(temperature_c));
    let range = [low.min(high), low.max(high)];
    // Of t = (U - U(10 degC)) / (U(45 degC) - U(10 degC)).
    let (center, scale) = (chain.temperature(10.0), 35.0 * chain.temperature_slope);
    let curve = |coefficients: [f64; 4]| Polynomial::new(&coefficients, center, scale, range);
    let gyroscope = |bias, k: f64, positive: [f64; 3], negative: [f64; 3]| {
        let scale_factor = |k: f64, [c1, c2, c3]: [f64; 3]| curve([k, k * c1, k * c2, k * c3]);
        Some(Axis {
            bias_unit: BiasUnit::DegreePerHour,
            bias: curve(bias)?,
            transient: 0.0,
            positive_scale_factor: scale_factor(k, positive)?,
            negative_scale_factor: scale_factor(-1.0007 * k, negative)?,
            max_rate: None,
        })
    };
    Some(Gyroscopes {
        axes: [
            gyroscope([2.4, -1.9, 0.8, -0.4], 1.0512, [4e-4, -1.5e-4, 6e-5], [-3e-4, -1e-4, 5e-5])?,
            gyroscope([-1.3, 0.6, 0.5, 0.3], 0.9871, [-2e-4, 1e-4, -4e-5], [1.5e-4, 8e-5, -3e-5])?,
            gyroscope([0.7, 1.1, -0.6, 0.2], 1.1189, [-5e-4, 2e-4, 7e-5], [-4e-4, 1.5e-4, -5e-5])?,
        ],
        g_sensitivity: [Some([0.62, -0.18, 0.09]), Some([0.31, -0.74, -0.22]), Some([-0.11, 0.27, -0.83])],
        alignment: GYROSCOPE_MISALIGNMENT.try_inverse(),
    })
}
