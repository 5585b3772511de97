//! Increments in CSV.

use crate::columns::INCREMENT;
use isotherm_shared::wire::{CompensatedIncrement, Flags};
use std::io::{self, Write};

/// Columns of the increments that `feed` and `replay` write. A column `delivery` may follow.
pub const CSV_COLUMNS: [&str; 8] = {
    let [_, _, sequence, timestamp, interval, a1, a2, a3, table, flags, ..] = INCREMENT;
    [sequence.name, timestamp.name, interval.name, a1.name, a2.name, a3.name, table.name, flags.name]
};

/// Writes increments as CSV. Floats have the shortest form that reads back as the same double.
pub struct IncrementCsvWriter<W> {
    sink: W,
    delivery: bool,
}

impl<W: Write> IncrementCsvWriter<W> {
    /// Writes the header row; with `delivery`, the last column has the delivery flags.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn new(mut sink: W, delivery: bool) -> io::Result<Self> {
        let last = if delivery { ",delivery" } else { "" };
        writeln!(sink, "{}{last}", CSV_COLUMNS.join(","))?;
        Ok(Self { sink, delivery })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn write(&mut self, increment: &CompensatedIncrement) -> io::Result<()> {
        let CompensatedIncrement { sequence, timestamp_ns, interval_ns, table, .. } = increment;
        let [a1, a2, a3] = increment.velocity_increment;
        let flags = Flags(increment.flags);
        let sample = flags.only(Flags::SAMPLE);
        write!(self.sink, "{sequence},{timestamp_ns},{interval_ns},{a1:?},{a2:?},{a3:?},{table:016x},{sample}")?;
        if self.delivery {
            write!(self.sink, ",{}", flags.only(Flags::DELIVERY))?;
        }
        self.sink.write_all(b"\n")
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

    #[test]
    fn increments_are_written_in_their_shortest_form() {
        let mut writer = IncrementCsvWriter::new(Vec::new(), true).unwrap();
        let increment = CompensatedIncrement {
            sequence: 1,
            timestamp_ns: 2,
            interval_ns: 3,
            velocity_increment: [0.1 + 0.2, f64::NAN, -1e-7],
            table: 0xabc,
            flags: (Flags::not_finite(1) | Flags::GAP).0,
            ..CompensatedIncrement::default()
        };
        writer.write(&increment).unwrap();
        assert_eq!(
            String::from_utf8(writer.finish().unwrap()).unwrap(),
            "sequence,timestamp_ns,interval_ns,a1_dv,a2_dv,a3_dv,table,flags,delivery\n\
             1,2,3,0.30000000000000004,NaN,-1e-7,0000000000000abc,a2-not-finite,gap\n"
        );
    }
}
