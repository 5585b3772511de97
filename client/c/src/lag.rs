//! The lagged temperature: readings, and the state for a successor of the process.
#![allow(non_camel_case_types, reason = "the names of C")]

use crate::acquisition::{isotherm_acquisition, with};
use crate::code::isotherm_code::ISOTHERM_ERROR_VALUE;
use crate::code::{CodedError, NULL, isotherm_code};
use core::ptr::NonNull;
use isotherm_client::{Lag, LaggedReading, Sensor};

/// Number of sensors: A1, A2, A3, G1, G2, G3 have the numbers 0 to 5.
pub const ISOTHERM_SENSORS: usize = 6;

/// The state of one sensor's lag: its last reading, and the lagged temperature at that time.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct isotherm_lagged_reading {
    /// When the temperature was measured, on the acquisition's clock [ns].
    pub time_ns: u64,
    /// Head temperature, in the table's unit.
    pub telemetry: f64,
    /// Lagged temperature, in the table's unit; NaN before the first reading.
    pub lagged: f64,
    /// The share of the lagged temperature that rests on an unknown start, 0 to 1; 0 where the sensor was soaked.
    /// Over 0.05 samples are sent without it.
    pub unknown: f64,
}

/// The state of an acquisition's lag. It may be saved as its bytes: it has no padding, and every bit pattern is valid.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct isotherm_lag {
    /// A1, A2, A3, G1, G2, G3.
    pub sensors: [isotherm_lagged_reading; ISOTHERM_SENSORS],
}

/// Takes a new reading of a sensor's head temperature, in the table's unit, measured at `time_ns` on your clock. Every
/// sample that is sent later carries the lagged temperature of all readings so far, in `lag_ns` and `head_lagged`.
///
/// `sensor` is 0 to 5 for A1, A2, A3, G1, G2, G3. Call it for every sensor that the IMU has, and once for each new
/// measurement, not for each sample. A value that is not finite, or has the time of the last reading, is no reading.
/// With ISOTHERM_LAG_SERVICE neither is one that no thermometer gives: far outside the ranges of the table in force, or
/// a step that is too fast. docs/temperature-in-motion.md has the formula and the limits.
///
/// If the service has taken a table with another time constant, with ISOTHERM_LAG_SERVICE, this call has the helper
/// thread of the acquisition read the status, and a later call takes it.
///
/// ISOTHERM_OK, ISOTHERM_ERROR_VALUE for another `sensor`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reading(
    acquisition: *mut isotherm_acquisition,
    sensor: u32,
    telemetry: f64,
    time_ns: u64,
) -> isotherm_code {
    with(acquisition, |content| {
        let (sensor, _) = Sensor::NAMES.get(sensor as usize).ok_or(NO_SENSOR)?;
        content.acquisition.lag().read(*sensor, telemetry, time_ns);
        Ok(())
    })
}

/// Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer: as
/// isotherm_reading once for each of the six. Gyroscopes that the IMU does not have stay absent.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_reading_of_all(
    acquisition: *mut isotherm_acquisition,
    temperature: f64,
    time_ns: u64,
) -> isotherm_code {
    with(acquisition, |content| {
        content.acquisition.lag().reading_of_all(temperature, time_ns);
        Ok(())
    })
}

const NO_SENSOR: CodedError =
    CodedError::fixed(ISOTHERM_ERROR_VALUE, c"there is no such sensor; give 0 to 5 for A1, A2, A3, G1, G2, G3");

/// The time constant that samples are sent with [ns]; 0 while there is none, and for a handle that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_lag_ns(acquisition: *const isotherm_acquisition) -> u64 {
    let mut lag_ns = 0;
    with(acquisition, |content| {
        lag_ns = content.acquisition.lag().state().lag_ns;
        Ok(())
    });
    lag_ns
}

/// Writes the state of the lag to `*lag`. Save it after each reading if a successor of this process shall go on with
/// it, together with isotherm_boot().
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_save_lag(
    acquisition: *const isotherm_acquisition,
    lag: *mut isotherm_lag,
) -> isotherm_code {
    with(acquisition, |content| {
        let output = NonNull::new(lag).ok_or(NULL)?;
        let Lag { sensors, unknown, .. } = *content.acquisition.lag().state();
        let none = LaggedReading { time_ns: 0, temperature: 0.0, lagged: f64::NAN };
        let sensors = core::array::from_fn(|sensor| {
            let LaggedReading { time_ns, temperature: telemetry, lagged } = sensors[sensor].unwrap_or(none);
            isotherm_lagged_reading { time_ns, telemetry, lagged, unknown: unknown[sensor] }
        });
        // SAFETY: not NULL, so it is writable, as the header requires.
        unsafe { output.write(isotherm_lag { sensors }) };
        Ok(())
    })
}

/// Goes on with a state that was saved, on the same clock, as if the temperature had gone straight on in the pause. A
/// sensor whose temperature or lagged temperature is not finite, or whose next reading is earlier than the saved one,
/// which is then of another clock, is unknown as after isotherm_forget_lag.
///
/// Call isotherm_forget_lag in its place if the state was saved with another isotherm_boot(), unless your clock goes on
/// when the machine is started anew.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_restore_lag(
    acquisition: *mut isotherm_acquisition,
    lag: *const isotherm_lag,
) -> isotherm_code {
    with(acquisition, |content| {
        if lag.is_null() {
            return Err(NULL);
        }
        // SAFETY: not NULL, so it is readable, as the header requires.
        let isotherm_lag { sensors } = unsafe { lag.read() };
        let mut lag = Lag::new(0);
        for (sensor, isotherm_lagged_reading { time_ns, telemetry, lagged, unknown }) in sensors.into_iter().enumerate()
        {
            lag.sensors[sensor] = Some(LaggedReading { time_ns, temperature: telemetry, lagged });
            lag.unknown[sensor] = unknown;
        }
        content.acquisition.lag().restore(&lag);
        Ok(())
    })
}

/// Informs the library that what the temperatures have been is not known. That is so already when the acquisition
/// connects, and when it begins a session. Increments are flagged ISOTHERM_FLAG_LAG_UNKNOWN, and computed without the
/// transient terms, until the readings span three time constants.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_forget_lag(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| {
        content.acquisition.lag().forget();
        Ok(())
    })
}

/// Informs the library that the IMU is soaked: its temperatures have been those of the next readings for three time
/// constants. Only what has just been powered, or has stood long enough, is. If it is not, the lagged temperature is
/// wrong by the difference, which decays with the time constant, and no flag shows it.
///
/// ISOTHERM_OK.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn isotherm_soaked(acquisition: *mut isotherm_acquisition) -> isotherm_code {
    with(acquisition, |content| {
        content.acquisition.lag().soaked();
        Ok(())
    })
}
