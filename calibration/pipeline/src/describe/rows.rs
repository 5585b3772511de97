//! What the rows of an IMU are.

use super::attitudes::AttitudeTally;
use isotherm_recording_formats::convert::Foreign;
use isotherm_recording_formats::read::{ImuChoice, Input, Recording};
use isotherm_shared::table::CoefficientTable;
use isotherm_shared::wire::{RawSample, Triad};
use isotherm_support::finding::{Finding, name};
use serde::Serialize;

/// From where to where a temperature goes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TemperatureSpan {
    /// The lowest one.
    pub low: f64,
    /// The highest one.
    pub high: f64,
    /// The unit; `None` of a recording, whose table has it.
    pub unit: Option<String>,
    /// Whether the data have none, and this is a placeholder.
    pub is_placeholder: bool,
}

/// An IMU, and its rows. What is not known is null.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ImuSummary {
    /// Its name, of a recording or a table that has one.
    pub imu: Option<String>,
    /// Its number in an autopilot, from 0 of PX4's and of logs, from 1 of ArduPilot's parameters.
    pub instance: Option<u32>,
    /// The numbers of its accelerometer and gyroscope, as an autopilot has them.
    pub devices: [Option<u32>; 2],
    /// Whether there are gyroscopes.
    pub gyroscopes: bool,
    /// The number of rows.
    pub rows: Option<u64>,
    /// How often the clock or the acquisition started.
    pub sessions: Option<u64>,
    /// The time from the first row to the last one of each session, added \[s\].
    pub duration_s: Option<f64>,
    /// Rows per second.
    pub rate_hz: Option<f64>,
    /// The temperature of the accelerometers.
    pub temperature: Option<TemperatureSpan>,
    /// The temperature of the gyroscopes, if they have another one.
    pub gyroscope_temperature: Option<TemperatureSpan>,
    /// How many attitudes there are, roughly.
    pub attitudes: Option<usize>,
    /// The part of the time in which it turns.
    pub turning: Option<f64>,
    /// Whether a number stands for a known acceleration, so that no table is needed.
    pub has_scale: bool,
}

impl ImuSummary {
    pub(super) fn of_table(table: &CoefficientTable) -> Self {
        let content = table.content();
        let ranges = content.axes.each_ref().map(|axis| axis.bias.range());
        let low = ranges.iter().map(|range| range[0]).fold(f64::INFINITY, f64::min);
        let high = ranges.iter().map(|range| range[1]).fold(f64::NEG_INFINITY, f64::max);
        let unit = Some(content.temperature_unit.clone());
        Self {
            imu: Some(content.imu.to_string()),
            gyroscopes: content.gyroscopes.is_some(),
            temperature: Some(TemperatureSpan { low, high, unit, is_placeholder: false }),
            has_scale: true,
            ..Self::default()
        }
    }
}

/// What is read: every row of the only IMU, or of a log's that is chosen.
pub(super) fn any_imu(foreign: Foreign) -> Input {
    Input::from((ImuChoice::Any, foreign))
}

/// What is gathered while rows are read.
#[derive(Debug, Default)]
pub(super) struct RowSummary {
    rows: u64,
    sessions: u64,
    last: Option<(u64, u64)>,
    elapsed_ns: u64,
    steps: u64,
    accelerometers: Extremes,
    gyroscopes: Extremes,
    has_gyroscopes: bool,
    attitudes: AttitudeTally,
}

#[derive(Debug, Default)]
struct Extremes(Option<[f64; 2]>);

impl Extremes {
    fn take(&mut self, triad: &Triad) {
        for value in triad.head_temperature.into_iter().filter(|value| value.is_finite()) {
            let [low, high] = self.0.get_or_insert([value; 2]);
            (*low, *high) = (low.min(value), high.max(value));
        }
    }

    fn span(&self, unit: Option<&str>, is_placeholder: bool) -> Option<TemperatureSpan> {
        let unit = unit.map(str::to_owned);
        self.0.map(|[low, high]| TemperatureSpan { low, high, unit, is_placeholder })
    }
}

impl RowSummary {
    pub(super) fn take(&mut self, row: &RawSample) {
        self.rows += 1;
        match self.last.replace((row.session, row.timestamp_ns)) {
            Some((session, before)) if session == row.session => {
                self.elapsed_ns = self.elapsed_ns.saturating_add(row.timestamp_ns.saturating_sub(before));
                self.steps += 1;
            }
            _ => self.sessions += 1,
        }
        self.accelerometers.take(&row.accelerometers);
        if !row.gyroscopes.is_absent() {
            self.has_gyroscopes = true;
            self.gyroscopes.take(&row.gyroscopes);
        }
        self.attitudes.take(row);
    }

    pub(super) fn imu(
        self,
        recording: &Recording,
        imu: Option<&str>,
        instance: Option<u32>,
        findings: &[Finding],
    ) -> ImuSummary {
        let is_foreign = recording.foreign_layout().is_some();
        let is_placeholder = findings.iter().any(|finding| finding.name == name::NO_TEMPERATURE);
        let unit = is_foreign.then_some("degC");
        let (attitudes, turning) = self.attitudes.found();
        let duration_s = self.elapsed_ns as f64 / 1e9;
        let of_log = recording.log_imu();
        let temperature = self.accelerometers.span(unit, is_placeholder);
        let of_gyroscopes = self.gyroscopes.span(unit, is_placeholder);
        ImuSummary {
            imu: imu.map(str::to_owned),
            instance: of_log.map(|imu| imu.instance).or(instance),
            devices: of_log.map(|imu| imu.devices).unwrap_or_default(),
            gyroscopes: self.has_gyroscopes,
            rows: Some(self.rows),
            sessions: Some(self.sessions),
            duration_s: Some(duration_s),
            rate_hz: (duration_s > 0.0).then(|| self.steps as f64 / duration_s),
            gyroscope_temperature: of_gyroscopes.filter(|of| self.has_gyroscopes && Some(of) != temperature.as_ref()),
            temperature,
            attitudes: Some(attitudes),
            turning: Some(turning),
            has_scale: is_foreign && recording.scale().is_ok(),
        }
    }
}
