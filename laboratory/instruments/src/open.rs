//! Opens an instrument with the driver that its configuration names.

use super::config::{ChamberConfig, ChamberDriver, TurntableConfig, TurntableDriver};
use super::fault::InstrumentFault;
use super::instrument::{Chamber, Turntable};
use super::{acutrol, aerosmith, ascii2, espec, f4t};

/// Opens the line to a chamber.
///
/// # Errors
/// If the port cannot be opened.
pub fn chamber(config: &ChamberConfig) -> Result<Box<dyn Chamber>, InstrumentFault> {
    Ok(match &config.driver {
        ChamberDriver::Espec(settings) => Box::new(espec::Espec::open(&config.line, settings)?),
        ChamberDriver::F4t(settings) => Box::new(f4t::F4t::open(&config.line, settings)?),
        ChamberDriver::Ascii2(settings) => Box::new(ascii2::Ascii2::open(&config.line, settings)?),
    })
}

/// Opens the line to a turntable.
///
/// # Errors
/// If the port cannot be opened.
pub fn turntable(config: &TurntableConfig) -> Result<Box<dyn Turntable>, InstrumentFault> {
    Ok(match &config.driver {
        TurntableDriver::Acutrol(settings) => Box::new(acutrol::Acutrol::open(&config.line, settings)?),
        TurntableDriver::Aerosmith(settings) => Box::new(aerosmith::Aerosmith::open(&config.line, settings)?),
    })
}
