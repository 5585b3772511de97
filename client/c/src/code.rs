//! The codes that calls return, and the message of the last error.
#![allow(non_camel_case_types, reason = "the names of C")]

use core::ffi::{CStr, c_char};
use isotherm_client::{
    CompensateError, ConnectError, DomainError, InFlight, MergeError, ReadingError, RealtimeError, SendError,
    TransportError,
};
use std::borrow::Cow;
use std::cell::RefCell;
use std::ffi::CString;

/// Result of a call: 0 is success, positive codes are part of normal operation, negative codes are errors. The numbers
/// never change; later versions may add codes.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
#[repr(i32)]
pub enum isotherm_code {
    /// Success.
    ISOTHERM_OK = 0,
    /// There is no increment now, or none came in time. Nothing has been written.
    ISOTHERM_NONE = 1,
    /// As many samples are unanswered as the service's queue holds. The sample has not been sent and is still yours:
    /// wait and send it again, add the next sample to it with isotherm_merge, or discard it, which is a gap.
    ISOTHERM_FULL = 2,
    /// The sample was sent, but its increment did not come in time. It stays in flight: it is sent again when a new
    /// service has started, and its late increment is kept for isotherm_receive.
    ISOTHERM_TIMEOUT = 3,
    /// The acquisition is closed. Control periods were lost, or samples were unanswered: the message has their numbers,
    /// and the service keeps them in its status.
    ISOTHERM_LOST = 4,
    /// A pointer is NULL that must not be NULL.
    ISOTHERM_ERROR_NULL = -1,
    /// The name of an IMU or a domain is not 1 to 32 of a-z 0-9 - _, or the domain's folder (ISOTHERM_ROOT) cannot be
    /// used.
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
    /// Shared memory, disk space or the file descriptors of the process are exhausted.
    ISOTHERM_ERROR_EXHAUSTED = -8,
    /// The transport failed; the message has the phase and the cause. A sample that was being sent is lost, and the
    /// service will flag the gap.
    ISOTHERM_ERROR_TRANSPORT = -9,
    /// The sample is not on loan from this acquisition: it has been sent or discarded, or was never loaned from it.
    ISOTHERM_ERROR_NOT_ON_LOAN = -10,
    /// ISOTHERM_LOANS samples are on loan already.
    ISOTHERM_ERROR_LOANS = -11,
    /// The sequence is not above the last one sent in this session. The sample is still yours.
    ISOTHERM_ERROR_SEQUENCE = -12,
    /// Samples of the old session are unanswered.
    ISOTHERM_ERROR_IN_FLIGHT = -13,
    /// The two samples cannot be summed: a channel's pulses exceed 32 bits, or the interval one hour. Neither has
    /// changed.
    ISOTHERM_ERROR_MERGE = -14,
    /// The operating system refused a real-time setting; the message has the setting, the cause and a remedy.
    ISOTHERM_ERROR_REALTIME = -15,
    /// Another call uses this handle at this moment, in another thread or interrupted by a signal handler. Nothing has
    /// been done.
    ISOTHERM_ERROR_BUSY = -16,
    /// The handle belongs to the process that this one was forked from. Nothing has been done.
    ISOTHERM_ERROR_FORKED = -17,
    /// A fault of this library, in this call or in an earlier one with the same handle. The handle can only be closed
    /// now. Please report the fault, with the text on stderr.
    ISOTHERM_ERROR_INTERNAL = -18,
    /// A value that cannot be: the number of a sensor, a time constant, a serial number that is not UTF-8, the size of
    /// isotherm_options, or a reading, a resolution or an interval that cannot become pulses.
    ISOTHERM_ERROR_VALUE = -19,
    /// A process of another version of Isotherm has made the streams.
    ISOTHERM_ERROR_OTHER_VERSION = -20,
}

use isotherm_code::*;

/// A code other than ISOTHERM_OK, with its message.
#[derive(Debug)]
pub(crate) struct CodedError {
    pub(crate) code: isotherm_code,
    /// `None` for ISOTHERM_NONE, which is too frequent for a message.
    message: Option<Cow<'static, CStr>>,
}

impl CodedError {
    pub(crate) fn new(code: isotherm_code, message: &impl ToString) -> Self {
        let text = message.to_string().replace('\0', "?");
        Self { code, message: CString::new(text).ok().map(Cow::Owned) }
    }

    pub(crate) const fn fixed(code: isotherm_code, message: &'static CStr) -> Self {
        Self { code, message: Some(Cow::Borrowed(message)) }
    }
}

/// There is no increment.
pub(crate) const NONE: CodedError = CodedError { code: ISOTHERM_NONE, message: None };
pub(crate) const NULL: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_NULL, c"a pointer is NULL that must not be; see the function's description");
pub(crate) const FULL: CodedError =
    CodedError::fixed(ISOTHERM_FULL, c"the service's queue is full of unanswered samples; the sample is still yours");

impl From<ConnectError> for CodedError {
    fn from(error: ConnectError) -> Self {
        let code = match &error {
            ConnectError::NoService(_) => ISOTHERM_ERROR_NO_SERVICE,
            ConnectError::NoSuchImu { .. } => ISOTHERM_ERROR_NO_SUCH_IMU,
            ConnectError::Occupied { .. } => ISOTHERM_ERROR_OCCUPIED,
            ConnectError::NoRoom { .. } => ISOTHERM_ERROR_NO_ROOM,
            ConnectError::Permission { .. } => ISOTHERM_ERROR_PERMISSION,
            ConnectError::Domain(_) => ISOTHERM_ERROR_NAME,
            ConnectError::Exhausted(_) => ISOTHERM_ERROR_EXHAUSTED,
            ConnectError::OtherVersion { .. } => ISOTHERM_ERROR_OTHER_VERSION,
            ConnectError::Transport { .. } => ISOTHERM_ERROR_TRANSPORT,
        };
        Self::new(code, &error)
    }
}

/// Conversions of error types that have one code each.
macro_rules! coded {
    ($($error:ty => $code:expr),* $(,)?) => {
        $(impl From<$error> for CodedError {
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
    ReadingError => ISOTHERM_ERROR_VALUE,
    RealtimeError => ISOTHERM_ERROR_REALTIME,
}

/// The error without its sample.
impl From<&SendError> for CodedError {
    fn from(error: &SendError) -> Self {
        match error {
            SendError::Full(_) => FULL,
            SendError::Sequence(_) => Self::new(ISOTHERM_ERROR_SEQUENCE, error),
            SendError::Transport(_) => Self::new(ISOTHERM_ERROR_TRANSPORT, error),
        }
    }
}

/// The error without its sample.
impl From<&CompensateError> for CodedError {
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

/// The code for C. The message is kept for [`isotherm_error_message`].
#[inline]
pub(crate) fn code(result: Result<(), CodedError>) -> isotherm_code {
    match result {
        Ok(()) => ISOTHERM_OK,
        Err(CodedError { code, message: None }) => code,
        Err(CodedError { code, message: Some(message) }) => {
            // The message may have been destroyed already while the thread ends.
            let _ = MESSAGE.try_with(|last| last.replace(message));
            code
        }
    }
}

/// The message of this thread's last call that returned neither ISOTHERM_OK nor ISOTHERM_NONE: phase, cause and remedy,
/// in UTF-8. Empty if there was no such call; never NULL. Valid until the thread's next such call or its end: copy it
/// if you keep it.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_error_message() -> *const c_char {
    MESSAGE.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}
