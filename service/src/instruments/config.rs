//! Which instrument is where: the `[chamber]` and `[table]` sections of a campaign plan.

use super::{Chamber, Fault, Table, acutrol, aerosmith, ascii2, espec, f4t};
use isotherm_shared::document::Section;
use serialport::{DataBits, Parity, StopBits};
use std::time::Duration;

/// A checked `[chamber]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct ChamberConfig {
    /// Where it is.
    pub line: LineConfig,
    /// What it speaks.
    pub driver: ChamberDriver,
}

/// What a chamber speaks.
#[derive(Clone, Debug, PartialEq)]
pub enum ChamberDriver {
    /// ESPEC P-300, SCP-220.
    Espec(espec::Settings),
    /// Watlow F4T, Modbus RTU.
    F4t(f4t::Settings),
    /// Voetsch and Weiss, ASCII-2.
    Ascii2(ascii2::Settings),
}

/// A checked `[table]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct TableConfig {
    /// Where it is.
    pub line: LineConfig,
    /// What it speaks.
    pub driver: TableDriver,
}

/// What a table speaks.
#[derive(Clone, Debug, PartialEq)]
pub enum TableDriver {
    /// ACUTROL 3000, ACL.
    Acutrol(acutrol::Settings),
    /// Ideal Aerosmith Table Language.
    Aerosmith(aerosmith::Settings),
}

/// A checked line.
#[derive(Clone, Debug, PartialEq)]
pub struct LineConfig {
    /// `/dev/ttyUSB0` or `tcp://host:port`.
    pub port: String,
    /// \[Bd\]
    pub baud: u32,
    /// In a character.
    pub data_bits: DataBits,
    /// In a character.
    pub parity: Parity,
    /// After a character.
    pub stop_bits: StopBits,
    /// Longest wait for a reply, and for a TCP connection.
    pub timeout: Duration,
    /// After a reply that did not come or made no sense, how long the line must be quiet before the next request.
    pub quiet: Duration,
    /// Least silence before a request.
    pub pause: Duration,
    /// A request without a proper reply is repeated so often.
    pub retries: u32,
}

impl LineConfig {
    /// Defaults: `baud`, 8N1, 1 s, quiet for as long as the time-out, `pause_s`, 2 retries.
    fn read(section: &Section<'_, '_>, baud: i64, pause_s: f64) -> Option<Self> {
        let port = section.string("port", "a device as \"/dev/ttyUSB0\", or \"tcp://host:port\"").and_then(|port| {
            let address = port.strip_prefix("tcp://");
            let number = |address: &str| address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
            let right = !port.is_empty() && address.is_none_or(|address| number(address).is_some());
            let wrong =
                (!right).then(|| format!("is {port:?}, give a device as \"/dev/ttyUSB0\", or \"tcp://host:port\""));
            section.refuse("port", wrong);
            right.then(|| port.to_owned())
        });
        let baud = section.optional_integer("baud", 50..=4_000_000).unwrap_or(baud) as u32;
        let data_bits = match section.optional_integer("data_bits", 7..=8) {
            Some(7) => DataBits::Seven,
            _ => DataBits::Eight,
        };
        let parities = [(Parity::None, "none"), (Parity::Even, "even"), (Parity::Odd, "odd")];
        let parity = section.optional_choice("parity", &parities).unwrap_or(Parity::None);
        let stop_bits = match section.optional_integer("stop_bits", 1..=2) {
            Some(2) => StopBits::Two,
            _ => StopBits::One,
        };
        let timeout = seconds(section, "timeout_s", 1.0, 60.0);
        let quiet = seconds(section, "quiet_s", timeout.as_secs_f64(), 60.0);
        let pause = seconds(section, "pause_s", pause_s, 10.0);
        let retries = section.optional_integer("retries", 0..=10).unwrap_or(2) as u32;
        section.refuse("timeout_s", timeout.is_zero().then(|| "is 0, give how long a reply may take".to_owned()));
        Some(Self { port: port?, baud, data_bits, parity, stop_bits, timeout, quiet, pause, retries })
    }
}

/// A number of seconds from 0 to `most`.
pub(super) fn seconds(section: &Section<'_, '_>, key: &'static str, default: f64, most: f64) -> Duration {
    let given = section.optional_number(key);
    let right = given.filter(|seconds| (0.0..=most).contains(seconds));
    let wrong = given.filter(|_| right.is_none());
    section.refuse(key, wrong.map(|seconds| format!("is {seconds:?}, give seconds from 0 to {most:?}")));
    Duration::from_secs_f64(right.unwrap_or(default))
}

/// The numbers of the outer and the inner axis.
pub(super) fn axes(section: &Section<'_, '_>) -> [u8; 2] {
    let Some(axes) = section.optional_integers("axes", 0..=99) else { return [1, 2] };
    match axes[..] {
        [outer, inner] if outer != inner => [outer as u8, inner as u8],
        _ => {
            section.fault("axes", "give the numbers of the outer and the inner axis, as [1, 2]");
            [1, 2]
        }
    }
}

impl ChamberConfig {
    /// Asks for every key of a chamber's driver and line; faults go to the document. The caller asks for keys of its own, then finishes
    /// the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        type Read = fn(&Section<'_, '_>) -> ChamberDriver;
        let drivers: [((i64, f64, Read), &str); 3] = [
            ((9600, 0.0, |section| ChamberDriver::Espec(espec::Settings::read(section))), "espec"),
            ((38400, f4t::PAUSE_S, |section| ChamberDriver::F4t(f4t::Settings::read(section))), "watlow-f4t"),
            ((9600, 0.0, |section| ChamberDriver::Ascii2(ascii2::Settings::read(section))), "ascii2"),
        ];
        let driver = section.choice("driver", &drivers);
        let (baud, pause_s, _) = driver.unwrap_or(drivers[0].0);
        let line = LineConfig::read(section, baud, pause_s);
        let (_, _, read) = driver?;
        let driver = read(section);
        Some(Self { line: line?, driver })
    }

    pub(super) fn open(&self) -> Result<Box<dyn Chamber>, Fault> {
        Ok(match &self.driver {
            ChamberDriver::Espec(settings) => Box::new(espec::Espec::open(&self.line, settings)?),
            ChamberDriver::F4t(settings) => Box::new(f4t::F4t::open(&self.line, settings)?),
            ChamberDriver::Ascii2(settings) => Box::new(ascii2::Ascii2::open(&self.line, settings)?),
        })
    }
}

impl TableConfig {
    /// Asks for every key of a table's driver and line; faults go to the document. The caller asks for keys of its own, then finishes
    /// the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        type Read = fn(&Section<'_, '_>) -> TableDriver;
        let drivers: [((i64, Read), &str); 2] = [
            ((19200, |section| TableDriver::Acutrol(acutrol::Settings::read(section))), "acutrol"),
            ((9600, |section| TableDriver::Aerosmith(aerosmith::Settings::read(section))), "aerosmith"),
        ];
        let driver = section.choice("driver", &drivers);
        let line = LineConfig::read(section, driver.map_or(9600, |(baud, _)| baud), 0.0);
        let (_, read) = driver?;
        let driver = read(section);
        Some(Self { line: line?, driver })
    }

    pub(super) fn open(&self) -> Result<Box<dyn Table>, Fault> {
        Ok(match &self.driver {
            TableDriver::Acutrol(settings) => Box::new(acutrol::Acutrol::open(&self.line, settings)?),
            TableDriver::Aerosmith(settings) => Box::new(aerosmith::Aerosmith::open(&self.line, settings)?),
        })
    }
}

/// A driver's settings from text.
#[cfg(test)]
pub(super) fn settings_of<S>(toml: &str, read: impl Fn(&Section<'_, '_>) -> S) -> S {
    let document = isotherm_shared::document::Document::parse(toml).unwrap();
    let settings = read(&document.root());
    document.finish(Some(settings)).unwrap()
}
