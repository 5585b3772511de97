//! Foreign data as raw samples: text with a mapping, NovAtel logs, `sensor_msgs/msg/Imu` in MCAP, and the logs of
//! autopilots, ULog and DataFlash.
//!
//! A [`Conversion`] is an iterator over [`RawSample`]s. Pulses are `round((value - offset) / resolution)`, with the
//! sign of the axis, on the positive or the negative channel. The sequence begins at 0; it rises by 1 from row to row,
//! and for readings by more where the time shows that rows are missing. Where the clock of the stamps starts again, the
//! session rises by 1, and the sequence begins at 0.

mod calendar;
mod clock;
mod columns;
mod decimal;
mod foreign;
mod header_units;
mod heading;
mod interval;
mod joined;
mod known;
mod layouts;
mod looked;
mod mapping;
mod novatel;
mod opening;
mod proposal;
mod recorded;
mod refused;
mod rhythm;
mod roles;
mod rollover;
mod ros;
mod scale;
mod settings;
mod stamp_rule;
mod stamp_tally;
mod stamped;
mod stated_interval;
mod stream;
mod table_pulses;
mod telemetry_log;
mod text;
mod unit;

pub(crate) use calendar::time_ns;
pub use columns::{ColumnRef, Kind, SensorColumns, Sensors, Temperature};
pub use foreign::Foreign;
pub use known::known_format;
pub use looked::{Calendar, LookedColumn, LookedTable};
pub use mapping::{Decimal, KnownColumns, Mapping, RowTimes, TimeUnit};
pub(crate) use ros::is_bag;
pub use scale::Scale;
pub use settings::{Settings, TimeSource};
pub use text::means::{MeanRow, read_means};
pub use unit::{Linear, acceleration_units, rate_units};

use interval::{GAP, IntervalSteps};
use isotherm_autopilot::logs::FoundImu;
use isotherm_recording::columns::Layout;
use isotherm_recording::foreign::{ForeignRow, ForeignRows, LeftOutRows, OpenData, Units, VehicleState};
use isotherm_recording::{LogImu, RecordingError};
use isotherm_shared::document::Faults;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{Nominal, PulseScale};
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, Triad};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, name};
use isotherm_support::source::DataSource;
use joined::JoinedSource;
use known::KnownFormat;
use opening::TextOpening;
use proposal::ProposedMapping;
use refused::BY_PYTHON;
use scale::TemperatureRange;
use stamped::StampedRows;
use std::io::{Cursor, ErrorKind, Read};
use std::path::{Path, PathBuf};
use stream::RowStream;
use table_pulses::TablePulses;

/// Intervals that an IMU has \[ns\]: 50 kHz to 0.01 Hz.
const PLAUSIBLE_NS: std::ops::RangeInclusive<u64> = 20_000..=100_000_000_000;
/// Pieces whose intervals differ by up to this part have one; with fewer rows than these, the larger part.
const SAME: f64 = 0.01;
const FEW_ROWS: u64 = 100;
const SAME_OF_FEW: f64 = 0.2;
/// Thermometers may show one temperature for so long \[ns\].
const ONE_TEMPERATURE_NS: u64 = 60_000_000_000;
/// Bytes by which the format is recognised.
const BEGINNING: u64 = 1 << 16;

/// An iterator over the raw samples of foreign data that ends at the first error.
pub struct Conversion {
    path: PathBuf,
    input: StampedRows,
    /// The session of the first rows, and that of the last one.
    first_session: u64,
    session: u64,
    /// Whether the last row is the first one of a further session.
    begins_session: bool,
    nominal_ns: u64,
    /// Number of rows that the nominal interval was found from, unless it was given.
    found_from: Option<u64>,
    /// Whether it is that of other pieces.
    is_of_pieces: bool,
    /// When rows without a time begin \[ns\].
    begin_ns: u64,
    /// Time and sequence of the last row.
    last: Option<(u64, u64)>,
    /// Rows that were read, and those of them that are not left out.
    read_rows: u64,
    rows: u64,
    gaps: Gaps,
    steps: IntervalSteps,
    pulses: TablePulses,
    temperature: TemperatureRange,
    /// The line of the first row of a table in memory.
    first_row: Option<u64>,
    ended: bool,
}

/// Where rows are missing, or late if they have all counts since the row before.
#[derive(Default)]
struct Gaps {
    count: u64,
    missing: u64,
    first: u64,
}

/// The IMUs of an autopilot's log, by their numbers; none of other data. The log is read once.
///
/// # Errors
/// If the file cannot be read, or if a log has no rows of an IMU.
pub fn imus_of_log(source: &DataSource, settings: &Settings) -> Result<Vec<FoundImu>, Failure> {
    if !source.is_file() {
        return Ok(Vec::new());
    }
    let mut bytes = source.open().map_err(|error| Failure::io("opening", source.name(), &error))?;
    let beginning = beginning(&mut bytes, source.name())?;
    let format = KnownFormat::of(&beginning);
    let bytes = settings.progress.restarted(Cursor::new(beginning).chain(bytes));
    format.map_or(Ok(Vec::new()), |format| format.imus(OpenData { source, bytes }))
}

/// The failure of data with this name. For a table in memory, whose first row has the line `first_row`, it counts rows
/// from 0.
fn failure_of(error: &RecordingError, path: &Path, first_row: Option<u64>) -> Failure {
    let (RecordingError::Data { line, message }, Some(first)) = (error, first_row) else { return error.failure(path) };
    let name = shown(path);
    let message = match line.checked_sub(first) {
        Some(row) => format!("{name}: row {row}: {message}"),
        None => format!("{name}: {message}"),
    };
    Failure::new(Exit::Data, message).at(path, line.checked_sub(first))
}

/// The bytes by which the format is recognised.
fn beginning(source: &mut dyn Read, path: &Path) -> Result<Vec<u8>, Failure> {
    let mut beginning = Vec::new();
    let read = source.take(BEGINNING).read_to_end(&mut beginning);
    read.map_err(|error| Failure::io("reading", path, &error)).map(|_| beginning)
}

impl Conversion {
    /// Opens foreign data, of a text with the name and the text of the mapping file. The format is recognised by the
    /// first bytes.
    ///
    /// # Errors
    /// [`Exit::Usage`] if a text has no mapping, with the mapping that would be. [`Exit::Config`] with all faults of
    /// the mapping. [`Exit::Data`] if the data are of no known format, or do not have what the mapping names.
    /// [`Exit::Io`].
    pub fn open(source: &DataSource, mapping: Option<(&Path, &str)>, settings: &Settings) -> Result<Self, Failure> {
        let bytes = source.open().map_err(|error| match error.kind() {
            ErrorKind::IsADirectory => {
                let message = format!("{}: a folder; name the .mcap file in it", shown(source.name()));
                Failure::new(Exit::Data, message)
            }
            _ => Failure::io("opening", source.name(), &error),
        })?;
        Self::read(source, settings.progress.restarted(bytes), mapping, settings)
    }

    /// As [`open`](Self::open), of a text that is in memory. `name` stands for the data in messages; `mapping` has a
    /// name and the text of the mapping file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn of_text(
        name: &Path,
        text: impl Read + 'static,
        mapping: Option<(&Path, &str)>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        Self::read(&DataSource::of_stream(name), Box::new(text), mapping, settings)
    }

    /// As [`open`](Self::open), of a source that is open.
    pub(crate) fn of_source(of: &DataSource, source: Box<dyn Read>, foreign: &Foreign) -> Result<Self, Failure> {
        Self::read(of, source, foreign.named(), &foreign.settings)
    }

    fn read(
        of: &DataSource,
        mut source: Box<dyn Read>,
        mapping: Option<(&Path, &str)>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let path = of.name();
        let beginning = beginning(&mut source, path)?;
        if let Some(message) = refused::reason(&beginning) {
            return Err(Failure::new(Exit::Data, format!("{}: {message}", shown(path))));
        }
        let (format, no_text) = (KnownFormat::of(&beginning), refused::no_text(&beginning));
        known::check(settings, path, format)?;
        match (format, no_text) {
            (Some(format), _) => {
                let source = Box::new(Cursor::new(beginning).chain(source));
                Self::read_known(format, OpenData { source: of, bytes: source }, mapping, settings)
            }
            (None, Some(message)) => Err(Failure::new(Exit::Data, format!("{}: {message}", shown(path)))),
            (None, None) => Self::read_text(path, beginning, source, mapping, settings),
        }
    }

    /// Data whose columns are known.
    fn read_known(
        format: KnownFormat,
        data: OpenData<'_>,
        mapping: Option<(&Path, &str)>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let path = data.source.name();
        let known = match mapping {
            Some((file, text)) => KnownColumns::from_toml(text).map_err(|faults| refuse(file, faults))?,
            None => KnownColumns::default(),
        };
        let temperature = settings.temperature.or(known.temperature);
        if let (Some((file, _)), true) = (mapping, known.units != [None; 2] && format != KnownFormat::Mcap) {
            let message = "[accelerometer] and [gyroscope] are for ROS messages and texts: these data have their units";
            return Err(Failure::new(Exit::Config, format!("{}: {message}", shown(file))).at(file, None));
        }
        let units = known.units.map(|unit| unit.unwrap_or(1.0));
        let source = format.rows(data, settings, temperature, units)?;
        let interval_ns = settings.interval_ns.or(known.interval_ns);
        Self::begin(path, source, interval_ns, settings)
    }

    /// A text with its mapping, or with the one that is found from its beginning.
    fn read_text(
        path: &Path,
        beginning: Vec<u8>,
        source: Box<dyn Read>,
        mapping: Option<(&Path, &str)>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| failure_of(&error, path, settings.first_row);
        let (mut mapping, found) = match given_mapping(mapping, settings)? {
            Some(mapping) => (mapping, None),
            None => found_mapping(path, &beginning, settings).map(|(mapping, found)| (mapping, Some(found)))?,
        };
        if let Some(temperature) = settings.temperature {
            mapping.temperature = Temperature::Constant(temperature);
        }
        let source = Box::new(Cursor::new(beginning).chain(source));
        let interval_ns = settings.interval_ns.or(mapping.time.interval_ns);
        let source: Box<dyn ForeignRows> = match &settings.gyroscope_file {
            Some(file) => {
                let alone = Mapping { gyroscope: None, ..mapping.clone() };
                let accelerometers = text::TextSource::new(source, alone).map_err(failed)?.with_found(found);
                Box::new(Self::of_two_files((path, accelerometers), file, mapping, settings.time)?)
            }
            None => {
                let source = text::TextSource::new(source, mapping).map_err(failed)?.with_found(found);
                Box::new(source.with_first_row(settings.first_row))
            }
        };
        Self::begin(path, source, interval_ns, settings)
    }

    /// The rows of a text of accelerometers, joined with those of a text of gyroscopes that has this mapping.
    fn of_two_files(
        (path, accelerometers): (&Path, text::TextSource),
        file: &DataSource,
        mapping: Mapping,
        time: TimeSource,
    ) -> Result<JoinedSource, Failure> {
        let source = file.open().map_err(|error| Failure::io("opening", file.name(), &error))?;
        let file = file.name();
        let name = |path: &Path| shown(path).to_string();
        let gyroscopes = text::TextSource::of_gyroscopes(Box::new(source), mapping);
        let gyroscopes = gyroscopes.and_then(|it| RowStream::new(Box::new(it), time, true, name(file), Some(file)));
        let gyroscopes = gyroscopes.map_err(|error| error.failure(file))?;
        let accelerometers = RowStream::new(Box::new(accelerometers), time, false, name(path), None);
        Ok(JoinedSource::new(accelerometers.map_err(|error| error.failure(path))?, gyroscopes))
    }

    /// Reads the first rows, to judge their stamps and to find the nominal interval if it is not given.
    fn begin(
        path: &Path,
        source: Box<dyn ForeignRows>,
        interval_ns: Option<u64>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| failure_of(&error, path, settings.first_row);
        if settings.time == TimeSource::Rate && interval_ns.is_none() {
            let message =
                "--time rate takes a rate that is known: give --interval S, or time.interval_s in the mapping";
            return Err(Failure::new(Exit::Usage, format!("{}: {message}", shown(path))));
        }
        let mut input = StampedRows::new(source, settings.time).map_err(failed)?;
        let mut is_of_pieces = false;
        let (nominal_ns, found_from) = match interval_ns {
            Some(nominal_ns) => (nominal_ns, None),
            None => match (input.nominal().map_err(failed)?, settings.of_pieces) {
                (own, Some((nominal_ns, rows))) if own.is_none_or(|own| is_same(own, nominal_ns)) => {
                    is_of_pieces = true;
                    (nominal_ns, Some(rows))
                }
                (Some((nominal_ns, rows)), _) => (nominal_ns, Some(rows)),
                (None, _) => {
                    let message =
                        "the nominal interval cannot be found from the time; give time.interval_s or --interval";
                    return Err(failed(input.source.error(input.first(), message.to_owned())));
                }
            },
        };
        Ok(Self {
            path: path.to_owned(),
            input,
            first_session: settings.session,
            session: settings.session,
            begins_session: false,
            nominal_ns,
            found_from,
            is_of_pieces,
            begin_ns: 0,
            last: None,
            read_rows: 0,
            rows: 0,
            gaps: Gaps::default(),
            steps: IntervalSteps::new(nominal_ns),
            pulses: TablePulses::new(settings.table, nominal_ns),
            temperature: TemperatureRange::default(),
            first_row: settings.first_row,
            ended: false,
        })
    }

    /// Which columns the samples need.
    #[must_use]
    pub fn layout(&self) -> Layout {
        let source = &self.input.source;
        Layout { gyroscopes: source.has_gyroscopes(), device: source.device() != 0, ..Layout::default() }
    }

    /// The nominal interval \[ns\]: the one that is given, or that was found from the time.
    #[must_use]
    pub const fn interval_ns(&self) -> u64 {
        self.nominal_ns
    }

    /// The nominal interval \[ns\], and the number of rows that it was found from, unless it was given.
    pub(crate) fn found_interval(&self) -> Option<(u64, u64)> {
        Some((self.nominal_ns, self.found_from?))
    }

    /// Whether the rows have times. Valid before the first row.
    pub(crate) fn has_times(&self) -> bool {
        self.input.has_times()
    }

    /// Lets rows without a time begin one interval after this one \[ns\].
    pub(crate) fn begin_after(&mut self, last_ns: u64) {
        self.begin_ns = last_ns;
    }

    /// Whether the rows are readings whose pulses are made for the nominal interval of a table. Valid after the first
    /// row.
    #[must_use]
    pub fn fits_table(&self) -> bool {
        let has_interval = self.pulses.table.is_some_and(|table| table.nominal_ns != 0);
        has_interval && self.input.source.are_readings()[0]
    }

    /// What the pulses stand for. Valid after the last row.
    ///
    /// # Errors
    /// The reason why it is not known, with a remedy: increments, counts, a unit that is not known.
    pub fn scale(&self) -> Result<Scale, String> {
        let source = &self.input.source;
        let Units { resolution, largest, devices } = source.units()?;
        let temperature = self.temperature.range().ok_or("no row has temperature; give the temperature")?;
        let has_gyroscopes = source.has_gyroscopes();
        let interval_ns = self.pulses.interval_ns(source.are_readings()[0]);
        Ok(Scale { resolution, interval_ns, has_gyroscopes, largest, devices, temperature })
    }

    /// What [`nominal_table`](isotherm_shared::table::nominal_table) needs to know, with temperature in degC and
    /// standard gravity. Valid after the last row.
    ///
    /// # Errors
    /// As [`scale`](Self::scale).
    pub fn nominal(&self, imu: &ImuId) -> Result<Nominal, String> {
        self.scale().map(|scale| scale.nominal(imu))
    }

    /// When the vehicle was armed and when it flew, by the log of an autopilot. Valid from the opening on.
    #[must_use]
    pub fn vehicle_state(&self) -> VehicleState {
        self.input.source.vehicle_state()
    }

    /// Number of rows so far that are not left out.
    #[must_use]
    pub const fn rows(&self) -> u64 {
        self.rows
    }

    /// The IMU, as the log of an autopilot names it; `None` of other data.
    #[must_use]
    pub fn log_imu(&self) -> Option<LogImu> {
        self.input.source.log_imu()
    }

    /// What the operator should know, a line each. Valid after the last row.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.input.source.notes();
        let Some(rows) = self.found_from else { return notes };
        let seconds = self.nominal_ns as f64 / 1e9;
        notes.push(format!(
            "the nominal interval is {seconds} s, found from the first {rows} rows; for recordings that belong together give it"
        ));
        notes
    }

    /// The rows that are left out, since their stamps cannot be right. Valid after the last row.
    #[must_use]
    pub fn left_out_by_stamps(&self) -> LeftOutRows {
        self.input.left_out()
    }

    /// What concerns the data's worth. Valid after the last row.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        let mut found = self.input.findings(self.first_session);
        found.extend(self.input.source.findings());
        let mut add = |name, message| found.push(Finding::warning(name, message));
        let seconds = self.nominal_ns as f64 / 1e9;
        if !PLAUSIBLE_NS.contains(&self.nominal_ns) {
            let hertz = 1.0 / seconds;
            let limits = "no IMU has under 0.01 Hz or over 50 kHz";
            add(
                name::INTERVAL,
                format!("the interval is {seconds} s, {hertz:.3e} Hz: {limits}; is the unit of the time right?"),
            );
        }
        let covered_ns = self.nominal_ns.saturating_mul(self.rows);
        let one = self.temperature.only().filter(|_| self.input.source.has_temperature());
        if let Some(only) = one.filter(|_| covered_ns > ONE_TEMPERATURE_NS) {
            let seconds = covered_ns / 1_000_000_000;
            add(
                name::ONE_TEMPERATURE,
                format!(
                    "all rows of {seconds} s have the temperature {only}: nothing in them depends on temperature; look \
                     whether the thermometer lives, and whether its stamps are those of the rows"
                ),
            );
        }
        let Gaps { count, missing, first } = self.gaps;
        if count > self.read_rows / 2 {
            add(name::INTERVAL, format!("most rows are over {GAP} nominal intervals apart; is {seconds} s right?"));
            return found;
        }
        if count > 0 && self.input.source.counts_since_the_row_before() {
            add(
                name::TIME_STEP,
                format!(
                    "{count} rows come over {GAP} nominal intervals after the row before, the first is row {first}; their counts are taken as \
                 those of this whole time"
                ),
            );
        } else if count > 0 {
            add(
                name::MISSING_ROWS,
                format!(
                    "{count} gaps, {missing} rows missing by the time, the first before row {first}; the sequence rises by them"
                ),
            );
        }
        if let Some(mean_ns) = self.steps.other_mean().filter(|_| !self.is_of_pieces) {
            let [mean, interval] = [mean_ns.round() / 1e6, self.nominal_ns as f64 / 1e6];
            let apart = format!("rows are {mean} ms apart on average, but the interval is {interval} ms");
            match (self.input.is_by_clock(), self.found_from) {
                (false, _) => add(name::INTERVAL, format!("{apart}; correct interval_s")),
                (true, None) => add(name::INTERVAL, format!("{apart}: rows are lost, or interval_s is wrong")),
                // An even clock keeps the interval that was found with it.
                (true, Some(_)) => {}
            }
        }
        found
    }

    /// Whether the last row is the first one of a further session: the clock of the stamps started again.
    #[must_use]
    pub const fn begins_session(&self) -> bool {
        self.begins_session
    }

    /// Whether no session was given: the first rows name none.
    pub(crate) const fn is_unnamed(&self) -> bool {
        self.first_session == 0
    }

    /// The next row, with its place: line or message.
    pub(crate) fn next_row(&mut self) -> Result<Option<(u64, RawSample)>, RecordingError> {
        let Some(reading) = self.input.next()? else {
            if self.rows > 0 {
                self.check_pulses()?;
            }
            return Ok(None);
        };
        let sample = self.sample(&reading).map_err(|message| self.error(reading.place, message))?;
        self.read_rows += 1;
        if self.read_rows == 1 {
            // Before anything is sent, as far as the first row says what the numbers are.
            self.check_pulses()?;
        }
        Ok(Some((reading.place, sample)))
    }

    /// Refuses pulses that are not those of the table, as far as the rows so far say what the numbers are.
    fn check_pulses(&self) -> Result<(), RecordingError> {
        let source = &self.input.source;
        let Some(table) = self.pulses.table else { return Ok(()) };
        let counts = if source.are_counts() { table.check_counts(self.nominal_ns) } else { Ok(()) };
        let weights = source.units().map_or([None; 2], |Units { resolution, .. }| {
            let seconds = |is_reading: bool| self.pulses.interval_ns(is_reading) as f64 / 1e9;
            let [a, g] = source.are_readings().map(seconds);
            [Some(resolution.accelerometer * a), Some(resolution.gyroscope * g)]
        });
        let checked = counts.and_then(|()| table.check(weights));
        checked.map_err(|mismatch| {
            RecordingError::Piece(
                Failure::new(Exit::Data, format!("{}: {mismatch}", shown(&self.path))).at(&self.path, None),
            )
        })
    }

    /// Sets the table that the rows are for.
    pub(crate) const fn set_table(&mut self, table: Option<PulseScale>) {
        self.pulses.table = table;
    }

    /// Takes a row that is not left out.
    pub(crate) fn keep(&mut self, sample: &RawSample) {
        self.rows += 1;
        self.temperature.take(sample);
    }

    /// The failure of a row.
    pub(crate) fn failure(&self, error: &RecordingError) -> Failure {
        failure_of(error, &self.path, self.first_row)
    }

    /// What messages call the data.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// An error about the row at this place.
    pub(crate) fn error(&self, place: u64, message: String) -> RecordingError {
        self.input.source.error(place, message)
    }

    /// What places count; `None` for lines.
    pub(crate) fn unit(&self) -> Option<&'static str> {
        self.input.source.unit()
    }

    fn sample(&mut self, reading: &ForeignRow) -> Result<RawSample, String> {
        self.begins_session = reading.begins_session;
        if reading.begins_session {
            (self.session, self.last) = (self.session.saturating_add(1), None);
            self.pulses.reset();
        }
        let nominal_ns = self.nominal_ns;
        let number = if reading.row > 0 { reading.row } else { self.read_rows + 1 };
        let counted_ns = || self.begin_ns.saturating_add(nominal_ns.saturating_mul(number));
        let timestamp_ns = reading.timestamp_ns.unwrap_or_else(counted_ns);
        let (mut sequence, mut interval_ns) = (0, nominal_ns);
        if let Some((last_ns, last)) = self.last {
            let step_ns = timestamp_ns.checked_sub(last_ns).filter(|step| *step > 0).ok_or_else(|| {
                let cause = "is a row there twice?";
                format!("the time is {timestamp_ns} ns after {last_ns} ns; it must rise from row to row; {cause}")
            })?;
            self.steps.take(step_ns);
            let mut missing = 0;
            let steps = step_ns as f64 / nominal_ns as f64;
            if steps > GAP {
                missing = (steps.round() as u64).saturating_sub(1);
                self.gaps.count += 1;
                if self.gaps.count == 1 {
                    self.gaps.first = self.read_rows + 1;
                }
            }
            if self.input.source.counts_since_the_row_before() {
                if step_ns > MAX_INTERVAL_NS {
                    let most = MAX_INTERVAL_NS / 1_000_000_000;
                    return Err(format!(
                        "the time steps by {step_ns} ns, but an increment counts over {most} s at most; split the data here"
                    ));
                }
                // The row has all counts since the row before: none is missing, however late it is.
                (missing, interval_ns) = (0, step_ns);
            }
            self.gaps.missing = self.gaps.missing.saturating_add(missing);
            sequence = last
                .checked_add(missing + 1)
                .ok_or_else(|| format!("the time steps by {step_ns} ns, over all that a sequence can count"))?;
        }
        self.last = Some((timestamp_ns, sequence));
        let has_gyroscopes = self.input.source.has_gyroscopes();
        let reading = &self.pulses.of_table(reading, self.input.source.are_readings());
        let gyroscopes = if has_gyroscopes { triad(reading, AXES)? } else { Triad::ABSENT };
        Ok(RawSample {
            session: self.session,
            sequence,
            timestamp_ns,
            interval_ns,
            accelerometers: triad(reading, 0)?,
            gyroscopes,
            device: self.input.source.device(),
            ..RawSample::default()
        })
    }
}

impl Iterator for Conversion {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.next_row().transpose();
        self.ended = !matches!(item, Some(Ok(_)));
        let item = item?.map(|(_, sample)| sample).map_err(|error| self.failure(&error));
        item.iter().for_each(|sample| self.keep(sample));
        Some(item)
    }
}

/// The sensors of a row from this index on.
///
/// # Errors
/// If the sum of several rows has too many pulses.
fn triad(reading: &ForeignRow, first: usize) -> Result<Triad, String> {
    let mut triad = Triad::default();
    for axis in 0..AXES {
        let (pulses, index) = (reading.pulses[first + axis], first + axis);
        let size = |pulses: i64| {
            u32::try_from(pulses.unsigned_abs()).map_err(|_| format!("{pulses} pulses, over {}", u32::MAX))
        };
        triad.positive_pulses[axis] = size(pulses.max(0))?;
        triad.negative_pulses[axis] = size(pulses.min(0) - reading.negative[index])?;
        triad.head_temperature[axis] = reading.head[index];
        triad.board_temperature[axis] = reading.board[index];
    }
    Ok(triad)
}

/// The mapping that is given.
fn given_mapping(mapping: Option<(&Path, &str)>, settings: &Settings) -> Result<Option<Mapping>, Failure> {
    if let Some(parsed) = &settings.mapping {
        return Ok(Some(parsed.clone()));
    }
    let Some((file, text)) = mapping else { return Ok(None) };
    let mapping = match settings.gyroscope_file {
        Some(_) => Mapping::of_two_files(text, settings.interval_ns),
        None => Mapping::with_interval(text, settings.interval_ns),
    };
    mapping.map(Some).map_err(|faults| refuse(file, faults))
}

/// The mapping of a text that begins so, if nothing in it is open. A layout of accelerometers is that of a file of
/// gyroscopes, too.
fn found_mapping(path: &Path, beginning: &[u8], settings: &Settings) -> Result<(Mapping, ProposedMapping), Failure> {
    // It may end in the middle of a row.
    let end = beginning.iter().rposition(|byte| *byte == b'\n').filter(|_| beginning.len() as u64 == BEGINNING);
    let rows = Cursor::new(beginning[..end.unwrap_or(beginning.len())].to_vec());
    let found = TextOpening::read(Box::new(rows), 0)
        .and_then(|(opening, rows)| ProposedMapping::of(&opening, rows, 0, path, settings.temperature))
        .map_err(|error| failure_of(&error, path, settings.first_row))?;
    let usage = |message: String| Failure::new(Exit::Usage, format!("{}: {message}", shown(path)));
    let mapping = Mapping::with_interval(&found.text, settings.interval_ns).ok();
    match (mapping, &settings.gyroscope_file) {
        (Some(mapping), None) => Ok((mapping, found)),
        (Some(mapping), Some(file)) if found.layout.is_some() => match mapping.gyroscope {
            None => Ok((Mapping { gyroscope: Some(mapping.accelerometer.clone()), ..mapping }, found)),
            Some(_) => {
                let file = shown(file.name());
                Err(usage(format!("it has gyroscopes itself; leave out --gyroscope-file {file}")))
            }
        },
        _ => Err(usage(format!(
            "which columns are what? Give --mapping with a file such as this, completed; or {BY_PYTHON}\n\n{}",
            found.text
        ))),
    }
}

/// Whether the interval that some rows show is this one \[ns\]. Few rows show it less well.
fn is_same((found_ns, rows): (u64, u64), nominal_ns: u64) -> bool {
    let part = if rows < FEW_ROWS { SAME_OF_FEW } else { SAME };
    found_ns.abs_diff(nominal_ns) as f64 <= part * nominal_ns as f64
}

fn refuse(path: &Path, faults: Faults) -> Failure {
    let line = faults.0.first().map(|fault| fault.line as u64);
    Failure::new(Exit::Config, faults.of(path)).at(path, line)
}
