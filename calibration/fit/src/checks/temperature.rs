//! The temperature of a campaign, one column after the other: sensors that do not react, broken readings, dwells and
//! set points that were not settled, set points that were not reached.

use super::{Checker, Column, SetPoint, Steps, last_digit};
use isotherm_campaign::{Block, Dwell, joint_range};
use isotherm_shared::wire::AXES;
use isotherm_statistics::median;
use isotherm_support::finding::{Finding, Severity, name};

/// Within a dwell, temperature that changes by more than this part of the step to a neighbouring set point is a
/// fault …
const DWELL_DRIFT: f64 = 0.5;
/// … if it also changes by more than this many times what is usual within a dwell.
const DWELL_NOISE: f64 = 3.0;
/// Temperature resolves set points that are at least this many of its digits apart.
const RESOLVED: f64 = 2.0;
/// The last digit may change to the next one, whatever the temperature does: a change by less than this many digits
/// says nothing.
const FLICKER: f64 = 1.5;
/// No temperature is further from all set points than this many times what temperature spans from the lowest to the
/// highest.
const IMPOSSIBLE: f64 = 10.0;
/// Over a set point, a change by more than this part of the step gives a warning.
const SET_POINT_DRIFT: f64 = 0.1;
/// Two set points whose temperature is nearer than this part of the step read alike.
const ALIKE: f64 = 0.1;

/// Lowest and highest temperature of a block, by axis.
type Ranges = fn(&Block) -> &[[f64; 2]; AXES];

/// The sensors of an accelerometer.
const SENSORS: [(&str, Ranges); 2] = [("head", |block| &block.head), ("board", |block| &block.board)];

/// The last digit of the temperature of `axis`.
fn digit(dwells: &[Dwell], axis: usize, ranges: Ranges) -> f64 {
    last_digit(dwells.iter().flat_map(|dwell| &dwell.blocks).flat_map(|block| ranges(block)[axis]).collect())
}

/// The last digits of head and board temperature of each accelerometer.
pub(crate) fn last_digits(dwells: &[Dwell]) -> [[f64; AXES]; 2] {
    SENSORS.map(|(_, ranges)| [0, 1, 2].map(|axis| digit(dwells, axis, ranges)))
}

/// One column of temperature.
struct Temperature {
    name: String,
    axis: usize,
    ranges: Ranges,
    /// Set points \[degC\], and the temperature there.
    means: Vec<(f64, f64)>,
    steps: Steps,
    /// The usual step from set point to set point, the usual spread within a dwell, and the last digit.
    step: f64,
    spread: f64,
    digit: f64,
}

impl Temperature {
    fn new(dwells: &[Dwell], set_points: &[SetPoint], axis: usize, (sensor, ranges): (&str, Ranges)) -> Self {
        let name = format!("a{}_{sensor}", axis + 1);
        let digit = digit(dwells, axis, ranges);
        let steps = Steps(Vec::new());
        let mut column = Self { name, axis, ranges, means: Vec::new(), steps, step: 0.0, spread: 0.0, digit };
        let mean = |set_point: &SetPoint| {
            let middles = set_point.dwells.iter().map(|&dwell| column.middle(&dwells[dwell]));
            (set_point.set_point_c, median(middles))
        };
        column.means = set_points.iter().map(mean).collect();
        column.steps = Steps::of(&column.means);
        column.step = median(column.steps.0.iter().map(|(_, step)| *step));
        column.spread = median(dwells.iter().map(|dwell| {
            let [low, high] = column.range(dwell);
            high - low
        }));
        column
    }

    fn block(&self, block: &Block) -> [f64; 2] {
        (self.ranges)(block)[self.axis]
    }

    fn range(&self, dwell: &Dwell) -> [f64; 2] {
        joint_range(dwell.blocks.iter().map(|block| self.block(block)))
    }

    fn middle(&self, dwell: &Dwell) -> f64 {
        median(dwell.blocks.iter().map(|block| {
            let [low, high] = self.block(block);
            0.5 * (low + high)
        }))
    }

    fn is_resolved(&self) -> bool {
        self.step >= RESOLVED * self.digit && self.spread <= DWELL_DRIFT * self.step
    }

    fn column(&self) -> Column {
        let coarse = (!self.is_resolved()).then_some([self.step, self.spread, self.digit]);
        Column { name: self.name.clone(), means: self.means.clone(), coarse }
    }
}

impl Checker<'_> {
    /// All rules, for each column.
    pub(super) fn temperature(&mut self, set_points: &[SetPoint]) {
        let mut columns: Vec<Column> = Vec::new();
        for (axis, sensor) in (0..AXES).flat_map(|axis| SENSORS.map(|sensor| (axis, sensor))) {
            let temperature = Temperature::new(self.dwells, set_points, axis, sensor);
            columns.push(temperature.column());
            if self.constant(&temperature) {
                continue;
            }
            self.broken_readings(&temperature);
            // If set points are not resolved, two may read alike, and noise may be larger than their distance.
            if !temperature.is_resolved() || self.stuck(&temperature) {
                continue;
            }
            self.drift(&temperature);
            self.settled(&temperature, set_points);
        }
        self.scale(&columns);
    }

    /// Whether a sensor does not react at all. An oven's may have the same median everywhere, but its last digits move.
    fn constant(&mut self, temperature: &Temperature) -> bool {
        let constant = temperature.step == 0.0 && temperature.spread == 0.0;
        if constant {
            let message = format!("{} is the same at every set point; is the sensor connected?", temperature.name);
            self.findings.push(Finding::whole(Severity::Fault, name::TEMPERATURE_CONSTANT, message));
        }
        constant
    }

    /// Rows that no temperature gives. They would be in the dwell's mean and in the table's range: nothing is left to
    /// accept.
    fn broken_readings(&mut self, temperature: &Temperature) {
        let [low, high] = joint_range(temperature.means.iter().map(|(_, mean)| [*mean; 2]));
        let far = IMPOSSIBLE * (high - low).max(temperature.spread).max(temperature.digit);
        for dwell in 0..self.dwells.len() {
            let blocks = self.dwells[dwell].blocks.iter().map(|block| (block.line, temperature.block(block)));
            let broken = blocks.into_iter().find(|(_, [least, most])| *least < low - far || *most > high + far);
            if let Some((line, [least, most])) = broken {
                let value = if most > high + far { most } else { least };
                let message = format!(
                    "{} reads {value:?}, and {low:.4} to {high:.4} at the set points: a broken reading; fix the row or leave the dwell \
                     out with --exclude",
                    temperature.name
                );
                self.report_dwell(Severity::Fault, name::TEMPERATURE_READING, dwell, line, message);
            }
        }
    }

    /// Whether a reading is exactly the same in two dwells at different set points: then the sensor does not work.
    fn stuck(&mut self, temperature: &Temperature) -> bool {
        let constant =
            |dwell: &Dwell| Some(temperature.range(dwell)).filter(|[low, high]| low == high).map(|[low, _]| low);
        let stuck = (1..self.dwells.len()).find(|&dwell| {
            let (before, after) = (&self.dwells[dwell - 1], &self.dwells[dwell]);
            before.set_point_c != after.set_point_c && constant(before).is_some() && constant(before) == constant(after)
        });
        if let Some(dwell) = stuck {
            let message = format!(
                "{} does not move from the set point before in any digit; is the sensor connected?",
                temperature.name
            );
            self.report_dwell(Severity::Fault, name::TEMPERATURE_REPEATED, dwell, self.dwells[dwell].lines[0], message);
        }
        stuck.is_some()
    }

    /// Dwells within which temperature moves.
    fn drift(&mut self, temperature: &Temperature) {
        let Temperature { name: column, steps, spread, digit, .. } = temperature;
        for (index, dwell) in self.dwells.iter().enumerate() {
            let [low, high] = temperature.range(dwell);
            let step = steps.at(dwell.set_point_c);
            let drifts = high - low > (DWELL_DRIFT * step).max(DWELL_NOISE * spread).max(FLICKER * digit);
            if !drifts {
                continue;
            }
            let usual = temperature.middle(dwell);
            let is_off = |block: &&Block| {
                let [low, high] = temperature.block(block);
                (low - usual).abs().max((high - usual).abs()) > 0.5 * DWELL_DRIFT * step
            };
            let line = dwell.blocks.iter().find(is_off).map_or(dwell.lines[0], |block| block.line);
            let message = format!(
                "{column} runs from {low} to {high} within the dwell, while set points are {step:.3} apart here: a broken \
                 reading, or a temperature that was not settled; fix the rows or leave the dwell out with --exclude"
            );
            self.report_dwell(Severity::Fault, name::TEMPERATURE_DRIFT, index, line, message);
        }
    }

    /// Set points while which temperature moves, and those that read as another one: they were not settled, or not
    /// reached.
    fn settled(&mut self, temperature: &Temperature, set_points: &[SetPoint]) {
        let Temperature { name: column, means, steps, digit, .. } = temperature;
        for (set_point, (at, mean)) in set_points.iter().zip(means) {
            let middles = set_point.dwells.iter().map(|&dwell| [temperature.middle(&self.dwells[dwell]); 2]);
            let [low, high] = joint_range(middles);
            let step = steps.at(*at);
            if high - low > (SET_POINT_DRIFT * step).max(FLICKER * digit) {
                let line = set_point.dwells.first().map(|&dwell| self.dwells[dwell].lines[0]);
                let message = format!(
                    "{column} moves from {low:.4} to {high:.4} while the set point is measured: the soak was too short"
                );
                self.report_set_point(Severity::Warning, name::TEMPERATURE_DRIFT, *at, line, message);
            }
            let alike = |(other, value): &&(f64, f64)| other < at && (value - mean).abs() < ALIKE * step;
            if let Some((other, _)) = means.iter().find(alike) {
                let message = format!("{column} reads as at {other} degC ({mean:.4}); was the set point reached?");
                self.report_set_point(Severity::Warning, name::SET_POINT, *at, None, message);
            }
        }
    }
}
