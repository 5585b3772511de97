//! The safe state: turntable stopped, chamber in standby or held at ambient.
//!
//! Each instrument has a thread, so that none waits for the other. First the stop orders go out, at once and whatever the line
//! does (see `begin_orders` of the line), within [`FIRST_ORDERS`]. Then comes the usual protocol, with its waits and repetitions:
//! what the replies to the first orders have not acknowledged is ordered again, and the state is read back.

use super::plan::Plan;
use isotherm_instruments::{Chamber, ChamberReading, Instrument, InstrumentFault, Turntable, TurntableReading};
use std::fmt;
use std::mem;
use std::thread;
use std::time::{Duration, Instant};

/// Longest time from a signal, or from a reason to end, to the last of the first stop orders. The lines end their waits when they
/// see a signal, which takes [`NOTICE`] at most; the rest is for the orders.
pub const FIRST_ORDERS: Duration = Duration::from_secs(5);
/// Longest time until the loop has noticed a signal.
const NOTICE: Duration = Duration::from_secs(1);
/// Number of attempts at the safe state of an instrument.
const SAFE_ATTEMPTS: u32 = 5;
/// Pause between two attempts, and between two readings of a turntable that stops.
const SAFE_PAUSE: Duration = Duration::from_millis(300);
/// Longest time until the turntable is at rest after a stop command.
const STOP_TIMEOUT: Duration = Duration::from_secs(20);
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

/// Brings both instruments into the safe state. Both are commanded at the same time, first at once, then with several attempts.
/// `bool` says whether the instrument is connected. Returns the results of turntable and chamber.
pub fn enter(
    plan: &Plan,
    (turntable, turntable_connected): (&mut (dyn Turntable + 'static), bool),
    (chamber, chamber_connected): (&mut (dyn Chamber + 'static), bool),
) -> (SafeOutcome, SafeOutcome) {
    let until = Instant::now() + (FIRST_ORDERS - NOTICE);
    thread::scope(|scope| {
        let turntable = scope.spawn(|| stop_turntable(plan, turntable, turntable_connected, until));
        let chamber = make_chamber_safe(plan, chamber, chamber_connected, until);
        let panicked = || SafeOutcome::Unknown("table NOT known to be stopped: the program has failed".to_owned());
        (turntable.join().unwrap_or_else(|_| panicked()), chamber)
    })
}

/// Sends an order at once. Returns whether its reply acknowledges it.
fn order_first<I: Instrument + ?Sized>(
    instrument: &mut I,
    until: Instant,
    order: impl FnOnce(&mut I) -> Result<(), InstrumentFault>,
) -> bool {
    instrument.line_mut().begin_orders(until);
    let result = order(instrument);
    instrument.line_mut().end_orders();
    if let Err(fault) = &result {
        tracing::warn!("the first stop order is not acknowledged and will be repeated: {fault}");
    }
    result.is_ok()
}

/// Stops the turntable, and reads it until it is at rest.
fn stop_turntable(
    plan: &Plan,
    turntable: &mut (dyn Turntable + 'static),
    connected: bool,
    until: Instant,
) -> SafeOutcome {
    let mut acknowledged = order_first(turntable, until, |turntable| turntable.stop());
    let still =
        |reading: &TurntableReading| reading.rates_deg_s.iter().all(|rate| rate.abs() <= plan.motion.still_deg_s);
    let stopped = attempt(turntable, connected, |turntable| {
        if !mem::take(&mut acknowledged) {
            turntable.stop()?;
        }
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

/// Commands standby, or ambient if the plan says so, and reads the chamber back. The first order for ambient is the set point
/// alone, which starts no chamber.
fn make_chamber_safe(
    plan: &Plan,
    chamber: &mut (dyn Chamber + 'static),
    connected: bool,
    until: Instant,
) -> SafeOutcome {
    // The limits hold for ambient too.
    let ambient_c = plan.ambient_c.map(|ambient_c| plan.limits.clamp_chamber(ambient_c));
    let mut acknowledged = order_first(chamber, until, |chamber| match ambient_c {
        None => chamber.standby(),
        Some(ambient_c) => chamber.set_point(ambient_c),
    });
    let result = match ambient_c {
        None => attempt(chamber, connected, |chamber| {
            if !mem::take(&mut acknowledged) {
                chamber.standby()?;
            }
            chamber.read().map(|reading| (None, reading))
        }),
        Some(ambient_c) => attempt(chamber, connected, |chamber| {
            let reading = chamber.read()?;
            // A chamber that is stopped, has an alarm or exceeds a limit is not started.
            if !reading.running || !reading.alarms.is_empty() || plan.limits.chamber(reading.air_c).is_some() {
                return standby(chamber);
            }
            if !mem::take(&mut acknowledged) {
                chamber.set_point(ambient_c)?;
            }
            chamber.run()?;
            chamber.read().map(|reading| (Some(ambient_c), reading))
        })
        .or_else(|_| attempt(chamber, false, standby)),
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

/// Sends `request` up to [`SAFE_ATTEMPTS`] times. After each failure the line is opened anew, and the instrument identified.
fn attempt<I: Instrument + ?Sized, T>(
    instrument: &mut I,
    mut connected: bool,
    mut request: impl FnMut(&mut I) -> Result<T, InstrumentFault>,
) -> Result<T, InstrumentFault> {
    let mut attempts = 1;
    loop {
        let identified = if connected { Ok(()) } else { instrument.identify().map(drop) };
        match identified.and_then(|()| request(instrument)) {
            Err(_) if attempts < SAFE_ATTEMPTS => {
                attempts += 1;
                instrument.line_mut().close();
                connected = false;
                thread::sleep(SAFE_PAUSE);
            }
            result => return result,
        }
    }
}
