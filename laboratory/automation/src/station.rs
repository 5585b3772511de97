//! Chamber and turntable: every command and every reading is checked against the limits here. Only this module and the
//! safe state command them.

use super::plan::Plan;
use super::safe_state::{self, SafeOutcome};
use isotherm_instruments::{
    self as instruments, ChamberInstrument, ChamberReading, FaultKind, InstrumentFault, Surroundings,
    TurntableInstrument, TurntableReading,
};

/// The air's rate of change is an alarm beyond this multiple of the ramp's limit: a controller overshoots.
const RAMP_ALARM_FACTOR: f64 = 1.5;

/// Why a reading or a command of an instrument has failed.
pub enum StationError {
    /// The instrument is not connected or has not answered correctly. The campaign pauses.
    Lost(String),
    /// An alarm or a fault of the instrument, or a limit that is exceeded. The campaign ends in the safe state.
    Alarm(String),
}

/// Both instruments, each connected or not.
pub struct Station<'p> {
    plan: &'p Plan,
    around: Surroundings,
    chamber: Box<dyn ChamberInstrument>,
    turntable: Box<dyn TurntableInstrument>,
    /// Whether chamber and turntable are connected: identified, and the turntable engaged.
    connected: [bool; 2],
    /// Identities of chamber and turntable.
    names: [String; 2],
    /// Whether an earlier connection or an earlier runner has engaged the turntable: it may have a fault or still move.
    was_engaged: bool,
}

impl<'p> Station<'p> {
    /// A station without connections. `was_engaged` if an earlier runner has not ended in the safe state.
    /// The signal that asks to end ends every wait for an instrument, until the safe state is entered.
    pub fn new(plan: &'p Plan, was_engaged: bool, around: Surroundings) -> Self {
        Self {
            plan,
            chamber: instruments::chamber(&plan.chamber, &around),
            turntable: instruments::turntable(&plan.turntable, &around),
            around,
            connected: [false; 2],
            names: [String::new(), String::new()],
            was_engaged,
        }
    }

    /// Identities of chamber and turntable, as they report them.
    pub fn names(&self) -> [String; 2] {
        self.names.clone()
    }

    /// Repeated requests to chamber and turntable.
    pub fn repeated(&mut self) -> [u64; 2] {
        [self.chamber.line_mut().repeated(), self.turntable.line_mut().repeated()]
    }

    /// Connects and identifies the chamber if it is not connected. This commands nothing.
    ///
    /// # Errors
    /// If the chamber does not answer.
    pub fn connect_chamber(&mut self) -> Result<(), StationError> {
        if !self.connected[0] {
            self.connected[0] = true;
            self.names[0] = self.chamber(|chamber| chamber.identify())?;
        }
        Ok(())
    }

    /// Connects and engages the turntable if it is not connected. This moves nothing. Engaging resets faults; therefore
    /// a turntable that was engaged before is first checked for faults, and stopped.
    ///
    /// # Errors
    /// If the turntable does not answer, has a fault or exceeds a limit.
    pub fn connect_turntable(&mut self) -> Result<(), StationError> {
        if !self.connected[1] {
            self.connected[1] = true;
            self.names[1] = self.turntable(|turntable| turntable.identify())?;
            if self.was_engaged {
                let reading = self.turntable(|turntable| turntable.read())?;
                self.check_turntable(&reading).inspect_err(|_| self.close_turntable())?;
                self.check_angles(&reading)?;
                self.turntable(|turntable| turntable.stop())?;
            }
            self.turntable(|turntable| turntable.engage())?;
            self.was_engaged = true;
        }
        Ok(())
    }

    /// Checks a reading of the turntable for faults and rates beyond the limit: they end the campaign.
    fn check_turntable(&self, reading: &TurntableReading) -> Result<(), StationError> {
        if !reading.faults.is_empty() {
            return Err(StationError::Alarm(format!("the turntable has a fault: {}", reading.faults.join(", "))));
        }
        // A second reading would not show it: the orders have stopped the table by then.
        match self.plan.limits.measured_rates(reading.rates_deg_s) {
            Some(fault) => Err(StationError::Alarm(format!("the turntable: {fault}"))),
            None => Ok(()),
        }
    }

    /// Checks the angles of a reading. If they are beyond the limits, the turntable is stopped at once; whether the
    /// campaign ends, too, a second reading on a fresh line decides.
    fn check_angles(&mut self, reading: &TurntableReading) -> Result<(), StationError> {
        let (limits, wraps) = (self.plan.limits, self.plan.turntable.wraps());
        let is_beyond = |reading: &TurntableReading| limits.measured_angles(reading.angles_deg, wraps);
        let Some(first) = is_beyond(reading) else { return Ok(()) };
        self.stop_turntable();
        self.connected[1] = true;
        let second = self.turntable(|turntable| turntable.read());
        // The next connection stops and engages it again.
        self.close_turntable();
        Err(decided("the turntable", &first, second.map(|reading| is_beyond(&reading))))
    }

    /// The same of the chamber's air: standby is ordered at once, or ambient if the plan says so.
    fn check_air(&mut self, reading: &ChamberReading) -> Result<(), StationError> {
        let limits = self.plan.limits;
        let Some(first) = limits.chamber(reading.air_c) else { return Ok(()) };
        safe_state::order_chamber(self.plan, self.around.time.as_ref(), self.chamber.as_mut());
        self.chamber.line_mut().close();
        self.connected[0] = true;
        let second = self.chamber(|chamber| chamber.read());
        Err(decided("the chamber's air", &first, second.map(|reading| limits.chamber(reading.air_c))))
    }

    /// Sends a request to the chamber. A failure closes the line; the next connection opens it anew.
    fn chamber<T>(
        &mut self,
        request: impl FnOnce(&mut dyn ChamberInstrument) -> Result<T, InstrumentFault>,
    ) -> Result<T, StationError> {
        if !self.connected[0] {
            return Err(StationError::Lost("the chamber is not connected".to_owned()));
        }
        let result = request(self.chamber.as_mut());
        if result.as_ref().is_err_and(is_broken) {
            self.chamber.line_mut().close();
            self.connected[0] = false;
        }
        result.map_err(station_error)
    }

    /// Sends a request to the turntable. A failure closes the line; the next connection opens it anew.
    fn turntable<T>(
        &mut self,
        request: impl FnOnce(&mut dyn TurntableInstrument) -> Result<T, InstrumentFault>,
    ) -> Result<T, StationError> {
        if !self.connected[1] {
            return Err(StationError::Lost("the turntable is not connected".to_owned()));
        }
        let result = request(self.turntable.as_mut());
        if result.as_ref().is_err_and(is_broken) {
            self.close_turntable();
        }
        result.map_err(station_error)
    }

    fn close_turntable(&mut self) {
        self.turntable.line_mut().close();
        self.connected[1] = false;
    }

    /// Reads the chamber and checks it for alarms and limits.
    ///
    /// # Errors
    /// If the chamber does not answer, has an alarm or exceeds a limit.
    pub fn read_chamber(&mut self) -> Result<ChamberReading, StationError> {
        let reading = self.chamber(|chamber| chamber.read())?;
        if !reading.alarms.is_empty() {
            return Err(StationError::Alarm(format!("the chamber has an alarm: {}", reading.alarms.join(", "))));
        }
        self.check_air(&reading)?;
        Ok(reading)
    }

    /// Checks the air's rate of change \[degC/h\] against the ramp's limit.
    ///
    /// # Errors
    /// If the air changes faster than 1.5 times the limit.
    pub fn check_ramp(&self, per_h: Option<f64>) -> Result<(), StationError> {
        match per_h.and_then(|per_h| self.plan.limits.ramp(per_h.abs() / 60.0 / RAMP_ALARM_FACTOR)) {
            Some(_) => {
                let per_min = per_h.unwrap_or_default() / 60.0;
                Err(StationError::Alarm(format!(
                    "the chamber's air changes by {per_min:.2} degC/min, far over limits.ramp_c_per_min"
                )))
            }
            None => Ok(()),
        }
    }

    /// Reads the turntable and checks it for faults, limits and power.
    ///
    /// # Errors
    /// If the turntable does not answer, has a fault, exceeds a limit or has lost its power.
    pub fn read_turntable(&mut self) -> Result<TurntableReading, StationError> {
        let reading = self.turntable(|turntable| turntable.read())?;
        self.check_turntable(&reading)?;
        self.check_angles(&reading)?;
        if reading.open.is_empty() {
            Ok(reading)
        } else {
            Err(StationError::Alarm(format!("the turntable has lost its power: {}", reading.open.join(", "))))
        }
    }

    /// Sets the chamber's set point \[degC\].
    ///
    /// # Errors
    /// If the set point is outside the limits, or the command fails.
    pub fn set_point(&mut self, celsius: f64) -> Result<(), StationError> {
        refuse_command(self.plan.limits.chamber(celsius))?;
        self.chamber(|chamber| chamber.set_point(celsius))
    }

    /// Starts the chamber.
    ///
    /// # Errors
    /// If the command fails.
    pub fn start_chamber(&mut self) -> Result<(), StationError> {
        self.chamber(|chamber| chamber.run())
    }

    /// Starts a motion of the turntable to these angles \[deg\].
    ///
    /// # Errors
    /// If the motion is outside the limits, or the command fails.
    pub fn move_to(&mut self, angles_deg: [f64; 2]) -> Result<(), StationError> {
        let motion = self.plan.motion;
        self.begin_motion(angles_deg, motion.rate_deg_s, motion.acceleration_deg_s2)
    }

    /// The same with the rate and the acceleration of a turn.
    ///
    /// # Errors
    /// As [`move_to`](Self::move_to).
    pub fn turn_to(&mut self, angles_deg: [f64; 2]) -> Result<(), StationError> {
        let turn = self.plan.turn;
        self.begin_motion(angles_deg, turn.rate_deg_s, turn.acceleration_deg_s2)
    }

    fn begin_motion(&mut self, angles_deg: [f64; 2], rate: f64, acceleration: f64) -> Result<(), StationError> {
        let limits = &self.plan.limits;
        refuse_command(limits.angles(angles_deg))?;
        refuse_command(limits.rate(rate))?;
        refuse_command(limits.acceleration(acceleration))?;
        self.turntable(|turntable| turntable.move_to(angles_deg, rate, acceleration))
    }

    /// Sends the stop orders to the turntable at once, whatever its line does, and closes the line. The next connection
    /// stops and engages it again.
    pub fn stop_turntable(&mut self) {
        safe_state::order_at_once(self.around.time.as_ref(), self.turntable.as_mut(), |turntable| turntable.stop());
        self.close_turntable();
    }

    /// Brings both instruments into the safe state: turntable stopped, chamber in standby or held at ambient. Returns
    /// the results of turntable and chamber.
    pub fn enter_safe_state(&mut self) -> (SafeOutcome, SafeOutcome) {
        let [chamber_connected, turntable_connected] = self.connected;
        let turntable = (self.turntable.as_mut(), turntable_connected);
        safe_state::enter(self.plan, self.around.time.as_ref(), turntable, (self.chamber.as_mut(), chamber_connected))
    }
}

/// What follows from a first reading beyond a limit, and a second one.
fn decided(what: &str, first: &str, second: Result<Option<String>, StationError>) -> StationError {
    match second {
        Ok(None) => StationError::Lost(format!(
            "{what}: {first}; a second reading on a fresh line does not confirm it; check cable, shield and line settings"
        )),
        Ok(Some(_)) => StationError::Alarm(format!("{what}: {first}")),
        Err(StationError::Lost(cause) | StationError::Alarm(cause)) => {
            StationError::Alarm(format!("{what}: {first}; it cannot be read again: {cause}"))
        }
    }
}

/// Whether a connection ends by this fault. After a signal the first orders go out on the connection that is there.
fn is_broken(fault: &InstrumentFault) -> bool {
    fault.kind != FaultKind::Stopped
}

/// The error of a fault: an alarm of the instrument ends the campaign, every other fault pauses it.
fn station_error(fault: InstrumentFault) -> StationError {
    match fault.kind {
        FaultKind::Alarm => StationError::Alarm(fault.to_string()),
        FaultKind::Line
        | FaultKind::NoReply
        | FaultKind::Garbled
        | FaultKind::Babble
        | FaultKind::Refused
        | FaultKind::Stopped
        | FaultKind::Mismatch => StationError::Lost(fault.to_string()),
    }
}

/// The error of a command that exceeds a limit.
fn refuse_command(fault: Option<String>) -> Result<(), StationError> {
    fault.map_or(Ok(()), |fault| Err(StationError::Alarm(format!("not commanded: {fault}"))))
}
