//! Serial lines, as instruments and IMUs are connected to: opened raw, at any rate, by one program at a time; or over
//! TCP, behind a converter.

use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, ioctl_tiocexcl, ioctl_tiocnxcl, tcflush, tcgetattr,
    tcsetattr,
};
use std::io;
use std::net::{TcpStream, ToSocketAddrs as _};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// An even number of ones.
    Even,
    /// An odd number of ones.
    Odd,
}

impl Parity {
    /// Every parity with its name in configurations.
    pub const NAMES: [(Self, &'static str); 3] = [(Self::None, "none"), (Self::Even, "even"), (Self::Odd, "odd")];
}

/// Settings of a serial line.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Serial {
    /// The device.
    pub path: PathBuf,
    /// Rate \[Bd\]; any, not only the usual ones.
    pub baud: u32,
    /// Data bits of a character, 7 or 8.
    pub data_bits: u8,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Stop bits of a character, 1 or 2.
    pub stop_bits: u8,
}

impl Serial {
    /// How long a character takes, with start, parity and stop bits \[s\].
    #[must_use]
    pub fn character_s(&self) -> f64 {
        let bits = 1 + self.data_bits + u8::from(self.parity != Parity::None) + self.stop_bits;
        f64::from(bits) / f64::from(self.baud)
    }

    /// Opens the line. Its descriptor never blocks.
    ///
    /// # Errors
    /// If the device cannot be opened, is no serial line, is used by another program, or refuses the settings.
    pub fn open(&self) -> io::Result<OpenSerial> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let descriptor = open(&self.path, flags, Mode::empty())?;
        let mut settings = tcgetattr(&descriptor)?;
        // No other program can open the device from here on, nor may one have it open that locks it as is usual. A
        // pseudo-terminal would stay closed after this program was killed.
        let is_exclusive = !is_pseudo_terminal(&self.path);
        if is_exclusive {
            ioctl_tiocexcl(&descriptor)?;
        }
        let line = OpenSerial { descriptor, is_exclusive };
        flock(&line.descriptor, FlockOperation::NonBlockingLockExclusive)
            .map_err(|_| io::Error::new(io::ErrorKind::ResourceBusy, "another program has it"))?;
        settings.make_raw();
        settings.input_modes -= InputModes::IXON | InputModes::IXOFF | InputModes::INPCK | InputModes::IGNPAR;
        settings.control_modes -= ControlModes::CSIZE
            | ControlModes::PARENB
            | ControlModes::PARODD
            | ControlModes::CSTOPB
            | ControlModes::CRTSCTS;
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.control_modes |= if self.data_bits == 7 { ControlModes::CS7 } else { ControlModes::CS8 };
        if self.stop_bits == 2 {
            settings.control_modes |= ControlModes::CSTOPB;
        }
        match self.parity {
            Parity::None => settings.input_modes |= InputModes::IGNPAR,
            Parity::Even => {
                settings.input_modes |= InputModes::INPCK;
                settings.control_modes |= ControlModes::PARENB;
            }
            Parity::Odd => {
                settings.input_modes |= InputModes::INPCK;
                settings.control_modes |= ControlModes::PARENB | ControlModes::PARODD;
            }
        }
        settings.set_speed(self.baud)?;
        // What had come before is of an unknown time, and may be at another rate.
        tcsetattr(&line.descriptor, OptionalActions::Flush, &settings)?;
        Ok(line)
    }
}

/// Connects to the first address of a host and port, as in `192.168.1.10:4000`, that answers; a serial line behind a
/// converter. The connection never blocks, and sends at once. Each address may take `timeout`, and a name longer.
///
/// # Errors
/// If the host has no address, or the last of them refuses.
pub fn connect(address: &str, timeout: Duration) -> io::Result<TcpStream> {
    let mut refused = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, timeout) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_nonblocking(true)?;
                return Ok(stream);
            }
            Err(error) => refused = error,
        }
    }
    Err(refused)
}

fn is_pseudo_terminal(path: &Path) -> bool {
    path.canonicalize().is_ok_and(|path| path.starts_with("/dev/pts"))
}

/// An open serial line.
#[derive(Debug)]
pub struct OpenSerial {
    descriptor: OwnedFd,
    is_exclusive: bool,
}

impl AsFd for OpenSerial {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.descriptor.as_fd()
    }
}

impl Drop for OpenSerial {
    /// Without the flush, closing a serial device waits until its output has left: 30 s on Linux if it takes none.
    fn drop(&mut self) {
        let _ = tcflush(&self.descriptor, QueueSelector::OFlush);
        if self.is_exclusive {
            let _ = ioctl_tiocnxcl(&self.descriptor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_character_has_all_its_bits() {
        let line = Serial { path: PathBuf::new(), baud: 374_400, data_bits: 8, parity: Parity::None, stop_bits: 1 };
        assert_eq!(line.character_s(), 10.0 / 374_400.0);
        let line = Serial { data_bits: 7, parity: Parity::Even, stop_bits: 2, baud: 1100, ..line };
        assert_eq!(line.character_s(), 0.01);
    }

    #[test]
    fn what_is_no_serial_line_is_refused() {
        let line = Serial { path: "/dev/null".into(), baud: 9600, data_bits: 8, parity: Parity::None, stop_bits: 1 };
        assert_eq!(
            line.open().err().and_then(|error| error.raw_os_error()),
            Some(rustix::io::Errno::NOTTY.raw_os_error())
        );
    }
}
