//! Chamber and table behind their limits: the only place that commands them.

use super::plan::Plan;
use isotherm_instruments::{
    self as instruments, Chamber, ChamberReading, Fault, FaultKind, Turntable, TurntableReading,
};
use std::fmt;
use std::thread;
use std::time::{Duration, Instant};

/// Attempts at the safe state, and the pause between two.
const ATTEMPTS: u32 = 5;
const PAUSE: Duration = Duration::from_millis(300);
/// A table that was told to stop comes to rest within this.
const COMES_TO_REST: Duration = Duration::from_secs(20);
/// The air may change by so many times the ramp's limit before that is an alarm: a controller swings.
const SWING: f64 = 1.5;

/// What is wrong with an instrument.
pub enum Watch {
    /// It may come back.
    Lost(String),
    /// An alarm, or a limit: into the safe state.
    Alarm(String),
}

/// What the safe state has come to.
pub enum Safe {
    /// Reached.
    Reached(String),
    /// Not reached, or nobody knows.
    Unknown(String),
}

impl Safe {
    /// Whether it is certain.
    pub const fn is_reached(&self) -> bool {
        matches!(self, Self::Reached(_))
    }
}

impl fmt::Display for Safe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reached(what) => f.write_str(what),
            Self::Unknown(what) => write!(f, "{what}; GO THERE AND LOOK"),
        }
    }
}

/// Both instruments, as far as they are connected.
pub struct Station<'p> {
    plan: &'p Plan,
    chamber: Option<Box<dyn Chamber>>,
    table: Option<Box<dyn Turntable>>,
    names: [String; 2],
    /// Whether the table may be in the middle of something: an earlier connection, or an earlier runner, has left it so.
    left: bool,
    /// Requests on lines that are closed by now that had to be repeated.
    repeated: [u64; 2],
}

impl<'p> Station<'p> {
    /// Neither is connected. `left` if an earlier runner has not ended in the safe state.
    pub fn new(plan: &'p Plan, left: bool) -> Self {
        Self { plan, chamber: None, table: None, names: [String::new(), String::new()], left, repeated: [0; 2] }
    }

    /// What chamber and table call themselves.
    pub fn names(&self) -> [String; 2] {
        self.names.clone()
    }

    /// Requests to chamber and table that had to be repeated.
    pub fn repeated(&self) -> [u64; 2] {
        let now = [self.chamber.as_ref().map(|c| c.repeated()), self.table.as_ref().map(|t| t.repeated())];
        [0, 1].map(|i| self.repeated[i] + now[i].unwrap_or_default())
    }

    /// Connects the chamber if it is not: nothing changes by it.
    ///
    /// # Errors
    /// What is in the way.
    pub fn connect_chamber(&mut self) -> Result<(), Watch> {
        if self.chamber.is_none() {
            let mut chamber = instruments::chamber(&self.plan.chamber).map_err(lost)?;
            self.names[0] = chamber.identify().map_err(lost)?;
            self.chamber = Some(chamber);
        }
        Ok(())
    }

    /// Connects and engages the table if it is not connected: nothing moves by it. Engaging resets faults, so that one which has come
    /// since the campaign began is looked for before.
    ///
    /// # Errors
    /// What is in the way.
    pub fn connect_table(&mut self) -> Result<(), Watch> {
        if self.table.is_none() {
            let mut table = instruments::turntable(&self.plan.table).map_err(lost)?;
            self.names[1] = table.identify().map_err(lost)?;
            if self.left {
                self.hold_to(&table.read().map_err(lost)?)?;
                table.stop().map_err(lost)?;
            }
            table.engage().map_err(lost)?;
            self.left = true;
            self.table = Some(table);
        }
        Ok(())
    }

    /// Faults and limits of the table.
    fn hold_to(&self, reading: &TurntableReading) -> Result<(), Watch> {
        if !reading.faults.is_empty() {
            return Err(Watch::Alarm(format!("the table has a fault: {}", reading.faults.join(", "))));
        }
        match self.plan.limits.reading(reading.angles_deg, reading.rates_deg_s) {
            Some(wrong) => Err(Watch::Alarm(format!("the table: {wrong}"))),
            None => Ok(()),
        }
    }

    fn chamber<T>(&mut self, ask: impl FnOnce(&mut dyn Chamber) -> Result<T, Fault>) -> Result<T, Watch> {
        let Some(chamber) = &mut self.chamber else {
            return Err(Watch::Lost("the chamber is not connected".to_owned()));
        };
        // The line is opened anew after whatever went wrong on it.
        let result = ask(chamber.as_mut());
        if result.is_err() {
            self.repeated[0] += self.chamber.take().map_or(0, |chamber| chamber.repeated());
        }
        result.map_err(lost)
    }

    fn table<T>(&mut self, ask: impl FnOnce(&mut dyn Turntable) -> Result<T, Fault>) -> Result<T, Watch> {
        let Some(table) = &mut self.table else { return Err(Watch::Lost("the table is not connected".to_owned())) };
        let result = ask(table.as_mut());
        if result.is_err() {
            self.drop_table();
        }
        result.map_err(lost)
    }

    fn drop_table(&mut self) {
        self.repeated[1] += self.table.take().map_or(0, |table| table.repeated());
    }

    /// Reads the chamber and holds it to alarms and limits.
    ///
    /// # Errors
    /// What is wrong.
    pub fn read_chamber(&mut self) -> Result<ChamberReading, Watch> {
        let reading = self.chamber(|chamber| chamber.read())?;
        if !reading.alarms.is_empty() {
            return Err(Watch::Alarm(format!("the chamber has an alarm: {}", reading.alarms.join(", "))));
        }
        match self.plan.limits.chamber(reading.air_c) {
            Some(wrong) => Err(Watch::Alarm(format!("the chamber's air: {wrong}"))),
            None => Ok(reading),
        }
    }

    /// Holds the air's rate of change \[degC/h\] to the ramp's limit.
    ///
    /// # Errors
    /// What is wrong.
    pub fn watch_ramp(&self, per_h: Option<f64>) -> Result<(), Watch> {
        match per_h.and_then(|per_h| self.plan.limits.ramp(per_h.abs() / 60.0 / SWING)) {
            Some(_) => {
                let per_min = per_h.unwrap_or_default() / 60.0;
                Err(Watch::Alarm(format!(
                    "the chamber's air changes by {per_min:.2} degC/min, far over limits.ramp_c_per_min"
                )))
            }
            None => Ok(()),
        }
    }

    /// Reads the table and holds it to faults and limits.
    ///
    /// # Errors
    /// What is wrong.
    pub fn read_table(&mut self) -> Result<TurntableReading, Watch> {
        let reading = self.table(|table| table.read())?;
        self.hold_to(&reading)?;
        if reading.open.is_empty() {
            Ok(reading)
        } else {
            Err(Watch::Alarm(format!("somebody has taken the table's power: {}", reading.open.join(", "))))
        }
    }

    /// Sets the chamber's set point \[degC\].
    ///
    /// # Errors
    /// What is wrong.
    pub fn set_point(&mut self, celsius: f64) -> Result<(), Watch> {
        refuse(self.plan.limits.chamber(celsius))?;
        self.chamber(|chamber| chamber.set_point(celsius))
    }

    /// Lets the chamber run.
    ///
    /// # Errors
    /// What is wrong.
    pub fn run(&mut self) -> Result<(), Watch> {
        self.chamber(|chamber| chamber.run())
    }

    /// Moves the table \[deg\].
    ///
    /// # Errors
    /// What is wrong.
    pub fn move_to(&mut self, angles_deg: [f64; 2]) -> Result<(), Watch> {
        let (limits, motion) = (&self.plan.limits, self.plan.motion);
        refuse(limits.angles(angles_deg))?;
        refuse(limits.rate(motion.rate_deg_s))?;
        refuse(limits.acceleration(motion.acceleration_deg_s2))?;
        self.table(|table| table.move_to(angles_deg, motion.rate_deg_s, motion.acceleration_deg_s2))
    }

    /// Stops the table, if that can be done now. It is engaged again when it is connected anew.
    pub fn stop_table(&mut self) {
        // One that does not answer is stopped by the safe state, or found stopped.
        let _ = self.table(|table| table.stop());
        self.drop_table();
    }

    /// The safe state: table stopped, chamber in standby or held at ambient. Tries hard, with both at once, and says what has come of
    /// it.
    pub fn safe(&mut self) -> (Safe, Safe) {
        let (plan, table, chamber) = (self.plan, self.table.take(), self.chamber.take());
        thread::scope(|scope| {
            let stopped = scope.spawn(move || safe_table(plan, table));
            let quiet = safe_chamber(plan, chamber);
            let panicked = || Safe::Unknown("table NOT known to be stopped: the program has failed".to_owned());
            (stopped.join().unwrap_or_else(|_| panicked()), quiet)
        })
    }
}

fn safe_table(plan: &Plan, mut table: Option<Box<dyn Turntable>>) -> Safe {
    let open = || {
        let mut table = instruments::turntable(&plan.table)?;
        table.identify().map(|_| table)
    };
    let still =
        |reading: &TurntableReading| reading.rates_deg_s.iter().all(|rate| rate.abs() <= plan.motion.still_deg_s);
    let stopped = persist(&mut table, open, |table| {
        table.stop()?;
        let begun = Instant::now();
        loop {
            let reading = table.read()?;
            if still(&reading) || begun.elapsed() > COMES_TO_REST {
                return Ok(reading);
            }
            thread::sleep(PAUSE);
        }
    });
    match stopped {
        Ok(reading) => {
            let [outer, inner] = reading.angles_deg;
            if still(&reading) {
                return Safe::Reached(format!("table stopped at {outer:.3}/{inner:.3} deg"));
            }
            let rates = reading.rates_deg_s;
            Safe::Unknown(format!("table was told to stop, but turns at {:.3}/{:.3} deg/s", rates[0], rates[1]))
        }
        Err(fault) => Safe::Unknown(format!("table NOT known to be stopped: {fault}")),
    }
}

/// Where the chamber is held \[degC\], if it is, and what it says after that.
type Quiet = (Option<f64>, ChamberReading);

fn standby(chamber: &mut (dyn Chamber + 'static)) -> Result<Quiet, Fault> {
    chamber.standby()?;
    chamber.read().map(|reading| (None, reading))
}

fn safe_chamber(plan: &Plan, mut chamber: Option<Box<dyn Chamber>>) -> Safe {
    let open = || {
        let mut chamber = instruments::chamber(&plan.chamber)?;
        chamber.identify().map(|_| chamber)
    };
    let quiet = match plan.ambient_c {
        None => persist(&mut chamber, open, standby),
        Some(ambient_c) => persist(&mut chamber, open, |chamber| {
            let reading = chamber.read()?;
            // One that does not run, or should not, is not told to.
            if !reading.running || !reading.alarms.is_empty() || plan.limits.chamber(reading.air_c).is_some() {
                return standby(chamber);
            }
            // Even ambient is only commanded within the limits.
            chamber.set_point(plan.limits.clamp_chamber(ambient_c))?;
            chamber.run()?;
            chamber.read().map(|reading| (Some(ambient_c), reading))
        })
        .or_else(|_| persist(&mut None, open, standby)),
    };
    match quiet {
        Ok((held, ChamberReading { air_c, running, .. })) if running == held.is_some() => {
            let what = held.map_or_else(|| "in standby".to_owned(), |ambient_c| format!("held at {ambient_c:?} degC"));
            Safe::Reached(format!("chamber {what}, air at {air_c:.1} degC"))
        }
        Ok(_) => Safe::Unknown("chamber was told to, but does not say that it is safe".to_owned()),
        Err(fault) => Safe::Unknown(format!("chamber NOT known to be safe: {fault}")),
    }
}

/// Tries `ask` some times, on a line that is opened anew after each failure.
fn persist<I: ?Sized, T>(
    instrument: &mut Option<Box<I>>,
    open: impl Fn() -> Result<Box<I>, Fault>,
    ask: impl Fn(&mut I) -> Result<T, Fault>,
) -> Result<T, Fault> {
    let mut attempt = 1;
    loop {
        let result = match instrument.take() {
            Some(instrument) => Ok(instrument),
            None => open(),
        };
        let result = result.and_then(|mut connected| ask(connected.as_mut()));
        match result {
            Err(_) if attempt < ATTEMPTS => {
                attempt += 1;
                thread::sleep(PAUSE);
            }
            result => return result,
        }
    }
}

fn lost(fault: Fault) -> Watch {
    match fault.kind {
        FaultKind::Alarm => Watch::Alarm(fault.to_string()),
        FaultKind::Line | FaultKind::NoReply | FaultKind::Garbled | FaultKind::Refused | FaultKind::Mismatch => {
            Watch::Lost(fault.to_string())
        }
    }
}

fn refuse(wrong: Option<String>) -> Result<(), Watch> {
    wrong.map_or(Ok(()), |wrong| Err(Watch::Alarm(format!("not commanded: {wrong}"))))
}
