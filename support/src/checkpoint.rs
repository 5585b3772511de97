//! Checkpoints of long computations: there the caller sees how far they are, and may end them.
//!
//! A computation calls [`checkpoint`] in its long loops. A caller that runs it by [`watched`] is called there, and may
//! say that the work ends: it then unwinds from the checkpoint, as after a panic but without one, so that all that it
//! holds is released and files that are not complete are removed. Where nobody watches, a checkpoint does nothing.
//!
//! ```
//! use isotherm_support::checkpoint::{checkpoint, watched};
//! use std::cell::Cell;
//! use std::rc::Rc;
//!
//! let left = Rc::new(Cell::new(3));
//! let watch = { let left = left.clone(); move || { left.set(left.get() - 1); left.get() > 0 } };
//! let endless = || loop { checkpoint() };
//! assert!(watched(watch, endless).is_err());
//! assert_eq!(left.get(), 0);
//! assert_eq!(watched(|| true, || { checkpoint(); 7 }).ok(), Some(7));
//! ```

use std::any::Any;
use std::cell::RefCell;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::rc::Rc;
use std::thread;

type Watch = Rc<dyn Fn() -> bool>;

thread_local! {
    static WATCH: RefCell<Option<Watch>> = const { RefCell::new(None) };
}

/// The work was ended at a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stop;

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("stopped")
    }
}

impl std::error::Error for Stop {}

/// Shows whether the work may continue, and ends it if not. It costs nanoseconds where nobody watches.
pub fn checkpoint() {
    // What is dropped while the work unwinds may read on, as a stream that is hashed to its end.
    if thread::panicking() {
        return;
    }
    let watch = WATCH.with(|watch| watch.borrow().clone());
    if let Some(watch) = watch
        && !watch()
    {
        resume_unwind(Box::new(Stop));
    }
}

/// Runs `work` in this thread. At each of its checkpoints `watch` says whether it goes on.
///
/// # Errors
/// If it does not. A panic of the work goes on as such.
pub fn watched<T>(watch: impl Fn() -> bool + 'static, work: impl FnOnce() -> T) -> Result<T, Stop> {
    let before = WATCH.with(|place| place.replace(Some(Rc::new(watch))));
    // Nothing of the work is seen again after it has ended.
    let done = catch_unwind(AssertUnwindSafe(work));
    WATCH.with(|place| place.replace(before));
    done.or_else(|cause: Box<dyn Any + Send>| if cause.is::<Stop>() { Err(Stop) } else { resume_unwind(cause) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_ends_releases_what_it_holds() {
        let held = Rc::new(());
        let inner = held.clone();
        let stopped = watched(
            || false,
            move || {
                let _held = inner;
                checkpoint();
                7
            },
        );
        assert_eq!(stopped, Err(Stop));
        assert_eq!(Rc::strong_count(&held), 1);
        // Nobody watches any more.
        checkpoint();
    }

    #[test]
    fn what_is_dropped_when_work_ends_may_have_checkpoints() {
        struct Reader;
        impl Drop for Reader {
            fn drop(&mut self) {
                checkpoint();
            }
        }
        let work = || {
            let _reader = Reader;
            checkpoint();
        };
        assert_eq!(watched(|| false, work), Err(Stop));
    }

    #[test]
    fn work_within_work_has_its_own_watch() {
        let outer = watched(
            || true,
            || {
                assert_eq!(watched(|| false, checkpoint), Err(Stop));
                checkpoint();
            },
        );
        assert_eq!(outer, Ok(()));
    }
}
