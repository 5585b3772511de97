//! Instruments and their ports: the `[chamber]` and `[turntable]` sections of a campaign plan.

use super::line_config::LineConfig;
use super::{acutrol, aerosmith, ascii2, espec, f4t};
use isotherm_shared::document::Section;

/// A checked `[chamber]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct ChamberConfig {
    /// Port and line settings.
    pub line: LineConfig,
    /// Protocol and its settings.
    pub driver: ChamberDriver,
}

/// A chamber's protocol and its settings.
#[derive(Clone, Debug, PartialEq)]
pub enum ChamberDriver {
    /// ESPEC P-300, SCP-220.
    Espec(espec::EspecSettings),
    /// Watlow F4T, Modbus RTU.
    F4t(f4t::F4tSettings),
    /// Voetsch and Weiss, ASCII-2.
    Ascii2(ascii2::Ascii2Settings),
}

/// A checked `[turntable]` section.
#[derive(Clone, Debug, PartialEq)]
pub struct TurntableConfig {
    /// Port and line settings.
    pub line: LineConfig,
    /// Protocol and its settings.
    pub driver: TurntableDriver,
}

/// A turntable's protocol and its settings.
#[derive(Clone, Debug, PartialEq)]
pub enum TurntableDriver {
    /// ACUTROL 3000, ACL.
    Acutrol(acutrol::AcutrolSettings),
    /// Ideal Aerosmith Table Language.
    Aerosmith(aerosmith::AerosmithSettings),
}

impl ChamberConfig {
    /// Reads every key of a chamber's driver and line; errors are collected in the document. The caller may read more
    /// keys, then finishes the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        type ReadChamberDriver = fn(&Section<'_, '_>) -> ChamberDriver;
        let drivers: [((i64, f64, ReadChamberDriver), &str); 3] = [
            ((9600, 0.0, |section| ChamberDriver::Espec(espec::EspecSettings::read(section))), "espec"),
            ((38400, f4t::PAUSE_S, |section| ChamberDriver::F4t(f4t::F4tSettings::read(section))), "watlow-f4t"),
            ((9600, 0.0, |section| ChamberDriver::Ascii2(ascii2::Ascii2Settings::read(section))), "ascii2"),
        ];
        let driver = section.choice("driver", &drivers);
        let (baud, pause_s, _) = driver.unwrap_or(drivers[0].0);
        let line = LineConfig::read(section, baud, pause_s);
        let (_, _, read) = driver?;
        let driver = read(section);
        Some(Self { line: line?, driver })
    }
}

impl ChamberConfig {
    /// The key that makes the driver read the chamber's alarms; `None` if it reads them.
    #[must_use]
    pub const fn key_of_alarms(&self) -> Option<&'static str> {
        match &self.driver {
            ChamberDriver::F4t(settings) if settings.alarms == 0 => Some("alarms"),
            ChamberDriver::Ascii2(settings) if settings.alarm_bit.is_none() => Some("alarm_bit"),
            ChamberDriver::Espec(_) | ChamberDriver::F4t(_) | ChamberDriver::Ascii2(_) => None,
        }
    }
}

impl TurntableConfig {
    /// The key that makes the driver read the turntable's faults; `None` if it reads them.
    #[must_use]
    pub const fn key_of_faults(&self) -> Option<&'static str> {
        match &self.driver {
            TurntableDriver::Aerosmith(settings) if settings.fault_mask == 0 => Some("fault_mask"),
            TurntableDriver::Acutrol(_) | TurntableDriver::Aerosmith(_) => None,
        }
    }

    /// Reads every key of a turntable's driver and line; errors are collected in the document. The caller may read more
    /// keys, then finishes the section.
    #[must_use]
    pub fn read(section: &Section<'_, '_>) -> Option<Self> {
        type ReadTurntableDriver = fn(&Section<'_, '_>) -> TurntableDriver;
        let drivers: [((i64, ReadTurntableDriver), &str); 2] = [
            ((19200, |section| TurntableDriver::Acutrol(acutrol::AcutrolSettings::read(section))), "acutrol"),
            ((9600, |section| TurntableDriver::Aerosmith(aerosmith::AerosmithSettings::read(section))), "aerosmith"),
        ];
        let driver = section.choice("driver", &drivers);
        let line = LineConfig::read(section, driver.map_or(9600, |(baud, _)| baud), 0.0);
        let (_, read) = driver?;
        let driver = read(section);
        Some(Self { line: line?, driver })
    }

    /// Whether the controller counts angles modulo 360 degrees: a whole turn takes several motions, and its read-backs
    /// do not show it.
    #[must_use]
    pub const fn wraps(&self) -> bool {
        match &self.driver {
            TurntableDriver::Acutrol(settings) => settings.wrap,
            TurntableDriver::Aerosmith(settings) => settings.wrap,
        }
    }
}
