//! The rate at rest that no gyroscope has.

use isotherm_shared::units::SensorKind;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, name};

/// No gyroscope has as much bias \[deg/h\]: 10 deg/s.
const MOST: f64 = 36_000.0;

/// That a gyroscope indicates over 10 deg/s on average at rest: the readings are in another unit, or the IMU turned.
/// `rates` are the means of G1 to G3 \[deg/h\]; the first that is too large is named.
///
/// ```
/// use isotherm_campaign::rate_at_rest;
///
/// assert!(rate_at_rest([-36e3, 20.0, 3.0]).is_none());
/// let found = rate_at_rest([20.0, 3600.0 * -98.5, 3.0]).map(|finding| finding.message);
/// assert!(found.is_some_and(|message| message.starts_with("G2 is -98.500 deg/s on average at rest; ")));
/// ```
#[must_use]
pub fn rate_at_rest(rates: [f64; AXES]) -> Option<Finding> {
    let axis = (0..AXES).find(|axis| rates[*axis].abs() > MOST)?;
    let message = format!(
        "{} is {:.3} deg/s on average at rest; the readings look like deg/s, not rad/s: give gyroscope.unit = \"deg/s\" \
         in a mapping (--mapping); or the IMU turned",
        SensorKind::Gyroscope.names()[axis],
        rates[axis] / 3600.0
    );
    Some(Finding::fault(name::RATE_AT_REST, message))
}
