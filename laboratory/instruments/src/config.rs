//! Which instrument is where: the `[chamber]` and `[table]` sections of a campaign plan.

use super::line_config::LineConfig;
use super::{Chamber, Fault, Turntable, acutrol, aerosmith, ascii2, espec, f4t};
use isotherm_shared::document::Section;

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
pub struct TurntableConfig {
    /// Where it is.
    pub line: LineConfig,
    /// What it speaks.
    pub driver: TurntableDriver,
}

/// What a table speaks.
#[derive(Clone, Debug, PartialEq)]
pub enum TurntableDriver {
    /// ACUTROL 3000, ACL.
    Acutrol(acutrol::Settings),
    /// Ideal Aerosmith Table Language.
    Aerosmith(aerosmith::Settings),
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

impl TurntableConfig {
    /// Asks for every key of a table's driver and line; faults go to the document. The caller asks for keys of its own, then finishes
    /// the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        type Read = fn(&Section<'_, '_>) -> TurntableDriver;
        let drivers: [((i64, Read), &str); 2] = [
            ((19200, |section| TurntableDriver::Acutrol(acutrol::Settings::read(section))), "acutrol"),
            ((9600, |section| TurntableDriver::Aerosmith(aerosmith::Settings::read(section))), "aerosmith"),
        ];
        let driver = section.choice("driver", &drivers);
        let line = LineConfig::read(section, driver.map_or(9600, |(baud, _)| baud), 0.0);
        let (_, read) = driver?;
        let driver = read(section);
        Some(Self { line: line?, driver })
    }

    pub(super) fn open(&self) -> Result<Box<dyn Turntable>, Fault> {
        Ok(match &self.driver {
            TurntableDriver::Acutrol(settings) => Box::new(acutrol::Acutrol::open(&self.line, settings)?),
            TurntableDriver::Aerosmith(settings) => Box::new(aerosmith::Aerosmith::open(&self.line, settings)?),
        })
    }
}
