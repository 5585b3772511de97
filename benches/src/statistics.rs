//! Percentiles with enough samples behind them, ratios of measurements of the same round, and confidence intervals of
//! these ratios.

use serde_json::{Map, Value, json};
use std::time::Duration;

/// A percentile with fewer samples beyond it is not given.
const BEYOND: usize = 20;
/// Resamplings for an interval (bootstrap).
const RESAMPLINGS: usize = 2000;

/// The percentiles that are given, by name.
const PARTS: [(&str, f64); 5] = [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p999", 0.999), ("p9999", 0.9999)];

/// The percentiles of which ratios are given.
const RATIO_PARTS: [(&str, f64); 4] = [PARTS[0], PARTS[1], PARTS[2], PARTS[3]];

/// A duration \[ns\]; over 4 s it is the largest number.
#[inline]
pub fn nanoseconds(time: Duration) -> u32 {
    u32::try_from(time.as_nanos()).unwrap_or(u32::MAX)
}

/// The value of sorted ones that a part of them does not exceed.
pub fn nearest_rank<T: Copy>(sorted: &[T], part: f64) -> Option<T> {
    sorted.get(rank(sorted.len(), part) - 1).copied()
}

fn rank(count: usize, part: f64) -> usize {
    ((count as f64 * part).ceil() as usize).max(1)
}

/// The percentile of sorted values, if enough of them lie beyond it.
fn percentile(sorted: &[u32], part: f64) -> Option<f64> {
    nearest_rank(sorted, part).filter(|_| sorted.len() >= rank(sorted.len(), part) + BEYOND).map(f64::from)
}

/// All percentiles \[ns\], the largest value and how many there are.
pub fn figures(mut values: Vec<u32>) -> Map<String, Value> {
    values.sort_unstable();
    let percentiles = PARTS.iter().map(|(name, part)| (format!("{name}_ns"), json!(percentile(&values, *part))));
    let mut figures: Map<_, _> = percentiles.collect();
    figures.insert("max_ns".to_owned(), json!(values.last()));
    figures.insert("count".to_owned(), json!(values.len()));
    figures
}

/// Ratios of the percentiles of `upper` to those of `lower`, both given round by round: the median over the rounds, and
/// the interval that holds 95 % of the medians when rounds are resampled. Rounds are resampled, not blocks: the blocks
/// of a round share processes and memory, so they are not independent. A percentile for which a round has too few
/// samples is taken from all rounds together, as in [`pooled_ratio`].
pub fn ratios(upper: &[Vec<u32>], lower: &[Vec<u32>]) -> Value {
    let of = |part| {
        let one = |(upper, lower): (&Vec<u32>, &Vec<u32>)| Some(percentile(upper, part)? / percentile(lower, part)?);
        let all: Option<Vec<f64>> = upper.iter().zip(lower).map(one).collect();
        all.and_then(|all| interval(&all)).unwrap_or_else(|| pooled_ratio(upper, lower, part))
    };
    by_part(of)
}

/// As [`ratios`], every percentile taken from all rounds together: for rounds of which some have few samples, or none.
pub(crate) fn pooled_ratios(upper: &[Vec<u32>], lower: &[Vec<u32>]) -> Value {
    by_part(|part| pooled_ratio(upper, lower, part))
}

fn by_part(ratio: impl Fn(f64) -> Value) -> Value {
    RATIO_PARTS.iter().map(|(name, part)| ((*name).to_owned(), ratio(*part))).collect::<Map<_, _>>().into()
}

fn interval(values: &[f64]) -> Option<Value> {
    let center = median(values.to_vec())?;
    let mut draw = Random::default();
    let medians =
        (0..RESAMPLINGS).filter_map(|_| median((0..values.len()).map(|_| values[draw.below(values.len())]).collect()));
    Some(around(center, medians.collect()))
}

/// The ratio of a percentile of all of `upper` to that of all of `lower`, both given turn by turn, and the interval
/// that holds 95 % of the ratios when turns are resampled. It is for percentiles that need more samples than one turn
/// has.
pub fn pooled_ratio(upper: &[Vec<u32>], lower: &[Vec<u32>], part: f64) -> Value {
    let of = |turns: &[Vec<u32>], chosen: &[usize]| {
        let mut pool: Vec<u32> = chosen.iter().flat_map(|turn| &turns[*turn]).copied().collect();
        pool.sort_unstable();
        percentile(&pool, part)
    };
    let ratio = |chosen: &[usize]| Some(of(upper, chosen)? / of(lower, chosen)?);
    let turns = upper.len().min(lower.len());
    let Some(center) = ratio(&(0..turns).collect::<Vec<_>>()) else { return Value::Null };
    let mut draw = Random::default();
    let drawn = (0..RESAMPLINGS / 10).filter_map(|_| ratio(&(0..turns).map(|_| draw.below(turns)).collect::<Vec<_>>()));
    around(center, drawn.collect())
}

fn around(center: f64, mut drawn: Vec<f64>) -> Value {
    drawn.sort_by(f64::total_cmp);
    let at = |part: f64| drawn.get((drawn.len().saturating_sub(1) as f64 * part).round() as usize);
    json!({"ratio": center, "low": at(0.025), "high": at(0.975)})
}

/// Pseudo-random numbers, the same in every run.
pub struct Random(u64);

impl Default for Random {
    fn default() -> Self {
        Self(0x9E37_79B9_7F4A_7C15)
    }
}

impl Random {
    /// A number from 0 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// An index below `below`.
    fn below(&mut self, below: usize) -> usize {
        (self.next() % below as u64) as usize
    }

    const fn next(&mut self) -> u64 {
        // xorshift64
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// The median; `None` if there are no values.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        odd if odd % 2 == 1 => Some(values[middle]),
        _ => Some(f64::midpoint(values[middle - 1], values[middle])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_needs_twenty_values_beyond_it() {
        let sorted: Vec<u32> = (1..=2000).collect();
        assert_eq!((percentile(&sorted, 0.5), percentile(&sorted, 0.99)), (Some(1000.0), Some(1980.0)));
        assert_eq!((percentile(&sorted[1..], 0.99), percentile(&sorted, 0.999)), (None, None));
    }

    #[test]
    fn the_interval_of_ratios_holds_their_median() {
        let lower = vec![vec![100; 100]; 9];
        let upper: Vec<_> = (0..9).map(|round| vec![200 + round; 100]).collect();
        let p50 = &ratios(&upper, &lower)["p50"];
        let [ratio, low, high] = ["ratio", "low", "high"].map(|name| p50[name].as_f64().unwrap());
        assert_eq!(ratio, 2.04);
        assert!((2.0..2.04).contains(&low) && high > 2.04 && high <= 2.08, "{low} {high}");
        assert_eq!(ratios(&upper, &lower)["p999"], Value::Null);
    }

    #[test]
    fn a_pooled_ratio_takes_all_turns_together() {
        let lower = vec![(1..=300).collect::<Vec<u32>>(); 8];
        let upper: Vec<Vec<u32>> = (0..8).map(|turn| (1..=300).map(|k| 2 * k + turn % 2).collect()).collect();
        // A single turn has three samples beyond p99.
        assert_eq!(ratios(&upper, &lower)["p99"], pooled_ratio(&upper, &lower, 0.99));
        let p99 = &pooled_ratio(&upper, &lower, 0.99);
        let [ratio, low, high] = ["ratio", "low", "high"].map(|name| p99[name].as_f64().unwrap());
        assert!(low <= ratio && ratio <= high && (2.0..2.01).contains(&low) && high < 2.01, "{low} {ratio} {high}");
        assert_eq!(pooled_ratio(&upper, &lower, 0.999), Value::Null);
        // A turn that was left out makes no percentile of one turn, but one of all.
        let mut with_gap = upper;
        with_gap[3].clear();
        let p50 = pooled_ratios(&with_gap, &lower)["p50"]["ratio"].as_f64().unwrap();
        assert!((2.0..2.02).contains(&p50), "{p50}");
        assert_eq!(ratios(&with_gap, &lower)["p50"]["ratio"], p50);
    }
}
