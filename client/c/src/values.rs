//! Functions without a handle: names and options from C, samples, flags.

use crate::code::isotherm_code::{ISOTHERM_ERROR_NAME, ISOTHERM_ERROR_VALUE};
use crate::code::{CodedError, NULL};
use core::ffi::{CStr, c_char};
use core::fmt::Write as _;
use core::time::Duration;
use isotherm_client::{Domain, Flags, ImuId, LagOption, Options, TimeConstant};

/// For isotherm_options: the time constant of the table in force. It is 0, so that it is the default.
///
/// It is read from the status of the service when the acquisition connects, and again when an increment is flagged
/// ISOTHERM_FLAG_LAG_UNKNOWN: if the table has another one after a reload, a few samples are flagged, until the next
/// readings. Connecting waits for the status beyond its time-out, 0.1 s or less, and 1 s for a service that hangs.
pub const ISOTHERM_LAG_SERVICE: f64 = 0.0;
/// For isotherm_options: the library keeps no lag. `lag_ns` and `head_lagged` are sent as the application fills them
/// in.
pub const ISOTHERM_LAG_NONE: f64 = -1.0;

/// For connecting: do not wait for the service.
pub const ISOTHERM_NO_WAIT: u64 = u64::MAX;

/// Default of the time-out for connecting.
const TIMEOUT: Duration = Duration::from_secs(5);

/// A time-out for connecting [ns]: 0 is the default.
pub(crate) const fn timeout(timeout_ns: u64) -> Duration {
    match timeout_ns {
        0 => TIMEOUT,
        ISOTHERM_NO_WAIT => Duration::ZERO,
        ns => Duration::from_nanos(ns),
    }
}

/// Parses an IMU's name.
///
/// # Safety
/// `name` is NULL or a string that ends with 0.
pub(crate) unsafe fn imu(name: *const c_char) -> Result<ImuId, CodedError> {
    // SAFETY: the caller's contract.
    let name = unsafe { text(name) }.ok_or(NULL)?;
    String::from_utf8_lossy(&name).parse().map_err(|error| CodedError::new(ISOTHERM_ERROR_NAME, &error))
}

/// The domain of a name.
///
/// # Safety
/// `name` is NULL or a string that ends with 0.
pub(crate) unsafe fn domain(name: *const c_char) -> Result<Domain, CodedError> {
    // SAFETY: the caller's contract.
    let name = unsafe { text(name) };
    Ok(isotherm_client::domain(name.as_deref().map(String::from_utf8_lossy).as_deref())?)
}

/// The options of a reader.
///
/// # Safety
/// `domain` is NULL or a string that ends with 0.
pub(crate) unsafe fn reader_options(domain: *const c_char, timeout_ns: u64) -> Result<Options, CodedError> {
    // SAFETY: the caller's contract.
    Ok(Options::new(unsafe { self::domain(domain) }?, timeout(timeout_ns)))
}

/// The lag of an option: a time constant [s], [`ISOTHERM_LAG_SERVICE`] or [`ISOTHERM_LAG_NONE`].
pub(crate) fn lag_option(lag_s: f64) -> Result<LagOption, CodedError> {
    if lag_s == ISOTHERM_LAG_SERVICE {
        Ok(LagOption::Service)
    } else if lag_s == ISOTHERM_LAG_NONE {
        Ok(LagOption::None)
    } else {
        let fixed = TimeConstant::from_seconds(lag_s).map(LagOption::Fixed);
        fixed.map_err(|error| CodedError::new(ISOTHERM_ERROR_VALUE, &error))
    }
}

/// The bytes of a string; `None` for NULL. A name that is not UTF-8 becomes an invalid one, which the callers refuse.
///
/// # Safety
/// `text` is NULL or a string that ends with 0.
pub(crate) unsafe fn text(text: *const c_char) -> Option<Vec<u8>> {
    // SAFETY: the caller's contract.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_bytes().to_vec())
}

/// The number of the device with this serial number, which every sample carries in `device`: the first 8 bytes of the
/// SHA-256 of its UTF-8, big-endian, without outer blanks. 0, unknown, for NULL, for blanks, and for text that is not
/// UTF-8.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_device(serial: *const c_char) -> u64 {
    // SAFETY: NULL or a string, as the header requires.
    let serial = unsafe { text(serial) }.and_then(|serial| String::from_utf8(serial).ok());
    serial.map_or(0, |serial| isotherm_client::device(&serial))
}

/// Writes the names of `flags` as text: the names joined by `|`, lowest bit first, or `-` if there is none; bits
/// without a name are left out. At most `size` bytes are written to `text`, including the 0 at the end. Returns the
/// length of the whole text without that 0; if it is not less than `size`, the text has been cut off. 1024 bytes are
/// always enough. `text` may be NULL if `size` is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_flags_text(flags: u64, text: *mut c_char, size: usize) -> usize {
    let mut writer = Bounded { text, size: if text.is_null() { 0 } else { size }, length: 0 };
    // `Bounded::write_str` never fails.
    let _ = write!(writer, "{}", Flags(flags));
    let length = writer.length;
    if writer.size > 0 {
        // SAFETY: within the size that the caller gave.
        unsafe { text.add(length.min(writer.size - 1)).write(0) };
    }
    length
}

/// Writes as much of a text as fits into `size` bytes, and counts the length of the whole text.
struct Bounded {
    text: *mut c_char,
    size: usize,
    length: usize,
}

impl core::fmt::Write for Bounded {
    fn write_str(&mut self, part: &str) -> core::fmt::Result {
        for byte in part.bytes() {
            if self.length + 1 < self.size {
                // SAFETY: within the size that the caller of `isotherm_flags_text` gave.
                unsafe { self.text.add(self.length).write(byte as c_char) };
            }
            self.length += 1;
        }
        Ok(())
    }
}
