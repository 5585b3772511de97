//! What several commands do with their arguments.

use crate::parse::one_of;
use clap::Args;
use isotherm_autopilot::logs::GyroscopeTemperature;
use isotherm_documents::{LoadError, load_table, read_text};
use isotherm_files::{Trust, print_data, source};
use isotherm_fit::Origin;
use isotherm_pipeline::JobFailure;
use isotherm_recording_formats::convert::{Foreign, Settings, TimeSource};
use isotherm_recording_formats::read::{ImuChoice, Recording, Samples};
use isotherm_report::json;
use isotherm_shared::names::ImuId;
use isotherm_shared::table::{CoefficientTable, PulseScale};
use isotherm_shared::wire::RawSample;
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::finding::{Admission, Finding, Location, Severity, name};
use isotherm_verification::Requirement;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tracing::{info, warn};

/// How the lagged temperature of a recording that has none is computed.
#[derive(Clone, Copy, Debug, Args)]
pub struct LagArgs {
    /// Set the lag of recordings without one [s]
    ///
    /// The time constant of the lagged temperature, for a recording without that column; or none.
    ///
    /// Default: the time constant of the table; feed asks the service for it. A lagged temperature in the recording is
    /// used unchanged
    #[arg(long = "lag", value_name = "S|none", value_parser = crate::parse::lag)]
    pub ns: Option<u64>,
}

/// Where times come from, by name.
const TIME_SOURCES: [(TimeSource, &str); 3] =
    [(TimeSource::Header, "header"), (TimeSource::Log, "log"), (TimeSource::Rate, "rate")];

/// How data of other programs are read, which take the place of a recording.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Third-party data")]
pub struct ForeignArgs {
    /// Read this mapping of a text's columns (TOML)
    #[arg(long, value_name = "M.toml")]
    pub mapping: Option<PathBuf>,
    /// Set the temperature of all rows
    ///
    /// In the unit of the table, for data without a temperature.
    #[arg(long, value_name = "T", allow_negative_numbers = true, value_parser = crate::parse::number)]
    pub temperature: Option<f64>,
    /// Set the nominal interval [s]
    ///
    /// Default: the interval in the mapping, or the one found from the times
    #[arg(long, value_name = "S", value_parser = crate::parse::interval)]
    pub interval: Option<Duration>,
    /// Choose the source of the times
    ///
    /// header: the stamps of the rows or messages. log: the times at which the messages of a bag were recorded. rate:
    /// the rows are one interval apart, which must be known [default: header]
    #[arg(long, value_name = "SOURCE", value_parser = one_of(TIME_SOURCES))]
    pub time: Option<TimeSource>,
    /// Choose the topic of the sensor_msgs/msg/Imu
    ///
    /// Required if there are several.
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Choose the topic of the gyroscopes
    ///
    /// For data in which accelerometers and gyroscopes have separate topics.
    #[arg(long, value_name = "TOPIC")]
    pub gyroscope_topic: Option<String>,
    /// Read the gyroscopes from this file
    ///
    /// For data in which accelerometers and gyroscopes have separate texts. The mapping describes both.
    #[arg(long, value_name = "FILE")]
    pub gyroscope_file: Option<PathBuf>,
    /// Choose the topic of the sensor_msgs/msg/Temperature
    ///
    /// Required if there are several.
    #[arg(long, value_name = "TOPIC")]
    pub temperature_topic: Option<String>,
    /// Choose an IMU of an autopilot's log
    ///
    /// The number of the IMU in the log, from 0. Required if the log has several IMUs.
    #[arg(long, value_name = "N")]
    pub instance: Option<u32>,
    /// Choose the gyroscopes' temperature in an autopilot's log
    ///
    /// For logs in which the gyroscopes have no temperature of their own.
    #[arg(long, value_name = "SENSOR", value_parser = one_of([(GyroscopeTemperature::Accelerometer, "accelerometer")]))]
    pub gyroscope_temperature: Option<GyroscopeTemperature>,
    /// Keep the given order of the pieces
    ///
    /// Applies if sequences and clocks do not show the order of the pieces. Sequences show the order of pieces of one
    /// session. Clocks show the order of sessions, and of pieces whose times do not overlap. Pieces without times then
    /// continue each other.
    #[arg(long)]
    pub in_order: bool,
}

impl ForeignArgs {
    /// What is known of the data, with the text of the mapping.
    ///
    /// # Errors
    /// If the mapping cannot be read.
    pub fn read(&self) -> Result<Foreign, Failure> {
        let settings = Settings {
            temperature: self.temperature,
            interval_ns: self.interval.map(|interval| interval.as_nanos() as u64),
            time: self.time.unwrap_or_default(),
            topic: self.topic.clone(),
            gyroscope_topic: self.gyroscope_topic.clone(),
            gyroscope_file: self.gyroscope_file.as_ref().map(source),
            in_order: self.in_order,
            temperature_topic: self.temperature_topic.clone(),
            instance: self.instance,
            gyroscope_temperature: self.gyroscope_temperature.unwrap_or_default(),
            ..Settings::default()
        };
        let read = |path: &PathBuf| Ok::<_, Failure>((path.clone(), read_text(path, Trust::Any)?.0));
        Ok(Foreign { mapping: self.mapping.as_ref().map(read).transpose()?, settings })
    }

    /// As [`read`](Self::read), for a table: its readings become pulses of that, and of a log with several IMUs that of
    /// the table is read, unless one is named.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_for(&self, table: Option<&CoefficientTable>, origin: &Origin) -> Result<Foreign, Failure> {
        let mut foreign = self.read()?;
        foreign.settings.preferred = origin.log_imu;
        foreign.settings.table = table.map(PulseScale::of);
        Ok(foreign)
    }

    /// The files, as [`refuse_overlap`](isotherm_files::refuse_overlap) takes them.
    pub fn inputs(&self) -> impl Iterator<Item = (&Path, &'static str)> {
        let mapping = self.mapping.iter().map(|mapping| (mapping.as_path(), "the mapping"));
        mapping.chain(self.gyroscope_file.iter().map(|file| (file.as_path(), "the file of the gyroscopes")))
    }
}

/// A table of any IMU, and what its provenance says.
///
/// # Errors
/// If it cannot be read.
pub fn load_with_origin(path: &Path) -> Result<(CoefficientTable, Origin), LoadError> {
    let (table, _) = load_table(path, None, Trust::Any)?;
    let origin = Origin::of_toml(&read_text(path, Trust::Any)?.0, &table);
    Ok((table, origin))
}

/// What is known of third-party data after the last row was read.
#[derive(Clone)]
pub struct OfData {
    findings: Vec<Finding>,
    notes: Vec<String>,
    /// Whether their pulses were made for the table.
    fits_table: bool,
}

impl OfData {
    /// What a recording of them has found.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let fits_table = recording.fits_table();
        Self { findings: recording.findings(), notes: recording.notes(), fits_table }
    }

    /// With what was found if the data are of another IMU than the table.
    pub fn with_unit(mut self, origin: &Origin, recording: &Recording) -> Self {
        self.findings.extend(origin.other_device(recording.log_imu(), recording.device()));
        self
    }

    /// With all findings of units as warnings.
    pub fn with_other_device(mut self) -> Self {
        let all = self.findings.iter_mut().filter(|finding| finding.name == name::OTHER_DEVICE);
        all.for_each(|finding| finding.severity = Severity::Warning);
        self
    }

    /// Without the notes, where a failure follows that says what is wrong.
    pub fn findings_alone(&self) -> Self {
        Self { findings: self.findings.clone(), notes: Vec::new(), fits_table: self.fits_table }
    }

    /// Prints findings and notes, where nothing can be refused any more.
    pub fn tell(&self) {
        self.findings.iter().for_each(|finding| warn!("{}", finding.tagged(|line| line.to_string())));
        self.notes.iter().for_each(|note| info!("{note}"));
    }

    /// Admits what a command found in the rows, and what was found in the data; then prints the notes: what is wrong
    /// comes first. The rows' gaps are not named twice.
    ///
    /// # Errors
    /// As [`AcceptanceArgs::admit`].
    pub fn admit(self, by: &AcceptanceArgs, recording: &str, mut found: Vec<Finding>) -> Result<(), JobFailure> {
        // Readings of any interval are right then.
        found.retain(|finding| !(self.fits_table && finding.name == name::INTERVAL_NOT_NOMINAL));
        let of_rows: Vec<_> = found.iter().map(|finding| finding.name).collect();
        found.extend(self.findings.into_iter().filter(|finding| !of_rows.contains(&finding.name)));
        by.admit(recording, found)?;
        self.notes.iter().for_each(|note| info!("{note}"));
        Ok(())
    }
}

/// Warns once if only one of table and samples has gyroscopes.
pub struct GyroscopeCheck {
    table_has: bool,
    due: bool,
}

impl GyroscopeCheck {
    /// For a table with or without gyroscopes.
    pub const fn new(table_has_gyroscopes: bool) -> Self {
        Self { table_has: table_has_gyroscopes, due: true }
    }

    /// Looks at a sample.
    pub fn check(&mut self, sample: &RawSample) {
        if self.due && sample.gyroscopes.is_absent() == self.table_has {
            self.due = false;
            // A recording may have the columns and zeros in them.
            let what = match (self.table_has, sample.gyroscopes.head_temperature[0].is_nan()) {
                (true, true) => {
                    "the recording has no gyroscopes, but the table has; the angle increments are NaN and flagged"
                }
                (true, false) => "all values of gyroscopes in the recording are 0; the angle increments mean nothing",
                (false, _) => "the recording has gyroscopes, but the table has none; there are no angle increments",
            };
            let message = format!("from sequence {} on {what}", sample.sequence);
            warn!("{}", Finding::warning(name::NO_GYROSCOPES, message).tagged(|line| line.to_string()));
        }
    }
}

/// Whether a command prints a document in place of a text.
#[derive(Clone, Copy, Debug, Args)]
pub struct JsonOption {
    /// Print one JSON document instead of text
    ///
    /// It goes to stdout, also in case of a failure.
    #[arg(long)]
    json: bool,
}

impl JsonOption {
    /// Whether it is.
    #[must_use]
    pub const fn is_given(self) -> bool {
        self.json
    }

    /// Prints the document, if the option is given.
    ///
    /// # Errors
    /// If stdout cannot be written.
    pub fn print(self, document: &Value) -> Result<(), Failure> {
        if self.json { print_data(&format!("{document:#}\n")) } else { Ok(()) }
    }

    /// Ends a command with its document and a verdict. That of a failure is printed by [`or_document`].
    ///
    /// # Errors
    /// The verdict; or if stdout cannot be written.
    pub fn finish(self, document: Value, verdict: Result<(), Failure>) -> Result<(), JobFailure> {
        match verdict {
            Ok(()) => Ok(self.print(&document)?),
            Err(failure) => Err(JobFailure { failure, document, fit: None }),
        }
    }
}

/// Prints the document of a failure to stdout, if `--json` is given. A command calls this once, for everything that can
/// fail before its results are printed.
///
/// # Errors
/// The failure.
pub fn or_document<T>(json: JsonOption, result: Result<T, JobFailure>) -> Result<T, Failure> {
    result.map_err(|JobFailure { failure, document, .. }| {
        // If stdout is closed or full there is still the message on stderr, and the exit code.
        let _ = json.print(&document);
        failure
    })
}

/// The requirement of all `--require`; `None` without one.
///
/// # Errors
/// If a bound is given twice.
pub fn joined(require: &[Requirement]) -> Result<Option<Requirement>, Failure> {
    let Some((first, others)) = require.split_first() else { return Ok(None) };
    let all = others.iter().try_fold(*first, |all, more| all.and(*more));
    all.map(Some).map_err(|message| Failure::new(Exit::Usage, format!("--require: {message}")))
}

/// The files of a recording, as [`refuse_overlap`](isotherm_files::refuse_overlap) takes them.
pub fn inputs(recording: &[PathBuf]) -> Vec<(&Path, &'static str)> {
    recording.iter().map(|path| (path.as_path(), "the recording")).collect()
}

/// Which findings the user accepts.
#[derive(Clone, Debug, Default, Args)]
pub struct AcceptanceArgs {
    /// Continue in spite of this fault
    ///
    /// The message of a fault contains its name in brackets. Give several names with commas, or repeat the option. The
    /// provenance of a table lists the accepted names.
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = name::acceptable)]
    pub accept: Vec<&'static str>,
    /// Treat every warning as a fault
    ///
    /// Applies to every warning that is not accepted.
    #[arg(long)]
    pub strict: bool,
}

impl AcceptanceArgs {
    /// Prints the findings about `recording`, and returns them.
    ///
    /// # Errors
    /// With the faults that are not accepted.
    pub fn admit(&self, recording: &str, findings: Vec<Finding>) -> Result<Vec<Finding>, JobFailure> {
        let at = |finding: Finding| match finding.place {
            None if !recording.is_empty() => finding.at(Location::Recording(recording.to_owned())),
            _ => finding,
        };
        let findings = findings.into_iter().map(at).collect();
        let admission = Admission { accept: &self.accept, strict: self.strict };
        match admission.admit(findings, &mut Vec::new()) {
            Ok(findings) => {
                findings.iter().for_each(|finding| warn!("{}", finding.tagged(|line| line.to_string())));
                Ok(findings)
            }
            Err(findings) => {
                let lines: Vec<_> = findings.iter().map(|finding| finding.tagged(|line| line.to_string())).collect();
                let mut refused = JobFailure::from(Failure::new(Exit::Data, lines.join("\n")));
                refused.document["findings"] = json::findings(&findings, |line| line.to_string());
                Err(refused)
            }
        }
    }
}

/// Refuses a recording that names another IMU than that of its table, as MCAP does. To be called after the
/// first row.
///
/// # Errors
/// If the names differ, unless `other_imu` allows it.
pub fn refuse_other_imu(
    samples: &Samples,
    recording: &[PathBuf],
    (table, path): (&CoefficientTable, &Path),
    other_imu: bool,
) -> Result<(), Failure> {
    let of_table = &table.content().imu;
    let Some(imu) = samples.imu().filter(|imu| !other_imu && *imu != of_table.as_str()) else { return Ok(()) };
    let (imu, file, table) = (imu.escape_debug(), joined_paths(recording), shown(path));
    let message = format!(
        "{file}: the recording is of {imu}, and the table {table} of {of_table}; give the table of {imu}, or take it \
         anyway with --other-imu"
    );
    Err(Failure::new(Exit::Config, message).at(path, None))
}

/// The files of a recording, for messages.
pub fn joined_paths(recording: &[PathBuf]) -> String {
    recording.iter().map(|path| shown(path).to_string()).collect::<Vec<_>>().join(", ")
}

/// The IMU whose samples are read for a table: `imu` if it is given, otherwise the table's.
pub fn choice(imu: Option<ImuId>, table: &CoefficientTable) -> ImuChoice {
    imu.map_or_else(|| ImuChoice::Prefer(table.content().imu.clone()), ImuChoice::Only)
}
