//! What every chamber and every turntable can do, and what it reports.

use super::fault::{FaultKind, InstrumentFault};
use super::line::Line;
use super::reply::ExchangeError;

/// A reading is taken anew at most this often.
const READINGS: u32 = 3;

/// An instrument on a line.
pub trait Instrument: Send {
    /// The line to it, to open or close it, or to change how it sends.
    fn line_mut(&mut self) -> &mut Line;

    /// Type or identity as the controller reports it.
    ///
    /// # Errors
    /// A fault of the instrument or the line.
    fn identify(&mut self) -> Result<String, InstrumentFault>;
}

/// A temperature chamber. All temperatures \[degC\].
pub trait ChamberInstrument: Instrument {
    /// Measured values and state of the controller.
    ///
    /// # Errors
    /// A fault of the chamber or the line.
    fn read(&mut self) -> Result<ChamberReading, InstrumentFault>;

    /// Sets the set point, reads it back and compares.
    ///
    /// # Errors
    /// A fault of the chamber or the line; [`FaultKind::Mismatch`](super::FaultKind::Mismatch) if another set point is
    /// read back.
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
    /// A mode in which it neither controls the temperature nor is stopped, as the controller names it: somebody has
    /// changed it.
    pub other_mode: Option<String>,
    /// Active alarms as the controller names them; empty for none.
    pub alarms: Vec<String>,
}

/// A two-axis turntable. Angles \[deg\], rates \[deg/s\]; both are right-handed: the outer axis (0) along the
/// laboratory's X, the inner axis (1) up where the outer one is at 0.
pub trait TurntableInstrument: Instrument {
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

    /// Enters the safe state: the motion stops, the axes are held or without power. Both axes are commanded, even if
    /// the first one fails.
    ///
    /// # Errors
    /// A fault of the turntable or the line.
    fn stop(&mut self) -> Result<(), InstrumentFault>;
}

/// Measured values and state of a turntable.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TurntableReading {
    /// Angles of the outer and the inner axis \[deg\].
    pub angles_deg: [f64; 2],
    /// Rates of the outer and the inner axis \[deg/s\].
    pub rates_deg_s: [f64; 2],
    /// The last digit of the angles, of all readings of the driver the finest \[deg\].
    pub resolution_deg: f64,
    /// Active faults as the controller names them; empty for none.
    pub faults: Vec<String>,
    /// Axes without power (open interlocks), as the controller names them; always empty for controllers that do not
    /// report it.
    pub open: Vec<String>,
}

/// Takes a reading of several requests. If one of them had to be repeated, the replies to the others may be late ones
/// to requests before them: then the whole reading is taken again, after the line was quiet.
pub(super) fn whole_reading<I: Instrument, R>(
    instrument: &mut I,
    read: impl Fn(&mut I) -> Result<R, InstrumentFault>,
) -> Result<R, InstrumentFault> {
    for _ in 0..READINGS {
        let before = instrument.line_mut().repeated();
        let reading = read(instrument)?;
        if instrument.line_mut().repeated() == before {
            return Ok(reading);
        }
        instrument.line_mut().doubt();
    }
    let message = format!("no reading of one piece: a request was repeated in each of {READINGS}");
    Err(instrument.line_mut().fault(ExchangeError(FaultKind::Garbled, message)))
}

/// A controller's angle as 0 to 360, if it counts modulo 360 degrees \[deg\].
pub(super) fn wrapped_deg(angle: f64, wrap: bool) -> f64 {
    if wrap { angle.rem_euclid(360.0) } else { angle }
}

/// The shortest rotation from `a` to `b`, over -180 and up to 180 \[deg\]: from 359.999 to 0 it is 0.001.
///
/// ```
/// use isotherm_instruments::turn_deg;
///
/// assert_eq!(turn_deg(350.0, 10.0), 20.0);
/// assert_eq!(turn_deg(10.0, 350.0), -20.0);
/// ```
#[must_use]
pub fn turn_deg(a: f64, b: f64) -> f64 {
    let turn = (b - a).rem_euclid(360.0);
    if turn > 180.0 { turn - 360.0 } else { turn }
}
