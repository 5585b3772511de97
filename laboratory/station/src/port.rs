//! The instrument's end of a line: a pseudo-terminal behind a symbolic link, or a TCP port.

use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, OptionalActions, ioctl_tiocnxcl, tcflow, tcgetattr, tcsetattr};
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{OpenOptionsExt as _, symlink};
use std::path::PathBuf;

/// A port of a device. It may be lost for some time.
pub(crate) struct SimulatedPort {
    address: PortAddress,
    open: Option<OpenPort>,
}

enum PortAddress {
    /// Path of the symbolic link to the pseudo-terminal.
    Link(PathBuf),
    /// Address and port number.
    Tcp(String),
}

enum OpenPort {
    /// The user side is kept open too: while no process has it open, the controller reports an error.
    Terminal {
        controller: OwnedFd,
        user_side: File,
    },
    Tcp {
        listener: TcpListener,
        stream: Option<TcpStream>,
    },
}

impl SimulatedPort {
    /// Creates the port.
    pub(crate) fn new(port: &str) -> io::Result<Self> {
        let address = match port.strip_prefix("tcp://") {
            Some(address) => PortAddress::Tcp(address.to_owned()),
            None => PortAddress::Link(PathBuf::from(port)),
        };
        let mut port = Self { address, open: None };
        port.restore()?;
        Ok(port)
    }

    /// Creates the port again if it is lost.
    pub(crate) fn restore(&mut self) -> io::Result<()> {
        if self.open.is_some() {
            return Ok(());
        }
        self.open = Some(match &self.address {
            PortAddress::Tcp(address) => {
                let listener = TcpListener::bind(address)?;
                listener.set_nonblocking(true)?;
                OpenPort::Tcp { listener, stream: None }
            }
            PortAddress::Link(link) => {
                let controller = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
                grantpt(&controller)?;
                unlockpt(&controller)?;
                let name = ptsname(&controller, Vec::new())?;
                let name = OsStr::from_bytes(name.as_bytes());
                let user_side = OpenOptions::new()
                    .read(true)
                    .write(true)
                    .custom_flags(OFlags::NOCTTY.bits().cast_signed())
                    .open(name)?;
                let mut settings = tcgetattr(&user_side)?;
                settings.make_raw();
                tcsetattr(&user_side, OptionalActions::Now, &settings)?;
                rustix::io::ioctl_fionbio(&controller, true)?;
                // A link of an earlier station may exist.
                let _ = fs::remove_file(link);
                symlink(name, link)?;
                OpenPort::Terminal { controller, user_side }
            }
        });
        Ok(())
    }

    /// Closes the port and removes its link.
    pub(crate) fn lose(&mut self) {
        if self.open.take().is_some()
            && let PortAddress::Link(link) = &self.address
        {
            let _ = fs::remove_file(link);
        }
    }

    /// Makes the port take nothing, as by flow control, or take bytes again; what it has taken and not given is lost
    /// then. A TCP port takes nothing because nobody reads, and needs no call.
    pub(crate) fn set_dead(&mut self, dead: bool) -> io::Result<()> {
        if let Some(OpenPort::Terminal { user_side, .. }) = &self.open {
            tcflow(user_side, if dead { Action::OOff } else { Action::OOn })?;
        }
        let mut lost = Vec::new();
        while !dead && self.open.is_some() {
            let before = lost.len();
            self.read(&mut lost)?;
            if lost.len() == before {
                break;
            }
        }
        Ok(())
    }

    /// The descriptor to poll: readable when bytes arrive, or when a connection is to be accepted.
    pub(crate) fn readable(&self) -> Option<BorrowedFd<'_>> {
        self.open.as_ref().map(|open| match open {
            OpenPort::Terminal { controller, .. } => controller.as_fd(),
            OpenPort::Tcp { stream: Some(stream), .. } => stream.as_fd(),
            OpenPort::Tcp { listener, .. } => listener.as_fd(),
        })
    }

    /// Appends the bytes that have arrived, or accepts a connection.
    pub(crate) fn read(&mut self, input: &mut Vec<u8>) -> io::Result<()> {
        let mut buffer = [0; 512];
        match &mut self.open {
            None => {}
            Some(OpenPort::Terminal { controller, user_side }) => {
                // A killed program leaves the terminal in exclusive mode, which would exclude the next one.
                let _ = ioctl_tiocnxcl(user_side.as_fd());
                match rustix::io::read(&*controller, &mut buffer) {
                    Ok(count) => input.extend_from_slice(&buffer[..count]),
                    Err(Errno::AGAIN) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            Some(OpenPort::Tcp { listener, stream }) => {
                let Some(connected) = stream else {
                    if let Ok((accepted, _)) = listener.accept() {
                        accepted.set_nonblocking(true)?;
                        accepted.set_nodelay(true)?;
                        *stream = Some(accepted);
                    }
                    return Ok(());
                };
                match connected.read(&mut buffer) {
                    // Bytes of this connection are not part of a request of the next one.
                    Ok(0) => (*stream, *input) = (None, Vec::new()),
                    Ok(count) => input.extend_from_slice(&buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                    Err(_) => (*stream, *input) = (None, Vec::new()),
                }
            }
        }
        Ok(())
    }

    /// Sends bytes. They are lost if nobody is connected, as on a cable.
    pub(crate) fn write(&mut self, bytes: &[u8]) {
        let _ = match &mut self.open {
            Some(OpenPort::Terminal { controller, .. }) => {
                rustix::io::write(&*controller, bytes).map_err(io::Error::from)
            }
            Some(OpenPort::Tcp { stream: Some(stream), .. }) => stream.write(bytes),
            _ => Ok(0),
        };
    }
}
