//! The rows of a DataFlash log: those of `IMU`, with what ArduPilot had corrected undone.

use super::super::scale::Units;
use super::super::settings::Settings;
use super::super::source::{PLACEHOLDER, Reading, Source, placeholder};
use super::dataflash::{Message, Messages};
use super::dataflash_format::ImuColumns;
use super::imu::{Imu, LOG_ACCELERATION_PULSE, LOG_RATE_PULSE, Values, choose, devices_told, open, units};
use super::undo::{Corrections, concerns, devices};
use super::vehicle::{Aspect, Report, Reports, VehicleState};
use isotherm_failure::{Exit, Failure, shown};
use isotherm_finding::{Finding, name};
use isotherm_recording::RecordingError;
use isotherm_shared::wire::{AXES, device};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Most parameters that are kept; ArduPilot has about 150 of IMUs.
const MAX_PARAMETERS: usize = 4096;
/// Letters of the units of specific force, rate and temperature, by which `FMTU` names them.
const UNITS: [(&str, char); 3] = [("AccX", 'o'), ("GyrX", 'E'), ("T", 'O')];

/// Rows of an IMU.
pub(in super::super) struct DataFlashSource {
    messages: Messages,
    instance: u8,
    imu: Imu,
    vehicle: VehicleState,
    telemetry: Option<f64>,
    /// As they stand at the row.
    parameters: HashMap<String, f64>,
    corrections: Corrections,
    /// What is undone from the beginning, in words.
    undone: String,
    /// Parameters that changed within the log: how many times, the first, and its place.
    changes: (u64, String, u64),
    /// Rows of sensors that report to be ill.
    ill: u64,
    has_temperature: bool,
}

/// What the first reading has found.
#[derive(Default)]
struct Contents {
    imus: BTreeMap<u8, Imu>,
    /// The first value of each. The log lists them all at its beginning, while the first rows come.
    parameters: HashMap<String, f64>,
    learnt: u64,
    reports: Reports,
    /// Of all IMUs.
    last_us: u64,
}

impl DataFlashSource {
    /// Opens a log, and chooses the IMU.
    ///
    /// # Errors
    /// If it has no rows, corrections that cannot be undone, or several IMUs of which none is named; of reading.
    pub(in super::super) fn open(
        path: &Path,
        settings: &Settings,
        telemetry: Option<f64>,
        is_text: bool,
    ) -> Result<Self, Failure> {
        let refused = |message: &str| Failure::new(Exit::Data, format!("{}: {message}", shown(path)));
        let mut first = Messages::new(open(path, settings)?, is_text);
        let failed = |error: RecordingError| error.failure(path);
        let mut contents = Contents::read(&mut first).map_err(failed)?;
        if contents.imus.is_empty() {
            return Err(failed(first.error(0, contents.no_rows())));
        }
        for (instance, imu) in &mut contents.imus {
            imu.devices = devices(&contents.parameters, *instance);
        }
        let (instance, imu) = choose(path, &contents.imus, settings.instance)?;
        let corrections = Corrections::new(&contents.parameters, instance).map_err(|message| refused(&message))?;
        Ok(Self {
            messages: Messages::new(open(path, settings)?, is_text),
            instance,
            imu,
            vehicle: contents.reports.state(contents.last_us),
            telemetry,
            parameters: contents.parameters,
            undone: corrections.told(),
            corrections,
            changes: (0, String::new(), 0),
            ill: 0,
            has_temperature: true,
        })
    }

    /// Takes a parameter that may have changed.
    fn set(&mut self, place: u64, name: String, value: f64) -> Result<(), String> {
        if !self.parameters.get(&name).is_some_and(|old| *old != value) {
            return Ok(());
        }
        self.parameters.insert(name.clone(), value);
        let new = Corrections::new(&self.parameters, self.instance)?;
        if new.turns_unlike(&self.corrections) {
            return Err(format!("{name} changes to {value} within the log; split it there, or log again"));
        }
        if new != self.corrections {
            if self.changes.0 == 0 {
                (self.changes.1, self.changes.2) = (format!("{name} = {value}"), place);
            }
            self.changes.0 += 1;
            self.corrections = new;
        }
        Ok(())
    }

    fn reading(&mut self, row: &Row) -> Result<Reading, String> {
        self.ill += u64::from(!row.is_healthy);
        self.has_temperature &= row.celsius.is_some();
        let celsius = row.celsius.or(self.telemetry).unwrap_or(PLACEHOLDER);
        let [acceleration, rate] = self.corrections.undo(row.logged, celsius);
        let values = Values { acceleration, rate: Some(rate), celsius: [celsius; 2] };
        values.reading(row.place, row.time_us, self.telemetry)
    }
}

/// A row of `IMU`, as it is logged.
struct Row {
    place: u64,
    time_us: u64,
    /// \[m/s2, rad/s\]
    logged: [[f64; AXES]; 2],
    celsius: Option<f64>,
    is_healthy: bool,
}

/// What a message says.
enum Said {
    Row(u8, Row),
    Parameter(String, f64),
    /// Of a definition, letters of the units of its columns.
    Units(u8, String),
    Learnt,
    /// Of the vehicle, with the name of the message.
    Reports(&'static str, Vec<Report>),
    Nothing,
}

/// Numbers of `EV`: what holds from then on, or no more.
const EVENTS: [(u8, Aspect, bool); 4] =
    [(10, Aspect::Armed, true), (11, Aspect::Armed, false), (28, Aspect::Flying, true), (18, Aspect::Flying, false)];

impl Message<'_> {
    fn said(&self) -> Result<Said, String> {
        let Message { format, body, .. } = self;
        Ok(match format.name.as_str() {
            "TCLR" => Said::Learnt,
            "EV" => Said::Reports("EV", self.event().into_iter().collect()),
            "ARM" => Said::Reports("ARM", self.state("ArmState", Aspect::Armed, true).into_iter().collect()),
            "STAT" => {
                let all = [("Armed", Aspect::Armed), ("isFlying", Aspect::Flying)];
                Said::Reports(
                    "STAT",
                    all.into_iter().filter_map(|(name, aspect)| self.state(name, aspect, false)).collect(),
                )
            }
            "PARM" => {
                let name = format.column("Name").and_then(|column| format.text(*body, column));
                let value = format.column("Value").and_then(|column| format.number(*body, column));
                let known = name.zip(value).filter(|(name, value)| concerns(name) && value.is_finite());
                known.map_or(Said::Nothing, |(name, value)| Said::Parameter(name, value))
            }
            "FMTU" => {
                let number = format.column("FmtType").and_then(|column| format.number(*body, column));
                let units = format.column("UnitIds").and_then(|column| format.text(*body, column));
                number.zip(units).map_or(Said::Nothing, |(number, units)| Said::Units(number as u8, units))
            }
            _ => match format.imu {
                Some(columns) => self.row(columns)?,
                None => Said::Nothing,
            },
        })
    }

    /// What an `EV` says.
    fn event(&self) -> Option<Report> {
        let Message { format, body, .. } = self;
        let number = format.number(*body, format.column("Id")?)?;
        let (_, aspect, holds) = EVENTS.into_iter().find(|(event, ..)| f64::from(*event) == number)?;
        Some(Report { aspect, time_us: format.time_us(*body)?, holds, is_change: true })
    }

    /// What a column says that is 0 or 1.
    fn state(&self, name: &str, aspect: Aspect, is_change: bool) -> Option<Report> {
        let Message { format, body, .. } = self;
        let holds = format.number(*body, format.column(name)?)? != 0.0;
        Some(Report { aspect, time_us: format.time_us(*body)?, holds, is_change })
    }

    fn row(&self, columns: ImuColumns) -> Result<Said, String> {
        let Message { format, body, place } = self;
        let damaged = || format!("a row of {} without its numbers; is the log damaged?", format.name);
        let number = |column: usize| format.number(*body, column).ok_or_else(damaged);
        let three = |[x, y, z]: [usize; AXES]| Ok::<_, String>([number(x)?, number(y)?, number(z)?]);
        let instance = columns.instance(format, *body).ok_or_else(damaged)?;
        let ill = |column: &Option<usize>| column.is_some_and(|column| format.number(*body, column) == Some(0.0));
        let row = Row {
            place: *place,
            time_us: (number(columns.time)? as u64).saturating_mul(columns.time_unit),
            logged: [three(columns.accelerometers)?, three(columns.gyroscopes)?],
            celsius: columns.temperature.map(number).transpose()?,
            is_healthy: !columns.health.iter().any(ill),
        };
        Ok(Said::Row(instance, row))
    }
}

impl Source for DataFlashSource {
    fn read(&mut self) -> Result<Option<Reading>, RecordingError> {
        loop {
            let Some(message) = self.messages.next()? else { return Ok(None) };
            let (place, said) = (message.place, message.said());
            let read = match said {
                Ok(Said::Row(instance, row)) if instance == self.instance => self.reading(&row).map(Some),
                Ok(Said::Parameter(name, value)) => self.set(place, name, value).map(|()| None),
                Ok(_) => Ok(None),
                Err(message) => Err(message),
            };
            match read {
                Ok(Some(reading)) => return Ok(Some(reading)),
                Ok(None) => {}
                Err(message) => return Err(self.messages.error(place, message)),
            }
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        self.messages.error(place, message)
    }

    fn unit(&self) -> Option<&'static str> {
        Some(self.messages.unit()).filter(|unit| *unit != "line")
    }

    fn units(&self) -> Result<Units, String> {
        Ok(Units { devices: self.imu.devices, ..units() })
    }

    fn has_gyroscopes(&self) -> bool {
        true
    }

    fn device(&self) -> u64 {
        self.imu.devices[0].map_or(0, |id| device(&id.to_string()))
    }

    fn vehicle_state(&self) -> VehicleState {
        self.vehicle.clone()
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = vec![format!(
            "A1, A2, A3 are AccX, AccY, AccZ of IMU {}, G1, G2, G3 its GyrX, GyrY, GyrZ; one pulse is \
             {LOG_ACCELERATION_PULSE:e} m/s2 or {LOG_RATE_PULSE:e} rad/s; temperatures in degC",
            self.instance
        )];
        notes.extend(devices_told(self.imu.devices));
        notes.push(self.undone.clone());
        let (count, first, place) = &self.changes;
        if *count > 0 {
            let unit = self.messages.unit();
            notes.push(format!(
                "corrections change {count} times within the log, first {first} at {unit} {place}: each is undone from \
                 there on"
            ));
        }
        notes
    }

    fn findings(&self) -> Vec<Finding> {
        let (damage, unit) = self.messages.damage();
        let mut found: Vec<_> = damage.findings(unit).collect();
        if self.ill > 0 {
            let message = format!("in {} rows the IMU reports to be ill (GH or AH is 0)", self.ill);
            found.push(Finding::warning(name::IMU_ERROR, message));
        }
        if !self.has_temperature {
            found.extend(placeholder(self.telemetry));
        }
        found
    }
}

impl Contents {
    fn read(messages: &mut Messages) -> Result<Self, RecordingError> {
        let mut contents = Self::default();
        while let Some(message) = messages.next()? {
            let place = message.place;
            match message.said() {
                // The second reading says what is wrong with a row.
                Err(_) => {}
                Ok(Said::Row(instance, row)) => {
                    contents.imus.entry(instance).or_default().rows += 1;
                    contents.last_us = row.time_us;
                }
                Ok(Said::Reports(name, reports)) => {
                    reports.into_iter().for_each(|report| contents.reports.take(name, report));
                }
                Ok(Said::Parameter(name, value)) => {
                    if contents.parameters.len() < MAX_PARAMETERS {
                        contents.parameters.entry(name).or_insert(value);
                    }
                }
                Ok(Said::Learnt) => contents.learnt += 1,
                Ok(Said::Units(number, units)) => {
                    let wrong = messages.imu_format(number).and_then(|format| {
                        let unit = |name: &str| units.chars().nth(format.column(name)?);
                        UNITS.iter().find(|(name, known)| unit(name).is_some_and(|unit| unit != *known && unit != '-'))
                    });
                    if let Some((name, _)) = wrong {
                        let message = format!(
                            "{name} of IMU is in another unit than m/s2, rad/s and degC; make CSV of it with \
                             mavlogdump.py, and give a mapping"
                        );
                        return Err(messages.error(place, message));
                    }
                }
                Ok(Said::Nothing) => {}
            }
        }
        Ok(contents)
    }

    fn no_rows(&self) -> String {
        const REMEDY: &str = "set LOG_DISARMED to 1 and the bit IMU of LOG_BITMASK, and log again";
        let learnt = if self.learnt > 0 { "; rows of TCLR alone have no rate" } else { "" };
        format!("no rows of IMU{learnt}; {REMEDY}")
    }
}
