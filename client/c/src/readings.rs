//! Readings in m/s2 and rad/s to pulses, and increments back to them.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::acquisition::{isotherm_acquisition, with};
use crate::code::{NULL, isotherm_code};
use crate::handle::without_handle;
use isotherm_client::{CompensatedIncrement, RawSample};

/// Writes the pulses of a sample of an acquisition that has connected with the resolutions of isotherm_options: three
/// of `specific_force` [m/s2] along A1, A2, A3, and three of `angular_rate` [rad/s] about G1, G2, G3, each the mean
/// over the interval of the sample. `angular_rate` is NULL for an IMU without gyroscopes: they become absent, with
/// temperature NaN.
///
/// The pulses are those of the table in force, whatever your own interval is, so the increment is right at any rate.
/// What rounding leaves is carried to the next sample: all pulses together differ from the integral of all readings by
/// half a pulse at most. An `interval_ns` of 0 in the sample becomes the nominal interval of the table. All other
/// fields stay. Nothing is allocated, unless it fails.
///
/// While no table is known, or its pulses stand for something else, samples are invalid: they are sent with
/// temperatures of NaN, so that their increments are NaN and flagged, and a line on stderr says why.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_VALUE for a reading that is not finite or over 2^32 - 1 pulses, whose sensor the message
/// names, and for an interval or a resolution out of its range. Nothing has been changed then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_fill(
    acquisition: *mut isotherm_acquisition,
    sample: *mut RawSample,
    specific_force: *const f64,
    angular_rate: *const f64,
) -> isotherm_code {
    with(acquisition, |content| {
        if sample.is_null() || specific_force.is_null() {
            return Err(NULL);
        }
        // SAFETY: not NULL, so they are readable, as the header requires.
        let (mut raw, force) = unsafe { (sample.read(), specific_force.cast::<[f64; 3]>().read()) };
        // SAFETY: NULL, or readable, as the header requires.
        let rate = (!angular_rate.is_null()).then(|| unsafe { angular_rate.cast::<[f64; 3]>().read() });
        content.acquisition.fill(&mut raw, force, rate)?;
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { sample.write(raw) };
        Ok(())
    })
}

/// Writes the mean specific force over an increment's interval to three of `specific_force` [m/s2]: NaN where the
/// increment is NaN, and for an interval of 0.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_increment_specific_force(
    increment: *const CompensatedIncrement,
    specific_force: *mut f64,
) -> isotherm_code {
    // SAFETY: NULL or valid, as the header requires.
    unsafe { write_mean(increment, specific_force, CompensatedIncrement::specific_force) }
}

/// Writes the mean angular rate over an increment's interval to three of `angular_rate` [rad/s]: NaN where the
/// increment is NaN, as of a table without gyroscopes, and for an interval of 0. Earth's rate is in it.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_increment_angular_rate(
    increment: *const CompensatedIncrement,
    angular_rate: *mut f64,
) -> isotherm_code {
    // SAFETY: NULL or valid, as the header requires.
    unsafe { write_mean(increment, angular_rate, CompensatedIncrement::angular_rate) }
}

/// Writes three values of an increment.
///
/// # Safety
/// The pointers are NULL or valid.
unsafe fn write_mean(
    increment: *const CompensatedIncrement,
    output: *mut f64,
    mean: impl FnOnce(&CompensatedIncrement) -> [f64; 3],
) -> isotherm_code {
    without_handle(|| {
        if increment.is_null() || output.is_null() {
            return Err(NULL);
        }
        // SAFETY: not NULL, so they are readable and writable, as the header requires.
        unsafe { output.cast::<[f64; 3]>().write(mean(&increment.read())) };
        Ok(())
    })
}
