//! The rows of a ULog file: those of `sensor_accel`, each with the mean of `sensor_gyro` since the row before.
//!
//! Both topics are raw: PX4 takes TC_ and CAL_ off later, in `vehicle_imu`, `vehicle_imu_status` and
//! `sensor_combined`. Their rows have their own times and rates. A row of `sensor_gyro` belongs to the first row of
//! `sensor_accel` at its time or after it.

use super::super::scale::Units;
use super::super::settings::Settings;
use super::super::source::{PLACEHOLDER, Reading, Source, placeholder};
use super::imu::{Imu, LOG_ACCELERATION_PULSE, LOG_RATE_PULSE, Values, choose, devices_told, open, units};
use super::ulog::{Messages, Topic, error};
use super::ulog_format::SensorRow;
use super::vehicle::{Report, Reports, VehicleState};
use isotherm_failure::Failure;
use isotherm_finding::{Finding, name};
use isotherm_recording::RecordingError;
use isotherm_shared::wire::{AXES, device};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// From this mean interval on the rows are said to be few \[us\]: PX4 logs 1 Hz unless told otherwise.
const FEW_US: u64 = 500_000;
/// One of so many rows without a row of `sensor_gyro` is told.
const HELD_TOLD: u64 = 100;

/// Rows of an IMU.
pub(in super::super) struct UlogSource {
    messages: Messages,
    instance: u8,
    imu: Imu,
    has_gyroscopes: bool,
    vehicle: VehicleState,
    telemetry: Option<f64>,
    /// The row of `sensor_accel` that may still get rows of `sensor_gyro`.
    waiting: Option<(u64, SensorRow)>,
    gyroscopes: Means,
    /// What the topic had last.
    last: Option<Gyroscopes>,
    /// Rows that have the one before's, and rows that had none and are left out.
    held: u64,
    without: u64,
    /// Rows of another device than the first.
    others: u64,
    has_temperature: bool,
    rows: u64,
    first_us: u64,
    last_us: u64,
}

/// Sums of rows of `sensor_gyro`.
#[derive(Default)]
struct Means {
    rates: [f64; AXES],
    celsius: f64,
    count: u64,
}

/// Rates \[rad/s\] and temperature \[degC\].
#[derive(Clone, Copy)]
struct Gyroscopes {
    rates: [f64; AXES],
    celsius: Option<f64>,
}

/// What the first reading has found.
#[derive(Default)]
struct Contents {
    imus: BTreeMap<u8, Imu>,
    gyroscopes: BTreeMap<u8, Option<u32>>,
    corrected: BTreeSet<&'static str>,
    reports: Reports,
    /// Of all IMUs.
    last_us: u64,
}

impl UlogSource {
    /// Opens a log, and chooses the IMU.
    ///
    /// # Errors
    /// If it has no raw rows, or several IMUs of which none is named; of reading.
    pub(in super::super) fn open(path: &Path, settings: &Settings, telemetry: Option<f64>) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(path);
        let mut messages = Messages::new(open(path, settings)?).map_err(failed)?;
        let contents = Contents::read(&mut messages).map_err(failed)?;
        if contents.imus.is_empty() {
            return Err(failed(error(messages.place(), contents.no_rows())));
        }
        let (instance, imu) = choose(path, &contents.imus, settings.instance)?;
        let has_gyroscopes = contents.gyroscopes.contains_key(&instance);
        let messages = Messages::new(open(path, settings)?).map_err(failed)?;
        Ok(Self {
            messages,
            instance,
            imu,
            has_gyroscopes,
            vehicle: contents.reports.state(contents.last_us),
            telemetry,
            waiting: None,
            gyroscopes: Means::default(),
            last: None,
            held: 0,
            without: 0,
            others: 0,
            has_temperature: true,
            rows: 0,
            first_us: 0,
            last_us: 0,
        })
    }

    /// The next row of one of both topics, with its place.
    fn sensor(&mut self) -> Result<Option<(Topic, u64, SensorRow)>, RecordingError> {
        while let Some(data) = self.messages.next()? {
            if data.of.instance != self.instance || !matches!(data.of.topic, Topic::SensorAccel | Topic::SensorGyro) {
                continue;
            }
            let layout = data.of.layout.as_ref().map_err(|message| error(data.place, message.clone()))?;
            let row = layout.row(data.body).ok_or_else(|| {
                error(data.place, "a message that is shorter than its definition; damaged?".to_owned())
            })?;
            return Ok(Some((data.of.topic, data.place, row)));
        }
        Ok(None)
    }

    /// A row with the gyroscopes since the one before; `None` if there were none yet.
    fn finish(&mut self, place: u64, row: &SensorRow) -> Result<Option<Reading>, RecordingError> {
        let gyroscopes = match (self.gyroscopes.take(), self.last) {
            _ if !self.has_gyroscopes => None,
            (Some(means), _) => Some(means),
            (None, Some(last)) => {
                self.held += 1;
                Some(last)
            }
            (None, None) => {
                self.without += 1;
                return Ok(None);
            }
        };
        self.last = gyroscopes.or(self.last);
        if self.rows == 0 {
            self.first_us = row.time_us;
        }
        (self.rows, self.last_us) = (self.rows + 1, row.time_us);
        self.others += u64::from(row.device != self.imu.devices[0]);
        self.has_temperature &= row.celsius.is_some();
        let celsius = row.celsius.unwrap_or(PLACEHOLDER);
        let values = Values {
            acceleration: row.values,
            rate: gyroscopes.map(|gyroscopes| gyroscopes.rates),
            celsius: [celsius, gyroscopes.and_then(|gyroscopes| gyroscopes.celsius).unwrap_or(celsius)],
        };
        let reading = values.reading(place, row.time_us, self.telemetry);
        reading.map(Some).map_err(|message| error(place, format!("sensor_accel: {message}")))
    }
}

impl Source for UlogSource {
    fn read(&mut self) -> Result<Option<Reading>, RecordingError> {
        loop {
            let next = self.sensor()?;
            let is_complete = |waiting: &(u64, SensorRow)| match &next {
                Some((Topic::SensorGyro, _, row)) => row.time_us > waiting.1.time_us,
                _ => true,
            };
            let complete = self.waiting.take_if(|waiting| is_complete(waiting));
            let reading = complete.map(|(place, row)| self.finish(place, &row)).transpose()?.flatten();
            match next {
                Some((Topic::SensorGyro, _, row)) => self.gyroscopes.add(&row),
                Some((_, place, row)) => self.waiting = Some((place, row)),
                None => return Ok(reading),
            }
            if reading.is_some() {
                return Ok(reading);
            }
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        error(if place == 0 { self.messages.place() } else { place }, message)
    }

    fn unit(&self) -> Option<&'static str> {
        Some("byte")
    }

    fn units(&self) -> Result<Units, String> {
        Ok(Units { devices: self.imu.devices, ..units() })
    }

    fn has_gyroscopes(&self) -> bool {
        self.has_gyroscopes
    }

    fn device(&self) -> u64 {
        self.imu.devices[0].map_or(0, |id| device(&id.to_string()))
    }

    fn vehicle_state(&self) -> VehicleState {
        self.vehicle.clone()
    }

    fn notes(&self) -> Vec<String> {
        let instance = self.instance;
        let gyroscopes = if self.has_gyroscopes {
            format!(", G1, G2, G3 of sensor_gyro {instance}, means since the row before")
        } else {
            String::new()
        };
        let mut notes = vec![format!(
            "A1, A2, A3 are x, y, z of sensor_accel {instance}{gyroscopes}; one pulse is {LOG_ACCELERATION_PULSE:e} \
             m/s2 or {LOG_RATE_PULSE:e} rad/s; temperatures in degC"
        )];
        notes.extend(devices_told(self.imu.devices));
        if self.rows > 1 && (self.last_us - self.first_us.min(self.last_us)) / (self.rows - 1) >= FEW_US {
            let message = "sensor_accel has about one row a second, as PX4 logs by default: enough over temperature; \
                           bit 2 of SDLOG_PROFILE (thermal calibration) logs ten";
            notes.push(message.to_owned());
        }
        if self.without > 0 {
            notes.push(format!("{} rows before the first of sensor_gyro are left out", self.without));
        }
        if self.messages.unknown > 0 {
            notes.push(format!("{} messages of unknown types are left out", self.messages.unknown));
        }
        notes
    }

    fn findings(&self) -> Vec<Finding> {
        let mut found: Vec<_> = self.messages.damage.findings("byte").collect();
        let (count, ms, place) = self.messages.dropouts;
        if count > 0 {
            let seconds = ms as f64 / 1e3;
            let message = format!(
                "the logger dropped data {count} times, for {seconds} s in all, first at byte {place}: rows may be \
                 missing there; take a faster card, or log less (SDLOG_PROFILE)"
            );
            found.push(Finding::warning(name::MISSING_ROWS, message));
        }
        if self.held > self.rows / HELD_TOLD {
            let message =
                format!("{} rows have the gyroscopes of the row before: sensor_gyro has fewer rows", self.held);
            found.push(Finding::warning(name::REPEATED, message));
        }
        if self.others > 0 {
            let message = format!("{} rows are of another device than the first row's", self.others);
            found.push(Finding::fault(name::OTHER_DEVICE, message));
        }
        if !self.has_temperature {
            found.extend(placeholder(self.telemetry));
        }
        found
    }
}

impl Means {
    fn add(&mut self, row: &SensorRow) {
        self.rates.iter_mut().zip(row.values).for_each(|(sum, rate)| *sum += rate);
        self.celsius += row.celsius.unwrap_or(f64::NAN);
        self.count += 1;
    }

    /// The means, and begins anew.
    fn take(&mut self) -> Option<Gyroscopes> {
        let Self { rates, celsius, count } = core::mem::take(self);
        let mean = |sum: f64| sum / count as f64;
        let celsius = Some(mean(celsius)).filter(|celsius| celsius.is_finite());
        (count > 0).then(|| Gyroscopes { rates: rates.map(mean), celsius })
    }
}

impl Contents {
    fn read(messages: &mut Messages) -> Result<Self, RecordingError> {
        let mut contents = Self::default();
        while let Some(data) = messages.next()? {
            let row = || data.of.layout.as_ref().ok()?.row(data.body);
            let device = || row()?.device;
            match data.of.topic {
                Topic::SensorAccel => {
                    contents.last_us = row().map_or(contents.last_us, |row| row.time_us);
                    let imu = contents.imus.entry(data.of.instance).or_default();
                    if imu.rows == 0 {
                        imu.devices[0] = device();
                    }
                    imu.rows += 1;
                }
                Topic::SensorGyro => drop(contents.gyroscopes.entry(data.of.instance).or_insert_with(device)),
                Topic::Corrected(name) => drop(contents.corrected.insert(name)),
                Topic::State(state) => {
                    let read = data.of.state.and_then(|layout| layout.read(data.body));
                    let report = read.map(|(time_us, value)| Report {
                        aspect: state.aspect,
                        time_us,
                        holds: value == state.value,
                        is_change: false,
                    });
                    report.into_iter().for_each(|report| contents.reports.take(state.topic, report));
                }
                Topic::Other => {}
            }
        }
        for (instance, imu) in &mut contents.imus {
            imu.devices[1] = contents.gyroscopes.get(instance).copied().flatten();
        }
        Ok(contents)
    }

    fn no_rows(&self) -> String {
        const REMEDY: &str =
            "log again with bit 2 of SDLOG_PROFILE (thermal calibration; with the default log it is 5)";
        if self.corrected.is_empty() {
            return format!("no rows of sensor_accel; {REMEDY}");
        }
        let corrected = self.corrected.iter().copied().collect::<Vec<_>>().join(", ");
        format!("no rows of sensor_accel; {corrected} are corrected already, by TC_ and CAL_ parameters; {REMEDY}")
    }
}
