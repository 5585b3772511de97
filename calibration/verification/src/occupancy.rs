//! Which temperatures of a curve's range judged rows touch: of what lies between, nothing is known.

use serde::{Deserialize, Serialize};

/// Bins of a range.
const BINS: usize = 40;
/// Empty bins between two touched ones that count as touched: less than a twentieth of the range lies between.
const BRIDGED: usize = 1;
/// No bound is met over a hole of more than this part of the range.
pub(crate) const MOST_UNTOUCHED: f64 = 0.1;

/// The temperatures of a range that judged rows touch, in 40 equal bins. What lies between two of them counts, if it is
/// less than a twentieth of the range.
///
/// ```
/// use isotherm_verification::Occupancy;
///
/// // A run that was cut to both ends of a range from 0 to 40 degC.
/// let ends = Occupancy::of([0.0, 40.0], [[-1.0, 2.5], [37.2, 39.0]]);
/// assert_eq!((ends.part(), ends.untouched(), ends.largest_hole()), (6.0 / 40.0, 34.0 / 40.0, Some([3.0, 37.0])));
/// let whole = Occupancy::of([0.0, 40.0], [[0.0, 20.0], [22.5, 40.0]]);
/// assert_eq!((whole.part(), whole.largest_hole()), (1.0, None));
/// ```
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
pub struct Occupancy {
    /// Lowest and highest temperature of the curve.
    pub range: [f64; 2],
    touched: Bins,
}

/// Bins of a range, a bit for each.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
pub struct Bins(u64);

impl Bins {
    /// These and others of the same range.
    #[must_use]
    pub(crate) const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Occupancy {
    /// Of a curve with this range, and rows whose temperature covers these spans, lowest and highest.
    #[must_use]
    pub fn of(range: [f64; 2], spans: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let mut found = Self { range, touched: Bins::default() };
        let [low, high] = range;
        for [from, to] in spans.into_iter().filter(|[from, to]| from <= to && *to >= low && *from <= high) {
            let [first, last] = [from, to].map(|end| found.bin(end.clamp(low, high)));
            (first..=last).for_each(|bin| found.touched.0 |= 1 << bin);
        }
        found
    }

    /// The bin that the temperature of a row touches; outside the range, or not a number, it touches none.
    pub(crate) fn touched_by(&self, temperature: f64) -> Bins {
        let [low, high] = self.range;
        if (low..=high).contains(&temperature) { Bins(1 << self.bin(temperature)) } else { Bins::default() }
    }

    /// Together with these bins.
    #[must_use]
    pub(crate) const fn with(self, bins: Bins) -> Self {
        Self { touched: self.touched.and(bins), ..self }
    }

    /// Together with what others touch of the same range.
    #[must_use]
    pub(crate) const fn and(self, other: Self) -> Self {
        self.with(other.touched)
    }

    fn bin(&self, temperature: f64) -> usize {
        let [low, high] = self.range;
        (((temperature - low) / (high - low) * BINS as f64) as usize).min(BINS - 1)
    }

    /// Which bins are touched, or lie between two that are.
    fn bins(&self) -> [bool; BINS] {
        let mut touched = core::array::from_fn(|bin| self.touched.0 >> bin & 1 == 1);
        let all: Vec<usize> = (0..BINS).filter(|bin| touched[*bin]).collect();
        for pair in all.windows(2).filter(|pair| pair[1] - pair[0] <= BRIDGED + 1) {
            touched[pair[0]..pair[1]].fill(true);
        }
        touched
    }

    /// The part of the range that is touched: the share of its bins.
    #[must_use]
    pub fn part(&self) -> f64 {
        self.bins().iter().filter(|is| **is).count() as f64 / BINS as f64
    }

    /// First and last bin of the largest hole, at an end of the range or between touched bins.
    fn hole(&self) -> Option<[usize; 2]> {
        let bins = self.bins();
        let empty = |begin: usize| bins[begin..].iter().take_while(|is| !**is).count();
        let begins = (0..BINS).filter(|bin| !bins[*bin]).map(|bin| [bin, bin + empty(bin)]);
        // Of holes that are as large the first one.
        begins.min_by_key(|[begin, end]| core::cmp::Reverse(end - begin))
    }

    /// The part of the range that its largest hole is.
    #[must_use]
    pub fn untouched(&self) -> f64 {
        self.hole().map_or(0.0, |[begin, end]| (end - begin) as f64 / BINS as f64)
    }

    /// The temperature at the ends of the largest hole.
    #[must_use]
    pub fn largest_hole(&self) -> Option<[f64; 2]> {
        let [low, high] = self.range;
        let at = |bin: usize| if bin == BINS { high } else { low + (high - low) * bin as f64 / BINS as f64 };
        self.hole().map(|ends| ends.map(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(spans: &[[f64; 2]]) -> Occupancy {
        Occupancy::of([10.0, 50.0], spans.iter().copied())
    }

    #[test]
    fn every_bin_between_the_lowest_and_the_highest_row_is_touched() {
        assert_eq!(of(&[[20.0, 20.0]]).part(), 1.0 / 40.0);
        assert_eq!(of(&[[20.0, 21.0]]).part(), 2.0 / 40.0);
        assert_eq!(of(&[[50.0, 60.0]]).part(), 1.0 / 40.0);
        assert_eq!(of(&[[0.0, 60.0]]).part(), 1.0);
        // Beyond the range, or without a number.
        assert_eq!(of(&[[0.0, 9.0], [51.0, 60.0], [f64::NAN, f64::NAN]]).part(), 0.0);
        let nothing = of(&[]);
        let rows = |at: &[f64]| at.iter().fold(nothing, |rows, at| rows.with(nothing.touched_by(*at)));
        assert_eq!(rows(&[9.9, 50.1, f64::NAN]), nothing);
        let rows = rows(&[10.0, 50.0]);
        assert_eq!((rows.part(), rows.largest_hole()), (2.0 / 40.0, Some([11.0, 49.0])));
    }

    #[test]
    fn the_largest_hole_is_between_rows_or_at_an_end() {
        assert_eq!(of(&[]).largest_hole(), Some([10.0, 50.0]));
        assert_eq!(of(&[[30.0, 30.5], [14.0, 16.0]]).largest_hole(), Some([31.0, 50.0]));
        let middle = of(&[[40.0, 50.0], [10.0, 12.0], [20.0, 22.0], [11.0, 15.0]]);
        assert_eq!((middle.largest_hole(), middle.untouched()), (Some([23.0, 40.0]), 17.0 / 40.0));
        assert_eq!(middle.and(of(&[[20.5, 38.1]])).largest_hole(), Some([16.0, 20.0]));
    }

    #[test]
    fn steps_that_are_close_are_one_and_others_are_not() {
        let steps = |apart: f64| {
            let begins = (0..=(40.0 / apart) as u32).map(|step| 10.0 + apart * f64::from(step));
            Occupancy::of([10.0, 50.0], begins.map(|at| [at, at]))
        };
        assert_eq!((steps(1.99).part(), steps(4.0).part()), (1.0, 11.0 / 40.0));
        // Three bins between two steps.
        assert_eq!((steps(1.99).untouched(), steps(4.0).untouched()), (0.0, 3.0 / 40.0));
    }
}
