//! Steps of work that a file could ask for more often than it has bytes: a field of a definition that is resolved, a
//! channel that is looked at, a byte that is unpacked, a record. Readers count them, so that tests and fuzzing can
//! bound the work by the length of the file, whatever the machine.

use std::cell::Cell;

/// Most steps for a byte of a file; a file has at least as many as one of [`LEAST`] bytes.
pub const MOST_A_BYTE: u64 = 256;
/// Bytes that any file counts as \[bytes\].
pub const LEAST: u64 = 1 << 18;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

/// The steps that this thread has taken.
#[must_use]
pub fn taken() -> u64 {
    TAKEN.get()
}

/// The most steps that reading a file of this length may take.
#[must_use]
pub const fn budget(length: u64) -> u64 {
    let length = if length < LEAST { LEAST } else { length };
    length.saturating_mul(MOST_A_BYTE)
}

/// Counts steps of this thread.
pub fn count(steps: u64) {
    TAKEN.set(TAKEN.get().wrapping_add(steps));
}
