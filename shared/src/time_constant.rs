//! Time constants of the lagged temperature.

use crate::table::LAG_RANGE;

/// A valid time constant of the lagged temperature: 0.1 s to one day.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct TimeConstant(u64);

impl TimeConstant {
    /// From seconds, to the nearest nanosecond.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_shared::time_constant::TimeConstant;
    ///
    /// assert_eq!(TimeConstant::from_seconds(240.0)?.ns(), 240_000_000_000);
    /// assert!(TimeConstant::from_seconds(0.01).is_err());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If it is not 0.1 s to 86400 s.
    pub fn from_seconds(seconds: f64) -> Result<Self, InvalidTimeConstant> {
        let [low, high] = LAG_RANGE;
        match (low..=high).contains(&seconds) {
            true => Ok(Self((seconds * 1e9).round() as u64)),
            false => Err(InvalidTimeConstant(seconds)),
        }
    }

    /// In nanoseconds, as [`RawSample::lag_ns`](crate::wire::RawSample::lag_ns).
    #[must_use]
    pub const fn ns(self) -> u64 {
        self.0
    }
}

/// A number that cannot be a time constant.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{0} s cannot be the time constant of the lagged temperature; give {low} to {high} s", low = LAG_RANGE[0], high = LAG_RANGE[1])]
pub struct InvalidTimeConstant(f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_constant_is_rounded_to_the_nearest_nanosecond_and_kept_in_its_range() {
        for (seconds, ns) in [(0.1, 100_000_000), (240.000_000_000_4, 240_000_000_000), (86_400.0, 86_400_000_000_000)]
        {
            assert_eq!(TimeConstant::from_seconds(seconds).unwrap().ns(), ns);
        }
        for seconds in [0.0, -1.0, 0.099, 86_401.0, f64::NAN, f64::INFINITY] {
            let message = TimeConstant::from_seconds(seconds).unwrap_err().to_string();
            assert!(message.contains("give 0.1 to 86400 s"), "{message}");
        }
    }
}
