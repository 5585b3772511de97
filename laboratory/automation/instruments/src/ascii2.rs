//! Voetsch and Weiss: ASCII-2.
//!
//! `$01I` CR reads everything: the reply has the values in a fixed order, separated by blanks, then the digital outputs
//! as a word of 0 and 1. `$01E 0023.0 0100000000000000` CR sets the nominal values, in their order, and the digital
//! outputs.

use super::fault::{FaultKind, InstrumentFault};
use super::instrument::{ChamberInstrument, ChamberReading, Instrument};
use super::line::Line;
use super::reply::{ExchangeError, Framing, carriage_return, number, text};
use isotherm_shared::document::Section;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Ascii2Settings {
    /// Address of the chamber.
    pub address: u8,
    /// Index of the nominal temperature in the reply, from 0.
    pub nominal: usize,
    /// Index of the measured temperature in the reply, from 0.
    pub actual: usize,
    /// Index of the digital output that starts the chamber, from 0.
    pub start_bit: usize,
    /// Index of the digital output that signals an alarm, from 0.
    pub alarm_bit: Option<usize>,
    /// Nominal values that are sent after the temperature's.
    pub other_values: Vec<f64>,
    /// Whether the chamber answers `$01E`.
    pub acknowledge: bool,
}

impl Ascii2Settings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let index = |key, limit: i64| section.optional_integer(key, 0..=limit).map(|index| index as usize);
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
        section.fault_if(same, "actual_field", "is the nominal temperature's field; give the measured one's");
        settings
    }

    fn parse_reading(&self, reply: &str) -> Option<Ascii2Reading> {
        let mut fields: Vec<_> = reply.split_ascii_whitespace().collect();
        let bits = fields.pop().filter(|bits| bits.len() >= 8 && bits.bytes().all(|bit| matches!(bit, b'0' | b'1')))?;
        let values = fields.into_iter().map(number).collect::<Option<Vec<_>>>()?;
        let bit = |index| bits.as_bytes().get(index).map(|bit| *bit == b'1');
        let alarm = match self.alarm_bit {
            Some(index) => bit(index)?,
            None => false,
        };
        // An order may write back a nominal temperature that came with foreign bytes.
        let nominal = values.get(self.nominal).copied().filter(|nominal| nominal.abs() < 1000.0)?;
        let actual = *values.get(self.actual)?;
        Some(Ascii2Reading {
            nominal,
            actual,
            running: bit(self.start_bit)?,
            alarm,
            bits: bits.to_owned(),
            values: values.len(),
        })
    }

    /// The request that sets the temperature and the start bit. The other outputs keep their values `bits`.
    fn write_request(&self, celsius: f64, running: bool, bits: &str) -> String {
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

/// A value in six characters with one decimal, `0023.0` or `-025.0`.
fn value(number: f64) -> String {
    // Adding 0 turns -0.0, which would be written as -000.0, into 0.0.
    format!("{:06.1}", (number * 10.0).round() / 10.0 + 0.0)
}

/// The content of a reply to `$01I`.
#[derive(Clone, Debug, PartialEq)]
struct Ascii2Reading {
    nominal: f64,
    actual: f64,
    running: bool,
    alarm: bool,
    bits: String,
    /// Number of values.
    values: usize,
}

/// The driver.
pub struct Ascii2 {
    line: Line,
    settings: Ascii2Settings,
    /// The last reading. A command sets every output, and an order of the safe state does not wait for another reading.
    last: Option<Ascii2Reading>,
}

impl Ascii2 {
    pub(super) fn new(line: Line, settings: &Ascii2Settings) -> Self {
        Self { line, settings: settings.clone(), last: None }
    }

    fn reading(&mut self) -> Result<Ascii2Reading, InstrumentFault> {
        let settings = &self.settings;
        let request = format!("${:02}I\r", settings.address);
        let reading =
            self.line.ask(request.as_bytes(), Framing { reply_length: &carriage_return, gap: None }, |reply| {
                settings.parse_reading(text(reply)?).ok_or_else(|| ExchangeError::garbled(reply))
            })?;
        self.last = Some(reading.clone());
        Ok(reading)
    }

    /// Sets temperature and running state and reads them back; `None` keeps a value. The reply to `$01E` is not
    /// documented: any reply that is not a reading is accepted.
    fn set(&mut self, celsius: Option<f64>, running: Option<bool>) -> Result<(), InstrumentFault> {
        let before = match self.last.clone().filter(|_| self.line.has_orders()) {
            Some(last) => last,
            None => self.reading()?,
        };
        let celsius = celsius.unwrap_or(before.nominal);
        let running = running.unwrap_or(before.running);
        let request = self.settings.write_request(celsius, running, &before.bits);
        // No later order may start a chamber that was ordered to stop, even if it is not read in between.
        if let Some(last) = &mut self.last {
            last.running &= running;
        }
        if self.settings.acknowledge {
            let settings = &self.settings;
            self.line.ask(request.as_bytes(), Framing { reply_length: &carriage_return, gap: None }, |reply| {
                settings.parse_reading(text(reply)?).map_or(Ok(()), |_| Err(ExchangeError::garbled(reply)))
            })?;
        } else {
            self.line.send_without_reply(request.as_bytes())?;
        }
        let after = self.reading()?;
        if (after.nominal - celsius).abs() < 0.05 + 1e-9 && after.running == running {
            return Ok(());
        }
        let Ascii2Reading { nominal, running: now, alarm, .. } = after;
        let state = format!("its set point is {nominal} and it is {} after {}", on(now), request.trim_ascii_end());
        Err(self.line.fault(if alarm {
            ExchangeError(FaultKind::Alarm, format!("alarm; {state}"))
        } else {
            ExchangeError(FaultKind::Mismatch, state)
        }))
    }
}

const fn on(running: bool) -> &'static str {
    if running { "on" } else { "off" }
}

impl Instrument for Ascii2 {
    fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    /// The protocol's list of fields is free text, so the number of values and outputs identifies the chamber.
    fn identify(&mut self) -> Result<String, InstrumentFault> {
        let reading = self.reading()?;
        Ok(format!("ASCII-2, {} values, {} digital outputs", reading.values, reading.bits.len()))
    }
}

impl ChamberInstrument for Ascii2 {
    fn read(&mut self) -> Result<ChamberReading, InstrumentFault> {
        let Ascii2Reading { nominal, actual, running, alarm, .. } = self.reading()?;
        let alarms = if alarm { vec!["alarm output".to_owned()] } else { Vec::new() };
        Ok(ChamberReading { air_c: actual, set_point_c: nominal, running, other_mode: None, alarms })
    }

    fn set_point(&mut self, celsius: f64) -> Result<(), InstrumentFault> {
        self.set(Some(celsius), None)
    }

    fn run(&mut self) -> Result<(), InstrumentFault> {
        self.set(None, Some(true))
    }

    fn standby(&mut self) -> Result<(), InstrumentFault> {
        self.set(None, Some(false))
    }
}

#[cfg(test)]
mod tests {
    use super::super::surroundings::Surroundings;
    use super::super::time::{RealTime, Time as _};
    use super::*;
    use crate::line_config::{LineConfig, settings_of};
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::net::TcpListener;
    use std::thread;
    use std::time::Duration;

    fn settings(toml: &str) -> Ascii2Settings {
        settings_of(toml, Ascii2Settings::read)
    }

    #[test]
    fn an_order_starts_no_chamber_that_was_told_to_stop() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap();
        let peer = thread::spawn(move || {
            let mut stream = BufReader::new(listener.accept().unwrap().0);
            let mut request = || {
                let mut request = Vec::new();
                stream.read_until(b'\r', &mut request).unwrap();
                if request == b"$01I\r" {
                    stream.get_mut().write_all(b"0023.0 0022.4 01000000\r").unwrap();
                }
                String::from_utf8(request).unwrap()
            };
            [request(), request(), request(), request()]
        });
        let keys = format!("port = \"tcp://{port}\"\ntimeout_s = 20\nquiet_s = 0\nretries = 0\n");
        let config = settings_of(&keys, |section| LineConfig::read(section, 9600, 0.0)).unwrap();
        let mut chamber = Ascii2::new(Line::new("chamber", &config, &Surroundings::default()), &settings(""));
        assert!(chamber.read().unwrap().running);
        // The orders are not acknowledged.
        chamber.line.begin_orders(RealTime.now() + Duration::from_secs(20));
        chamber.set_point(20.0).unwrap_err();
        chamber.standby().unwrap_err();
        chamber.set_point(20.0).unwrap_err();
        let expected = ["$01I\r", "$01E 0020.0 01000000\r", "$01E 0023.0 00000000\r", "$01E 0020.0 00000000\r"];
        assert_eq!(peer.join().unwrap(), expected);
    }

    // The request that ondrejh/VT4002, VT4002.py sends for -25 degC, without its line feed.
    #[test]
    fn writes_as_a_public_driver() {
        let others = "other_values = [80, 27.5, 0, 27, -191.3, 0, -191.3, 25.5, -191.3]";
        let request = settings(others).write_request(-25.0, true, "0011000000000000");
        let expected = "$01E -025.0 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 -191.3 0111000000000000\r";
        assert_eq!(request, expected);
        assert_eq!(settings("").write_request(23.04, false, "0111"), "$01E 0023.0 0011\r");
        assert_eq!(value(-0.04), "0000.0");
    }

    #[test]
    fn fields_are_where_the_settings_say() {
        let reply = "0023.0 0022.4 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 0101000000000000";
        let reading = settings("").parse_reading(reply).unwrap();
        assert_eq!((reading.nominal, reading.actual, reading.running), (23.0, 22.4, true));
        let other =
            settings("nominal_field = 1\nactual_field = 0\nstart_bit = 2\nalarm_bit = 3").parse_reading(reply).unwrap();
        assert_eq!((other.nominal, other.actual, other.running, other.alarm), (22.4, 23.0, false, true));
        for wrong in [
            "0",
            "",
            "0023.0 0022.4",
            "0023.0 01010000",
            "x 1 01010000",
            "0023.0 0022.4 0101",
            "27180023.0 0022.4 01010000",
        ] {
            assert_eq!(settings("").parse_reading(wrong), None, "{wrong}");
        }
    }
}
