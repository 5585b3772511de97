//! Temperature chambers and turntables: one trait for each, and the drivers that a configuration can name.
//!
//! Every driver uses a line (module `line`): it sends one request, then waits for the reply or the time-out, and never has two
//! requests under way. An error of an instrument or its line is an [`InstrumentFault`]; its [`FaultKind`] decides how a campaign
//! reacts. A driver repeats a request without a reply, or with a garbled one, up to `retries` times. That is safe because every
//! request is idempotent: it reads, or it sets an absolute value.

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
    /// Type or identity as the controller reports it.
    ///
    /// # Errors
    /// A fault of the chamber or the line.
    fn identify(&mut self) -> Result<String, InstrumentFault>;

    /// Measured values and state of the controller.
    ///
    /// # Errors
    /// A fault of the chamber or the line.
    fn read(&mut self) -> Result<ChamberReading, InstrumentFault>;

    /// Sets the set point, reads it back and compares.
    ///
    /// # Errors
    /// A fault of the chamber or the line; [`FaultKind::Mismatch`] if another set point is read back.
    fn set_point(&mut self, celsius: f64) -> Result<(), InstrumentFault>;

    /// Starts the constant mode: the chamber holds the set point.
    ///
    /// # Errors
    /// A fault of the chamber or the line.
    fn run(&mut self) -> Result<(), InstrumentFault>;

    /// Enters the safe state: no heating, no cooling.
    ///
    /// # Errors
    /// A fault of the chamber or the line.
    fn standby(&mut self) -> Result<(), InstrumentFault>;

    /// Requests on this line that had to be repeated.
    fn repeated(&self) -> u64;
}

/// Measured values and state of a chamber.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChamberReading {
    /// Measured air temperature \[degC\].
    pub air_c: f64,
    /// Set point \[degC\].
    pub set_point_c: f64,
    /// Whether it controls the temperature: heats and cools.
    pub running: bool,
    /// Active alarms as the controller names them; empty for none.
    pub alarms: Vec<String>,
}

/// A two-axis turntable. Angles \[deg\], rates \[deg/s\]. Axis 0 is the outer (first) axis, 1 the inner.
pub trait Turntable: Send {
    /// Type or identity as the controller reports it.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn identify(&mut self) -> Result<String, InstrumentFault>;

    /// Resets faults, closes the interlocks and powers the axes. Nothing moves.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn engage(&mut self) -> Result<(), InstrumentFault>;

    /// Angles, rates and state.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn read(&mut self) -> Result<TurntableReading, InstrumentFault>;

    /// Starts moving both axes. Returns when the move is commanded, not when it is complete.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn move_to(
        &mut self,
        angles_deg: [f64; 2],
        rate_deg_s: f64,
        acceleration_deg_s2: f64,
    ) -> Result<(), InstrumentFault>;

    /// Enters the safe state: the motion stops, the axes are held or without power. Both axes are commanded, even if the first
    /// one fails.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn stop(&mut self) -> Result<(), InstrumentFault>;

    /// Requests on this line that had to be repeated.
    fn repeated(&self) -> u64;
}

/// Measured values and state of a turntable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TurntableReading {
    /// Angles of the outer and the inner axis \[deg\].
    pub angles_deg: [f64; 2],
    /// Rates of the outer and the inner axis \[deg/s\].
    pub rates_deg_s: [f64; 2],
    /// Active faults as the controller names them; empty for none.
    pub faults: Vec<String>,
    /// Axes without power (open interlocks), as the controller names them; always empty for controllers that do not report it.
    pub open: Vec<String>,
}

/// The shortest rotation from `a` to `b`, over -180 and up to 180 \[deg\]: from 359.999 to 0 it is 0.001.
#[must_use]
pub fn turn_deg(a: f64, b: f64) -> f64 {
    let turn = (b - a).rem_euclid(360.0);
    if turn > 180.0 { turn - 360.0 } else { turn }
}

/// The kind of an [`InstrumentFault`].
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq)]
pub enum FaultKind {
    /// The port is lost or refused.
    Line,
    /// No reply in time.
    NoReply,
    /// The reply is damaged, or does not belong to this request.
    Garbled,
    /// The instrument refuses the request: `NA:`, a Modbus exception, an error reply.
    Refused,
    /// The instrument has an alarm or an internal fault and does not carry out the request.
    Alarm,
    /// The value that is read back differs from the value that was set.
    Mismatch,
}

/// A fault of an instrument or its line.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub struct InstrumentFault {
    /// Decides how a campaign reacts.
    pub kind: FaultKind,
    /// The instrument and its port.
    pub instrument: String,
    /// The request and its result.
    pub message: String,
}

/// Instrument, request and cause, remedy.
impl fmt::Display for InstrumentFault {
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
pub fn chamber(config: &ChamberConfig) -> Result<Box<dyn Chamber>, InstrumentFault> {
    config.open()
}

/// Opens the line to a turntable.
///
/// # Errors
/// If the port cannot be opened.
pub fn turntable(config: &TurntableConfig) -> Result<Box<dyn Turntable>, InstrumentFault> {
    config.open()
}
