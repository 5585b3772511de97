//! Thinning of long series to the points that a figure can show, so that the size of a report does not grow with the
//! measuring time.

use std::collections::BTreeSet;

use super::axis::usable;

/// Largest number of vertices of one line, of both edges of a band, or of the single points of a series.
pub(super) const MAX_VERTICES: usize = 1500;

/// Indices of the usable points to draw as a line, ascending.
///
/// Up to `limit` points are all kept. If there are more, every column of the figure keeps its smallest and largest y,
/// and the line keeps its ends: no extreme value is lost. Columns are equal intervals of x, or equal numbers of points
/// if x is not sorted.
pub(super) fn extremes(points: &[(f64, f64)], limit: usize) -> BTreeSet<usize> {
    let all: Vec<usize> = (0..points.len()).filter(|&i| usable(points[i].0) && usable(points[i].1)).collect();
    let (Some(&first), Some(&last)) = (all.first(), all.last()) else { return BTreeSet::new() };
    if all.len() <= limit {
        return all.into_iter().collect();
    }
    let columns = (limit / 2).saturating_sub(2).max(1);
    let (low, high) = (points[first].0, points[last].0);
    let sorted = low < high && all.is_sorted_by(|&a, &b| points[a].0 <= points[b].0);
    let column = |rank: usize| match sorted {
        true => (((points[all[rank]].0 - low) / (high - low) * columns as f64) as usize).min(columns - 1),
        false => rank * columns / all.len(),
    };
    let mut kept = BTreeSet::from([first, last]);
    let ranks: Vec<usize> = (0..all.len()).collect();
    for run in ranks.chunk_by(|&a, &b| column(a) == column(b)) {
        let order = |a: &&usize, b: &&usize| points[all[**a]].1.total_cmp(&points[all[**b]].1);
        kept.extend(run.iter().min_by(order).map(|&rank| all[rank]));
        kept.extend(run.iter().max_by(order).map(|&rank| all[rank]));
    }
    kept
}

/// Indices of the usable points to draw as single points: the extremes, and others at equal steps of the index.
pub(super) fn scatter(points: &[(f64, f64)], limit: usize) -> BTreeSet<usize> {
    let usable = (0..points.len()).filter(|&i| usable(points[i].0) && usable(points[i].1));
    let count = usable.clone().count();
    if count <= limit {
        return usable.collect();
    }
    let mut kept = extremes(points, limit / 6);
    kept.extend(usable.step_by(count.div_ceil(limit - limit / 6)));
    kept
}

/// Splits ascending indices wherever an index between two of them is not usable: there the line breaks.
pub(super) fn segments(kept: &BTreeSet<usize>, usable: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let mut segments: Vec<Vec<usize>> = Vec::new();
    for &index in kept {
        match segments.last_mut() {
            Some(segment) if segment.last().is_some_and(|&last| (last + 1..index).all(&usable)) => segment.push(index),
            _ => segments.push(vec![index]),
        }
    }
    segments
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_series_is_kept() {
        let points = [(0.0, 1.0), (1.0, f64::NAN), (f64::INFINITY, 1.0), (3.0, 1.0)];
        assert_eq!(extremes(&points, 10), BTreeSet::from([0, 3]));
        assert_eq!(scatter(&points, 10), BTreeSet::from([0, 3]));
        assert_eq!(extremes(&[], 10), BTreeSet::new());
    }

    #[test]
    fn extremes_of_a_long_series_are_kept() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i), libm::sin(f64::from(i)))).collect();
        points[33_333].1 = 50.0;
        points[77_777].1 = -50.0;
        points[50_000].1 = f64::NAN;
        for kept in [extremes(&points, MAX_VERTICES), scatter(&points, MAX_VERTICES)] {
            assert!(kept.len() <= MAX_VERTICES && kept.len() > MAX_VERTICES / 2, "{}", kept.len());
            for index in [0, 33_333, 77_777, 99_999] {
                assert!(kept.contains(&index), "{index}");
            }
            assert!(!kept.contains(&50_000));
        }
        points.swap(0, 99_999); // no longer sorted
        let kept = extremes(&points, MAX_VERTICES);
        assert!(kept.len() <= MAX_VERTICES && kept.contains(&33_333) && kept.contains(&77_777));
    }

    #[test]
    fn a_sparse_part_keeps_its_points_beside_a_dense_one() {
        let dense = (0..99_900).map(|i| (f64::from(i) * 1e-5, 0.0));
        let points: Vec<(f64, f64)> = dense.chain((1..=100).map(|i| (f64::from(i), 1.0 / f64::from(i)))).collect();
        let kept = extremes(&points, MAX_VERTICES);
        assert!(kept.iter().filter(|&&i| i >= 99_900).count() >= 99);
    }

    #[test]
    fn lines_break_only_where_a_value_is_missing() {
        let kept = BTreeSet::from([0, 2, 4, 5]);
        assert_eq!(segments(&kept, |i| i != 3), [vec![0, 2], vec![4, 5]]);
        assert_eq!(segments(&kept, |_| true), [vec![0, 2, 4, 5]]);
    }
}
