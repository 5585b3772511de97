//! The rows of a DataFlash log: those of `IMU`, with what ArduPilot had corrected undone.

use super::dataflash::{DataFlashMessage, DataFlashMessages, LogEncoding};
use super::dataflash_format::ImuColumns;
use super::imu::{
    FoundImu, ImuOfLog, LOG_ACCELERATION_PULSE, LOG_RATE_PULSE, NO_TEMPERATURE, Values, choose, found, take, units,
};
use super::left_out::{Flaw, Omissions};
use super::reports::{Aspect, Reports, VehicleReport};
use super::settings::LogSettings;
use super::survey::Survey;
use super::timeline::{Sieve, StampPlace, UsableTimes};
use super::undo::{Corrections, concerns, devices};
use isotherm_recording::foreign::Units;
use isotherm_recording::foreign::VehicleState;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, LeftOutRows, OpenData, PLACEHOLDER, placeholder};
use isotherm_recording::{LogImu, RecordingError};
use isotherm_shared::wire::AXES;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, name};
use std::collections::{BTreeMap, HashMap};

/// Most parameters that are kept; ArduPilot has about 150 of IMUs.
const MAX_PARAMETERS: usize = 4096;
/// An IMU with a smaller part of the rows of another one does not exist.
const STRAY: u64 = 100;
/// Nor does one with fewer rows than this, and a smaller part.
const FEW: u64 = 5;
/// Letters of the units of specific force, rate and temperature, by which `FMTU` names them.
const UNITS: [(&str, char); 3] = [("AccX", 'o'), ("GyrX", 'E'), ("T", 'O')];

/// Rows of an IMU.
pub struct DataFlashSource {
    messages: DataFlashMessages,
    instance: u8,
    imu: ImuOfLog,
    vehicle: VehicleState,
    temperature: Option<f64>,
    /// As they stand at the row.
    parameters: HashMap<String, f64>,
    corrections: Corrections,
    /// What is undone from the beginning, in words.
    undone: String,
    /// Parameters that changed within the log: how many times, the first, and its place.
    changes: (u64, String, u64),
    sieve: Sieve,
    strays: u64,
    left_out: Omissions,
    /// Rows of sensors that report to be ill.
    ill: u64,
    has_temperature: bool,
}

/// What the first reading has found.
#[derive(Default)]
struct DataFlashContents {
    imus: BTreeMap<u8, Survey>,
    /// The first value of each. The log lists them all at its beginning, while the first rows come.
    parameters: HashMap<String, f64>,
    learnt: u64,
    reports: Reports,
    /// Rows of IMUs that do not exist.
    strays: u64,
}

impl DataFlashSource {
    /// Opens a log, and chooses the IMU.
    ///
    /// # Errors
    /// If it has no rows, corrections that cannot be undone, or several IMUs of which none is named; of reading.
    pub fn open(
        mut data: OpenData<'_>,
        settings: &LogSettings,
        temperature: Option<f64>,
        encoding: LogEncoding,
    ) -> Result<Self, Failure> {
        let path = data.source.name();
        let refused = |message: &str| Failure::new(Exit::Data, format!("{}: {message}", shown(path)));
        let contents = DataFlashContents::of(&mut data, encoding)?;
        let (instance, imu) = choose(path, &contents.imus(), settings)?;
        let kept = contents.imus.get(&instance).map_or_else(|| Ok(UsableTimes::default()), |survey| survey.kept("IMU"));
        let kept = kept.map_err(|message| refused(&message))?;
        let corrections = Corrections::new(&contents.parameters, instance).map_err(|message| refused(&message))?;
        Ok(Self {
            messages: DataFlashMessages::new(data.again(&settings.progress)?, encoding),
            instance,
            imu,
            vehicle: contents.reports.state(kept.last_us),
            temperature,
            parameters: contents.parameters,
            undone: corrections.told(),
            corrections,
            changes: (0, String::new(), 0),
            sieve: Sieve::new(kept),
            strays: contents.strays,
            left_out: Omissions::default(),
            ill: 0,
            has_temperature: true,
        })
    }

    /// The IMUs of a log.
    ///
    /// # Errors
    /// If it has no rows; of reading.
    pub fn imus(mut data: OpenData<'_>, encoding: LogEncoding) -> Result<Vec<FoundImu>, Failure> {
        DataFlashContents::of(&mut data, encoding).map(|contents| found(&contents.imus()))
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

    /// The row, if it is not left out.
    fn reading(&mut self, row: &ImuRow) -> Option<ForeignRow> {
        let reading = match self.sieve.next(row.time_us) {
            StampPlace::Wild => Err(Flaw::Time),
            StampPlace::Repeats => Err(Flaw::Repeated),
            StampPlace::Follows => self.undone(row),
        };
        match reading {
            Ok(reading) => {
                self.ill += u64::from(!row.is_healthy);
                self.has_temperature &= row.celsius.is_some();
                Some(reading)
            }
            Err(flaw) => {
                self.left_out.take(flaw, row.place);
                None
            }
        }
    }

    fn undone(&self, row: &ImuRow) -> Result<ForeignRow, Flaw> {
        let logged = row.celsius.filter(|celsius| celsius.is_finite() || self.temperature.is_none());
        let celsius = logged.or(self.temperature).unwrap_or(PLACEHOLDER);
        let [acceleration, rate] = self.corrections.undo(row.logged, celsius);
        let values = Values { acceleration, rate: Some(rate), celsius: [celsius; 2] };
        values.reading(row.place, row.time_us, self.temperature)
    }
}

/// A row of `IMU`, as it is logged.
struct ImuRow {
    place: u64,
    time_us: u64,
    /// \[m/s2, rad/s\]
    logged: [[f64; AXES]; 2],
    celsius: Option<f64>,
    is_healthy: bool,
}

/// What a message says.
enum MessageMeaning {
    Row(u8, ImuRow),
    Parameter(String, f64),
    /// Of a definition, letters of the units of its columns.
    Units(u8, String),
    Learnt,
    /// Of the vehicle, with the name of the message.
    Reports(&'static str, Vec<VehicleReport>),
    /// It is a row of an IMU without its numbers.
    Damaged,
    Nothing,
}

/// Numbers of `EV`: what holds from then on, or no more.
const EVENTS: [(u8, Aspect, bool); 4] =
    [(10, Aspect::Armed, true), (11, Aspect::Armed, false), (28, Aspect::Flying, true), (18, Aspect::Flying, false)];

impl DataFlashMessage<'_> {
    fn said(&self) -> MessageMeaning {
        let DataFlashMessage { format, body, .. } = self;
        match format.name.as_str() {
            "TCLR" => MessageMeaning::Learnt,
            "EV" => MessageMeaning::Reports("EV", self.event().into_iter().collect()),
            "ARM" => MessageMeaning::Reports("ARM", self.state("ArmState", Aspect::Armed, true).into_iter().collect()),
            "STAT" => {
                let all = [("Armed", Aspect::Armed), ("isFlying", Aspect::Flying)];
                MessageMeaning::Reports(
                    "STAT",
                    all.into_iter().filter_map(|(name, aspect)| self.state(name, aspect, false)).collect(),
                )
            }
            "PARM" => {
                let name = format.column("Name").and_then(|column| format.text(*body, column));
                let value = format.column("Value").and_then(|column| format.number(*body, column));
                let known = name.zip(value).filter(|(name, value)| concerns(name) && value.is_finite());
                known.map_or(MessageMeaning::Nothing, |(name, value)| MessageMeaning::Parameter(name, value))
            }
            "FMTU" => {
                let number = format.column("FmtType").and_then(|column| format.number(*body, column));
                let units = format.column("UnitIds").and_then(|column| format.text(*body, column));
                number
                    .zip(units)
                    .map_or(MessageMeaning::Nothing, |(number, units)| MessageMeaning::Units(number as u8, units))
            }
            _ => match format.imu {
                Some(columns) => self
                    .row(columns)
                    .map_or(MessageMeaning::Damaged, |(instance, row)| MessageMeaning::Row(instance, row)),
                None => MessageMeaning::Nothing,
            },
        }
    }

    /// What an `EV` says.
    fn event(&self) -> Option<VehicleReport> {
        let DataFlashMessage { format, body, .. } = self;
        let number = format.number(*body, format.column("Id")?)?;
        let (_, aspect, holds) = EVENTS.into_iter().find(|(event, ..)| f64::from(*event) == number)?;
        Some(VehicleReport { aspect, time_us: format.time_us(*body)?, holds, is_change: true })
    }

    /// What a column says that is 0 or 1.
    fn state(&self, name: &str, aspect: Aspect, is_change: bool) -> Option<VehicleReport> {
        let DataFlashMessage { format, body, .. } = self;
        let holds = format.number(*body, format.column(name)?)? != 0.0;
        Some(VehicleReport { aspect, time_us: format.time_us(*body)?, holds, is_change })
    }

    /// The row, and which IMU it is of; `None` if it is not whole.
    fn row(&self, columns: ImuColumns) -> Option<(u8, ImuRow)> {
        let DataFlashMessage { format, body, place } = self;
        let number = |column: usize| format.number(*body, column);
        let three = |[x, y, z]: [usize; AXES]| Some([number(x)?, number(y)?, number(z)?]);
        let ill = |column: &Option<usize>| column.is_some_and(|column| number(column) == Some(0.0));
        let celsius = match columns.temperature {
            Some(column) => Some(number(column)?),
            None => None,
        };
        let row = ImuRow {
            place: *place,
            time_us: format.time_us(*body)?,
            logged: [three(columns.accelerometers)?, three(columns.gyroscopes)?],
            celsius,
            is_healthy: !columns.health.iter().any(ill),
        };
        Some((columns.instance(format, *body)?, row))
    }
}

impl ForeignRows for DataFlashSource {
    fn read(&mut self) -> Result<Option<ForeignRow>, RecordingError> {
        loop {
            let Some(message) = self.messages.next()? else { return Ok(None) };
            let (place, said) = (message.place, message.said());
            match said {
                MessageMeaning::Row(instance, row) if instance == self.instance => {
                    if let Some(reading) = self.reading(&row) {
                        return Ok(Some(reading));
                    }
                }
                MessageMeaning::Parameter(name, value) => {
                    self.set(place, name, value).map_err(|message| self.messages.error(place, message))?;
                }
                MessageMeaning::Damaged => self.left_out.take(Flaw::Value, place),
                _ => {}
            }
        }
    }

    fn error(&self, place: u64, message: String) -> RecordingError {
        self.messages.error(place, message)
    }

    fn no_rows(&self) -> String {
        let told = self.left_out.told(&format!("IMU {}", self.instance), self.messages.unit());
        let advice = match self.left_out.count(Flaw::Temperature) {
            0 => None,
            _ => Some(NO_TEMPERATURE.to_owned()),
        };
        let why = [vec!["no row can be used".to_owned()], told, advice.into_iter().collect()];
        why.concat().join("; ")
    }

    fn unit(&self) -> Option<&'static str> {
        Some(self.messages.unit()).filter(|unit| *unit != "line")
    }

    fn units(&self) -> Result<Units, String> {
        Ok(Units { devices: self.imu.devices, ..units() })
    }

    fn are_readings(&self) -> [bool; 2] {
        [true; 2]
    }

    fn has_gyroscopes(&self) -> bool {
        true
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
        let mut notes = vec![format!(
            "A1, A2, A3 are AccX, AccY, AccZ of IMU {}, G1, G2, G3 its GyrX, GyrY, GyrZ; one pulse is \
             {LOG_ACCELERATION_PULSE:e} m/s2 or {LOG_RATE_PULSE:e} rad/s; temperatures in degC",
            self.instance
        )];
        notes.extend(self.imu.named(self.instance).devices_told());
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

    fn left_out_by_stamps(&self) -> LeftOutRows {
        self.left_out.by_times(self.sieve.kept().count)
    }

    fn findings(&self) -> Vec<Finding> {
        let (damage, unit) = self.messages.damage();
        let mut found: Vec<_> = damage.findings(unit).collect();
        found.extend(self.left_out.findings(&format!("IMU {}", self.instance), unit, self.sieve.kept().count));
        if self.strays > 0 {
            let message =
                format!("{} rows are of IMUs that do not exist: the log is damaged; they are left out", self.strays);
            found.push(Finding::warning(name::ROWS_LEFT_OUT, message));
        }
        if self.ill > 0 {
            let message = format!("in {} rows the IMU reports to be ill (GH or AH is 0)", self.ill);
            found.push(Finding::warning(name::IMU_ERROR, message));
        }
        if !self.has_temperature {
            found.extend(placeholder(self.temperature));
        }
        found
    }
}

impl DataFlashContents {
    /// What a log has: one IMU at least.
    fn of(data: &mut OpenData<'_>, encoding: LogEncoding) -> Result<Self, Failure> {
        let mut first = DataFlashMessages::new(take(data)?, encoding);
        let failed = |error: RecordingError| error.failure(data.name());
        let contents = Self::read(&mut first).map_err(failed)?;
        if contents.imus.is_empty() {
            return Err(failed(first.error(0, contents.no_rows())));
        }
        Ok(contents)
    }

    fn read(messages: &mut DataFlashMessages) -> Result<Self, RecordingError> {
        let mut contents = Self::default();
        while let Some(message) = messages.next()? {
            let place = message.place;
            match message.said() {
                MessageMeaning::Row(instance, row) => {
                    contents.imus.entry(instance).or_default().take(row.time_us, None, row.celsius);
                }
                MessageMeaning::Reports(name, reports) => {
                    reports.into_iter().for_each(|report| contents.reports.take(name, report));
                }
                MessageMeaning::Parameter(name, value) => {
                    if contents.parameters.len() < MAX_PARAMETERS {
                        contents.parameters.entry(name).or_insert(value);
                    }
                }
                MessageMeaning::Learnt => contents.learnt += 1,
                MessageMeaning::Units(number, units) => {
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
                MessageMeaning::Damaged | MessageMeaning::Nothing => {}
            }
        }
        contents.forget_strays();
        Ok(contents)
    }

    /// Forgets IMUs of which there are only a few rows: their number is damaged.
    fn forget_strays(&mut self) {
        let most = self.imus.values().map(Survey::rows).max().unwrap_or(0);
        let is_stray = |rows: u64| rows < most / STRAY || (rows < FEW && rows < most / FEW);
        let strays: u64 = self.imus.values().map(Survey::rows).filter(|rows| is_stray(*rows)).sum();
        self.imus.retain(|_, survey| !is_stray(survey.rows()));
        self.strays = strays;
    }

    fn imus(&self) -> BTreeMap<u8, ImuOfLog> {
        let imu = |(instance, survey): (&u8, &Survey)| {
            (*instance, ImuOfLog { rows: survey.rows(), devices: devices(&self.parameters, *instance) })
        };
        self.imus.iter().map(imu).collect()
    }

    fn no_rows(&self) -> String {
        const REMEDY: &str = "set LOG_DISARMED to 1 and the bit IMU of LOG_BITMASK, and log again";
        let learnt = if self.learnt > 0 { "; rows of TCLR by themselves have no rate" } else { "" };
        format!("no rows of IMU{learnt}; {REMEDY}")
    }
}
