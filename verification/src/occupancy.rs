//! Which temperatures of a curve's range judged rows touch: of what lies between, nothing is known.

/// Bins of a range.
const BINS: usize = 40;
/// What lies between two judged windows counts as judged, if it is less than this part of the range.
const BRIDGED: f64 = 0.05;
/// No bound is met over a hole of more than this part of the range.
pub(crate) const MOST_UNTOUCHED: f64 = 0.1;

/// The temperatures of a range that judged windows touch.
///
/// ```
/// use isotherm_verification::Occupancy;
///
/// // A run that was cut to both ends of a range from 0 to 40 degC.
/// let ends = Occupancy::of([0.0, 40.0], [[-1.0, 2.5], [37.2, 39.0]]);
/// assert_eq!((ends.part(), ends.untouched(), ends.largest_hole()), (6.0 / 40.0, 34.0 / 40.0, Some([2.5, 37.2])));
/// // What lies between two windows by less than a twentieth of the range counts.
/// let whole = Occupancy::of([0.0, 40.0], [[0.0, 20.0], [21.9, 40.0]]);
/// assert_eq!((whole.part(), whole.largest_hole()), (1.0, None));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Occupancy {
    /// Lowest and highest telemetry of the curve.
    pub range: [f64; 2],
    /// What is touched, ascending and apart.
    spans: Vec<[f64; 2]>,
}

impl Occupancy {
    /// Of a curve with this range, and windows whose rows have telemetry within these spans, lowest and highest.
    #[must_use]
    pub fn of(range: [f64; 2], spans: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let [low, high] = range;
        let inside = spans.into_iter().filter(|[from, to]| from <= to && *to >= low && *from <= high);
        let mut inside: Vec<_> = inside.map(|span| span.map(|end| end.clamp(low, high))).collect();
        inside.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut spans: Vec<[f64; 2]> = Vec::new();
        for [from, to] in inside {
            match spans.last_mut() {
                Some(last) if from - last[1] < BRIDGED * (high - low) => last[1] = last[1].max(to),
                _ => spans.push([from, to]),
            }
        }
        Self { range, spans }
    }

    /// Together with what others touch of the same range.
    #[must_use]
    pub(crate) fn and(&self, other: &Self) -> Self {
        Self::of(self.range, self.spans.iter().chain(&other.spans).copied())
    }

    /// Which bins are touched.
    fn bins(&self) -> [bool; BINS] {
        let [low, high] = self.range;
        let bin = |telemetry: f64| (((telemetry - low) / (high - low) * BINS as f64) as usize).min(BINS - 1);
        let mut touched = [false; BINS];
        for [from, to] in &self.spans {
            touched[bin(*from)..=bin(*to)].fill(true);
        }
        touched
    }

    /// The part of the range that is touched: the share of 40 equal bins.
    #[must_use]
    pub fn part(&self) -> f64 {
        self.bins().iter().filter(|is| **is).count() as f64 / BINS as f64
    }

    /// The part of the range that its largest hole is, in whole bins: what no judged window touches, at an end of the
    /// range or between windows.
    #[must_use]
    pub fn untouched(&self) -> f64 {
        let bins = self.bins();
        bins.split(|is| *is).map(<[bool]>::len).max().unwrap_or_default() as f64 / BINS as f64
    }

    /// The ends of the largest hole: the telemetry of the windows next to it, or an end of the range.
    #[must_use]
    pub fn largest_hole(&self) -> Option<[f64; 2]> {
        let [low, high] = self.range;
        let begins = core::iter::once(low).chain(self.spans.iter().map(|span| span[1]));
        let ends = self.spans.iter().map(|span| span[0]).chain([high]);
        let holes = begins.zip(ends).map(|(from, to)| [from, to]).filter(|[from, to]| to > from);
        holes.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(spans: &[[f64; 2]]) -> Occupancy {
        Occupancy::of([10.0, 50.0], spans.iter().copied())
    }

    #[test]
    fn a_window_touches_every_bin_between_its_lowest_and_highest_row() {
        assert_eq!(of(&[[20.0, 20.0]]).part(), 1.0 / 40.0);
        assert_eq!(of(&[[20.0, 21.0]]).part(), 2.0 / 40.0);
        assert_eq!(of(&[[50.0, 60.0]]).part(), 1.0 / 40.0);
        assert_eq!(of(&[[0.0, 60.0]]).part(), 1.0);
        // Beyond the range, or without a number.
        assert_eq!(of(&[[0.0, 9.0], [51.0, 60.0], [f64::NAN, f64::NAN]]).part(), 0.0);
    }

    #[test]
    fn the_largest_hole_is_between_windows_or_at_an_end() {
        assert_eq!(of(&[]).largest_hole(), Some([10.0, 50.0]));
        assert_eq!(of(&[[30.0, 31.0], [14.0, 16.0]]).largest_hole(), Some([31.0, 50.0]));
        let middle = of(&[[40.0, 50.0], [10.0, 12.0], [20.0, 22.0], [11.0, 15.0]]);
        assert_eq!((middle.largest_hole(), middle.untouched()), (Some([22.0, 40.0]), 17.0 / 40.0));
        assert_eq!(middle.and(&of(&[[20.5, 38.1]])).largest_hole(), Some([15.0, 20.0]));
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
