//! The rates of all sensors, and the noise of each.

use super::bridge::fill;
use super::counts::{CountChanges, new_part, scatter};
use super::curve::{Allan, TemperatureLine};
use super::rate::RateKind;
use super::sensor::SensorNoise;
use isotherm_finding::{Finding, name};
use isotherm_shared::compensate::answer;
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::units::{ARCSEC, SensorKind};
use isotherm_shared::wire::{AXES, Flags, RawSample, Triad};

/// The rates of all sensors over all rows.
pub(super) struct Outputs {
    pub sensors: Vec<Sensor>,
    pub findings: Vec<Finding>,
}

pub(super) struct Sensor {
    kind: SensorKind,
    axis: usize,
    rate: RateKind,
    rates: Vec<f64>,
}

impl Outputs {
    pub(super) fn of(rows: &[RawSample], table: Option<&CoefficientTable>) -> Self {
        let recorded = rows.iter().any(|row| !row.gyroscopes.is_absent());
        let in_table = table.map(|table| table.content().gyroscopes.is_some());
        let message = match in_table {
            Some(true) if !recorded => Some("the recording has no gyroscopes, but the table has"),
            Some(false) if recorded => Some("the gyroscopes are left out: the table has none"),
            _ => None,
        };
        let finding = message.map(|message| Finding::warning(name::NO_GYROSCOPES, message.to_owned()));
        let mut findings: Vec<_> = finding.into_iter().collect();
        let triads = if recorded && in_table != Some(false) {
            &[SensorKind::Accelerometer, SensorKind::Gyroscope][..]
        } else {
            &[SensorKind::Accelerometer][..]
        };
        let mut other_device = 0_u64;
        let mut sensors: Vec<Sensor> = (triads.iter().flat_map(|kind| (0..AXES).map(|axis| (*kind, axis))))
            .map(|(kind, axis)| {
                let rate = match (table, kind) {
                    (None, _) => RateKind::Counts,
                    (Some(_), SensorKind::Accelerometer) => RateKind::SpecificForce,
                    (Some(_), SensorKind::Gyroscope) => RateKind::AngularRate,
                };
                Sensor { kind, axis, rate, rates: Vec::with_capacity(rows.len()) }
            })
            .collect();
        for row in rows {
            let seconds = row.interval_ns as f64 / 1e9;
            let compensated = table.map(|table| (answer(Some(table), row), table.content().gravity));
            other_device +=
                u64::from(compensated.is_some_and(|(it, _)| Flags(it.flags).intersects(Flags::OTHER_DEVICE)));
            for sensor in &mut sensors {
                let increment = match (compensated, sensor.kind) {
                    (None, kind) => net_counts(triad(row, kind), sensor.axis),
                    (Some((it, gravity)), SensorKind::Accelerometer) => it.velocity_increment[sensor.axis] / gravity,
                    // Seconds of arc a second are deg/h.
                    (Some((it, _)), SensorKind::Gyroscope) => it.angle_increment[sensor.axis] / ARCSEC,
                };
                sensor.rates.push(increment / seconds);
            }
        }
        if let Some(table) = table.filter(|_| other_device > 0) {
            findings.push(isotherm_recording::other_device(table, other_device));
        }
        Self { sensors, findings }
    }

    pub(super) fn is_finite(&self, row: usize) -> bool {
        self.sensors.iter().all(|sensor| sensor.rates[row].is_finite())
    }
}

impl Sensor {
    /// Its noise, with random numbers of this stream where rows are missing.
    pub(super) fn noise(&self, analysed: &Analysed<'_>, stream: u64) -> SensorNoise {
        let interval_s = analysed.interval_s;
        let mut rates = analysed.values(|row| self.rates[row]);
        fill(&mut rates, stream);
        let mut allan = Allan::of(&rates, interval_s);
        let telemetry = analysed.telemetry(|row| triad(row, self.kind).head_temperature[self.axis]);
        let mut line = allan.as_ref().and_then(|allan| TemperatureLine::of(&rates, &telemetry, interval_s, allan));
        for step in allan.iter_mut().chain(line.as_mut().map(|line| &mut line.without)).flat_map(|it| &mut it.steps) {
            step.at_s += analysed.begin_s;
        }
        let counts = analysed.values(|row| net_counts(triad(&analysed.rows[row], self.kind), self.axis));
        let white_counts = allan.as_ref().and_then(|allan| {
            let [_, white, ..] = allan.model.as_ref()?.coefficients;
            // Counts over the output, as the ratio of their Allan deviations over one row.
            let ratio = scatter(&counts) / allan.points.first()?.adev;
            Some(white.below().unwrap_or(white.value) / interval_s.sqrt() * ratio)
        });
        SensorNoise {
            name: self.kind.names()[self.axis],
            sensor: self.kind,
            kind: self.rate,
            mean: rates.iter().sum::<f64>() / rates.len() as f64,
            allan,
            line,
            white_counts,
            changes: CountChanges::of(&counts),
            new_every_s: new_part(&counts).map(|part| interval_s / part),
        }
    }
}

/// What is analysed.
pub(super) struct Analysed<'a> {
    /// All rows.
    pub rows: &'a [RawSample],
    /// The rows that are analysed, at regular times; `None` where one is missing.
    pub places: Vec<Option<usize>>,
    pub interval_s: f64,
    /// Begin of the first of them since that of the recording \[s\].
    pub begin_s: f64,
}

impl Analysed<'_> {
    /// Values of rows, NaN where a row is missing.
    fn values(&self, of: impl Fn(usize) -> f64) -> Vec<f64> {
        self.places.iter().map(|row| row.map_or(f64::NAN, &of)).collect()
    }

    /// Telemetry of rows, on a straight line where rows are missing.
    fn telemetry(&self, of: impl Fn(&RawSample) -> f64) -> Vec<f64> {
        let mut values = self.values(|row| of(&self.rows[row]));
        let mut last = 0;
        for place in (0..values.len()).filter(|place| self.places[*place].is_some()) {
            let (from, length) = (values[last], (place - last) as f64);
            let slope = (values[place] - from) / length;
            values[last..place].iter_mut().enumerate().skip(1).for_each(|(n, value)| *value = from + slope * n as f64);
            last = place;
        }
        values
    }
}

fn triad(row: &RawSample, kind: SensorKind) -> &Triad {
    match kind {
        SensorKind::Accelerometer => &row.accelerometers,
        SensorKind::Gyroscope => &row.gyroscopes,
    }
}

fn net_counts(triad: &Triad, axis: usize) -> f64 {
    f64::from(triad.positive_pulses[axis]) - f64::from(triad.negative_pulses[axis])
}
