//! Ideal Aerosmith: the Aerosmith Table Language.
//!
//! A request is a command of three letters with its argument, `MOV90.000`, ended by CR LF. For a table with two axes it
//! also contains the number of the axis; `form` defines where. A reply is a line, which may be empty, and a line with
//! the prompt.

use super::fault::{FaultKind, InstrumentFault};
use super::instrument::{Instrument, TurntableInstrument, TurntableReading, whole_reading, wrapped_deg};
use super::line::Line;
use super::line_config::axes;
use super::reply::{ExchangeError, Framing, angle, number, text};
use isotherm_shared::document::Section;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct AerosmithSettings {
    /// Numbers of the outer and the inner axis.
    pub axes: [u8; 2],
    /// Template of a request with `{axis}`, `{command}` and `{value}`.
    pub form: String,
    /// The command that moves to an angle.
    pub move_command: String,
    /// A command that powers an axis; empty for none.
    pub engage: String,
    /// Number of lines of a reply, including the line of the prompt.
    pub reply_lines: usize,
    /// Decimals of angles, rates and accelerations.
    pub decimals: usize,
    /// Whether the controller counts angles from 0 to 360 degrees.
    pub wrap: bool,
    /// Bits of `STA` that mean a fault; 0 for none.
    pub fault_mask: u32,
}

impl AerosmithSettings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let string = |key, default: &str| section.optional_string(key).unwrap_or(default).to_owned();
        let form = string("form", "{axis}{command}{value}");
        let valid = ["{axis}", "{command}", "{value}"].iter().all(|part| form.matches(part).count() == 1);
        section.refuse(
            "form",
            (!valid).then(|| format!("is {form:?}, give {{axis}}, {{command}} and {{value}} once each")),
        );
        Self {
            axes: axes(section),
            form,
            move_command: string("move", "MOV"),
            engage: string("engage", ""),
            reply_lines: section.optional_integer("reply_lines", 1..=4).unwrap_or(2) as usize,
            decimals: section.optional_integer("decimals", 0..=6).unwrap_or(3) as usize,
            wrap: section.optional_bool("wrap").unwrap_or(false),
            fault_mask: section.optional_integer("fault_mask", 0..=i64::from(u32::MAX)).unwrap_or(0) as u32,
        }
    }

    fn request(&self, axis: u8, command: &str, value: &str) -> String {
        self.form.replace("{axis}", &axis.to_string()).replace("{command}", command).replace("{value}", value) + "\r\n"
    }
}

/// Length of the first `lines` lines of a reply, up to the carriage return of the last one; `None` while they are
/// incomplete.
fn reply_length(lines: usize, bytes: &[u8]) -> Option<usize> {
    bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\r').nth(lines - 1).map(|(end, _)| end + 1)
}

/// The driver.
pub struct Aerosmith {
    line: Line,
    settings: AerosmithSettings,
    /// The finest last digit of the angles so far \[deg\].
    resolution_deg: f64,
}

impl Aerosmith {
    pub(super) fn new(line: Line, settings: &AerosmithSettings) -> Self {
        Self { line, settings: settings.clone(), resolution_deg: f64::INFINITY }
    }

    fn ask<T>(
        &mut self,
        axis: u8,
        command: &str,
        value: &str,
        read: impl Fn(&str) -> Option<T>,
    ) -> Result<T, InstrumentFault> {
        let lines = self.settings.reply_lines;
        let reply_length = |bytes: &[u8]| reply_length(lines, bytes);
        let framing = Framing { reply_length: &reply_length, gap: None };
        self.line.ask(self.settings.request(axis, command, value).as_bytes(), framing, |reply| {
            let first = &reply[..reply.iter().position(|&byte| byte == b'\r').unwrap_or(reply.len())];
            text(reply)?;
            read(text(first)?).ok_or_else(|| ExchangeError::garbled(reply))
        })
    }

    /// Sends a command. Public drivers do not evaluate the reply to a command; a number is a late reply to an earlier
    /// query.
    fn command(&mut self, axis: u8, command: &str, value: &str) -> Result<(), InstrumentFault> {
        self.ask(axis, command, value, |reply| number(reply).is_none().then_some(()))
    }

    fn read_once(&mut self) -> Result<TurntableReading, InstrumentFault> {
        let mut reading = TurntableReading::default();
        for (index, axis) in self.settings.axes.into_iter().enumerate() {
            let (angle_deg, last_digit) = self.ask(axis, "PPO", "", angle)?;
            self.resolution_deg = self.resolution_deg.min(last_digit);
            reading.angles_deg[index] = angle_deg;
            reading.rates_deg_s[index] = self.ask(axis, "PVE", "", number)?;
        }
        reading.resolution_deg = self.resolution_deg;
        reading.faults = self.faults()?;
        Ok(reading)
    }

    fn faults(&mut self) -> Result<Vec<String>, InstrumentFault> {
        let mut faults = Vec::new();
        for axis in self.settings.axes {
            let status = self.ask(axis, "STA", "", |reply| reply.parse::<u32>().ok())?;
            if status & self.settings.fault_mask != 0 {
                faults.push(format!("axis {axis}: status {status}"));
            }
        }
        Ok(faults)
    }
}

impl Instrument for Aerosmith {
    fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    /// The protocol has no identification command. Reading the status of both axes shows that a controller of this
    /// protocol answers.
    fn identify(&mut self) -> Result<String, InstrumentFault> {
        let [outer, inner] = self.settings.axes;
        self.faults()?;
        Ok(format!("Aerosmith Table Language, axes {outer} and {inner}"))
    }
}

impl TurntableInstrument for Aerosmith {
    fn engage(&mut self) -> Result<(), InstrumentFault> {
        let command = self.settings.engage.clone();
        for axis in self.settings.axes.into_iter().filter(|_| !command.is_empty()) {
            self.command(axis, &command, "")?;
        }
        let faults = self.faults()?;
        if faults.is_empty() {
            return Ok(());
        }
        Err(self.line.fault(ExchangeError(FaultKind::Alarm, faults.join(", "))))
    }

    fn read(&mut self) -> Result<TurntableReading, InstrumentFault> {
        // A late reply shows at the last requests, which have an integer as reply.
        whole_reading(self, Self::read_once)
    }

    fn move_to(
        &mut self,
        angles_deg: [f64; 2],
        rate_deg_s: f64,
        acceleration_deg_s2: f64,
    ) -> Result<(), InstrumentFault> {
        let AerosmithSettings { axes, decimals, wrap, .. } = self.settings;
        let value = |number: f64| format!("{number:.decimals$}");
        for axis in axes {
            self.command(axis, "VEL", &value(rate_deg_s))?;
            self.command(axis, "ACL", &value(acceleration_deg_s2))?;
        }
        let command = self.settings.move_command.clone();
        for (axis, angle) in axes.into_iter().zip(angles_deg) {
            self.command(axis, &command, &value(wrapped_deg(angle, wrap)))?;
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), InstrumentFault> {
        let [outer, inner] = self.settings.axes.map(|axis| self.command(axis, "STO", ""));
        outer.and(inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line_config::settings_of;

    fn settings(toml: &str) -> AerosmithSettings {
        settings_of(toml, AerosmithSettings::read)
    }

    #[test]
    fn the_axis_stands_where_the_form_says() {
        assert_eq!(settings("").request(2, "MOV", "90.000"), "2MOV90.000\r\n");
        assert_eq!(settings("form = \"{command}{axis},{value}\"").request(1, "VEL", "5"), "VEL1,5\r\n");
    }

    // actigraph/RateTableSweepGUI, RateSweepGUI.py reads these two lines after each request.
    #[test]
    fn a_reply_is_a_line_and_the_prompt() {
        assert_eq!(reply_length(2, b"12.5\r\n>\r\n"), Some(8));
        assert_eq!(reply_length(2, b"12.5\r\n>"), None);
        assert_eq!(reply_length(2, b"\r\n>\r"), Some(4));
    }
}
