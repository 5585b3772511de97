//! The functions of the reader.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::{CodedError, NONE, NULL, isotherm_code};
use crate::handle::{Handle, close, create, enter};
use crate::values::{ISOTHERM_NO_WAIT, imu, reader_options};
use core::ffi::{c_char, c_int};
use core::ptr::NonNull;
use core::time::Duration;
use isotherm_client::{CompensatedIncrement, IncrementReader};
use std::os::fd::AsRawFd as _;

/// Reads the increments of one IMU as they are published: for navigation and loggers. Each (session, sequence) is
/// returned once. A reader cannot disturb other processes. If it sleeps for more than 512 increments, the oldest are
/// overwritten, which is a gap in `sequence`.
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

/// Creates a reader that connects at once if the service is there, and otherwise in a later call, as soon as it is;
/// does not wait for it. `domain` is as in isotherm_options. Close the handle with isotherm_reader_close.
///
/// If isotherm_reader_is_connected is true then, nothing is missed that is published from now on. If it is false, what
/// is published before the call that connects it is not received. What prevents it from ever connecting is the error of
/// the next call.
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

/// Creates a connected reader, waiting up to `timeout_ns` for the service if necessary: 0 is the default, 5 s;
/// ISOTHERM_NO_WAIT does not wait. `domain` is as in isotherm_options. Close the handle with isotherm_reader_close.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._NO_ROOM, .._PERMISSION, .._EXHAUSTED,
/// .._TRANSPORT.
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

/// The next increment, if there is one now. Does not wait. The reader stays connected across restarts of service and
/// acquisition.
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

/// As isotherm_reader_receive, but waits up to `timeout_ns`: sleeps until the service signals that increments are
/// there. For the least delay call isotherm_reader_receive in a loop.
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

/// A descriptor for poll, epoll and the like: readable when increments may have come. Then call isotherm_reader_receive
/// until it returns ISOTHERM_NONE, which makes it unreadable, at most 5 ms later where the notification came late. Wait
/// for at most some 100 ms at once, and call isotherm_reader_receive after that too: a notification can be lost. It
/// belongs to the reader, which closes it, and stays the same as long as the reader.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_NO_SERVICE (also while the reader is not connected), ISOTHERM_ERROR_TRANSPORT.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_descriptor(
    reader: *mut isotherm_reader,
    descriptor: *mut c_int,
) -> isotherm_code {
    with(reader, |reader| {
        let output = NonNull::new(descriptor).ok_or(NULL)?;
        let descriptor = reader.descriptor()?.as_raw_fd();
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(descriptor) };
        Ok(())
    })
}

/// How long ago the service was last seen at work for this IMU [ns]: under 300 000 000 while it lives and is on time.
/// The first call of a reader may give up to a second more.
///
/// ISOTHERM_OK, ISOTHERM_NONE (no service was seen yet), ISOTHERM_ERROR_OTHER_VERSION, ISOTHERM_ERROR_TRANSPORT, and
/// the errors of isotherm_reader_receive.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_heartbeat_age(
    reader: *mut isotherm_reader,
    age_ns: *mut u64,
) -> isotherm_code {
    with(reader, |reader| {
        let output = NonNull::new(age_ns).ok_or(NULL)?;
        let age = reader.heartbeat_age()?.ok_or(NONE)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(u64::try_from(age.as_nanos()).unwrap_or(u64::MAX)) };
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

/// The control periods that are missing right before the increment that was received last: holes in `sequence`, also
/// those of a reader that was too slow, and the time between two sessions of the same clock. -1 if that is unknown:
/// where time steps, between sessions whose timestamps are of different clocks, are 0, or do not agree with the
/// reader's clock to within 0.25 s, before the first increment of the reader, and for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reader_lost_before(reader: *const isotherm_reader) -> i64 {
    let mut lost = None;
    with(reader, |reader| {
        lost = reader.lost_before();
        Ok(())
    });
    lost.map_or(-1, |lost| i64::try_from(lost).unwrap_or(i64::MAX))
}
