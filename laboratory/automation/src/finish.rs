//! The steps after the campaign's data are complete: fit, verify, install.
//!
//! Over 400 lines: the steps in their order, with what each hands on.

use super::in_force::{InForce, changes};
use super::journal::{self, Entry, History, JOURNAL, Journal, LargestError};
use super::machine::Unit;
use super::page;
use super::plan::Plan;
use super::progress::DroppedImu;
use super::runner::stopped_by;
use super::samples::file_of;
use isotherm_client::{Options, fetch_status};
use isotherm_files::{Installation, StagedText, print};
use isotherm_fit::{Accuracy, AlignmentChoice, Calibration, CalibrationOptions, CalibrationOutcome, LagChoice, tool};
use isotherm_pipeline::{CampaignFile, FitOptions, Inputs, Run, no_bar, now};
use isotherm_recording_formats::read::ImuChoice;
use isotherm_report as report;
use isotherm_report::verification::VerificationSource;
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::{Exit, Failure, printable, shown, tell};
use isotherm_support::finding::name;
use isotherm_verification::{
    EarthRate, Estimate, ExercisedChannels, GATE_FLOOR, Gate, LocalGravity, Refusal, Requirement, Setup, Stability,
};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::{Duration, Instant};

/// Begin of the name of the fitted table in the campaign's folder; see [`Plan::file`].
const TABLE: &str = "table";
/// Why the table of an IMU that is dropped is not installed.
const DROPPED: &str = "it is not verified: the IMU is dropped, and verification runs of it are missing";
/// Longest time until the service has the installed table in force; it takes milliseconds if the service watches the
/// file.
const IN_FORCE_TIMEOUT: Duration = Duration::from_secs(10);

/// Options of the steps after the data.
#[derive(Clone, Debug)]
pub struct Finish {
    /// What every verification run must show; bounds that are not given come from the fit ([`Requirement::of_fit`]).
    /// `None` installs nothing.
    pub require: Option<Requirement>,
    /// Whether the table gets an alignment matrix. If it is not said, the table in force decides, and the fit if there
    /// is none.
    pub alignment: AlignmentChoice,
    /// How the time constant of the lag is found, from the ramps.
    pub lag: LagChoice,
    /// Names of faults that count as warnings.
    pub accept: Vec<&'static str>,
    /// Whether every warning that is not accepted is a fault.
    pub strict: bool,
}

impl Finish {
    /// Fits the table, verifies it with every run, and installs it if all runs show what is required, none shows that
    /// the table in force is better, and no signal has asked to end. The journal has what becomes of each step, and so
    /// has the live page. Of a batch each IMU that is not dropped has its own table; a failure of one does not stop the
    /// others. One that is dropped has its table, which is neither verified nor installed, if only verification runs of
    /// it are missing.
    ///
    /// # Errors
    /// The step that has failed; of a batch those of all IMUs, with [`Exit::Failed`]. A failure before the installation
    /// leaves the installed table unchanged.
    pub fn run(
        self,
        plan: &Plan,
        journal: &mut Journal,
        options: &Options,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Failure> {
        let result = if plan.is_batch() {
            self.batch(plan, journal, options, stop_signal)
        } else {
            self.steps(plan, journal, options, stop_signal, false)
        };
        if let Err(error) = page::rewrite(plan) {
            tracing::warn!("writing the live page: {error}");
        }
        result
    }

    /// The steps of each IMU of a batch, as far as its data allow if it is dropped.
    fn batch(
        &self,
        plan: &Plan,
        journal: &mut Journal,
        options: &Options,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Failure> {
        let history = history(plan)?;
        let mut failed = Vec::new();
        for plan in plan.each() {
            let is_dropped = history.reason_dropped(&plan.imu).is_some();
            if is_dropped && !has_all_to_fit(plan, &history) {
                continue;
            }
            check_stop_signal(stop_signal)?;
            journal.about(Some(&plan.imu));
            let result = self.steps(plan, journal, options, stop_signal, is_dropped);
            journal.about(None);
            if let Err(failure) = result {
                failed.extend(failure.message.lines().map(|line| format!("{}: {line}", plan.imu)));
            }
        }
        check_stop_signal(stop_signal)?;
        if failed.is_empty() { Ok(()) } else { Err(Failure::new(Exit::Failed, failed.join("\n"))) }
    }

    fn steps(
        &self,
        plan: &Plan,
        journal: &mut Journal,
        options: &Options,
        stop_signal: &AtomicUsize,
        is_dropped: bool,
    ) -> Result<(), Failure> {
        journal.write_synced(Entry::FitBegun)?;
        let fit = match self.fit(plan) {
            Ok(fit) => fit,
            Err(failure) => {
                return Err(noted(journal, Entry::NotCalibrated { reason: failure.to_string() }, failure));
            }
        };
        let accuracy = Accuracy::of(&fit.calibration);
        let accuracy = match Accuracy::of_gyroscopes(&fit.calibration) {
            Some(gyroscopes) => format!("accelerometers: {accuracy}; gyroscopes: {gyroscopes}"),
            None => accuracy.to_string(),
        };
        let transients = fit.calibration.transients.iter().flat_map(|found| &found.words);
        let accuracy = transients.fold(accuracy, |accuracy, words| format!("{accuracy}; {words}"));
        journal.write_synced(Entry::Calibrated { digest: fit.digest(), accuracy })?;
        let left_aside = plan.output.join(plan.file(TABLE, "toml"));
        let left_aside = shown(&left_aside);
        let mut verify_and_install = || {
            self.verify(plan, journal, &fit, stop_signal)?;
            check_stop_signal(stop_signal)?;
            match self.target(plan) {
                Ok(target) => Ok(fit.install(target).map(Ok)?),
                Err(reason) => Ok(Err(reason)),
            }
        };
        // The runs of one that is dropped are not complete.
        let installed = if is_dropped { Ok(Err(DROPPED)) } else { verify_and_install() };
        match installed {
            Ok(Ok(target)) => {
                // A journal is UTF-8, and is read from other working directories.
                let file = std::path::absolute(target).unwrap_or_else(|_| target.to_owned());
                let file = PathBuf::from(file.to_string_lossy().into_owned());
                journal.write_synced(Entry::Installed { digest: fit.digest(), file })?;
                wait_until_in_force(plan, &fit.calibration.table, options)
            }
            Ok(Err(reason)) => {
                print_message(&format!("{left_aside} is the table; it is not installed: {reason}"));
                journal.write_synced(Entry::NotInstalled { reason: reason.to_owned() })
            }
            Err(Refused { failure, reason, remedy }) => {
                let text = format!("{failure}\nnothing is installed; the table is left aside as {left_aside}{remedy}");
                Err(noted(journal, Entry::NotInstalled { reason }, Failure::new(failure.exit, text)))
            }
        }
    }

    /// The file to install the table in, or why none is wanted.
    fn target<'p>(&self, plan: &'p Plan) -> Result<&'p Path, &'static str> {
        let target = plan.install.as_deref().ok_or("the plan has no install")?;
        let wanted = self.require.is_some() && plan.verify.is_some();
        if wanted { Ok(target) } else { Err("that takes --require and [verify] runs") }
    }

    /// Fits the table of the campaign, and writes it with its report.
    fn fit(&self, plan: &Plan) -> Result<FittedTable, Failure> {
        let in_force = plan.install.as_deref().map(|target| InForce::read(target, plan)).transpose();
        let in_force = match in_force {
            Ok(in_force) => in_force.flatten(),
            Err(failure) if self.target(plan).is_ok() => return Err(failure),
            // Nothing is to be installed: the fit can do without it.
            Err(failure) => {
                print_message(&failure.to_string());
                None
            }
        };
        print_message(
            &plan.member.as_ref().map_or_else(|| "fitting".to_owned(), |member| format!("fitting {}", member.imu)),
        );
        let (calibration, text) = self.calibrate_campaign(plan, in_force.as_ref().map(|in_force| &in_force.table))?;
        for change in in_force.iter().flat_map(|in_force| changes(&in_force.table, &calibration.table)) {
            print_message(&format!("note: {change}"));
        }
        Ok(FittedTable { calibration, text, in_force })
    }

    /// Judges the table by what is required and by every run. All runs are judged and reported before a failure ends
    /// it.
    fn verify(
        &self,
        plan: &Plan,
        journal: &mut Journal,
        fit: &FittedTable,
        stop_signal: &AtomicUsize,
    ) -> Result<(), Refused> {
        let Some(verify) = &plan.verify else { return Ok(()) };
        let calibration = &fit.calibration;
        let in_force = fit.in_force.as_ref().map(|in_force| &in_force.table);
        // One bound for all runs: that of the largest component along each accelerometer.
        let along = |axis: usize| verify.attitudes.iter().map(move |attitude| attitude.specific_force[axis].abs());
        let most = [0, 1, 2].map(|axis| along(axis).fold(0.0, f64::max));
        let gate = self.require.map(|require| Gate::new(require, calibration, most)).transpose();
        let gate = gate.map_err(|message| Failure::new(Exit::Failed, message))?;
        // Causes that the journal has with no run.
        let mut causes = Vec::new();
        if let Some(gate) = &gate {
            print_message(&format!("every verification run must show {}", gate.require));
            if let Some(number) = calibration.suspect_position {
                print_message(&format!(
                    "the residuals would fall to a third without position {number}: look at its angles; bounds that are not given are \
                     therefore at most {:.0}e-6 g0",
                    GATE_FLOOR * 1e6
                ));
            }
            causes.extend(gate.refuses_table(calibration, in_force).into_iter().map(|refusal| refusal.cause));
        }
        let (mut refused_runs, mut failed) = (Vec::new(), Vec::new());
        let mut exercised = ExercisedChannels::default();
        for (index, run) in plan.run_files().into_iter().enumerate() {
            check_stop_signal(stop_signal)?;
            let attitude = verify.attitude(index);
            // It includes the tilt of the base that the fit has found.
            let force = plan.campaign.force(attitude, calibration.solution.tilt).0;
            let earth_rate = calibration.table.turntable().zip(attitude.angles);
            let earth_rate = earth_rate.map(|(turntable, angles)| EarthRate::at(turntable, angles));
            let gravity = LocalGravity::Stated(plan.campaign.gravity_local);
            let setup = Setup { earth_rate, ..Setup::new(Some(force), gravity) };
            let recording = plan.output.join(&run);
            let (largest, failure) = match fit.verify_run(&recording, &setup, gate.as_ref(), &mut exercised) {
                Ok((largest, refused)) => (largest, refused.map(|causes| Failure::new(Exit::Failed, causes))),
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
        causes.extend(together.into_iter().flatten().map(|Refusal { by, cause }| match by {
            "runs" => format!("{cause}: {}", plan.whole_range()),
            "channel" => plan.more_runs().map_or_else(|| cause.clone(), |runs| format!("{cause}: {runs}")),
            _ => cause,
        }));
        failed.extend(causes.iter().map(|cause| Failure::new(Exit::Failed, cause.clone())));
        let Some(failure) = Failure::all(failed) else { return Ok(()) };
        let pages: Vec<_> = refused_runs.iter().map(|run| run.replace(".csv", ".html")).collect();
        let remedy = if pages.is_empty() { String::new() } else { format!("; look at {}", pages.join(", ")) };
        if !refused_runs.is_empty() {
            causes.push(format!("not shown by {}", refused_runs.join(", ")));
        }
        Err(Refused { failure, reason: causes.join("\n"), remedy })
    }

    /// Fits the table of the IMU of `plan` from the campaign's folder, and writes it with its report. Returns also the
    /// text of the table.
    fn calibrate_campaign(
        &self,
        plan: &Plan,
        in_force: Option<&CoefficientTable>,
    ) -> Result<(Calibration, String), Failure> {
        let folder = &plan.output;
        let file = CampaignFile::read(&folder.join("campaign.toml"))?;
        let campaign = file.campaigns()?.into_iter().find(|campaign| campaign.imu == plan.imu);
        let campaign = campaign.ok_or_else(|| {
            let (file, imu) = (shown(&file.path), &plan.imu);
            let message = format!("{file}: {imu} is not in it; run the campaign again, which writes it anew");
            Failure::new(Exit::Data, message)
        })?;
        let options = FitOptions { turntable: self.options(in_force), ..FitOptions::default() };
        let inputs = Inputs::read(&campaign, Some(&file), Vec::new(), &options, &no_bar);
        let made = inputs.and_then(|inputs| inputs.fit(&campaign, Some(&file))).map_err(|refused| refused.failure)?;
        made.findings().for_each(|finding| print_message(&finding));
        let _ = io::stderr().write_all(printable(&made.text()).as_bytes());
        let write = |name: &str, extension, text: &str| {
            StagedText::create(Some(&folder.join(plan.file(name, extension))))?.write(text)
        };
        let texts = vec![write(TABLE, "toml", &made.table)?, write("calibration", "html", &made.html(&campaign))?];
        StagedText::finish_together(texts)?;
        match made.fitted {
            CalibrationOutcome::Campaign(calibration) => Ok((*calibration, made.table)),
            _ => Err(Failure::new(Exit::Failed, "an automatic campaign has positions")),
        }
    }

    /// The options of the fit. A vehicle is boresighted with the axes of the table in force, so an installation keeps
    /// them.
    fn options(&self, in_force: Option<&CoefficientTable>) -> CalibrationOptions {
        let alignment = match (self.alignment, in_force) {
            (AlignmentChoice::IfNeeded, Some(table)) => {
                let with = table.content().alignment.is_some();
                let word = if with { "with" } else { "without" };
                print_message(&format!("{word} an alignment matrix, as the table in force"));
                AlignmentChoice::of(with, !with)
            }
            (choice, _) => choice,
        };
        CalibrationOptions {
            alignment,
            accept: self.accept.clone(),
            strict: self.strict,
            lag: self.lag,
            predecessor_lag_s: in_force.and_then(|table| table.content().lag_s),
            ..CalibrationOptions::default()
        }
    }
}

/// The IMUs of the batch of `plan` that are dropped.
///
/// # Errors
/// If the journal cannot be read.
pub fn dropped(plan: &Plan) -> Result<Vec<DroppedImu>, Failure> {
    let dropped = history(plan)?.dropped.into_iter();
    Ok(dropped.map(|(imu, reason)| DroppedImu { imu, reason }).collect())
}

fn history(plan: &Plan) -> Result<History, Failure> {
    let (lines, _) = journal::read(&plan.output.join(JOURNAL))?;
    Ok(journal::history(&lines))
}

/// Whether every dwell, turn and ramp of the IMU of `plan` is complete.
fn has_all_to_fit(plan: &Plan, history: &History) -> bool {
    let units = (0..).map_while(|index| Unit::of(plan, index)).take_while(|unit| !matches!(unit, Unit::Run(_)));
    units.enumerate().all(|(index, unit)| {
        let file = file_of(unit, plan);
        history.kept.get(index).is_some_and(|kept| kept.each().any(|kept| kept.file == file))
    })
}

/// Length of the windows of the stability \[s\].
const WINDOW_S: f64 = 10.0;

/// Why the table is not installed.
struct Refused {
    /// For the operator, with every reason.
    failure: Failure,
    /// For the journal, which has the reasons of each run already.
    reason: String,
    /// Where to look, for the last line.
    remedy: String,
}

impl From<Failure> for Refused {
    fn from(failure: Failure) -> Self {
        Self { reason: failure.to_string(), failure, remedy: String::new() }
    }
}

/// A fitted table, and the one that it may replace.
struct FittedTable {
    calibration: Calibration,
    /// The text of its file.
    text: String,
    in_force: Option<InForce>,
}

impl FittedTable {
    fn digest(&self) -> String {
        self.calibration.table.digest().to_string()
    }

    /// Prints what a verification run shows, writes its report, and adds it to what is exercised. Returns the largest
    /// error, and why the table must not be installed, one reason a line.
    fn verify_run(
        &self,
        recording: &Path,
        setup: &Setup,
        gate: Option<&Gate>,
        exercised: &mut ExercisedChannels,
    ) -> Result<(Option<LargestError>, Option<String>), Failure> {
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
        let Some(gate) = gate else { return Ok((largest, stability.nothing_claimed())) };
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
        let causes = gate.refuses_run(&stability, present.as_ref()).into_iter().map(|Refusal { cause, .. }| cause);
        let causes = causes.chain(not_compared);
        let refused = Some(causes.collect::<Vec<_>>().join("\n")).filter(|causes| !causes.is_empty());
        Ok((largest, refused))
    }

    /// Installs the table as `target`, unless it is in force already.
    fn install<'t>(&self, target: &'t Path) -> Result<&'t Path, Failure> {
        let installation = Installation::lock(target)?;
        installation.check_unchanged(self.in_force.as_ref().map(|in_force| in_force.state))?;
        let (digest, place) = (self.digest(), shown(target));
        if self.in_force.as_ref().is_some_and(|in_force| in_force.table.digest().to_string() == digest) {
            print_message(&format!("{digest} is installed as {place} already"));
            return Ok(target);
        }
        let has_predecessor = installation.install(&self.text)?;
        print_message(&format!("{digest} is installed as {place}"));
        if has_predecessor {
            let kept = shown(installation.previous());
            print_message(&format!("its predecessor is kept as {kept}; `isotherm rollback {place}` brings it back"));
        }
        Ok(target)
    }
}

/// The stability of a recording under a table.
fn stability(table: &CoefficientTable, recording: &Path, setup: &Setup) -> Result<Stability, Failure> {
    let (files, imu) = ([recording.to_owned()], ImuChoice::Prefer(table.content().imu.clone()));
    Run::open(table, &files, imu, None, WINDOW_S, &no_bar(&files, "reading"))?.finish(setup)
}

/// Notes in the journal why a step has failed. If that fails too, the failure says both.
fn noted(journal: &mut Journal, entry: Entry, failure: Failure) -> Failure {
    match journal.write_synced(entry) {
        Ok(()) => failure,
        Err(second) => Failure::new(failure.exit, format!("{failure}\n{second}")),
    }
}

fn check_stop_signal(stop_signal: &AtomicUsize) -> Result<(), Failure> {
    let stopped = |signal| Err(Failure::new(Exit::Failed, signal));
    stopped_by(stop_signal).map_or(Ok(()), stopped)
}

fn print_message(message: &str) {
    tell("isotherm", message);
}

/// Waits until the service's status shows the table in force.
fn wait_until_in_force(plan: &Plan, table: &CoefficientTable, options: &Options) -> Result<(), Failure> {
    let begun = Instant::now();
    let digest = table.digest().to_string();
    let mut is_refused = false;
    loop {
        let status = fetch_status(options);
        let cause = match &status {
            Ok(status) => match status.imus.iter().find(|imu| imu.id == plan.imu.to_string()) {
                Some(imu) if imu.table.as_deref() == Some(&digest) => {
                    print_message("the service has it in force");
                    return Ok(());
                }
                Some(imu) => {
                    is_refused = imu.refused_table.as_deref() == Some(&digest);
                    imu.last_reload_error.clone().unwrap_or_else(|| format!("it watches {}", imu.table_file))
                }
                None => format!("it does not serve {}", plan.imu),
            },
            Err(error) => error.to_string(),
        };
        if is_refused || begun.elapsed() > IN_FORCE_TIMEOUT {
            let message = format!("the table is installed, but the service does not have it in force: {cause}");
            return Err(Failure::new(Exit::Unavailable, message));
        }
        thread::sleep(Duration::from_millis(50));
    }
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
        let table = include_str!("../../../examples/tables/imu-paper.toml");
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
