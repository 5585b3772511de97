//! Makes an instrument with the driver that its configuration names. Nothing is opened: the first request opens the
//! port.

use super::config::{ChamberConfig, ChamberDriver, TurntableConfig, TurntableDriver};
use super::instrument::{Chamber, Turntable};
use super::line::Line;
use super::port::{Ports, RealPorts};
use super::time::{RealTime, Time};
use super::{acutrol, aerosmith, ascii2, espec, f4t};
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

/// What lines need of what is around them.
#[derive(Clone)]
pub struct Surroundings {
    /// The clocks.
    pub time: Arc<dyn Time>,
    /// What opens ports.
    pub ports: Arc<dyn Ports>,
    /// A number other than 0 ends every wait: that of the signal that asks to end.
    pub stop_signal: Arc<AtomicUsize>,
}

impl Surroundings {
    /// The clocks and the ports of the machine.
    #[must_use]
    pub fn real(stop_signal: &Arc<AtomicUsize>) -> Self {
        Self { time: Arc::new(RealTime), ports: Arc::new(RealPorts), stop_signal: Arc::clone(stop_signal) }
    }
}

impl Default for Surroundings {
    /// Those of the machine, without a signal.
    fn default() -> Self {
        Self::real(&Arc::default())
    }
}

/// A chamber.
#[must_use]
pub fn chamber(config: &ChamberConfig, around: &Surroundings) -> Box<dyn Chamber> {
    let line = Line::new("chamber", &config.line, around);
    match &config.driver {
        ChamberDriver::Espec(settings) => Box::new(espec::Espec::new(line, settings)),
        ChamberDriver::F4t(settings) => Box::new(f4t::F4t::new(line, settings)),
        ChamberDriver::Ascii2(settings) => Box::new(ascii2::Ascii2::new(line, settings)),
    }
}

/// A turntable.
#[must_use]
pub fn turntable(config: &TurntableConfig, around: &Surroundings) -> Box<dyn Turntable> {
    let line = Line::new("table", &config.line, around);
    match &config.driver {
        TurntableDriver::Acutrol(settings) => Box::new(acutrol::Acutrol::new(line, settings)),
        TurntableDriver::Aerosmith(settings) => Box::new(aerosmith::Aerosmith::new(line, settings)),
    }
}
