//! ESPEC P-300 and SCP-220: lines of ASCII.
//!
//! A request is a line such as `TEMP?`; on RS-485 the address comes first, `1,TEMP?`. The reply to a query is a line of
//! values, `23.0,25.0,100.0,-50.0`. The reply to a command is `OK:..` if the chamber accepts it and `NA:PARA ERR` (or
//! another reason) if it refuses it. All lines end with CR LF.

use super::fault::{FaultKind, InstrumentFault};
use super::instrument::{ChamberInstrument, ChamberReading, Instrument};
use super::line::Line;
use super::reply::{ExchangeError, Framing, line_feed, number, text};
use isotherm_shared::document::Section;

/// Keys of this driver.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EspecSettings {
    /// Address on RS-485; none on RS-232.
    pub address: Option<u8>,
    /// Decimals of a set point.
    pub decimals: usize,
    /// Whether `POWER,ON` is sent before `MODE,CONSTANT`.
    pub power_on: bool,
}

impl EspecSettings {
    pub(super) fn read(section: &Section<'_, '_>) -> Self {
        Self {
            address: section.optional_integer("address", 1..=32).map(|address| address as u8),
            decimals: section.optional_integer("decimals", 1..=2).unwrap_or(1) as usize,
            power_on: section.optional_bool("power_on").unwrap_or(false),
        }
    }
}

/// The driver.
pub struct Espec {
    line: Line,
    settings: EspecSettings,
}

impl Espec {
    pub(super) fn new(line: Line, settings: &EspecSettings) -> Self {
        Self { line, settings: settings.clone() }
    }

    /// Sends a request and parses the reply with `read`.
    fn ask<T>(&mut self, request: &str, read: impl Fn(&str) -> Option<T>) -> Result<T, InstrumentFault> {
        let address = self.settings.address.map_or_else(String::new, |address| format!("{address},"));
        let framing = Framing { reply_length: &line_feed, gap: None };
        self.line.ask(format!("{address}{request}\r\n").as_bytes(), framing, |reply| {
            let text = text(reply)?;
            match text.strip_prefix("NA:") {
                Some(reason) => Err(ExchangeError::refused(reason)),
                None => read(text).ok_or_else(|| ExchangeError::garbled(reply)),
            }
        })
    }

    fn command(&mut self, request: &str) -> Result<(), InstrumentFault> {
        self.ask(request, |reply| reply.starts_with("OK").then_some(()))
    }

    /// Commands a mode and checks that the mode is then one of `expected`.
    fn set_mode(&mut self, mode: &str, expected: &[&str]) -> Result<(), InstrumentFault> {
        self.command(&format!("MODE,{mode}"))?;
        let now = self.ask("MODE?", |reply| is_mode(reply).then(|| reply.to_owned()))?;
        if expected.contains(&now.as_str()) {
            return Ok(());
        }
        let alarms = self.alarms()?;
        Err(self.line.fault(match alarms.is_empty() {
            true => ExchangeError(FaultKind::Mismatch, format!("its mode is {now} after MODE,{mode}")),
            false => ExchangeError(FaultKind::Alarm, format!("{}; its mode stays {now}", alarms.join(", "))),
        }))
    }

    fn alarms(&mut self) -> Result<Vec<String>, InstrumentFault> {
        let codes =
            |reply: &str| reply.split(',').map(|code| code.trim().parse::<u16>().ok()).collect::<Option<Vec<_>>>();
        let codes = self.ask("ALARM?", codes)?;
        // The first number is the count of alarms.
        Ok(codes.iter().skip(1).map(|code| format!("alarm {code}")).collect())
    }
}

/// Whether a text is a mode: `OFF`, `STANDBY`, `CONSTANT`, or `RUN` with details.
fn is_mode(text: &str) -> bool {
    ["OFF", "STANDBY", "CONSTANT", "RUN"].iter().any(|mode| text.starts_with(mode))
}

/// Parses the reply to `MON?`: air temperature, mode, number of alarms. The second field is the humidity, empty in
/// chambers without it.
fn parse_monitor(reply: &str) -> Option<(f64, String, u16)> {
    let fields: Vec<_> = reply.split(',').map(str::trim).collect();
    let [air, _, mode, alarms] = fields[..] else { return None };
    Some((number(air)?, is_mode(mode).then(|| mode.to_owned())?, alarms.parse().ok()?))
}

/// Parses the reply to `TEMP?`, which is air temperature, set point, upper limit, lower limit; returns the set point.
fn parse_set_point(reply: &str) -> Option<f64> {
    let fields: Option<Vec<_>> = reply.split(',').map(number).collect();
    fields.filter(|fields| fields.len() == 4).map(|fields| fields[1])
}

impl Instrument for Espec {
    fn line_mut(&mut self) -> &mut Line {
        &mut self.line
    }

    fn identify(&mut self) -> Result<String, InstrumentFault> {
        // One or two sensors, controller, highest temperature. The checks exclude late replies to other requests.
        let controller = |reply: &str| {
            let fields: Vec<_> = reply.split(',').map(str::trim).collect();
            let valid =
                matches!(fields.len(), 3 | 4) && !is_mode(fields[2]) && fields.last().and_then(|f| number(f)).is_some();
            valid.then(|| format!("ESPEC {}", fields[fields.len() - 2]))
        };
        self.ask("TYPE?", controller)
    }
}

impl ChamberInstrument for Espec {
    fn read(&mut self) -> Result<ChamberReading, InstrumentFault> {
        // A late reply is none of these: each has a form of its own.
        let (air_c, mode, alarms) = self.ask("MON?", parse_monitor)?;
        let set_point_c = self.ask("TEMP?", parse_set_point)?;
        let alarms = if alarms > 0 { self.alarms()? } else { Vec::new() };
        let running = mode.starts_with("CONSTANT") || mode.starts_with("RUN");
        Ok(ChamberReading { air_c, set_point_c, running, other_mode: None, alarms })
    }

    fn set_point(&mut self, celsius: f64) -> Result<(), InstrumentFault> {
        let decimals = self.settings.decimals;
        // Adding 0 turns -0 into 0.
        let value = format!("{:.decimals$}", celsius + 0.0);
        self.command(&format!("TEMP, S{value}"))?;
        let now = self.ask("TEMP?", parse_set_point)?;
        // Compared with the value that was sent, not with `celsius`: the controller has no more decimals.
        if number(&value).is_some_and(|sent| (sent - now).abs() < 1e-9) {
            return Ok(());
        }
        Err(self.line.fault(ExchangeError(FaultKind::Mismatch, format!("its set point is {now} after TEMP, S{value}"))))
    }

    fn run(&mut self) -> Result<(), InstrumentFault> {
        if self.settings.power_on {
            self.command("POWER,ON")?;
        }
        self.set_mode("CONSTANT", &["CONSTANT"])
    }

    fn standby(&mut self) -> Result<(), InstrumentFault> {
        self.set_mode("STANDBY", &["STANDBY", "OFF"])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Replies as StaflSystems/ChamberConnectLibrary, chamberconnectlibrary/p300.py parses them.
    #[test]
    fn replies_as_in_public_drivers() {
        assert_eq!(parse_monitor("23.1,45,CONSTANT,0"), Some((23.1, "CONSTANT".to_owned(), 0)));
        assert_eq!(parse_monitor("-25.0,,STANDBY,2"), Some((-25.0, "STANDBY".to_owned(), 2)));
        assert_eq!(parse_set_point("23.1,25.0,100.0,-50.0"), Some(25.0));
    }

    #[test]
    fn replies_to_other_requests_are_refused() {
        for reply in
            ["OK:TEMP, S25.0", "CONSTANT", "T,T,P300,100.0", "23.1,25.0,100.0,-50.0", "", "nan,,OFF,0", "1,,ON,0"]
        {
            assert_eq!(parse_monitor(reply), None, "{reply}");
        }
        for reply in ["OK:MODE,CONSTANT", "23.1,,CONSTANT,0", "T,P300,100.0", "2,1,3", "1,2,3,inf"] {
            assert_eq!(parse_set_point(reply), None, "{reply}");
        }
    }
}
