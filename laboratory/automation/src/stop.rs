//! The safe state without a runner, or while one does not answer: what `campaign stop` does where nobody answers.

use super::control::snapshot;
use super::journal::{self, Entry};
use super::plan::Plan;
use super::progress::{self, STATUS, Snapshot};
use super::safe_state::SafeOutcome;
use super::station::Station;
use isotherm_instruments::Surroundings;
use isotherm_support::failure::Failure;
use std::sync::Arc;

/// The reason after a runner that ended without the safe state.
pub const STOPPED_WITHOUT_RUNNER: &str = "requested after its runner had ended without";
/// The reason while a runner does not answer.
pub const STOPPED_BESIDE_RUNNER: &str = "requested while its runner did not answer";
/// The reason in a folder that shows nothing of a runner.
pub const STOPPED_WHATEVER_RUNS: &str = "requested, whatever the campaign's folder has";

/// Brings chamber and turntable into the safe state for this reason, and notes it nowhere. Returns what came of it.
pub fn make_safe_without_note(plan: &Plan, around: Surroundings, reason: &str) -> String {
    ordered(plan, around, reason).0
}

/// What came of the orders, as text and for turntable and chamber.
fn ordered(plan: &Plan, around: Surroundings, reason: &str) -> (String, [SafeOutcome; 2]) {
    let (turntable, chamber) = Station::new(plan, true, around).enter_safe_state();
    (format!("{reason}\nsafe state: {turntable}; {chamber}"), [turntable, chamber])
}

/// Brings chamber and turntable into the safe state for this reason, and notes it. Returns what came of it, and whether
/// both have confirmed it.
///
/// # Errors
/// If it cannot be noted; the message says what came of it, too.
pub fn make_safe(plan: &Plan, around: Surroundings, reason: &str) -> Result<(String, bool), Failure> {
    let time = Arc::clone(&around.time);
    let (text, outcomes) = ordered(plan, around, reason);
    let certain = outcomes.iter().all(SafeOutcome::is_reached);
    // One that cannot be read is replaced.
    let last = snapshot(&plan.output).ok().flatten().unwrap_or_default();
    let last = Snapshot { ended: Some(text.clone()), paused: None, safe: certain, ..last };
    progress::write(&plan.output.join(STATUS), &last);
    let [turntable, chamber] = outcomes.map(|outcome| outcome.to_string());
    let reason = reason.to_owned();
    let entry = Entry::Safe { reason, stopped: true, turntable, chamber, certain };
    let noted = journal::append(&plan.output, entry, time);
    noted.map_err(|failure| Failure::new(failure.exit, format!("{text}\n{failure}")))?;
    Ok((text, certain))
}
