//! Increments in CSV.

use crate::columns::{Column, INCREMENT, load_increment};
use crate::rows::append_value;
use isotherm_shared::wire::{AXES, CompensatedIncrement};
use std::io::{self, Write};

/// Columns of all increments that `feed` and `replay` write.
pub const CSV_COLUMNS: [&str; 8] = {
    let [_, _, sequence, timestamp, interval, a1, a2, a3, _, _, _, table, flags, ..] = INCREMENT;
    [sequence.name, timestamp.name, interval.name, a1.name, a2.name, a3.name, table.name, flags.name]
};

/// Columns of the angle increments, which come behind the velocity increments where the table has gyroscopes.
pub const ANGLE_CSV_COLUMNS: [&str; AXES] = {
    let [_, _, _, _, _, _, _, _, g1, g2, g3, ..] = INCREMENT;
    [g1.name, g2.name, g3.name]
};

/// Which columns increments in CSV have in addition to [`CSV_COLUMNS`].
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub struct IncrementLayout {
    /// Those of the angle increments.
    pub gyroscopes: bool,
    /// The delivery flags, in the last column.
    pub delivery: bool,
}

/// Writes increments as CSV. Floats have the shortest form that reads back as the same double.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use isotherm_recording::{IncrementCsvWriter, IncrementLayout};
/// use isotherm_shared::wire::CompensatedIncrement;
///
/// let velocity_increment = [0.1, 0.0, f64::NAN]; // m/s
/// let increment = CompensatedIncrement { velocity_increment, ..CompensatedIncrement::default() };
/// let mut writer = IncrementCsvWriter::new(Vec::new(), IncrementLayout { gyroscopes: false, delivery: false })?;
/// writer.write(&increment)?;
/// let text = String::from_utf8(writer.finish()?)?;
/// assert!(text.starts_with("sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags"), "{text}");
/// # Ok(())
/// # }
/// ```
pub struct IncrementCsvWriter<W> {
    sink: W,
    /// The columns, by their index in [`INCREMENT`].
    columns: Vec<usize>,
    row: Vec<u8>,
}

impl<W: Write> IncrementCsvWriter<W> {
    /// Writes the header row.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn new(mut sink: W, layout: IncrementLayout) -> io::Result<Self> {
        let has = |column: &Column| match column.name {
            "delivery" => layout.delivery,
            name => CSV_COLUMNS.contains(&name) || layout.gyroscopes && ANGLE_CSV_COLUMNS.contains(&name),
        };
        let columns: Vec<_> = (0..INCREMENT.len()).filter(|index| has(&INCREMENT[*index])).collect();
        let names: Vec<_> = columns.iter().map(|index| INCREMENT[*index].name).collect();
        writeln!(sink, "{}", names.join(","))?;
        Ok(Self { sink, columns, row: Vec::new() })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn write(&mut self, increment: &CompensatedIncrement) -> io::Result<()> {
        let row = &mut self.row;
        row.clear();
        for index in &self.columns {
            append_value(INCREMENT[*index].kind, load_increment(increment, *index), row);
            row.push(b',');
        }
        // Replaces the comma after the last value.
        row.pop();
        row.push(b'\n');
        self.sink.write_all(row)
    }

    /// Flushes the sink.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn flush(&mut self) -> io::Result<()> {
        self.sink.flush()
    }

    /// Flushes the sink and returns it.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn finish(mut self) -> io::Result<W> {
        self.sink.flush()?;
        Ok(self.sink)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_shared::wire::Flags;

    #[test]
    fn increments_are_written_in_their_shortest_form() {
        let increment = CompensatedIncrement {
            sequence: 1,
            timestamp_ns: 2,
            interval_ns: 3,
            velocity_increment: [0.1 + 0.2, f64::NAN, -1e-7],
            angle_increment: [f64::NAN, 2e-7, -0.0],
            table: 0xabc,
            flags: (Flags::not_finite(1) | Flags::not_finite(0).of_gyroscopes() | Flags::GAP).0,
            ..CompensatedIncrement::default()
        };
        let written = |gyroscopes, delivery| {
            let mut writer = IncrementCsvWriter::new(Vec::new(), IncrementLayout { gyroscopes, delivery }).unwrap();
            writer.write(&increment).unwrap();
            String::from_utf8(writer.finish().unwrap()).unwrap()
        };
        assert_eq!(
            written(false, true),
            "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags,delivery\n\
             1,2,3,0.30000000000000004,NaN,-1e-7,0000000000000abc,a2-not-finite|g1-not-finite,gap\n"
        );
        assert_eq!(
            written(true, false),
            "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,g1_da,g2_da,g3_da,table,flags\n\
             1,2,3,0.30000000000000004,NaN,-1e-7,NaN,2e-7,-0.0,0000000000000abc,a2-not-finite|g1-not-finite\n"
        );
    }
}
