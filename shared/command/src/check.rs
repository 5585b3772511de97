//! `check`: validates files with the code that loads them.

use clap::Args;
use isotherm_documents::{LoadError, load_table, read_text};
use isotherm_files::{Trust, print, remove_unfinished_on_signals, replace};
use isotherm_shared::content::FileContent;
use isotherm_shared::document::{Document, Fault, Faults, MAX_BYTES};
use isotherm_shared::kind::FileKind;
use isotherm_shared::polynomial::Polynomial;
use isotherm_shared::table::difference::{MaxChange, TableDifference};
use isotherm_shared::table::{Axis, CoefficientTable, Content, Seal, with_unchecked_digest};
use isotherm_shared::units::SensorKind;
use isotherm_support::failure::{Exit, Failure, shown, tell};
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Validate files with the code that loads them
///
/// Validates coefficient tables and service configurations. `isotherm check` also validates campaign files, campaign
/// plans, mappings, descriptions of sources, and recordings with their checks. The kind of a file is recognised from
/// its content. All faults of all files are reported, each with line and key. A warning reports scale factors that look
/// as if a digit were lost. For a service configuration, warnings report what serve would refuse on this machine and
/// for this user: a core, a priority, locked memory, an address, or too little shared memory.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm check service.toml tables/*.toml\n  isotherm check --seal tables/imu-a.toml\n  isotherm check --against tables/imu-a.toml new.toml"
)]
pub struct Check {
    /// Write a table's digest into it
    ///
    /// A later change or an incomplete copy is then noticed.
    #[arg(long)]
    seal: bool,
    /// Fail if there is a warning
    ///
    /// The exit code is then 78.
    #[arg(long)]
    strict: bool,
    /// Compare each table with this one
    ///
    /// A table is refused if a service without limits of its own (max_change) would refuse the change.
    #[arg(long, value_name = "TABLE")]
    against: Option<PathBuf>,
    /// Accept world-writable files
    ///
    /// Without this option they are refused, as the service refuses them.
    #[arg(long)]
    allow_world_writable: bool,
    /// Validate these files; - is stdin
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// Validates a campaign file, plan or mapping that was read from this path. Returns a line for the operator if it is
/// valid.
pub type CheckLaboratoryFile = fn(FileKind, &str, &Path) -> Result<String, Failure>;

/// Validates the recording with this path. Returns a line for the operator if it is whole.
pub type CheckRecording = fn(&Path) -> Result<String, Failure>;

/// Validates a service configuration that was read from this path, and the tables that it names. Returns a line for the
/// operator if it is valid, and warnings.
pub type CheckConfiguration = fn(&str, &Path, Trust) -> Result<(String, Vec<String>), Failure>;

/// What a program validates in addition to tables.
#[derive(Clone, Copy)]
pub struct CheckedFiles {
    /// Campaign files, plans, mappings and descriptions of sources.
    pub laboratory: CheckLaboratoryFile,
    /// Recordings, which are refused without it.
    pub recording: Option<CheckRecording>,
    /// Service configurations.
    pub configuration: CheckConfiguration,
}

impl Check {
    /// Validates the files: tables by itself, the others by what the program has for them.
    ///
    /// # Errors
    /// All faults of all files.
    pub fn run(self, others: CheckedFiles) -> Result<(), Failure> {
        remove_unfinished_on_signals()?;
        let trust = Trust::protected_unless(self.allow_world_writable);
        let against = self.against.as_deref().map(|path| load_table(path, None, trust)).transpose()?;
        let against = against.map(|(table, _)| table);
        let checker = FileChecker { command: &self, trust, against, others };
        let mut failures = Vec::new();
        for path in &self.files {
            match checker.check(path) {
                Ok(line) => print(&format!("{}: {line}\n", shown(path)))?,
                Err(failure) => failures.push(failure),
            }
        }
        Failure::all(failures).map_or(Ok(()), Err)
    }
}

struct FileChecker<'a> {
    command: &'a Check,
    trust: Trust,
    /// What each table is compared with.
    against: Option<CoefficientTable>,
    others: CheckedFiles,
}

impl FileChecker<'_> {
    fn check(&self, path: &Path) -> Result<String, Failure> {
        let &Self { command: &Check { seal, .. }, trust, others, .. } = self;
        if let Some(format) = recording_format(path) {
            if let Some(recording) = others.recording.filter(|_| !seal && self.against.is_none()) {
                return recording(path);
            }
            let message =
                format!("{}: a recording ({format}), for replay, verify and noise; {EXPECTED_KINDS}", shown(path));
            return Err(Failure::new(Exit::Config, message));
        }
        let text = if path == Path::new("-") { read_stdin()? } else { read_text(path, trust)?.0 };
        let refuse = |faults| Failure::from(LoadError::Refused { path: path.to_owned(), faults });
        match kind(&text).map_err(refuse)? {
            FileKind::Table if seal && path == Path::new("-") => {
                Err(Failure::new(Exit::Usage, "only a file can be sealed; name it instead of -"))
            }
            kind @ (FileKind::Plan
            | FileKind::Campaign
            | FileKind::Mapping
            | FileKind::Source
            | FileKind::Node
            | FileKind::Configuration)
                if seal || self.against.is_some() =>
            {
                let what = if seal { "sealed" } else { "compared" };
                let message = format!("{}: {}; only tables are {what}", shown(path), kind.name());
                Err(Failure::new(Exit::Config, message))
            }
            FileKind::Table => self.table(path, &text),
            kind @ (FileKind::Plan | FileKind::Campaign | FileKind::Mapping | FileKind::Source | FileKind::Node) => {
                (others.laboratory)(kind, &text, path)
            }
            FileKind::Configuration => {
                let (line, warnings) = (others.configuration)(&text, path, trust)?;
                self.warn(path, warnings).map(|()| line)
            }
        }
    }

    fn table(&self, path: &Path, text: &str) -> Result<String, Failure> {
        let policy = if self.command.seal { Seal::Renewed } else { Seal::Checked };
        let table = CoefficientTable::from_toml_with(text, None, policy)
            .map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
        let changes = self.compare(path, &table)?;
        let sealed = if self.command.seal {
            write_digest(path, text, &table)?;
            "sealed"
        } else if Document::parse(text).is_ok_and(|document| document.has("digest")) {
            "seal intact"
        } else {
            "not sealed"
        };
        let content = table.content();
        self.warn(path, content.unlike_scale_factors())?;
        Ok(format!("table of {}, {}, {sealed}{}{changes}", content.imu, table.digest(), format_2(content)))
    }

    /// What changes from the table that is compared with, in words; an error if it is too much.
    fn compare(&self, path: &Path, table: &CoefficientTable) -> Result<String, Failure> {
        let Some(against) = &self.against else { return Ok(String::new()) };
        let difference = TableDifference::of(against, table);
        let refusals = MaxChange::default().refusals(&difference, 1.0);
        let refused = |refusal| Failure::new(Exit::Config, format!("{}: {refusal}", shown(path))).at(path, None);
        let refused = Failure::all(refusals.into_iter().map(refused).collect());
        refused.map_or_else(|| Ok(format!("\n  {difference}")), Err)
    }

    /// Prints the warnings of a file.
    ///
    /// # Errors
    /// With `--strict`, the warnings.
    fn warn(&self, path: &Path, warnings: Vec<String>) -> Result<(), Failure> {
        let lines = warnings.into_iter().map(|warning| format!("{}: warning: {warning}", shown(path)));
        if self.command.strict {
            let failures = lines.map(|line| Failure::new(Exit::Config, line)).collect();
            return Failure::all(failures).map_or(Ok(()), Err);
        }
        lines.for_each(|line| tell("isotherm", line));
        Ok(())
    }
}

/// What only tables of format 2 have, in lines of their own.
fn format_2(content: &Content) -> String {
    let unit = &content.temperature_unit;
    let mut text = content.lag_s.map_or(String::new(), |lag_s| format!("\n  lag of the head temperature: {lag_s} s"));
    let gyroscopes = content.gyroscopes.as_ref();
    let triads =
        [(SensorKind::Accelerometer, Some(&content.axes)), (SensorKind::Gyroscope, gyroscopes.map(|g| &g.axes))];
    let sensors = triads.into_iter().flat_map(|(kind, axes)| kind.names().into_iter().zip(axes.into_iter().flatten()));
    let transients = sensors
        .filter(|(_, axis)| axis.transient != 0.0)
        .map(|(name, axis)| format!("{name} {} {} per {unit}", axis.transient, axis.bias_unit.name()));
    let transients: Vec<_> = transients.collect();
    if !transients.is_empty() {
        let _ = write!(text, "\n  transient: {}", transients.join(", "));
    }
    let Some(gyroscopes) = gyroscopes else { return text };
    let names = SensorKind::Gyroscope.names();
    for ((name, axis), g_sensitivity) in names.iter().zip(&gyroscopes.axes).zip(&gyroscopes.g_sensitivity) {
        let Axis { bias_unit, bias, positive_scale_factor, negative_scale_factor, .. } = axis;
        let range = |polynomial: &Polynomial| {
            let [low, high] = polynomial.range();
            format!("{low} .. {high} {unit}")
        };
        let _ = write!(
            text,
            "\n  {name}: bias in {} over {}; K+ and K- in {} over {} and {}",
            bias_unit.name(),
            range(bias),
            SensorKind::Gyroscope.scale_factor_unit(),
            range(positive_scale_factor),
            range(negative_scale_factor)
        );
        if let Some([a1, a2, a3]) = g_sensitivity {
            let _ = write!(text, "; g-sensitivity {a1}, {a2}, {a3} deg/h/g0");
        }
    }
    if gyroscopes.alignment.is_some() {
        text.push_str("\n  alignment of the gyroscopes");
    }
    text
}

/// The format of a file that is a recording: MCAP, or CSV with sequences and times. An empty file is one by
/// its name.
fn recording_format(path: &Path) -> Option<&'static str> {
    const ENDINGS: [(&str, &str); 2] = [("mcap", "MCAP"), ("csv", "CSV")];
    const BEGINNING: u64 = 4096;
    let mut beginning = Vec::new();
    // A pipe is not even opened: that waits for its writer. What cannot be opened is reported when it is read.
    fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    let file = File::open(path).ok()?;
    file.take(BEGINNING).read_to_end(&mut beginning).ok()?;
    if beginning.is_empty() {
        let is_it = |ending: &&(&str, &str)| path.extension().is_some_and(|extension| extension == ending.0);
        return ENDINGS.iter().find(is_it).map(|(_, format)| *format);
    }
    match FileContent::of(&beginning)? {
        FileContent::Parquet => Some("Parquet"),
        FileContent::Mcap => Some("MCAP"),
        FileContent::Csv => Some("CSV"),
        FileContent::Ulog | FileContent::DataFlash | FileContent::Parameters => None,
    }
}

/// The remedy in the message for a file that is no TOML at all.
const EXPECTED_KINDS: &str = "give a coefficient table, a service configuration, a campaign file or a campaign plan";

fn read_stdin() -> Result<String, Failure> {
    let mut text = String::new();
    let read = io::stdin().take(MAX_BYTES + 1).read_to_string(&mut text);
    read.map_err(|error| Failure::io("reading", Path::new("stdin"), &error))?;
    if text.len() as u64 > MAX_BYTES {
        let message = format!("stdin: over {MAX_BYTES} bytes; no table or configuration is that large");
        return Err(Failure::new(Exit::Config, message));
    }
    Ok(text)
}

fn kind(text: &str) -> Result<FileKind, Faults> {
    // Only tables have a digest.
    let unread = |faults| with_unchecked_digest(text, faults);
    let document = Document::parse_as(text, EXPECTED_KINDS).map_err(unread)?;
    FileKind::of(&document).ok_or_else(|| {
        let message =
            "neither a coefficient table, which has [[axis]], nor a service configuration, which has [[imu]], nor a \
                       campaign plan, which has [chamber], nor a campaign file, which has [[position]]"
                .to_owned();
        Faults(vec![Fault { line: 1, key: String::new(), message }])
    })
}

/// Writes the digest of the table into its file, and leaves every other byte as the user wrote it.
fn write_digest(path: &Path, text: &str, table: &CoefficientTable) -> Result<(), Failure> {
    let sealed = with_digest(text, &format!("\"{}\"", table.digest()));
    // Read the result back before the file is replaced: it must be the same table, with a valid seal.
    let sealed = sealed.filter(|sealed| CoefficientTable::from_toml(sealed, None).as_ref() == Ok(table));
    let sealed = sealed.ok_or_else(|| {
        let (path, digest) = (shown(path), table.digest().to_string());
        let message =
            format!("{path}: cannot be sealed as it is laid out; put digest = {digest:?} below format by hand");
        Failure::new(Exit::Failed, message)
    })?;
    replace(path, &sealed).map_err(|error| Failure::io("writing", path, &error))
}

/// The text with this digest: in the place of the old one, or in a new line below `format`.
fn with_digest(text: &str, digest: &str) -> Option<String> {
    let document = Document::parse(text).ok()?;
    if let Some(span) = document.span("digest") {
        return Some(format!("{}{digest}{}", text.get(..span.start)?, text.get(span.end..)?));
    }
    let format = document.span("format")?;
    let end = format.end + text.get(format.end..)?.find('\n').map_or(text.len() - format.end, |newline| newline + 1);
    let (above, below) = text.split_at_checked(end)?;
    let newline = if above.ends_with("\r\n") { "\r\n" } else { "\n" };
    let gap = if above.ends_with('\n') { "" } else { newline };
    Some(format!("{above}{gap}digest = {digest}{newline}{below}"))
}

#[cfg(test)]
mod tests {
    use super::with_digest;

    #[test]
    fn the_digest_is_set_and_nothing_else_touched() {
        for (before, after) in [
            ("# c\nformat = 1 # f\n\n[imu]\n", "# c\nformat = 1 # f\ndigest = NEW\n\n[imu]\n"),
            ("format = 1\r\n[imu]\r\n", "format = 1\r\ndigest = NEW\r\n[imu]\r\n"),
            ("# above\n\n\"digest\" = \"x\"   # why\nformat = 1", "# above\n\n\"digest\" = NEW   # why\nformat = 1"),
            ("digest = 5\nformat = 1\n", "digest = NEW\nformat = 1\n"),
            ("format = 1", "format = 1\ndigest = NEW\n"),
        ] {
            assert_eq!(with_digest(before, "NEW").as_deref(), Some(after));
        }
    }
}
