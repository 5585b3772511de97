//! Panics of libraries that read hostile files.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`. A panic in it counts as an error in the file that is read, not in the program: `None`, and nothing is printed.
pub fn contain<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |panic| {
            if !SILENT.get() {
                usual(panic);
            }
        }));
    });
    SILENT.set(true);
    // Values that a panic has left half-changed are not used again: the caller ends at the first error.
    let result = catch_unwind(AssertUnwindSafe(work));
    SILENT.set(false);
    result.ok()
}
