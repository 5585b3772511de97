//! The `[provenance]` section that `calibrate` writes below a table: the origin of the table and its uncertainty. It is
//! not part of the digest, so an edited value passes unnoticed. It is for people and scripts. Of it, programs read
//! `gravity_local` and Earth's rate, which `verify` takes if the user states none, and the time and the errors of the
//! table, see [`Origin`].
//!
//! Over 400 lines: the records of the section, key by key; those of ramps are in `transients`.

mod origin;
mod source;
mod transients;
mod unit;
mod warm_up;

pub use origin::{CurveErrors, Origin, TableFile};
pub(crate) use source::ReadRecord;
pub use source::{CampaignSource, now, tool};

use crate::accuracy::{Accuracy, largest_interval};
use crate::gyroscopes::GyroscopeCalibration;
use crate::gyroscopes::earth::{EarthCheck, LeftOver};
use crate::ramps::RampCalibration;
use crate::result::Calibration;
use crate::triad::{CalibratedTriad, beside_diagonal};
use crate::warm_up::WarmUpCalibration;
use isotherm_campaign::Campaign;
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable, GYROSCOPE_NAMES};
use isotherm_shared::wire::AXES;
use isotherm_statistics::{QUANTITIES, root};
use nalgebra::Matrix3;
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use std::io::{self, Read, Write};
use transients::TransientsRecord;

/// The text of the table file of a campaign.
pub(crate) fn sealed_table(
    campaign: &Campaign,
    calibration: &Calibration,
    source: &CampaignSource,
) -> Result<String, String> {
    sealed(campaign, &calibration.table, provenance(campaign, calibration, source))
}

/// The text of the table file of ramps alone.
pub(crate) fn sealed_ramp_table(
    campaign: &Campaign,
    calibration: &RampCalibration,
    source: &CampaignSource,
) -> Result<String, String> {
    sealed(campaign, &calibration.table, transients::of_ramps(campaign, calibration, source))
}

/// The text of the table file of recordings at one attitude.
pub(crate) fn sealed_warm_up_table(
    campaign: &Campaign,
    calibration: &WarmUpCalibration,
    source: &CampaignSource,
) -> Result<String, String> {
    sealed(campaign, calibration.table(), warm_up::section(campaign, calibration, source))
}

/// The text of `table` with digest and `provenance`, read back.
pub(crate) fn sealed(
    campaign: &Campaign,
    table: &CoefficientTable,
    provenance: Result<String, toml::ser::Error>,
) -> Result<String, String> {
    let failed = |cause: String| format!("writing the table: {cause}");
    let section = provenance.map_err(|error| failed(error.to_string()))?;
    let text = format!("{}\n{section}", table.to_toml());
    match CoefficientTable::from_toml(&text, Some(&campaign.imu)) {
        Ok(read) if read == *table => Ok(text),
        Ok(_) => Err(failed("it does not read back the same".to_owned())),
        Err(faults) => Err(failed(faults.to_string())),
    }
}

/// SHA-256 in hexadecimal.
///
/// ```
/// use isotherm_fit::sha256;
///
/// assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
/// ```
#[must_use]
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}"))
}

/// Computes the SHA-256 of all bytes that are read or written through it.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_fit::{Hashed, sha256};
/// use std::io::Write as _;
///
/// let mut file = Hashed::new(Vec::new());
/// file.write_all(b"abc")?;
/// assert_eq!(file.finish(), (b"abc".to_vec(), sha256(b"abc")));
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Hashed<T> {
    inner: T,
    hash: Sha256,
}

impl<T> Hashed<T> {
    /// Wraps `inner`, from which nothing has been read or written yet.
    pub fn new(inner: T) -> Self {
        Self { inner, hash: Sha256::new() }
    }

    /// The inner value, and the SHA-256 of the bytes in hexadecimal.
    #[must_use]
    pub fn finish(self) -> (T, String) {
        (self.inner, hexadecimal(&self.hash.finalize()))
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hash.update(buffer.get(..count).unwrap_or_default());
        Ok(count)
    }
}

impl<W: Write> Write for Hashed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.hash.update(bytes.get(..count).unwrap_or_default());
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[derive(Serialize)]
struct ProvenanceFile<'a> {
    provenance: Provenance<'a>,
}

#[derive(Serialize)]
struct Provenance<'a> {
    tool: &'a str,
    time: &'a str,
    method: &'static str,
    campaign: &'a str,
    campaign_sha256: &'a str,
    samples_sha256: &'a str,
    /// Hashes of some of the rows, see [`Marks`](isotherm_recording::Marks).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rows: Vec<String>,
    #[serde(flatten)]
    read: ReadRecord<'a>,
    gravity_local: f64,
    set_points: usize,
    dwells: usize,
    excluded: Vec<String>,
    /// Outlying dwells that were kept in the fit.
    outliers: Vec<String>,
    /// The bottom line in words, then its parts by axis.
    accuracy: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_interval_ug0: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale_factor_interval_ppm: Option<[f64; 3]>,
    residual_sd_g0: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    tilt_rad: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tilt_standard_error: Option<[f64; 2]>,
    /// See [`Calibration::misalignment`].
    misalignment: [[f64; 3]; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    misalignment_standard_error: Option<[[f64; 3]; 3]>,
    /// Names of the faults that were accepted; they are among the warnings.
    accepted: Vec<&'static str>,
    warnings: Vec<String>,
    #[serde(flatten)]
    gyroscopes: Option<GyroscopeProvenance>,
    #[serde(skip_serializing_if = "Option::is_none")]
    transients: Option<TransientsRecord<'a>>,
    curve: Vec<CurveRecord<'a>>,
    two_stage: Vec<SetPointRecord>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    gyroscope_two_stage: Vec<GyroscopeSetPointRecord>,
}

/// What a table with gyroscopes has more.
#[derive(Serialize)]
struct GyroscopeProvenance {
    /// Turns in the fit.
    turns: usize,
    /// Outlying dwells and turns that were kept in the fit.
    gyroscope_outliers: Vec<String>,
    gyroscope_accuracy: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscope_bias_interval_deg_h: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscope_scale_factor_interval_ppm: Option<[f64; 3]>,
    /// Of the residuals.
    random_walk_deg_sqrt_h: [f64; 3],
    /// Row i: of gyroscope i to the specific force along each axis.
    g_sensitivity_deg_h_g0: [[f64; 3]; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    g_sensitivity_standard_error: Option<[[f64; 3]; 3]>,
    /// See [`GyroscopeCalibration::misalignment`].
    gyroscope_misalignment: [[f64; 3]; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    gyroscope_misalignment_standard_error: Option<[[f64; 3]; 3]>,
    #[serde(flatten)]
    earth: Option<EarthProvenance>,
    #[serde(skip_serializing_if = "Option::is_none")]
    earth_rate_left_over: Option<LeftOverRecord>,
}

/// Earth's rate, of a campaign with angles.
#[derive(Serialize)]
struct EarthProvenance {
    latitude_deg: f64,
    /// Along X, Y and Z of the base: X along the outer axis, Z up at outer angle 0. Z is that of the latitude.
    earth_rate_deg_h: [f64; 3],
    /// Of the components along X and Y.
    #[serde(skip_serializing_if = "Option::is_none")]
    earth_rate_standard_error: Option<[f64; 2]>,
    earth_horizontal_rate_deg_h: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    earth_horizontal_rate_standard_error: Option<f64>,
    earth_horizontal_rate_of_latitude_deg_h: f64,
    /// The rotation from the direction that the angles give to `specific_force`, if it is not the identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    mounting: Option<[[f64; 3]; 3]>,
}

/// What Earth's horizontal rate leaves in the estimate without angles, at most.
#[derive(Serialize)]
struct LeftOverRecord {
    bias_deg_h: f64,
    scale_factor_ppm: f64,
    g_sensitivity_deg_h_g0: f64,
    misalignment_rad: f64,
}

#[derive(Serialize)]
struct CurveRecord<'a> {
    axis: &'static str,
    quantity: &'static str,
    unit: &'static str,
    order: usize,
    reason: &'a str,
    r_squared: Option<f64>,
    leave_one_set_point_out_rms: Option<f64>,
    leave_one_set_point_out_max: Option<f64>,
    degrees_of_freedom: usize,
    /// Largest half width of the curve's 95 % interval over its range, in its unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    largest_interval: Option<f64>,
    /// Standard errors of the coefficients in the table, in their unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_errors: Option<Vec<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<Vec<Vec<f64>>>,
}

/// A set point reduced by itself.
#[derive(Serialize)]
struct SetPointRecord {
    set_point_c: f64,
    axis: &'static str,
    head: f64,
    board: f64,
    bias_ug0: f64,
    positive_scale_factor: f64,
    negative_scale_factor: f64,
    misalignment_rad: [f64; 2],
}

/// A set point of a gyroscope, reduced by itself.
#[derive(Serialize)]
struct GyroscopeSetPointRecord {
    set_point_c: f64,
    axis: &'static str,
    head: f64,
    board: f64,
    bias_deg_h: f64,
    positive_scale_factor: f64,
    negative_scale_factor: f64,
    misalignment_rad: [f64; 2],
    g_sensitivity_deg_h_g0: [f64; 3],
}

/// The rows of a matrix.
pub(crate) fn matrix_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]))
}

/// The three values, if each is known.
fn known<T>([a, b, c]: [Option<T>; AXES]) -> Option<[T; AXES]> {
    Some([a?, b?, c?])
}

/// `-25/3`, as `--exclude` takes it.
fn place(set_point: f64, number: u32) -> String {
    format!("{set_point}/{number}")
}

/// The text of the `[provenance]` section.
///
/// # Errors
/// If it cannot be written as TOML; a valid calibration always can.
pub(crate) fn provenance(
    campaign: &Campaign,
    calibration: &Calibration,
    source: &CampaignSource,
) -> Result<String, toml::ser::Error> {
    let accelerometers = CalibratedTriad::accelerometers(calibration);
    let gyroscopes = calibration.gyroscopes.as_ref();
    let gyroscopes = gyroscopes.map(|found| (found, CalibratedTriad::gyroscopes(calibration, found)));
    let accuracy = Accuracy::of(calibration);
    let millionths = |values| known(values).map(|values| values.map(|value: f64| value * 1e6));
    let curves = |triad| (0..9).map(move |index| curve(triad, index / 3, index % 3));
    let of_gyroscopes = gyroscopes.iter().flat_map(|(_, triad)| curves(triad));
    let document = ProvenanceFile {
        provenance: Provenance {
            tool: &source.tool,
            time: &source.time,
            method: calibration.options.method.name(),
            campaign: &source.campaign,
            campaign_sha256: &source.campaign_sha256,
            samples_sha256: &source.samples_sha256,
            rows: source.marks(),
            read: source.read(),
            gravity_local: campaign.gravity_local,
            set_points: calibration.set_points.len(),
            dwells: calibration.dwells.len(),
            excluded: calibration.options.exclude.iter().map(|&(s, n)| place(s, n)).collect(),
            outliers: outliers(campaign, calibration),
            accuracy: accuracy.to_string(),
            bias_interval_ug0: millionths(accuracy.bias),
            scale_factor_interval_ppm: millionths(accuracy.scale_factor),
            residual_sd_g0: [0, 1, 2].map(|axis| calibration.residual_sd(axis)),
            tilt_rad: calibration.solution.tilt,
            tilt_standard_error: calibration.solution.tilt_error,
            misalignment: matrix_rows(&calibration.misalignment()),
            misalignment_standard_error: misalignment_error(&accelerometers),
            accepted: calibration.accepted.clone(),
            warnings: calibration.findings.iter().map(ToString::to_string).collect(),
            gyroscopes: gyroscopes.as_ref().map(|(found, triad)| of_triad(campaign, calibration, found, triad)),
            transients: calibration.transients.as_ref().map(|found| TransientsRecord::of(campaign, found, source)),
            curve: curves(&accelerometers).chain(of_gyroscopes).collect(),
            two_stage: two_stage(calibration).collect(),
            gyroscope_two_stage: gyroscopes.iter().flat_map(|(found, _)| reduced(calibration, found)).collect(),
        },
    };
    toml::to_string(&document)
}

/// `-25/3 A1` for each outlying dwell.
fn outliers(campaign: &Campaign, calibration: &Calibration) -> Vec<String> {
    let outlier = |&(dwell, axis): &(usize, usize)| {
        let dwell = &calibration.dwells[dwell];
        format!("{} {}", place(dwell.set_point_c, campaign.positions[dwell.position].number), AXIS_NAMES[axis])
    };
    calibration.outliers.iter().map(outlier).collect()
}

/// The accelerometers at each set point.
fn two_stage(calibration: &Calibration) -> impl Iterator<Item = SetPointRecord> {
    let set_points = calibration.set_points.iter().zip(&calibration.reduced);
    set_points.flat_map(|(set_point, reduced)| {
        AXIS_NAMES.iter().zip(reduced).map(|(axis, reduced)| SetPointRecord {
            set_point_c: set_point.set_point_c,
            axis,
            head: reduced.telemetry[0],
            board: reduced.telemetry[1],
            bias_ug0: reduced.values[0] * 1e6,
            positive_scale_factor: reduced.values[1],
            negative_scale_factor: reduced.values[2],
            misalignment_rad: [reduced.values[3], reduced.values[4]],
        })
    })
}

fn misalignment_error(triad: &CalibratedTriad<'_>) -> Option<[[f64; 3]; 3]> {
    Some(beside_diagonal(0.0, known(triad.misalignment_error)?))
}

fn of_triad(
    campaign: &Campaign,
    calibration: &Calibration,
    found: &GyroscopeCalibration,
    triad: &CalibratedTriad<'_>,
) -> GyroscopeProvenance {
    let accuracy = Accuracy::of_triad(calibration, triad);
    let outlier = |&(run, axis): &(usize, usize)| {
        let run = &found.runs[run];
        let set_point_c = calibration.set_points[run.set_point].set_point_c;
        format!("{} {}", place(set_point_c, run.place.number(campaign).value()), GYROSCOPE_NAMES[axis])
    };
    let axes = &found.solution.gyroscopes;
    GyroscopeProvenance {
        turns: found.turns(),
        gyroscope_outliers: found.outliers.iter().map(outlier).collect(),
        gyroscope_accuracy: accuracy.to_string(),
        gyroscope_bias_interval_deg_h: known(accuracy.bias),
        gyroscope_scale_factor_interval_ppm: known(accuracy.scale_factor).map(|all| all.map(|part| part * 1e6)),
        random_walk_deg_sqrt_h: [0, 1, 2].map(|axis| found.random_walk(axis)),
        g_sensitivity_deg_h_g0: axes.each_ref().map(|axis| axis.g_sensitivity),
        g_sensitivity_standard_error: known(axes.each_ref().map(|axis| axis.g_sensitivity_error)),
        gyroscope_misalignment: matrix_rows(&found.misalignment()),
        gyroscope_misalignment_standard_error: misalignment_error(triad),
        earth: found.earth.as_ref().and_then(|earth| of_earth(campaign, found, earth)),
        earth_rate_left_over: found.left_over.as_ref().map(|left: &LeftOver| LeftOverRecord {
            bias_deg_h: left.bias,
            scale_factor_ppm: left.scale_factor * 1e6,
            g_sensitivity_deg_h_g0: left.g_sensitivity,
            misalignment_rad: left.misalignment,
        }),
    }
}

fn reduced(calibration: &Calibration, found: &GyroscopeCalibration) -> impl Iterator<Item = GyroscopeSetPointRecord> {
    let set_points = calibration.set_points.iter().zip(&found.reduced);
    set_points.flat_map(|(set_point, reduced)| {
        (0..AXES).map(|axis| {
            let [bias_deg_h, positive_scale_factor, negative_scale_factor, m1, m2, s1, s2, s3] = reduced.values[axis];
            GyroscopeSetPointRecord {
                set_point_c: set_point.set_point_c,
                axis: GYROSCOPE_NAMES[axis],
                head: reduced.telemetry[axis][0],
                board: reduced.telemetry[axis][1],
                bias_deg_h,
                positive_scale_factor,
                negative_scale_factor,
                misalignment_rad: [m1, m2],
                g_sensitivity_deg_h_g0: [s1, s2, s3],
            }
        })
    })
}

fn of_earth(campaign: &Campaign, found: &GyroscopeCalibration, earth: &EarthCheck) -> Option<EarthProvenance> {
    let [x, y] = found.solution.earth?;
    Some(EarthProvenance {
        latitude_deg: campaign.latitude_deg?,
        earth_rate_deg_h: [x, y, earth.along_z],
        earth_rate_standard_error: found.solution.earth_error,
        earth_horizontal_rate_deg_h: earth.found,
        earth_horizontal_rate_standard_error: earth.error,
        earth_horizontal_rate_of_latitude_deg_h: earth.expected,
        mounting: campaign.mount.filter(|mount| *mount != Matrix3::identity()).map(|mount| matrix_rows(&mount)),
    })
}

fn curve<'a>(triad: &CalibratedTriad<'a>, axis: usize, quantity: usize) -> CurveRecord<'a> {
    let orders = &triad.orders[axis][quantity];
    let fit = &orders.regression.fits()[orders.choice.order];
    let curve = &triad.curves[axis][quantity];
    let factor = triad.units.factor(quantity);
    let covariance = curve.table_covariance().map(|covariance| covariance * (factor * factor));
    CurveRecord {
        axis: triad.names[axis],
        quantity: QUANTITIES[quantity],
        unit: triad.units.in_table(quantity),
        order: curve.order(),
        reason: &orders.choice.reason,
        r_squared: fit.r_squared,
        leave_one_set_point_out_rms: fit.leave_one_out_rms.map(|rms| rms * factor),
        leave_one_set_point_out_max: fit.leave_one_out_max.map(|max| max * factor),
        degrees_of_freedom: curve.freedom() as usize,
        largest_interval: largest_interval(curve, false).map(|half| half * factor),
        standard_errors: covariance.as_ref().map(|c| c.diagonal().iter().map(|v| root(*v)).collect()),
        covariance: covariance.map(|c| c.row_iter().map(|row| row.iter().copied().collect()).collect()),
    }
}
