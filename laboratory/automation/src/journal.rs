//! The journal: one line of JSON for each event, only ever appended to. A unit of the data counts when its line is on
//! the disk.

mod entry;
mod history;
mod same_plan;

use entry::FORMAT;
pub use entry::{Entry, JournalLine, KeptStep, LargestError, TurnReadBacks};
pub use history::{History, history};

use super::plan::{Plan, SAMPLES};
use super::stamp::Stamp;
use isotherm_files::open_without_waiting;
use isotherm_fit::{sha256, tool};
use isotherm_instruments::{RealTime, Time};
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{Exit, Failure, shown};
use same_plan::check_same_plan;
use std::fs::{File, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The journal's file in the campaign's folder.
pub const JOURNAL: &str = "journal.jsonl";
/// Most bytes of a line.
const MAX_LINE: u64 = 1 << 20;

/// The open journal.
pub struct Journal {
    file: File,
    path: PathBuf,
    time: Arc<dyn Time>,
    /// The IMU of a batch that the next entries are about.
    imu: Option<String>,
    /// Length of the complete lines \[bytes\]; `None` if an incomplete line could not be removed.
    length: Option<u64>,
}

/// Refuses a folder that has data and no line of a journal. Nothing is written into it.
///
/// # Errors
/// If it is such a folder, or its journal cannot be read.
pub fn refuse_data_of_others(folder: &Path) -> Result<(), Failure> {
    let data = [SAMPLES, "campaign.toml"].into_iter().find(|name| folder.join(name).exists());
    match data {
        Some(name) if read(&folder.join(JOURNAL))?.0.is_empty() => {
            let folder = shown(folder);
            let message = format!(
                "{folder}: there is a {name} without a journal; give another output folder, or move this one away"
            );
            Err(Failure::new(Exit::Config, message))
        }
        _ => Ok(()),
    }
}

impl Journal {
    /// Opens the journal of `plan`, or creates it. An incomplete last line is removed.
    ///
    /// # Errors
    /// If it cannot be read or written, is damaged or belongs to another plan, or if data that it lists have changed.
    pub fn open(plan: &Plan) -> Result<(Self, History), Failure> {
        Self::open_with(plan, Arc::new(RealTime))
    }

    /// As [`open`](Self::open); the entries have the times of this clock.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(plan: &Plan, time: Arc<dyn Time>) -> Result<(Self, History), Failure> {
        let path = plan.output.join(JOURNAL);
        let failed = |error: io::Error| Failure::io("opening the journal", &path, &error);
        refuse_data_of_others(&plan.output)?;
        let (lines, whole) = read(&path)?;
        let file = open(&path, whole).map_err(failed)?;
        let mut journal = Self { file, path: path.clone(), time, imu: None, length: Some(whole) };
        if lines.is_empty() {
            journal.write_synced(begin_entry(plan))?;
            // The name of a new file is durable only when its folder is synced.
            File::open(&plan.output).and_then(|folder| folder.sync_all()).map_err(failed)?;
            return Ok((journal, History::default()));
        }
        let mut history = history(&lines);
        let same = match check_same_plan(&path, &lines, plan, &history.kept) {
            // Another plan may take the folder over while no unit is kept.
            Err(_) if history.kept.is_empty() => false,
            same => same?,
        };
        if !same {
            journal.write_synced(begin_entry(plan))?;
            history.reached = None;
        }
        check_unchanged(&plan.output, &history.kept)?;
        if history.kept.is_empty() {
            // The runner that starts now takes them in again.
            history.dropped.clear();
        }
        Ok((journal, history))
    }

    /// The next entries are about this IMU of a batch; `None` if about all of them, or if there is only one IMU.
    pub fn about(&mut self, imu: Option<&ImuId>) {
        self.imu = imu.map(ToString::to_string);
    }

    /// Appends an entry.
    ///
    /// # Errors
    /// If the operating system cannot write it.
    pub fn write(&mut self, entry: Entry) -> Result<(), Failure> {
        let line = JournalLine { at: Stamp::now(self.time.as_ref()), imu: self.imu.clone(), entry };
        let failed = |error: io::Error| Failure::io("writing the journal", &self.path, &error);
        let text = serde_json::to_string(&line).map_err(|error| failed(error.into()))? + "\n";
        let Some(length) = self.length else {
            return Err(failed(io::Error::other("it ends with an incomplete line that cannot be removed")));
        };
        // One write for the line: SIGKILL leaves all or nothing of it. The next start removes a part that a power loss
        // left.
        if let Err(error) = self.file.write_all(text.as_bytes()) {
            // A full disk may have taken a part of the line.
            self.length = self.file.set_len(length).is_ok().then_some(length);
            return Err(failed(error));
        }
        self.length = Some(length + text.len() as u64);
        Ok(())
    }

    /// Appends an entry and syncs it to the disk.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_synced(&mut self, entry: Entry) -> Result<(), Failure> {
        self.write(entry)?;
        self.file.sync_data().map_err(|error| Failure::io("writing the journal", &self.path, &error))
    }
}

/// The complete lines of a journal, and their length \[bytes\]. No lines if there is no journal.
///
/// # Errors
/// If the journal cannot be read, or a complete line is not an entry.
pub fn read(path: &Path) -> Result<(Vec<JournalLine>, u64), Failure> {
    read_since(path, 0)
}

/// The same of the lines after the first `from` bytes.
pub(crate) fn read_since(path: &Path, from: u64) -> Result<(Vec<JournalLine>, u64), Failure> {
    let failed = |error: io::Error| Failure::io("reading the journal", path, &error);
    let mut file = match open_without_waiting(path) {
        Ok(file) => BufReader::new(file),
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Err(error) => return Err(failed(error)),
    };
    file.seek(SeekFrom::Start(from)).map_err(failed)?;
    let (mut lines, mut whole, mut line) = (Vec::new(), from, Vec::new());
    loop {
        line.clear();
        (&mut file).take(MAX_LINE).read_until(b'\n', &mut line).map_err(failed)?;
        let is_whole = line.ends_with(b"\n");
        if !is_whole && (line.len() as u64) < MAX_LINE {
            return Ok((lines, whole));
        }
        let entry = serde_json::from_slice(&line).map_err(|error| {
            let message = format!(
                "{}:{}: not a line of a journal: {error}; restore it, or start again in another folder",
                shown(path),
                lines.len() + 1
            );
            Failure::new(Exit::Data, message)
        });
        lines.push(entry?);
        whole += line.len() as u64;
    }
}

/// Whether a runner has started in `folder` without a confirmed safe state since, or the journal cannot be read.
#[must_use]
pub fn needs_safe_state(folder: &Path) -> bool {
    read(&folder.join(JOURNAL)).map_or(true, |(lines, _)| {
        let history = history(&lines);
        history.begun && !history.safe
    })
}

/// Appends an entry to the journal of `folder` without a check of the plan. An incomplete last line is removed.
///
/// # Errors
/// If it cannot be read or written.
pub fn append(folder: &Path, entry: Entry, time: Arc<dyn Time>) -> Result<(), Failure> {
    let path = folder.join(JOURNAL);
    let (_, whole) = read(&path)?;
    let file = open(&path, whole).map_err(|error| Failure::io("opening the journal", &path, &error))?;
    Journal { file, path, time, imu: None, length: Some(whole) }.write_synced(entry)
}

fn open(path: &Path, whole: u64) -> io::Result<File> {
    let file = OpenOptions::new().read(true).append(true).create(true).open(path)?;
    file.set_len(whole)?;
    Ok(file)
}

fn begin_entry(plan: &Plan) -> Entry {
    Entry::Begin { format: FORMAT, tool: tool(), plan: plan.identity() }
}

/// Checks that the bytes of every kept unit are unchanged.
fn check_unchanged(folder: &Path, kept: &[KeptStep]) -> Result<(), Failure> {
    let mut buffer = Vec::new();
    for unit in kept.iter().flat_map(KeptStep::each) {
        let path = folder.join(&unit.file);
        let failed = |error: io::Error| Failure::io("reading back", &path, &error);
        let mut file = File::open(&path).map_err(failed)?;
        file.seek(SeekFrom::Start(unit.from)).map_err(failed)?;
        buffer.clear();
        file.take(unit.to.saturating_sub(unit.from)).read_to_end(&mut buffer).map_err(failed)?;
        if sha256(&buffer) != unit.sha256 {
            let message = format!(
                "{}: the bytes {} to {} ({}) are not those that were taken; restore the file, or start again in \
                 another folder",
                shown(&path),
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
    use std::fs;

    fn plan(folder: &Path) -> Plan {
        let text = include_str!("../../../examples/plan.toml");
        Plan::from_toml(&text.replace("output = \"imu-a-campaign\"", "output = \".\""), folder).unwrap()
    }

    #[test]
    fn a_line_that_was_cut_off_is_taken_away_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(folder.path());
        let (mut journal, history) = Journal::open(&plan).unwrap();
        assert_eq!(history, History::default());
        journal.write_synced(Entry::Reached { set_point_c: 5.0 }).unwrap();
        journal.write_synced(Entry::Left).unwrap();
        assert_eq!(Journal::open(&plan).unwrap().1.reached, None);
        journal.write_synced(Entry::Reached { set_point_c: 5.0 }).unwrap();
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

    /// A folder with a complete campaign of three runs at one attitude.
    fn of_three_runs(folder: &Path) {
        fs::create_dir(folder).unwrap();
        let begin = Entry::Begin { format: FORMAT, tool: tool(), plan: one_attitude(folder, 3).identity() };
        let nothing = sha256(b"");
        let kept = |(unit, file): (usize, &str)| {
            fs::write(folder.join(file), "").unwrap();
            Entry::Kept(KeptStep { unit, file: file.to_owned(), sha256: nothing.clone(), ..KeptStep::default() })
        };
        let files = ["verify-1.csv", "verify-2.csv", "verify-3.csv"];
        let units = std::iter::repeat_n(SAMPLES, 180).chain(files).enumerate().map(kept);
        let lines = [begin].into_iter().chain(units).map(|entry| {
            let line = JournalLine { at: Stamp { unix_s: 1.0, up: None }, imu: None, entry };
            serde_json::to_string(&line).unwrap() + "\n"
        });
        fs::write(folder.join(JOURNAL), lines.collect::<String>()).unwrap();
    }

    /// The example's plan with runs at one attitude.
    fn one_attitude(folder: &Path, runs: u32) -> Plan {
        let plan = plan(folder);
        let mut verify = plan.verify.clone().unwrap();
        verify.runs = runs;
        verify.attitudes.truncate(1);
        Plan { verify: Some(verify), ..plan }
    }

    #[test]
    fn runs_may_be_added_and_those_that_are_taken_do_not_change() {
        let folder = tempfile::tempdir().unwrap();
        let folder = &folder.path().join("campaign");
        of_three_runs(folder);
        let same = one_attitude(folder, 3);
        let lines = || read(&folder.join(JOURNAL)).unwrap().0.len();
        let before = lines();
        assert_eq!(Journal::open(&same).unwrap().1.kept.len(), 183);
        assert_eq!(lines(), before, "it is the same plan");
        // The opposite attitude after the three runs that are taken.
        let mut more = same.clone();
        let opposite = plan(folder).verify.unwrap().attitudes[1].clone();
        let verify = more.verify.as_mut().unwrap();
        let taken = verify.attitudes[0].clone();
        (verify.runs, verify.attitudes) = (4, vec![taken.clone(), taken.clone(), taken, opposite]);
        assert_eq!(Journal::open(&more).unwrap().1.kept.len(), 183);
        assert_eq!(lines(), before + 1, "the new plan is journalled");
        assert_eq!(Journal::open(&same).unwrap().1.kept.len(), 183, "and may be taken back");
        // Runs that are taken neither change nor vanish.
        for (changed, key) in [(plan(folder), "verify.2: was "), (one_attitude(folder, 2), "verify.3: was ")] {
            let refused = Journal::open(&changed).err().unwrap().to_string();
            assert!(refused.contains(key) && !refused.contains("verify.4"), "{refused}");
        }
        let gravity =
            include_str!("../../../examples/plan.toml").replace("gravity_local = 9.8015", "gravity_local = 9.8");
        let other = Plan::from_toml(&gravity.replace("output = \"imu-a-campaign\"", "output = \".\""), folder).unwrap();
        let refused = Journal::open(&other).err().unwrap().to_string();
        assert!(refused.contains("gravity_local: was 9.8015, is 9.8\n"), "{refused}");
    }

    #[test]
    fn a_turn_has_its_read_backs_and_other_units_are_written_as_before() {
        let turn = TurnReadBacks { angle_deg: 360.0, before_deg: [0.0001, 90.0], after_deg: [360.0, 90.0] };
        let kept = KeptStep { unit: 12, turn: Some(turn), ..KeptStep::default() };
        let line = JournalLine { at: Stamp { unix_s: 1.0, up: None }, imu: None, entry: Entry::Kept(kept.clone()) };
        let text = serde_json::to_string(&line).unwrap();
        let read_backs = r#""turn":{"angle_deg":360.0,"before_deg":[0.0001,90.0],"after_deg":[360.0,90.0]}"#;
        assert!(text.contains(read_backs), "{text}");
        assert_eq!(serde_json::from_str::<JournalLine>(&text).unwrap(), line);
        let dwell = JournalLine {
            at: Stamp { unix_s: 1.0, up: None },
            imu: None,
            entry: Entry::Kept(KeptStep { turn: None, ..kept }),
        };
        let text = serde_json::to_string(&dwell).unwrap();
        assert!(!text.contains("turn"), "{text}");
        assert_eq!(serde_json::from_str::<JournalLine>(&text).unwrap(), dwell);
    }

    #[test]
    fn a_unit_of_a_batch_is_one_line_and_who_is_dropped_stays_so_once_something_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let text = include_str!("../../../examples/plan-batch.toml").replace("\"batch-campaign\"", "\".\"");
        let plan = Plan::from_toml(&text, folder.path()).unwrap();
        let b = &plan.each()[1].imu;
        let drop_b = |journal: &mut Journal| {
            journal.about(Some(b));
            journal.write(Entry::Dropped { reason: "silent".to_owned() }).unwrap();
            journal.about(None);
        };
        let started = || Entry::Started { pid: 1, speed: 1.0, unit: 0 };
        let (mut journal, _) = Journal::open(&plan).unwrap();
        journal.write(started()).unwrap();
        drop_b(&mut journal);
        assert_eq!(Journal::open(&plan).unwrap().1.reason_dropped(b), None, "it has missed nothing yet");
        journal.write(started()).unwrap();
        let kept = |file: &str| {
            fs::write(folder.path().join(file), file).unwrap();
            KeptStep {
                file: file.to_owned(),
                to: file.len() as u64,
                sha256: sha256(file.as_bytes()),
                ..KeptStep::default()
            }
        };
        let unit = KeptStep { others: vec![kept("imu-b.csv"), kept("imu-c.csv")], ..kept("imu-a.csv") };
        journal.write(Entry::Kept(unit.clone())).unwrap();
        assert_eq!(Journal::open(&plan).unwrap().1.dropped, []);
        drop_b(&mut journal);
        journal.write(started()).unwrap();
        let (_, history) = Journal::open(&plan).unwrap();
        assert_eq!((history.kept, history.dropped), (vec![unit], vec![("imu-b".to_owned(), "silent".to_owned())]));
        let lines = fs::read_to_string(folder.path().join(JOURNAL)).unwrap();
        assert!(lines.contains(r#""imu":"imu-b","event":"dropped","reason":"silent""#), "{lines}");
        let single = serde_json::to_string(&kept("imu-c.csv")).unwrap();
        assert!(!single.contains("others") && !single.contains("imu\":"), "{single}");
        // The samples of each are checked.
        fs::write(folder.path().join("imu-c.csv"), "imu-x.csv").unwrap();
        let refused = Journal::open(&plan).err().unwrap();
        assert!(refused.exit == Exit::Data && refused.to_string().contains("imu-c.csv: the bytes"), "{refused}");
    }

    #[test]
    fn turns_do_not_change_once_something_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let whole = |change: &dyn Fn(&str) -> String| {
            let text = include_str!("../../../examples/plan-whole.toml").replace("imu-a-campaign", ".");
            Plan::from_toml(&change(&text), folder.path()).unwrap()
        };
        let plan = whole(&str::to_owned);
        let (mut journal, _) = Journal::open(&plan).unwrap();
        fs::write(folder.path().join(SAMPLES), "").unwrap();
        let kept = KeptStep { file: SAMPLES.to_owned(), sha256: sha256(b""), ..KeptStep::default() };
        journal.write_synced(Entry::Kept(kept)).unwrap();
        assert_eq!(Journal::open(&plan).unwrap().1.kept.len(), 1);
        for (from, to, changed) in [
            (
                "[-5, 720]",
                "[-5, 365]",
                "turn.13: was [0.0, 0.0] to [720.0, 0.0] deg, is [0.0, 0.0] to [360.0, 0.0] deg",
            ),
            ("rest_s = 5", "rest_s = 6", "turns.rest_s: was 5.0, is 6.0"),
            ("latitude_deg = 39.9", "latitude_deg = 40", "latitude_deg: was 39.9, is 40.0"),
        ] {
            let refused = Journal::open(&whole(&|text| text.replace(from, to))).err().unwrap().to_string();
            assert!(refused.contains(changed), "{refused}");
        }
        let section = |text: &str| text.find("[turns]").unwrap()..text.find("[chamber]").unwrap();
        let without = whole(&|text| {
            let mut text = text.to_owned();
            text.replace_range(section(&text), "");
            text.replace("latitude_deg", "# latitude_deg")
        });
        let refused = Journal::open(&without).err().unwrap().to_string();
        assert!(refused.contains("turn.18: was [0.0, 720.0] to [0.0, 0.0] deg, is nothing"), "{refused}");
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
        journal.write_synced(Entry::Reached { set_point_c: 5.0 }).unwrap();
        let second = Plan { set_points_c: vec![5.0], ..first.clone() };
        let (mut journal, history) = Journal::open(&second).unwrap();
        assert_eq!(
            (history.reached, Journal::open(&second).unwrap().1.reached),
            (None, None),
            "it was of another plan"
        );
        fs::write(folder.path().join("campaign.csv"), "").unwrap();
        let nothing = sha256(b"");
        let kept = KeptStep { file: "campaign.csv".to_owned(), sha256: nothing, ..KeptStep::default() };
        journal.write_synced(Entry::Kept(kept)).unwrap();
        assert_eq!(Journal::open(&second).unwrap().1.kept.len(), 1);
        let refused = Journal::open(&first).err().unwrap();
        assert_eq!(refused.exit, Exit::Config);
        assert!(refused.to_string().contains("set_points: was [5.0], is [-25.0, -20.0"), "{refused}");
    }
}
