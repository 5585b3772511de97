//! Whether a plan gives the data that a journal has begun.

use super::entry::{Entry, FORMAT, JournalLine, KeptStep};
use crate::plan::{Plan, RAMP_FILE, RAMP_KEY, RUN_FILE, RUN_KEY};
use isotherm_support::failure::{Exit, Failure, shown};
use std::path::Path;

/// Checks that `plan` gives the same data as the plan in the last [`Entry::Begin`] of `lines`, of which these units are
/// kept. Returns whether it is the same plan: verification runs that are not taken yet may differ, and so may ramps
/// before the first run.
pub(super) fn check_same_plan(
    path: &Path,
    lines: &[JournalLine],
    plan: &Plan,
    kept: &[KeptStep],
) -> Result<bool, Failure> {
    let runs = kept.iter().filter(|kept| kept.file.starts_with(RUN_FILE)).count();
    let ramps = kept.iter().filter(|kept| kept.file.starts_with(RAMP_FILE)).count();
    let refuse = |message: String| Err(Failure::new(Exit::Config, format!("{}: {message}", shown(path))));
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
    keys.retain(|key| value(before, key) != value(&now, key));
    let same = keys.is_empty();
    let number = |key: &str, begin: &str| key.strip_prefix(begin).and_then(|number| number.parse::<usize>().ok());
    let to_come = |key: &str| {
        number(key, RUN_KEY).is_some_and(|run| run > runs)
            || runs == 0 && number(key, RAMP_KEY).is_some_and(|ramp| ramp > ramps)
    };
    keys.retain(|key| !to_come(key));
    if keys.is_empty() {
        return Ok(same);
    }
    let different: Vec<_> =
        keys.iter().map(|key| format!("{key}: was {}, is {}", value(before, key), value(&now, key))).collect();
    refuse(format!(
        "the plan has changed since this campaign began; change it back, or give another output folder\n{}",
        different.join("\n")
    ))
}
