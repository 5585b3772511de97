//! A sheet of means: a row for each position at each set point, without times.

use super::super::columns::Kind;
use super::super::mapping::Mapping;
use super::axes::{AxisNumbers, TextAxes};
use super::bad_rows::RowRefusal;
use super::marks::Number;
use super::{TextSource, bad};
use isotherm_recording::RecordingError;
use isotherm_recording::csv::CsvColumn;
use isotherm_shared::wire::AXES;
use isotherm_support::failure::Failure;
use std::io::{Cursor, Read};
use std::path::Path;

/// The means of a position at a set point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanRow {
    /// Line in the sheet.
    pub line: u64,
    /// Set point of the chamber \[degC\].
    pub set_point_c: f64,
    /// Number of the position.
    pub position: u32,
    /// Rates of the positive and the negative channels of A1, A2, A3 \[pulse/s\].
    pub rates: [[f64; 2]; AXES],
    /// Temperature of heads and boards.
    pub temperature: [[f64; AXES]; 2],
}

/// Reads the bytes of a sheet of means with the mapping of a campaign file. `name` stands for it in messages.
///
/// # Errors
/// If a column is missing; at the first row that cannot be used, with its line.
pub fn read_means(name: &Path, bytes: Vec<u8>, mapping: Mapping) -> Result<Vec<MeanRow>, Failure> {
    rows(Box::new(Cursor::new(bytes)), mapping).map_err(|error| error.failure(name))
}

fn rows(source: Box<dyn Read>, mapping: Mapping) -> Result<Vec<MeanRow>, RecordingError> {
    let mut sheet = TextSource::new(source, mapping)?;
    let mut means = Vec::new();
    while sheet.rows.next_row()? {
        if sheet.is_no_row() {
            continue;
        }
        let mean = sheet.mean().map_err(|fault| match fault {
            RowRefusal::Text(error) => error,
            RowRefusal::Row(_, message) => sheet.rows.error(message),
        })?;
        means.push(mean);
    }
    sheet.marks.check()?;
    match means.is_empty() {
        true => Err(RecordingError::Data { line: sheet.begin, message: "there are no rows".to_owned() }),
        false => Ok(means),
    }
}

impl TextSource {
    /// The means of the current row.
    fn mean(&mut self) -> Result<MeanRow, RowRefusal> {
        self.check_width()?;
        let Some([set_point, position]) = &self.labels else {
            return Err(RowRefusal::Text(
                self.rows.error("a sheet has the columns of set point and position".to_owned()),
            ));
        };
        let mut number =
            |column: &CsvColumn| self.marks.number(&self.rows, column).map_err(|error| bad(&self.rows, column, error));
        let set_point_c = number(set_point)?.value;
        let Number { value, is_whole } = number(position)?;
        let position = Some(value).filter(|value| is_whole && (0.0..4_294_967_296.0).contains(value));
        let Some(position) = position.map(|value| value as u32) else {
            let message = format!("{value} is not a position; give its whole number, as in the campaign file");
            return Err(RowRefusal::Text(self.rows.error(message)));
        };
        let numbers = self.accelerometers.numbers(&self.rows, &mut self.marks)?;
        let rates = self.accelerometers.rates(&numbers);
        if let Some([positive, negative]) = rates.iter().find(|rates| rates.iter().any(|rate| *rate < 0.0)) {
            let message = format!(
                "a channel counts from 0 on, and these are {positive} and {negative} pulse/s; if a column has \
                 both signs, give columns in place of positive and negative"
            );
            return Err(RowRefusal::Text(self.rows.error(message)));
        }
        let [head, board] = self.temperature()?.map(|values| [values[0], values[1], values[2]]);
        Ok(MeanRow { line: self.rows.line(), set_point_c, position, rates, temperature: [head, board] })
    }
}

impl TextAxes {
    /// Rates of both channels of each axis \[pulse/s\].
    fn rates(&self, AxisNumbers { of_axes, negative }: &AxisNumbers) -> [[f64; 2]; AXES] {
        let gate_s = match self.kind {
            Kind::Count => self.gate_s.unwrap_or(1.0),
            _ => 1.0,
        };
        core::array::from_fn(|axis| {
            let both = match negative {
                Some(negative) => [of_axes[axis].value, negative[axis].value],
                None => [of_axes[axis].value.max(0.0), (-of_axes[axis].value).max(0.0)],
            };
            let [positive, negative] = both.map(|value| value / gate_s);
            let is_exchanged = self.sign[axis] < 0.0;
            if is_exchanged { [negative, positive] } else { [positive, negative] }
        })
    }
}
