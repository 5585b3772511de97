//! A campaign in a folder of its own, with as many runners as it takes.

use crate::faults::{FaultPlan, SeededRandom};
use crate::script::ScriptStep;
use crate::setup::Setup;
use crate::world::VirtualWorld;
use isotherm_automation::journal::{Entry, JOURNAL, Journal, JournalLine};
use isotherm_automation::plan::Plan;
use isotherm_automation::runner::Runner;
use isotherm_automation::{journal, stop};
use isotherm_instruments::Surroundings;
use isotherm_simulation::Truth;
use isotherm_support::failure::{Exit, Failure};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use std::{fs, io};
use tempfile::TempDir;

/// Time between two runners \[s\]: the turntable comes back from anywhere meanwhile.
const BETWEEN_S: f64 = 60.0;
/// Most runners of a campaign.
const MOST_RUNNERS: usize = 40;
/// How often status file and live page are written, in addition to each change of the phase: nobody watches.
const SHOWN: Duration = Duration::from_secs(600);

/// A campaign in a folder of its own.
pub struct Campaign {
    folder: TempDir,
    /// Its plan.
    pub plan: Plan,
    /// The world that it runs in.
    pub world: VirtualWorld,
    /// What is true of each IMU.
    pub truths: Vec<Truth>,
}

/// How a runner has ended.
#[derive(Clone, Debug)]
pub struct CampaignEnd {
    /// When it began, and when it ended \[s\].
    pub times_s: [f64; 2],
    /// Its message; `None` if all is complete.
    pub failure: Option<String>,
    /// Its exit code, if it has failed and was not killed.
    pub exit: Option<Exit>,
    /// Whether it was killed.
    pub is_killed: bool,
}

impl Campaign {
    /// The campaign of a set-up.
    ///
    /// # Panics
    /// If the set-up has no valid plan, or no folder can be made.
    #[must_use]
    pub fn new(setup: &Setup) -> Self {
        // Nothing of it has to last, and what is synced takes no time there.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let folder = folder.unwrap_or_else(|error| panic!("a temporary folder: {error}"));
        let (station, truths) = (setup.station(), setup.truths());
        let plan = setup.plan(&station, &truths, folder.path());
        fs::create_dir(&plan.output).unwrap_or_else(|error| panic!("a folder for the campaign: {error}"));
        let world = VirtualWorld::new(&station, &truths, setup.faults.clone(), &plan.output);
        let campaign = Self { folder, plan, world, truths };
        campaign.then(setup.steps.clone());
        campaign
    }

    /// The shipped plan, made short, with these faults.
    #[must_use]
    pub fn short(seed: u64, faults: FaultPlan) -> Self {
        Self::new(&Setup::short(seed, faults))
    }

    /// What happens from now on, in this order, in place of what has not happened yet.
    pub fn then(&self, steps: Vec<ScriptStep>) {
        self.world.script(steps);
    }

    /// Starts runners until one completes the campaign.
    #[must_use]
    pub fn run(&self) -> Vec<CampaignEnd> {
        let mut all = Vec::new();
        while all.len() < MOST_RUNNERS && all.last().is_none_or(|ended: &CampaignEnd| ended.failure.is_some()) {
            if let Some(ended) = all.last() {
                let is_beyond = |message: &String| message.contains("is outside limits.outer_deg");
                if ended.failure.as_ref().is_some_and(is_beyond) {
                    self.world.bring_back();
                }
                self.world.wait(BETWEEN_S);
            }
            all.push(self.run_once());
        }
        all
    }

    /// Starts a runner, and returns when it has ended.
    ///
    /// # Panics
    /// If the folder of a runner that was killed cannot be restored.
    #[must_use]
    pub fn run_once(&self) -> CampaignEnd {
        let around = self.world.surroundings();
        let (output, copy) = (self.plan.output.clone(), self.folder.path().join("killed"));
        let kept = copy.clone();
        self.world.at_kill(move || copy_folder(&output, &kept));
        let begun_s = self.world.now_s();
        let result = self.start(around);
        let is_killed = self.world.is_killed();
        if is_killed {
            // What it has done since then did not happen.
            let restored = copy_folder(&copy, &self.plan.output).and_then(|()| fs::remove_dir_all(&copy));
            restored.unwrap_or_else(|error| panic!("restoring the folder: {error}"));
            if self.world.is_power_lost() {
                let torn = tear(&self.plan.output, &mut SeededRandom((1e3 * self.world.now_s()) as u64));
                torn.unwrap_or_else(|error| panic!("tearing the folder: {error}"));
            }
        }
        let failure = if is_killed { None } else { result.err() };
        let exit = failure.as_ref().map(|failure| failure.exit);
        let failure = if is_killed { Some("killed".to_owned()) } else { failure.map(|failure| failure.message) };
        CampaignEnd { times_s: [begun_s, self.world.now_s()], failure, exit, is_killed }
    }

    fn start(&self, around: Surroundings) -> Result<(), Failure> {
        let (journal, history) = Journal::open_with(&self.plan, Arc::clone(&around.time))?;
        self.plan.write_campaign_file()?;
        Runner::new(&self.plan, (journal, &history), &self.world, 1.0, around)?.with_period(SHOWN).run()
    }

    /// What `campaign stop` does without a runner. Returns what it says, and whether the safe state is certain.
    ///
    /// # Errors
    /// If it cannot be journalled.
    pub fn stop(&self) -> Result<(String, bool), Failure> {
        stop::make_safe(&self.plan, self.world.surroundings(), stop::STOPPED_WITHOUT_RUNNER)
    }

    /// A file of the campaign's folder; empty if it is not there.
    #[must_use]
    pub fn file(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_default()
    }

    /// The path of a file of the campaign's folder.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.plan.output.join(name)
    }

    /// The lines of the journal.
    #[must_use]
    pub fn journal(&self) -> Vec<JournalLine> {
        journal::read(&self.path(JOURNAL)).unwrap_or_default().0
    }
}

/// Makes `to` a copy of the files of `from`, and of nothing else.
fn copy_folder(from: &Path, to: &Path) -> io::Result<()> {
    if to.exists() {
        for entry in fs::read_dir(to)? {
            fs::remove_file(entry?.path())?;
        }
    } else {
        fs::create_dir(to)?;
    }
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        fs::copy(entry.path(), to.join(entry.file_name()))?;
    }
    Ok(())
}

/// What a loss of power leaves of a folder: all that was synced, and any part of what was written after that. Files
/// that are only renamed may be as they were, empty or away.
fn tear(folder: &Path, random: &mut SeededRandom) -> io::Result<()> {
    let journal = fs::read_to_string(folder.join(JOURNAL)).unwrap_or_default();
    let lines = journal.split_inclusive('\n').filter_map(|line| {
        let read: JournalLine = serde_json::from_str(line).ok()?;
        Some((read, line.len() as u64))
    });
    let (mut end, mut synced, mut kept_to) = (0, 0, BTreeMap::from([(JOURNAL.to_owned(), 0)]));
    for (line, length) in lines {
        end += length;
        match &line.entry {
            Entry::Kept(kept) => {
                kept_to.extend(kept.each().map(|kept| (kept.file.clone(), kept.to)));
                synced = end;
            }
            Entry::Begin { .. } | Entry::Started { .. } | Entry::Safe { .. } | Entry::Dropped { .. } => synced = end,
            _ => {}
        }
    }
    kept_to.insert(JOURNAL.to_owned(), synced);
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let file = fs::File::options().write(true).open(entry.path())?;
        let (length, kept) = (file.metadata()?.len(), kept_to.get(&name).copied().unwrap_or_default());
        if name == JOURNAL || name.ends_with(".csv") {
            file.set_len(kept + ((length - kept) as f64 * random.uniform()) as u64)?;
        } else if name != "campaign.toml" {
            match (3.0 * random.uniform()) as u8 {
                0 => fs::remove_file(entry.path())?,
                1 => file.set_len(0)?,
                _ => {}
            }
        }
    }
    Ok(())
}
