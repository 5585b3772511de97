//! The line to an instrument: one request, then its reply or a time-out.
//!
//! # Rules
//! - Never two requests at once. What is in the input before a request is none of its reply and is thrown away.
//! - These protocols carry no tag that says which request a reply belongs to. So after a time-out, or a reply that made no sense, a
//!   reply may still be on its way: nothing is sent until the line has been quiet for `quiet_s`.
//! - Every wait has an end: a request takes at most (retries + 1) times (opening + drain + `timeout_s`), where a drain ends after ten
//!   times `quiet_s`, whatever the instrument does.
//! - A port that is lost is closed, and opened again for the next request.

use super::line_config::LineConfig;
use super::{Fault, FaultKind};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serialport::SerialPort;
use std::io::{self, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::thread;
use std::time::{Duration, Instant};

/// Longest reply; nothing that an instrument says is as long.
const MAX_REPLY: usize = 4096;
/// A drain ends after so many times `quiet_s`.
const DRAIN: u32 = 10;

/// What is wrong with a reply, or with what it says.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Wrong(pub FaultKind, pub String);

impl Wrong {
    /// A reply that is none of the request's.
    pub fn garbled(reply: &[u8]) -> Self {
        Self(FaultKind::Garbled, format!("a reply that makes no sense: \"{}\"", reply.escape_ascii()))
    }
}

/// Where a reply ends.
#[derive(Clone, Copy)]
pub struct Framing<'a> {
    /// How long the reply at the beginning of these bytes is, once it is whole.
    pub whole: &'a dyn Fn(&[u8]) -> Option<usize>,
    /// A pause that ends a reply too, if any.
    pub gap: Option<Duration>,
}

/// A line, open or to be opened again.
pub struct Line {
    /// Instrument and port, for messages.
    instrument: String,
    config: LineConfig,
    port: Option<Port>,
    /// Whether a reply may still be on its way.
    stale: bool,
    /// When bytes last went or came.
    last: Instant,
    repeated: u64,
}

impl Line {
    /// Opens the port.
    ///
    /// # Errors
    /// If that fails.
    pub fn open(kind: &str, config: &LineConfig) -> Result<Self, Fault> {
        let instrument = format!("{kind} at {}", config.port);
        // Whoever had the port before may have left a reply on its way.
        let mut line =
            Self { instrument, config: config.clone(), port: None, stale: true, last: Instant::now(), repeated: 0 };
        line.connect().map_err(|wrong| line.fault(wrong))?;
        Ok(line)
    }

    /// Requests that had to be repeated.
    pub const fn repeated(&self) -> u64 {
        self.repeated
    }

    /// As this line's fault.
    pub fn fault(&self, Wrong(kind, message): Wrong) -> Fault {
        Fault { kind, instrument: self.instrument.clone(), message }
    }

    /// Sends a request and reads its reply with `read`. Repeated if there is none or it is garbled.
    ///
    /// # Errors
    /// What was wrong in the last attempt, or what is wrong with what the reply says.
    pub fn ask<T>(
        &mut self,
        request: &[u8],
        framing: Framing<'_>,
        read: impl Fn(&[u8]) -> Result<T, Wrong>,
    ) -> Result<T, Fault> {
        let shown = request.trim_ascii_end().escape_ascii().to_string();
        let mut attempt = 0;
        loop {
            let result = self.exchange(request, framing).and_then(|reply| read(&reply));
            let wrong = match result {
                Ok(value) => return Ok(value),
                Err(wrong) => wrong,
            };
            match wrong.0 {
                FaultKind::Line => (self.port, self.stale) = (None, true),
                FaultKind::NoReply | FaultKind::Garbled => self.stale = true,
                _ => attempt = self.config.retries,
            }
            if attempt == self.config.retries {
                let Wrong(kind, message) = wrong;
                return Err(self.fault(Wrong(kind, format!("asking \"{shown}\": {message}"))));
            }
            attempt += 1;
            self.repeated += 1;
        }
    }

    /// Sends what is never answered.
    ///
    /// # Errors
    /// If the port is lost.
    pub fn tell(&mut self, request: &[u8]) -> Result<(), Fault> {
        self.send(request).map_err(|wrong| {
            self.port = None;
            self.fault(wrong)
        })
    }

    fn connect(&mut self) -> Result<(), Wrong> {
        if self.port.is_none() {
            let port = Port::open(&self.config);
            self.port = Some(port.map_err(|error| Wrong(FaultKind::Line, format!("opening the port: {error}")))?);
        }
        Ok(())
    }

    fn send(&mut self, request: &[u8]) -> Result<(), Wrong> {
        self.connect()?;
        self.drain()?;
        thread::sleep(self.config.pause.saturating_sub(self.last.elapsed()));
        let Some(port) = &mut self.port else { return Ok(()) };
        port.write(request).map_err(|error| Wrong(FaultKind::Line, format!("sending: {error}")))?;
        self.last = Instant::now();
        Ok(())
    }

    /// One byte or more that come before `deadline`, appended; whether any came.
    fn receive(&mut self, bytes: &mut Vec<u8>, deadline: Instant) -> Result<bool, Wrong> {
        let mut buffer = [0; 512];
        let Some(port) = &mut self.port else { return Ok(false) };
        let count = loop {
            match port.read(&mut buffer, deadline.saturating_duration_since(Instant::now())) {
                // By a signal, which ends the campaign, but not this wait: the reply is still on its way.
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => break other.map_err(|error| Wrong(FaultKind::Line, format!("receiving: {error}")))?,
            }
        };
        bytes.extend_from_slice(&buffer[..count]);
        if count > 0 {
            self.last = Instant::now();
        }
        Ok(count > 0)
    }

    /// Throws away what has come; if a reply may still be on its way, until the line is quiet.
    fn drain(&mut self) -> Result<(), Wrong> {
        let (begun, mut waste) = (Instant::now(), Vec::new());
        let quiet = if self.stale { self.config.quiet } else { Duration::ZERO };
        while self.receive(&mut waste, Instant::now() + quiet)? {
            waste.clear();
            if begun.elapsed() > self.config.quiet * DRAIN {
                return Err(Wrong(FaultKind::Garbled, "it talks without being asked".to_owned()));
            }
        }
        self.stale = false;
        Ok(())
    }

    fn exchange(&mut self, request: &[u8], framing: Framing<'_>) -> Result<Vec<u8>, Wrong> {
        self.send(request)?;
        let deadline = self.last + self.config.timeout;
        let mut reply = Vec::new();
        loop {
            let gap_end = framing.gap.filter(|_| !reply.is_empty()).map(|gap| self.last + gap);
            let came = self.receive(&mut reply, gap_end.map_or(deadline, |end| end.min(deadline)))?;
            if let Some(length) = (framing.whole)(&reply) {
                reply.truncate(length);
                return Ok(reply);
            }
            if !came && gap_end.is_some() {
                return Ok(reply);
            }
            if reply.len() > MAX_REPLY || (!came || Instant::now() >= deadline) && !reply.is_empty() {
                return Err(Wrong::garbled(&reply[..reply.len().min(100)]));
            }
            if !came {
                let timeout = self.config.timeout.as_secs_f64();
                return Err(Wrong(FaultKind::NoReply, format!("no reply in {timeout} s")));
            }
        }
    }
}

/// A reply that ends with a line feed.
pub fn line_feed(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\n').map(|end| end + 1)
}

/// A reply that ends with a carriage return.
pub fn carriage_return(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == b'\r').map(|end| end + 1)
}

/// A reply's text without blanks around it; only printable ASCII is text.
pub fn text(reply: &[u8]) -> Result<&str, Wrong> {
    let trimmed = reply.trim_ascii();
    let printable = trimmed.iter().all(|&byte| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t'));
    let text = core::str::from_utf8(trimmed).ok().filter(|_| printable);
    text.ok_or_else(|| Wrong::garbled(reply))
}

/// A finite number.
pub fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

enum Port {
    Serial(Box<dyn SerialPort>),
    Tcp(TcpStream),
}

impl Port {
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

    /// Some bytes, or 0 if none come within `timeout`.
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
