//! The campaign so far as curves, at a size that does not grow: a campaign takes days, and its page is drawn every few seconds.

use isotherm_shared::wire::AXES;
use std::collections::VecDeque;

/// Curves of one row: the chamber's air and set point, then the heads and the boards.
pub const CURVES: usize = 2 + 2 * AXES;
/// Stretches of time that the whole campaign is kept in. When they are full, neighbours are joined, and each is twice as long.
const MAX_STRETCHES: usize = 2048;
/// Rows of the last while that are kept as they are: three hours of one every 5 s are 2160.
const MAX_RECENT: usize = 4096;

/// Values at one time; NaN where there is none.
#[derive(Clone, Copy, Debug)]
pub struct CurveRow {
    /// Unix time \[s\].
    pub unix_s: f64,
    /// In the order of [`CURVES`].
    pub values: [f64; CURVES],
}

/// The lowest and highest values in a stretch of time.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    begin_s: f64,
    end_s: f64,
    low: [f64; CURVES],
    high: [f64; CURVES],
}

/// All rows so far, thinned.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// Length of a stretch, Unix time \[s\]; 0 while every row has one of its own.
    length_s: f64,
    stretches: Vec<Stretch>,
    recent: VecDeque<CurveRow>,
    begin_s: Option<f64>,
}

impl Curves {
    /// Adds the next row.
    pub fn add(&mut self, row: CurveRow) {
        self.begin_s.get_or_insert(row.unix_s);
        self.recent.push_back(row);
        if self.recent.len() > MAX_RECENT {
            self.recent.pop_front();
        }
        let stretch = Stretch { begin_s: row.unix_s, end_s: row.unix_s, low: row.values, high: row.values };
        match self.stretches.last_mut() {
            Some(last) if row.unix_s - last.begin_s < self.length_s => last.join(&stretch),
            _ => self.stretches.push(stretch),
        }
        if self.stretches.len() > MAX_STRETCHES {
            self.halve();
        }
    }

    fn halve(&mut self) {
        let joined = self.stretches.chunks(2).map(|pair| {
            let mut stretch = pair[0];
            pair[1..].iter().for_each(|other| stretch.join(other));
            stretch
        });
        self.stretches = joined.collect();
        let passed_s = self.recent.back().map_or(0.0, |row| row.unix_s) - self.begin_s.unwrap_or_default();
        self.length_s = (2.0 * self.length_s).max(passed_s / (MAX_STRETCHES / 2) as f64);
    }

    /// Time of the first and of the last row, Unix time \[s\]; `None` before any.
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.begin_s?, self.recent.back()?.unix_s])
    }

    /// Curve number `curve` of the whole campaign: Unix time \[s\] and value, the extremes of each stretch of time.
    pub fn all(&self, curve: usize) -> impl Iterator<Item = (f64, f64)> {
        self.stretches.iter().flat_map(move |stretch| {
            let ends = [(stretch.begin_s, stretch.low[curve]), (stretch.end_s, stretch.high[curve])];
            ends.into_iter().take(if stretch.begin_s < stretch.end_s { 2 } else { 1 })
        })
    }

    /// Curve number `curve` since `since_s`, as far as it is kept row by row: Unix time \[s\] and value.
    pub fn recent(&self, curve: usize, since_s: f64) -> impl Iterator<Item = (f64, f64)> {
        let rows = self.recent.iter().filter(move |row| row.unix_s >= since_s);
        rows.map(move |row| (row.unix_s, row.values[curve]))
    }
}

impl Stretch {
    fn join(&mut self, other: &Self) {
        self.end_s = other.end_s;
        for curve in 0..CURVES {
            // The other value where one is NaN.
            self.low[curve] = self.low[curve].min(other.low[curve]);
            self.high[curve] = self.high[curve].max(other.high[curve]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A week of a row every 5 s, with one spike: bounded, and neither the ends nor the spike are lost.
    #[test]
    fn a_week_is_kept_at_a_bounded_size_with_its_extremes() {
        let mut curves = Curves::default();
        let rows = 7 * 24 * 720;
        for row in 0..rows {
            let mut values = [20.0; CURVES];
            values[1] = if row == rows / 3 { 95.0 } else { f64::from(row) / f64::from(rows) };
            values[2] = f64::NAN;
            curves.add(CurveRow { unix_s: 1e9 + 5.0 * f64::from(row), values });
            assert!(curves.stretches.len() <= MAX_STRETCHES && curves.recent.len() <= MAX_RECENT);
        }
        let [begin_s, end_s] = curves.span_s().unwrap();
        assert_eq!((begin_s, end_s), (1e9, 1e9 + 5.0 * f64::from(rows - 1)));
        let all: Vec<_> = curves.all(1).collect();
        assert!(all.len() > MAX_STRETCHES / 2, "{}", all.len());
        assert!(all.is_sorted_by(|a, b| a.0 <= b.0));
        assert_eq!(all.iter().filter(|point| point.1 == 95.0).count(), 1);
        assert!((all[0].1 - 0.0).abs() < 1e-3 && (all[all.len() - 1].1 - 1.0).abs() < 1e-3);
        assert!(curves.all(2).all(|point| point.1.is_nan()));
        // The last three hours are there row by row.
        assert_eq!(curves.recent(0, end_s - 3.0 * 3600.0).count(), 3 * 720 + 1);
    }

    #[test]
    fn few_rows_are_kept_as_they_are() {
        let mut curves = Curves::default();
        assert_eq!(curves.span_s(), None);
        for row in 0..10 {
            curves.add(CurveRow { unix_s: f64::from(row), values: [f64::from(row); CURVES] });
        }
        let expected: Vec<_> = (0..10).map(|row| (f64::from(row), f64::from(row))).collect();
        assert_eq!(curves.all(7).collect::<Vec<_>>(), expected);
        assert_eq!(curves.recent(7, 8.0).collect::<Vec<_>>(), expected[8..]);
    }
}
