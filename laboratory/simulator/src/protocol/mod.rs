//! What the machines speak, byte by byte: written from the protocols, not from the drivers.

mod acutrol;
mod aerosmith;
mod ascii2;
mod espec;
mod f4t;

use super::chamber::ChamberMachine;
use super::server::Speaker;
use super::turntable::TurntableMachine;
use serde::{Deserialize, Serialize};

/// What a chamber speaks.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChamberProtocol {
    /// ESPEC P-300.
    Espec,
    /// Watlow F4T.
    WatlowF4t,
    /// Voetsch, Weiss.
    Ascii2,
}

impl ChamberProtocol {
    /// Every protocol with the driver's name.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Espec, "espec"), (Self::WatlowF4t, "watlow-f4t"), (Self::Ascii2, "ascii2")];

    /// The driver's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }

    pub(super) fn speaker(self) -> Box<dyn Speaker<ChamberMachine>> {
        match self {
            Self::Espec => Box::new(espec::Espec),
            Self::WatlowF4t => Box::new(f4t::F4t),
            Self::Ascii2 => Box::new(ascii2::Ascii2),
        }
    }
}

/// What a turntable speaks.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TurntableProtocol {
    /// ACUTROL 3000.
    Acutrol,
    /// Ideal Aerosmith.
    Aerosmith,
}

impl TurntableProtocol {
    /// Every protocol with the driver's name.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Acutrol, "acutrol"), (Self::Aerosmith, "aerosmith")];

    /// The driver's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }

    pub(super) fn speaker(self, tcp: bool) -> Box<dyn Speaker<TurntableMachine>> {
        match self {
            Self::Acutrol => Box::new(acutrol::Acutrol::new(tcp)),
            Self::Aerosmith => Box::new(aerosmith::Aerosmith::default()),
        }
    }
}

/// Takes the first line out of the input, without its end `\r`, `\n` or both.
fn take_line(input: &mut Vec<u8>) -> Option<Vec<u8>> {
    let blank = input.iter().take_while(|byte| matches!(byte, b'\r' | b'\n')).count();
    input.drain(..blank);
    let end = input.iter().position(|byte| matches!(byte, b'\r' | b'\n'))?;
    Some(input.drain(..=end).take(end).collect())
}
