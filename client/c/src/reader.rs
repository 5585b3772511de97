//! The functions of the reader.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::{CodedError, NONE, NULL, isotherm_code};
use crate::handle::{Handle, close, create, enter};
use crate::values::{ISOTHERM_NO_WAIT, imu, reader_options};
use core::ffi::c_char;
use core::ptr::NonNull;
use core::time::Duration;
use isotherm_client::{CompensatedIncrement, IncrementReader};

/// Reads the increments of one IMU as they are published: for navigation and loggers. Each (session, sequence) is returned once.
/// A reader cannot disturb other processes. If it sleeps for more than 512 increments, the oldest are overwritten, which is a gap
/// in `sequence`.
#[derive(Debug)]
pub struct isotherm_reader(Handle<IncrementReader>);

/// A call into a reader.
#[inline]
fn with(
    reader: *const isotherm_reader,
    work: impl FnOnce(&mut IncrementReader) -> Result<(), CodedError>,
) -> isotherm_code {
    // SAFETY: NULL or open, as the header requires.
    enter(unsafe { reader.as_ref() }.map(|handle| &handle.0), work)
}

/// Creates a reader that connects when the service has started; does not wait for it. `domain` is as in isotherm_options. Close the
/// handle with isotherm_reader_close.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NAME.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_new(
    imu: *const c_char,
    domain: *const c_char,
    reader: *mut *mut isotherm_reader,
) -> isotherm_code {
    // SAFETY: the strings and the pointer to the handle are NULL or valid, as the header requires.
    unsafe {
        create(reader, isotherm_reader, || {
            Ok(IncrementReader::new(self::imu(imu)?, &reader_options(domain, ISOTHERM_NO_WAIT)?))
        })
    }
}

/// Creates a connected reader, waiting up to `timeout_ns` for the service if necessary: 0 is the default, 5 s; ISOTHERM_NO_WAIT does not wait. `domain` is as in isotherm_options. Close the
/// handle with isotherm_reader_close.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._NO_ROOM, .._PERMISSION, .._EXHAUSTED, .._TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_connect(
    imu: *const c_char,
    domain: *const c_char,
    timeout_ns: u64,
    reader: *mut *mut isotherm_reader,
) -> isotherm_code {
    // SAFETY: the strings and the pointer to the handle are NULL or valid, as the header requires.
    unsafe {
        create(reader, isotherm_reader, || {
            Ok(IncrementReader::connect(self::imu(imu)?, &reader_options(domain, timeout_ns)?)?)
        })
    }
}

/// Leaves the stream and frees the handle. NULL is allowed.
///
/// ISOTHERM_OK. After ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED the handle is still open.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_close(reader: *mut isotherm_reader) -> isotherm_code {
    // SAFETY: NULL, or open and not used again, as the header requires.
    unsafe { close(reader, |handle| &handle.0, |_| Ok(())) }
}

/// The next increment, if there is one now. Does not wait. The reader stays connected across restarts of service and acquisition.
///
/// ISOTHERM_OK, ISOTHERM_NONE (also while there is no service yet), ISOTHERM_ERROR_NO_ROOM, ISOTHERM_ERROR_PERMISSION,
/// ISOTHERM_ERROR_EXHAUSTED, ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_receive(
    reader: *mut isotherm_reader,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(reader, |reader| {
        let output = NonNull::new(increment).ok_or(NULL)?;
        let increment = reader.receive()?.ok_or(NONE)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(increment) };
        Ok(())
    })
}

/// As isotherm_reader_receive, but waits up to `timeout_ns`. Polls every 0.2 ms; for less delay call isotherm_reader_receive in a
/// loop.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_receive_timeout(
    reader: *mut isotherm_reader,
    timeout_ns: u64,
    increment: *mut CompensatedIncrement,
) -> isotherm_code {
    with(reader, |reader| {
        let output = NonNull::new(increment).ok_or(NULL)?;
        let increment = reader.receive_timeout(Duration::from_nanos(timeout_ns))?.ok_or(NONE)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(increment) };
        Ok(())
    })
}

/// Whether the stream has been found. Stays true when the service stops. False for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_is_connected(reader: *const isotherm_reader) -> bool {
    let mut connected = false;
    with(reader, |reader| {
        connected = reader.is_connected();
        Ok(())
    });
    connected
}

/// Increments that came again after a resend and were not returned. 0 for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_repeats(reader: *const isotherm_reader) -> u64 {
    let mut repeats = 0;
    with(reader, |reader| {
        repeats = reader.repeats();
        Ok(())
    });
    repeats
}
