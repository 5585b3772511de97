//! Voetsch and Weiss: ASCII-2.
//!
//! `$01I` CR asks for everything: numbers in a fixed order, a blank between two, then the digital outputs as a word of 0 and 1.
//! `$01E 0023.0 0100000000000000` CR sets the nominal values in their order and the outputs.

use super::line::{Framing, Line, Wrong, carriage_return, number, text};
use super::line_config::LineConfig;
use super::{Chamber, ChamberReading, Fault, FaultKind};
use isotherm_shared::document::Section;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Address of the chamber.
    pub address: u8,
    /// Which number of the reply is the nominal temperature, from 0.
    pub nominal: usize,
    /// Which number of the reply is the measured temperature, from 0.
    pub actual: usize,
    /// Which digital output starts the chamber, from 0.
    pub start_bit: usize,
    /// Which digital output says that there is an alarm, from 0.
    pub alarm_bit: Option<usize>,
    /// Nominal values after the temperature's, as the chamber is to have them.
    pub other_values: Vec<f64>,
    /// Whether the chamber answers `$01E`.
    pub acknowledge: bool,
}

impl Settings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let index = |key, most: i64| section.optional_integer(key, 0..=most).map(|index| index as usize);
        let right = "numbers, one for each nominal value after the temperature";
        let others = section.has("other_values").then(|| section.numbers("other_values", right));
        if others.is_none() {
            section.ignore("other_values");
        }
        let settings = Self {
            address: section.optional_integer("address", 0..=99).unwrap_or(1) as u8,
            nominal: index("nominal_field", 63).unwrap_or(0),
            actual: index("actual_field", 63).unwrap_or(1),
            start_bit: index("start_bit", 31).unwrap_or(1),
            alarm_bit: index("alarm_bit", 31),
            other_values: others.flatten().unwrap_or_default(),
            acknowledge: section.optional_bool("acknowledge").unwrap_or(true),
        };
        let same = settings.nominal == settings.actual;
        section.refuse(
            "actual_field",
            same.then(|| "is the nominal temperature's field; give the measured one's".to_owned()),
        );
        settings
    }

    fn reading(&self, reply: &str) -> Option<Reading> {
        let mut fields: Vec<_> = reply.split_ascii_whitespace().collect();
        let bits = fields.pop().filter(|bits| bits.len() >= 8 && bits.bytes().all(|bit| matches!(bit, b'0' | b'1')))?;
        let values = fields.into_iter().map(number).collect::<Option<Vec<_>>>()?;
        let bit = |index| bits.as_bytes().get(index).map(|bit| *bit == b'1');
        let alarm = match self.alarm_bit {
            Some(index) => bit(index)?,
            None => false,
        };
        let (nominal, actual) = (*values.get(self.nominal)?, *values.get(self.actual)?);
        Some(Reading {
            nominal,
            actual,
            running: bit(self.start_bit)?,
            alarm,
            bits: bits.to_owned(),
            values: values.len(),
        })
    }

    /// Sets the temperature and the start bit; the other outputs stay as they are.
    fn writing(&self, celsius: f64, running: bool, bits: &str) -> String {
        let mut request = format!("${:02}E {}", self.address, value(celsius));
        self.other_values.iter().for_each(|other| request = format!("{request} {}", value(*other)));
        let bits = bits.char_indices().map(|(index, bit)| match running {
            _ if index != self.start_bit => bit,
            true => '1',
            false => '0',
        });
        format!("{request} {}\r", bits.collect::<String>())
    }
}

/// Six characters with one decimal, `0023.0` or `-025.0`.
fn value(number: f64) -> String {
    // -0.0 would be -000.0.
    format!("{:06.1}", (number * 10.0).round() / 10.0 + 0.0)
}

/// What `$01I` says.
#[derive(Clone, Debug, PartialEq)]
struct Reading {
    nominal: f64,
    actual: f64,
    running: bool,
    alarm: bool,
    bits: String,
    values: usize,
}

/// The driver.
pub struct Ascii2 {
    line: Line,
    settings: Settings,
}

impl Ascii2 {
    pub(super) fn open(config: &LineConfig, settings: &Settings) -> Result<Self, Fault> {
        Ok(Self { line: Line::open("chamber", config)?, settings: settings.clone() })
    }

    fn reading(&mut self) -> Result<Reading, Fault> {
        let settings = &self.settings;
        let request = format!("${:02}I\r", settings.address);
        self.line.ask(request.as_bytes(), Framing { whole: &carriage_return, gap: None }, |reply| {
            settings.reading(text(reply)?).ok_or_else(|| Wrong::garbled(reply))
        })
    }

    /// Sets and looks whether it is set. What the chamber answers to `$01E` is not documented: only that it is no reading counts.
    fn set(&mut self, celsius: Option<f64>, running: Option<bool>) -> Result<(), Fault> {
        let before = self.reading()?;
        let celsius = celsius.unwrap_or(before.nominal);
        let running = running.unwrap_or(before.running);
        let request = self.settings.writing(celsius, running, &before.bits);
        if self.settings.acknowledge {
            let settings = &self.settings;
            self.line.ask(request.as_bytes(), Framing { whole: &carriage_return, gap: None }, |reply| {
                settings.reading(text(reply)?).map_or(Ok(()), |_| Err(Wrong::garbled(reply)))
            })?;
        } else {
            self.line.tell(request.as_bytes())?;
        }
        let after = self.reading()?;
        if (after.nominal - celsius).abs() < 0.05 + 1e-9 && after.running == running {
            return Ok(());
        }
        let Reading { nominal, running: now, alarm, .. } = after;
        let state = format!("its set point is {nominal} and it is {} after {}", on(now), request.trim_ascii_end());
        Err(self.line.fault(if alarm {
            Wrong(FaultKind::Alarm, format!("alarm; {state}"))
        } else {
            Wrong(FaultKind::Mismatch, state)
        }))
    }
}

const fn on(running: bool) -> &'static str {
    if running { "on" } else { "off" }
}

impl Chamber for Ascii2 {
    /// The protocol's list of fields is free text; their number shows that it is spoken.
    fn identify(&mut self) -> Result<String, Fault> {
        let reading = self.reading()?;
        Ok(format!("ASCII-2, {} values, {} digital outputs", reading.values, reading.bits.len()))
    }

    fn read(&mut self) -> Result<ChamberReading, Fault> {
        let Reading { nominal, actual, running, alarm, .. } = self.reading()?;
        let alarms = if alarm { vec!["alarm output".to_owned()] } else { Vec::new() };
        Ok(ChamberReading { air_c: actual, set_point_c: nominal, running, alarms })
    }

    fn set_point(&mut self, celsius: f64) -> Result<(), Fault> {
        self.set(Some(celsius), None)
    }

    fn run(&mut self) -> Result<(), Fault> {
        self.set(None, Some(true))
    }

    fn standby(&mut self) -> Result<(), Fault> {
        self.set(None, Some(false))
    }

    fn repeated(&self) -> u64 {
        self.line.repeated()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line_config::settings_of;

    fn settings(toml: &str) -> Settings {
        settings_of(toml, Settings::read)
    }

    // The request that ondrejh/VT4002, VT4002.py sends at -25 degC, but for its line feed.
    #[test]
    fn writes_as_a_public_driver() {
        let others = "other_values = [80, 27.5, 0, 27, -191.3, 0, -191.3, 25.5, -191.3]";
        let request = settings(others).writing(-25.0, true, "0011000000000000");
        let expected = "$01E -025.0 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 -191.3 0111000000000000\r";
        assert_eq!(request, expected);
        assert_eq!(settings("").writing(23.04, false, "0111"), "$01E 0023.0 0011\r");
        assert_eq!(value(-0.04), "0000.0");
    }

    #[test]
    fn fields_are_where_the_settings_say() {
        let reply = "0023.0 0022.4 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 0101000000000000";
        let reading = settings("").reading(reply).unwrap();
        assert_eq!((reading.nominal, reading.actual, reading.running), (23.0, 22.4, true));
        let other =
            settings("nominal_field = 1\nactual_field = 0\nstart_bit = 2\nalarm_bit = 3").reading(reply).unwrap();
        assert_eq!((other.nominal, other.actual, other.running, other.alarm), (22.4, 23.0, false, true));
        for wrong in ["0", "", "0023.0 0022.4", "0023.0 01010000", "x 1 01010000", "0023.0 0022.4 0101"] {
            assert_eq!(settings("").reading(wrong), None, "{wrong}");
        }
    }
}
