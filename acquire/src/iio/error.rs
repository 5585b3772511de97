//! What fails at an IIO device.

use std::io;
use std::path::Path;

use isotherm_support::failure::{Exit, Failure, shown};
use rustix::io::Errno;

/// The kind of an [`IioError`].
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum IioFault {
    /// There is no such device.
    Absent,
    /// The device went away. It may come back: open it again, until then it is [`Self::Absent`] or this.
    Gone,
    /// Another program has the device.
    Busy,
    /// A right is missing.
    Permission,
    /// The description asks for what the device cannot do.
    Description,
    /// The kernel or the driver refuses, or answers what cannot be read.
    Refused,
}

/// A fault of an IIO device: phase, cause, remedy.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
#[error("{phase}: {cause}; {remedy}")]
pub struct IioError {
    /// Decides what the caller does.
    pub kind: IioFault,
    /// What was being done, and the device.
    pub phase: String,
    /// What went wrong.
    pub cause: String,
    /// What to do.
    pub remedy: String,
}

impl IioError {
    pub(super) fn new(
        kind: IioFault,
        phase: impl Into<String>,
        cause: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { kind, phase: phase.into(), cause: cause.into(), remedy: remedy.into() }
    }

    /// A file of sysfs or a device node that could not be opened, read or written.
    pub(super) fn io(phase: impl Into<String>, path: &Path, error: &io::Error) -> Self {
        let path = shown(path);
        match error.raw_os_error().map(Errno::from_raw_os_error) {
            Some(Errno::ACCESS | Errno::PERM) => Self::new(
                IioFault::Permission,
                phase,
                format!("this user may not open or write {path}"),
                "run as root, or give the right by the udev rule in docs/iio.md",
            ),
            Some(Errno::BUSY) => Self::new(
                IioFault::Busy,
                phase,
                format!("{path} is busy"),
                "another program uses this device: end it (`fuser -v` of its node in /dev names it), then try again",
            ),
            Some(Errno::NODEV | Errno::NXIO | Errno::NOENT) => Self::new(
                IioFault::Gone,
                phase,
                format!("{path} is not there"),
                "the device or its driver was removed: check its supply and bus, and `dmesg`",
            ),
            _ => Self::new(
                IioFault::Refused,
                phase,
                format!("{path}: {error}"),
                "the driver refuses: `dmesg` may say why, `isotherm acquire --list` shows what the device can",
            ),
        }
    }
}

impl From<IioError> for Failure {
    fn from(error: IioError) -> Self {
        let exit = match error.kind {
            IioFault::Absent | IioFault::Gone | IioFault::Busy => Exit::Unavailable,
            IioFault::Permission | IioFault::Refused => Exit::Io,
            IioFault::Description => Exit::Config,
        };
        Self::new(exit, error.to_string())
    }
}
