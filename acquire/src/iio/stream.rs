//! The bytes of one device, cut into scans.

use std::path::PathBuf;

use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::io::Errno;

use super::element::ElementPlace;
use super::error::{IioError, IioFault};
use super::join::Ring;
use super::sysfs::Folder;

/// Scans that one read takes at most.
const READ: usize = 128;

/// Scans of one device that may wait for those of another: all that the kernel holds, which rounds up to a power of
/// two, and two reads.
pub(super) fn waiting(length: usize) -> usize {
    length.next_power_of_two() + 2 * READ
}

/// What is taken out of a scan.
pub(super) struct ScanSelection {
    pub(super) timestamp: Option<ElementPlace>,
    /// The numbers.
    pub(super) places: Box<[ElementPlace]>,
    /// For each of them, its place among the numbers of the source.
    pub(super) slots: Box<[usize]>,
}

/// One device's buffer that is on. Dropping it switches the buffer off.
pub(super) struct Stream {
    node: OwnedFd,
    path: PathBuf,
    control: Folder,
    pub(super) wanted: ScanSelection,
    scan: usize,
    bytes: Box<[u8]>,
    filled: usize,
    has_begun: bool,
}

impl Stream {
    /// The scans of `scan` bytes each, over 0.
    pub(super) fn new(node: OwnedFd, path: PathBuf, control: Folder, wanted: ScanSelection, scan: usize) -> Self {
        let bytes = vec![0; scan * READ].into_boxed_slice();
        Self { node, path, control, wanted, scan, bytes, filled: 0, has_begun: false }
    }

    /// Room for scans that wait.
    pub(super) fn ring(&self, rows: usize) -> Ring {
        Ring::new(rows, self.wanted.places.len())
    }

    pub(super) fn descriptor(&self) -> BorrowedFd<'_> {
        self.node.as_fd()
    }

    /// Reads once, without waiting; whether there may be more.
    pub(super) fn fill(&mut self) -> Result<bool, IioError> {
        let room = self.bytes.get_mut(self.filled..).unwrap_or_default();
        let size = room.len();
        let read = loop {
            match rustix::io::read(&self.node, &mut *room) {
                Ok(read) => break read,
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return Ok(false),
                Err(errno) => return Err(IioError::io(self.control.phase("reading"), &self.path, &errno.into())),
            }
        };
        // The kernel gives no end; a pipe that stands for it does, before its writer came and after it went.
        if read == 0 && self.has_begun {
            let remedy = "check the device's supply and bus";
            return Err(IioError::new(IioFault::Gone, self.control.phase("reading"), "the stream has ended", remedy));
        }
        self.has_begun |= read > 0;
        self.filled += read;
        Ok(read == size)
    }

    /// Hands out each whole scan, and keeps what has begun.
    pub(super) fn scans(&mut self, mut each: impl FnMut(&ScanSelection, &[u8])) {
        let whole = self.filled - self.filled % self.scan;
        for scan in self.bytes.get(..whole).unwrap_or_default().chunks_exact(self.scan) {
            each(&self.wanted, scan);
        }
        self.bytes.copy_within(whole..self.filled, 0);
        self.filled -= whole;
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // A device that is gone has no switch any more.
        let _ = self.control.try_write("enable", "0");
    }
}
