//! The pulses of counts, and of rates over a gate.

use super::super::columns::{Kind, Sensors};
use super::bad_rows::{Fault, RowRefusal};
use super::marks::Number;
use isotherm_recording::csv::{CsvColumn, Rows};
use isotherm_support::finding::{Finding, name};
use std::io::Read;

/// A number of pulses that is farther from a whole one was not counted.
const WHOLE: f64 = 0.05;
/// Rates that come in parts are not all whole by chance, of so many.
const MANY: u64 = 20;

/// What counts and rates are, and whether the numbers agree with it.
pub(super) struct PulseCounts {
    kind: Kind,
    /// What makes pulses of a number: the gate \[s\] of rates.
    factor: f64,
    /// Numbers that are not 0, those of them that are no whole pulses, and whether all are whole numbers.
    pulses: u64,
    parts: u64,
    all_whole: bool,
}

impl PulseCounts {
    /// Of counts and rates; `None` of other numbers.
    pub(super) fn of(sensors: &Sensors) -> Option<Self> {
        let factor = sensors.gate_s.filter(|_| sensors.kind == Kind::Rate).unwrap_or(1.0);
        let is_it = sensors.kind.is_of_pulses();
        is_it.then_some(Self { kind: sensors.kind, factor, pulses: 0, parts: 0, all_whole: true })
    }

    /// The pulses of a number.
    pub(super) fn pulses(
        &mut self,
        rows: &Rows<Box<dyn Read>>,
        column: &CsvColumn,
        number: Number,
    ) -> Result<i64, RowRefusal> {
        let value = number.value * self.factor;
        let pulses = value.round();
        self.all_whole &= number.is_whole;
        self.pulses += u64::from(pulses != 0.0);
        if (value - pulses).abs() > WHOLE {
            if self.kind == Kind::Count {
                let message = format!(
                    "{} is {}, which is not a count: if the numbers are pulses per second, give kind = \"rate\" and \
                     gate_s, the time that they were counted over; if they are means of a dwell, give the sheet as \
                     means",
                    column.name(),
                    number.value
                );
                return Err(RowRefusal::Text(rows.error(message)));
            }
            self.parts += 1;
        }
        if pulses.abs() <= f64::from(u32::MAX) {
            return Ok(pulses as i64);
        }
        let message = format!("{}: {value} pulses in a row, over {}; give shorter rows", column.name(), u32::MAX);
        Err(RowRefusal::Row(Fault::Range, message))
    }

    /// The pulses of a channel.
    pub(super) fn of_channel(
        &mut self,
        rows: &Rows<Box<dyn Read>>,
        column: &CsvColumn,
        number: Number,
    ) -> Result<i64, RowRefusal> {
        let pulses = self.pulses(rows, column, number)?;
        if pulses >= 0 {
            return Ok(pulses);
        }
        let message = format!(
            "{} is {}, but a channel counts from 0 on; if a column has both signs, give columns in place of \
             positive and negative",
            column.name(),
            number.value
        );
        Err(RowRefusal::Text(rows.error(message)))
    }

    /// That the numbers are not what `kind` says. `section` is that of the mapping. Valid after the last row.
    pub(super) fn finding(&self, section: &str) -> Option<Finding> {
        let gate_s = self.factor;
        if self.kind != Kind::Rate {
            return None;
        }
        let message = if self.all_whole && self.pulses >= MANY && gate_s > 1.0 {
            format!(
                "{section}: all numbers are whole, but rates over {gate_s} s come in steps of {} pulse/s: they \
                 look like counts: give kind = \"count\"; or they were rounded, and lose up to half a pulse/s",
                shown(gate_s.recip())
            )
        } else if 2 * self.parts > self.pulses {
            format!(
                "{section}: most rates times gate_s = {gate_s} are not whole numbers of pulses: give the time that \
                 the pulses were counted over, or more digits; what is rounded is up to half a pulse a row"
            )
        } else {
            return None;
        };
        Some(Finding::warning(name::COUNTS_OR_RATES, message))
    }
}

/// A number to four digits.
fn shown(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}
