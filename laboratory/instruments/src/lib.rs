//! Temperature chambers and turntables: two small traits, and drivers that a configuration names.
//!
//! Every driver speaks through a [`line`]: one request, then its reply or a time-out, never two requests at once. What an instrument
//! did wrong is a [`Fault`]; its [`FaultKind`] decides what a campaign does about it. A driver repeats what had no reply or a garbled
//! one as often as `retries` says, which is safe: every request reads, or sets what it sets however often it is sent.

pub mod acutrol;
pub mod aerosmith;
pub mod ascii2;
pub mod config;
pub mod espec;
pub mod f4t;
mod line;
mod line_config;

pub use config::{ChamberConfig, TurntableConfig};
pub use line_config::LineConfig;

use std::fmt;

/// A temperature chamber. All temperatures \[degC\].
pub trait Chamber: Send {
    /// Type or identity as the controller tells it.
    ///
    /// # Errors
    /// What the chamber or the line did wrong.
    fn identify(&mut self) -> Result<String, Fault>;

    /// What the controller measures and does now.
    ///
    /// # Errors
    /// What the chamber or the line did wrong.
    fn read(&mut self) -> Result<ChamberReading, Fault>;

    /// Sets the set point, reads it back and compares.
    ///
    /// # Errors
    /// What the chamber or the line did wrong, [`FaultKind::Mismatch`] if another set point is read back.
    fn set_point(&mut self, celsius: f64) -> Result<(), Fault>;

    /// Constant mode at the set point.
    ///
    /// # Errors
    /// What the chamber or the line did wrong.
    fn run(&mut self) -> Result<(), Fault>;

    /// The safe state: no heating, no cooling.
    ///
    /// # Errors
    /// What the chamber or the line did wrong.
    fn standby(&mut self) -> Result<(), Fault>;

    /// Requests on this line that had to be repeated.
    fn repeated(&self) -> u64;
}

/// What a chamber says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChamberReading {
    /// Air \[degC\].
    pub air_c: f64,
    /// Set point \[degC\].
    pub set_point_c: f64,
    /// Whether it heats and cools.
    pub running: bool,
    /// Active alarms as the controller names them; empty for none.
    pub alarms: Vec<String>,
}

/// A two-axis turntable. Angles \[deg\], rates \[deg/s\]. Axis 0 is the outer (first) axis, 1 the inner.
pub trait Turntable: Send {
    /// Type or identity as the controller tells it.
    ///
    /// # Errors
    /// What the table or the line did wrong.
    fn identify(&mut self) -> Result<String, Fault>;

    /// Faults reset, interlocks closed, axes powered; no motion.
    ///
    /// # Errors
    /// What the table or the line did wrong.
    fn engage(&mut self) -> Result<(), Fault>;

    /// Where it is now.
    ///
    /// # Errors
    /// What the table or the line did wrong.
    fn read(&mut self) -> Result<TurntableReading, Fault>;

    /// Starts moving both axes; returns when that is commanded, not when they are there.
    ///
    /// # Errors
    /// What the table or the line did wrong.
    fn move_to(&mut self, angles_deg: [f64; 2], rate_deg_s: f64, acceleration_deg_s2: f64) -> Result<(), Fault>;

    /// The safe state: motion stopped, held or off. Both axes are told to, whatever the first one says.
    ///
    /// # Errors
    /// What the table or the line did wrong.
    fn stop(&mut self) -> Result<(), Fault>;

    /// Requests on this line that had to be repeated.
    fn repeated(&self) -> u64;
}

/// What a table says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TurntableReading {
    /// \[deg\]
    pub angles_deg: [f64; 2],
    /// \[deg/s\]
    pub rates_deg_s: [f64; 2],
    /// Active faults as the controller names them; empty for none.
    pub faults: Vec<String>,
    /// Axes without power, as the controller names them, where it tells: interlocks that are open.
    pub open: Vec<String>,
}

/// From `a` to `b` the short way, -180 to 180 \[deg\]: 359.999 and 0 are neighbours.
#[must_use]
pub fn turn_deg(a: f64, b: f64) -> f64 {
    let turn = (b - a).rem_euclid(360.0);
    if turn > 180.0 { turn - 360.0 } else { turn }
}

/// Of what kind a [`Fault`] is.
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum FaultKind {
    /// The port is lost or refused.
    Line,
    /// No reply in time.
    NoReply,
    /// A reply that is none of this request's.
    Garbled,
    /// The instrument refuses the request: `NA:`, a Modbus exception, an error reply.
    Refused,
    /// The instrument has an alarm or a fault of its own and does not do what it is asked to.
    Alarm,
    /// What is read back differs from what was set.
    Mismatch,
}

/// What an instrument did wrong.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub struct Fault {
    /// Decides what a campaign does.
    pub kind: FaultKind,
    /// The instrument and its port.
    pub instrument: String,
    /// What was tried and what came of it.
    pub message: String,
}

/// Phase, cause, remedy.
impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let remedy = match self.kind {
            FaultKind::Line => "check cable, power and the port's name, and that no other program has it",
            FaultKind::NoReply => "check power, address, line settings and timeout_s",
            FaultKind::Garbled => "check line settings, cable and shield, and the driver's keys",
            FaultKind::Refused => "check that the controller is in remote mode and allows this value",
            FaultKind::Alarm => "clear the cause at the instrument",
            FaultKind::Mismatch => "check the controller's limits and units and the driver's keys",
        };
        write!(f, "{}: {}; {remedy}", self.instrument, self.message)
    }
}

/// Opens the line to a chamber.
///
/// # Errors
/// If the port cannot be opened.
pub fn chamber(config: &ChamberConfig) -> Result<Box<dyn Chamber>, Fault> {
    config.open()
}

/// Opens the line to a table.
///
/// # Errors
/// If the port cannot be opened.
pub fn turntable(config: &TurntableConfig) -> Result<Box<dyn Turntable>, Fault> {
    config.open()
}
