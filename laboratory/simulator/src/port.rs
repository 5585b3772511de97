//! The instrument's end of a line: a pseudo-terminal behind a symbolic link, or a TCP port.

use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{OpenOptionsExt as _, symlink};
use std::path::PathBuf;

/// A port, there or lost.
pub struct Port {
    place: Place,
    open: Option<Open>,
}

enum Place {
    /// The symbolic link.
    Link(PathBuf),
    /// The address.
    Tcp(String),
}

enum Open {
    /// The other side is held too: a pseudo-terminal that nobody has open would report an error for ever.
    Terminal {
        ours: OwnedFd,
        theirs: File,
    },
    Tcp {
        listener: TcpListener,
        stream: Option<TcpStream>,
    },
}

impl Port {
    /// Makes the port.
    pub fn new(port: &str) -> io::Result<Self> {
        let place = match port.strip_prefix("tcp://") {
            Some(address) => Place::Tcp(address.to_owned()),
            None => Place::Link(PathBuf::from(port)),
        };
        let mut port = Self { place, open: None };
        port.restore()?;
        Ok(port)
    }

    /// Makes it again, if it is lost.
    pub fn restore(&mut self) -> io::Result<()> {
        if self.open.is_some() {
            return Ok(());
        }
        self.open = Some(match &self.place {
            Place::Tcp(address) => {
                let listener = TcpListener::bind(address)?;
                listener.set_nonblocking(true)?;
                Open::Tcp { listener, stream: None }
            }
            Place::Link(link) => {
                let ours = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
                grantpt(&ours)?;
                unlockpt(&ours)?;
                let name = ptsname(&ours, Vec::new())?;
                let name = OsStr::from_bytes(name.as_bytes());
                let theirs = OpenOptions::new()
                    .read(true)
                    .write(true)
                    .custom_flags(OFlags::NOCTTY.bits().cast_signed())
                    .open(name)?;
                let mut settings = tcgetattr(&theirs)?;
                settings.make_raw();
                tcsetattr(&theirs, OptionalActions::Now, &settings)?;
                rustix::io::ioctl_fionbio(&ours, true)?;
                // One of an earlier station.
                let _ = fs::remove_file(link);
                symlink(name, link)?;
                Open::Terminal { ours, theirs }
            }
        });
        Ok(())
    }

    /// Loses it.
    pub fn lose(&mut self) {
        if self.open.take().is_some()
            && let Place::Link(link) = &self.place
        {
            let _ = fs::remove_file(link);
        }
    }

    /// What tells of bytes to read, or of somebody to be accepted.
    pub fn readable(&self) -> Option<BorrowedFd<'_>> {
        self.open.as_ref().map(|open| match open {
            Open::Terminal { ours, .. } => ours.as_fd(),
            Open::Tcp { stream: Some(stream), .. } => stream.as_fd(),
            Open::Tcp { listener, .. } => listener.as_fd(),
        })
    }

    /// Appends what has come.
    pub fn read(&mut self, input: &mut Vec<u8>) -> io::Result<()> {
        let mut buffer = [0; 512];
        match &mut self.open {
            None => {}
            Some(Open::Terminal { ours, theirs }) => {
                // A program that was killed has left the terminal locked for the next one.
                let _ = ioctl_tiocnxcl(theirs.as_fd());
                match rustix::io::read(&*ours, &mut buffer) {
                    Ok(count) => input.extend_from_slice(&buffer[..count]),
                    Err(Errno::AGAIN) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            Some(Open::Tcp { listener, stream }) => {
                let Some(connected) = stream else {
                    if let Ok((accepted, _)) = listener.accept() {
                        accepted.set_nonblocking(true)?;
                        accepted.set_nodelay(true)?;
                        *stream = Some(accepted);
                    }
                    return Ok(());
                };
                match connected.read(&mut buffer) {
                    // Bytes of another connection are no part of a request of the next.
                    Ok(0) => (*stream, *input) = (None, Vec::new()),
                    Ok(count) => input.extend_from_slice(&buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                    Err(_) => (*stream, *input) = (None, Vec::new()),
                }
            }
        }
        Ok(())
    }

    /// Sends. What nobody takes is lost, as on a wire.
    pub fn write(&mut self, bytes: &[u8]) {
        let _ = match &mut self.open {
            Some(Open::Terminal { ours, .. }) => rustix::io::write(&*ours, bytes).map_err(io::Error::from),
            Some(Open::Tcp { stream: Some(stream), .. }) => stream.write(bytes),
            _ => Ok(0),
        };
    }
}
