//! The protocols of the devices, byte by byte. They follow the protocols' descriptions and share no code with the drivers.

mod acutrol;
mod aerosmith;
mod ascii2;
mod espec;
mod f4t;

use super::chamber::ChamberDevice;
use super::server::Protocol;
use super::turntable::TurntableDevice;
use serde::{Deserialize, Serialize};

/// Protocol of a chamber.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChamberProtocol {
    /// ESPEC P-300.
    Espec,
    /// Watlow F4T.
    WatlowF4t,
    /// Voetsch and Weiss, ASCII-2.
    Ascii2,
}

impl ChamberProtocol {
    /// Every protocol with the name of its driver.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Espec, "espec"), (Self::WatlowF4t, "watlow-f4t"), (Self::Ascii2, "ascii2")];

    /// The name of its driver.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }

    pub(super) fn implementation(self) -> Box<dyn Protocol<ChamberDevice>> {
        match self {
            Self::Espec => Box::new(espec::EspecProtocol),
            Self::WatlowF4t => Box::new(f4t::F4tProtocol),
            Self::Ascii2 => Box::new(ascii2::Ascii2Protocol),
        }
    }
}

/// Protocol of a turntable.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TurntableProtocol {
    /// ACUTROL 3000.
    Acutrol,
    /// Ideal Aerosmith.
    Aerosmith,
}

impl TurntableProtocol {
    /// Every protocol with the name of its driver.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Acutrol, "acutrol"), (Self::Aerosmith, "aerosmith")];

    /// The name of its driver.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }

    pub(super) fn implementation(self, tcp: bool) -> Box<dyn Protocol<TurntableDevice>> {
        match self {
            Self::Acutrol => Box::new(acutrol::AcutrolProtocol::new(tcp)),
            Self::Aerosmith => Box::new(aerosmith::AerosmithProtocol::default()),
        }
    }
}

/// Takes the first line out of the input, without its line end `\r`, `\n` or `\r\n`.
fn take_line(input: &mut Vec<u8>) -> Option<Vec<u8>> {
    let blank = input.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
    input.drain(..blank);
    let end = input.iter().position(|byte| matches!(byte, b'\r' | b'\n'))?;
    Some(input.drain(..=end).take(end).collect())
}
