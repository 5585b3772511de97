//! Checks of a campaign: every position at every set point, soak, stillness, saturation, plausible temperature.
//!
//! A finding that would spoil the table, or that no true data can show, is a fault. A finding that the user should know
//! is a warning. Both have a name ([`name`]), and name line, set point and position.
//!
//! Over 400 lines: one check after another on the same dwells, most of the text being messages.

mod counts;
pub(crate) mod scale;
pub(crate) mod temperature;
pub(crate) mod time;
pub(crate) mod wraps;

use crate::reduce::reduce;
use isotherm_campaign::{Block, Campaign, Dwell, FilePattern, SampleLayout};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::{greatest_divisor, median, robust_sd};
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};

/// Largest difference between the specific force of a position and the indicated one, with mean scale factors \[g0\]. A
/// scale factor may change by some percent over temperature; a wrong position differs by more.
const WRONG_POSITION: f64 = 0.1;
/// Motion within a dwell by more than this is a fault. The dwells of a set point are consistent if their residual
/// standard deviation is below this \[g0\].
const MOVED: f64 = 0.02;
/// Limit of the difference between a block and its dwell's median, in robust standard deviations of the dwell's blocks.
const STILL: f64 = 10.0;
/// Constant part of that limit \[g0\].
const STILL_FLOOR: f64 = 5e-6;
/// A converter whose rate is the same in every block is saturated if it is so in dwells of this many pulses at two set
/// points: noise and temperature of a working one show in the last digits, but 1e-6 can be less than they do near an
/// extremum of K.
const EXACT_PULSES: f64 = 1e6;
/// A few blocks may be the same by chance; it takes this many of a channel's largest rate.
const FULL_BLOCKS: usize = 20;
/// More values than these have a divisor in common only if they are read in steps of it.
const MANY_VALUES: usize = 8;
/// Rates of the same pulses in the same time, summed over different numbers of rows, differ by less.
const ROUNDING: f64 = 1e-9;

/// The temperature of one sensor.
struct Column {
    /// `a1_head`.
    name: String,
    /// Set point \[degC\] and mean temperature of each set point.
    means: Vec<(f64, f64)>,
    /// Where set points are not further apart than noise and digits: the usual step from set point to set point, the
    /// usual change within a dwell, and the last digit.
    coarse: Option<[f64; 3]>,
}

/// Each value of the set points \[degC\], rising, with the larger step of the temperature to its neighbours. A
/// thermistor's steps differ by orders of magnitude from one end to the other.
struct Steps(Vec<(f64, f64)>);

impl Steps {
    /// The steps of a column with these set points and means.
    fn of(means: &[(f64, f64)]) -> Self {
        let mut values: Vec<f64> = means.iter().map(|(set_point, _)| *set_point).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        let mean =
            |value: &f64| median(means.iter().filter(|(set_point, _)| set_point == value).map(|(_, mean)| *mean));
        let temperature: Vec<f64> = values.iter().map(mean).collect();
        let steps: Vec<f64> = temperature.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
        let larger = |index: usize| {
            let below = index.checked_sub(1).and_then(|below| steps.get(below));
            below.into_iter().chain(steps.get(index)).copied().fold(0.0, f64::max)
        };
        Self(values.iter().enumerate().map(|(index, value)| (*value, larger(index))).collect())
    }

    /// The step at a set point.
    fn at(&self, set_point_c: f64) -> f64 {
        self.0.iter().find(|(value, _)| *value == set_point_c).map_or(f64::NAN, |(_, step)| *step)
    }
}

/// The step of temperature: the smallest difference between two different values, or what all are multiples of, in the
/// last decimal that any of them has.
fn last_digit(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.dedup();
    let smallest = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let is_whole = |value: f64| (value - value.round()).abs() < 1e-3;
    let ten = (0..9).map(|places| 10_f64.powi(places)).find(|ten| values.iter().all(|value| is_whole(value * ten)));
    let decimal = ten.map_or(f64::INFINITY, |ten| {
        let multiples = values.iter().map(|value| (value * ten).round().abs() as u64);
        let common = if values.len() > MANY_VALUES { multiples.fold(0, greatest_divisor) } else { 1 };
        common.max(1) as f64 / ten
    });
    // A difference of decimals is not exact.
    if smallest < 0.99 * decimal { smallest } else { decimal }
}

/// The dwells of a set point, see [`set_points`]. They share errors, such as hysteresis.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPoint {
    /// Temperature that the chamber was set to \[degC\].
    pub set_point_c: f64,
    /// Indices of the dwells.
    pub dwells: Vec<usize>,
}

/// Groups dwells into set points. If every visit of a set point has more than half of the `positions`, each visit is a
/// set point of its own. Otherwise, all visits of the same value are one set point.
#[must_use]
pub fn set_points(dwells: &[Dwell], positions: usize) -> Vec<SetPoint> {
    let mut visits: Vec<SetPoint> = Vec::new();
    for (index, dwell) in dwells.iter().enumerate() {
        match visits.last_mut() {
            Some(visit) if visit.set_point_c == dwell.set_point_c => visit.dwells.push(index),
            _ => visits.push(SetPoint { set_point_c: dwell.set_point_c, dwells: vec![index] }),
        }
    }
    // A visit may lack some positions. A campaign that runs all set points in each position has one position a visit.
    let complete = |visit: &SetPoint| 2 * distinct(dwells, visit) > positions;
    if visits.iter().all(complete) {
        return visits;
    }
    let mut values: Vec<SetPoint> = Vec::new();
    for visit in visits {
        match values.iter_mut().find(|value| value.set_point_c == visit.set_point_c) {
            Some(value) => value.dwells.extend(visit.dwells),
            None => values.push(visit),
        }
    }
    values
}

/// Number of distinct positions.
fn distinct(dwells: &[Dwell], set_point: &SetPoint) -> usize {
    let mut positions: Vec<_> = set_point.dwells.iter().map(|&index| dwells[index].position).collect();
    positions.sort_unstable();
    positions.dedup();
    positions.len()
}

/// Runs all checks; faults come first. `excluded` are the dwells that the user left out: set point \[degC\] and number
/// of the position.
#[must_use]
pub fn check(campaign: &Campaign, dwells: &[Dwell], set_points: &[SetPoint], excluded: &[(f64, u32)]) -> Vec<Finding> {
    let checker = Checker { campaign, dwells, findings: Vec::new() };
    checker.run(set_points, excluded)
}

struct Checker<'a> {
    campaign: &'a Campaign,
    dwells: &'a [Dwell],
    findings: Vec<Finding>,
}

impl Checker<'_> {
    fn run(mut self, set_points: &[SetPoint], excluded: &[(f64, u32)]) -> Vec<Finding> {
        self.positions(set_points, excluded);
        self.soak();
        self.time();
        self.motion(set_points);
        if set_points.len() < 2 {
            let message = format!("{} set point; a temperature calibration needs at least 2", set_points.len());
            self.findings.push(Finding::whole(Severity::Fault, name::SET_POINTS, message));
        } else {
            self.temperature(set_points);
        }
        self.saturation();
        self.nominal_scale_factor();
        self.forces(set_points);
        self.still();
        self.findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
        self.findings
    }

    fn report_dwell(&mut self, severity: Severity, name: &'static str, dwell: usize, line: u64, message: String) {
        let dwell = &self.dwells[dwell];
        let number = RunNumber::Position(self.campaign.positions[dwell.position].number);
        let place = Some(Location::SetPoint(dwell.set_point_c, Some(number)));
        self.findings.push(Finding { severity, name, line: Some(line), place, message });
    }

    fn report_set_point(
        &mut self,
        severity: Severity,
        name: &'static str,
        set_point_c: f64,
        line: Option<u64>,
        message: String,
    ) {
        self.findings.push(Finding {
            severity,
            name,
            line,
            place: Some(Location::SetPoint(set_point_c, None)),
            message,
        });
    }

    /// Whether every set point has every position of the campaign file.
    fn positions(&mut self, set_points: &[SetPoint], excluded: &[(f64, u32)]) {
        for set_point in set_points {
            let has = |index: usize| set_point.dwells.iter().any(|&dwell| self.dwells[dwell].position == index);
            let missing: Vec<_> = (0..self.campaign.positions.len())
                .filter(|&index| !has(index))
                .map(|index| self.campaign.positions[index].number)
                .filter(|number| !excluded.contains(&(set_point.set_point_c, *number)))
                .map(|number| number.to_string())
                .collect();
            if !missing.is_empty() {
                let line = set_point.dwells.last().map(|&dwell| self.dwells[dwell].lines[1]);
                let (noun, verb, it) =
                    if missing.len() == 1 { ("position", "is", "it") } else { ("positions", "are", "each") };
                let message = format!(
                    "{noun} {} of the campaign file {verb} missing{}; measure {it}, or leave {it} out knowingly with --exclude {}/{}",
                    missing.join(", "),
                    self.file_of(set_point.set_point_c, &missing[0]),
                    set_point.set_point_c,
                    missing[0]
                );
                self.report_set_point(Severity::Fault, name::MISSING_POSITION, set_point.set_point_c, line, message);
            }
        }
    }

    /// What the file of a position at a set point would be called, where positions have files.
    fn file_of(&self, set_point_c: f64, number: &str) -> String {
        let pattern = self.campaign.samples.first().filter(|_| self.campaign.layout != SampleLayout::Rows);
        let pattern = pattern.and_then(|pattern| FilePattern::new(pattern).ok());
        let name = pattern.zip(number.parse().ok()).map(|(pattern, number)| pattern.name(set_point_c, number));
        name.map_or_else(String::new, |name| format!(": no file is called {name}, with or without zeros in front"))
    }

    /// Rates at the campaign's `max_rate`, and converters that are full.
    fn saturation(&mut self) {
        self.plateaus();
        let Some(limit) = self.campaign.max_rate else { return };
        for dwell in 0..self.dwells.len() {
            for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
                let full = self.dwells[dwell].blocks.iter().find(|block| block.rate[axis] >= limit);
                if let Some((line, rate)) = full.map(|block| (block.line, block.rate[axis])) {
                    let message =
                        format!("{accelerometer} counts {rate:.0} pulse/s, max_rate is {limit:.0}: saturated");
                    self.report_dwell(Severity::Fault, name::SATURATED, dwell, line, message);
                }
            }
        }
    }

    /// Finds saturated converters: they give the same count in every row, at different set points, and never a larger
    /// one.
    fn plateaus(&mut self) {
        for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
            for (channel, sign) in ["+", "-"].iter().enumerate() {
                let rate = |block: &Block| block.sums.rates(axis)[channel];
                let most = self.dwells.iter().flat_map(|dwell| &dwell.blocks).map(rate).fold(0.0, f64::max);
                let is_full = |dwell: &usize| {
                    let blocks = &self.dwells[*dwell].blocks;
                    blocks.len() > 2 && blocks.iter().all(|block| rate(block) >= most * (1.0 - ROUNDING))
                };
                let full: Vec<usize> = (0..self.dwells.len()).filter(is_full).collect();
                let blocks: usize = full.iter().map(|dwell| self.dwells[*dwell].blocks.len()).sum();
                if let [first, .., last] = *full.as_slice()
                    && self.dwells[first].set_point_c != self.dwells[last].set_point_c
                    && most > 1000.0
                    && blocks >= FULL_BLOCKS
                {
                    let seconds = |dwell: usize| self.dwells[dwell].sums.seconds;
                    let exact = most * seconds(first).min(seconds(last)) > EXACT_PULSES;
                    let severity = if exact { Severity::Fault } else { Severity::Warning };
                    let message = format!(
                        "the {sign} channel of {accelerometer} gives the same {most:.0} pulse/s in every row, here and at {} degC, and never more: its converter \
                         is full; measure with a larger range, or leave out the set points where it is",
                        self.dwells[last].set_point_c
                    );
                    self.report_dwell(severity, name::SATURATED, first, self.dwells[first].lines[0], message);
                }
            }
        }
    }

    /// Approximate scale factors `[K+, -K-]`, from the positions that point up or down \[pulse/s per local gravity\].
    fn nominal(&self, axis: usize) -> [f64; 2] {
        let of = |sign: f64, channel: usize| {
            let forces = self.campaign.positions.iter().map(|position| position.specific_force[axis] * sign);
            let most = forces.fold(0.0, f64::max);
            median(self.dwells.iter().filter_map(|dwell| {
                let f = self.campaign.positions[dwell.position].specific_force[axis] * sign;
                (f > 0.6 * most).then(|| dwell.sums.rates(axis)[channel] / f)
            }))
        };
        [of(1.0, 0), of(-1.0, 1)]
    }

    /// K+ and K- of a set point, if its dwells agree with each other and give scale factors of the right sign.
    fn consistent(&self, set_point: &SetPoint, axis: usize) -> Option<[f64; 2]> {
        let dwells: Vec<_> = set_point.dwells.iter().map(|&dwell| &self.dwells[dwell]).collect();
        let reduced = reduce(self.campaign, &dwells, axis, None)?;
        let [_, k_plus, k_minus, ..] = reduced.values;
        // The residual is NaN if there are as many dwells as parameters.
        let agree = reduced.residual_sd < MOVED || reduced.residual_sd.is_nan();
        (agree && k_plus > 0.0 && k_minus < 0.0).then_some([k_plus, k_minus])
    }

    /// The indicated specific force against the one of the position, and the scale factors against each other.
    fn forces(&mut self, set_points: &[SetPoint]) {
        let gravity = self.campaign.gravity_local / self.campaign.gravity_reference;
        let mut scale_factors: [Option<[f64; 2]>; AXES] = [None; AXES];
        let multiples = self.multiples();
        for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
            let [up, down] = self.nominal(axis);
            let sides = [(up, "up", "+"), (down, "down", "-")];
            self.findings
                .extend(sides.into_iter().filter_map(|(k, side, sign)| no_pulses(accelerometer, k, side, sign)));
            if [up, down].iter().any(|k| k.is_nan() || *k <= 1.0) {
                continue;
            }
            // A large bias shifts all readings by the same amount; the dwells of each set point are then still
            // consistent.
            let found: Option<Vec<_>> = set_points.iter().map(|set_point| self.consistent(set_point, axis)).collect();
            if let Some(found) = found {
                scale_factors[axis] = Some([0, 1].map(|channel| median(found.iter().map(|k| k[channel].abs()))));
                continue;
            }
            self.wrong_positions(axis, [up, down], gravity, &multiples);
        }
        self.scale_factors(&scale_factors);
    }

    /// Dwells whose indicated specific force is not that of their position, with K+ and |K-| of the accelerometer.
    /// Nothing more is said of `multiples`.
    fn wrong_positions(&mut self, axis: usize, [up, down]: [f64; 2], gravity: f64, multiples: &[usize]) {
        let accelerometer = AXIS_NAMES[axis];
        for dwell in (0..self.dwells.len()).filter(|dwell| !multiples.contains(dwell)) {
            let asked = self.campaign.positions[self.dwells[dwell].position].specific_force[axis] * gravity;
            let [positive, negative] = self.dwells[dwell].sums.rates(axis);
            let indicated = (positive / up - negative / down) * gravity;
            if (indicated - asked).abs() > WRONG_POSITION {
                let message = format!(
                    "{accelerometer} indicates {indicated:.3} g0 where the position asks for {asked:.3}: another position, or the \
                     table moved; fix the rows or leave the dwell out with --exclude"
                );
                let line = self.dwells[dwell].lines[0];
                self.report_dwell(Severity::Fault, name::WRONG_POSITION, dwell, line, message);
            }
        }
    }

    /// Whether all blocks of a dwell agree.
    fn still(&mut self) {
        for (axis, accelerometer) in AXIS_NAMES.iter().enumerate() {
            let [up, down] = self.nominal(axis);
            for dwell in 0..self.dwells.len() {
                let blocks = &self.dwells[dwell].blocks;
                let indicated = |block: &Block| {
                    let [positive, negative] = block.sums.rates(axis);
                    positive / up - negative / down
                };
                let values: Vec<f64> = blocks.iter().map(indicated).collect();
                let middle = median(values.iter().copied());
                let off: Vec<f64> = values.iter().map(|value| value - middle).collect();
                // The last block may be of a few rows only, and has the more noise.
                let usual_s = median(blocks.iter().map(|block| block.sums.seconds));
                let noise = STILL * robust_sd(&off);
                let over = |&k: &usize| {
                    let seconds = blocks[k].sums.seconds;
                    // Pulses are whole numbers: a difference of up to four is no motion.
                    let limit =
                        noise * (usual_s / seconds).sqrt().max(1.0) + STILL_FLOOR + 4.0 / (up.min(down) * seconds);
                    off[k].abs() > limit
                };
                let worst = (0..off.len()).filter(over).max_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs()));
                if let Some(worst) = worst {
                    let line = blocks[worst].line;
                    let severity = if off[worst].abs() > MOVED { Severity::Fault } else { Severity::Warning };
                    let message = format!(
                        "{} was not still: {:.1}e-6 g0 off the rest of the dwell from this row on; leave the rows or the dwell out",
                        accelerometer,
                        off[worst] * 1e6
                    );
                    self.report_dwell(severity, name::NOT_STILL, dwell, line, message);
                }
            }
        }
    }
}

/// A fault if the scale factor `k` of one side shows that the channel gives no pulses there.
fn no_pulses(accelerometer: &str, k: f64, side: &str, sign: &str) -> Option<Finding> {
    let message = if k.is_nan() {
        format!("no dwell is left in which {accelerometer} points {side}")
    } else if k <= 1.0 {
        format!(
            "{accelerometer} gives no pulses on its {sign} channel in the positions where it points {side}; is the \
             channel dead, or are the channels or the signs of the specific force exchanged?"
        )
    } else {
        return None;
    };
    Some(Finding::fault(name::NO_PULSES, message))
}
