//! Chamber and turntable: every command and every reading is checked against the limits here, and only this module commands them.

use super::plan::Plan;
use isotherm_instruments::{
    self as instruments, Chamber, ChamberReading, FaultKind, InstrumentFault, Turntable, TurntableReading,
};
use std::fmt;
use std::thread;
use std::time::{Duration, Instant};

/// Number of attempts at the safe state of an instrument.
const SAFE_ATTEMPTS: u32 = 5;
/// Pause between two attempts, and between two readings of a turntable that stops.
const SAFE_PAUSE: Duration = Duration::from_millis(300);
/// Longest time until the turntable is at rest after a stop command.
const STOP_TIMEOUT: Duration = Duration::from_secs(20);
/// The air's rate of change is an alarm beyond this multiple of the ramp's limit: a controller overshoots.
const RAMP_ALARM_FACTOR: f64 = 1.5;

/// Why a reading or a command of an instrument has failed.
pub enum StationError {
    /// The instrument is not connected or has not answered correctly. The campaign pauses.
    Lost(String),
    /// An alarm or a fault of the instrument, or a limit that is exceeded. The campaign ends in the safe state.
    Alarm(String),
}

/// The result of bringing an instrument into the safe state, as messages show it.
pub enum SafeOutcome {
    /// The instrument has confirmed the safe state.
    Reached(String),
    /// The instrument is not in the safe state, or has not confirmed it.
    Unknown(String),
}

impl SafeOutcome {
    /// Whether the safe state is confirmed.
    pub const fn is_reached(&self) -> bool {
        matches!(self, Self::Reached(_))
    }
}

impl fmt::Display for SafeOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reached(text) => f.write_str(text),
            Self::Unknown(text) => write!(f, "{text}; GO THERE AND LOOK"),
        }
    }
}

/// Both instruments, each connected or not.
pub struct Station<'p> {
    plan: &'p Plan,
    chamber: Option<Box<dyn Chamber>>,
    turntable: Option<Box<dyn Turntable>>,
    /// Identities of chamber and turntable.
    names: [String; 2],
    /// Whether an earlier connection or an earlier runner has engaged the turntable: it may have a fault or still move.
    was_engaged: bool,
    /// Repeated requests to chamber and turntable on lines that are closed by now.
    repeated: [u64; 2],
}

impl<'p> Station<'p> {
    /// A station without connections. `was_engaged` if an earlier runner has not ended in the safe state.
    pub fn new(plan: &'p Plan, was_engaged: bool) -> Self {
        Self {
            plan,
            chamber: None,
            turntable: None,
            names: [String::new(), String::new()],
            was_engaged,
            repeated: [0; 2],
        }
    }

    /// Identities of chamber and turntable, as they report them.
    pub fn names(&self) -> [String; 2] {
        self.names.clone()
    }

    /// Repeated requests to chamber and turntable.
    pub fn repeated(&self) -> [u64; 2] {
        let now = [self.chamber.as_ref().map(|c| c.repeated()), self.turntable.as_ref().map(|t| t.repeated())];
        [0, 1].map(|i| self.repeated[i] + now[i].unwrap_or_default())
    }

    /// Connects and identifies the chamber if it is not connected. This commands nothing.
    ///
    /// # Errors
    /// If the chamber does not answer.
    pub fn connect_chamber(&mut self) -> Result<(), StationError> {
        if self.chamber.is_none() {
            let mut chamber = instruments::chamber(&self.plan.chamber).map_err(station_error)?;
            self.names[0] = chamber.identify().map_err(station_error)?;
            self.chamber = Some(chamber);
        }
        Ok(())
    }

    /// Connects and engages the turntable if it is not connected. This moves nothing. Engaging resets faults; therefore a
    /// turntable that was engaged before is first checked for faults, and stopped.
    ///
    /// # Errors
    /// If the turntable does not answer, has a fault or exceeds a limit.
    pub fn connect_turntable(&mut self) -> Result<(), StationError> {
        if self.turntable.is_none() {
            let mut turntable = instruments::turntable(&self.plan.turntable).map_err(station_error)?;
            self.names[1] = turntable.identify().map_err(station_error)?;
            if self.was_engaged {
                self.check_turntable(&turntable.read().map_err(station_error)?)?;
                turntable.stop().map_err(station_error)?;
            }
            turntable.engage().map_err(station_error)?;
            self.was_engaged = true;
            self.turntable = Some(turntable);
        }
        Ok(())
    }

    /// Checks a reading of the turntable for faults and limits.
    fn check_turntable(&self, reading: &TurntableReading) -> Result<(), StationError> {
        if !reading.faults.is_empty() {
            return Err(StationError::Alarm(format!("the table has a fault: {}", reading.faults.join(", "))));
        }
        match self.plan.limits.reading(reading.angles_deg, reading.rates_deg_s) {
            Some(fault) => Err(StationError::Alarm(format!("the table: {fault}"))),
            None => Ok(()),
        }
    }

    /// Sends a request to the chamber. A failure closes the line; the next connection opens it anew.
    fn chamber<T>(
        &mut self,
        request: impl FnOnce(&mut dyn Chamber) -> Result<T, InstrumentFault>,
    ) -> Result<T, StationError> {
        let Some(chamber) = &mut self.chamber else {
            return Err(StationError::Lost("the chamber is not connected".to_owned()));
        };
        let result = request(chamber.as_mut());
        if result.is_err() {
            self.repeated[0] += self.chamber.take().map_or(0, |chamber| chamber.repeated());
        }
        result.map_err(station_error)
    }

    /// Sends a request to the turntable. A failure closes the line; the next connection opens it anew.
    fn turntable<T>(
        &mut self,
        request: impl FnOnce(&mut dyn Turntable) -> Result<T, InstrumentFault>,
    ) -> Result<T, StationError> {
        let Some(turntable) = &mut self.turntable else {
            return Err(StationError::Lost("the table is not connected".to_owned()));
        };
        let result = request(turntable.as_mut());
        if result.is_err() {
            self.close_turntable();
        }
        result.map_err(station_error)
    }

    fn close_turntable(&mut self) {
        self.repeated[1] += self.turntable.take().map_or(0, |turntable| turntable.repeated());
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
        match self.plan.limits.chamber(reading.air_c) {
            Some(fault) => Err(StationError::Alarm(format!("the chamber's air: {fault}"))),
            None => Ok(reading),
        }
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
        let (limits, motion) = (&self.plan.limits, self.plan.motion);
        refuse_command(limits.angles(angles_deg))?;
        refuse_command(limits.rate(motion.rate_deg_s))?;
        refuse_command(limits.acceleration(motion.acceleration_deg_s2))?;
        self.turntable(|turntable| turntable.move_to(angles_deg, motion.rate_deg_s, motion.acceleration_deg_s2))
    }

    /// Stops the turntable if it answers, and closes its line. The next connection engages it again.
    pub fn stop_turntable(&mut self) {
        // A failure is ignored: the next connection, or the safe state, stops the turntable again.
        let _ = self.turntable(|turntable| turntable.stop());
        self.close_turntable();
    }

    /// Brings both instruments into the safe state: turntable stopped, chamber in standby or held at ambient. Both are commanded
    /// at the same time, each with several attempts. Returns the results of turntable and chamber.
    pub fn enter_safe_state(&mut self) -> (SafeOutcome, SafeOutcome) {
        let (plan, turntable, chamber) = (self.plan, self.turntable.take(), self.chamber.take());
        thread::scope(|scope| {
            let turntable = scope.spawn(move || stop_turntable(plan, turntable));
            let chamber = make_chamber_safe(plan, chamber);
            let panicked = || SafeOutcome::Unknown("table NOT known to be stopped: the program has failed".to_owned());
            (turntable.join().unwrap_or_else(|_| panicked()), chamber)
        })
    }
}

/// Stops the turntable, and reads it until it is at rest.
fn stop_turntable(plan: &Plan, mut turntable: Option<Box<dyn Turntable>>) -> SafeOutcome {
    let open = || {
        let mut turntable = instruments::turntable(&plan.turntable)?;
        turntable.identify().map(|_| turntable)
    };
    let still =
        |reading: &TurntableReading| reading.rates_deg_s.iter().all(|rate| rate.abs() <= plan.motion.still_deg_s);
    let stopped = attempt(&mut turntable, open, |turntable| {
        turntable.stop()?;
        let begun = Instant::now();
        loop {
            let reading = turntable.read()?;
            if still(&reading) || begun.elapsed() > STOP_TIMEOUT {
                return Ok(reading);
            }
            thread::sleep(SAFE_PAUSE);
        }
    });
    match stopped {
        Ok(reading) => {
            let [outer, inner] = reading.angles_deg;
            if still(&reading) {
                return SafeOutcome::Reached(format!("table stopped at {outer:.3}/{inner:.3} deg"));
            }
            let rates = reading.rates_deg_s;
            SafeOutcome::Unknown(format!("table was told to stop, but turns at {:.3}/{:.3} deg/s", rates[0], rates[1]))
        }
        Err(fault) => SafeOutcome::Unknown(format!("table NOT known to be stopped: {fault}")),
    }
}

/// The set point that the chamber holds \[degC\], `None` for standby; and its reading after the command.
type SafeChamber = (Option<f64>, ChamberReading);

fn standby(chamber: &mut (dyn Chamber + 'static)) -> Result<SafeChamber, InstrumentFault> {
    chamber.standby()?;
    chamber.read().map(|reading| (None, reading))
}

/// Commands standby, or ambient if the plan says so, and reads the chamber back.
fn make_chamber_safe(plan: &Plan, mut chamber: Option<Box<dyn Chamber>>) -> SafeOutcome {
    let open = || {
        let mut chamber = instruments::chamber(&plan.chamber)?;
        chamber.identify().map(|_| chamber)
    };
    let result = match plan.ambient_c {
        None => attempt(&mut chamber, open, standby),
        Some(ambient_c) => attempt(&mut chamber, open, |chamber| {
            let reading = chamber.read()?;
            // A chamber that is stopped, has an alarm or exceeds a limit is not started.
            if !reading.running || !reading.alarms.is_empty() || plan.limits.chamber(reading.air_c).is_some() {
                return standby(chamber);
            }
            // The limits hold for ambient too.
            chamber.set_point(plan.limits.clamp_chamber(ambient_c))?;
            chamber.run()?;
            chamber.read().map(|reading| (Some(ambient_c), reading))
        })
        .or_else(|_| attempt(&mut None, open, standby)),
    };
    match result {
        Ok((held, ChamberReading { air_c, running, .. })) if running == held.is_some() => {
            let state = held.map_or_else(|| "in standby".to_owned(), |ambient_c| format!("held at {ambient_c:?} degC"));
            SafeOutcome::Reached(format!("chamber {state}, air at {air_c:.1} degC"))
        }
        Ok(_) => SafeOutcome::Unknown("chamber was commanded into the safe state, but does not confirm it".to_owned()),
        Err(fault) => SafeOutcome::Unknown(format!("chamber NOT known to be safe: {fault}")),
    }
}

/// Sends `request` up to [`SAFE_ATTEMPTS`] times. The line is opened anew after each failure.
fn attempt<I: ?Sized, T>(
    instrument: &mut Option<Box<I>>,
    open: impl Fn() -> Result<Box<I>, InstrumentFault>,
    request: impl Fn(&mut I) -> Result<T, InstrumentFault>,
) -> Result<T, InstrumentFault> {
    let mut attempts = 1;
    loop {
        let result = match instrument.take() {
            Some(instrument) => Ok(instrument),
            None => open(),
        };
        let result = result.and_then(|mut connected| request(connected.as_mut()));
        match result {
            Err(_) if attempts < SAFE_ATTEMPTS => {
                attempts += 1;
                thread::sleep(SAFE_PAUSE);
            }
            result => return result,
        }
    }
}

/// The error of a fault: an alarm of the instrument ends the campaign, every other fault pauses it.
fn station_error(fault: InstrumentFault) -> StationError {
    match fault.kind {
        FaultKind::Alarm => StationError::Alarm(fault.to_string()),
        FaultKind::Line | FaultKind::NoReply | FaultKind::Garbled | FaultKind::Refused | FaultKind::Mismatch => {
            StationError::Lost(fault.to_string())
        }
    }
}

/// The error of a command that exceeds a limit.
fn refuse_command(fault: Option<String>) -> Result<(), StationError> {
    fault.map_or(Ok(()), |fault| Err(StationError::Alarm(format!("not commanded: {fault}"))))
}
