//! Checks of a campaign: every position at every set point, soak, stillness, saturation, plausible telemetry.
//!
//! A finding that would spoil the table is a fault. A finding that the user should know is a warning. Both name line, set
//! point and position.
//!
//! Over 400 lines: one check after another on the same dwells, most of the text being messages.

use crate::campaign::{Block, Campaign, Dwell, range};
use crate::diagnostics::{median, robust_sd};
use crate::reduce::reduce;
use core::fmt;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;

/// If the campaign states no soak, a shorter time between two set points gives a warning \[s\].
const USUAL_SOAK: f64 = 3600.0;
/// Largest difference between the specific force of a position and the indicated one, with mean scale factors \[g0\]. A
/// scale factor may change by some percent over temperature; a wrong position differs by more.
const WRONG_POSITION: f64 = 0.1;
/// Motion within a dwell by more than this is a fault. The dwells of a set point are consistent if their residual standard
/// deviation is below this \[g0\].
const MOVED: f64 = 0.02;
/// Limit of the difference between a block and its dwell's median, in robust standard deviations of the dwell's blocks.
const STILL: f64 = 10.0;
/// Constant part of that limit \[g0\].
const STILL_FLOOR: f64 = 5e-6;
/// Within a dwell, telemetry that changes by more than this part of the step between set points is a fault.
const DWELL_DRIFT: f64 = 0.5;
/// Over a set point, a change by more than this part of the step gives a warning.
const SET_POINT_DRIFT: f64 = 0.1;

/// Largest relative difference between the sum of the intervals and the elapsed time.
const CLOCK_TOLERANCE: f64 = 0.01;
/// A dwell shorter than this part of the median counts as cut short.
const SHORT_DWELL: f64 = 0.6;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Severity {
    /// No table is made.
    Fault,
    /// The table is made; the user should look at the message.
    Warning,
}

/// A fault or a warning about the campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Line of the samples, if the finding concerns one.
    pub line: Option<u64>,
    /// Set point \[degC\] and number of the position, if the finding concerns one.
    pub place: Option<(f64, Option<u32>)>,
    /// The cause and the remedy.
    pub message: String,
}

impl Finding {
    /// The finding as text, with file and line in front if it has a line. `locate` gives file and line of a row.
    #[must_use]
    pub fn located(&self, locate: impl Fn(u64) -> String) -> String {
        match self.line {
            Some(line) => format!("{}: {self}", locate(line)),
            None => self.to_string(),
        }
    }
}

/// `set point 5 degC, position 3: message`, without the line.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place {
            Some((set_point, Some(position))) => write!(f, "set point {set_point} degC, position {position}: ")?,
            Some((set_point, None)) => write!(f, "set point {set_point} degC: ")?,
            None => {}
        }
        f.write_str(&self.message)
    }
}

/// The dwells of a set point, see [`set_points`]. They share errors, such as hysteresis.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPoint {
    /// Temperature that the chamber was set to \[degC\].
    pub set_point_c: f64,
    /// Indices of the dwells.
    pub dwells: Vec<usize>,
}

/// Groups dwells into set points. If every visit of a set point has more than half of the `positions`, each visit is a set
/// point of its own. Otherwise all visits of the same value are one set point.
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

/// Runs all checks; faults come first. `excluded` are the dwells that the user left out: set point \[degC\] and number of
/// the position.
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
        if set_points.len() < 2 {
            let message = format!("{} set point; a temperature calibration needs at least 2", set_points.len());
            self.findings.push(Finding { severity: Severity::Fault, line: None, place: None, message });
        } else {
            self.telemetry(set_points);
        }
        self.saturation();
        self.forces(set_points);
        self.still();
        self.findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
        self.findings
    }

    fn report_dwell(&mut self, severity: Severity, dwell: usize, line: u64, message: String) {
        let dwell = &self.dwells[dwell];
        let place = Some((dwell.set_point_c, Some(self.campaign.positions[dwell.position].number)));
        self.findings.push(Finding { severity, line: Some(line), place, message });
    }

    fn report_set_point(&mut self, severity: Severity, set_point_c: f64, line: Option<u64>, message: String) {
        self.findings.push(Finding { severity, line, place: Some((set_point_c, None)), message });
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
                let message = format!(
                    "position {} of the campaign file is missing; measure it, or leave it out knowingly with --exclude {}/{}",
                    missing.join(", "),
                    set_point.set_point_c,
                    missing[0]
                );
                self.report_set_point(Severity::Fault, set_point.set_point_c, line, message);
            }
        }
    }

    /// The time between the last row of a set point and the first row of the next.
    fn soak(&mut self) {
        let (limit, severity) = match self.campaign.soak_s {
            Some(stated) => (stated, Severity::Fault),
            None => (USUAL_SOAK, Severity::Warning),
        };
        for index in 1..self.dwells.len() {
            let (before, after) = (&self.dwells[index - 1], &self.dwells[index]);
            let gap = after.time_ns[0].saturating_sub(before.time_ns[1]) as f64 / 1e9;
            if before.set_point_c != after.set_point_c && gap < limit {
                let stated = if self.campaign.soak_s.is_some() { "the campaign file asks for" } else { "usual are" };
                let message = format!(
                    "its first dwell begins {gap:.0} s after the set point before; {stated} {limit:.0} s of soak"
                );
                self.report_set_point(severity, after.set_point_c, Some(after.lines[0]), message);
            }
        }
    }

    /// The sum of the intervals against the elapsed time, and dwells that are cut short.
    fn time(&mut self) {
        let elapsed = |dwell: &Dwell| dwell.time_ns[1].saturating_sub(dwell.time_ns[0]) as f64 / 1e9;
        let ratio = median(self.dwells.iter().map(|dwell| dwell.sums.seconds / elapsed(dwell)));
        let line = self.dwells.first().map(|dwell| dwell.lines[0]);
        if !(1.0 - CLOCK_TOLERANCE..=1.0 + CLOCK_TOLERANCE).contains(&ratio) {
            let (severity, cause) = if ratio > 1.0 {
                (Severity::Fault, "pulses are counted twice, or interval_ns is not in ns")
            } else {
                (
                    Severity::Warning,
                    "rows are missing, or interval_ns is not the time that was counted, and every scale factor is wrong by as much",
                )
            };
            let message = format!("the intervals add up to {ratio:.4} of the time that passed: {cause}");
            self.findings.push(Finding { severity, line, place: None, message });
        }
        let usual = median(self.dwells.iter().map(|dwell| dwell.sums.seconds));
        for dwell in 0..self.dwells.len() {
            let (seconds, lines) = (self.dwells[dwell].sums.seconds, self.dwells[dwell].lines);
            if seconds < SHORT_DWELL * usual {
                let message = format!("{seconds:.1} s only, others have {usual:.1} s; is the file cut?");
                self.report_dwell(Severity::Warning, dwell, lines[1], message);
            }
        }
    }

    /// Sensors that do not react, dwells and set points that were not settled, set points that were not reached.
    fn telemetry(&mut self, set_points: &[SetPoint]) {
        type TelemetryRanges = fn(&Block) -> &[[f64; 2]; AXES];
        let sensors: [(&str, TelemetryRanges); 2] = [("head", |block| &block.head), ("board", |block| &block.board)];
        for axis in 0..AXES {
            for (name, of) in sensors {
                let of_dwell = |dwell: &Dwell| range(dwell.blocks.iter().map(|block| of(block)[axis]));
                let middle = |dwell: &Dwell| {
                    median(dwell.blocks.iter().map(|block| {
                        let [low, high] = of(block)[axis];
                        0.5 * (low + high)
                    }))
                };
                let means: Vec<f64> = set_points
                    .iter()
                    .map(|set_point| median(set_point.dwells.iter().map(|&dwell| middle(&self.dwells[dwell]))))
                    .collect();
                let mut steps = means.clone();
                steps.sort_by(f64::total_cmp);
                let step = median(steps.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
                let column = format!("a{}_{name}", axis + 1);
                if step.is_nan() {
                    let message = format!("{column} is the same at every set point; is the sensor connected?");
                    self.findings.push(Finding { severity: Severity::Fault, line: None, place: None, message });
                    continue;
                }
                // A sensor whose reading is exactly the same in two dwells at different set points does not work.
                let constant =
                    |dwell: &Dwell| Some(of_dwell(dwell)).filter(|[low, high]| low == high).map(|[low, _]| low);
                let stuck = (1..self.dwells.len()).find(|&dwell| {
                    let (before, after) = (&self.dwells[dwell - 1], &self.dwells[dwell]);
                    before.set_point_c != after.set_point_c
                        && constant(before).is_some()
                        && constant(before) == constant(after)
                });
                if let Some(dwell) = stuck {
                    let line = self.dwells[dwell].lines[0];
                    let message = format!(
                        "{column} does not move from the set point before in any digit; is the sensor connected?"
                    );
                    self.report_dwell(Severity::Fault, dwell, line, message);
                    continue;
                }
                for dwell in 0..self.dwells.len() {
                    let [low, high] = of_dwell(&self.dwells[dwell]);
                    if high - low > DWELL_DRIFT * step {
                        let usual = middle(&self.dwells[dwell]);
                        let is_off = |block: &&Block| {
                            let [low, high] = of(block)[axis];
                            (low - usual).abs().max((high - usual).abs()) > 0.5 * DWELL_DRIFT * step
                        };
                        let line = self.dwells[dwell]
                            .blocks
                            .iter()
                            .find(is_off)
                            .map_or(self.dwells[dwell].lines[0], |b| b.line);
                        let message = format!(
                            "{column} runs from {low} to {high} within the dwell, while set points are {step:.3} apart: a broken \
                             reading, or a temperature that was not settled; mend the rows or leave the dwell out with --exclude"
                        );
                        self.report_dwell(Severity::Fault, dwell, line, message);
                    }
                }
                for (set_point, mean) in set_points.iter().zip(&means) {
                    let [low, high] = range(set_point.dwells.iter().map(|&dwell| [middle(&self.dwells[dwell]); 2]));
                    if high - low > SET_POINT_DRIFT * step {
                        let line = set_point.dwells.first().map(|&dwell| self.dwells[dwell].lines[0]);
                        let message = format!(
                            "{column} moves from {low:.4} to {high:.4} while the set point is measured: the soak was too short"
                        );
                        self.report_set_point(Severity::Warning, set_point.set_point_c, line, message);
                    }
                    // If two different set points have the same telemetry, one of them was not reached.
                    let other = set_points.iter().zip(&means).find(|(other, value)| {
                        other.set_point_c < set_point.set_point_c && (*value - mean).abs() < 0.1 * step
                    });
                    if let Some((other, _)) = other {
                        let message = format!(
                            "{column} reads as at {} degC ({mean:.4}); was the set point reached?",
                            other.set_point_c
                        );
                        self.report_set_point(Severity::Warning, set_point.set_point_c, None, message);
                    }
                }
            }
        }
    }

    /// Rates at the campaign's `max_rate`, and converters that are full.
    fn saturation(&mut self) {
        self.plateaus();
        let Some(limit) = self.campaign.max_rate else { return };
        for dwell in 0..self.dwells.len() {
            for (axis, name) in AXIS_NAMES.iter().enumerate() {
                let full = self.dwells[dwell].blocks.iter().find(|block| block.rate[axis] >= limit);
                if let Some((line, rate)) = full.map(|block| (block.line, block.rate[axis])) {
                    let message = format!("{name} counts {rate:.0} pulse/s, max_rate is {limit:.0}: saturated");
                    self.report_dwell(Severity::Fault, dwell, line, message);
                }
            }
        }
    }

    /// Finds saturated converters: they give the same count in every row, at different set points.
    fn plateaus(&mut self) {
        for (axis, name) in AXIS_NAMES.iter().enumerate() {
            for (channel, sign) in ["+", "-"].iter().enumerate() {
                let rate = |block: &Block| block.sums.rates(axis)[channel];
                let flat = |dwell: &Dwell| {
                    let first = dwell.blocks.first().map(rate)?;
                    (first > 0.0 && dwell.blocks.len() > 2 && dwell.blocks.iter().all(|block| rate(block) == first))
                        .then_some(first)
                };
                let full: Vec<_> = (0..self.dwells.len()).filter_map(|d| Some((d, flat(&self.dwells[d])?))).collect();
                let most = full.iter().map(|(_, rate)| *rate).fold(0.0, f64::max);
                let mut full = full.iter().filter(|(_, rate)| *rate == most).map(|(dwell, _)| *dwell);
                let (first, last) = (full.next(), full.next_back());
                if let (Some(first), Some(last)) = (first, last)
                    && self.dwells[first].set_point_c != self.dwells[last].set_point_c
                    && most > 1000.0
                {
                    let message = format!(
                        "the {sign} channel of {name} gives the same {most:.0} pulse/s in every row, here and at {} degC: is it saturated?",
                        self.dwells[last].set_point_c
                    );
                    self.report_dwell(Severity::Warning, first, self.dwells[first].lines[0], message);
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

    /// Whether the dwells of a set point agree with each other and give scale factors of the right sign.
    fn is_consistent(&self, set_point: &SetPoint, axis: usize) -> bool {
        let dwells: Vec<_> = set_point.dwells.iter().map(|&dwell| &self.dwells[dwell]).collect();
        reduce(self.campaign, &dwells, axis, None).is_some_and(|reduced| {
            let [_, k_plus, k_minus, ..] = reduced.values;
            // The residual is NaN if there are as many dwells as parameters.
            (reduced.residual_sd < MOVED || reduced.residual_sd.is_nan()) && k_plus > 0.0 && k_minus < 0.0
        })
    }

    /// The indicated specific force against the one of the position.
    fn forces(&mut self, set_points: &[SetPoint]) {
        let gravity = self.campaign.gravity_local / self.campaign.gravity_reference;
        for (axis, name) in AXIS_NAMES.iter().enumerate() {
            let [up, down] = self.nominal(axis);
            for (k, side, sign) in [(up, "up", "+"), (down, "down", "-")] {
                if k.is_nan() || k <= 1.0 {
                    let message = if k.is_nan() {
                        format!("no dwell is left in which {name} points {side}")
                    } else {
                        format!(
                            "{name} gives no pulses on its {sign} channel in the positions where it points {side}; are the channels or the \
                         signs of the specific force exchanged?"
                        )
                    };
                    self.findings.push(Finding { severity: Severity::Fault, line: None, place: None, message });
                }
            }
            if [up, down].iter().any(|k| k.is_nan() || *k <= 1.0) {
                continue;
            }
            // A large bias shifts all readings by the same amount; the dwells of each set point are then still consistent.
            if set_points.iter().all(|set_point| self.is_consistent(set_point, axis)) {
                continue;
            }
            for dwell in 0..self.dwells.len() {
                let asked = self.campaign.positions[self.dwells[dwell].position].specific_force[axis] * gravity;
                let [positive, negative] = self.dwells[dwell].sums.rates(axis);
                let indicated = (positive / up - negative / down) * gravity;
                if (indicated - asked).abs() > WRONG_POSITION {
                    let message = format!(
                        "{name} indicates {indicated:.3} g0 where the position asks for {asked:.3}: another position, or the table moved; \
                         mend the rows or leave the dwell out with --exclude"
                    );
                    self.report_dwell(Severity::Fault, dwell, self.dwells[dwell].lines[0], message);
                }
            }
        }
    }

    /// Whether all blocks of a dwell agree.
    fn still(&mut self) {
        for (axis, name) in AXIS_NAMES.iter().enumerate() {
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
                // Pulses are whole numbers: a difference of up to four is no motion.
                let pulse = 4.0 / (up.min(down) * median(blocks.iter().map(|block| block.sums.seconds)));
                let limit = STILL * robust_sd(&off) + STILL_FLOOR + pulse;
                let worst = (0..off.len()).max_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs()));
                if let Some(worst) = worst.filter(|&worst| off[worst].abs() > limit) {
                    let line = blocks[worst].line;
                    let severity = if off[worst].abs() > MOVED { Severity::Fault } else { Severity::Warning };
                    let message = format!(
                        "{} was not still: {:.1}e-6 g0 off the rest of the dwell from this row on; leave the rows or the dwell out",
                        name,
                        off[worst] * 1e6
                    );
                    self.report_dwell(severity, dwell, line, message);
                }
            }
        }
    }
}
