//! An open port: a descriptor that never blocks.

use crate::datagrams::Datagrams;
use crate::description::Port;
use isotherm_client::monotonic_ns;
use isotherm_serial::OpenSerial;
use isotherm_support::failure::{Exit, Failure};
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use rustix::io::Errno;
use rustix::net::sockopt;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

/// Longest wait for a TCP connection to one address.
const CONNECT: Duration = Duration::from_secs(3);
/// A TCP connection without a sign of life is given up after so many probes, one a second.
const PROBES: u32 = 3;

/// An open port.
pub(crate) enum OpenPort {
    Serial(OpenSerial),
    Tcp(TcpStream),
    Udp(Datagrams),
    File(File),
    Stdin(io::Stdin),
}

/// What reading has brought.
pub(crate) enum PortRead {
    Bytes(usize),
    /// Nothing is there now.
    Nothing,
    /// The other side has ended.
    End,
}

impl OpenPort {
    /// Opens a port. May take seconds.
    fn open(port: &Port) -> io::Result<Self> {
        match port {
            Port::Serial(serial) => serial.open().map(Self::Serial),
            Port::Tcp(address) => connect(address).map(Self::Tcp),
            Port::Udp(udp) => Datagrams::open(udp).map(Self::Udp),
            Port::File { path, .. } => {
                let file = File::open(path)?;
                if file.metadata()?.is_dir() {
                    return Err(io::Error::from(io::ErrorKind::IsADirectory));
                }
                Ok(Self::File(file))
            }
            Port::Stdin => Ok(Self::Stdin(io::stdin())),
        }
    }

    /// Whether a read would not wait: pipes do not say so themselves.
    fn has_something(&self) -> bool {
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        poll(&mut [PollFd::new(self, PollFlags::IN)], Some(&now)).is_ok_and(|ready| ready > 0)
    }

    /// Whether somebody hears what is written.
    pub(crate) const fn is_heard(&self) -> bool {
        matches!(self, Self::Serial(_) | Self::Tcp(_))
    }

    /// Writes what the line takes at once, and returns how many bytes it took: none where nobody hears it.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> usize {
        match self {
            Self::Serial(line) => rustix::io::write(&*line, bytes).unwrap_or(0),
            Self::Tcp(stream) => stream.write(bytes).unwrap_or(0),
            // A line that has failed is found so by the next read.
            Self::Udp(_) | Self::File(_) | Self::Stdin(_) => 0,
        }
    }

    /// Reads what is there, without waiting.
    pub(crate) fn read(&mut self, buffer: &mut [u8]) -> io::Result<PortRead> {
        let read = match self {
            Self::Serial(line) => rustix::io::read(&*line, buffer).map_err(io::Error::from),
            Self::Tcp(stream) => stream.read(buffer),
            Self::Udp(datagrams) => {
                return match datagrams.receive(buffer) {
                    Ok(count) => Ok(PortRead::Bytes(count)),
                    Err(error) => nothing(error),
                };
            }
            Self::File(_) | Self::Stdin(_) if !self.has_something() => return Ok(PortRead::Nothing),
            Self::File(file) => file.read(buffer),
            Self::Stdin(stdin) => rustix::io::read(stdin, buffer).map_err(io::Error::from),
        };
        match read {
            Ok(0) => Ok(PortRead::End),
            Ok(count) => Ok(PortRead::Bytes(count)),
            Err(error) => nothing(error),
        }
    }
}

impl OpenPort {
    /// When the bytes that were read last came, if the kernel reports that \[ns, monotonic clock\].
    pub(crate) const fn received_ns(&self) -> Option<u64> {
        match self {
            Self::Udp(datagrams) => datagrams.received_ns,
            _ => None,
        }
    }

    /// Datagrams of others than the peer.
    pub(crate) const fn strangers(&self) -> u64 {
        match self {
            Self::Udp(datagrams) => datagrams.strangers,
            _ => 0,
        }
    }
}

fn nothing(error: io::Error) -> io::Result<PortRead> {
    match error.kind() {
        io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => Ok(PortRead::Nothing),
        _ => Err(error),
    }
}

impl AsFd for OpenPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Serial(line) => line.as_fd(),
            Self::Tcp(stream) => stream.as_fd(),
            Self::Udp(datagrams) => datagrams.as_fd(),
            Self::File(file) => file.as_fd(),
            Self::Stdin(stdin) => stdin.as_fd(),
        }
    }
}

/// A connection that notices a peer which vanishes, since that sends no end.
fn connect(address: &str) -> io::Result<TcpStream> {
    let stream = isotherm_serial::connect(address, CONNECT)?;
    sockopt::set_socket_keepalive(&stream, true)?;
    sockopt::set_tcp_keepidle(&stream, Duration::from_secs(1))?;
    sockopt::set_tcp_keepintvl(&stream, Duration::from_secs(1))?;
    sockopt::set_tcp_keepcnt(&stream, PROBES)?;
    Ok(stream)
}

/// A port that is being opened, in a thread of its own: names are looked up and connections made there.
pub(crate) struct PendingPort {
    result: Receiver<(io::Result<OpenPort>, u64)>,
    /// Readable when the port is open or was refused.
    event: Arc<OwnedFd>,
}

impl PendingPort {
    pub(crate) fn start(port: &Port) -> io::Result<Self> {
        let event = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let (sender, result) = channel();
        let (port, raised) = (port.clone(), Arc::clone(&event));
        let body = move || {
            let opened = OpenPort::open(&port);
            // Nobody waits for it any more if the process ends.
            let _ = sender.send((opened, monotonic_ns()));
            let _ = rustix::io::write(&raised, &1u64.to_ne_bytes());
        };
        thread::Builder::new().name("open".to_owned()).spawn(body)?;
        Ok(Self { result, event })
    }

    /// The port, once it is open or was refused, and when that was \[ns\].
    pub(crate) fn poll(&self) -> Option<(io::Result<OpenPort>, u64)> {
        match self.result.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some((Err(io::Error::other("the thread that opens it ended")), monotonic_ns()))
            }
        }
    }
}

impl AsFd for PendingPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.event.as_fd()
    }
}

/// Opens a port, unless the end is asked for.
pub(crate) fn open_port(port: &Port, end: &AtomicBool) -> Result<OpenPort, Failure> {
    let opening = PendingPort::start(port).map_err(|error| refused(port, &error))?;
    loop {
        if let Some((result, _)) = opening.poll() {
            return result.map_err(|error| refused(port, &error));
        }
        if end.load(Ordering::Relaxed) {
            return Err(Failure::new(Exit::Failed, format!("opening {}: interrupted", name_of(port))));
        }
        thread::sleep(Duration::from_millis(1));
    }
}

/// Why a port could not be opened, with a remedy.
pub(crate) fn refused(port: &Port, error: &io::Error) -> Failure {
    let remedy = match (port, error.raw_os_error().map(Errno::from_raw_os_error)) {
        (Port::Tcp(_), _) => "check host and port, and that the device accepts connections",
        (Port::Udp(_), _) => "give an address of this machine, as 0.0.0.0, and a port that no other program has",
        (Port::Stdin, _) => "give it a pipe",
        (_, Some(Errno::ACCESS | Errno::PERM)) => {
            "the device is another user's: add this user to its group, as in `sudo usermod -aG dialout $USER` and a \
             new login, or give it a udev rule"
        }
        (Port::File { .. }, _) => "give a file of bytes",
        (_, Some(Errno::NOENT | Errno::NXIO | Errno::NODEV)) => {
            "plug it in; `isotherm acquire --list` shows the serial ports that there are"
        }
        (_, Some(Errno::ISDIR | Errno::NOTTY)) => "it is not a serial line; give a device as /dev/ttyUSB0",
        (_, Some(Errno::INVAL)) => "the line refuses its settings; give a rate and parity that it has",
        _ if error.kind() == io::ErrorKind::ResourceBusy => {
            "end the program that has it (`fuser -v` names it; gpsd and ModemManager open what is plugged in)"
        }
        _ => "`isotherm acquire --list` shows the serial ports that there are",
    };
    let path = match port {
        Port::Serial(serial) => Some(serial.path.as_path()),
        Port::File { path, .. } => Some(path.as_path()),
        _ => None,
    };
    let failure = Failure::new(Exit::Io, format!("opening {}: {}; {remedy}", name_of(port), cause(error)));
    match path {
        Some(path) => failure.at(Path::new(path), None),
        None => failure,
    }
}

/// The port without its settings.
pub(crate) fn name_of(port: &Port) -> String {
    match port {
        Port::Serial(serial) => serial.path.display().to_string(),
        other => other.to_string(),
    }
}

fn cause(error: &io::Error) -> String {
    match error.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::BUSY) => "another program has it".to_owned(),
        Some(Errno::NOTTY) => "not a terminal device".to_owned(),
        _ => error.to_string(),
    }
}

/// The serial ports, best by names that stay after unplugging: those of `/dev/serial/by-id`, and of `/dev` what has
/// none there.
#[must_use]
pub fn serial_ports(root: &Path) -> Vec<PathBuf> {
    let entries = |folder: &str| {
        let entries = root.join(folder).read_dir().into_iter().flatten().flatten();
        let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
        paths.sort();
        paths
    };
    let by_id = entries("dev/serial/by-id");
    let named: Vec<_> = by_id.iter().filter_map(|path| path.canonicalize().ok()).collect();
    let is_port = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let is_usual = ["ttyUSB", "ttyACM", "ttyAMA", "ttyTHS", "ttyPS", "ttymxc", "ttySC", "ttyO"]
            .iter()
            .any(|beginning| name.starts_with(beginning));
        // Most of ttyS0 to ttyS31 have no hardware.
        let is_real = name.starts_with("ttyS") && is_real_uart(root, &name);
        (is_usual || is_real) && !named.contains(path)
    };
    let others = entries("dev").into_iter().filter(is_port);
    by_id.iter().cloned().chain(others).collect()
}

/// Whether the kernel has found hardware for a port of the machine itself.
fn is_real_uart(root: &Path, name: &str) -> bool {
    let kind = std::fs::read_to_string(root.join("sys/class/tty").join(name).join("type"));
    kind.is_ok_and(|kind| kind.trim() != "0")
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::fs::OpenOptions;

    /// A read that waits would hold a signal up.
    #[test]
    fn a_pipe_that_is_silent_is_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        mknodat(CWD, &path, FileType::Fifo, Mode::from_raw_mode(0o600), 0).unwrap();
        // Both ends, so that opening does not wait either.
        let mut writer = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let mut port = OpenPort::open(&Port::File { path, pace: false }).unwrap();
        let mut buffer = [0; 8];
        assert!(matches!(port.read(&mut buffer).unwrap(), PortRead::Nothing));
        writer.write_all(b"abc").unwrap();
        assert!(matches!(port.read(&mut buffer).unwrap(), PortRead::Bytes(3)));
        assert!(matches!(port.read(&mut buffer).unwrap(), PortRead::Nothing));
    }
}
