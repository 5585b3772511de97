//! The rates of all sensors, and the noise of each.

use super::bridge::fill;
use super::counts::{CountChanges, new_part, scatter};
use super::curve::{Allan, TemperatureLine};
use super::rate::RateKind;
use super::rows::{Cursor, Rows};
use super::sensor::SensorNoise;
use super::stretch::Stretch;
use core::ops::Range;
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::{AXES, Flags, RawSample, Triad};
use isotherm_support::checkpoint::checkpoint;
use isotherm_support::finding::{Finding, name};

/// The outputs of rows: compensated, or net counts a second.
pub(super) struct Outputs<'a> {
    table: Option<&'a CoefficientTable>,
    /// Whether there are gyroscopes among them.
    gyroscopes: bool,
}

/// What the counts of a sensor say.
struct OfCounts {
    scatter: f64,
    changes: Option<CountChanges>,
    new_part: Option<f64>,
}

/// The rows that are analysed.
pub(super) struct AnalysisSpan {
    pub stretch: Stretch,
    pub interval_s: f64,
    /// Begin of the first of them since that of the recording \[s\].
    pub begin_s: f64,
}

impl<'a> Outputs<'a> {
    /// Of a recording with gyroscopes or without.
    pub(super) fn new(table: Option<&'a CoefficientTable>, recorded: bool) -> (Self, Option<Finding>) {
        let in_table = table.map(|table| table.content().gyroscopes.is_some());
        let message = match in_table {
            Some(true) if !recorded => Some("the recording has no gyroscopes, but the table has"),
            Some(false) if recorded => Some("the gyroscopes are left out: the table has none"),
            _ => None,
        };
        let finding = message.map(|message| Finding::warning(name::NO_GYROSCOPES, message.to_owned()));
        (Self { table, gyroscopes: recorded && in_table != Some(false) }, finding)
    }

    /// The number of sensors.
    fn count(&self) -> usize {
        if self.gyroscopes { 2 * AXES } else { AXES }
    }

    /// The rates of all sensors in a row, of which there may be fewer, and whether it is another unit's.
    pub(super) fn rates(&self, row: &RawSample) -> ([f64; 2 * AXES], bool) {
        let seconds = row.interval_ns as f64 / 1e9;
        let Some(table) = self.table else {
            return (core::array::from_fn(|sensor| net_counts(triad(row, sensor), sensor % AXES) / seconds), false);
        };
        let (it, gravity) = (answer(Some(table), row), table.content().gravity);
        let rates = core::array::from_fn(|sensor| {
            let increment = match sensor {
                0..AXES => it.velocity_increment[sensor] / gravity,
                // Seconds of arc a second are deg/h.
                _ => it.angle_increment[sensor - AXES] / ARCSEC,
            };
            increment / seconds
        });
        (rates, Flags(it.flags).intersects(Flags::OTHER_DEVICE))
    }

    /// Whether the rates of all sensors are numbers.
    pub(super) fn are_finite(&self, rates: &[f64; 2 * AXES]) -> bool {
        rates[..self.count()].iter().all(|rate| rate.is_finite())
    }

    /// The noise of each sensor. The rows become fewer with each: they take most of the memory.
    pub(super) fn noise(&self, mut rows: Rows, analysed: &AnalysisSpan) -> Vec<SensorNoise> {
        let count = rows.len();
        rows.pulses.resize_with(self.count(), || vec![0; count]);
        let of_counts: Vec<_> = rows.pulses.iter().map(|pulses| OfCounts::of(pulses, &analysed.stretch)).collect();
        self.replace_by_rates(&mut rows, analysed.stretch.rows());
        rows.forget_times();
        let sensors = of_counts.into_iter().enumerate();
        sensors.map(|(sensor, of_counts)| self.noise_of(sensor, &mut rows, analysed, of_counts)).collect()
    }

    /// Puts the rates into the place of the counts.
    fn replace_by_rates(&self, rows: &mut Rows, used: Range<usize>) {
        let mut cursor = Cursor::default();
        for row in 0..used.end {
            if row % 4096 == 0 {
                checkpoint();
            }
            let Some(sample) = cursor.next(rows) else { break };
            if row >= used.start {
                let (rates, _) = self.rates(&sample);
                rows.pulses.iter_mut().zip(rates).for_each(|(of, rate)| of[row] = rate.to_bits());
            }
        }
    }

    /// The noise of a sensor, with random numbers of its own where rows are missing.
    fn noise_of(&self, sensor: usize, rows: &mut Rows, analysed: &AnalysisSpan, of_counts: OfCounts) -> SensorNoise {
        let (interval_s, axis) = (analysed.interval_s, sensor % AXES);
        let (kind, rate) = match (sensor / AXES, self.table) {
            (0, None) => (SensorKind::Accelerometer, RateKind::Counts),
            (0, Some(_)) => (SensorKind::Accelerometer, RateKind::SpecificForce),
            (_, None) => (SensorKind::Gyroscope, RateKind::Counts),
            (_, Some(_)) => (SensorKind::Gyroscope, RateKind::AngularRate),
        };
        let mut rates = rates(core::mem::take(&mut rows.pulses[sensor]), &analysed.stretch);
        fill(&mut rates, sensor as u64);
        let mean = rates.iter().sum::<f64>() / rates.len() as f64;
        let mut allan = Allan::without_steps(&mut rates, interval_s);
        let mut line = allan.as_ref().and_then(|allan| {
            let temperature = temperature(rows, sensor, &analysed.stretch);
            TemperatureLine::taken_off(&mut rates, &temperature, interval_s, allan)
        });
        for step in allan.iter_mut().chain(line.as_mut().map(|line| &mut line.without)).flat_map(|it| &mut it.steps) {
            step.at_s += analysed.begin_s;
        }
        let white_counts = allan.as_ref().and_then(|allan| {
            let [_, white, ..] = allan.model.as_ref()?.coefficients;
            // Counts over the output, as the ratio of their Allan deviations over one row.
            let ratio = of_counts.scatter / allan.points.first()?.adev;
            Some(white.below().unwrap_or(white.value) / interval_s.sqrt() * ratio)
        });
        SensorNoise {
            name: kind.names()[axis],
            sensor: kind,
            kind: rate,
            mean,
            allan,
            line,
            white_counts,
            changes: of_counts.changes,
            new_every_s: of_counts.new_part.map(|part| interval_s / part),
        }
    }
}

impl OfCounts {
    fn of(pulses: &[u64], stretch: &Stretch) -> Self {
        let net = |both: u64| (both >> 32) as f64 - f64::from(both as u32);
        let counts = stretch.values(|row| net(pulses[row]));
        Self { scatter: scatter(&counts), changes: CountChanges::of(&counts), new_part: new_part(&counts) }
    }
}

/// The rates of a stretch, NaN where a row is missing.
fn rates(mut bits: Vec<u64>, stretch: &Stretch) -> Vec<f64> {
    match stretch.runs() {
        // They stay where they are.
        [run] => {
            bits.truncate(run.rows.end);
            bits.drain(..run.rows.start);
            bits.into_iter().map(f64::from_bits).collect()
        }
        _ => stretch.values(|row| f64::from_bits(bits[row])),
    }
}

/// Head temperature of a stretch, on a straight line where rows are missing.
fn temperature(rows: &Rows, sensor: usize, stretch: &Stretch) -> Vec<f64> {
    let (mut changes, mut value) = (rows.head(sensor).peekable(), f64::NAN);
    let mut values = stretch.values(|row| {
        while let Some((_, next)) = changes.next_if(|(from, _)| *from <= row) {
            value = next;
        }
        value
    });
    let mut end = 0;
    for run in stretch.runs() {
        end += run.rows.len();
        if run.missing > 0 {
            let (from, length) = (values[end - 1], (run.missing + 1) as f64);
            let slope = (values[end + run.missing] - from) / length;
            (1..=run.missing).for_each(|n| values[end - 1 + n] = from + slope * n as f64);
            end += run.missing;
        }
    }
    values
}

fn triad(row: &RawSample, sensor: usize) -> &Triad {
    if sensor < AXES { &row.accelerometers } else { &row.gyroscopes }
}

fn net_counts(triad: &Triad, axis: usize) -> f64 {
    f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])
}
