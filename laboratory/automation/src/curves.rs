//! The curves of the live page in bounded memory: a campaign takes days, and the page is drawn every few seconds.

use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Number of curves: the chamber's air and set point, then the heads and the boards.
pub(crate) const CURVES: usize = 2 + 2 * AXES;
/// Largest number of time bins of the whole campaign. When there are more, pairs of bins are merged, and new bins are
/// longer.
const MAX_BINS: usize = 2048;
/// Number of the latest rows that are kept unthinned: three hours of one row every 5 s are 2160.
const MAX_RECENT: usize = 4096;

/// The values at one time; NaN where one is missing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurveRow {
    /// Unix time \[s\].
    pub unix_s: f64,
    /// One value for each curve, in the order that [`CURVES`] states.
    pub values: [f64; CURVES],
}

/// The lowest and highest value of each curve in an interval of time.
#[derive(Clone, Copy, Debug)]
struct CurveBin {
    begin_s: f64,
    end_s: f64,
    low: [f64; CURVES],
    high: [f64; CURVES],
}

/// All rows so far as bins, and the latest rows unthinned.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlottedCurves {
    /// Length of a bin \[s\]; 0 while every row has its own bin.
    length_s: f64,
    bins: Vec<CurveBin>,
    recent: VecDeque<CurveRow>,
    begin_s: Option<f64>,
}

impl PlottedCurves {
    /// Adds the next row. A row without a time cannot be drawn.
    pub(crate) fn add(&mut self, row: CurveRow) {
        if !row.unix_s.is_finite() {
            return;
        }
        self.begin_s.get_or_insert(row.unix_s);
        self.recent.push_back(row);
        if self.recent.len() > MAX_RECENT {
            self.recent.pop_front();
        }
        let bin = CurveBin { begin_s: row.unix_s, end_s: row.unix_s, low: row.values, high: row.values };
        match self.bins.last_mut() {
            Some(last) if row.unix_s - last.begin_s < self.length_s => last.merge(&bin),
            _ => self.bins.push(bin),
        }
        if self.bins.len() > MAX_BINS {
            self.merge_pairs();
        }
    }

    /// Merges pairs of bins.
    fn merge_pairs(&mut self) {
        let merged = self.bins.chunks(2).map(|pair| {
            let mut bin = pair[0];
            pair[1..].iter().for_each(|other| bin.merge(other));
            bin
        });
        self.bins = merged.collect();
        let passed_s = self.recent.back().map_or(0.0, |row| row.unix_s) - self.begin_s.unwrap_or_default();
        self.length_s = (2.0 * self.length_s).max(passed_s / (MAX_BINS / 2) as f64);
    }

    /// Unix time of the first and of the last row \[s\]; `None` before the first row.
    pub(crate) fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.begin_s?, self.recent.back()?.unix_s])
    }

    /// Curve number `curve` of the whole campaign: Unix time \[s\] and value, lowest and highest of each bin.
    pub(crate) fn all(&self, curve: usize) -> impl Iterator<Item = (f64, f64)> {
        self.bins.iter().flat_map(move |bin| {
            let ends = [(bin.begin_s, bin.low[curve]), (bin.end_s, bin.high[curve])];
            ends.into_iter().take(if bin.begin_s < bin.end_s { 2 } else { 1 })
        })
    }

    /// Curve number `curve` since `since_s`, as far as rows are kept unthinned: Unix time \[s\] and value.
    pub(crate) fn recent(&self, curve: usize, since_s: f64) -> impl Iterator<Item = (f64, f64)> {
        let rows = self.recent.iter().filter(move |row| row.unix_s >= since_s);
        rows.map(move |row| (row.unix_s, row.values[curve]))
    }
}

impl CurveBin {
    fn merge(&mut self, other: &Self) {
        self.end_s = other.end_s;
        for curve in 0..CURVES {
            // `min` and `max` give the other value where one is NaN.
            self.low[curve] = self.low[curve].min(other.low[curve]);
            self.high[curve] = self.high[curve].max(other.high[curve]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A week with a row every 5 s, one spike and one dip.
    #[test]
    fn a_week_is_kept_at_a_bounded_size_with_its_extremes() {
        let mut curves = PlottedCurves::default();
        let rows = 7 * 24 * 720;
        for row in 0..rows {
            let mut values = [20.0; CURVES];
            values[1] = if row == rows / 3 { 95.0 } else { f64::from(row) / f64::from(rows) };
            values[2] = f64::NAN;
            values[3] = if row == rows / 2 { -60.0 } else { 20.0 };
            curves.add(CurveRow { unix_s: 1e9 + 5.0 * f64::from(row), values });
            assert!(curves.bins.len() <= MAX_BINS && curves.recent.len() <= MAX_RECENT);
        }
        let [begin_s, end_s] = curves.span_s().unwrap();
        assert_eq!((begin_s, end_s), (1e9, 1e9 + 5.0 * f64::from(rows - 1)));
        let all: Vec<_> = curves.all(1).collect();
        assert!(all.len() > MAX_BINS / 2, "{}", all.len());
        assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
        let count = |curve: usize, value: f64| curves.all(curve).filter(|point| point.1 == value).count();
        assert_eq!((count(1, 95.0), count(3, -60.0)), (1, 1));
        assert_eq!(count(3, 20.0) + 1, curves.all(3).count());
        assert!((all[0].1 - 0.0).abs() < 1e-3 && (all[all.len() - 1].1 - 1.0).abs() < 1e-3);
        assert!(curves.all(2).all(|point| point.1.is_nan()));
        // The last three hours are kept unthinned.
        assert_eq!(curves.recent(0, end_s - 3.0 * 3600.0).count(), 3 * 720 + 1);
    }

    #[test]
    fn a_row_without_a_time_hides_none_of_the_others() {
        let mut curves = PlottedCurves::default();
        for unix_s in [f64::NAN, 1.0, f64::INFINITY, 2.0] {
            curves.add(CurveRow { unix_s, values: [0.0; CURVES] });
        }
        assert_eq!(curves.span_s(), Some([1.0, 2.0]));
        assert_eq!(curves.all(0).count(), 2);
    }

    #[test]
    fn few_rows_are_kept_as_they_are() {
        let mut curves = PlottedCurves::default();
        assert_eq!(curves.span_s(), None);
        for row in 0..10 {
            curves.add(CurveRow { unix_s: f64::from(row), values: [f64::from(row); CURVES] });
        }
        let expected: Vec<_> = (0..10).map(|row| (f64::from(row), f64::from(row))).collect();
        assert_eq!(curves.all(7).collect::<Vec<_>>(), expected);
        assert_eq!(curves.recent(7, 8.0).collect::<Vec<_>>(), expected[8..]);
    }
}
