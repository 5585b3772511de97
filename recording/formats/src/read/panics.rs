//! Catches panics of libraries that read damaged or hostile files.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Runs `work`. A panic in it means an invalid file, not an error of the program: returns `None`, and prints nothing.
pub(crate) fn catch_panic<T>(work: impl FnOnce() -> T) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let default_hook = take_hook();
        set_hook(Box::new(move |panic| {
            if !SILENT.get() {
                default_hook(panic);
            }
        }));
    });
    SILENT.set(true);
    // Unwind safe: the caller stops at the first error and does not use values that a panic left inconsistent.
    let result = catch_unwind(AssertUnwindSafe(work));
    SILENT.set(false);
    result.ok()
}
