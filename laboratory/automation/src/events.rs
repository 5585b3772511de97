//! What the live page shows of a campaign's course: every start, pause, resumption, repetition and end, and what became
//! of fit, verification and installation, from the journal.

use super::journal::{Entry, JournalLine};
use super::plan::Plan;
use super::step::CampaignStep;
use super::timeline::{duration, units};
use isotherm_support::failure::shown;

use isotherm_report::NoteKind;

/// An event as the live page shows it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PageEvent {
    /// Unix time \[s\].
    pub unix_s: f64,
    /// Whether the operator should care.
    pub kind: NoteKind,
    /// What has happened, in one or two words.
    pub name: &'static str,
    /// The cause, or what belongs to it.
    pub text: String,
    /// Whether readings may be missing before or after it.
    pub interrupts: bool,
    /// Whether it belongs to the readings. What follows them may come days later, and has no place in their curves.
    pub marked: bool,
}

/// The events of a journal so far.
#[derive(Debug, Default)]
pub(crate) struct PageEvents {
    /// Number of complete units.
    kept: usize,
    running: bool,
    all: Vec<PageEvent>,
}

impl PageEvents {
    /// All of them, oldest first.
    pub(crate) fn all(&self) -> &[PageEvent] {
        &self.all
    }

    /// Adds those of the next line of the journal of `plan`.
    pub(crate) fn add(&mut self, plan: &Plan, line: &JournalLine) {
        let of_course = self.course(plan, &line.entry);
        let marked = of_course.is_some();
        let headlines = of_course.map_or_else(|| outcome(&line.entry), |headline| vec![headline]);
        let interrupts = matches!(line.entry, Entry::Started { .. } | Entry::Paused { .. });
        for Headline { kind, name, text } in headlines {
            let text = text.replace('\n', "; ");
            let text = line.imu.as_ref().map_or_else(|| text.clone(), |imu| format!("{imu}: {text}"));
            self.all.push(PageEvent { unix_s: line.at.unix_s, kind, name, text, interrupts, marked });
        }
    }

    /// An event of the data's course: the runner's starts and ends, and what it waits for, repeats or drops.
    fn course(&mut self, plan: &Plan, entry: &Entry) -> Option<Headline> {
        let step = CampaignStep::of(plan, self.kept);
        let place = step.map_or_else(|| "all units are complete".to_owned(), |step| step.name(plan));
        Some(match entry {
            Entry::Started { .. } => match std::mem::replace(&mut self.running, true) {
                true => {
                    let text = format!("{place}; the runner before ended without the safe state");
                    Headline::new(NoteKind::Warning, "start", text)
                }
                false => Headline::new(NoteKind::Good, "start", place),
            },
            Entry::Kept(_) => {
                self.kept += 1;
                return None;
            }
            Entry::Discarded { reason } => {
                let name = match step {
                    Some(CampaignStep::Run(_)) => "repeated run",
                    Some(CampaignStep::Ramp(_)) => "repeated ramp",
                    Some(CampaignStep::Turn { .. }) => "repeated turn",
                    Some(CampaignStep::Dwell { .. }) | None => "repeated dwell",
                };
                Headline::new(NoteKind::Warning, name, format!("{place}: {reason}"))
            }
            Entry::Dropped { reason } => Headline::new(NoteKind::Bad, "dropped", reason),
            Entry::Paused { cause } => Headline::new(NoteKind::Warning, "pause", format!("{place}: {cause}")),
            Entry::Resumed { after_s } => {
                Headline::new(NoteKind::Good, "resume", format!("{place}, after {}", duration(*after_s)))
            }
            Entry::Safe { reason, stopped, turntable, chamber, certain } => {
                self.running = false;
                let (kind, name) = match stopped {
                    _ if self.kept == units(plan) => (NoteKind::Good, "end"),
                    true => (NoteKind::Warning, "stop"),
                    false => (NoteKind::Bad, "alarm or fault"),
                };
                let kind = if *certain { kind } else { NoteKind::Bad };
                Headline::new(kind, name, format!("{reason}; {turntable}; {chamber}"))
            }
            _ => return None,
        })
    }
}

/// What an event says.
struct Headline {
    kind: NoteKind,
    name: &'static str,
    text: String,
}

impl Headline {
    fn new(kind: NoteKind, name: &'static str, text: impl Into<String>) -> Self {
        Self { kind, name, text: text.into() }
    }
}

/// The events of fit, verification and installation: one for each reason of a refusal.
fn outcome(entry: &Entry) -> Vec<Headline> {
    let each = |kind, name, reasons: &str| reasons.lines().map(|reason| Headline::new(kind, name, reason)).collect();
    match entry {
        Entry::Calibrated { digest, accuracy } => {
            let accuracy = if accuracy.is_empty() { String::new() } else { format!("; {accuracy}") };
            vec![Headline::new(NoteKind::Good, "fit", format!("{digest}{accuracy}"))]
        }
        Entry::NotCalibrated { reason } => vec![Headline::new(NoteKind::Bad, "no fit", reason)],
        Entry::Verified { run, largest, refused, .. } => {
            let largest = largest.as_ref().map_or_else(String::new, |largest| format!(": largest error {largest}"));
            match refused {
                None => vec![Headline::new(NoteKind::Good, "verified", format!("{run}{largest}"))],
                Some(causes) => {
                    let causes = causes.replace('\n', &format!("\n{run}; "));
                    each(NoteKind::Bad, "refused", &format!("{run}{largest}; {causes}"))
                }
            }
        }
        Entry::NotJudged { reasons } => each(NoteKind::Warning, "not judged", &reasons.join("\n")),
        Entry::NotInstalled { reason } => each(NoteKind::Warning, "not installed", reason),
        Entry::Installed { digest, file } => {
            vec![Headline::new(NoteKind::Good, "installed", format!("{digest} as {}", shown(file)))]
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::journal::{KeptStep, LargestError};
    use super::super::stamp::Stamp;
    use super::*;
    use std::path::Path;

    fn events(plan: &Plan, lines: &[JournalLine]) -> Vec<PageEvent> {
        let mut events = PageEvents::default();
        lines.iter().for_each(|line| events.add(plan, line));
        events.all
    }

    fn plan() -> Plan {
        Plan::from_toml(include_str!("../../../examples/plan.toml"), Path::new("/")).unwrap()
    }

    fn safe(reason: &str, stopped: bool, certain: bool) -> Entry {
        let [turntable, chamber] = ["turntable stopped", "chamber in standby"].map(String::from);
        Entry::Safe { reason: reason.to_owned(), stopped, turntable, chamber, certain }
    }

    #[test]
    fn every_interruption_is_an_event_with_its_place_and_cause() {
        let plan = plan();
        let kept = || Entry::Kept(KeptStep::default());
        let started = || Entry::Started { pid: 7, speed: 1.0, unit: 0 };
        let mut entries = vec![
            started(),
            Entry::Connected { chamber: "c".to_owned(), turntable: "t".to_owned() },
            Entry::Reached { set_point_c: -25.0 },
            kept(),
            Entry::Paused { cause: "the turntable is\nnot connected".to_owned() },
            Entry::Resumed { after_s: 120.0 },
            Entry::Discarded { reason: "a gap".to_owned() },
            safe("SIGTERM, as by campaign stop", true, true),
            started(),
            started(),
            safe("requested", true, true),
            safe("the chamber has an alarm: high temperature", false, true),
            safe("SIGTERM", true, false),
            // The words do not count.
            safe("stopped by the chamber", false, true),
        ];
        entries.extend((1..units(&plan)).map(|_| kept()));
        entries.push(safe("all data are taken", false, true));
        let lines: Vec<_> = (0_u32..)
            .zip(entries)
            .map(|(n, entry)| JournalLine { at: Stamp { unix_s: n.into(), up: None }, imu: None, entry })
            .collect();
        let events = events(&plan, &lines);
        let found: Vec<_> = events.iter().map(|event| (event.unix_s, event.kind, event.name)).collect();
        let (good, warning, bad) = (NoteKind::Good, NoteKind::Warning, NoteKind::Bad);
        let last = f64::from(u32::try_from(lines.len()).unwrap() - 1);
        assert_eq!(
            found,
            [
                (0.0, good, "start"),
                (4.0, warning, "pause"),
                (5.0, good, "resume"),
                (6.0, warning, "repeated dwell"),
                (7.0, warning, "stop"),
                (8.0, good, "start"),
                (9.0, warning, "start"),
                (10.0, warning, "stop"),
                (11.0, bad, "alarm or fault"),
                (12.0, bad, "stop"),
                (13.0, bad, "alarm or fault"),
                (last, good, "end"),
            ]
        );
        let place = CampaignStep::of(&plan, 1).unwrap().name(&plan);
        assert_eq!(events[1].text, format!("{place}: the turntable is; not connected"));
        assert_eq!(events[2].text, format!("{place}, after 2 min"));
        assert_eq!(events[3].text, format!("{place}: a gap"));
        assert!(events[6].text.ends_with("; the runner before ended without the safe state"), "{}", events[6].text);
        assert!(events[8].text.starts_with("the chamber has an alarm: high temperature; "), "{}", events[8].text);
        assert!(events.iter().all(|event| event.marked));
    }

    #[test]
    fn a_repeated_turn_is_an_event_of_its_own_name() {
        let plan = Plan::from_toml(include_str!("../../../examples/plan-whole.toml"), Path::new("/")).unwrap();
        let kept = (0..12).map(|_| Entry::Kept(KeptStep::default()));
        let discarded = Entry::Discarded { reason: "samples are missing".to_owned() };
        let lines: Vec<_> = kept
            .chain([discarded])
            .map(|entry| JournalLine { at: Stamp { unix_s: 1.0, up: None }, imu: None, entry })
            .collect();
        let events = events(&plan, &lines);
        assert_eq!(
            (events.len(), events[0].name, events[0].text.as_str()),
            (1, "repeated turn", "-25 degC, turn 13 (outer 0 to 720 deg): samples are missing")
        );
    }

    #[test]
    fn fit_verification_and_installation_are_events_without_a_place_in_the_curves() {
        let run = || "verify-1.csv".to_owned();
        let largest = LargestError { of: "A2".to_owned(), error_g0: 3e-6, interval_g0: 1e-7 };
        let reason = || "one\ntwo".to_owned();
        let entries = [
            Entry::FitBegun,
            Entry::Calibrated { digest: "sha256:1".to_owned(), accuracy: "bias +- 1 ug0".to_owned() },
            Entry::Verified { run: run(), angles_deg: None, largest: Some(largest), refused: None },
            Entry::Verified { run: run(), angles_deg: None, largest: None, refused: Some("bias\nscale".to_owned()) },
            Entry::NotJudged { reasons: vec!["K- of A1".to_owned(), "K+ of A2".to_owned()] },
            Entry::NotInstalled { reason: reason() },
            Entry::NotCalibrated { reason: reason() },
            Entry::Installed { digest: "sha256:1".to_owned(), file: "imu-a.toml".into() },
        ];
        let lines: Vec<_> = entries
            .into_iter()
            .map(|entry| JournalLine { at: Stamp { unix_s: 1.0, up: None }, imu: None, entry })
            .collect();
        let events = events(&plan(), &lines);
        assert!(events.iter().all(|event| !event.marked && !event.interrupts));
        let found: Vec<_> = events.iter().map(|event| (event.kind, event.name, event.text.as_str())).collect();
        assert_eq!(
            found,
            [
                (NoteKind::Good, "fit", "sha256:1; bias +- 1 ug0"),
                (NoteKind::Good, "verified", "verify-1.csv: largest error A2 3.000 +- 0.100e-6 g0"),
                (NoteKind::Bad, "refused", "verify-1.csv; bias"),
                (NoteKind::Bad, "refused", "verify-1.csv; scale"),
                (NoteKind::Warning, "not judged", "K- of A1"),
                (NoteKind::Warning, "not judged", "K+ of A2"),
                (NoteKind::Warning, "not installed", "one"),
                (NoteKind::Warning, "not installed", "two"),
                (NoteKind::Bad, "no fit", "one; two"),
                (NoteKind::Good, "installed", "sha256:1 as imu-a.toml"),
            ]
        );
    }
}
