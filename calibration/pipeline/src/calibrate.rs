//! One calibration: read, hash, fit, seal, report.

use crate::files::{Bar, CampaignFile};
use crate::laid_out::{PositionData, by_position, of_means};
use crate::samples::RowSource;
use isotherm_campaign::{Campaign, Ramp};
use isotherm_documents::load_table_text;
use isotherm_files::{Trust, sources};
use isotherm_fit::{
    CalibrationData, CalibrationError, CalibrationOptions, CalibrationOutcome, CampaignSource, Measurements,
    RampRecording, TumbleOptions, TumbleRecording, WarmUpOptions, observable, read_measurements, sha256,
};
use isotherm_recording::{CampaignRow, LogImu, Marks, Progress, RecordingError};
use isotherm_recording_formats::convert::{Foreign, Settings};
use isotherm_recording_formats::read::{ImuChoice, Input, Part, Pieces, Places, Recording, RowKind};
use isotherm_report::{json, outcome};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{CoefficientTable, Nominal, PulseScale, nominal_content, nominal_table};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Finding, Severity, name};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// How the recordings of a calibration are read.
#[derive(Clone, Debug, Default)]
pub struct InputOptions {
    /// Whether the findings that a diagnosis explains are listed too.
    pub symptoms: bool,
    /// How recordings are read where other programs wrote them; not of a turntable.
    pub foreign: Foreign,
    /// The part of each recording that is read.
    pub part: Part,
}

/// Why a job ends: there is no table, or the verdict is negative.
#[derive(Debug)]
pub struct JobFailure {
    /// For the operator.
    pub failure: Failure,
    /// The same as JSON, with the findings.
    pub document: Value,
    /// What the fit refused, with file and line of each row of the samples; `None` if it was not reached.
    pub fit: Option<Box<(CalibrationError, Places)>>,
}

impl<F: Into<Failure>> From<F> for JobFailure {
    fn from(failure: F) -> Self {
        let failure = failure.into();
        Self { document: json::failure(&failure), failure, fit: None }
    }
}

/// What was measured, with where it comes from.
#[derive(Clone, Debug)]
pub struct Inputs {
    /// The measurements.
    pub measured: CalibrationData,
    /// Where they come from.
    pub origin: InputOrigin,
}

/// Where measurements come from.
#[derive(Clone, Debug, Default)]
pub struct InputOrigin {
    /// File and line of each row of the samples.
    pub places: Places,
    /// What messages call the samples: their first file.
    pub samples: PathBuf,
    /// SHA-256 of the samples of positions, in hexadecimal.
    pub samples_sha256: String,
    /// SHA-256 of each recording of ramps, of a tumble or of a warm-up.
    pub recordings_sha256: Vec<String>,
    /// The marks of all recordings.
    pub rows: Vec<Marks>,
    /// What the operator should know of recordings that other programs wrote, a line each.
    pub notes: Vec<String>,
    /// The IMU, as the logs of an autopilot name it.
    pub log_imu: Option<LogImu>,
    /// The part of the recordings that was read, in words; `None` for all of them.
    pub part: Option<String>,
    /// Whether the findings that a diagnosis explains are listed too.
    pub symptoms: bool,
}

/// A calibration with the text of its table.
#[derive(Clone, Debug)]
pub struct JobOutcome {
    /// The calibration.
    pub fitted: CalibrationOutcome,
    /// The text of the table file, sealed, with its provenance.
    pub table: String,
    /// Where it comes from.
    pub source: CampaignSource,
    /// File and line of each row of the samples.
    pub places: Places,
    /// What the operator should know of recordings that other programs wrote, a line each.
    pub notes: Vec<String>,
}

impl Inputs {
    /// Reads what a campaign on a turntable names, also one with only ramps. `samples` replace those that the campaign
    /// file names.
    ///
    /// # Errors
    /// If positions and turns do not determine all parameters, or if a file cannot be read.
    pub fn turntable(
        campaign: &Campaign,
        file: &CampaignFile,
        samples: Vec<RowSource<'_>>,
        options: CalibrationOptions,
        input: &InputOptions,
        bar: Bar<'_>,
    ) -> Result<Self, JobFailure> {
        let samples = named_unless_given(samples, campaign, Some(file))?;
        let mut origin = InputOrigin::new(&samples, Some(file), input);
        let reader =
            RecordingReader { input: Input::from(ImuChoice::Prefer(campaign.imu.clone())).within(input.part), bar };
        let curves = file.curves(campaign).map(|path| curves(&path, campaign)).transpose()?;
        let mut measurements = Measurements::default();
        if curves.is_none() {
            // Checked first, because reading may take minutes.
            observable(campaign).map_err(|error| origin.refusal(error, Some(file)))?;
            measurements = reader.positions((campaign, file), samples, &mut origin)?;
        }
        let ramps = origin.take(reader.ramps(campaign, &file.ramps(campaign))?);
        let measured = match curves {
            Some((curves, curves_have_errors)) => {
                CalibrationData::Ramps(ramps, Box::new(curves), CalibrationOptions { curves_have_errors, ..options })
            }
            None => CalibrationData::Campaign(Measurements { ramps, ..measurements }, options),
        };
        Ok(Self { measured, origin })
    }

    /// Reads the recordings of a tumble: those of `samples`, otherwise those that the campaign file names. `file` is
    /// `None` if options describe the IMU.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn tumble(
        campaign: &Campaign,
        file: Option<&CampaignFile>,
        samples: Vec<RowSource<'_>>,
        options: TumbleOptions,
        input: &InputOptions,
        bar: Bar<'_>,
    ) -> Result<Self, JobFailure> {
        let samples = named_unless_given(samples, campaign, file)?;
        let mut origin = InputOrigin::new(&samples, file, input);
        let reader = RecordingReader::foreign(&campaign.imu, input, bar);
        let recordings = origin.take(reader.tumbles(samples)?);
        Ok(Self { measured: CalibrationData::Tumble(recordings, options), origin })
    }

    /// Reads the recordings of a warm-up, which are at one attitude, and what describes them. Without a `nominal` table
    /// they must be readings of other programs: their resolution makes it.
    ///
    /// # Errors
    /// If a file cannot be read, or if no nominal table can be made.
    pub fn warm_up(
        imu: &ImuId,
        samples: Vec<RowSource<'_>>,
        (nominal, gravity): (Option<CoefficientTable>, Option<f64>),
        options: WarmUpOptions,
        input: &InputOptions,
        bar: Bar<'_>,
    ) -> Result<(Campaign, Self), JobFailure> {
        let mut origin = InputOrigin::new(&samples, None, input);
        let mut reader = RecordingReader::foreign(imu, input, bar);
        if let Some(foreign) = &mut reader.input.foreign {
            foreign.settings.table = nominal.as_ref().map(PulseScale::of);
        }
        let read = reader.warm_ups(imu, samples)?;
        let names: Vec<_> = read.iter().map(|read| read.name.clone()).collect();
        let (recordings, found): (Vec<_>, Vec<_>) = origin.take(read).into_iter().unzip();
        let found = found.into_iter().zip(&names).map(|(found, name)| found.unwrap_or_else(|| Err(no_nominal(name))));
        let of_readings = joint(found.collect());
        let nominal = match nominal {
            Some(nominal) => completed(nominal, of_readings.ok(), &mut origin.notes),
            None => of_readings.map_err(needs_nominal).and_then(|found| nominal_of(found, gravity))?,
        };
        let content = nominal.content();
        let campaign = Campaign::warm_up(imu.clone(), content.gravity, &content.temperature_unit, &names);
        Ok((campaign, Self { measured: CalibrationData::WarmUp(recordings, Box::new(nominal), options), origin }))
    }

    /// Makes the table.
    ///
    /// # Errors
    /// If the data do not allow a valid table.
    pub fn fit(self, campaign: &Campaign, file: Option<&CampaignFile>) -> Result<JobOutcome, JobFailure> {
        let Self { measured, origin } = self;
        let fitted = CalibrationOutcome::fit(campaign, measured).map_err(|error| origin.refusal(error, file))?;
        let source = CampaignSource {
            campaign: file.map(CampaignFile::name).unwrap_or_default(),
            campaign_sha256: file.map_or_else(String::new, |file| sha256(file.text.as_bytes())),
            samples_sha256: origin.samples_sha256,
            recordings_sha256: origin.recordings_sha256,
            rows: origin.rows,
            part: origin.part,
            log_imu: origin.log_imu,
            ..CampaignSource::at(crate::now())
        };
        let table = fitted.sealed(campaign, &source).map_err(|message| Failure::new(Exit::Failed, message))?;
        Ok(JobOutcome { fitted, table, source, places: origin.places, notes: origin.notes })
    }
}

/// The samples that are given, otherwise those that the campaign file names.
fn named_unless_given<'a>(
    samples: Vec<RowSource<'a>>,
    campaign: &Campaign,
    file: Option<&CampaignFile>,
) -> Result<Vec<RowSource<'a>>, Failure> {
    match file {
        Some(file) if samples.is_empty() => file.sources(campaign),
        _ => Ok(samples),
    }
}

impl InputOrigin {
    fn new(samples: &[RowSource<'_>], file: Option<&CampaignFile>, input: &InputOptions) -> Self {
        Self {
            samples: samples.first().map(RowSource::path).or(file.map(|file| file.path.clone())).unwrap_or_default(),
            part: input.part.told(),
            symptoms: input.symptoms,
            ..Self::default()
        }
    }

    /// Takes hashes and marks of recordings; returns the recordings.
    fn take<T>(&mut self, read: Vec<RecordingInput<T>>) -> Vec<T> {
        let mut named = read.iter().map(|read| read.log_imu);
        self.log_imu =
            named.next().flatten().filter(|first| named.all(|imu| imu.is_some_and(|imu| !imu.differs_from(first))));
        let recording = |RecordingInput { name: _, recording, sha256, rows, notes, log_imu: _ }| {
            self.recordings_sha256.push(sha256);
            self.rows.push(rows);
            self.notes.extend(notes);
            recording
        };
        read.into_iter().map(recording).collect()
    }

    fn refusal(&self, error: CalibrationError, file: Option<&CampaignFile>) -> JobFailure {
        let locate = |line| self.places.locate(line);
        let path = file.map_or(&self.samples, |file| &file.path);
        let failure = error.failure_with(path, &self.samples, locate, self.symptoms);
        let document = json::refusal(&error, &failure, locate);
        JobFailure { document, failure, fit: Some(Box::new((error, self.places.clone()))) }
    }
}

impl JobOutcome {
    /// What was found, in lines.
    #[must_use]
    pub fn text(&self) -> String {
        outcome::text(&self.fitted)
    }

    /// What was found, as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        outcome::json(&self.fitted, |line| self.places.locate(line))
    }

    /// The report as HTML.
    #[must_use]
    pub fn html(&self, campaign: &Campaign) -> String {
        outcome::html(campaign, &self.fitted, &self.source, &|line| self.places.locate(line))
    }

    /// The findings, a line each.
    pub fn findings(&self) -> impl Iterator<Item = String> {
        self.fitted.findings().iter().map(|finding| finding.tagged(|line| self.places.locate(line)))
    }
}

/// The table that only ramps begin with, and whether its provenance states errors of its bias curves.
fn curves(path: &Path, campaign: &Campaign) -> Result<(CoefficientTable, bool), Failure> {
    let (table, text, _) = load_table_text(path, Some(&campaign.imu), Trust::Any)?;
    let has_errors = isotherm_fit::Origin::of_toml(&text, &table).has_bias_errors();
    Ok((table, has_errors))
}

/// What a file of readings says of its pulses.
type ReadingsNominal = Result<Nominal, Failure>;

/// That rows in memory say nothing of their readings.
fn no_nominal(name: &str) -> Failure {
    Failure::new(Exit::Usage, format!("{name}: no nominal table: rows in memory do not say what a pulse is"))
}

/// Why no nominal table can be made, with the remedy.
fn needs_nominal(failure: Failure) -> Failure {
    let message = format!("{}; counts need --nominal TABLE.toml, which says what a pulse is", failure.message);
    Failure { message, ..failure }
}

/// What makes the nominal table of all recordings.
fn joint(all: Vec<Result<Nominal, Failure>>) -> Result<Nominal, Failure> {
    let join = |one: Nominal, other: Nominal| {
        let ranges = [one.range, other.range];
        let range = [ranges[0][0].min(ranges[1][0]), ranges[0][1].max(ranges[1][1])];
        let alike = Nominal { range, ..one };
        if alike == (Nominal { range, ..other }) {
            return Ok(alike);
        }
        let message = "the recordings differ in nominal interval, resolution or gyroscopes; give --interval, or recordings of one kind";
        Err(Failure::new(Exit::Data, message))
    };
    let mut all = all.into_iter();
    let first = all.next().ok_or_else(|| Failure::new(Exit::Usage, "no recording is named"))??;
    all.try_fold(first, |one, other| join(one, other?))
}

/// The nominal table of readings; `gravity` is 1 g0 \[m/s2\].
fn nominal_of(found: Nominal, gravity: Option<f64>) -> Result<CoefficientTable, Failure> {
    let gravity = gravity.unwrap_or(found.gravity);
    nominal_table(&Nominal { gravity, ..found }).map_err(|refusals| Failure::new(Exit::Config, refusals.to_string()))
}

/// A table with what readings say and it lacks: their interval, and their gyroscopes.
fn completed(table: CoefficientTable, found: Option<Nominal>, notes: &mut Vec<String>) -> CoefficientTable {
    let Some(found) = found else { return table };
    let mut content = table.content().clone();
    let of_readings = nominal_content(&Nominal { gravity: content.gravity, ..found }).ok();
    let Some(of_readings) = of_readings else { return table };
    content.nominal_interval_s = content.nominal_interval_s.or(of_readings.nominal_interval_s);
    if content.gyroscopes.is_none() && of_readings.gyroscopes.is_some() {
        content.gyroscopes = of_readings.gyroscopes;
        notes.push("the nominal table has no gyroscopes: those of the readings' resolution are taken".to_owned());
    }
    content.format = content.least_format();
    match CoefficientTable::new(content) {
        Ok(complete) => complete.measured_at(table.gravity_local()),
        Err(_) => table,
    }
}

/// A recording that was read, with the SHA-256 of its file, and its marks.
struct RecordingInput<T> {
    /// What messages call it.
    name: String,
    recording: T,
    sha256: String,
    rows: Marks,
    notes: Vec<String>,
    log_imu: Option<LogImu>,
}

/// A recording of a warm-up, and what makes a nominal table of it.
type WarmUpRecording = (RampRecording, Option<ReadingsNominal>);
type Row = Result<CampaignRow, RecordingError>;

/// The failure of rows in memory with this name. They are counted as in the array that they come from.
fn row_failure(name: &str, error: &RecordingError) -> Failure {
    let path = Path::new(name);
    match error {
        RecordingError::Data { line, message } => {
            Failure::new(Exit::Data, format!("{}: row {line}: {message}", shown(path))).at(path, Some(*line))
        }
        error => error.failure(path),
    }
}

/// The rows, which `marks` takes as they pass.
fn marked<'a>(rows: impl Iterator<Item = Row> + 'a, marks: &'a mut Marks) -> impl Iterator<Item = Row> + 'a {
    rows.inspect(|row| row.iter().for_each(|row| marks.add(&row.sample)))
}

/// What was found in the files of a recording. With clocks that are apart, its curves would be those of another time.
fn found_in(rows: &Recording) -> Vec<Finding> {
    let judged = |finding: Finding| match finding.name {
        name::CLOCKS_APART => Finding { severity: Severity::Fault, ..finding },
        _ => finding,
    };
    rows.findings().into_iter().map(judged).collect()
}

/// Reads the recordings of one IMU.
struct RecordingReader<'a> {
    input: Input,
    bar: Bar<'a>,
}

impl<'a> RecordingReader<'a> {
    /// The reader of recordings that other programs may have written.
    fn foreign(imu: &ImuId, input: &InputOptions, bar: Bar<'a>) -> Self {
        let choice = ImuChoice::Prefer(imu.clone());
        Self { input: Input::from((choice, input.foreign.clone())).within(input.part), bar }
    }

    /// Dwells and turns: from files by position, a sheet of means, or the pieces of one recording.
    fn positions(
        &self,
        (campaign, file): (&Campaign, &CampaignFile),
        mut samples: Vec<RowSource<'_>>,
        origin: &mut InputOrigin,
    ) -> Result<Measurements, Failure> {
        if let Some(laid_out) = self.laid_out((campaign, file), &samples)? {
            origin.places = laid_out.places;
            origin.rows.push(laid_out.marks);
            origin.samples_sha256 = laid_out.sha256;
            origin.notes.extend(laid_out.notes);
            return Ok(laid_out.measurements);
        }
        if let [RowSource::Rows { name, sha256, rows }] = samples.as_mut_slice() {
            origin.samples_sha256 = core::mem::take(sha256);
            origin.places.begin(Path::new(name), Some("row"), 0);
            let mut marks = Marks::default();
            let rows = self.input.part.of_rows(name, rows);
            let measurements = read_measurements(campaign, marked(rows, &mut marks));
            origin.rows.push(marks);
            return measurements.map_err(|error| row_failure(name, &error));
        }
        let paths: Vec<_> = samples.iter().map(RowSource::path).collect();
        let bar = (self.bar)(&paths, "reading");
        let mut rows = Recording::open_hashed(&sources(&paths)?, RowKind::Campaign, self.input.clone(), &bar)?;
        let mut marks = Marks::default();
        let measurements = read_measurements(campaign, marked(&mut rows, &mut marks));
        origin.rows.push(marks);
        bar.finish();
        let mut measurements = measurements.map_err(|error| rows.failure(&error))?;
        measurements.findings.extend(found_in(&rows));
        origin.notes.extend(rows.notes());
        origin.places = rows.places().clone();
        origin.samples_sha256 = rows.sha256()?;
        Ok(measurements)
    }

    /// Files by position, or a sheet of means; `None` of a recording.
    fn laid_out(
        &self,
        (campaign, file): (&Campaign, &CampaignFile),
        samples: &[RowSource<'_>],
    ) -> Result<Option<PositionData>, Failure> {
        let of_position = |source: &RowSource<'_>| match source {
            RowSource::Position(file) => Some(file.clone()),
            _ => None,
        };
        let files: Vec<_> = samples.iter().filter_map(of_position).collect();
        let mapping = file.mapping()?;
        if let ([RowSource::Means(sheet)], Some(mapping)) = (samples, &mapping) {
            return of_means(campaign, sheet, mapping.clone()).map(Some);
        }
        if files.is_empty() {
            return Ok(None);
        }
        let paths: Vec<_> = samples.iter().map(RowSource::path).collect();
        let bar = (self.bar)(&paths, "reading");
        let settings = Settings { mapping: mapping.clone(), ..Settings::default() };
        let foreign = mapping.is_some().then(|| Foreign { settings, ..Foreign::default() });
        let input = Input { foreign, ..self.input.clone() };
        let read = by_position(campaign, &files, (&input, mapping.as_ref()), &bar);
        bar.finish();
        read.map(Some)
    }

    /// Ramps, with the SHA-256 of each. Messages call each as the campaign file does, wherever it lies.
    fn ramps(&self, campaign: &Campaign, paths: &[PathBuf]) -> Result<Vec<RecordingInput<RampRecording>>, Failure> {
        let bar = (self.bar)(paths, "reading ramps");
        let read = |(path, ramp): (&PathBuf, &Ramp)| {
            let recording = |rows: &mut dyn Iterator<Item = Row>| RampRecording::read(ramp.samples.clone(), rows);
            self.recording(path, &bar, recording, |recording, rows| recording.with_findings(found_in(rows)))
        };
        let all = paths.iter().zip(&campaign.ramps).map(read).collect();
        bar.finish();
        all
    }

    /// Recordings of a tumble, with the SHA-256 of each.
    fn tumbles(&self, samples: Vec<RowSource<'_>>) -> Result<Vec<RecordingInput<TumbleRecording>>, Failure> {
        let read = |name: &str, rows: &mut dyn Iterator<Item = Row>| TumbleRecording::read(name.to_owned(), rows);
        self.recordings(samples, read, |recording, rows| match rows {
            Some(rows) => recording.with_findings(found_in(rows)),
            None => recording,
        })
    }

    /// Recordings of a warm-up, with the SHA-256 of each, and with what makes a nominal table; `None` of rows in
    /// memory.
    fn warm_ups(
        &self,
        imu: &ImuId,
        samples: Vec<RowSource<'_>>,
    ) -> Result<Vec<RecordingInput<WarmUpRecording>>, Failure> {
        let read =
            |name: &str, rows: &mut dyn Iterator<Item = Row>| RampRecording::read_screened(name.to_owned(), rows);
        self.recordings(samples, read, |recording, rows| match rows {
            Some(rows) => {
                let recording = recording.with_findings(found_in(rows)).of_table(rows.fits_table());
                (recording.with_in_use(rows.vehicle_state().in_use()), Some(rows.nominal(imu)))
            }
            None => (recording, None),
        })
    }

    /// The recordings that these are, in the order in which their first pieces are named: of files whose times go on
    /// from each other it is one. `complete` adds what files report after the last row.
    fn recordings<T, U>(
        &self,
        samples: Vec<RowSource<'_>>,
        read: impl Fn(&str, &mut dyn Iterator<Item = Row>) -> Result<T, RecordingError>,
        complete: impl Fn(T, Option<&Recording>) -> U,
    ) -> Result<Vec<RecordingInput<U>>, Failure> {
        let named: Vec<_> = samples.iter().map(RowSource::path).collect();
        let bar = (self.bar)(&named, "reading");
        let (mut all, mut files) = (Vec::new(), Vec::new());
        for (place, source) in samples.into_iter().enumerate() {
            match source {
                RowSource::File(path) | RowSource::Means(path) => files.push(path),
                RowSource::Position(file) => files.push(file.path),
                RowSource::Rows { name, sha256, rows } => {
                    let mut marks = Marks::default();
                    let rows = self.input.part.of_rows(&name, rows);
                    let recording = read(&name, &mut marked(rows, &mut marks));
                    let recording = complete(recording.map_err(|error| row_failure(&name, &error))?, None);
                    let (notes, log_imu) = (Vec::new(), None);
                    all.push((place, RecordingInput { name, recording, sha256, rows: marks, notes, log_imu }));
                }
            }
        }
        let mut left = match files.is_empty() {
            true => None,
            false => Some(Pieces::new(&sources(&files)?, RowKind::Sample, self.input.clone())?),
        };
        while let Some(pieces) = left.take() {
            let path = pieces.paths().next().map(Path::to_owned).unwrap_or_default();
            // A piece is named, or the folder that it is in.
            let place = named.iter().position(|named| *named == path || Some(named.as_path()) == path.parent());
            let name = path.display().to_string();
            let mut rows = pieces.first_recording_hashed(&bar)?;
            let mut marks = Marks::default();
            let recording = read(&name, &mut marked(&mut rows, &mut marks));
            let recording = recording.map_err(|error| rows.failure(&error))?;
            left = rows.others();
            let (recording, notes, log_imu) = (complete(recording, Some(&rows)), rows.notes(), rows.log_imu());
            let read = RecordingInput { name, recording, sha256: rows.sha256()?, rows: marks, notes, log_imu };
            all.push((place.unwrap_or(usize::MAX), read));
        }
        bar.finish();
        // The sort is stable: what is in one folder stays in order.
        all.sort_by_key(|(place, _)| *place);
        Ok(all.into_iter().map(|(_, read)| read).collect())
    }

    /// One recording; `complete` adds what its file reports after the last row.
    fn recording<T>(
        &self,
        path: &Path,
        bar: &Progress,
        read: impl Fn(&mut dyn Iterator<Item = Row>) -> Result<T, RecordingError>,
        complete: impl Fn(T, &Recording) -> T,
    ) -> Result<RecordingInput<T>, Failure> {
        let files = [path.to_owned()];
        let mut rows = Recording::open_hashed(&sources(&files)?, RowKind::Sample, self.input.clone(), bar)?;
        let mut marks = Marks::default();
        let recording = read(&mut marked(&mut rows, &mut marks));
        let recording = recording.map_err(|error| rows.failure(&error))?;
        let (recording, notes, log_imu) = (complete(recording, &rows), rows.notes(), rows.log_imu());
        let name = path.display().to_string();
        Ok(RecordingInput { name, recording, sha256: rows.sha256()?, rows: marks, notes, log_imu })
    }
}
