//! The handles that C gets. A handle admits one caller at a time, only in the process that created it, and catches
//! panics.

use crate::code::isotherm_code::{ISOTHERM_ERROR_BUSY, ISOTHERM_ERROR_INTERNAL, ISOTHERM_OK};
use crate::code::{CodedError, FORKED, NULL, code, isotherm_code};
use core::sync::atomic::Ordering;
use isotherm_client::Process;
use isotherm_client::sync::{AtomicU8, UnsafeCell};
use std::panic::{AssertUnwindSafe, catch_unwind};

const FREE: u8 = 0;
const IN_USE: u8 = 1;
/// A call has panicked. The content may be inconsistent and is not used again.
const BROKEN: u8 = 2;

/// The content with its guard.
///
/// Acquisitions and readers are not `Send`, only because the transport's ports and loans share a count that is not
/// atomic (`isotherm_client::transport::recycled`); a test below lets the compiler prove that this is the only reason.
/// All holders of such a count, loans included, are within one handle. A thread that enters the handle sees all effects
/// of the callers before it (acquire and release of `state`). So any thread may use and close a handle.
#[derive(Debug)]
pub(crate) struct Handle<T> {
    state: AtomicU8,
    process: Process,
    content: UnsafeCell<T>,
}

impl<T> Handle<T> {
    fn new(content: T) -> Self {
        Self { state: AtomicU8::new(FREE), process: Process::current(), content: UnsafeCell::new(content) }
    }

    /// Calls `work` with the content, unless another call is in the handle.
    #[inline]
    fn enter(&self, work: impl FnOnce(&mut T) -> Result<(), CodedError>) -> Result<(), CodedError> {
        if !self.process.is_current() {
            return Err(FORKED);
        }
        match self.state.compare_exchange(FREE, IN_USE, Ordering::Acquire, Ordering::Relaxed) {
            Ok(_) => {}
            Err(IN_USE) => return Err(BUSY),
            Err(_) => return Err(INTERNAL),
        }
        // SAFETY: the state admits one caller at a time.
        let result = catch_unwind(AssertUnwindSafe(|| work(unsafe { &mut *self.content.get() })));
        self.state.store(if result.is_ok() { FREE } else { BROKEN }, Ordering::Release);
        result.unwrap_or(Err(INTERNAL))
    }
}

const BUSY: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_BUSY,
    c"another call is in this handle, in another thread or interrupted by a signal handler; use a handle from one place at a time",
);
const INTERNAL: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_INTERNAL,
    c"a fault of this library; the details are on stderr; close the handle, and please report it",
);

/// A call with a handle; `None` is NULL.
#[inline]
pub(crate) fn enter<T>(
    handle: Option<&Handle<T>>,
    work: impl FnOnce(&mut T) -> Result<(), CodedError>,
) -> isotherm_code {
    code(handle.ok_or(NULL).and_then(|handle| handle.enter(work)))
}

/// A call without a handle.
pub(crate) fn without_handle(work: impl FnOnce() -> Result<(), CodedError>) -> isotherm_code {
    code(catch_unwind(AssertUnwindSafe(work)).unwrap_or(Err(INTERNAL)))
}

/// Creates a handle and writes it to `output`; writes NULL if that fails.
///
/// # Safety
/// `output` is NULL or writable.
pub(crate) unsafe fn create<T, H>(
    output: *mut *mut H,
    wrap: fn(Handle<T>) -> H,
    make: impl FnOnce() -> Result<T, CodedError>,
) -> isotherm_code {
    if output.is_null() {
        return code(Err(NULL));
    }
    // SAFETY: the caller's contract.
    unsafe { output.write(core::ptr::null_mut()) };
    without_handle(|| {
        let handle = Box::new(wrap(Handle::new(make()?)));
        // SAFETY: as above.
        unsafe { output.write(Box::into_raw(handle)) };
        Ok(())
    })
}

/// Closes a handle and frees it. `last` looks at its content before; what it returns is the result, and the handle is
/// closed all the same.
///
/// # Safety
/// `handle` is NULL, or came from [`create`] and is not used again once it is closed.
pub(crate) unsafe fn close<T, H>(
    handle: *mut H,
    content: fn(&H) -> &Handle<T>,
    last: fn(&T) -> Result<(), CodedError>,
) -> isotherm_code {
    // SAFETY: the caller's contract.
    let Some(content) = (unsafe { handle.as_ref() }).map(content) else { return ISOTHERM_OK };
    if !content.process.is_current() {
        // Only the parent may leave the streams.
        return code(Err(FORKED));
    }
    let state = content.state.compare_exchange(FREE, IN_USE, Ordering::Acquire, Ordering::Relaxed);
    if state == Err(IN_USE) {
        return code(Err(BUSY));
    }
    without_handle(|| {
        // SAFETY: no call is in the handle. One that has panicked left content that is not looked at.
        let result = if state.is_ok() { last(unsafe { &*content.content.get() }) } else { Ok(()) };
        // SAFETY: made by `Box::into_raw`; no call is in the handle, and by the caller's contract none will be.
        drop(unsafe { Box::from_raw(handle) });
        result
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::isotherm_code::ISOTHERM_ERROR_NULL;
    use crate::code::isotherm_error_message;
    use iceoryx2::prelude::ipc_threadsafe::Service;
    use std::ffi::CStr;

    #[test]
    fn a_panic_becomes_a_code_and_the_handle_is_not_entered_again() {
        let handle = Handle::new(0);
        assert_eq!(enter(Some(&handle), |_| panic!("on purpose")), ISOTHERM_ERROR_INTERNAL);
        assert_eq!(enter(Some(&handle), |_| Ok(())), ISOTHERM_ERROR_INTERNAL);
        // SAFETY: valid until the next failure.
        let message = unsafe { CStr::from_ptr(isotherm_error_message()) };
        assert!(message.to_str().unwrap().contains("report"));
        assert_eq!(without_handle(|| panic!("on purpose")), ISOTHERM_ERROR_INTERNAL);
    }

    #[test]
    fn one_caller_at_a_time() {
        let open = Box::into_raw(Box::new(Handle::new(0)));
        // SAFETY: not closed before the end.
        let handle = unsafe { open.as_ref() };
        let outer = enter(handle, |_| {
            assert_eq!(enter(handle, |_| Ok(())), ISOTHERM_ERROR_BUSY);
            // SAFETY: as above.
            assert_eq!(unsafe { close(open, |handle| handle, |_| Ok(())) }, ISOTHERM_ERROR_BUSY);
            Ok(())
        });
        assert_eq!((outer, enter(handle, |_| Ok(()))), (ISOTHERM_OK, ISOTHERM_OK));
        // SAFETY: not used any more.
        assert_eq!(unsafe { close(open, |handle| handle, |_| Ok(())) }, ISOTHERM_OK);
        assert_eq!(enter(None::<&Handle<u8>>, |_| Ok(())), ISOTHERM_ERROR_NULL);
    }

    /// All parts of acquisitions and readers are `Send` if the transport's variant has an atomic count.
    #[test]
    fn only_the_count_is_not_send() {
        fn is_send<T: Send>() {}
        is_send::<iceoryx2::port::publisher::Publisher<Service, isotherm_client::RawSample, ()>>();
        is_send::<iceoryx2::sample_mut::SampleMut<Service, isotherm_client::RawSample, ()>>();
        is_send::<iceoryx2::port::subscriber::Subscriber<Service, isotherm_client::CompensatedIncrement, ()>>();
        is_send::<iceoryx2::port::notifier::Notifier<Service>>();
        is_send::<iceoryx2::port::listener::Listener<Service>>();
        is_send::<
            iceoryx2::service::port_factory::publish_subscribe::PortFactory<Service, isotherm_client::RawSample, ()>,
        >();
        is_send::<iceoryx2::port::subscriber::Subscriber<Service, [u8], ()>>();
        is_send::<iceoryx2::service::port_factory::publish_subscribe::PortFactory<Service, [u8], ()>>();
        is_send::<iceoryx2::node::Node<Service>>();
        is_send::<isotherm_client::Clock>();
    }
}

#[cfg(test)]
#[cfg(isotherm_loom)]
mod explored {
    use super::*;
    use isotherm_client::sync::{explore, thread};
    use std::sync::Arc;

    struct AnyThread(Handle<u64>);
    // SAFETY: what the model is about; loom reports a race.
    unsafe impl Sync for AnyThread {}
    // SAFETY: a number is `Send`.
    unsafe impl Send for AnyThread {}

    /// Two threads call at any moment: a call is done whole or refused, and what it did is there for the next.
    #[test]
    fn explored_calls_take_turns() {
        let found = explore(|| {
            let handle = Arc::new(AnyThread(Handle::new(0)));
            let call = |handle: &AnyThread| {
                let code = enter(Some(&handle.0), |calls| {
                    *calls += 1;
                    Ok(())
                });
                assert!(matches!(code, ISOTHERM_OK | ISOTHERM_ERROR_BUSY), "{code:?}");
                u64::from(code == ISOTHERM_OK)
            };
            let other = {
                let handle = Arc::clone(&handle);
                thread::spawn(move || call(&handle) + call(&handle))
            };
            let done = call(&handle);
            let mut total = 0;
            let done = done + other.join().unwrap();
            assert_eq!(enter(Some(&handle.0), |calls| Ok(total = *calls)), ISOTHERM_OK);
            assert_eq!(total, done);
        });
        assert_eq!((found.needed.len(), found.idle.len()), (2, 0), "{found:?}");
    }
}
