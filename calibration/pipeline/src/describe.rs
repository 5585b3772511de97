//! What a file is, and what it is good for: `isotherm describe`.
//!
//! Rows are read one by one: a log of any size takes the memory of a few messages. The log of an autopilot is read once
//! for its IMUs and then for each of them, as every job does it.

mod attitudes;
mod jobs;
mod model;
mod rows;
mod text;
mod toml;

use crate::files::Bar;
use isotherm_autopilot::{Autopilot, ImportError, ImportOptions, import};
use isotherm_documents::{LoadError, read_parameters};
use isotherm_files::source;
use isotherm_recording_formats::convert::{Foreign, Settings, imus_of_log, known_format};
use isotherm_recording_formats::read::Samples;
use isotherm_shared::content::FileContent;
use isotherm_shared::table::STANDARD_GRAVITY;
use isotherm_support::failure::{Exit, Failure, shown};
pub use model::{DescribedKind, FileDescription, FindingExplanation, JobFitness};
pub use rows::{ImuSummary, TemperatureSpan};
use std::io::{Read as _, Seek as _};
use std::path::{Path, PathBuf};

/// Bytes by which a file is recognised.
const BEGINNING: u64 = 1 << 16;

/// An interval with which parameters are read \[ns\].
const INTERVAL_NS: u64 = 10_000_000;

impl FileDescription {
    /// Looks at a file. `foreign` is what is known of data of other programs; nothing is needed. What cannot be read is
    /// described as far as it was.
    #[must_use]
    pub fn of(path: &Path, foreign: &Foreign, bar: Bar<'_>) -> Self {
        let mut description = Self {
            file: path.display().to_string(),
            bytes: 0,
            kind: DescribedKind::Unknown,
            format: "unknown".to_owned(),
            imus: Vec::new(),
            jobs: Vec::new(),
            findings: Vec::new(),
            notes: Vec::new(),
            error: None,
            exit_code: 0,
        };
        if let Err(failure) = description.read(path, foreign, bar) {
            description.error = Some(failure.message);
            description.exit_code = failure.exit as u8;
        }
        description.jobs = jobs::of(&description, path, foreign);
        description
    }

    /// The same for people.
    #[must_use]
    pub fn text(&self) -> String {
        text::text(self)
    }

    /// The failure of a file that cannot be read.
    #[must_use]
    pub fn failure(&self) -> Option<Failure> {
        let exits = [Exit::Failed, Exit::Usage, Exit::Data, Exit::Unavailable, Exit::Io, Exit::OtherUser, Exit::Config];
        let exit = exits.into_iter().find(|exit| *exit as u8 == self.exit_code)?;
        self.error.as_ref().map(|message| Failure::new(exit, message.as_str()))
    }

    fn read(&mut self, path: &Path, foreign: &Foreign, bar: Bar<'_>) -> Result<(), Failure> {
        let file = source(path);
        let opened = |error: std::io::Error| Failure::io("opening", path, &error);
        let mut bytes = file.open().map_err(opened)?;
        let mut beginning = Vec::new();
        (&mut bytes).take(BEGINNING).read_to_end(&mut beginning).map_err(opened)?;
        if !file.is_file() {
            let message = format!("{}: a stream, which can be read only once; name a file", shown(path));
            return Err(Failure::new(Exit::Usage, message));
        }
        self.bytes = bytes.seek(std::io::SeekFrom::End(0)).map_err(opened)?;
        drop(bytes);
        if beginning.is_empty() {
            return Err(Failure::new(Exit::Data, format!("{}: the file is empty", shown(path))));
        }
        let known = known_format(&beginning);
        match FileContent::of(&beginning) {
            Some(FileContent::Parameters) if known.is_none() => return self.read_parameters(path),
            Some(content) => self.format = known.unwrap_or(content.name()).to_owned(),
            None if known.is_none() && toml::looks_so(path, &beginning) => return self.read_toml(path),
            None => self.format = known.unwrap_or("a text of columns").to_owned(),
        }
        self.kind = DescribedKind::Data;
        self.read_data(path, foreign, bar)
    }

    /// The parameters of both sensors, of each instance that has any.
    fn read_parameters(&mut self, path: &Path) -> Result<(), Failure> {
        self.kind = DescribedKind::Parameters;
        self.format = "parameters of an autopilot".to_owned();
        let text = read_parameters(path)?;
        let Some(autopilot) = Autopilot::of_text(&text) else {
            self.notes.push("there are no parameters of temperature compensation".to_owned());
            return Ok(());
        };
        self.format = format!("parameters of {}", autopilot.title());
        let mut refused = None;
        for instance in autopilot.instances() {
            // Only the range of temperature is used, and whether there are gyroscopes.
            let imu = "imu".parse().map_err(|error| Failure::new(Exit::Failed, format!("{error}")))?;
            let (interval_ns, gravity) = (INTERVAL_NS, STANDARD_GRAVITY);
            let options = ImportOptions { autopilot, instance: Some(instance), imu, interval_ns, gravity };
            match import(&text, &options) {
                Ok(table) => self.imus.push(ImuSummary {
                    imu: None,
                    instance: Some(instance.into()),
                    ..ImuSummary::of_table(&table)
                }),
                Err(error) => _ = refused.get_or_insert(error),
            }
        }
        match refused {
            Some(ImportError::Text(faults)) if self.imus.is_empty() => {
                Err(LoadError::Refused { path: path.to_owned(), faults }.into())
            }
            Some(error) if self.imus.is_empty() => Err(error.into()),
            _ => Ok(()),
        }
    }

    fn read_data(&mut self, path: &Path, foreign: &Foreign, bar: Bar<'_>) -> Result<(), Failure> {
        let files = [path.to_owned()];
        let progress = bar(&files, "looking for IMUs");
        let settings = Settings { progress: progress.clone(), ..foreign.settings.clone() };
        let found = imus_of_log(&source(path), &settings);
        progress.finish();
        let mut failed = None;
        let chosen = |instance| foreign.settings.instance.is_none_or(|wanted| wanted == instance);
        let instances: Vec<_> = found?.iter().map(|found| found.imu.instance).filter(|it| chosen(*it)).collect();
        let instances = if instances.is_empty() { vec![foreign.settings.instance] } else { somes(instances) };
        for instance in instances {
            let mut of_imu = foreign.clone();
            of_imu.settings.instance = instance;
            if let Err(failure) = self.read_imu(&files, of_imu, bar) {
                failed.get_or_insert(failure);
            }
        }
        // An IMU that cannot be read does not keep the others from being used.
        match failed {
            Some(failure) if self.imus.iter().all(|imu| imu.rows == Some(0)) => Err(failure),
            Some(failure) => {
                self.notes.push(failure.message);
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn read_imu(&mut self, files: &[PathBuf; 1], foreign: Foreign, bar: Bar<'_>) -> Result<(), Failure> {
        let progress = bar(files, "reading");
        let instance = foreign.settings.instance;
        let mut samples = Samples::open(&[source(&files[0])], rows::any_imu(foreign), &progress)?;
        if samples.recording().foreign_layout().is_none() {
            self.kind = DescribedKind::Recording;
        }
        let mut summary = rows::RowSummary::default();
        let read = samples.by_ref().try_for_each(|row| row.map(|row| summary.take(&row)));
        progress.finish();
        let recording = samples.recording();
        let findings = recording.findings();
        let imu = summary.imu(recording, samples.imu(), instance, &findings);
        for finding in &findings {
            let explained = FindingExplanation::of(finding);
            if self.findings.iter().all(|known| known.message != explained.message) {
                self.findings.push(explained);
            }
        }
        for note in recording.notes() {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
        self.imus.push(imu);
        read
    }
}

fn somes(instances: Vec<u32>) -> Vec<Option<u32>> {
    instances.into_iter().map(Some).collect()
}
