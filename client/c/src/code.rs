//! Codes, and the message behind the last one.
#![allow(non_camel_case_types, reason = "the names of C")]

use core::ffi::{CStr, c_char};
use isotherm_client::{
    CompensateError, ConnectError, DomainError, InFlight, MergeError, RealtimeError, SendError, TransportError,
};
use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::CString;

/// What a call came to. 0 is success, positive codes are part of normal operation, negative ones are errors. The numbers never
/// change; later versions may add some.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
#[repr(i32)]
pub enum isotherm_code {
    /// Done.
    ISOTHERM_OK = 0,
    /// There is no increment now, or none came in time. Nothing has been written.
    ISOTHERM_NONE = 1,
    /// As many samples as the service's queue holds are unanswered. The sample has not been sent and is still yours: wait and send
    /// it again, discard it, or sum the next one into it with isotherm_merge.
    ISOTHERM_FULL = 2,
    /// The sample was sent, but its increment did not come in time. It stays in flight: it is sent again when the service
    /// returns, and a later isotherm_receive may still get its answer.
    ISOTHERM_TIMEOUT = 3,
    /// A pointer that must not be NULL is.
    ISOTHERM_ERROR_NULL = -1,
    /// The name of an IMU or a domain is not 1 to 32 of a-z 0-9 - _, or the domain's folder (ISOTHERM_ROOT) cannot be used.
    ISOTHERM_ERROR_NAME = -2,
    /// No service runs in the domain.
    ISOTHERM_ERROR_NO_SERVICE = -3,
    /// The service does not serve this IMU.
    ISOTHERM_ERROR_NO_SUCH_IMU = -4,
    /// Another process, or another handle, is this IMU's acquisition.
    ISOTHERM_ERROR_OCCUPIED = -5,
    /// All reader places of the IMU are taken.
    ISOTHERM_ERROR_NO_ROOM = -6,
    /// The domain belongs to another user.
    ISOTHERM_ERROR_PERMISSION = -7,
    /// The machine has no shared memory or disk space left, or the process no descriptors.
    ISOTHERM_ERROR_EXHAUSTED = -8,
    /// The transport failed; the message has the phase and the cause. A sample that was being sent is lost, and the service will
    /// flag the gap.
    ISOTHERM_ERROR_TRANSPORT = -9,
    /// This is no sample on loan from this acquisition: it has been sent or discarded, or never was one.
    ISOTHERM_ERROR_NOT_ON_LOAN = -10,
    /// ISOTHERM_LOANS samples are on loan already.
    ISOTHERM_ERROR_LOANS = -11,
    /// The sequence is not above the last one sent in this session. The sample is still yours.
    ISOTHERM_ERROR_SEQUENCE = -12,
    /// Samples of the old session are unanswered.
    ISOTHERM_ERROR_IN_FLIGHT = -13,
    /// The two samples cannot be summed: a channel's pulses exceed 32 bits, or the interval one hour. Neither has changed.
    ISOTHERM_ERROR_MERGE = -14,
    /// The operating system refused a real-time setting; the message tells which, why, and what would help.
    ISOTHERM_ERROR_REALTIME = -15,
    /// Another call is in this handle at this moment, in another thread or beneath a signal handler. Nothing has been done.
    ISOTHERM_ERROR_BUSY = -16,
    /// The handle is of the process that this one was forked from. Nothing has been done.
    ISOTHERM_ERROR_FORKED = -17,
    /// A fault of this library, in this call or in an earlier one with the same handle, which can only be closed now. Please
    /// report it, with what was printed to stderr.
    ISOTHERM_ERROR_INTERNAL = -18,
}

use isotherm_code::*;

/// Anything but success, and why.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) code: isotherm_code,
    /// `None` for what is too common to have one.
    message: Option<Cow<'static, CStr>>,
}

impl Failure {
    pub(crate) fn new(code: isotherm_code, message: &impl ToString) -> Self {
        let text = message.to_string().replace('\0', "?");
        Self { code, message: CString::new(text).ok().map(Cow::Owned) }
    }

    pub(crate) const fn fixed(code: isotherm_code, message: &'static CStr) -> Self {
        Self { code, message: Some(Cow::Borrowed(message)) }
    }
}

/// No increment.
pub(crate) const NONE: Failure = Failure { code: ISOTHERM_NONE, message: None };
pub(crate) const NULL: Failure =
    Failure::fixed(ISOTHERM_ERROR_NULL, c"a pointer is NULL that must not be; see the function's description");
pub(crate) const FULL: Failure =
    Failure::fixed(ISOTHERM_FULL, c"the service's queue is full of unanswered samples; the sample is still yours");

impl From<ConnectError> for Failure {
    fn from(error: ConnectError) -> Self {
        let code = match &error {
            ConnectError::NoService(_) => ISOTHERM_ERROR_NO_SERVICE,
            ConnectError::NoSuchImu { .. } => ISOTHERM_ERROR_NO_SUCH_IMU,
            ConnectError::Occupied { .. } => ISOTHERM_ERROR_OCCUPIED,
            ConnectError::NoRoom { .. } => ISOTHERM_ERROR_NO_ROOM,
            ConnectError::Permission { .. } => ISOTHERM_ERROR_PERMISSION,
            ConnectError::Domain(_) => ISOTHERM_ERROR_NAME,
            ConnectError::Exhausted(_) => ISOTHERM_ERROR_EXHAUSTED,
            ConnectError::Transport { .. } => ISOTHERM_ERROR_TRANSPORT,
        };
        Self::new(code, &error)
    }
}

/// Errors with one code each.
macro_rules! coded {
    ($($error:ty => $code:expr),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::new($code, &error)
            }
        })*
    };
}

coded! {
    DomainError => ISOTHERM_ERROR_NAME,
    TransportError => ISOTHERM_ERROR_TRANSPORT,
    InFlight => ISOTHERM_ERROR_IN_FLIGHT,
    MergeError => ISOTHERM_ERROR_MERGE,
    RealtimeError => ISOTHERM_ERROR_REALTIME,
}

/// Without the sample that may be in it.
impl From<&SendError> for Failure {
    fn from(error: &SendError) -> Self {
        match error {
            SendError::Full(_) => FULL,
            SendError::Sequence(_) => Self::new(ISOTHERM_ERROR_SEQUENCE, error),
            SendError::Transport(_) => Self::new(ISOTHERM_ERROR_TRANSPORT, error),
        }
    }
}

/// Without the sample that may be in it.
impl From<&CompensateError> for Failure {
    fn from(error: &CompensateError) -> Self {
        match error {
            CompensateError::Send(error) => error.into(),
            CompensateError::Timeout => Self::new(ISOTHERM_TIMEOUT, error),
            CompensateError::Receive(error) => Self::new(ISOTHERM_ERROR_TRANSPORT, error),
        }
    }
}

thread_local! {
    static MESSAGE: RefCell<Cow<'static, CStr>> = const { RefCell::new(Cow::Borrowed(c"")) };
}

/// The code for C; the message is kept.
#[inline]
pub(crate) fn code(result: Result<(), Failure>) -> isotherm_code {
    match result {
        Ok(()) => ISOTHERM_OK,
        Err(Failure { code, message: None }) => code,
        Err(Failure { code, message: Some(message) }) => {
            // While a thread ends there is no message any more.
            let _ = MESSAGE.try_with(|last| last.replace(message));
            code
        }
    }
}

/// What the last call of this thread that gave neither ISOTHERM_OK nor ISOTHERM_NONE has to say: phase, cause and remedy, in
/// UTF-8; empty if there was none. Never NULL. Valid until the thread's next such call, or its end: copy what you keep.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_error_message() -> *const c_char {
    MESSAGE.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
