//! The port of a line: a serial device or a TCP connection, as one descriptor that never blocks.
//!
//! Only [`InstrumentPort::open`] may block, because names are looked up and connections are made there; the line calls
//! it in a thread of its own. Reading and writing wait with a deadline. Even a device that takes no bytes (flow
//! control, a full window, an adapter that hangs) stops nobody for longer.

use super::line_config::LineConfig;
use isotherm_serial::{OpenSerial, connect};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::io;
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Instant;

/// An open port.
pub(crate) struct InstrumentPort {
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

impl InstrumentPort {
    /// Opens a device, or connects to a host.
    pub(crate) fn open(config: &LineConfig) -> io::Result<Self> {
        match config.port.strip_prefix("tcp://") {
            Some(address) => {
                connect(address, config.timeout).map(Descriptor::Tcp).map(|descriptor| Self { descriptor })
            }
            None => Ok(Self { descriptor: Descriptor::Serial(config.serial().open()?) }),
        }
    }

    /// Whether it is a serial device: its bytes take time after they are written.
    pub(crate) const fn is_serial(&self) -> bool {
        matches!(self.descriptor, Descriptor::Serial(_))
    }

    /// Writes some bytes; returns 0 if it takes none until `deadline`.
    pub(crate) fn write(&self, bytes: &[u8], deadline: Instant) -> io::Result<usize> {
        self.when(PollFlags::OUT, deadline, || rustix::io::write(&self.descriptor, bytes))
            .map(Option::unwrap_or_default)
    }

    /// Reads at least one byte; returns 0 if none arrives until `deadline`.
    pub(crate) fn read(&self, buffer: &mut [u8], deadline: Instant) -> io::Result<usize> {
        match self.when(PollFlags::IN, deadline, || rustix::io::read(&self.descriptor, &mut *buffer))? {
            Some(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "closed by the other side")),
            Some(count) => Ok(count),
            None => Ok(0),
        }
    }

    /// Does it when the descriptor is ready; returns `None` if it is not ready until `deadline`. A signal ends the
    /// wait, so that the caller can look at it.
    fn when(
        &self,
        ready: PollFlags,
        deadline: Instant,
        mut transfer: impl FnMut() -> rustix::io::Result<usize>,
    ) -> io::Result<Option<usize>> {
        let wait = deadline.saturating_duration_since(Instant::now());
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
        let port = InstrumentPort { descriptor: port };
        let soon = || Instant::now() + Duration::from_millis(50);
        let full = (0..10_000).any(|_| port.write(&[b'x'; 65536], soon()).unwrap() == 0);
        assert!(full);
        assert_eq!(port.write(b"STANDBY", soon()).unwrap(), 0);
        assert_eq!(port.read(&mut [0; 8], soon()).unwrap(), 0);
    }
}
