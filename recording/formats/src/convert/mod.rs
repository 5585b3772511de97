//! Foreign data as raw samples: text with a mapping, NovAtel logs, and `sensor_msgs/msg/Imu` in MCAP.
//!
//! A [`Conversion`] is an iterator over [`RawSample`]s. Pulses are `round((value - offset) / resolution)`, with the
//! sign of the axis, on the positive or the negative channel. The sequence begins at 0; it rises by 1 from row to row,
//! and for readings by more where the time shows that rows are missing.

mod clock;
mod interval;
mod mapping;
mod novatel;
mod proposal;
mod refused;
mod ros;
mod text;

pub use mapping::{ColumnRef, Decimal, Kind, KnownColumns, Mapping, Sensors, Temperature, Time};

use clock::{Counter, EvenClock};
use interval::{GAP, Nominal, Steps};
use isotherm_failure::{Exit, Failure};
use isotherm_files::{LoadError, WorldWritable, open_recording, read_text};
use isotherm_finding::{Finding, name};
use isotherm_recording::RecordingError;
use isotherm_recording::columns::{Layout, MCAP_MAGIC};
use isotherm_recording::csv::Rows;
use isotherm_shared::document::Faults;
use isotherm_shared::wire::{AXES, MAX_INTERVAL_NS, RawSample, Triad};
use std::collections::VecDeque;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

/// Telemetry of data that have none, unless it is given. A placeholder.
pub const PLACEHOLDER: f64 = 25.0;
/// Rows from which the nominal interval is found,
const FOUND_FROM: usize = 1000;
/// and where the stamps jitter or come in bursts, which takes longer to average out.
const FOUND_FROM_JITTER: usize = 100_000;
/// Intervals beyond these are no IMU's \[ns\].
const PLAUSIBLE_NS: [u64; 2] = [20_000, 100_000_000_000];
/// Bytes by which the format is recognised.
const BEGINNING: u64 = 1 << 16;

/// What is known of foreign data besides a mapping.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// The telemetry of all rows, in the unit of the table.
    pub temperature: Option<f64>,
    /// The nominal interval \[ns\].
    pub interval_ns: Option<u64>,
    /// The topic of the `sensor_msgs/msg/Imu`, if there are several.
    pub topic: Option<String>,
    /// The topic of the `sensor_msgs/msg/Temperature`, if there are several.
    pub temperature_topic: Option<String>,
}

/// A row of a source.
#[derive(Clone, Copy, Debug, Default)]
struct Reading {
    /// Line of a text, number of a message.
    place: u64,
    /// `None` in a text without a column of the time.
    timestamp_ns: Option<u64>,
    /// Pulses with their sign: A1, A2, A3, G1, G2, G3.
    pulses: [i64; 2 * AXES],
    head: [f64; 2 * AXES],
    board: [f64; 2 * AXES],
}

/// What the foreign formats have in common.
trait Source {
    /// The next row.
    fn read(&mut self) -> Result<Option<Reading>, RecordingError>;

    /// An error about the row at this place.
    fn error(&self, place: u64, message: String) -> RecordingError;

    /// Whether the rows have gyroscopes.
    fn has_gyroscopes(&self) -> bool;

    /// The unit of the time, if its column has whole numbers \[ns\].
    fn whole_unit_ns(&self) -> Option<u64> {
        None
    }

    /// Whether the time is that of the day.
    fn is_of_day(&self) -> bool {
        false
    }

    /// Whether the numbers count over the time since the row before, not over the nominal interval.
    fn counts_since_the_row_before(&self) -> bool {
        false
    }

    /// What the operator should know. Valid after the last row.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// What concerns the data's worth. Valid after the last row.
    fn findings(&self) -> Vec<Finding> {
        Vec::new()
    }
}

/// An iterator over the raw samples of foreign data that ends at the first error.
pub struct Conversion {
    path: PathBuf,
    source: Box<dyn Source>,
    /// Rows that have been read to find the nominal interval.
    ahead: VecDeque<Reading>,
    nominal_ns: u64,
    counter: Counter,
    /// The clock of rows whose stamps jitter or come in bursts.
    even: Option<EvenClock>,
    /// Number of rows that the nominal interval was found from, unless it was given.
    found_from: Option<usize>,
    /// Time and sequence of the last row.
    last: Option<(u64, u64)>,
    last_stamp_ns: Option<u64>,
    rows: u64,
    gaps: Gaps,
    steps: Steps,
    ended: bool,
}

/// Where rows are missing, or late if they have all counts since the row before.
#[derive(Default)]
struct Gaps {
    count: u64,
    missing: u64,
    first: u64,
}

/// Rows from which on stamps are said to jitter.
const LEAST_FOR_JITTER: usize = 50;

/// The next row of a source, its time joined over rollovers.
fn read_joined(source: &mut dyn Source, counter: &mut Counter) -> Result<Option<Reading>, RecordingError> {
    let Some(mut reading) = source.read()? else { return Ok(None) };
    let (unit_ns, of_day) = (source.whole_unit_ns(), source.is_of_day());
    reading.timestamp_ns = reading.timestamp_ns.map(|stamp_ns| counter.join(stamp_ns, unit_ns, of_day));
    Ok(Some(reading))
}

/// Reads on until `ahead` has `most` rows. Gives the place of the first, if there is one.
fn read_ahead(
    source: &mut dyn Source,
    counter: &mut Counter,
    ahead: &mut VecDeque<Reading>,
    most: usize,
) -> Result<Option<u64>, RecordingError> {
    while ahead.len() < most
        && let Some(reading) = read_joined(source, counter)?
    {
        ahead.push_back(reading);
    }
    Ok(ahead.front().map(|reading| reading.place))
}

impl Conversion {
    /// Opens foreign data. `-` is stdin, for text. The format is recognised by the first bytes.
    ///
    /// # Errors
    /// [`Exit::Usage`] if a text has no mapping, with the mapping that would be. [`Exit::Config`] with all faults of
    /// the mapping. [`Exit::Data`] if the data are of no known format, or do not have what the mapping names.
    /// [`Exit::Io`].
    pub fn open(path: &Path, mapping: Option<&Path>, settings: &Settings) -> Result<Self, Failure> {
        let text = match mapping {
            Some(mapping) => Some(read_text(mapping, WorldWritable::Allow)?.0),
            None => None,
        };
        Self::of_file(path, mapping.zip(text.as_deref()), settings)
    }

    /// As [`open`](Self::open), with the name and the text of the mapping file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn of_file(path: &Path, mapping: Option<(&Path, &str)>, settings: &Settings) -> Result<Self, Failure> {
        if path.is_dir() {
            let message = format!("{}: a folder; name the .mcap file in it", path.display());
            return Err(Failure::new(Exit::Data, message));
        }
        let source = open_recording(path).map_err(|error| Failure::io("opening", path, &error))?;
        Self::read(path, source, mapping, settings)
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
        Self::read(name, Box::new(text), mapping, settings)
    }

    fn read(
        path: &Path,
        mut source: Box<dyn Read>,
        mapping: Option<(&Path, &str)>,
        settings: &Settings,
    ) -> Result<Self, Failure> {
        let failed = |error: RecordingError| error.failure(path);
        let mut beginning = Vec::new();
        let read = (&mut source).take(BEGINNING).read_to_end(&mut beginning);
        read.map_err(|error| Failure::io("reading", path, &error))?;
        if let Some(message) = refused::reason(&beginning) {
            return Err(Failure::new(Exit::Data, format!("{}: {message}", path.display())));
        }
        let (is_mcap, is_novatel) = (beginning.starts_with(MCAP_MAGIC), novatel::is_log(&beginning));
        let source: Box<dyn Read> = Box::new(Cursor::new(beginning).chain(source));
        if !is_mcap && (settings.topic.is_some() || settings.temperature_topic.is_some()) {
            return Err(Failure::new(
                Exit::Usage,
                format!("{}: a topic is named, but this is not MCAP", path.display()),
            ));
        }
        if is_mcap || is_novatel {
            let known = match mapping {
                Some((file, text)) => KnownColumns::from_toml(text).map_err(|faults| refuse(file, faults))?,
                None => KnownColumns::default(),
            };
            let temperature = settings.temperature.or(known.temperature);
            let source: Box<dyn Source> = if is_mcap {
                Box::new(ros::RosSource::open(path, settings, temperature)?)
            } else {
                Box::new(novatel::NovatelSource::new(source, temperature))
            };
            return Self::begin(path, source, settings.interval_ns.or(known.interval_ns)).map_err(failed);
        }
        let mut rows = Rows::new(source);
        let Some((file, text)) = mapping else {
            let proposal = proposal::propose(&mut rows).map_err(failed)?;
            let name = path.display();
            let message = format!("{name}: which columns are what? Give --mapping with a file such as\n\n{proposal}");
            return Err(Failure::new(Exit::Usage, message));
        };
        let mut mapping = Mapping::from_toml(text).map_err(|faults| refuse(file, faults))?;
        if let Some(temperature) = settings.temperature {
            mapping.temperature = Temperature::Constant(temperature);
        }
        let interval_ns = settings.interval_ns.or(mapping.time.interval_ns);
        let source = text::TextSource::new(rows, mapping).map_err(failed)?;
        Self::begin(path, Box::new(source), interval_ns).map_err(failed)
    }

    /// Reads as many rows as are needed to find the nominal interval, if it is not given.
    fn begin(path: &Path, mut source: Box<dyn Source>, interval_ns: Option<u64>) -> Result<Self, RecordingError> {
        let (mut ahead, mut counter) = (VecDeque::new(), Counter::default());
        let first = read_ahead(&mut *source, &mut counter, &mut ahead, FOUND_FROM)?;
        let Some(first) = first else { return Err(source.error(0, "there are no rows".to_owned())) };
        let find = |ahead: &VecDeque<Reading>| {
            interval::nominal(&ahead.iter().filter_map(|row| row.timestamp_ns).collect::<Vec<_>>())
        };
        let readings = !source.counts_since_the_row_before();
        let mut found = find(&ahead);
        if readings && found.is_none_or(|found| !found.is_regular) && ahead.len() == FOUND_FROM {
            read_ahead(&mut *source, &mut counter, &mut ahead, FOUND_FROM_JITTER)?;
            found = find(&ahead);
        }
        let nominal_ns = interval_ns.or(found.map(|found| found.interval_ns)).ok_or_else(|| {
            let message = "the nominal interval cannot be found from the time; give time.interval_s or --interval";
            source.error(first, message.to_owned())
        })?;
        let jitters = found.filter(|found| readings && !found.is_regular && ahead.len() >= LEAST_FOR_JITTER);
        let even = jitters.map(|found| EvenClock::new(&Nominal { interval_ns: nominal_ns, ..found }));
        let found_from = interval_ns.is_none().then_some(ahead.len());
        Ok(Self {
            path: path.to_owned(),
            source,
            ahead,
            nominal_ns,
            counter,
            even,
            found_from,
            last: None,
            last_stamp_ns: None,
            rows: 0,
            gaps: Gaps::default(),
            steps: Steps::new(nominal_ns),
            ended: false,
        })
    }

    /// The next row of the source, its time joined over rollovers.
    fn next_reading(&mut self) -> Result<Option<Reading>, RecordingError> {
        match self.ahead.pop_front() {
            Some(reading) => Ok(Some(reading)),
            None => read_joined(&mut *self.source, &mut self.counter),
        }
    }

    /// Which columns the samples need.
    #[must_use]
    pub fn layout(&self) -> Layout {
        Layout { gyroscopes: self.source.has_gyroscopes(), ..Layout::default() }
    }

    /// Number of rows so far.
    #[must_use]
    pub const fn rows(&self) -> u64 {
        self.rows
    }

    /// What the operator should know, a line each. Valid after the last row.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.source.notes();
        if let Some(rows) = self.found_from {
            let seconds = self.nominal_ns as f64 / 1e9;
            notes.push(format!(
                "the nominal interval is {seconds} s, found from the first {rows} rows; for recordings that belong together give it"
            ));
        }
        notes
    }

    /// What concerns the data's worth. Valid after the last row.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        let mut found = self.source.findings();
        let mut add = |name, message| found.push(Finding::warning(name, message));
        let seconds = self.nominal_ns as f64 / 1e9;
        if !(PLAUSIBLE_NS[0]..=PLAUSIBLE_NS[1]).contains(&self.nominal_ns) {
            let message = format!("the interval is {seconds} s, which no IMU has; is the unit of the time right?");
            add(name::INTERVAL, message);
        }
        if self.counter.rollovers > 0 {
            let (count, width_s) = (self.counter.rollovers, self.counter.width_ns as f64 / 1e9);
            let times = if count == 1 { "once".to_owned() } else { format!("{count} times") };
            add(name::ROLLOVER, format!("the time rolled over {times}, after {width_s} s: it is joined there"));
        }
        if self.even.is_some() {
            let message = format!(
                "the stamps jitter, or come in bursts: the rows are put {seconds} s apart, on a clock that follows the stamps; rows that are \
                 lost cannot be told from jitter"
            );
            add(name::STAMPS, message);
        }
        let Gaps { count, missing, first } = self.gaps;
        if count > self.rows / 2 {
            add(name::INTERVAL, format!("most rows are over {GAP} nominal intervals apart; is {seconds} s right?"));
            return found;
        }
        if count > 0 && self.source.counts_since_the_row_before() {
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
        if let Some(mean_ns) = self.steps.other_mean() {
            add(
                name::INTERVAL,
                format!(
                    "rows are {} ms apart on average, but the interval is {} ms; correct interval_s",
                    mean_ns.round() / 1e6,
                    self.nominal_ns as f64 / 1e6
                ),
            );
        }
        found
    }

    fn advance(&mut self) -> Result<Option<RawSample>, RecordingError> {
        let Some(reading) = self.next_reading()? else { return Ok(None) };
        let sample = self.sample(&reading).map_err(|message| self.source.error(reading.place, message))?;
        self.rows += 1;
        Ok(Some(sample))
    }

    fn sample(&mut self, reading: &Reading) -> Result<RawSample, String> {
        let nominal_ns = self.nominal_ns;
        let stamp_ns = reading.timestamp_ns.unwrap_or_else(|| nominal_ns.saturating_mul(self.rows + 1));
        if let Some(last_ns) = self.last_stamp_ns.replace(stamp_ns)
            && (stamp_ns < last_ns || stamp_ns == last_ns && self.even.is_none())
        {
            return Err(stepped_back(last_ns, stamp_ns));
        }
        let (timestamp_ns, missing) = match &mut self.even {
            Some(clock) => clock.next(stamp_ns),
            None => (stamp_ns, 0),
        };
        if self.even.is_some() {
            return self.evenly(reading, timestamp_ns, missing);
        }
        let (mut sequence, mut interval_ns) = (0, nominal_ns);
        if let Some((last_ns, last)) = self.last {
            let step_ns = timestamp_ns - last_ns;
            self.steps.take(step_ns);
            let mut missing = 0;
            let steps = step_ns as f64 / nominal_ns as f64;
            if steps > GAP {
                missing = (steps.round() as u64).saturating_sub(1);
                self.gaps.count += 1;
                if self.gaps.count == 1 {
                    self.gaps.first = self.rows + 1;
                }
            }
            if self.source.counts_since_the_row_before() {
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
        Ok(self.made(reading, sequence, timestamp_ns, interval_ns))
    }

    /// The sample of a row by the even clock, with rows missing before it.
    fn evenly(&mut self, reading: &Reading, timestamp_ns: u64, missing: u64) -> Result<RawSample, String> {
        let mut sequence = 0;
        if let Some((_, last)) = self.last {
            self.count_gap(missing);
            sequence = last.checked_add(missing.saturating_add(1)).ok_or("over all that a sequence can count")?;
        }
        Ok(self.made(reading, sequence, timestamp_ns, self.nominal_ns))
    }

    fn count_gap(&mut self, missing: u64) {
        if missing > 0 {
            self.gaps.count += 1;
            self.gaps.missing = self.gaps.missing.saturating_add(missing);
            if self.gaps.count == 1 {
                self.gaps.first = self.rows + 1;
            }
        }
    }

    fn made(&mut self, reading: &Reading, sequence: u64, timestamp_ns: u64, interval_ns: u64) -> RawSample {
        self.last = Some((timestamp_ns, sequence));
        let gyroscopes = if self.source.has_gyroscopes() { triad(reading, AXES) } else { Triad::ABSENT };
        RawSample {
            sequence,
            timestamp_ns,
            interval_ns,
            accelerometers: triad(reading, 0),
            gyroscopes,
            ..RawSample::default()
        }
    }
}

impl Iterator for Conversion {
    type Item = Result<RawSample, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let item = self.advance().transpose();
        self.ended = !matches!(item, Some(Ok(_)));
        item.map(|item| item.map_err(|error| error.failure(&self.path)))
    }
}

/// What a time that does not rise may be.
fn stepped_back(last_ns: u64, stamp_ns: u64) -> String {
    let shown = format!("the time is {stamp_ns} ns after {last_ns} ns; it must rise from row to row");
    if stamp_ns == last_ns {
        return format!("{shown}: two rows have one time");
    }
    format!(
        "{shown}: another recording begins here, the logger was started again, or rows are out of order; it is no rollover of 2^32 us, \
         2^32 ms or a counter; split the data here"
    )
}

/// The sensors of a row from this index on.
fn triad(reading: &Reading, first: usize) -> Triad {
    let mut triad = Triad::default();
    for axis in 0..AXES {
        let (pulses, index) = (reading.pulses[first + axis], first + axis);
        // The sources have checked the size.
        let size = pulses.unsigned_abs() as u32;
        if pulses < 0 {
            triad.negative_pulses[axis] = size;
        } else {
            triad.positive_pulses[axis] = size;
        }
        triad.head_temperature[axis] = reading.head[index];
        triad.board_temperature[axis] = reading.board[index];
    }
    triad
}

/// The pulses of a value; `Err` says what is wrong with it.
fn pulses(value: f64, offset: f64, resolution: f64, sign: f64) -> Result<i64, String> {
    let pulses = (sign * ((value - offset) / resolution)).round();
    if pulses.abs() <= f64::from(u32::MAX) {
        return Ok(pulses as i64);
    }
    Err(format!(
        "{value} is {pulses} pulses of {resolution}, over {}; give a larger resolution, or the offset",
        u32::MAX
    ))
}

fn refuse(path: &Path, faults: Faults) -> Failure {
    LoadError::Refused { path: path.to_owned(), faults }.into()
}

/// Tells that the telemetry is a placeholder, if it is not given.
fn placeholder(temperature: Option<f64>) -> Option<Finding> {
    let warning = || {
        let message = format!(
            "the data have no temperature; {PLACEHOLDER} is in all rows as a placeholder; give --temperature, or \
             temperature.constant in a mapping"
        );
        Finding::warning(name::NO_TEMPERATURE, message)
    };
    temperature.is_none().then(warning)
}
