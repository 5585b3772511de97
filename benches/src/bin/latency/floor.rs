//! The lower bound of every path: two cache lines in bare shared memory, one for each direction, and nothing else.
#![expect(unsafe_code, reason = "this bench measures bare shared memory, so it must map it itself")]

use crate::paths::Path;
use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::{Acquire, Release};
use isotherm_benches::{BenchResult, Spin};
use isotherm_client::{CompensatedIncrement, RawSample};
use rustix::mm::{MapFlags, ProtFlags, mmap};
use std::fs::{self, File};

/// Size of the memory. Its two lines are so far apart that no processor fetches them together.
const BYTES: usize = 512;

/// The two lines.
struct Lines {
    request: &'static AtomicU64,
    response: &'static AtomicU64,
}

impl Lines {
    fn map(path: &std::path::Path) -> BenchResult<Self> {
        let file = File::options().read(true).write(true).open(path)?;
        // SAFETY: this is a fresh mapping of a file that is `BYTES` long and that nobody shortens. It is never
        // unmapped. Both words are aligned, lie within it, and are only used as atomics, by both processes.
        unsafe {
            let protection = ProtFlags::READ | ProtFlags::WRITE;
            let start = mmap(core::ptr::null_mut(), BYTES, protection, MapFlags::SHARED, &file, 0)?.cast::<AtomicU64>();
            Ok(Self { request: &*start, response: &*start.add(BYTES / 2 / size_of::<AtomicU64>()) })
        }
    }
}

/// The client's end.
pub(crate) struct Floor {
    lines: Lines,
    count: u64,
}

impl Floor {
    /// Creates the shared memory.
    pub(crate) fn create(path: &std::path::Path) -> BenchResult<Self> {
        fs::write(path, [0; BYTES])?;
        Ok(Self { lines: Lines::map(path)?, count: 0 })
    }
}

impl Path for Floor {
    fn round_trip(&mut self, _: &RawSample) -> BenchResult<CompensatedIncrement> {
        self.count += 1;
        self.lines.request.store(self.count, Release);
        let mut spin = Spin::default();
        while self.lines.response.load(Acquire) != self.count {
            spin.turn()?;
        }
        Ok(CompensatedIncrement::default())
    }
}

/// The other end: answers until the bench ends.
pub(crate) fn answer(path: &str) -> BenchResult<()> {
    let lines = Lines::map(path.as_ref())?;
    let mut last = 0;
    loop {
        let request = lines.request.load(Acquire);
        if request != last {
            last = request;
            lines.response.store(request, Release);
        }
        core::hint::spin_loop();
    }
}
