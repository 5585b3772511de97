//! The verification of a fitted table by every run.

use super::fitted_table::{FittedTable, print_message};
use crate::journal::{Entry, Journal, LargestError};
use crate::plan::{Plan, VerificationPlan};
use crate::runner::stopped_by;
use isotherm_campaign::Position;
use isotherm_files::{StagedText, print};
use isotherm_fit::{Calibration, tool};
use isotherm_pipeline::{VerificationRun, no_bar, now};
use isotherm_recording_formats::read::ImuChoice;
use isotherm_report as report;
use isotherm_report::verification::VerificationSource;
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure};
use isotherm_support::finding::name;
use isotherm_verification::{
    EarthRate, Estimate, ExercisedChannels, GATE_FLOOR, Gate, GateRefusal, LocalGravity, Requirement, Setup, Stability,
};
use std::path::Path;
use std::sync::atomic::AtomicUsize;

/// Length of the windows of the stability \[s\].
const WINDOW_S: f64 = 10.0;

/// Why the table is not installed.
pub(super) struct InstallationRefusal {
    /// For the operator, with every reason.
    pub(super) failure: Failure,
    /// For the journal, which has the reasons of each run already.
    pub(super) reason: String,
    /// Where to look, for the last line.
    pub(super) remedy: String,
}

impl From<Failure> for InstallationRefusal {
    fn from(failure: Failure) -> Self {
        Self { reason: failure.to_string(), failure, remedy: String::new() }
    }
}

/// What a verification run shows.
struct RunVerdict {
    /// The largest error; `None` if it shows none.
    largest: Option<LargestError>,
    /// Why the table must not be installed, one reason a line; `None` if nothing speaks against it.
    refused: Option<String>,
}

/// Judges the table by what is required and by every run. All runs are judged and reported before a failure ends
/// it.
pub(super) fn verify(
    require: Option<Requirement>,
    plan: &Plan,
    journal: &mut Journal,
    fit: &FittedTable,
    stop_signal: &AtomicUsize,
) -> Result<(), InstallationRefusal> {
    let Some(verify) = &plan.verify else { return Ok(()) };
    let calibration = &fit.calibration;
    let in_force = fit.in_force.as_ref().map(|in_force| &in_force.table);
    let gate = gate(require, verify, calibration)?;
    // Causes that the journal has with no run.
    let mut causes = Vec::new();
    if let Some(gate) = &gate {
        causes.extend(gate.refuses_table(calibration, in_force).into_iter().map(|refusal| refusal.cause));
    }
    let mut exercised = ExercisedChannels::default();
    let (mut refused_runs, mut failed) = (Vec::new(), Vec::new());
    for (index, run) in plan.run_files().into_iter().enumerate() {
        check_stop_signal(stop_signal)?;
        let attitude = verify.attitude(index);
        let setup = setup_of(plan, calibration, attitude);
        let verdict = fit.verify_run(&plan.output.join(&run), &setup, gate.as_ref(), &mut exercised);
        let (largest, failure) = match verdict {
            Ok(RunVerdict { largest, refused }) => (largest, refused.map(|causes| Failure::new(Exit::Failed, causes))),
            Err(failure) => (None, Some(failure)),
        };
        let refused = failure.as_ref().map(ToString::to_string);
        let entry = Entry::Verified { run: run.clone(), angles_deg: attitude.angles, largest, refused };
        journal.write_synced(entry)?;
        if let Some(failure) = failure {
            let lines: Vec<_> = failure.message.lines().map(|line| format!("{run}: {line}")).collect();
            failed.push(Failure::new(failure.exit, lines.join("\n")));
            refused_runs.push(run);
        }
    }
    let reasons = exercised.not_judged(&calibration.table);
    for reason in &reasons {
        print_message(&format!("not judged: {reason}"));
    }
    if !reasons.is_empty() {
        journal.write_synced(Entry::NotJudged { reasons })?;
    }
    let together = gate.map(|gate| gate.refuses_together(&exercised, &calibration.table, in_force));
    causes.extend(together.into_iter().flatten().map(|refusal| with_remedy(plan, refusal)));
    failed.extend(causes.iter().map(|cause| Failure::new(Exit::Failed, cause.clone())));
    let Some(failure) = Failure::all(failed) else { return Ok(()) };
    let pages: Vec<_> = refused_runs.iter().map(|run| run.replace(".csv", ".html")).collect();
    let remedy = if pages.is_empty() { String::new() } else { format!("; look at {}", pages.join(", ")) };
    if !refused_runs.is_empty() {
        causes.push(format!("not shown by {}", refused_runs.join(", ")));
    }
    Err(InstallationRefusal { failure, reason: causes.join("\n"), remedy })
}

/// What every run must show, which it prints; `None` if nothing is required.
fn gate(
    require: Option<Requirement>,
    verify: &VerificationPlan,
    calibration: &Calibration,
) -> Result<Option<Gate>, Failure> {
    let Some(require) = require else { return Ok(None) };
    // One bound for all runs: that of the largest component along each accelerometer.
    let along = |axis: usize| verify.attitudes.iter().map(move |attitude| attitude.specific_force[axis].abs());
    let largest = [0, 1, 2].map(|axis| along(axis).fold(0.0, f64::max));
    let gate = Gate::new(require, calibration, largest).map_err(|message| Failure::new(Exit::Failed, message))?;
    print_message(&format!("every verification run must show {}", gate.require));
    if let Some(number) = calibration.suspect_position {
        print_message(&format!(
            "the residuals would fall to a third without position {number}: look at its angles; bounds that are not given are \
             therefore at most {:.0}e-6 g0",
            GATE_FLOOR * 1e6
        ));
    }
    Ok(Some(gate))
}

/// # Errors
/// If a signal has asked to end.
pub(super) fn check_stop_signal(stop_signal: &AtomicUsize) -> Result<(), Failure> {
    let stopped = |signal| Err(Failure::new(Exit::Failed, signal));
    stopped_by(stop_signal).map_or(Ok(()), stopped)
}

/// What is known of a run at this attitude: the specific force includes the tilt of the base that the fit has found.
fn setup_of(plan: &Plan, calibration: &Calibration, attitude: &Position) -> Setup {
    let force = plan.campaign.force(attitude, calibration.solution.tilt).0;
    let earth_rate = calibration.table.turntable().zip(attitude.angles);
    let earth_rate = earth_rate.map(|(turntable, angles)| EarthRate::at(turntable, angles));
    Setup { earth_rate, ..Setup::new(Some(force), LocalGravity::Stated(plan.campaign.gravity_local)) }
}

/// The cause of what all runs together refuse, and what runs of another plan would show.
fn with_remedy(plan: &Plan, GateRefusal { by, cause }: GateRefusal) -> String {
    let remedy = match by {
        GateRefusal::RUNS => Some(plan.whole_range()),
        GateRefusal::CHANNEL => plan.more_runs(),
        _ => None,
    };
    remedy.map_or_else(|| cause.clone(), |remedy| format!("{cause}: {remedy}"))
}

impl FittedTable {
    /// Prints what a verification run shows, writes its report, and adds it to what is exercised.
    fn verify_run(
        &self,
        recording: &Path,
        setup: &Setup,
        gate: Option<&Gate>,
        exercised: &mut ExercisedChannels,
    ) -> Result<RunVerdict, Failure> {
        let table = &self.calibration.table;
        // What the runs leave out is judged of all together.
        let stability = Stability { accepts_holes: true, ..stability(table, recording, setup)? };
        exercised.add(&stability);
        let run = recording.file_name().unwrap_or_default().to_string_lossy();
        let aligned = table.content().alignment.is_some();
        print(&format!("{run}:\n{}", report::text::stability(&stability, WINDOW_S, aligned)))?;
        if let Some(gate) = gate {
            print(&report::text::judgements(&gate.require.judge(&stability)))?;
        }
        let source = VerificationSource {
            tool: tool(),
            time: now(),
            table: self.digest(),
            recording: recording.display().to_string(),
            window_s: WINDOW_S,
            required: gate.map(|gate| gate.require),
        };
        let page = report::verification::html(table, &stability, &source);
        StagedText::create(Some(&recording.with_extension("html")))?.write(&page)?.finish()?;
        let (of, Estimate { value, interval }) = stability.verdict.largest();
        let largest = LargestError { of: of.to_owned(), error_g0: value, interval_g0: interval };
        let largest = Some(largest)
            .filter(|_| stability.nothing_claimed().is_none() && value.is_finite() && interval.is_finite());
        let Some(gate) = gate else { return Ok(RunVerdict { largest, refused: stability.nothing_claimed() }) };
        let present = self.in_force.as_ref().map(|in_force| self::stability(&in_force.table, recording, setup));
        let (present, not_compared) = match present.transpose() {
            Ok(present) => (present, None),
            Err(failure) => (None, Some(format!("the table in force cannot judge it: {failure}"))),
        };
        let is_accepted = self.calibration.options.accept.contains(&name::NOT_COMPARED);
        if let Some(cause) = not_compared.as_ref().filter(|_| is_accepted) {
            print_message(&format!("{run}: {cause}"));
        }
        let not_compared = not_compared.filter(|_| !is_accepted).map(|cause| {
            format!(
                "{cause}; so nothing shows that the new table is not worse: move the table in force away, or accept it: --accept not-compared"
            )
        });
        let causes = gate.refuses_run(&stability, present.as_ref()).into_iter().map(|GateRefusal { cause, .. }| cause);
        let causes = causes.chain(not_compared);
        let refused = Some(causes.collect::<Vec<_>>().join("\n")).filter(|causes| !causes.is_empty());
        Ok(RunVerdict { largest, refused })
    }
}

/// The stability of a recording under a table.
fn stability(table: &CoefficientTable, recording: &Path, setup: &Setup) -> Result<Stability, Failure> {
    let (files, imu) = ([recording.to_owned()], ImuChoice::Prefer(table.content().imu.clone()));
    VerificationRun::open(table, &files, imu, None, WINDOW_S, &no_bar(&files, "reading"))?.finish(setup)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_recording::{Layout, RawCsvWriter};
    use isotherm_shared::wire::RawSample;
    use isotherm_simulation::{Noise, RunSchedule, Truth, run};

    /// Of a run that is recorded twice in one file, in two sessions: both begin soaked, so both have the same windows.
    #[test]
    fn a_second_session_of_a_verification_run_begins_soaked() {
        let table = include_str!("../../../../examples/tables/imu-paper.toml");
        let mut content = CoefficientTable::from_toml(table, None).unwrap().content().clone();
        (content.format, content.lag_s, content.axes[0].transient) = (2, Some(240.0), 350.0);
        let truth = Truth::of(CoefficientTable::new(content).unwrap());
        let schedule = RunSchedule {
            direction: [0.6, -0.48, 0.64],
            ramp_c_per_s: 70.0 / 3600.0,
            hold_s: 60.0,
            interval_ns: 1_000_000_000,
            noise: Noise::NONE,
            ..RunSchedule::default()
        };
        let rows: Vec<_> = run(&truth, &schedule, 1).take(3600).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        let mut writer = RawCsvWriter::with_layout(Vec::new(), "session", true, Layout::default()).unwrap();
        for session in [1, 2] {
            for raw in &rows {
                let later = (session - 1) * 3600 * 1_000_000_000;
                let (timestamp_ns, telemetry_ns) = (raw.timestamp_ns + later, raw.telemetry_ns + later);
                let raw = RawSample { session, timestamp_ns, telemetry_ns, ..*raw };
                writer.write(format!("{session:016x}"), &raw).unwrap();
            }
        }
        std::fs::write(&path, writer.finish().unwrap()).unwrap();
        let setup = Setup::new(Some(schedule.direction), LocalGravity::Stated(truth.table.content().gravity));
        let windows = stability(&truth.table, &path, &setup).unwrap().windows;
        let (first, second) = windows.split_at(360);
        assert_eq!((first.len(), second.len()), (360, 360));
        for (first, second) in first.iter().zip(second) {
            assert!((first.after[0] - second.after[0]).abs() < 1e-12, "{} {}", first.after[0], second.after[0]);
        }
    }
}
