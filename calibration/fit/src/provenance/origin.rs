//! What programs read of a table's `[provenance]`: when the table was made, and its errors.

use isotherm_recording::{LogImu, Marks};
use isotherm_shared::document::Faults;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::{Axis, CoefficientTable};
use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{Curve, QUANTITIES, SlopeError};
use nalgebra::{DMatrix, DVector, Matrix3};
use toml::{Table, Value};

/// Degrees of freedom that can be: of a fit of two set points, to more than a campaign can have.
const FREEDOM: core::ops::RangeInclusive<f64> = 1.0..=1e6;

/// The covariance of a curve's coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveErrors {
    /// In the unit and the powers of the table's polynomial; as many rows as it has coefficients.
    pub covariance: DMatrix<f64>,
    /// Degrees of freedom, 1 to 1e6.
    pub freedom: f64,
    /// Temperature that was measured, out of which the errors are not known; `None` if they are known everywhere.
    pub measured: Option<[f64; 2]>,
    /// What a slope that the curve lacks adds, in the unit of the covariance.
    pub slope: Option<SlopeError>,
}

/// When a table was made, and its errors. A part that is missing, or that cannot be right, is `None`: the provenance is
/// free for the user.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Origin {
    /// The text of `time`.
    pub time: Option<String>,
    /// The same in seconds since 1970, if it is RFC 3339 in UTC.
    pub unix_s: Option<f64>,
    /// Errors of bias, K+ and K-, for A1, A2, A3, G1, G2, G3.
    pub curves: [[Option<CurveErrors>; 3]; 2 * AXES],
    /// Misalignments of accelerometers and gyroscopes \[rad\]: row i is what sensor i indicates for 1 along each axis;
    /// 1 on the diagonal.
    pub misalignment: [Option<Matrix3<f64>>; 2],
    /// Standard errors of the misalignments of accelerometers and gyroscopes \[rad\]; 0 on the diagonal.
    pub misalignment_error: [Option<Matrix3<f64>>; 2],
    /// Standard deviation of the residuals of A1, A2, A3 \[g0\].
    pub residual_sd_g0: Option<[f64; AXES]>,
    /// Whether ramps gave bias curves with their errors.
    pub has_ramp_errors: bool,
    /// The tilt of the turntable's base about X and Y \[rad\].
    pub tilt_rad: Option<[f64; 2]>,
    /// Rms of the residuals of a calibration that has one for all accelerometers \[g0\].
    pub residual_rms_g0: Option<f64>,
    /// SHA-256 of the recordings, in hexadecimal.
    pub sha256: Vec<String>,
    /// The marks of the recordings.
    pub rows: Vec<Marks>,
    /// The IMU, as the logs of an autopilot name it that made the table.
    pub log_imu: Option<LogImu>,
}

/// A table with the name of its file, and what its provenance says.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::TableFile;
///
/// let file = TableFile::from_toml("imu-a.toml", include_str!("../../../../tests/data/imu-a.toml"))?;
/// assert_eq!(file.sensors().count(), 3); // no gyroscopes
/// assert_eq!(file.origin.time, None); // written by hand, it has no provenance
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct TableFile {
    /// Its name in messages.
    pub name: String,
    /// The table.
    pub table: CoefficientTable,
    /// When it was made, and its errors.
    pub origin: Origin,
}

impl TableFile {
    /// Reads a table from the text of its file.
    ///
    /// # Errors
    /// All faults of the text.
    pub fn from_toml(name: impl Into<String>, text: &str) -> Result<Self, Faults> {
        let table = CoefficientTable::from_toml(text, None)?;
        let origin = Origin::of_toml(text, &table);
        Ok(Self { name: name.into(), table, origin })
    }

    /// The sensors with their kind and errors: A1, A2, A3, and the gyroscopes if the table has them.
    pub fn sensors(&self) -> impl Iterator<Item = (SensorKind, usize, &Axis)> {
        let content = self.table.content();
        let gyroscopes = content.gyroscopes.iter().flat_map(|gyroscopes| &gyroscopes.axes);
        let kinds = [SensorKind::Accelerometer, SensorKind::Gyroscope];
        let places = kinds.into_iter().flat_map(|kind| (0..AXES).map(move |axis| (kind, axis)));
        places.zip(content.axes.iter().chain(gyroscopes)).map(|((kind, index), axis)| (kind, index, axis))
    }

    /// The text of a sealed file of the table: `text`, its own, if that has a digest; otherwise one with the same
    /// provenance.
    #[must_use]
    pub fn sealed(&self, text: &str) -> String {
        let mut file = text.parse::<Table>().unwrap_or_default();
        if file.contains_key("digest") {
            return text.to_owned();
        }
        file.retain(|key, _| key == "provenance");
        let provenance = toml::to_string(&file).unwrap_or_default();
        let gap = if provenance.is_empty() { "" } else { "\n" };
        format!("{}{gap}{provenance}", self.table.to_toml())
    }

    /// The curve of a quantity of a sensor, A1 to G3, with the errors that the provenance has, and its unit in the
    /// table.
    /// `None` if the table has no such sensor or quantity.
    #[must_use]
    pub fn curve(&self, sensor: usize, quantity: usize) -> Option<(Curve, &'static str)> {
        let (kind, _, axis) = self.sensors().nth(sensor).filter(|_| quantity < QUANTITIES.len())?;
        let (polynomial, unit) = quantity_of(axis, kind, quantity);
        let errors = self.origin.curves[sensor][quantity].as_ref();
        let range = polynomial.range();
        let curve = Curve::new(
            [polynomial.center(), polynomial.scale()],
            DVector::from_column_slice(polynomial.coefficients()),
            errors.map(|errors| errors.covariance.clone()),
            errors.map_or(0.0, |errors| errors.freedom),
            range,
        );
        let measured = errors.and_then(|errors| errors.measured).unwrap_or(range);
        Some((curve.known(measured, errors.and_then(|errors| errors.slope)), unit))
    }

    /// Whether the table has gyroscopes.
    #[must_use]
    pub fn has_gyroscopes(&self) -> bool {
        self.table.content().gyroscopes.is_some()
    }
}

impl Origin {
    /// Reads the provenance of `table` from `text`, the text of its file.
    #[must_use]
    pub fn of_toml(text: &str, table: &CoefficientTable) -> Self {
        let file = text.parse::<Table>().unwrap_or_default();
        let Some(provenance) = file.get("provenance").and_then(Value::as_table) else { return Self::default() };
        let time = match provenance.get("time") {
            Some(Value::String(time)) => Some(time.clone()),
            Some(Value::Datetime(time)) => Some(time.to_string()),
            _ => None,
        };
        let since =
            |time: &String| humantime::parse_rfc3339_weak(time).ok()?.duration_since(std::time::UNIX_EPOCH).ok();
        let mut origin = Self {
            unix_s: time.as_ref().and_then(since).map(|since| since.as_secs_f64()),
            time,
            misalignment: ["misalignment", "gyroscope_misalignment"].map(|key| square(&matrix(provenance.get(key)?)?)),
            misalignment_error: ["misalignment_standard_error", "gyroscope_misalignment_standard_error"]
                .map(|key| square(&matrix(provenance.get(key)?)?).filter(|errors| errors.min() >= 0.0)),
            residual_sd_g0: provenance.get("residual_sd_g0").and_then(numbers),
            residual_rms_g0: provenance.get("residual_rms_g0").and_then(number),
            tilt_rad: provenance.get("tilt_rad").and_then(pair),
            has_ramp_errors: ramp_errors(provenance),
            sha256: hashes(provenance),
            log_imu: log_imu(provenance),
            rows: texts(provenance.get("rows")).filter_map(|marks| marks.parse().ok()).collect(),
            ..Self::default()
        };
        let records = provenance.get("curve").and_then(Value::as_array);
        for record in records.into_iter().flatten().filter_map(Value::as_table) {
            if let Some((sensor, quantity, errors)) = errors_of_record(record, table) {
                origin.curves[sensor][quantity] = errors;
            }
        }
        origin
    }

    /// Whether an error of a bias curve is stated.
    #[must_use]
    pub fn has_bias_errors(&self) -> bool {
        self.has_ramp_errors || self.residual_rms_g0.is_some() || self.curves.iter().any(|[bias, ..]| bias.is_some())
    }
}

/// Whether only ramps stated the error of a curve.
fn ramp_errors(provenance: &Table) -> bool {
    let alone = provenance.get("method").and_then(Value::as_str) == Some("ramps");
    let biases = provenance.get("transients").and_then(|it| it.get("bias")).and_then(Value::as_array);
    alone && biases.into_iter().flatten().any(|bias| bias.get("curve_error").is_some())
}

impl Origin {
    /// Whether the table was made from a recording with these marks, or with a file of this SHA-256.
    #[must_use]
    pub fn is_made_from(&self, rows: &Marks, sha256: &str) -> bool {
        self.sha256.iter().any(|known| known == sha256) || self.rows.iter().any(|known| known.share_rows_with(rows))
    }

    /// Whether both tables were made from the same rows. Their files may be one, with the rows of several IMUs.
    #[must_use]
    pub fn shares_rows_with(&self, other: &Self) -> bool {
        self.rows.iter().any(|rows| other.rows.iter().any(|others| rows.share_rows_with(others)))
    }
}

/// The IMU of a log.
fn log_imu(provenance: &Table) -> Option<LogImu> {
    let number = |key: &str| provenance.get(key).and_then(Value::as_integer).and_then(|it| u32::try_from(it).ok());
    let devices = ["device_id", "gyroscope_device_id"].map(number);
    number("instance").map(|instance| LogImu { instance, devices })
}

/// Texts of an array; none if it is none.
fn texts(value: Option<&Value>) -> impl Iterator<Item = &str> {
    value.and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
}

/// The hashes of all files with rows.
fn hashes(provenance: &Table) -> Vec<String> {
    let ramps = provenance.get("transients").and_then(|transients| transients.get("ramp")).and_then(Value::as_array);
    let ramps = ramps.into_iter().flatten().filter_map(|ramp| ramp.get("sha256").and_then(Value::as_str));
    let samples = provenance.get("samples_sha256").and_then(Value::as_str);
    let all = samples.into_iter().chain(texts(provenance.get("recordings_sha256"))).chain(ramps);
    all.filter(|hash| !hash.is_empty()).map(str::to_owned).collect()
}

/// The sensor, the quantity and the errors that a `[[provenance.curve]]` has; `None` if the table has no such curve, or
/// in another unit: then the errors are not the table's.
fn errors_of_record(record: &Table, table: &CoefficientTable) -> Option<(usize, usize, Option<CurveErrors>)> {
    let word = |key: &str| record.get(key).and_then(Value::as_str);
    let quantity = QUANTITIES.iter().position(|name| Some(*name) == word("quantity"))?;
    let kinds = [SensorKind::Accelerometer, SensorKind::Gyroscope];
    let mut names = kinds.iter().flat_map(|kind| kind.names().map(|name| (*kind, name))).enumerate();
    let (sensor, (kind, _)) = names.find(|(_, (_, name))| Some(*name) == word("axis"))?;
    let content = table.content();
    let axis = match kind {
        SensorKind::Accelerometer => &content.axes[sensor],
        SensorKind::Gyroscope => &content.gyroscopes.as_ref()?.axes[sensor - AXES],
    };
    let (polynomial, unit) = quantity_of(axis, kind, quantity);
    word("unit").is_none_or(|stated| stated == unit).then(|| (sensor, quantity, curve_errors(record, polynomial)))
}

/// The polynomial of a quantity with its unit in the table.
fn quantity_of(axis: &Axis, kind: SensorKind, quantity: usize) -> (&Polynomial, &'static str) {
    match quantity {
        0 => (&axis.bias, axis.bias_unit.name()),
        1 => (&axis.positive_scale_factor, kind.scale_factor_unit()),
        _ => (&axis.negative_scale_factor, kind.scale_factor_unit()),
    }
}

fn curve_errors(record: &Table, polynomial: &Polynomial) -> Option<CurveErrors> {
    let freedom = number(record.get("degrees_of_freedom")?).filter(|freedom| FREEDOM.contains(freedom))?;
    let rows = matrix(record.get("covariance")?)?;
    let count = polynomial.coefficients().len();
    let square = rows.len() == count && rows.iter().all(|row| row.len() == count);
    let value = |key: &str| record.get(key).and_then(number);
    let slope = value("slope_error").zip(value("slope_about"));
    square.then(|| CurveErrors {
        covariance: DMatrix::from_fn(count, count, |i, j| rows[i][j]),
        freedom,
        measured: record.get("measured").and_then(numbers),
        slope: slope.map(|(per_unit, about)| SlopeError { per_unit, about }),
    })
}

fn square(rows: &[Vec<f64>]) -> Option<Matrix3<f64>> {
    let right = rows.len() == AXES && rows.iter().all(|row| row.len() == AXES);
    right.then(|| Matrix3::from_fn(|i, j| rows[i][j]))
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(number).collect();
    numbers?.try_into().ok()
}

fn matrix(value: &Value) -> Option<Vec<Vec<f64>>> {
    value.as_array()?.iter().map(|row| row.as_array()?.iter().map(number).collect()).collect()
}

/// A finite number.
fn pair(value: &Value) -> Option<[f64; 2]> {
    let [x, y] = value.as_array()?.as_slice() else { return None };
    Some([number(x)?, number(y)?])
}

fn number(value: &Value) -> Option<f64> {
    let number = match value {
        Value::Integer(integer) => Some(*integer as f64),
        Value::Float(float) => Some(*float),
        _ => None,
    };
    number.filter(|number| number.is_finite())
}
