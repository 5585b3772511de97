//! Reading and writing a table file's text. Reading reports all faults of the text together.
//!
//! Over 400 lines: what is read and what is written are the same keys, so they stand side by side.

use super::checks::{
    NO_LAG, alignment_fault, bias_fault, g_sensitivity_fault, gravity_fault, lag_fault, max_age_fault, max_rate_fault,
    negative_scale_factor_fault, nominal_interval_fault, positive_scale_factor_fault, transient_fault,
};
use super::content::{
    AXIS_NAMES, Axis, Content, FORMAT, G_SENSITIVITY_KEYS, GRAVITY_ONLY, GYROSCOPE_NAMES, Gyroscopes, OutOfRange,
};
use super::errors::StatedErrors;
use super::model::CoefficientTable;
use super::turntable::Turntable;
use crate::document::{Document, Fault, Faults, Section, too_large};
use crate::names::ImuId;
use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::units::{BiasUnit, SensorKind};
use crate::wire::AXES;
use core::fmt::Write as _;
use nalgebra::Matrix3;

/// The unit of a g-sensitivity.
const G_SENSITIVITY_UNIT: &str = "deg/h/g0";
/// The version of the file format, for messages.
const FORMATS: &str = "format = 1, or 2 with gyroscopes or a lag, or 3 with a nominal interval";
const POWERS: [&str; MAX_ORDER + 1] = ["c0", "c1", "c2", "c3", "c4", "c5", "c6", "c7"];

/// How reading treats a file's digest.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Seal {
    /// A digest in the file must match the content.
    Checked,
    /// A digest in the file is ignored, because the caller is about to replace it. The table counts as sealed.
    Renewed,
}

/// Largest text of a coefficient table: 128 KiB. One with provenance, gyroscopes and every accepted finding has under
/// 16 KiB.
pub const MAX_TABLE_BYTES: u64 = 128 << 10;

/// The key of the provenance that is true in the file of a table that a service keeps, which always has a digest, if
/// the file that the table is from had none.
pub const UNSEALED: &str = "unsealed";

/// Said of the digest of a file whose content cannot be read.
const UNCHECKED_DIGEST: &str = "cannot be checked until these are right";

/// The faults of a table's text that is not TOML, with a word on its digest if it seems to have one.
#[must_use]
pub fn with_unchecked_digest(text: &str, mut faults: Faults) -> Faults {
    let sealed = text.lines().position(|line| line.trim_start().starts_with("digest"));
    faults.0.extend(sealed.map(|line| Fault {
        line: line + 1,
        key: "digest".to_owned(),
        message: UNCHECKED_DIGEST.to_owned(),
    }));
    faults.0.sort_by_key(|fault| fault.line);
    faults
}

impl CoefficientTable {
    /// Reads a table file's text. With `expected`, a table for another IMU is refused.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::names::ImuId;
    /// use isotherm_shared::table::CoefficientTable;
    ///
    /// let text = include_str!("../../../tests/data/imu-a.toml");
    /// let table = CoefficientTable::from_toml(text, ImuId::new("imu-a").as_ref())?;
    /// let bias = table.content().axes[0].bias_at(2.0); // A1 at 2 V
    /// assert!((bias.0 - (793.55 - 1074.70 * 2.0 + 420.81 * 4.0 - 53.712 * 8.0) * 1e-6).abs() < 1e-15); // g0
    ///
    /// // A table for another IMU, and one with a fault, are refused; the fault has its line.
    /// assert!(CoefficientTable::from_toml(text, ImuId::new("imu-b").as_ref()).is_err());
    /// let wrong = text.replace("gravity = 9.8015", "gravity = 98.015");
    /// let faults = CoefficientTable::from_toml(&wrong, None).err().ok_or("the gravity is ten times too large")?;
    /// assert_eq!(faults.0[0].line, 4);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// All faults of the text with line and key.
    pub fn from_toml(text: &str, expected: Option<&ImuId>) -> Result<Self, Faults> {
        Self::from_toml_with(text, expected, Seal::Checked)
    }

    /// As [`from_toml`](Self::from_toml); `seal` says how to treat the digest.
    ///
    /// # Errors
    /// All faults of the text with line and key.
    pub fn from_toml_with(text: &str, expected: Option<&ImuId>, seal: Seal) -> Result<Self, Faults> {
        if text.len() as u64 > MAX_TABLE_BYTES {
            return Err(too_large(text.as_bytes(), MAX_TABLE_BYTES, "coefficient table"));
        }
        let document = Document::parse_as(text, "give the coefficient table")
            .map_err(|faults| with_unchecked_digest(text, faults))?;
        let root = document.root();
        let table = read(&root, expected, seal);
        root.finish();
        document.finish(table)
    }

    /// The table as the text of a sealed file (one with a digest), without provenance. Its numbers read back to the
    /// same doubles.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::table::CoefficientTable;
    ///
    /// let table = CoefficientTable::from_toml(include_str!("../../../tests/data/imu-a.toml"), None)?;
    /// let sealed = table.to_toml();
    /// assert_eq!(CoefficientTable::from_toml(&sealed, None)?, table);
    /// // A changed coefficient no longer has the digest.
    /// assert!(CoefficientTable::from_toml(&sealed.replace("793.55", "793.56"), None).is_err());
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn to_toml(&self) -> String {
        let content = self.content();
        let mut text =
            format!("format = {}\ndigest = \"{}\"\n\n[imu]\nid = \"{}\"\n", content.format, self.digest(), content.imu);
        // Writing to a String cannot fail.
        let mut line = |line: core::fmt::Arguments<'_>| {
            let _ = text.write_fmt(line);
            text.push('\n');
        };
        if let Some(serial) = &content.serial {
            line(format_args!("serial = {}", quoted(serial)));
        }
        line(format_args!("gravity = {:?}", content.gravity));
        if let Some(interval) = content.nominal_interval_s {
            line(format_args!("nominal_interval_s = {interval:?}"));
        }
        line(format_args!("\n[temperature]"));
        line(format_args!("unit = {}", quoted(&content.temperature_unit)));
        line(format_args!("out_of_range = \"{}\"", content.out_of_range.name()));
        if let Some(age) = content.max_age_s {
            line(format_args!("max_age_s = {age:?}"));
        }
        if let Some(time_constant) = content.lag_s {
            line(format_args!("\n[lag]\ntime_constant_s = {time_constant:?}"));
        }
        for (name, axis) in AXIS_NAMES.iter().zip(&content.axes) {
            line(format_args!("\n[[axis]]\nname = \"{name}\""));
            line(format_args!("{}", sensor(axis, SensorKind::Accelerometer)));
        }
        if let Some(matrix) = &content.alignment {
            line(format_args!("\n[alignment]\nmatrix = {}", rows(matrix)));
        }
        let Some(gyroscopes) = &content.gyroscopes else { return text };
        for ((name, axis), g_sensitivity) in GYROSCOPE_NAMES.iter().zip(&gyroscopes.axes).zip(&gyroscopes.g_sensitivity)
        {
            line(format_args!("\n[[gyroscope]]\nname = \"{name}\""));
            line(format_args!("{}", sensor(axis, SensorKind::Gyroscope)));
            if let Some([a1, a2, a3]) = g_sensitivity {
                line(format_args!(
                    "g_sensitivity = {{ unit = \"{G_SENSITIVITY_UNIT}\", a1 = {a1:?}, a2 = {a2:?}, a3 = {a3:?} }}"
                ));
            }
        }
        if let Some(matrix) = &gyroscopes.alignment {
            line(format_args!("\n[gyroscope_alignment]\nmatrix = {}", rows(matrix)));
        }
        text
    }
}

fn read(root: &Section<'_, '_>, expected: Option<&ImuId>, seal: Seal) -> Option<CoefficientTable> {
    let format = root.number("format", FORMATS);
    let format = format.and_then(|format| {
        let known = (1..=FORMAT).find(|known| f64::from(*known) == format);
        if known.is_none() {
            root.fault("format", "unknown; this version reads format = 1, 2 and 3");
        }
        known
    });
    if format == Some(1) {
        for key in ["lag", "gyroscope", "gyroscope_alignment"].into_iter().filter(|key| root.has(key)) {
            root.fault(key, "is a part of format 2; give format = 2");
        }
    }
    let digest = match seal {
        Seal::Checked => root.optional_string("digest"),
        Seal::Renewed => {
            root.ignore("digest");
            None
        }
    };
    let provenance = root.unchecked("provenance");
    let gravity_local = provenance.and_then(|it| it.number("gravity_local")).filter(|g| gravity_fault(*g).is_none());
    let turntable = provenance.and_then(Turntable::read);
    let gravity_only = provenance.is_some_and(|it| it.is_text("method", GRAVITY_ONLY));
    let content = content(root, format, expected);
    let Some(content) = content else {
        if digest.is_some() {
            root.fault("digest", UNCHECKED_DIGEST);
        }
        return None;
    };
    let found = content.digest();
    if let Some(digest) = digest.filter(|digest| **digest != found.to_string()) {
        root.fault(
            "digest",
            format!(
                "is {digest:?}, but the content has {found}; if the change was meant, seal it again with the command `check --seal`"
            ),
        );
    }
    // Each part has been checked where its line is known, so what this refuses has been reported.
    let table = CoefficientTable::new(content).ok()?.measured_at(gravity_local).measured_on(turntable);
    let table = if gravity_only { table.measured_by_hand() } else { table };
    let table = match provenance {
        Some(provenance) => {
            let errors = StatedErrors::read(provenance, table.content());
            let table = table.stating(errors);
            if provenance.has_only(UNSEALED) { table } else { table.with_provenance() }
        }
        None => table,
    };
    // The caller is about to write the digest.
    let has_digest = digest.is_some() || seal == Seal::Renewed;
    let kept_unsealed = provenance.is_some_and(|it| it.is_true(UNSEALED));
    Some(if has_digest && !kept_unsealed { table.sealed() } else { table })
}

/// All that the digest is of, as far as it can be read; its values may be refused.
fn content(root: &Section<'_, '_>, format: Option<u8>, expected: Option<&ImuId>) -> Option<Content> {
    let imu = root.section("imu", "[imu] with id and gravity").and_then(|section| imu(section, format, expected));
    let temperature = root.section("temperature", "[temperature] with unit and out_of_range").and_then(temperature);
    let lag = root.optional_section("lag").map(lag);
    let lag_given = lag.is_some();
    let axes = axes(root, SensorKind::Accelerometer, "axis", format, lag_given);
    let alignment = root.optional_section("alignment").map(alignment);
    let gyroscopes = gyroscopes(root, format, lag_given);

    let (id, serial, gravity, nominal_interval_s) = imu?;
    let (temperature_unit, out_of_range, max_age_s) = temperature?;
    // An optional part that is there must be right.
    Some(Content {
        format: format?,
        imu: id,
        serial,
        gravity,
        nominal_interval_s,
        temperature_unit,
        out_of_range,
        max_age_s,
        lag_s: match lag {
            Some(time_constant) => Some(time_constant?),
            None => None,
        },
        axes: axes?.map(|(axis, _)| axis),
        alignment: match alignment {
            Some(matrix) => Some(matrix?),
            None => None,
        },
        gyroscopes: match gyroscopes {
            Some(gyroscopes) => Some(gyroscopes?),
            None => None,
        },
    })
}

/// Identifier, serial number, gravity, nominal interval.
type Imu = (ImuId, Option<String>, f64, Option<f64>);

fn imu(section: Section<'_, '_>, format: Option<u8>, expected: Option<&ImuId>) -> Option<Imu> {
    let id = section.imu_id("id");
    if let (Some(id), Some(expected)) = (&id, expected)
        && id != expected
    {
        section.fault("id", format!("this table belongs to {id}, not to {expected}; name the table of {expected}"));
    }
    let serial = section.optional_string("serial").map(str::to_owned);
    let gravity = section.number("gravity", "the value of 1 g0 in m/s2, for example 9.8015");
    section.refuse("gravity", gravity.and_then(gravity_fault));
    let nominal_interval_s = section.optional_number("nominal_interval_s");
    if section.has("nominal_interval_s") && format.is_some_and(|format| format < 3) {
        section.fault("nominal_interval_s", "is a part of format 3; give format = 3");
    }
    section.refuse("nominal_interval_s", nominal_interval_s.and_then(nominal_interval_fault));
    section.finish();
    Some((id?, serial, gravity?, nominal_interval_s))
}

fn temperature(section: Section<'_, '_>) -> Option<(String, OutOfRange, Option<f64>)> {
    let unit = section.string("unit", "the unit of the temperature, for example \"V\"").map(str::to_owned);
    let out_of_range = section.choice("out_of_range", &OutOfRange::NAMES);
    let max_age_s = section.optional_number("max_age_s");
    section.refuse("max_age_s", max_age_s.and_then(max_age_fault));
    section.finish();
    Some((unit?, out_of_range?, max_age_s))
}

fn lag(section: Section<'_, '_>) -> Option<f64> {
    let time_constant = section.number("time_constant_s", "the time constant of the lagged temperature in s");
    section.refuse("time_constant_s", time_constant.and_then(lag_fault));
    section.finish();
    time_constant
}

/// The gyroscopes, if the file has any; the inner `None` if they are not right.
fn gyroscopes(root: &Section<'_, '_>, format: Option<u8>, lag_given: bool) -> Option<Option<Gyroscopes>> {
    let alignment = root.optional_section("gyroscope_alignment").map(alignment);
    if !root.has("gyroscope") {
        if alignment.is_some() {
            root.fault("gyroscope_alignment", "needs gyroscopes; give three [[gyroscope]], or leave it out");
        }
        return None;
    }
    let axes = axes(root, SensorKind::Gyroscope, "gyroscope", format, lag_given);
    let alignment = match alignment {
        Some(Some(matrix)) => Some(matrix),
        Some(None) => return Some(None),
        None => None,
    };
    Some(axes.map(|axes| {
        let g_sensitivity = axes.each_ref().map(|(_, g_sensitivity)| *g_sensitivity);
        Gyroscopes { axes: axes.map(|(axis, _)| axis), g_sensitivity, alignment }
    }))
}

/// A sensor and its g-sensitivity, which only a gyroscope has.
type Sensor = (Axis, Option<[f64; AXES]>);

/// The sensors of a triad.
fn axes(
    root: &Section<'_, '_>,
    kind: SensorKind,
    key: &'static str,
    format: Option<u8>,
    lag_given: bool,
) -> Option<[Sensor; AXES]> {
    let sections = root.list(key);
    let [first, second, third] = kind.names();
    if sections.len() != AXES {
        root.fault(
            key,
            format!(
                "{} of them; give exactly three [[{key}]], {first}, {second}, {third} in this order",
                sections.len()
            ),
        );
    }
    let axis = |(mut section, index): (Section<'_, '_>, usize)| {
        let expected = kind.names().get(index).copied();
        match (section.string("name", &format!("{first}, {second} or {third}")), expected) {
            (Some(name), Some(expected)) if name != expected => {
                let order = format!("the names are {first}, {second}, {third} in this order");
                section.fault("name", format!("is {name:?}, give \"{expected}\": {order}"));
            }
            _ => {}
        }
        if let Some(name) = expected {
            section.rename(format!("{key}.{name}"));
        }
        axis(section, kind, format, lag_given)
    };
    let axes: Vec<_> = sections.into_iter().zip(0..).map(axis).collect();
    let axes: Option<Vec<_>> = axes.into_iter().collect();
    axes?.try_into().ok()
}

fn axis(section: Section<'_, '_>, kind: SensorKind, format: Option<u8>, lag_given: bool) -> Option<Sensor> {
    let max_rate = section.optional_number("max_rate");
    section.refuse("max_rate", max_rate.and_then(max_rate_fault));
    let bias = bias(&section, kind, format, lag_given);
    let positive = scale_factor(&section, "positive_scale_factor", kind, positive_scale_factor_fault);
    let negative = scale_factor(&section, "negative_scale_factor", kind, negative_scale_factor_fault);
    let g_sensitivity = match kind {
        SensorKind::Accelerometer => None,
        SensorKind::Gyroscope => section.optional_section("g_sensitivity").map(g_sensitivity),
    };
    section.finish();
    let (bias_unit, bias, transient) = bias?;
    let axis = Axis {
        bias_unit,
        bias,
        transient,
        positive_scale_factor: positive?,
        negative_scale_factor: negative?,
        max_rate,
    };
    match g_sensitivity {
        Some(coefficients) => Some((axis, Some(coefficients?))),
        None => Some((axis, None)),
    }
}

/// Unit, polynomial and transient of a bias.
fn bias(
    axis: &Section<'_, '_>,
    kind: SensorKind,
    format: Option<u8>,
    lag_given: bool,
) -> Option<(BiasUnit, Polynomial, f64)> {
    let (_, example) = kind.bias_units().last()?;
    let section = axis.section("bias", &format!("{{ unit = \"{example}\", range = [.., ..], c0 = .. }}"))?;
    let unit = section.choice("unit", kind.bias_units());
    let transient = section.optional_number("transient");
    if transient.is_some() && format == Some(1) {
        section.fault("transient", "is a part of format 2; give format = 2");
    } else if transient.is_some_and(|transient| transient != 0.0) && !lag_given {
        section.fault("transient", NO_LAG);
    }
    let transient = transient.unwrap_or(0.0);
    let curve = unit.zip(polynomial(&section));
    section.refuse("transient", curve.and_then(|(unit, curve)| transient_fault(kind, transient, &curve, unit)));
    section.finish();
    let (unit, polynomial) = curve?;
    axis.refuse("bias", bias_fault(kind, &polynomial, unit));
    Some((unit, polynomial, transient))
}

fn scale_factor(
    axis: &Section<'_, '_>,
    key: &'static str,
    kind: SensorKind,
    fault: fn(SensorKind, &Polynomial) -> Option<String>,
) -> Option<Polynomial> {
    let unit = kind.scale_factor_unit();
    let section = axis.section(key, &format!("{{ unit = \"{unit}\", range = [.., ..], c0 = .. }}"))?;
    let unit = section.choice("unit", &[((), unit)]);
    let polynomial = polynomial(&section);
    section.finish();
    let polynomial = polynomial?;
    axis.refuse(key, fault(kind, &polynomial));
    unit.map(|()| polynomial)
}

fn g_sensitivity(section: Section<'_, '_>) -> Option<[f64; AXES]> {
    let unit = section.choice("unit", &[((), G_SENSITIVITY_UNIT)]);
    let coefficients = G_SENSITIVITY_KEYS.map(|key| {
        let coefficient = section.number(key, "all three of a1, a2, a3, 0.0 where there is none");
        section.refuse(key, coefficient.and_then(g_sensitivity_fault));
        coefficient
    });
    section.finish();
    let [a1, a2, a3] = coefficients;
    unit.and(Some([a1?, a2?, a3?]))
}

fn polynomial(section: &Section<'_, '_>) -> Option<Polynomial> {
    const RANGE: &str = "range = [lowest, highest] calibrated temperature, both finite numbers";
    let range = section.numbers("range", RANGE).and_then(|range| {
        let range = <[f64; 2]>::try_from(range).ok().filter(|range| range[0] < range[1]);
        if range.is_none() {
            section.fault("range", format!("empty, reversed or not two numbers; give {RANGE}"));
        }
        range
    });
    let center = section.optional_number("center").unwrap_or(0.0);
    let scale = section.optional_number("scale").unwrap_or(1.0);
    if scale == 0.0 {
        section.fault("scale", "is 0; give what the centred temperature is divided by");
    }
    let given = POWERS.map(|power| section.optional_number(power));
    let coefficients: Vec<f64> = given.iter().map_while(|coefficient| *coefficient).collect();
    // A missing lower power is more likely a mistake than a zero. A present value that is not a number has been
    // reported above.
    let highest = POWERS.iter().rposition(|power| section.has(power));
    for (power, _) in POWERS.iter().zip(0..=highest.unwrap_or(0)).filter(|(power, _)| !section.has(power)) {
        section.fault(power, format!("missing; give {power} = 0.0 if it is zero"));
    }
    if Some(coefficients.len()) != highest.map(|highest| highest + 1) {
        return None;
    }
    Polynomial::new(&coefficients, center, scale, range?)
}

fn alignment(section: Section<'_, '_>) -> Option<Matrix3<f64>> {
    const MATRIX: &str = "a 3x3 matrix of finite numbers, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] for none";
    let rows = section.matrix("matrix", MATRIX);
    let matrix = rows
        .as_ref()
        .filter(|rows| rows.len() == 3 && rows.iter().all(|row| row.len() == 3))
        .map(|rows| Matrix3::from_row_iterator(rows.iter().flatten().copied()));
    if rows.is_some() && matrix.is_none() {
        section.fault("matrix", format!("not 3x3; give {MATRIX}"));
    }
    section.refuse("matrix", matrix.as_ref().and_then(alignment_fault));
    section.finish();
    matrix
}

/// The lines of a sensor after its name.
fn sensor(axis: &Axis, kind: SensorKind) -> String {
    let rate = axis.max_rate.map(|rate| format!("max_rate = {rate:?}"));
    let curves = axis.polynomials(kind).map(|(quantity, polynomial, unit)| {
        let transient = if quantity == "bias" { axis.transient } else { 0.0 };
        format!("{quantity} = {}", inline(polynomial, unit, transient))
    });
    rate.into_iter().chain(curves).collect::<Vec<_>>().join("\n")
}

fn rows(m: &Matrix3<f64>) -> String {
    let row = |i| format!("[{:?}, {:?}, {:?}]", m[(i, 0)], m[(i, 1)], m[(i, 2)]);
    format!("[{}, {}, {}]", row(0), row(1), row(2))
}

fn inline(polynomial: &Polynomial, unit: &str, transient: f64) -> String {
    let [low, high] = polynomial.range();
    let mut text = format!("{{ unit = \"{unit}\", range = [{low:?}, {high:?}]");
    if polynomial.center() != 0.0 || polynomial.scale() != 1.0 {
        let _ = write!(text, ", center = {:?}, scale = {:?}", polynomial.center(), polynomial.scale());
    }
    for (power, coefficient) in POWERS.iter().zip(polynomial.coefficients()) {
        let _ = write!(text, ", {power} = {coefficient:?}");
    }
    if transient != 0.0 {
        let _ = write!(text, ", transient = {transient:?}");
    }
    text + " }"
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}
