//! The line to an instrument: one request, then its reply or a time-out.
//!
//! # Rules
//! - There are never two requests at once. Bytes that are in the input before a request do not belong to its reply and
//!   are discarded.
//! - These protocols do not mark which request a reply belongs to. After a time-out or a garbled reply, a late reply
//!   may still arrive: nothing is sent until the line has been quiet for `quiet_s`.
//! - A reading of several requests is taken again if one of them had to be repeated: what followed it may have had
//!   the replies to others.
//! - Every wait is bounded: a request takes at most (retries + 1) times (opening + drain + sending + reply). A line
//!   that does not keep still for `quiet_s` within [`STILL_WITHIN`] times that is at fault, and the request is not
//!   repeated.
//! - A lost port is closed, and opened again for the next request.
//! - A signal that asks to end also ends every wait; only a reply that is under way may still arrive for [`GRACE`]. No
//!   further request is sent.
//! - Orders that lead to the safe state ([`Line::begin_orders`]) break the first two rules: they go out at once,
//!   whatever arrives. Only the reply of a line that was still counts as an acknowledgement.

use super::fault::{FaultKind, InstrumentFault};
use super::line_config::LineConfig;
use super::port::{PendingPort, Port};
use super::reply::{ExchangeError, Framing};
use super::surroundings::Surroundings;
use super::time::Moment;
use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// Longest reply \[bytes\]; no reply of these protocols is as long.
const MAX_REPLY: usize = 4096;
/// A line must become quiet within this multiple of `quiet_s`, and may always try for [`MIN_STILL_WITHIN`].
const STILL_WITHIN: u32 = 3;
const MIN_STILL_WITHIN: Duration = Duration::from_secs(1);
/// How long the line must be quiet after bytes that nobody has asked for, between two requests that were answered.
const STRAY_QUIET: Duration = Duration::from_millis(50);
/// The stop signal is looked at so often during a wait.
const SLICE: Duration = Duration::from_millis(50);
/// How long the reply to the request under way is waited for after the stop signal: a controller that works answers
/// sooner, and can then take the next request.
const GRACE: Duration = Duration::from_millis(500);
/// Longest wait for a first order to be taken, longest wait for its reply, and longest silence before it.
const ORDER_WAIT: Duration = Duration::from_millis(300);

/// A line. A lost port is opened again for the next request.
pub struct Line {
    /// Instrument and port, for messages.
    instrument: String,
    config: LineConfig,
    around: Surroundings,
    port: Option<Box<dyn Port>>,
    /// A port that is being opened; one that never opens is waited for again, and not opened twice.
    opening: Option<Box<dyn PendingPort>>,
    /// Whether a late reply may still arrive.
    stale: bool,
    /// When bytes were last received, or the last byte that was sent has left.
    last_activity: Moment,
    repeated: u64,
    /// When this line first saw the signal.
    stopped: Option<Moment>,
    /// The end of the time for the first orders, while they go out.
    orders_until: Option<Moment>,
}

impl Line {
    /// A line whose port is not open yet.
    pub(super) fn new(kind: &str, config: &LineConfig, around: &Surroundings) -> Self {
        Self {
            instrument: format!("{kind} at {}", config.port),
            config: config.clone(),
            around: around.clone(),
            port: None,
            opening: None,
            // A reply to the previous user of the port may still arrive.
            stale: true,
            last_activity: around.time.now(),
            repeated: 0,
            stopped: None,
            orders_until: None,
        }
    }

    /// Requests that had to be repeated.
    #[must_use]
    pub const fn repeated(&self) -> u64 {
        self.repeated
    }

    /// From now on requests are orders that go out at once: until `until` the line waits for no silence, only shortly
    /// for a reply, and repeats a request only on a port that it had to open anew. No signal ends these waits.
    pub const fn begin_orders(&mut self, until: Moment) {
        self.orders_until = Some(until);
    }

    /// From now on the stop signal ends no wait: it has done its work.
    pub fn ignore_signal(&mut self) {
        self.around.stop_signal = Arc::default();
    }

    /// From now on requests obey the line's rules again. Returns whether the line was still, so that the replies to the
    /// orders can be distinguished from others.
    pub const fn end_orders(&mut self) -> bool {
        self.orders_until = None;
        !self.stale
    }

    /// A late reply may still arrive, though the last request was answered.
    pub(super) const fn doubt(&mut self) {
        self.stale = true;
    }

    /// Whether requests are orders that go out at once.
    pub(super) const fn has_orders(&self) -> bool {
        self.orders_until.is_some()
    }

    /// Opens the port, if it is not open.
    ///
    /// # Errors
    /// If that fails.
    pub fn connect(&mut self) -> Result<(), InstrumentFault> {
        self.open().map_err(|error| self.fault(error))
    }

    /// Closes the port. The next request opens it again.
    pub fn close(&mut self) {
        if self.is_serial() {
            // Closing discards what has not left yet.
            self.around.time.sleep_until(self.last_activity);
        }
        self.lose();
    }

    fn lose(&mut self) {
        (self.port, self.stale) = (None, true);
    }

    fn is_serial(&self) -> bool {
        self.port.as_ref().is_some_and(|port| port.is_serial())
    }

    fn now(&self) -> Moment {
        self.around.time.now()
    }

    /// Adds the instrument's name to an error.
    pub(super) fn fault(&self, ExchangeError(kind, message): ExchangeError) -> InstrumentFault {
        InstrumentFault { kind, instrument: self.instrument.clone(), message }
    }

    /// Sends a request and parses its reply with `read`. Repeats the request if there is no reply or a garbled one.
    ///
    /// # Errors
    /// The error of the last attempt, or the refusal that the reply contains.
    pub(super) fn ask<T>(
        &mut self,
        request: &[u8],
        framing: Framing<'_>,
        read: impl Fn(&[u8]) -> Result<T, ExchangeError>,
    ) -> Result<T, InstrumentFault> {
        self.attempts(request, |line| read(&line.exchange(request, framing)?))
    }

    /// Sends a request that the instrument never answers.
    ///
    /// # Errors
    /// If the port is lost.
    pub(super) fn send_without_reply(&mut self, request: &[u8]) -> Result<(), InstrumentFault> {
        self.attempts(request, |line| line.send(request))
    }

    fn attempts<T>(
        &mut self,
        request: &[u8],
        attempt: impl Fn(&mut Self) -> Result<T, ExchangeError>,
    ) -> Result<T, InstrumentFault> {
        let mut repeated = 0;
        loop {
            let error = match self.check_stop(Duration::ZERO).and_then(|()| attempt(self)) {
                Ok(value) => return Ok(value),
                Err(error) => error,
            };
            match error.0 {
                FaultKind::Line => self.lose(),
                FaultKind::NoReply | FaultKind::Garbled | FaultKind::Babble | FaultKind::Stopped => self.stale = true,
                FaultKind::Refused | FaultKind::Alarm | FaultKind::Mismatch => {}
            }
            let retries = match (error.0, self.orders_until) {
                (FaultKind::Line, Some(until)) => u32::from(self.now() < until),
                (FaultKind::Line | FaultKind::NoReply | FaultKind::Garbled, None) => self.config.retries,
                _ => 0,
            };
            if repeated >= retries || self.check_stop(Duration::ZERO).is_err() {
                let ExchangeError(kind, message) = error;
                let shown = request.trim_ascii_end().escape_ascii();
                return Err(self.fault(ExchangeError(kind, format!("asking \"{shown}\": {message}"))));
            }
            repeated += 1;
            self.repeated += 1;
        }
    }

    /// An error if the stop signal came longer than `grace` ago.
    fn check_stop(&mut self, grace: Duration) -> Result<(), ExchangeError> {
        if self.has_orders() || self.around.stop_signal.load(Relaxed) == 0 {
            return Ok(());
        }
        let now = self.now();
        if now.since(*self.stopped.get_or_insert(now)) < grace {
            return Ok(());
        }
        Err(ExchangeError(FaultKind::Stopped, "not waited for, because a signal asks to end".to_owned()))
    }

    /// Opens the port, if it is not open.
    fn open(&mut self) -> Result<(), ExchangeError> {
        if self.port.is_some() {
            return Ok(());
        }
        let failed = |error: &io::Error| ExchangeError::line("opening the port", error);
        let mut opening = match self.opening.take() {
            Some(opening) => opening,
            None => self.around.ports.open(&self.config).map_err(|error| failed(&error))?,
        };
        loop {
            let slice = self.now() + SLICE;
            if let Some(port) = opening.wait(self.orders_until.map_or(slice, |until| slice.min(until))) {
                self.port = Some(port.map_err(|error| failed(&error))?);
                return Ok(());
            }
            let is_late = self.orders_until.is_some_and(|until| self.now() >= until);
            let ended = match self.check_stop(Duration::ZERO) {
                Err(stopped) => Some(stopped),
                Ok(()) => is_late.then(|| failed(&io::ErrorKind::TimedOut.into())),
            };
            if let Some(ended) = ended {
                self.opening = Some(opening);
                return Err(ended);
            }
        }
    }

    fn send(&mut self, request: &[u8]) -> Result<(), ExchangeError> {
        self.open()?;
        if self.has_orders() {
            self.discard_input()?;
        } else {
            self.drain()?;
        }
        self.pause()?;
        self.write(request)
    }

    /// Waits until the line has been silent for `pause_s`.
    fn pause(&mut self) -> Result<(), ExchangeError> {
        let mut until = self.last_activity + self.config.pause;
        if let Some(end) = self.orders_until {
            until = until.min(end).min(self.now() + ORDER_WAIT);
        }
        while self.now() < until {
            self.check_stop(Duration::ZERO)?;
            self.around.time.sleep_until(until.min(self.now() + SLICE));
        }
        Ok(())
    }

    fn write(&mut self, request: &[u8]) -> Result<(), ExchangeError> {
        let deadline = self.deadline(self.now());
        let mut rest = request;
        loop {
            let Some(port) = &self.port else { return Ok(()) };
            let slice = deadline.min(self.now() + SLICE);
            let count = port.write(rest, slice).map_err(|error| ExchangeError::line("sending", &error))?;
            rest = rest.get(count..).unwrap_or_default();
            if rest.is_empty() {
                break;
            }
            // A part of a request would become the beginning of the next one: an error of the line closes the port.
            if self.now() >= deadline || self.check_stop(Duration::ZERO).is_err() {
                return Err(ExchangeError(FaultKind::Line, "sending: the port takes no bytes".to_owned()));
            }
        }
        self.last_activity = self.now();
        if self.is_serial() {
            self.last_activity = self.last_activity + self.config.transmission(request.len());
        }
        Ok(())
    }

    /// The end of a wait that begins at `from`.
    fn deadline(&self, from: Moment) -> Moment {
        match self.orders_until {
            Some(until) => (from + ORDER_WAIT.min(self.config.timeout)).min(until),
            None => from + self.config.timeout,
        }
    }

    /// Appends the next bytes, at least one, that arrive before `deadline`. Returns whether any arrived. The stop
    /// signal ends the wait after `grace`.
    fn receive(&mut self, bytes: &mut Vec<u8>, deadline: Moment, grace: Duration) -> Result<bool, ExchangeError> {
        let mut buffer = [0; 512];
        loop {
            self.check_stop(grace)?;
            let Some(port) = &self.port else { return Ok(false) };
            let slice = deadline.min(self.now() + SLICE);
            let count = port.read(&mut buffer, slice).map_err(|error| ExchangeError::line("receiving", &error))?;
            if count > 0 {
                bytes.extend_from_slice(&buffer[..count]);
                self.last_activity = self.now();
                return Ok(true);
            }
            if self.now() >= deadline {
                return Ok(false);
            }
        }
    }

    /// Discards the input. If a late reply may still arrive, or if anything is there, goes on until the line is quiet.
    fn drain(&mut self) -> Result<(), ExchangeError> {
        let (begun, mut discarded) = (self.now(), Vec::new());
        let mut quiet = if self.stale { self.config.quiet } else { Duration::ZERO };
        let limit = (self.config.quiet * STILL_WITHIN).max(MIN_STILL_WITHIN);
        while self.receive(&mut discarded, self.now() + quiet, Duration::ZERO)? {
            discarded.clear();
            quiet = quiet.max(STRAY_QUIET);
            if self.now().since(begun) > limit {
                let (quiet, limit) = (quiet.as_secs_f64(), limit.as_secs_f64());
                let message =
                    format!("babble: it sends without a request, and is not quiet for {quiet} s within {limit} s");
                return Err(ExchangeError(FaultKind::Babble, message));
            }
        }
        self.stale = false;
        Ok(())
    }

    /// Discards what has arrived, without any wait. After that a reply cannot be trusted.
    fn discard_input(&mut self) -> Result<(), ExchangeError> {
        let mut discarded = Vec::new();
        while discarded.len() < MAX_REPLY && self.receive(&mut discarded, self.now(), Duration::ZERO)? {
            self.stale = true;
        }
        Ok(())
    }

    fn exchange(&mut self, request: &[u8], framing: Framing<'_>) -> Result<Vec<u8>, ExchangeError> {
        self.send(request)?;
        let deadline = self.deadline(self.last_activity);
        let mut reply = Vec::new();
        loop {
            let gap_end = framing.gap.filter(|_| !reply.is_empty()).map(|gap| self.last_activity + gap);
            let received = self.receive(&mut reply, gap_end.map_or(deadline, |end| end.min(deadline)), GRACE)?;
            if let Some(length) = (framing.reply_length)(&reply) {
                reply.truncate(length);
                return Ok(reply);
            }
            // What the deadline ends may be the begin of a reply.
            if !received && gap_end.is_some_and(|end| end < deadline) {
                return Ok(reply);
            }
            if reply.len() > MAX_REPLY || (!received || self.now() >= deadline) && !reply.is_empty() {
                return Err(ExchangeError::garbled(&reply));
            }
            if !received {
                let waited = deadline.since(self.last_activity).as_secs_f64();
                return Err(ExchangeError(FaultKind::NoReply, format!("no reply in {waited} s")));
            }
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.close();
    }
}
