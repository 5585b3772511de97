//! Plain values: names that C hands over, samples, flags.

use crate::code::isotherm_code::ISOTHERM_ERROR_NAME;
use crate::code::{Failure, NULL, code, isotherm_code};
use core::ffi::{CStr, c_char};
use core::fmt::Write as _;
use core::time::Duration;
use isotherm_client::{Flags, ImuId, Options, RawSample};

/// An IMU's name.
///
/// # Safety
/// NULL or a string that ends with 0.
pub(crate) unsafe fn imu(name: *const c_char) -> Result<ImuId, Failure> {
    // SAFETY: the caller's contract.
    let name = unsafe { text(name) }.ok_or(NULL)?;
    name.parse().map_err(|error| Failure::new(ISOTHERM_ERROR_NAME, &error))
}

/// How to reach the service.
///
/// # Safety
/// As for [`imu`].
pub(crate) unsafe fn options(domain: *const c_char, timeout_ns: u64) -> Result<Options, Failure> {
    // SAFETY: the caller's contract.
    let domain = isotherm_client::domain(unsafe { text(domain) }.as_deref())?;
    Ok(Options { domain, timeout: Duration::from_nanos(timeout_ns) })
}

/// What is not UTF-8 is no valid name, and refused as such.
unsafe fn text(text: *const c_char) -> Option<String> {
    // SAFETY: the caller's contract.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

/// Adds the next control period to a sample: pulses and intervals are summed, timestamp and telemetry become the later
/// ones, session, sequence and `sent_ns` stay. `later` does not change.
///
/// The velocity increment is linear in pulses and interval, so no velocity is lost as long as the temperature has not moved
/// between the two. Use it for a sample that the service had no room for.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_MERGE.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_merge(sample: *mut RawSample, later: *const RawSample) -> isotherm_code {
    if sample.is_null() || later.is_null() {
        return code(Err(NULL));
    }
    // SAFETY: not NULL, so they can be read, as the header asks for. Copies: the two may be the same.
    let (mut sum, later) = unsafe { (sample.read(), later.read()) };
    code(sum.merge(&later).map_err(Failure::from).map(|()| {
        // SAFETY: as above.
        unsafe { sample.write(sum) };
    }))
}

/// Writes the names of `flags` as text: `-`, or the names joined by `|`, lowest bit first; bits without a name are left out. At
/// most `size` bytes are written to `text`, the 0 at the end included. Returns how long the whole text is, without that 0; if that is
/// not below `size`, it has been cut off. 512 bytes are enough for all. `text` may be NULL if `size` is 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_flags_text(flags: u32, text: *mut c_char, size: usize) -> usize {
    let mut writer = Bounded { text, size: if text.is_null() { 0 } else { size }, length: 0 };
    // Writing there cannot fail.
    let _ = write!(writer, "{}", Flags(flags));
    let length = writer.length;
    if writer.size > 0 {
        // SAFETY: within the size that the caller has given.
        unsafe { text.add(length.min(writer.size - 1)).write(0) };
    }
    length
}

/// As much of a text as there is room for.
struct Bounded {
    text: *mut c_char,
    size: usize,
    length: usize,
}

impl core::fmt::Write for Bounded {
    fn write_str(&mut self, part: &str) -> core::fmt::Result {
        for byte in part.bytes() {
            if self.length + 1 < self.size {
                // SAFETY: within the size that the caller of `isotherm_flags_text` has given.
                unsafe { self.text.add(self.length).write(byte as c_char) };
            }
            self.length += 1;
        }
        Ok(())
    }
}
