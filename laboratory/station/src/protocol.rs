//! The protocols of the devices, byte by byte. They follow the protocols' descriptions and share no code with the
//! drivers.

mod acutrol;
mod aerosmith;
mod ascii2;
mod espec;
mod f4t;

use crate::chamber::ChamberDevice;
use crate::station::{ChamberProtocol, TurntableProtocol};
use crate::turntable::TurntableDevice;
use crate::wire::Protocol;

impl ChamberProtocol {
    pub(super) fn implementation(self) -> Box<dyn Protocol<ChamberDevice>> {
        match self {
            Self::Espec => Box::new(espec::EspecProtocol),
            Self::WatlowF4t => Box::new(f4t::F4tProtocol),
            Self::Ascii2 => Box::new(ascii2::Ascii2Protocol),
        }
    }
}

impl TurntableProtocol {
    pub(super) fn implementation(self, tcp: bool) -> Box<dyn Protocol<TurntableDevice>> {
        match self {
            Self::Acutrol => Box::new(acutrol::AcutrolProtocol::new(tcp)),
            Self::Aerosmith => Box::new(aerosmith::AerosmithProtocol::default()),
        }
    }
}
