//! The nominal interval, and how far apart the rows are.

use isotherm_shared::wire::MAX_INTERVAL_NS;

/// A step of the time over this number of nominal intervals is a gap, or a late row.
pub(super) const GAP: f64 = 1.5;
/// Relative difference that counts: 100 ppm.
const COUNTS: f64 = 1e-4;
/// Most that a rounded interval may differ from the mean step, relative, however much the time jitters.
const MOST: f64 = 5e-3;
/// Standard errors that jitter explains.
const ERRORS: f64 = 3.0;
/// Fewest steps that are judged.
const FEWEST: u64 = 3;

/// The steps of the time between rows without a gap, as deviations from one interval.
pub(super) struct IntervalSteps {
    interval_ns: f64,
    count: u64,
    /// Of them under half of the interval.
    short: u64,
    /// Steps that do not count: between runs of those that do.
    long: u64,
    sum: f64,
    squares: f64,
    /// Of each deviation and the one before.
    products: f64,
    last: f64,
}

impl IntervalSteps {
    /// No steps.
    pub(super) fn new(interval_ns: u64) -> Self {
        Self {
            interval_ns: interval_ns as f64,
            count: 0,
            short: 0,
            long: 0,
            sum: 0.0,
            squares: 0.0,
            products: 0.0,
            last: 0.0,
        }
    }

    /// Takes a step in \[ns\]. One over [`GAP`] intervals does not count.
    pub(super) fn take(&mut self, step_ns: u64) {
        let step = step_ns as f64;
        if step <= GAP * self.interval_ns {
            let deviation = step - self.interval_ns;
            self.count += 1;
            self.short += u64::from(step < 0.5 * self.interval_ns);
            self.sum += deviation;
            self.squares += deviation * deviation;
            self.products += deviation * self.last;
            self.last = deviation;
        } else {
            self.long += 1;
            self.last = 0.0;
        }
    }

    /// The mean step \[ns\].
    fn mean(&self) -> f64 {
        self.interval_ns + self.sum / self.count as f64
    }

    /// The variance of the steps \[ns2\].
    fn variance(&self) -> f64 {
        let (count, mean) = (self.count as f64, self.sum / self.count as f64);
        (self.squares / count - mean * mean).max(0.0)
    }

    /// The mean step \[ns\], if it differs from the interval by over 100 ppm and what the jitter explains.
    ///
    /// The variance of the mean is that of steps that are correlated with the step before: where only the stamps
    /// jitter, a step that is too long is followed by one that is too short.
    pub(super) fn other_mean(&self) -> Option<f64> {
        if self.count < FEWEST {
            return None;
        }
        let (count, off) = (self.count as f64, self.sum / self.count as f64);
        // Where some steps are that short, as many are over the limit, and missing in the mean.
        if (SHORT * count..0.5 * count).contains(&(self.short as f64)) && self.short > 0 {
            return None;
        }
        let covariance = (self.products - (count - 1.0) * off * off) / count;
        // Of each run only the stamps of its ends remain.
        let of_ends = self.variance() * ((self.long + 1) as f64 / count).min(1.0);
        let variance = (self.variance() + 2.0 * covariance).max(of_ends);
        let explained = ERRORS * (variance / count).sqrt();
        (off.abs() > COUNTS * self.interval_ns + explained).then(|| self.mean())
    }
}

/// How the stamps of rows lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct IntervalShape {
    /// The time from row to row \[ns\].
    pub period_ns: f64,
    /// Whether the stamps are those of the rows; otherwise they jitter or come in bursts.
    pub is_even: bool,
    /// A longer step is a gap \[ns\].
    pub gap_ns: u64,
    /// Rows that usually come at once, 1 without bursts.
    pub burst: usize,
    /// Whether the stamps show where rows are lost: those that are least late keep the pace.
    pub shows_losses: bool,
    /// The period may be off by this part where it is rounded.
    near: f64,
    median_ns: u64,
}

/// A step over this number of times the 99 % quantile of all steps is a gap.
const LONG: u64 = 3;
/// Steps within this part of the usual step are usual.
const USUAL: f64 = 0.2;
/// Least share of the time that lies in usual steps, if stamps are those of their rows.
const LEAST_USUAL: f64 = 0.45;
/// The same of steps of whole periods, where more than a third of the rows is lost.
const LEAST_WHOLE: f64 = 0.6;
/// The part of the steps that are shorter than the shortest usual one, by their jitter.
const SHORTEST: usize = 20;
/// Steps whose sum is compared with each of them: where rows are lost, a long step does not make the next ones short.
const SUMMED: usize = 16;
const LEAST_INDEPENDENT: f64 = 0.5;
/// Steps over this number of usual ones show nothing of the usual step.
const FEW: f64 = 10.0;
/// Fewer rows than this do not distinguish jitter from lost rows.
const FEWEST_UNEVEN: usize = 100;
/// Most steps of 0 between even stamps.
const STANDING: f64 = 0.01;
/// Least share of steps under half of the period where stamps jitter.
const SHORT: f64 = 3e-3;
/// Fewer such steps are single rows with a wrong stamp.
const FEWEST_SHORT: f64 = 3.0;
/// Blocks whose least delays show whether rows are lost, their rows, and the bursts in each.
const BLOCKS: usize = 16;
const LEAST_BLOCK: usize = 64;
const MOST_BLOCK: usize = 1000;
const BURSTS: usize = 8;
/// Fewer blocks show nothing.
const FEWEST_BLOCKS: usize = 4;
/// No burst has so many rows, and none is so long after the one before \[ns\].
const LARGEST_BURST: usize = 500;
const LONGEST_BURST_NS: u64 = 60_000_000_000;

/// The nominal interval of rows of this shape \[ns\]: the time from row to row; or the interval of a whole number of
/// Hz, of s, or the median step, the first that the data allow.
pub(super) fn rounded(shape: &IntervalShape) -> Option<u64> {
    let mean = shape.period_ns;
    let hertz = 1e9 / (1e9 / mean).round();
    let seconds = (mean / 1e9).round() * 1e9;
    let near = shape.near.min(MOST) * mean;
    let median = if shape.is_even { shape.median_ns as f64 } else { mean };
    let round = [hertz, seconds, median].into_iter().find(|round| (round - mean).abs() <= near);
    let found = round.unwrap_or(mean).round() as u64;
    (1..=MAX_INTERVAL_NS).contains(&found).then_some(found)
}

/// The shape of these times \[ns\], which do not fall; `None` if none of them rises.
pub(super) fn found(times: &[u64]) -> Option<IntervalShape> {
    let all: Vec<_> = times.windows(2).filter_map(|pair| pair[1].checked_sub(pair[0])).collect();
    let mut sorted: Vec<_> = all.iter().copied().filter(|step| *step > 0).collect();
    sorted.sort_unstable();
    let median_ns = *sorted.get(sorted.len() / 2)?;
    let gap_ns = sorted[(sorted.len() - 1) * 99 / 100].saturating_mul(LONG);
    let (longest, gap_ns) = longest(times, gap_ns);
    let steps: Vec<_> = longest.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let period_ns = period(&steps, usual(&all, median_ns));
    let is_even = is_even(longest, period_ns);
    if is_even {
        let mut steps = IntervalSteps::new(period_ns.round() as u64);
        all.iter().filter(|step| **step > 0).for_each(|step| steps.take(*step));
        let jitter = ERRORS * steps.variance().sqrt() / steps.count.max(1) as f64;
        let near = COUNTS + jitter / period_ns;
        return Some(IntervalShape { period_ns, is_even, gap_ns, burst: 1, shows_losses: true, near, median_ns });
    }
    let period_ns = slope(longest).filter(|period_ns| *period_ns > 0.0)?;
    let rows = longest.len() as f64;
    let long = longest.windows(2).filter(|pair| (pair[1] - pair[0]) as f64 > period_ns * 1.5).count();
    let short = longest.windows(2).filter(|pair| ((pair[1] - pair[0]) as f64) < period_ns * 0.5).count();
    // In bursts most steps are short, and the others long.
    let is_bursts = short > 2 * long;
    let burst = if is_bursts { (rows / (long + 1) as f64).round() as usize } else { 1 };
    let late = longest.iter().enumerate().map(|(row, time)| (time - longest[0]) as f64 - row as f64 * period_ns);
    let late: Vec<_> = late.collect();
    let (low, high) = late.iter().fold((0.0, 0.0), |(low, high): (f64, f64), late| (low.min(*late), high.max(*late)));
    let near = COUNTS + (high - low) / period_ns / libm::pow(rows, 1.5);
    let longer = usual_pace(&late, period_ns, burst);
    let (period_ns, shows_losses) = (period_ns * (1.0 + longer.unwrap_or(0.0)), longer.is_some());
    Some(IntervalShape { period_ns, is_even, gap_ns, burst, shows_losses, near, median_ns })
}

/// The part of the period by which the usual one is longer, of rows with these delays against an even clock \[ns\]:
/// that of most blocks of rows, whose least delays lie on a line within half a period. A step of the others is lost
/// rows. `None` if there is no such line.
fn usual_pace(late: &[f64], period_ns: f64, burst: usize) -> Option<f64> {
    let block = (late.len() / BLOCKS).clamp(LEAST_BLOCK, MOST_BLOCK).max(BURSTS * burst);
    let least = |block: &[f64]| block.iter().copied().fold(f64::INFINITY, f64::min);
    let least: Vec<_> = late.chunks_exact(block).map(least).collect();
    let steps: Vec<_> = least.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = steps.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let unsteady = steps.iter().filter(|step| (*step - usual).abs() > period_ns / 2.0).count();
    match unsteady {
        0 => Some(0.0),
        _ if steps.len() < FEWEST_BLOCKS => Some(0.0),
        _ => (2 * unsteady <= steps.len()).then_some(usual / block as f64 / period_ns),
    }
}

/// The usual step of the times that rise \[ns\], of times that may also fall; `None` if none rises.
pub(super) fn usual_step(times: &[u64]) -> Option<f64> {
    let mut rises: Vec<_> = times.windows(2).filter_map(|pair| pair[1].checked_sub(pair[0])).collect();
    rises.retain(|step| *step > 0);
    let mut sorted = rises.clone();
    sorted.sort_unstable();
    let usual_ns = usual(&rises, *sorted.get(sorted.len() / 2)?);
    let longest_ns = sorted[(sorted.len() - 1) * 95 / 100].saturating_mul(LONG);
    rises.retain(|step| *step <= longest_ns);
    Some(period(&rises, usual_ns))
}

/// The time from row to row \[ns\]: the usual step, or the shortest one of which the others are whole multiples.
fn period(steps: &[u64], usual_ns: f64) -> f64 {
    if are_usual(steps, usual_ns) {
        return usual_ns;
    }
    let mut sorted: Vec<_> = steps.iter().copied().filter(|step| *step > 0).collect();
    sorted.sort_unstable();
    let shortest_ns = sorted.get(sorted.len() / SHORTEST).map(|shortest_ns| usual(steps, *shortest_ns));
    shortest_ns.filter(|period_ns| are_multiples(steps, *period_ns)).unwrap_or(usual_ns)
}

/// The longest stretch without a longer step, and that step; all times if the longer steps are those of bursts, with
/// three of them as the limit.
fn longest(times: &[u64], gap_ns: u64) -> (&[u64], u64) {
    let stretches = times.chunk_by(|earlier, later| (*earlier..=earlier.saturating_add(gap_ns)).contains(later));
    let longest = stretches.max_by_key(|stretch| stretch.len()).unwrap_or(times);
    let rises = times.windows(2).all(|pair| pair[0] <= pair[1]);
    if !rises || 2 * longest.len() >= times.len() {
        return (longest, gap_ns);
    }
    match of_bursts(times, gap_ns) {
        Some(usual_ns) => (times, usual_ns.saturating_mul(LONG)),
        None => (longest, gap_ns),
    }
}

/// The usual one of the steps over `gap_ns`, if they are those between bursts: many, and most of them alike. Pauses
/// are not.
fn of_bursts(times: &[u64], gap_ns: u64) -> Option<u64> {
    let steps = times.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    let mut long: Vec<_> = steps.filter(|step| *step > gap_ns).collect();
    long.sort_unstable();
    let usual_ns = *long.get(long.len() / 2)?;
    let is_usual = |step: &&u64| step.abs_diff(usual_ns) as f64 <= USUAL * usual_ns as f64;
    let is_alike = 2 * long.iter().filter(is_usual).count() >= long.len();
    (is_alike && usual_ns <= LONGEST_BURST_NS && times.len() < LARGEST_BURST * (long.len() + 1)).then_some(usual_ns)
}

/// The usual step \[ns\]: the sum of all that show it over the number of rows that they are long.
fn usual(steps: &[u64], median_ns: u64) -> f64 {
    let mut near = IntervalSteps::new(median_ns);
    steps.iter().filter(|step| **step > 0).for_each(|step| near.take(*step));
    let first = near.mean();
    let few = steps.iter().map(|step| *step as f64).filter(|step| *step > 0.0 && *step <= FEW * first);
    let (sum, rows) = few.fold((0.0, 0.0), |(sum, rows), step| (sum + step, rows + (step / first).round()));
    if rows > 0.0 { sum / rows } else { first }
}

/// Whether the stamps are those of their rows: the time lies in usual steps, or where rows are lost in whole multiples
/// of them, and where a step is too short, others are too long.
fn is_even(times: &[u64], period_ns: f64) -> bool {
    let steps: Vec<_> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let stand = steps.iter().filter(|step| **step == 0).count() as f64;
    let is_few = times.len() <= FEWEST_UNEVEN;
    is_few
        || stand <= STANDING * times.len() as f64
            && (are_usual(&steps, period_ns) || are_multiples(&steps, period_ns))
            && !only_jitters(times, period_ns)
}

/// Whether much of the time lies in steps within a fifth of the period, or one unit of coarse stamps.
fn are_usual(steps: &[u64], period_ns: f64) -> bool {
    let unit_ns = steps.iter().copied().fold(0, gcd) as f64;
    let coarse = if unit_ns < period_ns / 2.0 { unit_ns } else { 0.0 };
    let is_usual = |step: &f64| {
        let off = (step - period_ns).abs();
        off <= USUAL * period_ns || off < coarse
    };
    time_in(steps, is_usual) >= LEAST_USUAL * time_in(steps, |_| true)
}

/// Whether most of the time lies in steps of whole periods, in any order: the steps between them are lost rows. Where
/// stamps are coarse, jitter or come in bursts, a long step makes the next ones short.
fn are_multiples(steps: &[u64], period_ns: f64) -> bool {
    let is_whole = |step: &f64| {
        let periods = (step / period_ns).round();
        (1.0..=FEW).contains(&periods) && (step - periods * period_ns).abs() <= USUAL * period_ns
    };
    let steps_of = || steps.iter().map(|step| *step as f64);
    let sums = steps.chunks_exact(SUMMED).map(|part| time_in(part, |_| true));
    let is_any_order = variance(sums) >= LEAST_INDEPENDENT * SUMMED as f64 * variance(steps_of());
    is_any_order && time_in(steps, is_whole) >= LEAST_WHOLE * time_in(steps, |_| true)
}

/// The time of some of the steps \[ns\].
fn time_in(steps: &[u64], of: impl Fn(&f64) -> bool) -> f64 {
    steps.iter().map(|step| *step as f64).filter(of).sum()
}

/// The variance of steps \[ns2\].
fn variance(steps: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = steps.clone().count().max(1) as f64;
    let mean = steps.clone().sum::<f64>() / count;
    steps.map(|step| (step - mean) * (step - mean)).sum::<f64>() / count
}

/// Whether steps under half of the period and over 1.5 of it are as many: stamps jitter, and no row is lost.
fn only_jitters(times: &[u64], period_ns: f64) -> bool {
    let steps = || times.windows(2).map(|pair| (pair[1] - pair[0]) as f64 / period_ns);
    let [short, long] = [steps().filter(|step| *step < 0.5).count(), steps().filter(|step| *step > GAP).count()];
    let [short, long] = [short, long].map(|count| count as f64);
    short >= FEWEST_SHORT.max(SHORT * times.len() as f64) && long - short <= ERRORS * (long + short).sqrt()
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The time from row to row \[ns\], if rows arrive late and never early: the slope of the edge of the lower convex hull
/// that is over the middle row.
fn slope(times: &[u64]) -> Option<f64> {
    let (first, middle) = (*times.first()?, times.len() as f64 / 2.0);
    let mut hull: Vec<(f64, f64)> = Vec::new();
    for (row, time) in times.iter().enumerate() {
        let point = (row as f64, (time - first) as f64);
        while let [.., (x0, y0), (x1, y1)] = hull[..]
            && (y1 - y0) * (point.0 - x1) >= (point.1 - y1) * (x1 - x0)
        {
            hull.pop();
        }
        hull.push(point);
    }
    let edge = hull.windows(2).find(|pair| pair[1].0 >= middle)?;
    Some((edge[1].1 - edge[0].1) / (edge[1].0 - edge[0].0))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Stamps of rows at this rate, each rounded down to `unit`, from 5 s on.
    fn stamps(hertz: f64, unit: u64, rows: u64) -> Vec<u64> {
        (0..rows).map(|row| (5e9 + row as f64 * 1e9 / hertz) as u64 / unit * unit).collect()
    }

    fn nominal(times: &[u64]) -> Option<u64> {
        rounded(&found(times)?)
    }

    fn other_mean(times: &[u64], interval_ns: u64) -> Option<f64> {
        let mut steps = IntervalSteps::new(interval_ns);
        times.windows(2).for_each(|pair| steps.take(pair[1] - pair[0]));
        steps.other_mean()
    }

    #[test]
    fn only_a_rate_that_is_a_whole_number_of_hertz_is_rounded() {
        for unit in [1, 1000, 100_000] {
            assert_eq!(nominal(&stamps(416.0, unit, 1000)), Some(2_403_846), "{unit}");
            let found = nominal(&stamps(416.4, unit, 1000)).unwrap() as f64 * 416.4 / 1e9;
            assert!((found - 1.0).abs() < 1e-4, "{unit}: {found}");
        }
        assert_eq!(nominal(&stamps(200.01, 1, 1000)), Some(5_000_000));
        assert_eq!(nominal(&stamps(300.0, 1_000_000, 1000)), Some(3_333_333));
        assert_eq!(nominal(&[0, 1_000_000_000]), Some(1_000_000_000));
        assert_eq!((nominal(&[]), nominal(&[7, 7]), nominal(&[0, u64::MAX])), (None, None, None));
    }

    #[test]
    fn lost_rows_gaps_and_coarse_stamps_do_not_change_it() {
        let stamps = |hertz: f64, unit: u64, is_lost: &dyn Fn(u64) -> bool| {
            let all = (0..1000).filter(|row| !is_lost(*row));
            let time = |row: u64| 5e9 + row as f64 * 1e9 / hertz + if row > 600 { 3.6e12 } else { 0.0 };
            all.map(|row| time(row) as u64 / unit * unit).collect::<Vec<_>>()
        };
        for hertz in [50.0, 100.0, 200.0, 300.0, 416.0, 420.0, 450.0] {
            for unit in [1, 1_000_000] {
                for lost in [0, 5, 20] {
                    let is_lost = |row: u64| row * 7919 % 101 < lost;
                    let found = nominal(&stamps(hertz, unit, &is_lost)).unwrap() as f64 * hertz / 1e9;
                    assert!((found - 1.0).abs() < 1.3e-3, "{hertz} Hz, {unit} ns, {lost} lost: {found}");
                }
            }
        }
    }

    #[test]
    fn stamps_that_stand_or_come_in_bursts_are_not_even() {
        let shape = |time: &dyn Fn(u64) -> u64| found(&(0..1000).map(time).collect::<Vec<_>>()).unwrap();
        assert!(shape(&|row| row * 5_000_000).is_even && shape(&|row| row * 2_381_000 / 1_000_000).is_even);
        let bursts = shape(&|row| row / 25 * 125_000_000 + row % 25 * 50_000);
        assert!(!bursts.is_even && bursts.burst == 25 && (bursts.period_ns / 5e6 - 1.0).abs() < 1e-3, "{bursts:?}");
        let standing = shape(&|row| row / 2 * 1_000_000);
        assert!(!standing.is_even && (standing.period_ns / 5e5 - 1.0).abs() < 2e-3, "{standing:?}");
    }

    /// Numbers from 0 to 1 that look random.
    pub(in crate::convert) fn uniform(row: u64) -> f64 {
        let mixed = (row + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) as f64 / u64::MAX as f64
    }

    /// How far the period is from 10 ms, relative.
    fn off(shape: IntervalShape) -> f64 {
        (shape.period_ns / 1e7 - 1.0).abs()
    }

    #[test]
    fn pauses_are_no_bursts_and_jitter_is_no_loss() {
        for rows in [100, 250, 400] {
            let pause = |row: u64| (0..row / rows).map(|number| 9e11 * (1.0 + 3.0 * uniform(number))).sum::<f64>();
            for count in [1000, 20_000] {
                let times: Vec<_> = (0..count).map(|row| row * 10_000_000 + pause(row) as u64).collect();
                assert!(found(&times).is_some_and(|shape| shape.is_even && off(shape) < 1e-9), "{rows} {count}");
            }
        }
        for burst in [10, 25, 200, 438] {
            let times: Vec<_> =
                (0..20_000).map(|row| row / burst * burst * 10_000_000 + row % burst * 50_000).collect();
            let shape = found(&times).unwrap();
            assert!(!shape.is_even && off(shape) < 1.3e-3 && shape.gap_ns < 20_000_000_000, "{burst} {shape:?}");
        }
        let late = |row: &u64| row * 10_000_000 + (6e6 * uniform(*row)) as u64;
        let shape = found(&(0..1000).map(|row| late(&row)).collect::<Vec<_>>()).unwrap();
        assert!(!shape.is_even && off(shape) < 1.3e-3, "{shape:?}");
        let lost = (0..1000).filter(|row| uniform(row + 5000) > 0.05);
        let shape = found(&lost.map(|row| late(&row)).collect::<Vec<_>>()).unwrap();
        assert!(shape.is_even && off(shape) < 0.015, "{shape:?}");
    }

    /// Rows that jitter by 10 % of the interval, of which some are lost.
    #[test]
    fn steps_of_whole_intervals_are_lost_rows() {
        for seed in 0..20 {
            for lost in [0.1, 0.3, 0.39, 0.5, 0.6, 0.7] {
                let kept = (0..20_000_u64).filter(|row| uniform(row + seed * 77_777) >= lost);
                let jitter = if seed % 2 == 0 { 2e6 } else { 0.0 };
                let late = |row: u64| row * 10_000_000 + (jitter * uniform(row + 900_000 + seed)) as u64;
                let times: Vec<_> = kept.map(late).take(1000).collect();
                let shape = found(&times).unwrap();
                assert!(shape.is_even && off(shape) < 0.01, "{seed} {lost}: {shape:?}");
                assert!((usual_step(&times).unwrap() / 1e7 - 1.0).abs() < 0.01, "{seed} {lost}");
            }
        }
        // A clock of whole ms at 700 Hz loses nothing, nor do bursts whose steps are whole multiples.
        let coarse = found(&stamps(700.0, 1_000_000, 2000)).unwrap();
        assert!(!coarse.is_even && (coarse.period_ns * 700.0 / 1e9 - 1.0).abs() < 1e-3, "{coarse:?}");
        let burst = |row: u64| (row / 3 * 8 + row % 3) * 125_000;
        let bursts = found(&(0..2000).map(burst).collect::<Vec<_>>()).unwrap();
        assert!(!bursts.is_even && (bursts.period_ns * 3.0 / 1e6 - 1.0).abs() < 2e-3, "{bursts:?}");
    }

    #[test]
    fn a_wrong_interval_is_told_from_jitter() {
        // Twice as long, and as the rounding of a rate that is no whole number makes it.
        assert_eq!(other_mean(&stamps(200.0, 1, 10), 10_000_000), Some(5e6));
        for unit in [1, 1000, 1_000_000] {
            let mean = other_mean(&stamps(416.4, unit, 20_000), 2_403_846).unwrap();
            assert!((mean * 416.4 / 1e9 - 1.0).abs() < 1e-4, "{unit}: {mean}");
            assert_eq!(other_mean(&stamps(416.0, unit, 20_000), 2_403_846), None, "{unit}");
        }
        // 50 ppm do not count; nor do 2 steps, nor gaps.
        assert_eq!(other_mean(&stamps(200.01, 1, 1000), 5_000_000), None);
        assert_eq!(other_mean(&[0, 5, 10], 10), None);
        assert_eq!(other_mean(&[0, 10, 20, 60, 70, 110], 10), None);
        // Coarse stamps of which a fifth is lost.
        let mut lost = stamps(416.0, 1_000_000, 20_000);
        lost.retain(|time| uniform(*time) > 0.2);
        assert_eq!(other_mean(&lost, 2_403_846), None);
        // Rows whose sampling jitters by up to 20 %, so that the mean of 20 steps differs by chance.
        let mut time = 0;
        let times: Vec<_> = (0..20_u64)
            .map(|row| {
                time += 9_000_000 + row * 7_919_000 % 2_100_000;
                time
            })
            .collect();
        let mean = (times[19] - times[0]) as f64 / 19.0;
        assert!((mean / 1e7 - 1.0).abs() > 1e-4 && other_mean(&times, 10_000_000).is_none(), "{mean}");
    }
}
