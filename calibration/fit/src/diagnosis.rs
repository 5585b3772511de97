//! The single mistake that explains the data, if there is one: exchanged positions, cables, channels, a turned IMU, a
//! position that is off.
//!
//! # Method
//! Each set point is reduced by itself, all accelerometers together, with the base's tilt where the angles are known:
//!
//! ```text
//! rate+/K+ + rate-/K- = f_a + m_p f_p + m_o f_o + by_tilt t + A
//! ```
//! This is linear in 1/K+, 1/K-, A, m_p, m_o of each accelerometer and in t. A hypothesis changes the specific force of
//! dwells or the columns that are an accelerometer's, and the reduction is repeated. A hypothesis holds at a set point
//! where its residuals are a tenth of those without it, and its scale factors have the right signs. It explains the
//! data if, with it where it holds, the residuals of all set points together are a tenth of those without.
//!
//! The residuals do not change if both channels of an accelerometer are exchanged: K+ is then negative. So the six
//! orders of the accelerometers are tried, and the signs of the scale factors tell the rest: exchanged channels, or a
//! turned IMU. Single channels of two accelerometers are exchanged one by one.
//!
//! Over 400 lines: every hypothesis is tried by the same reduction.

mod cause;
mod unit;
mod words;

use crate::checks::SetPoint;
pub(crate) use cause::Diagnosis;
use cause::{MAX_GOOD, OF_FORCES, diagnosis};
use isotherm_campaign::{Campaign, Dwell, Observability, PARAMETERS, Position, specific_force};
use isotherm_shared::table::AXIS_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Residuals below this need no diagnosis \[g0\].
const GOOD: f64 = 20e-6;
/// A hypothesis must reduce the residuals by this factor.
const EXPLAINS: f64 = 10.0;
/// Hypotheses whose residuals are within this factor of the best are as good as it is.
const AS_GOOD: f64 = 4.0;
/// More hypotheses that are equally good are no diagnosis.
const MAX_AMBIGUOUS: usize = 3;
/// Residual of scale factors with a wrong sign \[g0\].
const WRONG_SIGN: f64 = 1.0;
/// With more positions, pairs and single positions are not tried.
const MAX_POSITIONS: usize = 64;
/// With more dwells, nothing is tried: the rows are no campaign then.
const MAX_DWELLS: usize = 20_000;
/// Least degrees of freedom of a set point without one of its positions.
const MIN_FREEDOM: usize = 3;
/// A position is off if it is by more than this \[g0\] ..
const POSITION_OFF: f64 = 1e-3;
/// .. and by more than this many of its own standard errors ..
const POSITION_OFF_ERRORS: f64 = 20.0;
/// .. and by more than this many times the others' residuals.
const POSITION_OFF_OTHERS: f64 = 5.0;
/// Largest number of positions that can be off: of more, nothing tells which are right.
const MAX_OFF: usize = 3;
/// Added to the normal equations' scaled diagonal, so that what a set point does not determine stays 0.
const RIDGE: f64 = 1e-11;
/// Weight of the observation that the base is level: a tilt of 1e-3 rad costs as much as a residual of 10e-6 g0. Where
/// positions do not tell the tilt from the other unknowns it stays small.
const LEVEL_WEIGHT: f64 = 1e-2;
/// Unknowns of a set point: those of three accelerometers, and the tilt.
const UNKNOWNS: usize = AXES * PARAMETERS + 2;

/// The single mistake that explains the `findings` about `dwells`; `None` if there is none, or if there are several. A
/// finding that is the mistake itself is taken out of the findings.
#[must_use]
pub(crate) fn diagnose(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &mut Vec<Finding>,
) -> Option<Diagnosis> {
    let found = single_cause(campaign, dwells, set_points, findings)?;
    if let Some(index) = found.promoted {
        findings.remove(index);
    }
    Some(found)
}

fn single_cause(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &[Finding],
) -> Option<Diagnosis> {
    if dwells.len() > MAX_DWELLS {
        return None;
    }
    if let Some(other) = unit::other_unit(campaign, dwells, set_points) {
        return Some(other);
    }
    let faults = |names: &[&str]| findings.iter().any(|f| f.severity == Severity::Fault && names.contains(&f.name));
    let mut causes: Vec<Diagnosis> = Vec::new();
    causes.extend(missing_everywhere(campaign, dwells, set_points, findings));
    causes.extend(dead_channels(campaign, dwells));
    causes.extend(clock(findings));
    // Positions that are missing, or channels without pulses, leave no set point that could be reduced.
    if causes.iter().all(|cause| cause.finding.name == name::IMPOSSIBLE_MOTION || cause.finding.name == name::INTERVAL)
    {
        // Motion within a dwell has been named, and is no wrong position.
        match Trials::new(campaign, dwells, set_points).forces(!faults(&[name::NOT_STILL]), findings) {
            Some(of_forces) => {
                // The intervals are then a part of what the hypothesis changes.
                causes.retain(|cause| cause.finding.name != of_forces.finding.name);
                causes.push(of_forces);
            }
            // Something else is wrong as well.
            None if faults(&[name::WRONG_POSITION, name::POSITION_OFF]) => return None,
            None => {}
        }
    }
    let mut causes = causes.into_iter();
    causes.next().filter(|_| causes.next().is_none())
}

/// Positions that no set point has.
fn missing_everywhere(
    campaign: &Campaign,
    dwells: &[Dwell],
    set_points: &[SetPoint],
    findings: &[Finding],
) -> Option<Diagnosis> {
    let missing: Vec<_> = (0..campaign.positions.len())
        .filter(|position| dwells.iter().all(|dwell| dwell.position != *position))
        .map(|position| campaign.positions[position].number.to_string())
        .collect();
    // A set point that lacks another position has its own cause.
    let has = |set_point: &SetPoint, position: usize| set_point.dwells.iter().any(|&d| dwells[d].position == position);
    let elsewhere = |position: usize| dwells.iter().any(|dwell| dwell.position == position);
    let lacks = |set_point: &SetPoint| {
        (0..campaign.positions.len()).any(|position| elsewhere(position) && !has(set_point, position))
    };
    let found = findings.iter().filter(|finding| finding.name == name::MISSING_POSITION).count();
    if missing.is_empty() || found != set_points.len() || found < 2 || set_points.iter().any(lacks) {
        return None;
    }
    let (verb, it, list) = match missing.as_slice() {
        [one] => ("is", "it", format!("position {one}")),
        many => ("are", "them", format!("positions {}", many.join(", "))),
    };
    let message = format!(
        "{list} of the campaign file {verb} missing at all {} set points: measure {it}, or take {it} out of the campaign file if the others \
         are enough",
        set_points.len()
    );
    Some(diagnosis(name::MISSING_POSITION, message, &[name::MISSING_POSITION, name::NO_PULSES]))
}

/// Channels without a pulse in the whole campaign, although the accelerometer points both ways.
fn dead_channels(campaign: &Campaign, dwells: &[Dwell]) -> Option<Diagnosis> {
    let dead = |axis: usize, channel: usize| {
        let sign = [1.0, -1.0][channel];
        let pulses = |dwell: &Dwell| dwell.sums.rates(axis)[channel];
        dwells.iter().all(|dwell| pulses(dwell) == 0.0)
            && dwells.iter().any(|dwell| campaign.positions[dwell.position].specific_force[axis] * sign > 0.5)
    };
    let found: Vec<_> =
        (0..AXES).flat_map(|axis| (0..2).map(move |channel| (axis, channel))).filter(|&(a, c)| dead(a, c)).collect();
    let message = without_pulses(&found)?;
    Some(diagnosis(name::NO_PULSES, message, &[name::NO_PULSES, name::WRONG_POSITION, name::CHANNELS_DIFFER]))
}

/// What is said of the channels without pulses `dead`, each an axis and 0 for + or 1 for -.
fn without_pulses(dead: &[(usize, usize)]) -> Option<String> {
    let word = |channel: usize| ["+", "-"][channel];
    Some(match dead {
        [(axis, channel)] => format!(
            "the {} channel of {} gives no pulse in the whole campaign: mend its converter or cable, or the column a{}_{}, and measure again",
            word(*channel),
            AXIS_NAMES[*axis],
            axis + 1,
            ["positive", "negative"][*channel]
        ),
        [(a, _), (b, _)] if a == b => format!(
            "{} gives no pulse in the whole campaign: mend the accelerometer, its converter or cable, or the columns of its pulses, and \
             measure again",
            AXIS_NAMES[*a]
        ),
        [(_, a), (_, b), (_, c)] if a == b && b == c => format!(
            "no accelerometer gives a pulse on its {} channel in the whole campaign: the counts have lost their sign, or one channel was not \
             recorded; count both channels",
            word(*a)
        ),
        [] => return None,
        several => {
            // An accelerometer with two dead channels is one part.
            let part = |axis: usize| match several.iter().filter(|(a, _)| *a == axis).collect::<Vec<_>>()[..] {
                [] => None,
                [(_, channel)] => Some(format!("the {} channel of {}", word(*channel), AXIS_NAMES[axis])),
                _ => Some(AXIS_NAMES[axis].to_owned()),
            };
            let mut parts: Vec<_> = (0..AXES).filter_map(part).collect();
            let last = parts.pop().unwrap_or_default();
            format!(
                "{} and {last} give no pulse in the whole campaign: mend what they share, such as a supply, a connector or a converter, or the \
                 columns of their pulses, and measure again",
                parts.join(", ")
            )
        }
    })
}

/// Intervals or all times in a wrong unit: the checks have said which.
fn clock(findings: &[Finding]) -> Option<Diagnosis> {
    // Single turns that are too fast, or the intervals of single dwells, have other causes and a place.
    let all = |name: &str| {
        let index = findings.iter().position(|f| f.severity == Severity::Fault && f.name == name && f.place.is_none());
        index.map(|index| (index, &findings[index]))
    };
    let explains = &[name::INTERVAL, name::IMPOSSIBLE_MOTION, name::IMPOSSIBLE_RAMP, name::SOAK, name::DURATION];
    match (all(name::IMPOSSIBLE_MOTION), all(name::INTERVAL)) {
        (Some((index, finding)), None) | (None, Some((index, finding))) => {
            Some(Diagnosis { finding: finding.clone(), explains, promoted: Some(index) })
        }
        _ => None,
    }
}

/// Specific force of a position \[g0\], and its derivatives by the tilt.
type Direction = ([f64; AXES], [[f64; 2]; AXES]);

/// A hypothesis about what is wrong.
#[derive(Clone, Debug, PartialEq)]
enum Hypothesis {
    /// The dwells of a position (by index) were measured in another: `[i]` is the index of the true position.
    Positions(PositionMistake, Vec<usize>),
    /// The pulses of accelerometer a are in the columns of accelerometer `order[a]`, with `sign[a]`.
    Axes { order: [usize; AXES], sign: [i8; AXES] },
    /// One channel of an accelerometer is exchanged with one of another: accelerometer and channel (0 is +) of both.
    Cables([usize; 2], [usize; 2]),
    /// Outer and inner angle of all positions are off \[deg\].
    Angles([f64; 2]),
    /// One position (by index) is not where the campaign file states it.
    Off(usize),
    /// The intervals are not the time from row to row.
    Intervals,
}

/// What is wrong with the numbers of the positions.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PositionMistake {
    /// Two are exchanged.
    Exchanged(usize, usize),
    /// All are shifted along the list by this.
    Shifted(isize),
}

/// Where the pulses of both channels of each accelerometer are: accelerometer and channel of the columns.
type Columns = [[[usize; 2]; 2]; AXES];

/// Both channels of accelerometer a in the columns of accelerometer `order[a]`.
fn in_order(order: [usize; AXES]) -> Columns {
    order.map(|axis| [[axis, 0], [axis, 1]])
}

/// Two columns exchanged.
fn with_exchanged(a: [usize; 2], b: [usize; 2]) -> Columns {
    in_order([0, 1, 2]).map(|axis| {
        axis.map(|column| match column {
            _ if column == a => b,
            _ if column == b => a,
            _ => column,
        })
    })
}

/// Root mean square.
fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    (values.map(|v| v * v).sum::<f64>() / n).sqrt()
}

/// A hypothesis that explains the data.
struct Explanation {
    hypothesis: Hypothesis,
    /// Residual with it \[g0\].
    after: f64,
    /// The set points where it holds.
    scope: Vec<usize>,
}

/// A residual in words.
fn size(g0: f64) -> String {
    if g0 < 1e-3 { format!("{:.1}e-6 g0", g0 * 1e6) } else { format!("{g0:.3} g0") }
}

/// One set point, reduced under a hypothesis.
struct Reduction {
    /// Residual standard deviation \[g0\].
    sd: f64,
    /// Signs of the scale factors by accelerometer: 1 right, -1 both wrong, 0 neither.
    sign: [i8; AXES],
    unknowns: DVector<f64>,
    /// The rates that a unit of the unknowns stands for.
    nominal: [[f64; 2]; AXES],
}

/// Trials of hypotheses on the dwells of a campaign.
struct Trials<'a> {
    campaign: &'a Campaign,
    dwells: &'a [Dwell],
    set_points: &'a [SetPoint],
    directions: Vec<Direction>,
    /// Residuals of each set point as the campaign file states it \[g0\], [`WRONG_SIGN`] if a scale factor has a wrong
    /// sign; NaN if it cannot be reduced.
    stated: Vec<f64>,
}

impl<'a> Trials<'a> {
    fn new(campaign: &'a Campaign, dwells: &'a [Dwell], set_points: &'a [SetPoint]) -> Self {
        let directions = campaign.positions.iter().map(|position| campaign.force(position, Some([0.0; 2]))).collect();
        let mut trials = Self { campaign, dwells, set_points, directions, stated: Vec::new() };
        let stated = |set_point: &SetPoint| {
            let reduction = trials.try_positions(set_point, &[], |position| position);
            reduction.map_or(f64::NAN, |r| if r.sign == [1; AXES] { r.sd } else { WRONG_SIGN })
        };
        trials.stated = set_points.iter().map(stated).collect();
        trials
    }

    fn try_positions(
        &self,
        set_point: &SetPoint,
        off: &[usize],
        position: impl Fn(usize) -> usize,
    ) -> Option<Reduction> {
        self.reduce(set_point, off, &|dwell| self.directions[position(dwell.position)], in_order([0, 1, 2]), &|_| 1.0)
    }

    /// Reduces a set point without the positions in `off`. `direction` gives the specific force of a dwell, `columns`
    /// those of each channel, `time` the factor of a dwell's counted time.
    fn reduce(
        &self,
        set_point: &SetPoint,
        off: &[usize],
        direction: &dyn Fn(&Dwell) -> Direction,
        columns: Columns,
        time: &dyn Fn(&Dwell) -> f64,
    ) -> Option<Reduction> {
        let dwells: Vec<&Dwell> = set_point
            .dwells
            .iter()
            .map(|&dwell| &self.dwells[dwell])
            .filter(|dwell| !off.contains(&dwell.position))
            .collect();
        let rates = |dwell: &Dwell, axis: usize| {
            columns[axis].map(|[axis, channel]| dwell.sums.rates(axis)[channel] / time(dwell))
        };
        let largest = |axis: usize, channel: usize| dwells.iter().map(|d| rates(d, axis)[channel]).fold(0.0, f64::max);
        let nominal = [0, 1, 2].map(|axis| [largest(axis, 0), largest(axis, 1)]);
        if nominal.iter().flatten().any(|rate| !(*rate > 0.0 && rate.is_finite())) {
            return None;
        }
        let unknowns = if self.campaign.mount.is_some() { UNKNOWNS } else { UNKNOWNS - 2 };
        let freedom = (AXES * dwells.len()).checked_sub(unknowns)?;
        if freedom == 0 || (!off.is_empty() && freedom < MIN_FREEDOM) {
            return None;
        }
        let shares = |dwell: &Dwell, axis: usize| {
            let [positive, negative] = rates(dwell, axis);
            [positive / nominal[axis][0], negative / nominal[axis][1]]
        };
        let directions: Vec<_> = dwells.iter().map(|dwell| direction(dwell)).collect();
        let (matrix, right) = equations(&directions, unknowns, |d, axis| shares(dwells[d], axis));
        let solution = solve(&matrix, &right)?;
        let residual = right - &matrix * &solution;
        let sd = (residual.norm_squared() / freedom as f64).sqrt();
        Some(Reduction { sd, sign: signs(&solution), unknowns: solution, nominal })
    }

    /// Residual of a set point under a hypothesis \[g0\]; infinite if its scale factors have another sign.
    fn residual(&self, hypothesis: &Hypothesis, set_point: &SetPoint) -> f64 {
        let (stated, in_place, as_counted) =
            (|dwell: &Dwell| self.directions[dwell.position], in_order([0, 1, 2]), |_: &Dwell| 1.0);
        let (reduction, sign) = match hypothesis {
            Hypothesis::Positions(_, positions) => (self.try_positions(set_point, &[], |at| positions[at]), [1; AXES]),
            Hypothesis::Off(position) => (self.try_positions(set_point, &[*position], |at| at), [1; AXES]),
            Hypothesis::Axes { order, sign } => {
                (self.reduce(set_point, &[], &stated, in_order(*order), &as_counted), *sign)
            }
            Hypothesis::Cables(a, b) => {
                (self.reduce(set_point, &[], &stated, with_exchanged(*a, *b), &as_counted), [1; AXES])
            }
            Hypothesis::Angles([outer, inner]) => {
                let turned = |dwell: &Dwell| self.turned(dwell.position, *outer, *inner);
                (self.reduce(set_point, &[], &turned, in_place, &as_counted), [1; AXES])
            }
            Hypothesis::Intervals => {
                let time =
                    |dwell: &Dwell| Some(dwell.interval_ratio()).filter(|ratio| *ratio > 0.0).map_or(1.0, f64::recip);
                (self.reduce(set_point, &[], &stated, in_place, &time), [1; AXES])
            }
        };
        reduction.filter(|reduction| reduction.sign == sign).map_or(f64::INFINITY, |reduction| reduction.sd)
    }

    /// The direction of a position whose angles are off.
    fn turned(&self, position: usize, outer_off: f64, inner_off: f64) -> Direction {
        let stated = &self.campaign.positions[position];
        let (Some(mount), Some([outer, inner])) = (self.campaign.mount, stated.angles) else {
            return self.directions[position];
        };
        let angles = [outer + outer_off, inner + inner_off];
        let force = mount * Vector3::from(specific_force(angles[0], angles[1]));
        let position = Position { angles: Some(angles), specific_force: force.into(), ..stated.clone() };
        self.campaign.force(&position, Some([0.0; 2]))
    }

    /// The hypotheses. `worst` is the set point that is worst explained by the campaign file.
    fn hypotheses(&self, worst: &SetPoint, with_off: bool) -> Vec<Hypothesis> {
        let mut all = self.orders(worst);
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let channels = [[0, 0], [0, 1], [1, 0], [1, 1]];
            all.extend(channels.map(|[first, second]| Hypothesis::Cables([a, first], [b, second])));
        }
        if let Some(mount) = self.campaign.mount {
            let exact = mount == mount.map(f64::round);
            // Where the mount only exchanges axes these are signed orders of the accelerometers.
            let turned: &[[f64; 2]] =
                if exact { &[] } else { &[[0.0, 90.0], [0.0, 180.0], [0.0, -90.0], [180.0, 0.0]] };
            all.extend([[90.0, 0.0], [-90.0, 0.0]].iter().chain(turned).map(|off| Hypothesis::Angles(*off)));
        }
        let count = self.campaign.positions.len();
        if count <= MAX_POSITIONS {
            all.extend(self.renumbered(count));
            let off = (0..count).filter(|position| with_off && self.spread(&[*position], *position).is_some());
            all.extend(off.map(Hypothesis::Off));
        }
        if self.dwells.iter().any(|dwell| (dwell.interval_ratio() - 1.0).abs() > 0.01) {
            all.push(Hypothesis::Intervals);
        }
        all
    }

    /// The orders of the accelerometers whose scale factors have signs at this set point, but the stated one.
    fn orders(&self, set_point: &SetPoint) -> Vec<Hypothesis> {
        let orders = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]].into_iter();
        let direction = |dwell: &Dwell| self.directions[dwell.position];
        let signed = orders.filter_map(|order| {
            let Reduction { sign, .. } = self.reduce(set_point, &[], &direction, in_order(order), &|_| 1.0)?;
            let stated = (order, sign) == ([0, 1, 2], [1; AXES]);
            (!sign.contains(&0) && !stated).then_some(Hypothesis::Axes { order, sign })
        });
        signed.collect()
    }

    /// Two of the `count` positions exchanged, or all shifted.
    fn renumbered(&self, count: usize) -> impl Iterator<Item = Hypothesis> {
        let pairs = (0..count).flat_map(move |i| (i + 1..count).map(move |j| (i, j)));
        let exchanged = pairs.filter(|(i, j)| self.directions[*i] != self.directions[*j]).map(move |(i, j)| {
            let mut positions: Vec<usize> = (0..count).collect();
            positions.swap(i, j);
            Hypothesis::Positions(PositionMistake::Exchanged(i, j), positions)
        });
        let shifted = [1, -1].map(|by| {
            let shifted = |position: usize| (position as isize + by).rem_euclid(count as isize) as usize;
            Hypothesis::Positions(PositionMistake::Shifted(by), (0..count).map(shifted).collect())
        });
        exchanged.chain(shifted)
    }

    /// The hypothesis that explains the residuals. Where a position is off in dwells in which the IMU moved, by one of
    /// the `findings`, the motion is the cause.
    fn forces(&self, with_off: bool, findings: &[Finding]) -> Option<Diagnosis> {
        let reducible: Vec<usize> = (0..self.set_points.len()).filter(|&i| !self.stated[i].is_nan()).collect();
        let worst = *reducible.iter().max_by(|&&a, &&b| self.stated[a].total_cmp(&self.stated[b]))?;
        if self.stated[worst] < GOOD {
            return None;
        }
        let before = rms(reducible.iter().map(|&i| self.stated[i]));
        let tried = self.hypotheses(&self.set_points[worst], with_off).into_iter();
        let mut found: Vec<_> =
            tried.filter_map(|hypothesis| self.holds(hypothesis, &reducible, worst, before)).collect();
        found.sort_by(|a, b| a.after.total_cmp(&b.after));
        let best = found.first()?.after;
        found.retain(|explanation| explanation.after < AS_GOOD * best);
        if found.len() > MAX_AMBIGUOUS {
            return None;
        }
        let signs = found.iter().flat_map(|it| &it.scope).any(|&i| self.stated[i] == WRONG_SIGN);
        let residuals = match signs {
            true => format!("as it is, scale factors have a wrong sign; corrected, residuals are {}", size(best)),
            false => format!("residuals {} -> {}", size(before), size(best)),
        };
        if let Some(first) = found.iter().find_map(|explanation| self.motion(explanation, findings)) {
            let mut finding = findings[first].clone();
            finding.severity = Severity::Fault;
            finding.message += &format!(" (without this position {residuals})");
            return Some(Diagnosis { finding, explains: OF_FORCES, promoted: Some(first) });
        }
        let texts: Vec<_> = found.iter().map(|it| self.describe(&it.hypothesis, &it.scope)).collect();
        let name = texts.first()?.0;
        let text = texts.into_iter().map(|(_, text)| text).collect::<Vec<_>>().join("; or ");
        let of_intervals = &[name::INTERVAL, name::WRONG_POSITION, name::POSITION_OFF];
        let explains = if name == name::INTERVAL { of_intervals } else { OF_FORCES };
        Some(diagnosis(name, format!("{text} ({residuals})"), explains))
    }

    /// The hypothesis as an explanation, if it holds at the set point `worst` and over all that are `reducible`, whose
    /// residuals are `before` without it.
    fn holds(&self, hypothesis: Hypothesis, reducible: &[usize], worst: usize, before: f64) -> Option<Explanation> {
        let holds = |stated: f64, residual: f64| residual < stated / EXPLAINS && residual < MAX_GOOD;
        let residual =
            |i: usize| Some(self.residual(&hypothesis, &self.set_points[i])).filter(|it| holds(self.stated[i], *it));
        residual(worst)?;
        let with: Vec<_> = reducible.iter().map(|&i| (i, residual(i))).collect();
        let after = rms(with.iter().map(|(i, residual)| residual.unwrap_or(self.stated[*i])));
        let scope: Vec<usize> = with.iter().filter(|(_, residual)| residual.is_some()).map(|(i, _)| *i).collect();
        // A smaller difference is an outlier: it is named after the fit, and kept.
        let is_outlier = |position: usize| {
            let offset = self.measured(position, &scope, &[position]).map_or(0.0, |(offset, _)| offset.norm());
            let spread = self.spread(&[position], position).unwrap_or(f64::INFINITY);
            offset < POSITION_OFF.max(POSITION_OFF_OTHERS * spread * after)
        };
        let only_outlier = matches!(hypothesis, Hypothesis::Off(position) if is_outlier(position));
        (holds(before, after) && !only_outlier).then_some(Explanation { hypothesis, after, scope })
    }

    /// The finding that the IMU moved in the position that is off, if it did wherever the position is off: the index of
    /// the first.
    fn motion(&self, Explanation { hypothesis, scope, .. }: &Explanation, findings: &[Finding]) -> Option<usize> {
        let Hypothesis::Off(position) = hypothesis else { return None };
        let number = RunNumber::Position(self.campaign.positions[*position].number);
        let moved = |i: &usize| {
            let place = Some(Location::SetPoint(self.set_points[*i].set_point_c, Some(number)));
            findings.iter().position(|finding| finding.name == name::NOT_STILL && finding.place == place)
        };
        let all: Option<Vec<usize>> = scope.iter().map(moved).collect();
        all?.first().copied()
    }

    /// The specific force that was measured in a position, less the stated one, in units of the local gravity: a mean
    /// over the set points `scope` with its standard error. The positions in `off` do not count in the reduction.
    fn measured(&self, position: usize, scope: &[usize], off: &[usize]) -> Option<(Vector3<f64>, f64)> {
        let gravity = self.campaign.gravity_local / self.campaign.gravity_reference;
        let mut all: Vec<Vector3<f64>> = Vec::new();
        for &i in scope {
            let set_point = &self.set_points[i];
            let Some(reduction) = self.try_positions(set_point, off, |position| position) else { continue };
            let u = &reduction.unknowns;
            let m = |axis: usize, k: usize| u[PARAMETERS * axis + 3 + k];
            let matrix = Matrix3::new(1.0, m(0, 0), m(0, 1), m(1, 1), 1.0, m(1, 0), m(2, 0), m(2, 1), 1.0);
            for &dwell in set_point.dwells.iter().filter(|&&dwell| self.dwells[dwell].position == position) {
                let indicated = |axis: usize| {
                    let [positive, negative] = self.dwells[dwell].sums.rates(axis);
                    let [by_positive, by_negative] = reduction.nominal[axis];
                    let first = PARAMETERS * axis;
                    u[first + 1] * positive / by_positive + u[first + 2] * negative / by_negative - u[first]
                };
                let indicated = Vector3::new(indicated(0), indicated(1), indicated(2));
                let (stated, by_tilt) = self.directions[position];
                let tilt = if u.len() == UNKNOWNS { [u[UNKNOWNS - 2], u[UNKNOWNS - 1]] } else { [0.0; 2] };
                let by_tilt = Vector3::from(by_tilt.map(|by| by[0] * tilt[0] + by[1] * tilt[1]));
                all.push((matrix.try_inverse()? * indicated - Vector3::from(stated) - by_tilt) / gravity);
            }
        }
        let n = all.len() as f64;
        let mean = all.iter().sum::<Vector3<f64>>() / n;
        let squares: f64 = all.iter().map(|value| (value - mean).norm_squared()).sum();
        // A single dwell has the errors of the others, which the caller compares it with.
        let error = if all.len() > 1 { (squares / (n - 1.0) / n).sqrt() } else { 0.0 };
        (!all.is_empty()).then_some((mean, error))
    }

    /// Error of the specific force that is measured in a position, if the positions in `off` do not count and each
    /// other dwell has an error of 1. `None` if the other positions do not determine all parameters.
    fn spread(&self, off: &[usize], position: usize) -> Option<f64> {
        let positions = &self.campaign.positions;
        let kept: Vec<Position> =
            (0..positions.len()).filter(|p| !off.contains(p)).map(|p| positions[p].clone()).collect();
        let force = positions[position].specific_force;
        let of = |axis: usize| {
            let found = Observability::of(&kept, axis);
            let sigma = found.sigma.filter(|_| found.deficiencies.is_empty())?;
            let own = if force[axis] > 0.0 { sigma[1] } else { sigma[2] } * force[axis];
            let parts = [1.0, sigma[0], own, sigma[3] * force[(axis + 1) % AXES], sigma[4] * force[(axis + 2) % AXES]];
            Some(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
        };
        Some(of(0)?.max(of(1)?).max(of(2)?))
    }

    /// Residual of all set points without the positions in `off` \[g0\].
    fn without(&self, off: &[usize]) -> Option<f64> {
        let of = |set_point: &SetPoint| Some(self.try_positions(set_point, off, |position| position)?.sd.powi(2));
        let squares: Option<Vec<f64>> = self.set_points.iter().map(of).collect();
        let squares = squares.filter(|squares| !squares.is_empty())?;
        Some((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }
}

/// 1 for each axis whose scale factors have the right signs, -1 where both are opposite, else 0.
fn signs(solution: &DVector<f64>) -> [i8; AXES] {
    [0, 1, 2].map(|axis| match (solution[PARAMETERS * axis + 1], solution[PARAMETERS * axis + 2]) {
        (plus, minus) if plus > 0.0 && minus < 0.0 => 1,
        (plus, minus) if plus < 0.0 && minus > 0.0 => -1,
        _ => 0,
    })
}

/// The equations of dwells with these `directions`: the unknowns of each axis, then the base's tilt. `shares` gives the
/// rates of a dwell's channels, by axis, over the largest ones.
fn equations(
    directions: &[Direction],
    unknowns: usize,
    shares: impl Fn(usize, usize) -> [f64; 2],
) -> (DMatrix<f64>, DVector<f64>) {
    let mut matrix = DMatrix::zeros(AXES * directions.len(), unknowns);
    let mut right = DVector::zeros(AXES * directions.len());
    for (d, (force, by_tilt)) in directions.iter().enumerate() {
        for axis in 0..AXES {
            let (row, first) = (AXES * d + axis, PARAMETERS * axis);
            let [positive, negative] = shares(d, axis);
            let (next, after) = (force[(axis + 1) % AXES], force[(axis + 2) % AXES]);
            for (k, value) in [-1.0, positive, negative, -next, -after].into_iter().enumerate() {
                matrix[(row, first + k)] = value;
            }
            for k in AXES * PARAMETERS..unknowns {
                matrix[(row, k)] = -by_tilt[axis][k - AXES * PARAMETERS];
            }
            right[row] = force[axis];
        }
    }
    (matrix, right)
}

/// The solution by scaled normal equations, in which the base is nearly level.
fn solve(matrix: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let unknowns = matrix.ncols();
    let mut normal = matrix.tr_mul(matrix);
    let mut projection = matrix.tr_mul(right);
    for k in AXES * PARAMETERS..unknowns {
        normal[(k, k)] += LEVEL_WEIGHT * LEVEL_WEIGHT;
    }
    let scale = DVector::from_fn(unknowns, |k, _| match normal[(k, k)].sqrt() {
        size if size > 0.0 => size,
        _ => 1.0,
    });
    for i in 0..unknowns {
        for k in 0..unknowns {
            normal[(i, k)] /= scale[i] * scale[k];
        }
        normal[(i, i)] = normal[(i, i)].max(RIDGE) + RIDGE;
        projection[i] /= scale[i];
    }
    Some(normal.cholesky()?.solve(&projection).component_div(&scale))
}

/// Faults of positions that are not where the campaign file states them, by more than their errors and the others'
/// residuals.
#[must_use]
pub(crate) fn positions_off(campaign: &Campaign, dwells: &[Dwell], set_points: &[SetPoint]) -> Vec<Finding> {
    if dwells.len() > MAX_DWELLS {
        return Vec::new();
    }
    let trials = Trials::new(campaign, dwells, set_points);
    let all: Vec<usize> = (0..set_points.len()).collect();
    let mut off: Vec<usize> = Vec::new();
    if campaign.positions.len() > MAX_POSITIONS || !trials.stated.iter().any(|sd| *sd > GOOD) {
        return Vec::new();
    }
    for _ in 0..MAX_OFF {
        let next = (0..campaign.positions.len())
            .filter(|position| !off.contains(position))
            .filter_map(|position| {
                let without = [off.as_slice(), &[position]].concat();
                trials.spread(&without, position)?;
                Some((trials.without(&without)?, position))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((others, position)) = next else { break };
        off.push(position);
        let is_off = |position: &usize| {
            let spread = trials.spread(&off, *position).unwrap_or(f64::INFINITY);
            trials.measured(*position, &all, &off).is_some_and(|(offset, error)| {
                offset.norm() > POSITION_OFF
                    && offset.norm() > POSITION_OFF_ERRORS * error
                    && offset.norm() > POSITION_OFF_OTHERS * spread * others
            })
        };
        if off.iter().all(is_off) {
            let finding = |position: &usize| {
                Finding::whole(Severity::Fault, name::POSITION_OFF, trials.describe_off(*position, &all, &off, ""))
            };
            return off.iter().map(finding).collect();
        }
    }
    Vec::new()
}
