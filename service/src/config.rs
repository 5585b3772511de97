//! The service's configuration, from a file, the command line, or both.

use isotherm_client::transport::stream::RAW_DEPTH;
use isotherm_documents::{LoadError, read_text};
use isotherm_files::Trust;
use isotherm_shared::document::{Document, Faults, Section};
use isotherm_shared::names::ImuId;
use isotherm_shared::table::difference::{Limit, MaxChange};
use std::collections::BTreeSet;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

/// Most IMUs of one service.
pub const MAX_IMUS: usize = 32;

/// How the worker waits for samples.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Strategy {
    /// Never sleeps: lowest latency, uses a whole core.
    Spin,
    /// Sleeps until shortly before the next sample is due, then spins.
    #[default]
    Anticipate,
    /// Sleeps until it is notified: least processor time, but the latency includes a wake-up.
    Block,
}

impl Strategy {
    /// Every strategy with the name that configurations use.
    pub const NAMES: [(Self, &'static str); 3] =
        [(Self::Spin, "spin"), (Self::Anticipate, "anticipate"), (Self::Block, "block")];

    /// The name that configurations use.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(value, _)| *value == self).map_or("", |(_, name)| name)
    }
}

/// What the service does at its start with a table file or a configuration that cannot be used, where one is kept that
/// was in use before.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum AtStart {
    /// It uses what is kept.
    #[default]
    Keep,
    /// It ends.
    Exit,
}

impl AtStart {
    /// Every value with the name that configurations use.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Keep, "keep"), (Self::Exit, "exit")];
}

/// The configuration of one IMU.
#[derive(Clone, Debug, PartialEq)]
pub struct Imu {
    /// Its name.
    pub id: ImuId,
    /// The file of its table, which is watched and reloaded.
    pub table: PathBuf,
    /// Raw samples that may be unanswered at once, 1 to [`RAW_DEPTH`].
    pub depth: usize,
    /// The worker thread that serves it, from 0.
    pub worker: usize,
    /// By how much a new table may differ from the one before.
    pub max_change: MaxChange,
}

impl Imu {
    /// An IMU with the default depth and worker.
    pub const fn new(id: ImuId, table: PathBuf, max_change: MaxChange) -> Self {
        Self { id, table, depth: RAW_DEPTH, worker: 0, max_change }
    }
}

/// A checked configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// One to [`MAX_IMUS`] different IMUs.
    pub imus: Vec<Imu>,
    /// How the worker waits.
    pub strategy: Strategy,
    /// An increment with a longer latency is flagged late \[us\].
    pub budget_us: f64,
    /// Real-time settings of the workers.
    pub realtime: WorkerRealtime,
    /// By how much a new table may differ from the one before, for an IMU without limits of its own.
    pub max_change: MaxChange,
    /// What to do at the start with a table file that cannot be taken.
    pub at_start: AtStart,
}

/// Real-time settings. By default there is no core, no priority and no locked memory, and the timer slack is 1 ns.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct WorkerRealtime {
    /// The core to which each worker is bound; empty if they are not bound.
    pub cores: Vec<usize>,
    /// `SCHED_FIFO` priority of the workers, 1 to 99.
    pub priority: Option<i32>,
    /// Keeps all memory of the process resident.
    pub lock_memory: bool,
    /// How much later than requested the kernel may end a worker's sleep \[ns\].
    pub timer_slack_ns: NonZeroU64,
}

impl Default for WorkerRealtime {
    fn default() -> Self {
        Self { cores: Vec::new(), priority: None, lock_memory: false, timer_slack_ns: NonZeroU64::MIN }
    }
}

/// The default of `latency.budget_us`.
pub const BUDGET_US: f64 = 50.0;

impl Default for Config {
    fn default() -> Self {
        Self {
            imus: Vec::new(),
            strategy: Strategy::default(),
            budget_us: BUDGET_US,
            realtime: WorkerRealtime::default(),
            max_change: MaxChange::default(),
            at_start: AtStart::default(),
        }
    }
}

impl Config {
    /// Reads a configuration file, and returns its text, too. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// Everything that is wrong with the file.
    pub fn load(path: &Path, trust: Trust) -> Result<(Self, String), LoadError> {
        let (text, _) = read_text(path, trust)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let config = Self::from_toml(&text, folder);
        let config = config.map_err(|faults| LoadError::Refused { path: path.to_owned(), faults })?;
        Ok((config, text))
    }

    /// How many worker threads serve the IMUs.
    pub fn workers(&self) -> usize {
        self.imus.iter().map(|imu| imu.worker + 1).max().unwrap_or(0)
    }

    /// Reads the text of a configuration. Paths in it are relative to `folder`.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use isotherm_service::config::Config;
    /// use std::path::Path;
    ///
    /// let text = "[[imu]]\nid = \"imu-a\"\ntable = \"imu-a.toml\"\ndepth = 65\n";
    /// let faults = Config::from_toml(text, Path::new(".")).err().ok_or("at most 64 samples may be unanswered")?;
    /// assert_eq!(faults.0[0].line, 4);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, Faults> {
        let document = Document::parse_as(text, "give the service configuration")?;
        let root = document.root();
        let config = read(&root, folder);
        root.finish();
        document.finish(Some(config))
    }
}

fn cores_fault(config: &Config) -> Option<String> {
    let (cores, workers) = (&config.realtime.cores, config.workers());
    let distinct: BTreeSet<_> = cores.iter().collect();
    if !cores.is_empty() && cores.len() != workers {
        Some(format!("has {} cores for {workers} workers; give one for each, as in [1, 2]", cores.len()))
    } else if distinct.len() < cores.len() {
        Some("names a core twice; give every worker one of its own".to_owned())
    } else {
        None
    }
}

/// The limits of `max_change` in a section; those that are not given are as in `others`, if they are given there.
fn max_change(section: &Section<'_, '_>, others: MaxChange) -> MaxChange {
    let mut limits = others;
    let Some(given) = section.optional_section("max_change") else { return limits };
    let all = [
        (Limit::Bias, &mut limits.bias),
        (Limit::Scale, &mut limits.scale),
        (Limit::Rate, &mut limits.rate),
        (Limit::Alignment, &mut limits.alignment),
    ];
    for (limit, value) in all {
        let bound = limit.bound();
        let read = given.optional_string(bound.name).map(|text| bound.parse(text, "give a number with a unit"));
        match read {
            Some(Ok(number)) => *value = Some(number),
            Some(Err(fault)) => given.fault(bound.name, fault),
            None => {}
        }
    }
    given.finish();
    limits
}

fn read(root: &Section<'_, '_>, folder: &Path) -> Config {
    let mut config = Config::default();
    if let Some(reload) = root.optional_section("reload") {
        config.max_change = max_change(&reload, config.max_change);
        config.at_start = reload.optional_choice("at_start", &AtStart::NAMES).unwrap_or_default();
        reload.finish();
    }
    if let Some(domain) = root.optional_section("domain") {
        domain.fault(
            "group",
            "does not exist any more, since a member could reach the files of every other one: remove [domain], and run all \
             programs of the domain as one user (docs/security.md)",
        );
    }
    config.imus = imus(root, folder, config.max_change);
    let idle = (0..config.workers()).find(|worker| config.imus.iter().all(|imu| imu.worker != *worker));
    root.refuse("imu", idle.map(|idle| format!("worker {idle} has none; number the workers from 0 without holes")));
    if let Some(wait) = root.optional_section("wait") {
        config.strategy = wait.optional_choice("strategy", &Strategy::NAMES).unwrap_or_default();
        wait.finish();
    }
    if let Some(latency) = root.optional_section("latency") {
        if let Some(budget) = latency.optional_number("budget_us") {
            if !(budget > 0.0 && budget <= 1e6) {
                latency.fault("budget_us", format!("is {budget:?}, give microseconds over 0 and up to 1000000"));
            }
            config.budget_us = budget;
        }
        latency.finish();
    }
    if let Some(section) = root.optional_section("realtime") {
        config.realtime = realtime(&section);
        section.refuse("core", cores_fault(&config));
        section.finish();
    }
    if let Some(metrics) = root.optional_section("metrics") {
        let address = metrics.optional_string("listen").unwrap_or("ADDRESS");
        metrics.fault(
            "listen",
            format!(
                "is a setting of the exporter now: remove [metrics], and start `isotherm-exporter --listen {address}` (unit \
                 isotherm-exporter.service)"
            ),
        );
    }
    config
}

fn imus(root: &Section<'_, '_>, folder: &Path, changes: MaxChange) -> Vec<Imu> {
    let sections = root.list("imu");
    if sections.is_empty() || sections.len() > MAX_IMUS {
        root.fault(
            "imu",
            format!("{} of them; give one to {MAX_IMUS} [[imu]], each with id and table", sections.len()),
        );
    }
    let (mut imus, mut known) = (Vec::new(), BTreeSet::new());
    for section in sections {
        let id = section.imu_id("id");
        let table = section.string("table", "the path of the IMU's coefficient table");
        section.refuse("table", table.filter(|table| table.is_empty()).map(|_| "is empty, give a path".to_owned()));
        if let Some(id) = &id
            && !known.insert(id.clone())
        {
            section.fault("id", format!("{id} is there twice; give every IMU once"));
        }
        let depth = section.optional_integer("depth", 1..=RAW_DEPTH as i64).map_or(RAW_DEPTH, |depth| depth as usize);
        let worker = section.optional_integer("worker", 0..=MAX_IMUS as i64 - 1).map_or(0, |worker| worker as usize);
        let max_change = max_change(&section, changes);
        section.finish();
        imus.extend(id.zip(table).map(|(id, table)| Imu { id, table: folder.join(table), depth, worker, max_change }));
    }
    imus
}

fn realtime(section: &Section<'_, '_>) -> WorkerRealtime {
    let cores = section.optional_integers("core", 0..=1023).unwrap_or_default();
    let slack = section.optional_integer("timer_slack_ns", 1..=1_000_000_000);
    WorkerRealtime {
        cores: cores.into_iter().map(|core| core as usize).collect(),
        priority: section.optional_integer("priority", 1..=99).map(|priority| priority as i32),
        lock_memory: section.optional_bool("lock_memory").unwrap_or_default(),
        timer_slack_ns: slack.and_then(|slack| NonZeroU64::new(slack as u64)).unwrap_or(NonZeroU64::MIN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_every_key() {
        let text = r#"
            [[imu]]
            id = "imu-a"
            table = "tables/imu-a.toml"
            [[imu]]
            id = "imu-b"
            table = "/absolute.toml"
            depth = 2
            worker = 1
            max_change = { scale = "2%", rate = "5deg/h" }
            [reload]
            max_change = { bias = "20mg0", scale = "1000 ppm", alignment = "1mrad" }
            at_start = "exit"
            [wait]
            strategy = "block"
            [latency]
            budget_us = 25
            [realtime]
            core = [1, 3]
            priority = 60
            lock_memory = true
            timer_slack_ns = 1000
        "#;
        let config = Config::from_toml(text, Path::new("/etc/isotherm")).unwrap();
        assert_eq!(config.imus[0].table, Path::new("/etc/isotherm/tables/imu-a.toml"));
        assert_eq!(config.imus[1].table, Path::new("/absolute.toml"));
        assert_eq!((config.strategy, config.budget_us), (Strategy::Block, 25.0));
        assert_eq!((config.imus[0].depth, config.imus[0].worker), (RAW_DEPTH, 0));
        assert_eq!((config.imus[1].depth, config.imus[1].worker, config.workers()), (2, 1, 2));
        let timer_slack_ns = NonZeroU64::new(1000).unwrap();
        let cores = vec![1, 3];
        assert_eq!(config.realtime, WorkerRealtime { cores, priority: Some(60), lock_memory: true, timer_slack_ns });
        assert_eq!(config.at_start, AtStart::Exit);
        let all = MaxChange { bias: Some(20.0 * 1e-3), scale: Some(1000.0 * 1e-6), rate: None, alignment: Some(1e-3) };
        assert_eq!([config.imus[0].max_change, config.max_change], [all; 2]);
        assert_eq!(config.imus[1].max_change, MaxChange { scale: Some(2.0 * 1e-2), rate: Some(5.0), ..all });
    }

    #[test]
    fn every_key_except_the_imus_has_a_default() {
        let config = Config::from_toml("[[imu]]\nid = \"a\"\ntable = \"a.toml\"\n", Path::new("")).unwrap();
        assert_eq!(config, Config { imus: config.imus.clone(), ..Config::default() });
    }

    #[test]
    fn workers_and_their_cores_must_fit() {
        let faults = |imus: &[usize], core: &str| {
            let imus =
                imus.iter().enumerate().map(|(k, n)| format!("[[imu]]\nid = \"i{k}\"\ntable = \"t\"\nworker = {n}\n"));
            let text = imus.collect::<String>() + &format!("[realtime]\ncore = {core}\n");
            let faults = Config::from_toml(&text, Path::new("")).err().map(|faults| faults.to_string());
            faults.unwrap_or_default()
        };
        assert_eq!(faults(&[0], "3"), "");
        assert_eq!(faults(&[1, 0, 1], "[3, 0]"), "");
        assert!(faults(&[0, 2], "[1, 2, 3]").contains("worker 1 has none"));
        assert!(faults(&[0, 1], "1").contains("1 cores for 2 workers"));
        assert!(faults(&[0, 1], "[1, 1]").contains("names a core twice"));
        assert!(faults(&[0], "[1, \"x\"]").contains("or a list of them"));
    }

    #[test]
    fn reports_everything_at_once() {
        let text = "[[imu]]\nid = \"A\"\n[[imu]]\nid = \"b\"\ntable = 1\n[[imu]]\nid = \"b\"\ntable = \"x\"\n\
                    [wait]\nstrategy = \"sleep\"\n[latency]\nbudget_us = 0\nbudget = 1\n\
                    [realtime]\ncore = -1\npriority = 100\nlock_memory = 1\n[metrics]\nlisten = \"x\"\n[metrix]\n\
                    [reload]\nmax_change = { bias = \"100\", scale = 0.1, rates = \"1deg/s\" }\nat_start = \"go\"\n\
                    [domain]\ngroup = \"imu\"\n";
        let faults = Config::from_toml(text, Path::new("")).unwrap_err();
        let found: Vec<_> = faults.0.iter().map(|fault| (fault.line, fault.key.as_str())).collect();
        let expected = [
            (1, "imu.1.table"),
            (2, "imu.1.id"),
            (5, "imu.2.table"),
            (7, "imu.3.id"),
            (10, "wait.strategy"),
            (12, "latency.budget_us"),
            (13, "latency.budget"),
            (15, "realtime.core"),
            (16, "realtime.priority"),
            (17, "realtime.lock_memory"),
            (19, "metrics.listen"),
            (20, "metrix"),
            (22, "reload.max_change.bias"),
            (22, "reload.max_change.scale"),
            (22, "reload.max_change.rates"),
            (23, "reload.at_start"),
            (25, "domain.group"),
        ];
        assert_eq!(found, expected);
        assert_eq!(Config::from_toml("", Path::new("")).unwrap_err().0.len(), 1);
    }
}
