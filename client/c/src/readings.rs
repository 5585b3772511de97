//! Readings in m/s2 and rad/s to pulses, and increments back to them.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::code::{NULL, isotherm_code};
use crate::handle::without_handle;
use crate::lag::ISOTHERM_SENSORS;
use isotherm_client::{CompensatedIncrement, RawSample, Readings, Resolution};

/// Turns readings into pulses, sample after sample. Begin with
/// `isotherm_readings readings = {.accelerometer = 1e-6, .gyroscope = 1e-7, .interval_ns = 2500000};`.
///
/// A pulse is the resolution over the nominal interval, as the table says too: K+ = -K- = g0 / (resolution * interval).
/// What rounding leaves is carried to the next sample, so that all pulses together differ from the integral of all
/// readings by half a pulse at most. Set `remainders` to 0 for a new session, and after a gap.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct isotherm_readings {
    /// What one pulse of an accelerometer stands for [m/s2], 1e-15 to 1e6.
    pub accelerometer: f64,
    /// What one pulse of a gyroscope stands for [rad/s], 1e-15 to 1e6, also if there is none.
    pub gyroscope: f64,
    /// The nominal interval between two samples [ns], 1 to ISOTHERM_MAX_INTERVAL_NS.
    pub interval_ns: u64,
    /// What rounding has left of A1, A2, A3, G1, G2, G3 [pulse]; over half a pulse counts as 0.
    pub remainders: [f64; ISOTHERM_SENSORS],
}

/// Writes the pulses of a sample: three of `specific_force` [m/s2] along A1, A2, A3, and three of `angular_rate`
/// [rad/s] about G1, G2, G3, each the mean over the sample's interval. `angular_rate` is NULL for an IMU without
/// gyroscopes: they become absent, with temperature NaN.
///
/// An `interval_ns` of 0 in the sample becomes the nominal one. Another one, such as the measured interval or that of
/// several samples in one, is kept, and the pulses are those of that interval. All other fields stay. Nothing is
/// allocated, unless it fails.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_VALUE for a reading that is not finite or over 2^32 - 1 pulses, whose sensor the message
/// names, and for a resolution or interval out of its range. Nothing has been changed then.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_readings_fill(
    readings: *mut isotherm_readings,
    sample: *mut RawSample,
    specific_force: *const f64,
    angular_rate: *const f64,
) -> isotherm_code {
    without_handle(|| {
        if readings.is_null() || sample.is_null() || specific_force.is_null() {
            return Err(NULL);
        }
        // SAFETY: not NULL, so they are readable, as the header requires.
        let (mut state, mut raw, force) =
            unsafe { (readings.read(), sample.read(), specific_force.cast::<[f64; 3]>().read()) };
        // SAFETY: NULL, or readable, as the header requires.
        let rate = (!angular_rate.is_null()).then(|| unsafe { angular_rate.cast::<[f64; 3]>().read() });
        let resolution = Resolution { accelerometer: state.accelerometer, gyroscope: state.gyroscope };
        let mut filling = Readings { resolution, interval_ns: state.interval_ns, remainders: state.remainders };
        filling.fill(&mut raw, force, rate)?;
        state.remainders = filling.remainders;
        // SAFETY: not NULL, so they are writable, as the header requires.
        unsafe { (readings.write(state), sample.write(raw)) };
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
