//! The safe state: turntable stopped, chamber in standby or held at ambient.
//!
//! Each instrument has a thread, so that none waits for the other. First the stop orders go out, at once and whatever
//! the line does (see `begin_orders` of the line), within [`FIRST_ORDERS`]. Then comes the usual protocol, with its
//! waits and repetitions: what the replies to the first orders have not acknowledged is ordered again, and the state is
//! read back. If that fails, all begins anew, the orders first: one spoiled byte loses an order, and a line that
//! babbles lets nothing else through.

use super::plan::Plan;
use isotherm_instruments::{
    ChamberInstrument, ChamberReading, Instrument, InstrumentFault, Time, TurntableInstrument, TurntableReading,
};
use std::fmt;
use std::time::Duration;

/// Longest time from a signal, or from a reason to end, to the last of the first stop orders. The lines end their waits
/// when they see a signal, which takes [`NOTICE`] at most; the rest is for the orders.
pub(crate) const FIRST_ORDERS: Duration = Duration::from_secs(5);
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

/// Brings both instruments into the safe state. Both are commanded at the same time, first at once, then with several
/// attempts. `bool` says whether the instrument is connected. Returns the results of turntable and chamber.
pub(crate) fn enter(
    plan: &Plan,
    time: &dyn Time,
    (turntable, turntable_connected): (&mut (dyn TurntableInstrument + 'static), bool),
    (chamber, chamber_connected): (&mut (dyn ChamberInstrument + 'static), bool),
) -> (SafeOutcome, SafeOutcome) {
    let failed = |which: &str| SafeOutcome::Unknown(format!("{which}: the program has failed"));
    let mut outcomes = (failed("turntable NOT known to be stopped"), failed("chamber NOT known to be safe"));
    time.both(&mut || outcomes.0 = stop_turntable(plan, time, turntable, turntable_connected), &mut || {
        outcomes.1 = make_chamber_safe(plan, time, chamber, chamber_connected);
    });
    outcomes
}

/// Stops the turntable, and reads it until it is at rest.
fn stop_turntable(
    plan: &Plan,
    time: &dyn Time,
    turntable: &mut (dyn TurntableInstrument + 'static),
    connected: bool,
) -> SafeOutcome {
    let still =
        |reading: &TurntableReading| reading.rates_deg_s.iter().all(|rate| rate.abs() <= plan.motion.still_deg_s);
    let stopped = attempt(
        time,
        turntable,
        connected,
        |turntable| turntable.stop(),
        |turntable, acknowledged| {
            if !acknowledged {
                turntable.stop()?;
            }
            let begun = time.now();
            loop {
                let reading = turntable.read()?;
                if still(&reading) {
                    let [outer, inner] = reading.angles_deg;
                    return Ok(SafeOutcome::Reached(format!("turntable stopped at {outer:.3}/{inner:.3} deg")));
                }
                if time.now().since(begun) > STOP_TIMEOUT {
                    let [outer, inner] = reading.rates_deg_s;
                    let message = format!("turntable was ordered to stop, but turns at {outer:.3}/{inner:.3} deg/s");
                    return Ok(SafeOutcome::Unknown(message));
                }
                time.sleep_until(time.now() + SAFE_PAUSE);
            }
        },
    );
    stopped.unwrap_or_else(|fault| SafeOutcome::Unknown(format!("turntable NOT known to be stopped: {fault}")))
}

/// Commands standby, or ambient if the plan says so, and reads the chamber back. The first order for ambient is only
/// the set point, which starts no chamber.
fn make_chamber_safe(
    plan: &Plan,
    time: &dyn Time,
    chamber: &mut (dyn ChamberInstrument + 'static),
    connected: bool,
) -> SafeOutcome {
    let mut connected = connected;
    if let Some(ambient_c) = ambient_c(plan) {
        let held = attempt(
            time,
            chamber,
            connected,
            |chamber| chamber.set_point(ambient_c),
            |chamber, acknowledged| {
                let reading = chamber.read()?;
                // A chamber that is stopped, has an alarm or exceeds a limit is not started.
                if !reading.running || !reading.alarms.is_empty() || plan.limits.chamber(reading.air_c).is_some() {
                    return standby(chamber, false);
                }
                if !acknowledged {
                    chamber.set_point(ambient_c)?;
                }
                chamber.run()?;
                read_back(chamber, Some(ambient_c))
            },
        );
        match held {
            Ok(held) if held.is_reached() => return held,
            _ => connected = false,
        }
    }
    attempt(time, chamber, connected, |chamber| chamber.standby(), standby)
        .unwrap_or_else(|fault| SafeOutcome::Unknown(format!("chamber NOT known to be safe: {fault}")))
}

/// Commands standby if it is not `acknowledged` yet, and reads the chamber back.
fn standby(
    chamber: &mut (dyn ChamberInstrument + 'static),
    acknowledged: bool,
) -> Result<SafeOutcome, InstrumentFault> {
    if !acknowledged {
        chamber.standby()?;
    }
    read_back(chamber, None)
}

/// Whether the chamber holds this set point \[degC\], or is in standby with `None`.
fn read_back(
    chamber: &mut (dyn ChamberInstrument + 'static),
    held_c: Option<f64>,
) -> Result<SafeOutcome, InstrumentFault> {
    let ChamberReading { air_c, running, other_mode, .. } = chamber.read()?;
    if running != held_c.is_some() || other_mode.is_some() {
        let message = "chamber was commanded into the safe state, but does not confirm it";
        return Ok(SafeOutcome::Unknown(message.to_owned()));
    }
    let state = held_c.map_or_else(|| "in standby".to_owned(), |held_c| format!("held at {held_c:?} degC"));
    Ok(SafeOutcome::Reached(format!("chamber {state}, air at {air_c:.1} degC")))
}

/// Tries up to [`SAFE_ATTEMPTS`] times. Each attempt sends `order` at once; then `confirm` gets whether it was
/// acknowledged, and does the rest by the line's usual rules. After each failure the line is opened anew, and the
/// instrument identified before `confirm`.
fn attempt<I: Instrument + ?Sized>(
    time: &dyn Time,
    instrument: &mut I,
    mut connected: bool,
    order: impl Fn(&mut I) -> Result<(), InstrumentFault>,
    confirm: impl Fn(&mut I, bool) -> Result<SafeOutcome, InstrumentFault>,
) -> Result<SafeOutcome, InstrumentFault> {
    // The signal has done its work.
    instrument.line_mut().ignore_signal();
    let mut attempts = 1;
    loop {
        let acknowledged = order_at_once(time, instrument, &order);
        let identified = if connected { Ok(()) } else { instrument.identify().map(drop) };
        let result = identified.and_then(|()| confirm(instrument, acknowledged));
        if attempts == SAFE_ATTEMPTS || result.as_ref().is_ok_and(SafeOutcome::is_reached) {
            return result;
        }
        attempts += 1;
        instrument.line_mut().close();
        connected = false;
        time.sleep_until(time.now() + SAFE_PAUSE);
    }
}

/// Orders a chamber at once into what the plan calls its safe state: standby, or ambient.
pub(crate) fn order_chamber(plan: &Plan, time: &dyn Time, chamber: &mut (dyn ChamberInstrument + 'static)) {
    order_at_once(time, chamber, |chamber| match ambient_c(plan) {
        Some(ambient_c) => chamber.set_point(ambient_c),
        None => chamber.standby(),
    });
}

/// The temperature that the safe state holds \[degC\]; `None` for standby. The limits hold for ambient too.
fn ambient_c(plan: &Plan) -> Option<f64> {
    plan.ambient_c.map(|ambient_c| plan.limits.clamp_chamber(ambient_c))
}

/// Sends an order at once. Returns whether its reply acknowledges it.
pub(crate) fn order_at_once<I: Instrument + ?Sized>(
    time: &dyn Time,
    instrument: &mut I,
    order: impl FnOnce(&mut I) -> Result<(), InstrumentFault>,
) -> bool {
    instrument.line_mut().begin_orders(time.now() + (FIRST_ORDERS - NOTICE));
    let result = order(instrument);
    let still = instrument.line_mut().end_orders();
    if let Err(fault) = &result {
        tracing::warn!("a stop order is not acknowledged: {fault}");
    }
    result.is_ok() && still
}
