//! ACUTROL 3000: the ACUTROL Command Language.
//!
//! A request is a line such as `:read:position? 1`, ended by CR LF. The reply to a query is a number or a word, the
//! reply to a command is `OK`. Over TCP a reply has a header of eight bytes and may have no line end, so a pause ends
//! it too.

use super::fault::{FaultKind, InstrumentFault};
use super::instrument::{Instrument, TurntableInstrument, TurntableReading, whole_reading, wrapped_deg};
use super::line::Line;
use super::line_config::{axes, seconds};
use super::reply::{ExchangeError, Framing, angle, line_feed, number, text};
use isotherm_shared::document::Section;
use std::cell::Cell;
use std::time::Duration;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct AcutrolSettings {
    /// Numbers of the outer and the inner axis.
    pub axes: [u8; 2],
    /// Length of the header before each reply \[bytes\].
    pub header: usize,
    /// A pause of this length ends a reply without a line feed.
    pub gap: Option<Duration>,
    /// Decimals of a whole reply without a line feed; 0 for any number, `None` if the first replies show it.
    pub reply_decimals: Option<u8>,
    /// Whether commands are answered.
    pub acknowledge: bool,
    /// Decimals of angles, rates and accelerations.
    pub decimals: usize,
    /// Whether the controller counts angles from 0 to 360 degrees.
    pub wrap: bool,
    /// Whether a stop holds the axes at rate 0 instead of switching them off.
    pub hold: bool,
}

impl AcutrolSettings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let tcp = section.optional_string("port").is_some_and(|port| port.starts_with("tcp://"));
        let gap = seconds(section, "gap_s", if tcp { 0.05 } else { 0.0 }, 10.0);
        Self {
            axes: axes(section),
            header: section.optional_integer("header", 0..=64).unwrap_or(if tcp { 8 } else { 0 }) as usize,
            gap: Some(gap).filter(|gap| !gap.is_zero()),
            reply_decimals: section.optional_integer("reply_decimals", 0..=9).map(|decimals| decimals as u8),
            acknowledge: section.optional_bool("acknowledge").unwrap_or(true),
            decimals: section.optional_integer("decimals", 0..=6).unwrap_or(4) as usize,
            wrap: section.optional_bool("wrap").unwrap_or(false),
            hold: section.optional_choice("stop", &[(false, "off"), (true, "hold")]).unwrap_or(false),
        }
    }
}

/// What a number of the controller is.
#[derive(Clone, Copy)]
enum AxisQuantity {
    Angle,
    Rate,
}

/// A first reply without a line feed has a decimal: its last digit is worth less than this.
const COARSEST: f64 = 0.5;

/// The driver.
pub struct Acutrol {
    line: Line,
    settings: AcutrolSettings,
    /// The finest last digit of the angles \[deg\] and of the rates \[deg/s\] so far.
    last_digits: [f64; 2],
    /// Whether a reply has ended with a line feed: then all do, and a pause ends none.
    ends_lines: bool,
}

impl Acutrol {
    pub(super) fn new(line: Line, settings: &AcutrolSettings) -> Self {
        Self { line, settings: settings.clone(), last_digits: [f64::INFINITY; 2], ends_lines: false }
    }

    fn ask<T>(&mut self, request: &str, read: impl Fn(&str) -> Result<T, ExchangeError>) -> Result<T, InstrumentFault> {
        self.ask_whole(request, |reply, _| read(reply))
    }

    /// Sends a request. `read` gets the reply, and whether a line feed ends it: then it is whole.
    fn ask_whole<T>(
        &mut self,
        request: &str,
        read: impl Fn(&str, bool) -> Result<T, ExchangeError>,
    ) -> Result<T, InstrumentFault> {
        let header = self.settings.header;
        // The header may contain any byte, a line feed too.
        let reply_length = |bytes: &[u8]| line_feed(bytes.get(header..)?).map(|length| header + length);
        let gap = self.settings.gap.filter(|_| !self.ends_lines);
        let framing = Framing { reply_length: &reply_length, gap };
        let ends_lines = Cell::new(self.ends_lines);
        let result = self.line.ask(format!("{request}\r\n").as_bytes(), framing, |reply| {
            let body =
                reply.get(header..).filter(|body| !body.is_empty()).ok_or_else(|| ExchangeError::garbled(reply))?;
            match text(body)? {
                refused if refused.to_ascii_lowercase().starts_with("error") => Err(ExchangeError::refused(refused)),
                text => {
                    let is_whole = body.ends_with(b"\n");
                    let value = read(text, is_whole)?;
                    ends_lines.set(ends_lines.get() || is_whole);
                    Ok(value)
                }
            }
        });
        self.ends_lines = ends_lines.get();
        result
    }

    /// A number, and the value of its last digit. A reply that no line feed ends is distinguished from the beginning of
    /// one by its decimals: it has as many as the one before, at least one.
    fn value(&mut self, request: &str, quantity: AxisQuantity) -> Result<f64, InstrumentFault> {
        if !self.ends_lines
            && self.last_digits[quantity as usize].is_infinite()
            && self.settings.reply_decimals.is_none()
        {
            let first = self.parts(request, COARSEST)?;
            self.last_digits[quantity as usize] = first.1;
            if self.ends_lines {
                return Ok(first.0);
            }
        }
        let known = self.last_digits[quantity as usize];
        let coarsest = match self.settings.reply_decimals {
            Some(0) => f64::INFINITY,
            Some(decimals) => 1.5 * 10_f64.powi(-i32::from(decimals)),
            None => 1.5 * known,
        };
        let (number, last_digit) = self.parts(request, coarsest)?;
        self.last_digits[quantity as usize] = known.min(last_digit);
        Ok(number)
    }

    /// A number whose last digit is worth at most `coarsest`, and the value of that; any last digit if the reply ends
    /// with a line feed.
    fn parts(&mut self, request: &str, coarsest: f64) -> Result<(f64, f64), InstrumentFault> {
        self.ask_whole(request, |reply, is_whole| {
            let found = angle(reply).filter(|(_, last_digit)| is_whole || *last_digit <= coarsest);
            found.ok_or_else(|| {
                let why = "no line feed ends it, and it has fewer decimals than a whole one; see reply_decimals";
                let ExchangeError(kind, message) = ExchangeError::garbled(reply.as_bytes());
                match angle(reply) {
                    Some(_) => ExchangeError(kind, format!("{message}: {why}")),
                    None => ExchangeError(kind, message),
                }
            })
        })
    }

    fn read_once(&mut self) -> Result<TurntableReading, InstrumentFault> {
        let mut reading = TurntableReading::default();
        for (index, axis) in self.settings.axes.into_iter().enumerate() {
            reading.angles_deg[index] = self.value(&format!(":read:position? {axis}"), AxisQuantity::Angle)?;
            reading.rates_deg_s[index] = self.value(&format!(":read:rate? {axis}"), AxisQuantity::Rate)?;
        }
        reading.resolution_deg = self.last_digits[AxisQuantity::Angle as usize];
        [reading.faults, reading.open] = self.interlocks()?;
        Ok(reading)
    }

    fn command(&mut self, request: &str) -> Result<(), InstrumentFault> {
        if !self.settings.acknowledge {
            return self.line.send_without_reply(format!("{request}\r\n").as_bytes());
        }
        self.ask(request, |reply| match reply {
            "OK" => Ok(()),
            // A number is a late reply to an earlier query.
            other if number(other).is_some() => Err(ExchangeError::garbled(other.as_bytes())),
            other => Err(ExchangeError::refused(other)),
        })
    }

    /// State of an axis's interlock, as the controller reports it.
    fn interlock(&mut self, axis: u8) -> Result<String, InstrumentFault> {
        self.ask(&format!(":interlock? {axis}"), |reply| match number(reply) {
            None if reply != "OK" => Ok(reply.to_owned()),
            _ => Err(ExchangeError::garbled(reply.as_bytes())),
        })
    }

    /// Axes whose interlock is at fault, and axes whose interlock is open.
    fn interlocks(&mut self) -> Result<[Vec<String>; 2], InstrumentFault> {
        let mut found = [const { Vec::new() }; 2];
        for axis in self.settings.axes {
            let state = self.interlock(axis)?;
            let lower = state.to_ascii_lowercase();
            if let Some(list) = ["fault", "open"].iter().position(|word| lower.contains(word)) {
                found[list].push(format!("interlock of axis {axis}: {state}"));
            }
        }
        Ok(found)
    }

    fn stop_axis(&mut self, axis: u8) -> Result<(), InstrumentFault> {
        let commands = if self.settings.hold {
            // The demand is set before the mode: an earlier demand would move the axis.
            [format!(":demand:rate {axis},0"), format!(":mode:rate {axis}")]
        } else {
            [format!(":mode:off {axis}"), format!(":interlock:open {axis}")]
        };
        let [first, second] = commands.map(|command| self.command(&command));
        first.and(second)
    }
}

impl Instrument for Acutrol {
    fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    fn identify(&mut self) -> Result<String, InstrumentFault> {
        self.ask("*idn?", |reply| match number(reply) {
            None if reply != "OK" => Ok(reply.to_owned()),
            _ => Err(ExchangeError::garbled(reply.as_bytes())),
        })
    }
}

impl TurntableInstrument for Acutrol {
    fn engage(&mut self) -> Result<(), InstrumentFault> {
        self.command(":utility:lockout on")?;
        for axis in self.settings.axes {
            self.command(&format!(":interlock:reset {axis}"))?;
            self.command(&format!(":interlock:close {axis}"))?;
        }
        let not_closed = self.interlocks()?.concat();
        if not_closed.is_empty() {
            return Ok(());
        }
        Err(self.line.fault(ExchangeError(FaultKind::Alarm, not_closed.join(", "))))
    }

    fn read(&mut self) -> Result<TurntableReading, InstrumentFault> {
        // A late reply shows at the last requests, which have a word as reply.
        whole_reading(self, Self::read_once)
    }

    fn move_to(
        &mut self,
        angles_deg: [f64; 2],
        rate_deg_s: f64,
        acceleration_deg_s2: f64,
    ) -> Result<(), InstrumentFault> {
        let AcutrolSettings { axes, decimals, wrap, .. } = self.settings;
        for (axis, angle) in axes.into_iter().zip(angles_deg) {
            let angle = wrapped_deg(angle, wrap);
            self.command(&format!(":limit:rate pos,{axis},{rate_deg_s:.decimals$}"))?;
            self.command(&format!(":limit:acc pos,{axis},{acceleration_deg_s2:.decimals$}"))?;
            self.command(&format!(":demand:position {axis},{angle:.decimals$}"))?;
        }
        // The modes come last, so that both axes start at nearly the same time.
        for axis in axes {
            self.command(&format!(":mode:position {axis}"))?;
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), InstrumentFault> {
        let [outer, inner] = self.settings.axes.map(|axis| self.stop_axis(axis));
        outer.and(inner)
    }
}
