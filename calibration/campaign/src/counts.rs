//! What the counts of a recording show before anything is fitted: full and wrapped counters, zeros, exchanged bytes, a
//! dead axis. None of it is movement.

use crate::net::{net, steps};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::{AXES, RawSample};
use isotherm_statistics::{greatest_divisor, median};
use isotherm_support::finding::{Finding, name};
use std::ops::Range;

/// Rows of a block, where there are no static poses.
const BLOCK_ROWS: usize = 10;
/// Two attitudes differ by more than this part of the specific force.
const OTHER_ATTITUDE: f64 = 0.05;
/// Blocks of this many rows, and as many of them, are enough for an axis that sits at its extreme …
const REST_ROWS: usize = 20;
const REST_BLOCKS: usize = 3;
/// … while the others scatter as in the static poses, up to this factor.
const ALIKE: f64 = 3.0;
/// A counter that wraps steps by more than this part of its range …
const WRAP: f64 = 0.95;
/// … and than so many usual changes, since noise of a few counts does the same …
const WRAP_CHANGES: f64 = 30.0;
/// … there and back within so many rows, none of them longer than this \[ns\], as often as …
const WRAP_ROWS: usize = 5;
const WRAP_INTERVAL_NS: u64 = 100_000_000;
/// … this.
const WRAPS: usize = 3;
/// Share of the rows that are missing before it is a cause.
const MOST_MISSING: f64 = 0.1;
/// Rows change by so many times less where the bytes are put right.
const SMOOTHER: f64 = 16.0;

/// What is wrong with the counts of the accelerometers. `poses` are the rows at rest; without them, blocks of ten
/// rows are looked at.
#[must_use]
pub fn faults(rows: &[RawSample], poses: &[Range<usize>]) -> Vec<Finding> {
    let counts: Vec<[f64; AXES]> = rows.iter().map(|row| [0, 1, 2].map(|axis| net(row, axis))).collect();
    if counts.is_empty() {
        return Vec::new();
    }
    let blocks: Vec<Range<usize>> = match poses.is_empty() {
        true => (0..counts.len() / BLOCK_ROWS).map(|block| block * BLOCK_ROWS..(block + 1) * BLOCK_ROWS).collect(),
        false => poses.to_vec(),
    };
    let dead = |axis: usize| counts.iter().all(|row| row[axis] == 0.0);
    let mut found: Vec<Finding> = (0..AXES).filter(|axis| dead(*axis)).map(no_pulses).collect();
    found.extend(swapped(&counts));
    let steps = steps(rows);
    let full = |axis: usize| full(&counts, &blocks, steps, axis).or_else(|| stuck(&counts, poses, steps, axis));
    found.extend((0..AXES).filter_map(full));
    found.extend((0..AXES).filter_map(|axis| wraps(rows, &counts, axis)));
    found.extend(zeros(&counts));
    found
}

fn no_pulses(axis: usize) -> Finding {
    let message = format!("{} gives no pulses in any row; look at its columns and its converter", AXIS_NAMES[axis]);
    Finding::fault(name::NO_PULSES, message)
}

/// Rows in which all axes are 0 at once, which no attitude gives.
fn zeros(counts: &[[f64; AXES]]) -> Option<Finding> {
    let zeros = counts.iter().filter(|row| is_zero(row)).count();
    (0 < zeros && zeros < counts.len()).then(|| {
        let message = format!(
            "all accelerometers are 0 at once in {zeros} rows, {:.1} %: values that were lost",
            100.0 * zeros as f64 / counts.len() as f64
        );
        Finding::warning(name::ZEROS, message)
    })
}

fn is_zero(row: &[f64; AXES]) -> bool {
    *row == [0.0; AXES]
}

/// An axis whose extreme value is that of most rows in two attitudes, while the noise of the other axes is over a step.
fn full(counts: &[[f64; AXES]], blocks: &[Range<usize>], steps: [f64; AXES], axis: usize) -> Option<Finding> {
    let values = || counts.iter().filter(|row| !is_zero(row)).map(|row| row[axis]);
    let others = [(axis + 1) % AXES, (axis + 2) % AXES];
    let of_block = |block: &Range<usize>| others.map(|other| mean_and_scatter(&counts[block.clone()], other));
    let noisy = |k: usize| median(blocks.iter().map(|block| of_block(block)[k][1])) >= steps[others[k]];
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)));
    if low >= high || !noisy(0) || !noisy(1) {
        return None;
    }
    let extreme = [high, low].into_iter().find(|extreme| {
        let at = |block: &&Range<usize>| {
            2 * counts[(*block).clone()].iter().filter(|row| row[axis] == *extreme).count() > block.len()
        };
        let means: Vec<_> = blocks.iter().filter(at).map(|block| of_block(block).map(|[mean, _]| mean)).collect();
        let apart = |mean: &[f64; 2]| libm::hypot(mean[0] - means[0][0], mean[1] - means[0][1]);
        means.iter().any(|mean| apart(mean) > OTHER_ATTITUDE * extreme.abs())
    })?;
    let share = values().filter(|value| *value == extreme).count() as f64 / counts.len() as f64;
    let message = format!(
        "{} sits at {extreme} counts in {:.0} % of the rows, in more than one attitude: saturated; record with a wider range",
        AXIS_NAMES[axis],
        100.0 * share
    );
    Some(Finding::fault(name::SATURATED, message))
}

/// An axis that is the extreme value in most rows of a rest, and scatters in others. At rest the other axes scatter as
/// in the static poses: a full axis makes static poses that are quieter than all others, or none.
fn stuck(counts: &[[f64; AXES]], poses: &[Range<usize>], steps: [f64; AXES], axis: usize) -> Option<Finding> {
    let scatter = |rows: &Range<usize>, axis: usize| mean_and_scatter(&counts[rows.clone()], axis)[1];
    let others = [(axis + 1) % AXES, (axis + 2) % AXES];
    let usual = others.map(|other| median(poses.iter().map(|rows| scatter(rows, other))));
    let rests = |rows: &Range<usize>| {
        let alike = |k: usize| (usual[k] / ALIKE..usual[k] * ALIKE).contains(&scatter(rows, others[k]));
        alike(0) && alike(1)
    };
    let blocks = (0..counts.len() / REST_ROWS).map(|block| block * REST_ROWS..(block + 1) * REST_ROWS);
    let blocks: Vec<_> = blocks.filter(rests).collect();
    let values = || counts.iter().map(|row| row[axis]);
    let extremes = [values().fold(f64::NEG_INFINITY, f64::max), values().fold(f64::INFINITY, f64::min)];
    extremes.into_iter().find_map(|extreme| {
        let sits = |rows: &&Range<usize>| {
            2 * counts[(*rows).clone()].iter().filter(|row| row[axis] == extreme).count() > REST_ROWS
        };
        let (full, free): (Vec<_>, Vec<_>) = blocks.iter().partition(sits);
        let scatters = median(free.into_iter().map(|rows| scatter(rows, axis))) >= steps[axis];
        (full.len() >= REST_BLOCKS && scatters).then(|| {
            let message = format!(
                "{} sits at {extreme} counts in {:.0} % of the rows at rest: saturated; record with a wider range",
                AXIS_NAMES[axis],
                100.0 * full.len() as f64 / blocks.len() as f64
            );
            Finding::fault(name::SATURATED, message)
        })
    })
}

/// Mean and standard deviation.
fn mean_and_scatter(rows: &[[f64; AXES]], axis: usize) -> [f64; 2] {
    let n = rows.len().max(1) as f64;
    let mean = rows.iter().map(|row| row[axis]).sum::<f64>() / n;
    [mean, (rows.iter().map(|row| (row[axis] - mean).powi(2)).sum::<f64>() / n).sqrt()]
}

/// A counter that wraps, or signed counts that were read as unsigned.
fn wraps(rows: &[RawSample], counts: &[[f64; AXES]], axis: usize) -> Option<Finding> {
    let kept: Vec<usize> = (0..counts.len()).filter(|row| !is_zero(&counts[*row])).collect();
    let values = || kept.iter().map(|row| counts[*row][axis]);
    let range = values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min);
    let step = |at: usize| counts[kept[at]][axis] - counts[kept[at - 1]][axis];
    let short = |at: usize| rows[kept[at]].interval_ns <= WRAP_INTERVAL_NS;
    let changes = (1..kept.len()).map(|at| step(at).abs()).filter(|change| *change > 0.0);
    if range <= WRAP_CHANGES * median(changes) {
        return None;
    }
    let (mut times, mut previous): (usize, Option<usize>) = (0, None);
    for at in (1..kept.len()).filter(|at| step(*at).abs() > WRAP * range && short(*at)) {
        let back = |before: usize| at - before <= WRAP_ROWS && step(before) * step(at) < 0.0;
        times += usize::from(previous.is_some_and(back));
        previous = Some(at);
    }
    (times >= WRAPS).then(|| {
        let message = format!(
            "{} jumps by {range} counts, its whole range, and back {times} times within {WRAP_ROWS} rows: its counts \
             wrap, or signed counts were read as unsigned; record with a wider range, or convert again",
            AXIS_NAMES[axis]
        );
        Finding::fault(name::WRAPPED, message)
    })
}

/// Counts of 16 bits whose two bytes are exchanged: put right, all axes change far less from row to row.
fn swapped(counts: &[[f64; AXES]]) -> Option<Finding> {
    let unit = counts.iter().flatten().fold(0, |unit, count| greatest_divisor(unit, count.abs() as u64)).max(1) as f64;
    let bits = |count: f64| {
        Some(count / unit).filter(|count| (-32_768.0..65_536.0).contains(count)).map(|it| it as i32 as u16)
    };
    let change = |axis: usize, value: &dyn Fn(u16) -> u16| {
        let values: Option<Vec<u16>> = counts.iter().map(|row| bits(row[axis])).collect();
        let signed: Vec<f64> = values?.into_iter().map(|count| f64::from(value(count) as i16)).collect();
        let changes = signed.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|change| *change > 0.0);
        Some(median(changes)).filter(|change| change.is_finite())
    };
    let axes: Vec<[f64; 2]> = (0..AXES)
        .map(|axis| Some([change(axis, &|count| count)?, change(axis, &u16::swap_bytes)?]))
        .collect::<Option<_>>()?;
    let worst = axes.iter().all(|[now, right]| *now > SMOOTHER * right).then(|| axes[0])?;
    let message = format!(
        "the rows of A1 usually change by {:.0} counts, with the two bytes of each count exchanged by {:.0}: the \
         order of the bytes is wrong; convert again",
        worst[0] * unit,
        worst[1] * unit
    );
    Some(Finding::fault(name::BYTE_ORDER, message))
}

/// Why no static pose was found, as far as the counts and times show it; empty if they do not.
pub(crate) fn cause(rows: &[RawSample]) -> String {
    let mut causes: Vec<String> = faults(rows, &[]).into_iter().map(|finding| finding.message).collect();
    let missing = missing(rows);
    if missing > MOST_MISSING {
        causes.push(format!("{:.0} % of the rows are missing", 100.0 * missing));
    }
    if causes.is_empty() { String::new() } else { causes.join("; ") + "; so " }
}

/// Share of the rows that are missing: of the time within sessions, what is not in the usual intervals.
fn missing(rows: &[RawSample]) -> f64 {
    let interval_ns = median(rows.iter().map(|row| row.interval_ns as f64)).max(1.0);
    let passed = |pair: &[RawSample]| match pair[0].session == pair[1].session {
        true => (pair[1].timestamp_ns.saturating_sub(pair[0].timestamp_ns) as f64 / interval_ns).round(),
        false => 1.0,
    };
    let should = 1.0 + rows.windows(2).map(passed).sum::<f64>();
    (1.0 - rows.len() as f64 / should).max(0.0)
}
