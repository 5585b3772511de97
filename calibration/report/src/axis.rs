//! Range, tick marks and tick labels of one plot axis.
//!
//! Ticks are whole multiples of 1, 2 or 5 times a power of ten, and their labels are written from these integers. So
//! two ticks never have the same label, however small the range is compared with the value.

use crate::quantity::power_of_ten;

/// Fewest and most tick marks of an axis.
pub(super) const TICKS: (usize, usize) = (4, 7);

/// A linear axis.
pub(super) struct PlotAxis {
    low: f64,
    high: f64,
    /// Value and label of the tick marks, ascending.
    pub(super) ticks: Vec<(f64, String)>,
    /// Factor and offset from a tick label to the value, e.g. "×10⁻³ + 90 751"; empty if the label is the value.
    pub(super) note: String,
}

impl PlotAxis {
    /// An axis over the usable `values`, extended by the fraction `margin` on both sides. Labels of more than `widest`
    /// characters are shortened by a power of ten and an offset.
    pub(super) fn new(values: impl IntoIterator<Item = f64>, margin: f64, widest: usize) -> Self {
        let (mut low, mut high) = range(values);
        let extra = (high - low) * margin;
        (low, high) = (low - extra, high + extra);
        let (factor, power) = step(low, high);
        let width = scaled(factor, power);
        let (mut first, mut last) = multiples(low, high, width);
        while last - first + 1 < TICKS.0 as i64 {
            let (below, above) = (scaled((first - 1) * factor, power), scaled((last + 1) * factor, power));
            if low - below <= above - high {
                (first, low) = (first - 1, below);
            } else {
                (last, high) = (last + 1, above);
            }
        }
        let numbers: Vec<i64> = (first..=last).map(|n| n * factor).collect();
        let (labels, note) = labels(&numbers, power, widest);
        let ticks = numbers.iter().map(|&n| scaled(n, power)).zip(labels).collect();
        Self { low, high, ticks, note }
    }

    /// A logarithmic axis over decimal logarithms, with a tick mark at powers of ten; under two decades also at their
    /// twice and five times.
    pub(super) fn decades(logarithms: impl IntoIterator<Item = f64>) -> Self {
        let (low, high) = range(logarithms);
        let extra = (0.03 * (high - low)).max(0.05);
        let (low, high) = (low - extra, high + extra);
        let factors: &[i64] = if high - low < 2.0 { &[1, 2, 5] } else { &[1] };
        let every = ((high - low) / TICKS.1 as f64).ceil().max(1.0) as usize;
        let powers = (low.floor() as i32..=high.ceil() as i32).step_by(every);
        let ticks = powers.flat_map(|power| {
            factors
                .iter()
                .map(move |factor| (libm::log10(*factor as f64) + f64::from(power), power_label(*factor, power)))
        });
        let ticks = ticks.filter(|(value, _)| (low..=high).contains(value)).collect();
        Self { low, high, ticks, note: String::new() }
    }

    /// Position of a value: 0 at the low end of the axis, 1 at the high one.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// `factor * 10^power` as a label: plain from 0.1 to 1000, otherwise with an exponent.
fn power_label(factor: i64, power: i32) -> String {
    if (-1..=3).contains(&power) {
        return decimal(factor, power);
    }
    let power = power_of_ten(power);
    if factor == 1 { power } else { format!("{factor}\u{b7}{power}") }
}

/// Ticks of a second scale, by pairs of a value on the axis and the value there on the second scale: round values of
/// the second scale where a line through the pairs has them, with their labels. Pairs of the same second value count as
/// their mean. None if the second scale does not rise or fall all along the axis.
pub(super) fn second_scale(pairs: impl IntoIterator<Item = (f64, f64)>) -> Vec<(f64, String)> {
    let mut pairs: Vec<_> = pairs.into_iter().filter(|pair| usable(pair.0) && usable(pair.1)).collect();
    pairs.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mean = |same: &[(f64, f64)]| (same.iter().map(|pair| pair.0).sum::<f64>() / same.len() as f64, same[0].1);
    let line: Vec<_> = pairs.chunk_by(|a, b| a.1 == b.1).map(mean).collect();
    let rises = |line: &[(f64, f64)], sign: f64| line.windows(2).all(|pair| sign * (pair[1].0 - pair[0].0) > 0.0);
    if line.len() < 2 || !(rises(&line, 1.0) || rises(&line, -1.0)) {
        return Vec::new();
    }
    let axis = PlotAxis::new(line.iter().map(|pair| pair.1), 0.0, 6);
    if !axis.note.is_empty() {
        return Vec::new(); // the labels alone would not be the values
    }
    let at = |value: f64| {
        let pair = line.windows(2).find(|pair| pair[0].1 <= value && value <= pair[1].1)?;
        Some(pair[0].0 + (value - pair[0].1) / (pair[1].1 - pair[0].1) * (pair[1].0 - pair[0].0))
    };
    axis.ticks.into_iter().filter_map(|(value, label)| Some((at(value)?, label))).collect()
}

/// Whether a value can be drawn: not NaN, and not so large that the arithmetic of an axis could overflow.
pub(super) fn usable(value: f64) -> bool {
    value.abs() < 1e100
}

/// Least and greatest usable value. The range has a width even if there is no value, only one, or only rounding noise.
fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .into_iter()
        .filter(|&v| usable(v))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (v.min(low), v.max(high)));
    if low > high {
        return (0.0, 1.0);
    }
    let size = low.abs().max(high.abs());
    if size < 1e-100 {
        (-1.0, 1.0)
    } else if high - low <= size * 1e-12 {
        (low - 0.05 * size, high + 0.05 * size)
    } else {
        (low, high)
    }
}

/// The smallest step, as factor (1, 2, 5) and power of ten, that puts at most [`TICKS`] marks between two values.
fn step(low: f64, high: f64) -> (i64, i32) {
    let mut power = libm::log10(high - low).floor() as i32 - 2;
    loop {
        for factor in [1, 2, 5] {
            let (first, last) = multiples(low, high, scaled(factor, power));
            if last - first < TICKS.1 as i64 {
                return (factor, power);
            }
        }
        power += 1;
    }
}

/// First and last multiple of `step` from `low` to `high`; an end that misses a multiple only by rounding includes it.
fn multiples(low: f64, high: f64, step: f64) -> (i64, i64) {
    ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64)
}

/// `n * 10^power`, correctly rounded for the usual powers.
fn scaled(n: i64, power: i32) -> f64 {
    if power < 0 { n as f64 / 10_f64.powi(-power) } else { n as f64 * 10_f64.powi(power) }
}

/// Labels for the ascending values `numbers * 10^power`, and the note that goes with them.
fn labels(numbers: &[i64], power: i32, widest: usize) -> (Vec<String>, String) {
    let write = |offset: i64, exponent: i32| -> Vec<String> {
        numbers.iter().map(|n| decimal(n - offset, power - exponent)).collect()
    };
    let fits = |labels: &[String], width: usize| labels.iter().all(|label| label.chars().count() <= width);
    let (first, last) = (numbers.first().copied().unwrap_or(0), numbers.last().copied().unwrap_or(0));

    let plain = write(0, 0);
    let size = magnitude(first.abs().max(last.abs()), power);
    if size >= -2 && fits(&plain, widest) {
        return (plain, String::new());
    }
    let exponent = size.div_euclid(3) * 3;
    let short = write(0, exponent);
    if fits(&short, 6) {
        return (short, times(exponent));
    }
    let mut round = 1;
    while round < last - first {
        round *= 10;
    }
    let offset = first.div_euclid(round) * round;
    let sign = if offset < 0 { "−" } else { "+" };
    let constant = format!("{sign} {}", number(offset.abs(), power));
    let short = write(offset, 0);
    if fits(&short, 5) {
        return (short, constant);
    }
    let exponent = magnitude(last - offset, power).div_euclid(3) * 3;
    let factor = times(exponent);
    (write(offset, exponent), if factor.is_empty() { constant } else { format!("{factor} {constant}") })
}

/// The power of ten of the leading digit of `n * 10^power`.
fn magnitude(n: i64, power: i32) -> i32 {
    n.unsigned_abs().checked_ilog10().unwrap_or(0) as i32 + power
}

/// `n * 10^power` without an exponent; a thin space separates the thousands of numbers with more than four digits.
fn decimal(n: i64, power: i32) -> String {
    let digits = n.unsigned_abs().to_string();
    let places = usize::try_from(-power).unwrap_or(0);
    let digits = if power > 0 && n != 0 { digits + &"0".repeat(power as usize) } else { digits };
    let digits = format!("{digits:0>width$}", width = places + 1);
    let (whole, fraction) = digits.split_at(digits.len() - places);
    let mut text = String::from(if n < 0 { "−" } else { "" });
    for (index, digit) in whole.chars().enumerate() {
        if index > 0 && whole.len() > 4 && (whole.len() - index).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    if places > 0 {
        text.push('.');
        text.push_str(fraction);
    }
    text
}

/// `n * 10^power` without trailing zeros; very large and very small numbers as mantissa and power of ten.
fn number(mut n: i64, mut power: i32) -> String {
    while n != 0 && n % 10 == 0 {
        (n, power) = (n / 10, power + 1);
    }
    let size = magnitude(n, power);
    if (-4..=12).contains(&size) {
        return decimal(n, power);
    }
    format!("{} {}", decimal(n, power - size), times(size))
}

/// "×10ⁿ", empty for n = 0.
fn times(exponent: i32) -> String {
    if exponent == 0 {
        return String::new();
    }
    format!("×{}", power_of_ten(exponent))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &PlotAxis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    #[test]
    fn plain_labels() {
        let axis = PlotAxis::new([1.1, 3.9], 0.03, 6);
        assert_eq!(texts(&axis), ["1.5", "2.0", "2.5", "3.0", "3.5"]);
        assert_eq!(axis.note, "");
        assert_eq!(texts(&PlotAxis::new([-0.3, 0.3], 0.05, 8)), ["−0.3", "−0.2", "−0.1", "0.0", "0.1", "0.2", "0.3"]);
        assert_eq!(texts(&PlotAxis::new([0.0, 20_000.0], 0.02, 6))[1], "5000");
        assert_eq!(texts(&PlotAxis::new([0.0, 20_000.0], 0.02, 6))[4], "20\u{2009}000");
    }

    #[test]
    fn a_tiny_range_on_a_large_value_is_readable() {
        let axis = PlotAxis::new([90_751.2, 90_751.9], 0.0, 8);
        assert_eq!(texts(&axis), ["90\u{2009}751.2", "90\u{2009}751.4", "90\u{2009}751.6", "90\u{2009}751.8"]);
        let axis = PlotAxis::new([90_751.234, 90_751.240_5], 0.0, 8);
        assert_eq!(texts(&axis), ["0.004", "0.005", "0.006", "0.007", "0.008", "0.009", "0.010"]);
        assert_eq!(axis.note, "+ 90\u{2009}751.23");
        let axis = PlotAxis::new([-5.000_000_3, -5.0], 0.0, 8);
        assert_eq!((texts(&axis)[0], axis.note.as_str()), ("0.70", "×10⁻⁶ − 5.000001"));
        let axis = PlotAxis::new([0.0, 3e-7], 0.0, 8);
        assert_eq!((texts(&axis)[1], axis.note.as_str()), ("50", "×10⁻⁹"));
        let axis = PlotAxis::new([0.0, 3e7], 0.0, 8);
        assert_eq!((texts(&axis)[1], axis.note.as_str()), ("5", "×10⁶"));
        assert_eq!(number(123_000, 17), "1.23 ×10²²");
    }

    #[test]
    fn every_range_has_four_to_seven_distinct_evenly_spaced_ticks() {
        for value in [0.0, 1.0, -3.3, 90_751.2, -1e-6, 1e9, 4.5e-30, 1e99, -1e99] {
            for exponent in -40..40 {
                for factor in [1.0, 1.3, 2.1, 2.7, 3.4, 4.9, 7.7, 9.9] {
                    let high = value + factor * 10_f64.powi(exponent);
                    let axis = PlotAxis::new([value, high], 0.04, 8);
                    let labels = texts(&axis);
                    let context = format!("{value:e}..{high:e}: {labels:?} {}", axis.note);
                    assert!((TICKS.0..=TICKS.1).contains(&labels.len()), "{context}");
                    assert!(labels.windows(2).all(|pair| pair[0] != pair[1]), "{context}");
                    assert!(labels.iter().all(|label| label.chars().count() <= 8), "{context}");
                    let (low, high) = (axis.fraction(axis.ticks[0].0), axis.fraction(axis.ticks[labels.len() - 1].0));
                    assert!(low >= -1e-3 && high <= 1.0 + 1e-3 && high - low > 0.4, "{context}: {low} {high}");
                    let width = (high - low) / (labels.len() - 1) as f64;
                    let ticks: Vec<f64> = axis.ticks.iter().map(|tick| axis.fraction(tick.0)).collect();
                    assert!(ticks.windows(2).all(|t| (t[1] - t[0] - width).abs() < 1e-3), "{context}");
                }
            }
        }
    }

    #[test]
    fn a_second_scale_has_round_values_where_the_pairs_have_them() {
        // Temperature over temperature, once rising, once falling; 20 degC was visited twice.
        for sign in [1.0, -1.0] {
            let pairs = [(0.9, -20.0), (1.0, -10.0), (1.2, 0.0), (1.69, 20.0), (1.71, 20.0), (2.2, 45.0)];
            let ticks = second_scale(pairs.map(|(u, c)| (sign * u, c)));
            let labels: Vec<_> = ticks.iter().map(|tick| tick.1.as_str()).collect();
            assert_eq!(labels, ["−20", "−10", "0", "10", "20", "30", "40"]);
            for (tick, expected) in ticks.iter().zip([0.9, 1.0, 1.2, 1.45, 1.7, 1.9, 2.1]) {
                assert!((sign * tick.0 - expected).abs() < 1e-12, "{ticks:?}");
            }
        }
        // Only where it is known.
        let ticks = second_scale([(1.0, 12.0), (2.0, 33.0)]);
        assert_eq!(ticks.iter().map(|tick| tick.1.as_str()).collect::<Vec<_>>(), ["15", "20", "25", "30"]);
        assert!((ticks[0].0 - (1.0 + 3.0 / 21.0)).abs() < 1e-12);
    }

    #[test]
    fn an_ambiguous_second_scale_has_no_ticks() {
        for pairs in [
            vec![],
            vec![(1.0, 20.0)],
            vec![(1.0, 20.0), (1.1, 20.0)],
            vec![(1.0, 10.0), (1.2, 20.0), (1.1, 30.0)],
            vec![(1.0, 10.0), (1.0, 20.0)],
            vec![(f64::NAN, 10.0), (1.0, f64::INFINITY), (2.0, 20.0)],
        ] {
            assert_eq!(second_scale(pairs.clone()), [], "{pairs:?}");
        }
    }

    #[test]
    fn steps_are_one_two_five() {
        for (high, expected) in
            [(6.0, (1, 0)), (6.9, (1, 0)), (7.0, (2, 0)), (13.0, (2, 0)), (15.0, (5, 0)), (0.6, (1, -1))]
        {
            assert_eq!(step(0.0, high), expected, "{high}");
        }
    }

    #[test]
    fn no_values_and_constants_have_a_range() {
        for values in [vec![], vec![f64::NAN, f64::INFINITY], vec![0.0], vec![5.0; 3], vec![1e300, -2.0], vec![5e-324]]
        {
            let axis = PlotAxis::new(values.iter().copied(), 0.05, 8);
            assert!(axis.high > axis.low, "{values:?}");
            assert!(axis.ticks.len() >= TICKS.0, "{values:?}");
        }
    }
}
