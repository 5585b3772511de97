//! The columns of a row, by their names or numbers.

use crate::number::Field;
use crate::sample::{Axes, Columns, MAX_STATUS, Status, TemperatureColumns};
use isotherm_client::Resolution;
use isotherm_recording_formats::convert::{ColumnRef, Kind, Linear, SensorColumns, Sensors, Temperature};
use isotherm_shared::document::Section;
use isotherm_shared::wire::AXES;

/// One pulse of readings that are not whole numbers, in the column's unit.
const FINE: f64 = 1e-6;
const TEMPERATURES: usize = 2 * AXES;

/// What columns a row has.
pub(super) struct Names {
    /// The names of all columns; empty if they have numbers.
    all: Vec<String>,
    /// Whether each is a whole number as it comes.
    plain: Vec<bool>,
    /// The width in bits of each that is a whole number without sign, and what its unit stands for.
    widths: Vec<Option<(u32, f64)>>,
    /// The columns that a row has, from 0; of frames all.
    used: Vec<usize>,
    form: Form,
}

#[derive(Clone, Copy, Eq, PartialEq)]
enum Form {
    /// A row has all fields.
    Fields,
    /// A row has the columns that are used, of which these are the names.
    Named,
    /// A row has the columns that are used.
    Numbered,
    /// A row has the channels that are used, with any names.
    Channels,
    /// The columns are not known, since what says them is wrong: each is taken to be there, by its name or number.
    Unknown { named: bool },
}

impl Names {
    pub(super) fn of_fields(fields: &[Field]) -> Self {
        let plain = fields.iter().map(|field| field.number.is_whole() && field.is_plain()).collect();
        let all = fields.iter().map(|field| field.name.clone()).collect();
        let width = |field: &Field| {
            let is_unsigned = field.number.is_unsigned() && field.offset == 0.0;
            is_unsigned.then(|| (8 * field.number.bytes() as u32, field.scale))
        };
        let widths = fields.iter().map(width).collect();
        Self { all, plain, widths, used: (0..fields.len()).collect(), form: Form::Fields }
    }

    /// The columns of lines; without names they have numbers.
    pub(super) fn of_lines(names: Vec<String>) -> Self {
        let form = if names.is_empty() { Form::Numbered } else { Form::Named };
        Self { all: names, plain: Vec::new(), widths: Vec::new(), used: Vec::new(), form }
    }

    /// The channels of IIO devices.
    pub(super) const fn channels() -> Self {
        Self { all: Vec::new(), plain: Vec::new(), widths: Vec::new(), used: Vec::new(), form: Form::Channels }
    }

    pub(super) const fn unknown(named: bool) -> Self {
        let form = Form::Unknown { named };
        Self { all: Vec::new(), plain: Vec::new(), widths: Vec::new(), used: Vec::new(), form }
    }

    pub(super) const fn are_named(&self) -> bool {
        !matches!(self.form, Form::Numbered | Form::Unknown { named: false })
    }

    pub(super) const fn are_unknown(&self) -> bool {
        matches!(self.form, Form::Unknown { .. })
    }

    pub(super) const fn are_channels(&self) -> bool {
        matches!(self.form, Form::Channels)
    }

    /// The width in bits of a column that is known to be a whole number without sign, and what its unit stands for.
    pub(super) fn width(&self, place: usize) -> Option<(u32, f64)> {
        self.widths.get(place).copied().flatten()
    }

    pub(super) fn used(&self) -> Vec<usize> {
        self.used.clone()
    }

    /// The names of the columns of a row; none if they have numbers.
    pub(super) fn of_row(&self) -> Vec<String> {
        self.used.iter().filter_map(|used| self.all.get(*used).cloned()).collect()
    }

    pub(super) fn names(&self) -> Vec<String> {
        self.all.clone()
    }

    /// The place of a column in a row. A fault is that of this key of the section.
    pub(super) fn place(&mut self, section: &Section<'_, '_>, key: &str, column: &ColumnRef) -> Option<usize> {
        let index = match (self.form, column) {
            (Form::Unknown { .. }, _) => return Some(0),
            (_, ColumnRef::Number(number)) => number.saturating_sub(1),
            (Form::Channels, ColumnRef::Name(name)) => match self.all.iter().position(|of| of == name) {
                Some(index) => index,
                None => {
                    self.all.push(name.clone());
                    self.all.len() - 1
                }
            },
            (_, ColumnRef::Name(name)) => {
                let Some(index) = self.all.iter().position(|of| of == name) else {
                    section.fault(key, format!("{name} is not a column; there are {}", self.all.join(", ")));
                    return None;
                };
                index
            }
        };
        if let Some(place) = self.used.iter().position(|used| *used == index) {
            return Some(place);
        }
        self.used.push(index);
        Some(self.used.len() - 1)
    }

    /// The place of the column that a section `{ column = .. }` names.
    pub(super) fn of_section(&mut self, section: &Section<'_, '_>) -> Option<usize> {
        match self.all_of_section(section, "column")?[..] {
            [column] => Some(column),
            _ => {
                section.fault("column", "has several columns; give one");
                None
            }
        }
    }

    /// The places of the columns that a key names: one or a list.
    pub(super) fn all_of_section(&mut self, section: &Section<'_, '_>, key: &'static str) -> Option<Vec<usize>> {
        let columns: Vec<_> = if self.are_named() {
            let names = section.strings(key, "the name of a column")?;
            names.into_iter().map(|name| ColumnRef::Name(name.to_owned())).collect()
        } else {
            if !section.has(key) {
                section.fault(key, "missing; give the number of a column, from 1");
            }
            let numbers = section.optional_integers(key, 1..=4096)?;
            numbers.into_iter().map(|number| ColumnRef::Number(number as usize)).collect()
        };
        columns.iter().map(|column| self.place(section, key, column)).collect()
    }

    /// Whether it is known that these columns are whole numbers as they come.
    fn are_counts(&self, columns: &[usize]) -> bool {
        match self.form {
            Form::Fields => columns.iter().all(|column| self.plain.get(*column) == Some(&true)),
            Form::Channels | Form::Unknown { .. } => true,
            Form::Named | Form::Numbered => false,
        }
    }
}

/// Bits of the status that belong to one sensor each.
pub(super) struct SensorBits {
    /// Places of the numbers of the status.
    columns: Vec<usize>,
    /// Places of the sensors, each with its bits.
    sensors: Vec<(usize, u64)>,
}

/// The section `[status]`, and what belongs to single sensors.
pub(super) fn status(root: &Section<'_, '_>, names: &mut Names) -> Option<(Status, Vec<SensorBits>)> {
    let section = root.optional_section("status")?;
    if names.are_channels() {
        section.fault("", "is not for IIO; leave it out");
        return None;
    }
    let columns = names.all_of_section(&section, "columns");
    let many = columns.as_ref().filter(|columns| columns.len() > MAX_STATUS);
    section.refuse("columns", many.map(|columns| format!("has {} columns; give {MAX_STATUS} at most", columns.len())));
    let bits = |key| section.optional_integer(key, 0..=i64::MAX).map(i64::cast_unsigned);
    let (mask, healthy) = (bits("mask").unwrap_or(u64::MAX), bits("healthy").unwrap_or(0));
    section.fault_if(healthy & !mask != 0, "healthy", "has bits that mask lacks; give those of a healthy device");
    let known = columns.clone().unwrap_or_default();
    let axes: Vec<_> = section.list("axes").into_iter().map(|axes| sensor_bits(axes, names, &known, mask)).collect();
    section.finish();
    let columns = columns?;
    let repeated = |at: usize| columns.get(at).or(columns.first()).copied().unwrap_or_default();
    let status = Status { columns: std::array::from_fn(repeated), mask, healthy, bits: Default::default() };
    Some((status, axes.into_iter().collect::<Option<_>>()?))
}

/// A section `[[status.axes]]`: the bits of single sensors in some numbers of the status.
fn sensor_bits(section: Section<'_, '_>, names: &mut Names, known: &[usize], mask: u64) -> Option<SensorBits> {
    let columns = names.all_of_section(&section, "columns");
    let sensors = names.all_of_section(&section, "sensors");
    let bits = section.integers("bits", 1..=i64::MAX, "the bit of each sensor, as in [0x01, 0x02, 0x04]");
    let other = columns.as_ref().is_some_and(|columns| columns.iter().any(|column| !known.contains(column)));
    let other = other && !names.are_unknown();
    section.fault_if(other, "columns", "has a column that columns of [status] lacks");
    let lengths = sensors.as_ref().map(Vec::len).zip(bits.as_ref().map(Vec::len));
    let differ = lengths.filter(|(sensors, bits)| sensors != bits);
    section
        .refuse("bits", differ.map(|(sensors, bits)| format!("has {bits}, and sensors {sensors}; give one a sensor")));
    let bits: Option<Vec<_>> = bits.map(|bits| bits.into_iter().map(i64::cast_unsigned).collect());
    let outside = bits.iter().flatten().any(|bits| bits & !mask != 0);
    section.fault_if(outside, "bits", "has bits that mask lacks");
    section.finish();
    let (columns, sensors, bits) = (columns?, sensors?, bits?);
    let sensors = sensors.into_iter().zip(bits).collect();
    (differ.is_none() && !outside && !other).then_some(SensorBits { columns, sensors })
}

/// Gives the numbers of a status the bits of the sensors that have these places.
fn complete(
    root: &Section<'_, '_>,
    status: (Status, Vec<SensorBits>),
    places: [Option<usize>; TEMPERATURES],
) -> Status {
    let (mut status, all) = status;
    for SensorBits { columns, sensors } in all {
        for (place, bits) in sensors {
            let sensor = places.iter().position(|of| *of == Some(place));
            let fault = "has a column that is none of [accelerometer] and [gyroscope]";
            root.refuse("status.axes.sensors", sensor.is_none().then(|| fault.to_owned()));
            let numbers = status.columns.iter().zip(&mut status.bits).filter(|(column, _)| columns.contains(column));
            if let Some(sensor) = sensor {
                numbers.for_each(|(_, of)| of[sensor] |= bits);
            }
        }
    }
    status
}

/// The places of the sensors' columns in a row.
pub(super) fn resolve(
    root: &Section<'_, '_>,
    sensors: &SensorColumns,
    names: &mut Names,
    interval_ns: u64,
    status: Option<(Status, Vec<SensorBits>)>,
    device: u64,
) -> Option<Columns> {
    let accelerometer = axes(root, "accelerometer", &sensors.accelerometer, names);
    let gyroscope = sensors.gyroscope.as_ref().map(|of| axes(root, "gyroscope", of, names));
    let temperature = temperature(root, &sensors.temperature, names);
    let (accelerometer, of_accelerometer) = accelerometer?;
    let gyroscope = gyroscope.map_or(Some(None), |axes| axes.map(Some))?;
    let of_gyroscope = gyroscope.as_ref().map_or(of_accelerometer, |(_, resolution)| *resolution);
    let resolution = Resolution { accelerometer: of_accelerometer, gyroscope: of_gyroscope };
    let gyroscope = gyroscope.map(|(axes, _)| axes);
    let temperature = temperature?;
    let places = |axes: Option<&Axes>| axes.map_or([None; AXES], |axes| axes.columns.map(Some));
    let [[a1, a2, a3], [g1, g2, g3]] = [Some(&accelerometer), gyroscope.as_ref()].map(places);
    let is_known = !names.are_unknown();
    let status = status.filter(|_| is_known).map(|status| complete(root, status, [a1, a2, a3, g1, g2, g3]));
    Some(Columns { accelerometer, gyroscope, temperature, status, resolution, interval_ns, device })
}

/// The columns of a triad, and one pulse in their unit.
fn axes(root: &Section<'_, '_>, key: &'static str, of: &Sensors, names: &mut Names) -> Option<(Axes, f64)> {
    let section = root.optional_section(key)?;
    let [a, b, c] = of.columns.each_ref().map(|column| names.place(&section, "columns", column));
    let columns = [a?, b?, c?];
    let resolution = match of.resolution {
        Some(resolution) => resolution,
        None if names.are_counts(&columns) => 1.0,
        None if of.kind == Kind::Reading && names.form == Form::Fields => FINE,
        None => {
            let message = "missing; give one pulse in the column's unit: 1 if the numbers are counts, otherwise what \
                they are rounded to, such as 1e-6";
            section.fault("resolution", message);
            return None;
        }
    };
    let is_reading = of.kind == Kind::Reading;
    Some((Axes { columns, offset: of.offset, sign: of.sign, is_reading }, resolution))
}

fn temperature(root: &Section<'_, '_>, of: &Temperature, names: &mut Names) -> Option<TemperatureColumns> {
    let section = root.optional_section("temperature")?;
    match of {
        Temperature::Constant(constant) => Some(TemperatureColumns::Constant(*constant)),
        Temperature::Columns { head, board, linear } => {
            let mut places = |key, columns: &[ColumnRef]| {
                let places = columns.iter().map(|column| names.place(&section, key, column));
                places.collect::<Option<Vec<_>>>().and_then(|places| for_all_sensors(&places))
            };
            let head = places("columns", head)?;
            let key = if section.has("board_columns") { "board_columns" } else { "columns" };
            let linear = linear.unwrap_or(Linear { scale: 1.0, offset: 0.0 });
            Some(TemperatureColumns::Columns { head, board: places(key, board)?, linear })
        }
    }
}

/// One column for all sensors, three for the axes, or six.
fn for_all_sensors(places: &[usize]) -> Option<[usize; TEMPERATURES]> {
    match *places {
        [one] => Some([one; TEMPERATURES]),
        [a, b, c] => Some([a, b, c, a, b, c]),
        _ => places.try_into().ok(),
    }
}
