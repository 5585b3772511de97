//! ACUTROL 3000: the ACUTROL Command Language.
//!
//! A request is `:read:position? 1`, ended by CR LF. A reply is a number or a word, to a command `OK`. Over TCP eight bytes stand in
//! front of each reply and nothing need stand behind it, so that there a pause ends it too.

use super::line::{Framing, Line, Wrong, line_feed, number, text};
use super::line_config::{LineConfig, axes, seconds};
use super::{Fault, FaultKind, Turntable, TurntableReading};
use isotherm_shared::document::Section;
use std::time::Duration;

/// Keys of this driver.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Numbers of the outer and the inner axis.
    pub axes: [u8; 2],
    /// Bytes in front of a reply.
    pub header: usize,
    /// A pause that ends a reply without a line feed.
    pub gap: Option<Duration>,
    /// Whether commands are answered.
    pub acknowledge: bool,
    /// Decimals of angles, rates and accelerations.
    pub decimals: usize,
    /// Whether angles are sent as 0 to 360 degrees.
    pub wrap: bool,
    /// Whether `stop` holds the axes with rate 0 instead of switching them off.
    pub hold: bool,
}

impl Settings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        let tcp = section.optional_string("port").is_some_and(|port| port.starts_with("tcp://"));
        let gap = seconds(section, "gap_s", if tcp { 0.05 } else { 0.0 }, 10.0);
        Self {
            axes: axes(section),
            header: section.optional_integer("header", 0..=64).unwrap_or(if tcp { 8 } else { 0 }) as usize,
            gap: Some(gap).filter(|gap| !gap.is_zero()),
            acknowledge: section.optional_bool("acknowledge").unwrap_or(true),
            decimals: section.optional_integer("decimals", 0..=6).unwrap_or(4) as usize,
            wrap: section.optional_bool("wrap").unwrap_or(false),
            hold: section.optional_choice("stop", &[(false, "off"), (true, "hold")]).unwrap_or(false),
        }
    }
}

/// The driver.
pub struct Acutrol {
    line: Line,
    settings: Settings,
}

impl Acutrol {
    pub(super) fn open(config: &LineConfig, settings: &Settings) -> Result<Self, Fault> {
        Ok(Self { line: Line::open("table", config)?, settings: settings.clone() })
    }

    fn ask<T>(&mut self, request: &str, read: impl Fn(&str) -> Result<T, Wrong>) -> Result<T, Fault> {
        let header = self.settings.header;
        // The header may hold any byte.
        let whole = |bytes: &[u8]| line_feed(bytes.get(header..)?).map(|length| header + length);
        let framing = Framing { whole: &whole, gap: self.settings.gap };
        self.line.ask(format!("{request}\r\n").as_bytes(), framing, |reply| {
            let body = reply.get(header..).filter(|body| !body.is_empty()).ok_or_else(|| Wrong::garbled(reply))?;
            match text(body)? {
                refused if refused.to_ascii_lowercase().starts_with("error") => {
                    Err(Wrong(FaultKind::Refused, format!("refused, \"{refused}\"")))
                }
                reply => read(reply),
            }
        })
    }

    fn number(&mut self, request: &str) -> Result<f64, Fault> {
        self.ask(request, |reply| number(reply).ok_or_else(|| Wrong::garbled(reply.as_bytes())))
    }

    fn command(&mut self, request: &str) -> Result<(), Fault> {
        if !self.settings.acknowledge {
            return self.line.tell(format!("{request}\r\n").as_bytes());
        }
        self.ask(request, |reply| match reply {
            "OK" => Ok(()),
            // A reading is an earlier request's.
            other if number(other).is_some() => Err(Wrong::garbled(other.as_bytes())),
            other => Err(Wrong(FaultKind::Refused, format!("refused, \"{other}\""))),
        })
    }

    /// State of an axis's interlock, as the controller names it.
    fn interlock(&mut self, axis: u8) -> Result<String, Fault> {
        self.ask(&format!(":interlock? {axis}"), |reply| match number(reply) {
            None if reply != "OK" => Ok(reply.to_owned()),
            _ => Err(Wrong::garbled(reply.as_bytes())),
        })
    }

    /// Axes whose interlock is at fault, and axes whose interlock is open.
    fn interlocks(&mut self) -> Result<[Vec<String>; 2], Fault> {
        let mut found = [const { Vec::new() }; 2];
        for axis in self.settings.axes {
            let state = self.interlock(axis)?;
            let said = state.to_ascii_lowercase();
            if let Some(list) = ["fault", "open"].iter().position(|word| said.contains(word)) {
                found[list].push(format!("interlock of axis {axis}: {state}"));
            }
        }
        Ok(found)
    }

    fn stop_axis(&mut self, axis: u8) -> Result<(), Fault> {
        let commands = if self.settings.hold {
            // The demand first: an earlier one would move the axis.
            [format!(":demand:rate {axis},0"), format!(":mode:rate {axis}")]
        } else {
            [format!(":mode:off {axis}"), format!(":interlock:open {axis}")]
        };
        let [first, second] = commands.map(|command| self.command(&command));
        first.and(second)
    }
}

impl Turntable for Acutrol {
    fn identify(&mut self) -> Result<String, Fault> {
        self.ask("*idn?", |reply| match number(reply) {
            None if reply != "OK" => Ok(reply.to_owned()),
            _ => Err(Wrong::garbled(reply.as_bytes())),
        })
    }

    fn engage(&mut self) -> Result<(), Fault> {
        self.command(":utility:lockout on")?;
        for axis in self.settings.axes {
            self.command(&format!(":interlock:reset {axis}"))?;
            self.command(&format!(":interlock:close {axis}"))?;
        }
        let wrong = self.interlocks()?.concat();
        if wrong.is_empty() {
            return Ok(());
        }
        Err(self.line.fault(Wrong(FaultKind::Alarm, wrong.join(", "))))
    }

    fn read(&mut self) -> Result<TurntableReading, Fault> {
        let mut reading = TurntableReading::default();
        for (index, axis) in self.settings.axes.into_iter().enumerate() {
            reading.angles_deg[index] = self.number(&format!(":read:position? {axis}"))?;
            reading.rates_deg_s[index] = self.number(&format!(":read:rate? {axis}"))?;
        }
        [reading.faults, reading.open] = self.interlocks()?;
        Ok(reading)
    }

    fn move_to(&mut self, angles_deg: [f64; 2], rate_deg_s: f64, acceleration_deg_s2: f64) -> Result<(), Fault> {
        let Settings { axes, decimals, wrap, .. } = self.settings;
        for (axis, angle) in axes.into_iter().zip(angles_deg) {
            let angle = if wrap { angle.rem_euclid(360.0) } else { angle };
            self.command(&format!(":limit:rate pos,{axis},{rate_deg_s:.decimals$}"))?;
            self.command(&format!(":limit:acc pos,{axis},{acceleration_deg_s2:.decimals$}"))?;
            self.command(&format!(":demand:position {axis},{angle:.decimals$}"))?;
        }
        // Both axes start together, as nearly as the line allows.
        for axis in axes {
            self.command(&format!(":mode:position {axis}"))?;
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), Fault> {
        let [outer, inner] = self.settings.axes.map(|axis| self.stop_axis(axis));
        outer.and(inner)
    }

    fn repeated(&self) -> u64 {
        self.line.repeated()
    }
}
