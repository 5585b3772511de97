//! One calibration: read, hash, fit, seal, report.

use crate::files::{Bar, CampaignFile};
use crate::laid_out::{LaidOut, by_position, of_means};
use crate::samples::Source;
use indicatif::ProgressBar;
use isotherm_campaign::{Campaign, Ramp};
use isotherm_files::{Trust, load_table_text};
use isotherm_fit::{
    CalibrationData, CalibrationError, CalibrationOptions, CalibrationOutcome, CampaignSource, Measurements,
    RampRecording, TumbleOptions, TumbleRecording, WarmUpOptions, observable, read_measurements, sha256,
};
use isotherm_recording::{CampaignRow, LogImu, Marks, RecordingError};
use isotherm_recording_formats::convert::{Foreign, Settings};
use isotherm_recording_formats::read::{ImuChoice, Input, Part, Pieces, Places, Recording, RowKind};
use isotherm_report::{json, outcome};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{CoefficientTable, Nominal, nominal_content, nominal_table};
use isotherm_support::failure::{Exit, Failure};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Options of a fit of either kind; the campaign says which kind it is.
#[derive(Clone, Debug, Default)]
pub struct FitOptions {
    /// Of a campaign on a turntable, and of ramps.
    pub turntable: CalibrationOptions,
    /// Of an IMU that was put down by hand.
    pub by_hand: TumbleOptions,
    /// Of recordings at one attitude.
    pub at_one_attitude: WarmUpOptions,
    /// Whether the findings that a diagnosis explains are listed too.
    pub symptoms: bool,
    /// How recordings are read where other programs wrote them; not of a turntable.
    pub foreign: Foreign,
    /// The part of each recording that is read.
    pub part: Part,
}

/// Why there is no table.
#[derive(Debug)]
pub struct Refused {
    /// For the operator.
    pub failure: Failure,
    /// The same as JSON, with the findings.
    pub document: Value,
    /// What the fit refused, with file and line of each row of the samples; `None` if it was not reached.
    pub fit: Option<Box<(CalibrationError, Places)>>,
}

impl<F: Into<Failure>> From<F> for Refused {
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
    pub from: Origin,
}

/// Where measurements come from.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// File and line of each row of the samples.
    pub places: Places,
    /// What messages call the samples: their first file.
    pub samples: PathBuf,
    /// SHA-256 of the samples of positions, in hexadecimal.
    pub samples_sha256: String,
    /// SHA-256 of each recording of ramps, or of an IMU that was put down by hand.
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
pub struct Made {
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
    /// Reads what `campaign` names. `file` is the campaign file; `None` if options describe the IMU. `samples` replace
    /// those that the file names.
    ///
    /// # Errors
    /// If positions and turns do not determine all parameters, or if a file cannot be read.
    pub fn read(
        campaign: &Campaign,
        file: Option<&CampaignFile>,
        mut samples: Vec<Source<'_>>,
        options: &FitOptions,
        bar: Bar<'_>,
    ) -> Result<Self, Refused> {
        if samples.is_empty() {
            samples = file.map(|file| file.sources(campaign)).transpose()?.unwrap_or_default();
        }
        let mut from = Origin {
            samples: samples.first().map(Source::path).or(file.map(|file| file.path.clone())).unwrap_or_default(),
            part: options.part.told(),
            symptoms: options.symptoms,
            ..Origin::default()
        };
        let imu = ImuChoice::Prefer(campaign.imu.clone());
        if campaign.is_tumble {
            let input = Input::from((imu, options.foreign.clone())).within(options.part);
            let reader = Reader { input, bar };
            let recordings = from.take(reader.tumbles(samples)?);
            return Ok(Self { measured: CalibrationData::Tumble(recordings, options.by_hand.clone()), from });
        }
        let reader = Reader { input: Input::from(imu).within(options.part), bar };
        let Some(file) = file else {
            return Err(Failure::new(Exit::Usage, "a campaign on a turntable has a campaign file").into());
        };
        let curves = file.curves(campaign).map(|path| curves(&path, campaign)).transpose()?;
        let mut measurements = Measurements::default();
        if curves.is_none() {
            // Checked first, because reading may take minutes.
            observable(campaign).map_err(|error| from.refused(error, Some(file)))?;
            measurements = reader.positions((campaign, file), samples, &mut from)?;
        }
        let ramps = from.take(reader.ramps(campaign, &file.ramps(campaign))?);
        let options = options.turntable.clone();
        let measured = match curves {
            Some((curves, curves_have_errors)) => {
                CalibrationData::Ramps(ramps, Box::new(curves), CalibrationOptions { curves_have_errors, ..options })
            }
            None => CalibrationData::Campaign(Measurements { ramps, ..measurements }, options),
        };
        Ok(Self { measured, from })
    }

    /// Reads recordings at one attitude, and what describes them. Without a `nominal` table they must be readings of
    /// other programs: their resolution makes it.
    ///
    /// # Errors
    /// If a file cannot be read, or if no nominal table can be made.
    pub fn at_one_attitude(
        imu: &ImuId,
        samples: Vec<Source<'_>>,
        nominal: Option<CoefficientTable>,
        gravity: Option<f64>,
        options: &FitOptions,
        bar: Bar<'_>,
    ) -> Result<(Campaign, Self), Refused> {
        let mut from = Origin {
            samples: samples.first().map(Source::path).unwrap_or_default(),
            part: options.part.told(),
            symptoms: options.symptoms,
            ..Origin::default()
        };
        let input = Input::from((ImuChoice::Prefer(imu.clone()), options.foreign.clone())).within(options.part);
        let read = Reader { input, bar }.at_one_attitude(imu, samples)?;
        let names: Vec<_> = read.iter().map(|read| read.name.clone()).collect();
        let (recordings, found): (Vec<_>, Vec<_>) = from.take(read).into_iter().unzip();
        let found = found.into_iter().zip(&names).map(|(found, name)| found.unwrap_or_else(|| Err(no_nominal(name))));
        let of_readings = joint(found.collect());
        let nominal = match nominal {
            Some(nominal) => completed(nominal, of_readings.ok(), &mut from.notes),
            None => of_readings.map_err(needs_nominal).and_then(|found| nominal_of(found, gravity))?,
        };
        let content = nominal.content();
        let campaign = Campaign::warm_up(imu.clone(), content.gravity, &content.temperature_unit, &names);
        let measured = CalibrationData::WarmUp(recordings, Box::new(nominal), options.at_one_attitude.clone());
        Ok((campaign, Self { measured, from }))
    }

    /// Makes the table.
    ///
    /// # Errors
    /// If the data do not allow a valid table.
    pub fn fit(self, campaign: &Campaign, file: Option<&CampaignFile>) -> Result<Made, Refused> {
        let Self { measured, from } = self;
        let fitted = CalibrationOutcome::fit(campaign, measured).map_err(|error| from.refused(error, file))?;
        let source = CampaignSource {
            campaign: file.map(CampaignFile::name).unwrap_or_default(),
            campaign_sha256: file.map_or_else(String::new, |file| sha256(file.text.as_bytes())),
            samples_sha256: from.samples_sha256,
            recordings_sha256: from.recordings_sha256,
            rows: from.rows,
            part: from.part,
            log_imu: from.log_imu,
            ..CampaignSource::at(crate::now())
        };
        let table = fitted.sealed(campaign, &source).map_err(|message| Failure::new(Exit::Failed, message))?;
        Ok(Made { fitted, table, source, places: from.places, notes: from.notes })
    }
}

impl Origin {
    /// Takes hashes and marks of recordings; returns the recordings.
    fn take<T>(&mut self, read: Vec<Read<T>>) -> Vec<T> {
        let mut named = read.iter().map(|read| read.log_imu);
        self.log_imu =
            named.next().flatten().filter(|first| named.all(|imu| imu.is_some_and(|imu| !imu.differs_from(first))));
        let recording = |Read { name: _, recording, sha256, rows, notes, log_imu: _ }| {
            self.recordings_sha256.push(sha256);
            self.rows.push(rows);
            self.notes.extend(notes);
            recording
        };
        read.into_iter().map(recording).collect()
    }

    fn refused(&self, error: CalibrationError, file: Option<&CampaignFile>) -> Refused {
        let locate = |line| self.places.locate(line);
        let path = file.map_or(&self.samples, |file| &file.path);
        let failure = error.failure_with(path, &self.samples, locate, self.symptoms);
        let document = json::refusal(&error, &failure, locate);
        Refused { document, failure, fit: Some(Box::new((error, self.places.clone()))) }
    }
}

impl Made {
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

/// The table that ramps alone begin with, and whether its provenance states errors of its bias curves.
fn curves(path: &Path, campaign: &Campaign) -> Result<(CoefficientTable, bool), Failure> {
    let (table, text, _) = load_table_text(path, Some(&campaign.imu), Trust::Any)?;
    let has_errors = isotherm_fit::Origin::of_toml(&text, &table).has_bias_errors();
    Ok((table, has_errors))
}

/// What a file of readings says of its pulses.
type OfReadings = Result<Nominal, Failure>;

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
struct Read<T> {
    /// What messages call it.
    name: String,
    recording: T,
    sha256: String,
    rows: Marks,
    notes: Vec<String>,
    log_imu: Option<LogImu>,
}

/// A recording at one attitude, and what makes a nominal table of it.
type WithReadings = (RampRecording, Option<OfReadings>);
type Row = Result<CampaignRow, RecordingError>;

/// The rows, which `marks` takes as they pass.
fn marked<'a>(rows: impl Iterator<Item = Row> + 'a, marks: &'a mut Marks) -> impl Iterator<Item = Row> + 'a {
    rows.inspect(|row| row.iter().for_each(|row| marks.add(&row.sample)))
}

/// Reads the recordings of one IMU.
struct Reader<'a> {
    input: Input,
    bar: Bar<'a>,
}

impl Reader<'_> {
    /// Dwells and turns: from files by position, a sheet of means, or the pieces of one recording.
    fn positions(
        &self,
        (campaign, file): (&Campaign, &CampaignFile),
        mut samples: Vec<Source<'_>>,
        from: &mut Origin,
    ) -> Result<Measurements, Failure> {
        if let Some(laid_out) = self.laid_out((campaign, file), &samples)? {
            from.places = laid_out.places;
            from.rows.push(laid_out.marks);
            from.samples_sha256 = laid_out.sha256;
            from.notes.extend(laid_out.notes);
            return Ok(laid_out.measurements);
        }
        if let [Source::Rows { name, sha256, rows }] = samples.as_mut_slice() {
            from.samples_sha256 = core::mem::take(sha256);
            from.places.begin(Path::new(name), None, 0);
            let mut marks = Marks::default();
            let rows = self.input.part.of_rows(name, rows);
            let measurements = read_measurements(campaign, marked(rows, &mut marks));
            from.rows.push(marks);
            return measurements.map_err(|error| error.failure(Path::new(name)));
        }
        let paths: Vec<_> = samples.iter().map(Source::path).collect();
        let bar = (self.bar)(&paths, "reading");
        let mut rows = Recording::open_hashed(&paths, RowKind::Campaign, self.input.clone(), &bar)?;
        let mut marks = Marks::default();
        let measurements = read_measurements(campaign, marked(&mut rows, &mut marks));
        from.rows.push(marks);
        bar.finish_and_clear();
        let measurements = measurements.map_err(|error| rows.failure(&error))?;
        from.notes.extend(rows.notes());
        from.places = rows.places().clone();
        from.samples_sha256 = rows.sha256()?;
        Ok(measurements)
    }

    /// Files by position, or a sheet of means; `None` of a recording.
    fn laid_out(
        &self,
        (campaign, file): (&Campaign, &CampaignFile),
        samples: &[Source<'_>],
    ) -> Result<Option<LaidOut>, Failure> {
        let of_position = |source: &Source<'_>| match source {
            Source::Position(file) => Some(file.clone()),
            _ => None,
        };
        let files: Vec<_> = samples.iter().filter_map(of_position).collect();
        let mapping = file.mapping()?;
        if let ([Source::Means(sheet)], Some(mapping)) = (samples, &mapping) {
            return of_means(campaign, sheet, mapping.clone()).map(Some);
        }
        if files.is_empty() {
            return Ok(None);
        }
        let paths: Vec<_> = samples.iter().map(Source::path).collect();
        let bar = (self.bar)(&paths, "reading");
        let settings = Settings { mapping: mapping.clone(), ..Settings::default() };
        let foreign = mapping.is_some().then(|| Foreign { settings, ..Foreign::default() });
        let input = Input { foreign, ..self.input.clone() };
        let read = by_position(campaign, &files, (&input, mapping.as_ref()), &bar);
        bar.finish_and_clear();
        read.map(Some)
    }

    /// Ramps, with the SHA-256 of each. Messages call each as the campaign file does, wherever it lies.
    fn ramps(&self, campaign: &Campaign, paths: &[PathBuf]) -> Result<Vec<Read<RampRecording>>, Failure> {
        let bar = (self.bar)(paths, "reading ramps");
        let read = |(path, ramp): (&PathBuf, &Ramp)| {
            self.recording(path, &bar, |rows| RampRecording::read(ramp.samples.clone(), rows), |recording, _| recording)
        };
        let all = paths.iter().zip(&campaign.ramps).map(read).collect();
        bar.finish_and_clear();
        all
    }

    /// Recordings of an IMU that was put down by hand, with the SHA-256 of each.
    fn tumbles(&self, samples: Vec<Source<'_>>) -> Result<Vec<Read<TumbleRecording>>, Failure> {
        let read = |name: &str, rows: &mut dyn Iterator<Item = Row>| TumbleRecording::read(name.to_owned(), rows);
        self.recordings(samples, read, |recording, rows| match rows {
            Some(rows) => recording.with_findings(rows.findings()),
            None => recording,
        })
    }

    /// Recordings at one attitude, with the SHA-256 of each, and with what makes a nominal table; `None` of rows in
    /// memory.
    fn at_one_attitude(&self, imu: &ImuId, samples: Vec<Source<'_>>) -> Result<Vec<Read<WithReadings>>, Failure> {
        let read =
            |name: &str, rows: &mut dyn Iterator<Item = Row>| RampRecording::read_screened(name.to_owned(), rows);
        self.recordings(samples, read, |recording, rows| match rows {
            Some(rows) => {
                let recording = recording.with_findings(rows.findings());
                (recording.with_in_use(rows.vehicle_state().in_use()), Some(rows.nominal(imu)))
            }
            None => (recording, None),
        })
    }

    /// The recordings that these are, in the order in which their first pieces are named: of files whose times go on
    /// from each other it is one. `complete` adds what files tell after the last row.
    fn recordings<T, U>(
        &self,
        samples: Vec<Source<'_>>,
        read: impl Fn(&str, &mut dyn Iterator<Item = Row>) -> Result<T, RecordingError>,
        complete: impl Fn(T, Option<&Recording>) -> U,
    ) -> Result<Vec<Read<U>>, Failure> {
        let named: Vec<_> = samples.iter().map(Source::path).collect();
        let bar = (self.bar)(&named, "reading");
        let (mut all, mut files) = (Vec::new(), Vec::new());
        for (place, source) in samples.into_iter().enumerate() {
            match source {
                Source::File(path) | Source::Means(path) => files.push(path),
                Source::Position(file) => files.push(file.path),
                Source::Rows { name, sha256, rows } => {
                    let mut marks = Marks::default();
                    let rows = self.input.part.of_rows(&name, rows);
                    let recording = read(&name, &mut marked(rows, &mut marks));
                    let recording = complete(recording.map_err(|error| error.failure(Path::new(&name)))?, None);
                    let (notes, log_imu) = (Vec::new(), None);
                    all.push((place, Read { name, recording, sha256, rows: marks, notes, log_imu }));
                }
            }
        }
        let mut left = match files.is_empty() {
            true => None,
            false => Some(Pieces::new(&files, RowKind::Sample, self.input.clone())?),
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
            let read = Read { name, recording, sha256: rows.sha256()?, rows: marks, notes, log_imu };
            all.push((place.unwrap_or(usize::MAX), read));
        }
        bar.finish_and_clear();
        // The sort is stable: what is in one folder stays in order.
        all.sort_by_key(|(place, _)| *place);
        Ok(all.into_iter().map(|(_, read)| read).collect())
    }

    /// One recording; `complete` adds what its file tells after the last row.
    fn recording<T>(
        &self,
        path: &Path,
        bar: &ProgressBar,
        read: impl Fn(&mut dyn Iterator<Item = Row>) -> Result<T, RecordingError>,
        complete: impl Fn(T, &Recording) -> T,
    ) -> Result<Read<T>, Failure> {
        let files = [path.to_owned()];
        let mut rows = Recording::open_hashed(&files, RowKind::Sample, self.input.clone(), bar)?;
        let mut marks = Marks::default();
        let recording = read(&mut marked(&mut rows, &mut marks));
        let recording = recording.map_err(|error| rows.failure(&error))?;
        let (recording, notes, log_imu) = (complete(recording, &rows), rows.notes(), rows.log_imu());
        let name = path.display().to_string();
        Ok(Read { name, recording, sha256: rows.sha256()?, rows: marks, notes, log_imu })
    }
}
