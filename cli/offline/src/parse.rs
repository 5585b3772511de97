//! Parsers of option values. clap shows their errors as usage errors.

use clap::builder::{PossibleValuesParser, TypedValueParser};
use isotherm_campaign::Place;
use isotherm_fit::LagChoice;
use isotherm_shared::table::GRAVITY_RANGE;
use isotherm_shared::time_constant::TimeConstant;
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS};
use std::str::FromStr;
use std::time::Duration;

/// A finite number.
///
/// # Errors
/// With what to give.
pub fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| "give a number".to_owned())
}

/// A number of seconds over 0.
///
/// # Errors
/// With what to give.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    if !(seconds > 0.0 && seconds <= 1e6) {
        return Err("give a number of seconds over 0 and up to 1000000".to_owned());
    }
    Ok(Duration::from_secs_f64(seconds))
}

/// A size in bytes, with k, M or G for powers of 1000.
///
/// # Errors
/// With what to give.
pub fn bytes(text: &str) -> Result<u64, String> {
    let (number, factor) = match text.as_bytes().last() {
        Some(b'k') => (&text[..text.len() - 1], 1_000),
        Some(b'M') => (&text[..text.len() - 1], 1_000_000),
        Some(b'G') => (&text[..text.len() - 1], 1_000_000_000),
        _ => (text, 1),
    };
    let size = number.parse::<u64>().ok().and_then(|number| number.checked_mul(factor)).filter(|size| *size > 0);
    size.ok_or_else(|| "give a number of bytes over 0, as 500M or 2G".to_owned())
}

/// A time constant of lagged temperature \[ns\]: a number of seconds, or `none` for 0.
///
/// # Errors
/// With what to give.
pub fn lag(text: &str) -> Result<u64, String> {
    if text == "none" {
        return Ok(0);
    }
    let seconds = text.parse().map_err(|_| "give a number of seconds, or none".to_owned())?;
    TimeConstant::from_seconds(seconds).map(TimeConstant::ns).map_err(|error| error.to_string())
}

/// A time constant for the ramps of a campaign: a number of seconds, `none`, or `auto`.
///
/// # Errors
/// With what to give.
pub fn lag_choice(text: &str) -> Result<LagChoice, String> {
    if text == "auto" {
        return Ok(LagChoice::Search);
    }
    let lag_ns = lag(text)?;
    Ok(if lag_ns == 0 { LagChoice::None } else { LagChoice::Given(lag_ns as f64 / 1e9) })
}

/// A time constant \[s\].
///
/// # Errors
/// With what to give.
pub fn time_constant(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    TimeConstant::from_seconds(seconds).map(|_| seconds).map_err(|error| error.to_string())
}

/// Set points \[degC\]. It is a type of its own, because clap takes a plain `Vec` for an option with many values.
#[derive(Clone, Debug)]
pub struct SetPoints(pub Vec<f64>);

/// `FROM:TO:STEP`, both ends included.
///
/// # Errors
/// With what to give.
pub fn set_points(text: &str) -> Result<SetPoints, String> {
    let [from, to, step] = list(text, ':').ok_or("give FROM:TO:STEP in degC, for example -25:45:5")?;
    let steps = (to - from) / step;
    if !(0.0..1000.0).contains(&steps) {
        return Err("the step must lead from FROM to TO in less than 1000 steps".to_owned());
    }
    // 1e-9: a last step that misses TO only by rounding still counts.
    Ok(SetPoints((0..=(steps + 1e-9) as u32).map(|index| round(from + step * f64::from(index))).collect()))
}

/// Rounds to 1e-9 degC, so that three steps of 0.1 give 0.3.
fn round(set_point: f64) -> f64 {
    (set_point * 1e9).round() / 1e9
}

/// One of values that have names; the help lists them.
pub fn one_of<T, const N: usize>(names: [(T, &'static str); N]) -> impl TypedValueParser<Value = T>
where
    T: Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(names.clone().map(|(_, name)| name)).try_map(move |text: String| {
        let found = names.iter().find(|(_, name)| *name == text);
        found.map(|(value, _)| value.clone()).ok_or("it is none of the names")
    })
}

/// Exactly N finite numbers.
fn list<const N: usize>(text: &str, separator: char) -> Option<[f64; N]> {
    let numbers: Result<Vec<f64>, _> = text.split(separator).map(|part| f64::from_str(part.trim())).collect();
    numbers.ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()))?.try_into().ok()
}

/// So many numbers, with commas between them.
///
/// # Errors
/// With what to give.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    list(text, ',').ok_or_else(|| format!("give {N} numbers with a comma between them"))
}

/// Two numbers from 0 up.
///
/// # Errors
/// With what to give.
pub fn sizes(text: &str) -> Result<[f64; 2], String> {
    let sizes = numbers::<2>(text)?;
    if sizes.iter().all(|size| *size >= 0.0) { Ok(sizes) } else { Err("neither may be negative".to_owned()) }
}

/// Amplitude \[g0\] and frequency \[Hz\]. The frequency has a limit, because the simulation takes 20 steps for each
/// cycle.
///
/// # Errors
/// With what to give.
pub fn vibration(text: &str) -> Result<[f64; 2], String> {
    let [amplitude, frequency] = sizes(text)?;
    if amplitude <= 100.0 && frequency <= 2000.0 {
        Ok([amplitude, frequency])
    } else {
        Err("give an amplitude up to 100 g0 and a frequency up to 2000 Hz".to_owned())
    }
}

/// A number from 0 up.
///
/// # Errors
/// With what to give.
pub fn size(text: &str) -> Result<f64, String> {
    list::<1>(text, ',')
        .map(|[size]| size)
        .filter(|size| *size >= 0.0)
        .ok_or_else(|| "give a number from 0 up".to_owned())
}

/// A number over 0.
///
/// # Errors
/// With what to give.
pub fn positive(text: &str) -> Result<f64, String> {
    size(text).ok().filter(|size| *size > 0.0).ok_or_else(|| "give a number over 0".to_owned())
}

/// A direction in the axes of the IMU.
///
/// # Errors
/// With what to give.
pub fn direction(text: &str) -> Result<[f64; AXES], String> {
    let direction = numbers::<AXES>(text)?;
    let right = direction.iter().any(|part| part.abs() > 1e-6) && direction.iter().all(|part| part.abs() < 1e6);
    if right { Ok(direction) } else { Err("give a direction, for example 0,0,1".to_owned()) }
}

/// The rate of a ramp \[degC/h\].
///
/// # Errors
/// With what to give.
pub fn ramp(text: &str) -> Result<f64, String> {
    let [ramp] = list(text, ',').ok_or("give a number of degC/h")?;
    if (0.1..=3600.0).contains(&ramp) { Ok(ramp) } else { Err("give a ramp from 0.1 to 3600 degC/h".to_owned()) }
}

/// Rates of ramps \[degC/h\]; a type of its own, as [`SetPoints`].
#[derive(Clone, Debug)]
pub struct Rates(pub Vec<f64>);

/// One rate or several, with commas between them.
///
/// # Errors
/// With what to give.
pub fn rates(text: &str) -> Result<Rates, String> {
    text.split(',').map(ramp).collect::<Result<_, _>>().map(Rates)
}

/// Local gravity, or the value of 1 g0 \[m/s2\].
///
/// # Errors
/// With what to give.
pub fn gravity(text: &str) -> Result<f64, String> {
    let [gravity] = list(text, ',').ok_or("give a number of m/s2")?;
    let [low, high] = GRAVITY_RANGE;
    if (low..=high).contains(&gravity) { Ok(gravity) } else { Err(format!("give a gravity from {low} to {high} m/s2")) }
}

/// Latitude, north positive \[deg\].
///
/// # Errors
/// With what to give.
pub fn latitude(text: &str) -> Result<f64, String> {
    list(text, ',')
        .map(|[latitude]| latitude)
        .filter(|latitude| Place::LATITUDES.contains(latitude))
        .ok_or_else(|| "give a number from -90 to 90, north positive".to_owned())
}

/// Height \[m\].
///
/// # Errors
/// With what to give.
pub fn height(text: &str) -> Result<f64, String> {
    let range = Place::HEIGHTS;
    list(text, ',')
        .map(|[height]| height)
        .filter(|height| range.contains(height))
        .ok_or_else(|| format!("give a number of metres from {} to {}", range.start(), range.end()))
}

/// The nominal interval between two rows \[s\].
///
/// # Errors
/// With what to give.
pub fn interval(text: &str) -> Result<Duration, String> {
    let interval = seconds(text)?;
    if (1_000..=u128::from(MAX_INTERVAL_NS)).contains(&interval.as_nanos()) {
        Ok(interval)
    } else {
        Err("give a number of seconds from 0.000001 to 3600".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_points_include_both_ends() {
        let points = |text| set_points(text).map(|points| points.0);
        assert_eq!(points("-25:-10:5").unwrap(), [-25.0, -20.0, -15.0, -10.0]);
        assert_eq!(points("0:0.3:0.1").unwrap(), [0.0, 0.1, 0.2, 0.3]);
        assert_eq!(points("20:0:-10").unwrap(), [20.0, 10.0, 0.0]);
        assert_eq!(points("0:12:5").unwrap(), [0.0, 5.0, 10.0]);
        assert_eq!(points("7:7:1").unwrap(), [7.0]);
        for wrong in ["", "1:2", "1:2:0", "1:1:0", "1:2:-1", "0:1000:1", "0:nan:1", "0:1:1:1", "a:1:1"] {
            assert!(points(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        assert_eq!(numbers::<2>("8.3, -12.4"), Ok([8.3, -12.4]));
        assert!(numbers::<2>("1").is_err() && numbers::<2>("1,inf").is_err() && numbers::<2>("1,2,3").is_err());
        assert!(sizes("0,-1").is_err() && size("-1").is_err() && size("0").is_ok());
        assert!(direction("0,0,0").is_err() && direction("0,0,-1").is_ok());
        assert!(gravity("9.6").is_err() && gravity("9.81").is_ok());
        assert!(interval("0").is_err() && interval("3601").is_err() && interval("0.01").is_ok());
        assert_eq!((lag("240"), lag("none"), lag("0.1")), (Ok(240_000_000_000), Ok(0), Ok(100_000_000)));
        assert!(["0", "0.09", "86401", "-1", "nan", "None", ""].into_iter().all(|text| lag(text).is_err()));
        assert!(ramp("0").is_err() && ramp("20").is_ok());
        assert_eq!(rates("20, 70").map(|rates| rates.0), Ok(vec![20.0, 70.0]));
        assert!(["", "20,", "20,0", "20;70"].into_iter().all(|text| rates(text).is_err()));
        assert_eq!((time_constant("240"), positive("0.1")), (Ok(240.0), Ok(0.1)));
        assert!(["none", "0", "1e5", "nan"].into_iter().all(|text| time_constant(text).is_err()));
        assert!(["0", "-1", "inf", "1,2"].into_iter().all(|text| positive(text).is_err()));
    }
}
