//! Rows whose interval is not the one that the scale factors of a table are of.

use crate::interval::{part, shown};
use isotherm_shared::nominal::{MAX_MULTIPLE, interval_fits};
use isotherm_support::finding::{Finding, name};

/// The fault that `usual_ns`, the interval of the rows, does not fit the nominal interval of a table; 0 fits all.
pub(crate) fn not_nominal(nominal_ns: u64, usual_ns: u64) -> Option<Finding> {
    if nominal_ns == 0 || interval_fits(nominal_ns, usual_ns) {
        return None;
    }
    let [usual, nominal] = [usual_ns, nominal_ns].map(|ns| ns as f64 / 1e9);
    let message = format!(
        "the interval of the rows is {} s, and the scale factors of the table are of {} s (nominal_interval_s): {} of \
         it, no whole multiple from 1 to {MAX_MULTIPLE}; give the table of this interval, or rows of that one",
        shown(usual),
        shown(nominal),
        part(usual / nominal)
    );
    Some(Finding::fault(name::INTERVAL_NOT_NOMINAL, message))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Continuity;
    use isotherm_shared::sequence::Period;
    use isotherm_shared::table::CoefficientTable;

    fn table() -> CoefficientTable {
        CoefficientTable::from_toml(include_str!("../../examples/tables/imu-mems.toml"), None).unwrap()
    }

    /// Rows of these intervals, which are the time from row to row times `ratio` \[ns\].
    fn rows(intervals: impl IntoIterator<Item = u64>, ratio: f64) -> Continuity {
        let mut timestamp_ns = 1_000_000_000;
        let row = |(sequence, interval_ns): (u64, u64)| {
            timestamp_ns += (interval_ns as f64 / ratio) as u64;
            Period { session: 1, sequence, timestamp_ns, interval_ns }
        };
        (0..).zip(intervals).map(row).collect()
    }

    #[test]
    fn the_usual_interval_is_compared() {
        let found = |intervals: Vec<u64>| rows(intervals, 1.0).not_nominal(&table()).map(|finding| finding.message);
        for fits in [vec![2_500_000; 50], vec![2_520_000; 50], vec![5_000_000; 50], vec![160_000_000; 50], vec![]] {
            assert_eq!(found(fits), None);
        }
        // One in three is merged of two and a half.
        let merged = (0..60).map(|n| if n % 3 == 0 { 6_250_000 } else { 2_500_000 });
        assert_eq!(found(merged.collect()), None);
        let text = found(vec![505_000_000; 50]).unwrap();
        assert!(
            text.starts_with("the interval of the rows is 0.505 s, and the scale factors of the table are of 0.0025 s")
        );
        assert!(text.contains("2.020e2 of it, no whole multiple from 1 to 64"), "{text}");
        assert!(found(vec![3_750_000; 50]).is_some() && found(vec![2_530_000; 1]).is_some());
        assert_eq!(not_nominal(0, 3_750_000), None);
    }

    #[test]
    fn where_the_interval_is_not_the_time_from_row_to_row_that_time_counts() {
        // Microseconds, of rows that fit: the unit is the fault.
        let microseconds = rows(vec![2_500; 50], 1e-3);
        assert!(microseconds.interval().is_some() && microseconds.not_nominal(&table()).is_none());
        // An interval that was only stated, of rows every 10.1 ms and a third.
        let stated = rows(vec![2_500_000; 50], 0.25 / 1.034);
        let text = stated.not_nominal(&table()).unwrap().message;
        assert!(text.starts_with("the interval of the rows is 0.01034 s"), "{text}");
    }
}
