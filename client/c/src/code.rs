//! The codes that calls return, and the message of the last error.
#![allow(non_camel_case_types, reason = "the names of C")]

use core::ffi::{CStr, c_char};
use isotherm_client::{
    CompensateError, ConnectError, DomainError, ExchangeError, InFlight, MergeError, ReadingError, RealtimeError,
    SendError, TransportError,
};
use std::borrow::Cow;
use std::cell::Cell;
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
    /// As many samples are unanswered as the service's queue holds, or others are kept, which go first and for which
    /// there is no room either. The sample has not been sent and is still yours: keep it with isotherm_keep, wait and
    /// send it again, or discard it, which is a gap.
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
    /// The domain belongs to another user, or others could put something into its place.
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
    /// The sequence is not above the last one sent or kept in this session. The sample is still yours.
    ISOTHERM_ERROR_SEQUENCE = -12,
    /// Samples of the old session are unanswered, or kept.
    ISOTHERM_ERROR_IN_FLIGHT = -13,
    /// The two samples cannot be summed: a channel's pulses exceed 32 bits, or the interval one hour, or both are the
    /// same sample. Neither has changed.
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
pub(crate) const FULL: CodedError = CodedError::fixed(
    ISOTHERM_FULL,
    c"the service's queue is full, or samples that are kept go first; this one is still yours: isotherm_keep it",
);
const SEQUENCE: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_SEQUENCE,
    c"the sequence does not rise above the last one sent or kept; the sample is still yours: raise it, or begin a session",
);
pub(crate) const FORKED: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_FORKED,
    c"the handle is of the process that this one was forked from; connect again in the child",
);
const TIMEOUT: CodedError =
    CodedError::fixed(ISOTHERM_TIMEOUT, c"no answer from the service in time; `isotherm status` shows whether it runs");
const PULSES: CodedError = CodedError::fixed(
    ISOTHERM_ERROR_MERGE,
    c"the summed pulses of a channel exceed 32 bits; send the two as two samples",
);
const INTERVAL: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_MERGE, c"the summed interval exceeds one hour; send the two as two samples");

impl From<ConnectError> for CodedError {
    fn from(error: ConnectError) -> Self {
        let code = match &error {
            ConnectError::NoService(_) => ISOTHERM_ERROR_NO_SERVICE,
            ConnectError::NoSuchImu { .. } => ISOTHERM_ERROR_NO_SUCH_IMU,
            ConnectError::Occupied { .. } => ISOTHERM_ERROR_OCCUPIED,
            ConnectError::NoRoom { .. } => ISOTHERM_ERROR_NO_ROOM,
            ConnectError::Permission { .. } | ConnectError::Foreign(_) => ISOTHERM_ERROR_PERMISSION,
            ConnectError::Domain(_) => ISOTHERM_ERROR_NAME,
            ConnectError::Exhausted(_) => ISOTHERM_ERROR_EXHAUSTED,
            ConnectError::Pulses { .. } => ISOTHERM_ERROR_VALUE,
            ConnectError::OtherVersion { .. } => ISOTHERM_ERROR_OTHER_VERSION,
            ConnectError::Transport { .. } | ConnectError::OtherClock { .. } | ConnectError::OtherMemory => {
                ISOTHERM_ERROR_TRANSPORT
            }
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
    ReadingError => ISOTHERM_ERROR_VALUE,
    RealtimeError => ISOTHERM_ERROR_REALTIME,
}

/// The error without its sample.
impl From<&SendError> for CodedError {
    fn from(error: &SendError) -> Self {
        match error {
            SendError::Full(_) => FULL,
            SendError::Sequence(_) => SEQUENCE,
            SendError::Transport(_) => Self::new(ISOTHERM_ERROR_TRANSPORT, error),
        }
    }
}

impl From<&ExchangeError> for CodedError {
    fn from(error: &ExchangeError) -> Self {
        match error {
            ExchangeError::Sequence(_) => SEQUENCE,
            ExchangeError::Forked(_) => FORKED,
        }
    }
}

/// The error without its sample.
impl From<&CompensateError> for CodedError {
    fn from(error: &CompensateError) -> Self {
        match error {
            CompensateError::Send(error) => error.into(),
            CompensateError::Timeout => TIMEOUT,
            CompensateError::Receive(error) => Self::new(ISOTHERM_ERROR_TRANSPORT, error),
        }
    }
}

impl From<MergeError> for CodedError {
    fn from(error: MergeError) -> Self {
        match error {
            MergeError::Pulses => PULSES,
            MergeError::Interval => INTERVAL,
        }
    }
}

thread_local! {
    /// The message of the thread's last call: a static text, or that of `ALLOCATED`. A signal handler may set and read
    /// it at any moment.
    static MESSAGE: Cell<*const c_char> = const { Cell::new(c"".as_ptr()) };
    /// The last message that was allocated.
    static ALLOCATED: Allocated = const { Allocated(Cell::new(None)) };
}

struct Allocated(Cell<Option<CString>>);

impl Drop for Allocated {
    fn drop(&mut self) {
        MESSAGE.set(c"".as_ptr());
    }
}

/// The code for C. The message is kept for [`isotherm_error_message`].
#[inline]
pub(crate) fn code(result: Result<(), CodedError>) -> isotherm_code {
    match result {
        Ok(()) => ISOTHERM_OK,
        Err(CodedError { code, message: None }) => code,
        Err(CodedError { code, message: Some(message) }) => {
            keep(message);
            code
        }
    }
}

/// Keeps a message. A static one is kept without an allocation and without freeing another: this may be a signal
/// handler, and the interrupted thread in its allocator.
fn keep(message: Cow<'static, CStr>) {
    match message {
        Cow::Borrowed(text) => MESSAGE.set(text.as_ptr()),
        // While the thread ends there may be no place for it any more.
        Cow::Owned(text) => {
            _ = ALLOCATED.try_with(|place| {
                let pointer = text.as_ptr();
                let before = place.0.replace(Some(text));
                MESSAGE.set(pointer);
                // Not earlier: a handler could have found it.
                drop(before);
            });
        }
    }
}

/// The message of this thread's last call that returned neither ISOTHERM_OK nor ISOTHERM_NONE: phase, cause and remedy,
/// in UTF-8. Empty if there was no such call; never NULL. Valid until the thread's next such call or its end: copy it
/// if you keep it.
#[unsafe(no_mangle)]
pub extern "C" fn isotherm_error_message() -> *const c_char {
    MESSAGE.get()
}
