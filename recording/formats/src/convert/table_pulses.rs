//! The pulses of readings for the nominal interval of a table.

use isotherm_recording::foreign::ForeignRow;
use isotherm_shared::table::PulseScale;
use isotherm_shared::wire::AXES;

/// The table that samples are for, and what rounding has left of their pulses.
#[derive(Debug)]
pub(super) struct TablePulses {
    pub table: Option<PulseScale>,
    /// The nominal interval of the data \[ns\].
    nominal_ns: u64,
    /// \[pulse\].
    remainders: [f64; 2 * AXES],
}

impl TablePulses {
    pub(super) const fn new(table: Option<PulseScale>, nominal_ns: u64) -> Self {
        Self { table, nominal_ns, remainders: [0.0; 2 * AXES] }
    }

    /// Forgets what rounding has left.
    pub(super) const fn reset(&mut self) {
        self.remainders = [0.0; 2 * AXES];
    }

    /// The interval that pulses are of \[ns\]: that of a table for readings, if it has one; otherwise that of the data.
    pub(super) fn interval_ns(&self, are_readings: bool) -> u64 {
        let of_table = self.table.map(|table| table.nominal_ns).filter(|nominal_ns| are_readings && *nominal_ns != 0);
        of_table.unwrap_or(self.nominal_ns)
    }

    /// The row with the pulses of the table. Where its interval is that of the data, they stay as they are.
    pub(super) fn of_table(&mut self, row: &ForeignRow, are_readings: [bool; 2]) -> ForeignRow {
        let mut of_table = *row;
        for index in 0..2 * AXES {
            let interval_ns = self.interval_ns(are_readings[index / AXES]);
            if interval_ns != self.nominal_ns {
                let whole =
                    (row.pulses[index] as f64 + row.rest[index]) * (self.nominal_ns as f64 / interval_ns as f64);
                let sum = whole + self.remainders[index];
                of_table.pulses[index] = sum.round() as i64;
                self.remainders[index] = sum - sum.round();
            }
        }
        of_table
    }
}
