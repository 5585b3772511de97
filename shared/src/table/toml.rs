//! Reading and writing a table file's text. Reading reports all faults of the text together.

use super::checks::{
    alignment_fault, bias_fault, gravity_fault, max_age_fault, max_rate_fault, negative_scale_factor_fault,
    positive_scale_factor_fault,
};
use super::model::{AXIS_NAMES, Axis, CoefficientTable, Content, OutOfRange};
use crate::document::{Document, Faults, Section};
use crate::polynomial::{MAX_ORDER, Polynomial};
use crate::stream::ImuId;
use crate::units::{BiasUnit, SCALE_FACTOR_UNIT};
use crate::wire::AXES;
use core::fmt::Write as _;
use nalgebra::Matrix3;

const POWERS: [&str; MAX_ORDER + 1] = ["c0", "c1", "c2", "c3", "c4", "c5", "c6", "c7"];

/// How reading treats a file's digest.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Seal {
    /// A digest in the file must match the content.
    Checked,
    /// A digest in the file is ignored, because the caller is about to replace it.
    Renewed,
}

impl CoefficientTable {
    /// Reads a table file's text. With `expected`, a table for another IMU is refused.
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
        let document = Document::parse_as(text, "give the coefficient table")?;
        let root = document.root();
        let table = read(&root, expected, seal);
        root.finish();
        document.finish(table)
    }

    /// The table as the text of a sealed file (one with a digest), without provenance. Its numbers read back to the same doubles.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let content = self.content();
        let mut text = format!("format = 1\ndigest = \"{}\"\n\n[imu]\nid = \"{}\"\n", self.digest(), content.imu);
        // Writing to a String cannot fail.
        let mut line = |line: core::fmt::Arguments<'_>| {
            let _ = text.write_fmt(line);
            text.push('\n');
        };
        if let Some(serial) = &content.serial {
            line(format_args!("serial = {}", quoted(serial)));
        }
        line(format_args!("gravity = {:?}\n\n[temperature]", content.gravity));
        line(format_args!("unit = {}", quoted(&content.temperature_unit)));
        line(format_args!("out_of_range = \"{}\"", content.out_of_range.name()));
        if let Some(age) = content.max_age_s {
            line(format_args!("max_age_s = {age:?}"));
        }
        for (name, axis) in AXIS_NAMES.iter().zip(&content.axes) {
            line(format_args!("\n[[axis]]\nname = \"{name}\""));
            if let Some(rate) = axis.max_rate {
                line(format_args!("max_rate = {rate:?}"));
            }
            for (quantity, polynomial, unit) in axis.polynomials() {
                line(format_args!("{quantity} = {}", inline(polynomial, unit)));
            }
        }
        if let Some(m) = &content.alignment {
            let row = |i| format!("[{:?}, {:?}, {:?}]", m[(i, 0)], m[(i, 1)], m[(i, 2)]);
            line(format_args!("\n[alignment]\nmatrix = [{}, {}, {}]", row(0), row(1), row(2)));
        }
        text
    }
}

fn read(root: &Section<'_, '_>, expected: Option<&ImuId>, seal: Seal) -> Option<CoefficientTable> {
    let format = root.number("format", "format = 1, the version of this file format");
    if format.is_some_and(|format| format != 1.0) {
        root.fault("format", "unknown; this version reads format = 1");
    }
    let digest = match seal {
        Seal::Checked => root.optional_string("digest"),
        Seal::Renewed => {
            root.ignore("digest");
            None
        }
    };
    let gravity_local = root.number_within("provenance", "gravity_local").filter(|g| gravity_fault(*g).is_none());
    let imu = root.section("imu", "[imu] with id and gravity").and_then(|section| imu(section, expected));
    let temperature = root.section("temperature", "[temperature] with unit and out_of_range").and_then(temperature);
    let axes = axes(root);
    let alignment = root.optional_section("alignment").map(alignment);

    let (id, serial, gravity) = imu?;
    let (temperature_unit, out_of_range, max_age_s) = temperature?;
    let content = Content {
        imu: id,
        serial,
        gravity,
        temperature_unit,
        out_of_range,
        max_age_s,
        axes: axes?,
        alignment: match alignment {
            Some(matrix) => Some(matrix?),
            None => None,
        },
    };
    // This cannot fail: each part has been checked above, where its line is known.
    let table = CoefficientTable::new(content).ok()?.measured_at(gravity_local);
    if let Some(digest) = digest.filter(|digest| **digest != table.digest().to_string()) {
        root.fault(
            "digest",
            format!(
                "is {digest:?}, but the content has {}; if the change was meant, seal it again with the command `check --seal`",
                table.digest()
            ),
        );
    }
    Some(table)
}

fn imu(section: Section<'_, '_>, expected: Option<&ImuId>) -> Option<(ImuId, Option<String>, f64)> {
    let id = section.imu_id("id");
    if let (Some(id), Some(expected)) = (&id, expected)
        && id != expected
    {
        section.fault("id", format!("this table belongs to {id}, not to {expected}; name the table of {expected}"));
    }
    let serial = section.optional_string("serial").map(str::to_owned);
    let gravity = section.number("gravity", "the value of 1 g0 in m/s2, for example 9.8015");
    section.refuse("gravity", gravity.and_then(gravity_fault));
    section.finish();
    Some((id?, serial, gravity?))
}

fn temperature(section: Section<'_, '_>) -> Option<(String, OutOfRange, Option<f64>)> {
    let unit = section.string("unit", "the unit of the telemetry, for example \"V\"").map(str::to_owned);
    let out_of_range = section.choice("out_of_range", &OutOfRange::NAMES);
    let max_age_s = section.optional_number("max_age_s");
    section.refuse("max_age_s", max_age_s.and_then(max_age_fault));
    section.finish();
    Some((unit?, out_of_range?, max_age_s))
}

fn axes(root: &Section<'_, '_>) -> Option<[Axis; AXES]> {
    let sections = root.list("axis");
    if sections.len() != AXES {
        root.fault(
            "axis",
            format!("{} of them; give exactly three [[axis]], A1, A2, A3 in this order", sections.len()),
        );
    }
    let axes: Vec<_> = sections.into_iter().zip(0..).map(|(section, index)| axis(section, index)).collect();
    let axes: Option<Vec<_>> = axes.into_iter().collect();
    axes?.try_into().ok()
}

fn axis(mut section: Section<'_, '_>, index: usize) -> Option<Axis> {
    let expected = AXIS_NAMES.get(index);
    match (section.string("name", "A1, A2 or A3"), expected) {
        (Some(name), Some(expected)) if name != *expected => {
            section.fault("name", format!("is {name:?}, give \"{expected}\": the axes are A1, A2, A3 in this order"));
        }
        _ => {}
    }
    if let Some(name) = expected {
        section.rename(format!("axis.{name}"));
    }
    let max_rate = section.optional_number("max_rate");
    section.refuse("max_rate", max_rate.and_then(max_rate_fault));
    let bias = bias(&section);
    let positive = scale_factor(&section, "positive_scale_factor", positive_scale_factor_fault);
    let negative = scale_factor(&section, "negative_scale_factor", negative_scale_factor_fault);
    section.finish();
    let (bias_unit, bias) = bias?;
    Some(Axis { bias_unit, bias, positive_scale_factor: positive?, negative_scale_factor: negative?, max_rate })
}

fn bias(axis: &Section<'_, '_>) -> Option<(BiasUnit, Polynomial)> {
    let section = axis.section("bias", "{ unit = \"ug0\", range = [.., ..], c0 = .. }")?;
    let unit = section.choice("unit", &BiasUnit::NAMES);
    let polynomial = polynomial(section);
    let (unit, polynomial) = (unit?, polynomial?);
    axis.refuse("bias", bias_fault(&polynomial, unit));
    Some((unit, polynomial))
}

fn scale_factor(
    axis: &Section<'_, '_>,
    key: &'static str,
    fault: fn(&Polynomial) -> Option<String>,
) -> Option<Polynomial> {
    let section = axis.section(key, "{ unit = \"pulse/(s*g0)\", range = [.., ..], c0 = .. }")?;
    let unit = section.choice("unit", &[((), SCALE_FACTOR_UNIT)]);
    let polynomial = polynomial(section)?;
    axis.refuse(key, fault(&polynomial));
    unit.map(|()| polynomial)
}

fn polynomial(section: Section<'_, '_>) -> Option<Polynomial> {
    const RANGE: &str = "range = [lowest, highest] calibrated telemetry, both finite numbers";
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
        section.fault("scale", "is 0; give what the centred telemetry is divided by");
    }
    let given = POWERS.map(|power| section.optional_number(power));
    let coefficients: Vec<f64> = given.iter().map_while(|coefficient| *coefficient).collect();
    // A missing lower power is more likely a mistake than a zero. A present value that is not a number has been reported above.
    let highest = POWERS.iter().rposition(|power| section.has(power));
    for (power, _) in POWERS.iter().zip(0..=highest.unwrap_or(0)).filter(|(power, _)| !section.has(power)) {
        section.fault(power, format!("missing; give {power} = 0.0 if it is zero"));
    }
    section.finish();
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

fn inline(polynomial: &Polynomial, unit: &str) -> String {
    let [low, high] = polynomial.range();
    let mut text = format!("{{ unit = \"{unit}\", range = [{low:?}, {high:?}]");
    if polynomial.center() != 0.0 || polynomial.scale() != 1.0 {
        let _ = write!(text, ", center = {:?}, scale = {:?}", polynomial.center(), polynomial.scale());
    }
    for (power, coefficient) in POWERS.iter().zip(polynomial.coefficients()) {
        let _ = write!(text, ", {power} = {coefficient:?}");
    }
    text + " }"
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}
