//! Which state of a file was read.

#[cfg(not(target_os = "wasi"))]
use std::fmt;
use std::fs::{self, Metadata};
use std::io;
#[cfg(not(target_os = "wasi"))]
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Makes a call again that a signal has interrupted. The standard library does so for most calls, but not for `stat`.
///
/// # Errors
/// Those of the call.
pub fn uninterrupted<T>(mut call: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match call() {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

/// Identifies one state of a file: it changes when the file is replaced or written.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Identity {
    size: u64,
    modified: Option<SystemTime>,
    /// Device and inode, and the time when these or the permissions changed. WASI has none of them.
    #[cfg(not(target_os = "wasi"))]
    inode: (u64, u64, i64, i64),
}

impl Identity {
    /// The state of the file at `path`, through symbolic links; `None` if there is no file.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|metadata| Self::from(&metadata))
    }

    /// When its content was last changed, Unix time \[s\].
    #[must_use]
    pub fn modified_unix_s(&self) -> f64 {
        let since = self.modified.and_then(|modified| modified.duration_since(UNIX_EPOCH).ok());
        since.map_or(0.0, |since| since.as_secs() as f64 + f64::from(since.subsec_nanos()) * 1e-9)
    }
}

/// Device, inode, time of change \[s and ns\] and size \[bytes\]: by this text one process says to another which state
/// it has read.
#[cfg(not(target_os = "wasi"))]
impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (device, inode, changed_s, changed_ns) = self.inode;
        write!(f, "{device}:{inode}:{changed_s}.{changed_ns:09}:{}", self.size)
    }
}

impl From<&Metadata> for Identity {
    fn from(metadata: &Metadata) -> Self {
        Self {
            size: metadata.len(),
            modified: metadata.modified().ok(),
            #[cfg(not(target_os = "wasi"))]
            inode: (metadata.dev(), metadata.ino(), metadata.ctime(), metadata.ctime_nsec()),
        }
    }
}
