//! The ports of lines: serial devices and TCP connections, or simulated ones.
//!
//! A port never blocks beyond a deadline: even a device that takes no bytes (flow control, a full window, an adapter
//! that hangs) stops nobody for longer. Opening may: names are looked up and connections are made, which has no end
//! that the caller could bring about. So a port is opened by another thread than the caller, who looks whether it is
//! open.

use super::line_config::LineConfig;
use super::time::{Moment, RealTime, Time as _};
use isotherm_serial::{OpenSerial, connect};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::{io, thread};

/// An open port.
pub trait Port: Send {
    /// Whether its bytes take time after they are written, as those of a serial device do.
    fn is_serial(&self) -> bool;

    /// Writes some bytes; returns 0 if it takes none until `deadline`, or earlier if a signal comes.
    ///
    /// # Errors
    /// If the port is lost.
    fn write(&self, bytes: &[u8], deadline: Moment) -> io::Result<usize>;

    /// Reads at least one byte; returns 0 if none arrives until `deadline`, or earlier if a signal comes.
    ///
    /// # Errors
    /// If the port is lost.
    fn read(&self, buffer: &mut [u8], deadline: Moment) -> io::Result<usize>;
}

/// A port that is being opened. If it is dropped, the port is closed once it is open.
pub trait PendingPort: Send {
    /// The port, or why it cannot be opened; `None` if neither is known at `deadline`. Once it has returned something,
    /// it is not called again.
    fn wait(&mut self, deadline: Moment) -> Option<io::Result<Box<dyn Port>>>;
}

/// What opens ports.
pub trait Ports: Send + Sync {
    /// Begins to open a port.
    ///
    /// # Errors
    /// If that cannot begin.
    fn open(&self, config: &LineConfig) -> io::Result<Box<dyn PendingPort>>;
}

/// The ports of the machine. Each is opened in a thread of its own.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealPorts;

impl Ports for RealPorts {
    fn open(&self, config: &LineConfig) -> io::Result<Box<dyn PendingPort>> {
        let (opened, result) = mpsc::channel();
        let config = config.clone();
        let open = move || drop(opened.send(RealPort::open(&config)));
        thread::Builder::new().name("open port".to_owned()).spawn(open)?;
        Ok(Box::new(PendingRealPort(result)))
    }
}

struct PendingRealPort(Receiver<io::Result<RealPort>>);

impl PendingPort for PendingRealPort {
    fn wait(&mut self, deadline: Moment) -> Option<io::Result<Box<dyn Port>>> {
        match self.0.recv_timeout(deadline.since(RealTime.now())) {
            Ok(port) => Some(port.map(|port| Box::new(port) as Box<dyn Port>)),
            Err(RecvTimeoutError::Disconnected) => Some(Err(io::ErrorKind::Other.into())),
            Err(RecvTimeoutError::Timeout) => None,
        }
    }
}

/// An open serial device or TCP connection, as one descriptor.
struct RealPort {
    descriptor: Descriptor,
}

enum Descriptor {
    Serial(OpenSerial),
    Tcp(TcpStream),
}

impl AsFd for Descriptor {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Serial(line) => line.as_fd(),
            Self::Tcp(stream) => stream.as_fd(),
        }
    }
}

impl RealPort {
    /// Opens a device, or connects to a host.
    fn open(config: &LineConfig) -> io::Result<Self> {
        match config.port.strip_prefix("tcp://") {
            Some(address) => {
                connect(address, config.timeout).map(Descriptor::Tcp).map(|descriptor| Self { descriptor })
            }
            None => Ok(Self { descriptor: Descriptor::Serial(config.serial().open()?) }),
        }
    }

    /// Does it when the descriptor is ready; returns `None` if it is not ready until `deadline`. A signal ends the
    /// wait, so that the caller can look at it.
    fn when(
        &self,
        ready: PollFlags,
        deadline: Moment,
        mut transfer: impl FnMut() -> rustix::io::Result<usize>,
    ) -> io::Result<Option<usize>> {
        let wait = deadline.since(RealTime.now());
        let wait = Timespec::try_from(wait).map_err(io::Error::other)?;
        match poll(&mut [PollFd::new(&self.descriptor, ready)], Some(&wait)) {
            Ok(0) | Err(Errno::INTR) => return Ok(None),
            Ok(_) => {}
            Err(error) => return Err(error.into()),
        }
        match transfer() {
            Ok(count) => Ok(Some(count)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

impl Port for RealPort {
    fn is_serial(&self) -> bool {
        matches!(self.descriptor, Descriptor::Serial(_))
    }

    fn write(&self, bytes: &[u8], deadline: Moment) -> io::Result<usize> {
        self.when(PollFlags::OUT, deadline, || rustix::io::write(&self.descriptor, bytes))
            .map(Option::unwrap_or_default)
    }

    fn read(&self, buffer: &mut [u8], deadline: Moment) -> io::Result<usize> {
        match self.when(PollFlags::IN, deadline, || rustix::io::read(&self.descriptor, &mut *buffer))? {
            Some(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "closed by the other side")),
            Some(count) => Ok(count),
            None => Ok(0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::time::Duration;

    /// The other side never reads: its window and our buffer are full after some megabytes.
    #[test]
    fn a_peer_that_takes_nothing_does_not_hold_the_writer() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port =
            connect(&listener.local_addr().unwrap().to_string(), Duration::from_secs(20)).map(Descriptor::Tcp).unwrap();
        let port = RealPort { descriptor: port };
        let soon = || RealTime.now() + Duration::from_millis(50);
        let full = (0..10_000).any(|_| port.write(&[b'x'; 65536], soon()).unwrap() == 0);
        assert!(full);
        assert_eq!(port.write(b"STANDBY", soon()).unwrap(), 0);
        assert_eq!(port.read(&mut [0; 8], soon()).unwrap(), 0);
    }
}
