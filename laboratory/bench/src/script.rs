//! What happens one after the other: each step when the campaign has come so far.

use crate::faults::DrawnFault;
use isotherm_automation::journal::JOURNAL;
use isotherm_automation::progress::STATUS;
use isotherm_instruments::Moment;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How often the campaign is looked at.
pub(crate) const LOOKED_AT: Duration = Duration::from_millis(250);

/// How far the campaign must have come.
#[derive(Clone, Debug, PartialEq)]
pub enum Trigger {
    /// The journal has so many of this event since the begin.
    Journal(&'static str, usize),
    /// The runner is in this phase, after so many devices.
    Phase(&'static str, usize),
    /// So much time has passed since the step before \[s\].
    After(f64),
}

/// What happens.
#[derive(Clone, Debug)]
pub enum ScriptAction {
    /// These faults are there from now on, in place of those before.
    Faults(Vec<DrawnFault>),
    /// A signal with this number.
    Signal(usize),
    /// SIGKILL.
    Kill,
    /// The acquisition starts again: another session.
    Restart,
    /// Somebody gives an order to the chamber at its panel, as these bytes.
    OrderChamber(Vec<u8>),
    /// The time of day is set forward by this \[s\].
    SetClock(f64),
    /// Something in the campaign's folder.
    Call(fn(&Path)),
    /// Nothing but that the time is noted.
    Note,
}

/// A step.
#[derive(Clone, Debug)]
pub struct ScriptStep(pub Trigger, pub ScriptAction);

/// The steps that are to come, and what they look at.
pub(crate) struct Script {
    steps: VecDeque<ScriptStep>,
    pub folder: PathBuf,
    /// So much of the journal is counted \[bytes\].
    read: u64,
    counts: BTreeMap<String, usize>,
    /// When the step before was done.
    before: Moment,
    looked: Moment,
    /// When each step was done.
    pub done: Vec<Moment>,
}

impl Script {
    pub(crate) fn new(folder: &Path, now: Moment) -> Self {
        Self {
            steps: VecDeque::new(),
            folder: folder.to_owned(),
            read: 0,
            counts: BTreeMap::new(),
            before: now,
            looked: now,
            done: Vec::new(),
        }
    }

    /// Does these from now on.
    pub(crate) fn set(&mut self, steps: Vec<ScriptStep>, now: Moment) {
        self.steps = steps.into();
        self.before = now;
    }

    /// When it is to be looked at next; `None` if nothing is to come.
    pub(crate) fn next_look(&self) -> Option<Moment> {
        (!self.steps.is_empty()).then(|| self.looked + LOOKED_AT)
    }

    /// What happens now.
    pub(crate) fn due(&mut self, now: Moment) -> Option<ScriptAction> {
        self.looked = now;
        let ScriptStep(when, _) = self.steps.front()?;
        let has_come = match when.clone() {
            Trigger::After(seconds) => now.since(self.before).as_secs_f64() >= seconds,
            Trigger::Journal(event, count) => self.count(event) >= count,
            Trigger::Phase(phase, units) => {
                let status = std::fs::read_to_string(self.folder.join(STATUS)).unwrap_or_default();
                let value = |key: &str| {
                    let begin = status.find(&format!("\n  \"{key}\": "))?;
                    let value = status[begin..].split_once(": ")?.1.lines().next()?;
                    Some(value.trim_end_matches(',').trim_matches('"').to_owned())
                };
                value("phase").as_deref() == Some(phase) && value("unit") == Some(units.to_string())
            }
        };
        if !has_come {
            return None;
        }
        self.before = now;
        self.done.push(now);
        self.steps.pop_front().map(|ScriptStep(_, act)| act)
    }

    /// How many lines of the journal have this event.
    fn count(&mut self, event: &str) -> usize {
        let path = self.folder.join(JOURNAL);
        let length = path.metadata().map_or(0, |file| file.len());
        if length < self.read {
            // It was restored.
            (self.read, self.counts) = (0, BTreeMap::new());
        }
        if length > self.read {
            let mut new = String::new();
            let read = File::open(&path).and_then(|mut file| {
                file.seek(SeekFrom::Start(self.read))?;
                file.read_to_string(&mut new)
            });
            self.read += read.unwrap_or_default() as u64;
            for line in new.lines() {
                let name = line.split_once("\"event\":\"").and_then(|(_, rest)| rest.split('"').next());
                *self.counts.entry(name.unwrap_or_default().to_owned()).or_default() += 1;
            }
        }
        self.counts.get(event).copied().unwrap_or_default()
    }
}
