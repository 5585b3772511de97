//! Whether a control period is the one that the scale factors of a table are of.
//!
//! A reading \[m/s2\] has no pulses. As a count of a fixed resolution it becomes pulses over one **nominal interval**,
//! and its scale factors are right at that interval and its multiples (merged samples) only. At 2.5 ms, scale factors
//! of 0.505 s give 202 times the acceleration.

use crate::wire::MAX_INTERVAL_NS;

/// Most nominal intervals that one sample may have in it.
pub const MAX_MULTIPLE: u64 = 64;

/// Whether `interval_ns` is within 1 % of a whole multiple, 1 to [`MAX_MULTIPLE`], of `nominal_ns`.
///
/// ```text
/// m  = floor((interval_ns + floor(nominal_ns / 2)) / nominal_ns), at least 1, at most 64
/// is = |interval_ns - m * nominal_ns| * 100 <= m * nominal_ns
/// ```
/// All are whole numbers, so any language repeats it exactly. Both must be from 1 to [`MAX_INTERVAL_NS`]; otherwise the
/// answer is no.
///
/// ```
/// use isotherm_shared::nominal::interval_fits;
///
/// let fits = |interval_ns| interval_fits(2_500_000, interval_ns);
/// assert!(fits(2_500_000) && fits(2_475_000) && fits(5_050_000));
/// assert!(!fits(2_474_999) && !fits(3_750_000) && !interval_fits(505_000_000, 2_500_000));
/// ```
#[must_use]
pub const fn interval_fits(nominal_ns: u64, interval_ns: u64) -> bool {
    if nominal_ns == 0 || nominal_ns > MAX_INTERVAL_NS || interval_ns == 0 || interval_ns > MAX_INTERVAL_NS {
        return false;
    }
    // Nearly every sample, without a division: m is 1 here.
    if interval_ns.abs_diff(nominal_ns) * 100 <= nominal_ns {
        return true;
    }
    let multiple = match (interval_ns + nominal_ns / 2) / nominal_ns {
        0 => 1,
        MAX_MULTIPLE.. => MAX_MULTIPLE,
        multiple => multiple,
    };
    // At most 64 hours times 100: far below 2^64.
    interval_ns.abs_diff(multiple * nominal_ns) * 100 <= multiple * nominal_ns
}

/// Whether scale factors of these nominal intervals \[s\] can be alike: they differ by at most 1 % of the first, or one
/// table has none.
#[must_use]
pub fn comparable(one: Option<f64>, other: Option<f64>) -> bool {
    one.zip(other).is_none_or(|(one, other)| (other - one).abs() <= 0.01 * one)
}

/// The nominal interval of a table \[s\] in whole nanoseconds: the double `seconds * 1e9`, rounded half up.
#[must_use]
pub fn nominal_ns(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
