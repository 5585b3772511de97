//! Makes an instrument with the driver that its configuration names. Nothing is opened: the first request opens the
//! port.

use super::config::{ChamberConfig, ChamberDriver, TurntableConfig, TurntableDriver};
use super::instrument::{ChamberInstrument, TurntableInstrument};
use super::line::Line;
use super::surroundings::Surroundings;
use super::{acutrol, aerosmith, ascii2, espec, f4t};

/// A chamber.
#[must_use]
pub fn chamber(config: &ChamberConfig, around: &Surroundings) -> Box<dyn ChamberInstrument> {
    let line = Line::new("chamber", &config.line, around);
    match &config.driver {
        ChamberDriver::Espec(settings) => Box::new(espec::Espec::new(line, settings)),
        ChamberDriver::F4t(settings) => Box::new(f4t::F4t::new(line, settings)),
        ChamberDriver::Ascii2(settings) => Box::new(ascii2::Ascii2::new(line, settings)),
    }
}

/// A turntable.
#[must_use]
pub fn turntable(config: &TurntableConfig, around: &Surroundings) -> Box<dyn TurntableInstrument> {
    let line = Line::new("turntable", &config.line, around);
    match &config.driver {
        TurntableDriver::Acutrol(settings) => Box::new(acutrol::Acutrol::new(line, settings)),
        TurntableDriver::Aerosmith(settings) => Box::new(aerosmith::Aerosmith::new(line, settings)),
    }
}
