//! Whether a campaign can be used: every position at every set point, soaked, still, unsaturated, telemetry that can be.
//!
//! What would spoil the table is a fault; what a person should know is a warning. Both say line, set point and position.

use crate::campaign::{Block, Campaign, Dwell, range};
use crate::diagnostics::{median, robust_sd};
use crate::reduce::reduce;
use core::fmt;
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;

/// Set points that follow each other sooner are warned of, if the campaign states no soak \[s\].
const USUAL_SOAK: f64 = 3600.0;
/// Largest difference between what a position asks for and what is indicated with mean scale factors \[g0\]: a scale factor
/// may run by some percent over the temperatures, another position is farther off.
const WRONG_POSITION: f64 = 0.1;
/// A dwell in which the output moves by more is no dwell, and dwells that disagree by more are not where they should be \[g0\].
const MOVED: f64 = 0.02;
/// A block off its dwell's median by more than so many of the dwell's own standard deviations was not still.
const STILL: f64 = 10.0;
/// And by more than this \[g0\]; less does not matter.
const STILL_FLOOR: f64 = 5e-6;
/// Telemetry may move by this part of the distance between set points within one dwell.
const DWELL_DRIFT: f64 = 0.5;
/// And over a whole set point by this part before it is warned of.
const SET_POINT_DRIFT: f64 = 0.1;

/// Two clocks may differ by this part.
const CLOCKS: f64 = 0.01;
/// A dwell shorter than this part of the usual is cut.
const SHORT: f64 = 0.6;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Severity {
    /// No table is made.
    Fault,
    /// A person should look.
    Warning,
}

/// Something about the campaign that a person should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Line of the samples, if one is concerned.
    pub line: Option<u64>,
    /// Set point \[degC\] and number of the position, if one is concerned.
    pub place: Option<(f64, Option<u32>)>,
    /// What it is, and what helps.
    pub message: String,
}

impl Finding {
    /// The finding with the place of its line, if it has one; `locate` gives file and line of a row.
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

/// The dwells of one stay at one set point: what they share, such as hysteresis, is common to their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct SetPoint {
    /// What the chamber was set to \[degC\].
    pub set_point_c: f64,
    /// Indices of its dwells.
    pub dwells: Vec<usize>,
}

/// Puts dwells into set points: one each time the chamber comes back to one, if every stay has all positions; else one each
/// value of the set point, whenever it was visited.
#[must_use]
pub fn set_points(dwells: &[Dwell], positions: usize) -> Vec<SetPoint> {
    let mut stays: Vec<SetPoint> = Vec::new();
    for (index, dwell) in dwells.iter().enumerate() {
        match stays.last_mut() {
            Some(stay) if stay.set_point_c == dwell.set_point_c => stay.dwells.push(index),
            _ => stays.push(SetPoint { set_point_c: dwell.set_point_c, dwells: vec![index] }),
        }
    }
    // Half of the positions tells a stay with a gap from a campaign that runs all set points in each position.
    let complete = |stay: &SetPoint| 2 * distinct(dwells, stay) > positions;
    if stays.iter().all(complete) {
        return stays;
    }
    let mut values: Vec<SetPoint> = Vec::new();
    for stay in stays {
        match values.iter_mut().find(|value| value.set_point_c == stay.set_point_c) {
            Some(value) => value.dwells.extend(stay.dwells),
            None => values.push(stay),
        }
    }
    values
}

fn distinct(dwells: &[Dwell], stay: &SetPoint) -> usize {
    let mut positions: Vec<_> = stay.dwells.iter().map(|&index| dwells[index].position).collect();
    positions.sort_unstable();
    positions.dedup();
    positions.len()
}

/// Looks at everything. `excluded` are (set point, number of the position) that the user left out.
#[must_use]
pub fn check(campaign: &Campaign, dwells: &[Dwell], stays: &[SetPoint], excluded: &[(f64, u32)]) -> Vec<Finding> {
    let checker = Checker { campaign, dwells, findings: Vec::new() };
    checker.run(stays, excluded)
}

struct Checker<'a> {
    campaign: &'a Campaign,
    dwells: &'a [Dwell],
    findings: Vec<Finding>,
}

impl Checker<'_> {
    fn run(mut self, stays: &[SetPoint], excluded: &[(f64, u32)]) -> Vec<Finding> {
        self.positions(stays, excluded);
        self.soak();
        self.time();
        if stays.len() < 2 {
            let message = format!("{} set point; a temperature calibration needs at least 2", stays.len());
            self.findings.push(Finding { severity: Severity::Fault, line: None, place: None, message });
        } else {
            self.telemetry(stays);
        }
        self.saturation();
        self.forces(stays);
        self.still();
        self.findings.sort_by_key(|finding| (finding.severity == Severity::Warning, finding.line));
        self.findings
    }

    fn of_dwell(&mut self, severity: Severity, dwell: usize, line: u64, message: String) {
        let dwell = &self.dwells[dwell];
        let place = Some((dwell.set_point_c, Some(self.campaign.positions[dwell.position].number)));
        self.findings.push(Finding { severity, line: Some(line), place, message });
    }

    fn of_set_point(&mut self, severity: Severity, set_point_c: f64, line: Option<u64>, message: String) {
        self.findings.push(Finding { severity, line, place: Some((set_point_c, None)), message });
    }

    /// Every listed position at every set point.
    fn positions(&mut self, stays: &[SetPoint], excluded: &[(f64, u32)]) {
        for stay in stays {
            let has = |index: usize| stay.dwells.iter().any(|&dwell| self.dwells[dwell].position == index);
            let missing: Vec<_> = (0..self.campaign.positions.len())
                .filter(|&index| !has(index))
                .map(|index| self.campaign.positions[index].number)
                .filter(|number| !excluded.contains(&(stay.set_point_c, *number)))
                .map(|number| number.to_string())
                .collect();
            if !missing.is_empty() {
                let line = stay.dwells.last().map(|&dwell| self.dwells[dwell].lines[1]);
                let message = format!(
                    "position {} of the campaign file is missing; measure it, or leave it out knowingly with --exclude {}/{}",
                    missing.join(", "),
                    stay.set_point_c,
                    missing[0]
                );
                self.of_set_point(Severity::Fault, stay.set_point_c, line, message);
            }
        }
    }

    /// The time between the last row of a set point and the first of the next.
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
                self.of_set_point(severity, after.set_point_c, Some(after.lines[0]), message);
            }
        }
    }

    /// What the intervals add up to against the time that passed, and dwells that are cut short.
    fn time(&mut self) {
        let elapsed = |dwell: &Dwell| dwell.time_ns[1].saturating_sub(dwell.time_ns[0]) as f64 / 1e9;
        let ratio = median(self.dwells.iter().map(|dwell| dwell.sums.seconds / elapsed(dwell)));
        let line = self.dwells.first().map(|dwell| dwell.lines[0]);
        if !(1.0 - CLOCKS..=1.0 + CLOCKS).contains(&ratio) {
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
            if seconds < SHORT * usual {
                let message = format!("{seconds:.1} s only, others have {usual:.1} s; is the file cut?");
                self.of_dwell(Severity::Warning, dwell, lines[1], message);
            }
        }
    }

    fn telemetry(&mut self, stays: &[SetPoint]) {
        type Place = fn(&Block) -> &[[f64; 2]; AXES];
        let places: [(&str, Place); 2] = [("head", |block| &block.head), ("board", |block| &block.board)];
        for axis in 0..AXES {
            for (name, of) in places {
                let of_dwell = |dwell: &Dwell| range(dwell.blocks.iter().map(|block| of(block)[axis]));
                let middle = |dwell: &Dwell| {
                    median(dwell.blocks.iter().map(|block| {
                        let [low, high] = of(block)[axis];
                        0.5 * (low + high)
                    }))
                };
                let means: Vec<f64> = stays
                    .iter()
                    .map(|stay| median(stay.dwells.iter().map(|&dwell| middle(&self.dwells[dwell]))))
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
                // A reading that moves in no digit from one set point to another is dead.
                let dead = |dwell: &Dwell| Some(of_dwell(dwell)).filter(|[low, high]| low == high).map(|[low, _]| low);
                let stuck = (1..self.dwells.len()).find(|&dwell| {
                    let (before, after) = (&self.dwells[dwell - 1], &self.dwells[dwell]);
                    before.set_point_c != after.set_point_c && dead(before).is_some() && dead(before) == dead(after)
                });
                if let Some(dwell) = stuck {
                    let line = self.dwells[dwell].lines[0];
                    let message = format!(
                        "{column} does not move from the set point before in any digit; is the sensor connected?"
                    );
                    self.of_dwell(Severity::Fault, dwell, line, message);
                    continue;
                }
                for dwell in 0..self.dwells.len() {
                    let [low, high] = of_dwell(&self.dwells[dwell]);
                    if high - low > DWELL_DRIFT * step {
                        let usual = middle(&self.dwells[dwell]);
                        let wild = |block: &&Block| {
                            let [low, high] = of(block)[axis];
                            (low - usual).abs().max((high - usual).abs()) > 0.5 * DWELL_DRIFT * step
                        };
                        let line =
                            self.dwells[dwell].blocks.iter().find(wild).map_or(self.dwells[dwell].lines[0], |b| b.line);
                        let message = format!(
                            "{column} runs from {low} to {high} within the dwell, while set points are {step:.3} apart: a broken \
                             reading, or a temperature that was not settled; mend the rows or leave the dwell out with --exclude"
                        );
                        self.of_dwell(Severity::Fault, dwell, line, message);
                    }
                }
                for (stay, mean) in stays.iter().zip(&means) {
                    let [low, high] = range(stay.dwells.iter().map(|&dwell| [middle(&self.dwells[dwell]); 2]));
                    if high - low > SET_POINT_DRIFT * step {
                        let line = stay.dwells.first().map(|&dwell| self.dwells[dwell].lines[0]);
                        let message = format!(
                            "{column} moves from {low:.4} to {high:.4} while the set point is measured: the soak was too short"
                        );
                        self.of_set_point(Severity::Warning, stay.set_point_c, line, message);
                    }
                    // A set point of the same name that reads like another one was never reached.
                    let other = stays.iter().zip(&means).find(|(other, value)| {
                        other.set_point_c < stay.set_point_c && (*value - mean).abs() < 0.1 * step
                    });
                    if let Some((other, _)) = other {
                        let message = format!(
                            "{column} reads as at {} degC ({mean:.4}); was the set point reached?",
                            other.set_point_c
                        );
                        self.of_set_point(Severity::Warning, stay.set_point_c, None, message);
                    }
                }
            }
        }
    }

    fn saturation(&mut self) {
        self.plateaus();
        let Some(limit) = self.campaign.max_rate else { return };
        for dwell in 0..self.dwells.len() {
            for (axis, name) in AXIS_NAMES.iter().enumerate() {
                let full = self.dwells[dwell].blocks.iter().find(|block| block.rate[axis] >= limit);
                if let Some((line, rate)) = full.map(|block| (block.line, block.rate[axis])) {
                    let message = format!("{name} counts {rate:.0} pulse/s, max_rate is {limit:.0}: saturated");
                    self.of_dwell(Severity::Fault, dwell, line, message);
                }
            }
        }
    }

    /// A converter that is full gives the same count in every row, at one set point as at another.
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
                    self.of_dwell(Severity::Warning, first, self.dwells[first].lines[0], message);
                }
            }
        }
    }

    /// Scale factors good to a percent, from the positions that point up or down: `[K+, -K-]`.
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

    /// Whether the dwells of a set point agree on scale factors of the right sign.
    fn makes_sense(&self, stay: &SetPoint, axis: usize) -> bool {
        let dwells: Vec<_> = stay.dwells.iter().map(|&dwell| &self.dwells[dwell]).collect();
        reduce(self.campaign, &dwells, axis, None).is_some_and(|reduced| {
            let [_, k_plus, k_minus, ..] = reduced.values;
            // Nothing is left over where there are as many dwells as parameters.
            (reduced.residual_sd < MOVED || reduced.residual_sd.is_nan()) && k_plus > 0.0 && k_minus < 0.0
        })
    }

    /// What is indicated against what the position asks for.
    fn forces(&mut self, stays: &[SetPoint]) {
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
            // A large bias shifts all readings alike; then each set point still makes sense by itself.
            if stays.iter().all(|stay| self.makes_sense(stay, axis)) {
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
                    self.of_dwell(Severity::Fault, dwell, self.dwells[dwell].lines[0], message);
                }
            }
        }
    }

    /// No part of a dwell may differ from the rest.
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
                // A few pulses more or less are no motion.
                let pulse = 4.0 / (up.min(down) * median(blocks.iter().map(|block| block.sums.seconds)));
                let limit = STILL * robust_sd(&off) + STILL_FLOOR + pulse;
                let worst = (0..off.len()).max_by(|&a, &b| off[a].abs().total_cmp(&off[b].abs()));
                if let Some(worst) = worst.filter(|&worst| off[worst].abs() > limit) {
                    let line = blocks[worst].line;
                    let severity = if off[worst].abs() > MOVED { Severity::Fault } else { Severity::Warning };
                    let message = format!(
                        "{} was not still: {:.1}e-6 g0 off the rest of the dwell from line {line} on; leave the rows or the dwell out",
                        name,
                        off[worst] * 1e6
                    );
                    self.of_dwell(severity, dwell, line, message);
                }
            }
        }
    }
}
