//! The temperature of a text for which a mapping is proposed.

use super::super::found::shown;
use super::super::unit::{self, Quantity};
use super::{ProposalText, commented, line};
use isotherm_shared::wire::AXES;

/// Temperatures of an IMU \[degC\].
pub(in crate::convert) const CELSIUS: std::ops::RangeInclusive<f64> = -60.0..=150.0;

impl ProposalText<'_> {
    /// Writes the section of the temperature. Columns that are taken are none of it.
    pub(super) fn temperature(&self, out: &mut String, taken: &[usize], has_gyroscope: bool) {
        out.push_str("[temperature]\n");
        let is_temperature = |index: &usize| {
            let column = &self.columns[*index];
            !taken.contains(index) && column.heading.is_temperature() && column.is_numeric()
        };
        let all: Vec<_> = (0..self.columns.len()).filter(is_temperature).collect();
        let own: Vec<_> = all.iter().copied().filter(|index| !self.columns[*index].heading.is_of_another()).collect();
        let temperatures = if own.is_empty() { all } else { own };
        let of = |quantity| {
            let mut own = temperatures.iter().filter(|index| self.columns[**index].heading.is_of(quantity));
            own.next().copied().filter(|_| own.next().is_none())
        };
        let is_right = [1, 3].contains(&temperatures.len()) || temperatures.len() == 6 && has_gyroscope;
        let columns = match (of(Quantity::Acceleration), of(Quantity::Rate), &temperatures[..]) {
            (Some(a), Some(g), [_, _]) if has_gyroscope => vec![a, a, a, g, g, g],
            (.., all) if is_right => all.to_vec(),
            (.., [first, ..]) => vec![*first],
            (.., []) => {
                let why = "a placeholder, in the unit of the table; or columns = [..], 1, 3 or 6";
                commented(out, format_args!("constant = 25.0"), why);
                return;
            }
        };
        let is_all = is_right || columns.len() == 2 * AXES;
        let why = if is_all { String::new() } else { format!("or 1, 3 or 6 of {}", self.names(&temperatures)) };
        commented(out, format_args!("columns = {}", self.names(&columns)), &why);
        self.thermal(out, columns[0]);
    }

    /// Writes what makes degrees Celsius of the numbers of a temperature, if they are none.
    fn thermal(&self, out: &mut String, index: usize) {
        let column = &self.columns[index];
        if let Some(unit) = unit::of_temperature(&column.heading.name) {
            if unit.linear.scale != 1.0 || unit.linear.offset != 0.0 {
                let why = format!("degC = scale * number + offset, of {} as the header says", unit.name);
                commented(out, format_args!("scale = {}", unit.linear.scale), &why);
                line(out, format_args!("offset = {}", unit.linear.offset));
            }
            return;
        }
        let Some(median) = column.median().filter(|median| !CELSIUS.contains(median)) else { return };
        let likely = match column.is_whole {
            true => "counts, or thousandths of a degree (scale = 0.001, offset = 0)",
            false => "no degrees Celsius; of kelvin scale = 1, offset = -273.15",
        };
        let why = format!("degC = scale * number + offset; the numbers are about {}: {likely}", shown(median));
        commented(out, format_args!("scale = \"?\""), &why);
        let why = "an MPU-6050 has scale = 0.00294117647, offset = 36.53; see docs/your-data.md";
        commented(out, format_args!("offset = \"?\""), why);
    }
}
