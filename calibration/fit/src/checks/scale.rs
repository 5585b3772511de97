//! The checks of scale: temperature against the set points, scale factors against each other.

use super::{Checker, Column};
use isotherm_shared::table::{AXIS_NAMES, CoefficientTable};
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use isotherm_support::finding::{Finding, Severity, name};

/// Temperature in degC or K does not rise faster than this with the chamber \[degC/degC\]. Fahrenheit has 1.8.
const STEEP: f64 = 1.5;
/// Set points over a smaller span do not show a slope: the IMU warms up by as much \[degC\].
const SLOPE_SPAN: f64 = 15.0;
/// Temperature that differs more from the set points gives a warning; an IMU with an oven has such an offset \[degC\].
const OFFSET: f64 = 30.0;
/// No IMU is so much warmer or colder than its chamber \[degC\].
const IMPOSSIBLE_OFFSET: f64 = 150.0;
/// Temperature that falls by more than this part of the usual step, where the others rise, gives a warning.
const REVERSAL: f64 = 0.5;
/// K+ and |K-| of one accelerometer do not differ by a larger factor.
const CHANNEL_FACTOR: f64 = 1.5;

/// Columns with the same finding: their names, and the value of the first.
type Columns = (Vec<String>, f64);

impl Checker<'_> {
    /// Temperature against the set points.
    pub(super) fn scale(&mut self, columns: &[Column]) {
        if let Some(zero) = zero_of(&self.campaign.temperature_unit) {
            self.slope_and_offset(columns, zero);
        }
        let mut reversed: Option<(Vec<String>, f64)> = None;
        let mut pair = None;
        let mut coarse: Option<(Vec<String>, [f64; 3])> = None;
        for column in columns {
            if let Some(figures) = column.coarse {
                coarse.get_or_insert_with(|| (Vec::new(), figures)).0.push(column.name.clone());
            }
        }
        if let Some((columns, [step, spread, digit])) = coarse {
            let message = format!(
                "temperature ({}) changes by {step:.4} from set point to set point and by {spread:.4} within a dwell, its last digit is {digit:.1e}: is \
                 the sensor in an oven, is it connected and in the IMU, and was the temperature settled?",
                list(&columns)
            );
            self.findings.push(Finding::whole(Severity::Warning, name::TEMPERATURE_DRIFT, message));
        }
        for Column { name, means, .. } in columns.iter().filter(|column| column.coarse.is_none()) {
            if let Some(set_point) = reversal(means) {
                add(&mut reversed, name, set_point);
                pair = pair.or_else(|| exchanged(means));
            }
        }
        if let Some((columns, set_point)) = reversed {
            let remedy = match pair {
                Some([a, b]) => {
                    format!(": {a} and {b} degC look exchanged; exchange them in the samples' column set_point_c")
                }
                None => format!(
                    ", at {set_point} degC it is over half a step on the wrong side: fix the samples' column set_point_c, or the columns of \
                     temperature if they are of another sensor"
                ),
            };
            let message =
                format!("temperature ({}) does not follow the order of the set points{remedy}", list(&columns));
            self.findings.push(Finding::whole(Severity::Warning, name::TEMPERATURE_ORDER, message));
        }
    }

    /// Slope and offset of temperature in degC or K; `zero` is 0 degC in its unit.
    fn slope_and_offset(&mut self, columns: &[Column], zero: f64) {
        let unit = self.campaign.temperature_unit.clone();
        let [mut steep, mut far, mut offset]: [Option<Columns>; 3] = [None, None, None];
        for Column { name: column, means, .. } in columns {
            let off = |(set_point, mean): &(f64, f64)| mean - set_point - zero;
            let usual = median(means.iter().map(off));
            let most =
                means.iter().map(off).fold(0.0, |most: f64, off| if off.abs() > most.abs() { off } else { most });
            let slope = slope(means);
            if slope.abs() > STEEP && span(means) >= SLOPE_SPAN {
                add(&mut steep, column, slope);
            } else if usual.abs() > IMPOSSIBLE_OFFSET {
                add(&mut far, column, usual);
            } else if most.abs() > OFFSET {
                add(&mut offset, column, most);
            }
        }
        self.findings.extend(steep.map(|(columns, slope)| too_steep(&columns, slope, &unit)));
        self.findings.extend(far.map(|(columns, usual)| too_far(&columns, usual, &unit)));
        self.findings.extend(offset.map(|(columns, most)| {
            let message = format!(
                "temperature ({}) is up to {most:.0} {unit} off the set points; is the IMU heated, and is {unit} its unit?",
                list(&columns)
            );
            Finding::warning(name::TEMPERATURE_OFFSET, message)
        }));
    }

    /// `[K+, |K-|]` of each accelerometer, where its dwells are consistent, against each other.
    pub(super) fn scale_factors(&mut self, found: &[Option<[f64; 2]>; AXES]) {
        for (accelerometer, k) in AXIS_NAMES.iter().zip(found) {
            let Some([plus, minus]) = *k else { continue };
            if !(CHANNEL_FACTOR.recip()..=CHANNEL_FACTOR).contains(&(plus / minus)) {
                let message = format!(
                    "{accelerometer}: K+ is {plus:.0} and |K-| {minus:.0} pulse/(s*g0), a factor of {:.3}; the two channels of a converter \
                     do not differ so much: one of them is divided, or loses pulses; fix its converter, cable or column, and measure again",
                    (plus / minus).max(minus / plus)
                );
                self.findings.push(Finding::whole(Severity::Fault, name::CHANNELS_DIFFER, message));
            }
        }
    }
}

/// Scale factors of a table that a lost digit may have made.
pub(crate) fn unlike_scale_factors(table: &CoefficientTable) -> Vec<Finding> {
    let unlike = table.content().unlike_scale_factors().into_iter();
    unlike.map(|message| Finding::whole(Severity::Warning, name::AXES_DIFFER, message)).collect()
}

/// 0 degC in the unit of the temperature, if that is degC or K. Anything else in the label is another unit, such as kΩ,
/// mK or K/100. So is a small k or c.
pub(crate) fn zero_of(unit: &str) -> Option<f64> {
    // People write the degree sign also as the ordinal indicator.
    let plain: String = unit.chars().filter(|c| !matches!(c, '°' | 'º' | '_') && !c.is_whitespace()).collect();
    match plain.as_str() {
        "C" | "℃" => return Some(0.0),
        // The letter, and the sign that looks the same.
        "K" | "\u{212a}" => return Some(273.15),
        _ => {}
    }
    match plain.to_ascii_lowercase().as_str() {
        "degc" | "celsius" | "degcelsius" | "degreecelsius" | "degreescelsius" => Some(0.0),
        "degk" | "kelvin" | "degkelvin" => Some(273.15),
        _ => None,
    }
}

/// Adds a column to those with the same finding.
fn add(columns: &mut Option<Columns>, column: &str, value: f64) {
    columns.get_or_insert_with(|| (Vec::new(), value)).0.push(column.to_owned());
}

/// `a1_head, a1_board and 4 more columns`.
fn list(columns: &[String]) -> String {
    match columns {
        [first, second, rest @ ..] if rest.len() > 1 => format!("{first}, {second} and {} more columns", rest.len()),
        _ => columns.join(", "),
    }
}

fn span(means: &[(f64, f64)]) -> f64 {
    let [low, high] = isotherm_campaign::joint_range(means.iter().map(|(set_point, _)| [*set_point; 2]));
    high - low
}

/// Temperature per degC of the set points: the median of the slopes between every two of them.
pub(super) fn slope(means: &[(f64, f64)]) -> f64 {
    let slopes = means.iter().enumerate().flat_map(|(i, a)| {
        let others = means[..i].iter().filter(move |b| b.0 != a.0);
        others.map(move |b| (b.1 - a.1) / (b.0 - a.0))
    });
    median(slopes)
}

/// The set point whose temperature is over half a step on the wrong side of that of its neighbour.
fn reversal(means: &[(f64, f64)]) -> Option<f64> {
    let mut values: Vec<f64> = means.iter().map(|(set_point, _)| *set_point).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let sign = slope(means).signum();
    let mean = |value: f64| median(means.iter().filter(|(set_point, _)| *set_point == value).map(|(_, mean)| *mean));
    let steps: Vec<f64> = values.windows(2).map(|pair| sign * (mean(pair[1]) - mean(pair[0]))).collect();
    let usual = median(steps.iter().map(|step| step.abs()));
    let worst = (0..steps.len()).min_by(|&a, &b| steps[a].total_cmp(&steps[b]))?;
    (steps[worst] < -REVERSAL * usual).then(|| values[worst + 1])
}

/// The two set points that follow the others' order if they are exchanged; `None` if no two do, or more than two.
fn exchanged(means: &[(f64, f64)]) -> Option<[f64; 2]> {
    let mut values: Vec<f64> = means.iter().map(|(set_point, _)| *set_point).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let mean = |value: &f64| median(means.iter().filter(|(point, _)| point == value).map(|(_, mean)| *mean));
    let temperature: Vec<f64> = values.iter().map(mean).collect();
    // Exchanged ends change the sign of the slope.
    let ordered = |(i, j): &(usize, usize)| {
        let mut temperature = temperature.clone();
        temperature.swap(*i, *j);
        temperature.is_sorted() || temperature.is_sorted_by(|a, b| a >= b)
    };
    let mut found = (0..values.len()).flat_map(|i| (i + 1..values.len()).map(move |j| (i, j))).filter(ordered);
    let (i, j) = found.next()?;
    found.next().is_none().then(|| [values[i], values[j]])
}

/// Temperature that changes by more than the set points.
fn too_steep(columns: &[String], slope: f64, unit: &str) -> Finding {
    let cause = if (slope - 1.8).abs() < 0.15 {
        "it looks like degrees Fahrenheit; convert it, (F - 32) / 1.8, or state the unit that it has"
    } else if (800.0..=1200.0).contains(&slope.abs()) {
        "it looks like thousandths of a degree; divide it by 1000, or state the unit that it has"
    } else {
        "state the unit that it has as temperature_unit"
    };
    let message = format!(
        "temperature ({}) changes by {slope:.2} for each degC of the set points, under temperature_unit = \"{unit}\": {cause}",
        list(columns)
    );
    Finding::fault(name::TEMPERATURE_SLOPE, message)
}

/// Temperature that no IMU has at these set points.
fn too_far(columns: &[String], usual: f64, unit: &str) -> Finding {
    let cause = match usual {
        230.0..=320.0 => "it looks like kelvin; state temperature_unit = \"K\", or convert it",
        -320.0..=-230.0 => "it looks like degC; state temperature_unit = \"degC\", or convert it",
        _ => "state the unit that it has as temperature_unit",
    };
    let message = format!(
        "temperature ({}) is {usual:.0} {unit} off the set points, more than any IMU from its chamber: {cause}",
        list(columns)
    );
    Finding::fault(name::TEMPERATURE_OFFSET, message)
}

#[cfg(test)]
mod tests {
    use crate::checks::scale::{exchanged, zero_of};

    #[test]
    fn exchanged_set_points_are_named() {
        let volts = |order: &[f64], rising: f64| -> Vec<(f64, f64)> {
            let temperature = (-3..).map(|k| 2.1 + rising * 0.4 * f64::from(k));
            order.iter().copied().zip(temperature).collect()
        };
        let order = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0];
        for rising in [1.0, -1.0] {
            assert_eq!(exchanged(&volts(&order, rising)), None);
            for (i, j) in [(0, 1), (0, 6), (1, 5), (2, 3), (5, 6)] {
                let mut wrong = order;
                wrong.swap(i, j);
                assert_eq!(exchanged(&volts(&wrong, rising)), Some([order[i], order[j]]));
            }
            // Three in a ring are no pair.
            assert_eq!(exchanged(&volts(&[-30.0, 0.0, -20.0, -10.0, 10.0, 20.0, 30.0], rising)), None);
        }
    }

    #[test]
    fn only_degrees_celsius_and_kelvin_are_temperatures() {
        for unit in ["degC", "deg C", "deg_C", "DEGC", "°C", "ºC", "° C", "℃", "C", " C ", "Celsius", "degrees Celsius"]
        {
            assert_eq!(zero_of(unit), Some(0.0), "{unit}");
        }
        for unit in ["K", "°K", "kelvin", "Kelvin", "deg K", "\u{212a}"] {
            assert_eq!(zero_of(unit), Some(273.15), "{unit}");
        }
        for unit in [
            "kΩ", "k", "kOhm", "ohm", "Ω", "V", "mV", "counts", "c", "1/K", "K/100", "1/C", "degC/100", "0.1 degC",
            "mK", "m°C", "K+", "2 K", "degF", "°F", "", "%",
        ] {
            assert_eq!(zero_of(unit), None, "{unit}");
        }
    }
}
