//! The rows of a ULog file: those of `sensor_accel`, each with the mean of `sensor_gyro` since the row before.
//!
//! Both topics are raw: PX4 takes TC_ and CAL_ off later, in `vehicle_imu`, `vehicle_imu_status` and
//! `sensor_combined`. Their rows have their own times and rates. A row of `sensor_gyro` belongs to the first row of
//! `sensor_accel` at its time or after it.

use super::imu::{
    FoundImu, ImuOfLog, LOG_ACCELERATION_PULSE, LOG_RATE_PULSE, NO_TEMPERATURE, Values, choose, found, take, units,
};
use super::left_out::{Flaw, Omissions};
use super::reports::{Reports, VehicleReport};
use super::settings::{GyroscopeTemperature, LogSettings};
use super::survey::{NoThermometer, Survey};
use super::timeline::{Sieve, StampPlace};
use super::ulog::{UlogMessages, UlogTopic, error};
use super::ulog_format::SensorRow;
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::VehicleState;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, LeftOutRows, OpenData, PLACEHOLDER, placeholder};
use isotherm_recording::{LogImu, RecordingError};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::Failure;
use isotherm_support::finding::{Finding, name};
use std::collections::{BTreeMap, BTreeSet};

/// From this mean interval on the rows are said to be few \[us\]: PX4 logs 1 Hz unless configured otherwise.
const FEW_US: u64 = 500_000;
/// One of so many rows without a row of `sensor_gyro` is reported.
const HELD_TOLD: u64 = 100;
/// A row of `sensor_gyro` holds for so many mean intervals of either sensor.
const HOLDS: u64 = 5;

/// Rows of an IMU.
pub struct UlogSource {
    messages: UlogMessages,
    instance: u8,
    imu: ImuOfLog,
    thermometer: LogThermometer,
    vehicle: VehicleState,
    temperature: Option<f64>,
    accelerometer: SensorRows,
    gyroscope: SensorRows,
    /// The row of `sensor_accel` that may still get rows of `sensor_gyro`.
    waiting: Option<(u64, SensorRow)>,
    means: RateMeans,
    /// What `sensor_gyro` had last, and when.
    last: Option<(u64, GyroscopeMeans)>,
    /// What was lost until then: bytes, rows and dropouts.
    lost: u64,
    /// Rows that have the one before's, and rows that had none and are left out.
    held: u64,
    without: u64,
    has_temperature: bool,
    rows: u64,
    first_us: u64,
    last_us: u64,
}

/// Rows of one of both topics, of which some are left out.
struct SensorRows {
    topic: &'static str,
    sieve: Sieve,
    left_out: Omissions,
}

/// Whose temperature the gyroscopes have.
#[derive(Clone, Copy, PartialEq)]
enum LogThermometer {
    /// There are no gyroscopes.
    NoGyroscopes,
    Own,
    /// There are none in the rows, because they have no temperature.
    Missing(NoThermometer),
    Accelerometer,
    /// That of all rows is given.
    Given,
}

/// Sums of rows of `sensor_gyro`.
#[derive(Default)]
struct RateMeans {
    rates: [f64; AXES],
    celsius: f64,
    count: u64,
    last_us: u64,
}

/// Rates \[rad/s\] and temperature \[degC\]; NaN without one.
#[derive(Clone, Copy)]
struct GyroscopeMeans {
    rates: [f64; AXES],
    celsius: f64,
}

/// What the first reading has found.
#[derive(Default)]
struct UlogContents {
    accelerometers: BTreeMap<u8, Survey>,
    gyroscopes: BTreeMap<u8, Survey>,
    corrected: BTreeSet<&'static str>,
    reports: Reports,
}

impl UlogSource {
    /// Opens a log, and chooses the IMU.
    ///
    /// # Errors
    /// If it has no raw rows, or several IMUs of which none is named; of reading.
    pub fn open(mut data: OpenData<'_>, settings: &LogSettings, temperature: Option<f64>) -> Result<Self, Failure> {
        let path = data.source.name();
        let failed = |error: RecordingError| error.failure(path);
        let contents = UlogContents::of(&mut data)?;
        let refused = |message: String| failed(error(0, message));
        let (instance, imu) = choose(path, &contents.imus(), settings)?;
        let nothing = Survey::default();
        let of = |all: &BTreeMap<u8, Survey>, topic| {
            let rows = SensorRows::new(topic, all.get(&instance).unwrap_or(&nothing));
            rows.map_err(refused)
        };
        let accelerometer = of(&contents.accelerometers, "sensor_accel")?;
        let gyroscope = of(&contents.gyroscopes, "sensor_gyro")?;
        let surveys = (contents.accelerometers.get(&instance), contents.gyroscopes.get(&instance));
        let thermometer = match surveys {
            (Some(accelerometers), Some(gyroscopes)) => {
                LogThermometer::new(accelerometers, gyroscopes, temperature, settings.gyroscope_temperature)
            }
            _ => LogThermometer::NoGyroscopes,
        };
        let vehicle = contents.reports.state(accelerometer.sieve.kept().last_us);
        let messages = UlogMessages::new(data.again(&settings.progress)?).map_err(failed)?;
        Ok(Self {
            messages,
            instance,
            imu,
            thermometer,
            vehicle,
            temperature,
            accelerometer,
            gyroscope,
            waiting: None,
            means: RateMeans::default(),
            last: None,
            lost: 0,
            held: 0,
            without: 0,
            has_temperature: true,
            rows: 0,
            first_us: 0,
            last_us: 0,
        })
    }

    /// The IMUs of a log.
    ///
    /// # Errors
    /// If it has no raw rows; of reading.
    pub fn imus(mut data: OpenData<'_>) -> Result<Vec<FoundImu>, Failure> {
        UlogContents::of(&mut data).map(|contents| found(&contents.imus()))
    }

    /// The next row of one of both topics that is not left out, with its place.
    fn sensor(&mut self) -> Result<Option<(UlogTopic, u64, SensorRow)>, RecordingError> {
        while let Some(data) = self.messages.next()? {
            let (rows, device) = match data.of.topic {
                UlogTopic::SensorAccel => (&mut self.accelerometer, self.imu.devices[0]),
                UlogTopic::SensorGyro => (&mut self.gyroscope, self.imu.devices[1]),
                _ => continue,
            };
            if data.of.instance != self.instance {
                continue;
            }
            let layout = data.of.layout.as_ref().map_err(|message| error(data.place, message.clone()))?;
            let Some(row) = layout.row(data.body) else { continue };
            if rows.take(data.place, &row, device) {
                return Ok(Some((data.of.topic, data.place, row)));
            }
        }
        Ok(None)
    }

    /// Takes a row of `sensor_gyro`.
    fn rate(&mut self, place: u64, row: &SensorRow) {
        let is_real = row.values.iter().all(|value| value.is_finite());
        let has_temperature = row.celsius.is_none_or(f64::is_finite) || self.thermometer != LogThermometer::Own;
        match (is_real, has_temperature) {
            (false, _) => self.gyroscope.left_out.take(Flaw::Value, place),
            (true, false) => self.gyroscope.left_out.take(Flaw::Temperature, place),
            (true, true) => {
                let stale_us = HOLDS.saturating_mul(self.gyroscope.sieve.kept().mean_us());
                if row.time_us.saturating_sub(self.means.last_us) > stale_us {
                    // The row of sensor_accel that these belong to is lost.
                    self.means = RateMeans::default();
                }
                self.means.add(row);
                self.lost = self.lost_so_far();
            }
        }
    }

    /// Bytes, rows and dropouts.
    fn lost_so_far(&self) -> u64 {
        self.messages.damage.count() + self.messages.dropouts.0 + self.gyroscope.left_out.total()
    }

    /// The rates of a row: the means since the one before, otherwise the last ones. `Err` if there is none near.
    fn rates(&mut self, row: &SensorRow) -> Result<GyroscopeMeans, Option<Flaw>> {
        let mean_us = [&self.accelerometer, &self.gyroscope].map(|rows| rows.sieve.kept().mean_us());
        let mean_us = mean_us[0].max(mean_us[1]);
        let is_lost = self.lost_so_far() != self.lost;
        let age_us = |time_us: u64| row.time_us.saturating_sub(time_us);
        if let Some((time_us, means)) = self.means.take() {
            self.last = Some((time_us, means));
            // Where something was lost, those of this row may be among it.
            return if is_lost && age_us(time_us) > mean_us { Err(Some(Flaw::NoGyroscopes)) } else { Ok(means) };
        }
        let Some((time_us, last)) = self.last else { return Err(None) };
        let is_near = !is_lost && age_us(time_us) <= HOLDS.saturating_mul(mean_us);
        is_near.then_some(last).ok_or(Some(Flaw::NoGyroscopes))
    }

    /// A row with the gyroscopes since the one before; `None` if it is left out.
    fn finish(&mut self, place: u64, row: &SensorRow) -> Option<ForeignRow> {
        let is_held = self.means.count == 0;
        let gyroscopes = match self.thermometer.has_gyroscopes().then(|| self.rates(row)) {
            None => None,
            Some(Ok(gyroscopes)) => Some(gyroscopes),
            Some(Err(None)) => {
                self.without += 1;
                return None;
            }
            Some(Err(Some(flaw))) => {
                self.accelerometer.left_out.take(flaw, place);
                return None;
            }
        };
        let celsius = row.celsius.unwrap_or(PLACEHOLDER);
        let own = gyroscopes.filter(|_| self.thermometer == LogThermometer::Own).map(|gyroscopes| gyroscopes.celsius);
        let values = Values {
            acceleration: row.values,
            rate: gyroscopes.map(|gyroscopes| gyroscopes.rates),
            celsius: [celsius, own.unwrap_or(celsius)],
        };
        match values.reading(place, row.time_us, self.temperature) {
            Ok(reading) => {
                self.count(row, gyroscopes.is_some() && is_held);
                Some(reading)
            }
            Err(flaw) => {
                self.accelerometer.left_out.take(flaw, place);
                None
            }
        }
    }

    fn count(&mut self, row: &SensorRow, is_held: bool) {
        if self.rows == 0 {
            self.first_us = row.time_us;
        }
        (self.rows, self.last_us) = (self.rows + 1, row.time_us);
        self.held += u64::from(is_held);
        self.has_temperature &= row.celsius.is_some();
    }
}

impl SensorRows {
    fn new(topic: &'static str, survey: &Survey) -> Result<Self, String> {
        Ok(Self { topic, sieve: Sieve::new(survey.kept(topic)?), left_out: Omissions::default() })
    }

    /// Whether the next row is used.
    fn take(&mut self, place: u64, row: &SensorRow, device: Option<u32>) -> bool {
        let flaw = match self.sieve.next(row.time_us) {
            StampPlace::Wild => Flaw::Time,
            StampPlace::Repeats => Flaw::Repeated,
            StampPlace::Follows if row.device != device => Flaw::Device,
            StampPlace::Follows => return true,
        };
        self.left_out.take(flaw, place);
        false
    }

    /// The name of the sensor.
    fn of(&self, instance: u8) -> String {
        format!("{} {instance}", self.topic)
    }
}

impl LogThermometer {
    fn new(
        accelerometers: &Survey,
        gyroscopes: &Survey,
        temperature: Option<f64>,
        wanted: GyroscopeTemperature,
    ) -> Self {
        match (temperature, wanted) {
            (Some(_), _) => Self::Given,
            (None, GyroscopeTemperature::Accelerometer) => Self::Accelerometer,
            (None, GyroscopeTemperature::Own) => match gyroscopes.no_thermometer(accelerometers) {
                Some(why) => Self::Missing(why),
                None => Self::Own,
            },
        }
    }

    const fn has_gyroscopes(self) -> bool {
        !matches!(self, Self::NoGyroscopes | Self::Missing(_))
    }
}

impl ForeignRows for UlogSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            let next = self.sensor()?;
            let is_complete = |waiting: &(u64, SensorRow)| match &next {
                Some((UlogTopic::SensorGyro, _, row)) => row.time_us > waiting.1.time_us,
                _ => true,
            };
            let complete = self.waiting.take_if(|waiting| is_complete(waiting));
            let reading = complete.and_then(|(place, row)| self.finish(place, &row));
            match next {
                Some((UlogTopic::SensorGyro, place, row)) => self.rate(place, &row),
                Some((_, place, row)) => self.waiting = Some((place, row)),
                None => return Ok(reading),
            }
            if reading.is_some() {
                return Ok(reading);
            }
        }
    }

    fn no_rows(&self) -> String {
        let mut why = vec!["no row can be used".to_owned()];
        why.extend(self.accelerometer.left_out.told(&self.accelerometer.of(self.instance), "byte"));
        why.extend(self.gyroscope.left_out.told(&self.gyroscope.of(self.instance), "byte"));
        if self.accelerometer.left_out.count(Flaw::Temperature) > 0 {
            why.push(NO_TEMPERATURE.to_owned());
        }
        why.join("; ")
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

    fn are_readings(&self) -> [bool; 2] {
        [true; 2]
    }

    fn has_gyroscopes(&self) -> bool {
        self.thermometer.has_gyroscopes()
    }

    fn has_temperature(&self) -> bool {
        self.has_temperature && self.temperature.is_none()
    }

    fn device(&self) -> u64 {
        self.imu.named(self.instance).device()
    }

    fn log_imu(&self) -> Option<LogImu> {
        Some(self.imu.named(self.instance))
    }

    fn vehicle_state(&self) -> VehicleState {
        self.vehicle.clone()
    }

    fn notes(&self) -> Vec<String> {
        let instance = self.instance;
        let gyroscopes = if self.has_gyroscopes() {
            format!(", G1, G2, G3 of sensor_gyro {instance}, means since the row before")
        } else {
            String::new()
        };
        let mut notes = vec![format!(
            "A1, A2, A3 are x, y, z of sensor_accel {instance}{gyroscopes}; one pulse is {LOG_ACCELERATION_PULSE:e} \
             m/s2 or {LOG_RATE_PULSE:e} rad/s; temperatures in degC"
        )];
        notes.extend(self.imu.named(self.instance).devices_told());
        if self.thermometer == LogThermometer::Accelerometer {
            notes.push("the temperature of the gyroscopes is that of the accelerometers, as asked for".to_owned());
        }
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

    fn left_out_by_stamps(&self) -> LeftOutRows {
        let of = |rows: &SensorRows| rows.left_out.by_times(rows.sieve.kept().count);
        of(&self.accelerometer).or_more(of(&self.gyroscope))
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
        for rows in [&self.accelerometer, &self.gyroscope] {
            found.extend(rows.left_out.findings(&rows.of(self.instance), "byte", self.rows));
        }
        found.extend(self.no_gyroscopes());
        if !self.has_temperature {
            found.extend(placeholder(self.temperature));
        }
        found
    }
}

impl UlogSource {
    /// Why the rows have no gyroscopes, although the log has.
    fn no_gyroscopes(&self) -> Option<Finding> {
        let LogThermometer::Missing(why) = self.thermometer else { return None };
        let why = match why {
            NoThermometer::None => "sensor_gyro has no temperature in any row".to_owned(),
            NoThermometer::Stands { at, other } => {
                format!(
                    "the temperature of sensor_gyro stands at {at} degC, while that of sensor_accel moves by {other:.1} degC"
                )
            }
        };
        let message = format!(
            "{why}: the rows have no gyroscopes; --gyroscope-temperature accelerometer takes the temperature of the \
             accelerometers for them"
        );
        Some(Finding::warning(name::NO_TEMPERATURE, message))
    }
}

impl RateMeans {
    fn add(&mut self, row: &SensorRow) {
        self.rates.iter_mut().zip(row.values).for_each(|(sum, rate)| *sum += rate);
        self.celsius += row.celsius.unwrap_or(f64::NAN);
        self.count += 1;
        self.last_us = row.time_us;
    }

    /// The time of the last row and the means, and begins anew.
    fn take(&mut self) -> Option<(u64, GyroscopeMeans)> {
        let Self { rates, celsius, count, last_us } = core::mem::take(self);
        let mean = |sum: f64| sum / count as f64;
        (count > 0).then(|| (last_us, GyroscopeMeans { rates: rates.map(mean), celsius: mean(celsius) }))
    }
}

impl UlogContents {
    /// What a log has: one IMU at least.
    fn of(data: &mut OpenData<'_>) -> Result<Self, Failure> {
        let bytes = take(data)?;
        let failed = |error: RecordingError| error.failure(data.name());
        let mut messages = UlogMessages::new(bytes).map_err(failed)?;
        let contents = Self::read(&mut messages).map_err(failed)?;
        if contents.accelerometers.is_empty() {
            return Err(failed(error(messages.place(), contents.no_rows())));
        }
        Ok(contents)
    }

    fn read(messages: &mut UlogMessages) -> Result<Self, RecordingError> {
        let mut contents = Self::default();
        while let Some(data) = messages.next()? {
            let surveys = match data.of.topic {
                UlogTopic::SensorAccel => &mut contents.accelerometers,
                UlogTopic::SensorGyro => &mut contents.gyroscopes,
                UlogTopic::Corrected(name) => {
                    contents.corrected.insert(name);
                    continue;
                }
                UlogTopic::State(state) => {
                    let read = data.of.state.and_then(|layout| layout.read(data.body));
                    let report = read.map(|(time_us, value)| VehicleReport {
                        aspect: state.aspect,
                        time_us,
                        holds: value == state.value,
                        is_change: false,
                    });
                    report.into_iter().for_each(|report| contents.reports.take(state.topic, report));
                    continue;
                }
                UlogTopic::Other => continue,
            };
            // The second reading says what is wrong with a definition.
            let survey = surveys.entry(data.of.instance).or_default();
            if let Some(row) = data.of.layout.as_ref().ok().and_then(|layout| layout.row(data.body)) {
                survey.take(row.time_us, row.device, row.celsius);
            }
        }
        Ok(contents)
    }

    fn imus(&self) -> BTreeMap<u8, ImuOfLog> {
        let imu = |(instance, survey): (&u8, &Survey)| {
            let devices = [survey.device(), self.gyroscopes.get(instance).and_then(Survey::device)];
            (*instance, ImuOfLog { rows: survey.rows(), devices })
        };
        self.accelerometers.iter().map(imu).collect()
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
