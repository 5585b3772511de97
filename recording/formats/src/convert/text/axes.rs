//! Three sensors of a text: their columns, and the pulses of their numbers.

use super::super::columns::{ColumnRef, Kind, Sensors};
use super::bad_rows::{Fault, RowRefusal};
use super::counting::PulseCounts;
use super::marks::{ColumnMarks, Number};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{CsvColumn, Rows};
use isotherm_recording::foreign::pulses;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::Finding;
use std::io::Read;

/// One pulse of numbers that are not whole, unless it is given.
const FINE: f64 = 1e-6;

/// The columns of three sensors, and what their numbers mean.
pub(super) struct TextAxes {
    columns: [CsvColumn; AXES],
    /// Those of the negative channels, where each channel has its own.
    negative: Option<[CsvColumn; AXES]>,
    pub(super) kind: Kind,
    pub(super) gate_s: Option<f64>,
    /// Of counts and rates.
    counting: Option<PulseCounts>,
    offset: f64,
    /// Of the first row on.
    resolution: Option<f64>,
    /// Whether the resolution was taken from the first row, where all numbers are whole.
    taken_for_whole: bool,
    /// Whether all numbers so far are whole.
    all_whole: bool,
    pub(super) sign: [f64; AXES],
    /// One of the column's unit \[m/s2 or rad/s\], and the largest reading in it.
    unit: Option<f64>,
    range: Option<f64>,
    /// The time \[us\] that the numbers are sums over.
    duration: Option<CsvColumn>,
}

/// The numbers of three sensors, with `negative` those of the positive channels.
pub(super) struct AxisNumbers {
    pub(super) of_axes: [Number; AXES],
    pub(super) negative: Option<[Number; AXES]>,
}

impl TextAxes {
    /// Of a mapping's sensors, in the columns that `find` finds.
    pub(super) fn new(
        sensors: &Sensors,
        find: impl Fn(&ColumnRef) -> Result<CsvColumn, RecordingError>,
    ) -> Result<Self, RecordingError> {
        let three = |[x, y, z]: &[ColumnRef; AXES]| Ok::<_, RecordingError>([find(x)?, find(y)?, find(z)?]);
        let Sensors { kind, gate_s, offset, resolution, sign, unit, range, .. } = *sensors;
        Ok(Self {
            columns: three(&sensors.columns)?,
            negative: sensors.negative.as_ref().map(three).transpose()?,
            kind,
            gate_s,
            counting: PulseCounts::of(sensors),
            offset,
            resolution,
            taken_for_whole: false,
            all_whole: true,
            sign,
            unit,
            range,
            duration: sensors.duration.as_ref().map(find).transpose()?,
        })
    }

    /// The numbers of the current row.
    #[inline]
    pub(super) fn numbers(
        &self,
        rows: &Rows<Box<dyn Read>>,
        marks: &mut ColumnMarks,
    ) -> Result<AxisNumbers, RowRefusal> {
        let mut three = |columns: &[CsvColumn; AXES]| {
            let mut numbers = [Number { value: 0.0, is_whole: true }; AXES];
            for (number, column) in numbers.iter_mut().zip(columns) {
                *number = marks.number(rows, column).map_err(|error| bad(rows, column, error))?;
            }
            Ok(numbers)
        };
        let mut numbers = three(&self.columns)?;
        let negative = self.negative.as_ref().map(three).transpose()?;
        if let Some(duration) = &self.duration {
            let us = marks.number(rows, duration).map_err(|error| bad(rows, duration, error))?.value;
            if us <= 0.0 {
                let message = format!("{}: the time of the sums is not over 0", duration.name());
                return Err(RowRefusal::Row(Fault::Number, message));
            }
            for number in &mut numbers {
                *number = Number { value: number.value / (us / 1e6), is_whole: false };
            }
        }
        Ok(AxisNumbers { of_axes: numbers, negative })
    }

    /// The pulses of numbers that are right, `to` each axis, with what rounding leaves, and those of the negative
    /// channels, where they are apart.
    #[inline]
    pub(super) fn pulses(
        &mut self,
        rows: &Rows<Box<dyn Read>>,
        AxisNumbers { of_axes: numbers, negative: of_negative }: &AxisNumbers,
        (to, rest): (&mut [i64], &mut [f64]),
        negative: &mut [i64],
    ) -> Result<(), RowRefusal> {
        if let Some(counting) = &mut self.counting {
            let columns = (&self.columns, self.negative.as_ref());
            return counted(counting, rows, columns, (numbers, of_negative.as_ref()), self.sign, [to, negative]);
        }
        let whole = numbers.iter().all(|number| number.is_whole);
        let resolution = self.resolution.unwrap_or(if whole { 1.0 } else { FINE });
        if self.taken_for_whole && !whole {
            let names: Vec<_> = self.columns.iter().map(CsvColumn::name).collect();
            let message =
                "not a whole number, as those of the first row are; give the resolution, such as resolution = 1e-6";
            return Err(RowRefusal::Text(rows.error(format!("{}: {message}", names.join(", ")))));
        }
        for (axis, number) in numbers.iter().enumerate() {
            let pulses = pulses(number.value, self.offset, resolution, self.sign[axis]);
            let of_axis = |message| RowRefusal::Row(Fault::Range, format!("{}: {message}", self.columns[axis].name()));
            (to[axis], rest[axis]) = pulses.map_err(of_axis)?;
        }
        self.all_whole &= whole;
        if self.resolution.is_none() {
            (self.resolution, self.taken_for_whole) = (Some(resolution), whole);
        }
        Ok(())
    }

    /// Whether the numbers are counts of a fixed scale. Valid after the first row.
    pub(super) fn are_counts(&self) -> bool {
        self.kind == Kind::Reading && self.unit.is_none() && self.resolution.is_none_or(|resolution| resolution == 1.0)
    }

    /// Whether they are readings, and no counts. Valid after the first row.
    pub(super) fn are_readings(&self) -> bool {
        self.kind == Kind::Reading && !self.are_counts()
    }

    /// That the numbers are not what `kind` says. `section` is that of the mapping. Valid after the last row.
    pub(super) fn finding(&self, section: &str) -> Option<Finding> {
        self.counting.as_ref()?.finding(section)
    }

    /// A pulse, and the largest reading \[m/s2 or rad/s\]. `section` is that of the mapping, `units` those it may have.
    pub(super) fn scale(&self, section: &str, units: &str) -> Result<(f64, Option<f64>), String> {
        if self.unit.is_none() && (self.offset != 0.0 || self.all_whole || self.are_counts()) {
            return Err(format!(
                "{section}: the numbers look like counts; if they are readings, give its unit: {units}; otherwise \
                 the scale of a count"
            ));
        }
        let unit = self.unit.unwrap_or(1.0);
        let resolution = self.resolution.ok_or_else(|| format!("{section}: no row has been read"))?;
        Ok((resolution * unit, self.range.map(|range| range * unit)))
    }
}

/// The pulses of counts and rates: those of the axes and, where each channel has a column, of the negative channels.
fn counted(
    counting: &mut PulseCounts,
    rows: &Rows<Box<dyn Read>>,
    (columns, of_negative): (&[CsvColumn; AXES], Option<&[CsvColumn; AXES]>),
    (numbers, negative): (&[Number; AXES], Option<&[Number; AXES]>),
    sign: [f64; AXES],
    [to, to_negative]: [&mut [i64]; 2],
) -> Result<(), RowRefusal> {
    for axis in 0..AXES {
        let Some((column, number)) =
            of_negative.zip(negative).map(|(columns, numbers)| (&columns[axis], numbers[axis]))
        else {
            to[axis] = counting.pulses(rows, &columns[axis], numbers[axis])? * sign[axis] as i64;
            continue;
        };
        let positive = counting.of_channel(rows, &columns[axis], numbers[axis])?;
        let negative = counting.of_channel(rows, column, number)?;
        // An axis that points the other way has its channels exchanged.
        let is_reversed = sign[axis] < 0.0;
        (to[axis], to_negative[axis]) = if is_reversed { (negative, positive) } else { (positive, negative) };
    }
    Ok(())
}

/// A row in which the field of a column is bad.
pub(super) fn bad(rows: &Rows<Box<dyn Read>>, column: &CsvColumn, error: RecordingError) -> RowRefusal {
    let RecordingError::Data { message, .. } = error else { return RowRefusal::Text(error) };
    let is_missing = [&b""[..], b"nan", b"null", b"none", b"-"];
    let field = rows.field(column.index());
    let is_missing = is_missing.iter().any(|missing| field.eq_ignore_ascii_case(missing));
    RowRefusal::Row(if is_missing { Fault::Missing } else { Fault::Number }, message)
}
