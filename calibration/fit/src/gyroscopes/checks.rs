//! Checks of the turns and of the gyroscopes' dwells, before the fit.

use super::data::Data;
use super::runs::{AT_REST, TurnBlock, TurnRun};
use isotherm_campaign::{Dwell, LEAST_TURN};
use isotherm_shared::table::GYROSCOPE_NAMES;
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use isotherm_support::finding::{Finding, Location, RunNumber, Severity, name};

/// Largest relative difference between the pulses for an angle in a turn and in the gyroscope's other turns.
const ANGLE_TOLERANCE: f64 = 0.02;
/// A turn begins and ends at rest if its rates differ by less than this from those of the dwells \[arcsec/s\]: 0.02
/// deg/s.
const REST: f64 = 0.02 * 3600.0;
/// In turns about an axis one column has this part of all pulses.
const EXCHANGED: f64 = 0.8;
/// The ends of a turn, if its rows are shorter \[s\].
const END: f64 = 0.5;
/// Largest angle of a row \[arcsec\]: 30 deg.
const LARGEST_ROW: f64 = 30.0 * 3600.0;
/// The intervals of a turn add up to its time within this \[s\]. At 10 deg/s it is 3 ppm of 360 deg.
const LOST_TIME: f64 = 1e-4;
/// Temperature of a run that changes by more than this part of the step between set points is a fault.
const DRIFT: f64 = 0.5;

/// Lowest and highest temperature of a gyroscope in a run.
type RangeOf = fn(&Dwell, usize) -> [f64; 2];

/// K+ and K- of each gyroscope, only from the turns \[pulse/arcsec\]: pulses by angle.
pub(super) fn first_scale_factors(data: &Data<'_>) -> [[f64; 2]; AXES] {
    [0, 1, 2].map(|axis| {
        [1.0, -1.0].map(|sign| {
            let of_its_sign = data.turns.iter().filter(|(_, turn)| turned(data, turn)[axis] * sign >= LEAST_TURN);
            median(of_its_sign.map(|(_, turn)| ratio(data, turn, axis))) * sign
        })
    })
}

fn turned(data: &Data<'_>, turn: &TurnRun) -> [f64; AXES] {
    data.campaign.turns[turn.run.position].turned().into()
}

/// Pulses of a gyroscope while it turns, by the angle about its own axis. In a long rest, bias and Earth's rate would
/// add up.
fn ratio(data: &Data<'_>, turn: &TurnRun, axis: usize) -> f64 {
    let pulses = |block: &TurnBlock| block.pulses[axis][0] - block.pulses[axis][1];
    let rate = |block: &TurnBlock| pulses(block).abs() / block.seconds;
    let fastest = turn.blocks.iter().map(rate).fold(0.0, f64::max);
    let moving: f64 = turn.blocks.iter().filter(|block| rate(block) > AT_REST * fastest).map(pulses).sum();
    moving / turned(data, turn)[axis]
}

/// Runs all checks. `present` says whether the samples have gyroscopes.
pub(super) fn check(data: &Data<'_>, excluded: &[(f64, u32)], present: bool) -> Vec<Finding> {
    if !present {
        let message = "the campaign file has turns, but the samples have no gyroscopes: g1_positive to g3_board are missing or 0; record them, or take \
                       every [[turn]] out of the campaign file";
        return vec![Finding::whole(Severity::Fault, name::NO_PULSES, message.to_owned())];
    }
    let mut checker = Checker { data, findings: Vec::new() };
    checker.missing(excluded);
    checker.gaps();
    if let Some(exchanged) = exchanged(data) {
        // It causes all that angles, rests and rows show.
        checker.findings.push(exchanged);
        return checker.gathered();
    }
    let usual = checker.angles();
    checker.rest(usual);
    checker.rows(usual);
    checker.still(usual);
    checker.temperature();
    checker.gathered()
}

/// The fault that the pulses of gyroscopes are in the columns of others: in every order but the stated one of the
/// turns' axes the columns that count are those of other gyroscopes.
fn exchanged(data: &Data<'_>) -> Option<Finding> {
    let counted = |axis: usize, column: usize| -> f64 {
        let about = data.turns.iter().filter(|(_, turn)| turned(data, turn)[axis].abs() >= LEAST_TURN);
        let pulses = |turn: &TurnRun| turn.run.sums.positive[column] - turn.run.sums.negative[column];
        about.map(|(_, turn)| pulses(turn).abs() / turned(data, turn)[axis].abs()).sum()
    };
    let counts = [0, 1, 2].map(|axis| [0, 1, 2].map(|column| counted(axis, column)));
    let columns = counts.map(|of_axis| {
        let all: f64 = of_axis.iter().sum();
        (0..AXES).find(|column| all > 0.0 && of_axis[*column] > EXCHANGED * all)
    });
    let [Some(first), Some(second), Some(third)] = columns else { return None };
    let order = [first, second, third];
    if order == [0, 1, 2] || first == second || second == third || first == third {
        return None;
    }
    let own: Vec<_> = (0..AXES).filter(|axis| order[*axis] == *axis).collect();
    let what = match own[..] {
        [own] => {
            let pair: Vec<_> = (0..AXES).filter(|axis| *axis != own).map(|axis| GYROSCOPE_NAMES[axis]).collect();
            format!("{} look exchanged: exchange their cables or columns", pair.join(" and "))
        }
        _ => format!(
            "the gyroscopes look exchanged: {}; correct cables, columns, or the axes of the turns",
            [0, 1, 2]
                .map(|axis| format!("{} is in the columns g{}", GYROSCOPE_NAMES[axis], order[axis] + 1))
                .join(", ")
        ),
    };
    let message = format!("{what}; in the turns about one the other counts");
    Some(Finding::whole(Severity::Fault, name::AXES_EXCHANGED, message))
}

struct Checker<'a> {
    data: &'a Data<'a>,
    findings: Vec<Finding>,
}

impl Checker<'_> {
    fn fault(&mut self, name: &'static str, turn: &TurnRun, line: u64, message: &str) {
        let number = self.data.campaign.turns[turn.run.position].start.number;
        self.findings.push(Finding {
            severity: Severity::Fault,
            name,
            line: Some(line),
            place: Some(Location::SetPoint(turn.run.set_point_c, Some(RunNumber::Turn(number)))),
            message: message.to_owned(),
        });
    }

    /// The findings; what is wrong with a turn at every set point, such as its angle in the campaign file, is one
    /// finding.
    fn gathered(self) -> Vec<Finding> {
        let Self { data, findings } = self;
        let turn = |finding: &Finding| match finding.place {
            Some(Location::SetPoint(_, Some(RunNumber::Turn(number)))) => Some((finding.name, number)),
            _ => None,
        };
        let everywhere = |(_, number): (&str, u32), count: usize| {
            let taken = |(_, turn): &&(usize, &TurnRun)| data.campaign.turns[turn.run.position].start.number == number;
            count > 1 && count == data.turns.iter().filter(taken).count()
        };
        let counts: Vec<_> = findings.iter().map(turn).collect();
        let mut gathered: Vec<(Option<(&str, u32)>, Finding)> = Vec::new();
        for mut finding in findings {
            let key =
                turn(&finding).filter(|key| everywhere(*key, counts.iter().filter(|it| **it == Some(*key)).count()));
            if key.is_some() && gathered.iter().any(|(known, _)| *known == key) {
                continue;
            }
            if let Some((_, number)) = key {
                finding.place = None;
                finding.message = format!("turn {number}, at every set point: {}", finding.message);
            }
            gathered.push((key, finding));
        }
        gathered.into_iter().map(|(_, finding)| finding).collect()
    }

    fn missing(&mut self, excluded: &[(f64, u32)]) {
        let taken = |turn: usize| self.data.turns.iter().any(|(_, run)| run.run.position == turn);
        let number = |turn: usize| self.data.campaign.turns[turn].start.number;
        let nowhere: Vec<_> = (0..self.data.campaign.turns.len()).filter(|turn| !taken(*turn)).map(number).collect();
        if !nowhere.is_empty() {
            let names: Vec<_> = nowhere.iter().map(ToString::to_string).collect();
            let (noun, verb, it) = if names.len() == 1 { ("turn", "is", "it") } else { ("turns", "are", "them") };
            let message = format!(
                "{noun} {} of the campaign file {verb} missing at every set point; take {it}, or take {it} out of the campaign file",
                names.join(", ")
            );
            self.findings.push(Finding::whole(Severity::Fault, name::MISSING_TURN, message));
        }
        for index in 0..self.data.set_points_c.len() {
            self.missing_at(index, excluded, &nowhere);
        }
        for turn in &self.data.strays {
            let message = "there are no positions at this set point; measure them, or take the rows of the turn out";
            self.fault(name::MISSING_POSITION, turn, turn.run.lines[0], message);
        }
    }

    /// Turns that are missing at one set point, but not `nowhere`.
    fn missing_at(&mut self, set_point: usize, excluded: &[(f64, u32)], nowhere: &[u32]) {
        let set_point_c = self.data.set_points_c[set_point];
        let has =
            |turn: usize| self.data.turns.iter().any(|(place, run)| *place == set_point && run.run.position == turn);
        let missing: Vec<_> = (0..self.data.campaign.turns.len())
            .filter(|turn| !has(*turn))
            .map(|turn| self.data.campaign.turns[turn].start.number)
            .filter(|number| !excluded.contains(&(set_point_c, *number)) && !nowhere.contains(number))
            .map(|number| number.to_string())
            .collect();
        if !missing.is_empty() {
            let (noun, verb, it) = if missing.len() == 1 { ("turn", "is", "it") } else { ("turns", "are", "each") };
            let message = format!(
                "{noun} {} of the campaign file {verb} missing; take {it}, or leave {it} out knowingly with --exclude {set_point_c}/{}; if no other turn drives its channel there, leave every position and turn of the set point out",
                missing.join(", "),
                missing[0]
            );
            self.findings.push(Finding {
                severity: Severity::Fault,
                name: name::MISSING_TURN,
                line: None,
                place: Some(Location::SetPoint(set_point_c, None)),
                message,
            });
        }
    }

    /// Samples that are missing in a turn: what it turned meanwhile is in no pulse.
    fn gaps(&mut self) {
        // The intervals may be of another clock than the timestamps.
        let clocks = median(self.data.dwells.iter().map(|(_, dwell)| dwell.interval_ratio()));
        let clocks = if clocks.is_finite() { clocks } else { 1.0 };
        for (_, turn) in &self.data.turns {
            let [begin_ns, end_ns] = turn.run.time_ns.unwrap_or_default();
            let elapsed = end_ns.saturating_sub(begin_ns) as f64 / 1e9 * clocks;
            let lost = elapsed - turn.run.sums.seconds;
            let line = turn.run.lines[0];
            if turn.has_gap() {
                let message = "rows are missing by their sequences, and with them a part of the angle; take the turn again, or leave it, or all of its set point, out with --exclude";
                self.fault(name::TURN_GAP, turn, line, message);
            } else if lost.abs() > LOST_TIME {
                let message = format!(
                    "its intervals add up to {:.4} s, but it lasts {elapsed:.4} s: {:.1} ms are lost or counted twice, and the angle of that time with \
                     them; take the turn again, or leave it, or all of its set point, out with --exclude",
                    turn.run.sums.seconds,
                    lost * 1e3
                );
                self.fault(name::TURN_GAP, turn, line, &message);
            }
        }
    }

    /// The pulses of each turn against its angle. Returns the usual pulses for an arcsec of each gyroscope.
    fn angles(&mut self) -> [f64; AXES] {
        let data = self.data;
        let mut told = vec![false; data.turns.len()];
        [0, 1, 2].map(|axis| {
            let counting: Vec<_> =
                data.turns.iter().enumerate().filter(|(_, (_, turn))| turned(data, turn)[axis].abs() >= LEAST_TURN).collect();
            let ratios: Vec<f64> = counting.iter().map(|(_, (_, turn))| ratio(data, turn, axis)).collect();
            for (index, (number, (_, turn))) in counting.iter().enumerate() {
                let others = ratios.iter().enumerate().filter(|(other, _)| *other != index).map(|(_, ratio)| ratio.abs());
                let usual = median(others);
                let gyroscope = GYROSCOPE_NAMES[axis];
                let (angle, line) = (data.campaign.turns[turn.run.position].angle_deg, turn.run.lines[0]);
                let message = if ratios[index] == 0.0 {
                    Some((name::NO_PULSES, format!("{gyroscope} gives no pulses; is it connected, and is it on this axis?")))
                } else if ratios[index] < 0.0 {
                    let message = format!(
                        "the pulses of {gyroscope} say the opposite direction: the sign of axis or angle_deg is wrong, or the gyroscope's channels are \
                         exchanged"
                    );
                    Some((name::TURN_ANGLE, message))
                } else if (ratios[index] / usual - 1.0).abs() > ANGLE_TOLERANCE {
                    let message = format!(
                        "the pulses of {gyroscope} show {:.1} deg, compared with its other turns, and the campaign file {angle} deg; correct angle_deg or axis, or \
                         take the turn again",
                        angle * ratios[index] / usual
                    );
                    Some((name::TURN_ANGLE, message))
                } else {
                    None
                };
                if let Some((name, message)) = message.filter(|_| !told[*number]) {
                    told[*number] = true;
                    self.fault(name, turn, line, &message);
                }
            }
            median(ratios.iter().map(|ratio| ratio.abs()))
        })
    }

    /// Whether each turn begins and ends at rest.
    fn rest(&mut self, usual: [f64; AXES]) {
        for (set_point, turn) in &self.data.turns {
            let blocks = |reverse: bool| -> Vec<&TurnBlock> {
                let mut seconds = 0.0;
                let enough = |block: &&TurnBlock| {
                    let more = seconds < END;
                    seconds += block.seconds;
                    more
                };
                if reverse {
                    turn.blocks.iter().rev().take_while(enough).collect()
                } else {
                    turn.blocks.iter().take_while(enough).collect()
                }
            };
            let ends = [("begin", turn.run.lines[0], blocks(false)), ("end", turn.run.lines[1], blocks(true))];
            for (verb, line, blocks) in ends {
                let seconds: f64 = blocks.iter().map(|block| block.seconds).sum();
                let off = (0..AXES).map(|axis| {
                    let pulses: f64 = blocks.iter().map(|block| block.pulses[axis][0] - block.pulses[axis][1]).sum();
                    let at_rest = self.data.dwells.iter().filter(|(place, _)| place == set_point);
                    let at_rest = median(at_rest.map(|(_, dwell)| rate(&dwell.sums.rates(axis))));
                    let off = (pulses / seconds - at_rest).abs() / usual[axis];
                    // Up to a pulse of each channel at each end.
                    (off > REST + 2.0 / usual[axis] / seconds).then_some((axis, off))
                });
                if let Some((axis, off)) = off.flatten().next() {
                    let message = format!(
                        "it does not {verb} at rest: {} is {:.3} deg/s off the dwells; rows from rest to rest must have its number, and some seconds of rest \
                         before and after",
                        GYROSCOPE_NAMES[axis],
                        off / 3600.0
                    );
                    self.fault(name::TURN_REST, turn, line, &message);
                }
            }
        }
    }

    /// Rows that are too long to follow the turn.
    fn rows(&mut self, usual: [f64; AXES]) {
        for (_, turn) in &self.data.turns {
            let axes = self.data.campaign.turns[turn.run.position].axis;
            let angle = |block: &TurnBlock| {
                let parts =
                    (0..AXES).map(|axis| axes[axis] * (block.pulses[axis][0] - block.pulses[axis][1]) / usual[axis]);
                parts.sum::<f64>().abs()
            };
            let longest = turn.blocks.iter().map(|block| (angle(block), block)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((angle, block)) = longest.filter(|(angle, _)| *angle > LARGEST_ROW) {
                let message = format!(
                    "it turns by {:.0} deg in a row of {:.2} s; at most 30 deg can be followed, record shorter rows or turn more slowly",
                    angle / 3600.0,
                    block.seconds
                );
                self.fault(name::TURN_ROWS, turn, block.line, &message);
            }
        }
    }

    /// Motion within a dwell.
    fn still(&mut self, usual: [f64; AXES]) {
        for (_, dwell) in &self.data.dwells {
            let moved = (0..AXES).find_map(|axis| {
                let at_rest = median(dwell.blocks.iter().map(|block| rate(&block.sums.rates(axis))));
                dwell.blocks.iter().find_map(|block| {
                    let off = (rate(&block.sums.rates(axis)) - at_rest).abs() / usual[axis];
                    (off > REST + 2.0 / usual[axis] / block.sums.seconds).then_some((axis, off, block.line))
                })
            });
            if let Some((axis, off, line)) = moved {
                let number = self.data.campaign.positions[dwell.position].number;
                let message = format!(
                    "{} turns by {:.3} deg/s within the dwell: the IMU was moved; leave the dwell out with --exclude",
                    GYROSCOPE_NAMES[axis],
                    off / 3600.0
                );
                self.findings.push(Finding {
                    severity: Severity::Fault,
                    name: name::NOT_STILL,
                    line: Some(line),
                    place: Some(Location::SetPoint(dwell.set_point_c, Some(RunNumber::Position(number)))),
                    message,
                });
            }
        }
    }

    /// Temperature that does not react, and runs that were not settled.
    fn temperature(&mut self) {
        let sensors: [(&str, RangeOf); 2] = [("head", Dwell::head_range), ("board", Dwell::board_range)];
        for axis in 0..AXES {
            for (sensor, of) in sensors {
                let column = format!("g{}_{sensor}", axis + 1);
                let middle = |set_point: usize| {
                    let dwells = self.data.dwells.iter().filter(move |(place, _)| *place == set_point);
                    median(dwells.map(|(_, dwell)| of(dwell, axis)).map(|[low, high]| 0.5 * (low + high)))
                };
                let mut steps: Vec<f64> = (0..self.data.set_points_c.len()).map(middle).collect();
                steps.sort_by(f64::total_cmp);
                let step = median(steps.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0));
                if step.is_nan() {
                    let message = format!("{column} is the same at every set point; is the sensor connected?");
                    self.findings.push(Finding::whole(Severity::Fault, name::TEMPERATURE_CONSTANT, message));
                    continue;
                }
                self.drift(&column, |run| of(run, axis), step);
            }
        }
    }

    /// Runs whose temperature `column` covers more than a part of the `step` between set points.
    fn drift(&mut self, column: &str, range: impl Fn(&Dwell) -> [f64; 2], step: f64) {
        let campaign = self.data.campaign;
        let position = |run: &Dwell| RunNumber::Position(campaign.positions[run.position].number);
        let turn = |run: &Dwell| RunNumber::Turn(campaign.turns[run.position].start.number);
        let dwells = self.data.dwells.iter().map(|(_, dwell)| (*dwell, position(dwell)));
        let turns = self.data.turns.iter().map(|(_, turned)| (&turned.run, turn(&turned.run)));
        for (run, number) in dwells.chain(turns) {
            let [low, high] = range(run);
            if high - low > DRIFT * step {
                let message = format!(
                    "{column} runs from {low} to {high}, while set points are {step:.3} apart: a broken reading, or a temperature that was not \
                     settled; fix the rows or leave them out with --exclude"
                );
                self.findings.push(Finding {
                    severity: Severity::Fault,
                    name: name::TEMPERATURE_DRIFT,
                    line: Some(run.lines[0]),
                    place: Some(Location::SetPoint(run.set_point_c, Some(number))),
                    message,
                });
            }
        }
    }
}

/// The difference of both channels' rates.
fn rate([positive, negative]: &[f64; 2]) -> f64 {
    positive - negative
}
