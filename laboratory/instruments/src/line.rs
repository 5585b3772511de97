//! The line to an instrument: one request, then its reply or a time-out.
//!
//! # Rules
//! - There are never two requests at once. Bytes that are in the input before a request do not belong to its reply and are
//!   discarded.
//! - These protocols do not mark which request a reply belongs to. After a time-out or a garbled reply, a late reply may still
//!   arrive: nothing is sent until the line has been quiet for `quiet_s`.
//! - Every wait is bounded: a request takes at most (retries + 1) times (opening + drain + `timeout_s`). A drain ends after ten
//!   times `quiet_s`, whatever the instrument does.
//! - A lost port is closed, and opened again for the next request.

use super::fault::{FaultKind, InstrumentFault};
use super::line_config::LineConfig;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serialport::SerialPort;
use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::thread;
use std::time::{Duration, Instant};

/// Longest reply \[bytes\]; no reply of these protocols is as long.
const MAX_REPLY: usize = 4096;
/// Longest drain, in units of `quiet_s`.
const DRAIN: u32 = 10;

/// Why an exchange failed: kind and message, without the instrument's name, which [`Line::fault`] adds.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct ExchangeError(pub FaultKind, pub String);

impl ExchangeError {
    /// A reply that is damaged, or does not belong to the request.
    pub fn garbled(reply: &[u8]) -> Self {
        Self(FaultKind::Garbled, format!("a reply that makes no sense: \"{}\"", reply.escape_ascii()))
    }
}

/// How the end of a reply is found.
#[derive(Clone, Copy)]
pub struct Framing<'a> {
    /// Length of the reply at the beginning of these bytes, or `None` while it is incomplete.
    pub reply_length: &'a dyn Fn(&[u8]) -> Option<usize>,
    /// A pause of this length ends a reply too.
    pub gap: Option<Duration>,
}

/// A line. A lost port is opened again for the next request.
pub struct Line {
    /// Instrument and port, for messages.
    instrument: String,
    config: LineConfig,
    port: Option<InstrumentPort>,
    /// Whether a late reply may still arrive.
    stale: bool,
    /// When bytes were last sent or received.
    last_activity: Instant,
    repeated: u64,
}

impl Line {
    /// Opens the port.
    ///
    /// # Errors
    /// If that fails.
    pub fn open(kind: &str, config: &LineConfig) -> Result<Self, InstrumentFault> {
        let instrument = format!("{kind} at {}", config.port);
        // A reply to the previous user of the port may still arrive.
        let mut line = Self {
            instrument,
            config: config.clone(),
            port: None,
            stale: true,
            last_activity: Instant::now(),
            repeated: 0,
        };
        line.connect().map_err(|error| line.fault(error))?;
        Ok(line)
    }

    /// Requests that had to be repeated.
    pub const fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Adds the instrument's name to an error.
    pub fn fault(&self, ExchangeError(kind, message): ExchangeError) -> InstrumentFault {
        InstrumentFault { kind, instrument: self.instrument.clone(), message }
    }

    /// Sends a request and parses its reply with `read`. Repeats the request if there is no reply or a garbled one.
    ///
    /// # Errors
    /// The error of the last attempt, or the refusal that the reply contains.
    pub fn ask<T>(
        &mut self,
        request: &[u8],
        framing: Framing<'_>,
        read: impl Fn(&[u8]) -> Result<T, ExchangeError>,
    ) -> Result<T, InstrumentFault> {
        let shown = request.trim_ascii_end().escape_ascii().to_string();
        let mut attempt = 0;
        loop {
            let result = self.exchange(request, framing).and_then(|reply| read(&reply));
            let error = match result {
                Ok(value) => return Ok(value),
                Err(error) => error,
            };
            match error.0 {
                FaultKind::Line => (self.port, self.stale) = (None, true),
                FaultKind::NoReply | FaultKind::Garbled => self.stale = true,
                _ => attempt = self.config.retries,
            }
            if attempt == self.config.retries {
                let ExchangeError(kind, message) = error;
                return Err(self.fault(ExchangeError(kind, format!("asking \"{shown}\": {message}"))));
            }
            attempt += 1;
            self.repeated += 1;
        }
    }

    /// Sends a request that the instrument never answers.
    ///
    /// # Errors
    /// If the port is lost.
    pub fn send_without_reply(&mut self, request: &[u8]) -> Result<(), InstrumentFault> {
        self.send(request).map_err(|error| {
            self.port = None;
            self.fault(error)
        })
    }

    fn connect(&mut self) -> Result<(), ExchangeError> {
        if self.port.is_none() {
            let port = InstrumentPort::open(&self.config);
            self.port =
                Some(port.map_err(|error| ExchangeError(FaultKind::Line, format!("opening the port: {error}")))?);
        }
        Ok(())
    }

    fn send(&mut self, request: &[u8]) -> Result<(), ExchangeError> {
        self.connect()?;
        self.drain()?;
        thread::sleep(self.config.pause.saturating_sub(self.last_activity.elapsed()));
        let Some(port) = &mut self.port else { return Ok(()) };
        port.write(request).map_err(|error| ExchangeError(FaultKind::Line, format!("sending: {error}")))?;
        self.last_activity = Instant::now();
        Ok(())
    }

    /// Appends the next bytes, at least one, that arrive before `deadline`. Returns whether any arrived.
    fn receive(&mut self, bytes: &mut Vec<u8>, deadline: Instant) -> Result<bool, ExchangeError> {
        let mut buffer = [0; 512];
        let Some(port) = &mut self.port else { return Ok(false) };
        let count = loop {
            match port.read(&mut buffer, deadline.saturating_duration_since(Instant::now())) {
                // A signal ends the campaign, but not this wait: the reply will still arrive.
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => break other.map_err(|error| ExchangeError(FaultKind::Line, format!("receiving: {error}")))?,
            }
        };
        bytes.extend_from_slice(&buffer[..count]);
        if count > 0 {
            self.last_activity = Instant::now();
        }
        Ok(count > 0)
    }

    /// Discards the input. If a late reply may still arrive, goes on until the line is quiet.
    fn drain(&mut self) -> Result<(), ExchangeError> {
        let (begun, mut discarded) = (Instant::now(), Vec::new());
        let quiet = if self.stale { self.config.quiet } else { Duration::ZERO };
        while self.receive(&mut discarded, Instant::now() + quiet)? {
            discarded.clear();
            if begun.elapsed() > self.config.quiet * DRAIN {
                return Err(ExchangeError(FaultKind::Garbled, "it sends data without a request".to_owned()));
            }
        }
        self.stale = false;
        Ok(())
    }

    fn exchange(&mut self, request: &[u8], framing: Framing<'_>) -> Result<Vec<u8>, ExchangeError> {
        self.send(request)?;
        let deadline = self.last_activity + self.config.timeout;
        let mut reply = Vec::new();
        loop {
            let gap_end = framing.gap.filter(|_| !reply.is_empty()).map(|gap| self.last_activity + gap);
            let received = self.receive(&mut reply, gap_end.map_or(deadline, |end| end.min(deadline)))?;
            if let Some(length) = (framing.reply_length)(&reply) {
                reply.truncate(length);
                return Ok(reply);
            }
            if !received && gap_end.is_some() {
                return Ok(reply);
            }
            if reply.len() > MAX_REPLY || (!received || Instant::now() >= deadline) && !reply.is_empty() {
                return Err(ExchangeError::garbled(&reply[..reply.len().min(100)]));
            }
            if !received {
                let timeout = self.config.timeout.as_secs_f64();
                return Err(ExchangeError(FaultKind::NoReply, format!("no reply in {timeout} s")));
            }
        }
    }
}

/// Length of a reply that ends with a line feed.
pub fn line_feed(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\n').map(|end| end + 1)
}

/// Length of a reply that ends with a carriage return.
pub fn carriage_return(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\r').map(|end| end + 1)
}

/// The text of a reply without blanks around it. A reply with other bytes than printable ASCII is garbled.
pub fn text(reply: &[u8]) -> Result<&str, ExchangeError> {
    let trimmed = reply.trim_ascii();
    let printable = trimmed.iter().all(|&byte| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t'));
    let text = core::str::from_utf8(trimmed).ok().filter(|_| printable);
    text.ok_or_else(|| ExchangeError::garbled(reply))
}

/// Parses a finite number.
pub fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// An open port.
enum InstrumentPort {
    Serial(Box<dyn SerialPort>),
    Tcp(TcpStream),
}

impl InstrumentPort {
    fn open(config: &LineConfig) -> io::Result<Self> {
        let Some(address) = config.port.strip_prefix("tcp://") else {
            let port = serialport::new(&config.port, config.baud)
                .data_bits(config.data_bits)
                .parity(config.parity)
                .stop_bits(config.stop_bits)
                .timeout(config.timeout);
            return Ok(Self::Serial(port.open()?));
        };
        let mut refused = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
        for address in address.to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, config.timeout) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_write_timeout(Some(config.timeout))?;
                    return Ok(Self::Tcp(stream));
                }
                Err(error) => refused = error,
            }
        }
        Err(refused)
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Serial(port) => {
                port.write_all(bytes)?;
                port.flush()
            }
            Self::Tcp(stream) => stream.write_all(bytes),
        }
    }

    /// Reads at least one byte; returns 0 if none arrives within `timeout`.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let result = match self {
            Self::Serial(port) => {
                port.set_timeout(timeout)?;
                port.read(buffer)
            }
            Self::Tcp(stream) => {
                let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
                match poll(&mut [PollFd::new(stream, PollFlags::IN)], Some(&timeout)) {
                    Ok(0) => return Ok(0),
                    Ok(_) => stream.read(buffer),
                    Err(error) => Err(error.into()),
                }
            }
        };
        match result {
            Ok(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "closed by the other side")),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(0),
            other => other,
        }
    }
}
