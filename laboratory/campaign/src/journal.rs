//! The journal: what has happened, one line of JSON each, only ever appended to. A unit of data counts when its line is on the disk.

use super::plan::{Plan, SAMPLES};
use isotherm_calibration::provenance::sha256;
use isotherm_calibration::provenance::tool;
use isotherm_client::unix_s;
use isotherm_failure::{Exit, Failure};
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

/// Its file in the campaign's folder.
pub const JOURNAL: &str = "journal.jsonl";
/// The version of its lines.
const FORMAT: u32 = 1;

/// A line.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct JournalLine {
    /// Seconds since 1970.
    pub unix_s: f64,
    /// What has happened.
    #[serde(flatten)]
    pub entry: Entry,
}

/// What has happened.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Entry {
    /// The campaign begins: the first line, and again if the plan has changed before anything was taken.
    Begin {
        /// Version of the lines.
        format: u32,
        /// What wrote it.
        tool: String,
        /// What of the plan makes the data what they are.
        plan: Vec<(String, String)>,
    },
    /// A runner has taken over.
    Started {
        /// Its process.
        pid: u32,
        /// Laboratory time over real time.
        speed: f64,
        /// The unit that it begins with.
        unit: usize,
    },
    /// Both instruments have answered.
    Connected {
        /// What the chamber calls itself.
        chamber: String,
        /// What the table calls itself.
        table: String,
    },
    /// The chamber is at a set point.
    Reached {
        /// \[degC\]
        set_point_c: f64,
    },
    /// The chamber has left the set point, or is told to.
    Left,
    /// A unit is complete.
    Kept(Kept),
    /// The unit in progress was thrown away.
    Discarded {
        /// Why.
        reason: String,
    },
    /// Nothing is commanded until all is well again.
    Paused {
        /// Why.
        cause: String,
    },
    /// It goes on.
    Resumed {
        /// Laboratory time that the pause took \[s\].
        after_s: f64,
    },
    /// The safe state.
    Safe {
        /// Why.
        reason: String,
        /// What came of the table.
        table: String,
        /// What came of the chamber.
        chamber: String,
        /// Whether both are certain.
        certain: bool,
    },
    /// The table of coefficients is made.
    Calibrated {
        /// Its digest.
        digest: String,
    },
    /// The table of coefficients is where the service reloads it.
    Installed {
        /// Its digest.
        digest: String,
        /// Where.
        file: PathBuf,
    },
}

/// A complete unit.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Kept {
    /// Its number, from 0.
    pub unit: usize,
    /// Its name, for people.
    pub name: String,
    /// Its file, in the folder.
    pub file: String,
    /// Where in the file it begins.
    pub from: u64,
    /// Where in the file it ends.
    pub to: u64,
    /// SHA-256 of these bytes.
    pub sha256: String,
    /// Rows.
    pub rows: u64,
    /// Counted time \[s\].
    pub seconds: f64,
    /// End of its last sample, as written \[ns\].
    pub end_ns: u64,
    /// The acquisition's session.
    pub session: u64,
    /// What was added to that session's timestamps, so that time rises \[ns\].
    pub shift_ns: u64,
    /// Gaps in the sequence.
    pub gaps: u64,
    /// Samples that were left out: stale or no telemetry, saturated, without a valid interval.
    pub left_out: u64,
}

/// What an earlier runner has left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Complete units, in order.
    pub kept: Vec<Kept>,
    /// The last set point that was reached, and when.
    pub reached: Option<(f64, f64)>,
    /// When the last of them was complete, seconds since 1970.
    pub kept_unix_s: f64,
    /// Whether a runner has begun.
    pub begun: bool,
    /// Whether the last runner has ended in the safe state, for certain.
    pub safe: bool,
}

/// The open journal.
pub struct Journal {
    file: File,
    path: PathBuf,
    /// Whole lines \[bytes\]; `None` when half a line could not be taken away again.
    length: Option<u64>,
}

/// The name of a samples' file that is in `folder`.
fn existing(folder: &Path) -> Option<&'static str> {
    [SAMPLES, "campaign.toml"].into_iter().find(|name| folder.join(name).exists())
}

impl Journal {
    /// Opens the journal of `plan`, or begins it. A last line that was cut off is taken away.
    ///
    /// # Errors
    /// If it cannot be read or written, is damaged, belongs to another plan, or data that it lists are not what they were.
    pub fn open(plan: &Plan) -> Result<(Self, History), Failure> {
        let path = plan.output.join(JOURNAL);
        let failed = |error: io::Error| Failure::io("opening the journal", &path, &error);
        let (lines, whole) = read(&path)?;
        let file = open(&path, whole).map_err(failed)?;
        let mut journal = Self { file, path: path.clone(), length: Some(whole) };
        if lines.is_empty() {
            if let Some(name) = existing(&plan.output) {
                let message = format!(
                    "{}: there is a {name} without a journal; give another output folder, or move this one away",
                    plan.output.display()
                );
                return Err(Failure::new(Exit::Config, message));
            }
            journal.lasting(begin(plan))?;
            // The file's name is the folder's to keep.
            File::open(&plan.output).and_then(|folder| folder.sync_all()).map_err(failed)?;
            return Ok((journal, History::default()));
        }
        let mut history = history(&lines);
        match same_plan(&path, &lines, plan) {
            Ok(()) => {}
            // Nothing has been taken by the other one.
            Err(_) if history.kept.is_empty() => {
                journal.lasting(begin(plan))?;
                history.reached = None;
            }
            Err(failure) => return Err(failure),
        }
        intact(&plan.output, &history.kept)?;
        Ok((journal, history))
    }

    /// Appends an entry.
    ///
    /// # Errors
    /// If the operating system does not take it.
    pub fn write(&mut self, entry: Entry) -> Result<(), Failure> {
        let line = JournalLine { unix_s: unix_s(), entry };
        let failed = |error: io::Error| Failure::io("writing the journal", &self.path, &error);
        let text = serde_json::to_string(&line).map_err(|error| failed(error.into()))? + "\n";
        let Some(length) = self.length else {
            return Err(failed(io::Error::other("half a line is at its end, and cannot be taken away")));
        };
        // In one piece: a kill leaves the line or nothing of it, a power loss at most a part, which is cut off.
        if let Err(error) = self.file.write_all(text.as_bytes()) {
            // A full disk has taken a part.
            self.length = self.file.set_len(length).is_ok().then_some(length);
            return Err(failed(error));
        }
        self.length = Some(length + text.len() as u64);
        Ok(())
    }

    /// Appends an entry and returns when it is on the disk.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn lasting(&mut self, entry: Entry) -> Result<(), Failure> {
        self.write(entry)?;
        self.file.sync_data().map_err(|error| Failure::io("writing the journal", &self.path, &error))
    }
}

/// The lines of a journal, and the length of those that are whole. None if there is no journal.
///
/// # Errors
/// If it cannot be read, or a line but the last is none.
pub fn read(path: &Path) -> Result<(Vec<JournalLine>, u64), Failure> {
    let text = match fs::read(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Err(error) => return Err(Failure::io("reading the journal", path, &error)),
    };
    let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |last| last + 1);
    let lines = text[..whole].split_inclusive(|&byte| byte == b'\n').enumerate();
    let lines = lines.map(|(index, line)| {
        serde_json::from_slice(line).map_err(|error| {
            let message = format!(
                "{}:{}: no line of a journal: {error}; restore it, or begin anew in another folder",
                path.display(),
                index + 1
            );
            Failure::new(Exit::Data, message)
        })
    });
    Ok((lines.collect::<Result<_, _>>()?, whole as u64))
}

/// Whether a runner has begun in `folder` and none has reached the safe state since, or nobody can tell.
#[must_use]
pub fn needs_safe_state(folder: &Path) -> bool {
    read(&folder.join(JOURNAL)).map_or(true, |(lines, _)| {
        let history = history(&lines);
        history.begun && !history.safe
    })
}

/// Appends an entry to the journal of `folder`, whatever the plan is. A last line that was cut off is taken away.
///
/// # Errors
/// If it cannot be read or written.
pub fn append(folder: &Path, entry: Entry) -> Result<(), Failure> {
    let path = folder.join(JOURNAL);
    let (_, whole) = read(&path)?;
    let file = open(&path, whole).map_err(|error| Failure::io("opening the journal", &path, &error))?;
    Journal { file, path, length: Some(whole) }.lasting(entry)
}

fn open(path: &Path, whole: u64) -> io::Result<File> {
    let file = OpenOptions::new().read(true).append(true).create(true).open(path)?;
    file.set_len(whole)?;
    Ok(file)
}

/// What the lines of a journal amount to.
pub fn history(lines: &[JournalLine]) -> History {
    let mut history = History::default();
    for line in lines {
        match &line.entry {
            Entry::Started { .. } => (history.begun, history.safe) = (true, false),
            Entry::Kept(kept) => {
                history.kept.push(kept.clone());
                history.kept_unix_s = line.unix_s;
            }
            Entry::Reached { set_point_c } => history.reached = Some((*set_point_c, line.unix_s)),
            Entry::Begin { .. } | Entry::Left => history.reached = None,
            Entry::Safe { certain, .. } => (history.reached, history.safe) = (None, *certain),
            _ => {}
        }
    }
    history
}

fn begin(plan: &Plan) -> Entry {
    Entry::Begin { format: FORMAT, tool: tool(), plan: plan.identity() }
}

/// Whether the plan that the last campaign of `lines` began with makes the same data as `plan`.
fn same_plan(path: &Path, lines: &[JournalLine], plan: &Plan) -> Result<(), Failure> {
    let refuse = |message: String| Err(Failure::new(Exit::Config, format!("{}: {message}", path.display())));
    let begun = lines.iter().rev().find(|line| matches!(line.entry, Entry::Begin { .. }));
    let Some(Entry::Begin { format: FORMAT, plan: before, .. }) = begun.map(|line| &line.entry) else {
        return refuse("it is not the journal of a campaign of this version; give another output folder".to_owned());
    };
    let now = plan.identity();
    let value = |list: &[(String, String)], key: &str| {
        list.iter().find(|(known, _)| known == key).map_or_else(|| "nothing".to_owned(), |(_, value)| value.clone())
    };
    let mut keys: Vec<_> = before.iter().chain(&now).map(|(key, _)| key).collect();
    keys.sort_unstable();
    keys.dedup();
    let different = keys.into_iter().filter(|key| value(before, key) != value(&now, key));
    let different: Vec<_> =
        different.map(|key| format!("{key}: was {}, is {}", value(before, key), value(&now, key))).collect();
    if different.is_empty() {
        return Ok(());
    }
    refuse(format!(
        "the plan has changed since this campaign began; change it back, or give another output folder\n{}",
        different.join("\n")
    ))
}

/// Whether every unit's bytes are what they were.
fn intact(folder: &Path, kept: &[Kept]) -> Result<(), Failure> {
    let mut buffer = Vec::new();
    for unit in kept {
        let path = folder.join(&unit.file);
        let failed = |error: io::Error| Failure::io("reading back", &path, &error);
        let mut file = File::open(&path).map_err(failed)?;
        file.seek(SeekFrom::Start(unit.from)).map_err(failed)?;
        buffer.clear();
        file.take(unit.to.saturating_sub(unit.from)).read_to_end(&mut buffer).map_err(failed)?;
        if sha256(&buffer) != unit.sha256 {
            let message = format!(
                "{}: the bytes {} to {} ({}) are not those that were taken; restore the file, or begin anew in another folder",
                path.display(),
                unit.from,
                unit.to,
                unit.name
            );
            return Err(Failure::new(Exit::Data, message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(folder: &Path) -> Plan {
        let text = include_str!("../../../examples/plan.toml");
        Plan::from_toml(&text.replace("output = \"campaign\"", "output = \".\""), folder).unwrap()
    }

    #[test]
    fn a_line_that_was_cut_off_is_taken_away_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(folder.path());
        let (mut journal, history) = Journal::open(&plan).unwrap();
        assert_eq!(history, History::default());
        journal.lasting(Entry::Reached { set_point_c: 5.0 }).unwrap();
        journal.lasting(Entry::Left).unwrap();
        assert_eq!(Journal::open(&plan).unwrap().1.reached, None);
        journal.lasting(Entry::Reached { set_point_c: 5.0 }).unwrap();
        let whole = fs::read(folder.path().join(JOURNAL)).unwrap();
        for cut in 1..40 {
            let torn = [&whole[..], &whole[..cut]].concat();
            fs::write(folder.path().join(JOURNAL), torn).unwrap();
            let (_, history) = Journal::open(&plan).unwrap();
            assert_eq!(history.reached.map(|(set_point_c, _)| set_point_c), Some(5.0));
            assert_eq!(fs::read(folder.path().join(JOURNAL)).unwrap(), whole);
        }
        let mut damaged = whole.clone();
        damaged[20] = b'#';
        fs::write(folder.path().join(JOURNAL), &damaged).unwrap();
        assert_eq!(Journal::open(&plan).err().unwrap().exit, Exit::Data);
        assert_eq!(fs::read(folder.path().join(JOURNAL)).unwrap(), damaged, "nothing is changed");
    }

    #[test]
    fn samples_without_a_journal_are_not_touched() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("campaign.csv"), "precious").unwrap();
        assert_eq!(Journal::open(&plan(folder.path())).err().unwrap().exit, Exit::Config);
        assert_eq!(fs::read_to_string(folder.path().join("campaign.csv")).unwrap(), "precious");
    }

    #[test]
    fn a_plan_may_change_until_something_has_been_taken() {
        let folder = tempfile::tempdir().unwrap();
        let first = plan(folder.path());
        let (mut journal, _) = Journal::open(&first).unwrap();
        journal.lasting(Entry::Reached { set_point_c: 5.0 }).unwrap();
        let second = Plan { set_points_c: vec![5.0], ..first.clone() };
        let (mut journal, history) = Journal::open(&second).unwrap();
        assert_eq!(
            (history.reached, Journal::open(&second).unwrap().1.reached),
            (None, None),
            "it was of another plan"
        );
        fs::write(folder.path().join("campaign.csv"), "").unwrap();
        let nothing = sha256(b"");
        let kept = Kept { file: "campaign.csv".to_owned(), sha256: nothing, ..Kept::default() };
        journal.lasting(Entry::Kept(kept)).unwrap();
        assert_eq!(Journal::open(&second).unwrap().1.kept.len(), 1);
        let refused = Journal::open(&first).err().unwrap();
        assert_eq!(refused.exit, Exit::Config);
        assert!(refused.to_string().contains("set_points: was [5.0], is [-25.0, -20.0"), "{refused}");
    }
}
