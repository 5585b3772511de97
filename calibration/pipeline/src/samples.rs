//! The files of a campaign's samples: those that it names, those of a pattern, a sheet of means.

use crate::files::CampaignFile;
use isotherm_campaign::{Campaign, FilePattern, SampleLayout};
use isotherm_recording::{CampaignRow, RecordingError};
use isotherm_support::failure::{Exit, Failure, shown};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Most files and folders that are looked at for the files of a pattern.
const MOST: usize = 100_000;
/// Names that are shown.
const SHOWN: usize = 3;

/// The file of a position at a set point.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionFile {
    /// The file.
    pub path: PathBuf,
    /// Set point of the chamber \[degC\].
    pub set_point_c: f64,
    /// Number of the position, or of the turn.
    pub position: u32,
}

/// Where rows come from.
pub enum RowSource<'a> {
    /// A file of any format that recordings have.
    File(PathBuf),
    /// The file of a position at a set point.
    Position(PositionFile),
    /// A sheet of means.
    Means(PathBuf),
    /// Rows in memory.
    Rows {
        /// What messages call them.
        name: String,
        /// SHA-256 of their bytes, in hexadecimal.
        sha256: String,
        /// The rows.
        rows: Box<dyn Iterator<Item = Result<CampaignRow, RecordingError>> + Send + 'a>,
    },
}

impl RowSource<'_> {
    /// Files.
    #[must_use]
    pub fn files(paths: &[PathBuf]) -> Vec<Self> {
        paths.iter().cloned().map(Self::File).collect()
    }

    pub(crate) fn path(&self) -> PathBuf {
        match self {
            Self::File(path) | Self::Means(path) => path.clone(),
            Self::Position(file) => file.path.clone(),
            Self::Rows { name, .. } => PathBuf::from(name),
        }
    }
}

impl CampaignFile {
    /// The files of the samples of `campaign`.
    ///
    /// # Errors
    /// As [`sources`](Self::sources).
    pub fn samples(&self, campaign: &Campaign) -> Result<Vec<PathBuf>, Failure> {
        Ok(self.sources(campaign)?.iter().map(RowSource::path).collect())
    }

    /// Where the samples of `campaign` come from.
    ///
    /// # Errors
    /// If no file fits a pattern, if two files are of one position at one set point, or if a file is of a position that
    /// the campaign file does not have.
    pub fn sources(&self, campaign: &Campaign) -> Result<Vec<RowSource<'static>>, Failure> {
        let paths = campaign.samples.iter().map(|name| self.beside(name));
        match campaign.layout {
            SampleLayout::Rows => Ok(paths.map(RowSource::File).collect()),
            SampleLayout::Means => Ok(paths.map(RowSource::Means).collect()),
            SampleLayout::ByPosition { .. } => {
                let mut all = Vec::new();
                for pattern in &campaign.samples {
                    all.extend(self.files_of(campaign, pattern)?.into_iter().map(RowSource::Position));
                }
                Ok(all)
            }
        }
    }

    /// The line in which a key of the section `samples` stands.
    fn line_of(&self, key: &str) -> u64 {
        let is_section = |line: &str| line.trim_start().starts_with("[samples]");
        let is_key =
            |line: &str| line.trim_start().strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='));
        let lines = || (1..).zip(self.text.lines()).skip_while(|(_, line)| !is_section(line));
        let found = lines().find(|(_, line)| is_key(line)).or_else(|| lines().next());
        found.map_or(1, |(line, _)| line)
    }

    /// The files of a pattern, by set point and position.
    fn files_of(&self, campaign: &Campaign, pattern: &str) -> Result<Vec<PositionFile>, Failure> {
        let refused = |message: String| {
            let line = self.line_of("files");
            let message = format!("{}:{line}: samples.files: {message}", shown(&self.path));
            Failure::new(Exit::Data, message).at(&self.path, Some(line))
        };
        let read = FilePattern::new(pattern).map_err(|message| refused(format!("{pattern:?} {message}")))?;
        let (folder, depth) = read.folder();
        let root = self.beside(folder);
        let names = names_in(&root, depth)?;
        let mut files: Vec<PositionFile> = Vec::new();
        let mut seen: HashMap<(u64, u32), PathBuf> = HashMap::new();
        for name in &names {
            let Some((set_point_c, position)) = read.read(&format!("{folder}{name}")) else { continue };
            let path = root.join(name);
            let is_known = campaign.positions.iter().any(|known| known.number == position)
                || campaign.turns.iter().any(|turn| turn.start.number == position);
            if !is_known {
                let known: Vec<_> = campaign.positions.iter().map(|position| position.number.to_string()).collect();
                return Err(refused(format!(
                    "{} is of position {position}, and the campaign file lists {}; give a [[position]] with number = \
                     {position}, or take the file out of the folder",
                    shown(&path),
                    known.join(", ")
                )));
            }
            if let Some(other) = seen.insert((set_point_c.to_bits(), position), path.clone()) {
                return Err(refused(format!(
                    "{} and {} are both of position {position} at {set_point_c} degC; take one away, or give a \
                     second visit a folder and a name of its own: files = [\"up/..\", \"down/..\"]",
                    shown(&other),
                    shown(&path)
                )));
            }
            files.push(PositionFile { path, set_point_c, position });
        }
        if files.is_empty() {
            let few: Vec<_> = names.iter().take(SHOWN).map(|name| shown(Path::new(name)).to_string()).collect();
            let there = match names.len() {
                0 => "there is none".to_owned(),
                many if many > SHOWN => format!("there are {}, ..", few.join(", ")),
                _ => format!("there are {}", few.join(", ")),
            };
            return Err(refused(format!(
                "no file in {} is called as {pattern:?} says; {there}; correct the pattern, or move the files",
                shown(if root.as_os_str().is_empty() { Path::new(".") } else { &root })
            )));
        }
        files.sort_by(|a, b| a.set_point_c.total_cmp(&b.set_point_c).then(a.position.cmp(&b.position)));
        Ok(files)
    }
}

/// The names of all files so many folders below a folder, with `/` between folders, in order. What is no regular file
/// is none: a pipe would be waited for without end.
pub(crate) fn names_in(root: &Path, depth: usize) -> Result<Vec<String>, Failure> {
    let root = if root.as_os_str().is_empty() { Path::new(".") } else { root };
    let mut names = Vec::new();
    let mut waiting = vec![(root.to_owned(), String::new(), 0)];
    let mut looked_at = 0_usize;
    while let Some((folder, before, below)) = waiting.pop() {
        let failed = |error: &std::io::Error| Failure::io("reading the folder", &folder, error);
        for entry in fs::read_dir(&folder).map_err(|error| failed(&error))? {
            let entry = entry.map_err(|error| failed(&error))?;
            looked_at += 1;
            if looked_at > MOST {
                let message = format!("{}: over {MOST} files; give the folder of only the campaign", shown(root));
                return Err(Failure::new(Exit::Data, message));
            }
            // A name that is no text fits no pattern.
            let Ok(name) = entry.file_name().into_string() else { continue };
            let path = entry.path();
            // A link to nothing is reported when it is read.
            match path.metadata() {
                Ok(found) if found.is_dir() && below < depth => {
                    waiting.push((path, format!("{before}{name}/"), below + 1));
                }
                Ok(found) if !found.is_file() => {}
                _ if below == depth => names.push(format!("{before}{name}")),
                _ => {}
            }
        }
    }
    names.sort();
    Ok(names)
}
