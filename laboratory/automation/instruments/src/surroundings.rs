//! What is around a line: clocks, ports, and the signal that asks to end.

use super::port::{Ports, RealPorts};
use super::time::{RealTime, Time};
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
